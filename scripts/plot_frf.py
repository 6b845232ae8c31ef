#!/usr/bin/env python3
"""Plots frequency response functions -> DIR/frf.png: magnitude, phase, residuals, coherence and the
Nyquist circle of a mode. Of several records the second one goes to frf_2.png, ..."""

import math
from pathlib import Path

import plotting as p
import frf_outputs as o
import numpy as np

DOTTED = 400    # fewer lines are marked one by one
LEVELS = {"sd": "noise level (sd of the record)", "coherence": "noise level from the coherence",
          "residuals": "rms of the residuals"}


def draw_magnitude(axes, curve, label, modes):
    """Measurement and model, with the 95 % band of the model's magnitude."""
    few = len(curve.f) < DOTTED
    if curve.measured is not None:
        axes.semilogy(curve.f, np.abs(curve.measured), "." if few else "-", color="black",
                      markersize=4, linewidth=1.5, label="measured")
    if curve.band is not None:
        axes.fill_between(curve.f, *curve.band, color=p.SKY, alpha=0.4, linewidth=0,
                          label="95 % band of the model")
    axes.semilogy(curve.f, np.abs(curve.model), color=p.BLUE, linewidth=1.2,
                  label=f"model, $N$ = {curve.elements}")
    axes.set_ylabel(label)
    p.mark_frequencies(axes, [f for _, f in modes])
    for text, (number, _) in zip(axes.texts, modes):
        text.set_text(f"{number}")


def draw_phase(axes, curve):
    """Phases in degrees, with a break where they jump by a turn."""
    few = len(curve.f) < DOTTED
    if curve.measured is not None:
        style = ("." if few else "-")
        f, phase = o.wrapped(curve.f, o.degrees(curve.measured))
        axes.plot(f, phase, style, color="black", markersize=4, linewidth=1.5)
    axes.plot(*o.wrapped(curve.f, o.degrees(curve.model)), color=p.BLUE, linewidth=1.2)
    axes.set(ylabel="phase (degrees)", ylim=(-190, 190), yticks=range(-180, 181, 90))


def draw_residual(axes, curve, averages, label):
    """Magnitudes of the residuals, and the level that noise gives them."""
    size = np.abs(curve.residual)
    axes.semilogy(curve.f, np.maximum(size, 1e-300), ".", color=p.VERMILION,
                  markersize=4 if len(curve.f) < DOTTED else 2,
                  label="|measured $-$ model|")
    level, basis = o.noise_level(curve, averages)
    axes.semilogy(curve.f, level, color="black", linewidth=1.2, label=LEVELS[basis])
    if (size > 0).any():
        axes.set_ylim(np.nanpercentile(size[size > 0], 1) / 3, 2 * max(np.nanmax(size),
                                                                       np.nanmax(level)))
    axes.set_ylabel(label)


def draw_circle(axes, curve, name, frequency, unit):
    """The Nyquist circle of a mode: imaginary over real part, lines marked one by one."""
    part, top = o.circle(curve, frequency)
    if curve.measured is not None:
        axes.plot(curve.measured[part].real, curve.measured[part].imag, ".", color="black",
                  markersize=4, label="measured")
    fine = o.between(curve.f[part], curve.model[part])[1]
    axes.plot(fine.real, fine.imag, color=p.BLUE, linewidth=1.2, label="model")
    at = curve.model[top]
    axes.plot([at.real], [at.imag], "o", color=p.GREEN, markersize=6, zorder=4)
    axes.axhline(0, color=p.GREY, linewidth=0.8)
    axes.axvline(0, color=p.GREY, linewidth=0.8)
    axes.set_aspect("equal", adjustable="box", anchor="N")
    axes.margins(0.15)
    axes.ticklabel_format(scilimits=(-3, 4))
    axes.set_xlabel(p.with_unit("real part", unit))
    axes.set_ylabel(p.with_unit("imaginary part", unit))
    lines = curve.f[part]
    axes.set_title(f"Nyquist circle of {name}\n{len(lines)} lines, "
                   f"{p.plain_number(lines[0], 5)} to {p.plain_number(lines[-1], 5)} Hz",
                   fontsize=10)
    out = at - curve.model[part].mean()    # from the middle of the circle to its outside
    out = 9 * out / (abs(out) or 1.0)
    axes.annotate(f"{p.plain_number(curve.f[top], 5)} Hz", (at.real, at.imag),
                  xytext=(out.real, out.imag), textcoords="offset points", fontsize=9,
                  color=p.GREEN, ha="left" if out.real >= 0 else "right",
                  va="bottom" if out.imag >= 0 else "top")


def draw_facts(axes, curve, averages):
    """Numbers of the record."""
    axes.set_axis_off()
    facts = [("$N$", f"{curve.elements} elements"), ("$n$", f"{len(curve.f)} lines"),
             ("", f"{p.plain_number(curve.f[0], 5)} to {p.plain_number(curve.f[-1], 5)} Hz")]
    if averages:
        facts.append(("", f"{averages} averages"))
    if curve.residual is not None:
        share = np.nansum(np.abs(curve.residual)**2) / np.nansum(np.abs(curve.measured)**2)
        facts.append(("", f"residual/measured: {100 * math.sqrt(share):.3g} %, rms"))
    for k, (name, text) in enumerate(facts):
        axes.text(0, 0.9 - 0.13 * k, name, fontsize=10.5)
        axes.text(0.1, 0.9 - 0.13 * k, text, fontsize=10)


def draw(folder, curve, mode=None):
    """The figure of one record."""
    quantity, unit = folder.quantity(curve.record), folder.unit(curve.record)
    averages, modes = folder.averages(curve.record), folder.modes(curve)
    number, frequency = o.chosen_mode(folder, curve, mode)
    heights = {"magnitude": 2.4, "phase": 1.3,
               **({"residual": 1.5} if curve.residual is not None else {}),
               **({"coherence": 0.9} if curve.coherence is not None else {})}
    figure = p.plt.figure(figsize=(11, 1.5 * sum(heights.values()) + 1))
    grid = figure.add_gridspec(len(heights), 2, height_ratios=list(heights.values()),
                               width_ratios=[2.3, 1])
    figure.get_layout_engine().set(wspace=0.04)
    which = f", record {curve.record} of {len(folder.curves)}" * (len(folder.curves) > 1)
    figure.suptitle(f"Frequency response: {p.case_name(folder.directory)}{which}", x=0.01,
                    ha="left")
    panels = {name: figure.add_subplot(grid[k, 0]) for k, name in enumerate(heights)}
    draw_magnitude(panels["magnitude"], curve, p.with_unit(quantity, unit), modes)
    draw_phase(panels["phase"], curve)
    if "residual" in panels:
        draw_residual(panels["residual"], curve, averages, p.with_unit("residual", unit))
    if "coherence" in panels:
        panels["coherence"].plot(curve.f, curve.coherence, color=p.PURPLE, linewidth=1.1)
        panels["coherence"].set(ylabel="coherence", ylim=(0, 1.05))
    last = list(panels.values())[-1]
    for panel in panels.values():
        panel.set_xlim(curve.f[0], curve.f[-1])
        panel.tick_params(labelbottom=panel is last)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(loc="lower left", bbox_to_anchor=(0, 0.99), ncols=4, columnspacing=0.9,
                         handlelength=1.2, handletextpad=0.5, borderaxespad=0)
    last.set_xlabel("frequency (Hz)")
    figure.align_ylabels(list(panels.values()))
    below = 2 if len(heights) > 2 else 1
    draw_circle(figure.add_subplot(grid[:below, 1]), curve,
                f"{folder.word(curve)} {number}", frequency, unit)
    draw_facts(figure.add_subplot(grid[below:, 1]), curve, averages)
    return figure


def pictures(directory, elements=None, mode=None):
    """The figures of an output folder, one for each record, for the mesh chosen or the finest."""
    if not (directory / "frf.csv").exists():
        p.fail(f"{directory}: found no frf.csv, expected outputs of frf, or of a fit of a record "
               "with kind='frf'")
    folder = o.Folder(directory)
    for curve in folder.finest(elements):
        yield draw(folder, curve, mode)


def main():
    parser = p.new_parser(__doc__.replace("\n", " "))
    parser.add_argument("directory", metavar="DIR", type=p.outputs,
                        help="output folder of frf or identify")
    parser.add_argument("--mode", metavar="K", type=int,
                        help="mode of the Nyquist circle, without modes.csv the K-th peak "
                        "(default: the highest)")
    parser.add_argument("--elements", metavar="N", type=int, help="mesh to show (default: finest)")
    parser.add_argument("--out", metavar="FILE", help="picture to write (default: DIR/frf.png)")
    arguments = parser.parse_args()

    path = Path(arguments.out or arguments.directory / "frf.png")
    for k, figure in enumerate(pictures(arguments.directory, arguments.elements, arguments.mode)):
        p.save(figure, p.numbered(path, k + 1))


if __name__ == "__main__":
    main()
