"""Results of fits: the components of the report, fits side by side, and further commands."""
from __future__ import annotations

import asyncio
import contextlib
import html
import json
import math
import re
from collections.abc import Callable
from typing import Any

import command_page
import fit_page
import numpy as np
import page as h
import plot_modes
import plotting as p
import track_page
from nicegui import background_tasks, ui
from output_folder import Outputs
from program import Failure

from beamid_studio import checks, differences, drawing
from beamid_studio.case_model import Case, quoted
from beamid_studio.session import Result
from beamid_studio.widgets import in_si

FIGURE = re.compile(r'<figure class="plot">.*?<script type="application/json">(.*?)</script>(.*?)'
                    r"</figure>", re.S)
CAPTION = re.compile(r"<figcaption>(.*?)</figcaption>", re.S)
#: Commands that go on from a fit, with what each does.
FURTHER = {
    "profile": "Fits all other parameters again at each of many values of one. The interval ends "
               "where the residuals become larger than noise explains.",
    "sample": "Draws sets of parameters that agree with the record. The interval contains 95 % of "
              "the draws.",
    "bootstrap": "Fits many records that are made of the model and resampled residuals. The "
                 "interval contains 95 % of their estimates.",
    "track": "Fits one window of the record after the other. A figure shows how a parameter "
             "changes with time."}
#: The part of a result that a command adds.
ADDED = {command: "Track" if command == "track" else "Beyond linear theory" for command in FURTHER}


class PageOutputs(Outputs):
    """The files of a fit, whose texts give advice in the words of the page."""

    def text(self, name: str) -> str:
        """Return what the program printed, with other advice."""
        return checks.in_words_of_page("\n".join(fit_page.unwrapped(super().text(name))))


def chosen_units(studio: Any, result: Result) -> dict[str, tuple[str, int]]:
    """Return the units that the user has chosen for parameters of a fit, with their powers of ten.

    The others keep the unit of the case: an inch is no power of ten, and the fields of a case in
    other units than m, kg, N and s have none to choose from.
    """
    if not in_si(Case(result.case)):
        return {}
    fields = {one.place: one.unit for one in studio.numbers if not one.sd}
    powers = {name: (fields[place][0], math.log10(float(fields[place][1])))
              for name, group in checks.GROUPS.items()
              if (place := (group, name.lower())) in fields}
    return {name: (unit, round(power)) for name, (unit, power) in powers.items()
            if power and power == round(power)}


def sections_of(result: Result, units: dict[str, tuple[str, int]]) -> list[tuple[str, str]]:
    """Return the parts of a result as headings and HTML; the first has no heading.

    units  of parameters that are not shown in the unit of the case
    """
    outputs = PageOutputs(result.folder)
    fit = fit_page.Fit(outputs, units)
    parts = [("", fit.verdict() + fit.estimates())]
    parts += [(heading, text) for name, heading, text in fit.sections() if name != "estimates"]
    if (result.folder / "track" / "manifest.txt").exists():
        box, extra = track_page.followed(Outputs(result.folder / "track"))
        parts.append(("Track", box + "".join(text for _, _, text in extra)))
    summary = Outputs(result.folder).summary("identify")
    if summary is not None:
        parts.append(("What the program printed", h.preformatted(summary.text)))
    return parts


def mode_pictures(result: Result) -> str:
    """Return the moving modes of a fitted structure."""
    try:
        x, shapes, _ = plot_modes.read_shapes(result.folder)
        numbers = plot_modes.read_numbers(result.folder)
    except SystemExit:
        return ""
    count = min(shapes.shape[1], len(numbers))
    return drawing.modes(x, shapes.T[:count], np.array([one[0] for one in numbers]),
                         np.array([one[1] for one in numbers]),
                         names=[one[2] for one in numbers])


def report(result: Result, name: str, units: dict[str, tuple[str, int]]) -> str:
    """Return the page about a fit as `beamid report` writes it, with advice in words of the studio.

    name   of the file of the record
    units  as `sections_of` takes them
    """
    outputs = PageOutputs(result.folder)
    outputs.name = f"{name}, {result.name}"
    return str(command_page.document(outputs, units))


class Results:
    """The fits of a tab: one at a time, or side by side."""

    def __init__(self, studio: Any, work: Callable[[Any], Any]) -> None:
        self.studio, self.session, self.work = studio, studio.session, work
        self.figures: list[tuple[Any, dict[str, Any]]] = []
        self.dark = studio.dark
        self.shown = 0
        self.outdated: Any = None    #: the sentence above a result of other inputs
        self.guesses: Any = None     #: the sentence on presets that nobody has checked
        self.box = ui.element("div").classes("views fits")
        self.show_all()

    @property
    def result(self) -> Result | None:
        """The fit that is shown; None beside a comparison."""
        return next((one for one in self.session.results if one.number == self.shown), None)

    def redraw(self) -> None:
        """Say whether the case has changed since the fit, and follow the colours of the page."""
        result = self.result
        if self.outdated is not None and result is not None:
            changed = differences.sentence(self.studio, result)
            again = " Run the fit again." * (result is self.session.results[-1])
            self.outdated.text = changed and (
                f"Outdated: the inputs of {result.name} are not those of the page now: {changed}."
                + again)
            self.outdated.set_visibility(bool(changed))
            unchecked = self.session.unchecked(result)
            self.guesses.text = ("The intervals rest on standard deviations that are guesses of "
                                 f"the page: {', '.join(unchecked)}. Confirm or correct them in "
                                 "their fields.")
            self.guesses.set_visibility(bool(unchecked))
        if self.dark != self.studio.dark:
            self.dark = self.studio.dark
            for chart, spec in self.figures:
                self.studio.show_figure(chart, spec)

    def show_all(self) -> None:
        """Show the fit that was shown, the latest one otherwise, or what to do."""
        self.figures, self.outdated = [], None
        self.box.clear()
        with self.box:
            if not self.session.results:
                self.shown = 0
                ui.label("The result of the fit appears here: verdict, estimates with intervals, "
                         "and where their errors come from.").classes("empty")
                return
        background_tasks.create(self.show_new(self.result or self.session.results[-1]),
                                name="show")

    async def show_new(self, result: Result, added: str = "") -> None:
        """Show a fit, below a list of all fits.

        added  heading of a part that has been added, which is opened and scrolled to
        """
        self.shown = result.number
        error, parts, modes = "", [], ""
        if result.has_outputs:
            try:
                parts = await asyncio.to_thread(sections_of, result,
                                                chosen_units(self.studio, result))
                modes = await asyncio.to_thread(mode_pictures, result)
            except Failure as failure:
                error = failure.message
        if self.studio.is_closed() or self.shown != result.number:
            return
        self.figures = []
        self.box.clear()
        with self.box:
            self.fit_list(result)
            self.outdated = ui.label("").classes("tell").props("data-field=outdated")
            ui.button(f"Use the inputs of {result.name} again",
                      on_click=lambda: self.take_back(result)).props(
                "outline dense no-caps padding='2px 12px' data-go=take-back").classes(
                "self-start").bind_visibility_from(self.outdated)
            self.guesses = ui.label("").classes("tell note").props("data-field=unchecked")
            self.studio.show_found()
            self.redraw()
            if error or not parts:
                texts = [error] if error else [self.studio.located(remark)
                                               for remark in result.remarks]
                for text in texts or ["The fit failed."]:
                    ui.label(f"{result.name.capitalize()} was refused. {text}" if not error else
                             text).classes("tell error")
                return
            self.actions(result)
            for heading, text in parts:
                if not heading:
                    self.components(text)
                    continue
                self.unfolding(heading, text, modes if heading == "Modes" else "", added)

    def unfolding(self, heading: str, text: str, above: str, added: str) -> None:
        """Show a section on demand; its figures are drawn when it is opened for the first time."""
        def fill(opened: bool) -> None:
            if opened and not list(box.default_slot.children):
                with box:
                    if above:
                        ui.html(above, sanitize=False).classes("w-full")
                    self.components(text)

        opened = heading == (added or "Record and model")
        box = ui.expansion(heading, value=opened,
                           on_value_change=lambda event: fill(event.value))
        with box.classes("w-full part").props("header-class='title' dense-toggle"):
            fill(opened)
        if added == heading:
            self.studio.client.run_javascript(
                f"setTimeout(() => getHtmlElement({box.id})?.scrollIntoView(), 200)")

    def fit_list(self, result: Result) -> None:
        """Show a button for each fit, and one for the comparison."""
        with ui.element("div").classes("bar"):
            for other in self.session.results:
                refused, chosen = other.is_refused, other is result
                ui.button(other.name.capitalize() + ", refused" * refused,
                          on_click=lambda _, other=other: self.show_new(other),
                          color=("negative" if chosen else None) if refused else "primary").props(
                    f"{'unelevated' if chosen else 'outline'} dense no-caps "
                    f"padding='2px 12px' data-fit={other.number} {'icon=block' * refused}"
                    ).classes("refused" * (refused and not chosen))
            if len(self.session.results) > 1:
                ui.button("Compare", on_click=self.compare).props(
                    f"{'unelevated' if result is None else 'outline'} dense no-caps "
                    "padding='2px 12px' data-go=compare")

    def components(self, text: str) -> None:
        """Show HTML of the report; its figures become figures of the page."""
        place, grid = 0, None
        for match in FIGURE.finditer(text):
            between = text[place:match.start()]
            if grid and "</div>" in between:
                grid, between = None, between.replace("</div>", "", 1)
            if not grid:
                opens = between.rstrip().endswith('<div class="grid">')
                self.html(between.rstrip().removesuffix('<div class="grid">') if opens else between)
                if opens:
                    grid = ui.element("div").classes("grid-of-figures")
            with grid or contextlib.nullcontext(), ui.element("div").classes("w-full min-w-0"):
                self.figure(match)
            place = match.end()
        rest = text[place:]
        self.html(rest.replace("</div>", "", 1) if grid else rest)

    def figure(self, match: re.Match[str]) -> None:
        """Show a figure of the report and its caption."""
        spec = json.loads(match[1].replace("<\\/", "</"))
        chart = self.studio.chart()
        self.studio.show_figure(chart, spec)
        self.figures.append((chart, spec))
        caption = CAPTION.search(match[2])
        if caption:
            ui.html(caption[1], sanitize=False).classes("caption")

    @staticmethod
    def html(text: str) -> None:
        """Show HTML that the report has made, in which names of the user are escaped."""
        if text.strip():
            ui.html(text, sanitize=False).classes("report")

    # -- further commands

    def actions(self, result: Result) -> None:
        """Show what can be done with a fit."""
        with ui.element("div").classes("bar"):
            for command, meaning in FURTHER.items():
                with ui.button(command.capitalize(), on_click=lambda _, command=command: (
                        self.ask_track(result) if command == "track" else
                        self.infer(command, result, ""))).props(
                        f"outline dense no-caps padding='2px 12px' data-go={command}"):
                    ui.tooltip(meaning).classes("meaning-tip")
            begin = next((remark.begin for remark in result.remarks if remark.begin), "")
            if begin and len(self.session.records) == 1:
                unit = " s" if in_si(Case(result.case)) else ""
                ui.button(f"Begin at {begin}{unit}, fit again",
                          on_click=lambda: self.begin_at(begin)).props(
                    "unelevated dense no-caps padding='2px 12px' data-go=begin")
            ui.button(f"Report of {result.name}",
                      on_click=lambda: self.download_report(result)).props(
                "unelevated dense no-caps padding='2px 12px' data-go=report")

    def take_back(self, result: Result) -> None:
        """Make the inputs of a fit those of the page again."""
        if self.session.is_busy:
            self.notify("The program is running: wait, or cancel it.", type="warning")
            return
        self.session.take_back(result)
        self.studio.show_record()

    async def begin_at(self, time: str) -> None:
        """Fit the record again from a later time, as the program proposes."""
        self.session.case.set("record", "t_first", time)
        self.studio.refresh_fields()
        self.studio.changed(window=True)
        await self.studio.start()

    async def infer(self, command: str, result: Result, extra: str) -> None:
        """Run a command on a fit, and show what it adds."""
        async def job() -> None:
            error = await self.session.infer(command, result, extra)
            page = self.session.page    # perhaps another one by now
            if page is None:
                return
            if error:
                page.results.notify("Cancelled." if error == "cancelled" else " ".join(
                    checks.remark_of(line).text for line in error.splitlines()), multi_line=True,
                                    close_button="Close",
                                    type="info" if error == "cancelled" else "negative")
                return
            await page.results.show_new(result, ADDED[command])

        await self.work(job())

    def notify(self, text: str, **options: Any) -> None:
        """Show a message on the page."""
        with self.box:
            ui.notify(text, **options)

    def ask_track(self, result: Result) -> None:
        """Ask for the parameter and the windows of a track."""
        first, last = self.session.record.window
        with ui.dialog() as dialog, ui.card():
            ui.label("Follow a parameter through the record").classes("title")
            name = ui.select([one for one in self.session.case.free if one != "offset"],
                             label="Parameter").props("outlined dense").classes("w-full")
            name.value = next(iter(name.options), None)
            window = ui.number("Window (s)", value=float(f"{(last - first) / 5:.3g}")).props(
                "outlined dense").classes("w-full")
            hop = ui.number("Hop (s)", value=float(f"{(last - first) / 20:.3g}")).props(
                "outlined dense").classes("w-full")

            async def go() -> None:
                dialog.close()
                if name.value and window.value and hop.value:
                    await self.infer("track", result, f"&track parameter={quoted(name.value)}, "
                                     f"window={window.value!r}, hop={hop.value!r} /\n")

            with ui.row():
                ui.button("Track", on_click=go).props("unelevated no-caps")
                ui.button("Cancel", on_click=dialog.close).props("flat no-caps")
        dialog.open()

    async def download_report(self, result: Result) -> None:
        """Write the report beside the outputs, and send it to the browser."""
        path = result.folder / "report.html"
        try:
            text = await asyncio.to_thread(report, result,
                                           self.session.name or result.folder.parent.name,
                                           chosen_units(self.studio, result))
            await asyncio.to_thread(path.write_text, text, encoding="utf-8")
        except Failure as failure:
            ui.notify(failure.message, type="negative")
            return
        ui.download.file(path, f"{result.folder.parent.name}-{result.folder.name}.html")

    # -- side by side

    def compare(self) -> None:
        """Show the estimates of all fits side by side."""
        self.shown, self.outdated = 0, None
        self.figures = []
        self.box.clear()
        with self.box:
            self.fit_list(None)    # type: ignore[arg-type]
            fits = [result for result in self.session.results if result.has_outputs]
            units = chosen_units(self.studio, fits[-1]) if fits else {}
            ui.html(comparison(fits, differences.table(self.studio, fits), units),
                    sanitize=False).classes("report")


def comparison(results: list[Result], inputs: list[list[str]],
               units: dict[str, tuple[str, int]]) -> str:
    """Return a table with a row for each parameter and a column for each fit.

    inputs  rows of the inputs in which the fits differ
    units   of parameters that are not shown in the unit of the case
    """
    fits = [fit_page.Fit(PageOutputs(result.folder)) for result in results]
    names = list(dict.fromkeys(row["parameter"] for fit in fits for row in fit.main))
    rows = [["", *(result.name for result in results)]]
    for name in names:
        found = [next((row for row in fit.main if row["parameter"] == name), None) for fit in fits]
        known = [fit_page.value(row, "estimate") for row in found if row]
        if name in units:
            unit, power = units[name]
        else:
            power = h.common_power([value for value in known if value is not None])
            unit = next((h.scaled_unit(power, row["unit"]) for row in found if row), "")
        cells = []
        for row in found:
            if row is None:
                cells.append("not estimated")
                continue
            low, high = (fit_page.value(row, f"total_{end}95") for end in ("lower", "upper"))
            value, around = h.measured(fit_page.value(row, "estimate"), low, high, power)
            determined = {"yes": "determined", "no": "not determined"}.get(row["determined"], "")
            cells.append(h.Raw(f"{h.rich(value)}<br><small>{h.rich(around)}"
                               f"<br>{determined}</small>"))
        rows.append([h.Raw(f"{h.symbol(name)} <span class='unit'>{html.escape(unit)}</span>"),
                     *cells])
    rows.append(["explained", *(", ".join(f"{p.number(row, 'fit_percent'):.2f} %"
                                          for row in fit.quality) for fit in fits)])
    rows.append(["residual, rms", *(", ".join(h.significant(p.number(row, "rms_residual"))
                                              for row in fit.quality) for fit in fits)])
    rows.append(["estimated", *(h.Raw(", ".join(h.symbol(row["parameter"]) for row in fit.rows
                                                if not row["parameter"].startswith(("cos_", "sin_"))
                                                )) for fit in fits)])
    # The numbers of each verdict are in the table above it.
    verdicts = "".join(f"<h3>{html.escape(result.name.capitalize())}</h3>"
                       + fit.verdict().replace(fit.quality_table(), "")
                       for result, fit in zip(results, fits))
    # Names of files may look like symbols.
    differ = [[h.Raw(h.rich(row[0])), *(h.Raw(html.escape(text)) for text in row[1:])]
              for row in inputs]
    return (h.table(rows[0], [rows[1:]]) + "<h3>Inputs that differ</h3>\n"
            + (h.table(rows[0], [differ], wrap=range(1, len(rows[0]))) if differ else
               h.paragraph("None.")) + verdicts)
