"""Figures of the reports, by Plotly. Colours are variables of the page's style sheet (page.py).

Every function returns a figure without a title; the caption says what it shows. Legends stand above
the plotted area, so that they never cover data.
"""

import math

import numpy as np
import signals as s
from page import raised, scaled_unit, symbol
from program import need

need("plotly")

import plotly.graph_objects as go  # noqa: E402
from plotly.subplots import make_subplots  # noqa: E402

COLOURS = ("blue", "vermilion", "green", "purple", "orange", "sky")
MARKED = 400         # fewer samples are marked one by one
MOST_POINTS = 12000  # of a curve; a longer one is drawn through the extremes of each column
DASHES = ("solid", "dash", "dot")


def colour(name):
    """Returns the style sheet's variable of a colour."""
    return f"var(--{name})"


def cycle(k):
    """Returns the colour of the k-th curve."""
    return colour(COLOURS[k % len(COLOURS)])


def label(quantity, unit=""):
    """Returns an axis title: the quantity, and its unit in brackets if it has one."""
    return f"{quantity} ({raised(unit)})" if unit else quantity


def numbers(values):
    """Returns numbers as Plotly stores them most briefly: of single precision if that is enough."""
    values = np.asarray(values, dtype=float)
    finite = values[np.isfinite(values)]
    single = finite.astype(np.float32)
    if finite.size and np.abs(single - finite).max() <= 1e-6 * np.ptp(finite):
        return values.astype(np.float32)
    return values


def style(figure, height, *, margin=None, hover="closest"):
    """Gives a figure the look of all figures."""
    axis = dict(showline=True, linecolor=colour("grey"), linewidth=1, gridcolor=colour("grid"),
                zeroline=False, ticks="outside", ticklen=4, tickcolor=colour("grey"),
                automargin=True, title_standoff=8, exponentformat="power", minexponent=4)
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    figure.update_layout(
        template=None, height=height, hovermode=hover, uirevision="kept",
        margin=dict(l=56, r=12, t=34, b=44) | (margin or {}),
        paper_bgcolor="rgba(0,0,0,0)", plot_bgcolor="rgba(0,0,0,0)",
        font=dict(family="system-ui, Segoe UI, Roboto, Noto Sans, Liberation Sans, DejaVu Sans, "
                  "sans-serif", size=12.5, color=colour("text")),
        legend=dict(orientation="h", x=0, xanchor="left", y=1.0, yanchor="bottom",
                    bgcolor="rgba(0,0,0,0)", font_size=12, itemwidth=30, tracegroupgap=0),
        modebar=dict(bgcolor="rgba(0,0,0,0)", color=colour("grey"), activecolor=colour("link"),
                     orientation="v"),
        hoverlabel=dict(bgcolor=colour("panel"), bordercolor=colour("line"),
                        font_color=colour("text"), namelength=-1))
    return figure


def new(height, x, y, **options):
    """Returns a figure with one panel and titles of its axes."""
    figure = style(go.Figure(), height, **options)
    figure.update_xaxes(title_text=x)
    figure.update_yaxes(title_text=y)
    return figure


def stacked(heights, x, ys, height):
    """Returns a figure with panels above one another on a common horizontal axis."""
    figure = make_subplots(len(ys), 1, shared_xaxes=True, row_heights=heights,
                           vertical_spacing=0.07 if len(ys) < 4 else 0.04)
    style(figure, height)
    for k, y in enumerate(ys):
        figure.update_yaxes(title_text=y, row=k + 1)
    figure.update_xaxes(title_text=x, row=len(ys))
    return figure


def across_gaps(t, *series):
    """Returns times and series with a break where the record has a gap."""
    steps = np.diff(t)
    typical = 20 * np.median(steps[steps > 0]) if (steps > 0).any() else 0.0
    gaps = 1 + np.flatnonzero(steps > typical) if typical else []
    return [np.insert(values, gaps, np.nan) for values in (t, *series)]


def thinned(t, values):
    """Returns a curve, or of a long one the extremes of each column."""
    if len(t) <= MOST_POINTS:
        return across_gaps(t, values)
    return s.envelope(t, values, MOST_POINTS // 4)


def add_line(figure, t, values, name, tone, *, width=1.5, dash="solid", row=None, **options):
    """Adds a curve."""
    t, values = thinned(np.asarray(t, float), np.asarray(values, float))
    figure.add_scatter(x=numbers(t), y=numbers(values), name=name, mode="lines",
                       line=dict(color=tone, width=width, dash=dash), row=row,
                       col=row and 1, **options)


def add_band(figure, t, low, high, name, tone="band", row=None):
    """Adds a band between two curves."""
    t, low, high = across_gaps(np.asarray(t, float), low, high)
    known = np.isfinite(low) & np.isfinite(high)
    t, low, high = (values[known] for values in (t, low, high))
    figure.add_scatter(x=numbers(np.concatenate([t, t[::-1]])),
                       y=numbers(np.concatenate([high, low[::-1]])), name=name, mode="lines",
                       fill="toself", fillcolor=colour(tone), line=dict(width=0), hoverinfo="skip",
                       row=row, col=row and 1)


def add_record(figure, t, values, name="record", row=None):
    """Adds a record: dots if there are few samples, else a curve."""
    if len(t) >= MARKED:
        add_line(figure, t, values, name, colour("ink"), width=1.1, row=row)
        return
    figure.add_scatter(x=numbers(t), y=numbers(values), name=name, mode="markers",
                       marker=dict(color=colour("ink"), size=5), row=row, col=row and 1)


# -- a fit

def record_and_model(t, measured, residual, curve, units, elements, band=None):
    """Draws a record with the fitted model, and below it the residuals.

    `curve` has the times and values of the model, `band` (or None) times, lower and upper ends of
    the prediction band.
    """
    acceleration = units.get("acceleration")
    figure = stacked([0.68, 0.32], label("time", units.get("time")),
                     [label("acceleration", acceleration), label("residual", acceleration)], 470)
    if band is not None:
        add_band(figure, *band, "95 % prediction band", row=1)
    add_record(figure, t, measured, row=1)
    add_line(figure, *curve, f"model, <i>N</i> = {elements}", colour("blue"), row=1,
             width=1.6 if len(t) < MARKED else 1)
    few = len(t) < MARKED
    x, y = thinned(t, residual)
    figure.add_scatter(x=numbers(x), y=numbers(y), name="residual: record − model",
                       mode="lines+markers" if few else "lines", marker_size=4,
                       line=dict(color=colour("vermilion"), width=0.9), row=2, col=1)
    figure.add_hline(y=0, line_color=colour("grey"), line_width=1, row=2, col=1)
    return figure


def cycles(t, measured, band, curve, units):
    """Draws some cycles of a record: dots, the model and its prediction band.

    `band` has times, lower and upper ends, `curve` times and values.
    """
    figure = new(340, label("time", units.get("time")),
                 label("acceleration", units.get("acceleration")))
    add_band(figure, *band, "95 % prediction band")
    add_line(figure, *curve, "model", colour("blue"), width=1.4)
    size = float(np.clip(1500 / max(len(t), 1), 3, 6))
    figure.add_scatter(x=numbers(t), y=numbers(measured), name="record", mode="markers",
                       marker=dict(color=colour("ink"), size=size))
    return figure


def spectra(t, series, modes, units, names=("record", "model", "residual"), known=None):
    """Draws amplitude spectra of time series, both axes logarithmic, and marks frequencies of
    modes. `known` has the spectra if they have been computed."""
    figure = new(400, label("frequency", units.hertz),
                 label("amplitude", units.get("acceleration")))
    f, *amplitudes = known or s.spectrum(t, *series)
    tones = ("ink", "blue", "vermilion")
    for amplitude, name, tone, width in zip(amplitudes, names, tones, (1.6, 1.2, 1)):
        x, y = s.highest(f, amplitude)
        figure.add_scatter(x=numbers(x), y=numbers(y), name=name, mode="lines",
                           line=dict(color=colour(tone), width=width))
    top = max(amplitude.max() for amplitude in amplitudes[:2])
    floor = min(np.percentile(amplitude, 20) for amplitude in amplitudes[::2])
    low, high = max(floor / 3, 1e-8 * top, 1e-300), 2.5 * max(top, 1e-290)
    seen = [mode for mode in modes if f[0] < mode < f[-1]]
    if seen:
        ends = [value for mode in seen for value in (mode, mode, None)]
        figure.add_scatter(
            x=ends, y=[low, high, None] * len(seen), name="modes of the structure", mode="lines",
            line=dict(color=colour("green"), width=1, dash="dash"),
            hovertemplate="mode at %{x:.5g}" + f" {units.hertz}<extra></extra>")
        for k, mode in enumerate(seen):
            figure.add_annotation(x=math.log10(mode), y=1, yref="paper", text=f"{k + 1}",
                                  showarrow=False, xanchor="left", yanchor="top", xshift=1,
                                  font=dict(color=colour("green"), size=11))
    figure.update_xaxes(type="log", range=[math.log10(f[0]), math.log10(f[-1])],
                        tickformat="~g", dtick="D2" if f[-1] < 200 * f[0] else 1)
    figure.update_yaxes(type="log", range=[math.log10(low), math.log10(high)], dtick=1,
                        tickfont_size=10)
    return figure


def autocorrelation(lags, values, band, unit="samples"):
    """Draws the autocorrelation of residuals with the band that holds 95 % of it for white
    noise. The lags count samples, or what `unit` says."""
    figure = new(260, f"lag ({unit})", "autocorrelation")
    ends = [0, max(lags) + 1]
    add_band(figure, ends, np.array([-band, -band]), np.array([band, band]),
             "95 % band of white noise")
    figure.add_scatter(x=list(lags), y=numbers(values), name="autocorrelation of the residuals",
                       mode="lines+markers", marker=dict(size=4, color=colour("vermilion")),
                       line=dict(color=colour("vermilion"), width=1))
    figure.add_hline(y=0, line_color=colour("grey"), line_width=1)
    figure.update_xaxes(range=ends)
    return figure


def shapes(x, curves, names, attached, units):
    """Draws mode shapes over the beam, and marks the attachments (name, x)."""
    figure = new(360, label("<i>x</i>", units.get("length")), "displacement (largest: 1)")
    figure.add_scatter(x=[x[0], x[-1]], y=[0, 0], mode="lines", showlegend=False, hoverinfo="skip",
                       line=dict(color=colour("ink"), width=3))
    for k, (curve, name) in enumerate(zip(curves, names)):
        figure.add_scatter(x=numbers(x), y=numbers(curve), name=name, mode="lines",
                           line=dict(color=cycle(k), width=2, dash=DASHES[k % 3]))
    add_attached(figure, x, attached)
    figure.update_yaxes(range=[-1.12, 1.12])
    return figure


def add_attached(figure, x, attached, row=None):
    """Marks what is attached to the beam; the names at one place share a line."""
    places = sorted({place for _, place in attached})
    if not places:
        return
    words = [", ".join(name for name, at in attached if at == place) for place in places]
    sides = ["top left" if place > x[0] + 0.7 * (x[-1] - x[0]) else "top right"
             if place < x[0] + 0.3 * (x[-1] - x[0]) else "top center" for place in places]
    figure.add_scatter(x=places, y=[0] * len(places), mode="markers+text", text=words,
                       textposition=sides, textfont_size=11.5, showlegend=False,
                       marker=dict(symbol="square", size=9, color=colour("ink")), cliponaxis=False,
                       hovertemplate="%{text}: <i>x</i> = %{x:.4g}<extra></extra>", row=row,
                       col=row and 1)


def along(functions, attached, units, highest):
    """Draws what varies along the beam: start, fit and band of each function (name, unit, columns),
    the length over which the fit averages, and the beam below them."""
    count = len(functions)
    ys = []
    for name, unit, values in functions:
        power = p_of(values["value"])
        ys.append(label(symbol(f"{name}(x)"), scaled_unit(power, unit)))
    figure = stacked([1] * count + [0.2], label("<i>x</i>", units.get("length")), [*ys, ""],
                     150 + 230 * count)
    x = functions[0][2]["x"]
    for row, (name, _, values) in enumerate(functions, 1):
        unit = 10.0**p_of(values["value"])
        x, value = values["x"], values["value"] / unit
        top = highest * value.max()
        if np.isfinite(values["lower95"]).any():
            add_band(figure, x, values["lower95"] / unit,
                     np.minimum(np.nan_to_num(values["upper95"] / unit, posinf=top), top),
                     "95 % band", row=row)
        searched = np.isfinite(values["start"]).any()
        if searched:
            add_line(figure, x, values["start"] / unit, "start", colour("grey"), dash="dash",
                     row=row)
        add_line(figure, x, value, f"{symbol(name)}, fit" if searched else
                 f"{symbol(name)}, as given", colour("blue"), row=row, width=2)
        add_resolution(figure, values, value, row)
    figure.add_scatter(x=[x[0], x[-1]], y=[0, 0], mode="lines", showlegend=False, hoverinfo="skip",
                       line=dict(color=colour("ink"), width=4), row=count + 1, col=1)
    add_attached(figure, x, attached, row=count + 1)
    figure.update_yaxes(row=count + 1, visible=False, range=[-0.6, 1.6])
    hide_repeated(figure)
    return figure


def add_resolution(figure, values, value, row):
    """Adds bars as long as what the estimate averages over, at some places."""
    length, x = values["resolution"], values["x"]
    if not np.isfinite(length).any():
        return
    seen = np.concatenate([value, values["lower95"] / (values["value"] / value)])
    height = np.nanmin(seen) - 0.06 * np.ptp(seen[np.isfinite(seen)])
    ends = []
    for place in np.linspace(x[0], x[-1], 6)[1:-1]:
        half = length[np.argmin(np.abs(x - place))] / 2
        ends += [max(x[0], place - half), min(x[-1], place + half), None]
    figure.add_scatter(x=ends, y=[height if end is not None else None for end in ends],
                       mode="lines", name="length that the fit averages over",
                       line=dict(color=colour("vermilion"), width=4), hoverinfo="skip", row=row,
                       col=1)


def hide_repeated(figure):
    """Shows each entry of the legend once."""
    seen = set()
    for trace in figure.data:
        if trace.name in seen:
            trace.showlegend = False
        seen.add(trace.name)


def p_of(values):
    """Returns the power of ten that numbers of an axis share."""
    from page import common_power
    return common_power([float(value) for value in np.ravel(values)])


# -- intervals

def profile(value, rise, curve, parabola, ends, estimate, title):
    """Draws the rise of J over one parameter.

    `value` and `rise` are the fits, `curve` and `parabola` have points of the profile and of linear
    theory (or None), `ends` lists (place, text) of the interval's ends.
    """
    figure = new(250, title, "rise of <i>J</i> (95 %: 1)", margin=dict(t=12, r=10))
    figure.update_layout(showlegend=False)
    if parabola is not None:
        add_line(figure, *parabola, "linear theory", colour("ink"), dash="dot")
    add_line(figure, *curve, "profile", colour("vermilion"), width=2)
    figure.add_scatter(x=numbers(value), y=numbers(rise), mode="markers", name="fit",
                       marker=dict(symbol="square", size=5, color=colour("vermilion")))
    figure.add_scatter(x=[estimate], y=[0], mode="markers", name="estimate", cliponaxis=False,
                       marker=dict(size=8, color=colour("ink")))
    figure.add_hline(y=1, line_color=colour("grey"), line_dash="dash", line_width=1)
    for place, text, side in ends:
        figure.add_annotation(x=place, y=1, text=text, showarrow=False, yshift=9, font_size=11.5,
                              xanchor=side, bgcolor=colour("back"), borderpad=1)
    figure.update_yaxes(range=[0, 1.42], tickvals=[0, 0.5, 1])
    return figure


def corner(names, titles, draws, others, levels, density, spans, best):
    """Draws histograms on the diagonal and densities of pairs of parameters below it.

    `draws` and `others` (or None) have values by name, `density` returns edges, counts and heights
    of contours of a pair, `spans` the shown ranges, `best` the estimates.
    """
    n = len(names)
    side = 190 if n < 4 else 160
    figure = make_subplots(n, n, horizontal_spacing=0.02, vertical_spacing=0.02)
    style(figure, max(side * n + 60, 330), margin=dict(t=10))
    figure.update_layout(showlegend=False, bargap=0)
    for i, row in enumerate(names):
        for j, column in enumerate(names):
            at = dict(row=i + 1, col=j + 1)
            if j > i:
                figure.update_xaxes(visible=False, **at)
                figure.update_yaxes(visible=False, **at)
                continue
            figure.update_xaxes(range=spans[column], showticklabels=i == n - 1, nticks=4,
                                showgrid=False, title_text=titles[column] if i == n - 1 else "",
                                tickangle=0, tickfont_size=11, **at)
            if i == j:
                add_histogram(figure, draws[row], spans[row], others and others.get(row), at)
                figure.update_yaxes(visible=False, **at)
                continue
            x, y, counts, heights = density(draws[column], draws[row], spans[column], spans[row])
            figure.add_heatmap(x=numbers(x), y=numbers(y), z=numbers(counts), showscale=False,
                               colorscale=[[0, "rgba(128,128,128,0)"], [1, colour("grey")]],
                               hoverinfo="skip", **at)
            for height, share, dash in zip(heights, levels, ("dash", "solid")):
                figure.add_contour(x=numbers(x), y=numbers(y), z=numbers(counts), showscale=False,
                                   contours=dict(start=float(height), end=float(height), size=1,
                                                 coloring="none"),
                                   line=dict(color=colour("blue"), width=1.4, dash=dash),
                                   name=f"{100 * share:g} % of the draws", hoverinfo="name", **at)
            figure.add_scatter(x=[best[column]], y=[best[row]], mode="markers", name="estimate",
                               marker=dict(symbol="cross-thin", size=11, line_width=2,
                                           line_color=colour("ink")), **at)
            figure.update_yaxes(range=spans[row], showticklabels=j == 0, nticks=4, showgrid=False,
                                title_text=titles[row] if j == 0 else "", tickfont_size=11, **at)
    return figure


def add_histogram(figure, values, span, others, at, bins=36):
    """Adds a histogram of one parameter, and the outline of another one."""
    for data, fill, line in ((values, "haze", "grey"), (others, "", "green")):
        if data is None:
            continue
        heights, edges = np.histogram(data, bins, range=span, density=True)
        x, y = np.repeat(edges, 2), np.concatenate([[0], np.repeat(heights, 2), [0]])
        figure.add_scatter(x=numbers(x), y=numbers(y), mode="lines", hoverinfo="skip",
                           fill="tozeroy" if fill else "none",
                           fillcolor=colour(fill) if fill else None,
                           line=dict(color=colour(line), width=1.2), **at)


def intervals(methods, title):
    """Draws the intervals of several methods for one parameter: (name, colour, symbol, estimate,
    low, high) with ends that may be infinite."""
    figure = new(70 + 26 * len(methods), title, "", margin=dict(t=8, l=110))
    figure.update_layout(showlegend=False)
    finite = [x for method in methods for x in method[3:] if math.isfinite(x)]
    low, high = min(finite), max(finite)
    room = 0.06 * (high - low) or 1.0
    for k, (name, tone, mark, estimate, *ends) in enumerate(methods):
        y = -k
        shown = [max(ends[0], low - room), min(ends[1], high + room)]
        figure.add_scatter(x=shown, y=[y, y], mode="lines+markers", name=name,
                           line=dict(color=colour(tone), width=2),
                           marker=dict(symbol=["line-ns" if math.isfinite(ends[0]) else
                                               "triangle-left", "line-ns" if math.isfinite(ends[1])
                                               else "triangle-right"], size=9,
                                       line=dict(color=colour(tone), width=2)))
        figure.add_scatter(x=[estimate], y=[y], mode="markers", name=name,
                           marker=dict(color=colour(tone), symbol=mark, size=8))
    figure.update_yaxes(tickvals=[-k for k in range(len(methods))],
                        ticktext=[method[0] for method in methods], showgrid=False,
                        range=[0.6 - len(methods), 0.6])
    # Numbers that agree in many digits are long: few of them have room without being turned.
    is_narrow = high - low < 1e-3 * max(abs(low), abs(high))
    figure.update_xaxes(range=[low - 1.5 * room, high + 1.5 * room],
                        nticks=3 if is_narrow else 5, tickangle=0)
    return figure


def motion(t, low, middle, high, measured, noise, units):
    """Draws the band of the model's motion with the record, and both minus the median below."""
    acceleration = units.get("acceleration")
    figure = stacked([0.6, 0.4], label("time", units.get("time")),
                     [label("acceleration", acceleration),
                      label("minus the median", acceleration)], 470)
    for row, less in ((1, 0), (2, middle)):
        if noise is not None:
            wide = 1.96 * noise
            add_band(figure, t, middle - less - np.hypot(middle - low, wide),
                     middle - less + np.hypot(high - middle, wide),
                     "95 % of measured values (with noise)", "haze", row=row)
        add_band(figure, t, low - less, high - less, "95 % of the model's motion", row=row)
        add_line(figure, t, middle - less, "median of the draws", colour("blue"), row=row,
                 width=1.3)
        if measured is not None:
            add_record(figure, t, measured - less, row=row)
    hide_repeated(figure)
    return figure


# -- other commands

def response(panels, units):
    """Draws a response: panels of (quantity, unit, [(name, times, values, curve)]), where `curve`
    has the times and values between the samples."""
    figure = stacked([1] * len(panels), label("time", units.get("time")),
                     [label(quantity, unit) for quantity, unit, _ in panels],
                     80 + 165 * len(panels))
    for row, (_, _, curves) in enumerate(panels, 1):
        for name, x, y, _ in curves:
            if name == "with noise":
                add_record(figure, x, y, name, row=row)
        for k, (name, x, y, curve) in enumerate(each for each in curves if each[3] is not None):
            add_line(figure, *curve, name, cycle(k), row=row, width=1.4)
            if len(x) < MARKED:
                figure.add_scatter(x=numbers(x), y=numbers(y), name="samples", mode="markers",
                                   marker=dict(size=4, color=cycle(k)), row=row, col=1)
    hide_repeated(figure)
    return figure


def criteria(models, columns):
    """Draws differences of information criteria from the best model, as bars."""
    figure = new(110 + 46 * len(models), "difference", "")
    models = [name if len(name) < 24 else name[:22] + "…" for name in models]
    for k, (name, values) in enumerate(columns):
        figure.add_bar(y=models, x=numbers(values), name=name, orientation="h",
                       marker_color=cycle(k))
    figure.update_layout(barmode="group", bargap=0.35)
    figure.update_yaxes(autorange="reversed", showgrid=False)
    return figure


def error_map(axes, best, titles, marks, height=330):
    """Draws a map of standard errors in per cent over two settings.

    `axes` has the values of both settings, `best` the error at each pair (nan: not determined),
    `marks` lists (name, symbol, size, place) with places as indices.
    """
    figure = new(height, *titles)
    logs = np.log10(best)
    low, high = math.floor(np.nanmin(logs)), math.ceil(np.nanmax(logs) + 1e-9)
    ticks = [base * 10.0**k for k in range(low, high + 1) for base in (1, 2, 5)]
    ticks = [tick for tick in ticks if np.nanmin(logs) - 0.02 <= math.log10(tick)
             <= np.nanmax(logs) + 0.02]
    if len(ticks) > 8:
        ticks = [tick for tick in ticks if f"{tick:e}"[0] == "1"]
    shown = [[f"{value:.4g}" for value in values] for values in axes]
    figure.add_heatmap(
        x=list(range(len(axes[0]))), y=list(range(len(axes[1]))), z=numbers(logs.T),
        customdata=numbers(best.T), colorscale="Viridis", reversescale=True, xgap=1, ygap=1,
        hovertemplate="%{customdata:.3g} %<extra></extra>",
        colorbar=dict(tickvals=[math.log10(tick) for tick in ticks],
                      ticktext=[f"{tick:g} %" for tick in ticks], thickness=14, outlinewidth=0))
    for name, mark, size, place in marks:
        figure.add_scatter(x=[int(place[0])], y=[int(place[1])], mode="markers", name=name,
                           cliponaxis=False, marker=dict(symbol=mark, size=size, color="#ffffff",
                                                         line=dict(color="#222222", width=1.5)))
    for values, update in zip(shown, (figure.update_xaxes, figure.update_yaxes)):
        step = -(-len(values) // 10)
        at = list(range((len(values) - 1) % step, len(values), step))
        update(tickvals=at, ticktext=[values[k] for k in at], showgrid=False,
               range=[-0.5, len(values) - 0.5])
    return figure


def error_curve(values, best, x, y):
    """Draws the standard error in per cent over one setting."""
    figure = new(340, x, y)
    figure.update_layout(showlegend=False)
    figure.add_scatter(x=numbers(values), y=numbers(best), mode="lines+markers",
                       line=dict(color=colour("blue"), width=1.8), name="standard error (%)")
    figure.update_yaxes(type="log", dtick="D2")
    return figure


def pulls(values, title):
    """Draws a histogram of (estimate - truth)/(standard error) against the normal density."""
    figure = new(230, title, "", margin=dict(t=10, l=24))
    figure.update_layout(showlegend=False, bargap=0.04)
    edges = np.arange(-5, 5.01, 0.5)
    heights, _ = np.histogram(np.clip(values, -4.99, 4.99), edges)
    density = heights / max(len(values), 1) / 0.5
    figure.add_bar(x=numbers(edges[:-1] + 0.25), y=numbers(density), width=0.5, name="members",
                   marker=dict(color=colour("haze"), line=dict(color=colour("grey"), width=1)),
                   customdata=heights, hovertemplate="%{customdata} members<extra></extra>")
    z = np.linspace(-5, 5, 201)
    figure.add_scatter(x=numbers(z), y=numbers(np.exp(-z**2 / 2) / math.sqrt(2 * math.pi)),
                       mode="lines", line=dict(color=colour("blue"), width=1.8), name="normal",
                       hoverinfo="skip")
    figure.update_yaxes(showticklabels=False, ticks="", showgrid=False,
                        range=[0, 1.08 * max(0.4, density.max())])
    figure.update_xaxes(range=[-5, 5], tickvals=[-4, -2, 0, 2, 4])
    return figure


def spread(values, title):
    """Draws a histogram of the values of one quantity."""
    figure = new(230, title, "", margin=dict(t=10, l=24))
    figure.update_layout(showlegend=False)
    heights, edges = np.histogram(values, min(30, max(5, len(values) // 4)))
    figure.add_bar(x=numbers(0.5 * (edges[1:] + edges[:-1])), y=heights.tolist(), name="members",
                   width=numbers(np.diff(edges)), marker=dict(
                       color=colour("haze"), line=dict(color=colour("grey"), width=1)),
                   hovertemplate="%{y} members<extra></extra>")
    figure.update_yaxes(showticklabels=False, ticks="", showgrid=False)
    figure.update_xaxes(nticks=5)
    return figure


def forest(names, values, low, high, title):
    """Draws an estimate with its interval for each case."""
    figure = new(90 + 24 * len(names), title, "", margin=dict(t=10))
    figure.update_layout(showlegend=False)
    figure.add_scatter(y=list(names), x=numbers(values), mode="markers", marker=dict(
        color=colour("blue"), size=8), name="estimate", error_x=dict(
            type="data", array=numbers(np.subtract(high, values)),
            arrayminus=numbers(np.subtract(values, low)), color=colour("blue"), thickness=1.6))
    figure.update_yaxes(autorange="reversed", showgrid=False)
    figure.update_xaxes(nticks=5)
    return figure


def convergence(ours, paper, x, y, title_of):
    """Draws series over the number of elements on a logarithmic axis: ours as lines, the paper's
    as hollow points; `title_of` gives the name of a series."""
    figure = new(380, x, y)
    for k, (name, (n, values)) in enumerate(ours.items()):
        figure.add_scatter(x=list(map(int, n)), y=list(map(float, values)), name=title_of(name),
                           mode="lines+markers", line=dict(color=cycle(k), width=1.8),
                           marker=dict(symbol=SYMBOLS[k % len(SYMBOLS)], size=8))
        if name in paper:
            n, values = paper[name]
            figure.add_scatter(x=list(map(int, n)), y=list(map(float, values)),
                               name=f"{title_of(name)}, paper", mode="markers",
                               marker=dict(symbol=SYMBOLS[k % len(SYMBOLS)] + "-open", size=11,
                                           color=cycle(k), line_width=1.6))
    figure.update_yaxes(type="log", dtick=1, tickfont_size=10)
    meshes = sorted({int(n) for series in ours.values() for n in series[0]})
    if len(meshes) <= 12:
        figure.update_xaxes(tickvals=meshes)
    return figure


SYMBOLS = ("circle", "square", "diamond", "triangle-down", "triangle-up", "pentagon")
