"""Input fields of the page: numbers with units, and the sentences of the program below them."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from beamid_studio.case_model import Case, number_text
from beamid_studio.checks import Field, Remark

#: Units to choose from, each with its factor to m, kg, N and s as text.
LENGTHS = {"mm": "0.001", "cm": "0.01", "m": "1", "in": "0.0254"}
MASSES = {"g": "0.001", "kg": "1"}
MODULI = {"GPa": "1e9", "MPa": "1e6", "N/m²": "1"}
DENSITIES = {"kg/m³": "1", "g/cm³": "1000"}
SI = {"length": "m", "mass": "kg", "time": "s", "force": "N"}


def in_si(case: Case) -> bool:
    """Return whether a case counts in metres, kilograms, seconds and newtons."""
    return all(case.get("units", key) == unit for key, unit in SI.items())


class Tells:
    """The sentences below a field."""

    def __init__(self) -> None:
        self.box = ui.column().classes("w-full gap-1")
        self.hint = ui.label("").classes("hint")    #: of the page, not of the program
        self.hint.set_visibility(False)
        self.own = ""

    def suggest(self, hint: str) -> None:
        """Show a hint of the page; '' hides it."""
        self.hint.text = hint
        self.hint.set_visibility(bool(hint))

    def show(self, remarks: list[Remark], advise: Callable[[str], None] | None = None) -> None:
        """Show sentences in place of those before.

        advise  estimates a parameter that a sentence proposes
        """
        self.box.clear()
        with self.box:
            if self.own:
                ui.label(self.own).classes("tell error")
            for remark in remarks:
                with ui.element("div").classes(f"tell {remark.kind}"):
                    ui.label(remark.text).classes("inline")
                    if remark.advice and advise:
                        ui.button(f"Estimate {remark.advice}",
                                  on_click=lambda _, name=remark.advice: advise(name)).props(
                            "flat dense no-caps size=sm color=primary")


class NumberField:
    """A number of the case, entered in a unit of the user's choice."""

    def __init__(self, case: Callable[[], Case], place: Field, label: str, units: dict[str, str],
                 changed: Callable[[], None], *, sd: str = "",
                 chosen: dict[tuple[str, ...], str] | None = None,
                 presets: dict[str, str | None] | None = None,
                 confirmed: Callable[[], None] = lambda: None) -> None:
        self.presets = {} if presets is None else presets    #: standard deviations to be checked
        self.case, self.place, self.changed, self.confirmed = case, place, changed, confirmed
        self.units, self.sd, self.muted = units, sd, False
        self.chosen = {} if chosen is None else chosen    #: units that the user has chosen
        with ui.element("div").classes("field"):
            self.input = ui.input(label or None, on_change=self.read).props(
                f'outlined dense {"stack-label" if label else ""} debounce=250 inputmode=decimal '
                f'autocomplete=off data-field="{"-".join(place)}" '
                f'aria-label="{label or "standard deviation of " + sd}"')
            if sd:    # a preset that the user has looked at is the user's value
                self.input.on("keydown.enter", self.confirm).on("blur", self.confirm)
            self.select: ui.select | None = None
            with self.input.add_slot("append"):
                if len(units) > 1:
                    self.select = ui.select(list(units), value=self.chosen.get(
                        (*place, sd), next(iter(units))), on_change=self.read).props(
                        "borderless dense options-dense aria-label='unit'")
                elif units:
                    ui.label(next(iter(units))).classes("text-xs opacity-70")
            self.tells = Tells()
        self.write()

    @property
    def unit(self) -> tuple[str, str]:
        """The unit that is chosen, and its factor."""
        name = str(self.select.value) if self.select else next(iter(self.units), "")
        return name, self.units.get(name, "1")

    def current(self) -> str:
        """Return the value as it stands in the case."""
        if self.sd:
            keys = self.case().prior(self.sd)
            return keys.get("sd", [""])[0] if keys else ""
        return self.case().get(*self.place)

    def write(self) -> None:
        """Show the value of the case."""
        self.muted = True
        raw = self.current()
        self.input.value = (number_text(raw, self.unit[1], divide=True) or raw) if raw else ""
        self.tells.own = ""
        if self.sd:
            is_preset = bool(raw) and self.presets.get(self.sd) == raw
            self.tells.suggest("Preset: Enter confirms" if is_preset else "")
        self.muted = False

    def confirm(self) -> None:
        """Take a preset as the value of the user, who has been in its field."""
        if self.presets.get(self.sd) is not None:
            self.presets[self.sd] = None
            self.tells.suggest("")
            self.confirmed()

    def read(self) -> None:
        """Take the value that the user has entered."""
        if self.muted:
            return
        text = str(self.input.value or "").strip()
        if self.select:
            self.chosen[(*self.place, self.sd)] = self.select.value
        value = number_text(text, self.unit[1]) if text else ""
        self.tells.own = "" if value is not None else f"Found {text[:30]}, expected a number."
        self.tells.show([])
        if value is None:
            return
        if self.sd:
            self.presets[self.sd] = None
            self.tells.suggest("")
            self.case().set_prior(self.sd, value)
        else:
            self.case().set(*self.place, value)
        self.changed()


def pair() -> Any:
    """Return a part with two columns of fields."""
    return ui.element("div").classes("pair")


def panel(title: str, lead: str = "") -> Any:
    """Return a framed part of a step, with a title and a sentence."""
    box = ui.element("section").classes("panel")
    with box:
        if title:
            ui.label(title).classes("title")
        if lead:
            ui.label(lead).classes("lead")
    return box
