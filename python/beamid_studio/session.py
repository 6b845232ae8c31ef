"""The work of one tab: its case, its record, its fits, and its folder."""
from __future__ import annotations

import itertools
import re
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import cases
import numpy as np

from beamid_studio import recordings, runs
from beamid_studio.case_model import Case, Input, number_text, quoted
from beamid_studio.checks import Found, Remark, remark_of, verdict_remarks
from beamid_studio.records import Force, Record

#: A case to begin with: metres, newtons, seconds and kilograms, a free decay.
NEW = """&units length='m', force='N', time='s', mass='kg' /
&excitation kind='free', modes=3 /
&record /
&stage free='E','c_D','gamma','offset' /
&prior parameter='length', sd=0.001 /
&prior parameter='height', sd=2e-5 /
"""
#: Standard deviations to begin with, as shares of the value that the user has entered.
SHARES = {"m_S": 0.1, "density": 0.01}
#: Sessions of closed tabs that are kept, so that a tab can come back.
KEPT = 4
#: An excitation to begin with.
FREE = {"kind": ["'free'"], "modes": ["3"]}
COMMENT = """Written by beamid studio, from {name}.

   beamid identify case.nml

repeats the fit, and `beamid help` explains every group and key."""


@dataclass
class Result:
    """A fit, and what was done with it."""

    number: int
    folder: Path        #: with the outputs
    case: str           #: text of the case file
    status: int
    error: str = ""
    remarks: list[Remark] = field(default_factory=list)
    records: list[Record] = field(default_factory=list)    #: as they were at its beginning
    presets: dict[str, str | None] = field(default_factory=dict)    #: as those of `Session`

    @property
    def name(self) -> str:
        """What the page calls the fit."""
        return f"fit {self.number}"

    @property
    def is_refused(self) -> bool:
        """Whether the program has refused the case, or failed without estimates."""
        return not self.has_outputs

    @property
    def has_outputs(self) -> bool:
        """Whether the program has written estimates."""
        return (self.folder / "estimates.csv").exists() and (self.folder / "manifest.txt").exists()


class Session:
    """The state behind one tab of the browser; it outlives the pages that the tab loads."""

    every: ClassVar[dict[str, Session]] = {}    #: by key; the longest without a page first
    number: ClassVar[itertools.count[int]] = itertools.count(1)

    def __init__(self, root: Path, limit: int) -> None:
        self.root, self.limit = root, limit
        self.key = str(next(self.number))
        self.page: Any = None            #: the page that shows the session now
        self.tab = self.client = ""      #: NiceGUI's names of the tab, and of the page in it
        self.step = "record"             #: the step that the page shows
        self.chosen_units: dict[tuple[str, ...], str] = {}    #: of the fields of the page
        self.folder: Path | None = None
        self.case = Case(NEW)
        #: standard deviations that nobody has checked; None: the user's own, or none
        self.presets: dict[str, str | None] = {
            keys["parameter"][0].strip("'"): keys["sd"][0] for keys in self.case.all("prior")}
        self.name = ""                   #: of the file, as the user calls it
        self.records = [Record(self.case.first("record"))]    #: of the case, in its order
        self.found = Found()
        self.used: dict[str, np.ndarray] = {}    #: times that a fit uses, by the case of a record
        self.results: list[Result] = []
        self.run: runs.Run | None = None
        self.is_busy = False             #: whether a job is running, which has one run or none
        self.progress = ""               #: of the job
        self.closed = False
        Session.every[self.key] = self

    # -- the life of a tab

    @classmethod
    def of_tab(cls, memory: dict[str, Any], tab: str, root: Path, limit: int) -> Session:
        """Return the session that a tab had before it was reloaded; a new one if it had none.

        memory  what NiceGUI keeps for the tab. A tab that the user has duplicated begins with a
                copy of it, but leaves the session to the tab that shows it.
        tab     NiceGUI's name of the tab
        """
        session = cls.every.get(memory.get("session", ""))
        if session is None or (session.page and session.page.is_connected and session.tab != tab):
            session = cls(root, limit)
        memory["session"], session.tab = session.key, tab
        return session

    def leave(self, page: Any, asleep: bool) -> None:
        """Keep the session without its page, in case that the tab is loaded again.

        page    the page that has been closed; nothing happens if another one shows the session
        asleep  whether the tab may come back; otherwise its run ends
        """
        if self.page is not page or self.closed:
            return
        self.page = None
        if self.run and not asleep:
            self.run.kill()
        Session.every[self.key] = Session.every.pop(self.key)
        alone = [session for session in Session.every.values() if session.page is None]
        for session in alone[:-KEPT]:
            session.close()

    def close(self) -> None:
        """End what the tab has started; its folder stays if it holds a fit."""
        self.closed = True
        if self.run:
            self.run.kill()
        if self.folder and not self.results:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.records, self.used, self.found = [], {}, Found()
        Session.every.pop(self.key, None)

    @classmethod
    def close_all(cls) -> None:
        """End what every tab has started."""
        for session in list(cls.every.values()):
            session.close()
        for run in list(runs.ALL):
            run.kill()

    def preset(self, name: str, value: str) -> None:
        """State a share of a value as its standard deviation, unless the user has chosen one."""
        number = float(number_text(value) or 0)
        if name in SHARES and self.presets.get(name, "") is not None and number > 0:
            self.presets[name] = f"{SHARES[name] * number:.2g}"
            self.case.set_prior(name, self.presets[name])

    # -- the records

    @property
    def record(self) -> Record:
        """The record that is edited."""
        return self.records[self.case.chosen]

    def begin(self, name: str) -> Path:
        """Return a new folder for a file, and forget the fits of the one before."""
        stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(name).stem)[:40].strip("-") or "record"
        k = 1
        while True:
            folder = self.root / (stem if k == 1 else f"{stem}-{k}")
            try:
                folder.mkdir()
                break
            except FileExistsError:
                k += 1
        if self.folder and not self.results:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.folder, self.results, self.name = folder, [], name
        return folder

    def take(self, recording: recordings.Recording, further: bool = False) -> None:
        """Make a recording the record of the case, or a further one; the beam stays as it is."""
        was_in_time = self.is_in_time
        if further:
            each = self.has_own_excitations
            record = Record(self.case.add("record"))
            if each:
                self.case.add("excitation").update(FREE)
        else:
            self.begin(recording.name)
            for _ in self.records[1:]:
                self.case.remove_record(1)
            if any("file" in keys for keys in self.case.all("excitation")):
                self.case.remove("excitation")    # its table belongs to the records before
            record = Record(self.case.first("record"))
            record.keys.clear()
            self.records = []
        self.records.append(record)
        self.case.chosen = len(self.records) - 1
        record.name, record.recording = recording.name, recording
        record.keys["file"] = [quoted(self.fresh_file("record"))]
        record.choose(recording.chosen)
        self.follow_kinds(was_in_time)

    def choose(self, place: int) -> None:
        """Make a column of its file the record that is edited."""
        was_in_time = self.is_in_time
        self.renew_record()
        self.record.choose(place)
        self.follow_kinds(was_in_time)

    def remove_record(self) -> None:
        """Remove the record that is edited, unless it is the only one."""
        if len(self.records) > 1:
            was_in_time, place = self.is_in_time, self.case.chosen
            self.case.remove_record(place)
            del self.records[place]
            self.follow_kinds(was_in_time)

    @property
    def is_in_time(self) -> bool:
        """Whether a record consists of accelerations in time."""
        return any(record.kind == "time" for record in self.records)

    def follow_kinds(self, was_in_time: bool) -> None:
        """Estimate an offset once there is a record in time, and none without one."""
        if self.is_in_time and not self.case.all("excitation"):
            self.case.add("excitation").update(FREE)
        names = [name for name in self.case.free if name != "offset"]
        if was_in_time != self.is_in_time:
            self.case.free = [*names, "offset"] if self.is_in_time else names

    @property
    def has_own_excitations(self) -> bool:
        """Whether each of several records has an excitation of its own."""
        return len(self.case.all("excitation")) == len(self.records) > 1

    @property
    def moved(self) -> Record:
        """The record whose motion is edited: the first one if all have the same."""
        return self.record if self.has_own_excitations else self.records[0]

    def set_own_excitations(self, own: bool) -> None:
        """Give each record an excitation of its own that begins as that of all, or undo this."""
        first = dict(self.case.first("excitation"))
        self.case.remove("excitation")
        for _ in self.records if own else self.records[:1]:
            self.case.add("excitation").update(first)
        for record in self.records[1:]:
            record.force = None

    def set_excitation(self, kind: str) -> None:
        """Set the kind of the motion that is edited."""
        keys = self.case.first("excitation")
        place = {key: value for key, value in keys.items() if key == "x_f" and kind != "free"}
        keys.clear()
        keys.update({**FREE, "kind": [quoted(kind)]} if kind == "free" else
                    {"kind": [quoted(kind)], **place})
        self.moved.force = None

    def set_force(self, force: Force) -> None:
        """Set the measured force of the motion that is edited."""
        if self.moved.force is None or self.results or self.is_busy:
            self.case.set("excitation", "file", quoted(self.fresh_file("force")))
        self.moved.force, self.moved.unwritten = force, True
        for key in ("time_column", "value_column", "rate"):
            self.case.set("excitation", key, None)

    def fresh_file(self, stem: str) -> str:
        """Return a name for a table that neither the case nor a fit has used."""
        assert self.folder is not None
        used = {cases.unquoted(keys["file"]) for _, keys in self.case.groups if "file" in keys}
        names = itertools.chain([f"{stem}.csv"], (f"{stem}_{k}.csv" for k in itertools.count(2)))
        return next(name for name in names
                    if name not in used and not (self.folder / name).exists())

    def renew_record(self) -> None:
        """Give the record a new file before it changes, if a fit has used the present one."""
        if self.results or self.is_busy:
            self.record.keys["file"] = [quoted(self.fresh_file("record"))]
            if self.moved is self.record and self.record.force:
                self.case.set("excitation", "file", quoted(self.fresh_file("force")))
        self.record.unwritten = True

    def write_records(self) -> None:
        """Write the records that have changed as the tables that the case names."""
        each = self.case.all("excitation")
        for k, record in enumerate(self.records):
            if record.unwritten and self.folder:
                self.used.clear()
                keys = each[k if self.has_own_excitations else 0] if each else {}
                name = Path(cases.unquoted(keys.get("file", []))).name
                record.write(self.folder, self.folder / name if name and record.force else None)

    @property
    def lacking(self) -> str:
        """What the records still need before a fit, or ''."""
        if not self.folder or not self.records[0].get("file"):
            return "Open a recorder's file first."
        without = [k for k, record in enumerate(self.records, 1) if record.lacks_rate]
        return (f"Record {without[0]} still needs its samples per second." if without else "")

    def case_text(self) -> str:
        """Return the case file that a fit reads."""
        return self.case.text(comment=COMMENT.format(name=" ".join(self.name.split())))

    # -- fits

    @property
    def latest(self) -> Result | None:
        """The last fit with estimates."""
        return next((one for one in reversed(self.results) if one.has_outputs), None)

    def changes(self, result: Result) -> list[Input]:
        """Return the inputs in which the case as it stands differs from that of a fit."""
        now, then = self.case.inputs(), Case(result.case).inputs()
        return [place for place in {**then, **now} if now.get(place) != then.get(place)]

    def unchecked(self, result: Result) -> list[str]:
        """Return the parameters of a fit whose errors are presets that nobody has checked."""
        if result.is_refused:
            return []
        case = Case(result.case)
        return [name for name, sd in result.presets.items()
                if sd is not None and self.presets.get(name) is not None
                and (case.prior(name) or {}).get("sd") == [sd]]

    def hear(self, line: str) -> None:
        """Show a line of the program's progress on the page."""
        self.say(runs.progress_text(line))

    def say(self, progress: str) -> None:
        """Show the progress of the job on the page, and whether it is running."""
        self.progress = progress
        if self.page:
            self.page.show_progress()

    async def fit(self) -> Result | None:
        """Fit the case as it stands; return nothing if the fit was cancelled."""
        assert self.folder is not None
        number = 1 + max((result.number for result in self.results), default=0)
        out = self.folder / f"fit_{number}"
        shutil.rmtree(out, ignore_errors=True)
        text = self.case_text()
        path = self.folder / "case.nml"
        path.write_text(text, encoding="utf-8")
        kept = self.kept()
        self.run = runs.Run("identify", path, out, self.hear)
        try:
            status = await self.run.go()
            error = self.run.error
        finally:
            self.run = None
        if status == -2:
            shutil.rmtree(out, ignore_errors=True)
            return None
        summary = out / "summary.txt"
        remarks = (verdict_remarks(summary.read_text(encoding="utf-8")) if summary.exists() else
                   [remark_of(line, "error") for line in error.splitlines()] if status else [])
        result = Result(number, out, text, status, error if status else "", remarks, *kept)
        self.results.append(result)
        return result

    def kept(self) -> tuple[list[Record], dict[str, str | None]]:
        """Return copies of the records and presets, which a result needs to be taken back."""
        return [replace(record) for record in self.records], dict(self.presets)

    def take_back(self, result: Result) -> None:
        """Make the inputs of a fit those of the page again; its tables are still there."""
        chosen, self.case = self.case.chosen, Case(result.case)
        self.records = [replace(record, keys=keys) for record, keys in
                        zip(result.records, self.case.all("record"))]
        self.case.chosen = min(chosen, len(self.records) - 1)
        self.used.clear()
        self.presets.clear()
        self.presets.update(result.presets)

    async def infer(self, command: str, result: Result, extra: str) -> str:
        """Run profile, sample, bootstrap or track on a fit; return what went wrong, or ''.

        extra  further groups of the case file
        """
        assert self.folder is not None
        path = self.folder / f"{command}.nml"
        path.write_text(result.case + extra, encoding="utf-8")
        out = result.folder if command != "track" else result.folder / "track"
        self.run = runs.Run(command, path, out, self.hear)
        try:
            status = await self.run.go()
            error = self.run.error
        finally:
            self.run = None
            path.unlink(missing_ok=True)
        return "cancelled" if status == -2 else error if status else ""

    # -- an existing case

    def open_case(self, path: Path) -> None:
        """Restore a case file, or the output folder of a fit, with its records.

        Raises recordings.Unreadable with one sentence.
        """
        file = path / "case.txt" if path.is_dir() else path
        try:
            text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "is no text in UTF-8"
            raise recordings.Unreadable(f"{file.name}: {reason}") from None
        case = Case(text)
        records = case.all("record")
        if not case.all("beam") or not records:
            raise recordings.Unreadable(f"{file.name}: found no &beam or no &record, expected a "
                                        "case file of a fit")
        names = [Path(cases.unquoted(keys.get("file", []))).name for keys in records]
        places = [file.parent, *([path.parent, Path.cwd(), *Path.cwd().glob("*/")]
                                 if path.is_dir() else [])]
        name = path.name if path.is_dir() else file.parent.name + "-" + file.stem
        copies: dict[Path, str] = {}
        for k, keys in enumerate(keys for group in ("record", "excitation")
                                 for keys in case.all(group) if "file" in keys):
            given = cases.unquoted(keys["file"])
            source = next((place / given for place in places if (place / given).is_file()), None)
            if source is None:
                raise recordings.Unreadable(f"{file.name}: found no {given} beside it; open the "
                                            "case file in the folder of its record")
            if source.stat().st_size > self.limit:
                raise recordings.Unreadable(f"{given}: is larger than {self.limit // 10**6} MB")
            target = copies.setdefault(source, f"table_{k + 1}.csv" if k else "record.csv")
            keys["file"] = [quoted(target)]
        folder = self.begin(name)
        for source, target in copies.items():
            shutil.copyfile(source, folder / target)
        self.case, self.name = case, path.name
        self.presets.clear()
        self.presets.update(dict.fromkeys(SHARES))
        self.records = [Record(keys, name=given) for keys, given in zip(records, names)]
        for record in self.records:
            record.read(folder)
        if path.is_dir():
            self.restore_results(path)

    def restore_results(self, path: Path) -> None:
        """Take a copy of the outputs of a fit into the folder of the tab."""
        assert self.folder is not None
        if not (path / "estimates.csv").exists():
            return
        out = self.folder / "fit_1"
        shutil.copytree(path, out, ignore=shutil.ignore_patterns("report.html", "track"))
        summary = out / "summary.txt"
        text = summary.read_text(encoding="utf-8") if summary.exists() else ""
        self.results.append(Result(1, out, self.case_text(), int(text.startswith("no fit")), "",
                                   verdict_remarks(text), *self.kept()))
