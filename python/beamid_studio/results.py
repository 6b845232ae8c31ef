"""Results of fits: the components of the report, fits side by side, and further commands."""
from __future__ import annotations

import asyncio
import contextlib
import html
import json
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

from beamid_studio import checks, drawing
from beamid_studio.case_model import quoted
from beamid_studio.session import Result

FIGURE = re.compile(r'<figure class="plot">.*?<script type="application/json">(.*?)</script>(.*?)'
                    r"</figure>", re.S)
CAPTION = re.compile(r"<figcaption>(.*?)</figcaption>", re.S)
#: Commands that add intervals to a fit, with what the button says.
FURTHER = {"profile": "Profile", "sample": "Sample", "bootstrap": "Bootstrap"}


def error_remark(result: Result) -> checks.Remark:
    """Return the program's last line about a fit that failed."""
    return checks.remark_of(result.error, "error")


def sections_of(result: Result) -> list[tuple[str, str]]:
    """Return the parts of a result as headings and HTML; the first has no heading."""
    outputs = Outputs(result.folder)
    fit = fit_page.Fit(outputs)
    parts = [("", fit.verdict() + fit.estimates())]
    parts += [(heading, text) for name, heading, text in fit.sections() if name != "estimates"]
    if (result.folder / "track" / "manifest.txt").exists():
        box, extra = track_page.followed(Outputs(result.folder / "track"))
        parts.append(("Track", box + "".join(text for _, _, text in extra)))
    summary = outputs.summary("identify")
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
                         np.array([one[1] for one in numbers]))


def report(result: Result) -> str:
    """Return the page about a fit, as `beamid report` writes it."""
    return str(command_page.document(Outputs(result.folder)))


class Results:
    """The fits of a tab: one at a time, or side by side."""

    def __init__(self, studio: Any, work: Callable[[Any], Any]) -> None:
        self.studio, self.session, self.work = studio, studio.session, work
        self.figures: list[tuple[Any, dict[str, Any]]] = []
        self.dark = studio.dark
        self.shown = 0
        self.box = ui.element("div").classes("views fits")
        studio.redraws["fit"] = self.recolour
        self.show_all()

    def recolour(self) -> None:
        """Redraw the figures if the page has changed between light and dark."""
        if self.dark != self.studio.dark:
            self.dark = self.studio.dark
            for chart, spec in self.figures:
                self.studio.show_figure(chart, spec)

    def show_all(self) -> None:
        """Show the latest fit of the session, or what to do."""
        self.figures = []
        self.box.clear()
        with self.box:
            if not self.session.results:
                ui.label("The result of the fit appears here: verdict, estimates with intervals, "
                         "and where their errors come from.").classes("empty")
                return
        background_tasks.create(self.show_new(self.session.results[-1]), name="show")

    async def show_new(self, result: Result) -> None:
        """Show a fit, below a list of all fits."""
        self.shown = result.number
        error, parts, modes = "", [], ""
        if result.has_outputs:
            try:
                parts = await asyncio.to_thread(sections_of, result)
                modes = await asyncio.to_thread(mode_pictures, result)
            except Failure as failure:
                error = failure.message
        if self.studio.is_closed() or self.shown != result.number:
            return
        self.figures = []
        self.box.clear()
        with self.box:
            self.fit_list(result)
            if error or not parts:
                remark = checks.Remark(error, kind="error") if error else error_remark(result)
                ui.label(remark.text or "The fit failed.").classes("tell error")
                return
            self.actions(result)
            for heading, text in parts:
                if not heading:
                    self.components(text)
                    continue
                self.unfolding(heading, text, modes if heading == "Modes" else "")

    def unfolding(self, heading: str, text: str, above: str) -> None:
        """Show a section on demand; its figures are drawn when it is opened for the first time."""
        def fill(opened: bool) -> None:
            if opened and not list(box.default_slot.children):
                with box:
                    if above:
                        ui.html(above, sanitize=False).classes("w-full")
                    self.components(text)

        opened = heading == "Record and model"
        with ui.expansion(heading, value=opened, on_value_change=lambda event: fill(event.value)
                          ).classes("w-full").props("header-class='title' dense-toggle") as box:
            fill(opened)

    def fit_list(self, result: Result) -> None:
        """Show a button for each fit, and one for the comparison."""
        with ui.element("div").classes("bar"):
            for other in self.session.results:
                ui.button(other.name.capitalize(), on_click=lambda _, other=other:
                          self.show_new(other)).props(
                    f"{'unelevated' if other is result else 'outline'} dense no-caps "
                    f"padding='2px 12px' data-fit={other.number}")
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
            for command, label in FURTHER.items():
                ui.button(label, on_click=lambda _, command=command:
                          self.infer(command, result, "")).props(
                    f"outline dense no-caps padding='2px 12px' data-go={command}")
            ui.button("Track", on_click=lambda: self.ask_track(result)).props(
                "outline dense no-caps padding='2px 12px' data-go=track")
            ui.button("Download report", on_click=lambda: self.download_report(result)).props(
                "unelevated dense no-caps padding='2px 12px' data-go=report")

    async def infer(self, command: str, result: Result, extra: str) -> None:
        """Run a command on a fit, and show what it adds."""
        async def job() -> None:
            error = await self.session.infer(command, result, extra)
            page = self.session.page    # perhaps another one by now
            if page is None:
                return
            if error:
                page.results.notify("Cancelled." if error == "cancelled" else
                                    checks.remark_of(error).text, multi_line=True,
                                    close_button="Close",
                                    type="info" if error == "cancelled" else "negative")
                return
            await page.results.show_new(result)

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
            text = await asyncio.to_thread(report, result)
            await asyncio.to_thread(path.write_text, text, encoding="utf-8")
        except Failure as failure:
            ui.notify(failure.message, type="negative")
            return
        ui.download.file(path, f"{result.folder.parent.name}-{result.folder.name}.html")

    # -- side by side

    def compare(self) -> None:
        """Show the estimates of all fits side by side."""
        self.shown = 0
        self.figures = []
        self.box.clear()
        with self.box:
            self.fit_list(None)    # type: ignore[arg-type]
            ui.html(comparison([result for result in self.session.results if result.has_outputs]),
                    sanitize=False).classes("report")


def comparison(results: list[Result]) -> str:
    """Return a table with a row for each parameter and a column for each fit."""
    fits = [fit_page.Fit(Outputs(result.folder)) for result in results]
    names = list(dict.fromkeys(row["parameter"] for fit in fits for row in fit.main))
    rows = [["", *(result.name for result in results)]]
    for name in names:
        found = [next((row for row in fit.main if row["parameter"] == name), None) for fit in fits]
        known = [fit_page.value(row, "estimate") for row in found if row]
        power = h.common_power([value for value in known if value is not None])
        unit = next((h.scaled_unit(power, row["unit"]) for row in found if row), "")
        cells = []
        for row in found:
            if row is None:
                cells.append("not estimated")
                continue
            low, high = (fit_page.value(row, f"total_{end}95") for end in ("lower", "upper"))
            value, around = h.measured(fit_page.value(row, "estimate"), low, high, power)
            cells.append(h.Raw(f"{h.rich(value)}<br><small>{h.rich(around)}</small>"))
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
    return h.table(rows[0], [rows[1:]]) + verdicts
