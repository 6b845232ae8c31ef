#!/usr/bin/env python3
"""Plots a parameter that `beamid track` has followed -> DIR/track.png: the estimate of each window
with its 95 % interval, and the share of the energy that the model leaves unexplained. With a
reference it prints how far the estimates are from it."""

from pathlib import Path

import plotting as p
import plot_fit
import numpy as np

FLAGS = (("moving", p.ORANGE), ("unseen", p.GREY), ("gap", p.PURPLE))


def read_track(directory):
    """The parameter, its unit, and the columns of track.csv by name: nan where a limit is missing,
    flags as texts."""
    names = ("t_first", "t_last", "estimate", "lower95", "upper95", "misfit")
    rows = p.read_table(directory / "track.csv", "parameter", "flag", "unit", *names)
    columns = {name: np.array([float(row[name] or "nan") for row in rows]) for name in names}
    columns["flag"] = np.array([row["flag"] for row in rows])
    columns["middle"] = (columns["t_first"] + columns["t_last"]) / 2
    return rows[0]["parameter"], rows[0]["unit"], columns


def read_reference(path, columns):
    """Times and values of a reference."""
    rows = p.read_table(path, *columns)
    return np.array([[p.number(row, name) for name in columns] for row in rows]).T


def of_windows(track, reference):
    """The mean of a reference in each window."""
    t, values = reference
    sums = np.concatenate([[0.0], np.cumsum(values)])
    first = np.searchsorted(t, track["t_first"])
    last = np.searchsorted(t, track["t_last"], side="right")
    return (sums[last] - sums[first]) / np.maximum(last - first, 1)


def metrics(track, truth):
    """How far the windows without a flag are from the truth: the rms value, and the metrics of the
    papers on DROPBEAR: MSE; SNR in dB; TRAC, the squared cosine between the two."""
    clear = (track["flag"] == "") & np.isfinite(truth)
    if not clear.any():
        p.fail("found no window without a flag, expected some to compare with the reference")
    estimate, truth = track["estimate"][clear], truth[clear]
    mse = np.mean((estimate - truth)**2)
    held = (track["lower95"][clear] <= truth) & (truth <= track["upper95"][clear])
    return dict(rms=np.sqrt(mse), mse=mse, snr=10 * np.log10(np.mean(truth**2) / mse),
                trac=np.sum(estimate * truth)**2 / np.sum(estimate**2) / np.sum(truth**2),
                held=np.mean(held), windows=int(clear.sum()))


def view(track):
    """The range of the parameter that a picture shows: that of the windows without a flag."""
    clear = track["flag"] == ""
    shown = track["estimate"][clear] if clear.any() else track["estimate"]
    span = np.ptp(shown) or abs(shown[0]) or 1.0
    return shown.min() - 0.3 * span, shown.max() + 0.3 * span


def draw(name, unit, track, time, truth=None):
    """A panel for the parameter and one for the misfit; returns the figure."""
    figure, (above, below) = p.plt.subplots(2, sharex=True, figsize=(7.5, 6), height_ratios=(3, 1))
    t, clear = track["middle"], track["flag"] == ""
    low, high = view(track)
    above.fill_between(t, np.nan_to_num(track["lower95"], nan=low),
                       np.nan_to_num(track["upper95"], nan=high, posinf=high), color=p.SKY,
                       alpha=0.4, linewidth=0, label="95 % interval")
    for flag, colour in FLAGS:
        mine = track["flag"] == flag
        if mine.any():
            above.plot(t[mine], track["estimate"][mine], ".", color=colour, markersize=2,
                       label=flag)
    above.plot(t[clear], track["estimate"][clear], ".", color=p.BLUE, markersize=3,
               label="no flag")
    if truth is not None:
        above.plot(t, truth, color="black", linewidth=0.9, label="reference")
    above.set_ylim(low, high)
    above.set_ylabel(p.with_unit(p.symbol(name), unit))
    above.legend(markerscale=4, ncols=3, loc="best")
    below.plot(t, track["misfit"], color=p.GREY, linewidth=0.9)
    below.set(ylim=(0, 1), ylabel="unexplained share")
    below.set_xlabel(p.with_unit("middle of the window", time))
    return figure


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=p.outputs, help="output folder of track")
    parser.add_argument("--reference", metavar="FILE", help="table with an independent measurement")
    parser.add_argument("--columns", metavar="NAME", nargs=2, default=("time", "value"),
                        help="its columns of times and values (default: time value)")
    parser.add_argument("--line", metavar="NUMBER", nargs=2, type=float,
                        help="parameter = first + second * value (default: a line fitted to the "
                        "windows without a flag)")
    parser.add_argument("--out", metavar="FILE", help="picture (default: DIR/track.png)")
    arguments = parser.parse_args()

    name, unit, track = read_track(arguments.directory)
    truth = None
    if arguments.reference:
        measured = of_windows(track, read_reference(arguments.reference, arguments.columns))
        clear = track["flag"] == ""
        if not arguments.line and clear.sum() < 3:
            p.fail(f"{arguments.directory}: found {clear.sum()} windows without a flag, expected "
                   "three or more to fit a line, or --line")
        slope, constant = (arguments.line[::-1] if arguments.line else
                           np.polyfit(measured[clear], track["estimate"][clear], 1))
        truth = constant + slope * measured
        found = metrics(track, truth)
        print(f"reference = {constant:.6g} + {slope:.6g} * {arguments.columns[1]}\n"
              f"{found['windows']} windows without a flag: rms {found['rms']:.4g}, "
              f"MSE {found['mse']:.4g}, SNR {found['snr']:.1f} dB, TRAC {found['trac']:.6f}\n"
              f"{100 * found['held']:.1f} % of their intervals hold the reference")
    time = plot_fit.read_units(arguments.directory).get("time", "")
    figure = draw(name, unit, track, time, truth)
    figure.suptitle(f"{p.case_name(arguments.directory)}: {p.symbol(name)} in each window")
    p.save(figure, Path(arguments.out or arguments.directory / "track.png"))


if __name__ == "__main__":
    main()
