"""The command `beamid` of the Python package.

`beamid report`, `beamid plot KIND` and `beamid to-csv` run a script of the package, and `beamid
studio` its page in the browser. Every other command runs the program of the package, which shares
its library with the module `beamid`. This module imports neither numpy nor `beamid`, so that the
program starts at once.
"""
from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent / "beamid"
PROGRAM = PACKAGE / "lib" / "beamid"
# An editable installation uses the scripts of its checkout.
SCRIPTS = PACKAGE / "scripts"
if not SCRIPTS.exists():
    SCRIPTS = PACKAGE.parents[1] / "scripts"

HELP = """
Commands of the Python package:
  report [DIR]              write DIR/report.html, a page about a fit
  plot KIND DIR|case.nml    draw a picture; 'beamid plot' lists the kinds
  to-csv FILE               convert a recorder's file to columns
  studio [FILE]             open a page that leads from a record to a report
"""


def kinds() -> list[str]:
    """Returns the kinds of pictures: KIND of each plot_KIND.py that is a script."""
    return sorted(path.stem[len("plot_"):] for path in SCRIPTS.glob("plot_*.py")
                  if "__main__" in path.read_text(encoding="utf-8"))


def run(*command: str | Path) -> int:
    """Replaces this process by a command, so that signals and the exit status are the command's.

    Returns the exit status where a process cannot be replaced (Windows).
    """
    words = [str(word) for word in command]
    sys.stdout.flush()
    if os.name == "posix":
        os.execv(words[0], words)
    return subprocess.run(words).returncode


def run_script(name: str, called: str, *arguments: str) -> int:
    """Runs a script, and tells it which program to use.

    name, called  name of the script, and the words by which the user has called it, for its help
    """
    os.environ.setdefault("BEAMID_PROGRAM", str(PROGRAM))
    os.environ["BEAMID_COMMAND"] = f"beamid {called}"
    return run(sys.executable, SCRIPTS / f"{name}.py", *arguments)


def plot(words: list[str]) -> int:
    """Runs the script that draws a kind of picture.

    words  words behind `plot`: the kind, and the arguments of the script
    """
    kind = words[0] if words else ""
    if kind in kinds():
        return run_script(f"plot_{kind}", f"plot {kind}", *words[1:])
    text = f"expected one of {', '.join(kinds())}; 'beamid plot KIND --help' says more"
    if kind in ("--help", "-h"):
        print(f"beamid plot: {text}")
        return 0
    print(f"beamid plot: found {kind or 'no kind'}, {text}", file=sys.stderr)
    return 2


def main() -> int:
    """Runs the command in `sys.argv`, and returns the exit status."""
    if os.name == "posix":
        # `beamid help | head` ends without a traceback.
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    words = sys.argv[1:]
    if len(words) > 1 and words[0] == "help" and words[1] in ("report", "plot", "to-csv",
                                                              "studio"):
        words = [*words[1:], "--help"]
    if words[:1] == ["report"]:
        return run_script("report", "report", *words[1:])
    if words[:1] == ["plot"]:
        return plot(words[1:])
    if words[:1] == ["to-csv"]:
        return run_script("to_csv", "to-csv", *words[1:])
    if words[:1] == ["studio"]:
        return run(sys.executable, "-m", "beamid_studio", *words[1:])
    if not PROGRAM.exists():
        print(f"beamid: found no program {PROGRAM}; install the package again", file=sys.stderr)
        return 1
    if words in (["help"], ["--help"], ["-h"]):
        status = subprocess.run([PROGRAM, *words]).returncode
        print(HELP, end="")
        return status
    return run(PROGRAM, *words)


if __name__ == "__main__":
    sys.exit(main())
