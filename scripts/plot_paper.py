#!/usr/bin/env python3
"""Draws Figures 4.1 to 4.9 of NASA CR-178199 and the valley between its Tables 4.3 and 4.4.

From the results of `reproduce section-4` -> figure_4_1.png ... figure_4_9.png, figure_valley.png.
"""

from dataclasses import dataclass
from pathlib import Path

import plotting as p
import numpy as np

RECORD, MODEL, FIT, RESIDUALS = "record", "model", "fit", "residuals"

# Number of the figure: the model as curves.csv names it, what is drawn, the title.
FIGURES = {
    "4.1": ("no_hose", RECORD, "Acceleration at the tip"),
    "4.2": ("no_hose", MODEL, "Beam without hose and damping, predicted $E$ and m_T"),
    "4.3": ("no_hose", RESIDUALS, "Residuals of the beam without hose and damping"),
    "4.4": ("4.4", FIT, "The model of Table 4.4: beam damping and hose fitted"),
    "4.5": ("4.4", RESIDUALS, "Residuals of the model of Table 4.4"),
    "4.6": ("4.5", FIT, "The adjusted model of Table 4.5: $E$ and m_T by matched modes"),
    "4.7": ("4.5", RESIDUALS, "Residuals of the adjusted model of Table 4.5"),
    "4.8": ("4.6", FIT, "The model of Table 4.6: $E$ and m_T fitted, no hose"),
    "4.9": ("4.6", RESIDUALS, "Residuals of the model of Table 4.6"),
}
# What must be there: the models and, where they have a table, its parameters.
MODELS = {"no_hose": set(), "4.2": {"m_H", "k_H"}, "4.3": {"m_H", "c_H", "k_H"},
          "4.4": {"c_D", "m_H", "c_H", "k_H"}, "4.5": {"m_T", "E"}, "4.6": {"m_T", "E"}}
TITLES = {number: title.replace("$", "") for number, (_, _, title) in FIGURES.items()}
VALLEY = "The valley between Tables 4.3 and 4.4"
RECONSTRUCTED = "RECONSTRUCTED record, not the measurement"
WINDOW = 3.0, 5.0     # s: the interval of the fits, Section 4
STEP = 0.1            # s: between their samples
UNIT = "ft/s^2"


@dataclass
class Results:
    """What the folder of `reproduce section-4` holds, by model."""

    curves: dict       # arrays t, measured, model, residual
    estimates: dict    # ours by parameter, None where nothing is fitted
    paper: dict        # the paper's by parameter
    sums: dict         # our sum of squares and the paper's
    valley: np.ndarray   # rows m_H, c_H, k_H, J


def read_results(directory):
    """The results in a folder."""
    columns = ("t", "measured", "model_acceleration", "residual")
    curves = {}
    for row in p.read_table(directory / "curves.csv", "model", *columns):
        curves.setdefault(row["model"], []).append([p.number(row, name) for name in columns])
    estimates, paper = {}, {}
    for row in p.read_table(directory / "tables.csv", "table", "parameter", "ours", "paper"):
        ours = p.number(row, "ours") if row["ours"] else None
        estimates.setdefault(row["table"], {})[row["parameter"]] = ours
        paper.setdefault(row["table"], {})[row["parameter"]] = p.number(row, "paper")
    sums = {row["model"]: (p.number(row, "ours"), p.number(row, "paper"))
            for row in p.read_table(directory / "sums.csv", "model", "ours", "paper")}
    columns = ("m_H", "c_H", "k_H", "J")
    valley = [[p.number(row, name) for name in columns]
              for row in p.read_table(directory / "valley.csv", *columns)]
    for model, names in MODELS.items():
        if model not in curves or model not in sums or not names <= paper.get(model, {}).keys():
            p.fail(f"{directory}: model '{model}' is incomplete; make the folder again with "
                   "scripts/run.sh reproduce section-4")
    return Results({model: np.array(rows).T for model, rows in curves.items()}, estimates, paper,
                   sums, np.array(valley))


def fitted(results, model):
    """Whether the model has estimates of ours."""
    return None not in results.estimates.get(model, {"": None}).values()


def window_samples(t):
    """Where the samples of the fits are."""
    nearest = np.round(t / STEP) * STEP
    return (abs(t - nearest) < 1e-6) & (t > WINDOW[0] - 1e-6) & (t < WINDOW[1] + 1e-6)


def caption(number, results):
    """What the record is, at which parameters the model stands, its sum of squares."""
    model, kind, _ = FIGURES[number]
    if kind == RECORD:
        return [f"{RECONSTRUCTED}; {results.curves[model].shape[1]} samples"]
    if kind == MODEL:
        return ["Independent of any record: nothing is fitted"]
    if kind == RESIDUALS:
        sums = (p.plain_number(value, 3) for value in results.sums[model])
        return [RECONSTRUCTED, "Sum of squares {}, the paper's {}".format(*sums)]
    ours = fitted(results, model)
    values = results.estimates[model] if ours else results.paper[model]
    text = ", ".join(f"{name} = {p.plain_number(value, 4)}" for name, value in values.items())
    whose = "our estimates" if ours else "the paper's values"
    return [RECONSTRUCTED, f"Model at {whose}: {text}"]


def limits(results, kind):
    """One vertical axis for all figures of a kind."""
    models = dict.fromkeys(model for model, what, _ in FIGURES.values()
                           if (what == RESIDUALS) == (kind == RESIDUALS))
    rows = [3] if kind == RESIDUALS else [1, 2]
    values = np.concatenate([results.curves[model][rows].ravel() for model in models])
    return np.floor(4 * values.min()) / 4, np.ceil(4 * values.max()) / 4


def draw_window(axes, t, y):
    """The window of the fits, lightly, and their samples."""
    chosen = window_samples(t)
    axes.axvspan(*WINDOW, color="0.955", linewidth=0, zorder=0)
    axes.plot(t[chosen], y[chosen], "o", markersize=4.5, markerfacecolor="white",
              markeredgecolor="black", markeredgewidth=0.8, linestyle="none", zorder=4,
              clip_on=False,
              label="the {} samples of the fit, {:g} to {:g} s".format(chosen.sum(), *WINDOW))


def set_title(axes, title, lines):
    """A title, and below it small lines."""
    axes.set_title(p.with_symbols(title), pad=8 + 12 * len(lines), fontsize=10.5,
                   fontweight="bold")
    axes.annotate(p.with_symbols("\n".join(lines)), (0, 1), (0, 5), fontsize=8.5, color="0.25",
                  xycoords="axes fraction", textcoords="offset points", va="bottom")


def draw(number, results):
    """One of the paper's figures."""
    model, kind, _ = FIGURES[number]
    t, measured, response, residual = results.curves[model]
    figure, axes = p.plt.subplots(figsize=(7.6, 3.7))
    set_title(axes, f"Figure {number}  {FIGURES[number][2]}", caption(number, results))
    axes.axhline(0, color="0.6", linewidth=0.7, zorder=1)
    if kind == RESIDUALS:
        axes.plot(t, residual, color=p.VERMILION, linewidth=0.8, label="record $-$ model")
        shown = residual
    elif kind == MODEL:
        axes.plot(t, response, color=p.BLUE, linewidth=1.8, label="model")
    else:
        light = "0.25" if kind == RECORD else "0.55"
        axes.plot(t, measured, color=light, linewidth=0.8, label="record (reconstructed)")
        shown = measured
    if kind == FIT:
        axes.plot(t, response, color=p.BLUE, linewidth=2, label="model", zorder=3)
    if kind == RECORD or (kind != MODEL and fitted(results, model)):
        draw_window(axes, t, shown)
    axes.set_xlim(0, max(5.0, t[-1]))
    axes.set_ylim(*limits(results, kind))
    axes.yaxis.set_major_locator(p.plt.MultipleLocator(0.25))
    axes.set_xlabel("time (s)", loc="left")
    quantity = "residual" if kind == RESIDUALS else "acceleration at the tip"
    axes.set_ylabel(p.with_unit(quantity, UNIT))
    axes.legend(loc="upper right", bbox_to_anchor=(1.01, -0.09), ncols=3, columnspacing=1.6)
    return figure


def at_minimum(results, table):
    """m_H of our estimates and their J, from the residuals at the samples of the fit."""
    t, _, _, residual = results.curves[table]
    return results.estimates[table]["m_H"], np.sum(residual[window_samples(t)]**2)


def one_standard_error(results, table="4.3"):
    """The rise of J over its minimum that belongs to one standard error of an estimate."""
    t, _, _, residual = results.curves[table]
    chosen = window_samples(t)
    return np.sum(residual[chosen]**2) / (chosen.sum() - len(results.estimates[table]))


def draw_valley(results):
    """J along the valley, and the c_H and k_H that belong to it with the paper's two tables."""
    m_H, c_H, k_H, J = results.valley.T
    lowest = J.min()
    figure, axes = p.plt.subplots(3, 1, figsize=(7.6, 6.6), sharex=True, height_ratios=[2, 1, 1])
    top = axes[0]
    set_title(top, VALLEY, [f"{RECONSTRUCTED}; c_D = 0, c_H and k_H fitted for each m_H"])

    top.plot(m_H, J, ".-", color=p.BLUE, linewidth=2, markersize=7,
             label=p.with_symbols("lowest $J$ for this m_H"))
    level = lowest + one_standard_error(results)
    top.axhline(level, color="0.3", linestyle="--", linewidth=1)
    top.annotate("below this line: within one standard error", (m_H[-1], level), (0, 3),
                 fontsize=8.5, ha="right", textcoords="offset points")
    top.plot(*at_minimum(results, "4.3"), "o", color="black", markersize=7, zorder=5,
             label="our minimum")
    top.set_ylabel(p.with_unit("$J$", "ft^2/s^4"))
    right = top.secondary_yaxis("right", functions=(lambda y: 100 * (y / lowest - 1),
                                                    lambda y: lowest * (1 + y / 100)))
    right.set_ylabel("above the lowest (%)")
    right.spines["right"].set_visible(True)
    marks = (("4.3", p.VERMILION, "D", "--"), ("4.4", p.GREEN, "s", ":"))
    for table, colour, _, style in marks:
        at = results.paper[table]["m_H"]
        for panel in axes:
            panel.axvline(at, color=colour, linestyle=style, linewidth=1.6, zorder=1,
                          label=f"Table {table} of the paper" if panel is top else None)
    for panel, name, values in zip(axes[1:], ("c_H", "k_H"), (c_H, k_H)):
        panel.plot(m_H, values, color=p.BLUE, linewidth=2)
        panel.plot(results.estimates["4.3"]["m_H"], results.estimates["4.3"][name], "o",
                   color="black", markersize=6, zorder=5)
        for table, colour, marker, _ in marks:
            panel.plot(results.paper[table]["m_H"], results.paper[table][name], marker,
                       color=colour, markersize=8, markeredgecolor="black", zorder=4)
    axes[1].set_ylabel(p.with_unit(p.symbol("c_H"), "lb s/ft"))
    axes[2].set_ylabel(p.with_unit(p.symbol("k_H"), "lb/ft"))
    axes[2].set_xlabel(p.with_unit(p.symbol("m_H"), "slug"))
    top.set_xlim(m_H[0], m_H[-1])
    top.legend(loc="center right", bbox_to_anchor=(1, 0.58))
    figure.align_ylabels(axes)
    return figure


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("folder", nargs="?", default="out/section-4",
                        help="results of `reproduce section-4` (default: out/section-4)")
    parser.add_argument("--out", metavar="FOLDER", help="where to (default: beside the results)")
    arguments = parser.parse_args()
    directory = Path(arguments.folder)
    if not directory.is_dir():
        p.fail(f"{directory}: no such folder; make it with scripts/run.sh reproduce section-4")
    results = read_results(p.outputs(directory))
    out = Path(arguments.out or directory)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        p.fail(f"{out}: {p.reason(error)}")
    for number in FIGURES:
        p.save(draw(number, results), out / f"figure_{number.replace('.', '_')}.png")
    p.save(draw_valley(results), out / "figure_valley.png")


if __name__ == "__main__":
    main()
