"""The page of an output folder for report.py, of whatever commands have written it: identify,
simulate, modes, frf, profile, sample, bootstrap, compare, design, track, ensemble."""

import html
import math
import re
from pathlib import Path

import damping_page
import figures as f
import fit_page
import frf_page
import page as h
import plot_design
import plot_intervals
import plotting as p
import numpy as np
import signals as s
import track_page
from fit_page import value
from model_curve import even, interpolated
from output_folder import find_case
from program import has_rows, read_text
from units import Units

#: What each command did, in the words of the page's first sentence.
LEADS = {
    "identify": "estimated the parameters of a beam from its record",
    "simulate": "simulated the response of a structure",
    "modes": "computed natural frequencies, damping ratios and mode shapes",
    "frf": "computed the frequency response of a structure",
    "profile": "computed intervals from the profile of J",
    "sample": "drew samples from the posterior of the parameters",
    "bootstrap": "fitted resampled records",
    "compare": "compared several models of one record",
    "design": "compared experiments by the standard errors that they would give",
    "track": "followed a parameter through a long record",
    "ensemble": "ran a command on many records"}
#: Settings of an experiment in few words.
SETTINGS = {"x_S": "sensor at", "x_S_2": "second sensor at", "x_F": "force at",
            "duration": "duration of the pulse", "t_first": "first sample",
            "t_last": "last sample", "t_step": "time step", "f_first": "from", "f_last": "up to",
            "f_step": "distance of the lines"}
MOST_CASES = 40      # of a fleet, in a figure
MOST_ERROR = 100     # per cent, in a map of standard errors
WORST_COVERAGE = 3   # standard errors between the coverage and 95 %


def best_row(rows, column):
    """Returns the row with the lowest number in a column."""
    return min(rows, key=lambda row: p.number(row, column))


def plural(count, word):
    """Returns a count with its noun: 1 record, 3 records."""
    return f"{count} {word}{'s' * (count != 1)}"


# -- simulate

def simulated(outputs):
    """Returns the verdict box and the sections of a simulated response."""
    rows = s.read_columns(outputs.folder / "response.csv", "elements", "t", "force",
                          "displacement", "velocity", "acceleration")
    units = outputs.units
    meshes = sorted(set(map(int, rows[0])))
    force = "force" if not outputs.case or "'base'" not in outputs.case else "base acceleration"
    quantities = [("acceleration", "acceleration"), ("velocity", "velocity"),
                  ("displacement", "length"), (force, "force" if force == "force" else
                                               "acceleration")]
    places = {"acceleration": 5, "velocity": 4, "displacement": 3, force: 2}
    panels, cells = [], []
    for quantity, unit in quantities:
        curves = []
        for mesh in meshes:
            mine = rows[:, rows[0] == mesh]
            t, y = mine[1], mine[places[quantity]]
            if not y.any():
                continue
            between = (interpolated(t, y) if quantity != force and even(t) and len(t) < f.MARKED
                       else (t, y))
            curves.append((f"<i>N</i> = {mesh}", t, y, between))
            peak = int(np.argmax(np.abs(y)))
            cells.append([quantity, f"{mesh}", h.significant(abs(y[peak])),
                          h.raised(units.get(unit)), p.plain_number(t[peak], 5)])
        if quantity == "acceleration" and outputs.written_by("record.csv", "simulate"):
            t, noisy = s.read_columns(outputs.folder / "record.csv", "t", "acceleration")
            if curves and len(t) == len(curves[-1][1]) and np.any(noisy != curves[-1][2]):
                curves.insert(0, ("with noise", t, noisy, None))
        if curves:
            panels.append((quantity, units.get(unit), curves))
    t = rows[1, rows[0] == meshes[-1]]
    span = f"{p.plain_number(t[0], 5)} to {p.plain_number(t[-1], 5)} {units.get('time')}".strip()
    noise = any(curve[0] == "with noise" for panel in panels for curve in panel[2])
    box = h.box("good", f"The response is computed at {plural(len(t), 'time')}, {span}.",
                [f"Mesh: {', '.join(map(str, meshes))} elements.",
                 *["`record.csv` has the acceleration with the noise of `&noise`."] * noise])
    text = h.table(["quantity", "elements", "largest magnitude", "unit",
                    f"at time ({units.get('time') or 'unit of the case'})"], [cells], left=1)
    if panels:
        few = even(t) and len(t) < f.MARKED
        text += h.figure(f.response(panels, units), "Motion at the sensor"
                         + ", and the excitation" * (panels[-1][0] == force) + "."
                         + " Between the samples, the curves are a band-limited interpolation."
                         * few)
    if len(t) >= s.FEW and panels and panels[0][0] == "acceleration":
        last = panels[0][2][-1][2]
        text += h.figure(f.spectra(t, [last], [], units, ["acceleration"]),
                         "Amplitude spectrum of the acceleration.")
    return box, [("response", "Response", text)]


# -- modes

def natural_modes(outputs):
    """Returns the verdict box and the sections of the natural modes of a structure."""
    rows = outputs.table("modes.csv", "elements", "mode", "frequency_hz", "damping_ratio")
    elements = max(p.number(row, "elements", int) for row in rows)
    mine = [row for row in rows if row["elements"] == str(elements)]
    lowest = best_row(mine, "frequency_hz")
    hertz = outputs.units.hertz
    damped = p.number(lowest, "damping_ratio")
    unstable = [row for row in mine if p.number(row, "damping_ratio") < 0]
    headline = (f"The lowest natural frequency is {h.significant(p.number(lowest, 'frequency_hz'))}"
                f" {hertz}".rstrip() + f", with a damping ratio of {h.significant(damped)}.")
    points = [f"{plural(len(mine), 'mode')} with {elements} elements."]
    if unstable:
        points.append(f"{plural(len(unstable), 'mode')} with a negative damping ratio: the "
                      "structure is unstable.")
    text = fit_page.mode_table(outputs, "modes.csv")
    meshes = sorted({p.number(row, "elements", int) for row in rows})
    if len(meshes) > 1:
        text += "<h3>Convergence with the mesh</h3>\n" + mesh_table(rows, meshes, hertz)
    text += "<h3>Mode shapes</h3>\n" + fit_page.shapes(outputs)
    sections = [("modes", "Natural modes", text)]
    if outputs.has("modes_fitted.csv") and has_rows(outputs.folder / "modes_fitted.csv"):
        sections.append(("modes-fitted", "Modes of the fitted structure", h.paragraph(
            "The case says how to fit its record. These are the modes at the estimates, with 95 % "
            "intervals from those of the parameters.")
            + fit_page.mode_table(outputs, "modes_fitted.csv")))
    return h.box("bad" if unstable else "good", headline, points), sections


def mesh_table(rows, meshes, hertz):
    """Returns a table of frequencies by mesh."""
    by = {(row["elements"], row["mode"]): p.number(row, "frequency_hz") for row in rows}
    modes = list(dict.fromkeys(row["mode"] for row in rows))[:10]
    cells = [[mode, *(h.significant(by[str(mesh), mode], 7) if (str(mesh), mode) in by else ""
                      for mesh in meshes)] for mode in modes]
    return h.table(["mode", *(f"N = {mesh} ({hertz})" for mesh in meshes)], [cells])


# -- profile, sample, bootstrap without a fit beside them

def intervals(outputs):
    """Returns the verdict box and the sections of profile, sample or bootstrap."""
    found = plot_intervals.Found(outputs.folder)
    text = fit_page.intervals(outputs)
    open_ends = sorted({row["parameter"] for row in found.rows
                        if "unbounded" in (row["lower_end"], row["upper_end"])})
    unknown = sorted({row["parameter"] for row in found.rows
                      if "unknown" in (row["lower_end"], row["upper_end"])})
    methods = [plot_intervals.METHODS[name][0] for name in fit_page.methods_of(found)
               if name != "linear"]
    names = fit_page.parameters_of(found)
    points = [f"No limit: the record does not bound {', '.join(open_ends)} on every side."
              ] * bool(open_ends)
    points += [f"Unknown: the search did not find an end for {', '.join(unknown)}."] * bool(unknown)
    points += [point for name in names for point in [disagreement(found, name)] if point]
    headline = (f"95 % intervals of {plural(len(names), 'parameter')} by {' and '.join(methods)}.")
    return h.box("" if open_ends or unknown else "good", headline, points), [
        ("intervals", "Intervals", text)]


def disagreement(found, name):
    """Returns a sentence if an interval differs from linear theory by a quarter of its width."""
    linear = found.interval("linear", name)
    if linear is None or not linear.half_width() > 0:
        return ""
    for method in fit_page.methods_of(found):
        other = found.interval(method, name)
        if other is None or method == "linear" or not all(map(math.isfinite, other.ends)):
            continue
        apart = max(abs(a - b) for a, b in zip(other.ends, linear.ends))
        if apart > 0.5 * linear.half_width():
            return (f"{name}: linear theory is a poor approximation; by "
                    f"{plot_intervals.METHODS[method][0]} the interval is "
                    f"{fit_page.told(other, h.decimals_of(*other.ends, 0), 0)} "
                    f"{found.unit(name)}".rstrip() + ".")
    return ""


# -- compare

def comparison(outputs):
    """Returns the verdict box and the sections of a comparison of models."""
    rows = outputs.table("models.csv", "model", "elements", "parameters", "J", "aicc", "bic")
    best = {column: best_row(rows, column) for column in ("aicc", "bic")}
    names = {column: row["model"] for column, row in best.items()}
    same = names["aicc"] == names["bic"]
    headline = (f"`{names['aicc']}` has the lowest AICc and the lowest BIC." if same else
                f"`{names['aicc']}` has the lowest AICc, `{names['bic']}` the lowest BIC.")
    close = [row["model"] for row in rows if row["model"] != names["aicc"]
             and p.number(row, "aicc") - p.number(best["aicc"], "aicc") < 2]
    verb = "is" if len(close) == 1 else "are"
    listed = ", ".join(f"`{name}`" for name in close)
    points = [(f"{listed} {verb} within 2 of the lowest AICc: the record hardly tells these models "
               "apart.")] * bool(close)
    unit = acceleration_squared(outputs, rows)
    power = h.common_power([p.number(row, "J") for row in rows])
    cells = [[f"`{row['model']}`", row["elements"], row["parameters"],
              h.significant(p.number(row, "J") / 10.0**power, 6),
              *(text for column in ("aicc", "bic") for text in (
                  h.fixed(p.number(row, column), 2),
                  h.fixed(p.number(row, column) - p.number(best[column], column), 2)))]
             for row in sorted(rows, key=lambda row: p.number(row, "aicc"))]
    head = f"J ({h.scaled_unit(power, unit)})" if power or unit else "J"
    text = h.paragraph("AICc and BIC weigh the sum of squared residuals J against the number of "
                       "free parameters. Lower is better; a difference above 10 is strong "
                       "evidence.")
    text += h.table(["model", "elements", "free parameters", head, "AICc", "to the best", "BIC",
                     "to the best"], [cells])
    columns = [(name, [p.number(row, key) - p.number(best[key], key) for row in rows])
               for key, name in (("aicc", "AICc"), ("bic", "BIC"))]
    text += h.figure(f.criteria([row["model"] for row in rows], columns),
                     "Differences of AICc and BIC from the lowest ones.")
    if has_rows(outputs.folder / "nested.csv"):
        cells = []
        for row in outputs.table("nested.csv", "restricted", "full", "restrictions", "U",
                                 "probability"):
            probability = p.number(row, "probability")
            cells.append([f"`{row['restricted']}`", f"`{row['full']}`", row["restrictions"],
                          h.significant(p.number(row, "U"), 3), h.significant(probability, 3),
                          "prefer the full model" if probability < 0.05 else
                          "no reason to prefer the full model"])
            if probability < 0.05:
                points.append(f"The additional parameters of `{row['full']}` beyond "
                              f"`{row['restricted']}` are significant (p = "
                              f"{h.significant(probability, 3)}).")
        text += "<h3>Nested models</h3>\n" + h.paragraph(
            "One model is nested in another one if it fixes parameters that the other one fits. "
            "Under the restricted model, U follows a chi-square distribution.") + h.table(
                ["restricted model", "full model", "restrictions", "U", "p", "conclusion"],
                [cells], left=2, wrap=(5,))
    sections = [("models", "Models", text)]
    if has_rows(outputs.folder / "damping.csv"):
        return damping_page.verdict(outputs), [damping_page.damping_ratios(outputs), *sections]
    return h.box("" if close else "good", headline, points), sections


def acceleration_squared(outputs, rows):
    """Returns the unit of J, from the case files of the models if they are at hand."""
    summary = outputs.summary("compare")
    if summary and "because the noise is known" in summary.text:
        return ""    # J is in units of the variance of the noise
    texts = list(outputs.case_files.values()) or [
        read_text(path) for row in rows for path in [find_case(row["model"])] if path]
    unit = outputs.units.get("acceleration") or (
        Units.of_case(texts[0]).get("acceleration") if texts else "")
    length, _, time = unit.partition("/")
    return f"{length}^2/{time.partition('^')[0]}^4" if time else ""


# -- design

def experiments(outputs):
    """Returns the verdict box and the sections of a comparison of experiments."""
    known_settings = plot_design.settings_of(outputs.folder)
    rows = outputs.table("design.csv", "design", *known_settings, "determined")
    names = [name[9:] for name in p.header(outputs.folder / "design.csv")
             if name.startswith("relative_")]
    summary = outputs.summary("design")
    units = outputs.units
    present = rows[0]
    determined = [row for row in rows[1:] if row["determined"] == "yes"]
    chosen = {}
    for criterion, key, sign in (("*D*", "D", -1), ("*A*", "A", 1), ("*E*", "E", -1),
                                 *((name, f"relative_{name}", 1) for name in names)):
        known = [row for row in determined or rows[1:] if value(row, key) is not None]
        if known:
            best = min(known, key=lambda row: sign * p.number(row, key))
            chosen.setdefault(best["design"], (best, []))[1].append(criterion)
    headline = (f"{len(determined)} of {plural(len(rows) - 1, 'experiment')} determine "
                f"{', '.join(names)}.")
    points = []
    if present["determined"] == "yes":
        errors = ", ".join(f"{name} {relative(present, name)}" for name in names)
        points.append(f"The experiment of the case would have the standard errors {errors}.")
    else:
        points.append("The experiment of the case does not determine every parameter.")
    if summary:
        points += [line for line in fit_page.unwrapped(summary.text)
                   if line.startswith(("a standard error of", "these predictions"))]
        at_end = re.findall(r"(?m)^design (\d+) is at the end of (.+): beyond", summary.text)
        ends = ", ".join(dict.fromkeys(name for _, what in at_end for name in what.split(", ")))
        points += [(f"The best experiments lie at the end of the list of {ends}: a better "
                    "experiment may lie beyond it.")] * bool(at_end)
    is_whole = not any(point.startswith("these predictions") for point in points)
    kind = ("bad" if not determined else
            "good" if is_whole and present["determined"] == "yes" else "")
    settings = [name for name in known_settings if len({row[name] for row in rows}) > 1]
    constant = [name for name in known_settings if name not in settings and present[name]]
    cells = [[("the case" if row is present else row["design"]),
              *(p.plain_number(number, 4) if (number := value(row, name)) is not None else ""
                for name in settings), row["samples"], *(relative(row, name) for name in names),
              ", ".join(reasons)]
             for row, reasons in [(present, []), *chosen.values()]]
    header = ["experiment", *(h.Raw(setting_title(name, units)) for name in settings),
              "samples", *(h.Raw(f"error of {h.symbol(name)}") for name in names), "best for"]
    same = ", ".join(f"{SETTINGS[name]} {p.plain_number(p.number(present, name), 4)} "
                     f"{units.get(plot_design.SETTINGS[name][1])}".strip() for name in constant)
    text = h.paragraph("Predicted standard errors, relative to the values of the parameters, of "
                       "the experiment in the case and of the best ones. *D*, *A* and *E* are the "
                       "criteria of optimal design: the determinant of the information, the sum of "
                       "the relative variances, and the least eigenvalue of the information.")
    text += h.table(header, [cells], wrap=(len(header) - 1,))
    text += h.paragraph(f"The same in all experiments: {same}.") if same else ""
    text += maps(outputs, rows, names)
    return h.box(kind, headline, points), [("experiments", "Experiments", text)]


def setting_title(name, units):
    """Returns the name of a setting of an experiment with its symbol and unit, as HTML."""
    symbol = f" {h.symbol(name.removesuffix('_2'))}" if name[0] == "x" else ""
    return f.label(SETTINGS[name] + symbol, units.get(plot_design.SETTINGS[name][1]))


def relative(row, name):
    """Returns a relative standard error in per cent; above 1000 % it says nothing more."""
    number = value(row, f"relative_{name}")
    return "none" if number is None else "> 1000 %" if number > 10 else (
        h.significant(100 * number, 3) + "\u00a0%")


def maps(outputs, rows, names):
    """Returns a figure for each parameter: the standard error over the settings that vary."""
    settings = [name for name in plot_design.settings_of(outputs.folder)
                if len(plot_design.values_of(rows, name)) > 1]
    if not settings:
        return ""
    over, units = settings[:2], outputs.units
    axes = [plot_design.values_of(rows, name) for name in over]
    titles = [setting_title(name, units) for name in over]
    charts, highest = [], MOST_ERROR
    for name in names:
        best = np.full([len(values) for values in axes], np.inf)
        for row in rows[1:]:
            at = [row[setting] for setting in over]
            if all(at):
                place = tuple(values.index(float(x)) for values, x in zip(axes, at))
                best[place] = min(best[place], 100 * (value(row, f"relative_{name}") or np.inf))
        if not np.isfinite(best).any():
            continue
        highest = max(highest, 10 * best.min())
        best[best > max(MOST_ERROR, 10 * best.min())] = np.nan
        if len(over) == 1:
            charts.append(h.figure(f.error_curve(axes[0], best, titles[0],
                                                 f"standard error of {h.symbol(name)} (%)"),
                                   name=f"Standard error of {name}"))
            continue
        where = np.unravel_index(np.nanargmin(best), best.shape)
        marks = [(f"best: {h.significant(best[where], 3)} %", "star", 11, where)]
        at = [value(rows[0], setting) for setting in over]
        if all(x in values for x, values in zip(at, axes)):
            marks.insert(0, (f"the case: {relative(rows[0], name)}", "circle", 17,
                             [values.index(x) for x, values in zip(at, axes)]))
        charts.append(h.figure(f.error_map(axes, best, titles, marks),
                               f"Standard error of {name}"))
    if not charts:
        return ""
    rest = " and ".join(SETTINGS[key] for key in settings[2:])
    return h.panels(charts, "Lowest predicted standard errors, relative to the values of the "
                    "parameters." + f" At each point, the best {rest} counts." * bool(rest)
                    + f" An empty field: no such error is below {h.significant(highest, 3)} %.")


# -- ensemble

def ensemble(outputs):
    """Returns the verdict box and the sections of an ensemble or a fleet."""
    members = outputs.table("members.csv", "member", "status", "parameter")
    rows = outputs.table("ensemble.csv", "elements", "parameter", "members", "mean", "sd")
    count = len({row["member"] for row in members})
    failed = [row for row in members if row["status"] != "ok"]
    cases = {row["member"]: row["case"] for row in outputs.table("cases.csv", "member", "case")
             } if outputs.has("cases.csv") else {}
    known = [row for row in rows if value(row, "covered") is not None]
    off = [row for row in known if value(row, "covered_error") and abs(
        p.number(row, "covered") - 0.95) > WORST_COVERAGE * p.number(row, "covered_error")]
    noun = "case" if cases else "simulated record"
    headline = (f"{count - len({row['member'] for row in failed})} of {plural(count, noun)} gave "
                "a result.")
    points = [f"95 % intervals of {row['parameter']} hold the true value in "
              f"{100 * p.number(row, 'covered'):.1f} % of the records." for row in off]
    if known and not off:
        points.append("For every parameter, the share of 95 % intervals that hold the true value "
                      f"is within {WORST_COVERAGE} standard errors of 95 %.")
    text = statistics_table(outputs, [row for row in rows if row["members"] != "1"] if cases
                            else rows, bool(known))
    text += fleet(outputs, members, cases) if cases else histograms(outputs, members)
    sections = [("members", "Cases" if cases else "Members", text)]
    if has_rows(outputs.folder / "changed.csv"):
        head = p.header(outputs.folder / "changed.csv")
        changes = outputs.table("changed.csv")
        sections.append(("changed", "Changed parameters", h.table(
            head, [[[short(row[key]) for key in head] for row in changes]])))
    if failed:
        cells = [[cases.get(row["member"], row["member"]), row.get("message") or row["status"]]
                 for row in failed[:100]]
        sections.append(("failed", "Failed members", h.table(
            ["case" if cases else "member", "message"], [cells], wrap=(1,))))
    return h.box("" if failed or off else "good", headline, points), sections


def short(text):
    """Returns a field of a table, a number with six digits."""
    try:
        return h.significant(float(text), 6)
    except ValueError:
        return text


def statistics_table(outputs, rows, known):
    """Returns the table of ensemble.csv; with the bias and the coverage if the truth is known."""
    cells = []
    if not rows:
        return ""
    for row in rows:
        name = row["parameter"]
        mean, sd, error, bias, bias_error = (
            value(row, key) for key in ("mean", "sd", "mean_std_error", "bias", "bias_error"))
        power = h.common_power([mean, sd])
        ten = 10.0**power
        decimals = None
        if sd:
            decimals = max(2 - math.floor(math.log10(sd / ten)), 0)
            decimals = None if decimals > h.MOST_DIGITS else decimals

        def text(number, decimals=decimals, ten=ten):
            return "" if number is None else h.significant(number / ten) if decimals is None \
                else h.fixed(number / ten, decimals)

        line = [h.name_cell(name), row["members"], text(mean), text(sd), text(error)]
        if known:
            line += [f"{text(bias)} ± {text(bias_error)}" if bias is not None else "",
                     f"{100 * p.number(row, 'covered'):.1f} ± "
                     f"{100 * (value(row, 'covered_error') or 0):.1f}"
                     if value(row, "covered") is not None else ""]
        cells.append([*line, h.Raw(h.scaled_unit(power, outputs.units.of(name)))])
    header = ["parameter", "members", "mean", "standard deviation", "mean standard error",
              *["bias", "intervals with the truth (%)"] * known, "unit"]
    note = ("Standard deviation: of the estimates over all members, which includes the spread of "
            "drawn parameters. Mean standard error: as the fits state it.")
    more = " Bias: mean of estimate minus truth." * known
    if any(row["parameter"].startswith("frequency_") for row in rows):
        more += " f: natural frequency, ζ: damping ratio of a mode."
    return h.table(header, [cells]) + h.paragraph(note + more)


def grouped(members):
    """Returns the rows of members that gave a result, by parameter."""
    found = {}
    for row in members:
        if row["status"] == "ok" and value(row, "estimate") is not None:
            found.setdefault(row["parameter"], []).append(row)
    return found


def spread_of(rows):
    """Returns the range of the estimates relative to the largest one."""
    values = [p.number(row, "estimate") for row in rows]
    return (max(values) - min(values)) / (max(map(abs, values)) or 1.0)


def histograms(outputs, members):
    """Returns small histograms: of scaled errors if the truth is known, else of the estimates."""
    charts, scaled = [], False
    for name, rows in grouped(members).items():
        errors = [(p.number(row, "estimate") - value(row, "truth")) / value(row, "std_error")
                  for row in rows if value(row, "truth") is not None and value(row, "std_error")]
        if len(errors) > 1:
            scaled = True
            title = f"(estimate − truth) / standard error of {h.symbol(name)}"
            charts.append(h.figure(f.pulls(np.array(errors), title), name=f"Errors of {name}"))
        elif len(rows) > 1 and spread_of(rows) > 1e-6:
            values = np.array([p.number(row, "estimate") for row in rows])
            power = h.common_power(values)
            title = f.label(h.symbol(name), h.scaled_unit(power, outputs.units.of(name)))
            charts.append(h.figure(f.spread(values / 10.0**power, title),
                                   name=f"Values of {name}"))
    if not charts:
        return ""
    keys = [("grey", "area", "members"), ("blue", "line", "standard normal density")]
    return h.panels(charts, "Errors of the estimates, divided by their standard errors. If the "
                    "standard errors are right, the histogram follows the normal density."
                    if scaled else "Values over all members.", keys if scaled else ())


def fleet(outputs, members, cases):
    """Returns the estimates of each case on its finest mesh, as figures and as a table."""
    units = {member: Units.of_case(case_text(case)) for member, case in cases.items()}
    finest = {}
    for row in members:
        if row["status"] == "ok" and value(row, "estimate") is not None:
            mesh = p.number(row, "elements", int)
            finest[row["member"]] = max(mesh, finest.get(row["member"], mesh))
    shown = [row for row in members if row["member"] in finest
             and row["elements"] == str(finest[row["member"]])
             and not row["parameter"].startswith(("cos_", "sin_"))]
    alike, tables = {}, []
    for member, case in cases.items():
        lines = []
        for row in (row for row in shown if row["member"] == member):
            name = row["parameter"]
            estimate, low, high = (value(row, key) for key in ("estimate", *(
                ("total_lower95", "total_upper95") if row.get("total_lower95") else
                ("lower95", "upper95"))))
            unit = units[member].of(name)
            alike.setdefault((name, unit), []).append((stem(case), estimate, low, high))
            power = h.common_power([estimate, low, high])
            lines.append(["" if lines else f"`{stem(case)}`", h.name_cell(name),
                          *h.measured(estimate, low, high, power),
                          h.Raw(h.scaled_unit(power, unit))])
        tables.append(lines)
    charts = []
    for (name, unit), rows in alike.items():
        if len(rows) < 2:
            continue
        names, *columns = zip(*((case, x, x if low is None else low, x if high is None else high)
                                for case, x, low, high in rows[:MOST_CASES]))
        power = h.common_power([x for column in columns for x in column])
        title = f.label(h.symbol(name), h.scaled_unit(power, unit))
        charts.append(h.figure(f.forest(names, *(np.array(column) / 10.0**power
                                                 for column in columns), title),
                               name=f"Estimates of {name}"))
    text = h.panels(charts, "Estimates of each case with their 95 % intervals.") if charts else ""
    return text + h.table(["case", "parameter", "estimate", "95 % interval", "unit"],
                          [lines for lines in tables if lines], left=2)


def stem(path):
    """Returns the name of a case without folder and ending."""
    return path.rsplit("/", 1)[-1].removesuffix(".nml")


def case_text(path):
    """Returns the text of a case file if it is at hand."""
    found = Path(path) if Path(path).is_file() else find_case(stem(path))
    return read_text(found) if found else ""


# -- the page

def case_section(outputs):
    """Returns the section with the case file, or how to add one."""
    if len(outputs.case_files) > 1:
        return "".join(f"<h3><code>{html.escape(name)}</code></h3>\n" + h.preformatted(text)
                       for name, text in outputs.case_files.items())
    if outputs.case is not None:
        return (h.paragraph(outputs.case_note) if outputs.case_note else "") + h.preformatted(
            outputs.case)
    if outputs.has("models.csv"):
        found = {row["model"]: find_case(row["model"])
                 for row in outputs.table("models.csv", "model")}
        if all(found.values()):
            return h.paragraph("These are the case files as they are now.") + "".join(
                f"<h3><code>{html.escape(name)}</code></h3>\n" + h.preformatted(read_text(path))
                for name, path in found.items())
    return h.paragraph("The outputs hold no case file. `--case FILE` adds it to the page.")


def document(outputs, units=None):
    """Returns the whole page of an output folder; `units` as `preferred` of `fit_page.Fit`."""
    boxes, sections = [], []
    if outputs.has("estimates.csv") and outputs.has("quality.csv"):
        fit = fit_page.Fit(outputs, units)
        boxes.append(fit.verdict())
        sections += fit.sections()
    elif outputs.has("intervals.csv"):
        part = intervals(outputs)
        boxes.append(part[0])
        sections += part[1]
    for name, commands, build in (("response.csv", ["simulate"], simulated),
                                  ("modes.csv", ["modes"], natural_modes),
                                  ("frf.csv", ["frf"], frf_page.computed),
                                  ("models.csv", ["compare"], comparison),
                                  ("design.csv", ["design"], experiments),
                                  ("track.csv", ["track"], track_page.followed),
                                  ("members.csv", ["ensemble"], ensemble)):
        if outputs.written_by(name, *commands):
            box, more = build(outputs)
            boxes.append(box)
            taken = {section[0] for section in sections}
            sections += [(f"{key}-2" if key in taken else key, heading, text)
                         for key, heading, text in more]
    if not boxes:
        p.fail(f"{outputs.folder}: found outputs of {', '.join(outputs.commands()) or 'nothing'}, "
               f"expected those of {', '.join(LEADS)} or reproduce")
    commands = [name for name in outputs.commands() if name in LEADS]
    did = [LEADS[name] for name in sorted(commands, key=list(LEADS).index)]
    lead = ", ".join(did[:-1]) + " and " * (len(did) > 1) + did[-1]
    ending = case_section(outputs)
    if outputs.written_by("summary.txt", *outputs.commands()):
        ending += h.unfolded("All that the program printed",
                             read_text(outputs.folder / "summary.txt"))
    opening = (f"<h1>{html.escape(outputs.name)}</h1>\n"
               f'<p class="lead"><code>beamid</code> {h.rich(lead)}.</p>\n' + "".join(boxes))
    kind = "a fit" if "identify" in commands else " and ".join(commands)
    return h.document(f"{outputs.name}: {kind} by beamid", [
        ("top", "", opening), *sections, ("case", "The case file", ending)])
