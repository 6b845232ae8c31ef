"""The second step: geometry, material, ends and attachments, with a drawing and the modes."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cases
from nicegui import ui

from beamid_studio import drawing
from beamid_studio.case_model import quoted
from beamid_studio.widgets import (DENSITIES, LENGTHS, MASSES, MODULI, NumberField, in_si, pair,
                                   panel)

#: Density [kg/m^3] and modulus of elasticity [N/m^2] of common materials.
MATERIALS = {
    "steel": ("7850", "2.05e11"), "stainless steel": ("7900", "1.95e11"),
    "aluminium": ("2700", "7e10"), "brass": ("8500", "1e11"), "copper": ("8930", "1.2e11"),
    "titanium": ("4510", "1.1e11"), "glass": ("2500", "7e10"), "acrylic": ("1190", "3.2e9"),
    "carbon fibre laminate": ("1550", "1.2e11"), "spruce, along the grain": ("430", "1.1e10"),
    "beech, along the grain": ("720", "1.4e10")}
#: Start values of damping: Kelvin-Voigt viscosity by E [s], and damping by the air [N s/m^2].
VISCOSITY, AIR = 3e-5, "0.05"
ENDS = {"root": {"clamped": "clamped", "pinned": "pinned", "guided": "guided", "free": "free"},
        "tip": {"free": "free", "clamped": "clamped", "pinned": "pinned", "guided": "guided"}}
#: What the record is shown as, by its kind.
HEADINGS = {"time": "Spectrum of the window; dashed: these modes",
            "frf": "Measured frequency response; dashed: these modes",
            "modes": "Measured modes and modes of the beam"}
#: Groups with fields of their own; others are kept as they are.
WITH_FIELDS = {"units", "beam", "end", "tip", "mass", "sensor", "support", "excitation", "record",
               "stage", "prior"}


class BeamStep:
    """The panel of the beam."""

    def __init__(self, studio: Any, onwards: Callable[[], None]) -> None:
        self.studio, self.session, self.onwards = studio, studio.session, onwards
        self.muted = False
        number = studio.number
        with ui.element("div").classes("step"):
            with ui.element("div").classes("inputs"):
                with panel("Beam", "From the clamp to the free end. The height is the thickness in "
                           "the direction of the vibration."), pair():
                    number("beam", "length", "Length", LENGTHS)
                    number("beam", "width", "Width", LENGTHS)
                    number("beam", "height", "Height", LENGTHS)
                with panel("Material"):
                    self.material = ui.select(list(MATERIALS), label="Typical values of",
                                              on_change=self.take_material, clearable=True).props(
                        "outlined dense options-dense data-field=material")
                    with pair():
                        number("beam", "density", "Density", DENSITIES)
                        number("beam", "E", "Modulus E", MODULI)
                    with ui.expansion("Damping, start values").classes("w-full"), pair():
                        number("beam", "c_D", "Material c_D", {"N s/m²": "1"})
                        number("beam", "gamma", "Air gamma", {"N s/m²": "1"})
                with panel("Sensor", "Its mass includes the board and half the cable; a phone has "
                           "about 200 g."), pair():
                    number("sensor", "x_S", "From the clamp", LENGTHS)
                    number("sensor", "m_S", "Mass", MASSES)
                with panel("Ends and attachments"):
                    with pair():
                        self.ends = {at: ui.select(
                            kinds, label={"root": "Root", "tip": "Other end"}[at],
                            on_change=self.set_ends).props(
                                f"outlined dense options-dense data-field=end-{at}")
                            for at, kinds in ENDS.items()}
                        number("tip", "m_T", "Tip mass", MASSES)
                        number("beam", "k_R", "Clamp stiffness", {"N m": "1"})
                    self.attached = ui.column().classes("w-full gap-2")
                    with ui.row().classes("gap-2"):
                        ui.button("Add a mass", on_click=lambda: self.add("mass")).props(
                            "outline dense no-caps padding='xs md'")
                        ui.button("Add a support", on_click=lambda: self.add("support")).props(
                            "outline dense no-caps padding='xs md'")
                    self.kept = ui.label("").classes("lead")
                with ui.row().classes("gap-2"):
                    ui.button("Next: the fit", on_click=onwards).props(
                        "unelevated dense no-caps padding='xs md' data-go=fit")
                    ui.button("Run the fit", on_click=self.run).props(
                        "outline dense no-caps padding='xs md' data-go=run-now")
            with ui.element("div").classes("views"):
                self.drawing = ui.html("", sanitize=False).classes("w-full")
                ui.label("Lowest modes").classes("title")
                self.modes = ui.html("", sanitize=False).classes("w-full")
                self.lacking = ui.label("The modes appear when length, section, density and E are "
                                        "known.").classes("lead")
                self.heading = ui.label("").classes("title")
                self.spectrum = studio.chart()
        self.pictures: tuple[Any, ...] = ()
        studio.redraws["beam"] = self.draw
        studio.listeners.append(self.loaded)
        self.loaded()

    async def run(self) -> None:
        """Fit at once, with what the case estimates already."""
        self.onwards()
        await self.studio.start()

    def take_material(self) -> None:
        """Take the typical values of a material."""
        if self.muted or self.material.value not in MATERIALS:
            return
        case = self.session.case
        density, modulus = MATERIALS[self.material.value]
        case.set("beam", "density", density)
        case.set("beam", "e", modulus)
        case.set("beam", "c_d", f"{VISCOSITY * float(modulus):.0e}".replace("e+0", "e"))
        if not case.get("beam", "gamma"):
            case.set("beam", "gamma", AIR)
        self.session.preset("density", density)
        self.studio.refresh_fields()
        self.studio.changed()

    def set_ends(self) -> None:
        """Take the kinds of the ends; the usual ones need no group."""
        if self.muted:
            return
        case = self.session.case
        case.remove("end")
        for at, select in self.ends.items():
            if select.value and select.value != next(iter(ENDS[at])):
                case.add("end").update(at=[quoted(at)], kind=[quoted(select.value)])
        self.studio.changed()

    def add(self, name: str) -> None:
        """Attach a mass or a support at the tip."""
        keys = self.session.case.add(name)
        length = self.session.case.get("beam", "length") or "0"
        keys["x" if name == "mass" else "x_p"] = [length]
        if name == "mass":
            keys["m"] = ["0.01" if in_si(self.session.case) else "0"]
        if len(self.session.case.all(name)) > 1:
            for k, group in enumerate(self.session.case.all(name), 1):
                group.setdefault("name", [quoted(f"{name[0]}{k}")])
        self.show_attached()
        self.studio.changed()

    def detach(self, keys: dict[str, list[str]]) -> None:
        """Remove a mass or a support."""
        self.session.case.drop(keys)
        self.show_attached()
        self.studio.changed()

    def show_attached(self) -> None:
        """Show a row of fields for each mass and support."""
        si = in_si(self.session.case)
        self.attached.clear()
        with self.attached:
            for name, columns in (("mass", (("x", "x", LENGTHS), ("m", "Mass", MASSES))),
                                  ("support", (("x_p", "x", LENGTHS),
                                               ("k_p", "Stiffness", {"N/m": "1"})))):
                for keys in self.session.case.all(name):
                    with ui.element("div").classes("bar no-wrap"):
                        ui.label(name.capitalize()).classes("text-sm")
                        for key, label, units in columns:
                            GroupField(keys, key, label, units if si else {}, self.studio)
                        ui.button(icon="close", on_click=lambda _, keys=keys: self.detach(keys)
                                  ).props(f"flat dense round size=sm aria-label='remove {name}'")

    def loaded(self) -> None:
        """Show the beam of another case."""
        case = self.session.case
        self.muted = True
        values = case.get("beam", "density"), case.get("beam", "e")
        self.material.value = next((name for name, known in MATERIALS.items() if known == values),
                                   None)
        kinds = drawing.ends_of(case)
        for at, select in self.ends.items():
            kind = kinds[at]
            if kind in ENDS[at]:
                select.set_options(ENDS[at], value=kind)
            else:
                select.set_options({**ENDS[at], kind: "springs, as in the case"}, value=kind)
        self.muted = False
        others = sorted({name for name, _ in case.groups} - WITH_FIELDS)
        self.kept.text = ("Also in the case, and kept: " + ", ".join(f"&{name}" for name in others)
                          if others else "")
        self.kept.set_visibility(bool(others))
        self.show_attached()

    def draw(self) -> None:
        """Redraw the beam, its modes, and the spectrum."""
        found = self.session.found
        pictures = (drawing.beam(self.session.case), drawing.modes(
            found.x, found.shapes, found.frequencies, found.damping,
            self.studio.units.hertz or "Hz"))
        if pictures != self.pictures:
            self.pictures = pictures
            self.drawing.set_content(pictures[0])
            self.modes.set_content(pictures[1])
            self.lacking.set_visibility(not pictures[1])
        kind = self.session.record.kind
        shown = (self.studio.draw_frequencies(self.spectrum)
                 or self.studio.draw_spectrum(self.spectrum))
        self.heading.text = HEADINGS[kind]
        self.heading.set_visibility(shown)


class GroupField(NumberField):
    """A number of one of several groups."""

    def __init__(self, keys: dict[str, list[str]], key: str, label: str, units: dict[str, str],
                 studio: Any) -> None:
        self.keys, self.key = keys, key
        super().__init__(lambda: self, ("", key), label, units, studio.changed)  # type: ignore

    def get(self, _: str, key: str) -> str:
        """Return the value of the key."""
        return cases.unquoted(self.keys.get(key, []))

    def set(self, _: str, key: str, value: str) -> None:
        """Set the key, or remove it."""
        if value:
            self.keys[key] = [value]
        else:
            self.keys.pop(key, None)


def build(studio: Any, onwards: Callable[[], None]) -> None:
    """Build the step of the beam."""
    BeamStep(studio, onwards)
