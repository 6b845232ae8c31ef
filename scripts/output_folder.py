"""An output folder for report.py: which command wrote each file, the case file, the units."""

import re
from pathlib import Path

import plotting as p
from page import Summary
from program import read_text
from units import Units


def find_case(name):
    """Returns the path of the only case file of this name in the current folder or in a folder
    below it; None if there is none or more than one."""
    found = sorted({path.resolve() for pattern in (f"{name}.nml", f"*/{name}.nml")
                    for path in Path().glob(pattern)})
    return found[0] if len(found) == 1 else None


class Outputs:
    """The files of an output folder.

    `cases` are the case files that the user named. Without them the folder's own case.txt counts,
    then, for outputs of an earlier version, a case file with the name that the command printed, or
    with the name of the folder.
    """

    def __init__(self, folder, cases=()):
        self.folder = p.outputs(folder)
        self.name = self.folder.resolve().name
        lines = read_text(self.folder / "manifest.txt").splitlines()[1:]
        self.writers = {name: command for name, _, _, command in
                        (line.rsplit(" ", 3) for line in lines)}
        self.case_files = {Path(path).stem: read_text(path) for path in cases}
        self.case, self.case_note = self.find_text()
        self.units = Units.of_folder(self.folder, self.case)

    def find_text(self):
        """Returns the text of the case file, or None, and a sentence on where it comes from."""
        if self.case_files:
            return next(iter(self.case_files.values())), ""
        if (self.folder / "case.txt").exists():
            writer = self.writers.get("case.txt")
            others = [name for name in self.commands() if name != writer]
            return read_text(self.folder / "case.txt"), (
                f"The last command that wrote into this folder was `{writer}`, and this is its "
                f"case file. {', '.join(f'`{name}`' for name in others)} may have read another one."
                if others else "")
        printed = [read_text(self.folder / name) for name in ("summary.txt", "intervals.txt")
                   if self.has(name)]
        names = [match[1] for text in printed for match in [re.match(r"(\S+): ", text)] if match]
        path = next(filter(None, map(find_case, [*names, self.name])), None)
        if path is None:
            return None, ""
        return read_text(path), (f"The outputs hold no copy of the case file; this is "
                                 f"`{path.name}` as it is now.")

    def has(self, name):
        """Tells whether a file is there."""
        return (self.folder / name).exists()

    def written_by(self, name, *commands):
        """Tells whether one of the commands wrote a file."""
        return self.has(name) and self.writers.get(name) in commands

    def commands(self):
        """Returns the commands that have written files, in the order of the manifest."""
        return list(dict.fromkeys(self.writers.values()))

    def table(self, name, *columns):
        """Returns the rows of a CSV file."""
        return p.read_table(self.folder / name, *columns)

    def summary(self, *commands):
        """Returns what a command printed, if summary.txt is of one of the commands; else None."""
        if not self.written_by("summary.txt", *commands):
            return None
        return Summary(self.text("summary.txt"))

    def text(self, name):
        """Returns what a command printed into a file."""
        return read_text(self.folder / name)
