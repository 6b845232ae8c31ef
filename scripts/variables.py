"""Reads named variables: the files of MATLAB and NumPy. Series become channels; times, rates and
units are found by their names."""

import re

from channels import REMARKS, Channel, stepped, text_of
from program import fail

# Names of variables, without case, blanks and underscores.
TIMES = {"t", "time", "times", "timestamp", "timestamps"}
RATES = {"fs", "rate", "samplerate", "samplingrate", "samplingfrequency", "samplefrequency", "sr"}
STEPS = {"dt", "ts", "increment", "deltat", "deltax", "sampletime", "samplingtime"}
STARTS = {"t0", "tstart", "starttime", "startvalue"}
UNITS = {"unit", "units", "unitlabel", "label"}


def read_mat(path):
    """The variables of a MATLAB file."""
    from scipy.io import loadmat
    try:
        found = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        fail(f"{path}: found version 7.3, expected one that SciPy reads: save(..., '-v7')")
    return from_variables({key: value for key, value in found.items() if key[:2] != "__"})


def read_numpy(path):
    """The array or arrays of a NumPy file."""
    import numpy as np
    found = np.load(path, allow_pickle=False)
    if path.suffix.lower() == ".npy":
        return from_variables({path.stem: found})
    return from_variables({key: found[key] for key in found.files})


def from_variables(variables):
    """Channels from named values: vectors, columns of matrices; and times, rates and units by their
    names, next to each channel first."""
    channels, known = [], {}
    collect("", variables, channels, known)
    others = [channel.name for channel in channels if last(channel.name) not in TIMES]
    for channel in channels:
        set_times(channel, channels, known, others)
    used = {id(channel.times) for channel in channels}
    channels = [channel for channel in channels if id(channel.values) not in used]
    for channel in channels:
        own = [key for key in known if plain(key) in
               (plain(channel.name) + "unit", plain(channel.name) + "units")]
        near = [key for key in near_to(channel, known, UNITS, others)
                if "." in key or len(channels) == 1]
        if not channel.unit and len(own or near) == 1:
            channel.unit = text_of(known[(own or near)[0]])
    return channels, [f"{key} = {text_of(value)}" for key, value in known.items()]


def collect(name, value, channels, known):
    """Adds the series in a value to `channels`, and its single numbers and texts to `known`."""
    import numpy as np
    if isinstance(value, dict):
        for key, one in value.items():
            collect(f"{name}.{key}" if name else key, one, channels, known)
    elif isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray)
                                              and value.dtype.kind == "O"):
        for k, one in enumerate(np.ravel(np.array(value, dtype=object))):
            collect(f"{name}({k + 1})", one, channels, known)
    elif isinstance(value, np.ndarray) and value.dtype.names:
        for key in value.dtype.names:
            collect(f"{name}.{key}", value[key], channels, known)
    elif np.size(value) == 1 or isinstance(value, (str, bytes)):
        known[name] = value.item() if isinstance(value, np.ndarray) else value
    elif np.size(value) > 1:
        channels += columns_of(name, np.asarray(value))


def columns_of(name, values):
    """A channel from a vector, one for each column of a matrix; the longer side is time."""
    import numpy as np
    values = np.squeeze(values)
    if values.dtype.kind == "M":
        seconds = (values - values[0]) / np.timedelta64(1, "s")
        return [Channel(name, seconds, "s", notes=[f"since {values[0]}"])]
    if values.dtype.kind not in "biuf" or values.ndim not in (1, 2) or values.size < 2:
        REMARKS.append(f"{name} holds no series of real numbers: left out")
        return []
    if values.dtype.kind == "b":
        values = values.astype(int)
    if values.dtype.kind == "f":
        values = values.astype(float)    # NumPy prints those of extended precision with their type
    if values.ndim == 1:
        return [Channel(name, values)]
    columns = values.T if values.shape[0] >= values.shape[1] else values
    return [Channel(f"{name}({k + 1})", column) for k, column in enumerate(columns)]


def plain(name):
    """A name without case, blanks and underscores."""
    return re.sub(r"[\s_]", "", name).lower()


def last(name):
    """The last part of a name, plain."""
    return plain(name.split(".")[-1])


def near_to(channel, names, wanted, others):
    """The names whose last part is one of those wanted, in the innermost structure around the
    channel that has any; what stands in a structure beside one of the other channels is theirs."""
    def is_theirs(name):
        around = name.rpartition(".")[0] + "."
        return (len(around) > 1 and not channel.name.startswith(around)
                and any(other.startswith(around) for other in others))

    parts = channel.name.split(".")
    for depth in range(len(parts) - 1, -1, -1):
        inside = ".".join(parts[:depth]) + "." if depth else ""
        found = [name for name in names if name.startswith(inside) and last(name) in wanted
                 and not is_theirs(name)]
        if found:
            return found
    return []


def set_times(channel, channels, known, others):
    """Times of a channel: a series of that name and length that grows, else one rate or step."""
    import numpy as np
    series = {one.name: one.values for one in channels if one is not channel
              and len(one.values) == len(channel.values) and (np.diff(one.values) > 0).all()}
    numbers = {name: float(value) for name, value in known.items()
               if isinstance(value, (int, float, np.integer, np.floating))}
    times = near_to(channel, series, TIMES, others)
    rates = near_to(channel, numbers, RATES | STEPS, others)
    starts = near_to(channel, numbers, STARTS, others)
    if last(channel.name) in TIMES:
        return
    if len(times) == 1:
        channel.times = series[times[0]]
    elif len(rates) > 1:
        REMARKS.append(f"{channel.name} gets no times: found {', '.join(rates)}, expected one")
    elif rates:
        start = numbers[starts[0]] if len(starts) == 1 else 0.0
        step = numbers[rates[0]]
        rate = step if last(rates[0]) in RATES else None
        channel.times = stepped(len(channel.values), step, start, rate, rates[0])
