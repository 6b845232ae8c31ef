"""Arguments as the text of a case file: the library reads and checks nothing else."""
from __future__ import annotations

from typing import Any, Iterable, Mapping, Sequence

import numpy as np

from ._library import InputError

#: Groups that stand once, and groups that may repeat.
SINGLE = ("beam", "tip", "hose", "gravity", "axial", "discretization", "integrator", "observation",
          "score", "multistart", "windows", "sample", "bootstrap", "noise", "units")
REPEATED = ("sensor", "support", "excitation", "prior")


class Record:
    """Samples of one accelerometer.

    t     (m) ascending times
    a     (m) values, of which scale*(a - offset) is an acceleration
    keys  of &record, as sd=..., sensor='tip', t_first=..., thin=...
    """

    def __init__(self, t, a, **keys: Any) -> None:
        self.t = np.ascontiguousarray(t, dtype=float).ravel()
        self.a = np.ascontiguousarray(a, dtype=float).ravel()
        self.keys = keys
        if self.t.size != self.a.size:
            raise InputError(f"Record: found {self.t.size} times and {self.a.size} values, "
                             "expected as many of one as of the other")


def written(value: Any) -> str:
    """A value as a case file has it."""
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if isinstance(value, (bool, np.bool_)):
        raise InputError(f"found {value}, expected a number, a text or several of these")
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, Iterable):
        return ", ".join(written(item) for item in value)
    raise InputError(f"found {value!r}, expected a number, a text or several of these")


def group(name: str, keys: Mapping[str, Any]) -> str:
    """One group in a line; keys whose value is None are left out."""
    if not isinstance(keys, Mapping):
        raise InputError(f"{name}: found {keys!r}, expected its keys, as in {name}=dict(...)")
    given = [f"{key}={written(value)}" for key, value in keys.items() if value is not None]
    return f"&{name} {', '.join(given)} /\n"


def case_text(records: Sequence[Mapping[str, Any]], stages: Sequence[Mapping[str, Any]],
              groups: Mapping[str, Any]) -> str:
    """The case file that says the same as the arguments."""
    text = ""
    for name, keys in groups.items():
        if name not in SINGLE + REPEATED:
            raise InputError(f"found {name}, expected {', '.join(sorted(SINGLE + REPEATED))}")
        if keys is None:
            continue
        if name in SINGLE or isinstance(keys, Mapping):
            keys = [keys]
        text += "".join(group(name, item) for item in keys)
    text += "".join(group("record", keys) for keys in records)
    return text + "".join(group("stage", keys) for keys in stages)
