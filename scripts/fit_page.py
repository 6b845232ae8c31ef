"""The sections of a fit for report.py: verdict, estimates and the sources of their errors, record
and model, spectra, modes, correlations; and the intervals of profile, sample and bootstrap."""

import html
import math
import re

import figures as f
import frf_page
import plotting as p
import page as h
import plot_along
import plot_fit
import plot_intervals
import plot_modes
import signals as s
import numpy as np
from model_curve import model_curve
from program import has_rows

SOURCES = (("noise", "blue"), ("coloured residuals", "sky"), ("fixed parameters", "orange"),
           ("mesh", "purple"))
LONG = 75    # a line shorter than that has no other one behind it that goes on with it
CHECKS = ("determined", "not determined", "white noise", "NOT white", "records disagree", "moves",
          "held at")
#: Correlation above which two parameters can hardly be told apart.
HARDLY_APART = 0.99
#: How much the error of a fixed parameter moves the estimates: below the sources of errors.
EFFECT = re.compile(r"([\d.E+-]+) (.+ )?in (\S+) moves ")
#: Beginnings of sentences that limit a good result.
RESERVATIONS = ("residuals are NOT white", "not in these intervals")
CURVES = {"computed": "The model's curve is computed at ten times for each sample interval.",
          "interpolated": "Between the samples, the model's curve is a band-limited interpolation.",
          "samples": "Straight lines join the model's values at the samples."}
BAND = ("The prediction band holds 95 % of the measured values; it includes the noise and the "
        "uncertainty of the parameters.")
#: Colours and marks of the methods of intervals.csv, in figures.
METHODS = {"linear": ("ink", "circle"), "profile": ("vermilion", "square"),
           "posterior": ("blue", "diamond"), "bca": ("green", "triangle-up")}


def unwrapped(text):
    """Returns lines as they were before long ones were continued, four columns in."""
    lines, last = [], ""
    for line in text.splitlines():
        if len(last) > LONG and re.match(r" {4}\S", line) and lines:
            lines[-1] += line[3:]
        else:
            lines.append(line)
        last = line
    return lines


def value(row, column):
    """Returns a finite number of a row, or None where the field is empty or infinite."""
    text = (row.get(column) or "").strip()
    try:
        found = float(text)
    except ValueError:
        return None
    return found if math.isfinite(found) else None


class Fit:
    """A fit in an output folder, of the last stage on the finest mesh."""

    def __init__(self, outputs, preferred=None):
        """Reads the fit; `preferred` has the unit and its power of ten for each parameter that is
        not shown in the unit of the case."""
        self.preferred = preferred or {}
        self.outputs, self.folder = outputs, outputs.folder
        self.units = outputs.units
        self.elements, rows = list(p.last_stage(self.folder).items())[-1]
        self.stage = rows[0]["stage"]
        self.rows = [row for row in rows if not row["parameter"].startswith("J")]
        self.main = [row for row in self.rows if not plot_fit.NUISANCE.match(row["parameter"])]
        self.quality = (outputs.table("quality.csv", "record", "fit_percent")
                        if outputs.has("quality.csv") else [])
        # A fit of frequency responses alone has no samples.
        self.records = (plot_fit.read_fit(self.folder) if has_rows(self.folder / "fit.csv") else {})

    # -- what came out

    def verdict(self):
        """Returns the verdict box: how much of the signal is explained, and what limits the fit."""
        headline = self.headline()
        summary = self.outputs.summary("identify")
        if summary is None:
            note = ("summary.txt is from another command: run `identify` again for the warnings of "
                    "the fit")
            return h.box("", headline, [note]) + self.quality_table()
        first = unwrapped(summary.text)[0]
        warnings, _, statistics = summary.text.rpartition("\nStatistics for")
        lines = [line for line in unwrapped(warnings) if line.startswith("warning")]
        lines += [line for line in unwrapped(statistics)
                  if any(word in line for word in CHECKS) and not line.startswith(" ")
                  and not EFFECT.match(line)]
        lines += [line for line in unwrapped(warnings)
                  if line.startswith(("not determined", "not in these intervals"))]
        # What stands above the quality of the records makes reservations about the fit.
        above = summary.text.partition("\nrecord 1:")[0] * (not first.startswith("record 1:"))
        lines = [line for line in unwrapped(above) if not line.startswith("no fit")] + lines
        good = not above and not any(
            line.startswith("warning") or "not determined" in line or "disagree" in line
            or "another minimum" in line for line in lines)
        failed = first.startswith("no fit")
        points = [h.shortened(line) for line in dict.fromkeys(lines)]
        if good:    # a green box holds no reservation
            limits = [point for point in points if point.startswith(RESERVATIONS)]
            return (h.box("good", headline, [point for point in points if point not in limits])
                    + h.box("", "Reservations", limits) * bool(limits) + self.quality_table())
        return h.box("bad" if failed else "", first if failed else headline,
                     points) + self.quality_table()

    def headline(self):
        """Returns the share of the signal that is explained. Of modes alone, a share would say
        nothing: the residuals are compared with the standard deviations."""
        signals = [row for row in self.quality if row.get("kind") != "modes"]
        if not signals:
            return ("The model agrees with the measured modes within "
                    f"{h.significant(self.rms_of_modes(), 2)} standard deviations (rms).")
        least = min(p.number(row, "fit_percent") for row in signals)
        if len(self.quality) == 1:
            return (f"The model explains {least:.1f} % of the signal: the residuals have "
                    f"{100 - least:.1f} % of its rms value.")
        return (f"The model explains at least {math.floor(10 * least) / 10:.1f} % of the signal of "
                f"each of {len(self.quality)} records.")

    def rms_of_modes(self):
        """Returns the rms residual of the measured modes, in standard deviations."""
        found = [value(row, f"residual_{end}") / p.number(row, sd)
                 for row in self.modal_rows() for end, sd in (("hz", "sd_hz"),
                                                              ("damping", "sd_damping"))
                 if value(row, f"residual_{end}") is not None]
        return math.sqrt(sum(z**2 for z in found) / len(found))

    def modal_rows(self):
        """Returns the rows of modal_fit.csv of this mesh."""
        return [row for row in self.outputs.table(
            "modal_fit.csv", "elements", "record", "mode", "measured_hz", "sd_hz", "model_hz",
            "residual_hz", "measured_damping", "sd_damping", "model_damping", "residual_damping")
            if row["elements"] == str(self.elements)]

    def quality_table(self):
        """Returns a table with a row for each record: samples, signal, residual, explained."""
        kinds = {row.get("kind") or "time" for row in self.quality}
        same = kinds == {"time"}
        unit = h.raised(self.units.get("acceleration"))
        units = [self.signal_unit(row.get("kind") or "time", int(row["record"]))
                 for row in self.quality]
        rows = []
        for row, own in zip(self.quality, units):
            kind = row.get("kind") or "time"
            count = row["samples"] if same else f"{row['samples']} {self.counted(kind, row)}"
            rows.append([row["record"], count, *(h.significant(p.number(row, name)) for name in
                         ("rms_signal", "rms_residual")), *[own] * (any(units) and not same),
                         f"{p.number(row, 'fit_percent'):.2f} %"])
        if same:
            return h.table(["record", "samples", f"signal, rms ({unit})",
                            f"residual, rms ({unit})", "explained"], [rows])
        return h.table(["record", "data", "signal, rms", "residual, rms", *["unit"] * any(units),
                        "explained"], [rows])

    @staticmethod
    def counted(kind, row):
        """Returns what the column samples of quality.csv counts for a kind of record."""
        noun = {"frf": "lines", "modes": "modes"}.get(kind, "samples")
        return noun[:-1] if row["samples"] == "1" else noun

    def signal_unit(self, kind, record):
        """Returns the unit of the rms values of a record, as it stands in a cell."""
        if kind == "modes":
            return self.units.hertz
        if kind == "frf":
            return h.raised(frf_page.o.Folder(self.folder).unit(record))
        return h.raised(self.units.get("acceleration"))

    def estimates(self):
        """Returns the table of estimates with their intervals, and the sources of their errors."""
        rows = []
        for row in self.main:
            estimate = value(row, "estimate")
            noise = [value(row, f"{end}95_corrected") for end in ("lower", "upper")]
            if not any(end is not None for end in noise):
                noise = [value(row, f"{end}95") for end in ("lower", "upper")]
            total = [value(row, f"total_{end}95") for end in ("lower", "upper")]
            if not any(end is not None for end in total):
                total = noise
            power = h.common_power([estimate, *(end for end in total if end)])
            unit = h.scaled_unit(power, row["unit"])
            unit, power = self.preferred.get(row["parameter"], (unit, power))
            shown, around = h.measured(estimate, *total, power)
            fine = h.measured(estimate, *noise, power)[1]
            rows.append([h.name_cell(row["parameter"]), shown, around,
                         h.Raw(unit), fine, row["determined"] or ""])
        note = h.paragraph("The first interval includes every source of error that the case "
                           "states, the second only the noise of the record. Both are valid only "
                           "if the model is right. Numbers are rounded to the digits that their "
                           "intervals justify.")
        return h.table(["parameter", "estimate", "95 % interval", "unit",
                        "from noise alone", "determined"], [rows]) + note + self.compensating() \
            + self.sources()

    def compensating(self):
        """Returns a sentence on the parameters that can hardly be told apart; empty without any."""
        names, groups = [row["parameter"] for row in self.main], []
        for pair, number in self.correlation_matrix().items():
            if pair[0] != pair[1] and abs(number) > HARDLY_APART and {*pair} <= {*names}:
                touched = [group for group in groups if group & {*pair}]
                groups = [group for group in groups if group not in touched]
                groups.append({*pair}.union(*touched))
        told = "; ".join(", ".join(sorted(group, key=names.index)) for group in groups)
        return h.paragraph(f"Hardly to be told apart, with correlations above {HARDLY_APART:g}: "
                           f"{told}. An error of one is compensated by the others. If an interval "
                           "is too wide, fix one of them at a known value.") if told else ""

    def correlation_matrix(self):
        """Returns the correlations of the last stage by pairs of names; empty without any."""
        if not has_rows(self.folder / "correlations.csv"):
            return {}
        return {(row["parameter"], row["other"]): p.number(row, "correlation")
                for row in self.outputs.table("correlations.csv", "stage", "elements",
                                              "parameter", "other", "correlation")
                if row["stage"] == self.stage and row["elements"] == str(self.elements)}

    def sources(self):
        """Returns a bar for each parameter: the shares of its variance by source."""
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
            pieces = "".join(f'<span style="width:{share:.2f}%;background:var(--{tone})"></span>'
                             for (_, tone), share in zip(SOURCES, shares) if share >= 0.05)
            bars.append(f'<b>{h.symbol(row["parameter"])}</b>'
                        f'<div role="img" aria-label="{html.escape(row["parameter"])}: {told}">'
                        f"{pieces}</div><small>{told}</small>\n")
        if not bars:
            return ""
        return ("<h3>Where the error comes from</h3>\n" + h.paragraph(
            "Shares of the variance. A fixed parameter contributes the error that its stated "
            "standard deviation causes.")
            + f'<div class="bars">{"".join(bars)}</div>\n' + self.effects())

    def effects(self):
        """Returns the table of how much the error of each fixed parameter moves the estimates."""
        summary = self.outputs.summary("identify")
        found = [] if summary is None else [line for line in unwrapped(summary.text)
                                            if EFFECT.match(line)]
        rows = []
        for line in found:
            error, unit, name = EFFECT.match(line).groups()
            size = f"{error} {unit or ''}".strip()
            if name in self.preferred:
                unit, power = self.preferred[name]
                size = f"{float(error) / 10**power:.4g} {unit}"
            moved = dict(piece.split(" by ", 1) for piece in
                         line[EFFECT.match(line).end():].split(", "))
            # A change of the reciprocal of a stiffness has no percentage.
            rows.append((name, size, {
                key.removeprefix("1/"): f"{h.significant(float(text), 3)} in {key}"
                if key.startswith("1/") and not text.endswith(("%", "amount")) else text
                for key, text in moved.items()}))
        names = list(dict.fromkeys(key for *_, moved in rows for key in moved))
        if not rows:
            return ""
        cells = [[h.name_cell(name), size, *(moved.get(key, "") for key in names)]
                 for name, size, moved in rows]
        return h.paragraph("One standard deviation of a fixed parameter moves the estimates by:") \
            + h.table(["fixed", "standard deviation", *map(h.name_cell, names)], [cells], left=2)

    # -- record and model

    def curves(self):
        """Returns the figures of each record: record and model, some cycles, spectra."""
        text = ""
        # The estimate of a stiffness may be infinite.
        estimates = {row["parameter"]: float(row["estimate"]) for row in self.rows}
        for record, meshes in self.records.items():
            of = f"record {record}" if len(self.quality) > 1 else "the record"
            t, measured, model, residual, by_parameters = meshes[self.elements]
            fine, values, how = model_curve(self.outputs.case, estimates, self.elements, t, model)
            whole = (fine, values) if len(fine) <= f.MOST_POINTS else (t, model)
            half = 1.96 * np.sqrt(np.mean(residual**2) + np.nan_to_num(by_parameters)**2)
            width = np.interp(fine, t, half)
            band = fine, values - width, values + width
            short = len(t) < f.MARKED
            text += h.figure(
                f.record_and_model(t, measured, residual, whole, self.units, self.elements,
                                   band if short else None),
                f"{of[0].upper()}{of[1:]}, the fitted model and the residuals. {CURVES[how]}"
                + f" {BAND}" * short)
            if not short:
                text += self.cycles(of, t, measured, band, (fine, values))
            if len(t) >= plot_fit.LEAST:
                modes = plot_fit.read_modes(self.folder, self.elements, record)
                text += h.figure(
                    f.spectra(t, (measured, model, residual), modes, self.units),
                    f"Amplitude spectra of {of}, the model and the residual."
                    + " Dashed: the modes of the fitted structure." * bool(modes))
        return text + (self.autocorrelation() if text else "")

    def cycles(self, of, t, measured, band, curve):
        """Returns the figure of some cycles with the prediction band."""
        span = s.some_cycles(t, measured) or (t[0], t[min(len(t) - 1, 200)])
        seen, near = ((x >= span[0]) & (x <= span[1]) for x in (t, curve[0]))
        parts = [[series[near] for series in group] for group in (band, curve)]
        return h.figure(f.cycles(t[seen], measured[seen], *parts, self.units),
                        f"Some cycles of {of}, sample by sample. {BAND}")

    def autocorrelation(self):
        """Returns the figure of the autocorrelation of the residuals."""
        if not has_rows(self.folder / "autocorrelation.csv"):
            return ""
        rows = [row for row in self.outputs.table("autocorrelation.csv", "elements", "lag",
                                                  "autocorrelation", "band95")
                if row["elements"] == str(self.elements)][:120]
        if not rows:
            return ""
        return h.figure(f.autocorrelation(
            [p.number(row, "lag", int) for row in rows],
            [p.number(row, "autocorrelation") for row in rows], p.number(rows[0], "band95"),
            "samples" if self.records else "lines"),
            "Autocorrelation of the residuals. If the model is complete, most points lie within "
            "the band, as those of white noise do.")

    def frequency_responses(self):
        """Returns the figures of the frequency responses of the records; empty without any."""
        if not self.outputs.written_by("frf.csv", "identify"):
            return ""
        return frf_page.section(self.outputs) + ("" if self.records else self.autocorrelation())

    # -- modes

    def measured_modes(self):
        """Returns the table of the modes that were measured, beside those of the model."""
        if not has_rows(self.folder / "modal_fit.csv"):
            return ""
        rows = self.modal_rows()
        with_damping = any(value(row, "measured_damping") is not None for row in rows)
        many = len({row["record"] for row in rows}) > 1
        cells = [[*[row["record"]] * many, row["mode"],
                  *self.compared(row, "measured_hz", "sd_hz", "model_hz", "residual_hz"),
                  *(self.compared(row, "measured_damping", "sd_damping", "model_damping",
                                  "residual_damping") if with_damping else [])] for row in rows]
        hertz = self.units.hertz or "1/time"
        heads = ["measured", "± sd", "model", "residual/sd"]
        return "<h3>Measured modes</h3>\n" + h.table(
            [*["record"] * many, "mode", f"frequency ({hertz})", *heads[1:],
             *(["damping ratio", *heads[1:]] if with_damping else [])], [cells]) + h.paragraph(
            "A residual is the measured value minus that of the model. With good standard "
            "deviations, 95 % of the residuals are between -2 and 2 standard deviations.")

    @staticmethod
    def compared(row, measured, sd, model, residual):
        """Returns the cells of a measured value, its standard deviation, the value of the model,
        and the residual in standard deviations."""
        if value(row, measured) is None:
            return ["", "", "", ""]
        error = p.number(row, sd)
        decimals = max(0, 1 - math.floor(math.log10(error)))
        if decimals > 9:
            numbers = [h.significant(p.number(row, name), 6) for name in (measured, sd, model)]
        else:
            numbers = [h.fixed(p.number(row, name), decimals) for name in (measured, sd, model)]
        return [*numbers, h.fixed(p.number(row, residual) / error, 2)]

    def modes(self):
        """Returns the modes that the records show, and those of the fitted structure."""
        text = self.measured_modes()
        hertz = self.units.hertz
        if has_rows(self.folder / "modes_seen.csv"):
            rows = []
            for row in self.outputs.table("modes_seen.csv", "record", "mode", "model_hz",
                                          "verdict"):
                peak, share = value(row, "peak_hz"), value(row, "energy_share")
                is_mode = row["mode"] != "0"
                rows.append([row["record"], row["mode"] if is_mode else "none",
                             h.significant(p.number(row, "model_hz"), 6) if is_mode else "",
                             h.significant(peak, 6) if peak else "none",
                             f"{100 * (share or 0):.3g} %", row["verdict"]])
            text += "<h3>Modes in the record</h3>\n" + h.table(
                ["record", "mode", f"model ({hertz})", f"peak of the record ({hertz})",
                 "share of the energy", "verdict"], [rows])
        if not self.outputs.written_by("modes.csv", "identify"):
            return text
        return text + "<h3>Modes of the fitted structure</h3>\n" + mode_table(
            self.outputs, "modes.csv", self.elements, self.highest_frequency) + shapes(
                self.outputs)

    def highest_frequency(self, record):
        """Returns half the sampling rate of a record; infinity if it has no samples."""
        if record not in self.records:
            return math.inf
        times = self.records[record][int(self.elements)][0]
        return 0.5 / float(np.median(np.diff(times))) if len(times) > 1 else math.inf

    def along(self):
        """Returns the figure of what varies along the beam."""
        if not self.outputs.has("along.csv"):
            return ""
        functions = plot_along.read_along(self.folder, self.elements)
        figure = f.along(functions, plot_along.read_attached(self.folder), self.units,
                         plot_along.HIGHEST)
        return h.figure(figure, "Along the beam: the start, the fit and its 95 % band, which "
                        "includes noise and parameters that are held fixed. Bars: the length over "
                        "which the fit averages. Below: the beam and what is attached to it.")

    def windows(self):
        """Returns figures of the estimates in each window of the record, with &windows."""
        if not has_rows(self.folder / "windows.csv"):
            return ""
        by_name = {}
        for row in self.outputs.table("windows.csv", "record", "window", "t_first", "t_last",
                                      "parameter", "estimate", "std_error"):
            if value(row, "estimate") is not None and not plot_fit.NUISANCE.match(row["parameter"]):
                by_name.setdefault(row["parameter"], []).append(row)
        time = self.units.get("time")
        charts = []
        for name, rows in by_name.items():
            spans = [f"{p.plain_number(p.number(row, 't_first'), 3)} to "
                     f"{p.plain_number(p.number(row, 't_last'), 3)} {time}".strip() for row in rows]
            whole = next((row for row in self.main if row["parameter"] == name), None)
            shown = [(span, p.number(row, "estimate"), value(row, "std_error") or 0.0)
                     for span, row in zip(spans, rows)]
            if whole is not None:
                shown.insert(0, ("whole record", p.number(whole, "estimate"),
                                 value(whole, "std_error") or 0.0))
            names, at, errors = (np.array(column) for column in zip(*shown))
            power = h.common_power(at)
            at, half = at / 10.0**power, 1.96 * errors / 10.0**power
            charts.append(h.figure(
                f.forest(names, at, at - half, at + half,
                         f.label(h.symbol(name), h.scaled_unit(power, self.units.of(name)))),
                name=f"{name} in each window"))
        return h.panels(charts, "Estimates in each window of the record, with 95 % intervals from "
                        "noise alone. A parameter whose estimates differ by more than their "
                        "intervals is not constant during the motion.")

    def minima(self):
        """Returns the table of the minima that the starts of &multistart have found."""
        if not has_rows(self.folder / "minima.csv"):
            return ""
        found = {}
        for row in self.outputs.table("minima.csv", "elements", "minimum", "count", "J",
                                      "parameter", "estimate"):
            if row["elements"] == str(self.elements):
                found.setdefault(row["minimum"], [row["count"], p.number(row, "J"), {}])[2][
                    row["parameter"]] = p.number(row, "estimate")
        names = [name for name in (row["parameter"] for row in self.main)
                 if any(name in values for _, _, values in found.values())]
        rows = [[minimum, count, h.significant(J, 6),
                 *(h.significant(values.get(name), 5) for name in names)]
                for minimum, (count, J, values) in found.items()]
        units = [h.scaled_unit(0, self.units.of(name)) for name in names]
        return h.table(["minimum", "starts", "J", *(
            h.Raw(f.label(h.symbol(name), unit)) for name, unit in zip(names, units))], [rows])

    def correlations(self):
        """Returns the matrix of correlations, strong ones stressed."""
        names = [row["parameter"] for row in self.main]
        matrix = self.correlation_matrix()
        if not matrix:
            return h.paragraph("The fit leaves no degree of freedom for correlations.")
        rows = [[h.name_cell(name), *(self.mark(matrix.get((name, other)), name == other)
                                      for other in names)] for name in names]
        return h.table(["", *map(h.name_cell, names)], [rows]) + h.paragraph(
            "*Stressed*: above 0.9 in magnitude. An error of one of these parameters is "
            "compensated by the other. If an interval is too wide, fix the other parameter at a "
            "known value.")

    @staticmethod
    def mark(number, same):
        """Returns one correlation as a cell."""
        if number is None or same:
            return ""
        text = h.fixed(number, 3)
        return h.Raw(f"<b><em>{text}</em></b>") if abs(number) > 0.9 else text

    def sections(self):
        """Returns the sections of the page below the verdict."""
        return [("estimates", "Estimates", self.estimates()),
                *[("along", "Along the beam", text) for text in [self.along()] if text],
                *[("curves", "Record and model", text) for text in [self.curves()] if text],
                *[("frf", "Frequency responses", text)
                  for text in [self.frequency_responses()] if text],
                *[("beyond", "Beyond linear theory", text)
                  for text in [intervals(self.outputs, self.elements, self.main,
                                          self.preferred)] if text],
                *[("windows", "Windows of the record", text)
                  for text in [self.windows()] if text],
                *[("minima", "Minima", text) for text in [self.minima()] if text],
                *[("modes", "Modes", text) for text in [self.modes()] if text],
                ("correlations", "Correlations", self.correlations())]


# -- modes, of a fit and of a structure

def mode_table(outputs, name, elements=None, highest=None):
    """Returns a table of modes with their intervals, if the file has them.

    `highest` returns half the sampling rate of a record; a mode above it is extrapolated.
    """
    rows = outputs.table(name, "elements", "mode", "frequency_hz", "damping_ratio")
    elements = elements or max(p.number(row, "elements", int) for row in rows)
    rows = [row for row in rows if row["elements"] == str(elements)]
    several = len({row.get("record", "1") for row in rows}) > 1
    with_intervals = any(value(row, "frequency_lower95") is not None for row in rows)
    cells = []
    for row in rows:
        if int(row["mode"]) > 10:
            continue
        frequency, damping = (p.number(row, key) for key in ("frequency_hz", "damping_ratio"))
        line = [row.get("record", "1")] * several + [row["mode"]]
        for number, stem in ((frequency, "frequency"), (damping, "damping")):
            ends = [value(row, f"{stem}_{end}95") for end in ("lower", "upper")]
            if with_intervals:
                line += h.measured(number, *ends)
            else:
                line.append(h.significant(number, 6 if stem == "frequency" else 4))
        if highest:
            line.append("extrapolated" if frequency > highest(int(row.get("record") or 1)) else "")
        cells.append(line)
    more = ["95 % interval"] * with_intervals
    noted = bool(highest) and any(line[-1] for line in cells)
    cells = cells if noted or not highest else [line[:-1] for line in cells]
    note = h.paragraph("*Extrapolated*: above half the sampling rate; no sample shows this mode, "
                       "the model alone predicts it.") if noted else ""
    return h.table(["record"] * several + ["mode", f"frequency ({outputs.units.hertz or '1/time'})",
                                           *more, "damping ratio", *more, *[""] * noted],
                   [cells]) + note


def shapes(outputs):
    """Returns the figure of the lowest mode shapes."""
    if not outputs.has("shapes.csv"):
        return ""
    x, curves, attached = plot_modes.read_shapes(outputs.folder)
    numbers = plot_modes.read_numbers(outputs.folder)
    hertz = outputs.units.hertz
    count = min(curves.shape[1], plot_modes.MOST, len(numbers))
    names = [f"mode {mode}: {h.significant(frequency)} {hertz}".strip()
             for frequency, _, mode in numbers[:count]]
    return h.figure(f.shapes(x, curves[:, :count].T.real, names, attached, outputs.units),
                    "Mode shapes over the beam, each to a largest displacement of 1. Squares: what "
                    "is attached to the beam.")


# -- intervals of profile, sample and bootstrap

def intervals(outputs, elements=None, fit_rows=(), preferred=None):
    """Returns the section on what profile, sample and bootstrap have found; empty without one.

    `fit_rows` are the rows of the fit in the same folder, with which the intervals must agree;
    `preferred` is that of `Fit`.
    """
    found = plot_intervals.Found(outputs.folder, elements)
    if not found.anything() or not found.rows:
        return ""
    for row in fit_rows:
        linear, estimate = found.interval("linear", row["parameter"]), value(row, "estimate")
        if linear and estimate is not None and not math.isclose(linear.estimate, estimate,
                                                                rel_tol=1e-12):
            return h.paragraph("`intervals.csv` belongs to another fit than `estimates.csv`: "
                               "repeat `profile`, `sample` or `bootstrap`.")
    found.preferred = preferred or {}
    text = left_out(outputs) + interval_table(found) + interval_figures(found)
    if found.profiles:
        text += profiles(found)
    if found.draws or found.resampled:
        text += corner(found)
    if found.motion is not None:
        text += "".join(motion(found, outputs.units, int(record))
                        for record in np.unique(found.motion[0]))
    if outputs.has("intervals.txt"):
        text += h.unfolded("What the last of these commands printed",
                           p.read_text(outputs.folder / "intervals.txt"))
    return text


def left_out(outputs):
    """Returns a box with the program's sentences on errors that intervals do not include."""
    texts = [outputs.text(name) for name in ("intervals.txt", "summary.txt") if outputs.has(name)]
    lines = [line for text in texts for line in unwrapped(text)
             if line.startswith(("these intervals do not include", "not in these intervals"))]
    return h.box("", "Errors that these intervals leave out", dict.fromkeys(lines)) * bool(lines)


def methods_of(found):
    """Returns the methods that have intervals."""
    return [method for method in plot_intervals.METHODS
            if any(row["method"] == method for row in found.rows)]


def parameters_of(found):
    """Returns the parameters that have intervals."""
    return list(dict.fromkeys(row["parameter"] for row in found.rows))


def unit_of(found, name, power):
    """Returns the unit in which a parameter is shown, and its power of ten.

    `power` is used if the unit of the parameter is not chosen.
    """
    return found.preferred.get(name, (h.scaled_unit(power, found.unit(name)), power))


def interval_table(found):
    """Returns a table with a row for each parameter and a column for each method."""
    methods = methods_of(found)
    rows = []
    for name in parameters_of(found):
        known = [found.interval(method, name) for method in methods]
        ends = [end for interval in known if interval for end in interval.ends]
        power = h.common_power(ends)
        unit, power = unit_of(found, name, power)
        decimals = [h.decimals_of(*interval.ends, power) for interval in known if interval]
        finest = max((number for number in decimals if number is not None), default=None)
        rows.append([h.name_cell(name), *(told(interval, finest, power) for interval in known),
                     h.Raw(unit)])
    note = ("*Linear theory* approximates J by a parabola. The *profile* fits all other parameters "
            "again at each value of one; an end may be a bound (b), or may not exist. The "
            "*posterior* weighs all values that agree with the record. The *bootstrap* fits "
            "records that are made of the model and resampled residuals. Where the methods agree, "
            "linear theory is good enough.")
    heads = [plot_intervals.METHODS[method][0] for method in methods]
    return h.table(["95 % interval", *heads, "unit"], [rows]) + h.paragraph(note)


def told(interval, decimals, power):
    """Returns both ends of an interval as text, and how each came about."""
    if interval is None:
        return ""
    words = []
    for end, state, infinite in zip(interval.ends, interval.states, ("\u2212∞", "∞")):
        number = infinite
        if math.isfinite(end):
            scaled = end / 10.0**power
            number = h.significant(scaled) if decimals is None else h.fixed(scaled, decimals)
        words.append({"bound": number + " (b)", "unknown": "?", "unbounded": infinite}.get(
            state, number))
    return " to ".join(words)


def interval_figures(found):
    """Returns small figures of the intervals of all methods, one for each parameter."""
    methods = methods_of(found)
    if len(methods) < 2:
        return ""
    charts = []
    for name in parameters_of(found):
        known = [(method, found.interval(method, name)) for method in methods]
        known = [(method, interval) for method, interval in known if interval]
        values = [x for _, interval in known for x in (interval.estimate, *interval.ends)
                  if math.isfinite(x)]
        if not values:
            continue
        unit, power = unit_of(found, name, h.common_power(values))
        ten = 10.0**power
        lines = [(plot_intervals.METHODS[method][0], *METHODS[method], interval.estimate / ten,
                  *(end / ten if math.isfinite(end) else
                    math.copysign(math.inf, -1 if k == 0 else 1)
                    for k, end in enumerate(interval.ends))) for method, interval in known]
        title = f.label(h.symbol(name), unit)
        charts.append(h.figure(f.intervals(lines, title), name=f"Intervals of {name}"))
    return h.panels(charts, "95 % intervals of each parameter by each method. A triangle stands "
                    "for an end that does not exist.")


def profiles(found):
    """Returns the figures of the profiles."""
    by_name = {}
    for row in found.profiles:
        by_name.setdefault(row["parameter"], []).append(row)
    charts = [h.figure(profile(found, name, rows), name=f"Profile of J over {name}")
              for name, rows in by_name.items()]
    keys = [("vermilion", "line", "profile: least J at each value"),
            ("ink", "dot", "parabola of linear theory"), ("ink", "point", "estimate")]
    return "<h3>Profiles of <i>J</i></h3>\n" + h.panels(
        charts, "Rise of the least J if one parameter is fixed at each value and all others are "
        "fitted again. The 95 % interval ends where the rise is 1.", keys)


def profile(found, name, rows):
    """Returns the figure of one profile."""
    at, z = (np.array([p.number(row, key) for row in rows]) for key in ("value", "distance"))
    states = (rows[0]["lower_end"], rows[0]["upper_end"])
    best = int(np.argmin(np.abs(z)))
    outer = [plot_intervals.shown_side(at[best::-1], z[best::-1], states[0]),
             plot_intervals.shown_side(at[best:], z[best:], states[1])]
    own = found.interval("profile", name)
    for k in (0, 1):    # the last fit may have been just inside the bound
        if own and states[k] == "bound" and math.isfinite(own.ends[k]):
            outer[k] = own.ends[k]
    low, high = outer
    logarithmic = low > 0 and high > 30 * at[best]
    unit, power = ((h.scaled_unit(0, found.unit(name)), 0) if logarithmic else
                   unit_of(found, name, h.common_power(outer)))
    ten = 10.0**power
    spaced = np.geomspace if logarithmic else np.linspace
    fine = spaced(low, high, 200)
    fine = fine[(fine >= at[0]) & (fine <= at[-1])]
    margin = 0.17 * (high - low)
    shown = (low / 1.6, high * 1.6) if logarithmic else (low - margin, high + margin)
    linear = found.interval("linear", name)
    parabola = None
    if linear and linear.half_width() > 0:
        wide = spaced(*shown, 200)
        rise = ((wide - linear.estimate) / linear.half_width())**2
        near = rise < 1.5
        parabola = wide[near] / ten, rise[near]
    inside = (at >= low) & (at <= high)
    decimals = h.decimals_of(low, high, power)
    ends = []
    for end, state, side in zip(outer, states, ("left", "right")):
        number = h.significant(end / ten) if decimals is None else h.fixed(end / ten, decimals)
        text = {"bound": f"bound {number}", "unknown": f"lost at {number}", "unbounded":
                "no limit →" if side == "right" else "← no limit"}.get(state, number)
        ends.append((math.log10(end) if logarithmic else end / ten, text, side))
    title = f.label(h.symbol(name), unit)
    # The distance is nearly straight, so its square is smooth between points.
    figure = f.profile(at[inside] / ten, z[inside]**2,
                       (fine / ten, plot_intervals.curve(at, z, fine)**2), parabola, ends,
                       at[best] / ten, title)
    if logarithmic:
        figure.update_xaxes(type="log", range=[math.log10(x) for x in shown])
    else:
        figure.update_xaxes(range=[x / ten for x in shown], nticks=5)
    return figure


def corner(found):
    """Returns the figure of the draws, or of the estimates of resampled records."""
    draws = found.draws or found.resampled
    names = list(draws)[:plot_intervals.MOST]
    hidden = list(draws)[plot_intervals.MOST:]
    shown = {name: unit_of(found, name, h.common_power(np.quantile(draws[name], (0.001, 0.999))))
             for name in names}
    powers = {name: power for name, (_, power) in shown.items()}
    scaled = {name: draws[name] / 10.0**powers[name] for name in names}
    others = found.resampled if found.draws else None
    others = others and {name: others[name] / 10.0**powers[name] for name in names
                         if name in others}
    spans = {name: plot_intervals.range_of(scaled[name]) for name in names}
    titles = {name: f.label(h.symbol(name), shown[name][0]) for name in names}
    best = {name: getattr(found.interval("linear", name), "estimate", math.nan)
            / 10.0**powers[name] for name in names}

    def density(x, y, x_span, y_span):
        counts, *edges = np.histogram2d(x, y, bins=plot_intervals.BINS, range=(x_span, y_span))
        smooth = plot_intervals.smooth(counts).T
        return (*((edge[1:] + edge[:-1]) / 2 for edge in edges), smooth,
                plot_intervals.heights_of(smooth))

    figure = f.corner(names, titles, scaled, others, plot_intervals.LEVELS, density, spans, best)
    count = len(next(iter(draws.values())))
    many = f"{count} " + ("draws from the posterior" if found.draws else
                          "estimates of resampled records")
    more = (f" The green outlines are {len(next(iter(others.values())))} estimates of resampled "
            "records." if others else "")
    left = f" Not shown: {', '.join(hidden)}." if hidden else ""
    heading = "Posterior" if found.draws else "Resampled records"
    return f"<h3>{heading}</h3>\n" + h.figure(
        figure, f"Histograms of {many}, and pairs of parameters; the contours enclose 50 % (solid) "
        f"and 95 % (dashed), the cross is the estimate.{more}{left}",
        width=150 * len(names) + 60 if len(names) > 2 else 0)


def motion(found, units, record):
    """Returns the figure of the motion that the draws predict for one record."""
    return h.figure(f.motion(*plot_intervals.motion_of(found, record), units),
                    "The motion that the draws predict, and the record. Below: both minus the "
                    "median of the draws.")
