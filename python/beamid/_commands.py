"""The commands simulate, modes, frf, design, compare and ensemble."""
from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from ctypes import byref, c_longlong
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _plots
from ._cases import (GROUPS, IN_MEMORY, AnyRecord, Group, Groups, Lines, Names, as_list, case_text,
                     check_keys, given, group, open_case, records_of)
from ._changes import STAGE, read_groups, text_of_groups, without_lines
from ._fits import Fit, Problem, changed_case, describe_arguments, source_of
from ._library import (Handle, InputError, NoFit, Progress, beginning, compute, documented,
                       html_of, kind_of, optional, table_of, text_of)

if TYPE_CHECKING:
    import pandas

#: A case that is given as a whole.
Case = Union[str, "PathLike[str]", Problem, Fit]
#: Groups that describe the structure.
STRUCTURE = {"beam", "tip", "mass", "hose", "sensor", "support", "end", "gravity", "axial", "along"}
#: Groups that only a fit needs.
OF_FITS = ("stage", "prior", "score", "multistart", "windows", "sample", "bootstrap")


@dataclass(repr=False)
class Results:
    """Results of a command: its summary and its tables.

    Attributes
    ----------
    text : str
        Summary that the program prints, as `summary()` returns it.
    tables : dict[str, str]
        Tables that the program writes, as CSV text by the name of the file.
    """

    text: str
    tables: dict[str, str]
    _units: dict[str, str] = field(default_factory=dict)    #: names of the units by quantity
    _table: ClassVar[str] = ""    #: name of the main table

    def __repr__(self) -> str:
        return beginning(self.text)

    def _repr_html_(self) -> str:
        return html_of(self.text, self.tables[self._table + ".csv"])

    def summary(self) -> str:
        """Return the summary that the program prints."""
        return self.text

    def to_pandas(self, table: str | None = None) -> pandas.DataFrame:
        """Return a table as a data frame, with the columns that the program writes.

        Parameters
        ----------
        table : str, optional
            Name of a table, such as 'modes' or 'modes.csv'. Default: the main table, that of the
            response, modes, experiments, models or members.

        Raises
        ------
        ImportError
            If pandas is not installed.
        KeyError
            If there is no such table.
        """
        pandas = optional("pandas", "to_pandas")
        name = self._table if table is None else table
        return pandas.read_csv(io.StringIO(table_of(self.tables, name)))

    def _rows(self, table: str) -> list[dict[str, str]]:
        return list(csv.DictReader(io.StringIO(self.tables[table])))

    def _finest(self, table: str) -> dict[str, np.ndarray]:
        """Return the columns of a table of numbers, of the finest mesh alone."""
        columns = _plots.read(self.tables[table])
        chosen = columns["elements"] == columns["elements"][-1]
        return {name: values[chosen] for name, values in columns.items()}


@dataclass(repr=False)
class Simulation(Results):
    """A simulated record, and the response that it comes from, on the finest mesh.

    `text`, `tables`, `summary` and `to_pandas` are those of `Results`.

    Attributes
    ----------
    t : ndarray
        Sample times, shape (m,) [time].
    record : ndarray
        Values of the record with noise, shape (m,), in the unit of the sensor.
    acceleration : ndarray
        Acceleration without noise, shape (m,) [length/time²].
    displacement : ndarray
        Displacement at the sensor, shape (m,) [length].
    velocity : ndarray
        Velocity at the sensor, shape (m,) [length/time].
    force : ndarray
        Force of the excitation, shape (m,) [force].
    """

    _table: ClassVar[str] = "response"
    t: np.ndarray = field(default_factory=lambda: np.empty(0))
    record: np.ndarray = field(default_factory=lambda: np.empty(0))
    acceleration: np.ndarray = field(default_factory=lambda: np.empty(0))
    displacement: np.ndarray = field(default_factory=lambda: np.empty(0))
    velocity: np.ndarray = field(default_factory=lambda: np.empty(0))
    force: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(repr=False)
class FrequencyResponse(Results):
    """The frequency response function of a structure, on the finest mesh.

    `text`, `tables`, `summary` and `to_pandas` are those of `Results`.

    Attributes
    ----------
    frequencies : ndarray
        Frequencies, shape (n,) [1/time].
    h : ndarray
        Response per unit force with the convention e^(+iωt), complex, shape (n,):
        acceleration, velocity or displacement per force, by `quantity` of the record.
    band : ndarray | None
        Ends of the 95 % interval of the magnitude, shape (n, 2); NaN where an estimate is
        not determined. None if the case describes no fit.
    """

    _table: ClassVar[str] = "frf"
    frequencies: np.ndarray = field(default_factory=lambda: np.empty(0))
    h: np.ndarray = field(default_factory=lambda: np.empty(0))
    band: np.ndarray | None = None

    def plot(self, axes: Any = None) -> Any:
        """Draw magnitude and phase, with the 95 % band if the structure is fitted.

        Parameters
        ----------
        axes : sequence of two matplotlib axes, optional
            Where to draw. Default: a new figure.

        Returns
        -------
        numpy.ndarray of two Axes

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        lower, upper = (None, None) if self.band is None else self.band.T
        return _plots.response(self.frequencies, self.h, lower, upper, axes,
                               "FrequencyResponse.plot", self._units)


@dataclass(repr=False)
class Modes(Results):
    """Natural modes of a structure, on the finest mesh.

    `text`, `tables`, `summary` and `to_pandas` are those of `Results`.

    Modes are numbered from 1 in the order of `frequencies`, as in the table 'modes.csv'. Rigid-body
    modes (0 Hz) and overdamped modes count, but have no mode shape: `shapes[i]` is the shape of
    mode `shape_modes[i]`, whose frequency is ``frequencies[shape_modes[i] - 1]``.

    Attributes
    ----------
    s : ndarray
        Roots of the characteristic equation, shape (modes,) [1/time].
    frequencies : ndarray
        Natural frequencies abs(s)/(2 π), shape (modes,) [1/time].
    damping_ratios : ndarray
        Damping ratios, shape (modes,).
    shape_modes : ndarray
        Numbers of the modes whose shapes are in `shapes`, shape (shapes,).
    x : ndarray
        Positions of the mode shapes along the beam, shape (points,) [length].
    shapes : ndarray
        Mode shapes of the lowest modes that oscillate, complex, shape (shapes, points).
    """

    _table: ClassVar[str] = "modes"
    s: np.ndarray = field(default_factory=lambda: np.empty(0))
    frequencies: np.ndarray = field(default_factory=lambda: np.empty(0))
    damping_ratios: np.ndarray = field(default_factory=lambda: np.empty(0))
    shape_modes: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    x: np.ndarray = field(default_factory=lambda: np.empty(0))
    shapes: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    def plot(self, axes: Any = None) -> Any:
        """Draw the mode shapes, each with the number, frequency and damping ratio of its mode.

        Parameters
        ----------
        axes : sequence of matplotlib axes, optional
            Where to draw, one axes for each shape. Default: a new figure.

        Returns
        -------
        numpy.ndarray of Axes of shape (shapes,)

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If no mode oscillates.
        """
        modes = [(int(number), self.frequencies[number - 1], self.damping_ratios[number - 1])
                 for number in self.shape_modes]
        return _plots.shapes(self.tables.get("shapes.csv", ""),
                             self.tables.get("attachments.csv", ""), self._units, modes, axes)


@dataclass(repr=False)
class Design(Results):
    """Predicted errors of candidate experiments.

    `text`, `tables`, `summary` and `to_pandas` are those of `Results`.

    Attributes
    ----------
    settings : list[dict[str, float]]
        Settings of each experiment: `x_S`, `x_F` [length], `duration`, `t_first`, `t_last`,
        `t_step` [time], or for a frequency response `f_first`, `f_last`, `f_step` [1/time];
        `samples`. Experiment 0 is the present one.
    std_errors : dict[str, ndarray]
        Standard errors by parameter, in its unit, shape (experiments,); nan: not
        determined.
    D : ndarray
        Logarithm of the determinant of the information matrix, shape (experiments,); the larger
        the better.
    A : ndarray
        Sum of the relative variances of the estimates, shape (experiments,); the smaller the
        better.
    E : ndarray
        Least eigenvalue of the information matrix, shape (experiments,); the larger the better.
    """

    _table: ClassVar[str] = "design"
    settings: list[dict[str, float]] = field(default_factory=list)
    std_errors: dict[str, np.ndarray] = field(default_factory=dict)
    D: np.ndarray = field(default_factory=lambda: np.empty(0))
    A: np.ndarray = field(default_factory=lambda: np.empty(0))
    E: np.ndarray = field(default_factory=lambda: np.empty(0))


@documented
class ComparedModel(NamedTuple):
    """A model of a comparison.

    Attributes
    ----------
    model : str
        Name of the model.
    elements : int
        Number of elements of its mesh.
    parameters : int
        Number of estimated parameters.
    J : float
        Sum of squared residuals.
    aicc : float
        Akaike's criterion with the correction for small samples; the smaller the better.
    bic : float
        Bayesian information criterion; the smaller the better.
    """

    model: str
    elements: int
    parameters: int
    J: float
    aicc: float
    bic: float


@documented
class NestedPair(NamedTuple):
    """Test of a model against a special case of it.

    Attributes
    ----------
    restricted : str
        Name of the special case.
    full : str
        Name of the model that contains it.
    restrictions : int
        Number of parameters that only the full model estimates.
    U : float
        Test statistic, chi-square distributed if the restricted model is true.
    probability : float
        Probability of a larger U if the restricted model is true.
    """

    restricted: str
    full: str
    restrictions: int
    U: float
    probability: float


@documented
class DampingRatio(NamedTuple):
    """A mode of a model in a comparison of damping mechanisms; nan: not measured.

    Attributes
    ----------
    model : str
        Name of the model.
    record : int
        Number of the record whose structure has the mode.
    mode : int
        Number of the mode.
    frequency : float
        Natural frequency of the model [1/time].
    damping_ratio : float
        Damping ratio of the model.
    measured_frequency : float
        Natural frequency that the record shows by itself [1/time].
    measured_damping : float
        Damping ratio that the record shows by itself.
    lower95 : float
        Lower end of its 95 % interval.
    upper95 : float
        Upper end of its 95 % interval.
    """

    model: str
    record: int
    mode: int
    frequency: float
    damping_ratio: float
    measured_frequency: float
    measured_damping: float
    lower95: float
    upper95: float


@dataclass(repr=False)
class Comparison(Results):
    """Several models of the same records.

    `text`, `tables`, `summary` and `to_pandas` are those of `Results`.

    Attributes
    ----------
    models : list[ComparedModel]
        The models, in the order of the arguments.
    nested : list[NestedPair]
        Tests of all pairs of which one model is a special case of the other.
    damping : list[DampingRatio]
        Modes of each model, if damping mechanisms are compared.
    """

    _table: ClassVar[str] = "models"
    models: list[ComparedModel] = field(default_factory=list)
    nested: list[NestedPair] = field(default_factory=list)
    damping: list[DampingRatio] = field(default_factory=list)

    @property
    def best(self) -> ComparedModel:
        """The model with the smallest AICc."""
        return min(self.models, key=lambda model: model.aicc)


@documented
class MemberStatistics(NamedTuple):
    """Statistics of a parameter over the members of an ensemble; nan: not known.

    Attributes
    ----------
    elements : int
        Number of elements of the mesh.
    parameter : str
        Name of the parameter.
    members : int
        Number of members with an estimate of the parameter.
    mean : float
        Mean of the estimates.
    sd : float
        Standard deviation of the estimates.
    mean_std_error : float
        Mean of the standard errors that the fits state.
    bias : float
        Mean of estimate - true value.
    bias_error : float
        Standard error of the bias.
    covered : float
        Share of the 95 % intervals that contain the true value.
    covered_error : float
        Standard error of this share.
    """

    elements: int
    parameter: str
    members: int
    mean: float
    sd: float
    mean_std_error: float
    bias: float
    bias_error: float
    covered: float
    covered_error: float


@dataclass(repr=False)
class Ensemble(Results):
    """A command on many records.

    `text`, `tables`, `summary` and `to_pandas` are those of `Results`.

    Attributes
    ----------
    statistics : list[MemberStatistics]
        Statistics of each parameter on each mesh.
    estimates : dict[str, ndarray]
        Estimates by parameter on the finest mesh, shape (members,); nan: the member failed.
    failures : dict[int, str]
        Messages of the members that failed, by their numbers, from 1.
    """

    _table: ClassVar[str] = "members"
    statistics: list[MemberStatistics] = field(default_factory=list)
    estimates: dict[str, np.ndarray] = field(default_factory=dict)
    failures: dict[int, str] = field(default_factory=dict)


def _run(command: str, cases: Sequence[Handle], labels: str, progress: Progress | None) -> Handle:
    """Run a command on open cases, and return the handle of its results."""
    name, titles, found = command.encode(), labels.encode(), Handle()
    numbers = (c_longlong*len(cases))(*[case.number.value for case in cases])
    compute("beamid_run", name, len(name), len(cases), numbers, titles, len(titles),
            byref(found.number), progress=progress)
    return found


def _results(command: str, cases: Sequence[Handle], progress: Progress | None,
             labels: str = "") -> dict[str, Any]:
    """Run a command, and return its summary and tables."""
    found = _run(command, cases, labels, progress)
    return dict(text=text_of(found, "summary"),
                tables={name: text_of(found, name) for name in text_of(found, "tables").split()})


def _opened(case: str | PathLike[str] | Problem) -> Handle:
    """Return the handle of a case file or a problem."""
    if isinstance(case, Problem):
        return case._handle
    return open_case(os.fspath(case), "", [], fits=False)


def _units_of(case: Case | None, changes: Group) -> dict[str, str]:
    """Return the names of the units by quantity that a case and the argument `units` give."""
    named: dict[str, str] = {}
    if case is not None:
        named = {key: value.strip("'\"") for name, keys in read_groups(source_of(case)[1])
                 if name == "units" for key, value in keys.items()}
    named.update({key: str(value or "") for key, value in (changes or {}).items()})
    return named


def _changes_of(arguments: dict[str, Any]) -> set[str]:
    """Return the names of the arguments that change a case; names of units do not."""
    return {name for name, value in given(arguments, "case", "progress", "units").items()
            if value is not None}


def _is_changed(arguments: dict[str, Any]) -> bool:
    """Return whether arguments of a command change the structure of a case. Records belong to the
    structure that was measured: another one is not fitted to them."""
    return any(arguments.get(name) for name in STRUCTURE)


def _open_with_lines(case: str | PathLike[str] | Problem, changes: dict[str, Any]) -> Handle:
    """Return the handle of a case with its measured records, and with frequencies at which the
    response of the fitted structure is computed.

    Parameters
    ----------
    case
        Path of a case file, or a problem.
    changes
        Arguments of `frf` by name; `record` has the frequencies.
    """
    lines = changes.pop("record")
    path, text, records = changed_case(case, changes)
    held: list[AnyRecord | Lines] = list(records)
    groups = [(name, keys) for name, keys in read_groups(text)
              if name != "record" or held or "file" in keys]
    if held:
        held.append(Lines())
    with without_lines(path):
        return open_case(path, text_of_groups(groups) + group("record", lines), held, fits=False)


def _case_of(first: str, arguments: dict[str, Any], fits: bool = False,
             is_given: bool = False) -> Handle:
    """Return the handle of the case that the arguments of a command describe.

    Parameters
    ----------
    first
        Name of the first argument, which may be the whole case, or the times of a record.
    arguments
        `locals()` at the beginning of the command.
    fits
        Whether the command needs the free parameters of a fit.
    is_given
        Whether the values of the case are those of the structure, so that nothing is fitted.
    """
    keys = given(arguments, "progress")
    case = keys.pop(first)
    if first == "case" and not isinstance(case, (Fit, Problem, str, PathLike, type(None))):
        raise InputError(f"case: found {kind_of(case)}, expected the path of a case file, a "
                         "Problem or a Fit")
    if isinstance(case, (Fit, Problem, str, PathLike)):
        changes = {name: value for name, value in keys.items() if value is not None}
        if not changes and not isinstance(case, Fit):
            return _opened(case)
        left_out = OF_FITS if (isinstance(case, Fit) or is_given) and not fits else ()
        path, text, held = changed_case(case, changes, grid=True, left_out=left_out)
        with without_lines(path):
            return open_case(path, text, held, fits=False)
    record, records = keys.pop("record", None), keys.pop("records", None)
    stage = {name: keys.pop(name, None) for name in ("free", "start", "lower", "upper", "shared")}
    stages = keys.pop("stages", None)
    if stages is None:
        stages = [stage] if stage["free"] is not None else []
    held = []
    if records is not None or case is not None:
        held = records_of(case, case, record, records)
    described = [item.keys for item in held]
    if not held and record is not None:
        described = as_list(record, "record")
    text = case_text(described, as_list(stages, "stages"), keys)
    return open_case(IN_MEMORY, text, held, fits=False)


@describe_arguments
def simulate(t: ArrayLike | Case | None = None, *, record: Group = None, beam: Group = None,
             tip: Group = None, mass: Groups = None, hose: Groups = None, sensor: Groups = None,
             support: Groups = None, end: Groups = None, gravity: Group = None, axial: Group = None,
             along: Groups = None, excitation: Groups = None, discretization: Group = None,
             integrator: Group = None, observation: Group = None, noise: Group = None,
             units: Group = None, **other: Any) -> Simulation:
    """Simulate a record, as the command `simulate` does.

    Without ``discretization=dict(elements=...)`` the mesh is refined until the response no longer
    changes. `response` computes a response on one mesh, with its derivatives.

    The other arguments are those of `Problem`, which describes them with their units: `beam`,
    `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`, `axial`, `along`, `excitation`;
    `discretization`, `integrator`, `observation`; `units`; and any other group, `other`.

    Parameters
    ----------
    t : array_like, str, os.PathLike, Problem or Fit, optional
        Sample times, ascending [time]; or a case; or a fit, whose estimates are then the values of
        the case, on the mesh of the fit. The other arguments change the case, as in
        ``simulate(fit, excitation=dict(kind="release", displacement=0.02))``.
    record : mapping, optional
        In place of `t`, a grid of sample times: `t_first`, `t_last`, `t_step` [time]. `scale` and
        `offset` are those of the sensor.
    noise : mapping, optional
        Noise of the record: `sd` [length/time²], `seed`.

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another.
    ComputationError
        If the response cannot be computed.
    """
    results = _results("simulate", [_case_of("t", locals())], None)
    found = Simulation(**results)
    columns = found._finest("response.csv")
    found.t, found.acceleration, found.displacement, found.velocity, found.force = (
        columns[name] for name in ("t", "acceleration", "displacement", "velocity", "force"))
    found.record = _plots.read(found.tables["record.csv"])["acceleration"]
    return found


@describe_arguments
def modes(case: Case | None = None, *, beam: Group = None, tip: Group = None, mass: Groups = None,
          hose: Groups = None, sensor: Groups = None, support: Groups = None, end: Groups = None,
          gravity: Group = None, axial: Group = None, along: Groups = None,
          discretization: Group = None, units: Group = None, progress: Progress | None = None,
          **other: Any) -> Modes:
    """Compute the natural modes of a structure, as the command `modes` does.

    `Modes.tables` also has 'modes_fitted.csv', the modes of the fitted structure with their 95 %
    intervals, in two cases: for a `Fit` without other arguments than `units`, and for a problem or
    a case file that can be fitted and whose structure is not changed here. A problem is fitted for
    this purpose, and its other modes are those of the values in the case.

    The other arguments are those of `Problem`, which describes them with their units: `beam`,
    `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`, `axial`, `along`;
    `discretization`; `units`; and any other group, `other`.

    Parameters
    ----------
    case : str, os.PathLike, Problem or Fit, optional
        A case, or a fit, whose estimates are then the values of the case, on the mesh of the fit.
        The other arguments change the case, as in ``modes(fit, beam=dict(length=0.44))``.
    progress : bool or callable, optional
        See `Problem.fit`.

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another.
    ComputationError
        If the modes cannot be computed.
    """
    arguments = locals()
    handle = _case_of("case", arguments, is_given=_is_changed(arguments))
    found = Modes(**_results("modes", [handle], progress), _units=_units_of(case, units))
    columns = found._finest("modes.csv")
    found.s = columns["real"] + 1j*columns["imag"]
    found.frequencies, found.damping_ratios = columns["frequency_hz"], columns["damping_ratio"]
    if isinstance(case, Fit) and not _changes_of(arguments):
        found.tables["modes_fitted.csv"] = case.tables["modes.csv"]
    if "shapes.csv" in found.tables:
        columns = _plots.read(found.tables["shapes.csv"])
        found.x = columns["x"]
        found.shapes = np.array([columns[f"mode_{k}_real"] + 1j*columns[f"mode_{k}_imag"]
                                 for k in range(1, (len(columns) - 1)//2 + 1)])
        # The table has the lowest modes that oscillate.
        found.shape_modes = np.flatnonzero(found.s.imag > 0)[:len(found.shapes)] + 1
    return found


@describe_arguments
def frf(case: Case | None = None, *, record: Groups = None,
        records: AnyRecord | Sequence[AnyRecord] | None = None, free: Names | None = None,
        start: Any = None, lower: Any = None, upper: Any = None, shared: Names | None = None,
        stages: Groups = None, beam: Group = None, tip: Group = None, mass: Groups = None,
        hose: Groups = None, sensor: Groups = None, support: Groups = None, end: Groups = None,
        gravity: Group = None, axial: Group = None, along: Groups = None,
        excitation: Groups = None, discretization: Group = None, prior: Groups = None,
        units: Group = None, progress: Progress | None = None, **other: Any) -> FrequencyResponse:
    """Compute the frequency response of a structure, as the command `frf` does.

    A problem or a case file that can be fitted is fitted first: the response is that of the fitted
    structure, with its 95 % band. Of a `Fit`, it is the same response with the same band; for the
    band, the search is repeated from the start values of the fit. Without `record`, the response is
    computed at the lines of the first measured response; time records and tables of modes have no
    lines.

    If `record` and a change of the structure are given, nothing is fitted, because the records of
    the case belong to the structure that was measured. Beside a `Fit`, any argument other than
    `record` and `units` changes the fitted structure, needs `record`, and gives a response without
    a band.

    The other arguments are those of `Problem`, which describes them with their units: `free`,
    `start`, `lower`, `upper`, `shared`, `stages`; `beam`, `tip`, `mass`, `hose`, `sensor`,
    `support`, `end`, `gravity`, `axial`, `along`, `excitation`; `discretization`, `prior`; `units`;
    and any other group, `other`.

    Parameters
    ----------
    case : str, os.PathLike, Problem or Fit, optional
        A case, or a fit, whose estimates are then the values of the case, on the mesh of the fit.
        The other arguments change the case: ``frf(fit, beam=dict(length=0.44), record=...)``.
    record : mapping
        Frequencies of the response, `f_first`, `f_last`, `f_step` [1/time]; position of the force,
        `x_F` [length]; `quantity` ('accelerance', 'mobility' or 'receptance'),
        `exponential_window` [1/time], `sensor`.
    records : FrequencyRecord or sequence of records, optional
        In place of `record`: records to fit. The response is computed at the lines of the first
        `FrequencyRecord`.
    progress : bool or callable, optional
        See `Problem.fit`.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another.
    ComputationError
        If the response cannot be computed.
    """
    arguments = locals()
    if isinstance(record, Mapping):
        arguments["record"] = dict(record, kind="frf")
    changes = _changes_of(arguments)
    if isinstance(case, Fit):
        if changes <= {"record"}:
            if case.no_fit:
                raise NoFit(case.no_fit, case)
            arguments["case"] = case._problem_from_start()
        elif record is None and not changes - {*GROUPS} & {*other, *STAGE, "stages", "records"}:
            raise InputError(f"frf: found {', '.join(sorted(changes))} beside a fit and no record, "
                             "expected record=dict(f_first=..., f_last=..., f_step=...): the lines "
                             "of a measured response belong to the structure that was measured")
    source = arguments["case"]
    if isinstance(source, (Problem, str, PathLike)) and isinstance(record, Mapping) \
            and not _is_changed(arguments):
        handle = _open_with_lines(source, {name: value for name, value in given(
            arguments, "case", "progress").items() if value is not None})
    else:
        # Without lines, the response is that at the lines of the measured one, which belongs to a
        # fit.
        handle = _case_of("case", arguments, is_given=_is_changed(arguments) and record is not None)
    found = FrequencyResponse(**_results("frf", [handle], progress), _units=_units_of(case, units))
    columns = found._finest("frf.csv")
    found.frequencies, found.h = columns["frequency_hz"], columns["real"] + 1j*columns["imag"]
    if "magnitude_lower95" in columns:
        found.band = np.column_stack([columns["magnitude_lower95"], columns["magnitude_upper95"]])
    return found


@describe_arguments
def design(case: Case | None = None, *, record: Groups = None, free: Names | None = None,
           stages: Groups = None, beam: Group = None, tip: Group = None, mass: Groups = None,
           hose: Groups = None, sensor: Groups = None, support: Groups = None, end: Groups = None,
           gravity: Group = None, axial: Group = None, along: Groups = None,
           excitation: Groups = None, discretization: Group = None, observation: Group = None,
           prior: Groups = None, noise: Group = None, design: Group = None, units: Group = None,
           progress: Progress | None = None, **other: Any) -> Design:
    """Predict the errors that candidate experiments would give, as the command `design` does.

    The other arguments are those of `Problem`, which describes them with their units: `beam`,
    `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`, `axial`, `along`, `excitation`;
    `discretization`, `observation`, `prior`; `units`; and any other group, `other`.

    Parameters
    ----------
    case : str, os.PathLike, Problem or Fit, optional
        A case, or a fit, whose estimates are then the values of the case, on the mesh of the fit.
        The other arguments change the case, as in ``design(fit, beam=dict(length=0.44))``.
    record : mapping or sequence of mappings
        Sample times of the present experiment: `t_first`, `t_last`, `t_step` [time]; of a
        frequency response `kind="frf"`, `f_first`, `f_last`, `f_step` [1/time].
    free : str or sequence of str
        Names of the parameters to estimate.
    stages : mapping or sequence of mappings, optional
        Keys of several stages, in place of `free`.
    noise : mapping
        Noise of the record: `sd` [length/time²]. Default with a fit: that of its case, or else
        the noise that it has found in its first record.
    design : mapping
        Lists of settings to choose from: `x_S`, `x_F` [length] or 'auto', `duration`, `t_last`
        [time], `f_last` [1/time] and so on; `target`, the relative standard error to reach.
    progress : bool or callable, optional
        See `Problem.fit`.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another.
    ComputationError
        If a response cannot be computed.
    """
    arguments = locals()
    check_keys("design", other)
    if isinstance(case, Fit) and noise is None and not any(
            name == "noise" for name, _ in read_groups(changed_case(case, {})[1])):
        quality = _plots.read(case.tables["quality.csv"])
        arguments["noise"] = dict(sd=float(quality["noise_sd"][0]))
    found = Design(**_results("design", [_case_of("case", arguments, fits=True)], progress))
    columns = _plots.read(found.tables["design.csv"])
    names = [name for name in ("x_S", "x_S_2", "x_F", "duration", "t_first", "t_last", "t_step",
                               "f_first", "f_last", "f_step", "samples") if name in columns]
    found.settings = [dict(zip(names, values))
                      for values in zip(*(columns[name].tolist() for name in names))]
    found.std_errors = {name[3:]: values for name, values in columns.items()
                        if name.startswith("sd_")}
    found.D, found.A, found.E = columns["D"], columns["A"], columns["E"]
    return found


def compare(*cases: Case | Fit | Mapping[str, Case | Fit],
            damping: bool | Literal["ratios"] = False,
            progress: Progress | None = None) -> Comparison:
    """Compare several models of the same records, as the command `compare` does.

    Parameters
    ----------
    *cases : str, os.PathLike, Problem or Fit
        The models; or one mapping with the models by their names in the tables. By default a case
        file is called by its name, and a problem 'model' with its number.
    damping : bool or 'ratios', default False
        Whether to compare damping mechanisms for one case: each of them is fitted to its records,
        with the other free parameters of the case. 'ratios': to the damping ratios alone.
    progress : bool or callable, optional
        See `Problem.fit`.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If a case cannot be fitted, or the records differ.
    ComputationError
        If a fit fails.
    """
    if len(cases) == 1 and isinstance(cases[0], Mapping):
        labels = [str(name) for name in cases[0]]
        cases = tuple(cases[0].values())
    else:
        labels = []
    if damping not in (True, False, "ratios"):
        raise InputError(f"damping: found {damping!r}, expected True, False or 'ratios'")
    items: list[str | PathLike[str] | Problem] = []
    for case in cases:
        if not isinstance(case, (Fit, Problem, str, PathLike)):
            raise InputError(
                f"compare: found {kind_of(case)}, expected cases one after the other, as in "
                "compare(one, other), or one mapping with their names: compare({'one': one, ...})")
        items.append(case._problem if isinstance(case, Fit) else case)
    if not labels and any(isinstance(case, Problem) for case in items):
        labels = [_label(k, case) for k, case in enumerate(items, start=1)]
    for name in labels:
        if not name or set(name) & set(',"\n'):
            raise InputError(f"compare: found the name {name!r}, expected one without comma, "
                             "double quote and line feed")
    command = "compare"
    if damping:
        command += " --damping" if damping is True else f" --damping={damping}"
        if len(items) != 1:
            raise InputError(f"compare: found {len(items)} cases beside damping, expected one")
    found = Comparison(**_results(command, [_opened(case) for case in items], progress,
                                  "\n".join(labels)))
    found.models = [ComparedModel(row["model"], int(row["elements"]), int(row["parameters"]),
                                  float(row["J"]), float(row["aicc"]), float(row["bic"]))
                    for row in found._rows("models.csv")]
    found.nested = [NestedPair(row["restricted"], row["full"], int(row["restrictions"]),
                               float(row["U"]), float(row["probability"]))
                    for row in found._rows("nested.csv")]
    if damping:
        found.damping = [DampingRatio(row["model"], int(row["record"]), int(row["mode"]),
                                      *(float(row[key] or "nan") for key in (
                                          "frequency_hz", "damping_ratio", "measured_hz",
                                          "measured_damping", "lower95", "upper95")))
                         for row in found._rows("damping.csv")]
    return found


def _label(number: int, case: str | PathLike[str] | Problem) -> str:
    """Return the name of a model in the tables of a comparison."""
    path = case._path if isinstance(case, Problem) else os.fspath(case)
    return f"model {number}" if path == IN_MEMORY else Path(path).stem


@describe_arguments
def ensemble(t: ArrayLike | Case | None = None, *, record: Group = None,
             records: AnyRecord | Sequence[AnyRecord] | None = None, free: Names | None = None,
             start: Any = None, lower: Any = None, upper: Any = None, shared: Names | None = None,
             stages: Groups = None, beam: Group = None, tip: Group = None, mass: Groups = None,
             hose: Groups = None, sensor: Groups = None, support: Groups = None, end: Groups = None,
             gravity: Group = None, axial: Group = None, along: Groups = None,
             excitation: Groups = None, discretization: Group = None, integrator: Group = None,
             observation: Group = None, prior: Groups = None, sample: Group = None,
             bootstrap: Group = None, noise: Group = None, draw: Groups = None,
             ensemble: Group = None, units: Group = None, progress: Progress | None = None,
             **other: Any) -> Ensemble:
    """Run a command on many simulated records, or on a list of cases, as `ensemble` does.

    The members and their order are the same for any number of threads. All of them are kept in
    memory; the command line can share the work among several machines.

    The other arguments are those of `Problem`, which describes them with their units: `free`,
    `start`, `lower`, `upper`, `shared`, `stages`; `beam`, `tip`, `mass`, `hose`, `sensor`,
    `support`, `gravity`, `axial`, `along`, `excitation`; `discretization`, `integrator`,
    `observation`, `prior`, `sample`, `bootstrap`; `units`; and any other group, `other`.

    Parameters
    ----------
    t : array_like, str, os.PathLike, Problem or Fit, optional
        Sample times of the records, ascending [time]; or a case; or a fit, whose estimates are then
        the values of the case. The other arguments change the case.
    record : mapping, optional
        In place of `t`, a grid of sample times: `t_first`, `t_last`, `t_step` [time].
    records : Record or sequence of Record, optional
        Several records. Their values are replaced by those of the members.
    noise : mapping, optional
        Noise of the records: `sd` [length/time²].
    draw : mapping or sequence of mappings, optional
        Parameters that differ between members: `parameter`, `low`, `high`, in its unit.
    ensemble : mapping
        `members`, `seed`, `command` ('identify', 'profile', 'sample', 'bootstrap' or 'modes').
    progress : bool or callable, optional
        See `Problem.fit`.

    Returns
    -------
    Ensemble

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another, or all members would be the same.
    ComputationError
        If every member fails.
    """
    arguments = locals()
    check_keys("ensemble", other)
    found = Ensemble(**_results("ensemble", [_case_of("t", arguments, fits=True)], progress))
    found.statistics = [MemberStatistics(
        int(row["elements"]), row["parameter"], int(row["members"]),
        *(float(row[name] or "nan") for name in MemberStatistics._fields[3:]))
        for row in found._rows("ensemble.csv")]
    rows = found._rows("members.csv")
    count = int(rows[-1]["member"])
    for row in rows:
        k = int(row["member"])
        if row["status"] != "ok":
            found.failures[k] = row["message"]
            continue
        # Rows of a finer mesh follow those of a coarser one, and replace them.
        values = found.estimates.setdefault(row["parameter"], np.full(count, np.nan))
        values[k - 1] = float(row["estimate"] or "nan")
    return found
