"""The work of one tab: its case, its record, its fits, and its folder."""
from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import cases
import numpy as np

from beamid_studio import recordings, runs
from beamid_studio.case_model import Case, number_text, quoted
from beamid_studio.checks import Found, Remark, verdict_remarks

#: A case to begin with: metres, newtons, seconds and kilograms, a free decay.
NEW = """&units length='m', force='N', time='s', mass='kg' /
&excitation kind='free', modes=3 /
&record file='record.csv' /
&stage free='E','c_D','gamma','offset' /
&prior parameter='length', sd=0.001 /
&prior parameter='height', sd=2e-5 /
"""
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

    @property
    def name(self) -> str:
        """What the page calls the fit."""
        return f"fit {self.number}"

    @property
    def has_outputs(self) -> bool:
        """Whether the program has written estimates."""
        return (self.folder / "estimates.csv").exists() and (self.folder / "manifest.txt").exists()


class Session:
    """The state behind one tab of the browser."""

    every: ClassVar[set[Session]] = set()

    def __init__(self, root: Path, limit: int) -> None:
        self.root, self.limit = root, limit
        self.folder: Path | None = None
        self.case = Case(NEW)
        self.name = ""                   #: of the file, as the user calls it
        self.recording: recordings.Recording | None = None
        self.rate = ""                   #: samples per second of a file without times
        self.t = self.z = np.empty(0)    #: times [s] and values of the record
        self.missing = 0
        self.found = Found()
        self.used: dict[str, np.ndarray] = {}    #: times that a fit uses, by the case of the record
        self.results: list[Result] = []
        self.run: runs.Run | None = None
        self.listeners: list[Callable[[], Any]] = []
        self.closed = False
        Session.every.add(self)

    # -- the life of a tab

    def is_closed(self) -> bool:
        """Return whether the tab has been closed, perhaps during a computation."""
        return self.closed

    def close(self) -> None:
        """End what the tab has started; its folder stays if it holds a fit."""
        self.closed = True
        if self.run:
            self.run.kill()
        if self.folder and not self.results:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.listeners.clear()
        self.recording, self.t, self.z = None, np.empty(0), np.empty(0)
        Session.every.discard(self)

    @classmethod
    def close_all(cls) -> None:
        """End what every tab has started."""
        for session in list(cls.every):
            session.close()
        for run in list(runs.ALL):
            run.kill()

    # -- the record

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

    def take(self, recording: recordings.Recording) -> None:
        """Make a recording the record of the case; the beam stays as it is."""
        self.begin(recording.name)
        self.recording, self.rate = recording, ""
        for key in ("t_first", "t_last", "scale", "offset", "rate", "time_column", "value_column"):
            self.case.set("record", key, None)
        self.case.set("record", "file", quoted("record.csv"))
        self.choose(recording.chosen)

    def choose(self, place: int) -> None:
        """Make a channel the record."""
        assert self.recording is not None
        self.recording.chosen = place
        factor = recordings.ACCELERATIONS.get(self.recording.unit, "")
        self.case.set("record", "scale", factor if factor not in ("", "1") else None)
        self.load_samples()

    def renew_record(self) -> None:
        """Give the record a new file before it changes, if a fit has used the present one."""
        if self.results:
            self.case.set("record", "file", quoted(f"record_{len(self.results) + 1}.csv"))

    def load_samples(self) -> None:
        """Take times and values of the channel, in seconds and in the unit of the file."""
        assert self.recording is not None
        self.t, self.z, self.missing = self.recording.samples(float(self.rate or 0))

    def write_record(self) -> None:
        """Write the record as the table that the case names."""
        if self.recording and self.folder and self.is_ready:
            self.used.clear()
            self.recording.write(self.record_file, float(self.rate or 0))

    @property
    def record_file(self) -> Path:
        """The table of the record, in the folder of the tab."""
        assert self.folder is not None
        # The name is one of those that the page has given, whatever the case file said.
        return self.folder / Path(self.case.get("record", "file") or "record.csv").name

    @property
    def is_ready(self) -> bool:
        """Whether there is a record with times."""
        return bool(self.t.size) and (self.recording is None or self.recording.has_times
                                      or bool(self.rate))

    @property
    def scale(self) -> float:
        """Factor from the unit of the file to that of the case."""
        try:
            return float(self.case.get("record", "scale") or 1)
        except ValueError:
            return 1.0

    @property
    def window(self) -> tuple[float, float]:
        """First and last time of the fit."""
        ends = [float(self.t[0]), float(self.t[-1])] if self.t.size else [0.0, 1.0]
        if self.found.onset is not None:
            ends[0] = self.found.onset
        given = [number_text(self.case.get("record", key)) for key in ("t_first", "t_last")]
        first, last = (float(text) if text else end for text, end in zip(given, ends))
        return first, last

    def case_text(self) -> str:
        """Return the case file that a fit reads."""
        return self.case.text(comment=COMMENT.format(name=" ".join(self.name.split())))

    # -- fits

    async def fit(self, heard: Callable[[str], None]) -> Result | None:
        """Fit the case as it stands; return nothing if the fit was cancelled."""
        assert self.folder is not None
        number = 1 + max((result.number for result in self.results), default=0)
        out = self.folder / f"fit_{number}"
        shutil.rmtree(out, ignore_errors=True)
        text = self.case_text()
        path = self.folder / "case.nml"
        path.write_text(text, encoding="utf-8")
        self.run = runs.Run("identify", path, out, heard)
        try:
            status = await self.run.go()
            error = self.run.error
        finally:
            self.run = None
        if status == -2:
            shutil.rmtree(out, ignore_errors=True)
            return None
        summary = out / "summary.txt"
        remarks = (verdict_remarks(summary.read_text(encoding="utf-8")) if summary.exists() else [])
        result = Result(number, out, text, status, error if status else "", remarks)
        self.results.append(result)
        return result

    async def infer(self, command: str, result: Result, extra: str,
                    heard: Callable[[str], None]) -> str:
        """Run profile, sample, bootstrap or track on a fit; return what went wrong, or ''.

        extra  further groups of the case file
        """
        assert self.folder is not None
        path = self.folder / f"{command}.nml"
        path.write_text(result.case + extra, encoding="utf-8")
        out = result.folder if command != "track" else result.folder / "track"
        self.run = runs.Run(command, path, out, heard)
        try:
            status = await self.run.go()
            error = self.run.error
        finally:
            self.run = None
            path.unlink(missing_ok=True)
        return "cancelled" if status == -2 else error if status else ""

    # -- an existing case

    def open_case(self, path: Path) -> None:
        """Restore a case file, or the output folder of a fit, with its first record.

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
        places = [file.parent, *([path.parent, Path.cwd(), *Path.cwd().glob("*/")]
                                 if path.is_dir() else [])]
        name = path.name if path.is_dir() else file.parent.name + "-" + file.stem
        copies: list[tuple[Path, str]] = []
        used = [keys for group in ("record", "excitation") for keys in case.all(group)
                if "file" in keys]
        for k, keys in enumerate(used):
            given = cases.unquoted(keys["file"])
            source = next((place / given for place in places if (place / given).is_file()), None)
            if source is None:
                raise recordings.Unreadable(f"{file.name}: found no {given} beside it; open the "
                                            "case file in the folder of its record")
            if source.stat().st_size > self.limit:
                raise recordings.Unreadable(f"{given}: is larger than {self.limit // 10**6} MB")
            target = "record.csv" if k == 0 else f"table_{k + 1}.csv"
            copies.append((source, target))
            keys["file"] = [quoted(target)]
        folder = self.begin(name)
        for source, target in copies:
            shutil.copyfile(source, folder / target)
        self.case, self.recording = case, None
        self.name = path.name
        try:
            self.t, a = cases.read_samples(folder / "case.nml", records[0])
            offset = cases.real(records[0], "offset", 0.0)
            self.z = a / self.scale + offset
        except (SystemExit, KeyError) as failure:    # a frequency response or a table of modes
            self.t = self.z = np.empty(0)
            if cases.unquoted(records[0].get("kind", [])).lower() not in ("frf", "modes"):
                raise recordings.Unreadable(getattr(failure, "message", str(failure))) from None
        self.missing = 0
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
        self.results.append(Result(1, out, self.case.text(), int(text.startswith("no fit")), "",
                                   verdict_remarks(text)))
