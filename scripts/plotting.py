"""What the plots share: the environment, one style, reading the CSV files, errors of one line.

Import this module first: when numpy or matplotlib is missing, it restarts the calling script
with the Python of the checkout's environment.
"""

import csv
import math
import os
import re
import sys
from pathlib import Path

_VENV = Path(__file__).resolve().parent.parent / ".venv"


def fail(message):
    """Ends the script with one line on standard error and exit status 2."""
    print(f"{Path(sys.argv[0]).stem}: {message}", file=sys.stderr)
    raise SystemExit(2)


try:
    import matplotlib
    import numpy  # noqa: F401  (tested here so that every script may rely on it)
except ImportError as missing:
    python = _VENV / "bin" / "python"
    if not python.exists() or Path(sys.prefix).resolve() == _VENV.resolve():
        fail(f"no module {missing.name}; run scripts/setup.sh first")
    os.execv(python, [str(python), *sys.argv])

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

# Okabe and Ito's colours: told apart with every kind of colour vision.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
MARKERS = "osD^vP"
GREY = "0.4"

plt.rcParams.update({
    "font.size": 10, "axes.titlesize": 11, "axes.titlelocation": "left", "axes.labelsize": 10,
    "figure.titlesize": 13, "legend.fontsize": 9, "legend.frameon": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": "0.88", "grid.linewidth": 0.6, "lines.linewidth": 1.4,
    "savefig.dpi": 160, "figure.constrained_layout.use": True,
})


def read_table(path, *columns):
    """The rows of a CSV file as dictionaries of text; each of `columns` must be in the header."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            header = reader.fieldnames or ["none"]
            rows = [{**row, "": f"{path}:{reader.line_num}"} for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        fail(f"{path}: {getattr(error, 'strerror', None) or error}")
    for column in columns:
        if column not in header:
            fail(f"{path}: no column '{column}' (found: {', '.join(header)})")
    if not rows:
        fail(f"{path}: no data")
    for row in rows:
        if any(row[column] is None for column in columns):
            fail(f"{row['']}: the row is shorter than the header")
    return rows


def number(row, column, kind=float):
    """A finite number of a row of read_table."""
    try:
        value = kind(row[column])
        if math.isfinite(value):
            return value
    except (TypeError, ValueError):
        pass
    fail(f"{row['']}: '{column}' is '{row[column] or ''}', expected a number")


def folder(path):
    """A folder that must exist."""
    if not Path(path).is_dir():
        fail(f"{path}: no such folder")
    return Path(path)


def case_name(directory):
    """The case's name, which is the name of its output folder, safe for use in a title."""
    return directory.resolve().name.replace("$", r"\$")


def last_stage(directory):
    """The rows of estimates.csv of the last stage, by number of elements, coarsest mesh first."""
    rows = read_table(directory / "estimates.csv", "stage", "elements", "parameter", "estimate")
    meshes = {}
    for row in rows:
        if row["stage"] == rows[-1]["stage"]:
            meshes.setdefault(number(row, "elements", int), []).append(row)
    return dict(sorted(meshes.items()))


def symbol(name):
    """m_T as a mathematical symbol with an upright index."""
    match = re.fullmatch(r"([A-Za-z]+)_(\w+)", name)
    return rf"${match[1]}_{{\mathrm{{{match[2]}}}}}$" if match else rf"${name}$"


def unit_text(unit):
    """A unit with its powers raised: ft/s^2."""
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", (unit or "").strip())


def with_unit(quantity, unit):
    """An axis label: the quantity, and its unit in brackets where there is one."""
    return f"{quantity} ({unit_text(unit)})" if unit else quantity


def number_text(value, digits):
    """A number with so many significant digits; powers of ten where they are shorter."""
    text = f"{value:#.{digits}g}".rstrip(".")
    mantissa, _, exponent = text.partition("e")
    return rf"{mantissa}$\times$10$^{{{int(exponent)}}}$" if exponent else text


def save(figure, path):
    """Writes the figure and says where."""
    try:
        figure.savefig(path, format=Path(path).suffix[1:] or "png")
    except (OSError, ValueError) as error:
        fail(f"{path}: {getattr(error, 'strerror', None) or error}")
    print(path)
