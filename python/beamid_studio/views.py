"""Figures of the page: the report's, and those of a record before a fit."""
from __future__ import annotations

import copy
import html
import re
from functools import lru_cache
from typing import Any

import figures as f
import numpy as np
import page as h
import signals as s

#: Columns of a curve through the extremes of a long record.
COLUMNS = 900
SEGMENTS = 80        #: columns of a spectrogram
LEAST_SEGMENT = 64   #: samples of a segment
MOST_SEGMENT = 4096


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
