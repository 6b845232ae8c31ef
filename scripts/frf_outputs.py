"""The frequency response functions (FRFs) in frf.csv, for pictures and reports: curves, noise
levels, peaks and the lines of a Nyquist circle."""
from __future__ import annotations

import math
from dataclasses import dataclass

import plotting as p
import cases as c
import numpy as np
from plot_fit import read_modes
from responses import QUANTITIES
from units import Units

SMOOTHED = 21       # lines of a moving average of variances
ARC = 0.2           # a Nyquist circle contains the lines above this share of the peak
LEAST_ARC = 5       # lines of a Nyquist circle on each side of the peak, if there are as many
FINE = 8            # least number of points of a Nyquist circle for each line
POINTS = 2000       # points of a circle with few lines, between which a sharp peak turns
LEAST_PEAK = 1e-3   # of the highest peak
MOTIONS = {"accelerance": "acceleration", "mobility": "velocity", "receptance": "length"}


@dataclass
class Curve:
    """The FRF of one record on one mesh. What the file does not contain is None."""

    record: int
    elements: int
    f: np.ndarray                            # [Hz]
    model: np.ndarray
    measured: np.ndarray | None = None
    residual: np.ndarray | None = None
    coherence: np.ndarray | None = None
    sd: np.ndarray | None = None             # of the real and of the imaginary part
    band: tuple | None = None                # ends of the 95 % interval of the magnitude


def read_curves(directory):
    """Returns the curves of frf.csv, by record and by number of elements."""
    path = directory / "frf.csv"
    p.read_table(path, "elements", "frequency_hz", "real", "imag")
    names = p.header(path)
    rows = np.genfromtxt(path, delimiter=",", skip_header=1, ndmin=2)
    column = dict(zip(names, rows.T))
    record = column.get("record", np.ones(len(rows))).astype(int)
    found = {}
    for r, n in sorted(set(zip(record, column["elements"].astype(int)))):
        mine = (record == r) & (column["elements"] == n)
        found.setdefault(int(r), {})[int(n)] = curve_of(
            int(r), int(n), {name: values[mine] for name, values in column.items()})
    return found


def curve_of(record, elements, column):
    """Returns the curve in some rows; a column without any number counts as missing."""
    known = {name: values for name, values in column.items() if np.isfinite(values).any()}

    def pair(stem):
        if f"{stem}real" in known and f"{stem}imag" in known:
            return known[f"{stem}real"] + 1j * known[f"{stem}imag"]
        return None

    ends = [known.get(f"magnitude_{end}95") for end in ("lower", "upper")]
    return Curve(record, elements, column["frequency_hz"], pair(""), pair("measured_"),
                 pair("residual_"), known.get("coherence"), known.get("sd"),
                 None if ends[0] is None or ends[1] is None else tuple(ends))


class Folder:
    """An output folder with frf.csv, its case file and its units."""

    def __init__(self, directory):
        self.directory = directory
        self.curves = read_curves(directory)
        path = directory / "case.txt"
        text = p.read_text(path) if path.exists() else ""
        self.units = Units.of_folder(directory, text)
        self.records = [keys for name, keys, _ in c.read_groups(text) if name == "record"]
        if "record" not in p.header(directory / "frf.csv"):
            self.records = self.records_of_command()

    def records_of_command(self):
        """Returns the &record of the command frf alone: the first FRF without a file, or else the
        first FRF."""
        found = [keys for keys in self.records if c.unquoted(keys.get("kind") or "") == "frf"]
        return [keys for keys in found if not keys.get("file")][:1] or found[:1]

    def key(self, record, name):
        """Returns the text of a key of a &record; '' without it."""
        keys = self.records[record - 1] if record <= len(self.records) else {}
        return c.unquoted(keys.get(name)) if keys.get(name) else ""

    def quantity(self, record):
        """Returns accelerance, mobility or receptance."""
        stated = self.key(record, "quantity").lower()
        return stated if stated in QUANTITIES.values() else "accelerance"

    def unit(self, record):
        """Returns the unit of the FRF of a record; empty if the case states no units."""
        motion, force = (self.units.get(name) for name in
                         (MOTIONS[self.quantity(record)], "force"))
        if not motion or not force:
            return ""
        return f"{motion}/{force}"

    def averages(self, record):
        """Returns the number of averages of a measured FRF, or None."""
        text = self.key(record, "averages")
        return int(text) if text.isdigit() and int(text) > 1 else None

    def finest(self, elements=None):
        """Returns the curve of each record on a mesh, by default on the finest one."""
        for meshes in self.curves.values():
            chosen = max(meshes) if elements is None else elements
            if chosen not in meshes:
                p.fail(f"{self.directory / 'frf.csv'}: no FRF with {chosen} elements (found: "
                       f"{', '.join(map(str, meshes))})")
            yield meshes[chosen]

    def modes(self, curve):
        """Returns the natural frequencies within the range of a curve, as (number, frequency): of
        modes.csv, or else the peaks of the model."""
        return self.known_modes(curve) or list(enumerate(peaks(curve.f, np.abs(curve.model)), 1))

    def known_modes(self, curve):
        """Returns the modes of modes.csv within the range of a curve."""
        known = enumerate(read_modes(self.directory, curve.elements, curve.record), 1)
        return [(k, f) for k, f in known if curve.f[0] <= f <= curve.f[-1]]

    def word(self, curve):
        """Returns what the numbers of modes() count: 'mode' or 'peak'."""
        return "mode" if self.known_modes(curve) else "peak"


def smoothed(values, lines=SMOOTHED):
    """Returns the moving average of values that may contain NaN."""
    weights = np.ones(min(lines, len(values)))
    known = np.isfinite(values)
    sums = np.convolve(np.where(known, values, 0.0), weights, "same")
    with np.errstate(invalid="ignore", divide="ignore"):
        return sums / np.convolve(known.astype(float), weights, "same")


def noise_level(curve, averages):
    """Returns the rms magnitude that the noise gives the residuals, and what it rests on: 'sd',
    'coherence' or 'residuals'.

    The real and the imaginary part each have the variance |H|^2 (1 - g)/(2 (n - 1) g) for the
    coherence g and n averages (Bendat and Piersol), here smoothed over neighbouring lines.
    """
    if curve.sd is not None:
        return math.sqrt(2) * curve.sd, "sd"
    if curve.coherence is not None and averages and curve.measured is not None:
        g = np.clip(curve.coherence, 1e-6, 1)
        variance = np.abs(curve.measured)**2 * (1 - g) / ((averages - 1) * g)
        return np.sqrt(smoothed(variance)), "coherence"
    if curve.residual is None:
        return None, ""
    rms = math.sqrt(np.nanmean(np.abs(curve.residual)**2))
    return np.full(len(curve.f), rms), "residuals"


def peaks(f, magnitude):
    """Returns the frequencies of the local maxima of a magnitude without noise."""
    inner = magnitude[1:-1]
    at = 1 + np.flatnonzero((inner > magnitude[:-2]) & (inner >= magnitude[2:]))
    at = at[magnitude[at] >= LEAST_PEAK * magnitude.max()]
    return [float(f[k]) for k in (at if at.size else [int(np.argmax(magnitude))])]


def highest(curve, modes, count=1):
    """Returns the modes with the highest peaks, as (number, frequency), the lowest mode first."""
    def height(mode):
        return abs(curve.model[np.argmin(np.abs(curve.f - mode[1]))])
    return sorted(sorted(modes, key=height)[-count:])


def chosen_mode(folder, curve, number=None):
    """Returns the number and the frequency of the mode whose circle is to be shown."""
    modes = folder.modes(curve)
    number = highest(curve, modes)[0][0] if number is None else number
    if number not in dict(modes):
        p.fail(f"--mode: found {number}, expected one of {', '.join(str(k) for k, _ in modes)}, "
               f"the {folder.word(curve)}s within the frequencies of frf.csv")
    return number, dict(modes)[number]


def circle(curve, frequency):
    """Returns the slice of the lines around a peak, down to a share of it or to the minimum between
    two peaks, and the place of the peak."""
    magnitude = np.abs(curve.model)
    top = int(np.argmin(np.abs(curve.f - frequency)))
    while 0 < top < len(magnitude) - 1 and max(magnitude[top - 1], magnitude[top + 1]) > \
            magnitude[top]:
        top += 1 if magnitude[top + 1] > magnitude[top - 1] else -1
    ends = []
    for step, last in ((-1, 0), (1, len(magnitude) - 1)):
        k = top
        while k != last and magnitude[k + step] <= magnitude[k] and (
                magnitude[k] > ARC * magnitude[top] or abs(k - top) < LEAST_ARC):
            k += step
        ends.append(k)
    return slice(ends[0], ends[1] + 1), top


def between(f, values):
    """Returns fine frequencies and the FRF there. 1/H is nearly a polynomial around a peak, and is
    interpolated by cubic polynomials."""
    if len(f) < 3 or not values.all():
        return f, values
    fine = np.linspace(f[0], f[-1], max(FINE, POINTS // (len(f) - 1)) * (len(f) - 1) + 1)
    inverse = 1 / values
    slope = np.gradient(inverse, f)
    k = np.clip(np.searchsorted(f, fine, "right") - 1, 0, len(f) - 2)
    step = f[k + 1] - f[k]
    u = (fine - f[k]) / step
    cubic = ((1 + 2 * u) * (1 - u)**2 * inverse[k] + u * (1 - u)**2 * step * slope[k]
             + u**2 * (3 - 2 * u) * inverse[k + 1] - u**2 * (1 - u) * step * slope[k + 1])
    return fine, 1 / cubic


def degrees(values):
    """Returns phases in degrees from -180 to 180."""
    return np.degrees(np.angle(values))


def wrapped(f, phases):
    """Returns frequencies and phases with a break where the phase jumps by a turn."""
    jumps = 1 + np.flatnonzero(np.abs(np.diff(phases)) > 180)
    return np.insert(np.asarray(f, float), jumps, np.nan), np.insert(phases, jumps, np.nan)
