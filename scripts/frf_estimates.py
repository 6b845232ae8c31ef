"""Estimates frequency response functions (FRFs) from a measured force and measured responses, for
to_csv.py --frf.

The record is cut into blocks: one for each hammer blow, or blocks of equal distance. Averages over
the blocks give H1 = Sfy/Sff or H2 = Syy/Syf and the coherence |Sfy|^2/(Sff Syy).
"""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import text_tables
from channels import REMARKS
from frf_options import BEFORE
from program import fail
from responses import Response, measured_by, quantity_of, ratio_of_units

LARGEST_JITTER = 0.2     # of a sample interval
LEAST_SAMPLES = 16       # of a block
EARLY = 0.1              # of a block: where its free vibration is looked at first
PART = 4                 # parts of a block; the last one shows what is left
STRONG = 1e-4            # of the largest power: weaker lines are not judged
CHANCE = 0.01            # that noise passes for vibration
REMAINS = 0.01           # of the free vibration, from which on the script warns


@dataclass
class Spectra:
    """Averaged spectra of force and response over the blocks."""

    frequencies: np.ndarray
    force: np.ndarray        # Sff
    cross: np.ndarray        # Sfy
    response: np.ndarray     # Syy

    def h1(self):
        """Returns the FRF that noise of the response does not bias."""
        return self.cross / self.force

    def h2(self):
        """Returns the FRF that noise of the force does not bias."""
        return self.response / self.cross.conj()

    def coherence(self):
        """Returns the squared coherence."""
        return np.abs(self.cross)**2 / (self.force * self.response)


def rate_of(path, channels, given):
    """Returns the number of samples per second that channels share."""
    first = channels[0]
    for channel in channels[1:]:
        if len(channel.values) != len(first.values) or (
                (channel.times is None) != (first.times is None)) or (
                first.times is not None and not np.array_equal(channel.times, first.times)):
            fail(f"{path}: found other times for {channel.name} than for {first.name}, expected "
                 "the same")
    if first.times is None:
        if given is None:
            fail(f"{path}: found no times, expected --rate, the number of samples per s")
        return given
    if given is not None:
        fail(f"{path}: found times and --rate, expected one of them")
    times = np.asarray(first.times, float)
    grid = np.linspace(times[0], times[-1], len(times))
    step = (times[-1] - times[0]) / max(len(times) - 1, 1)
    away = np.abs(times - grid).max()
    if len(times) < 2 or not step > 0 or away > LARGEST_JITTER * step:
        fail(f"{path}: found times without a constant step (up to {away:.3g} from a mean step of "
             f"{step:.6g}), expected samples at a constant rate")
    # Ten digits: the times themselves are often rounded.
    return float(f"{text_tables.PARTS.get(text_tables.time_unit(first.time_unit), 1) / step:.10g}")


def blows(force, level, length, before):
    """Returns the first samples of the blocks, one for each blow whose block lies within the
    record, and remarks on the others.

    A blow begins where the magnitude of the force rises to the level. The next one is looked for
    behind the block.
    """
    above = np.abs(force) >= level
    rises = np.flatnonzero(above & ~np.append(False, above[:-1]))
    starts, outside, repeated, end = [], 0, 0, 0
    for at in rises:
        if at < end:
            continue
        start = at - before
        if start < 0 or start + length > len(force):
            outside += 1
            continue
        starts.append(start)
        end = start + length
        repeated += several(np.abs(force[at:end]), level)
    if outside:
        REMARKS.append(f"{outside} of {outside + len(starts)} blows are left out: their blocks "
                       "reach beyond the record")
    if repeated:
        REMARKS.append(f"{repeated} of {len(starts)} blocks contain more than one blow")
    return np.array(starts, dtype=int)


def several(force, level):
    """Tells whether the force rises to the level again after it has fallen below half of it."""
    low = np.flatnonzero(force < 0.5 * level)
    return bool(low.size and (force[low[0]:] >= level).any())


def cut(settings, force, rate):
    """Returns the first samples of the blocks and their length."""
    n = len(force)
    if settings.trigger is not None:
        length = round(settings.block * rate)
        share = settings.before if settings.before is not None else BEFORE * settings.block
        before = round(share * rate)
        if before >= length:
            fail(f"--pre-trigger: found {share:.6g} s, expected less than the block of "
                 f"{settings.block:.6g} s")
        starts = blows(force, settings.trigger, length, before)
        if not starts.size:
            fail(f"--trigger: found no blow of {settings.trigger:.6g} or more with a block of "
                 f"{settings.block:.6g} s, expected a lower level or a shorter block (largest "
                 f"magnitude of the force: {np.abs(force).max():.6g})")
        return starts[:settings.averages], length
    if settings.block is not None:
        length = round(settings.block * rate)
    else:
        length = int(n / (1 + (settings.averages - 1) * (1 - settings.overlap)))
    if not LEAST_SAMPLES <= length <= n:
        fail(f"--{'block' if settings.block is not None else 'averages'}: found blocks of {length} "
             f"samples, expected {LEAST_SAMPLES} to {n}, the length of the record")
    step = max(1, length - int(settings.overlap * length))
    return np.arange(0, n - length + 1, step)[:settings.averages], length


def window_of(settings, length, rate):
    """Returns the samples of the window."""
    from scipy.signal import get_window
    return get_window(settings.window, length) * np.exp(
        -settings.exponential * np.arange(length) / rate)


def spectra(force, response, starts, window, rate):
    """Returns the averaged spectra, without the lines at 0 Hz and at half the sampling rate.

    The line at 0 Hz contains the offsets of the sensors, the other one no imaginary part.
    """
    from scipy.signal import csd
    length, sums = len(window), [0.0, 0.0, 0.0]
    for start in starts:
        block = slice(start, start + length)
        for k, pair in enumerate(((force, force), (force, response), (response, response))):
            f, density = csd(*(values[block] for values in pair), rate, window=window,
                             nperseg=length, noverlap=0, detrend=False)
            sums[k] = sums[k] + density / len(starts)
    kept = slice(1, (length + 1) // 2)
    return Spectra(f[kept], sums[0].real[kept], sums[1][kept], sums[2].real[kept])


def independent_averages(starts, window):
    """Returns the number of blocks without overlap whose averages would scatter as much as those
    of the blocks, for noise that is white within the width of a line (Welch 1967)."""
    energy, total = np.sum(window**2), float(len(starts))
    for lag in range(1, len(starts)):
        shifts = starts[lag:] - starts[:-lag]
        shifts = shifts[shifts < len(window)]
        if not shifts.size:
            break
        for shift, count in zip(*np.unique(shifts, return_counts=True)):
            overlap = np.sum(window[shift:] * window[:len(window) - shift]) / energy
            total += 2 * count * overlap**2
    return len(starts)**2 / total


def without_offset(values, trigger):
    """Returns a channel without the offset of its sensor: the mean, or the median of the force of
    hammer blows, which is zero most of the time."""
    values = np.asarray(values, float)
    return values - (np.median(values) if trigger else values.mean())


def slowest(y, starts, length, rate):
    """Returns the frequency of the vibration that decays most slowly within the blocks, and the
    share of its amplitude that is left after a block; None if noise hides what is left.

    A line of the power spectrum late in the blocks is compared with the same line early in them.
    The noise is the median of the late lines.
    """
    size = length // PART
    if size < LEAST_SAMPLES:
        return None
    first, last = int(EARLY * length), length - size
    taper = np.hanning(size)
    early, late = (np.mean([np.abs(np.fft.rfft(taper * y[start + at:start + at + size]))**2
                            for start in starts], axis=0)[2:] for at in (first, last))
    # Averages of the power of noise over n blocks have a gamma distribution: a line is clear if
    # noise in any of all the lines exceeds it with the probability CHANCE only.
    from scipy.stats import gamma
    floor, n = np.median(late), len(starts)
    level = floor * gamma.isf(CHANCE / late.size, n) / gamma.median(n)
    clear = np.flatnonzero((early > STRONG * early.max()) & (early > level) & (late > level))
    if not clear.size:
        return None
    k = clear[np.argmax(late[clear] / early[clear])]
    left = math.sqrt(min(1.0, (late[k] - floor) / early[k]))
    return (k + 2) * rate / size, left**(length / (last - first))


def check_rest(channel, y, starts, window, rate):
    """Adds a remark if the response has not decayed at the end of the blocks, or at the next
    blow."""
    length = len(window)
    found = slowest(y, starts, length, rate)
    if found is None:
        return
    where = f"of the vibration at {found[0]:.3g} Hz is left at the"
    left = found[1] * window[-1] / window[0]
    if left > REMAINS:
        REMARKS.append(f"{channel.name}: {100 * left:.2g} % {where} end of a block, which makes "
                       "damping too high: choose a longer --block or an --exponential window")
    left = found[1]**(np.diff(starts).min(initial=100 * length) / length)
    if left > REMAINS:
        REMARKS.append(f"{channel.name}: {100 * left:.2g} % {where} next blow, which no window "
                       "removes: wait longer between blows")


def estimate(path, force, channels, settings, rate=None):
    """Returns the FRF of each response channel.

    rate  samples per second of channels without times
    """
    rate = rate_of(path, [force, *channels], rate)
    for channel in (force, *channels):
        if not np.isfinite(np.asarray(channel.values, float)).all():
            fail(f"{path}: {channel.name}: found samples that are no finite numbers")
    x = without_offset(force.values, settings.trigger is not None)
    starts, length = cut(settings, x, rate)
    window = window_of(settings, length, rate)
    count = independent_averages(starts, window)
    found = []
    for channel in channels:
        y = without_offset(channel.values, False)
        if settings.trigger is not None:
            check_rest(channel, y, starts, window, rate)
        averaged = spectra(x, y, starts, window, rate)
        if not (averaged.force.all() and averaged.response.all()):
            fail(f"{path}: found no {'response' if averaged.force.all() else 'force'} at some "
                 "frequencies, expected a spectrum above 0")
        found.append(response_of(force, channel, settings, averaged, (len(starts), count),
                                 length / rate, rate))
    if count < 2:
        REMARKS.append("one average has no coherence: the column is left out")
    return found


def response_of(force, channel, settings, averaged, counts, block, rate):
    """Returns an FRF with what the case file needs.

    counts  numbers of blocks and of independent averages
    """
    blocks, count = counts
    whole = math.floor(count + 1e-9)
    values = averaged.h1() if settings.estimator == "H1" else averaged.h2()
    overlap = f" with an overlap of {100 * settings.overlap:.4g} %" * (settings.overlap > 0)
    text = (f"{settings.estimator} from {blocks} block{'s' * (blocks > 1)} of {block:.6g} s"
            f"{overlap}, {rate:.8g} samples per s, window {settings.window}")
    keys = {"averages": f"{whole}", "window": f"'{settings.window}'"}
    if settings.exponential:
        text += f" times exp(-{settings.exponential:.8g} t)"
        keys["exponential_window"] = repr(settings.exponential)
    if whole < blocks:
        text += f"; they scatter like {count:.4g} averages without overlap"
    quantity = quantity_of(channel.measured or measured_by(channel.unit), "force")
    if not quantity:
        text += "; the response, without a unit of motion, counts as acceleration"
    notes = [text, *(f"channel '{one.name}'" + f" [{one.unit}]" * bool(one.unit)
                     + "".join(f"; {note}" for note in one.notes) for one in (force, channel))]
    return Response(
        f"FRF {channel.name}/{force.name}", averaged.frequencies, values,
        ratio_of_units(channel.unit, force.unit),
        quantity or "accelerance", averaged.coherence() if count >= 2 else None, notes, keys)
