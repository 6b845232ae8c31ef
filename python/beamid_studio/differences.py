"""The inputs in which cases differ, in the words and units of the page."""
from __future__ import annotations

from typing import Any

import cases
from page import GREEK

from beamid_studio.case_model import Case, Input, number_text
from beamid_studio.session import Result

#: Names of inputs whose fields have no label of their own.
NAMES = {("excitation", "kind"): "Motion", ("excitation", "modes"): "Modes in the record",
         ("excitation", "file"): "Table of the force", ("record", "file"): "Record",
         ("record", "scale"): "Unit of the record", ("record", "quantity"): "Quantity",
         ("stage", "free"): "Estimated"}
#: Groups of which a case may have several that the page tells apart by their number.
NUMBERED = ("record", "excitation", "mass", "support", "end")
MOST = 4    #: inputs that a sentence names


def name_of(studio: Any, place: Input) -> str:
    """Return what the page calls an input."""
    group, which, key = place
    if group == "prior":
        return f"Standard deviation of {GREEK.get(which, which)}" + f", {key}" * (key != "sd")
    name = NAMES.get((group, key)) or studio.labels.get((group, key)) or f"&{group} {key}"
    several = group in NUMBERED and len(studio.session.case.all(group)) > 1
    return f"{name}, {group} {which}" if several else name


def value_of(studio: Any, place: Input, values: tuple[str, ...] | None) -> str:
    """Return an input in the unit that the user has chosen for its field."""
    if values is None:
        return "not set"
    group, which, key = place
    field = next((one for one in studio.numbers if (
        (group == "prior" and key == "sd" and one.sd.lower() == which.lower())
        or (not one.sd and one.place == (group, key)))), None)
    if field is not None:
        text = number_text(values[0], field.unit[1], divide=True)
        if text:
            return f"{text} {field.unit[0]}".strip()
    names = [cases.unquoted([value]) for value in values]
    return ", ".join(GREEK.get(name, name) for name in names)


def sentence(studio: Any, result: Result) -> str:
    """Return in which inputs the case as it stands differs from that of a fit; '' if in none."""
    changed = studio.session.changes(result)
    if not changed:
        return ""
    now, then = studio.session.case.inputs(), Case(result.case).inputs()
    told = [f"{name_of(studio, place)} ({value_of(studio, place, then.get(place))}, now "
            f"{value_of(studio, place, now.get(place))})" for place in changed[:MOST]]
    more = len(changed) - len(told)
    return ("; ".join(told) + f"; and {more} more" * (more > 0))


def table(studio: Any, results: list[Result]) -> list[list[str]]:
    """Return a row for each input in which some fits differ: its name, and its values."""
    inputs = [Case(result.case).inputs() for result in results]
    places = dict.fromkeys(place for one in inputs for place in one)
    return [[name_of(studio, place), *(value_of(studio, place, one.get(place)) for one in inputs)]
            for place in places if len({one.get(place) for one in inputs}) > 1]
