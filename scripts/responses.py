"""Frequency response functions (FRFs), as to_csv.py reads, estimates and writes them.

An FRF is the complex ratio of a response to a force, in the convention e^(+i omega t).
"""

import math
import re
from dataclasses import dataclass, field

from channels import text_of

#: The quantity of an FRF, as &record states it, by the motion in its numerator.
QUANTITIES = {"acceleration": "accelerance", "velocity": "mobility", "displacement": "receptance"}
#: Hertz in a unit of frequency; a file without a unit is taken to be in Hz.
HERTZ = {"": 1.0, "hz": 1.0, "1/s": 1.0, "khz": 1000.0, "rad/s": 0.5 / math.pi}

LENGTH = r"(?:[nmckd\u00b5\u03bc]|u)?m|in|inch|ft|mil"
SECOND = r"(?:s|sec)"
SQUARED = rf"/{SECOND}(?:\^2|\*\*2|2|\u00b2)|/{SECOND}/{SECOND}"
UNITS = {"acceleration": re.compile(rf"(?:[m\u00b5]?g|(?:{LENGTH})(?:{SQUARED}))", re.I),
         "velocity": re.compile(rf"(?:{LENGTH})/{SECOND}", re.I),
         "displacement": re.compile(LENGTH, re.I),
         "force": re.compile(r"[mckM]?N|lbf?|kip|kgf")}
RATIO = re.compile(r"\(?(?P<top>.*?)\)?/\(?(?P<bottom>[mckM]?N|lbf?|kip|kgf)\)?")


@dataclass
class Response:
    """An FRF, and what the file states about it."""

    name: str
    frequencies: object         # [Hz]
    values: object              # complex
    unit: str = ""              # of the values
    quantity: str = ""          # accelerance, mobility or receptance; '': unknown
    coherence: object = None
    notes: list = field(default_factory=list)
    keys: dict = field(default_factory=dict)    # further keys of &record, as text
    sd: object = None           # standard deviation of the real and of the imaginary part


def measured_by(unit):
    """Returns what a unit measures: 'acceleration', 'velocity', 'displacement', 'force' or ''."""
    plain = unit.replace(" ", "")
    return next((word for word, pattern in UNITS.items() if pattern.fullmatch(plain)), "")


def quantity_of(numerator, denominator):
    """Returns the quantity of the ratio of two measured quantities, or ''."""
    return QUANTITIES.get(numerator, "") if denominator == "force" else ""


def quantity_of_unit(unit):
    """Returns the quantity of an FRF with a unit such as (m/s^2)/N, or ''."""
    plain = unit.replace(" ", "")
    if plain == "1/kg":
        return "accelerance"
    ratio = RATIO.fullmatch(plain)
    return quantity_of(measured_by(ratio["top"]), "force") if ratio else ""


def ratio_of_units(numerator, denominator):
    """Returns the unit of a ratio, with '?' for an unknown unit; empty if both are unknown."""
    if not numerator and not denominator:
        return ""
    def part(unit):
        return f"({unit})" if "/" in unit else unit or "?"
    return f"{part(numerator)}/{part(denominator)}"


def record_line(response, file_name):
    """Returns the group of a case file that reads the FRF."""
    keys = {"kind": "'frf'", "file": f"'{file_name}'",
            "quantity": f"'{response.quantity}'" if response.quantity else "...", **response.keys}
    return f"&record {', '.join(f'{key}={value}' for key, value in keys.items())} /"


def description(response):
    """Returns what a file holds: rows, range of frequencies, name, unit, coherence."""
    f = response.frequencies
    return (f"{len(f)} rows, {f[0]:.6g} to {f[-1]:.6g} Hz, {response.name}"
            + f" [{response.unit}]" * bool(response.unit)
            + (", no coherence" if response.coherence is None else ", with coherence"))


def table(path, texts, response):
    """Returns the text of a file: remarks behind '#', then the columns that beamid reads."""
    quantity, unit = response.quantity or "unknown quantity", response.unit or "unknown unit"
    lines = [f"from {path.name}", response.name, f"real, imag: {quantity} [{unit}]",
             *response.notes, *texts]
    header, columns = ["frequency_hz", "real", "imag"], [
        response.frequencies, response.values.real, response.values.imag]
    for name in ("coherence", "sd"):
        if getattr(response, name) is not None:
            header.append(name)
            columns.append(getattr(response, name))
    rows = zip(*(map(repr, column.tolist()) for column in columns))
    return "".join([*(f"# {text_of(line)}\n" for line in lines), ",".join(header), "\n",
                    *(",".join(row) + "\n" for row in rows)])
