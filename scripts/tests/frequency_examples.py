"""Structures with known frequency response functions, and their motion, for the tests.

The accelerance is the sum of the modes in closed form. The motion is that of a linear system under
a force that is linear between samples, by the matrix exponential (scipy.signal.lsim); both are
independent of the Fourier transforms of the estimators.
"""

import numpy as np
from scipy.signal import lsim

RATE = 2048.0    # samples per s
#: Frequency [Hz], damping ratio and modal constant [1/kg] of each mode.
MODES = ((40.0, 0.03, 0.5), (130.0, 0.02, -0.3))


def accelerance(f, modes=MODES, decay=0.0):
    """Returns the accelerance at frequencies [Hz]; `decay` [1/s] is added to all decay rates, as by
    an exponential window."""
    s = 2j * np.pi * f + decay
    total = 0.0
    for frequency, damping, constant in modes:
        w = 2 * np.pi * frequency
        total = total + constant * s**2 / (s**2 + 2 * damping * w * s + w**2)
    return total


def sampled_accelerance(f, rate=RATE, decay=0.0):
    """Returns the ratio of the discrete-time spectra of motion(force) and force.

    A force that is linear between samples has the spectrum of its samples times sinc(f/rate)^2 at
    all frequencies. Sampling the motion folds those above half the rate onto f. Far above the
    modes, the accelerance is the sum of the modal constants.
    """
    total, share = 0.0, 0.0
    for k in range(-100, 101):
        weight = np.sinc(f / rate + k)**2
        total = total + weight * accelerance(f + k * rate, decay=decay)
        share = share + weight
    return total + (1 - share) * sum(constant for *_, constant in MODES)


def motion(force, rate=RATE, modes=MODES):
    """Returns the accelerations under samples of a force, from rest."""
    t = np.arange(len(force)) / rate
    total = np.zeros(len(force))
    for frequency, damping, constant in modes:
        w = 2 * np.pi * frequency
        a = [[0.0, 1.0], [-w**2, -2 * damping * w]]
        system = (np.array(a), np.array([[0.0], [1.0]]),
                  constant * np.array([[-w**2, -2 * damping * w]]), np.array([[constant]]))
        total += lsim(system, force, t)[1]
    return total


def pulse(t, at, duration=0.004, height=50.0):
    """Returns a hammer blow without content above 1 kHz that matters: height times sin^4."""
    phase = (t - at) / duration
    return np.where((phase > 0) & (phase < 1), height * np.sin(np.pi * np.clip(phase, 0, 1))**4, 0)


def hammer_test(blows=8, spacing=2.0, noise=0.0, seed=1, rate=RATE, **options):
    """Returns times, force and accelerations with white noise of a standard deviation."""
    t = np.arange(round((blows * spacing + 0.5) * rate)) / rate
    generator = np.random.default_rng(seed)
    force = sum(pulse(t, 0.3 + k * spacing, height=50.0 + 5 * k) for k in range(blows))
    return t, force, motion(force, rate, **options) + noise * generator.standard_normal(len(t))
