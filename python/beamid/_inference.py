"""Intervals beyond linear theory: profiles, draws from the posterior, fits of resampled records."""
from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from ._cases import AnyRecord, Group, Groups, Names
from ._fits import Fit, Subject, fitted
from ._library import Progress, optional

if TYPE_CHECKING:
    import arviz
    import pandas

CHAINS = 4


class Interval(NamedTuple):
    """A 95 % interval of a parameter, in its unit."""

    method: str
    """'linear', 'profile', 'posterior', 'percentile' or 'bca'."""
    elements: int
    """Number of elements of the mesh."""
    parameter: str
    """Name of the parameter."""
    unit: str
    """Unit of the parameter."""
    estimate: float
    """Estimate."""
    lower: float
    """Lower end of the interval."""
    upper: float
    """Upper end of the interval."""
    lower_end: str
    """Kind of the lower end: 'closed', 'bound', 'unbounded' or 'unknown'."""
    upper_end: str
    """Kind of the upper end."""


class Profile(NamedTuple):
    """The least sum of squares at each value of a parameter."""

    value: np.ndarray
    """Values of the parameter, ascending, shape (points,); of a stiffness `k_R` those of 1/k_R."""
    J: np.ndarray
    """Least sum of squares at each value, shape (points,)."""
    distance: np.ndarray
    """0 at the estimate, -1 and 1 at the ends of the interval, shape (points,)."""
    parameters: np.ndarray
    """Values of all parameters there, shape (points, n)."""
    ends: tuple[str, str]
    """Kinds of the lower and the upper end, as in `Interval`."""


@dataclass
class Inference:
    """Results of `profile`, `sample` or `bootstrap`, on the finest mesh."""

    fit: Fit = field(repr=False)
    """The fit that it starts from."""
    names: list[str]
    """Names of the n variables of the search: for a stiffness `k_R`, '1/k_R'."""
    intervals: list[Interval]
    """Intervals by all methods that this fit knows, on all meshes."""
    text: str = field(repr=False)
    tables: dict[str, str] = field(repr=False)
    """Tables that the program writes, by the name of the file."""

    def summary(self) -> str:
        """Return the summary that the program prints."""
        return self.text

    def interval(self, parameter: str, method: str) -> Interval:
        """Return the interval of a parameter by one of the methods, on the finest mesh.

        Raises
        ------
        KeyError
            If there is no such interval.
        """
        found = [item for item in self.intervals
                 if (item.parameter, item.method) == (parameter, method)]
        if not found:
            known = sorted({(item.parameter, item.method) for item in self.intervals})
            raise KeyError(f"{parameter}, {method}: expected one of {known}")
        return max(found, key=lambda item: item.elements)

    def to_pandas(self, table: str = "intervals") -> pandas.DataFrame:
        """Return a table as a data frame, with the columns that the program writes.

        Raises
        ------
        ImportError
            If pandas is not installed.
        KeyError
            If there is no such table.
        """
        pandas = optional("pandas", "to_pandas")
        if table + ".csv" not in self.tables:
            raise KeyError(f"{table}: expected one of {', '.join(self.tables)}")
        return pandas.read_csv(io.StringIO(self.tables[table + ".csv"]))


@dataclass
class Profiles(Inference):
    """Profiles by parameter: ``profiles["c_D"].value`` and ``.J``."""

    profiles: dict[str, Profile] = field(default_factory=dict, repr=False)

    def __getitem__(self, name: str) -> Profile:
        return self.profiles[name]


@dataclass
class Posterior(Profiles):
    """Draws from the posterior, which is flat between the bounds and has the noise integrated out.
    """

    draws: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    """Draws of the variables of the search, shape (chains, draws, n)."""
    log_density: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    """Log density of each draw, shape (chains, draws), up to a constant."""

    def values(self, name: str) -> np.ndarray:
        """Return the draws of one parameter by its own name, shape (chains, draws). For a stiffness
        `k_R` they are the reciprocals of the variable of the search."""
        if name in self.names:
            return self.draws[:, :, self.names.index(name)]
        return 1/self.draws[:, :, self.names.index(f"1/{name}")]

    def to_arviz(self) -> arviz.InferenceData:
        """Return the draws as ArviZ has them: groups `posterior` and `sample_stats` (lp).

        Raises
        ------
        ImportError
            If arviz is not installed.
        """
        arviz = optional("arviz", "to_arviz")
        by_name = {name: self.draws[:, :, k] for k, name in enumerate(self.names)}
        groups = {"posterior": by_name, "sample_stats": {"lp": self.log_density}}
        if int(arviz.__version__.split(".")[0]) > 0:    # the groups in one argument
            return arviz.from_dict(groups)
        return arviz.from_dict(**groups)


@dataclass
class Bootstrap(Inference):
    """Estimates from resampled records."""

    estimates: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    """Estimates, shape (records, n). Records that could not be fitted are left out."""


def _columns(text: str, elements: int, where: int, first: int) -> tuple[list[str], np.ndarray]:
    """Return the names from a column on, and the rows of one mesh, whose number of elements is in
    column `where`."""
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
    """Return the results of a command that starts from a fit."""
    fit._infer(command, progress)
    tables = {name: text for name, text in fit.tables.items() if name in (
        "intervals.csv", "profiles.csv", "posterior.csv", "posterior_motion.csv",
        "posterior_modes.csv", "bootstrap.csv")}
    intervals = _intervals(tables["intervals.csv"])
    finest = max(item.elements for item in intervals)
    known: dict[str, Any] = dict(fit=fit, intervals=intervals, text=fit._text("intervals"),
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


def profile(t: Subject = None, a: ArrayLike | None = None, *, record: Group = None,
            records: AnyRecord | Sequence[AnyRecord] | None = None, free: Names | None = None,
            start: Any = None, lower: Any = None, upper: Any = None, shared: Names | None = None,
            stages: Groups = None, beam: Group = None, tip: Group = None, mass: Groups = None,
            hose: Groups = None, sensor: Groups = None, support: Groups = None, end: Groups = None,
            gravity: Group = None, axial: Group = None, along: Groups = None,
            excitation: Groups = None, discretization: Group = None, integrator: Group = None,
            observation: Group = None, prior: Groups = None, score: Group = None,
            multistart: Group = None, windows: Group = None, sample: Group = None,
            bootstrap: Group = None, units: Group = None, progress: Progress | None = None,
            **other: Any) -> Profiles:
    """Compute intervals from the profile of J. They may be lopsided, end at a bound or have no end.

    The other arguments are those of `Problem`, which describes them with their units. Records and
    parameters: `a`, `record`, `records`, `free`, `start`, `lower`, `upper`, `shared`, `stages`.
    Structure and excitation: `beam`, `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`,
    `axial`, `along`, `excitation`. Methods: `discretization`, `integrator`, `observation`, `prior`,
    `score`, `multistart`, `windows`, `sample`, `bootstrap`. Labels of units: `units`. Any other
    group: `other`.

    Parameters
    ----------
    t : array_like, str, os.PathLike, Problem or Fit
        Times of a record [time]; or, as the only argument, the path of a case file, a `Problem` or
        a `Fit`.
    progress : bool or callable, optional
        See `Problem.fit`; for the fit and for the inference.

    Returns
    -------
    Profiles

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another, or a record is unusable.
    ComputationError
        If the search or a profile fails.
    NoFit
        If the search ends, but does not explain the records.
    """
    return infer("profile", fitted(locals(), progress), progress)


def sample(t: Subject = None, a: ArrayLike | None = None, *, record: Group = None,
           records: AnyRecord | Sequence[AnyRecord] | None = None, free: Names | None = None,
           start: Any = None, lower: Any = None, upper: Any = None, shared: Names | None = None,
           stages: Groups = None, beam: Group = None, tip: Group = None, mass: Groups = None,
           hose: Groups = None, sensor: Groups = None, support: Groups = None, end: Groups = None,
           gravity: Group = None, axial: Group = None, along: Groups = None,
           excitation: Groups = None, discretization: Group = None, integrator: Group = None,
           observation: Group = None, prior: Groups = None, score: Group = None,
           multistart: Group = None, windows: Group = None, sample: Group = None,
           bootstrap: Group = None, units: Group = None, progress: Progress | None = None,
           **other: Any) -> Posterior:
    """Draw from the posterior of the parameters. Draws are the same for the same seed.

    The other arguments are those of `Problem`, which describes them with their units. Records and
    parameters: `a`, `record`, `records`, `free`, `start`, `lower`, `upper`, `shared`, `stages`.
    Structure and excitation: `beam`, `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`,
    `axial`, `along`, `excitation`. Methods: `discretization`, `integrator`, `observation`, `prior`,
    `score`, `multistart`, `windows`, `bootstrap`. Labels of units: `units`. Any other group:
    `other`.

    Parameters
    ----------
    t : array_like, str, os.PathLike, Problem or Fit
        Times of a record [time]; or, as the only argument, the path of a case file, a `Problem` or
        a `Fit`.
    sample : mapping, optional
        Settings of the draws: `draws`, `seed`, `method`, `noise`.
    progress : bool or callable, optional
        See `Problem.fit`; for the fit and for the inference.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another, or a record is unusable.
    ComputationError
        If the search fails, or the draws cannot be trusted.
    NoFit
        If the search ends, but does not explain the records.
    """
    return infer("sample", fitted(locals(), progress), progress)


def bootstrap(t: Subject = None, a: ArrayLike | None = None, *, record: Group = None,
              records: AnyRecord | Sequence[AnyRecord] | None = None, free: Names | None = None,
              start: Any = None, lower: Any = None, upper: Any = None, shared: Names | None = None,
              stages: Groups = None, beam: Group = None, tip: Group = None, mass: Groups = None,
              hose: Groups = None, sensor: Groups = None, support: Groups = None,
              end: Groups = None, gravity: Group = None, axial: Group = None, along: Groups = None,
              excitation: Groups = None, discretization: Group = None, integrator: Group = None,
              observation: Group = None, prior: Groups = None, score: Group = None,
              multistart: Group = None, windows: Group = None, sample: Group = None,
              bootstrap: Group = None, units: Group = None, progress: Progress | None = None,
              **other: Any) -> Bootstrap:
    """Fit resampled records. Results are the same for the same seed.

    The other arguments are those of `Problem`, which describes them with their units. Records and
    parameters: `a`, `record`, `records`, `free`, `start`, `lower`, `upper`, `shared`, `stages`.
    Structure and excitation: `beam`, `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`,
    `axial`, `along`, `excitation`. Methods: `discretization`, `integrator`, `observation`, `prior`,
    `score`, `multistart`, `windows`, `sample`. Labels of units: `units`. Any other group: `other`.

    Parameters
    ----------
    t : array_like, str, os.PathLike, Problem or Fit
        Times of a record [time]; or, as the only argument, the path of a case file, a `Problem` or
        a `Fit`.
    bootstrap : mapping, optional
        Settings of the resampled records: `n`, `seed`, `kind`, `block`.
    progress : bool or callable, optional
        See `Problem.fit`; for the fit and for the inference.

    Returns
    -------
    Bootstrap

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another, or a record is unusable.
    ComputationError
        If the search fails, or too many records cannot be fitted.
    NoFit
        If the search ends, but does not explain the records.
    """
    return infer("bootstrap", fitted(locals(), progress), progress)
