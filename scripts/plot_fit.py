#!/usr/bin/env python3
"""Plots a fit -> DIR/fit.png: record and model, a few cycles of it, residuals, their
autocorrelation, spectra, estimates. Of several records the second one goes to fit_2.png, ..."""

import math
import re
from pathlib import Path

import plotting as p
import signals as s
import numpy as np

# How the motion began, and coefficients of E(x) and c_D(x): of no interest in themselves.
NUISANCE = re.compile(r"(cos|sin)_\d+|(E|c_D)\.\d+$")
MARKED = 400                               # fewer samples are marked one by one
LEAST = 8                                  # fewer samples have no spectrum worth the name


def read_fit(directory):
    """fit.csv as arrays (t, measured, model, residual, standard deviation of the model or nan), by
    record and by number of elements."""
    path = directory / "fit.csv"
    columns, names = ("t", "measured", "model", "residual"), p.header(path)
    with_record = "record" in names
    values = s.read_columns(path, "elements", *columns, *["record"] * with_record)
    record = values[5].astype(int) if with_record else np.ones(values.shape[1], dtype=int)
    elements = values[0].astype(int)
    values[0] = np.nan
    if "model_sd" in names:    # empty where the record leaves something undetermined
        values[0] = np.genfromtxt(path, delimiter=",", skip_header=1,
                                  usecols=names.index("model_sd"))
    values = values[[1, 2, 3, 4, 0]]
    return {r: {n: values[:, (record == r) & (elements == n)]
                for n in map(int, np.unique(elements[record == r]))}
            for r in map(int, np.unique(record))}


def read_units(directory):
    """labels.csv as unit by quantity; empty without the file."""
    path = directory / "labels.csv"
    if not path.exists():
        return {}
    return {row["quantity"]: row["unit"] for row in p.read_table(path, "quantity", "unit")}


def read_modes(directory, elements, record):
    """Frequencies of the fitted structure from modes.csv; empty where that is of another run."""
    path = directory / "modes.csv"
    if not path.exists() or "record" not in p.header(path):
        return []
    return [p.number(row, "frequency_hz")
            for row in p.read_table(path, "elements", "record", "frequency_hz", "damping_ratio")
            if (row["elements"], row["record"]) == (str(elements), str(record))
            and p.number(row, "damping_ratio") < 1]


def white(directory, elements, samples):
    """Whether the residuals of all records pass the program's test for white noise."""
    path = directory / "autocorrelation.csv"
    if not path.exists():
        return True
    rows = p.read_table(path, "elements", "autocorrelation")
    r = np.array([p.number(row, "autocorrelation") for row in rows
                  if row["elements"] == str(elements)])[:max(1, samples // 10)]
    if not r.size:
        return True
    k = 1 + np.arange(r.size)
    ljung_box = samples * (samples + 2) * np.sum(r**2 / (samples - k))
    spread = 2 / (9 * r.size)    # chi-square's 95 % point by Wilson and Hilferty
    return ljung_box < r.size * (1 - spread + 1.645 * math.sqrt(spread))**3


def estimate_text(row, ends):
    """The value with its unit; the 95 % interval, or why there is none; the colour of that."""
    digits, note, colour = 5, "", p.GREY
    if (row.get("determined") or "").strip().lower() == "no":
        note, colour = "not determined by this record", p.VERMILION
    elif row.get(ends[0]) and row.get(ends[1]):
        low, high = (p.number(row, end) for end in ends)
        if high > low:    # two digits of the width, and of the value as many as of its interval
            largest = max(abs(low), abs(high))
            digits = min(max(2 + math.ceil(math.log10(largest / (high - low))), 3), 12)
        note = f"{p.number_text(low, digits)} to {p.number_text(high, digits)}"
    value = p.number_text(p.number(row, "estimate"), max(digits, 5))
    return f"{value} {p.unit_text(row.get('unit'))}", note, colour


def estimate_lines(rows, ends, facts):
    """Lines of the panel of estimates: symbol, text, colour, space below."""
    lines = []
    compact = len(rows) > 6    # what is beside the point in short then, and not all
    nuisance = [row for row in rows if NUISANCE.match(row["parameter"])]
    hidden = nuisance[max(0, 20 - len(rows) + len(nuisance)):] if compact else []
    for row in sorted(rows, key=lambda row: (row["parameter"].startswith("J"), row in nuisance)):
        if any(row is other for other in hidden):
            continue
        value, note, colour = estimate_text(row, ends)
        symbol = p.symbol(row["parameter"].partition("(")[0])
        if compact and row in nuisance and colour == p.GREY:
            note = ""
        lines.append((symbol, value, "black", 0.9 if note else 1.15 if compact else 1.4))
        if note:
            lines.append(("", note, colour, 1.4))
    if hidden:
        lines.append(("", f"and {len(hidden)} more", p.GREY, 1.15))
    return lines + [(symbol, text, "black", 1.15) for symbol, text in facts]


def draw_estimates(axes, rows, corrected, facts):
    """The panel of estimates: value and unit, below it the interval; then J and the samples.

    A parameter has its total interval, which includes every source of error; amplitudes and offsets
    have that of the noise."""
    axes.set_axis_off()
    suffix = "_corrected" if corrected and any(row.get("lower95_corrected") for row in rows) else ""
    noise = [end + suffix for end in ("lower95", "upper95")]
    total = ["total_lower95", "total_upper95"]
    rows = [{**row, "low": row.get(total[0]) or row.get(noise[0]),
             "high": row.get(total[1]) or row.get(noise[1])} for row in rows]
    ends = ["low", "high"]
    intervals = any(row["low"] for row in rows)
    axes.set_title("Estimates" + ", 95 % intervals" * intervals)
    if any(row.get(total[0]) for row in rows):
        axes.text(0, 1, "of parameters: with every source of error that the case states",
                  va="top", fontsize=8.5, color=p.GREY)
    lines = estimate_lines(rows, ends, facts)
    step = min(0.055, 0.96 / sum(line[3] for line in lines))
    y = 0.93
    for name, text, colour, space in lines:
        size = 10 if colour == "black" else 8.5
        axes.text(0.0, y, name, va="baseline", fontsize=10.5)
        axes.text(0.2, y, text, va="baseline", fontsize=size, color=colour)
        y -= space * step


def draw_overview(axes, t, measured, model, elements):
    """Record and model; where there are too many samples for dots, the extremes of each column."""
    many = len(t) > 3000
    size = 5 if len(t) < MARKED else 2.5
    axes.plot(*s.envelope(t, measured), *["-"] * many, *["."] * (not many), color="black",
              markersize=size, linewidth=1.6, zorder=1 if many else 3, label="record")
    gap = 20 * np.median(np.diff(t)) if len(t) > 1 else 0.0
    axes.plot(*across(*s.envelope(t, model), gap), color=p.BLUE, linewidth=0.7 if many else 1.4,
              zorder=2, label=f"model, $N$ = {elements}")


def across(t, values, least=0.0):
    """The same with nothing where the record has a gap, so that no line is drawn across it."""
    steps = np.diff(t)
    typical = 20 * np.median(steps[steps > 0]) if (steps > 0).any() else 0.0
    gaps = 1 + np.flatnonzero(steps > max(typical, least))
    return np.insert(t, gaps, np.nan), np.insert(values, gaps, np.nan)


def draw_zoom(axes, t, measured, model, span, unit):
    """A few cycles, sample by sample."""
    part = (t >= span[0]) & (t <= span[1])
    axes.plot(t[part], measured[part], ".", color="black",
              markersize=float(np.clip(1500 / part.sum(), 1.5, 5)), zorder=2)
    axes.plot(*across(t[part], model[part]), color=p.BLUE, linewidth=1.1, zorder=3)
    axes.set_title(f"a few cycles of the lowest mode seen, {4 / (span[1] - span[0]):.3g} {unit}",
                   fontsize=9, color=p.GREY)
    axes.set_xlim(*span)


def draw_meshes(axes, meshes, chosen):
    """Residuals of all meshes; of many samples how far their models are from the one chosen."""
    t, _, best, difference, _ = meshes[chosen]
    few = len(t) < MARKED
    for k, n in enumerate(n for n in meshes if n != chosen):
        axes.plot(*s.envelope(t, meshes[n][3] if few else meshes[n][2] - best), linewidth=0.9,
                  color=p.COLOURS[1 + k % 5], linestyle=("-", "--", ":")[k // 5 % 3],
                  label=f"$N$ = {n}" if few else f"model at $N$ = {n} less that at {chosen}")
    if few:
        axes.plot(t, difference, color=p.BLUE, linewidth=1.6, label=f"$N$ = {chosen}")


def draw_spectra(axes, t, measured, model, residual, modes):
    """Amplitude spectra, both axes logarithmic, and where the modes of the fit are."""
    if len(t) < LEAST:
        axes.set_axis_off()
        return
    f, *amplitudes = s.spectrum(t, measured, model, residual)
    styles = (("record", "black", 1.6), ("model", p.BLUE, 1.0), ("residual", p.VERMILION, 0.9))
    for amplitude, (label, colour, width) in zip(amplitudes, styles):
        axes.loglog(*s.highest(f, amplitude), color=colour, linewidth=width, label=label)
    top = max(amplitude.max() for amplitude in amplitudes[:2])
    floor = min(np.percentile(amplitude, 20) for amplitude in amplitudes[::2])
    if top > 0:
        axes.set_ylim(max(floor / 3, 1e-8 * top, 1e-300), 2.5 * top)
    axes.set_xlim(f[0], f[-1])
    p.plain_logarithmic(axes.xaxis)
    p.mark_frequencies(axes, [mode for mode in modes if f[0] < mode < f[-1]])


def draw_autocorrelation(axes, residual, lags):
    """Autocorrelation of the residuals and the band that holds 95 % of it for white noise."""
    if len(residual) < LEAST:
        axes.set_axis_off()
        return
    r, band = s.autocorrelation(residual, lags), 1.96 / math.sqrt(len(residual))
    k = 1 + np.arange(lags)
    axes.axhspan(-band, band, color=p.SKY, alpha=0.35, linewidth=0)
    axes.axhline(0, color=p.GREY, linewidth=0.8)
    if lags <= 60:
        axes.vlines(k, 0, r, color=p.VERMILION, linewidth=1.4)
    axes.plot(k, r, "." if lags <= 60 else "-", color=p.VERMILION, linewidth=1.1)
    axes.set(xlabel="lag (samples)", xlim=(0, lags + 1), ylim=(min(-0.3, 1.1 * r.min()), 1))
    axes.set_title("autocorrelation of the residuals\nblue: 95 % band of white noise", fontsize=9,
                   color=p.GREY)


def draw(directory, meshes, chosen, rows, corrected, record=1, of=1):
    """The figure of one record: fit, zoom, residuals (of all meshes if several), spectra."""
    units = read_units(directory)
    acceleration, residual, between, amplitude = (
        p.with_unit(quantity, units.get("acceleration"))
        for quantity in ("acceleration", "residual", "difference", "amplitude"))
    time = p.with_unit("time", units.get("time"))
    hertz = p.frequency_unit(units.get("time"))
    t, measured, model, difference, _ = meshes[chosen]
    few = len(t) < MARKED
    several, span = len(meshes) > 1, s.some_cycles(t, measured)
    names = ["fit", *["zoom"] * bool(span), "residual", *["meshes"] * several, "spectra"]
    heights = {"fit": 2.2, "zoom": 1.8, "residual": 1.0, "meshes": 1.2, "spectra": 2.1}

    total = sum(heights[name] for name in names)
    figure = p.plt.figure(figsize=(11, 1.45 * total + 0.6))
    grid = figure.add_gridspec(len(names), 2, height_ratios=[heights[name] for name in names],
                               width_ratios=[2.9, 1])
    figure.get_layout_engine().set(wspace=0.03)
    which = f", record {record} of {of}" if of > 1 else ""
    figure.suptitle(f"Acceleration and fitted model: {p.case_name(directory)}{which}", x=0.01,
                    ha="left")
    panels = {name: figure.add_subplot(grid[k, 0]) for k, name in enumerate(names)}
    draw_overview(panels["fit"], t, measured, model, chosen)
    panels["fit"].set_ylabel(acceleration)
    if span:
        draw_zoom(panels["zoom"], t, measured, model, span, hertz)
        panels["zoom"].set_ylabel(acceleration)
    panels["residual"].axhline(0, color=p.GREY, linewidth=0.8)
    panels["residual"].plot(*s.envelope(t, difference), color=p.BLUE, marker="." if few else "",
                            markersize=4, linewidth=0.9 if few else 0.6,
                            label=f"record $-$ model, $N$ = {chosen}")
    panels["residual"].set_ylabel(residual)
    if several:
        draw_meshes(panels["meshes"], meshes, chosen)
        panels["meshes"].set_ylabel(residual if few else between)
    draw_spectra(panels["spectra"], t, measured, model, difference,
                 read_modes(directory, chosen, record))
    panels["spectra"].set_xlabel(p.with_unit("frequency", hertz))
    panels["spectra"].set_ylabel(amplitude)
    in_time = [panels[name] for name in names if name in ("fit", "residual", "meshes")]
    margin = 0.01 * (t[-1] - t[0] or 1.0)
    for panel in in_time:
        panel.set_xlim(t[0] - margin, t[-1] + margin)
        panel.tick_params(labelbottom=panel is in_time[-1] or (bool(span) and panel is in_time[0]))
    in_time[-1].set_xlabel(time)
    for name in set(names) - {"zoom"}:
        if not panels[name].lines:
            continue
        panels[name].legend(loc="lower left", bbox_to_anchor=(0.07, 0.98), ncols=8,
                            columnspacing=0.9, handlelength=1.2, handletextpad=0.5,
                            borderaxespad=0)
    figure.align_ylabels(list(panels.values()))

    facts = [("$N$", f"{chosen} elements"), ("$n$", f"{len(t)} samples")]
    if of > 1:
        unit = p.unit_text(units.get("acceleration"))
        facts += [("rms", f"{math.sqrt(np.mean(difference**2)):.3g} {unit}, this record"),
                  ("", "J is that of all records")]
    draw_estimates(figure.add_subplot(grid[:-1, 1]), rows, corrected, facts)
    mode = s.lowest_mode(t, measured) if len(t) >= s.FEW else None
    lags = int(len(t) / (t[-1] - t[0]) / mode) if mode else 0
    draw_autocorrelation(figure.add_subplot(grid[-1, 1]), difference,
                         max(1, min(max(lags, 20), len(t) // 2)))
    return figure


def pictures(directory, chosen=None):
    """The figures of an output folder, one for each record, for the mesh chosen or the finest."""
    if not (directory / "fit.csv").exists() and (directory / "frf.csv").exists():
        p.fail(f"{directory}: found no fit.csv, but frf.csv, which plot_frf.py draws")
    if (directory / "fit.csv").exists() and not p.has_rows(directory / "fit.csv"):
        if (directory / "frf.csv").exists():    # a fit of frequency responses alone
            import plot_frf
            yield from plot_frf.pictures(directory, chosen)
            return
        if (directory / "modal_fit.csv").exists():
            p.fail(f"{directory}: found a fit of modes alone, which has no curve: report.py shows "
                   "it, and plot_modes.py draws the mode shapes")
    records = read_fit(directory)
    meshes = next(iter(records.values()))
    chosen = max(meshes) if chosen is None else chosen
    if chosen not in meshes:
        found = ", ".join(map(str, meshes))
        p.fail(f"{directory / 'fit.csv'}: no fit with {chosen} elements (found: {found})")
    rows = p.last_stage(directory).get(chosen)
    if not rows:
        p.fail(f"{directory / 'estimates.csv'}: no estimates for {chosen} elements")
    samples = sum(meshes[chosen].shape[1] for meshes in records.values())
    corrected = not white(directory, chosen, samples)
    for record, meshes in records.items():    # names end in (2) for what belongs to record 2 alone
        mine = [row for row in rows if not re.search(r"\(\d+\)$", row["parameter"])
                or row["parameter"].endswith(f"({record})")]
        yield draw(directory, meshes, chosen, mine, corrected, record, len(records))


def main():
    parser = p.new_parser(__doc__.replace("\n", " "))
    parser.add_argument("directory", metavar="DIR", type=p.outputs, help="output folder of a fit")
    parser.add_argument("--elements", metavar="N", type=int, help="mesh to show (default: finest)")
    parser.add_argument("--out", metavar="FILE", help="picture to write (default: DIR/fit.png)")
    arguments = parser.parse_args()

    path = Path(arguments.out or arguments.directory / "fit.png")
    for k, figure in enumerate(pictures(arguments.directory, arguments.elements)):
        p.save(figure, p.numbered(path, k + 1))


if __name__ == "__main__":
    main()
