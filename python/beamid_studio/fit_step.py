"""The third step: what is estimated and what is known, the run, and the results."""
from __future__ import annotations

from typing import Any

import page as h
from nicegui import background_tasks, ui

from beamid_studio import checks, results
from beamid_studio.motion import MotionPanel
from beamid_studio.session import Result
from beamid_studio.widgets import DENSITIES, LENGTHS, MASSES, MODULI, panel

#: Parameters that the page offers: name, meaning, units of its standard deviation.
OFFERED: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("E", "modulus of elasticity", MODULI), ("m_S", "mass of the sensor", MASSES),
    ("c_D", "damping in the material", {}), ("gamma", "damping by the air", {}),
    ("k_R", "stiffness of the clamp", {}), ("x_S", "place of the sensor", LENGTHS),
    ("length", "of the beam", LENGTHS))
KNOWN = (("width", "of the section", LENGTHS), ("height", "of the section", LENGTHS),
         ("density", "of the material", DENSITIES))
#: Further parameters that may be estimated.
FURTHER = {
    "m_T": "mass at the tip", "J_T": "rotary inertia at the tip",
    "J_S": "rotary inertia of the sensor", "rho": "mass per length",
    "c_R": "damping of the root's rotation", "k_w": "stiffness of an end against deflection",
    "c_w": "damping of an end's deflection", "x_P": "place of a support",
    "k_P": "stiffness of a support", "c_P": "damping of a support", "m_M": "mass on the beam",
    "x_M": "its place", "m_H": "mass of a hose", "c_H": "damping of a hose",
    "k_H": "stiffness of a hose", "x_H": "place of a hose", "eta": "loss factor",
    "a_h": "spatial hysteresis", "b_h": "its range", "d_1": "time hysteresis",
    "b_1": "its relaxation rate", "T": "axial force"}


class FitStep:
    """The panel of the fit."""

    def __init__(self, studio: Any) -> None:
        self.studio, self.session = studio, studio.session
        self.muted = False
        self.boxes: dict[str, ui.checkbox] = {}
        with ui.element("div").classes("step even"):
            with ui.element("div").classes("inputs"):
                self.choices_panel()
                self.motion = MotionPanel(studio)
            with ui.element("div").classes("views"):
                self.run_panel()
                self.results = studio.results = results.Results(studio, self.work)
        inherited = studio.refresh_choices

        def refresh() -> None:
            inherited()
            self.show_choices()

        studio.refresh_choices = refresh
        studio.redraws["fit"] = self.draw
        studio.listeners.append(self.loaded)
        self.loaded()

    # -- inputs

    def choices_panel(self) -> None:
        """Build the list of what is estimated and known."""
        number = self.studio.number
        with panel("Estimated and known", "Tick what the fit estimates. State the standard "
                   "deviation of what you have measured: the intervals then include it. A preset "
                   "is a guess of the page, and counts as well. An empty field counts as exactly "
                   "known, or as not known at all if its parameter is ticked."):
            with ui.element("div").classes("choices"):
                for text in ("", "parameter", "standard deviation"):
                    ui.label(text).classes("head")
                for name, meaning, units in OFFERED:
                    self.boxes[name] = ui.checkbox(on_change=self.take_choices).props(
                        f"dense data-free={name} aria-label='estimate {name}'")
                    self.named(name, meaning)
                    if name == "k_R":
                        ui.label("")
                    else:
                        number("prior", name, "", units, sd=name)
                    self.tell_row(name)
                self.boxes["offset"] = ui.checkbox(on_change=self.take_choices).props(
                    "dense data-free=offset aria-label='estimate offset'")
                self.named("offset", "zero of the sensor, in the unit of the file")
                ui.label("")
                self.tell_row("offset")
                for name, meaning, units in KNOWN:
                    ui.label("")
                    self.named(name, meaning)
                    number("prior", name, "", units, sd=name)
            self.further = ui.select(FURTHER, label="Estimate also", multiple=True,
                                     on_change=self.take_choices).props(
                "outlined dense options-dense use-chips data-field=further")
            self.studio.tell_at("stage", "free")

    @staticmethod
    def named(name: str, meaning: str) -> None:
        """Show a parameter's symbol and meaning."""
        with ui.element("div").classes("meaning"):
            ui.html(h.symbol(name), sanitize=False)
            ui.html(f"<small>{meaning}</small>", sanitize=False)

    def tell_row(self, name: str) -> None:
        """Add a place for sentences about a parameter below its row."""
        with ui.element("div").classes("wide"):
            self.studio.tell_at("stage", name.lower())

    def run_panel(self) -> None:
        """Build the buttons and the progress."""
        with panel("") as box:
            box.classes("flat")
            with ui.element("div").classes("bar"):
                self.go = ui.button("Run the fit", on_click=self.start).props(
                    "unelevated no-caps padding='sm xl' data-go=run")
                self.stop = ui.button("Cancel", on_click=self.cancel).props(
                    "outline no-caps padding='sm md' data-go=cancel")
                self.spinner = ui.spinner(size="1.4rem")
            self.progress = ui.label("").classes("lead").props("data-field=progress")
            self.studio.tell_at("stage", "all")
        self.studio.show_progress, self.studio.start = self.show_progress, self.start
        self.show_progress()

    # -- events

    def take_choices(self) -> None:
        """Take the names that are ticked, in the order of the list."""
        if self.muted:
            return
        names = [name for name, box in self.boxes.items() if box.value]
        self.session.case.free = [*names, *(self.further.value or [])]
        self.studio.changed()

    def show_choices(self) -> None:
        """Show what the case estimates."""
        self.muted = True
        free = self.session.case.free
        known = {name.lower(): name for name in self.boxes}
        for name, box in self.boxes.items():
            box.value = name.lower() in {one.lower() for one in free}
        others = [name for name in free if name.lower() not in known]
        self.further.set_options({name: f"{name}: {FURTHER[name]}" if name in FURTHER else name
                                  for name in dict.fromkeys([*FURTHER, *others])}, value=others)
        self.muted = False

    def loaded(self) -> None:
        """Show the choices and the fits of another case."""
        self.show_choices()
        self.motion.show()
        self.results.show_all()

    def draw(self) -> None:
        """Redraw what follows the input: hints at the sensor, and the mark of a result."""
        for name, (meaning, error) in checks.SENSOR_ERRORS.items():
            effect, hint = self.session.found.effects.get(name, 0), ""
            if effect > checks.LEAST_EFFECT and "E" in self.session.case.free:
                hint = (f"Without a standard deviation, the {meaning} counts as exactly known. An "
                        f"error of {100 * error:g} % would move E by {100 * effect:.1f} %.")
            self.studio.tells["stage", name.lower()].suggest(hint)
        self.studio.tells["stage", "all"].suggest(self.lacking())
        self.results.redraw()

    def show_progress(self) -> None:
        """Show whether a job is running, and what the program has said last."""
        running = self.session.is_busy
        self.go.set_visibility(not running)
        self.stop.set_visibility(running)
        self.spinner.set_visibility(running)
        self.progress.text = self.session.progress

    def lacking(self) -> str:
        """Return what a fit still needs, or ''."""
        case = self.session.case
        if self.session.lacking:
            return self.session.lacking
        needed = [("length", "length"), ("e", "modulus E")]
        if not case.get("beam", "rho"):
            needed += [("width", "width"), ("height", "height"), ("density", "density")]
        missing = [label for key, label in needed if not case.get("beam", key)]
        if missing:
            return f"The beam still needs: {', '.join(missing)}."
        return "" if case.free else "Tick at least one parameter."

    async def start(self) -> None:
        """Fit the case as it stands."""
        lacking = self.lacking()
        if lacking:
            ui.notify(lacking, type="warning")
            return
        # It appears where the other button was: a second click is not meant for it.
        self.stop.disable()
        ui.timer(0.6, self.stop.enable, once=True)
        await self.work(self.fit())

    async def work(self, job: Any) -> None:
        """Run a job of the program, one at a time; it goes on if the tab is loaded again."""
        session = self.session
        if session.is_busy:
            job.close()
            ui.notify("The program is running: wait, or cancel it.", type="warning")
            return
        session.is_busy = True
        session.say("starting")
        try:
            await background_tasks.create(job, name="run")
        finally:
            session.is_busy = False
            session.say("")

    async def fit(self) -> None:
        """Write what has changed, run the program, and show what it found."""
        await self.studio.write_records()
        if self.session.page is None:    # the tab has been closed
            return
        result: Result | None = await self.session.fit()
        page = self.session.page    # perhaps another one by now
        if page is None:
            return
        if result is None:
            page.results.notify("The fit was cancelled.")
            return
        page.show_found()
        await page.results.show_new(result)

    async def cancel(self) -> None:
        """End the run."""
        if self.session.run:
            self.session.say("cancelling")
            await self.session.run.cancel()


def build(studio: Any) -> None:
    """Build the step of the fit."""
    FitStep(studio)
