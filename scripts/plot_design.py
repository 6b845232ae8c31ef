#!/usr/bin/env python3
"""Plots what experiments would tell of one parameter -> DIR/design_<parameter>.png: the least
predicted standard error at each value of two settings, over all values of the others."""

from pathlib import Path

import plotting as p
import plot_fit
import numpy as np

SETTINGS = {"x_S": ("place of the sensor", "length"), "x_F": ("place of the force", "length"),
            "duration": ("duration of the pulse", "time"), "t_last": ("last sample", "time"),
            "t_first": ("first sample", "time"), "t_step": ("step between samples", "time"),
            "f_last": ("highest frequency", "frequency"),
            "f_first": ("lowest frequency", "frequency"),
            "f_step": ("distance of the lines", "frequency"),
            "x_S_2": ("place of the second sensor", "length")}


def settings_of(directory):
    """The settings of design.csv, in the order of SETTINGS: windows in time or bands."""
    columns = p.header(directory / "design.csv")
    return [name for name in SETTINGS if name in columns]


def read_designs(directory, name):
    """The rows of design.csv, the present experiment first, and the error of each (inf: none)."""
    rows = p.read_table(directory / "design.csv", "design", *settings_of(directory),
                        f"relative_{name}")
    errors = [p.number(row, f"relative_{name}") if row[f"relative_{name}"] else np.inf
              for row in rows]
    return rows, np.array(errors)


def values_of(rows, setting):
    """The values of a setting over the designs, ascending."""
    return sorted({p.number(row, setting) for row in rows[1:] if row[setting]})


def choose(rows, wanted):
    """The two settings of the axes: those asked for, or the first ones that vary."""
    varied = [setting for setting in SETTINGS
              if setting in rows[0] and len(values_of(rows, setting)) > 1]
    chosen = wanted or varied[:2]
    for setting in chosen:
        if setting not in varied:
            p.fail(f"found --over {setting}, which does not vary; expected {', '.join(varied)}")
    if not chosen:
        p.fail("design.csv: found one experiment, expected several to compare")
    return chosen


def draw(directory, name, wanted):
    """The map, or with one setting a curve."""
    rows, errors = read_designs(directory, name)
    units = plot_fit.read_units(directory)
    over = choose(rows, wanted)
    axis = [values_of(rows, setting) for setting in over]
    best = np.full([len(values) for values in axis], np.inf)
    for row, error in zip(rows[1:], errors[1:]):
        at = tuple(values.index(p.number(row, setting)) if row[setting] else -1
                   for setting, values in zip(over, axis))
        if all(row[setting] for setting in over):
            best[at] = min(best[at], error)
    best = np.ma.masked_invalid(best) * 100
    labels = [p.with_unit(f"{SETTINGS[setting][0]} {p.symbol(setting) if '_' in setting else ''}"
                          .strip(), units.get(SETTINGS[setting][1])) for setting in over]
    quantity = f"standard error of {p.symbol(name)} (%)"
    figure, axes = p.plt.subplots(figsize=(6.8, 4.6))
    if len(over) == 1:
        axes.semilogy(axis[0], best, "o-", color=p.BLUE)
        axes.set(xlabel=labels[0], ylabel=quantity)
        p.plain_logarithmic(axes.yaxis)
    else:
        # Values in the order of the list, not to scale: a list is what there is to choose from.
        norm = p.matplotlib.colors.LogNorm(best.min(), max(best.max(), 1.01 * best.min()))
        picture = axes.imshow(best.T, origin="lower", aspect="auto", cmap="viridis_r", norm=norm)
        bar = figure.colorbar(picture, label=quantity)
        p.plain_logarithmic(bar.ax.yaxis)
        for k, (values, ticks, label) in enumerate(zip(
                axis, (axes.set_xticks, axes.set_yticks), (axes.set_xlabel, axes.set_ylabel))):
            step = -(-len(values) // 10)
            shown = range((len(values) - 1) % step, len(values), step)
            ticks(list(shown), [f"{values[i]:.4g}" for i in shown])
            label(labels[k])
        axes.grid(False)
        where = np.unravel_index(np.ma.argmin(best), best.shape)
        axes.plot(*where, "*", color="white", markeredgecolor="black", markersize=14,
                  label=f"best: {p.plain_number(best[where], 3)} %")
        present = [p.number(rows[0], setting) if rows[0][setting] else None for setting in over]
        if all(value in values for value, values in zip(present, axis)):
            axes.plot(*(values.index(value) for value, values in zip(present, axis)), "o",
                      color="none", markeredgecolor="black", markersize=10, markeredgewidth=1.6,
                      label="as in the case")
        figure.legend(loc="outside lower left", ncols=2)
    axes.set_title(f"as it is: {p.plain_number(100 * errors[0], 3)} %" if np.isfinite(errors[0])
                   else "as it is: not determined", fontsize=10)
    figure.suptitle(f"{p.case_name(directory)}: best of all other settings")
    return figure


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=p.outputs, help="output folder of design")
    parser.add_argument("--parameter", metavar="NAME", help="default: the first one")
    parser.add_argument("--over", metavar="SETTING", nargs="+", choices=SETTINGS,
                        help="one or two of " + ", ".join(SETTINGS) + "; default: what varies")
    parser.add_argument("--out", metavar="FILE", help="picture")
    arguments = parser.parse_args()

    names = [name[9:] for name in p.header(arguments.directory / "design.csv")
             if name.startswith("relative_")]
    if not names:
        p.fail(f"{arguments.directory / 'design.csv'}: found no column relative_<parameter>")
    name = arguments.parameter or names[0]
    if name not in names:
        p.fail(f"found --parameter {name}, expected {', '.join(names)}")
    path = Path(arguments.out or arguments.directory / f"design_{name}.png")
    p.save(draw(arguments.directory, name, (arguments.over or [])[:2]), path)


if __name__ == "__main__":
    main()
