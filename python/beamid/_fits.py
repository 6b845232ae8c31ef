"""Fits: a problem that is prepared once, and what a search has found."""
from __future__ import annotations

import html
import inspect
import io
import os
import re
import textwrap
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from ctypes import byref
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, NamedTuple, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _plots
from ._cases import (IN_MEMORY, AnyRecord, Group, Groups, Names, as_list, case_text, given,
                     open_case, records_of, written)
from ._changes import (STAGE, change, change_all, read_groups, set_estimates,
                       text_of_groups, without_lines)
from ._library import (Handle, InputError, NoFit, Progress, array_of, call, compute, documented,
                       numbers, optional, table_of, text_of)

if TYPE_CHECKING:
    import pandas

_Function = TypeVar("_Function", bound=Callable[..., Any])
#: What a pickled fit consists of, beside its tables.
ARRAYS = ("estimates", "J", "covariance", "correlation", "jacobian", "residual", "t", "measured",
          "modes")
TEXTS = ("names", "units", "note", "no_fit", "summary", "intervals", "tables")

#: Lines of a verdict that only measure: the fit of a record, and a mode or a spectral line.
_MEASURE = re.compile(r" |record \d+: \d+ (sample|line|mode)s?, ")


@documented
class Estimate(NamedTuple):
    """The estimate of a parameter, in its own unit.

    If the records do not determine the parameter, its interval has infinite or missing (nan) ends.

    Attributes
    ----------
    name : str
        Name of the parameter.
    value : float
        Estimated value.
    unit : str
        Unit of the parameter, if the argument `units` names the units; otherwise empty.
    start : float
        Value from which the search started.
    std_error : float
        Standard error due to noise alone, if the noise is white. It is smaller than the total
        error: do not compute intervals from it, but use `interval`.
    noise_interval : tuple[float, float]
        95 % interval due to noise alone, with its autocorrelation taken into account.
    interval : tuple[float, float]
        Total 95 % interval. It includes the noise, the discretization error and the errors of fixed
        parameters that have a `prior`.
    determined : bool
        Whether the records determine the parameter. It is False if the interval is wider than the
        value, or if the verdict says that no parameter counts as determined.
    """

    name: str
    value: float
    unit: str
    start: float
    std_error: float
    noise_interval: tuple[float, float]
    interval: tuple[float, float]
    determined: bool


@documented
class Mode(NamedTuple):
    """A natural mode of the fitted structure.

    Attributes
    ----------
    record : int
        Number of the record.
    s : complex
        Root of the characteristic equation, the complex exponent of the motion e^(s t) [1/time].
    frequency : float
        Natural frequency, abs(s)/(2 π) [1/time].
    damping_ratio : float
        Damping ratio, -Re(s)/abs(s).
    frequency_half_width : float
        Half width of the 95 % interval of the frequency [1/time].
    damping_half_width : float
        Half width of the 95 % interval of the damping ratio.
    """

    record: int
    s: complex
    frequency: float
    damping_ratio: float
    frequency_half_width: float
    damping_half_width: float


@documented
class FittedResponse(NamedTuple):
    """A measured frequency response beside that of the fitted structure.

    Attributes
    ----------
    record : int
        Number of the record.
    frequencies : ndarray
        Frequencies of the lines that were used, shape (n,) [1/time].
    measured : ndarray
        Measured response per unit force, complex, shape (n,).
    model : ndarray
        Response of the fitted structure, complex, shape (n,).
    residual : ndarray
        Measured - model, complex, shape (n,).
    band : ndarray
        Ends of the 95 % interval of the magnitude of the model, shape (n, 2); nan: a
        parameter is not determined.
    sd : ndarray
        Standard deviation of real and imaginary part, shape (n,); nan: estimated by the
        fit.
    coherence : ndarray
        Coherence, shape (n,); nan: not known.
    """

    record: int
    frequencies: np.ndarray
    measured: np.ndarray
    model: np.ndarray
    residual: np.ndarray
    band: np.ndarray
    sd: np.ndarray
    coherence: np.ndarray


@documented
class FittedMode(NamedTuple):
    """A measured mode beside that of the fitted structure; nan: not measured.

    Attributes
    ----------
    record : int
        Number of the record.
    mode : int
        Number of the mode.
    frequency : float
        Measured natural frequency [1/time].
    sd : float
        Its standard deviation [1/time].
    model_frequency : float
        Natural frequency of the fitted structure [1/time].
    residual : float
        Measured frequency - that of the model [1/time].
    damping_ratio : float
        Measured damping ratio.
    sd_damping : float
        Its standard deviation.
    model_damping_ratio : float
        Damping ratio of the fitted structure.
    damping_residual : float
        Measured damping ratio - that of the model.
    """

    record: int
    mode: int
    frequency: float
    sd: float
    model_frequency: float
    residual: float
    damping_ratio: float
    sd_damping: float
    model_damping_ratio: float
    damping_residual: float


class Fit:
    """The result of a search.

    `fit["E"]` is the `Estimate` of a parameter; iteration goes over the names of the parameters.
    Arrays are copies: a change of one does not change the fit.

    The search variables are the estimates in the order of `names`, with one exception: for a
    stiffness such as `k_R`, the search variable is its reciprocal 1/k_R. Covariances, correlations
    and derivatives refer to the search variables.

    A fit can be pickled and sent to another process. Numbers, texts and tables go with it. If
    `profile`, `sample` or `bootstrap` is then called with the fit, its problem is fitted again
    first. Copies by the module `copy` share the fit inside the library.
    """

    def __init__(self, handle: Handle, problem: Problem, start: np.ndarray, check: bool) -> None:
        self._handle: Handle | None = handle
        self._problem = problem
        self._search = start, check
        #: Commands that have added intervals, and for each the text of a case with its settings.
        self._commands: dict[str, str] = {}
        self._arrays: dict[str, np.ndarray] = {}
        self._texts: dict[str, str] = {}

    def __copy__(self) -> Fit:
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        return twin

    def __deepcopy__(self, _: Any) -> Fit:
        return self.__copy__()

    def __getstate__(self) -> dict[str, Any]:
        self._judge()
        texts = {name: self._text(name) for name in TEXTS}
        texts.update({name: self._text(name) for name in texts["tables"].splitlines()})
        return {"_handle": None, "_problem": self._problem, "_search": self._search,
                "_commands": self._commands, "_texts": texts,
                "_arrays": {name: self._array(name) for name in ARRAYS}}

    def _array(self, name: str) -> np.ndarray:
        if self._handle is None:
            return self._arrays[name].copy()
        return array_of(self._handle, name)

    def _text(self, name: str) -> str:
        if self._handle is None:
            return self._texts.get(name, "")
        return text_of(self._handle, name)

    def _judge(self, progress: Progress | None = None) -> None:
        handle = self._handle
        if handle is None:    # judged before it was pickled
            return
        with handle.lock:
            if not handle.is_judged:
                compute("beamid_judge", handle.number, progress=progress)
                handle.is_judged = True

    def _infer(self, command: str, settings: Mapping[str, Any], progress: Progress | None) -> None:
        """Add the tables of a command to those of the fit.

        Parameters
        ----------
        command
            'profile', 'sample' or 'bootstrap'.
        settings
            Keys of the groups `sample` and `bootstrap` that differ from those of the case.
        """
        if self.no_fit:
            raise NoFit(self.no_fit, self)
        text = changed_case(self._problem, settings)[1] if settings else ""
        commands = {command: text}
        if self._handle is None:
            # The fit inside the library stayed in another process: it is made again, with the
            # intervals that it had.
            commands = {**self._commands, **commands}
            handle = self._problem._search(*self._search, progress)
            compute("beamid_judge", handle.number, progress=progress)
            handle.is_judged = True
            self._handle = handle
        for item, its_text in commands.items():
            name = item.encode()
            with self._handle.lock:
                self._set_methods(self._handle, its_text)
                compute("beamid_infer", self._handle.number, name, len(name), progress=progress)
        self._commands = {**self._commands, command: text}

    def _set_methods(self, fit: Handle, text: str) -> None:
        """Give the fit in the library the settings of `sample` and `bootstrap` in the text of a
        case; '': those of its own case."""
        if fit.methods == text:
            return
        path, own, _ = source_of(self._problem)
        with without_lines(path):
            case = open_case(path, text or own, [], fits=False)
        call("beamid_set_methods", fit.number, case.number)
        fit.methods = text

    def _problem_from_start(self) -> Problem:
        """Return the problem whose fit this is: that of the case, with the start values of this
        fit."""
        start = self._search[0]
        if not start.size:
            return self._problem
        path, text, records = source_of(self._problem)
        groups = read_groups(text)
        next(keys for name, keys in groups if name == "stage")["start"] = written(start)
        problem = Problem.__new__(Problem)
        with without_lines(path):
            problem._set(path, text_of_groups(groups), records)
        return problem

    @property
    def names(self) -> list[str]:
        """Names of the estimates: parameters, then the unknowns that enter linearly."""
        return self._text("names").splitlines()

    @property
    def values(self) -> np.ndarray:
        """Estimates, shape (n,)."""
        return self._array("estimates")[:, 1]

    @property
    def J(self) -> float:
        """Sum of squared residuals; with several records, each divided by its noise."""
        return float(self._array("J")[0, 0])

    @property
    def covariance(self) -> np.ndarray:
        """Covariance matrix of the search variables, shape (n, n), for white noise."""
        return self._array("covariance")

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix of the search variables, shape (n, n)."""
        return self._array("correlation")

    @property
    def jacobian(self) -> np.ndarray:
        """Derivatives of the model with respect to the search variables, shape (rows, n).

        The derivatives of the residuals are the negative of these. With several records, each row
        is divided by the noise of its record. Behind the samples there is a row for each prior.
        """
        return self._array("jacobian")

    @property
    def residuals(self) -> np.ndarray:
        """Residuals, record - model, shape (m,), of all records in turn [length/time²]. They are
        those of the column `residual` in `fit.csv`.

        Residuals of a frequency response or a table of modes are divided by the standard
        deviations that the record states: first all real parts, then all imaginary parts; first
        all frequencies, then all damping ratios. `frequency_responses` and `measured_modes` have
        them in their units."""
        # 0 - r, not -r: a residual that vanishes is 0, not -0.
        residuals: np.ndarray = 0 - self._array("residual")[:, 0]
        return residuals

    @property
    def model(self) -> np.ndarray:
        """Accelerations of the model at the times of the samples, shape (m,) [length/time²]."""
        model: np.ndarray = self.measured - self.residuals
        return model

    @property
    def t(self) -> np.ndarray:
        """Times of the samples that were used, shape (m,), of all records in turn [time].
        Frequency responses and tables of modes have none."""
        return self._array("t")[:, 0]

    @property
    def measured(self) -> np.ndarray:
        """Recorded accelerations at these times, shape (m,) [length/time²]."""
        return self._array("measured")[:, 0]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Estimates by name, with intervals by every source of error."""
        self._judge()
        rows = self._array("estimates").tolist()
        names = self.names
        # The rows of the last stage on the finest mesh come last in the table.
        table = [line.split(",") for line in self._text("estimates.csv").splitlines()]
        place = {name: k for k, name in enumerate(table[0])}
        said = {row[place["parameter"]]: row[place["determined"]] == "yes" for row in table[1:]}
        return {name: Estimate(name, row[1], unit, row[0], row[4], (row[7], row[8]),
                               (row[9], row[10]), said.get(name, False))
                for name, unit, row in zip(names, self._text("units").split("\n"), rows)}

    def __getitem__(self, name: str) -> Estimate:
        if name not in self.estimates:
            raise KeyError(f"{name}: expected one of {', '.join(self.estimates)}")
        return self.estimates[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def modes(self) -> list[Mode]:
        """Lowest natural modes of the fitted structure."""
        self._judge()
        return [Mode(int(row[0]), complex(row[1], row[2]), *row[3:])
                for row in self._array("modes").tolist()]

    @property
    def frequency_responses(self) -> list[FittedResponse]:
        """Measured and fitted frequency responses of the records with `FrequencyRecord` or
        kind='frf', on the finest mesh."""
        columns = self._finest("frf.csv")
        if not columns:
            return []
        found = []
        for record in np.unique(columns["record"]):
            of = {name: values[columns["record"] == record] for name, values in columns.items()}
            unknown = np.full(of["real"].size, np.nan)
            measured, model, residual = (of[stem + "real"] + 1j*of[stem + "imag"]
                                         for stem in ("measured_", "", "residual_"))
            band = np.column_stack([of["magnitude_lower95"], of["magnitude_upper95"]])
            found.append(FittedResponse(
                int(record), of["frequency_hz"], measured, model, residual, band,
                of.get("sd", unknown), of.get("coherence", unknown)))
        return found

    @property
    def measured_modes(self) -> list[FittedMode]:
        """Measured and fitted modes of the records with `ModalRecord` or kind='modes', on the
        finest mesh."""
        columns = self._finest("modal_fit.csv")
        rows = zip(*(columns[name].tolist() for name in (
            "record", "mode", "measured_hz", "sd_hz", "model_hz", "residual_hz",
            "measured_damping", "sd_damping", "model_damping", "residual_damping"))) \
            if columns else ()
        return [FittedMode(int(row[0]), int(row[1]), *row[2:]) for row in rows]

    def _finest(self, table: str) -> dict[str, np.ndarray]:
        """Return the columns of a table of the finest mesh; none if there is no such table."""
        self._judge()
        text = self._text(table)
        if not text:
            return {}
        columns = _plots.read(text)
        chosen = columns["elements"] == columns["elements"][-1]
        return {name: values[chosen] for name, values in columns.items()}

    @property
    def no_fit(self) -> str:
        """Reason why the verdict rejects the fit; empty if it does not."""
        self._judge()
        return self._text("no_fit")

    @property
    def note(self) -> str:
        """Parameters that are held fixed because a mode is not in the record; empty if none."""
        return self._text("note")

    @property
    def verdict(self) -> str:
        """The verdict on the fit, with which the summary begins, one statement per line: warnings,
        the share of each record that the model explains, and the modes that the records show."""
        # The summary is wrapped: continuation lines start with four blanks.
        return re.sub(r" *\n {4,}", " ", self.summary().partition("\n\n")[0])

    @property
    def warnings(self) -> list[str]:
        """Sentences of the verdict that call for attention, such as 'gamma, which the model leaves
        out, is significant ...'; empty if there are none."""
        return [line.strip() for line in self.verdict.splitlines()
                if line.endswith(": unexplained") or not _MEASURE.match(line)]

    def summary(self) -> str:
        """Return the summary that the program prints for such a fit.

        Returns
        -------
        str
            The text of `summary.txt`: the verdict, the estimates with their intervals, the modes
            and the checks.
        """
        self._judge()
        return self._text("summary")

    @property
    def tables(self) -> dict[str, str]:
        """Tables that the program writes for such a fit, by the name of the file: 'estimates.csv',
        ..., and those that `profile`, `sample` and `bootstrap` have added. 'case.txt' is no table,
        but the text of the case."""
        self._judge()
        return {name: self._text(name) for name in self._text("tables").splitlines()}

    def to_pandas(self, table: str = "estimates") -> pandas.DataFrame:
        """Return a table as a data frame, with the columns that the program writes.

        Parameters
        ----------
        table : str
            Name of a table, such as 'modes' or 'modes.csv'. `tables` has the names, those that
            end with '.csv'.

        Raises
        ------
        ImportError
            If pandas is not installed.
        KeyError
            If there is no such table.
        """
        pandas = optional("pandas", "to_pandas")
        return pandas.read_csv(io.StringIO(table_of(self.tables, table)))

    def plot(self, record: int = 1, axes: Any = None) -> Any:
        """Draw record and model, and below them the residuals, record - model. Of a frequency
        response, draw magnitude, phase and the magnitude of the residuals.

        Parameters
        ----------
        record : int
            Number of the record, from 1.
        axes : sequence of two or three matplotlib axes, optional
            Where to draw. Default: a new figure.

        Returns
        -------
        numpy.ndarray of Axes of shape (2,), or (3,) for a frequency response

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If there is no such record.
        """
        self._judge()
        for found in self.frequency_responses:
            if found.record == record:
                lower, upper = found.band.T
                return _plots.response(found.frequencies, found.model, lower, upper, axes,
                                       "Fit.plot", self._units(), found.measured)
        return _plots.fit(self._text("fit.csv"), self._text("labels.csv"), record, axes)

    def plot_modes(self, axes: Any = None) -> Any:
        """Draw the mode shapes of the fitted structure in the first record.

        Parameters
        ----------
        axes : sequence of matplotlib axes, optional
            Where to draw, one axes for each mode. Default: a new figure.

        Returns
        -------
        numpy.ndarray of Axes of shape (modes,)

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If the structure has no mode that oscillates.
        """
        of_record = [mode for mode in self.modes if mode.record == 1]
        modes = [(number, mode.frequency, mode.damping_ratio)
                 for number, mode in enumerate(of_record, start=1) if mode.s.imag > 0]
        return _plots.shapes(self._text("shapes.csv"), self._text("attachments.csv"),
                             self._units(), modes, axes)

    def _units(self) -> dict[str, str]:
        return _plots.read_units(self._text("labels.csv"))

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{name}</th>" for name in (
            "parameter", "estimate", "unit", "95 % interval", "determined"))
        rows = [f"<tr><td>{html.escape(e.name)}</td><td>{e.value:.6g}</td>"
                f"<td>{html.escape(e.unit)}</td>"
                f"<td>{e.interval[0]:.6g} to {e.interval[1]:.6g}</td>"
                f"<td>{'yes' if e.determined else 'no'}</td></tr>" for e in self.estimates.values()]
        lines = "<br>".join(html.escape(line) for line in self._statements())
        return (f"<p>{lines}</p>"
                f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>")

    def _statements(self) -> list[str]:
        """Return the lines of the verdict, without those of the modes that the records show."""
        return [line for line in self.verdict.splitlines()
                if not (line.startswith(" ") and line.endswith(": seen"))]

    def __repr__(self) -> str:
        lines = [textwrap.fill(line, 100, subsequent_indent="    ") for line in self._statements()]
        lines += ["", f"{'':10s}{'estimate':>14s}{'95 % interval':>30s}"]
        for e in self.estimates.values():
            ends = f"{e.interval[0]:.6g} .. {e.interval[1]:.6g}"
            lines.append(f"{e.name:10s}{e.value:14.6g}{ends:>30s} {e.unit}".rstrip()
                         + ("" if e.determined else "  (not determined)"))
        return "\n".join(lines)


class Problem:
    """Records and a model, prepared for any number of fits, from any number of threads.

    Each group of a case file is an argument: a dict of its keys, or a list of dicts for a group
    that may repeat. The page *Case file* of the documentation has all keys with their units and
    defaults. Units are the user's own, but must be consistent: stiffnesses are in force/length,
    E in force/length² and so on. The argument `units` names them, and enables the checks of units.

    A problem can be pickled: the arguments go with it. The record files of a case file are read
    again in the other process.

    Parameters
    ----------
    t : array_like of shape (m,), optional
        Times of the samples of one record, ascending [time].
    a : array_like of shape (m,), optional
        Values of these samples; see `Record`.
    record : mapping, optional
        Further arguments of `Record` for this record, such as ``dict(t_first=0.2, scale=9.81)``. In
        place of `t` and `a`, `file` reads a text file, as in a case file: ``dict(file="record.csv",
        time_column="t", value_column="a")``.
    records : Record, FrequencyRecord, ModalRecord or sequence of these, optional
        Records, in place of `t`, `a` and `record`. They may be of several kinds.
    free : str or sequence of str, optional
        Names of the parameters to estimate, such as ``["E", "c_D", "offset"]``.
    start : sequence of float, 'auto' or 'case', optional
        Start values, one for each name, in the units of the parameters; 'auto': from the spectral
        lines of the record; 'case': the values of the case.
    lower, upper : sequence of float, optional
        Bounds, one for each name, in the units of the parameters.
    shared : str or sequence of str, optional
        Names of the parameters that several records have in common. Default: all.
    stages : mapping or sequence of mappings, optional
        Keys of several stages, each with `free` and so on, in place of the five arguments above.
    beam : mapping
        `length` [length], `E` [force/length²], `c_D` [force time/length²], `rho` [mass/length] or
        `density` [mass/length³], `I` [length⁴] or `width` and `height` [length], `gamma`
        [force time/length²], `eta` [none], `a_h` [force time], `b_h` [length], `d_1` [none], `b_1`
        [1/time], `d_2` [none], `b_2` [1/time], `k_R` [force length], `c_R` [force length time].
    tip : mapping, optional
        Mass at the tip: `m_T` [mass], `J_T` [mass length²].
    mass : mapping or sequence of mappings, optional
        Mass on the beam: `x` [length], `m` [mass], `J` [mass length²], `name`.
    hose : mapping or sequence of mappings, optional
        Hose or absorber: `x_H` [length], `m_H` [mass], `c_H` [force time/length],
        `k_H` [force/length], `name`.
    sensor : mapping or sequence of mappings, optional
        Accelerometer: its position `x_S` [length], the tip by default; `m_S` [mass] and `J_S`
        [mass length²], 0 by default; `name`, required with several sensors. Without this argument,
        an accelerometer without mass is at the tip.
    support : mapping or sequence of mappings, optional
        Support: `x_P` [length], `k_P` [force/length], `c_P` [force time/length],
        `k_R` [force length], `c_R` [force length time], `name`.
    end : mapping or sequence of mappings, optional
        What holds an end of the beam: `at` ('root' or 'tip'), `kind` ('clamped', 'pinned', 'guided'
        or 'free'), or the springs and dampers `k_w` [force/length], `c_w` [force time/length],
        `k_R` [force length], `c_R` [force length time]. Default: the root is clamped, the tip free.
    gravity : mapping, optional
        Weight: `g` [length/time²], `direction` ('hanging' or 'standing').
    axial : mapping, optional
        Axial force: `force`, positive in tension [force].
    along : mapping or sequence of mappings, optional
        Property that varies along the beam: `parameter`, `x` [length], `value` in the unit of the
        property.
    excitation : mapping or sequence of mappings
        Source of the motion: `kind` and the keys of this kind. 'pulse': a constant force
        `amplitude` [force] from time 0 on, for the `duration` [time]. 'table': a force from a file;
        `file`, `time_column`, `value_column`, and `rate` [1/time] without a column of times.
        'release': the beam is deflected by a static `force` [force] or `displacement` [length], and
        released at `time` [time], 0 by default. 'free': nothing drives the beam; the initial state
        of `modes` modes, 2 by default, is estimated. 'base': the base moves with the acceleration
        in a file; keys as for 'table'. Force, deflection: at `x_F` [length], the tip by default;
        `load` ('point' or 'distributed') and `power` describe a load along the beam.
    discretization : mapping, optional
        Mesh: `degree`, `elements`.
    integrator : mapping, optional
        Solver: `method` ('modal' or 'cvode') and its tolerances.
    observation : mapping, optional
        Observed acceleration: `formula`, `delta` [time], `frame`.
    prior : mapping or sequence of mappings, optional
        Prior of a parameter: `parameter`, `value`, `sd`, in the unit of the parameter.
    score, multistart, windows : mapping, optional
        Window of the score, several starts, and fits in windows.
    sample : mapping, optional
        Settings of the draws from the posterior: `draws`, `seed`, `method`, `noise`.
    bootstrap : mapping, optional
        Settings of the resampled records: `n`, `seed`, `kind`, `block`.
    units : mapping, optional
        Names of the units, `length`, `mass`, `time` and `force`, such as ``dict(length="m",
        mass="kg", time="s", force="N")``. They appear in texts and tables. The names m, s, and kg
        or N enable the checks of units: if a value that looks like GPa, mm or g contradicts the
        record, a message says so.
    **other
        Any other group of a case file. A fit ignores the groups of other functions: `noise`,
        `design`, `track`, `ensemble` and `draw`.

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another, or a record is unusable.
    """

    def __init__(self, t: ArrayLike | None = None, a: ArrayLike | None = None, *,
                 record: Group = None, records: AnyRecord | Sequence[AnyRecord] | None = None,
                 free: Names | None = None, start: Any = None, lower: Any = None, upper: Any = None,
                 shared: Names | None = None, stages: Groups = None, beam: Group = None,
                 tip: Group = None, mass: Groups = None, hose: Groups = None, sensor: Groups = None,
                 support: Groups = None, end: Groups = None, gravity: Group = None,
                 axial: Group = None, along: Groups = None, excitation: Groups = None,
                 discretization: Group = None, integrator: Group = None, observation: Group = None,
                 prior: Groups = None, score: Group = None, multistart: Group = None,
                 windows: Group = None, sample: Group = None, bootstrap: Group = None,
                 units: Group = None, **other: Any) -> None:
        groups = given(locals(), "t", "a", "record", "records", "free", "start", "lower", "upper",
                       "shared", "stages")
        items = []
        if t is None and a is None and records is None and isinstance(record, Mapping) \
                and "file" in record:    # the library reads it
            described: list[Mapping[str, Any]] = [
                dict(record, file=os.path.abspath(record["file"]))]
        else:
            items = records_of(t, a, record, records)
            described = [item.keys for item in items]
        stage = dict(free=free, start=start, lower=lower, upper=upper, shared=shared)
        if stages is None:
            stages = stage
        elif any(value is not None for value in stage.values()):
            raise InputError(f"found stages beside {', '.join(stage)}, expected one or the other")
        text = case_text(described, as_list(stages, "stages"), groups)
        self._set(IN_MEMORY, text, items)

    def _set(self, path: str, text: str | bytes, records: Sequence[AnyRecord]) -> None:
        self._path, self._text, self._records = path, text, records
        self._lock = threading.Lock()
        self._opened: Handle | None = open_case(path, text, records, fits=True)

    def __repr__(self) -> str:
        where = "" if self._path == IN_MEMORY else f" of {self._path}"
        try:
            groups = read_groups(source_of(self)[1])
        except InputError:    # the case file is no longer there
            return f"Problem{where}"
        records = [keys for name, keys in groups if name == "record"]
        told = [item.described() for item in self._records] or [
            f"the file {keys['file']}" for keys in records if "file" in keys]
        free = [keys.get("free", "").replace("'", "").replace('"', "")
                for name, keys in groups if name == "stage"]
        return (f"Problem{where}: {len(told)} record{'s' if len(told) != 1 else ''} "
                f"({'; '.join(told)}), free: {'; then '.join(free)}")

    @property
    def _handle(self) -> Handle:
        """The case inside the library; it is opened again in a process that got it by pickle."""
        with self._lock:
            if self._opened is None:
                self._opened = open_case(self._path, self._text, self._records, fits=True)
            return self._opened

    def __copy__(self) -> Problem:
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        return twin

    def __deepcopy__(self, _: Any) -> Problem:
        return self.__copy__()

    def __getstate__(self) -> dict[str, Any]:
        path, text = self._path, self._text
        if not text:    # a case file: its text now, and its folder wherever the other process is
            path = os.path.abspath(path)
            with suppress(OSError):
                text = Path(path).read_bytes()
        return {"_path": path, "_text": text, "_records": self._records, "_opened": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = threading.Lock()

    def _search(self, start: np.ndarray, check: bool, progress: Progress | None) -> Handle:
        """Return the handle of a fit without a verdict."""
        handle = Handle()
        compute("beamid_fit", self._handle.number, int(check), start.size, start.ctypes.data,
                byref(handle.number), progress=progress)
        return handle

    def fit(self, start: ArrayLike | None = None, *, judge: bool = True,
            progress: Progress | None = None) -> Fit:
        """Search for the minimum of the sum of squared residuals.

        Parameters
        ----------
        start : array_like of shape (n,), optional
            Start values of the free parameters of the first stage, in their order and units.
            Default: those of the problem.
        judge : bool
            Whether exact derivatives are compared with differences before the search, and the
            verdict is made after it. Without it a fit is several times faster, and the verdict is
            made when it is needed (`Fit.no_fit`).
        progress : bool or callable, optional
            True: a progress bar, by tqdm if that is installed. A function is called as
            ``progress(done, all, what)`` at most ten times a second; `all` is 0 if it is not known.
            An exception of the function stops the computation.

        Raises
        ------
        InputError
            If a start value is not finite or outside its bounds.
        ComputationError
            If the search fails.
        NoFit
            If the search ends, but does not explain the records; its `fit` holds the evidence.
        KeyboardInterrupt
            After Ctrl-C.
        """
        values = numbers([] if start is None else start, "start").copy()
        found = Fit(self._search(values, judge, progress), self, values, judge)
        if judge:
            found._judge(progress)
        if judge and found.no_fit:
            raise NoFit(found.no_fit, found)
        return found


def source_of(case: str | PathLike[str] | Problem | Fit) -> tuple[str, str, list[AnyRecord]]:
    """Return path, text and records of a case; raises InputError if its file cannot be read."""
    problem = case._problem if isinstance(case, Fit) else case
    records: list[AnyRecord] = []
    if isinstance(problem, Problem):
        path, source, records = problem._path, problem._text, list(problem._records)
    else:
        path, source = os.fspath(problem), ""
    if not source:
        try:
            source = Path(path).read_bytes()
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}") from None
    return path, source if isinstance(source, str) else source.decode(errors="replace"), records


def changed_case(case: str | PathLike[str] | Problem | Fit, changes: Mapping[str, Any], *,
                 grid: bool = False, left_out: Sequence[str] = ()
                 ) -> tuple[str, str, list[AnyRecord]]:
    """Return path, text and records of a case with other values.

    Parameters
    ----------
    case
        Path of a case file, a problem, or a fit, whose estimates become values of the case.
    changes
        Arguments of the function that are given beside the case, by name.
    grid
        Whether `record` is a grid of times in place of the records.
    left_out
        Groups of the case that the function does not need.

    Raises
    ------
    InputError
        If the case file cannot be read, or a change does not go with the case.
    NoFit
        If the verdict rejects the fit.
    """
    path, text, records = source_of(case)
    groups = [group for group in read_groups(text) if group[0] not in left_out]
    if not groups:
        raise InputError(f"{path}: found no group of a case file; a record is read by "
                         f"record=dict(file={path!r})")
    if isinstance(case, Fit):
        if case.no_fit:
            raise NoFit(case.no_fit, case)
        finest = int(case.tables["estimates.csv"].splitlines()[-1].split(",")[1])
        set_estimates(groups, dict(zip(case.names, case.values.tolist())), finest)
    changes = dict(changes)
    if "a" in changes:
        raise InputError("found values of a record beside a case, expected "
                         "records=beamid.Record(t, a, ...)")
    if "records" in changes:
        records = records_of(None, None, None, changes.pop("records"))
        change(groups, "record", [item.keys for item in records], replace=True)
    elif grid and "record" in changes:
        records = []
    change_all(groups, changes, grid=grid)
    return path, text_of_groups(groups), records


def changed_problem(case: str | PathLike[str] | Problem, changes: Mapping[str, Any]) -> Problem:
    """Return the problem of a case with other values; see `changed_case`."""
    problem = Problem.__new__(Problem)
    path, text, records = changed_case(case, changes)
    with without_lines(path):
        problem._set(path, text, records)
    return problem


def describe_arguments(function: _Function) -> _Function:
    """Add to the docstring of a function what that of `Problem` says about its arguments."""
    told = inspect.getdoc(function) or ""
    section = (inspect.getdoc(Problem) or "").partition("Parameters\n----------\n")[2]
    entries = re.split(r"\n(?=\S)", section.partition("\n\n")[0])
    names = set(inspect.signature(function).parameters)
    if "multistart" not in names:
        # Without a fit there is no record that could contradict a unit.
        entries = [re.sub(r"\s+The names m, s, and kg\b.*", "", entry, flags=re.DOTALL)
                   for entry in entries]
    more = [entry for entry in entries
            if names & set(re.findall(r"\w+", entry.partition(" :")[0]))
            and not re.search(rf"^{re.escape(entry.partition(' :')[0])} :", told, re.MULTILINE)]
    function.__doc__ = "\n".join([told, "", "Other Parameters", "----------------", *more])
    return function


#: The first argument of a fit or an inference: times of a record, a case file, a problem or a fit.
Subject = Union[ArrayLike, str, "PathLike[str]", Problem, Fit, None]


def load(path: str | PathLike[str]) -> Problem:
    """Prepare the problem of a case file, with the records that it names.

    Parameters
    ----------
    path : str or os.PathLike
        The case file.

    Raises
    ------
    InputError
        If the case file or a record is unusable.
    """
    problem = Problem.__new__(Problem)
    problem._set(os.fspath(path), "", [])
    return problem


@describe_arguments
def fit(t: Subject = None, a: ArrayLike | None = None, *, record: Group = None,
        records: AnyRecord | Sequence[AnyRecord] | None = None, free: Names | None = None,
        start: Any = None, lower: Any = None, upper: Any = None, shared: Names | None = None,
        stages: Groups = None, beam: Group = None, tip: Group = None, mass: Groups = None,
        hose: Groups = None, sensor: Groups = None, support: Groups = None, end: Groups = None,
        gravity: Group = None, axial: Group = None, along: Groups = None, excitation: Groups = None,
        discretization: Group = None, integrator: Group = None, observation: Group = None,
        prior: Groups = None, score: Group = None, multistart: Group = None, windows: Group = None,
        sample: Group = None, bootstrap: Group = None, units: Group = None,
        progress: Progress | None = None, **other: Any) -> Fit:
    """Fit the free parameters of a beam to one or several records.

    The arguments are those of `Problem`, which describes them with their units. Records and
    parameters: `t`, `a`, `record`, `records`, `free`, `start`, `lower`, `upper`, `shared`,
    `stages`. Structure and excitation: `beam`, `tip`, `mass`, `hose`, `sensor`, `support`, `end`,
    `gravity`, `axial`, `along`, `excitation`. Methods: `discretization`, `integrator`,
    `observation`, `prior`, `score`, `multistart`, `windows`, `sample`, `bootstrap`. Labels of
    units: `units`. Any other group: `other`.

    Parameters
    ----------
    t : array_like, str, os.PathLike, Problem or Fit
        Times of a record [time]; or the path of a case file, a `Problem` or a `Fit`. The other
        arguments then change the case: `fit(problem, free=["E", "m_S"])` frees other parameters,
        `beam=dict(E=None, length=0.44)` removes one key and changes another, and a list of dicts
        replaces all groups of that name.
    progress : bool or callable, optional
        See `Problem.fit`.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another, or a record is unusable.
    ComputationError
        If the search fails.
    NoFit
        If the search ends, but does not explain the records; its `fit` holds the evidence.
    """
    return fitted(locals(), progress)


def fitted(arguments: dict[str, Any], progress: Progress | None) -> Fit:
    """Return the fit that the arguments of a function describe.

    Parameters
    ----------
    arguments
        `locals()` at the beginning of the function.
    progress
        See `Problem.fit`.
    """
    case = arguments["t"]
    keys = given(arguments, "progress")
    if not isinstance(case, (Fit, Problem, str, PathLike)):
        return Problem(**keys).fit(progress=progress)
    changes = {name: value for name, value in keys.items() if value is not None and name != "t"}
    if isinstance(case, Fit):
        if not changes:
            return case
        start = None if {*STAGE, "stages"} & set(changes) else case._search[0]
        return changed_problem(case._problem, changes).fit(start, progress=progress)
    if changes:
        return changed_problem(case, changes).fit(progress=progress)
    return (case if isinstance(case, Problem) else load(case)).fit(progress=progress)
