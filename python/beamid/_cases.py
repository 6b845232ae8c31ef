"""Arguments as the text of a case file: the library reads and checks nothing else."""
from __future__ import annotations

import difflib
import inspect
import re
import tempfile
import uuid
from collections.abc import Iterable, Mapping, Sequence
from ctypes import byref, c_int
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike

from ._library import (Handle, InputError, complex_numbers, compute, groups as known_groups,
                       numbers)

#: Groups of a case file that are given by their name. Asked for at once, as a forked child may not
#: be able to ask.
GROUPS = [name for name in known_groups() if name not in ("record", "stage")]

#: Frequent keys of groups, for messages. The first group that has a key is named.
KEYS = {
    "beam": "length E c_D rho density I width height gamma eta a_h b_h d_1 b_1 d_2 b_2 k_R c_R",
    "tip": "m_T J_T", "sensor": "x_S m_S J_S", "support": "x_P k_P c_P",
    "hose": "x_H m_H c_H k_H",
    "excitation": "kind amplitude duration displacement force modes x_F", "gravity": "g direction",
    "discretization": "degree elements", "noise": "seed sd", "sample": "draws seed method noise",
    "bootstrap": "n seed kind block", "ensemble": "members seed command",
    "track": "parameter window hop rate frequency_error",
    "design": "x_S x_F duration t_first t_last t_step f_first f_last f_step noise_sd target"}
#: Arguments that are not groups.
ARGUMENTS = ("record", "records", "free", "start", "lower", "upper", "shared", "stages")

#: Name of a case in messages that has no file.
IN_MEMORY = "beamid"

#: Keys of a group, and keys of a group that may repeat.
Group = Optional[Mapping[str, Any]]
Groups = Union[None, Mapping[str, Any], Sequence[Mapping[str, Any]]]
#: One name or several.
Names = Union[str, Sequence[str]]


class Record:
    """Samples of one accelerometer.

    Parameters
    ----------
    t : array_like of shape (m,)
        Times of the samples, ascending [time]. A column or a row, of shape (m, 1) or (1, m), is
        accepted, too.
    a : array_like of shape (m,)
        Values of the samples; also a column or a row. The acceleration [length/time²] is
        ``scale*(a - offset)``. Masked samples are left out: ``np.ma.masked_invalid(a)`` masks those
        that are nan or infinite.
    t_first, t_last : float, optional
        Times of the first and the last sample that a fit uses [time]. Default: all samples. With
        ``excitation=dict(kind="free")``, a quiet stretch before the motion is left out by default.
    t_step : float, optional
        Time step of the samples that a fit uses [time]. Default: every sample.
    scale : float, optional
        Calibration factor, 1 by default.
    offset : float, optional
        Offset of the sensor, in the unit of `a`; 0 by default.
    clip_low, clip_high : float, optional
        Limits of the sensor, in the unit of `a`. Samples at or beyond them are left out. Default:
        found from flats of the signal.
    thin : int, optional
        Every thin-th sample is used, after a low-pass filter. Default: 1.
    sd : float, optional
        Standard deviation of the noise [length/time²]. Default: estimated.
    length : float, optional
        Length of the beam in this record [length]. Default: that of `beam`.
    x_S, x_P : float, optional
        Positions of the sensor and of the support in this record [length]. Default: those of
        `sensor` and `support`.
    sensor : str, optional
        Name of the sensor; required if there are several.
    experiment : int, optional
        Number of the experiment. Records with the same number share one motion.
    **other
        Any other key of the group `&record`.

    Raises
    ------
    InputError
        If times or values are not finite real numbers, or their numbers differ.
    """

    def __init__(self, t: ArrayLike, a: ArrayLike, *, t_first: float | None = None,
                 t_last: float | None = None, t_step: float | None = None,
                 scale: float | None = None, offset: float | None = None,
                 clip_low: float | None = None, clip_high: float | None = None,
                 thin: int | None = None, sd: float | None = None, length: float | None = None,
                 x_S: float | None = None, x_P: float | None = None, sensor: str | None = None,
                 experiment: int | None = None, **other: Any) -> None:
        places: np.ndarray | None = None
        if np.ma.is_masked(t) or np.ma.is_masked(a):
            sizes = np.size(t), np.size(a)
            if sizes[0] == sizes[1]:
                both: list[Any] = [np.ma.asanyarray(values).ravel() for values in (t, a)]
                kept = ~(np.ma.getmaskarray(both[0]) | np.ma.getmaskarray(both[1]))
                t, a = (np.ma.getdata(values)[kept] for values in both)
                places = np.flatnonzero(kept)
        self.t = numbers(t, "times of a record").copy()
        self.a = numbers(a, "values of a record").copy()
        self._check_finite(places)
        self.keys = dict(
            t_first=t_first, t_last=t_last, t_step=t_step, scale=scale, offset=offset,
            clip_low=clip_low, clip_high=clip_high, thin=thin, sd=sd, length=length, x_S=x_S,
            x_P=x_P, sensor=sensor, experiment=experiment, **other)
        self.check()

    def check(self) -> None:
        """Raise InputError if the numbers of times and values differ."""
        if np.size(self.t) != np.size(self.a):
            raise InputError(f"Record: found {np.size(self.t)} times and {np.size(self.a)} values, "
                             "expected as many of one as of the other")
        self._check_finite()

    def described(self) -> str:
        """Return the record in a few words."""
        return f"{np.size(self.t)} samples"

    def _check_finite(self, places: np.ndarray | None = None) -> None:
        """Raise InputError if a time or a value is not finite.

        places  indices of the samples in the arrays of the user; None: 0, 1, ...
        """
        for what, values in (("times", self.t), ("values", self.a)):
            if not np.isfinite(values).all():
                k = int(np.flatnonzero(~np.isfinite(values))[0])
                name = what[0] if what == "times" else "a"
                index = k if places is None else places[k]
                raise InputError(
                    f"{what} of a record: found {values[k]} at index {index} ({name}[0] is the "
                    f"first sample), expected finite numbers; np.ma.masked_invalid({name}) leaves "
                    "such samples out")


class TableRecord:
    """A record that is no function of time: a table with named columns.

    The library reads the table from a file. It is written with all digits into a temporary folder,
    which lives as long as the case inside the library.
    """

    #: Nothing is passed to the library as samples.
    t: ArrayLike = ()
    a: ArrayLike = ()

    def __init__(self, columns: Mapping[str, Any], what: str, keys: Mapping[str, Any]) -> None:
        self.columns = {name: numbers(values, f"{name} of {what}").copy()
                        for name, values in columns.items() if values is not None}
        self.what = what
        self._file = f"{uuid.uuid4().hex}.csv"    #: its name in the text of a case
        self.keys = dict(keys, file=self._file)
        self.check()

    def check(self) -> None:
        """Raise InputError if the columns differ in length, or a value is not finite."""
        sizes = {name: values.size for name, values in self.columns.items()}
        if len(set(sizes.values())) > 1:
            found = ", ".join(f"{size} of {name}" for name, size in sizes.items())
            raise InputError(f"{self.what}: found {found}, expected as many of each")
        for name, values in self.columns.items():
            if not np.isfinite(values).all():
                raise InputError(f"{self.what}: found a value of {name} that is not finite, "
                                 "expected finite ones")

    def described(self) -> str:
        """Return the record in a few words."""
        size = next(iter(self.columns.values())).size
        return f"{self.what} of {size} rows"

    def write(self, folder: str, text: str) -> str:
        """Write the table into a folder, and return the text of a case with its path."""
        path = Path(folder, self._file)
        rows = zip(*(values.tolist() for values in self.columns.values()))
        path.write_text(",".join(self.columns) + "\n"
                        + "".join(",".join(map(repr, row)) + "\n" for row in rows))
        return text.replace(self._file, str(path).replace("'", "''"))


class Lines:
    """A place for a group &record that has frequencies and no measured values."""

    t: ArrayLike = ()
    a: ArrayLike = ()

    def check(self) -> None:
        """Accept the group: the library checks its frequencies."""


class FrequencyRecord(TableRecord):
    """A measured frequency response function (FRF): response per unit force, with the convention
    e^(+i omega t).

    Values are in the units of the case. The library reads them from a temporary file, which lives
    as long as the problem.

    Parameters
    ----------
    frequency : array_like of shape (n,)
        Frequencies, ascending, in cycles per unit of time (Hz if times are in seconds).
    h : array_like of shape (n,)
        Complex response per unit force.
    coherence : array_like of shape (n,), optional
        Coherence, from 0 to 1. It requires `averages`.
    sd : float or array_like of shape (n,), optional
        Standard deviation of the real part, and of the imaginary part. Default: from `coherence`
        and `averages`, or else estimated.
    quantity : {'accelerance', 'mobility', 'receptance'}, optional
        Acceleration, velocity or displacement per force. Default: 'accelerance'.
    averages : int, optional
        Number of averaged blocks.
    x_F : float, optional
        Position of the force [length]. Default: that of `excitation`, or else the tip.
    x_S : float, optional
        Position of the sensor [length]. Default: that of `sensor`.
    f_first, f_last : float, optional
        Lowest and highest frequency that a fit uses [1/time]. Default: all lines.
    coherence_least : float, optional
        Lines with a lower coherence are left out. Default: 0.
    window : {'boxcar', 'hann'}, optional
        Window of the blocks. Default: 'boxcar', none.
    exponential_window : float, optional
        Decay rate of the exponential window of force and response [1/time]. Default: 0.
    scale : float, optional
        Factor of the response, 1 by default.
    sensor : str, optional
        Name of the sensor; required if there are several.
    length : float, optional
        Length of the beam in this record [length]. Default: that of `beam`.
    **other
        Any other key of the group `&record`.

    Raises
    ------
    InputError
        If values are not finite numbers, or their numbers differ.
    """

    def __init__(self, frequency: ArrayLike, h: ArrayLike, *, coherence: ArrayLike | None = None,
                 sd: ArrayLike | None = None, quantity: str | None = None,
                 averages: int | None = None, x_F: float | None = None, x_S: float | None = None,
                 f_first: float | None = None, f_last: float | None = None,
                 coherence_least: float | None = None, window: str | None = None,
                 exponential_window: float | None = None, scale: float | None = None,
                 sensor: str | None = None, length: float | None = None, **other: Any) -> None:
        values = complex_numbers(h, "h of FrequencyRecord")
        one_sd = sd is not None and np.ndim(sd) == 0
        super().__init__(
            dict(frequency_hz=frequency, real=values.real, imag=values.imag, coherence=coherence,
                 sd=None if one_sd else sd), "FrequencyRecord",
            dict(kind="frf", sd=sd if one_sd else None, quantity=quantity, averages=averages,
                 x_F=x_F, x_S=x_S, f_first=f_first, f_last=f_last,
                 coherence_least=coherence_least, window=window,
                 exponential_window=exponential_window, scale=scale, sensor=sensor, length=length,
                 **other))


class ModalRecord(TableRecord):
    """A table of measured modes: natural frequencies and damping ratios with standard deviations.

    The library reads the values from a temporary file, which lives as long as the problem.

    Parameters
    ----------
    frequency : array_like of shape (n,)
        Natural frequencies, in cycles per unit of time (Hz if times are in seconds).
    sd : array_like of shape (n,) or float
        Their standard deviations, in the same unit.
    damping : array_like of shape (n,), optional
        Damping ratios (2 % is 0.02).
    sd_damping : array_like of shape (n,) or float, optional
        Their standard deviations; required with `damping`.
    mode : array_like of shape (n,), optional
        Numbers of the modes, from 1. Default: the nearest modes of the model.
    length : float, optional
        Length of the beam in this record [length]. Default: that of `beam`.
    **other
        Any other key of the group `&record`.

    Raises
    ------
    InputError
        If values are not finite numbers, or their numbers differ.
    """

    def __init__(self, frequency: ArrayLike, sd: ArrayLike, damping: ArrayLike | None = None,
                 sd_damping: ArrayLike | None = None, mode: ArrayLike | None = None, *,
                 length: float | None = None, **other: Any) -> None:
        size = np.size(frequency)

        def all_of(value: ArrayLike | None) -> ArrayLike | None:
            return np.full(size, value) if value is not None and np.ndim(value) == 0 else value

        super().__init__(
            dict(frequency_hz=frequency, sd_hz=all_of(sd), damping_ratio=damping,
                 sd_damping=all_of(sd_damping), mode=mode), "ModalRecord",
            dict(kind="modes", length=length, **other))


#: A record of any kind.
AnyRecord = Union[Record, TableRecord]


def written(value: Any) -> str:
    """Return a value as a case file has it."""
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if isinstance(value, (bool, np.bool_)):
        raise InputError(f"found {value}, expected a number, a text or several of these")
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if np.ma.is_masked(value):
        raise InputError("found a masked value, expected a number")
    if isinstance(value, np.ndarray):
        return written(value.item()) if value.size == 1 else ", ".join(map(written, value.ravel()))
    if isinstance(value, Iterable):
        return ", ".join(map(written, value))
    raise InputError(f"found {value!r}, expected a number, a text or several of these")


def written_key(group: str, key: str, value: Any) -> str:
    """Return the value of a key of a group as a case file has it."""
    if group == "stage" and key in ("free", "shared"):
        value = checked_names(value, key)
    return written(value)


def group(name: str, keys: Mapping[str, Any]) -> str:
    """Return one group in a line; keys whose value is None are left out."""
    if not isinstance(keys, Mapping):
        raise InputError(f"{name}: found {keys!r}, expected its keys, as in {name}=dict(...)")
    given = [f"{key}={written_key(name, key, value)}" for key, value in keys.items()
             if value is not None]
    return f"&{name} {', '.join(given)} /\n"


def case_text(records: Sequence[Mapping[str, Any]], stages: Sequence[Mapping[str, Any]],
              groups: Mapping[str, Any]) -> str:
    """Return the case file that says the same as the arguments.

    Parameters
    ----------
    records, stages
        Keys of each group &record and &stage.
    groups
        Keys of any other group by its name, or a list of these if the group repeats.
    """
    text = ""
    for name, keys in groups.items():
        if name not in GROUPS:
            raise unknown_group(name)
        if keys is None:
            continue
        several: Iterable[Any] = keys
        if isinstance(keys, (Mapping, str)) or not isinstance(keys, Iterable):
            several = [keys]
        text += "".join(group(name, item) for item in several)
    text += "".join(group("record", keys) for keys in records)
    return text + "".join(group("stage", keys) for keys in stages)


def check_keys(group: str, other: Mapping[str, Any]) -> None:
    """Raise InputError if an argument of a function is a key of the group that the function is
    about, such as `n` of `bootstrap`."""
    for name in other:
        if name not in GROUPS and name in KEYS[group].split():
            raise InputError(f"found {name}, which belongs into {group}=dict({name}=...)")


def unknown_group(name: str) -> InputError:
    """Return the error for an argument that no group has, with the place of a key of that name, or
    with the nearest name."""
    keys_of_record = " ".join(inspect.signature(Record.__init__).parameters)
    for group, keys in {**KEYS, "record": keys_of_record}.items():
        if name in keys.split():
            return InputError(f"found {name}, which belongs into {group}=dict({name}=...)")
    if name in ARGUMENTS:
        return InputError(f"found {name}, which this function does not take")
    names = [*GROUPS, *ARGUMENTS]
    near = difflib.get_close_matches(name, names, n=1)
    return InputError(f"found {name}, expected one of {', '.join(names)}"
                      + "".join(f", perhaps {other}" for other in near))


def checked_names(value: Any, what: str) -> Any:
    """Return the name of a parameter, or a sequence of names.

    Raises
    ------
    InputError
        If there is no name, or one text holds several names.
    """
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, Iterable):
        return value
    names = list(names)
    if not names:
        raise InputError(f"{what}: found no name, expected one or more, such as "
                         f"{what}=['E', 'c_D']")
    for name in names:
        parts = re.split(r"[,\s]+", name.strip(", ")) if isinstance(name, str) else []
        if len(parts) > 1:
            raise InputError(f"{what}: found {name!r}, but several names are a list: "
                             f"{what}={parts}")
    return names


def open_case(path: str, text: str | bytes, records: Sequence[AnyRecord | Lines], *,
              fits: bool) -> Handle:
    """Open a case in the library.

    Parameters
    ----------
    path
        Name of the case in messages, and the file whose folder relative paths start from. If
        `text` is empty, the case file itself.
    text
        Text of a case file.
    records
        Records in memory, in the order of the groups &record; none: they are in files.
    fits
        Whether the case is to be fitted. Its records are then read and checked at once.
    """
    for item in records:
        item.check()
    sizes = (c_int*max(len(records), 1))(*[np.size(item.t) for item in records])
    none = np.empty(0)
    t = np.concatenate([numbers(item.t, "times of a record") for item in records] or [none])
    z = np.concatenate([numbers(item.a, "values of a record") for item in records] or [none])
    where = path.encode()
    handle = Handle()
    tables = [item for item in records if isinstance(item, TableRecord)]
    if tables and isinstance(text, str):
        # Commands read the files again: the folder lives as long as the handle.
        handle.folder = tempfile.TemporaryDirectory(prefix="beamid-")
        for item in tables:
            text = item.write(handle.folder.name, text)
    what = text.encode() if isinstance(text, str) else text
    compute("beamid_open", where, len(where), what, len(what), len(records), sizes, t.size,
            t.ctypes.data, z.ctypes.data, int(fits), byref(handle.number))
    return handle


def as_list(value: Any, what: str) -> list[Any]:
    """Return one mapping or record, or several, as a list.

    Parameters
    ----------
    value
        The argument of the user.
    what
        Its name, for messages.
    """
    if isinstance(value, (Mapping, Record, TableRecord)):
        return [value]
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f"{what}: found {value!r}, expected one or several of them")
    return list(value)


def records_of(t: Any, a: Any, record: Any, records: Any) -> list[AnyRecord]:
    """Return the records that the arguments of a function describe; see `Problem`."""
    if records is None:
        if record is not None and not isinstance(record, Mapping):
            raise InputError(f"record: found {record!r}, expected its keys, as in record=dict(...)")
        return [Record([] if t is None else t, [] if a is None else a, **(record or {}))]
    if t is not None or a is not None or record is not None:
        raise InputError("found records beside t, a or record, expected one or the other")
    items = as_list(records, "records")
    for item in items:
        if not isinstance(item, (Record, TableRecord)):
            raise InputError(f"records: found {item!r}, expected beamid.Record(t, a, ...), "
                             "FrequencyRecord(...) or ModalRecord(...); one file is read by "
                             "record=dict(file=...)")
    return items


def given(arguments: Mapping[str, Any], *left_out: str) -> dict[str, Any]:
    """Return the keyword arguments of a function as one dict, those of `**other` among them.

    Parameters
    ----------
    arguments
        `locals()` at the beginning of the function.
    left_out
        Names of arguments that are not keys of a case.
    """
    kept = {name: value for name, value in arguments.items()
            if name not in ("self", "other", *left_out)}
    return {**kept, **arguments["other"]}
