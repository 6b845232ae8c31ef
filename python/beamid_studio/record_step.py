"""The first step: the recorder's file, its columns and units, and the window of the fit."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from beamid_studio import recordings, views
from beamid_studio.case_model import number_text
from beamid_studio.recordings import ACCELERATIONS, SUFFIXES, TIME_UNITS
from beamid_studio.widgets import in_si, panel

#: Units of acceleration by the factor in the case file.
BY_FACTOR = {factor: unit for unit, factor in ACCELERATIONS.items() if factor}


async def open_path(studio: Any, path: Path) -> bool:
    """Open a file or folder of this machine: a recording, a case file, or outputs of a fit."""
    session = studio.session

    def work() -> Any:
        if path.is_dir() or (path.suffix.lower() in (".nml", ".txt") and _is_case(path)):
            session.open_case(path)
            return None
        if path.stat().st_size > session.limit:
            raise recordings.Unreadable(f"{path.name}: is larger than {session.limit // 10**6} MB; "
                                        "--limit sets the limit")
        return recordings.read(path, limit=session.limit)

    return bool(await studio.open(work))


def _is_case(path: Path) -> bool:
    with open(path, encoding="utf-8", errors="replace") as file:
        return path.suffix.lower() == ".nml" or "&beam" in file.read(100_000)


class RecordStep:
    """The panel of the record."""

    def __init__(self, studio: Any, onwards: Callable[[], None]) -> None:
        self.studio, self.session = studio, studio.session
        self.view: tuple[float, float] | None = None
        self.muted = False
        with ui.element("div").classes("step"):
            with ui.element("div").classes("inputs"):
                self.file_panel()
                self.columns_panel()
                self.window_panel(onwards)
            with ui.element("div").classes("views"):
                self.views_panel()
        self.session.listeners.append(self.loaded)
        studio.redraws["record"] = self.draw
        self.loaded()
        self.draw()

    # -- inputs

    def file_panel(self) -> None:
        """Build the place to drop a file, and the facts about it."""
        with panel("Recorder's file"):
            ui.upload(label="Drop a file here, or choose one", auto_upload=True, max_files=None,
                      max_file_size=self.session.limit, on_upload=self.uploaded,
                      on_rejected=lambda: ui.notify(
                          f"The file is larger than {self.session.limit // 10**6} MB, or of "
                          "another kind.", type="negative")).props(
                f'flat accept="{",".join(SUFFIXES)}" data-field=file').classes("drop")
            self.facts = ui.element("div").classes("facts")
            self.tells = self.studio.tell_at("record", "file")

    def columns_panel(self) -> None:
        """Build the lists of columns and units."""
        self.columns = panel("Columns and units")
        with self.columns:
            self.channel = ui.select([], label="Acceleration", on_change=self.choose).props(
                "outlined dense options-dense data-field=column")
            with ui.element("div").classes("pair"):
                with ui.element("div").classes("field"):
                    self.unit = ui.select(list(ACCELERATIONS), label="Its unit",
                                          on_change=self.set_unit).props(
                        "outlined dense options-dense data-field=unit")
                with ui.element("div").classes("field"):
                    self.time_unit = ui.select(list(TIME_UNITS), label="Times in", value="s",
                                               on_change=self.set_time_unit).props(
                        "outlined dense options-dense data-field=time-unit")
                    self.rate = ui.input("Samples per second", on_change=self.set_rate).props(
                        "outlined dense stack-label debounce=300 data-field=rate")
            self.unstated = ui.label("The file states no unit of this column: choose it. The scale "
                                     "has no effect on the frequencies, only on accelerations."
                                     ).classes("tell note")
            self.scale = self.studio.number("record", "scale", "Factor to m/s²", {})
            self.time_tells = self.studio.tell_at("record", "times", "times")
            self.value_tells = self.studio.tell_at("record", "value", "values")

    def window_panel(self, onwards: Callable[[], None]) -> None:
        """Build the fields of the window."""
        self.window = panel("Window of the fit", "Drag across the record. Begin when hands and "
                            "tools have let go; end while the signal is above the noise.")
        with self.window:
            with ui.element("div").classes("pair"):
                self.first = self.studio.number("record", "t_first", "From", {"s": "1"})
                self.last = self.studio.number("record", "t_last", "To", {"s": "1"})
            for field in (self.first, self.last):
                field.changed = lambda: self.studio.changed(window=True)
            self.proposal = ui.element("div").classes("w-full")
            with ui.row().classes("gap-2"):
                ui.button("Whole record", on_click=lambda: self.set_window(None, None)).props(
                    "outline dense no-caps padding='xs md'")
                ui.button("Next: the beam", on_click=onwards).props(
                    "unelevated dense no-caps padding='xs md' data-go=beam")

    def views_panel(self) -> None:
        """Build the figures."""
        self.empty = ui.label("The record appears here: its samples, their spectrum, and the "
                              "natural frequencies of the beam.").classes("empty")
        self.shown = ui.element("div").classes("views")
        with self.shown:
            with ui.element("div").classes("bar"):
                ui.label("Record").classes("title")
                self.mode = ui.toggle({"select": "Set window", "zoom": "Zoom"}, value="select",
                                      on_change=self.draw).props("dense no-caps unelevated "
                                                                 "padding='2px 12px'")
                ui.button("Show all", on_click=lambda: self.zoom(None)).props(
                    "flat dense no-caps data-go=all")
            self.chart = self.studio.chart()
            self.chart.on("plotly_selected", self.selected, js_handler="""(event) => emit(
                event && event.range && event.range.x)""")
            self.chart.on("plotly_relayout", self.relayout, js_handler="""(event) => {
                if ("xaxis.range[0]" in event) emit([event["xaxis.range[0]"],
                                                     event["xaxis.range[1]"]]);
                else if (event["xaxis.autorange"]) emit(null); }""")
            ui.label("Spectrum of the window; dashed: natural frequencies of the beam as it is "
                     "described now").classes("title")
            self.spectrum = self.studio.chart()
            with ui.expansion("Spectrogram of the window", on_value_change=self.draw).classes(
                    "w-full") as self.more:
                self.spectrogram = self.studio.chart()

    # -- events

    async def uploaded(self, event: Any) -> None:
        """Read a file that the browser has sent."""
        name = Path(event.file.name.replace("\\", "/")).name or "record"
        suffix = Path(name).suffix.lower()
        event.sender.reset()
        if suffix not in SUFFIXES:
            ui.notify(f"{name}: the page reads {' '.join(SUFFIXES)}", type="negative")
            return
        path = self.session.root / f".upload-{id(self):x}{suffix}"
        try:
            await event.file.save(path)
            await self.studio.open(lambda: recordings.read(path, name, self.session.limit))
        finally:
            path.unlink(missing_ok=True)

    def choose(self) -> None:
        """Take another column as the record."""
        if self.muted or self.session.recording is None or self.channel.value is None:
            return
        self.session.renew_record()
        self.session.choose(int(self.channel.value))
        self.loaded()
        self.studio.changed(record=True)

    def set_unit(self) -> None:
        """Take the unit of the record as the factor of the case."""
        if self.muted:
            return
        self.unstated.set_visibility(False)
        factor = ACCELERATIONS.get(self.unit.value, "")
        if factor:
            self.session.case.set("record", "scale", factor if factor != "1" else None)
            self.scale.write()
            self.studio.changed(window=True)
        self.show_scale()

    def show_scale(self) -> None:
        """Show the factor where the unit is none of the list."""
        self.scale.input.set_visibility(self.unit.value == "other" or not in_si(self.session.case))

    def set_time_unit(self) -> None:
        """Count the times of the file in another unit; the window keeps its samples."""
        if self.muted or self.session.recording is None:
            return
        old, new = self.session.recording.time_unit, self.time_unit.value
        self.session.renew_record()
        self.session.recording.time_unit = new
        self.session.load_samples()
        for key in ("t_first", "t_last"):
            raw = self.session.case.get("record", key)
            in_old = number_text(raw, TIME_UNITS[old], divide=True) if raw else None
            self.session.case.set("record", key, in_old and number_text(in_old, TIME_UNITS[new]))
        self.view = None
        self.facts_now()
        self.studio.refresh_fields()
        self.studio.changed(record=True)

    def set_rate(self) -> None:
        """Take the sampling rate of a file without times."""
        if self.muted or self.session.recording is None:
            return
        text = number_text(str(self.rate.value or ""))
        if text is None or float(text) <= 0:
            return
        self.session.renew_record()
        self.session.rate = text
        self.session.load_samples()
        self.view = None
        self.facts_now()
        self.studio.changed(record=True)

    def selected(self, event: Any) -> None:
        """Take the window that was dragged."""
        if event.args:
            low, high = sorted(float(end) for end in event.args)
            t = self.session.t
            self.set_window(None if low <= t[0] else low, None if high >= t[-1] else high)

    def set_window(self, low: float | None, high: float | None) -> None:
        """Limit the record to times that are rounded to the digits that the samples have."""
        for key, value in (("t_first", low), ("t_last", high)):
            self.session.case.set("record", key, None if value is None else
                                  number_text(f"{value:.{self.decimals()}f}"))
        if low is None:
            self.session.found.onset = None
        self.first.write()
        self.last.write()
        self.studio.changed(window=True)

    def decimals(self) -> int:
        """Return how many decimals of a time tell samples apart."""
        t = self.session.t
        step = float(np.median(np.diff(t[:10000]))) if t.size > 1 else 1.0
        return int(np.clip(np.ceil(-np.log10(step)), 0, 9))

    def relayout(self, event: Any) -> None:
        """Show the part of the record that was zoomed to, with all its details."""
        self.zoom(tuple(float(end) for end in event.args) if event.args else None)

    def zoom(self, view: Any) -> None:
        """Show these times of the record; None: all."""
        self.view = view
        self.draw_record()

    # -- figures

    def loaded(self) -> None:
        """Show the columns and units of another file."""
        recording, session = self.session.recording, self.session
        self.muted = True
        there = bool(session.t.size)
        self.columns.set_visibility(there)
        self.window.set_visibility(there)
        self.view = None
        if recording:
            self.channel.set_options({k: name for k, (name, _) in enumerate(recording.channels)},
                                     value=recording.chosen)
            self.time_unit.value = recording.time_unit
            self.rate.value = session.rate
        self.channel.set_visibility(bool(recording))
        # The reader has converted times whose unit the file states, unless these are seconds.
        self.time_unit.set_visibility(bool(recording and recording.has_times
                                           and not recording.is_converted))
        self.rate.set_visibility(bool(recording and not recording.has_times))
        factor = number_text(session.case.get("record", "scale") or "1") or "1"
        unit = BY_FACTOR.get(factor, "other")
        if recording and not recording.unit and factor == "1":
            unit = "m/s²"
        self.unit.value = unit
        self.unstated.set_visibility(bool(recording and not recording.unit))
        self.unit.set_visibility(in_si(session.case))
        self.scale.write()
        self.show_scale()
        self.muted = False
        self.facts_now()

    def facts_now(self) -> None:
        """Show sampling, missing samples, and what the reader has remarked."""
        session = self.session
        self.facts.clear()
        if not session.t.size:
            return
        t = session.t
        steps = np.diff(t[:200_000])
        step = float(np.median(steps)) if steps.size else 1.0
        uneven = bool(steps.size and np.ptp(steps) > 0.01 * abs(step))
        rows = [("File", session.name), ("Samples", f"{t.size:,}"
                 + f", {session.missing:,} missing ones left out" * bool(session.missing)),
                ("Times", f"{t[0]:.6g} to {t[-1]:.6g} s"),
                ("Sampling", f"{1 / step:.5g} per second" + ", uneven" * uneven
                 if step > 0 else "")]
        if session.recording and session.recording.channel.notes:
            rows.append(("Read as", "; ".join(session.recording.channel.notes)[:200]))
        if session.recording and session.recording.remarks:
            rows.append(("Left out", "; ".join(session.recording.remarks)[:200]))
        with self.facts:
            for name, text in rows:
                ui.label(name)
                ui.label(text)

    def draw(self) -> None:
        """Redraw everything that follows the input."""
        there = self.session.is_ready
        self.empty.set_visibility(not there)
        self.shown.set_visibility(there)
        self.draw_record()
        self.studio.draw_spectrum(self.spectrum)
        self.propose()
        if there and self.more.value:
            modes = self.session.found.frequencies[:8]
            key = (id(self.session.z), self.session.window, self.session.scale, tuple(modes))
            self.studio.follow_figure(self.spectrogram, key, lambda: views.spectrogram(
                self.studio.window_samples(), modes))

    def draw_record(self) -> None:
        """Redraw the record and its window."""
        session = self.session
        if not session.is_ready:
            return
        label = session.recording.channel.name if session.recording else "record"
        unit = self.unit.value if self.unit.value in BY_FACTOR.values() else ""
        key = (id(session.z), session.window, self.view, self.mode.value, unit)
        self.studio.follow_figure(self.chart, key, lambda: views.record(
            session.t, session.z, session.window, label=label, unit=unit, view=self.view,
            mode=self.mode.value))

    def propose(self) -> None:
        """Say where the program sees the motion begin."""
        onset = self.session.found.onset
        self.proposal.clear()
        if onset is None:
            return
        with self.proposal, ui.element("div").classes("tell note"):
            ui.label(f"The motion begins at {onset:.6g} s. The fit starts there, unless you set "
                     "another time.").classes("inline")


def build(studio: Any, onwards: Callable[[], None]) -> None:
    """Build the step of the record."""
    RecordStep(studio, onwards)
