#!/usr/bin/env python3
"""Plots a fit: measured and modelled acceleration, residuals, estimates -> DIR/fit.png."""

import math

import plotting as p
import numpy as np


def read_fit(directory):
    """fit.csv as arrays (t, measured, model, residual) by number of elements."""
    meshes = {}
    columns = ("t", "measured", "model", "residual")
    for row in p.read_table(directory / "fit.csv", "elements", *columns):
        values = [p.number(row, column) for column in columns]
        meshes.setdefault(p.number(row, "elements", int), []).append(values)
    return {n: np.array(rows).T for n, rows in sorted(meshes.items())}


def read_units(directory):
    """labels.csv as unit by quantity; empty without the file."""
    path = directory / "labels.csv"
    if not path.exists():
        return {}
    return {row["quantity"]: row["unit"] for row in p.read_table(path, "quantity", "unit")}


def estimate_text(row):
    """The value with its unit; the 95 % interval, or why there is none; the colour of that."""
    digits, note, colour = 5, "", p.GREY
    if (row.get("determined") or "").strip().lower() == "no":
        note, colour = "not determined by this record", p.VERMILION
    elif row.get("lower95") and row.get("upper95"):
        low, high = p.number(row, "lower95"), p.number(row, "upper95")
        if high > low:    # two digits of the width, and of the value as many as of its interval
            largest = max(abs(low), abs(high))
            digits = min(max(2 + math.ceil(math.log10(largest / (high - low))), 3), 12)
        note = f"{p.number_text(low, digits)} to {p.number_text(high, digits)}"
    value = p.number_text(p.number(row, "estimate"), max(digits, 5))
    return f"{value} {p.unit_text(row.get('unit'))}", note, colour


def draw_estimates(axes, rows, elements, samples):
    """The panel of estimates: value and unit, below it the interval; then J and the samples."""
    axes.set_axis_off()
    intervals = any(row.get("lower95") for row in rows)
    axes.set_title("Estimates" + ", 95 % intervals" * intervals)
    lines = []    # symbol, text, colour, space below
    for row in sorted(rows, key=lambda row: row["parameter"] == "J"):    # J last
        value, note, colour = estimate_text(row)
        lines.append((p.symbol(row["parameter"]), value, "black", 0.9 if note else 1.4))
        if note:
            lines.append(("", note, colour, 1.4))
    lines.append(("$N$", f"{elements} elements", "black", 1.4))
    lines.append(("$n$", f"{samples} samples", "black", 1.0))

    step = min(0.055, 1 / sum(line[3] for line in lines))
    y = 0.97
    for name, text, colour, space in lines:
        size = 10 if colour == "black" else 8.5
        axes.text(0.0, y, name, va="baseline", fontsize=11)
        axes.text(0.15, y, text, va="baseline", fontsize=size, color=colour)
        y -= space * step


def draw(directory, meshes, chosen, rows):
    """The figure: fit, its residuals, the residuals of all meshes if several, estimates."""
    units = read_units(directory)
    acceleration = p.with_unit("acceleration", units.get("acceleration"))
    residual = p.with_unit("residual", units.get("acceleration"))
    t, measured, model, difference = meshes[chosen]

    several = len(meshes) > 1
    heights = [2.4, 1, 1.2] if several else [2.4, 1]
    figure = p.plt.figure(figsize=(10.5, 7.2 if several else 6))
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=[2.9, 1])
    figure.get_layout_engine().set(wspace=0.03)
    title = f"Tip acceleration and fitted model: {p.case_name(directory)}"
    figure.suptitle(title, x=0.01, ha="left")

    top = figure.add_subplot(grid[0, 0])
    size = 5 if len(t) < 400 else 2.5
    top.plot(t, measured, ".", color="black", markersize=size, zorder=3, label="measured")
    top.plot(t, model, color=p.BLUE, label=f"model, $N$ = {chosen}")
    top.set_ylabel(acceleration)
    panels = [top, figure.add_subplot(grid[1, 0], sharex=top)]
    panels[1].axhline(0, color=p.GREY, linewidth=0.8)
    panels[1].plot(t, difference, color=p.BLUE, marker="." if len(t) < 400 else "", markersize=4,
                   linewidth=0.9, label=f"measured $-$ model, $N$ = {chosen}")
    panels[1].set_ylabel(residual)
    if several:
        panels.append(figure.add_subplot(grid[2, 0], sharex=top))
        for k, n in enumerate(n for n in meshes if n != chosen):
            style = ("-", "--", ":")[k // 5 % 3]
            panels[2].plot(*meshes[n][[0, 3]], linewidth=0.9, linestyle=style,
                           color=p.COLOURS[1 + k % 5], label=f"$N$ = {n}")
        panels[2].plot(t, difference, color=p.BLUE, linewidth=1.6, label=f"$N$ = {chosen}")
        panels[2].set_ylabel(residual)
    for panel in panels:
        panel.legend(loc="lower left", bbox_to_anchor=(0.07, 0.98), ncols=8, columnspacing=0.9,
                     handlelength=1.2, handletextpad=0.5, borderaxespad=0)
        panel.tick_params(labelbottom=panel is panels[-1])
    panels[-1].set_xlabel(p.with_unit("time", units.get("time")))
    top.set_xlim(t[0] - 0.01 * (t[-1] - t[0]), t[-1] + 0.01 * (t[-1] - t[0]))
    figure.align_ylabels(panels)

    draw_estimates(figure.add_subplot(grid[:, 1]), rows, chosen, len(t))
    return figure


def picture(directory, chosen=None):
    """The figure of an output folder, for the mesh chosen or the finest."""
    meshes = read_fit(directory)
    chosen = max(meshes) if chosen is None else chosen
    if chosen not in meshes:
        found = ", ".join(map(str, meshes))
        p.fail(f"{directory / 'fit.csv'}: no fit with {chosen} elements (found: {found})")
    rows = p.last_stage(directory).get(chosen)
    if not rows:
        p.fail(f"{directory / 'estimates.csv'}: no estimates for {chosen} elements")
    return draw(directory, meshes, chosen, rows)


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=p.folder, help="output folder of a fit")
    parser.add_argument("--elements", metavar="N", type=int, help="mesh to show (default: finest)")
    parser.add_argument("--out", metavar="FILE", help="picture to write (default: DIR/fit.png)")
    arguments = parser.parse_args()

    figure = picture(arguments.directory, arguments.elements)
    p.save(figure, arguments.out or arguments.directory / "fit.png")


if __name__ == "__main__":
    main()
