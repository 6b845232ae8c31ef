#!/usr/bin/env python3
"""Turns a recorder's file into columns that beamid reads: UFF 58 and 58b (.uff .unv .uf), .mat,
.wav, .npy, .npz, .tdms, LabVIEW's .lvm, text (.csv .txt .tsv), and zip archives of text.

Every channel becomes a column, named with its unit; times come from the file, or from the rate that
it states. Text above the columns, behind '#', contains all else that the file says. Channels with
other times go into a file of their own. Values are not converted. Times of text become seconds if
they are time stamps, or if their column states another unit of time.

Frequency response functions (FRFs) of UFF and text become a file each, with their coherence. With
--frf, the script estimates the FRFs of measured responses per measured force.
"""

import math
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import responses
from channels import REMARKS, BadTimes, Channel, stepped, text_of
from frequency_tables import read_text
from frf_options import add_options, check_options, settings_of
from labview import read_lvm
from program import (CHECKOUT, IN_CHECKOUT, PYTHON, fail, new_parser, pip_install, reason, tell,
                     write_text)
from text_tables import MULTIPLES, PARTS, read_zip
from uff import read_uff
from variables import columns_of, read_mat, read_numpy

# By suffix: the reader's name, the modules that it imports and what pip installs.
FORMATS = {**dict.fromkeys((".uff", ".unv", ".uf"), ("uff", "pyuff", "pyuff>=2.4")),
           ".mat": ("mat", "scipy", "scipy>=1.9"), ".wav": ("wav", "scipy", "scipy>=1.9"),
           ".npy": ("numpy", "numpy", "numpy>=1.24"), ".npz": ("numpy", "numpy", "numpy>=1.24"),
           ".tdms": ("tdms", "nptdms", "npTDMS>=1.6"),
           ".lvm": ("lvm", "numpy", "numpy>=1.24"), ".zip": ("zip", "numpy", "numpy>=1.24"),
           **dict.fromkeys((".csv", ".txt", ".tsv"), ("text", "numpy", "numpy>=1.24"))}
OWN_READERS = {"lvm": read_lvm, "text": read_text, "zip": read_zip}    # without a library
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


LIBRARY_READERS = {"uff": read_uff, "mat": read_mat, "wav": read_wav, "numpy": read_numpy,
                   "tdms": read_tdms}


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


def command_line():
    """Returns the parser of the command line."""
    parser = new_parser(__doc__.replace("\n", " "))
    parser.add_argument("file", metavar="FILE", help="the recorder's file")
    parser.add_argument("--out", metavar="FILE", help="columns to write (default: FILE with .csv; "
                        "with --frf, FILE with _frf.csv)")
    parser.add_argument("--channel", metavar="NAME", nargs="+",
                        help="only these channels or FRFs, by name or number")
    parser.add_argument("--time-unit", metavar="UNIT", choices=[*PARTS, *MULTIPLES],
                        help="unit of the times of a text that states none: "
                        + ", ".join((*PARTS, *MULTIPLES)))
    parser.add_argument("--install", action="store_true",
                        help="installs the library that reads this format into .venv")
    add_options(parser)
    return parser


def target_of(arguments, path, of_frequency):
    """Returns the file to write; one that is there needs --out.

    of_frequency  whether the file is to contain an FRF
    """
    ending = "_frf" if of_frequency else "_seconds"
    out = Path(arguments.out or (path.with_name(f"{path.stem}_frf.csv") if arguments.frf else
                                 path.with_suffix(".csv")))
    if out == path and not arguments.out:
        out = path.with_stem(path.stem + ending)
    if out.exists() and not arguments.out:
        fail(f"{out}: exists; --out {out} replaces it")
    if out.exists() and out.samefile(path):
        fail(f"{out}: is the file to read, expected --out to name another")
    return out


def read_channels(path, arguments):
    """Returns the channels and FRFs of a file, and the texts above them."""
    reader, module, package = FORMATS[path.suffix.lower()]
    if arguments.time_unit and reader not in ("text", "zip"):
        fail(f"--time-unit is for text, and {path} is not")
    need(module, package, arguments.install)
    try:
        return (OWN_READERS | LIBRARY_READERS)[reader](
            path, *[arguments.time_unit] * bool(arguments.time_unit))
    except BadTimes as error:
        fail(f"{path}: {error}")
    except OSError as error:
        fail(f"{path}: {reason(error)}")
    except Exception as error:    # the libraries raise errors of every kind
        who = "cannot be read" if reader in OWN_READERS else f"{module} cannot read it"
        fail(f"{path}: {who}: {text_of(error) or type(error).__name__}")


def estimated(path, channels, arguments):
    """Returns the FRFs of --frf."""
    import frf_estimates
    settings = settings_of(arguments)
    channels = [channel for channel in channels if isinstance(channel, Channel)]
    (_, force), *more = chosen(channels, [arguments.force], path)
    responses = [channel for _, channel in chosen(channels, arguments.response, path)]
    if more or force in responses:
        fail(f"--force: found '{arguments.force}', expected one channel that is no response")
    return frf_estimates.estimate(path, force, responses, settings, arguments.rate)


def write_channels(path, out, texts, groups, count):
    """Writes channels, a file for each group, and prints their &record groups."""
    for target, columns in groups:
        write_text(target, table(path, texts, columns))
        times = columns[0][1].times
        rate = ", rate=... (or time_column='...')" if times is None else ""
        print(f"{target}: {len(columns[0][1].values)} rows, {len(columns)} of {count} "
              f"channels, {'no times' if rate else 'with times'}")
        for name, _ in columns:
            quoted = name.replace("'", "''")
            print(f"   &record file='{target.name}', value_column='{quoted}'{rate} /")


def write_responses(path, files, texts, estimates):
    """Writes FRFs, a file for each, and prints their &record groups.

    estimates  whether the script has estimated the FRFs, whose first note then says how
    """
    for target, response in files:
        if not all(map(math.isfinite, [*response.values.real, *response.values.imag])):
            tell(f"{path}: {response.name}: some values are no finite numbers, which beamid "
                 "refuses")
        write_text(target, responses.table(path, texts, response))
        print(f"{target}: {responses.description(response)}")
        if estimates:
            print(f"   {response.notes[0]}")
        print(f"   {responses.record_line(response, target.name)}")


def main():
    arguments = command_line().parse_args()
    path = Path(arguments.file)
    if path.suffix.lower() not in FORMATS:
        fail(f"{path}: found '{path.suffix}', expected one of {' '.join(FORMATS)}"
             + "; export the sheet as CSV" * path.suffix.lower().startswith((".xls", ".ods")))
    if not path.is_file():
        fail(f"{path}: no such file")
    check_options(arguments)
    out = target_of(arguments, path, arguments.frf)
    if arguments.frf:
        need("scipy", "scipy>=1.9", arguments.install)
    channels, texts = read_channels(path, arguments)
    if not channels:
        fail(f"{path}: found neither a time series nor an FRF, expected one or more"
             + "".join(f"; {remark}" for remark in REMARKS))
    if arguments.frf:
        found = [(response.name, response) for response in estimated(path, channels, arguments)]
    else:
        found = chosen(channels, arguments.channel, path)
    for remark in REMARKS:
        tell(f"{path}: {remark}")
    frfs = [one for _, one in found if isinstance(one, responses.Response)]
    groups = by_times([pair for pair in found if isinstance(pair[1], Channel)])
    if not groups:
        out = target_of(arguments, path, True)
    targets = [out.with_stem(f"{out.stem}_{k + 1}") if k else out
               for k in range(len(groups) + len(frfs))]
    write_channels(path, out, texts, list(zip(targets, groups)), len(channels))
    write_responses(path, list(zip(targets[len(groups):], frfs)), texts, arguments.frf)


if __name__ == "__main__":
    main()
