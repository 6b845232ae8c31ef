"""What the scripts share: errors of one line, the command line, the environment, the program and
the CSV files that it writes."""

import argparse
import csv
import importlib
import math
import os
import shlex
import subprocess
import sys
import zlib
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
PYTHON = CHECKOUT / ".venv" / "bin" / "python"
# What runs the program: set-up and build come first, or install.sh has put it beside the scripts;
# tests bring one of their own.
IN_CHECKOUT = (CHECKOUT / "fpm.toml").exists()
PROGRAM = Path(os.environ.get("BEAMID_PROGRAM") or
               (CHECKOUT / "scripts" / "run.sh" if IN_CHECKOUT else
                CHECKOUT.parent.parent / "bin" / "beamid"))


def tell(message):
    """One line on standard error."""
    line = str(message).replace("\n", " ")
    print(f"{Path(sys.argv[0]).stem}: {line}", file=sys.stderr, flush=True)


class Failure(SystemExit):
    """The end of a script, with the line that it has printed."""

    def __init__(self, message, status):
        super().__init__(status)
        self.message = str(message)


def fail(message, status=2):
    """Ends the script with one line on standard error."""
    tell(message)
    raise Failure(message, status)


def need(*modules):
    """Restarts the calling script with the checkout's Python when one of the modules is missing,
    which set-up installs there."""
    try:
        for module in modules:
            importlib.import_module(module)
    except ImportError as missing:
        if not IN_CHECKOUT:
            if {"-h", "--help"} & set(sys.argv[1:]):
                print(sys.modules["__main__"].__doc__)
            if "matplotlib" in modules or "plotly" in modules:
                modules = "numpy", "matplotlib", "plotly"
            fail(f"no module {missing.name}; install what is missing by {pip_install(*modules)}", 1)
        wanted = ["packages", *modules] if "scipy" in modules else ["pictures"]
        if Path(sys.prefix).resolve() == PYTHON.parent.parent.resolve():
            fail(f"no module {missing.name} in .venv; run scripts/setup.sh {' '.join(wanted)}", 1)
        if subprocess.run([CHECKOUT / "scripts" / "setup.sh", *wanted]).returncode:
            raise SystemExit(1) from None
        os.execv(PYTHON, [str(PYTHON), *sys.argv])


def pip_install(*packages):
    """The command that adds packages to the Python that runs the script."""
    return shlex.join([sys.executable, "-m", "pip", "install", *packages])


def new_parser(description, **options):
    """A command line; what it does not understand is one line and exit status 2. The command
    `beamid` of the Python package says by BEAMID_COMMAND how the user has called the script."""
    options.setdefault("prog", os.environ.get("BEAMID_COMMAND"))
    parser = argparse.ArgumentParser(description=description, allow_abbrev=False, **options)
    parser.error = fail
    return parser


def output_of(*command):
    """Standard output of a command run in the checkout; its failure is the script's."""
    done = subprocess.run(command, capture_output=True, text=True, cwd=CHECKOUT)
    if done.returncode:
        sys.stderr.write(done.stderr)
        fail(f"{Path(command[0]).name}: exit status {done.returncode}", 1)
    return done.stdout.strip()


def run(*arguments):
    """Sets up and builds what is missing, then runs the program; its output goes nowhere."""
    if subprocess.run([PROGRAM, *arguments], stdout=subprocess.DEVNULL).returncode:
        fail(f"{PROGRAM.name} {arguments[0]} failed", 1)


def release(target="beamid"):
    """An executable of the release build, made if need be: the program or '--example NAME'."""
    run("version")
    if not IN_CHECKOUT:
        return PROGRAM
    listed = output_of("bash", "-c", "checkout=$PWD; . scripts/fpm.sh && find_fpm && "
                       f"paths release run {target}")
    return CHECKOUT / listed.splitlines()[-1]


def reason(error):
    """What went wrong, without the file's name."""
    return getattr(error, "strerror", None) or error


def outputs(path):
    """A folder that holds the outputs of runs that ended, as its manifest says."""
    directory = Path(path)
    if not directory.is_dir():
        fail(f"{directory}: no such folder")
    if not (directory / "manifest.txt").exists():
        fail(f"{directory}: no manifest.txt, as after a run that was interrupted; repeat the run")
    header, *lines = read_text(directory / "manifest.txt").splitlines() or [""]
    if header != "name bytes crc32 command":
        fail(f"{directory / 'manifest.txt'}: found '{header[:40]}', expected a manifest of beamid")
    for line in lines:
        name, *size_and_checksum = line.rsplit(" ", 3)[:3]
        if size_and_checksum != list(size_and_crc32(directory / name)):
            fail(f"{directory / name}: not as manifest.txt has it: the file was changed, "
                 "or is from another run; repeat the run")
    return directory


def size_and_crc32(path):
    """Size and checksum of a file as a manifest has them."""
    size = checksum = 0
    try:
        with open(path, "rb") as file:
            while piece := file.read(1 << 20):
                size += len(piece)
                checksum = zlib.crc32(piece, checksum)
    except OSError as error:
        fail(f"{path}: {reason(error)}")
    return f"{size}", f"{checksum:08x}"


def read_text(path):
    """The text of a file."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        fail(f"{path}: {reason(error)}")


def write_text(path, text):
    """Writes a file, into a folder that is made if need be."""
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        fail(f"{path}: {reason(error)}")


def has_rows(path):
    """Tells whether a table has anything below its header."""
    return path.exists() and len(read_text(path).splitlines()) > 1


def read_table(path, *columns):
    """The rows of a CSV file as dictionaries of text; each of `columns` must be in the header."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            header = reader.fieldnames or ["none"]
            rows = [{**row, "": f"{path}:{reader.line_num}"} for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        fail(f"{path}: {reason(error)}")
    for column in columns:
        if column not in header:
            fail(f"{path}: no column '{column}' (found: {', '.join(header)})")
    if not rows:
        fail(f"{path}: no data")
    for row in rows:
        if any(row[column] is None for column in columns):
            fail(f"{row['']}: the row is shorter than the header")
    return rows


def number(row, column, kind=float):
    """A finite number of a row of read_table."""
    try:
        value = kind(row[column])
        if math.isfinite(value):
            return value
    except (TypeError, ValueError):
        pass
    fail(f"{row['']}: '{column}' is '{row[column] or ''}', expected a number")
