"""The page about NASA CR-178199 for report.py, and pages of its parts (reproduce table-4.1)."""

import html
import re

import figures as f
import plotting as p
import page as h
import plot_convergence
import plot_fit
import plot_paper
import studies
import numpy as np
from model_curve import model_curve
from program import CHECKOUT, read_text
from units import Units

UNITS = {"m_T": "slug", "E": "lb/ft²", "c_D": "lb s/ft²", "m_H": "slug", "c_H": "lb s/ft",
         "k_H": "lb/ft"}
NAMES = {"no_hose": "no hose, no damping"}     # of the models that are not named after a table
FACTOR = 16                                    # the paper's J over ours in Table 4.1

TABLES = {    # table: what it is, its figures
    "4.2": ("Table 4.2: m_H and k_H fitted, no damping",
            "The first fit: c_D and c_H are held at zero, mass and stiffness of the hose are free.",
            ()),
    "4.3": ("Table 4.3: the hose's damping c_H as well",
            "First c_H alone, from zero, then m_H, c_H and k_H together.", ()),
    "4.4": ("Table 4.4: the beam's damping c_D as well",
            ("First c_D alone, from zero, then all four. The curves below are those of *our* "
             "estimates, which need not be those of the paper's table."), ("4.4", "4.5")),
    "4.5": ("Table 4.5: E and m_T by matched modes",
            ("Nothing is fitted to the record here: Floyd adjusted m_T and then E until the first "
             "mode of a beam without hose agreed with an observed one."), ("4.6", "4.7")),
    "4.6": ("Table 4.6: E and m_T fitted, no hose",
            "The same model as in Table 4.5, but with E and m_T from the sum of squares.",
            ("4.8", "4.9")),
}

CASE_4_1 = CHECKOUT / "data" / "table_4_1_fit.nml"    # the case of `reproduce table-4.1`
MISPRINTED = 3    # the row of Table 4.1 whose c_D lacks a zero

PARTS = ("table-4.1", "section-4", "table-4.2", "table-4.3", "table-4.4", "table-4.5", "table-4.6",
         "acceleration", "convergence", "varying")    # commands of `reproduce`

STUDIES = {    # part: its heading, text, the function that draws it, the caption
    "acceleration": (
        "Three formulas for the acceleration",
        ("The paper prefers differences of the displacement (4.1) or of the velocity (4.2) to the "
         "equation of motion itself (3.13), as more stable. This compares the three."),
        studies.acceleration,
        "Error of the tip acceleration over the tolerance of the integrator."),
    "convergence": (
        "Convergence",
        "How fast the splines converge to the solution, in the norms of the paper's theory.",
        studies.convergence, "Errors over the number of elements, both axes logarithmic."),
    "varying": (
        "Parameters that vary along the beam",
        ("What the theorem says of parameters that vary along the beam: the distance of E(x) and "
         "c_D(x) from the truth as the meshes of the state and of the functions are refined."),
        studies.varying,
        "Distances over the number of coefficients, both axes logarithmic."),
}


def summary_of(folder):
    """summary.txt of a part."""
    return h.Summary(read_text(folder / "summary.txt"))


def name_of(model):
    """A model's name on the page."""
    return NAMES.get(model, f"Table {model}")


def compared(names, units, ours, paper):
    """Rows ours, paper, differs below the names of the parameters; ours may be None."""
    columns = [h.column([mine, theirs]) for mine, theirs in zip(ours, paper)]
    header = ["", *(h.Raw(f"{h.symbol(name)} ({power}{h.raised(unit)})")
                    for name, unit, (_, power) in zip(names, units, columns))]
    rows = [["paper", *(texts[1] for texts, _ in columns)]]
    if None not in ours:
        rows.insert(0, ["ours", *(texts[0] for texts, _ in columns)])
        rows.append(h.Soft(["differs", *(h.percent(mine / theirs) if theirs else ""
                                         for mine, theirs in zip(ours, paper))]))
    return h.table(header, [rows])


class SimulatedData:
    """Table 4.1 in an output folder, beside the paper's."""

    def __init__(self, folder):
        self.folder = p.outputs(folder)
        self.units = Units.of_folder(folder)
        self.summary = summary_of(folder)
        stage = p.last_stage(folder)
        self.meshes = {n: {row["parameter"]: p.number(row, "estimate") for row in rows}
                       for n, rows in stage.items()}
        self.rows = next(iter(stage.values()))
        self.paper = {}
        for row in p.read_table(folder / "paper.csv", "elements", "parameter", "value"):
            mesh = self.paper.setdefault(p.number(row, "elements", int), {})
            mesh[row["parameter"]] = p.number(row, "value")
        truth_file = folder / "truth.csv"
        self.truth = plot_convergence.read_values(truth_file) if truth_file.exists() else {}

    def worst(self):
        """Returns the largest relative differences from the paper, as texts: of m_H, c_H and k_H,
        and of c_D without the misprint."""
        both = {n: values for n, values in self.paper.items() if n in self.meshes}
        shared = [(self.meshes[n][name], values[name]) for n, values in both.items()
                  for name in ("m_H", "c_H", "k_H")]
        damping = [(self.meshes[n]["c_D"], values["c_D"]) for n, values in both.items()
                   if n != MISPRINTED]
        return worst(shared), worst(damping)

    def table(self):
        """Returns the table of our estimates, the paper's and their differences."""
        names = [row["parameter"] for row in self.rows if row["parameter"] != "J"]
        units = {row["parameter"]: h.raised(row.get("unit")) for row in self.rows}
        groups = []
        for n, ours in self.meshes.items():
            theirs = self.paper.get(n)
            rows = [[f"{n}", "ours", *(h.fixed(ours[name], 6) for name in names),
                     h.scientific(ours["J"]), h.scientific(FACTOR * ours["J"])]]
            if theirs:
                rows += [["", "paper", *(h.fixed(theirs[name], 6) for name in names), "",
                          h.scientific(theirs["J"])],
                         h.Soft(["", "differs", *(h.percent(ours[name] / theirs[name])
                                                  for name in names), "",
                                 h.percent(FACTOR * ours["J"] / theirs["J"])])]
            groups.append(rows)
        if self.truth:
            groups.append([["", "true", *(h.fixed(self.truth.get(name), 6) for name in names), "",
                            ""]])
        header = [h.Raw("<i>N</i>"), "",
                  *(h.Raw(f"{h.symbol(name)} ({units[name]})") for name in names),
                  h.Raw(f"<i>J</i> ({units['J']})"), h.Raw(f"{FACTOR} <i>J</i>")]
        return h.table(header, groups, left=2)

    def convergence(self):
        """Returns the figures of J and of the errors over the number of elements."""
        ours = plot_convergence.series(self.meshes)
        paper = plot_convergence.read_paper(self.folder / "paper.csv")
        n, J = ours["J"]
        truth = self.truth or {name: values[-1] for name, (_, values) in ours.items()}
        free = [name for name in ours if name != "J" and truth.get(name)]

        def errors(series):
            found = {}
            for name in free:
                if name in series:
                    error = np.abs(series[name][1] / truth[name] - 1)
                    found[name] = series[name][0][error > 0], error[error > 0]
            return found

        what = "the true values" if self.truth else "the finest mesh"
        return h.figure(
            f.convergence({"sum of squares": (n, FACTOR * J)},
                          {"sum of squares": paper["J"]} if "J" in paper else {},
                          "number of elements <i>N</i>", f"{FACTOR} <i>J</i>", str),
            f"{FACTOR} times the sum of squared residuals over the number of elements, and the "
            "paper's sum (hollow).") + h.figure(
            f.convergence(errors(ours), errors(paper), "number of elements <i>N</i>",
                          "relative error", h.symbol),
            f"Relative differences of the estimates from {what}; hollow: the paper's.")

    def curves(self):
        """Returns the figure of the record, the model on the finest mesh and the residuals."""
        meshes = next(iter(plot_fit.read_fit(self.folder).values()))
        finest = max(meshes)
        t, measured, model, residual, _ = meshes[finest]
        figure = f.record_and_model(t, measured, residual, fine_curve(
            self.meshes[finest], finest, t, model), self.units, finest)
        return h.figure(figure, "The simulated record, the model on the finest mesh and its "
                        "residuals.")

    def section(self, badge=""):
        """Returns the text, the table, the remarks and the figures."""
        return (h.paragraph(
            "Data made with known parameters (row *true*) are fitted with models of N = "
            f"{min(self.meshes)} to {max(self.meshes)} spline elements. The data were made again "
            "for this, so the comparison needs nothing of the paper but its table. The symbol c_D "
            f"stands for c_D I with I = 1. The paper's J is set beside {FACTOR} times ours, for "
            "the reason in remark 1.", badge=badge)
            + self.table() + self.summary.block("Remarks") + self.curves() + self.convergence())


def fine_curve(estimates, elements, t, model):
    """Returns times and values of the model of Table 4.1 between its samples."""
    free = {name: value for name, value in estimates.items() if name != "J"}
    case = read_text(CASE_4_1) if CASE_4_1.exists() else None
    return model_curve(case, free, elements, t, model)[:2]


def worst(pairs):
    """Returns the largest relative difference, as text."""
    return h.percent(1 + max(abs(mine / theirs - 1) for mine, theirs in pairs if theirs))


class Page:
    """The results of all parts in a folder, and the sections made of them."""

    def __init__(self, folder):
        self.folder = folder
        self.results = plot_paper.read_results(p.outputs(folder / "section-4"))
        self.summary = summary_of(folder / "section-4")
        columns = ("ours", "paper", "at_paper_estimates", "distance2", "paper_difference", "bound")
        self.sums = {row["model"]: {name: p.number(row, name) for name in columns} for row in
                     p.read_table(folder / "section-4" / "sums.csv", "model", *columns)}
        self.frequencies = {}
        for row in p.read_table(folder / "section-4" / "frequencies.csv", "model", "frequency_hz"):
            values = self.frequencies.setdefault(row["model"], [])
            values.append(p.number(row, "frequency_hz"))
        if "no_hose" not in self.frequencies:
            p.fail(f"{folder / 'section-4' / 'frequencies.csv'}: no model 'no_hose'")
        self.table_4_1 = SimulatedData(folder / "table-4.1")

    def figure(self, number):
        """One of the paper's figures."""
        return paper_figure(number, self.results)

    def differences(self, table):
        """How far each of our estimates is from a table of Section 4, as text."""
        return ", ".join(f"{name} {h.percent(value / self.results.paper[table][name])}"
                         for name, value in self.results.estimates[table].items())

    def opening(self):
        """Title, warning, what is reproduced at a glance."""
        shared, damping = self.table_4_1.worst()
        sums = self.sums.values()
        printed = worst((row["at_paper_estimates"], row["paper"]) for row in sums)
        within = sum(abs(row["paper_difference"] - row["distance2"]) <= row["bound"]
                     for row in sums if row["bound"])
        others = sum(row["bound"] > 0 for row in sums)
        bare = [h.fixed(value, 2) for value in self.frequencies["no_hose"][:2]]
        apart = re.search(r"\|Y - Y_0\|\^2 = (\S+) apart", self.summary.text)
        rows = [("Table 4.1: four parameters from simulated data", h.INDEPENDENT,
                 (f"m_H, c_H and k_H differ by {shared} at most, on every mesh; c_D, "
                  f"which such a record hardly determines, by {damping}, N = "
                  f"{MISPRINTED} left out as a misprint")),
                ("Distances between the six models of Section 4", h.INDEPENDENT,
                 f"the printed sums are possible: {within} of {others} within the bound"),
                ("Frequencies of the bare beam with the predicted E and m_T", h.INDEPENDENT,
                 f"{' and '.join(bare)} Hz; the paper observed .75 and 7.5 Hz"),
                *[("Effect of the paper's c_D on the response", h.INDEPENDENT,
                   (f"squared distance {h.scientific(float(apart[1]), 1)} ft²/s⁴: no record of "
                    "this kind determines it"))] * bool(apart),
                ("Six sums of squares at the paper's values", h.REBUILT,
                 f"differ by {printed} at most, as the record was built to have"),
                *((f"Table {table}: estimates", h.REBUILT, f"differ by {self.differences(table)}")
                  if plot_paper.fitted(self.results, table) else
                  (f"Table {table}: E and m_T by matched modes, nothing fitted", h.REBUILT,
                   (f"sum of squares {p.plain_number(sums_of['ours'], 4)}, the paper prints "
                    f"{p.plain_number(sums_of['paper'], 4)}"))
                  for table in TABLES for sums_of in [self.sums[table]])]
        return ("<h1>The identification of a flexible beam, computed again</h1>\n"
                '<p class="lead">What the program <code>beamid</code> makes of the tables and '
                "figures of NASA CR-178199 (Banks, Gates, Rosen and Wang, 1986), beside what the "
                "paper prints.</p>\n"
                '<div class="box"><strong>Read this first: the record of Section 4 is '
                "reconstructed.</strong> The measurement behind Tables 4.2 to 4.6 was never "
                "published as numbers. The record used here was rebuilt from the numbers that the "
                "paper does print, so agreement with those numbers is a <em>consistency check, not "
                "a confirmation</em>: it shows that they can go together, and no more. On this "
                f"page {h.REBUILT} marks what rests on that record, and {h.INDEPENDENT} what does "
                "without it.</div>\n" + h.overview(rows))

    def experiment(self):
        """What was measured, and what the paper did with it."""
        caption = ("The model: a beam clamped at one end; at its tip a mass with thruster and "
                   "accelerometer, and the hose as a mass on a spring and a dashpot.")
        return (h.paragraph(
            "One arm of a laboratory structure for the control of large spacecraft (the RPL "
            "experiment) is clamped at one end. The arm is an aluminium strip 4 ft long, 6 in wide "
            "and .125 in thick. At its free end sit a small thruster and an accelerometer; a "
            "pressurised hose that feeds the thruster hangs on the same spot. The thruster fires "
            "for .05 s with .297 lb, the arm swings, and the accelerometer is read every 5 ms for "
            "5 s: 1000 numbers. (The numbers of this section are the paper's.)")
            + f"<figure>{h.SKETCH}<figcaption>{h.rich(caption)}</figcaption></figure>\n"
            + h.paragraph(
            "The question is what that one record says about the structure: the beam's stiffness E "
            "and damping c_D, the tip mass m_T, and the hose's mass m_H, damping c_H and stiffness "
            "k_H. The authors wrote the motion as a partial differential equation for the beam "
            "coupled to an oscillator for the hose, replaced it by one for a few cubic splines, "
            "integrated that in time, and looked for the parameters with the least sum J of "
            "squared differences between model and record.")
            + h.paragraph(
            "They tried the method on simulated data first (Table 4.1), where the truth is known. "
            "For the experiment they fitted the last two seconds of the record, where a torsional "
            "mode of some 14 Hz that the model does not have has died out, at steps of .1 s "
            "(Tables 4.2 to 4.4 with a hose, Table 4.6 without), and judged every model, fitted or "
            "not, by the sum of its squared residuals over all five seconds."))

    def record(self):
        """The record, the beam without hose, the terms that the tables share."""
        return (h.paragraph("Figure 4.1 is the record, as rebuilt. Figure 4.2 is the response of "
                            "the bare beam with the predicted E and m_T, which the paper computes "
                            "for comparison, and Figure 4.3 what it leaves of the record.")
                + self.summary.block("J:") + "".join(map(self.figure, ("4.1", "4.2", "4.3"))))

    def fitted_tables(self):
        """Tables 4.2 to 4.6, each with what the statistics say and its figures."""
        parts = []
        for table, (title, text, figures) in TABLES.items():
            ours, paper = self.results.estimates[table], self.results.paper[table]
            sums = self.sums[table]
            fitted = plot_paper.fitted(self.results, table)
            parts += [f"<h3>{h.rich(title)}</h3>\n", h.paragraph(text, badge=h.REBUILT),
                      compared(paper, [UNITS[name] for name in paper],
                               [ours[name] for name in paper], list(paper.values())),
                      h.paragraph(f"Sum of squared residuals over all five seconds: "
                                  f"{p.plain_number(sums['ours'], 4)}"
                                  f"{' at our estimates' * fitted}; the paper prints "
                                  f"{p.plain_number(sums['paper'], 4)}."),
                      h.paragraph("What the statistics say, and what is *independent*:"),
                      self.summary.block(f"Table {table}", remarks=True),
                      *(self.figure(number) for number in figures)]
            if table == "4.4":
                parts.append(self.valley())
        return "".join(parts)

    def valley(self):
        """The picture of the valley."""
        rise = plot_paper.one_standard_error(self.results) / self.results.valley[:, 3].min()
        return h.figure(valley(self.results),
                        f"{plot_paper.VALLEY}. {plot_paper.RECONSTRUCTED}. Above: the least J for "
                        "a given m_H; below: the c_H and k_H that go with it, and the paper's two "
                        "tables (diamond and square). A change of the estimates that raises J by "
                        f"less than {h.fixed(100 * rise, 1)} % (dashed) is within one standard "
                        "error: the record hardly tells one place in the valley from another.")

    def six_sums(self):
        """The sums at the paper's estimates and at ours."""
        rows = [[name_of(model), h.fixed(row["paper"], 3), h.fixed(row["at_paper_estimates"], 4),
                 h.percent(row["at_paper_estimates"] / row["paper"]), h.fixed(row["ours"], 4),
                 h.percent(row["ours"] / row["paper"])] for model, row in self.sums.items()]
        header = ["model", "printed", "at the paper's values", "differs", "at our estimates",
                  "differs"]
        return (h.paragraph("Sums of squared residuals over all five seconds, at steps of .1 s, in "
                            "ft²/s⁴. Where nothing is fitted both are the same.", badge=h.REBUILT)
                + h.table(header, [rows]))

    def distances(self):
        """What needs no record: how far the models' responses are from one another."""
        rows = [[name_of(model), h.fixed(row["distance2"], 3), h.fixed(row["paper_difference"], 3),
                 h.fixed(row["paper_difference"] - row["distance2"], 3), h.fixed(row["bound"], 3)]
                for model, row in self.sums.items() if row["bound"]]
        return (h.paragraph("The responses of the six models at the paper's values can be computed "
                            "without any record. Let Y be such a response and S the sum of squares "
                            "of a record about it. For *any* record two sums differ by the squared "
                            "distance of the two responses to within a bound; printed sums beyond "
                            "it would be impossible. Here every model is set against that of Table "
                            "4.4.", badge=h.INDEPENDENT)
                + h.table(["model", "squared distance", "printed difference of S", "apart by",
                           "bound"], [rows]))

    def frequency_table(self):
        """Natural frequencies at our estimates, and the program's table with the paper's."""
        modes = max(map(len, self.frequencies.values()))
        rows = [[name_of(model), *(h.fixed(value, 4) for value in values),
                 *[""] * (modes - len(values))] for model, values in self.frequencies.items()]
        header = ["at our estimates", *(f"mode {k + 1} (Hz)" for k in range(modes))]
        return (h.paragraph("Undamped natural frequencies. With a hose the lowest mode is the "
                            "hose's. Those at the paper's values are independent of any record; "
                            "the program's own table sets them beside ours and beside the observed "
                            "ones.")
                + h.table(header, [rows]) + self.summary.block("Undamped frequencies"))

    def study(self, name):
        """A part that may not have been computed."""
        folder = self.folder / name
        if not (folder / f"{name}.csv").exists():
            return h.paragraph(f"Not computed yet: `scripts/run.sh reproduce {name} --out {folder}`"
                               " makes it, and `scripts/report.py` then shows it here.")
        return study(p.outputs(folder), name, h.INDEPENDENT)

    def ending(self):
        """How the page was made, and all the program printed."""
        parts = [("Table 4.1", self.table_4_1.summary), ("Section 4", self.summary)]
        return (h.paragraph("`scripts/run.sh reproduce all` computes every number, "
                            "`scripts/report.py` writes this page from its outputs, and "
                            "`scripts/plot_paper.py` the figures as files. The record is made by "
                            "`scripts/reconstruct_record.py`, whose head says how.")
                + h.paragraph("H. T. Banks, S. S. Gates, I. G. Rosen, Y. Wang, *The identification "
                              "of a distributed parameter model for a flexible structure*, NASA "
                              "CR-178199, ICASE Report 86-71, 1986.")
                + "".join(h.unfolded(f"{name}: all that the program printed", summary.text)
                          for name, summary in parts))

    def document(self):
        """The whole page."""
        return h.document("The identification of a flexible beam, computed again", [
            ("top", "", self.opening()),
            ("experiment", "The experiment, and what the paper did", self.experiment()),
            ("table-4-1", "Table 4.1: simulated data", self.table_4_1.section(h.INDEPENDENT)),
            ("record", "Section 4: the record", self.record()),
            ("tables", "Section 4: Tables 4.2 to 4.6", self.fitted_tables()),
            ("sums", "Section 4: six sums of squares", self.six_sums()),
            ("distances", "Section 4: distances between the models", self.distances()),
            ("frequencies", "Frequencies", self.frequency_table()),
            *((name, STUDIES[name][0], self.study(name)) for name in STUDIES),
            ("made", "How this page was made", self.ending())])


# -- figures of the paper

def paper_figure(number, results):
    """Returns one of the paper's figures."""
    model, kind, _ = plot_paper.FIGURES[number]
    t, measured, response, residual = results.curves[model]
    unit = Units({"length": "ft", "time": "s"}).get("acceleration")
    quantity = "residual" if kind == plot_paper.RESIDUALS else "acceleration at the tip"
    figure = f.new(330, "time (s)", f.label(quantity, unit))
    shown = residual if kind == plot_paper.RESIDUALS else measured
    if kind == plot_paper.RESIDUALS:
        f.add_line(figure, t, residual, "record − model", f.colour("vermilion"), width=1)
    elif kind != plot_paper.MODEL:
        f.add_line(figure, t, measured, "record (reconstructed)", f.colour("grey"), width=1)
    if kind in (plot_paper.FIT, plot_paper.MODEL):
        f.add_line(figure, t, response, "model", f.colour("blue"), width=2)
    if kind == plot_paper.RECORD or (kind != plot_paper.MODEL
                                     and plot_paper.fitted(results, model)):
        chosen = plot_paper.window_samples(t)
        figure.add_vrect(*plot_paper.WINDOW, fillcolor=f.colour("haze"), line_width=0,
                         layer="below")
        figure.add_scatter(x=f.numbers(t[chosen]), y=f.numbers(shown[chosen]), mode="markers",
                           name="the {} samples of the fit, {:g} to {:g} s".format(
                               chosen.sum(), *plot_paper.WINDOW),
                           marker=dict(size=6, color=f.colour("back"),
                                       line=dict(color=f.colour("ink"), width=1.2)))
    figure.update_yaxes(range=list(plot_paper.limits(results, kind)))
    figure.update_layout(showlegend=True)
    notes = ". ".join(plot_paper.caption(number, results))
    return h.figure(figure, f"Figure {number}. {plot_paper.TITLES[number]}. {notes}.")


def valley(results):
    """Returns the figure of J along the valley, and of the c_H and k_H that belong to it."""
    m_H, c_H, k_H, J = results.valley.T
    figure = f.stacked([2, 1, 1], f.label(h.symbol("m_H"), "slug"),
                       [f.label("<i>J</i>", "ft^2/s^4"), f.label(h.symbol("c_H"), "lb s/ft"),
                        f.label(h.symbol("k_H"), "lb/ft")], 560)
    ours = results.estimates["4.3"]
    f.add_line(figure, m_H, J, f"lowest <i>J</i> for this {h.symbol('m_H')}", f.colour("blue"),
               row=1, width=2)
    figure.data[-1].update(mode="lines+markers", marker_size=5)
    figure.add_hline(y=J.min() + plot_paper.one_standard_error(results), line_dash="dash",
                     line_width=1, line_color=f.colour("grey"), row=1, col=1)
    for row, values in ((2, c_H), (3, k_H)):
        f.add_line(figure, m_H, values, "", f.colour("blue"), row=row, width=2, showlegend=False)
    minimum = plot_paper.at_minimum(results, "4.3")
    for row, y in ((1, minimum[1]), (2, ours["c_H"]), (3, ours["k_H"])):
        figure.add_scatter(x=[float(minimum[0])], y=[float(y)], mode="markers", name="our minimum",
                           marker=dict(size=9, color=f.colour("ink")), row=row, col=1)
    for table, tone, mark, dash in (("4.3", "vermilion", "diamond", "dash"),
                                    ("4.4", "green", "square", "dot")):
        theirs = results.paper[table]
        figure.add_vline(x=theirs["m_H"], line_color=f.colour(tone), line_dash=dash, line_width=1.4)
        for row, name in ((2, "c_H"), (3, "k_H")):
            figure.add_scatter(x=[theirs["m_H"]], y=[theirs[name]], mode="markers",
                               name=f"Table {table} of the paper", row=row, col=1,
                               marker=dict(symbol=mark, size=10, color=f.colour(tone)))
    f.hide_repeated(figure)
    return figure


# -- pages of the parts

def study(folder, name, badge=""):
    """Returns the section about one of the studies."""
    _, text, draw, caption = STUDIES[name]
    return (h.paragraph(text, badge=badge) + draw(folder / f"{name}.csv", caption)
            + h.preformatted(summary_of(folder).text))


def part_document(outputs, part):
    """Returns the page about one part of the paper, in a folder of its own."""
    heading, text, case = f"Section 4: {part}", "", None
    if part == "table-4.1":
        simulated = SimulatedData(outputs.folder)
        shared, damping = simulated.worst()
        heading = "Table 4.1: four parameters from simulated data"
        case = read_text(CASE_4_1) if CASE_4_1.exists() else None
        point = (f"c_D, which such a record hardly determines, differs by {damping} at most; N = "
                 f"{MISPRINTED} is left out as a misprint.")
        verdict = h.box("good", f"m_H, c_H and k_H differ from the paper's by {shared} at most, on "
                        "every mesh.", [point])
        text = simulated.section()
    elif part in STUDIES:
        heading = STUDIES[part][0]
        verdict = h.box("good", "Independent of any record: nothing is fitted to one.")
        text = study(outputs.folder, part)
    else:
        verdict = h.box("", "The record of Section 4 is reconstructed: agreement with the paper is "
                        "a consistency check, not a confirmation.")
        text = section_4(outputs) + h.preformatted(summary_of(outputs.folder).text)
    ending = h.preformatted(case) if case else h.paragraph(
        "The case files are `data/rpl_*.nml`." if part not in STUDIES else
        f"The case is built into `reproduce {part}`.")
    title = f"reproduce {part}"
    return h.document(f"{title}, by beamid", [
        ("top", "", f"<h1>{html.escape(title)}</h1>\n"
         '<p class="lead">beamid: results of NASA CR-178199 beside the paper\'s '
         "numbers.</p>\n" + verdict),
        ("results", heading, text), ("case", "The case file", ending)])


def section_4(outputs):
    """Returns tables and curves of the models in a folder of Section 4."""
    text = ""
    ours, paper = {}, {}
    for row in outputs.table("tables.csv", "table", "parameter", "ours", "paper"):
        mine = p.number(row, "ours") if row["ours"] else None
        ours.setdefault(row["table"], {})[row["parameter"]] = mine
        paper.setdefault(row["table"], {})[row["parameter"]] = p.number(row, "paper")
    for table, values in paper.items():
        text += f"<h3>{h.rich(TABLES[table][0])}</h3>\n" + compared(
            values, [UNITS[name] for name in values], [ours[table][name] for name in values],
            list(values.values()))
    curves = {}
    for row in outputs.table("curves.csv", "model", "t", "measured", "model_acceleration",
                             "residual"):
        curves.setdefault(row["model"], []).append(
            [p.number(row, name) for name in ("t", "measured", "model_acceleration", "residual")])
    units = Units({"length": "ft", "time": "s"})
    for model, rows in curves.items():
        t, measured, response, residual = np.array(rows).T
        figure = f.record_and_model(t, measured, residual, (t, response), units, 4)
        text += h.figure(figure, f"The record, the response of the model ({name_of(model)}) and "
                         "the residuals.")
    return text
