"""Pictures of fits and of mode shapes, by matplotlib if it is installed."""
from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ._library import optional

#: With fewer samples, each sample is marked.
MARKED = 400


def fit(table: str, labels: str, record: int, axes: Any) -> Any:
    """Draw record, model and residuals from fit.csv; see `Fit.plot`."""
    if len(table.splitlines()) < 2:
        raise ValueError(f"plot: found record={record}, which has no samples, expected a record "
                         "of samples or a frequency response")
    columns = read(table)
    chosen = (columns["elements"] == columns["elements"].max()) & (columns["record"] == record)
    if not chosen.any():
        raise ValueError(f"plot: found record={record}, expected 1 to "
                         f"{int(columns['record'].max())}")
    t, measured, model, residual = (columns[name][chosen]
                                    for name in ("t", "measured", "model", "residual"))
    units = read_units(labels)
    upper, lower = panels(2, axes, "Fit.plot", figsize=(8, 5), height_ratios=[2, 1])
    style = "." if t.size < MARKED else "-"
    upper.plot(t, measured, style, color="black", markersize=4, linewidth=1.2, label="record")
    upper.plot(t, model, color="tab:blue", linewidth=1, label="model")
    upper.set_ylabel(labelled("acceleration", units.get("acceleration")))
    upper.legend(loc="upper right")
    if columns["record"].max() > 1:
        upper.set_title(f"record {record}")
    lower.plot(t, residual, style, color="black", markersize=4, linewidth=0.6)
    lower.axhline(0, color="grey", linewidth=0.6)
    lower.set_ylabel("record - model")
    lower.set_xlabel(labelled("t", units.get("time")))
    return np.array([upper, lower])


def response(frequency: np.ndarray, h: np.ndarray, lower: np.ndarray | None,
             upper: np.ndarray | None, axes: Any, what: str, units: Mapping[str, str],
             measured: np.ndarray | None = None) -> Any:
    """Draw magnitude and phase of a frequency response, and of a measured one the residuals.

    Parameters
    ----------
    frequency, h
        Frequencies [1/time] and complex response of the model.
    lower, upper
        Ends of the 95 % band of the magnitude; None: not known.
    axes
        Where to draw; None: a new figure.
    what
        Name of the function, for messages.
    units
        Names of the units by quantity; empty: not known.
    measured
        Measured response; None: none.
    """
    count = 2 if measured is None else 3
    drawn = panels(count, axes, what, figsize=(8, 2 + 1.6*count),
                   height_ratios=[2, 1, 1][:count])
    magnitude, phase = drawn[:2]
    few = frequency.size < MARKED
    if measured is not None:
        style = "." if few else "-"
        magnitude.plot(frequency, np.abs(measured), style, color="black", markersize=4,
                       linewidth=0.8, label="measured")
        phase.plot(frequency, np.degrees(np.angle(measured)), ".", color="black", markersize=2)
        drawn[2].semilogy(frequency, np.abs(measured - h), ".", color="black", markersize=2)
        drawn[2].set_ylabel("|measured - model|")
    if lower is not None and upper is not None and np.isfinite(upper).all():
        magnitude.fill_between(frequency, np.maximum(lower, 1e-300), upper, color="tab:blue",
                               alpha=0.3, linewidth=0, label="95 % band")
    magnitude.semilogy(frequency, np.abs(h), color="tab:blue", linewidth=1, label="model")
    positive = np.abs(h)[np.abs(h) > 0]
    if positive.size:
        magnitude.set_ylim(positive.min()/3, 3*positive.max())
    magnitude.set_ylabel("magnitude")
    magnitude.legend(loc="upper right")
    phase.plot(frequency, np.degrees(np.angle(h)), ".", color="tab:blue", markersize=2)
    phase.set_ylabel("phase [degrees]")
    phase.set_yticks([-180, -90, 0, 90, 180])
    drawn[-1].set_xlabel(labelled("frequency", frequency_unit(units) or "1/time"))
    return np.array(drawn)


def shapes(table: str, attachments: str, units: Mapping[str, str],
           modes: Sequence[tuple[int, float, float]], axes: Any) -> Any:
    """Draw mode shapes from shapes.csv.

    Parameters
    ----------
    table, attachments
        shapes.csv and attachments.csv.
    units
        Names of the units by quantity; empty: not known.
    modes
        Number, frequency [1/time] and damping ratio of each mode that oscillates.
    axes
        Where to draw; None: a new figure.
    """
    if not table:
        raise ValueError("plot_modes: found no mode shape, as no mode oscillates")
    columns = read(table)
    x = columns["x"]
    hertz = f" {frequency_unit(units)}".rstrip()
    count = min((len(columns) - 1)//2, len(modes))
    drawn = panels(count, axes, "plot_modes", figsize=(7, 1 + 1.4*count))
    places = [float(line.rsplit(",", 1)[1]) for line in attachments.splitlines()[1:]]
    for k, (panel, (number, frequency, damping)) in enumerate(zip(drawn, modes), start=1):
        shape = columns[f"mode_{k}_real"]
        panel.axhline(0, color="grey", linewidth=0.6)
        panel.plot(x, shape, color="tab:blue", label=f"mode {number}")
        panel.plot(places, np.interp(places, x, shape), "ks", markersize=5)
        panel.set_title(f"mode {number}: {frequency:.5g}{hertz}, damping ratio {damping:.3g}",
                        fontsize=10)
        panel.set_yticks([])
    drawn[-1].set_xlabel(labelled("x", units.get("length")))
    return np.array(drawn)


def profiles(drawn: Sequence[tuple[str, str, Any, float]], axes: Any) -> Any:
    """Draw profiles of J; see `Profiles.plot`.

    Parameters
    ----------
    drawn
        Label, unit, `Profile` and half width of the interval by linear theory of each parameter;
        nan: not known.
    axes
        Where to draw; None: a new figure.
    """
    found = panels(len(drawn), axes, "Profiles.plot", sharex=False,
                   figsize=(7, 1 + 1.9*len(drawn)))
    for panel, (label, unit, profile, half_width) in zip(found, drawn):
        x, distance = profile.value, profile.distance
        panel.plot(x, distance**2, ".-", color="tab:blue", markersize=5, linewidth=1,
                   label="profile")
        if np.isfinite(half_width) and half_width > 0:
            estimate = x[np.argmin(np.abs(distance))]
            fine = np.linspace(x[0], x[-1], 200)
            panel.plot(fine, ((fine - estimate)/half_width)**2, "--", color="grey", linewidth=1,
                       label="linear theory")
        panel.axhline(1, color="tab:red", linewidth=0.8, label="end of the 95 % interval")
        panel.set_xlabel(labelled(label, unit))
        panel.set_ylabel("relative rise of J")
        panel.locator_params(axis="x", nbins=6)
        panel.ticklabel_format(axis="x", useOffset=False)
        panel.set_ylim(0, 1.1*max(1, (distance**2).max(initial=0)))
    found[0].legend(loc="upper center", fontsize=8)
    return np.array(found)


def densities(drawn: Sequence[tuple[str, str, np.ndarray, tuple[float, float]]], axes: Any,
              what: str) -> Any:
    """Draw histograms of draws or of resampled estimates, with their 95 % intervals.

    Parameters
    ----------
    drawn
        Label, unit, values and ends of the interval of each parameter.
    axes
        Where to draw; None: a new figure.
    what
        Name of the function, for messages.
    """
    found = panels(len(drawn), axes, what, sharex=False, figsize=(7, 1 + 1.9*len(drawn)))
    for panel, (label, unit, values, ends) in zip(found, drawn):
        bins = int(np.clip(np.sqrt(values.size), 5, 50))
        panel.hist(values, bins=bins, density=True, color="tab:blue", alpha=0.5)
        panel.axvline(values.mean(), color="black", linewidth=1, label="mean")
        for end, name in zip(ends, ("end of the 95 % interval", None)):
            if np.isfinite(end):
                panel.axvline(end, color="tab:red", linewidth=0.8, label=name)
        panel.set_xlabel(labelled(label, unit))
        panel.set_ylabel("density")
        panel.set_yticks([])
        panel.locator_params(axis="x", nbins=6)
        panel.ticklabel_format(axis="x", useOffset=False)
    found[0].legend(loc="upper right", fontsize=8)
    return np.array(found)


def panels(count: int, axes: Any, what: str, **figure: Any) -> list[Any]:
    """Return axes, one below the other: those of the user, or those of a new figure."""
    if axes is not None:
        given = list(np.ravel(axes))
        if len(given) != count:
            raise ValueError(f"{what}: found {len(given)} axes, expected {count}")
        return given
    pyplot = optional("matplotlib.pyplot", what)
    ratios = figure.pop("height_ratios", None)
    shared = figure.pop("sharex", True)
    _, drawn = pyplot.subplots(count, 1, sharex=shared, squeeze=False, layout="constrained",
                               gridspec_kw=dict(height_ratios=ratios), **figure)
    return list(drawn[:, 0])


def read(table: str) -> dict[str, np.ndarray]:
    """Return the columns of a table of numbers by name; nan for an empty field."""
    header = table.split("\n", 1)[0].split(",")
    rows = np.genfromtxt(io.StringIO(table), delimiter=",", skip_header=1, ndmin=2)
    return dict(zip(header, rows.T))


def read_units(labels: str) -> dict[str, str]:
    """Return the units of labels.csv by quantity."""
    rows = (line.partition(",") for line in labels.splitlines()[1:])
    return {quantity: unit for quantity, _, unit in rows}


def frequency_unit(units: Mapping[str, str]) -> str:
    """Return the unit of frequencies; '': not known."""
    unit = units.get("time")
    return "Hz" if unit == "s" else f"1/{unit}" if unit else ""


def labelled(name: str, unit: str | None) -> str:
    """Return the label of an axis."""
    return f"{name} [{unit}]" if unit else name
