"""The page: its steps, and what follows from every input."""
from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import figures as f
import numpy as np
import responses
from nicegui import background_tasks, ui
from units import Units

from beamid_studio import beam_step, checks, fit_step, record_step, save_step, style, views
from beamid_studio.case_model import Case
from beamid_studio.checks import Field, Found, Remark
from beamid_studio.recordings import Unreadable
from beamid_studio.session import Result, Session
from beamid_studio.widgets import NumberField, Tells

#: Seconds after an input before the program is asked.
PAUSE = 0.35
#: Modes of the model that are shown in a frequency response.
MOST_MODES = 20
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
        self.closed = False
        self.listeners: list[Callable[[], Any]] = []    #: called when another file is open
        self.tells: dict[Field, Tells] = {}
        self.labels: dict[Field, str] = {}
        self.steps_of: dict[Field, str] = {}    #: the step that has a field
        self.badges: dict[str, ui.badge] = {}   #: how many sentences a step shows
        self.outdated: Any = None               #: badge of the step of the fit
        self.building = "record"                #: the step whose fields are being added
        self.numbers: list[NumberField] = []
        self.spectrum: Any = None          #: of the window
        self.drawn: dict[int, tuple[Any, ...]] = {}    #: what each figure shows
        self.redraws: dict[str, Callable[[], Any]] = {}    #: by the name of the step
        self.stale = False                 #: whether the spectrum is of another window
        self.version = 0
        self.turn = asyncio.Lock()         #: one check at a time
        self.results: Any = None
        self.show_progress: Callable[[], Any] = lambda: None    #: of the fit; its step sets this
        self.start: Callable[..., Any] = lambda: None           #: the fit; its step sets this

    def is_closed(self) -> bool:
        """Return whether the page has been closed, perhaps during a computation."""
        return self.closed or self.session.closed

    @property
    def is_connected(self) -> bool:
        """Whether a browser shows the page."""
        return not self.closed and bool(self.client.has_socket_connection)

    # -- input

    def number(self, group: str, key: str, label: str, units: dict[str, str], **options: Any
               ) -> NumberField:
        """Add a field for a number of the case."""
        field = NumberField(lambda: self.session.case, (group, key.lower()), label, units,
                            lambda: self.take_number(group, key), chosen=self.session.chosen_units,
                            presets=self.session.presets, confirmed=self.draw_now, **options)
        self.numbers.append(field)
        if not options.get("sd"):
            self.tells[field.place] = field.tells
            self.labels[field.place], self.steps_of[field.place] = label, self.building
        return field

    def take_number(self, group: str, key: str) -> None:
        """Follow a number that the user has entered, and show the preset of its error, if any."""
        if group != "prior":
            self.session.preset(key, self.session.case.get(group, key.lower()))
            for field in self.numbers:
                if field.sd == key:
                    field.write()
        self.changed()

    def tell_at(self, group: str, key: str, label: str = "") -> Tells:
        """Add a place for the sentences that concern a field."""
        self.tells[(group, key)] = Tells()
        self.labels[(group, key)], self.steps_of[(group, key)] = label, self.building
        return self.tells[(group, key)]

    def changed(self, record: bool = False, window: bool = False) -> None:
        """Follow an input: at once what is cheap, the program's answer soon after.

        record  whether times or values of the record that is edited are others
        window  whether the window of the fit is another
        """
        self.version += 1
        self.stale = self.stale or record or window
        if record:
            self.session.found, self.spectrum = Found(), None
        self.draw_now()
        background_tasks.create(self.follow(self.version), name="check")

    def draw_now(self) -> None:
        """Redraw what the user sees and what needs no long computation."""
        if not self.is_closed():
            results = self.session.results
            self.outdated.set_visibility(bool(results and self.session.changes(results[-1])))
            self.redraws[self.session.step]()

    def show_step(self, name: str) -> None:
        """Draw a step that has become visible, from its top."""
        self.session.step = name
        self.client.run_javascript("window.scrollTo(0, 0)")
        self.draw_now()

    async def follow(self, version: int) -> None:
        """Ask the program about the input, unless a later input has come."""
        await asyncio.sleep(PAUSE)
        async with self.turn:
            if version != self.version or self.is_closed():
                return
            try:
                await self.ask(version)
            except FileNotFoundError:
                # The folder goes with its tab, perhaps during a computation.
                if not self.is_closed():
                    raise

    async def ask(self, version: int) -> None:
        """Ask the program about the input as it stands, and show what it says."""
        session = self.session
        case, found, record = session.case.copy(), Found(), session.record
        folder = session.folder or session.begin("beam")
        await self.write_records()
        described = is_described(case)
        if described:
            await asyncio.to_thread(checks.modes_of, case, folder, found)
            if version == self.version:    # the frequencies do not wait for the record
                session.found = replace(found)
                self.draw_now()
            await asyncio.to_thread(checks.effects_of_sensor, case, folder, found)
        onset = None
        if described and not session.lacking and not found.has_errors:
            onset = await asyncio.to_thread(checks.check_fit, case, folder, record, found,
                                            session.used)
        elif record.is_ready and record.kind == "time" and not described:
            onset = await asyncio.to_thread(checks.check_record, case, folder, record, found,
                                            session.used)
        if version != self.version or self.is_closed():
            return
        moved = onset != record.onset
        record.onset, session.found = onset, found
        if self.spectrum is None or self.stale or moved:
            self.stale = False
            await self.transform()
        if version == self.version and not self.is_closed():
            self.show_found()

    async def write_records(self) -> None:
        """Write the records that have changed."""
        await asyncio.to_thread(self.session.write_records)

    async def transform(self) -> None:
        """Compute the spectrum of the window."""
        record = self.session.record
        if not record.is_ready or record.kind != "time":
            self.spectrum = None
            return
        t, values = self.window_samples()
        self.spectrum = await asyncio.to_thread(views.spectrum, t, values)

    def window_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples of the window, in the unit of the case."""
        record = self.session.record
        low, high = np.searchsorted(record.t, record.window, side="left")
        part = slice(int(low), int(high) + 1)
        return record.t[part], record.scale * record.z[part]

    @property
    def shown(self) -> Result | None:
        """The fit that the page shows; beside a comparison, the latest one."""
        return ((self.results and self.results.result)
                or next(iter(self.session.results[-1:]), None))

    def show_found(self) -> None:
        """Show the program's sentences at their fields, and the frequencies in the figures.

        The sentences of a fit appear while it is shown, and its inputs are those of the case.
        """
        found = self.session.found.remarks
        shown = None if self.session.run else self.shown
        if shown is None or self.session.changes(shown):
            self.place_remarks(found)
        else:
            # Before the fit, the page has said where the motion begins.
            fields = {remark.field for remark in found} & {("record", "t_first")}
            self.place_remarks([*found, *(remark for remark in shown.remarks
                                          if remark.field not in fields)],
                               [remark for remark in shown.remarks
                                if shown.is_refused or not remark.advice])
        self.draw_now()

    def place_of(self, remark: Remark) -> Field:
        """Return the field at which a sentence is shown."""
        return remark.field if remark.field in self.tells else ("stage", "all")

    def worded(self, remark: Remark) -> Remark:
        """Return a sentence with the labels of the page in place of the keys of a case file."""
        group = self.place_of(remark)[0]
        labels = {key: label for (_, key), label in self.labels.items() if label and "_" in key}
        labels |= {key: label for (own, key), label in self.labels.items()
                   if own == group and label and "_" in key}
        if self.step_of(remark) == "fit":    # its parameters are named by their symbols
            labels = {key: label for key, label in labels.items() if key[:2] in ("t_", "f_")}
        return replace(remark, text=re.sub(
            r"\b\w+_\w+\b", lambda match: f"“{labels[match[0].lower()]}”"
            if match[0].lower() in labels else match[0], remark.text))

    def step_of(self, remark: Remark) -> str:
        """Return the step that shows a sentence."""
        return self.steps_of.get(self.place_of(remark), "fit")

    def located(self, remark: Remark) -> str:
        """Return a sentence behind the name of its field, unless the step of the fit has it."""
        text, step, place = self.worded(remark).text, self.step_of(remark), self.place_of(remark)
        return (text if step == "fit" else
                f"Step {step.capitalize()}, {self.labels.get(place) or 'the file'}: {text}")

    def place_remarks(self, remarks: list[Remark], told: Sequence[Remark] = ()) -> None:
        """Show sentences at the fields that they concern; the others at the button of the fit.

        told  sentences that the result of a fit shows below this button; those with a button of
              their own are shown here, too
        """
        placed: dict[Field, list[Remark]] = {}
        counts = dict.fromkeys(self.badges, 0)
        known = {remark.text for remark in told}
        unique: dict[tuple[Any, ...], Remark] = {}
        for remark in remarks:
            unique.setdefault((remark.text, remark.field, remark.record), remark)
        for remark in unique.values():
            if remark.record not in (None, self.session.case.chosen):
                remark = replace(remark, text=f"Record {remark.record + 1}: {remark.text}",
                                 field=("record", "file"))
            place, step = self.place_of(remark), self.step_of(remark)
            counts[step] += remark.kind != "note"
            if place != ("stage", "all"):
                placed.setdefault(place, []).append(self.worded(remark))
            if remark.text not in known and (place == ("stage", "all") or (
                    remark.kind == "error" and step != "fit")):
                placed.setdefault(("stage", "all"), []).append(
                    replace(remark, text=self.located(remark)))
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

    async def open(self, work: Callable[[], Any], further: bool = False) -> bool:
        """Open a file by a function that runs in a thread; return whether it could be used.

        further  whether it becomes a further record of the case
        """
        if self.session.is_busy:
            ui.notify("A fit is running: cancel it first.", type="warning")
            return False
        try:
            recording = await asyncio.to_thread(work)
        except Unreadable as error:
            self.say(error)
            return False
        if recording is not None:
            self.session.take(recording, further)
        self.show_record()
        return True

    @staticmethod
    def say(error: Unreadable) -> None:
        """Show why a file cannot be used."""
        ui.notify(str(error), type="negative", multi_line=True, close_button="Close", timeout=0)

    def show_record(self) -> None:
        """Show the record that is edited now in place of that before."""
        self.refresh_fields()
        for listener in self.listeners:
            listener()
        self.changed(record=True)

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

    def draw_spectrum(self, chart: Any) -> bool:
        """Show the spectrum of the window with the frequencies of the model, if there is one."""
        chart.set_visibility(self.spectrum is not None)
        if self.spectrum is not None:
            modes = self.session.found.frequencies[:12]
            self.follow_figure(chart, (id(self.spectrum), tuple(modes)), lambda: (
                views.spectrum_figure(self.spectrum, modes, self.units)))
        return self.spectrum is not None

    def draw_frequencies(self, chart: Any, view: Any = None, mode: str = "zoom") -> bool:
        """Show a record of frequencies beside those of the model; return whether it is one.

        view, mode  as `views.record` takes them
        """
        record, found = self.session.record, self.session.found
        shown = record.is_ready and record.kind != "time" and (record.kind == "frf"
                                                               or record.modes is not None)
        if not shown:
            return False
        chart.set_visibility(True)
        frequencies = tuple(found.frequencies[:MOST_MODES])
        key = (record.version, frequencies, record.window, record.scale, view, mode)
        if record.kind == "modes":
            self.follow_figure(chart, key, lambda: views.modal(
                record.modes, found.frequencies, found.damping))
            return True
        unit = {"mobility": "velocity", "receptance": "length"}.get(
            record.get("quantity").lower(), "acceleration")
        units = [self.units.get(name) for name in (unit, "force")]
        self.follow_figure(chart, key, lambda: views.response(
            record.t, record.scale * record.z, np.array(frequencies), window=record.window,
            label=f.label(record.get("quantity") or "accelerance",
                          responses.ratio_of_units(*units) if all(units) else ""),
            view=view, mode=mode))
        return True


def is_described(case: Case) -> bool:
    """Return whether a beam has length, section, mass and stiffness."""
    has_section = case.get("beam", "width") and case.get("beam", "height")
    return bool(case.get("beam", "length") and case.get("beam", "e")
                and (has_section or case.get("beam", "I"))
                and ((has_section and case.get("beam", "density")) or case.get("beam", "rho")))


async def prepare() -> bool:
    """Send what every page needs, wait for the browser, and return whether it is dark."""
    ui.add_css(style.sheet())
    ui.add_body_html(SCHEME)
    ui.colors(primary="#0072b2")
    await ui.context.client.connected(timeout=30)
    return bool(await ui.run_javascript("document.body.classList.contains('body--dark')"))


async def build(studio: Studio, first: Path | None) -> None:
    """Build the page of a session, and open the file of the command line in a new one."""
    session = studio.session
    with ui.element("header").classes("top"):
        with ui.element("div").classes("brand"):
            ui.label("beamid studio")
        with ui.tabs().props("dense no-caps inline-label indicator-color=primary") as tabs:
            for name, label in STEPS.items():
                with ui.tab(name, label).props(f'data-step="{name}"'):
                    studio.badges[name] = ui.badge("").props("color=orange-9 rounded")
                    studio.badges[name].set_visibility(False)
                    with studio.badges[name]:
                        ui.tooltip("Number of remarks at the fields of this step")
                    if name == "fit":
                        studio.outdated = ui.badge("outdated").props(
                            "color=grey-7 rounded data-mark=outdated")
                        studio.outdated.set_visibility(False)
        what = ui.label("").classes("what")
    builders = {"record": lambda: record_step.build(studio, lambda: tabs.set_value("beam")),
                "beam": lambda: beam_step.build(studio, lambda: tabs.set_value("fit")),
                "fit": lambda: fit_step.build(studio), "save": lambda: save_step.build(studio)}
    with ui.tab_panels(tabs, value=session.step, animated=False, keep_alive=False).classes("steps"):
        for name, step in builders.items():
            studio.building = name
            with ui.tab_panel(name):
                step()
    studio.listeners.append(lambda: what.set_text(session.name))

    def scheme(event: Any) -> None:
        studio.dark = bool(event.args)
        studio.draw_now()

    ui.on("scheme", scheme)
    tabs.on_value_change(lambda event: studio.show_step(event.value))
    if session.folder:    # the tab has been loaded again
        what.set_text(session.name)
        studio.changed()
    elif first is not None and await record_step.open_path(studio, first) and session.results:
        tabs.set_value("fit")
