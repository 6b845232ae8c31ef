"""The section about damping ratios on the page of `compare --damping`, for report.py."""

import re

import figures as f
import numpy as np
import page as h
import plot_damping


def verdict(outputs):
    """Returns the box with what the program concludes: the first block of its summary."""
    summary = outputs.summary("compare")
    if summary is None:
        return h.box("warn", "summary.txt is from another command: run compare --damping again, "
                     "with a folder of its own, for what it concludes", [])
    block = summary.blocks[0]
    headline, *points = re.sub(r"\n {4,}", " ", block.strip()).splitlines()
    is_open = any(point.startswith(("The data do not", "warning")) for point in points)
    return h.box("warn" if is_open else "good", headline + ".",
                 [point.rstrip(".") + "." for point in points])


def damping_ratios(outputs):
    """Returns the section with the damping ratios of measured modes and of the models."""
    measured, models = plot_damping.read_damping(outputs.folder)
    possible = [name for name, is_possible, _, _ in models if is_possible]
    words = ("Models that the data do not reject are in colour: " +
             ", ".join(f"`{name}`" for name in possible) + ".")
    text = h.paragraph(words) + h.figure(
        draw(measured, models), "Damping ratio of each mode over its natural frequency, both axes "
        "logarithmic: measured modes with their 95 % intervals, and the models.")
    return ("damping", "Damping ratios", text)


def draw(measured, models):
    """Draws the damping ratios, the rejected models in grey."""
    figure = f.new(400, "natural frequency (Hz)", "damping ratio (%)")
    is_first = True
    for k, (name, is_possible, _, modes) in enumerate(models):
        if not is_possible:
            f.add_line(figure, modes[:, 0], 100 * modes[:, 1], "rejected", f.colour("grey"),
                       showlegend=is_first)
            is_first = False
            continue
        figure.add_scatter(x=f.numbers(modes[:, 0]), y=f.numbers(100 * modes[:, 1]), name=name,
                           mode="lines+markers", marker=dict(size=6, color=f.cycle(k)),
                           line=dict(width=1.6, color=f.cycle(k), dash=f.DASHES[k % 3]))
    if len(measured):
        ratio, low, high = (100 * measured[:, k] for k in (1, 2, 3))
        figure.add_scatter(x=f.numbers(measured[:, 0]), y=f.numbers(ratio), name="measured",
                           mode="markers", marker=dict(size=8, color=f.colour("text")),
                           error_y=dict(type="data", array=f.numbers(high - ratio),
                                        arrayminus=f.numbers(ratio - low), thickness=1.4,
                                        color=f.colour("text")))
    low, high = (100 * end for end in plot_damping.view(measured, models))
    figure.update_xaxes(type="log")
    figure.update_yaxes(type="log", range=[np.log10(low), np.log10(high)])
    return figure
