"""Reads tables of frequency response functions (FRFs) from text: a column of frequencies, and real
and imaginary parts or magnitudes and phases, perhaps with coherences or standard deviations."""

import math
import re

import text_tables
from program import fail
from responses import HERTZ, Response, quantity_of_unit

FREQUENCIES = {"f", "freq", "frequency", "frequencies", "frequenz"}
#: Words in the name of a column, by the part of an FRF that the column contains.
PARTS = {"real": ("real", "re"), "imag": ("imag", "imaginary", "im"),
         "magnitude": ("magnitude", "mag", "amplitude", "ampl", "amp", "modulus", "abs"),
         "phase": ("phase", "angle", "arg"), "coherence": ("coherence", "coh"),
         "sd": ("sd",)}
DEGREES, RADIANS = {"deg", "degree", "degrees", "\u00b0"}, {"rad", "radian", "radians"}
UNIT = re.compile(r"(?P<name>.+)_(?P<unit>hz|khz|deg|rad|db)", re.I)
LONGEST_TURN = 2.02 * math.pi    # [rad]; phases that vary by more are in degrees


def read_text(path, unit=""):
    """Returns the FRFs of a text file if it has any, otherwise its channels; and the lines above.

    unit  of times, if the file states none
    """
    table = text_tables.read(path, or_one=True)
    return responses_of(table) or text_tables.channels_of(table, unit), table.above


def named(name):
    """Returns a name without its unit, and the unit."""
    stem, unit = text_tables.split_unit(name)
    match = None if unit else UNIT.fullmatch(stem)
    return (match["name"], match["unit"]) if match else (stem, unit)


def responses_of(table):
    """Returns the FRFs of a table; none if it lacks frequencies, or a pair of columns."""
    pairs = [named(name) for name in table.names]
    place = next((k for k, (name, unit) in enumerate(pairs) if name.lower() in FREQUENCIES
                  and unit.lower() in HERTZ), None)
    if place is None:
        return []
    found = {}    # by what is left of the name: {part: column}
    for k, (name, _) in enumerate(pairs):
        words = re.findall(r"[^\W_]+", name.lower())
        part = next((part for part, names in PARTS.items() if set(words) & set(names)), "")
        if part and k != place:
            rest = " ".join(word for word in words if word not in PARTS[part])
            found.setdefault(rest, {})[part] = k
    complete = {rest: columns for rest, columns in found.items()
                if {"real", "imag"} <= set(columns) or {"magnitude", "phase"} <= set(columns)}
    if not complete:
        return []
    frequencies = column(table, place) * HERTZ[pairs[place][1].lower()]
    alone = {part: k for part, k in found.get("", {}).items()
             if part in ("coherence", "sd")} if len(complete) == 1 else {}
    return [response_of(table, pairs, frequencies, rest, {**alone, **columns})
            for rest, columns in complete.items()]


def response_of(table, pairs, frequencies, name, columns):
    """Returns the FRF in some columns."""
    import numpy as np
    notes = []
    if "real" in columns:
        values = column(table, columns["real"]) + 1j * column(table, columns["imag"])
        unit = pairs[columns["real"]][1]
    else:
        unit = pairs[columns["magnitude"]][1]
        magnitude = column(table, columns["magnitude"])
        if unit.lower().startswith("db"):
            unit = re.sub(r"(?i)^db\s*(re)?\s*1?\s*", "", unit).strip()
            magnitude = 10 ** (magnitude / 20)
            notes.append("magnitudes converted from dB")
        values = magnitude * np.exp(1j * radians(table, pairs, columns["phase"]))
    coherence, sd = (column(table, columns[part]) if part in columns else None
                     for part in ("coherence", "sd"))
    quantity = next((word for word in ("accelerance", "mobility", "receptance")
                     if word in name), quantity_of_unit(unit))
    return Response(f"FRF {name}".strip(), frequencies, values, unit, quantity, coherence, notes,
                    sd=sd)


def radians(table, pairs, place):
    """Returns phases in radians; without a unit, the range of the phases must tell it."""
    import numpy as np
    phases, unit = column(table, place), pairs[place][1].lower()
    if unit in DEGREES or (unit not in RADIANS and np.ptp(phases) > LONGEST_TURN):
        return np.radians(phases)
    if unit not in RADIANS:
        fail(f"{table.place}: column {place + 1} ('{table.names[place]}'): found phases without a "
             "unit that vary by less than 6.3, expected a name such as 'phase [deg]' or "
             "'phase [rad]'")
    return phases


def column(table, place):
    """Returns the numbers of a column; one of text only ends the script."""
    values = text_tables.numbers(table, place)
    if values is None:
        table.fail(table.rows[0][0], place, "found text, expected a number")
    return values
