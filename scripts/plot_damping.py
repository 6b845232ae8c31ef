#!/usr/bin/env python3
"""Plots damping ratios over the frequency: measured modes with their 95 % intervals, and the models
of `compare --damping` -> DIR/damping.png."""

from pathlib import Path

import plotting as p
import numpy as np

def read_damping(directory):
    """Returns the measured modes and the models of a comparison.

    The first is an array with the columns frequency, damping ratio, lower and upper limit. The
    second lists name, whether the data allow the model, difference of AICc from the best model, and
    an array with frequencies and damping ratios of the first record's modes; best model first.
    """
    rows = p.read_table(directory / "damping.csv", "model", "possible", "record", "mode",
                        "damping_ratio", "measured_hz", "measured_damping", "lower95", "upper95")
    criteria = {row["model"]: p.number(row, "aicc")
                for row in p.read_table(directory / "models.csv", "model", "aicc")}
    names = sorted(criteria, key=criteria.get)
    measured = [[p.number(row, key) for key in ("measured_hz", "measured_damping", "lower95",
                                                "upper95")]
                for row in rows if row["model"] == names[0] and row["measured_hz"]]
    models = []
    for name in names:
        modes = [[p.number(row, key) for key in ("frequency_hz", "damping_ratio")]
                 for row in rows if row["model"] == name and row["record"] == "1"]
        possible = next(row["possible"] == "yes" for row in rows if row["model"] == name)
        models.append((name, possible, criteria[name] - criteria[names[0]], np.array(modes)))
    return np.array(measured).reshape(-1, 4), models


def view(measured, models):
    """Returns the range of damping ratios to show: that of measured modes and possible models."""
    ratios = [ratio for _, possible, _, modes in models if possible for ratio in modes[:, 1]]
    ratios = np.array([*ratios, *measured[:, 1:].ravel()])
    ratios = ratios[ratios > 0]
    return ratios.min() / 1.5, ratios.max() * 1.5


def draw(directory):
    """Returns the figure."""
    measured, models = read_damping(directory)
    figure, axes = p.plt.subplots(figsize=(7.4, 4.4))
    is_first = True
    for k, (name, possible, difference, modes) in enumerate(models):
        if possible:
            style = {"color": p.COLOURS[k % len(p.COLOURS)], "marker": p.MARKERS[k % 6],
                     "markersize": 4, "linestyle": ("-", "--", ":")[k % 3],
                     "label": name if k == 0 else f"{name} (+{difference:.1f})"}
        else:
            style = {"color": "0.75", "linewidth": 0.9, "zorder": 1,
                     "label": "rejected" if is_first else None}
            is_first = False
        axes.plot(modes[:, 0], 100 * modes[:, 1], **style)
    if len(measured):
        error = 100 * np.array([measured[:, 1] - measured[:, 2], measured[:, 3] - measured[:, 1]])
        axes.errorbar(measured[:, 0], 100 * measured[:, 1], yerr=error, fmt="o", color="black",
                      markersize=5, capsize=3, label="measured", zorder=4)
    axes.set(xscale="log", yscale="log", xlabel="natural frequency (Hz)",
             ylabel="damping ratio (%)", title=p.case_name(directory),
             ylim=[100 * end for end in view(measured, models)])
    for axis in (axes.xaxis, axes.yaxis):
        p.plain_logarithmic(axis)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=p.outputs,
                        help="output folder of compare --damping")
    parser.add_argument("--out", metavar="FILE", help="picture (default: DIR/damping.png)")
    arguments = parser.parse_args()
    p.save(draw(arguments.directory), Path(arguments.out or arguments.directory / "damping.png"))


if __name__ == "__main__":
    main()
