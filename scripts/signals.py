"""What pictures of records need: fast columns, thinned lines, spectra, peaks, autocorrelation.

The spectra are for the eye. Records may be sampled unevenly: they are interpolated linearly onto
an even grid of the usual step, weighted by a Hann window and transformed. That is right far below
half the sampling rate, and damps what lies near it. No fit uses them.
"""

import math

import numpy as np

from program import fail, number, read_table, reason

MAX_GRID = 2**21         # points of the even grid, at most
FEW = 200                # with fewer samples no cycle is worth a picture of its own
LEAST_CYCLES = 3         # a frequency needs so many within the record to be told from a trend


def read_columns(path, *columns):
    """Columns of numbers of a CSV file as arrays; a bad file is one line that says where."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            header = [name.strip() for name in file.readline().split(",")]
            if set(columns) <= set(header):
                places = [header.index(column) for column in columns]
                values = np.loadtxt(file, delimiter=",", usecols=places, ndmin=2,
                                    comments=None).T
                if values.size and np.isfinite(values).all():
                    return values
    except OSError as error:
        fail(f"{path}: {reason(error)}")
    except (ValueError, UnicodeDecodeError):
        pass
    rows = read_table(path, *columns)    # slower, and knows what is wrong in which line
    return np.array([[number(row, column) for column in columns] for row in rows]).T


def envelope(t, y, columns=1500):
    """The line through the extremes in every column of the picture; a short series as it is."""
    if len(t) <= 4 * columns:
        return t, y
    edges = np.linspace(t[0], t[-1], columns + 1)[:-1]
    starts = np.unique(np.searchsorted(t, edges))
    least, greatest = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    rising = y[starts] < y[np.append(starts[1:], len(y)) - 1]    # which of the two comes first
    both = np.where(rising, [least, greatest], [greatest, least])
    return np.repeat(t[starts], 2), both.T.ravel()


def spectrum(t, *series):
    """Frequencies, and of each series the amplitudes; a steady sine shows its own amplitude."""
    step = max(np.median(np.diff(t)), (t[-1] - t[0]) / MAX_GRID)
    even = np.arange(t[0], t[-1] + step / 2, step)
    window = np.hanning(len(even) + 2)[1:-1]
    length = 2 ** int(np.ceil(np.log2(len(even) * (8 if len(even) < 4000 else 2))))
    amplitudes = []
    for y in series:
        y = np.interp(even, t, y)
        y = (y - np.average(y, weights=window)) * window
        amplitudes.append(2 * np.abs(np.fft.rfft(y, length)) / window.sum())
    frequencies = np.fft.rfftfreq(length, step)
    seen = frequencies >= 1 / (t[-1] - t[0])
    return frequencies[seen], *(amplitude[seen] for amplitude in amplitudes)


def highest(frequencies, amplitudes, columns=900):
    """The spectrum thinned for a logarithmic axis: in every column of it the highest point."""
    place = np.log(frequencies / frequencies[0])
    starts = np.unique(np.searchsorted(place, np.linspace(0, place[-1], columns + 1)[:-1]))
    ends = np.append(starts[1:], len(place))
    picked = [a + np.argmax(amplitudes[a:b]) for a, b in zip(starts, ends)]
    return frequencies[picked], np.maximum(amplitudes[picked], 1e-300)    # zero has no logarithm


def peaks(frequencies, amplitudes, duration, most=10, above=5.0):
    """Frequencies and heights of the peaks that stand out, the lowest frequency first.

    A peak is `above` times as high as the middle one of the values from a third to three times its
    frequency, and three times as high as what the window leaves of higher peaks beside it.
    """
    inner = amplitudes[1:-1]
    tops = 1 + np.flatnonzero((inner > amplitudes[:-2]) & (inner >= amplitudes[2:]))
    tops = tops[frequencies[tops] >= LEAST_CYCLES / duration]
    found = []
    for k in tops[np.argsort(-amplitudes[tops])][:400]:
        f = frequencies[k]
        apart = [duration * abs(f - frequencies[j]) for j in found]
        if any(d < max(4, 0.1 * f * duration) for d in apart):
            continue
        beside = sum(amplitudes[j] / (math.pi * d * (d**2 - 1)) for j, d in zip(found, apart))
        if amplitudes[k] < 3 * beside:
            continue
        low, high = np.searchsorted(frequencies, (f / 3, 3 * f))
        some = amplitudes[low:high:1 + (high - low) // 2000]
        if amplitudes[k] > above * np.median(some):
            found.append(k)
        if len(found) == most:
            break
    found = np.array(sorted(found), dtype=int)
    left, top, right = (np.log(amplitudes[found + k] + 1e-300) for k in (-1, 0, 1))
    shift = 0.5 * (left - right) / np.minimum(left - 2 * top + right, -1e-300)    # a parabola's
    return frequencies[found] + shift * (frequencies[1] - frequencies[0]), amplitudes[found]


def lowest_mode(t, y):
    """The lowest frequency whose peak is a tenth of the highest one or more; None without one."""
    if len(t) < 8:
        return None
    f, amplitudes = spectrum(t, y)
    places, heights = peaks(f, amplitudes, t[-1] - t[0])
    visible = places[heights >= 0.1 * heights.max(initial=0)]
    return visible[0] if visible.size else None


def some_cycles(t, y, cycles=4):
    """Begin and end of a few cycles of the lowest mode, where they are largest; None: no use."""
    frequency = lowest_mode(t, y) if len(t) >= FEW else None
    if frequency is None or cycles / frequency > 0.4 * (t[-1] - t[0]):
        return None
    begins = np.arange(t[0], t[-1] - cycles / frequency, 1 / frequency)
    power = np.append(0, np.cumsum((y - y.mean())**2))
    ends = np.searchsorted(t, begins + cycles / frequency)
    starts = np.searchsorted(t, begins)
    best = np.argmax((power[ends] - power[starts]) / np.maximum(ends - starts, 1))
    return begins[best], begins[best] + cycles / frequency


def autocorrelation(residual, lags):
    """Autocorrelation at lags 1 to `lags`, of the deviations from the mean."""
    residual = residual - residual.mean()
    length = 2 ** int(np.ceil(np.log2(len(residual) + lags + 1)))
    power = np.abs(np.fft.rfft(residual, length))**2
    covariance = np.fft.irfft(power, length)[:lags + 1]
    return covariance[1:] / (covariance[0] or 1.0)
