#!/usr/bin/env python3
"""Plots the records of a case before any fit -> out/CASE/record.png: the record and its window,
its spectrum, and where the modes of the case's structure lie with the start values."""

import contextlib
import subprocess
import tempfile
from pathlib import Path

import plotting as p
import cases as c
import signals as s
import numpy as np
from program import PROGRAM, read_text, write_text

FIT = ("excitation", "stage", "multistart", "score", "noise")    # groups of no use here
OWN = {"beam": "length", "sensor": "x_s"}
STRUCTURE = ("beam", "tip", "sensor", "hose", "discretization")
MOST_MODES = 6
FAR = 0.1      # a peak further than this from a mode, relatively, is not taken for it


def run_modes(case, text):
    """Frequencies of the structure of a case file's text on its finest mesh, by the program.

    The program judges the groups it is given, and what is wrong with them is told in its words.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.nml"
        write_text(path, text)
        done = subprocess.run([PROGRAM, "modes", path, "--quiet", "--out", folder],
                              stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode:
            lines = done.stderr.strip().splitlines() or ["the program failed"]
            message = lines[-1].removeprefix("beamid: ").replace(str(path), str(case))
            p.fail(message, done.returncode)
        rows = p.read_table(Path(folder) / "modes.csv", "elements", "frequency_hz",
                            "damping_ratio")
    return [p.number(row, "frequency_hz") for row in rows
            if row["elements"] == rows[-1]["elements"] and p.number(row, "damping_ratio") < 1]


def changed(groups, record):
    """The structure during a record that has a beam length or a sensor place of its own."""
    structure = {name: dict(keys) for name, keys, _ in groups if name in STRUCTURE}
    for name, key in OWN.items():
        if key in record:
            structure.setdefault(name, {})[key] = record[key]
    return "".join(c.group_text(*group) for group in structure.items())


def pairs(modes, peaks, heights):
    """For each mode the strongest peak near it, or None."""
    found = []
    for mode in modes:
        near = [(height, peak) for peak, height in zip(peaks, heights)
                if abs(peak - mode) < FAR * mode]
        found.append(max(near)[1] if near else None)
    return found


def inside(t, window):
    """Which samples are in the window; rounding of its ends costs none."""
    slack = 1e-3 * np.median(np.diff(t))
    return (t >= window[0] - slack) & (t <= window[1] + slack)


def draw_record(axes, t, a, window):
    """The whole record, and what lies in its window in colour."""
    axes.plot(*s.envelope(t, a), color="0.6", linewidth=0.7)
    part = inside(t, window)
    axes.plot(*s.envelope(t[part], a[part]), color=p.BLUE, linewidth=0.7)
    axes.axvspan(max(window[0], t[0]), min(window[1], t[-1]), color=p.SKY, alpha=0.18, linewidth=0)
    axes.set_xlim(t[0], t[-1])
    axes.set_title("record; in blue from t_first to t_last", fontsize=9, color=p.GREY)


def draw_spectrum(axes, f, amplitude, modes, peaks, heights, hertz):
    """The window's spectrum, its peaks, and the modes."""
    axes.loglog(*s.highest(f, amplitude), color="black", linewidth=0.9)
    axes.set_xlim(f[0], f[-1])
    top, floor = amplitude.max(), np.percentile(amplitude, 20)
    if top > 0:
        axes.set_ylim(max(floor / 3, 1e-8 * top, 1e-300), 6 * top)
    for peak, height in zip(peaks, heights):
        crowded = (heights > height) & (abs(np.log(peaks / peak)) < 0.07 * np.log(f[-1] / f[0]))
        if crowded.any():
            continue
        axes.annotate(f"{peak:.4g}", (peak, height), xytext=(0, 3), textcoords="offset points",
                      ha="center", fontsize=8.5, color=p.VERMILION,
                      bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})
    axes.plot(peaks, heights, "v", color=p.VERMILION, markersize=4)
    p.mark_frequencies(axes, modes)
    p.plain_logarithmic(axes.xaxis)
    axes.set_title(f"spectrum of the window, with its peaks ({hertz}); green: modes of the case",
                   fontsize=9, color=p.GREY)


def draw_table(axes, modes, near, hertz):
    """Mode, its frequency with the start values, the peak near it and how far off that is."""
    axes.set_axis_off()
    axes.set_title("Modes of the case and peaks of the record", fontsize=10)
    columns = ((0.03, "left"), (0.42, "right"), (0.7, "right"), (0.98, "right"))
    lines = [("mode", f"case ({hertz})", f"peak ({hertz})", "case/peak")]
    for k, (mode, peak) in enumerate(zip(modes, near)):
        lines.append((f"{k + 1}", f"{mode:.5g}", f"{peak:.5g}" if peak else "\u2013",
                      f"{100 * (mode / peak - 1):+.1f} %".replace("-", "\u2212") if peak else ""))
    for k, line in enumerate(lines):
        for (x, side), text in zip(columns, line):
            axes.text(x, 0.93 - 0.085 * k, text, ha=side, va="top", fontsize=9,
                      color=p.GREEN if k and x < 0.5 else p.VERMILION if k else p.GREY)


def draw(title, t, a, window, modes, units):
    """The figure of one record; also the lines for standard output."""
    acceleration, amplitude = (p.with_unit(quantity, units["acceleration"])
                               for quantity in ("acceleration", "amplitude"))
    hertz = p.frequency_unit(units["time"])
    part = inside(t, window)
    if part.sum() < 8:
        p.fail(f"{title}: {part.sum()} samples between t_first = {window[0]:g} and t_last = "
               f"{window[1]:g}, expected 8 or more (the record: {t[0]:g} to {t[-1]:g})")
    f, spectrum = s.spectrum(t[part], a[part])
    peaks, heights = s.peaks(f, spectrum, t[part][-1] - t[part][0])
    modes = [mode for mode in modes[:MOST_MODES] if f[0] < mode < f[-1]]
    near = pairs(modes, peaks, heights)

    figure = p.plt.figure(figsize=(11, 6.8))
    grid = figure.add_gridspec(2, 2, height_ratios=[1, 1.35], width_ratios=[1.9, 1])
    figure.suptitle(f"Record before the fit: {title}", x=0.01, ha="left")
    whole = figure.add_subplot(grid[0, 0])
    draw_record(whole, t, a, window)
    span = s.some_cycles(t[part], a[part])
    zoom = figure.add_subplot(grid[0, 1])
    zoom.set_title("a few cycles of the lowest mode seen" if span else
                   "the window, sample by sample", fontsize=9, color=p.GREY)
    span = span or (t[part][0], t[part][-1])
    seen = part & (t >= span[0]) & (t <= span[1])
    zoom.plot(t[seen], a[seen], ".-", color=p.BLUE, linewidth=0.6,
              markersize=float(np.clip(800 / seen.sum(), 1, 5)))
    for axes in (whole, zoom):
        axes.set_xlabel(p.with_unit("time", units["time"]))
    whole.set_ylabel(acceleration)
    below = figure.add_subplot(grid[1, 0])
    draw_spectrum(below, f, spectrum, modes, peaks, heights, hertz)
    below.set(xlabel=p.with_unit("frequency", hertz), ylabel=amplitude)
    figure.align_ylabels([whole, below])
    draw_table(figure.add_subplot(grid[1, 1]), modes, near, hertz)
    for k, (mode, peak) in enumerate(zip(modes, near)):
        seen = (f"peak at {peak:.5g} {hertz}" if peak else f"no peak within {100 * FAR:g} %"
                if mode * (t[part][-1] - t[part][0]) > s.LEAST_CYCLES else
                f"fewer than {s.LEAST_CYCLES} cycles in the window")
        print(f"mode {k + 1}: {mode:.5g} {hertz} with the start values, {seen}")
    return figure


def main():
    parser = p.new_parser(__doc__.replace("\n", " "))
    parser.add_argument("case", metavar="CASE", help="case file")
    parser.add_argument("--out", metavar="FILE",
                        help="picture to write (default: out/CASE/record.png)")
    arguments = parser.parse_args()

    case = Path(arguments.case)
    path = Path(arguments.out or Path("out") / case.stem / "record.png")
    text = read_text(case)
    modes = run_modes(case, c.without(text, FIT))    # without a stage the program fits nothing
    groups = c.read_groups(text)
    records = [keys for name, keys, _ in groups if name == "record"]
    if not records:
        p.fail(f"{case}: no group &record, nothing to draw")
    labels = {key: c.unquoted(values)
              for name, keys, _ in groups if name == "units" for key, values in keys.items()}
    length, time = labels.get("length", ""), labels.get("time", "")
    units = {"time": time, "acceleration": f"{length}/{time}^2" if length and time else ""}
    with contextlib.suppress(OSError):    # what is wrong shows when the picture is written
        path.parent.mkdir(parents=True, exist_ok=True)
    for k, record in enumerate(records):
        t, a = c.read_samples(case, record)
        window = [c.real(record, key, end) for key, end in (("t_first", t[0]), ("t_last", t[-1]))]
        title = case.stem.replace("$", r"\$") + f", record {k + 1}" * (len(records) > 1)
        own = set(record) & set(OWN.values())
        figure = draw(title, t, a, window,
                      run_modes(case, changed(groups, record)) if own else modes, units)
        p.save(figure, p.numbered(path, k + 1))


if __name__ == "__main__":
    main()
