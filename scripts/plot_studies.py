"""Pictures of the studies `reproduce acceleration`, `convergence` and `varying`; for report.py."""

import plotting as p
import numpy as np

QUANTITIES = ("displacement", "velocity", "acceleration")


def panels_for(keys, x, y):
    """A figure with one panel for each key on common axes, at most three in a row."""
    columns = 3 if len(keys) == 3 else min(len(keys), 2)
    rows = -(-len(keys) // columns)
    figure, axes = p.plt.subplots(rows, columns, squeeze=False, sharex=True, sharey=True,
                                  figsize=(7.6, 2.9 * rows + 0.8))
    for unused in axes.flat[len(keys):]:
        unused.set_visible(False)
    panels = axes.flat[:len(keys)]
    for k, panel in enumerate(panels):
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.tick_params(labelbottom=k >= len(keys) - columns, labelsize=8.5)
    figure.supxlabel(x, fontsize=10)
    figure.supylabel(y, fontsize=10)
    return figure, panels


def positive(values):
    """Values for a logarithmic axis: what is not positive has no place there."""
    values = np.array(values, dtype=float)
    return np.where(values > 0, values, np.nan)


def draw_lines(panel, lines):
    """Lines by label, the same look for the same place in `lines` in every panel."""
    for k, (label, points) in enumerate(lines.items()):
        if points:
            xs, ys = np.array(sorted(points)).T
            panel.plot(positive(xs), positive(ys), color=p.COLOURS[k % 6], markersize=5,
                       marker=p.MARKERS[k % 6], linestyle=("-", "--", ":")[k // 6 % 3], label=label)


def legend_above(figure, panels):
    """One legend for all panels."""
    entries = {}
    for panel in panels:
        entries.update(zip(*reversed(panel.get_legend_handles_labels())))
    figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=3)


def draw_acceleration(path):
    """Error of the tip acceleration over the integrator's tolerance, by formula and damping."""
    rows = p.read_table(path, "damping", "rtol", "formula", "rms_error")
    dampings = dict.fromkeys(row["damping"] for row in rows)
    formulas = dict.fromkeys(row["formula"] for row in rows)
    figure, panels = panels_for(dampings, "rtol of the integrator", "rms error of the acceleration")
    for panel, damping in zip(panels, dampings):
        lines = {formula: [(p.number(row, "rtol"), p.number(row, "rms_error")) for row in rows
                           if (row["damping"], row["formula"]) == (damping, formula)]
                 for formula in formulas}
        draw_lines(panel, lines)
        panel.set_title(f"damping: {damping}")
    legend_above(figure, panels)
    return figure


def draw_convergence(path):
    """Errors over the number of elements, by force, load and norm."""
    rows = p.read_table(path, "force", "load", "N")
    names = [name for name in rows[0] if name.partition("_")[0] in QUANTITIES
             and not name.endswith(("order", "rate"))]
    if not names:
        p.fail(f"{path}: no column of errors, such as displacement_V")
    cases = dict.fromkeys((row["force"], row["load"]) for row in rows)
    figure, panels = panels_for(cases, "number of elements $N$", "error")
    for panel, case in zip(panels, cases):
        mine = [row for row in rows if (row["force"], row["load"]) == case]
        lines = {name.replace("_", ", norm "): [(p.number(row, "N"), p.number(row, name))
                                                for row in mine if row[name]] for name in names}
        draw_lines(panel, lines)
        panel.set_title(f"force: {case[0]}, load: {case[1]}", fontsize=10)
        meshes = sorted({p.number(row, "N", int) for row in mine})
        panel.set_xticks(meshes, labels=meshes)
        panel.set_xticks([], minor=True)
    legend_above(figure, panels)
    return figure


def draw_varying(path):
    """Distances of E(x) and c_D(x) from the truth over the coefficients, by problem and state mesh;
    where the folder has them too, below these the functions on the finest state mesh."""
    rows = p.read_table(path, "problem", "N", "M", "parameter", "sup", "L2")
    cases = list(dict.fromkeys((row["problem"], row["parameter"]) for row in rows))
    beside = path.with_name("varying_functions.csv")
    curves = p.read_table(beside, "problem", "N", "M", "parameter", "x", "value",
                          "truth") if beside.exists() else []
    figure, axes = p.plt.subplots(2 if curves else 1, len(cases), squeeze=False,
                                  figsize=(2.6 * len(cases), 6.4 if curves else 3.6))
    for (problem, parameter), panel in zip(cases, axes[0]):
        mine = [row for row in rows if (row["problem"], row["parameter"]) == (problem, parameter)]
        draw_lines(panel, {f"$N$ = {mesh}": [(p.number(row, "M"), p.number(row, "L2"))
                                             for row in mine if row["N"] == mesh]
                           for mesh in dict.fromkeys(row["N"] for row in mine)})
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(f"{p.with_symbols(problem)}: {p.symbol(parameter)}$(x)$", fontsize=10)
        panel.set_xlabel("coefficients $M$")
        meshes = sorted({p.number(row, "M", int) for row in mine})
        panel.set_xticks(meshes, labels=meshes)
        panel.set_xticks([], minor=True)
        panel.tick_params(labelsize=8.5)
    limits = [panel.get_ylim() for panel in axes[0]]
    for panel in axes[0]:
        panel.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
        panel.tick_params(labelleft=panel is axes[0, 0])
    axes[0, 0].set_ylabel("distance from the truth, $L_2$, relative", fontsize=9)
    legend_above(figure, axes[0])
    if curves:
        finest = max(curves, key=lambda row: p.number(row, "N", int))["N"]
        for (problem, parameter), panel in zip(cases, axes[1]):
            mine = (problem, parameter, finest)
            draw_functions(panel, [row for row in curves
                                   if (row["problem"], row["parameter"], row["N"]) == mine])
            panel.set_ylabel(f"{p.symbol(parameter)}$(x)$, $N$ = {finest}", fontsize=9)
        axes[1, 0].legend(fontsize=8)
    return figure


def draw_functions(panel, rows):
    """One function by its coefficients, and the truth."""
    for k, mesh in enumerate(dict.fromkeys(row["M"] for row in rows)):
        mine = [row for row in rows if row["M"] == mesh]
        xs = [p.number(row, "x") for row in mine]
        if k == 0:
            panel.plot(xs, [p.number(row, "truth") for row in mine], color="black", linewidth=2.4,
                       alpha=0.35, label="truth")
        panel.plot(xs, [p.number(row, "value") for row in mine], color=p.COLOURS[k % 6],
                   linewidth=1, label=f"$M$ = {mesh}")
    panel.set_xlabel("$x$")
    panel.tick_params(labelsize=8.5)
