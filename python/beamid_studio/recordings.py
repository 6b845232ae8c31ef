"""Recorders' files: the channels that the readers of `beamid to-csv` find, one as the record."""
from __future__ import annotations

import threading
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import channels as script_channels
import numpy as np
import to_csv
from program import Failure
from text_tables import MULTIPLES, PARTS

#: The readers collect their remarks in one list of the process.
READING = threading.Lock()
SUFFIXES = tuple(to_csv.FORMATS)
#: Units of time that a column may have, and how many seconds each is, as text.
TIME_UNITS = {"s": "1", "ms": "0.001", "us": "1e-6", "ns": "1e-9", "min": "60", "h": "3600"}
#: Units of acceleration, by the factor to m/s^2.
ACCELERATIONS = {"m/s²": "1", "g": "9.80665", "mg": "0.00980665", "mm/s²": "0.001",
                 "cm/s²": "0.01", "ft/s²": "0.3048", "other": ""}
#: How files write these units.
WRITTEN = {"m/s^2": "m/s²", "m/s2": "m/s²", "m/s/s": "m/s²", "ms^-2": "m/s²", "m*s^-2": "m/s²",
           "g": "g", "gn": "g", "mg": "mg", "mm/s^2": "mm/s²", "mm/s2": "mm/s²", "cm/s^2": "cm/s²",
           "cm/s2": "cm/s²", "ft/s^2": "ft/s²"}


class Unreadable(Exception):
    """A file that cannot be used, with one sentence for the user."""


@dataclass
class Recording:
    """The channels of a file; one of them is the record."""

    name: str                           #: of the file, as the user calls it
    channels: list[tuple[str, Any]]     #: (name of the column, channel)
    texts: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    chosen: int = 0                     #: place of the record among the channels
    time_unit: str = "s"                #: in which the times of the file are counted

    @property
    def channel(self) -> Any:
        """The channel that is the record."""
        return self.channels[self.chosen][1]

    @property
    def column(self) -> str:
        """Name of the column of the record."""
        return self.channels[self.chosen][0]

    @property
    def has_times(self) -> bool:
        """Whether the file states times."""
        return self.channel.times is not None

    @property
    def is_converted(self) -> bool:
        """Whether the reader has converted the times to seconds."""
        return any(note.startswith("times ") for note in self.channel.notes)

    @property
    def unit(self) -> str:
        """The unit of the record in the list ACCELERATIONS; '' if the file states none of them."""
        return WRITTEN.get(self.channel.unit.strip().lower().replace("²", "^2"), "")

    def samples(self, rate: float = 0.0) -> tuple[np.ndarray, np.ndarray, int]:
        """Return the times [s] and the values of the record, and how many samples are missing.

        rate  samples per second, for a file without times
        """
        channel = self.channel
        values = np.asarray(channel.values, dtype=float)
        if channel.times is not None:
            times = np.asarray(channel.times, dtype=float)
            if channel.time_unit in ("", "s") and self.time_unit != "s":
                times = in_seconds(times, self.time_unit)
        else:
            times = np.arange(len(values)) / (rate or 1.0)
        known = np.isfinite(values)
        return times[known], values[known], int(np.count_nonzero(~known))

    def write(self, path: Path, rate: float = 0.0) -> None:
        """Write the record as a table that the program reads: times in s, and values as they are.

        rate  samples per second, for a file without times
        """
        t, z, missing = self.samples(rate)
        notes = [*self.channel.notes]
        if self.has_times and self.time_unit != "s":
            notes.append(f"times converted from {self.time_unit} to s")
        if missing:
            notes.append(f"{missing} missing samples left out")
        record = script_channels.Channel(self.channel.name, z, self.channel.unit, t, "s", notes)
        part = path.with_suffix(".part")
        part.write_text(to_csv.table(Path(self.name), self.texts, [(self.column, record)]),
                        encoding="utf-8")
        part.replace(path)


def in_seconds(times: np.ndarray, unit: str) -> np.ndarray:
    """Return times of a unit in seconds."""
    return times * MULTIPLES[unit] if unit in MULTIPLES else times / PARTS[unit]


def read(path: Path, name: str = "", limit: int = 0) -> Recording:
    """Read a recorder's file.

    name   what the user calls the file, for messages
    limit  most bytes of what an archive holds; 0: any

    Raises Unreadable with one sentence.
    """
    name = name or path.name
    suffix = Path(name).suffix.lower()
    if suffix not in to_csv.FORMATS:
        raise Unreadable(f"{name}: the page reads {' '.join(SUFFIXES)} and case files (.nml)"
                         + "; export the sheet as CSV" * suffix.startswith((".xls", ".ods")))
    reader, _module, package = to_csv.FORMATS[suffix]
    if suffix in (".zip", ".npz") and limit and unpacked(path) > limit:
        raise Unreadable(f"{name}: holds more than {limit // 10**6} MB; --limit sets the limit")
    with READING:
        script_channels.REMARKS.clear()
        try:
            found, texts = (to_csv.OWN_READERS | to_csv.LIBRARY_READERS)[reader](path)
        except Failure as failure:
            raise Unreadable(failure.message.replace(str(path), name)) from None
        except ModuleNotFoundError as missing:
            raise Unreadable(f"{name}: found no module {missing.name}; install it by "
                             f"pip install '{package}'") from None
        except Exception as error:    # the libraries raise errors of every kind
            raise Unreadable(f"{name}: cannot be read: {' '.join(str(error).split())[:200]}"
                             ) from None
        remarks = list(script_channels.REMARKS)
    found = [channel for channel in found if isinstance(channel, script_channels.Channel)]
    if not found:
        raise Unreadable(f"{name}: found no series of real numbers in time, expected one or more")
    named = to_csv.chosen(found, None, path)
    recording = Recording(name, named, texts, remarks)
    recording.chosen = likely(named)
    return recording


def unpacked(path: Path) -> int:
    """Return how many bytes the files of an archive have; 0 if it cannot be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            return sum(member.file_size for member in archive.infolist())
    except (OSError, zipfile.BadZipFile):
        return 0


def likely(named: list[tuple[str, Any]]) -> int:
    """Return the place of the channel that is most likely an acceleration."""
    def score(pair: tuple[str, Any]) -> int:
        name, channel = pair
        known = channel.unit.strip().lower().replace("²", "^2") in WRITTEN
        return 2 * known + ("acc" in name.lower())

    scores = [score(pair) for pair in named]
    best = max(scores)
    if len(named) > 1 and best and scores.count(best) > 1:
        # Of several axes, the one that moves most.
        spread = [np.nanstd(np.asarray(channel.values, float)) * (own == best)
                  for (_, channel), own in zip(named, scores)]
        return int(np.argmax(spread))
    return scores.index(best)
