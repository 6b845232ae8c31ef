"""Arguments as the text of a case file: the library reads and checks nothing else."""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._library import InputError, groups as known_groups, numbers

#: Groups of a case file that are given by their name. Asked for at once, as a forked child may not
#: be able to ask.
GROUPS = [name for name in known_groups() if name not in ("record", "stage")]


class Record:
    """Samples of one accelerometer.

    t     (m) ascending times
    a     (m) values; the acceleration is scale*(a - offset). Masked samples are left out
    keys  of &record, as sd=..., sensor='tip', t_first=..., thin=...
    """

    def __init__(self, t: ArrayLike, a: ArrayLike, **keys: Any) -> None:
        if np.ma.is_masked(t) or np.ma.is_masked(a):
            sizes = np.size(t), np.size(a)
            if sizes[0] == sizes[1]:
                both: list[Any] = [np.ma.asanyarray(values).ravel() for values in (t, a)]
                kept = ~(np.ma.getmaskarray(both[0]) | np.ma.getmaskarray(both[1]))
                t, a = (np.ma.getdata(values)[kept] for values in both)
        self.t = numbers(t, "times of a record").copy()
        self.a = numbers(a, "values of a record").copy()
        self.keys = keys
        self.check()

    def check(self) -> None:
        """Raises InputError if the numbers of times and values differ."""
        if np.size(self.t) != np.size(self.a):
            raise InputError(f"Record: found {np.size(self.t)} times and {np.size(self.a)} values, "
                             "expected as many of one as of the other")


def written(value: Any) -> str:
    """Returns a value as a case file has it."""
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


def group(name: str, keys: Mapping[str, Any]) -> str:
    """One group in a line; keys whose value is None are left out."""
    if not isinstance(keys, Mapping):
        raise InputError(f"{name}: found {keys!r}, expected its keys, as in {name}=dict(...)")
    given = [f"{key}={written(value)}" for key, value in keys.items() if value is not None]
    return f"&{name} {', '.join(given)} /\n"


def case_text(records: Sequence[Mapping[str, Any]], stages: Sequence[Mapping[str, Any]],
              groups: Mapping[str, Any]) -> str:
    """Returns the case file that says the same as the arguments.

    records, stages  keys of each group &record and &stage
    groups           keys of any other group by its name, or a list of these if the group repeats
    """
    text = ""
    for name, keys in groups.items():
        if name not in GROUPS:
            raise InputError(f"found {name}, expected one of {', '.join(GROUPS)}")
        if keys is None:
            continue
        several: Iterable[Any] = keys
        if isinstance(keys, (Mapping, str)) or not isinstance(keys, Iterable):
            several = [keys]
        text += "".join(group(name, item) for item in several)
    text += "".join(group("record", keys) for keys in records)
    return text + "".join(group("stage", keys) for keys in stages)
