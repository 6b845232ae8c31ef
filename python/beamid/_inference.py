"""Intervals beyond linear theory: profiles, draws from the posterior, fits of resampled records."""
from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from . import _plots
from ._cases import AnyRecord, Group, Groups, Names, check_keys, given
from ._fits import Fit, Subject, describe_arguments, fitted
from ._library import (InputError, Progress, beginning, documented, html_of, optional,
                       table_of)

if TYPE_CHECKING:
    import arviz
    import pandas

CHAINS = 4
#: Groups that hold settings of a method.
METHODS = ("sample", "bootstrap")


@documented
class Interval(NamedTuple):
    """A 95 % interval of a parameter, in its unit.

    Attributes
    ----------
    method : str
        'linear' (linear theory), 'profile', 'posterior', 'percentile' or 'bca' (both from the
        bootstrap).
    elements : int
        Number of elements of the mesh.
    parameter : str
        Name of the parameter.
    unit : str
        Unit of the parameter; empty without the argument `units`.
    estimate : float
        Estimate by the method. 'linear' and 'profile': estimate by the fit. 'posterior': mean of
        the draws. 'percentile' and 'bca': mean of the estimates from resampled records. For a
        stiffness such as `k_R`, the reciprocal of the mean of its reciprocal 1/k_R.
    lower : float
        Lower end of the interval; -inf or inf: there is no end.
    upper : float
        Upper end of the interval.
    lower_end : str
        Kind of the lower end. 'closed': the interval ends there. 'bound': it ends at a bound of the
        parameter. 'unbounded': the records do not limit the parameter on this side. 'unknown': a
        fit failed before the end was found.
    upper_end : str
        Kind of the upper end, by the same words.
    """

    method: str
    elements: int
    parameter: str
    unit: str
    estimate: float
    lower: float
    upper: float
    lower_end: str
    upper_end: str


@documented
class Profile(NamedTuple):
    """The profile of J along one parameter: the least sum of squares at each of its values, with
    all other parameters fitted again.

    Attributes
    ----------
    value : ndarray
        Values of the parameter, ascending, shape (points,), in its unit. For a stiffness such as
        `k_R`, values of its reciprocal 1/k_R.
    J : ndarray
        Least sum of squares at each value, shape (points,).
    distance : ndarray
        Signed square root of the rise of J, relative to its rise at the ends of the 95 % interval,
        shape (points,): 0 at the estimate, -1 at the lower end, 1 at the upper end. A straight line
        over `value` means that linear theory holds.
    parameters : ndarray
        Values of all parameters at each value, shape (points, n), in the order of `names` of the
        `Profiles`.
    ends : tuple[str, str]
        Kinds of the lower and the upper end: 'closed', 'bound', 'unbounded' or 'unknown', as in
        `Interval`.
    """

    value: np.ndarray
    J: np.ndarray
    distance: np.ndarray
    parameters: np.ndarray
    ends: tuple[str, str]


@dataclass(repr=False)
class Inference:
    """Results of `profile`, `sample` or `bootstrap`, on the finest mesh.

    Attributes
    ----------
    fit : Fit
        The fit that the computation starts from.
    names : list[str]
        Names of the n search variables: those of the free parameters, but '1/k_R' for a stiffness
        such as `k_R`, because the search varies its reciprocal.
    intervals : list[Interval]
        Intervals by all methods that have been applied to this fit, on all meshes.
    text : str
        Summary that the program prints, as `summary()` returns it.
    tables : dict[str, str]
        Tables that the program writes, as CSV text by the name of the file.
    """

    fit: Fit
    names: list[str]
    intervals: list[Interval]
    text: str
    tables: dict[str, str]

    def __repr__(self) -> str:
        return beginning(self.text)

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

    def _repr_html_(self) -> str:
        return html_of(self.text, self.tables["intervals.csv"])

    def _densities(self, sets: np.ndarray, method: str, parameters: Names | None, axes: Any,
                   what: str) -> Any:
        """Draw the marginal density of each parameter.

        Parameters
        ----------
        sets
            Values of the search variables, shape (sets, n).
        method
            Name of the interval that belongs to them.
        parameters, axes
            As in `Posterior.plot`.
        what
            Name of the function, for messages.
        """
        known = [name.removeprefix("1/") for name in self.names]
        wanted = known if parameters is None else parameters
        drawn = []
        for name in [wanted] if isinstance(wanted, str) else wanted:
            if name not in known:
                raise KeyError(f"{name}: expected one of {', '.join(known)}")
            found, place = self.interval(name, method), known.index(name)
            label, unit, ends = name, found.unit, (found.lower, found.upper)
            if self.names[place] != name:    # a stiffness
                label, unit, ends = self.names[place], "", (1/found.upper, 1/found.lower)
            drawn.append((label, unit, sets[:, place], ends))
        return _plots.densities(drawn, axes, what)

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
        return pandas.read_csv(io.StringIO(table_of(self.tables, table)))


@dataclass(repr=False)
class Profiles(Inference):
    """Profiles of J by parameter: ``profiles["c_D"].value`` and ``profiles["c_D"].J``.

    `interval`, `intervals`, `names`, `fit`, `tables`, `summary` and `to_pandas` are those of
    `Inference`.

    Attributes
    ----------
    profiles : dict[str, Profile]
        The profile of each parameter, by its name.
    """

    profiles: dict[str, Profile] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Profile:
        if name not in self.profiles:
            raise KeyError(f"{name}: expected one of {', '.join(self.profiles)}")
        return self.profiles[name]

    def plot(self, parameters: Names | None = None, axes: Any = None) -> Any:
        """Draw the profile of each parameter: the rise of J, relative to its rise at the end of the
        95 % interval, and the parabola of linear theory. A stiffness is drawn as its reciprocal.

        Parameters
        ----------
        parameters : str or sequence of str, optional
            Names of the parameters. Default: all of them.
        axes : sequence of matplotlib axes, optional
            Where to draw, one axes for each parameter. Default: a new figure.

        Returns
        -------
        numpy.ndarray of Axes of shape (parameters,)

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        KeyError
            If a parameter has no profile.
        """
        names = list(self.profiles) if parameters is None else parameters
        names = [names] if isinstance(names, str) else list(names)
        drawn: list[tuple[str, str, Profile, float]] = []
        for name in names:
            profile, linear = self[name], self.interval(name, "linear")
            if "1/" + name in self.names:
                drawn.append(("1/" + name, "", profile, np.nan))
            else:
                half_width = (linear.upper - linear.lower)/2
                drawn.append((name, linear.unit, profile, half_width))
        return _plots.profiles(drawn, axes)


@dataclass(repr=False)
class Posterior(Profiles):
    """Draws from the posterior, which is flat between the bounds and has the noise integrated out.

    The profiles of J, from which the draws start, are in `profiles`; `beamid.profile(fit).plot()`
    draws them.

    Attributes
    ----------
    draws : ndarray
        Draws of the search variables, shape (chains, draws, n), in the order of `names`.
    log_density : ndarray
        Log density of each draw, shape (chains, draws), up to a constant.
    """

    draws: np.ndarray = field(default_factory=lambda: np.empty(0))
    log_density: np.ndarray = field(default_factory=lambda: np.empty(0))

    def plot(self, parameters: Names | None = None, axes: Any = None) -> Any:
        """Draw the marginal posterior density of each parameter: a histogram of the draws, with
        their mean and the ends of the 95 % interval. A stiffness is drawn as its reciprocal.

        Parameters
        ----------
        parameters : str or sequence of str, optional
            Names of the parameters. Default: all of them.
        axes : sequence of matplotlib axes, optional
            Where to draw, one axes for each parameter. Default: a new figure.

        Returns
        -------
        numpy.ndarray of Axes of shape (parameters,)

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        KeyError
            If there is no such parameter.
        """
        sets = self.draws.reshape(-1, len(self.names))
        return self._densities(sets, "posterior", parameters, axes, "Posterior.plot")

    def values(self, name: str) -> np.ndarray:
        """Return the draws of one parameter by its own name, shape (chains, draws). For a stiffness
        `k_R` they are the reciprocals of the draws of 1/k_R."""
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


@dataclass(repr=False)
class Bootstrap(Inference):
    """Estimates from resampled records.

    Attributes
    ----------
    estimates : ndarray
        Estimates of the search variables, shape (records, n), in the order of `names`. Records
        that could not be fitted are left out.
    """

    estimates: np.ndarray = field(default_factory=lambda: np.empty(0))

    def plot(self, parameters: Names | None = None, axes: Any = None) -> Any:
        """Draw the density of the resampled estimates of each parameter: a histogram, with their
        mean and the ends of the 95 % interval 'bca'. A stiffness is drawn as its reciprocal.

        Parameters
        ----------
        parameters : str or sequence of str, optional
            Names of the parameters. Default: all of them.
        axes : sequence of matplotlib axes, optional
            Where to draw, one axes for each parameter. Default: a new figure.

        Returns
        -------
        numpy.ndarray of Axes of shape (parameters,)

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        KeyError
            If there is no such parameter.
        """
        return self._densities(self.estimates, "bca", parameters, axes, "Bootstrap.plot")


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
def infer(command: Literal["profile"], arguments: dict[str, Any],
          progress: Progress | None) -> Profiles: ...
@overload
def infer(command: Literal["sample"], arguments: dict[str, Any],
          progress: Progress | None) -> Posterior: ...
@overload
def infer(command: Literal["bootstrap"], arguments: dict[str, Any],
          progress: Progress | None) -> Bootstrap: ...
def infer(command: str, arguments: dict[str, Any], progress: Progress | None) -> Inference:
    """Return the results of a command that starts from a fit.

    Parameters
    ----------
    command
        'profile', 'sample' or 'bootstrap'.
    arguments
        `locals()` at the beginning of the function of this name.
    progress
        See `Problem.fit`.
    """
    if command in METHODS:
        check_keys(command, arguments["other"])
    settings: dict[str, Any] = {}
    if isinstance(arguments["t"], Fit):
        # Settings of a method change neither the case nor its fit.
        arguments = dict(arguments)
        settings = {name: arguments[name] for name in METHODS if arguments[name] is not None}
        others = given(arguments, "t", "progress", *METHODS)
        if all(value is None for value in others.values()):
            arguments.update(dict.fromkeys(METHODS))
        else:
            settings = {}
    fit = fitted(arguments, progress)
    fit._infer(command, settings, progress)
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


@describe_arguments
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
        Times of a record [time]; or the path of a case file, a `Problem` or a `Fit`. The other
        arguments then change the case, as in `fit`, and a changed case is fitted again. Beside a
        `Fit`, `sample` and `bootstrap` alone are settings: the fit stays, and so do its intervals.
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
    if "parameters" in other:
        raise InputError("profile: found parameters, expected none: every free parameter gets a "
                         "profile, and profile(fit)['E'] is that of E")
    return infer("profile", locals(), progress)


@describe_arguments
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
        Times of a record [time]; or the path of a case file, a `Problem` or a `Fit`. The other
        arguments then change the case, as in `fit`, and a changed case is fitted again. Beside a
        `Fit`, `sample` and `bootstrap` alone are settings: the fit stays, and so do its intervals.
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
    return infer("sample", locals(), progress)


@describe_arguments
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
        Times of a record [time]; or the path of a case file, a `Problem` or a `Fit`. The other
        arguments then change the case, as in `fit`, and a changed case is fitted again. Beside a
        `Fit`, `sample` and `bootstrap` alone are settings: the fit stays, and so do its intervals.
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
    return infer("bootstrap", locals(), progress)
