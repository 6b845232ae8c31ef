#!/usr/bin/env python3
"""Plots what varies along a beam -> DIR/along.png: E(x) and c_D(x) before and after a fit with the
95 % band, over the beam and what sits on it."""

from pathlib import Path

import plotting as p
import plot_fit
import plot_modes
import numpy as np

HIGHEST = 3.0    # a band without an end is drawn up to so many times the largest value


def read_along(directory, chosen=None):
    """Functions of the finest mesh, or the chosen one: (name, unit, columns by name), nan where a
    field is empty."""
    path = directory / "along.csv"
    names = ("x", "value", "lower95", "upper95", "start", "resolution")
    rows = p.read_table(path, "elements", "parameter", *names)
    meshes = [p.number(row, "elements", int) for row in rows]
    elements = chosen or max(meshes)
    if elements not in meshes:
        p.fail(f"{path}: nothing for {elements} elements")
    functions, units = {}, {}
    for row, mesh in zip(rows, meshes):
        if mesh == elements:
            units[row["parameter"]] = row.get("unit", "")
            functions.setdefault(row["parameter"], []).append(
                [p.number(row, name) if name in ("x", "value") else float(row[name] or "nan")
                 for name in names])
    return [(name, units[name], dict(zip(names, np.array(values).T)))
            for name, values in functions.items()]


def read_attached(directory):
    """What sits on the beam: (name, x)."""
    path = directory / "attachments.csv"
    if not path.exists():
        return []
    return [(row["name"], p.number(row, "x")) for row in p.read_table(path, "name", "x")]


def draw_function(axes, name, unit, values):
    """One function: where it began, the estimate, its band; what was not searched for is a line."""
    x, value = values["x"], values["value"]
    factor, power = 1.0, ""
    if not 1e-2 <= np.abs(value).max() < 1e4:
        exponent = int(np.floor(np.log10(np.abs(value).max() or 1.0)))
        factor, power = 10.0**-exponent, f"10$^{{{exponent}}}$ "
    top = HIGHEST * factor * value.max()
    if np.isfinite(values["lower95"]).any():
        axes.fill_between(x, factor * values["lower95"],
                          np.minimum(np.nan_to_num(factor * values["upper95"], posinf=top), top),
                          color=p.SKY, alpha=0.4, linewidth=0, label="95 % band")
    if np.isfinite(values["start"]).any():
        axes.plot(x, factor * values["start"], color=p.GREY, linestyle="--", linewidth=1.0,
                  label="start")
        axes.plot(x, factor * value, color=p.BLUE, linewidth=1.8, label="fit")
    else:
        axes.plot(x, factor * value, color=p.BLUE, linewidth=1.8, label="as given")
    axes.set_ylabel(p.with_unit(f"{p.symbol(name)}$(x)$", power + unit))
    low, high = axes.get_ylim()
    middle = factor * np.median(value)    # what hardly varies is not to look as if it did
    low, high = min(low, 0.95 * middle), max(high, 1.05 * middle)
    axes.set_ylim(low - 0.12 * (high - low), high)
    axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 0.98), fontsize=8, borderpad=0.2)


def draw_resolution(axes, values):
    """Bars as long as what the estimate averages over, at some places."""
    length = values["resolution"]
    if not np.isfinite(length).any():
        return
    x = values["x"]
    for place in np.linspace(x[0], x[-1], 6)[1:-1]:
        k = np.argmin(np.abs(x - place))
        axes.plot([max(x[0], place - length[k] / 2), min(x[-1], place + length[k] / 2)],
                  [0.04, 0.04], color=p.VERMILION, linewidth=2, solid_capstyle="butt",
                  transform=axes.get_xaxis_transform(), label=None)
    axes.annotate("averaged over", (x[0], 0.06), xycoords=axes.get_xaxis_transform(),
                  xytext=(4, 0), textcoords="offset points", fontsize=8, color=p.VERMILION)


def draw_structure(axes, x, attached):
    """The beam from the side: clamp, supports below it, sensors and masses on it."""
    axes.plot([x[0], x[-1]], [0, 0], color="black", linewidth=4, solid_capstyle="butt")
    axes.plot([x[0], x[0]], [-0.8, 0.8], color="black", linewidth=2.5)
    step = 0.018 * (x[-1] - x[0])
    for height in np.linspace(-0.7, 0.7, 6):
        axes.plot([x[0] - step, x[0]], [height - 0.25, height], color="black", linewidth=0.8)
    for name, place in attached:
        support = name.startswith("support")
        axes.plot([place], [-0.45 if support else 0.35], "k^" if support else "ks", markersize=6)
    plot_modes.name_attached(axes, attached, x[-1], 12)
    axes.set(ylim=(-1.1, 1.3), yticks=[])
    axes.grid(False)
    axes.spines["left"].set_visible(False)


def draw(directory, chosen=None, width=6.4):
    """A panel for each function, the beam below them; returns the figure."""
    functions = read_along(directory, chosen)
    count = len(functions)
    figure, panels = p.plt.subplots(count + 1, 1, figsize=(width, 1.4 + 2.5 * count), sharex=True,
                                    gridspec_kw={"height_ratios": [1] * count + [0.28]})
    for axes, (name, unit, values) in zip(panels, functions):
        draw_function(axes, name, unit, values)
        draw_resolution(axes, values)
    draw_structure(panels[-1], functions[0][2]["x"], read_attached(directory))
    panels[-1].set_xlabel(p.with_unit("x", plot_fit.read_units(directory).get("length")))
    return figure


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=p.outputs,
                        help="output folder of identify")
    parser.add_argument("--elements", metavar="N", type=int, help="mesh (default: the finest)")
    parser.add_argument("--out", metavar="FILE", help="picture (default: DIR/along.png)")
    arguments = parser.parse_args()

    if not (arguments.directory / "along.csv").exists():
        p.fail(f"{arguments.directory}: found no along.csv, expected a fit of E(x) or c_D(x), "
               "or &along in the case")
    figure = draw(arguments.directory, arguments.elements)
    figure.suptitle(f"{p.case_name(arguments.directory)}: along the beam")
    p.save(figure, Path(arguments.out or arguments.directory / "along.png"))


if __name__ == "__main__":
    main()
