"""The panel of the motion: a free decay, a release, an impulse, or a measured force."""
from __future__ import annotations

from typing import Any

from nicegui import ui

from beamid_studio import recordings
from beamid_studio.record_step import drop_zone
from beamid_studio.recordings import FORCES
from beamid_studio.records import Force
from beamid_studio.widgets import LENGTHS, pair, panel

KINDS = {"free": "free decay: nothing is known of its start",
         "release": "release: pulled aside and let go", "pulse": "impulse: a constant force",
         "table": "measured force"}
LEADS = {"free": "Amplitude and phase of each mode are estimated, too.",
         "release": "State the force, or the displacement, at which the beam was held. If you have "
                    "measured neither, choose a free decay.",
         "pulse": "The force acts from t = 0.",
         "table": "The force is a column of the record's file, or of another file with the same "
                  "zero of time."}
DURATIONS = {"ms": "0.001", "s": "1"}


async def use_force(studio: Any, recording: recordings.Recording) -> None:
    """Take the force from a file of its own."""
    studio.session.set_force(Force(likely(recording), recording))
    studio.show_record()


def likely(recording: recordings.Recording) -> int:
    """Return the place of the channel that is most likely a force."""
    return max(range(len(recording.channels)), key=lambda k: (
        getattr(recording.channels[k][1], "measured", "") == "force"
        or getattr(recording.channels[k][1], "unit", "") in FORCES,
        "force" in recording.channels[k][0].lower(), -k))


class MotionPanel:
    """What sets the beam in motion, for all records or for the one that is edited."""

    def __init__(self, studio: Any) -> None:
        self.studio, self.session = studio, studio.session
        self.muted = False
        number = studio.number
        self.panel = panel("Motion")
        with self.panel:
            self.each = ui.checkbox("Each record has a motion of its own",
                                    on_change=self.take_each).props("dense data-field=each")
            self.of = ui.label("").classes("lead")
            self.kind = ui.select(KINDS, on_change=self.take_kind).props(
                "outlined dense options-dense data-field=motion aria-label=motion")
            studio.tell_at("excitation", "kind", "motion")
            self.lead = ui.label("").classes("lead")
            self.parts = {}
            with pair() as self.parts["free"]:
                self.modes = ui.number("Modes in the record", min=1, max=20, step=1, precision=0,
                                       on_change=self.take_modes).props(
                    "outlined dense data-field=modes")
            with pair() as self.parts["release"]:
                number("excitation", "force", "Force", {"N": "1"})
                number("excitation", "displacement", "or displacement", LENGTHS)
                number("excitation", "time", "Time of release", {"s": "1"})
            with pair() as self.parts["pulse"]:
                number("excitation", "amplitude", "Force", {"N": "1"})
                number("excitation", "duration", "Duration", DURATIONS)
            with ui.element("div").classes("field gap-2") as self.parts["table"]:
                with pair():
                    self.column = ui.select({}, label="Force", on_change=self.take_force).props(
                        "outlined dense options-dense data-field=force")
                    self.unit = ui.select(list(FORCES), label="Its unit", value="N",
                                          on_change=self.take_force).props(
                        "outlined dense options-dense data-field=force-unit")
                drop_zone(self.session, "force-file", use_force).props(
                    'label="Or drop a file of the force"')
                studio.tell_at("excitation", "file", "force")
            with pair() as self.place:
                number("excitation", "x_F", "Force at", LENGTHS)
        self.show()

    # -- events

    def take_each(self) -> None:
        """Give each record a motion of its own, or all records the same."""
        if not self.muted:
            self.session.set_own_excitations(bool(self.each.value))
            self.studio.show_record()

    def take_kind(self) -> None:
        """Take another kind of motion; only the place of the force stays."""
        if not self.muted:
            self.session.set_excitation(self.kind.value)
            self.studio.show_record()

    def take_modes(self) -> None:
        """Take the number of modes of a free decay."""
        if self.muted or not self.modes.value:
            return
        self.session.case.set("excitation", "modes", str(int(self.modes.value)))
        self.studio.changed()

    def take_force(self) -> None:
        """Take another column, or its unit, as the force."""
        if self.muted or not self.column.value or self.column.value[0] == "c":
            return
        own, force = self.column.value[0] == "f", self.session.moved.force
        recording = force.recording if own and force else None
        self.session.set_force(Force(int(self.column.value[1:]), recording, self.unit.value))
        self.studio.changed()

    # -- what is shown

    def show(self) -> None:
        """Show the motion of the case."""
        session = self.session
        kind = session.case.get("excitation", "kind").lower()
        self.muted = True
        self.panel.set_visibility(session.is_in_time)
        several = len(session.records) > 1
        self.each.set_visibility(several)
        self.each.value = session.has_own_excitations
        self.of.text = (f"Of record {session.case.chosen + 1}, which you choose at step 1."
                        if session.has_own_excitations else "")
        self.of.set_visibility(session.has_own_excitations)
        others = {} if kind in KINDS else {kind: f"{kind}, as in the case"}
        self.kind.set_options({**KINDS, **others}, value=kind)
        self.lead.text = LEADS.get(kind, "")
        self.modes.value = float(session.case.get("excitation", "modes") or 2)
        for name, part in self.parts.items():
            part.set_visibility(name == kind)
        self.place.set_visibility(kind in ("release", "pulse", "table"))
        self.show_force()
        self.muted = False

    def show_force(self) -> None:
        """Show the columns that may be the force."""
        record = self.session.moved
        options, value = {}, None
        if record.recording and record.kind == "time":
            options = {f"r{k}": name for k, (name, _) in enumerate(record.recording.channels)
                       if k != record.recording.chosen}
        if record.force and record.force.recording:
            options |= {f"f{k}": f"{name} ({record.force.recording.name})"
                        for k, (name, _) in enumerate(record.force.recording.channels)}
        if record.force:
            value = f"{'f' if record.force.recording else 'r'}{record.force.column}"
            self.unit.value = record.force.unit
        elif self.session.case.get("excitation", "file"):
            options["c0"] = "as in the case"
            value = "c0"
        self.column.set_options(options, value=value if value in options else None)
