"""Runs of the program: one at a time for each tab, with progress, and cancelled by Ctrl-C."""
from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

#: Seconds that the program gets to end after it has been told to.
GRACE = 3.0
ALL: set[Run] = set()    #: runs that have not ended


@dataclass(eq=False)
class Run:
    """One command of the program on one case."""

    command: str
    case: Path
    out: Path
    heard: Callable[[str], None]       #: hears each line of the progress
    cancelled: bool = False
    status: int = -1
    lines: list[str] = field(default_factory=list)

    async def go(self) -> int:
        """Run the command to its end; return its exit status, -2 if it was cancelled."""
        if self.cancelled:
            return -2
        ALL.add(self)
        self.process = await asyncio.create_subprocess_exec(
            os.environ["BEAMID_PROGRAM"], self.command, self.case.name, "--out", self.out,
            cwd=self.case.parent, stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
            start_new_session=True)
        try:
            if self.was_cancelled():    # while the process was being started
                self.signal(signal.SIGINT)
            assert self.process.stderr is not None
            async for line in self.process.stderr:
                text = line.decode("utf-8", "replace").strip()
                self.lines = [*self.lines[-20:], text]
                self.heard(text)
            self.status = await self.process.wait()
        finally:
            if self.process.returncode is None:
                self.signal(signal.SIGKILL)
                await asyncio.shield(self.process.wait())
            ALL.discard(self)
        return -2 if self.cancelled else self.status

    def was_cancelled(self) -> bool:
        """Return whether the user has cancelled the run, perhaps while it was being started."""
        return self.cancelled

    def signal(self, number: int) -> None:
        """Send a signal to the program."""
        with contextlib.suppress(ProcessLookupError, AttributeError):
            self.process.send_signal(number)

    async def cancel(self) -> None:
        """End the program: it hears Ctrl-C first, and is killed if it does not listen."""
        self.cancelled = True
        self.signal(signal.SIGINT)
        for _ in range(int(GRACE / 0.05)):
            if self not in ALL:
                return
            await asyncio.sleep(0.05)
        self.signal(signal.SIGKILL)

    def kill(self) -> None:
        """End the program at once."""
        self.cancelled = True
        self.signal(signal.SIGKILL)

    @property
    def error(self) -> str:
        """The lines of the program that say what is wrong."""
        said = [line for line in self.lines if line.startswith("beamid:")]
        return "\n".join(said or self.lines[-1:])


def progress_text(line: str) -> str:
    """Return a line of the program's progress as a short sentence."""
    match = re.match(r"(.*?): iteration (\d+), (\d+) evaluations, J = ([^,]+)", line)
    if match:
        where = match[1].replace("N = ", "mesh of ").replace(", stage", " elements, stage")
        where += " elements" if where.split()[-1].isdigit() and "stage" not in where else ""
        return f"{where}: iteration {match[2]}, J = {match[4]}"
    return line[:120]
