"""Figures of the page: the report's, and those of a record before a fit."""
from __future__ import annotations

import copy
import html
import re
from functools import lru_cache
from typing import Any

import figures as f
import frf_outputs
import numpy as np
import page as h
import signals as s

#: Columns of a curve through the extremes of a long record.
COLUMNS = 900
SEGMENTS = 80        #: columns of a spectrogram
LEAST_SEGMENT = 64   #: samples of a segment
MOST_SEGMENT = 4096
TOOLS = 36           #: pixels that the tools of a figure need


def colours(style: str) -> dict[str, str]:
    """Return the variables of a style sheet of the report by name."""
    return dict(re.findall(r"(--[a-z-]+): ([^;]+);", style))


THEMES = {False: colours(h.LIGHT), True: colours(h.DARK)}


def themed(spec: Any, dark: bool) -> Any:
    """Return a figure with the colours of a light or a dark page in place of variables."""
    if isinstance(spec, str):
        return re.sub(r"var\((--[a-z-]+)\)", lambda match: THEMES[dark][match[1]], spec)
    if isinstance(spec, dict):
        return {key: themed(item, dark) for key, item in spec.items()}
    if isinstance(spec, (list, tuple)):
        return [themed(item, dark) for item in spec]
    return spec


def plotly(figure: Any, dark: bool) -> dict[str, Any]:
    """Return a figure of the report as the page draws it."""
    spec = figure if isinstance(figure, dict) else figure.to_plotly_json()
    spec = themed(spec, dark)
    # The tools of a figure stand beside its curves.
    margin = spec["layout"].get("margin", {})
    spec["layout"]["margin"] = {**margin, "r": max(margin.get("r", 0), TOOLS)}
    spec["config"] = {"displaylogo": False, "responsive": True, "modeBarButtonsToRemove": [
        "select2d", "lasso2d", "autoScale2d"]}
    return dict(spec)


def shown(text: str) -> str:
    """Return a text of the user for a figure: Plotly takes some marks for markup."""
    return html.escape(" ".join(text.split()), quote=False)


@lru_cache(maxsize=8)
def frame(label: str, unit: str) -> Any:
    """Return the figure of a record without its samples: the same for every window and zoom."""
    figure = f.new(330, f.label("time", "s"), f.label(shown(label), shown(unit)),
                   margin=dict(t=14))
    for name, tone in (("record", "grey"), ("window", "blue")):
        figure.add_scatter(name=name, line=dict(color=f.colour(tone), width=1),
                           marker=dict(color=f.colour(tone), size=4), hoverinfo="x+y")
    figure.add_vrect(x0=0, x1=1, fillcolor=f.colour("band"), opacity=0.35,
                     line=dict(color=f.colour("blue"), width=1), layer="below")
    figure.update_layout(showlegend=False, selectdirection="h",
                         newselection=dict(line=dict(color=f.colour("blue"), width=1)))
    figure.update_yaxes(fixedrange=True)
    return figure.to_plotly_json()


def record(t: np.ndarray, values: np.ndarray, window: tuple[float, float], *, label: str, unit: str,
           view: tuple[float, float] | None, mode: str) -> Any:
    """Return the figure of a record and the window of the fit.

    view  times that the figure shows; None: all
    mode  what dragging does: "select" sets the window, "zoom" shows a part
    """
    figure = copy.deepcopy(frame(label, unit))
    low, high = view or (float(t[0]), float(t[-1]))
    first, last = np.searchsorted(t, [low, high], side="left")
    part = slice(max(int(first) - 1, 0), min(int(last) + 1, len(t)))
    x, y = s.envelope(t[part], values[part], COLUMNS)
    inside = (x >= window[0]) & (x <= window[1])
    for trace, seen in zip(figure["data"], (slice(None), inside)):
        trace |= dict(x=x[seen], y=y[seen], mode="lines+markers" if part.stop - part.start
                      < f.MARKED else "lines")
    layout = figure["layout"]
    layout["xaxis"]["range"] = [low, high]
    layout["shapes"][0] |= dict(x0=window[0], x1=window[1])
    layout |= dict(dragmode=mode, selections=[], uirevision=f"{mode}{low}{high}")
    return figure


def spectrum(t: np.ndarray, values: np.ndarray) -> Any:
    """Return frequencies and amplitudes of the window; None if it is too short."""
    return s.spectrum(t, values) if len(t) >= 16 and t[-1] > t[0] else None


def spectrum_figure(known: Any, modes: np.ndarray, units: Any) -> Any:
    """Return the figure of the spectrum with the frequencies of the model as it stands."""
    figure = f.spectra(None, [None], list(modes), units, ["record"], known)
    figure.update_layout(height=330, showlegend=False, margin=dict(t=18))
    return figure


def spectrogram(samples: tuple[np.ndarray, np.ndarray], modes: np.ndarray) -> Any:
    """Return the figure of the spectra of segments, which shows what changes during the motion.

    samples  times and values of the window
    """
    t, values = samples
    count = int(np.clip(len(t) // LEAST_SEGMENT, 1, SEGMENTS))
    length = int(np.clip(2 * len(t) // (count + 1), LEAST_SEGMENT, MOST_SEGMENT))
    starts = np.unique(np.linspace(0, max(len(t) - length, 0), count).astype(int))
    centres, columns, frequencies = [], [], None
    for start in starts:
        part = slice(start, start + length)
        if len(t[part]) < 16:
            continue
        own, amplitude = s.spectrum(t[part], values[part])
        frequencies = own if frequencies is None else frequencies
        columns.append(np.interp(frequencies, own, amplitude))
        centres.append(0.5 * (t[part][0] + t[part][-1]))
    figure = f.new(330, f.label("time", "s"), f.label("frequency", "Hz"), margin=dict(t=14))
    if frequencies is None:
        return figure
    # A heat map needs no more rows than the screen has.
    step = max(1, len(frequencies) // 400)
    rows = len(frequencies) // step * step
    z = np.array(columns)[:, :rows].reshape(len(columns), -1, step).max(axis=2).T
    decibels = 20 * np.log10(np.maximum(z / max(z.max(), 1e-300), 1e-6))
    figure.add_heatmap(x=np.array(centres), y=frequencies[:rows:step], z=np.round(decibels, 1),
                       zmin=-80, zmax=0, colorscale="Viridis",
                       colorbar=dict(title=dict(text="dB"), thickness=12, outlinewidth=0),
                       hovertemplate="%{x:.4g} s, %{y:.4g} Hz: %{z} dB<extra></extra>")
    top = float(frequencies[-1])
    for k, mode in enumerate(mode for mode in modes if mode < top):
        figure.add_hline(y=float(mode), line=dict(color="rgba(255,255,255,.7)", width=1,
                                                  dash="dash"), annotation_text=f"{k + 1}",
                         annotation_font_color="#ffffff", annotation_position="top left")
    return figure


def response(frequencies: np.ndarray, values: np.ndarray, modes: np.ndarray, *,
             window: tuple[float, float], label: str, view: tuple[float, float] | None = None,
             mode: str = "zoom") -> Any:
    """Return the figure of a frequency response: magnitude and phase, with the model's frequencies.

    window     frequencies of the fit
    label      quantity of the response with its unit
    view, mode  as `record` takes them
    """
    figure = f.stacked([0.64, 0.36], "frequency (Hz)", [label, "phase (°)"], 430)
    magnitude = np.maximum(np.abs(values), 1e-300)
    inside = (frequencies >= window[0]) & (frequencies <= window[1])
    for tone, seen in (("grey", slice(None)), ("blue", inside)):
        x = frequencies[seen]
        if len(x) > 1:
            f.add_line(figure, x, magnitude[seen], "", f.colour(tone), row=1)
            turned = frf_outputs.wrapped(x, frf_outputs.degrees(values[seen]))
            figure.add_scatter(x=f.numbers(turned[0]), y=f.numbers(turned[1]), mode="lines",
                               line=dict(color=f.colour(tone), width=1.2), row=2, col=1)
    low, high = view or (float(frequencies[0]), float(frequencies[-1]))
    bottom, top = 0.5 * np.nanpercentile(magnitude, 0.5), 2.5 * np.nanmax(magnitude)
    for k, frequency in enumerate(modes, 1):
        if not low < frequency < high:
            continue
        for row, ends in ((1, [bottom, top]), (2, [-185, 185])):
            figure.add_scatter(x=[frequency] * 2, y=ends, mode="lines", row=row, col=1,
                               line=dict(color=f.colour("green"), width=1, dash="dash"),
                               hovertemplate=f"mode {k} at %{{x:.5g}} Hz<extra></extra>")
        figure.add_annotation(x=frequency, y=1, yref="y domain", text=f"{k}", showarrow=False,
                              xanchor="left", yanchor="top", xshift=1,
                              font=dict(color=f.colour("green"), size=11))
    figure.update_yaxes(type="log", range=[np.log10(bottom), np.log10(top)], row=1)
    figure.update_yaxes(range=[-190, 190], dtick=90, row=2)
    figure.update_yaxes(fixedrange=True)
    figure.update_xaxes(range=[low, high])
    if mode == "select":
        figure.add_vrect(x0=window[0], x1=window[1], fillcolor=f.colour("band"), opacity=0.35,
                         line=dict(color=f.colour("blue"), width=1), layer="below")
    figure.update_layout(showlegend=False, selectdirection="h", dragmode=mode, selections=[],
                         margin=dict(t=18), uirevision=f"{mode}{low}{high}",
                         newselection=dict(line=dict(color=f.colour("blue"), width=1)))
    return figure


def modal(table: Any, modes: np.ndarray, damping: np.ndarray) -> Any:
    """Return the figure of measured modes with 95 % error bars beside those of the model.

    table  measured modes; without numbers, each is compared with the nearest mode of the model
    """
    measured = np.asarray(table.frequencies, float)
    numbered = table.modes is not None and np.isfinite(table.modes).all()
    places = (np.asarray(table.modes, int) - 1 if numbered else
              np.abs(measured[:, None] - modes).argmin(axis=1) if len(modes) else
              np.argsort(np.argsort(measured)))
    known = (places >= 0) & (places < len(modes))
    panels = [("frequency (Hz)", measured, table.sd, modes)]
    if len(modes):
        own = modes[places[known]]
        panels.append(("measured − model (%)", 100 * (measured[known] / own - 1),
                       100 * np.asarray(table.sd)[known] / own, np.zeros(len(modes))))
    if table.damping is not None:
        panels.append(("damping ratio", table.damping, table.sd_damping, damping))
    figure = f.stacked([1.0] * len(panels), "mode", [title for title, *_ in panels],
                       110 + 170 * len(panels))
    for row, (title, values, sd, model) in enumerate(panels, 1):
        at = places[known] if title.endswith("(%)") else places
        own = np.unique(at[at < len(model)])
        figure.add_scatter(x=own + 1, y=model[own], mode="markers", name="model", row=row, col=1,
                           showlegend=row == 1, hovertemplate="%{y:.5g}<extra>model</extra>",
                           marker=dict(symbol="line-ew", size=26, line=dict(
                               color=f.colour("green"), width=2)))
        bars = None if sd is None else dict(array=1.96 * np.asarray(sd), color=f.colour("ink"))
        figure.add_scatter(x=at + 1, y=values, error_y=bars, mode="markers", row=row, col=1,
                           name="measured, 95 %", showlegend=row == 1,
                           hovertemplate="%{y:.5g}<extra>measured</extra>",
                           marker=dict(color=f.colour("ink"), size=6))
        if not title.endswith("(%)"):
            figure.update_yaxes(rangemode="tozero", row=row)
    figure.update_xaxes(dtick=1, range=[0.5, max(places.max(initial=0), 0) + 1.5])
    return figure
