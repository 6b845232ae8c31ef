"""The last step: what is worth keeping, and how to repeat it without the page."""
from __future__ import annotations

import asyncio
import zipfile
from pathlib import Path
from typing import Any

import cases
import page as h
from nicegui import ui

from beamid_studio import differences
from beamid_studio.session import Session
from beamid_studio.widgets import panel

COMMANDS = """beamid identify case.nml
beamid report out/case"""
SNIPPET = """import beamid

fit = beamid.load("case.nml").fit()
print(fit.summary())
for name, estimate in fit.estimates.items():
    print(name, estimate.value, estimate.interval, estimate.unit)"""


def pack(session: Session) -> Path:
    """Write the case as it stands, and an archive of it with the tables that it names."""
    assert session.folder is not None
    (session.folder / "case.nml").write_text(session.case_text(), encoding="utf-8")
    path = session.folder / "case.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
        named = {cases.unquoted(keys["file"]) for _, keys in session.case.groups if "file" in keys}
        for file in ("case.nml", *sorted(named)):
            archive.write(session.folder / file, f"{session.folder.name}/{file}")
    return path


def build(studio: Any) -> None:
    """Build the step of saving."""
    session = studio.session

    async def download() -> None:
        if session.lacking:
            ui.notify(session.lacking, type="warning")
            return
        await studio.write_records()
        path = await asyncio.to_thread(pack, session)
        ui.download.file(path, f"{session.folder.name}.zip")

    async def report() -> None:
        if session.latest is None:
            ui.notify("Run a fit first.", type="warning")
            return
        await studio.results.download_report(session.latest)

    def code(text: str, name: str) -> None:
        with ui.element("div").classes("field"):
            ui.html(h.preformatted(text).replace("<pre>", '<pre class="code">'), sanitize=False)
            ui.button("Copy", on_click=lambda: ui.clipboard.write(text)).props(
                f"flat dense no-caps size=sm data-go=copy-{name}").classes("self-start")

    with ui.element("div").classes("step even"):
        with ui.element("div").classes("inputs"):
            with panel("Download", "The case file and its records, as an archive; and the report "
                       "of the last fit, a page that needs no network."):
                with ui.row().classes("gap-2"):
                    ui.button("Case with its records", on_click=download).props(
                        "unelevated dense no-caps padding='xs md' data-go=case")
                    of_fit = ui.button("Report", on_click=report).props(
                        "outline dense no-caps padding='xs md' data-go=last-report")
                differs = ui.label("").classes("tell").props("data-field=differs")
                where = ui.label("").classes("lead")
            with panel("Repeat on the command line", "In the folder of the case:"):
                code(COMMANDS, "commands")
            with panel("Repeat in Python"):
                code(SNIPPET, "snippet")
        with ui.element("div").classes("views"):
            ui.label("Case file").classes("title")
            refused = ui.column().classes("w-full gap-1").props("data-field=refused")
            text = ui.html("", sanitize=False).classes("w-full").props("data-field=case")

    def draw() -> None:
        text.set_content(h.preformatted(session.case_text()).replace("<pre>",
                                                                     '<pre class="code">'))
        latest = session.latest
        of_fit.text = f"Report of {latest.name}" if latest else "Report"
        changed = differences.sentence(studio, latest) if latest else ""
        differs.text = changed and (f"The report is of {latest.name}, whose inputs are not those "
                                    f"of the case: {changed}. Run the fit again for a report of "
                                    "the case.")
        differs.set_visibility(bool(changed))
        refused.clear()
        errors = [remark for remark in session.found.remarks if remark.kind == "error"]
        if not errors and session.results and session.results[-1].is_refused and not (
                session.changes(session.results[-1])):
            errors = session.results[-1].remarks
        with refused:
            for remark in errors:
                ui.label(f"The program refuses this case. {studio.located(remark)}").classes(
                    "tell error")
        where.text = f"Everything is also in {session.folder}." if session.folder else ""

    studio.redraws["save"] = draw
    draw()
