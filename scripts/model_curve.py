"""The curve of a fitted model between the samples of its record, for report.py.

fit.csv has the model at the sample times only. A straight line from sample to sample would show
corners that the model does not have. So the program computes the fitted model at times between the
samples, if the case is simple enough to be written down again with the estimates. The curve is used
only if it agrees with fit.csv at the sample times. Otherwise the samples are interpolated by a
windowed sinc, which is right for a model without content above half the sampling rate.
"""

import os
import subprocess
import tempfile
from pathlib import Path

import cases as c
import numpy as np
import signals as s
from program import CHECKOUT, IN_CHECKOUT, PROGRAM

FINE = 10            # times of the curve for each sample interval
MOST_SAMPLES = 1000  # of a record whose model the program computes again
AGREES = 1e-5        # relative to the rms value of the model
LOBES = 12           # of the windowed sinc
DROPPED = ("stage", "prior", "multistart", "windows", "sample", "bootstrap", "design", "ensemble",
           "draw", "score", "noise", "integrator", "discretization")
KEPT = ("x_s", "x_p", "length", "sensor")    # keys of &record that belong to the structure


def executable():
    """Returns the program if it can run without a build, else None."""
    if not IN_CHECKOUT or os.environ.get("BEAMID_PROGRAM"):
        return PROGRAM if PROGRAM.exists() else None
    built = sorted(CHECKOUT.glob("build/gfortran_*/app/beamid"), key=lambda path:
                   path.stat().st_mtime)
    return built[-1] if built else None


def even(t):
    """Tells whether times have one step."""
    steps = np.diff(t)
    return len(t) > 2 and bool(np.ptp(steps) < 1e-6 * abs(steps.mean()))


def fitted_case(text, estimates, elements, t):
    """Returns the text of a case that simulates the fitted model at fine times, or None if the
    case cannot be written down so.

    `estimates` has the free parameters by name, `t` the sample times.
    """
    groups = [(name, dict(keys)) for name, keys, _ in c.read_groups(text)]
    records = [keys for name, keys in groups if name == "record"]
    kinds = [c.unquoted(keys.get("kind")).lower() for name, keys in groups if name == "excitation"]
    if len(records) != 1 or kinds not in (["pulse"], ["release"]):
        return None
    for name, value in estimates.items():
        holders = [keys for group, keys in groups if name.lower() in keys and group != "units"]
        if len(holders) != 1:
            return None
        holders[0][name.lower()] = [repr(float(value))]
    record = {key: values for key, values in records[0].items() if key in KEPT}
    step = (t[-1] - t[0]) / ((len(t) - 1) * FINE)
    record |= {"t_first": [repr(float(t[0]))], "t_last": [repr(float(t[-1] + 0.1 * step))],
               "t_step": [repr(float(step))]}
    mesh = next((keys for name, keys in groups if name == "discretization"), {})
    mesh["elements"] = [str(elements)]
    kept = [(name, keys) for name, keys in groups if name not in (*DROPPED, "record")]
    return "".join(c.group_text(*group) for group in
                   [*kept, ("discretization", mesh), ("record", record)])


def simulated(text):
    """Returns times and accelerations that the program simulates for a case file's text, or None
    if it fails."""
    program = executable()
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.nml"
        path.write_text(text, encoding="utf-8")
        done = subprocess.run([program, "simulate", path, "--quiet", "--out", folder],
                              capture_output=True, timeout=120)
        if done.returncode:
            return None
        return s.read_columns(Path(folder) / "response.csv", "t", "acceleration")


def interpolated(t, values):
    """Returns fine times and values between even samples by a sinc with a Kaiser window."""
    reach = min(LOBES, len(t) - 1)
    # Reflected about the end points, a curve goes on without a corner.
    before = 2 * values[0] - values[reach:0:-1]
    behind = 2 * values[-1] - values[-2:-reach - 2:-1]
    padded = np.concatenate([before, values, behind])
    offsets = np.arange(FINE) / FINE
    taps = np.arange(1 - reach, reach + 1)
    distance = taps[None, :] - offsets[:, None]
    weights = np.sinc(distance) * np.i0(8.0 * np.sqrt(np.clip(1 - (distance / reach)**2, 0, 1)))
    weights /= weights.sum(axis=1, keepdims=True)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach)[1:len(values)]
    fine = np.append((windows @ weights.T).ravel(), values[-1])
    return np.linspace(t[0], t[-1], len(fine)), fine


def model_curve(case, estimates, elements, t, model):
    """Returns fine times, the values of the fitted model there, and how they were found:
    "computed", "interpolated" or "samples".

    `case` is the text of the case file or None, `estimates` are the free parameters by name, `t`
    and `model` are the samples.
    """
    if len(t) < 4 or not even(t):
        return t, model, "samples"
    text = None
    if case and len(t) <= MOST_SAMPLES:
        free = {name: value for name, value in estimates.items() if name != "offset"}
        text = fitted_case(case, free, elements, t)
    found = simulated(text) if text else None
    if found is not None:
        fine, values = found
        values = values + estimates.get("offset", 0.0)
        error = np.abs(np.interp(t, fine, values) - model).max()
        if error < AGREES * np.sqrt(np.mean(model**2)):
            return fine, values, "computed"
    return (*interpolated(t, model), "interpolated")
