"""Fits: a problem that is prepared once, and what a search has found."""
from __future__ import annotations

import ctypes
import io
from collections.abc import Iterator, Mapping, Sequence
from ctypes import byref, c_int
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ._cases import Record, case_text
from ._library import Handle, NoFit, Progress, call, compute, numbers

if TYPE_CHECKING:
    import pandas


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
    """The result of a search. Arrays are copies: a change of one does not change the fit."""

    def __init__(self, handle: Handle) -> None:
        self._handle = handle

    def _array(self, name: str) -> np.ndarray:
        rows, columns, key = c_int(), c_int(), name.encode()
        with self._handle.lock:
            call("beamid_array", self._handle.number, key, len(key), 0, None, byref(rows),
                 byref(columns))
            array = np.empty((columns.value, rows.value))
            call("beamid_array", self._handle.number, key, len(key), array.size,
                 array.ctypes.data, byref(rows), byref(columns))
        return array.T

    def _text(self, name: str) -> str:
        key, length, room = name.encode(), c_int(), 4096
        with self._handle.lock:
            while True:
                buffer = ctypes.create_string_buffer(room)
                call("beamid_text", self._handle.number, key, len(key), buffer, room, byref(length))
                if length.value <= room:
                    return buffer.raw[:length.value].decode()
                room = length.value

    def _judge(self, progress: Progress | None = None) -> None:
        with self._handle.lock:
            if not self._handle.is_judged:
                compute("beamid_judge", self._handle.number, progress=progress)
                self._handle.is_judged = True

    def _infer(self, command: str, progress: Progress | None) -> None:
        """Adds the tables of a command to those of the fit."""
        if self.no_fit:
            raise NoFit(self.no_fit, self)
        name = command.encode()
        with self._handle.lock:
            compute("beamid_infer", self._handle.number, name, len(name), progress=progress)

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
        """(n, n) by white noise, of the parameters searched for; for a stiffness like k_R of its
        reciprocal."""
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

    def to_pandas(self, table: str = "estimates") -> pandas.DataFrame:
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
    groups     any other group of a case file by its name, its keys as a dict; a list of dicts for
               several groups of one name
    """

    def __init__(self, t: ArrayLike | None = None, a: ArrayLike | None = None, *,
                 records: Sequence[Record] | None = None, free: Sequence[str] | None = None,
                 start: Any = None, lower: Any = None, upper: Any = None,
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
        for item in records:
            item.check()
        sizes = (c_int*max(len(records), 1))(*[np.size(item.t) for item in records])
        none = np.empty(0)
        t = np.concatenate([numbers(item.t, "times of a record") for item in records] or [none])
        z = np.concatenate([numbers(item.a, "values of a record") for item in records] or [none])
        where, what = path.encode(), text.encode()
        self._handle = Handle()
        compute("beamid_open", where, len(where), what, len(what), len(records), sizes, t.size,
                t.ctypes.data, z.ctypes.data, 1, byref(self._handle.number))

    def fit(self, start: Sequence[float] | None = None, *, judge: bool = True,
            progress: Progress | None = None) -> Fit:
        """Searches for the minimum.

        start     of the free parameters of the first stage, in their order; default: as prepared
        judge     whether exact derivatives are compared with differences before the search, and
                  the verdict is made after it. Without it a fit is several times faster, and the
                  verdict is made when it is needed (`fit.no_fit`)
        progress  True: shows a progress bar; or a function of pieces done, pieces in all (0: not
                  known) and their name, called at most ten times a second

        Raises InputError; ComputationError; NoFit if the search ends, but not at a fit;
        KeyboardInterrupt.
        """
        values = numbers([] if start is None else start, "start")
        handle = Handle()
        compute("beamid_fit", self._handle.number, int(judge), values.size, values.ctypes.data,
                byref(handle.number), progress=progress)
        found = Fit(handle)
        if judge:
            found._judge(progress)
        if judge and found.no_fit:
            raise NoFit(found.no_fit, found)
        return found


def load(path: str | PathLike[str]) -> Problem:
    """Returns the problem of a case file, with the records that it names."""
    problem = Problem.__new__(Problem)
    problem._open(str(path), "", [])
    return problem


def fit(t: Any = None, a: Any = None, *, progress: Progress | None = None, **arguments: Any) -> Fit:
    """Returns one fit; arguments as of `Problem` and `Problem.fit`. Raises NoFit if it is none."""
    return Problem(t, a, **arguments).fit(progress=progress)
