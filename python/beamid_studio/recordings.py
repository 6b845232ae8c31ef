"""Recorders' files: what the readers of `beamid to-csv` find in them, and tables of modes."""
from __future__ import annotations

import threading
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import channels as script_channels
import frequency_tables
import numpy as np
import responses
import text_tables
import to_csv
from program import Failure
from text_tables import MULTIPLES, PARTS

from beamid_studio.case_model import quoted

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


#: Factors to SI units of what a frequency response has above a force in N.
MOTIONS = {**{unit: factor for unit, factor in ACCELERATIONS.items() if factor},
           "m/s": "1", "mm/s": "0.001", "m": "1", "mm": "0.001", "um": "1e-6", "µm": "1e-6"}
#: Units of a force by the factor to N.
FORCES = {"N": "1", "kN": "1000", "mN": "0.001", "lbf": "4.4482216152605"}
#: Names of the columns of a table of modes without their units, as the program reads them.
MODAL = {"frequencies": ("frequency", "freq", "f", "fn"), "sd": ("sd", "sd_frequency"),
         "damping": ("damping_ratio", "damping", "zeta", "xi"),
         "sd_damping": ("sd_damping", "sd_damping_ratio"), "modes": ("mode",)}
#: Their names in the table that the page writes.
MODAL_COLUMNS = {"frequencies": "frequency_hz", "sd": "sd_hz", "damping": "damping_ratio",
                 "sd_damping": "sd_damping", "modes": "mode"}


class Unreadable(Exception):
    """A file that cannot be used, with one sentence for the user."""


@dataclass
class ModalTable:
    """Measured natural frequencies, and damping ratios where the table has them."""

    name: str
    frequencies: np.ndarray             #: [Hz]
    sd: np.ndarray                      #: their standard deviations [Hz]
    damping: np.ndarray | None = None
    sd_damping: np.ndarray | None = None
    modes: np.ndarray | None = None     #: numbers of the modes, from 1
    unit: str = "Hz"
    notes: list[str] = field(default_factory=list)

    def text(self) -> str:
        """Return the table that the program reads."""
        columns = {name: getattr(self, key) for key, name in MODAL_COLUMNS.items()
                   if getattr(self, key) is not None}
        rows = zip(*(values.tolist() for values in columns.values()))
        return ",".join(columns) + "\n" + "".join(
            ",".join(repr(value).removesuffix(".0") for value in row) + "\n" for row in rows)


@dataclass
class Recording:
    """What a file contains: channels, frequency responses, or a table of modes; one is chosen."""

    name: str                           #: of the file, as the user calls it
    channels: list[tuple[str, Any]]     #: (name of the column, channel, response or table)
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
    def kind(self) -> str:
        """What the chosen channel is: 'time', 'frf' or 'modes'."""
        return ("frf" if isinstance(self.channel, responses.Response) else
                "modes" if isinstance(self.channel, ModalTable) else "time")

    @property
    def has_times(self) -> bool:
        """Whether the file states times, or has none because it is about frequencies."""
        return self.kind != "time" or self.channel.times is not None

    @property
    def keys(self) -> dict[str, list[str]]:
        """Keys of &record that follow from the chosen channel: its factor, and what it measures."""
        if self.kind == "time":
            factor = ACCELERATIONS.get(self.unit, "")
            return {"scale": [factor]} if factor not in ("", "1") else {}
        if self.kind == "modes":
            return {}
        ratio = responses.RATIO.fullmatch(self.channel.unit.replace(" ", "").replace("²", "^2"))
        factor = ""
        if ratio and ratio["bottom"] == "N":
            factor = MOTIONS.get(WRITTEN.get(ratio["top"].lower(), ratio["top"]), "")
        found = {"quantity": [quoted(self.channel.quantity or "accelerance")]}
        if factor not in ("", "1"):
            found["scale"] = [factor]
        return {**found, **{key.lower(): [value] for key, value in self.channel.keys.items()}}

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
        if self.kind == "frf":
            return np.asarray(channel.frequencies, float), np.asarray(channel.values, complex), 0
        if self.kind == "modes":
            return channel.frequencies, channel.sd, 0
        values = np.asarray(channel.values, dtype=float)
        if channel.times is not None:
            times = np.asarray(channel.times, dtype=float)
            if channel.time_unit in ("", "s") and self.time_unit != "s":
                times = in_seconds(times, self.time_unit)
        else:
            times = np.arange(len(values)) / (rate or 1.0)
        known = np.isfinite(values)
        return times[known], values[known], int(np.count_nonzero(~known))

    def write(self, path: Path, rate: float = 0.0, force: tuple[str, str] = ("", "1")) -> None:
        """Write the record as a table that the program reads: times in s, and values as they are.

        rate   samples per second, for a file without times
        force  unit of a force and its factor to N: a force has no scale in the case file
        """
        part = path.with_suffix(".part")
        if self.kind != "time":
            part.write_text(self.channel.text() if self.kind == "modes" else responses.table(
                Path(self.name), self.texts, self.channel), encoding="utf-8")
            part.replace(path)
            return
        t, z, missing = self.samples(rate)
        notes = [*self.channel.notes]
        if self.has_times and self.time_unit != "s":
            notes.append(f"times converted from {self.time_unit} to s")
        if missing:
            notes.append(f"{missing} missing samples left out")
        unit, column = self.channel.unit, self.column
        if force[1] != "1":
            z, unit, column = z * float(force[1]), "N", f"{self.channel.name} [N]"
            notes.append(f"values converted from {force[0]} to N")
        record = script_channels.Channel(self.channel.name, z, unit, t, "s", notes)
        part.write_text(to_csv.table(Path(self.name), self.texts, [(column, record)]),
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
            found, texts = (read_text(path) if reader == "text" else
                            (to_csv.OWN_READERS | to_csv.LIBRARY_READERS)[reader](path))
        except Failure as failure:
            raise Unreadable(failure.message.replace(str(path), name)) from None
        except ModuleNotFoundError as missing:
            raise Unreadable(f"{name}: found no module {missing.name}; install it by "
                             f"pip install '{package}'") from None
        except Exception as error:    # the libraries raise errors of every kind
            raise Unreadable(f"{name}: cannot be read: {' '.join(str(error).split())[:200]}"
                             ) from None
        remarks = list(script_channels.REMARKS)
    if not found:
        raise Unreadable(f"{name}: found no series of real numbers in time, no frequency response "
                         "and no table of modes, expected one of these")
    named = to_csv.chosen(found, None, path)
    recording = Recording(name, named, texts, remarks)
    recording.chosen = likely(named)
    return recording


def read_text(path: Path) -> tuple[list[Any], list[str]]:
    """Return the frequency responses, the modes or the channels of a text, and lines above them."""
    table = text_tables.read(path, or_one=True)
    return (frequency_tables.responses_of(table) or modes_of(table)
            or text_tables.channels_of(table)), table.above


def modes_of(table: Any) -> list[ModalTable]:
    """Return the table of modes that a text contains, or nothing.

    A table with frequencies that is neither this nor a frequency response ends the reader.
    """
    pairs = [frequency_tables.named(name) for name in table.names]
    if any(stem.lower() in text_tables.TIMES or text_tables.time_unit(unit)
           for stem, unit in pairs):
        return []
    places = {key: next((k for k, (stem, unit) in enumerate(pairs) if stem.lower() in stems
                         and unit.lower() in ("", "hz")), None) for key, stems in MODAL.items()}
    if places["frequencies"] is None:
        return []
    if places["sd"] is None:
        if pairs[places["frequencies"]][1].lower() != "hz":
            return []
        table.fail(table.rows[0][0], places["frequencies"], "found frequencies, expected columns "
                   "'real' and 'imag', or 'magnitude' and 'phase_deg', for a frequency response; "
                   "or 'sd_hz' for a table of modes")
    return [ModalTable("modes", **{key: frequency_tables.column(table, k)
                                   for key, k in places.items() if k is not None})]


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
    if best and scores.count(best) > 1 and all(
            isinstance(channel, script_channels.Channel) for _, channel in named):
        # Of several axes, the one that moves most.
        spread = [np.nanstd(np.asarray(channel.values, float)) * (own == best)
                  for (_, channel), own in zip(named, scores)]
        return int(np.argmax(spread))
    return scores.index(best)
