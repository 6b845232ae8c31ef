#!/usr/bin/env python3
"""Turns a recorder's file into columns that beamid reads: UFF 58 and 58b (.uff .unv .uf), .mat,
.wav, .npy, .npz, .tdms, LabVIEW's .lvm, text (.csv .txt .tsv), and zip archives of text.

Every channel becomes a column, named with its unit; times come from the file, or from the rate that
it states. Text above the columns, behind '#', contains all else that the file says. Channels with
other times go into a file of their own. Values are not converted. Times of text become seconds if
they are time stamps, or if their column states another unit of time.
"""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from channels import REMARKS, BadTimes, Channel, stepped, text_of
from labview import read_lvm
from program import (CHECKOUT, IN_CHECKOUT, PYTHON, fail, new_parser, pip_install, reason, tell,
                     write_text)
from text_tables import MULTIPLES, PARTS, read_text, read_zip

# By suffix: the reader's name, the modules that it imports and what pip installs.
FORMATS = {**dict.fromkeys((".uff", ".unv", ".uf"), ("uff", "pyuff", "pyuff>=2.4")),
           ".mat": ("mat", "scipy", "scipy>=1.9"), ".wav": ("wav", "scipy", "scipy>=1.9"),
           ".npy": ("numpy", "numpy", "numpy>=1.24"), ".npz": ("numpy", "numpy", "numpy>=1.24"),
           ".tdms": ("tdms", "nptdms", "npTDMS>=1.6"),
           ".lvm": ("lvm", "numpy", "numpy>=1.24"), ".zip": ("zip", "numpy", "numpy>=1.24"),
           **dict.fromkeys((".csv", ".txt", ".tsv"), ("text", "numpy", "numpy>=1.24"))}
READERS = {"lvm": read_lvm, "text": read_text, "zip": read_zip}    # the others are below
# Names of variables, without case, blanks and underscores.
TIMES = {"t", "time", "times", "timestamp", "timestamps"}
RATES = {"fs", "rate", "samplerate", "samplingrate", "samplingfrequency", "samplefrequency", "sr"}
STEPS = {"dt", "ts", "increment", "deltat", "deltax", "sampletime", "samplingtime"}
STARTS = {"t0", "tstart", "starttime", "startvalue"}
UNITS = {"unit", "units", "unitlabel", "label"}
DIRECTIONS = ["", "+X", "+Y", "+Z", "+RX", "+RY", "+RZ", "-RZ", "-RY", "-RX", "-Z", "-Y", "-X"]
LONGEST = 90             # of the name of a column; beamid tells them apart by 100 bytes


def need(module, package, install):
    """Restarts with the Python of .venv where that has the module; installs it there only when
    asked to."""
    if find_spec(module):
        return
    if not IN_CHECKOUT:
        fail(f"no module {module}; install it by {pip_install(package)}", 1)
    if Path(sys.prefix).resolve() != PYTHON.parent.parent.resolve():
        if install:
            setup = [CHECKOUT / "scripts" / "setup.sh", "packages", package]
            if subprocess.run(setup).returncode:
                raise SystemExit(1)
        if PYTHON.exists() and not subprocess.run(
                [PYTHON, "-c", f"import {module}"], stderr=subprocess.DEVNULL).returncode:
            os.execv(PYTHON, [str(PYTHON), *sys.argv])
    elif install:
        fail(f"no module {module} in .venv, where pip was to install it", 1)
    fail(f"no module {module}: install it by --install, or by .venv/bin/pip install '{package}'", 1)


def read_uff(path):
    """Functions of time of the data sets 58; those of frequency are no records."""
    import pyuff
    file, channels, texts = pyuff.UFF(str(path)), [], []
    for k, kind in enumerate(file.get_set_types()):
        if int(kind) not in (58, 164):
            continue
        data = file.read_sets(k)
        words = {key: text_of("" if value is None else value) for key, value in data.items()
                 if key not in ("x", "data")}
        if int(kind) == 164:
            texts += [f"set {k + 1}, units: " + ", ".join(f"{key} {words[key]}" for key in (
                "units_code", "units_description", "length", "force", "temp") if key in words)]
        elif data["func_type"] not in (0, 1) or data["abscissa_spec_data_type"] not in (0, 17):
            REMARKS.append(f"set {k + 1} is no function of time: left out")
        else:
            channels.append(uff_channel(path, k + 1, data, words))
    return channels, texts


def uff_channel(path, number, data, words):
    """A data set 58; what the reader found behind its last sample is no sample."""
    n = data["num_pts"]
    if len(data["data"]) < n:
        fail(f"{path}: set {number}: found {len(data['data'])} samples, expected {n} as it says")
    notes = [words[f"id{k}"] for k in range(1, 6) if words.get(f"id{k}") not in ("NONE", "")]
    if data["abscissa_spacing"] == 1:
        notes.append(f"from {words['abscissa_min']} by {words['abscissa_inc']}")
    entity = words["rsp_ent_name"].replace("NONE", "") or "node"
    return Channel(f"{entity} {data['rsp_node']}{DIRECTIONS[data['rsp_dir']]}", data["data"][:n],
                   words["ordinate_axis_units_lab"].replace("NONE", ""), data["x"][:n],
                   words["abscissa_axis_units_lab"].replace("NONE", ""), notes)


def read_tdms(path):
    """The channels of all groups; stamps as seconds since the first."""
    import nptdms
    file = nptdms.TdmsFile.read(path)
    channels, texts = [], properties(file.properties)
    for group in file.groups():
        texts += [f"{group.name}: {text}" for text in properties(group.properties)]
        for channel in group.channels():
            known = channel.properties
            step, start = known.get("wf_increment"), known.get("wf_start_offset", 0.0)
            unit = known.get("unit_string") or known.get("NI_UnitDescription") or ""
            found = columns_of(f"{group.name}/{channel.name}", channel[:])
            for one in found:
                one.unit = one.unit or text_of(unit)
                one.notes += properties(known)
                one.times = (None if step is None else
                             stepped(len(one.values), step, start, name="wf_increment"))
                one.time_unit = "s"
            channels += found
    return channels, texts


def properties(known):
    """What a TDMS object says of itself."""
    return [f"{key} = {text_of(value)}" for key, value in known.items()]


def read_wav(path):
    """The channels of a sound file, in its own numbers."""
    from scipy.io import wavfile
    rate, data = wavfile.read(path)
    columns = data.reshape(len(data), -1).T
    return [Channel(f"channel {k + 1}", column,
                    times=stepped(len(column), 0, rate=rate, name="rate"), time_unit="s",
                    notes=[f"{rate} samples per s, {column.dtype}"])
            for k, column in enumerate(columns)], []


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
    """Sorts a value, and what is in it, into channels and what is known of them."""
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


def label(channel, taken=()):
    """The name of a column, with its unit: one that begins with a letter, and no other has."""
    name = re.sub(r"[,;\"\s]+", " ", channel.name + f" [{channel.unit}]" * bool(channel.unit))
    name = name.strip() if re.match(r"\s*[^\W\d_]", name) else f"channel {name.strip()}"
    name = name.encode()[:LONGEST].decode(errors="ignore")
    names = [name] + [f"{name} {k}" for k in range(2, len(taken) + 2)]
    return next(one for one in names if one.lower() not in map(str.lower, taken))


def chosen(channels, wanted, path):
    """The channels of these names, with or without unit, or numbers."""
    names = []
    for channel in channels:
        names.append(label(channel, names))
    if not wanted:
        return list(zip(names, channels))
    found = []
    for word in wanted:
        places = [k for k, channel in enumerate(channels)
                  if word.lower() in (names[k].lower(), channel.name.strip().lower())]
        if not places and word.isdigit() and 0 < int(word) <= len(channels):
            places = [int(word) - 1]
        if not places:
            listed = ", ".join(f"{k + 1} '{name}'" for k, name in enumerate(names[:20]))
            fail(f"{path}: no channel '{word}' (found: {listed}{', ...' * (len(names) > 20)})")
        found += [(names[k], channels[k]) for k in places]
    return found


def by_times(columns):
    """The channels in groups that share their times, or have none and as many samples."""
    groups = {}
    for name, channel in columns:
        times = None if channel.times is None else (channel.time_unit, channel.times.tobytes())
        groups.setdefault((len(channel.values), times), []).append((name, channel))
    return list(groups.values())


def table(path, texts, columns):
    """The text of a file of columns."""
    import numpy as np
    times, lines = columns[0][1].times, [f"from {path.name}"]
    for name, channel in columns:
        lines.append(f"column '{name}'" + ": " * bool(channel.notes) + "; ".join(channel.notes))
    header, series = [name for name, _ in columns], [channel.values for _, channel in columns]
    if times is not None:
        unit = columns[0][1].time_unit
        header, series = [f"t [{unit}]" if unit else "t", *header], [times, *series]
    for name, values in zip(header, series):
        bad = np.count_nonzero(~np.isfinite(values))
        if bad:
            tell(f"{path}: {name}: {bad} of {len(values)} samples are no finite numbers, "
                 "which beamid refuses")
    rows = zip(*(map(repr, values.tolist()) for values in series))
    return "".join([*(f"# {text_of(line)}\n" for line in lines + texts), ",".join(header), "\n",
                    *(",".join(row) + "\n" for row in rows)])


def main():
    parser = new_parser(__doc__.replace("\n", " "))
    parser.add_argument("file", metavar="FILE", help="the recorder's file")
    parser.add_argument("--out", metavar="FILE", help="columns to write (default: FILE with .csv)")
    parser.add_argument("--channel", metavar="NAME", nargs="+",
                        help="only these channels, by name or number")
    parser.add_argument("--time-unit", metavar="UNIT", choices=[*PARTS, *MULTIPLES],
                        help="unit of the times of a text that states none: "
                        + ", ".join((*PARTS, *MULTIPLES)))
    parser.add_argument("--install", action="store_true",
                        help="installs the library that reads this format into .venv")
    arguments = parser.parse_args()

    path = Path(arguments.file)
    if path.suffix.lower() not in FORMATS:
        fail(f"{path}: found '{path.suffix}', expected one of {' '.join(FORMATS)}"
             + "; export the sheet as CSV" * path.suffix.lower().startswith((".xls", ".ods")))
    if not path.is_file():
        fail(f"{path}: no such file")
    out = Path(arguments.out or path.with_suffix(".csv"))
    if out == path and not arguments.out:
        out = path.with_stem(f"{path.stem}_seconds")
    if out.exists() and not arguments.out:
        fail(f"{out}: exists; --out {out} replaces it")
    if out.exists() and out.samefile(path):
        fail(f"{out}: is the file to read, expected --out to name another")
    reader, module, package = FORMATS[path.suffix.lower()]
    if arguments.time_unit and reader not in ("text", "zip"):
        fail(f"--time-unit is for text, and {path} is not")
    need(module, package, arguments.install)
    try:
        channels, texts = (READERS.get(reader) or globals()[f"read_{reader}"])(
            path, *[arguments.time_unit] * bool(arguments.time_unit))
    except BadTimes as error:
        fail(f"{path}: {error}")
    except OSError as error:
        fail(f"{path}: {reason(error)}")
    except Exception as error:    # what the libraries raise is of every kind
        who = f"{module} cannot read it" if reader not in READERS else "cannot be read"
        fail(f"{path}: {who}: {text_of(error) or type(error).__name__}")
    if not channels:
        fail(f"{path}: found no series of real numbers in time, expected one or more"
             + "".join(f"; {remark}" for remark in REMARKS))
    for remark in REMARKS:
        tell(f"{path}: {remark}")
    for k, columns in enumerate(by_times(chosen(channels, arguments.channel, path))):
        target = out.with_stem(f"{out.stem}_{k + 1}") if k else out
        write_text(target, table(path, texts, columns))
        times = columns[0][1].times
        rate = ", rate=... (or time_column='...')" if times is None else ""
        print(f"{target}: {len(columns[0][1].values)} rows, {len(columns)} of {len(channels)} "
              f"channels, {'no times' if rate else 'with times'}")
        for name, _ in columns:
            quoted = name.replace("'", "''")
            print(f"   &record file='{target.name}', value_column='{quoted}'{rate} /")


if __name__ == "__main__":
    main()
