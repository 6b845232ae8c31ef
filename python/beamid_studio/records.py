"""The records of a case: the group of each, its table, its samples, and the force that moves it."""
from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path

import cases
import numpy as np
from program import Failure

from beamid_studio import recordings
from beamid_studio.case_model import number_text, quoted
from beamid_studio.recordings import FORCES

#: Keys of the window of the fit, by the kind of the record.
WINDOWS = {"time": ("t_first", "t_last"), "frf": ("f_first", "f_last"), "modes": ()}


#: Numbers of versions of samples.
VERSIONS = itertools.count(1)


@dataclass
class Force:
    """A measured force: a column of a file."""

    column: int
    recording: recordings.Recording | None = None    #: None: the file of the record
    unit: str = "N"


@dataclass(eq=False)
class Record:
    """A record of the case."""

    keys: dict[str, list[str]] = field(default_factory=dict)    #: of its group &record
    name: str = ""                     #: of the file, as the user calls it
    recording: recordings.Recording | None = None    #: None: a table of an existing case
    rate: str = ""                     #: samples per second of a file without times
    t: np.ndarray = field(default_factory=lambda: np.empty(0))    #: times [s], or frequencies [Hz]
    z: np.ndarray = field(default_factory=lambda: np.empty(0))    #: values, in the unit of the file
    modes: recordings.ModalTable | None = None       #: of a record of this kind
    force: Force | None = None         #: that moves the beam, if it has been measured
    missing: int = 0
    onset: float | None = None         #: start of the motion, behind a quiet lead-in
    unwritten: bool = False            #: whether it has changed since it was written
    version: int = 0                   #: another number for other samples
    is_unit_chosen: bool = False       #: whether the user has chosen the unit

    def get(self, key: str) -> str:
        """Return a value of the group; '' without one."""
        return cases.unquoted(self.keys.get(key.lower(), []))

    @property
    def kind(self) -> str:
        """What the record contains: 'time', 'frf' or 'modes'."""
        kind = self.get("kind").lower() or "time"
        return kind if kind in WINDOWS else "time"

    @property
    def is_ready(self) -> bool:
        """Whether the samples are known, with their times."""
        return bool(self.t.size) and not self.lacks_rate

    @property
    def lacks_rate(self) -> bool:
        """Whether the file has no times, and the user has not entered a rate."""
        return bool(self.recording and not self.recording.has_times and not self.rate)

    @property
    def scale(self) -> float:
        """Factor from the unit of the file to that of the case."""
        return float(number_text(self.get("scale")) or 1)

    @property
    def window(self) -> tuple[float, float]:
        """First and last time, or frequency, of the fit."""
        ends = [float(self.t[0]), float(self.t[-1])] if self.t.size else [0.0, 1.0]
        if self.onset is not None:
            ends[0] = self.onset
        given = [number_text(self.get(key)) for key in WINDOWS[self.kind]] or ["", ""]
        first, last = (float(text) if text else end for text, end in zip(given, ends))
        return first, last

    def file(self, folder: Path) -> Path:
        """Return the table of the record in the folder of the tab."""
        # The name is one of those that the page has given, whatever the case file said.
        return folder / Path(self.get("file") or "record.csv").name

    def choose(self, place: int) -> None:
        """Take a column, a frequency response or a table of modes of the file as the record."""
        assert self.recording is not None
        recording = self.recording
        recording.chosen = place
        for key in ("kind", "scale", "quantity"):
            self.keys.pop(key, None)
        if recording.kind != "time":
            self.keys["kind"] = [quoted(recording.kind)]
        self.keys.update(recording.keys)
        self.load()

    def load(self) -> None:
        """Take the samples of the file, in its unit."""
        self.onset, self.version, self.unwritten = None, next(VERSIONS), True
        if self.recording:
            self.t, self.z, self.missing = self.recording.samples(float(self.rate or 0))
            self.modes = self.recording.channel if self.kind == "modes" else None

    def write(self, folder: Path, force: Path | None) -> None:
        """Write the tables that the case names: the record, and its force."""
        self.unwritten = False
        if self.recording and self.is_ready:
            self.recording.write(self.file(folder), float(self.rate or 0))
        source = self.force and (self.force.recording or self.recording)
        if source and self.force and force:
            replace(source, chosen=self.force.column).write(
                force, float(self.rate or 0), (self.force.unit, FORCES[self.force.unit]))

    def read(self, folder: Path) -> None:
        """Read the samples of a table of an existing case.

        Raises recordings.Unreadable with one sentence. A table of frequencies that only the
        program understands has no samples here, and is not drawn.
        """
        self.version = next(VERSIONS)
        if self.kind == "time":
            try:
                self.t, a = cases.read_samples(folder / "case.nml", self.keys)
            except Failure as failure:
                raise recordings.Unreadable(failure.message) from None
            self.z = a / self.scale + cases.real(self.keys, "offset", 0.0)
            return
        try:
            found = recordings.read(self.file(folder))
        except recordings.Unreadable:
            return
        if found.kind == self.kind:
            self.t, self.z, self.missing = found.samples()
            self.modes = found.channel if self.kind == "modes" else None
