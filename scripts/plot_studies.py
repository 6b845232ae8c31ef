"""Pictures of the studies `reproduce acceleration` and `reproduce convergence`; for report.py."""

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
