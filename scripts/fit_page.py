"""The page of a fit for report.py: verdict, estimates with where their errors come from, curves,
spectra, mode shapes, correlations, the case file."""

import html
import math
import re

import plotting as p
import page as h
import plot_along
import plot_fit
import plot_intervals
import plot_modes
import signals as s
import numpy as np

SIZE = (5.4, 3.0)    # of a picture [in]: legible on a telephone
SOURCES = (("noise", p.BLUE), ("coloured residuals", p.SKY), ("held parameters", p.ORANGE),
           ("mesh", p.PURPLE))
LONG = 75    # a line shorter than that has no other one behind it that goes on with it
CHECKS = ("determined", "not determined", "white noise", "NOT white", "records disagree", "moves",
          "held at")


def unwrapped(text):
    """Lines as they were before long ones were made to go on, four columns in."""
    lines, last = [], ""
    for line in text.splitlines():
        if len(last) > LONG and re.match(r" {4}\S", line) and lines:
            lines[-1] += line[3:]
        else:
            lines.append(line)
        last = line
    return lines


def has_rows(path):
    """Whether a table has anything below its header."""
    return len(p.read_text(path).splitlines()) > 1


def value(row, column):
    """A finite number of a row, or None where the field is empty or infinite."""
    text = (row.get(column) or "").strip()
    try:
        found = float(text)
    except ValueError:
        return None
    return found if math.isfinite(found) else None


def digits_of(estimate, low, high):
    """As many significant digits as an interval leaves: two of its width."""
    if low is None or high is None or not high > low or not estimate:
        return 5
    return min(max(2 + math.ceil(math.log10(max(abs(low), abs(high)) / (high - low))), 3), 9)


def raised(unit):
    """A unit with its powers raised: m/s²."""
    return re.sub(r"\^(-?\d+)", lambda match: match[1].translate(p.SUPERSCRIPTS), unit or "")


def between(low, high, digits, above="∞"):
    """An interval as text."""
    if low is None and high is None:
        return "unbounded"
    ends = (p.plain_number(end, digits) if end is not None else other
            for end, other in ((low, "−∞"), (high, above)))
    return " to ".join(ends)


class Fit:
    """The outputs of `identify` in a folder, of the last stage on the finest mesh."""

    def __init__(self, folder):
        self.folder = folder
        self.name = folder.resolve().name
        self.summary = h.Summary(p.read_text(folder / "summary.txt"))
        self.elements, rows = list(p.last_stage(folder).items())[-1]
        self.stage = rows[0]["stage"]
        self.J = next((row for row in rows if row["parameter"] == "J"), None)
        self.rows = [row for row in rows if not row["parameter"].startswith("J")]
        self.main = [row for row in self.rows if not plot_fit.NUISANCE.match(row["parameter"])]
        self.quality = p.read_table(folder / "quality.csv", "record", "fit_percent")
        self.units = plot_fit.read_units(folder)
        self.records = plot_fit.read_fit(folder)

    # -- what came out

    def verdict(self):
        """The first lines of the summary, how good each record is, and what limits the fit."""
        first = self.summary.text.split("\n", 1)[0]
        warnings, _, statistics = self.summary.text.rpartition("\nStatistics for")
        lines = [line for line in unwrapped(warnings) if line.startswith("warning")]
        lines += [line for line in unwrapped(statistics)
                  if any(word in line for word in CHECKS) and not line.startswith(" ")]
        # What stands above the quality of the records makes reservations about the fit.
        above = self.summary.text.partition("\nrecord 1:")[0] * (not first.startswith("record 1:"))
        lines = [line for line in unwrapped(above) if not line.startswith("no fit")] + lines
        good = not above and not any(
            line.startswith("warning") or "not determined" in line or "disagree" in line
            or "another minimum" in line for line in lines)
        least = min(p.number(row, "fit_percent") for row in self.quality)
        many = f" of every one of {len(self.quality)} records" * (len(self.quality) > 1)
        say = f"<strong>The model explains {least:.1f} %{many} of the signal.</strong>"
        if first.startswith("no fit"):
            say = f"<strong>{h.rich(first)}</strong>"
        points = "".join(f"<li>{h.rich(line)}</li>" for line in dict.fromkeys(lines))
        box = "box good" if good else "box bad" if first.startswith("no fit") else "box"
        return (f"<h1>{html.escape(self.name)}</h1>\n"
                f'<p class="lead">Parameters of a beam from its record, found by '
                f"<code>beamid</code>, with {self.elements} elements.</p>\n"
                f'<div class="{box}">{say}<ul>{points}</ul></div>\n' + self.quality_table())

    def quality_table(self):
        """A row for each record: samples, how large, how much is explained."""
        unit = raised(self.units.get("acceleration"))
        rows = [[row["record"], row["samples"], *(p.plain_number(p.number(row, name), 4) for name in
                 ("rms_signal", "rms_residual")), f"{p.number(row, 'fit_percent'):.2f} %"]
                for row in self.quality]
        return h.table(["record", "samples", f"signal, rms ({unit})", f"residual, rms ({unit})",
                        "fit"], [rows])

    def estimates(self):
        """The table: value, interval with every source of error, interval from noise alone."""
        rows = []
        for row in self.main:
            estimate = value(row, "estimate")
            noise = [value(row, f"{end}95_corrected") for end in ("lower", "upper")]
            total = [value(row, f"total_{end}95") for end in ("lower", "upper")]
            if not any(end is not None for end in total):
                total = noise
            digits = digits_of(estimate, *total)
            fine = digits_of(estimate, *noise)
            shown = "∞" if estimate is None else p.plain_number(estimate, max(digits, 3))
            rows.append([row["parameter"], shown, raised(row["unit"]), between(*total, digits),
                         between(*noise, fine), row["determined"] or ""])
        note = h.paragraph("The first interval counts every source of error that is stated, the "
                           "second the noise of the record alone. Both hold if the model is right.")
        return h.table(["parameter", "estimate", "unit", "95 % interval", "from noise alone",
                        "determined"], [rows]) + note + self.sources()

    def sources(self):
        """A bar for each parameter: which part of its interval comes from where."""
        bars = []
        for row in self.main:
            plain, corrected, held, mesh = (
                value(row, name) or 0.0 for name in
                ("std_error", "std_error_corrected", "from_held", "mesh_shift"))
            parts = [plain**2, max(corrected**2 - plain**2, 0.0), held**2, (mesh / 1.96)**2]
            if not sum(parts) > 0 or not value(row, "std_error"):
                continue
            shares = [100 * part / sum(parts) for part in parts]
            told = ", ".join(f"{name} {share:.0f} %" for (name, _), share in zip(SOURCES, shares)
                             if share >= 0.5)
            pieces = "".join(f'<span style="width:{share:.2f}%;background:{colour}"></span>'
                             for (_, colour), share in zip(SOURCES, shares) if share >= 0.05)
            bars.append(f'<div class="bar"><b>{h.rich(row["parameter"])}</b>'
                        f'<div role="img" aria-label="{row["parameter"]}: {told}">{pieces}</div>'
                        f"<small>{told}</small></div>\n")
        if not bars:
            return ""
        return ("<h3>Where the error comes from</h3>\n" + h.paragraph(
            "Shares of the variance. What is held counts as far as `&prior` says how well it is "
            "known.") + "".join(bars))

    def beyond(self):
        """What profile, sample and bootstrap have added: the table of all intervals, profiles,
        draws, the motion that they predict."""
        found = plot_intervals.Found(self.folder, self.elements)
        if not found.anything() or not found.rows:
            return ""
        if not all(self.same(found.interval("linear", row["parameter"]), row)
                   for row in self.main if found.interval("linear", row["parameter"])):
            return h.paragraph("`intervals.csv` is of another fit than `estimates.csv`: repeat "
                               "`profile`, `sample` or `bootstrap`.")
        captions = {
            "profiles": "Profiles: how far the least J rises when one parameter is held and all "
            "others are fitted again; at 1 ends the interval. Dotted: what linear theory "
            "takes it for.",
            "posterior": "Draws from the posterior: histograms with the intervals of all methods "
            "below them, and pairs of parameters with contours about half and 95 % of the draws.",
            "bootstrap": "Estimates of resampled records, and the intervals of all methods.",
            "posterior_motion": "What the draws predict: the band of the model's motion, the wider "
            "one of what is measured, and the record; below less the median."}
        text = self.interval_table(found)
        for name, figure in plot_intervals.pictures(found):
            stem = re.sub(r"_\d+$", "", name.removesuffix(".png"))
            text += h.picture(p.png(figure), captions[stem])
        printed = self.folder / "intervals.txt"
        if printed.exists():
            text += h.unfolded("What the last of these commands printed", p.read_text(printed))
        return text

    @staticmethod
    def same(interval, row):
        """Whether a row of intervals.csv is of this fit."""
        estimate = value(row, "estimate")
        return estimate is None or math.isclose(interval.estimate, estimate, rel_tol=1e-12)

    def interval_table(self, found):
        """A row for each parameter, a column for each method; ends as the methods found them."""
        methods = [method for method in plot_intervals.METHODS
                   if any(row["method"] == method for row in found.rows)]
        names = list(dict.fromkeys(row["parameter"] for row in found.rows))
        rows = [[name, *(self.told(found.interval(method, name)) for method in methods),
                 raised(found.unit(name))] for name in names]
        note = ("*Linear theory* takes J for a parabola. The *profile* fits all other parameters "
                "again at each value of one; an end may be a bound (b), or there may be none. The "
                "*posterior* weighs all values that go with the record, each as likely as any "
                "other beforehand. The *bootstrap* fits records that are made of the model and its "
                "residuals. Where they agree, any of them will do.")
        heads = [plot_intervals.METHODS[method][0] for method in methods]
        return h.table(["parameter", *heads, "unit"], [rows]) + h.paragraph(note)

    @staticmethod
    def told(interval):
        """Both ends of an interval as text, and how each came about."""
        if interval is None:
            return ""
        low, high = (end if math.isfinite(end) else None for end in interval.ends)
        digits = digits_of(interval.estimate, low, high)
        words = []
        for end, state, infinite in zip((low, high), interval.states, ("−∞", "∞")):
            number = infinite if end is None else p.plain_number(end, digits)
            words.append({"bound": number + " (b)", "unknown": "?",
                          "unbounded": infinite}.get(state, number))
        return " to ".join(words)

    # -- pictures

    def axes(self, height=1.0):
        """A figure with one panel."""
        figure = p.plt.figure(figsize=(SIZE[0], height * SIZE[1]))
        return figure, figure.add_subplot()

    def curves(self):
        """Record and model, some cycles with the band, residuals, spectra, of each record."""
        text = ""
        for record, meshes in self.records.items():
            of = f" {record}" if len(self.records) > 1 else ""
            t, measured, model, residual, by_parameters = meshes[self.elements]
            band = 1.96 * np.sqrt(np.mean(residual**2) + np.nan_to_num(by_parameters)**2)
            label = p.with_unit("acceleration", self.units.get("acceleration"))
            time = p.with_unit("time", self.units.get("time"))
            hertz = p.frequency_unit(self.units.get("time"))

            figure, axes = self.axes()
            plot_fit.draw_overview(axes, t, measured, model, self.elements)
            axes.set(xlabel=time, ylabel=label)
            axes.legend(loc="upper right")
            text += h.picture(p.png(figure), f"Record{of} and model.")

            span = s.some_cycles(t, measured) or (t[0], t[min(len(t) - 1, 200)])
            figure, axes = self.axes()
            part = (t >= span[0]) & (t <= span[1])
            axes.fill_between(t[part], (model - band)[part], (model + band)[part], color=p.SKY,
                              alpha=0.4, linewidth=0)
            plot_fit.draw_zoom(axes, t, measured, model, span, hertz)
            axes.set_title("")
            axes.set(xlabel=time, ylabel=label)
            text += h.picture(p.png(figure), f"Some cycles of record{of}. The prediction band "
                              "holds 95 % of what is measured, by the residuals and by what the "
                              "record leaves open of the parameters.")

            figure, axes = self.axes(0.75)
            axes.axhline(0, color=p.GREY, linewidth=0.8)
            axes.plot(*s.envelope(t, residual), color=p.BLUE, linewidth=0.6)
            axes.set(xlabel=time, ylabel=p.with_unit("residual", self.units.get("acceleration")))
            text += h.picture(p.png(figure), f"Residuals of record{of}, record less model.")

            if len(t) >= plot_fit.LEAST:
                figure, axes = self.axes(1.1)
                plot_fit.draw_spectra(axes, t, measured, model, residual, plot_fit.read_modes(
                    self.folder, self.elements, record))
                axes.set(xlabel=p.with_unit("frequency", hertz), ylabel=p.with_unit(
                    "amplitude", self.units.get("acceleration")))
                axes.legend(loc="upper left", fontsize=8)
                text += h.picture(p.png(figure), f"Spectra of record{of}; dashed: the modes of the "
                                  "fitted structure.")
        return text

    def modes(self):
        """Which modes the records show, and those of the fitted structure with their intervals."""
        text = ""
        path = self.folder / "modes_seen.csv"
        if has_rows(path):
            rows = []
            for row in p.read_table(path, "record", "mode", "model_hz", "verdict"):
                peak, share = value(row, "peak_hz"), value(row, "energy_share")
                is_mode = row["mode"] != "0"
                rows.append([row["record"], row["mode"] if is_mode else "none",
                             p.plain_number(p.number(row, "model_hz"), 6) if is_mode else "",
                             p.plain_number(peak, 6) if peak else "none",
                             f"{100 * (share or 0):.3g} %", row["verdict"]])
            text += h.table(["record", "mode", "model", "peak of the record", "energy", "verdict"],
                            [rows])
        rows = []
        if not has_rows(self.folder / "modes.csv"):
            return text
        for row in p.read_table(self.folder / "modes.csv", "elements", "mode", "frequency_hz"):
            if row["elements"] != str(self.elements) or int(row["mode"]) > 8:
                continue
            frequency, damping = (p.number(row, name) for name in ("frequency_hz", "damping_ratio"))
            f95 = [value(row, f"frequency_{end}95") for end in ("lower", "upper")]
            d95 = [value(row, f"damping_{end}95") for end in ("lower", "upper")]
            outside = frequency > self.highest_frequency(int(row.get("record") or 1))
            rows.append([row.get("record", "1"), row["mode"],
                         p.plain_number(frequency, digits_of(frequency, *f95))
                         + " (extrapolated)" * outside,
                         between(*f95, digits_of(frequency, *f95)) if f95[0] else "",
                         p.plain_number(damping, digits_of(damping, *d95)),
                         between(*d95, digits_of(damping, *d95)) if f95[0] else ""])
        hertz = p.frequency_unit(self.units.get("time"))
        return (text + "<h3>Modes of the fitted structure</h3>\n" + h.table(
            ["record", "mode", f"frequency ({hertz})", "95 % interval", "damping ratio",
             "95 % interval"], [rows]) + self.shapes())

    def highest_frequency(self, record):
        """Half the sampling rate of a record; a mode above it is extrapolated by the model."""
        times = self.records[record][int(self.elements)][0]
        return 0.5 / float(np.median(np.diff(times))) if len(times) > 1 else math.inf

    def shapes(self):
        """The lowest modes over the beam and what sits on it."""
        if not (self.folder / "shapes.csv").exists():
            return ""
        figure, axes = self.axes(1.1)
        plot_modes.draw_together(axes, self.folder, self.units)
        return h.picture(p.png(figure), "Mode shapes over the beam, each to a largest "
                         "displacement of 1; squares: what sits on it.")

    def along(self):
        """What varies along the beam, with its band."""
        if not (self.folder / "along.csv").exists():
            return ""
        figure = plot_along.draw(self.folder, self.elements, SIZE[0])
        return h.picture(p.png(figure), "Along the beam: the start, the fit and its 95 % band, by "
                         "noise and by what is held. Bars: over what length the fit averages.")

    def correlations(self):
        """The matrix, strong ones marked."""
        names = [row["parameter"] for row in self.main]
        if not has_rows(self.folder / "correlations.csv"):
            return h.paragraph("No degree of freedom is left for them.")
        matrix = {(row["parameter"], row["other"]): p.number(row, "correlation")
                  for row in p.read_table(self.folder / "correlations.csv", "stage", "elements",
                                          "parameter", "other", "correlation")
                  if row["stage"] == self.stage and row["elements"] == str(self.elements)}
        rows = [[name] + [self.mark(matrix.get((name, other)), name == other) for other in names]
                for name in names]
        return h.table(["", *names], [rows]) + h.paragraph(
            "*Stressed*: above .9. Parameters that go together so closely can be moved together "
            "almost without effect; hold one of them at a value that you know.")

    @staticmethod
    def mark(number, same):
        """One correlation as text."""
        if number is None or same:
            return ""
        text = h.fixed(number, 3)
        return f"*{text}*" if abs(number) > 0.9 else text

    def ending(self):
        """The case file, and all that was printed."""
        case = self.folder / "case.txt"
        text = h.preformatted(p.read_text(case)) if case.exists() else ""
        return text + h.unfolded("All that the program printed", self.summary.text)

    def document(self):
        """The whole page."""
        return h.document(f"{self.name}: a fit by beamid", [
            ("top", "", self.verdict()),
            ("estimates", "Estimates", self.estimates()),
            *[("along", "Along the beam", text) for text in [self.along()] if text],
            ("curves", "Record and model", self.curves()),
            *[("beyond", "Beyond one fit", text) for text in [self.beyond()] if text],
            ("modes", "Modes", self.modes()),
            ("correlations", "Correlations", self.correlations()),
            ("case", "The case file", self.ending())])
