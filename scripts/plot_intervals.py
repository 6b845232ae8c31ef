#!/usr/bin/env python3
"""Plots what profile, sample and bootstrap have found -> DIR/profiles.png, posterior.png (or
bootstrap.png), posterior_motion.png: profiles of J, draws and intervals of all methods, motion."""

import math

import plotting as p
import plot_fit
import signals as s
import numpy as np

#: Methods of intervals.csv: name, colour, line and mark, told apart without colours too.
METHODS = {
    "linear": ("linear theory", "black", ":", "o"), "profile": ("profile", p.VERMILION, "-", "s"),
    "posterior": ("posterior", p.BLUE, "--", "D"), "bca": ("bootstrap (BCa)", p.GREEN, "-.", "^")}
MOST = 8         # parameters in a corner plot
BINS = 36
LEVELS = (0.95, 0.5)    # shares of the draws within the contours
SIDE = 1.95      # of a panel [in]


def finest(rows):
    """The rows of the finest mesh."""
    n = max(p.number(row, "elements", int) for row in rows)
    return [row for row in rows if row["elements"] == str(n)], n


def end_of(text):
    """A number that may be infinite."""
    try:
        return float(text)
    except ValueError:
        return math.nan


class Interval:
    """A method's 95 % interval of what was searched for: of a stiffness 1/k_R its reciprocal."""

    def __init__(self, row, name):
        self.unit = row["unit"]
        self.estimate, *ends = (end_of(row[key]) for key in ("estimate", "lower95", "upper95"))
        states = [row["lower_end"], row["upper_end"]]
        if name.startswith("1/"):
            self.estimate, *ends = (1 / x if x else math.inf for x in (self.estimate, *ends[::-1]))
            states = states[::-1]
            self.unit = f"1/({self.unit})" if self.unit else ""
        self.ends, self.states = ends, states

    def half_width(self):
        """Of linear theory, by an end that no bound has cut off; nan without one."""
        widths = [abs(end - self.estimate) for end, state in zip(self.ends, self.states)
                  if state == "closed" and math.isfinite(end)]
        return max(widths, default=math.nan)


class Found:
    """The outputs of the three commands in a folder, on one mesh; what is not there is None."""

    def __init__(self, folder, elements=None):
        self.folder = folder
        self.units = plot_fit.read_units(folder)
        self.elements = elements
        self.rows = self.table("intervals.csv", "method", "elements", "parameter", "unit",
                               "estimate", "lower95", "upper95", "lower_end", "upper_end") or []
        self.profiles = self.table("profiles.csv", "elements", "parameter", "value", "distance",
                                   "lower_end", "upper_end")
        self.draws = self.columns("posterior.csv", 4)
        self.resampled = self.columns("bootstrap.csv", 2)
        self.motion = self.samples("posterior_motion.csv", "record", "t", "lower95", "median",
                                   "upper95")
        self.record = self.samples("fit.csv", "t", "measured", "residual")

    def anything(self):
        """Whether one of the commands has been here."""
        return bool(self.profiles or self.draws or self.resampled or self.motion is not None)

    def chosen(self, rows, name):
        """The rows of the mesh that is shown."""
        if self.elements is None:
            rows, self.elements = finest(rows)
            return rows
        mine = [row for row in rows if row["elements"] == str(self.elements)]
        if not mine:
            p.fail(f"{self.folder / name}: nothing for {self.elements} elements")
        return mine

    def table(self, name, *columns):
        """Rows of a file, or None."""
        path = self.folder / name
        return self.chosen(p.read_table(path, *columns), name) if path.exists() else None

    def columns(self, name, first):
        """Values by parameter, whose names stand in the header from a column on, or None."""
        path = self.folder / name
        if not path.exists():
            return None
        names = p.header(path)[first:]
        values = self.on_mesh(path, names)
        return dict(zip(names, values))

    def on_mesh(self, path, names):
        """Columns of the mesh that is shown."""
        elements, *values = s.read_columns(path, "elements", *names)
        if self.elements is None:
            self.elements = int(elements.max())
        mine = elements == self.elements
        if not mine.any():
            p.fail(f"{path}: nothing for {self.elements} elements")
        return np.array(values)[:, mine]

    def samples(self, name, *columns):
        """Columns as an array with a row for each, or None; of fit.csv on the same mesh only."""
        path = self.folder / name
        if not p.has_rows(path):    # a fit of frequency responses or modes alone has no samples
            return None
        if name != "fit.csv":
            return self.on_mesh(path, columns)
        more = ["record"] * ("record" in p.header(path))
        elements, *values = s.read_columns(path, "elements", *columns, *more)
        values = np.array(values if more else [*values, np.ones_like(elements)])
        return values[:, elements == self.elements]

    def interval(self, method, name):
        """A method's interval of a parameter as it was searched for, or None."""
        for row in self.rows:
            if (row["method"], row["parameter"]) == (method, name.removeprefix("1/")):
                return Interval(row, name)
        return None

    def unit(self, name):
        """The unit of a parameter as it was searched for."""
        found = [self.interval(method, name) for method in METHODS]
        return next((interval.unit for interval in found if interval), "")


def symbol_of(name):
    """1/k_R, or a parameter of one record or point: m_S.a, E(2)."""
    stem, mark, rest = name.removeprefix("1/").partition("(")
    stem, dot, point = stem.partition(".")
    text = p.symbol(stem) + dot + point + mark + rest
    return f"1/{text}" if name.startswith("1/") else text


def scale_of(values):
    """The power of ten that goes into the label, for ticks without exponents."""
    values = np.abs(values[np.isfinite(values)])
    largest = values.max(initial=0)
    if not largest > 0 or 0.1 <= largest < 1e4:
        return 0
    return 3 * math.floor(math.log10(largest) / 3)


def label_of(name, unit, power):
    """The parameter's symbol, the power of ten of its numbers, and its unit."""
    ten = f"10$^{{{power}}}$" if power else ""
    inside = f"{ten} {p.unit_text(unit)}".strip()
    return f"{symbol_of(name)} ({inside})" if inside else symbol_of(name)


# -- profiles

def shown_side(values, distance, state):
    """The outer end of a side that is drawn: where an open one has flattened, else its last."""
    if state != "unbounded" or len(values) < 3:
        return values[-1]
    return values[np.argmax(np.abs(distance) >= 0.98 * np.abs(distance).max())]


def told_end(value, state, side):
    """How an end is told."""
    number = p.plain_number(value, 3)
    return {"bound": f"bound {number}", "unbounded": "no limit →" if side > 0 else "← no limit",
            "unknown": f"lost at {number}"}.get(state, number)


def curve(x, y, at):
    """Through the points by cubics that rise and fall with them (Fritsch and Butland)."""
    if len(x) < 3:
        return np.interp(at, x, y)
    slopes = np.diff(y) / np.diff(x)
    product = slopes[1:] * slopes[:-1]
    total = np.where(product > 0, slopes[1:] + slopes[:-1], 1.0)
    d = np.concatenate([slopes[:1], np.where(product > 0, 2 * product / total, 0), slopes[-1:]])
    k = np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2)
    h = x[k + 1] - x[k]
    u = (at - x[k]) / h
    return ((1 - u)**2 * (1 + 2 * u) * y[k] + u**2 * (3 - 2 * u) * y[k + 1]
            + h * u * (1 - u) * ((1 - u) * d[k] - u * d[k + 1]))


def draw_profile(axes, rows, found, name):
    """Rise of J over the parameter, the 95 % level, the parabola of linear theory, the ends."""
    value, z = (np.array([p.number(row, key) for row in rows]) for key in ("value", "distance"))
    states = (rows[0]["lower_end"], rows[0]["upper_end"])
    best = int(np.argmin(np.abs(z)))
    outer = [shown_side(value[best::-1], z[best::-1], states[0]),
             shown_side(value[best:], z[best:], states[1])]
    told = found.interval("profile", name)
    for k in (0, 1):    # the last fit may have been just inside the bound
        if told and states[k] == "bound" and math.isfinite(told.ends[k]):
            outer[k] = told.ends[k]
    low, high = outer
    logarithmic = low > 0 and high > 30 * value[best]
    power = 0 if logarithmic else scale_of(np.array([low, high]))
    unit = 10.0**power
    fine = np.geomspace(low, high, 400) if logarithmic else np.linspace(low, high, 400)
    fine = fine[(fine >= value[0]) & (fine <= value[-1])]
    linear = found.interval("linear", name)
    axes.axhline(1, color=p.GREY, linewidth=1, linestyle="--")
    margin = 0.17 * (high - low)
    left, right = (low / 1.6, high * 1.6) if logarithmic else (low - margin, high + margin)
    if linear and linear.half_width() > 0:
        wide = np.linspace(left, right, 400)
        axes.plot(wide / unit, ((wide - linear.estimate) / linear.half_width())**2, color="black",
                  linestyle=":", linewidth=1.5, label="parabola of linear theory")
    # The distance is nearly straight, so its square is smooth between points.
    axes.plot(fine / unit, curve(value, z, fine)**2, color=p.VERMILION, linewidth=1.8,
              label="profile: least $J$ at each value")
    inside = (value >= low) & (value <= high)
    axes.plot(value[inside] / unit, z[inside]**2, "s", color=p.VERMILION, markersize=3.5)
    axes.plot(value[best] / unit, 0, "o", color="black", markersize=5, label="estimate",
              clip_on=False, zorder=4)
    for end, state, side in zip(outer, states, (-1, 1)):
        if state != "unbounded":
            axes.vlines(end / unit, 0, 1, color=p.VERMILION, linewidth=1.1,
                        linestyle="-" if state == "bound" else (0, (2, 2)))
        axes.annotate(told_end(end / unit, state, side), (end / unit, 1), xytext=(0, 5),
                      textcoords="offset points", fontsize=8.5,
                      ha="left" if side < 0 else "right",
                      bbox=dict(facecolor="white", edgecolor="none", pad=0.6))
    if logarithmic:
        axes.set_xscale("log")
    axes.set(xlim=(left / unit, right / unit), ylim=(0, 1.42), yticks=[0, 0.5, 1],
             xlabel=label_of(name, found.unit(name), power))


def draw_profiles(found):
    """The figure of all profiles."""
    by_name = {}
    for row in found.profiles:
        by_name.setdefault(row["parameter"], []).append(row)
    across = min(len(by_name), 2 if len(by_name) < 7 else 3)
    down = math.ceil(len(by_name) / across)
    size = max(5.4, 4.1 * across), 2.5 * down + 1.1
    figure, panels = p.plt.subplots(down, across, figsize=size, squeeze=False)
    for axes, (name, rows) in zip(panels.flat, by_name.items()):
        draw_profile(axes, rows, found, name)
    for axes in panels.flat[len(by_name):]:
        axes.set_axis_off()
    for axes in panels[:, 0]:
        axes.set_ylabel("rise of $J$ (95 %: 1)")
    handles = {label: handle for axes in panels.flat for handle, label in
               zip(*axes.get_legend_handles_labels())}
    figure.suptitle(f"Profiles of J, $N$ = {found.elements}: {p.case_name(found.folder)}", x=0.01,
                    ha="left")
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3,
                  columnspacing=1.2)
    return figure


# -- draws

def smooth(counts):
    """A histogram of two parameters, its noise averaged over neighbours."""
    kernel = np.exp(-0.5 * (np.arange(-3, 4) / 1.2)**2)
    for axis in (0, 1):
        counts = np.apply_along_axis(np.convolve, axis, counts, kernel / kernel.sum(), "same")
    return counts


def heights_of(counts):
    """Heights above which the shares LEVELS of all draws lie, ascending."""
    ordered = np.sort(counts.ravel())[::-1]
    sums = np.cumsum(ordered)
    return [ordered[np.searchsorted(sums, level * sums[-1])] for level in LEVELS]


def range_of(values):
    """Nearly all of the draws, with a little room."""
    low, high = np.quantile(values, (0.001, 0.999))
    room = 0.08 * (high - low) or 0.05 * abs(low) or 1.0
    return low - room, high + room


def draw_pair(axes, x, y, spans, at):
    """Draws of two parameters: density in grey, contours about half and 95 % of them."""
    counts, *edges = np.histogram2d(x, y, bins=BINS, range=spans)
    density = smooth(counts).T
    middle = [(edge[1:] + edge[:-1]) / 2 for edge in edges]
    axes.pcolormesh(*edges, density, cmap="Greys", vmax=1.6 * density.max(), rasterized=True)
    heights = heights_of(density)
    if heights[0] < heights[1]:
        axes.contour(*middle, density, levels=heights, colors=p.BLUE, linewidths=(1.0, 1.4),
                     linestyles=("--", "-"))
    if all(map(math.isfinite, at)):
        axes.plot(*at, "+", color="black", markersize=9, markeredgewidth=1.6)
    axes.set(xlim=spans[0], ylim=spans[1])


def draw_single(axes, name, found, values, others, span, unit):
    """Histograms of one parameter, and below them the interval of every method."""
    heights, _, _ = axes.hist(values, BINS, range=span, density=True, color="0.82",
                              edgecolor="0.55", linewidth=0.3)
    top = heights.max()
    if others is not None:
        count, _, _ = axes.hist(others, BINS, range=span, density=True, histtype="step",
                                color=p.GREEN, linewidth=1.2)
        top = max(top, count.max())
    step = 0.13 * top
    known = [method for method in METHODS if found.interval(method, name)]
    for k, method in enumerate(known):
        _, colour, line, mark = METHODS[method]
        interval = found.interval(method, name)
        y = -(k + 0.9) * step
        ends = [min(max(end / unit, span[0]), span[1]) if not math.isnan(end) else edge
                for end, edge in zip(interval.ends, span)]
        axes.plot(ends, [y, y], color=colour, linestyle=line, linewidth=1.6)
        axes.plot(interval.estimate / unit, y, mark, color=colour, markersize=4)
        for end, state, place, away in zip(ends, interval.states, span, "<>"):
            beyond = state == "unbounded" or end == place
            axes.plot(end, y, away if beyond else "|", color=colour, markersize=5 if beyond else 6)
    axes.axhline(0, color=p.GREY, linewidth=0.8)
    axes.set(xlim=span, ylim=(-(len(known) + 0.7) * step, 1.08 * top), yticks=[])
    axes.grid(False)
    axes.spines["left"].set_visible(False)


def draw_corner(found):
    """Histograms on the diagonal, pairs below it; of draws, or where there are none of estimates
    of resampled records."""
    draws = found.draws or found.resampled
    others = found.resampled if found.draws else None
    names = list(draws)
    hidden = names[MOST:]
    names = names[:MOST]
    n = len(names)
    values, spans, units, labels = {}, {}, {}, {}
    for name in names:
        power = scale_of(draws[name])
        units[name] = 10.0**power
        values[name] = draws[name] / units[name]
        spans[name] = range_of(values[name])
        labels[name] = label_of(name, found.unit(name), power)
    side = max(SIDE, 4.4 / n)
    size = side * n + 0.5, side * n + (0.9 if n > 1 else 1.6)
    figure, panels = p.plt.subplots(n, n, figsize=size, squeeze=False)
    figure.get_layout_engine().set(hspace=0.02, wspace=0.02)
    best = {name: getattr(found.interval("linear", name), "estimate", math.nan) / units[name]
            for name in names}
    for i, row in enumerate(names):
        for j, column in enumerate(names):
            axes = panels[i, j]
            if j > i:
                axes.set_axis_off()
                continue
            if j == i:
                other = others[row] / units[row] if others and row in others else None
                draw_single(axes, row, found, values[row], other, spans[row], units[row])
            else:
                draw_pair(axes, values[column], values[row], (spans[column], spans[row]),
                          (best[column], best[row]))
                axes.grid(False)
                axes.yaxis.set_major_locator(p.matplotlib.ticker.MaxNLocator(3))
            axes.xaxis.set_major_locator(p.matplotlib.ticker.MaxNLocator(3))
            axes.tick_params(labelsize=8, labelbottom=i == n - 1, labelleft=0 == j < i)
            if i == n - 1:
                axes.set_xlabel(labels[column], fontsize=9)
            if j == 0 and i > 0:
                axes.set_ylabel(labels[row], fontsize=9)
    figure.align_labels()
    kind = "Posterior" if found.draws else "Estimates of resampled records"
    count = len(next(iter(draws.values())))
    figure.suptitle(f"{kind}, $N$ = {found.elements}: {p.case_name(found.folder)}", x=0.01,
                    ha="left", fontsize=12)
    figure.legend(**corner_legend(found, names, count, others, hidden), **(
        dict(loc="upper right", bbox_to_anchor=(0.99, 0.93 if n < 4 else 0.95)) if n > 2 else
        dict(loc="outside lower center", ncols=2)))
    return figure


def corner_legend(found, names, count, others, hidden):
    """What the marks of a corner plot mean."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    handles = [Patch(facecolor="0.82", edgecolor="0.55")]
    labels = [f"{count} " + ("draws" if found.draws else "estimates")]
    if others:
        handles.append(Patch(facecolor="none", edgecolor=p.GREEN))
        labels.append(f"{len(next(iter(others.values())))} resampled records")
    for method, (text, colour, line, mark) in METHODS.items():
        if any(found.interval(method, name) for name in names):
            handles.append(Line2D([], [], color=colour, linestyle=line, marker=mark, markersize=4))
            labels.append(f"95 %, {text}")
    if len(names) > 1:
        handles += [Line2D([], [], color=p.BLUE), Line2D([], [], color=p.BLUE, linestyle="--"),
                    Line2D([], [], color="black", marker="+", markersize=9, linestyle="")]
        labels += ["half of the draws", "95 % of them", "estimate"]
    if hidden:
        handles.append(Line2D([], [], linestyle=""))
        labels.append(f"not shown: {', '.join(map(symbol_of, hidden[:3]))}"
                      + (f" and {len(hidden) - 3} more" if len(hidden) > 3 else ""))
    return dict(handles=handles, labels=labels, fontsize=8.5)


# -- motion

def motion_of(found, record):
    """Returns the motion that the draws predict for one record, and the record.

    The motion is times and three quantiles. Measured values and standard deviation of the noise are
    None without a fit at the same times.
    """
    t, low, middle, high = found.motion[1:, found.motion[0] == record]
    measured = noise = None
    if found.record is not None:
        mine = found.record[:, found.record[3] == record]
        if mine.shape[1] == len(t) and np.allclose(mine[0], t):
            measured, noise = mine[1], math.sqrt(np.mean(mine[2]**2))
    return t, low, middle, high, measured, noise


def draw_motion(found, record, of):
    """A record and the model's band; below both less the band's middle, where it can be seen."""
    t, low, middle, high, measured, noise = motion_of(found, record)
    few = len(t) < plot_fit.MARKED
    figure, (above, below) = p.plt.subplots(2, 1, figsize=(8.6, 5.6), sharex=True,
                                            height_ratios=(1.5, 1))
    which = f", record {record} of {of}" if of > 1 else ""
    figure.suptitle(f"Predicted motion, $N$ = {found.elements}: {p.case_name(found.folder)}"
                    f"{which}", x=0.01, ha="left")
    for axes, less in ((above, 0), (below, middle)):
        if noise is not None:
            wide = 1.96 * noise
            axes.fill_between(t, middle - less - np.hypot(middle - low, wide),
                              middle - less + np.hypot(high - middle, wide), color="0.86",
                              linewidth=0, label="95 % of what is measured (with noise)")
        axes.fill_between(t, low - less, high - less, color=p.SKY, alpha=0.9, linewidth=0.6,
                          edgecolor=p.BLUE, label="95 % of the model's motion")
        axes.plot(t, middle - less, color=p.BLUE, linewidth=1.1 if few else 0.7,
                  label="median of the draws")
        if measured is not None:
            axes.plot(*s.envelope(t, measured - less), "." if few else "-", color="black",
                      markersize=4, linewidth=0.5, label="record", zorder=3 if few else 1)
    unit = found.units.get("acceleration")
    above.set_ylabel(p.with_unit("acceleration", unit))
    below.set_ylabel(p.with_unit("minus the median", unit))
    below.set_xlabel(p.with_unit("time", found.units.get("time")))
    margin = 0.01 * (t[-1] - t[0] or 1.0)
    below.set_xlim(t[0] - margin, t[-1] + margin)
    figure.align_ylabels()
    figure.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def pictures(found):
    """Names and figures of all that was found."""
    if found.profiles:
        yield "profiles.png", draw_profiles(found)
    if found.draws or found.resampled:
        yield "posterior.png" if found.draws else "bootstrap.png", draw_corner(found)
    if found.motion is not None:
        records = np.unique(found.motion[0]).astype(int)
        for record in records:
            name = "posterior_motion.png" if record == 1 else f"posterior_motion_{record}.png"
            yield name, draw_motion(found, record, len(records))


def main():
    parser = p.new_parser(__doc__.replace("\n", " "))
    parser.add_argument("directory", metavar="DIR", type=p.outputs,
                        help="output folder of profile, sample or bootstrap")
    parser.add_argument("--elements", metavar="N", type=int, help="mesh to show (default: finest)")
    arguments = parser.parse_args()
    found = Found(arguments.directory, arguments.elements)
    if not found.anything():
        p.fail(f"{arguments.directory}: found no profiles.csv, posterior.csv or bootstrap.csv, "
               "expected one of them, as after 'beamid profile', 'sample' or 'bootstrap'")
    for name, figure in pictures(found):
        p.save(figure, arguments.directory / name)


if __name__ == "__main__":
    main()
