#!/usr/bin/env python3
"""Plots how a fit converges with the number of elements -> DIR/convergence.png."""

import plotting as p
import numpy as np


def read_values(path):
    """A CSV file with parameter,value as a dictionary."""
    rows = p.read_table(path, "parameter", "value")
    return {row["parameter"]: p.number(row, "value") for row in rows}


def series(meshes):
    """From values by parameter, by mesh, to (elements, values) by parameter."""
    names = dict.fromkeys(name for values in meshes.values() for name in values)
    meshes = sorted(meshes.items())
    return {name: np.array([(n, values[name]) for n, values in meshes if name in values]).T
            for name in names}


def read_paper(path):
    """A CSV file with elements,parameter,value as series; nothing without the file."""
    meshes = {}
    if path.exists():
        for row in p.read_table(path, "elements", "parameter", "value"):
            values = meshes.setdefault(p.number(row, "elements", int), {})
            values[row["parameter"]] = p.number(row, "value")
    return series(meshes)


def hollow(colour, marker="o"):
    """The look of the paper's points."""
    return dict(linestyle="none", marker=marker, markersize=8, markerfacecolor="none", color=colour)


def draw_sum_of_squares(axes, ours, paper):
    """J against N; with the paper's J also ours times 16, the constant factor between the two."""
    axes.set_title("Sum of squared residuals")
    axes.set_ylabel("$J$")
    axes.plot(*ours, "o-", color=p.BLUE, label="$J$")
    if paper is not None:
        axes.plot(ours[0], 16 * ours[1], "--", color=p.ORANGE, label=r"16 $\times$ $J$")
        axes.plot(*paper, **hollow("black"), label="$J$ in the paper")
    axes.legend()


def draw_errors(axes, ours, paper, truth, what):
    """Relative differences of the parameters from their true values, or from the finest mesh."""
    axes.set_title(f"Estimates: difference from {what}")
    axes.set_ylabel("relative difference")

    def draw_series(name, data, **style):
        error = np.abs(data[1] / truth[name] - 1)
        error[error == 0] = np.nan    # no place on a logarithmic axis
        axes.plot(data[0], error, **style)

    for k, (name, data) in enumerate(ours.items()):
        colour, marker = p.COLOURS[k % 6], p.MARKERS[k % 6]
        draw_series(name, data, color=colour, marker=marker, markersize=5, label=p.symbol(name))
        if name in paper:
            draw_series(name, paper[name], **hollow(colour, marker))
    handles = axes.get_legend_handles_labels()[0]
    if any(name in paper for name in ours):
        handles.append(p.plt.Line2D([], [], **hollow(p.GREY), label="in the paper"))
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def draw(directory, ours, paper, truth):
    """The figure: J on the left, the parameters on the right."""
    what = "the true values" if truth else "the finest mesh"
    truth = truth or {name: values[-1] for name, (_, values) in ours.items()}
    parameters = {name: data for name, data in ours.items() if name != "J" and truth.get(name)}
    if not parameters:
        p.fail(f"{directory}: no parameter with a nonzero reference value")

    figure, (left, right) = p.plt.subplots(1, 2, figsize=(10.5, 4.6), sharex=True,
                                           width_ratios=[1, 1.15])
    figure.get_layout_engine().set(wspace=0.06)
    title = f"Convergence with the number of elements: {p.case_name(directory)}"
    figure.suptitle(title, x=0.01, ha="left")
    draw_sum_of_squares(left, ours["J"], paper.get("J"))
    draw_errors(right, parameters, paper, truth, what)
    for axes in (left, right):
        axes.set_yscale("log")
        axes.set_xlabel("number of elements $N$")
        axes.grid(which="minor", axis="y", color="0.95", linewidth=0.4)
    elements = ours["J"][0].astype(int)
    if elements[-1] > 8 * elements[0]:
        left.set_xscale("log")
    if len(elements) <= 10:
        left.set_xticks(elements, labels=elements)
        left.set_xticks([], minor=True)
    return figure


def picture(directory, truth_file=None):
    """The figure of an output folder; without `truth_file` its truth.csv, if there is one."""
    meshes = {n: {row["parameter"]: p.number(row, "estimate") for row in rows}
              for n, rows in p.last_stage(directory).items()}
    if len(meshes) < 2:
        p.fail(f"{directory / 'estimates.csv'}: one number of elements only, nothing to compare")
    ours = series(meshes)
    if "J" not in ours:
        p.fail(f"{directory / 'estimates.csv'}: no row with parameter = J")
    own = directory / "truth.csv"
    truth = read_values(truth_file or own) if truth_file or own.exists() else None
    return draw(directory, ours, read_paper(directory / "paper.csv"), truth)


def main():
    parser = p.new_parser(__doc__)
    parser.add_argument("directory", metavar="DIR", type=p.outputs, help="output folder of a fit")
    parser.add_argument("--truth", metavar="FILE", help="true values (default: DIR/truth.csv)")
    parser.add_argument("--out", metavar="FILE", help="picture (default: DIR/convergence.png)")
    arguments = parser.parse_args()

    figure = picture(arguments.directory, arguments.truth)
    p.save(figure, arguments.out or arguments.directory / "convergence.png")


if __name__ == "__main__":
    main()
