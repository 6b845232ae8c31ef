"""The first step: the recorder's file, its columns and units, and the window of the fit."""
from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from beamid_studio import recordings, views
from beamid_studio.case_model import number_text, quoted
from beamid_studio.recordings import ACCELERATIONS, SUFFIXES, TIME_UNITS
from beamid_studio.records import WINDOWS
from beamid_studio.session import Session
from beamid_studio.widgets import LENGTHS, in_si, pair, panel

QUANTITIES = ["accelerance", "mobility", "receptance"]
#: Texts of the panel by the kind of the record.
NAMES = {"time": "Acceleration", "frf": "Frequency response", "modes": "Table"}
SCALES = {"time": "Factor to m/s²", "frf": "Factor to units of the case", "modes": ""}
TITLES = {"time": "Record", "frf": "Frequency response; dashed: natural frequencies of the beam",
          "modes": "Measured modes and modes of the beam"}
ADVICE = {"time": "Drag across the record. Begin when hands and tools have let go; end while the "
          "signal is above the noise.", "frf": "Drag across the frequencies. Leave out those that "
          "the blow or the shaker did not reach.", "modes": ""}
#: Numbers of files that are being received.
UPLOADS = itertools.count(1)
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


async def open_record(studio: Any, recording: recordings.Recording) -> None:
    """Make a recording the only record."""
    await studio.open(lambda: recording)


async def add_record(studio: Any, recording: recordings.Recording) -> None:
    """Make a recording a further record."""
    await studio.open(lambda: recording, further=True)


def drop_zone(session: Session, name: str, use: Callable[[Any, recordings.Recording],
                                                         Awaitable[None]]) -> Any:
    """Add a place to drop a file.

    use  takes the page and what the file contains. FastAPI keeps what receives uploads as long as
         the server runs: it must not refer to a page, which would be kept as well.
    """
    async def uploaded(event: Any) -> None:
        studio = session.page
        file = Path(event.file.name.replace("\\", "/")).name or "record"
        suffix = Path(file).suffix.lower()
        event.sender.reset()
        if suffix not in SUFFIXES:
            ui.notify(f"{file}: the page reads {' '.join(SUFFIXES)}", type="negative")
            return
        path = session.root / f".upload-{session.key}-{next(UPLOADS)}{suffix}"
        try:
            await event.file.save(path)
            recording = await asyncio.to_thread(recordings.read, path, file, session.limit)
        except recordings.Unreadable as error:
            studio.say(error)
            return
        finally:
            path.unlink(missing_ok=True)
        await use(studio, recording)

    return ui.upload(auto_upload=True, max_file_size=session.limit, on_upload=uploaded,
                     on_rejected=lambda: ui.notify(
                         f"The file is larger than {session.limit // 10**6} MB, or of another "
                         "kind.", type="negative")).props(
        f'flat accept="{",".join(SUFFIXES)}" data-field={name}').classes("drop")


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
                self.window_panel()
                with ui.row().classes("gap-2"):
                    self.whole = ui.button("Whole record", on_click=lambda: self.set_window(
                        None, None)).props("outline dense no-caps padding='xs md'")
                    self.next = ui.button("Next: the beam", on_click=onwards).props(
                        "unelevated dense no-caps padding='xs md' data-go=beam")
            with ui.element("div").classes("views"):
                self.views_panel()
        studio.listeners.append(self.loaded)
        studio.redraws["record"] = self.draw
        self.loaded()
        self.draw()

    # -- inputs

    def file_panel(self) -> None:
        """Build the place to drop a file, and the facts about it."""
        with panel("Recorder's file"):
            with ui.element("div").classes("drops"):
                self.drop = drop_zone(self.session, "file", open_record)
                self.more_drop = drop_zone(self.session, "further", add_record).props(
                    'label="Add a record"')
            self.list = ui.element("div").classes("records")
            self.facts = ui.element("div").classes("facts")
            self.tells = self.studio.tell_at("record", "file")

    def show_list(self) -> None:
        """Show a button for each of several records, and what dropping a file does."""
        records, chosen = self.session.records, self.session.case.chosen
        there = bool(self.session.folder and records[0].get("file"))
        self.drop.props(f'label="{"Begin anew" if there else "Drop a file here, or choose one"}"')
        self.more_drop.set_visibility(there)
        self.list.clear()
        if len(records) < 2:
            return
        with self.list:
            for k, record in enumerate(records):
                with ui.element("div").classes("bar no-wrap"):
                    ui.button(f"{k + 1}  {record.name}", on_click=lambda _, k=k: self.edit(k)
                              ).props(f"{'unelevated' if k == chosen else 'outline'} dense no-caps "
                                      f"align=left padding='2px 12px' data-record={k + 1}"
                                      ).classes("grow min-w-0 overflow-hidden")
                    if k == chosen:
                        ui.button(icon="close", on_click=self.remove).props(
                            f"flat dense round size=sm aria-label='remove record {k + 1}' "
                            "data-go=remove-record")

    def columns_panel(self) -> None:
        """Build the lists of columns and units."""
        self.columns = panel("Columns and units")
        with self.columns:
            self.channel = ui.select([], label="Acceleration", on_change=self.choose).props(
                "outlined dense options-dense data-field=column")
            with ui.element("div").classes("pair") as self.of_time:
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
            with ui.element("div").classes("pair") as self.of_frf:
                self.quantity = ui.select(QUANTITIES, label="Quantity",
                                          on_change=self.set_quantity).props(
                    "outlined dense options-dense data-field=quantity")
                self.studio.number("record", "x_F", "Force at", LENGTHS)
                self.studio.number("record", "averages", "Averaged blocks", {})
                self.studio.number("record", "sd", "Noise, sd", {})
            self.unstated = ui.label("The file states no unit of this column: choose it. The scale "
                                     "has no effect on the frequencies, only on accelerations."
                                     ).classes("tell note")
            self.scale = self.studio.number("record", "scale", "Factor to m/s²", {})
            self.time_tells = self.studio.tell_at("record", "times", "times")
            self.value_tells = self.studio.tell_at("record", "value", "values")
            self.own = ui.expansion("Differs in this record").classes("w-full")
            with self.own, pair():
                self.studio.number("record", "length", "Length of the beam", LENGTHS)
                self.studio.number("record", "x_S", "Sensor at", LENGTHS)

    def window_panel(self) -> None:
        """Build the fields of the window."""
        self.window = panel("Window of the fit")
        with self.window:
            self.advice = ui.label("").classes("lead")
            self.ends = {}
            for kind, unit in (("time", "s"), ("frf", "Hz")):
                with ui.element("div").classes("pair") as box:
                    fields = [self.studio.number("record", key, label, {unit: "1"})
                              for key, label in zip(WINDOWS[kind], ("From", "To"))]
                for field in fields:
                    field.changed = lambda: self.studio.changed(window=True)
                self.ends[kind] = (box, fields)
            self.proposal = ui.element("div").classes("w-full")

    def views_panel(self) -> None:
        """Build the figures."""
        self.empty = ui.label("The record appears here: its samples, their spectrum, and the "
                              "natural frequencies of the beam.").classes("empty")
        self.shown = ui.element("div").classes("views")
        with self.shown:
            with ui.element("div").classes("bar"):
                self.title = ui.label("Record").classes("title")
                self.mode = ui.toggle({"select": "Set window", "zoom": "Zoom"}, value="select",
                                      on_change=self.draw).props("dense no-caps unelevated "
                                                                 "padding='2px 12px'")
                self.all = ui.button("Show all", on_click=lambda: self.zoom(None)).props(
                    "flat dense no-caps data-go=all")
            self.chart = self.studio.chart()
            self.chart.on("plotly_selected", self.selected, js_handler="""(event) => emit(
                event && event.range && (event.range.x || event.range.x2))""")
            self.chart.on("plotly_relayout", self.relayout, js_handler="""(event) => {
                const axis = ["xaxis", "xaxis2"].find((one) => one + ".range[0]" in event);
                if (axis) emit([event[axis + ".range[0]"], event[axis + ".range[1]"]]);
                else if (event["xaxis.autorange"]) emit(null); }""")
            self.heading = ui.label("Spectrum of the window; dashed: natural frequencies of the "
                                    "beam as it is described now").classes("title")
            self.spectrum = self.studio.chart()
            with ui.expansion("Spectrogram of the window", on_value_change=self.draw).classes(
                    "w-full") as self.more:
                self.spectrogram = self.studio.chart()

    # -- events

    def edit(self, place: int) -> None:
        """Edit another record."""
        self.session.case.chosen = place
        self.studio.show_record()

    def remove(self) -> None:
        """Remove the record that is edited."""
        self.session.remove_record()
        self.studio.show_record()

    def choose(self) -> None:
        """Take another column as the record."""
        if self.muted or self.session.record.recording is None or self.channel.value is None:
            return
        self.session.choose(int(self.channel.value))
        self.studio.show_record()

    def set_quantity(self) -> None:
        """Take what a frequency response measures."""
        if not self.muted:
            self.session.case.set("record", "quantity", quoted(self.quantity.value))
            self.studio.changed()

    def set_unit(self) -> None:
        """Take the unit of the record as the factor of the case."""
        if self.muted:
            return
        self.unstated.set_visibility(False)
        self.session.record.is_unit_chosen = True
        factor = ACCELERATIONS.get(self.unit.value, "")
        if factor:
            self.session.case.set("record", "scale", factor if factor != "1" else None)
            self.scale.write()
            self.studio.changed(window=True)
        self.show_scale()

    def show_scale(self) -> None:
        """Show the factor where the unit is none of the list."""
        kind = self.session.record.kind
        self.scale.input.set_visibility(kind == "frf" or (kind == "time" and (
            self.unit.value == "other" or not in_si(self.session.case))))

    def set_time_unit(self) -> None:
        """Count the times of the file in another unit; the window keeps its samples."""
        record = self.session.record
        if self.muted or record.recording is None:
            return
        old, new = record.recording.time_unit, self.time_unit.value
        self.session.renew_record()
        record.recording.time_unit = new
        record.load()
        for key in WINDOWS["time"]:
            raw = record.get(key)
            in_old = number_text(raw, TIME_UNITS[old], divide=True) if raw else None
            self.session.case.set("record", key, in_old and number_text(in_old, TIME_UNITS[new]))
        self.view = None
        self.facts_now()
        self.studio.refresh_fields()
        self.studio.changed(record=True)

    def set_rate(self) -> None:
        """Take the sampling rate of a file without times."""
        record = self.session.record
        if self.muted or record.recording is None:
            return
        text = number_text(str(self.rate.value or ""))
        if text is None or float(text) <= 0:
            return
        self.session.renew_record()
        record.rate = text
        record.load()
        self.view = None
        self.facts_now()
        self.studio.changed(record=True)

    def selected(self, event: Any) -> None:
        """Take the window that was dragged."""
        if event.args:
            low, high = sorted(float(end) for end in event.args)
            t = self.session.record.t
            self.set_window(None if low <= t[0] else low, None if high >= t[-1] else high)

    def set_window(self, low: float | None, high: float | None) -> None:
        """Limit the record to times that are rounded to the digits that the samples have."""
        record = self.session.record
        for key, value in zip(WINDOWS[record.kind], (low, high)):
            self.session.case.set("record", key, None if value is None else
                                  number_text(f"{value:.{self.decimals()}f}"))
        if low is None:
            record.onset = None
        for field in self.ends[record.kind][1]:
            field.write()
        self.studio.changed(window=True)

    def decimals(self) -> int:
        """Return how many decimals of a time tell samples apart."""
        t = self.session.record.t
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
        """Show the columns and units of another record."""
        record, case = self.session.record, self.session.case
        recording, kind = record.recording, record.kind
        self.muted = True
        there = bool(record.t.size)
        self.show_list()
        several = len(self.session.records) > 1
        choice = bool(recording and (kind == "time" or len(recording.channels) > 1))
        self.columns.set_visibility(there and (kind != "modes" or choice or several))
        self.window.set_visibility(there and kind != "modes")
        self.whole.set_visibility(there and kind != "modes")
        self.next.set_visibility(there)
        self.view = None
        if recording:
            self.channel.set_options({k: name for k, (name, _) in enumerate(recording.channels)},
                                     value=recording.chosen)
            self.time_unit.value = recording.time_unit
            self.rate.value = record.rate
        self.channel.props(f'label="{NAMES[kind]}"')
        self.channel.set_visibility(choice)
        # The reader has converted times whose unit the file states, unless these are seconds.
        self.time_unit.set_visibility(bool(recording and recording.has_times
                                           and not recording.is_converted))
        self.rate.set_visibility(bool(recording and not recording.has_times))
        self.of_time.set_visibility(kind == "time")
        self.of_frf.set_visibility(kind == "frf")
        self.quantity.value = record.get("quantity").lower() or QUANTITIES[0]
        factor = number_text(record.get("scale") or "1") or "1"
        unit = BY_FACTOR.get(factor, "other")
        is_unstated = bool(recording and kind == "time" and not recording.unit)
        if is_unstated and factor == "1":
            unit = "m/s²"
        self.unit.value = unit
        self.unstated.set_visibility(is_unstated and not record.is_unit_chosen)
        self.unit.set_visibility(in_si(case))
        self.scale.input.props(f'label="{SCALES[kind]}"')
        self.scale.write()
        self.show_scale()
        self.own.set_visibility(several)
        for name, (box, _) in self.ends.items():
            box.set_visibility(name == kind)
        self.advice.text = ADVICE[kind]
        for part in (self.mode, self.all):
            part.set_visibility(kind != "modes")
        self.title.text = TITLES[kind]
        self.muted = False
        self.facts_now()

    def facts_now(self) -> None:
        """Show sampling, missing samples, and what the reader has remarked."""
        record = self.session.record
        recording, t = record.recording, record.t
        self.facts.clear()
        if not t.size:
            return
        rows = [("File", record.name)]
        if record.kind == "modes":
            rows.append(("Modes", f"{t.size}, {t.min():.6g} to {t.max():.6g} Hz"))
        elif record.kind == "frf":
            rows.append(("Lines", f"{t.size:,}, {t[0]:.6g} to {t[-1]:.6g} Hz"))
            if recording:
                rows.append(("Unit", recording.channel.unit or "none stated"))
        else:
            steps = np.diff(t[:200_000])
            step = float(np.median(steps)) if steps.size else 1.0
            uneven = bool(steps.size and np.ptp(steps) > 0.01 * abs(step))
            rows += [("Samples", f"{t.size:,}"
                      + f", {record.missing:,} missing ones left out" * bool(record.missing)),
                     ("Times", f"{t[0]:.6g} to {t[-1]:.6g} s"),
                     ("Sampling", f"{1 / step:.5g} per second" + ", uneven" * uneven
                      if step > 0 else "")]
        if recording and recording.channel.notes:
            rows.append(("Read as", "; ".join(recording.channel.notes)[:200]))
        if recording and recording.remarks:
            rows.append(("Left out", "; ".join(recording.remarks)[:200]))
        with self.facts:
            for name, text in rows:
                ui.label(name)
                ui.label(text)

    def draw(self) -> None:
        """Redraw everything that follows the input."""
        record = self.session.record
        there, in_time = record.is_ready, record.kind == "time"
        self.empty.set_visibility(not there)
        self.shown.set_visibility(there)
        self.draw_record()
        self.show_window()
        self.heading.set_visibility(in_time)
        self.more.set_visibility(in_time)
        self.studio.draw_spectrum(self.spectrum)
        self.propose()
        if there and in_time and self.more.value:
            modes = self.session.found.frequencies[:8]
            key = (record.version, record.window, record.scale, tuple(modes))
            self.studio.follow_figure(self.spectrogram, key, lambda: views.spectrogram(
                self.studio.window_samples(), modes))

    def show_window(self) -> None:
        """Show the ends of the window in fields that the user has left empty."""
        record = self.session.record
        if record.kind in self.ends and record.t.size:
            for field, end in zip(self.ends[record.kind][1], record.window):
                field.input.props(f'stack-label placeholder="{end:.6g}"')

    def draw_record(self) -> None:
        """Redraw the record and its window."""
        record = self.session.record
        if not record.is_ready or self.studio.draw_frequencies(self.chart, self.view,
                                                               self.mode.value):
            return
        label = record.recording.channel.name if record.recording else "record"
        unit = self.unit.value if self.unit.value in BY_FACTOR.values() else ""
        key = (record.version, record.window, self.view, self.mode.value, unit)
        self.studio.follow_figure(self.chart, key, lambda: views.record(
            record.t, record.z, record.window, label=label, unit=unit, view=self.view,
            mode=self.mode.value))

    def propose(self) -> None:
        """Say where the program sees the motion begin."""
        onset = self.session.record.onset
        self.proposal.clear()
        if onset is None or self.session.record.get("t_first"):
            return
        with self.proposal, ui.element("div").classes("tell note"):
            ui.label(f"The motion begins at {onset:.6g} s. The fit starts there, unless you set "
                     "another time.").classes("inline")


def build(studio: Any, onwards: Callable[[], None]) -> None:
    """Build the step of the record."""
    RecordStep(studio, onwards)
