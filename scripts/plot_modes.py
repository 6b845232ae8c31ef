#!/usr/bin/env python3
"""Plots the mode shapes of a structure -> DIR/modes.png; with --animate also -> DIR/modes.gif."""

from pathlib import Path

import plotting as p
import plot_fit
import numpy as np

MOST = 4       # modes in a picture
FRAMES = 40    # of a cycle
SPEED = 20     # frames a second


def read_shapes(directory):
    """Returns x (n), the shapes (n, modes), complex if damped, and the parts there: (name, x)."""
    path = directory / "shapes.csv"
    rows = p.read_table(path, "x", "mode_1_real")
    count = sum(name.endswith("_real") for name in p.header(path))
    x = np.array([p.number(row, "x") for row in rows])
    shapes = np.array([[complex(p.number(row, f"mode_{k}_real"), p.number(row, f"mode_{k}_imag"))
                        for k in range(1, count + 1)] for row in rows])
    attached = [(row["name"], p.number(row, "x"))
                for row in p.read_table(directory / "attachments.csv", "name", "x")]
    return x, shapes, attached


def read_numbers(directory):
    """Frequency, damping ratio and number of each mode that has a shape, because it oscillates: of
    the finest mesh, of the first record."""
    rows = p.read_table(directory / "modes.csv", "elements", "mode", "frequency_hz",
                        "damping_ratio", "imag")
    rows = [row for row in rows if row["elements"] == rows[-1]["elements"]
            and row.get("record", "1") == "1" and p.number(row, "imag") > 0]
    return [(p.number(row, "frequency_hz"), p.number(row, "damping_ratio"), row["mode"])
            for row in rows]


def draw_beam(axes, x):
    """The beam at rest and its clamp."""
    axes.plot([x[0], x[-1]], [0, 0], color="black", linewidth=3, solid_capstyle="butt")
    axes.plot([x[0], x[0]], [-0.6, 0.6], color="black", linewidth=2)


def name_attached(axes, attached, length, offset):
    """Names at their places; those at one place share a line, which ends at the tip."""
    for place in sorted({place for _, place in attached}):
        names = ", ".join(name for name, at in attached if at == place)
        side, shift = ("right", 5) if place > 0.9 * length else ("center", 0)
        axes.annotate(names, (place, 0), xytext=(shift, offset), textcoords="offset points",
                      ha=side, fontsize=8)


def draw(directory):
    """A panel for each mode; returns the figure and what moves: (curve, marks, shape)."""
    x, shapes, attached = read_shapes(directory)
    units, numbers = plot_fit.read_units(directory), read_numbers(directory)
    hertz = p.frequency_unit(units.get("time"))
    count = min(shapes.shape[1], MOST)
    figure, panels = p.plt.subplots(count, 1, figsize=(6.4, 1.0 + 1.5 * count), sharex=True,
                                    squeeze=False)
    moving = []
    places = np.array([place for _, place in attached])
    for k, axes in enumerate(panels[:, 0]):
        draw_beam(axes, x)
        axes.plot(x, shapes[:, k].real, color=p.GREY, linewidth=0.8)
        axes.plot(x, -shapes[:, k].real, color=p.GREY, linewidth=0.8)
        curve, = axes.plot(x, shapes[:, k].real, color=p.COLOURS[k], linewidth=2.2)
        there = np.interp(places, x, shapes[:, k].real) + 1j * np.interp(
            places, x, shapes[:, k].imag)
        marks, = axes.plot(places, there.real, "ks", markersize=6)
        frequency, damping, mode = numbers[k]
        axes.set_title(f"mode {mode}: {p.plain_number(frequency, 5)} {hertz}, damping ratio "
                       f"{p.plain_number(damping, 3)}", fontsize=10)
        axes.set(ylim=(-1.15, 1.15), yticks=[])
        moving.append((curve, marks, shapes[:, k], there))
    panels[-1, 0].set_xlabel(p.with_unit("x", units.get("length")))
    name_attached(panels[0, 0], attached, x[-1], -14)
    figure.suptitle(f"{p.case_name(directory)}: mode shapes")
    return figure, moving


def animate(directory, path):
    """One cycle of every mode, each at its own pace made the same, without its decay."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    figure, moving = draw(directory)

    def show(frame):
        turn = np.exp(2j * np.pi * frame / FRAMES)
        for curve, marks, shape, there in moving:
            curve.set_ydata((shape * turn).real)
            marks.set_ydata((there * turn).real)
        return [artist for curve, marks, *_ in moving for artist in (curve, marks)]

    try:
        FuncAnimation(figure, show, frames=FRAMES).save(path, PillowWriter(fps=SPEED), dpi=70)
    except OSError as error:
        p.fail(f"{path}: {p.reason(error)}")


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=p.outputs,
                        help="output folder of modes or identify")
    parser.add_argument("--animate", action="store_true", help="a moving picture as well")
    parser.add_argument("--out", metavar="FILE", help="picture (default: DIR/modes.png)")
    arguments = parser.parse_args()

    path = Path(arguments.out or arguments.directory / "modes.png")
    figure, _ = draw(arguments.directory)
    p.save(figure, path)
    if arguments.animate:
        animate(arguments.directory, path.with_suffix(".gif"))
        print(path.with_suffix(".gif"))


if __name__ == "__main__":
    main()
