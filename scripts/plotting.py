"""What the plots share: one style, symbols and units, files of pictures.

Import this module before numpy or matplotlib: where one is missing, it restarts the calling script
with the Python of the checkout's environment. Also what `program` shares is here, as p.fail etc.
"""

import re
from pathlib import Path

from program import (fail, has_rows, need, new_parser, number, outputs, read_table,  # noqa: F401
                     read_text, reason)

need("numpy", "matplotlib")

import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import matplotlib.ticker  # noqa: E402

# Okabe and Ito's colours: told apart with every kind of colour vision.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
MARKERS = "osD^vP"
GREY = "0.4"
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

plt.rcParams.update({
    "font.size": 10, "axes.titlesize": 11, "axes.titlelocation": "left", "axes.labelsize": 10,
    "figure.titlesize": 13, "legend.fontsize": 9, "legend.frameon": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": "0.88", "grid.linewidth": 0.6, "lines.linewidth": 1.4,
    "savefig.dpi": 160, "figure.constrained_layout.use": True,
})


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
    """m_T as a mathematical symbol with an upright index; gamma in Greek, other words upright."""
    stem, _, index = name.partition("_")
    if stem in ("gamma", "rho"):
        stem = rf"\{stem}"
    elif len(stem) > 1:
        stem = rf"\mathrm{{{stem}}}"
    return rf"${stem}_{{\mathrm{{{index}}}}}$" if index else rf"${stem}$"


def with_symbols(text):
    """Every name such as m_T in the text as a symbol."""
    return re.sub(r"\b[A-Za-z]_[A-Z]\b", lambda match: symbol(match[0]), text)


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


def plain_number(value, digits):
    """A number with at most so many significant digits, without mathematical text: 1.731×10⁹."""
    mantissa, _, exponent = f"{value:.{digits}g}".replace("-", "\u2212").partition("e")
    power = exponent.replace("\u2212", "-")
    return mantissa + (f"×10{str(int(power)).translate(SUPERSCRIPTS)}" if exponent else "")


def frequency_unit(time):
    """The unit of frequencies for one of times: Hz for seconds."""
    return {"": "", "s": "Hz"}.get(time or "", f"1/{time}")


def mark_frequencies(axes, frequencies):
    """A dashed line at each mode, beside it its number."""
    for k, frequency in enumerate(frequencies):
        axes.axvline(frequency, color=GREEN, linewidth=0.9, linestyle="--", zorder=0.5)
        axes.annotate(f"{k + 1}", (frequency, 1), xycoords=("data", "axes fraction"),
                      xytext=(3, -2), textcoords="offset points", va="top", fontsize=9,
                      color=GREEN)


def plain_logarithmic(axis):
    """Ticks of a logarithmic axis as plain numbers; of a short one also those between."""
    low, high = axis.get_view_interval()
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}" if high < 4 * low else "")
    if 4 * low <= high < 100 * low:
        axis.set_major_locator(matplotlib.ticker.LogLocator(subs=(1, 2, 5)))


def header(path):
    """The names of the columns of a CSV file."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            return [name.strip() for name in file.readline().split(",")]
    except (OSError, UnicodeDecodeError) as error:
        fail(f"{path}: {reason(error)}")


def numbered(path, k):
    """The path of the k-th picture: name.png, name_2.png, ..."""
    return path if k == 1 else path.with_name(f"{path.stem}_{k}{path.suffix}")


def save(figure, path):
    """Writes the figure and says where."""
    try:
        figure.savefig(path, format=Path(path).suffix[1:] or "png")
    except (OSError, ValueError) as error:
        fail(f"{path}: {reason(error)}")
    plt.close(figure)
    print(path)
