"""Intervals beyond linear theory: profiles, draws from the posterior, fits of resampled records."""
from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import numpy as np

from ._fits import Fit, Problem, load
from ._library import Progress

if TYPE_CHECKING:
    import arviz
    import pandas

CHAINS = 4


class Interval(NamedTuple):
    """A method's 95 % interval of a parameter."""

    method: str          #: 'linear', 'profile', 'posterior', 'percentile' or 'bca'
    elements: int
    parameter: str
    unit: str
    estimate: float
    lower: float
    upper: float
    lower_end: str       #: 'closed', 'bound', 'unbounded' or 'unknown'
    upper_end: str


class Profile(NamedTuple):
    """The least sum of squares at each value of a parameter."""

    value: np.ndarray        #: (points) ascending; of a stiffness k_R of 1/k_R
    J: np.ndarray            #: (points)
    distance: np.ndarray     #: (points) 0 at the estimate, -1 and 1 at the ends of the interval
    parameters: np.ndarray   #: (points, n) of all parameters there
    ends: tuple[str, str]    #: as of `Interval`


@dataclass
class Inference:
    """What one of the commands has found, on the finest mesh."""

    fit: Fit = field(repr=False)    #: where it starts from
    names: list[str]                #: (n) of what was searched for: of a stiffness k_R '1/k_R'
    intervals: list[Interval]       #: of all methods that this fit knows, on all meshes
    summary: str                    #: what the program prints
    tables: dict[str, str] = field(repr=False)    #: what it writes, by name of the file

    def interval(self, parameter: str, method: str) -> Interval:
        """One of the intervals, on the finest mesh."""
        found = [item for item in self.intervals
                 if (item.parameter, item.method) == (parameter, method)]
        if not found:
            known = sorted({(item.parameter, item.method) for item in self.intervals})
            raise KeyError(f"{parameter}, {method}: expected one of {known}")
        return max(found, key=lambda item: item.elements)

    def to_pandas(self, table: str = "intervals") -> pandas.DataFrame:
        """A table as a pandas.DataFrame, with the columns that the program writes."""
        import pandas

        if table + ".csv" not in self.tables:
            raise KeyError(f"{table}: expected one of {', '.join(self.tables)}")
        return pandas.read_csv(io.StringIO(self.tables[table + ".csv"]))


@dataclass
class Profiles(Inference):
    """Profiles by parameter."""

    profiles: dict[str, Profile] = field(default_factory=dict, repr=False)

    def __getitem__(self, name: str) -> Profile:
        return self.profiles[name]


@dataclass
class Posterior(Profiles):
    """Draws from the posterior, flat between the bounds, the noise integrated out."""

    draws: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    """(chains, draws, n)"""
    log_density: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    """(chains, draws), but for a constant"""

    def values(self, name: str) -> np.ndarray:
        """(chains, draws) of one parameter, by its own name: of k_R the reciprocals of what was
        searched for."""
        if name in self.names:
            return self.draws[:, :, self.names.index(name)]
        return 1/self.draws[:, :, self.names.index(f"1/{name}")]

    def to_arviz(self) -> arviz.InferenceData:
        """As ArviZ has it: groups `posterior` and `sample_stats` (lp)."""
        try:
            import arviz
        except ImportError:
            raise ImportError("found no arviz, expected it for to_arviz: pip install arviz"
                              ) from None
        by_name = {name: self.draws[:, :, k] for k, name in enumerate(self.names)}
        groups = {"posterior": by_name, "sample_stats": {"lp": self.log_density}}
        if int(arviz.__version__.split(".")[0]) > 0:    # the groups in one argument
            return arviz.from_dict(groups)
        return arviz.from_dict(**groups)


@dataclass
class Bootstrap(Inference):
    """Estimates from resampled records."""

    estimates: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    """(records, n); records that could not be fitted are left out"""


def _columns(text: str, elements: int, where: int, first: int) -> tuple[list[str], np.ndarray]:
    """Names from a column on, and the rows of one mesh, the number of which stands in `where`."""
    header = text.split("\n", 1)[0].split(",")
    rows = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, ndmin=2)
    return header[first:], rows[rows[:, where] == elements]


def _intervals(text: str) -> list[Interval]:
    rows = [line.split(",") for line in text.splitlines()[1:]]
    return [Interval(method, int(elements), parameter, unit, float(estimate), float(lower),
                     float(upper), lower_end, upper_end)
            for method, elements, parameter, unit, estimate, lower, upper, lower_end, upper_end, *_
            in rows]


def _profiles(text: str, elements: int) -> tuple[list[str], dict[str, Profile]]:
    header, *lines = text.splitlines()
    names = header.split(",")[7:]
    points: dict[str, list[list[str]]] = {}
    for row in (line.split(",") for line in lines):
        if int(row[0]) == elements:
            points.setdefault(row[1], []).append(row)
    found = {}
    for name, rows in points.items():
        numbers = np.array([[float(x) for x in (*row[2:5], *row[7:])] for row in rows])
        value, J, distance = numbers[:, :3].T
        found[name] = Profile(value, J, distance, numbers[:, 3:], (rows[0][5], rows[0][6]))
    return names, found


@overload
def infer(command: Literal["profile"], fit: Fit, progress: Progress | None) -> Profiles: ...
@overload
def infer(command: Literal["sample"], fit: Fit, progress: Progress | None) -> Posterior: ...
@overload
def infer(command: Literal["bootstrap"], fit: Fit, progress: Progress | None) -> Bootstrap: ...
def infer(command: str, fit: Fit, progress: Progress | None) -> Inference:
    """Returns what a command adds to a fit."""
    fit._infer(command, progress)
    tables = {name: text for name, text in fit.tables.items() if name in (
        "intervals.csv", "profiles.csv", "posterior.csv", "posterior_motion.csv",
        "posterior_modes.csv", "bootstrap.csv")}
    intervals = _intervals(tables["intervals.csv"])
    finest = max(item.elements for item in intervals)
    known: dict[str, Any] = dict(fit=fit, intervals=intervals, summary=fit._text("intervals"),
                                 tables=tables)
    if command == "bootstrap":
        names, estimates = _columns(tables["bootstrap.csv"], finest, 1, 2)
        return Bootstrap(names=names, estimates=estimates[:, 2:], **known)
    names, profiles = _profiles(tables["profiles.csv"], finest)
    known.update(names=names, profiles=profiles)
    if command == "profile":
        return Profiles(**known)
    _, rows = _columns(tables["posterior.csv"], finest, 2, 4)
    shape = CHAINS, len(rows)//CHAINS
    return Posterior(draws=rows[:, 4:].reshape(*shape, -1), log_density=rows[:, 3].reshape(shape),
                     **known)


def _fitted(case: Any, t: Any, arguments: dict[str, Any], progress: Progress | None) -> Fit:
    if isinstance(case, Fit):
        if t is not None or arguments:
            raise TypeError("found arguments behind a fit, expected none: it has its own")
        return case
    if isinstance(case, (str, Path)):
        if t is not None or arguments:
            raise TypeError("found arguments behind a case file, expected none: it has all of them")
        return load(case).fit(progress=progress)
    if isinstance(case, Problem):
        return case.fit(progress=progress)
    return Problem(case, t, **arguments).fit(progress=progress)


def profile(t: Any = None, a: Any = None, *, progress: Progress | None = None,
            **arguments: Any) -> Profiles:
    """Intervals from the profile of J, which may be lopsided, end at a bound or have no end.

    t, a, arguments  as of `fit`; or the path of a case file, a `Problem` or a `Fit` alone
    progress         as of `Problem.fit`, for the fit and for what follows it

    Raises NoFit where the search ends, but not at a fit.
    """
    return infer("profile", _fitted(t, a, arguments, progress), progress)


def sample(t: Any = None, a: Any = None, *, progress: Progress | None = None,
           **arguments: Any) -> Posterior:
    """Draws from the posterior; arguments as of `profile`, and sample=dict(draws=..., seed=...).

    Draws are the same for the same seed. ComputationError where they cannot be trusted.
    """
    return infer("sample", _fitted(t, a, arguments, progress), progress)


def bootstrap(t: Any = None, a: Any = None, *, progress: Progress | None = None,
              **arguments: Any) -> Bootstrap:
    """Fits of resampled records; arguments as of `profile`, and bootstrap=dict(n=..., seed=...)."""
    return infer("bootstrap", _fitted(t, a, arguments, progress), progress)
