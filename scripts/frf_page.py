"""Frequency response functions (FRFs) for report.py: the section of a fit, and the page of the
command frf."""

import math

import figures as f
import frf_outputs as o
import numpy as np
import page as h
import plotting as p

CIRCLES = 4    # modes whose Nyquist circles are shown, at most
LEVELS = {"sd": "The line is the noise level that the record states.",
          "coherence": "The line is the noise level from the coherence and the number of averages, "
                       f"a moving average over {o.SMOOTHED} lines.",
          "residuals": "The line is their rms value: the record has neither a coherence with a "
                       "number of averages nor a standard deviation."}


def responses(folder, curve):
    """Draws magnitude and phase of measurement and model, the residuals and the coherence. Returns
    the figure, and what the noise level rests on."""
    quantity, unit = folder.quantity(curve.record), folder.unit(curve.record)
    rows = ["magnitude", "phase", *["residual"] * (curve.residual is not None),
            *["coherence"] * (curve.coherence is not None)]
    weights = {"magnitude": 2.2, "phase": 1.2, "residual": 1.4, "coherence": 0.9}
    titles = {"magnitude": f.label(quantity, unit), "phase": "phase (°)",
              "residual": f.label("residual", unit), "coherence": "coherence"}
    figure = f.stacked([weights[name] for name in rows], "frequency (Hz)",
                       [titles[name] for name in rows],
                       110 + round(100 * sum(weights[name] for name in rows)))
    add_magnitudes(figure, curve, folder.modes(curve), folder.word(curve))
    if curve.measured is not None:
        phase = o.degrees(curve.measured)
        few = len(curve.f) < f.MARKED
        f.add_record(figure, *((curve.f, phase) if few else o.wrapped(curve.f, phase)), "measured",
                     row=2)
    line(figure, *o.wrapped(curve.f, o.degrees(curve.model)), model_name(curve), "blue", 2)
    figure.update_yaxes(range=[-190, 190], dtick=90, row=2)
    level, basis = o.noise_level(curve, folder.averages(curve.record))
    if curve.residual is not None:
        size = np.maximum(np.abs(curve.residual), 1e-300)
        figure.add_scatter(x=f.numbers(curve.f), y=f.numbers(size), mode="markers",
                           name="|measured − model|", row=3, col=1,
                           marker=dict(color=f.colour("vermilion"), size=3))
        line(figure, curve.f, level, "noise level", "ink", 3)
        low = max(np.nanpercentile(size, 1) / 3, 1e-6 * np.nanmax(np.abs(curve.model)))
        high = 2 * max(np.nanmax(size), np.nanmax(level), low)
        figure.update_yaxes(type="log", row=3, range=[math.log10(low), math.log10(high)], dtick=1)
    if curve.coherence is not None:
        line(figure, curve.f, curve.coherence, "coherence", "purple", len(rows))
        figure.update_yaxes(range=[0, 1.05], row=len(rows))
    figure.update_xaxes(range=[float(curve.f[0]), float(curve.f[-1])])
    f.hide_repeated(figure)
    return figure, basis


def model_name(curve):
    """Returns the entry of the model in the legend."""
    return f"model, <i>N</i> = {curve.elements}"


def line(figure, x, y, name, tone, row):
    """Adds a curve with a break where it contains NaN."""
    figure.add_scatter(x=f.numbers(x), y=f.numbers(y), name=name, mode="lines", row=row, col=1,
                       line=dict(color=f.colour(tone), width=1.3))


def add_magnitudes(figure, curve, modes, word):
    """Adds the panel of magnitudes, with the modes as dashed lines."""
    ends = [np.abs(curve.model)]
    if curve.band is not None:
        f.add_band(figure, curve.f, *(np.maximum(end, 1e-300) for end in curve.band),
                   "95 % band of the model", row=1)
    if curve.measured is not None:
        ends.append(np.abs(curve.measured))
        f.add_record(figure, curve.f, np.maximum(ends[-1], 1e-300), "measured", row=1)
    line(figure, curve.f, np.maximum(ends[0], 1e-300), model_name(curve), "blue", 1)
    positive = np.concatenate([end[end > 0] for end in ends])
    low, high = 0.5 * np.percentile(positive, 0.5), 2.5 * positive.max()
    for number, frequency in modes:
        figure.add_scatter(x=[frequency, frequency], y=[low, high], mode="lines", row=1, col=1,
                           line=dict(color=f.colour("green"), width=1, dash="dash"),
                           name=f"{word}s",
                           hovertemplate=f"{word} {number} at %{{x:.5g}} Hz<extra></extra>")
        figure.add_annotation(x=frequency, y=1, yref="y domain", text=f"{number}", xanchor="left",
                              yanchor="top", xshift=1, showarrow=False,
                              font=dict(color=f.colour("green"), size=11))
    figure.update_yaxes(type="log", range=[math.log10(low), math.log10(high)], dtick=1, row=1)


def nyquist(curve, frequency, unit):
    """Draws the Nyquist circle of a mode with equal scales of both axes. Returns the figure, and
    the frequencies of its lines."""
    part, top = o.circle(curve, frequency)
    figure = f.new(340, f.label("real part", unit), f.label("imaginary part", unit))
    fine, values = o.between(curve.f[part], curve.model[part])
    figure.add_scatter(x=f.numbers(values.real), y=f.numbers(values.imag), mode="lines",
                       name="model", customdata=f.numbers(fine),
                       hovertemplate="%{customdata:.5g} Hz<extra>model</extra>",
                       line=dict(color=f.colour("blue"), width=1.5))
    if curve.measured is not None:
        measured = curve.measured[part]
        figure.add_scatter(x=f.numbers(measured.real), y=f.numbers(measured.imag), mode="markers",
                           name="measured", customdata=f.numbers(curve.f[part]),
                           hovertemplate="%{customdata:.5g} Hz<extra>measured</extra>",
                           marker=dict(color=f.colour("ink"), size=5))
    at = curve.model[top]
    figure.add_scatter(x=[at.real], y=[at.imag], mode="markers", name="peak",
                       marker=dict(color=f.colour("green"), size=9),
                       hovertemplate=f"{curve.f[top]:.5g} Hz<extra>peak</extra>")
    figure.update_yaxes(scaleanchor="x", scaleratio=1, nticks=8)
    figure.update_xaxes(nticks=8)
    return figure, curve.f[part]


def figures_of(folder, curve):
    """Returns the figures of one FRF with their captions."""
    unit, modes = folder.unit(curve.record), folder.modes(curve)
    several = f" of record {curve.record}" * (len(folder.curves) > 1)
    figure, basis = responses(folder, curve)
    measured = curve.measured is not None
    who = "measurement and model" if measured else "model"
    word = folder.word(curve)
    caption = f"Frequency response{several}: magnitude and phase of the {who}. Dashed: the {word}s."
    if curve.residual is not None:
        caption += (" Below: magnitudes of the residuals, for real and imaginary part together. "
                    + LEVELS[basis])
    if curve.coherence is not None:
        caption += " The coherence is that of the measurement."
    text = h.figure(figure, caption)
    charts = []
    for number, frequency in o.highest(curve, modes, CIRCLES):
        circle, lines = nyquist(curve, frequency, unit)
        charts.append(h.figure(circle, f"{word.capitalize()} {number}: "
                               f"{p.plain_number(lines[0], 5)} to "
                               f"{p.plain_number(lines[-1], 5)} Hz"))
    return text + h.panels(charts, f"Nyquist circles{several}: imaginary over real part around the "
                           "highest peaks. Between the lines, the model's curve is interpolated.")


def section(outputs):
    """Returns the figures of all FRFs of a fit; empty without an FRF."""
    if not outputs.has("frf.csv"):
        return ""
    folder = o.Folder(outputs.folder)
    return "".join(figures_of(folder, curve) for curve in folder.finest())


def computed(outputs):
    """Returns the verdict box and the sections of the command frf."""
    folder = o.Folder(outputs.folder)
    curves = list(folder.finest())
    cells, points = [], []
    for curve in curves:
        for number, frequency in folder.modes(curve):
            size = abs(curve.model[np.argmin(np.abs(curve.f - frequency))])
            cells.append([*[f"{curve.record}"] * (len(curves) > 1), f"{number}",
                          h.significant(frequency, 6), folder.quantity(curve.record),
                          h.significant(size), h.raised(folder.unit(curve.record))])
    first = curves[0]
    points.append("Mesh: " + ", ".join(map(str, folder.curves[first.record])) + " elements.")
    if any(curve.band is not None for curve in curves):
        points.append("The 95 % band is that of the fitted parameters.")
    box = h.box("good", f"The frequency response is computed at {len(first.f)} frequencies, "
                f"{p.plain_number(first.f[0], 5)} to {p.plain_number(first.f[-1], 5)} Hz.", points)
    peaks = h.table([*["record"] * (len(curves) > 1), folder.word(first), "frequency (Hz)",
                     "quantity", "magnitude", "unit"], [cells])
    text = "".join(figures_of(folder, curve) for curve in curves)
    return box, [("frf", "Frequency response", text + "<h3>Peaks</h3>\n" + peaks)]
