#!/usr/bin/env python3
"""Finds where the roller of a measured beam stood in each dwell, from its vibration, and compares
the places with the voltage that was recorded of the roller. Writes

    dwell_NN.csv     time (s), acceleration (V), roller (V): the free decays, cut from DIR/test*.txt
    dwell_NN.nml     the place in one dwell; the support is rigid, the sensor has 40 g
    joint.nml        all dwells: a place for each, one sensor's mass, one stiffness of the support
    rigid.nml        the same with a rigid support
    without_N.nml    joint.nml without the dwells at the N-th place
    places.csv       voltage, place and the place's distance from a straight line, of joint.nml
    roller_beam.png  the same as a picture
    track_N.csv, track_N.nml    the N-th trial as a whole, for the command track
    track_N.png      the place in each window of .5 s, beside a line through the voltage

The record is that of Vereen, Downey, Dodson and Moura. docs/tutorials/moving-support.md says where
to find it."""

import os
import subprocess
from pathlib import Path

import plot_track
import plotting as p
import numpy as np
from program import release, tell, write_text

SOURCE = ("Record: Vereen, Downey, Dodson, Moura (2023), Dataset-8-DROPBEAR-Acceleration-vs-Roller-"
          "Displacement\nof the High-Rate SHM Working Group. Record and this picture: CC BY-SA 4.0")
COLUMNS = ("Time", "Low G Accel", "PinLoc")    # in the recorder's files
STILL = 0.010        # V in 20 ms: a roller that moves more is not at rest
NEAR = 0.012         # V, some .6 mm: so near to where it stays a roller has arrived
REST = 0.5           # s, the shortest dwell that is used; --shortest
LENGTH = 0.3         # s of each dwell that are fitted; mode 2 is gone by then
FILTER = 0.012       # s, what `thin` takes at either end
RINGS = 0.010        # V rms; before its first move the roller leaves the beam at rest
FIRST = 0.08         # m, start of the first place, near the clamp in the photograph
APART = 0.1          # V between the places where the roller dwells

# Steel, 51 x 6.66 x 501 mm; the sensor's place was measured in the photograph.
CASE = """&beam           length=0.501, rho=2.666, E=2e11, width=0.051, height=0.00666, c_D=4e6 /
&sensor         m_S=0.04, x_S=0.338 /
&support        x_P={place:.6f}{stiffness} /
&excitation     kind='free', modes=2 /
&discretization degree=5, elements=12 /
{records}&stage          {stage} /
&units          length='m', force='N', time='s', mass='kg' /
"""
# The frequencies of the beam differ from those of the model by some .5 %.
TRACK = ("&track          parameter='x_P', window=0.5, hop=0.001, rate=0.05, "
         "frequency_error=0.005 /\n")


def read(path):
    """Time (s), acceleration and roller (V) of one of the recorder's files."""
    rows = [line.split("\t") for line in p.read_text(path).splitlines()]
    head = next((k for k, row in enumerate(rows) if set(COLUMNS) <= {name.strip() for name in row}),
                None)
    if head is None:
        p.fail(f"{path}: found no line with the columns {', '.join(COLUMNS)}")
    names = [name.strip() for name in rows[head]]
    places = [names.index(name) for name in COLUMNS]
    # Below the names are their units, and lines that the recorder leaves empty.
    values = [row for row in rows[head + 2:] if len(row) == len(names) and all(row)]
    try:
        return np.array([[float(row[place]) for place in places] for row in values]).T
    except ValueError as error:
        p.fail(f"{path}: {error}, expected numbers below the line of names")


def decays(t, acceleration, roller, shortest=REST):
    """The samples of each dwell that are fitted: the roller has arrived, the beam rings."""
    step = np.median(np.diff(t))
    half = round(0.01 / step)
    weights = np.full(2 * half, 0.5 / half)
    mean = np.convolve(np.pad(roller, half, mode="edge"), weights, "same")[half:-half]
    moving = np.ones(t.size, bool)
    moving[half:-half] = abs(mean[2 * half:] - mean[:-2 * half]) > STILL
    ends = np.flatnonzero(np.diff(moving)) + 1
    for first, last in zip(ends[::2], ends[1::2]):
        level = np.median(roller[(first + last) // 2:last])
        arrived = first + np.flatnonzero(np.append(True, abs(mean[first:last] - level) > NEAR))[-1]
        spare = round(FILTER / step)
        part = slice(max(arrived - spare, 0), min(last, arrived + round(LENGTH / step) + spare))
        if (last - first) * step > shortest and acceleration[part].std() > RINGS:
            yield part


def cut(directory, out, shortest):
    """Writes a record of each dwell; the roller's mean voltage in each."""
    volts = []
    for path in sorted(directory.glob("test*.txt")):
        columns = read(path)
        for part in decays(*columns, shortest):
            rows = np.transpose(columns)[part]
            volts.append(rows[:, 2].mean())
            write_text(out / f"dwell_{len(volts):02}.csv", "time,acceleration,roller\n" +
                       "".join(f"{t:.4f},{a:.6g},{volt:.6g}\n" for t, a, volt in rows))
    if not volts:
        p.fail(f"{directory}: found no file test*.txt with a dwell in which the beam rings")
    return np.array(volts)


def identify(program, path, **words):
    """Runs a case; the rows of its estimates by name. Where the program sees no fit it is told."""
    write_text(path, CASE.format(**words))
    out = path.with_suffix("")
    done = subprocess.run([program, "identify", path, "--quiet", "--out", out], text=True,
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    if done.returncode:
        message = done.stderr.strip().removeprefix("beamid: ")
        (tell if "no fit" in message else p.fail)(message)
    rows = p.read_table(p.outputs(out) / "estimates.csv", "parameter", "estimate")
    return {row["parameter"]: row for row in rows}


def record(k, more=""):
    """The group of a case file that names the k-th dwell."""
    return f"&record         file='dwell_{k:02}.csv', thin=4, sd=0.02{more} /\n"


def one_by_one(program, out, count):
    """The place in each dwell for itself; the search begins at that in the dwell before."""
    places = [FIRST]
    for k in range(1, count + 1):
        found = identify(program, out / f"dwell_{k:02}.nml", place=places[-1], stiffness="",
                         records=record(k), stage="free='x_P','c_D','offset'")
        places.append(p.number(found["x_P"], "estimate"))
    return list(enumerate(places))[1:]


def jointly(program, path, starts, *shared):
    """Some dwells in one fit: their numbers, and the place that each has found for itself."""
    names = ",".join(f"'{name}'" for name in shared)
    return identify(program, path, place=FIRST, stiffness=", k_P=2e7" * ("k_P" in shared),
                    records="".join(record(k, f", x_P={start:.6f}") for k, start in starts),
                    stage=f"free='x_P','c_D',{names},'offset', shared={names}, start='case'")


def in_interval(row):
    """An estimate and its interval, the corrected one where residuals are not white."""
    kind = "95_corrected" if row.get("lower95_corrected") else "95"
    value, lower, upper = (float(row[key]) for key in ("estimate", f"lower{kind}", f"upper{kind}"))
    return f"{value:.4g} {row['unit']} ({lower:.4g} to {upper:.4g})"


def judge(name, found, volts):
    """Prints what the dwells have in common; places and a straight line through them."""
    places = np.array([p.number(found[f"x_P({k + 1})"], "estimate") for k in range(volts.size)])
    slope, constant = np.polyfit(volts, places, 1)
    away = places - constant - slope * volts
    common = "".join(f", {key} = {in_interval(found[key])}" for key in ("m_S", "k_P")
                     if key in found)
    print(f"{name}: J = {p.number(found['J'], 'estimate'):.4g}{common}\n"
          f"  place = {1e3 * constant:.2f} mm + {1e3 * slope:.2f} mm/V, "
          f"{1e3 * np.sqrt(np.mean(away**2)):.2f} mm rms of {volts.size} dwells, "
          f"{1e3 * abs(away).max():.2f} mm at most", flush=True)
    return places, away


def correlation(out):
    """That of the sensor's mass with the support's stiffness."""
    rows = p.read_table(out / "correlations.csv", "parameter", "other", "correlation")
    return next(p.number(row, "correlation") for row in rows
                if (row["parameter"], row["other"]) == ("m_S", "k_P"))


def draw(volts, places, away, path):
    """Place against voltage, and how far from a straight line."""
    figure, (above, below) = p.plt.subplots(2, sharex=True, figsize=(7, 6.5), height_ratios=(2, 1))
    above.plot(volts, 1e3 * places, "o", color=p.BLUE, label="by beamid, one for each dwell")
    order = np.argsort(volts)
    above.plot(volts[order], 1e3 * (places - away)[order], color=p.GREY, zorder=1,
               label="straight line")
    above.set_ylabel("place of the roller (mm)")
    above.legend()
    below.axhline(0, color=p.GREY)
    below.plot(volts, 1e3 * away, "o", color=p.BLUE)
    below.set_ylabel("from the line (mm)")
    below.set_xlabel("recorded voltage of the roller (V)")
    figure.suptitle(f"Place against voltage, {volts.size} dwells")
    figure.supxlabel(SOURCE, fontsize=7, color=p.GREY)
    p.save(figure, path)


def track(program, directory, out, found):
    """Follows the roller through whole trials, with what the dwells have told of sensor and
    support, and compares it with a line through the voltage that the first trial fixes."""
    known = {name: p.number(found[name], "estimate") for name in ("m_S", "k_P")}
    slope = constant = None
    for n, path in enumerate(sorted(directory.glob("test*.txt")), 1):
        columns = read(path)
        write_text(out / f"track_{n}.csv", "time,acceleration,roller\n" + "".join(
            f"{t:.4f},{a:.6g},{volt:.6g}\n" for t, a, volt in columns.T))
        case = CASE.format(place=FIRST, stiffness=f", k_P={known['k_P']:.6g}",
                           records=f"&record         file='track_{n}.csv', sd=0.02 /\n",
                           stage="free='x_P','c_D','offset'")
        write_text(out / f"track_{n}.nml", case.replace("m_S=0.04", f"m_S={known['m_S']:.6g}")
                   + TRACK)
        folder = out / f"track_{n}"
        done = subprocess.run([program, "track", out / f"track_{n}.nml", "--quiet", "--out",
                               folder], text=True, capture_output=True)
        if done.returncode:
            p.fail(done.stderr.strip().removeprefix("beamid: "))
        name, unit, followed = plot_track.read_track(p.outputs(folder))
        volts = plot_track.of_windows(followed, columns[[0, 2]])
        if slope is None:
            clear = followed["flag"] == ""
            slope, constant = np.polyfit(volts[clear], followed["estimate"][clear], 1)
        line = constant + slope * volts
        of = plot_track.metrics(followed, line)
        print(f"track {path.name}: {1e3 * of['rms']:.2f} mm rms of {of['windows']} windows without "
              f"a flag, SNR {of['snr']:.1f} dB, TRAC {of['trac']:.5f}\n"
              f"  {100 * of['held']:.0f} % of their intervals hold {1e3 * constant:.2f} mm + "
              f"{1e3 * slope:.2f} mm/V", flush=True)
        figure = plot_track.draw(name, unit, followed, "s", line)
        figure.supxlabel(SOURCE, fontsize=7, color=p.GREY)
        p.save(figure, out / f"track_{n}.png")


def main():
    """From the recorder's files to the picture."""
    parser = p.new_parser(__doc__.split(" Writes")[0])
    parser.add_argument("directory", metavar="DIR", type=Path, help="the recorder's test*.txt")
    parser.add_argument("--out", type=Path, default=Path("out/roller_beam"))
    parser.add_argument("--quick", action="store_true", help="joint.nml alone, not those beside it")
    parser.add_argument("--shortest", type=float, default=REST, metavar="SECONDS",
                        help=f"the shortest dwell that is used (default: {REST})")
    options = parser.parse_args()
    program = os.environ.get("BEAMID_PROGRAM") or release()     # tests bring one of their own
    out = options.out
    volts = cut(options.directory, out, options.shortest)
    starts = one_by_one(program, out, volts.size)
    found = jointly(program, out / "joint.nml", starts, "m_S", "k_P")
    places, away = judge("elastic support", found, volts)
    print(f"  correlation of m_S with k_P: {correlation(out / 'joint'):.2f}")
    write_text(out / "places.csv", "voltage,place,residual\n" + "".join(
        f"{volt:.6f},{place:.8f},{rest:.8f}\n" for volt, place, rest in zip(volts, places, away)))
    draw(volts, places, away, out / "roller_beam.png")
    if options.quick:
        return
    judge("rigid support", jointly(program, out / "rigid.nml", starts, "m_S"), volts)
    order = np.argsort(volts)
    levels = np.split(order, np.flatnonzero(np.diff(volts[order]) > APART) + 1)
    for n, left_out in enumerate(levels, 1):
        rest = np.setdiff1d(order, left_out)
        found = jointly(program, out / f"without_{n}.nml", [starts[k] for k in rest], "m_S", "k_P")
        judge(f"without the dwells at {volts[left_out].mean():.2f} V", found, volts[rest])
        if n == 1:
            best = found
    track(program, options.directory, out, best)


if __name__ == "__main__":
    main()
