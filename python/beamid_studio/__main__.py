"""The command line of `beamid studio`."""
from __future__ import annotations

import argparse
import os
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import beamid_command

# The readers, the figures and the report are scripts of the package.
sys.path.insert(0, str(beamid_command.SCRIPTS))
os.environ.setdefault("BEAMID_PROGRAM", str(beamid_command.PROGRAM))

from program import fail, new_parser, pip_install

#: What the page needs beside NumPy: the extra `studio` of the package installs it.
NEEDED = ("nicegui", "plotly", "matplotlib")
MEGABYTE = 10**6


def command_line() -> argparse.Namespace:
    """Return the arguments of the command line, checked."""
    parser = new_parser("Opens a page in the browser that leads from a recorder's file to a fit "
                        "and its report. The page is served to this machine only, and ends with "
                        "its last tab or with Ctrl-C.", prog="beamid studio")
    parser.add_argument("file", metavar="FILE", nargs="?", help="a recorder's file, a case file, "
                        "or the output folder of a fit")
    parser.add_argument("--out", metavar="DIR", default="out/studio",
                        help="folder below which everything is written (default: out/studio)")
    parser.add_argument("--port", metavar="N", type=int, default=0,
                        help="port of the page (default: a free one)")
    parser.add_argument("--limit", metavar="MB", type=int, default=500,
                        help="largest file that the page accepts (default: 500)")
    parser.add_argument("--no-browser", action="store_true",
                        help="only prints the address of the page")
    parser.add_argument("--stay", action="store_true",
                        help="continues after the last tab is closed")
    return parser.parse_args()


def main() -> int:
    """Start the page, and return when it has ended."""
    arguments = command_line()
    missing = [name for name in NEEDED if not find_spec(name)]
    if missing:
        fail(f"found no {' and no '.join(missing)}; install what the page needs by "
             f"{pip_install('beamid[studio]')}, or in a checkout by scripts/setup.sh studio", 1)
    file = Path(arguments.file).resolve() if arguments.file else None
    if file and not file.exists():
        fail(f"{arguments.file}: no such file or folder")
    if not 0 <= arguments.port < 65536 or arguments.limit < 1:
        fail(f"found --port {arguments.port} --limit {arguments.limit}, expected a port up to "
             "65535 and a limit of 1 MB or more")
    folder = Path(arguments.out).resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scratch = tempfile.TemporaryDirectory(prefix=".studio-", dir=folder)
    except OSError as error:
        fail(f"{folder}: {error.strerror}")
    with scratch:
        # Uploads on their way and pictures of fonts are written below the folder, too.
        tempfile.tempdir = scratch.name
        os.environ["TMPDIR"] = os.environ["MPLCONFIGDIR"] = scratch.name
        os.environ["NICEGUI_STORAGE_PATH"] = str(Path(scratch.name, "storage"))
        from beamid_studio import server
        return server.serve(server.Settings(
            file, folder, arguments.port, arguments.limit * MEGABYTE, not arguments.no_browser,
            arguments.stay))


if __name__ == "__main__":
    sys.exit(main())
