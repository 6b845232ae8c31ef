"""Figures of the studies `reproduce acceleration`, `convergence` and `varying`, for report.py."""

import figures as f
import page as h
import plotting as p

QUANTITIES = ("displacement", "velocity", "acceleration")
MARKS = ("circle", "square", "diamond", "triangle-down", "triangle-up", "pentagon")


def chart(lines, x, y, ticks=(), logarithmic=True):
    """Returns a small figure of lines by name, whose looks depend on their place in `lines`."""
    figure = f.new(290, x, y, margin=dict(t=14))
    figure.update_layout(showlegend=False)
    for k, (name, points) in enumerate(lines.items()):
        points = sorted((a, b) for a, b in points if not logarithmic or (a > 0 and b > 0))
        if points:
            xs, ys = zip(*points)
            figure.add_scatter(x=list(xs), y=list(ys), name=name, mode="lines+markers",
                               line=dict(color=f.cycle(k), width=1.6, dash=f.DASHES[k // 6 % 3]),
                               marker=dict(symbol=MARKS[k % 6], size=6))
    if logarithmic:
        figure.update_xaxes(type="log", dtick=2, tickfont_size=10)
        figure.update_yaxes(type="log", dtick=1, tickfont_size=10)
    if ticks:
        figure.update_xaxes(tickvals=list(ticks), ticktext=[f"{tick:g}" for tick in ticks],
                            dtick=None)
    return figure


def keys_of(names):
    """Returns the legend of lines in the order of their names."""
    return [(f.COLOURS[k % 6], ("line", "dash", "dot")[k // 6 % 3], name)
            for k, name in enumerate(names)]


def titled(figure, title):
    """Returns a figure as HTML with a title above it."""
    return h.figure(figure, title)


def acceleration(path, caption):
    """Returns figures of the error of the tip acceleration over the integrator's tolerance, one for
    each damping."""
    rows = p.read_table(path, "damping", "rtol", "formula", "rms_error")
    formulas = list(dict.fromkeys(row["formula"] for row in rows))
    charts = []
    for damping in dict.fromkeys(row["damping"] for row in rows):
        lines = {name: [(p.number(row, "rtol"), p.number(row, "rms_error")) for row in rows
                        if (row["damping"], row["formula"]) == (damping, name)]
                 for name in formulas}
        charts.append(titled(chart(lines, "relative tolerance", "rms error (ft/s²)"),
                             f"Damping c_D = {h.significant(float(damping), 3)} lb s/ft^2"))
    return h.panels(charts, caption, keys_of(f"formula {name}" for name in formulas))


def convergence(path, caption):
    """Returns figures of errors over the number of elements, one for each force and load."""
    rows = p.read_table(path, "force", "load", "N")
    names = [name for name in rows[0] if name.partition("_")[0] in QUANTITIES
             and not name.endswith(("order", "rate"))]
    if not names:
        p.fail(f"{path}: no column of errors, such as displacement_V")
    charts = []
    for case in dict.fromkeys((row["force"], row["load"]) for row in rows):
        mine = [row for row in rows if (row["force"], row["load"]) == case]
        lines = {name: [(p.number(row, "N"), p.number(row, name)) for row in mine if row[name]]
                 for name in names}
        meshes = sorted({p.number(row, "N", int) for row in mine})
        charts.append(titled(chart(lines, "number of elements <i>N</i>", "relative error", meshes),
                             f"Force: {case[0]}, load: {case[1]}"))
    return h.panels(charts, caption, keys_of(name.replace("_", ", norm ") for name in names))


def varying(path, caption):
    """Returns figures of the distances of E(x) and c_D(x) from the truth over the coefficients, and
    where the folder has them the functions on the finest mesh of the state."""
    rows = p.read_table(path, "problem", "N", "M", "parameter", "sup", "L2")
    cases = list(dict.fromkeys((row["problem"], row["parameter"]) for row in rows))
    meshes = list(dict.fromkeys(row["N"] for row in rows))
    charts = []
    for problem, parameter in cases:
        mine = [row for row in rows if (row["problem"], row["parameter"]) == (problem, parameter)]
        lines = {mesh: [(p.number(row, "M"), p.number(row, "L2")) for row in mine
                        if row["N"] == mesh] for mesh in meshes}
        ticks = sorted({p.number(row, "M", int) for row in mine})
        charts.append(titled(chart(lines, "coefficients <i>M</i>", "relative distance, <i>L</i>₂",
                                   ticks), f"{problem}: {parameter}(x)"))
    text = h.panels(charts, caption, keys_of(f"N = {mesh}" for mesh in meshes))
    beside = path.with_name("varying_functions.csv")
    if not beside.exists():
        return text
    curves = p.read_table(beside, "problem", "N", "M", "parameter", "x", "value", "truth")
    finest = max(curves, key=lambda row: p.number(row, "N", int))["N"]
    counts = list(dict.fromkeys(row["M"] for row in curves))
    charts = []
    for case in cases:
        mine = [row for row in curves if (row["problem"], row["parameter"], row["N"])
                == (*case, finest)]
        lines = {count: [(p.number(row, "x"), p.number(row, "value")) for row in mine
                         if row["M"] == count] for count in counts}
        figure = chart(lines, "<i>x</i>", h.symbol(f"{case[1]}(x)"), logarithmic=False)
        figure.update_traces(mode="lines")
        first = [row for row in mine if row["M"] == mine[0]["M"]]
        f.add_line(figure, [p.number(row, "x") for row in first],
                   [p.number(row, "truth") for row in first], "truth", f.colour("ink"), width=2.4)
        charts.append(titled(figure, f"{case[0]}: {case[1]}(x), N = {finest}"))
    return text + h.panels(charts, "The functions that the fits find, and the truth.", [
        *keys_of(f"M = {count}" for count in counts), ("ink", "line", "truth")])
