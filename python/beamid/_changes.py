"""Cases with other values: those of a fit, or those that the user gives beside a case."""
from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from ._cases import GROUPS, as_list, unknown_group, written, written_key
from ._library import InputError

#: A group of a case file: its name, and its values as text by key in lower case.
TextGroup = tuple[str, dict[str, str]]

_TOKEN = re.compile(r"""'(?:[^']|'')*'|"(?:[^"]|"")*"|![^\n]*|&\w+|/|=|[^\s,=/'"!]+""")

#: Groups and keys of the parameters. Those of other names are keys of &beam.
PLACES = {
    "m_T": ("tip", "m_T"), "J_T": ("tip", "J_T"), "g": ("gravity", "g"), "T": ("axial", "force"),
    "x_F": ("excitation", "x_F"), "amplitude": ("excitation", "amplitude"),
    "place": ("along", "place"), "width": ("along", "width"), "depth": ("along", "depth"),
    "k_w": ("end", "k_w"), "c_w": ("end", "c_w"), "m_S": ("sensor", "m_S"),
    "J_S": ("sensor", "J_S"), "x_S": ("sensor", "x_S"), "x_P": ("support", "x_P"),
    "k_P": ("support", "k_P"), "c_P": ("support", "c_P"), "k_RP": ("support", "k_R"),
    "c_RP": ("support", "c_R"), "m_M": ("mass", "m"), "J_M": ("mass", "J"), "x_M": ("mass", "x"),
    "m_H": ("hose", "m_H"), "c_H": ("hose", "c_H"), "k_H": ("hose", "k_H"), "x_H": ("hose", "x_H"),
    "offset": ("record", "offset"), **{name: ("beam", name) for name in (
        "E", "c_D", "rho", "gamma", "length", "eta", "a_h", "b_h", "d_1", "b_1", "d_2", "b_2",
        "k_R", "c_R")}}
#: Parameters whose value may be that of one record.
_OF_RECORD = ("length", "x_S", "x_P", "offset")
#: Arguments that are keys of the only stage.
STAGE = ("free", "start", "lower", "upper", "shared")


@contextmanager
def without_lines(path: str) -> Iterator[None]:
    """Leave the numbers of lines out of messages: a changed case has other lines than its file."""
    try:
        yield
    except InputError as error:
        raise InputError(re.sub(rf"^{re.escape(path)}:\d+:", f"{path}, changed:", str(error),
                                flags=re.MULTILINE)) from None


def read_groups(text: str) -> list[TextGroup]:
    """Return the groups of a case file that the library has accepted."""
    groups: list[TextGroup] = []
    keys: dict[str, list[str]] | None = None
    values: list[str] | None = None
    tokens = [token for token in _TOKEN.findall(text) if token[0] != "!"]
    for token, behind in zip(tokens, [*tokens[1:], ""]):
        if keys is None:
            if token[0] == "&":
                keys, values, name = {}, None, token[1:].lower()
        elif token == "/":
            groups.append((name, {key: ", ".join(items) for key, items in keys.items()}))
            keys = None
        elif behind == "=":
            values = keys.setdefault(token.lower(), [])
        elif token != "=" and values is not None:
            values.append(token)
    return groups


def text_of_groups(groups: Sequence[TextGroup]) -> str:
    """Return the text of a case file, one group per line."""
    return "".join(f"&{name} " + ", ".join(f"{key}={value}" for key, value in keys.items()) + " /\n"
                   for name, keys in groups)


def change(groups: list[TextGroup], name: str, given: Any, *, replace: bool = False) -> None:
    """Change the keys of a group, or replace all groups of the name.

    Parameters
    ----------
    groups
        Groups of the case; they are changed in place.
    name
        Name of the group.
    given
        Mapping: keys of the only group of that name with their new values; None removes a key.
        Another `kind` replaces the group. Sequence of mappings: the new groups.
    replace
        Whether a mapping replaces the groups, too.
    """
    found = [keys for group, keys in groups if group == name]
    if not isinstance(given, Mapping) or not found or replace:
        groups[:] = [group for group in groups if group[0] != name] + [
            (name, {key.lower(): written_key(name, key, value) for key, value in keys.items()
                    if value is not None}) for keys in as_list(given, name)]
        return
    if len(found) > 1:
        raise InputError(f"{name}: found keys of one group, but the case has {len(found)} groups "
                         f"&{name}; expected a list with the keys of each")
    keys = found[0]
    if given.get("kind") is not None and keys.get("kind") != written(given["kind"]):
        keys.clear()
    for key, value in given.items():
        keys.pop(key.lower(), None)
        if value is not None:
            keys[key.lower()] = written_key(name, key, value)


def change_all(groups: list[TextGroup], changes: Mapping[str, Any], *, grid: bool) -> None:
    """Change a case by the arguments that a user gives beside it.

    Parameters
    ----------
    groups
        Groups of the case; they are changed in place.
    changes
        Arguments of the function by name, those that are given.
    grid
        Whether `record` is a grid of times in place of the records.
    """
    stage = {name: changes[name] for name in STAGE if name in changes}
    for name, keys in changes.items():
        if name == "record":
            change(groups, name, keys, replace=grid)
        elif name == "stages":
            change(groups, "stage", keys, replace=True)
        elif name in GROUPS:
            change(groups, name, keys)
        elif name not in STAGE:
            raise unknown_group(name)
    if "free" in stage:    # values for other parameters
        stage = {**dict.fromkeys(STAGE), **stage}
    if stage:
        change(groups, "stage", stage)


def set_estimates(groups: list[TextGroup], estimates: Mapping[str, float], elements: int) -> None:
    """Give the structure of a case the values of a fit.

    Parameters
    ----------
    groups
        Groups of the case; they are changed in place.
    estimates
        Estimates by their printed names, such as 'E', 'm_S.tip' or 'x_P(2)'. Unknowns that enter
        linearly are not part of a case, and left out.
    elements
        Number of elements of the mesh of the fit.
    """
    for name, value in estimates.items():
        base, _, record = name.rstrip(")").partition("(")
        symbol, _, label = base.partition(".")
        if symbol in ("E", "c_D") and label:
            raise InputError(f"found estimates of {symbol}(x), expected a structure that keys of a "
                             "case describe; the results of the fit itself have its modes")
        if symbol in PLACES:
            group, key = PLACES[symbol]
            if symbol in ("k_R", "c_R") and label:
                group = "end"
            _holder(groups, name, group, key, label, record).update(
                _written_estimate(groups, symbol, key, value))
    change(groups, "discretization", dict(elements=elements))


def _holder(groups: list[TextGroup], name: str, group: str, key: str, label: str,
            record: str) -> dict[str, str]:
    """Return the keys of the group that has a parameter; a new group if there is none."""
    if (record and key in _OF_RECORD) or group == "record":
        records = [keys for found, keys in groups if found == "record"]
        return records[int(record or 1) - 1]
    held = [keys for found, keys in groups if found == group]
    if label:
        named = [keys for keys in held
                 if label.lower() in (keys.get(key, "").strip("'\"").lower()
                                      for key in ("name", "at"))]
        held = named or held
    if not held and not label:
        groups.append((group, {}))
        return groups[-1][1]
    if record or len(held) != 1:
        raise InputError(f"{name}: found {'a value for one record' if record else len(held)}"
                         f"{'' if record else f' groups &{group}'}, expected a value of one "
                         "structure: describe the structure by arguments, without the fit")
    return held[0]


def _written_estimate(groups: list[TextGroup], symbol: str, key: str,
                      value: float) -> dict[str, str]:
    """Return the key of a case that holds an estimate, with its value."""
    if symbol == "rho":
        beam = next(keys for found, keys in groups if found == "beam")
        if "density" in beam:    # width and height also make I
            width, height = (float(beam[side].lower().replace("d", "e"))
                             for side in ("width", "height"))
            return {"density": written(value/(width*height))}
    if symbol == "amplitude":
        excitation = next(keys for found, keys in groups if found == "excitation")
        held = [name for name in ("amplitude", "force", "displacement") if name in excitation]
        if len(held) != 1:
            raise InputError("found an estimate of the amplitude of a table, expected one of a "
                             "pulse or a release: give excitation=dict(...) without the fit")
        key = held[0]
    return {key.lower(): written(value)}
