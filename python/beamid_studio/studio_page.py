"""The page: its steps, and what follows from every input."""
from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import background_tasks, ui
from units import Units

from beamid_studio import beam_step, checks, fit_step, record_step, save_step, style, views
from beamid_studio.case_model import Case
from beamid_studio.checks import Field, Found, Remark
from beamid_studio.recordings import Unreadable
from beamid_studio.session import Session
from beamid_studio.widgets import NumberField, Tells

#: Seconds after an input before the program is asked.
PAUSE = 0.35
STEPS = {"record": "1  Record", "beam": "2  Beam", "fit": "3  Fit", "save": "4  Save"}
SCHEME = """<script>
  const tellScheme = () => emitEvent("scheme", document.body.classList.contains("body--dark"));
  new MutationObserver(tellScheme).observe(document.body, {attributeFilter: ["class"]});
</script>"""


class Studio:
    """One page in the browser: the session behind it, its fields and its figures."""

    def __init__(self, session: Session, dark: bool) -> None:
        self.session, self.dark = session, dark
        self.client = ui.context.client
        self.tells: dict[Field, Tells] = {}
        self.labels: dict[Field, str] = {}
        self.steps_of: dict[Field, str] = {}    #: the step that has a field
        self.badges: dict[str, ui.badge] = {}   #: how many sentences a step shows
        self.building = "record"                #: the step whose fields are being added
        self.numbers: list[NumberField] = []
        self.spectrum: Any = None          #: of the window
        self.drawn: dict[int, tuple[Any, ...]] = {}    #: what each figure shows
        self.redraws: dict[str, Callable[[], Any]] = {}    #: by the name of the step
        self.step = "record"
        self.stale = False                 #: whether the spectrum is of another window
        self.version = 0
        self.unwritten = False             #: whether the record has changed since it was written
        self.turn = asyncio.Lock()         #: one check at a time
        self.results: Any = None

    # -- input

    def number(self, group: str, key: str, label: str, units: dict[str, str], **options: Any
               ) -> NumberField:
        """Add a field for a number of the case."""
        field = NumberField(lambda: self.session.case, (group, key.lower()), label, units,
                            self.changed, **options)
        self.numbers.append(field)
        if not options.get("sd"):
            self.tells[field.place] = field.tells
            self.labels[field.place], self.steps_of[field.place] = label, self.building
        return field

    def tell_at(self, group: str, key: str, label: str = "") -> Tells:
        """Add a place for the sentences that concern a field."""
        self.tells[(group, key)] = Tells()
        self.labels[(group, key)], self.steps_of[(group, key)] = label, self.building
        return self.tells[(group, key)]

    def changed(self, record: bool = False, window: bool = False) -> None:
        """Follow an input: at once what is cheap, the program's answer soon after.

        record  whether times or values of the record are others
        window  whether the window of the fit is another
        """
        self.version += 1
        self.unwritten = self.unwritten or record
        self.stale = self.stale or record or window
        if record:
            self.session.found, self.spectrum = Found(), None
        self.draw_now()
        background_tasks.create(self.follow(self.version), name="check")

    def draw_now(self) -> None:
        """Redraw what the user sees and what needs no long computation."""
        if not self.session.closed:
            self.redraws[self.step]()

    def show_step(self, name: str) -> None:
        """Draw a step that has become visible."""
        self.step = name
        self.draw_now()

    async def follow(self, version: int) -> None:
        """Ask the program about the input, unless a later input has come."""
        await asyncio.sleep(PAUSE)
        async with self.turn:
            if version != self.version or self.session.is_closed():
                return
            try:
                await self.ask(version)
            except FileNotFoundError:
                # The folder goes with its tab, perhaps during a computation.
                if not self.session.is_closed():
                    raise

    async def ask(self, version: int) -> None:
        """Ask the program about the input as it stands, and show what it says."""
        session = self.session
        case, found = Case(session.case.text()), Found()
        folder = session.folder or session.begin("beam")
        await self.write_record()
        ready = session.is_ready and session.record_file.exists()
        described = is_described(case)
        if described:
            await asyncio.to_thread(checks.modes_of, case, folder, found)
            if version == self.version:    # the frequencies do not wait for the record
                found.onset, found.used = session.found.onset, session.found.used
                session.found = replace(found)
                self.draw_now()
        if described and ready and not found.has_errors:
            found.onset = None
            await asyncio.to_thread(checks.check_fit, case, folder, session.t, found, session.used)
        elif ready and not described:
            await asyncio.to_thread(checks.check_record, case, folder, session.t, session.z, found,
                                    session.used)
        if version != self.version or session.is_closed():
            return
        moved = found.onset != session.found.onset
        session.found = found
        if self.spectrum is None or self.stale or moved:
            self.stale = False
            await self.transform()
        if version == self.version and not session.is_closed():
            self.show_found()

    async def write_record(self) -> None:
        """Write the record, if it has changed."""
        if self.unwritten:
            self.unwritten = False
            await asyncio.to_thread(self.session.write_record)

    async def transform(self) -> None:
        """Compute the spectrum of the window."""
        session = self.session
        if not session.is_ready:
            self.spectrum = None
            return
        t, values = self.window_samples()
        self.spectrum = await asyncio.to_thread(views.spectrum, t, values)

    def window_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples of the window, in the unit of the case."""
        session = self.session
        low, high = np.searchsorted(session.t, session.window, side="left")
        part = slice(int(low), int(high) + 1)
        return session.t[part], session.scale * session.z[part]

    def show_found(self) -> None:
        """Show the program's sentences at their fields, and the frequencies in the figures."""
        latest = self.session.results[-1:] if not self.session.run else []
        self.place_remarks([*self.session.found.remarks,
                            *[remark for result in latest if result.case == self.session.case_text()
                              for remark in result.remarks]])
        self.draw_now()

    def place_remarks(self, remarks: list[Remark]) -> None:
        """Show sentences at the fields that they concern; the others at the button of the fit."""
        placed: dict[Field, list[Remark]] = {}
        counts = dict.fromkeys(self.badges, 0)
        for remark in remarks:
            place = remark.field if remark.field in self.tells else ("stage", "all")
            placed.setdefault(place, []).append(remark)
            step = self.steps_of.get(place, "fit")
            counts[step] += remark.kind != "note"
            if remark.kind == "error" and step != "fit":
                placed.setdefault(("stage", "all"), []).append(Remark(
                    f"Step {step.capitalize()}, {self.labels.get(place, 'the file')}: "
                    f"{remark.text}", kind="error"))
        for step, badge in self.badges.items():
            badge.text = str(counts[step])
            badge.set_visibility(counts[step] > 0)
        for place, tells in self.tells.items():
            tells.show(placed.get(place, []), self.estimate)

    def estimate(self, name: str) -> None:
        """Add a parameter to those that are estimated, as the program proposes."""
        if name not in self.session.case.free:
            self.session.case.free = [*self.session.case.free, name]
        self.refresh_fields()
        self.changed()
        ui.notify(f"{name} will be estimated: repeat the fit.")

    # -- files

    async def open(self, work: Callable[[], Any]) -> bool:
        """Open a file by a function that runs in a thread; return whether it could be used."""
        if self.session.run:
            ui.notify("A fit is running: cancel it first.", type="warning")
            return False
        try:
            recording = await asyncio.to_thread(work)
        except Unreadable as error:
            ui.notify(str(error), type="negative", multi_line=True, close_button="Close",
                      timeout=0)
            return False
        if recording is not None:
            self.session.take(recording)
        self.unwritten = recording is not None
        self.session.found = Found()
        self.spectrum = None
        self.refresh_fields()
        for listener in self.session.listeners:
            listener()
        self.changed(record=recording is not None)
        return True

    def refresh_fields(self) -> None:
        """Show the values of the case in every field."""
        for field in self.numbers:
            field.write()
        self.refresh_choices()

    def refresh_choices(self) -> None:
        """Show the choices of the case; the steps extend this."""

    # -- figures

    @property
    def units(self) -> Units:
        """The units of the case."""
        return Units.of_case(self.session.case.text(("units",)))

    @staticmethod
    def chart() -> Any:
        """Add an empty figure."""
        return ui.plotly({"data": [], "layout": {}}).classes("chart")

    def show_figure(self, chart: Any, figure: Any) -> None:
        """Show a figure in the colours of the page."""
        spec = views.plotly(figure, self.dark)
        chart.style(f"height: {spec['layout'].get('height', 330)}px")
        chart.update_figure(spec)

    def follow_figure(self, chart: Any, key: tuple[Any, ...], make: Callable[[], Any]) -> None:
        """Show a figure anew if what it depends on has changed.

        key  what the figure depends on, beside the colours of the page
        """
        key = (*key, self.dark)
        if self.drawn.get(chart.id) != key:
            self.drawn[chart.id] = key
            self.show_figure(chart, make())

    def draw_spectrum(self, chart: Any) -> None:
        """Show the spectrum of the window with the frequencies of the model."""
        chart.set_visibility(self.spectrum is not None)
        if self.spectrum is not None:
            modes = self.session.found.frequencies[:12]
            self.follow_figure(chart, (id(self.spectrum), tuple(modes)), lambda: (
                views.spectrum_figure(self.spectrum, modes, self.units)))


def is_described(case: Case) -> bool:
    """Return whether a beam has length, section, mass and stiffness."""
    has_section = case.get("beam", "width") and case.get("beam", "height")
    return bool(case.get("beam", "length") and case.get("beam", "e")
                and (has_section or case.get("beam", "I"))
                and ((has_section and case.get("beam", "density")) or case.get("beam", "rho")))


async def build(session: Session, first: Path | None) -> None:
    """Build the page for a new tab, and open the file of the command line."""
    ui.add_css(style.sheet())
    ui.add_body_html(SCHEME)
    ui.colors(primary="#0072b2")
    await ui.context.client.connected(timeout=30)
    dark = bool(await ui.run_javascript("document.body.classList.contains('body--dark')"))
    studio = Studio(session, dark)
    with ui.element("header").classes("top"):
        with ui.element("div").classes("brand"):
            ui.label("beamid studio")
        with ui.tabs().props("dense no-caps inline-label indicator-color=primary") as tabs:
            for name, label in STEPS.items():
                with ui.tab(name, label).props(f'data-step="{name}"'):
                    studio.badges[name] = ui.badge("").props("color=orange-9 rounded")
                    studio.badges[name].set_visibility(False)
        what = ui.label("").classes("what")
    builders = {"record": lambda: record_step.build(studio, lambda: tabs.set_value("beam")),
                "beam": lambda: beam_step.build(studio, lambda: tabs.set_value("fit")),
                "fit": lambda: fit_step.build(studio), "save": lambda: save_step.build(studio)}
    with ui.tab_panels(tabs, value="record", animated=False, keep_alive=False).classes("steps"):
        for name, step in builders.items():
            studio.building = name
            with ui.tab_panel(name):
                step()
    session.listeners.append(lambda: what.set_text(session.name))

    def scheme(event: Any) -> None:
        studio.dark = bool(event.args)
        studio.draw_now()

    ui.on("scheme", scheme)
    tabs.on_value_change(lambda event: studio.show_step(event.value))
    if first is not None and await record_step.open_path(studio, first) and session.results:
        tabs.set_value("fit")
