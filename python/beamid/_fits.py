"""Fits: a problem that is prepared once, and what a search has found."""
from __future__ import annotations

import ctypes
import io
import weakref
from ctypes import byref, c_int, c_void_p
from typing import Any, Iterator, Mapping, NamedTuple, Sequence

import numpy as np

from ._cases import Record, case_text
from ._library import ROOM, NoFit, check, library, message_buffer


class Estimate(NamedTuple):
    """A parameter as estimated; what the record does not determine has infinite or missing ends."""

    name: str
    value: float
    unit: str
    start: float
    std_error: float                       #: by white noise
    noise_interval: tuple[float, float]    #: 95 %, by the noise as it is
    interval: tuple[float, float]          #: 95 %, by noise, mesh and the errors of what is held


class Mode(NamedTuple):
    """A mode of the fitted structure."""

    record: int
    s: complex                             #: root [1/time]
    frequency: float                       #: |s|/(2 pi)
    damping_ratio: float
    frequency_half_width: float            #: of the 95 % interval
    damping_half_width: float


class Fit:
    """What a search has found. Arrays are views of the library's own and live with the fit."""

    def __init__(self, handle: c_void_p) -> None:
        self._handle = handle
        weakref.finalize(self, library.beamid_forget, handle)

    def _array(self, name: str) -> np.ndarray:
        data, rows, columns = c_void_p(), c_int(), c_int()
        key = name.encode()
        library.beamid_array(self._handle, key, len(key), byref(data), byref(rows), byref(columns))
        shape = (columns.value, rows.value)
        if not data.value:
            return np.empty(shape).T
        memory = (ctypes.c_double*(shape[0]*shape[1])).from_address(data.value)
        memory.owner = self
        return np.frombuffer(memory).reshape(shape).T

    def _text(self, name: str) -> str:
        key, room = name.encode(), 4096
        while True:
            buffer = ctypes.create_string_buffer(room)
            length = library.beamid_text(self._handle, key, len(key), buffer, room)
            if length <= room:
                return buffer.raw[:length].decode()
            room = length

    def _judge(self) -> None:
        message = message_buffer()
        check(library.beamid_judge(self._handle, message, ROOM), message)

    def _infer(self, command: str) -> None:
        """Has the library add what a command finds out to the tables."""
        if self.no_fit:
            raise NoFit(self.no_fit, self)
        message, name = message_buffer(), command.encode()
        check(library.beamid_infer(self._handle, name, len(name), message, ROOM), message)

    @property
    def names(self) -> list[str]:
        """Of what was estimated: parameters, then what enters linearly."""
        return self._text("names").splitlines()

    @property
    def values(self) -> np.ndarray:
        """(n) estimates."""
        return self._array("estimates")[:, 1]

    @property
    def J(self) -> float:
        """The sum of squared residuals; of several records each divided by its noise."""
        return float(self._array("J")[0, 0])

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) by white noise, of what was searched for: of a stiffness like k_R its reciprocal."""
        return self._array("covariance")

    @property
    def correlation(self) -> np.ndarray:
        """(n, n), likewise."""
        return self._array("correlation")

    @property
    def jacobian(self) -> np.ndarray:
        """(rows, n) derivatives of the residuals, likewise; of several records each divided by its
        noise, and behind the samples a row for each prior."""
        return self._array("jacobian")

    @property
    def residuals(self) -> np.ndarray:
        """(m) model - record, of all records in turn."""
        return self._array("residual")[:, 0]

    @property
    def t(self) -> np.ndarray:
        """(m) times of the samples that were used."""
        return self._array("t")[:, 0]

    @property
    def measured(self) -> np.ndarray:
        """(m) accelerations at these times."""
        return self._array("measured")[:, 0]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """By name, with intervals by every source of error."""
        self._judge()
        rows = self._array("estimates").tolist()
        return {name: Estimate(name, row[1], unit, row[0], row[4], (row[7], row[8]),
                               (row[9], row[10]))
                for name, unit, row in zip(self.names, self._text("units").split("\n"), rows)}

    def __getitem__(self, name: str) -> Estimate:
        return self.estimates[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def modes(self) -> list[Mode]:
        """Of the fitted structure, the lowest."""
        self._judge()
        return [Mode(int(row[0]), complex(row[1], row[2]), *row[3:])
                for row in self._array("modes").tolist()]

    @property
    def no_fit(self) -> str:
        """Why this is no fit; '' where it is one."""
        self._judge()
        return self._text("no_fit")

    @property
    def note(self) -> str:
        """Which parameters are held because a mode is not in the record; ''."""
        return self._text("note")

    @property
    def summary(self) -> str:
        """What the program prints of such a fit."""
        self._judge()
        return self._text("summary")

    @property
    def tables(self) -> dict[str, str]:
        """The tables that the program writes of such a fit, by name: 'estimates.csv', ..., and what
        `profile`, `sample` and `bootstrap` have added."""
        self._judge()
        return {name: self._text(name) for name in self._text("tables").splitlines()}

    def to_pandas(self, table: str = "estimates"):
        """A table as a pandas.DataFrame, with the columns that the program writes."""
        import pandas

        self._judge()
        text = self._text(table + ".csv")
        if not text:
            raise KeyError(f"{table}: expected one of {', '.join(self._text('tables').split())}")
        return pandas.read_csv(io.StringIO(text))

    def __repr__(self) -> str:
        lines = [f"{'':10s}{'estimate':>14s}{'95 % interval':>30s}"]
        for e in self.estimates.values():
            ends = f"{e.interval[0]:.6g} .. {e.interval[1]:.6g}"
            lines.append(f"{e.name:10s}{e.value:14.6g}{ends:>30s} {e.unit}")
        if self.no_fit:
            lines.insert(0, f"no fit: {self.no_fit}")
        if self.note:
            lines.insert(0, self.note)
        return "\n".join(lines)


class Problem:
    """Records and a model, prepared for any number of fits, from any number of threads.

    `beamid.Problem(t, a, beam=..., free=[...])`, `beamid.Problem(records=[Record(...), ...], ...)`,
    or `beamid.load('case.nml')`.

    t, a       (m) times and values of one record
    records    several of these instead
    free       names of the parameters to be found
    start, lower, upper   (n) as in &stage; start may be 'auto' or 'case'
    shared     names of those that several records have in common
    stages     several of &stage instead, each its keys
    record     keys of &record of the one record
    groups     any other group of a case file by its name, its keys as a dict; several of &sensor,
               &support, &excitation and &prior as a list
    """

    def __init__(self, t=None, a=None, *, records: Sequence[Record] | None = None,
                 free: Sequence[str] | None = None, start=None, lower=None, upper=None,
                 shared: Sequence[str] | None = None,
                 stages: Sequence[Mapping[str, Any]] | None = None,
                 record: Mapping[str, Any] | None = None, **groups: Any) -> None:
        if records is None:
            records = [Record([] if t is None else t, [] if a is None else a, **(record or {}))]
        if stages is None:
            stages = [dict(free=free, start=start, lower=lower, upper=upper, shared=shared)]
        text = case_text([item.keys for item in records], stages, groups)
        self._open("beamid", text, records)

    def _open(self, path: str, text: str, records: Sequence[Record]) -> None:
        handle, message = c_void_p(), message_buffer()
        sizes = (c_int*max(len(records), 1))(*[item.t.size for item in records])
        t = np.concatenate([item.t for item in records]) if records else np.empty(0)
        z = np.concatenate([item.a for item in records]) if records else np.empty(0)
        where, what = path.encode(), text.encode()
        check(library.beamid_open(where, len(where), what, len(what), len(records), sizes,
                                  t.ctypes.data, z.ctypes.data, 1, byref(handle), message, ROOM),
              message)
        self._handle = handle
        weakref.finalize(self, library.beamid_close, handle)

    def fit(self, start: Sequence[float] | None = None, *, judge: bool = True) -> Fit:
        """Searches.

        start  of the free parameters of the first stage, in their order; default: as prepared
        judge  whether exact derivatives are compared with differences before the search and the
               verdict is asked for behind it; without it a fit is several times faster, and the
               verdict comes when it is asked for (`fit.no_fit`)

        InputError, ComputationError; NoFit where the search has ended, but not at a fit.
        """
        handle, message = c_void_p(), message_buffer()
        values = np.ascontiguousarray([] if start is None else start, dtype=float)
        check(library.beamid_fit(self._handle, int(judge), values.size, values.ctypes.data,
                                 byref(handle), message, ROOM), message)
        found = Fit(handle)
        if judge and found.no_fit:
            raise NoFit(found.no_fit, found)
        return found


def load(path) -> Problem:
    """The problem of a case file, with the records that it names."""
    problem = Problem.__new__(Problem)
    problem._open(str(path), "", [])
    return problem


def fit(t=None, a=None, **arguments: Any) -> Fit:
    """One fit; arguments as of `Problem`. Raises NoFit where what was found is no fit."""
    return Problem(t, a, **arguments).fit()
