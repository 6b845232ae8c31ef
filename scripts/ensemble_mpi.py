#!/usr/bin/env python3
"""Runs `beamid ensemble` by several workers, on one machine or on many that share a file system:
Open MPI starts them and a manager, who hands out parts of the members (mpi4py.futures). What was
done stays when a worker dies: run it again and it goes on."""

import os
import re
import subprocess
import sys
from pathlib import Path

from program import fail, new_parser, release

LARGEST = 5000       # members of a part: its time is long beside the start of a program
PARTS = 16           # of each worker: short beside the whole, so that none waits for a slow one
# What a part says that is not the last one.
WAITING = re.compile(r"members \d+ to \d+ of (\d+) are done; the tables follow when all are")


def run_part(command, first, last):
    """Members first to last: exit status, standard output, messages."""
    done = subprocess.run([*command, "--quiet", "--only", f"{first}:{last}"], capture_output=True,
                          text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    return done.returncode, done.stdout, done.stderr


def manage(workers, command):
    """Hands out all members and ends with the status of the part that made the tables."""
    # The first member alone: a case that is refused is refused once, and who is left is told.
    status, out, err = run_part(command, 1, 1)
    waiting = WAITING.search(out)
    if status == 0 and waiting:
        from mpi4py.futures import MPIPoolExecutor
        members = int(waiting[1])
        size = max(1, min(LARGEST, members // (PARTS * workers)))
        firsts = range(2, members + 1, size)
        with MPIPoolExecutor() as pool:
            parts = [pool.submit(run_part, command, first, min(first + size - 1, members))
                     for first in firsts]
            results = [part.result() for part in parts]
        # Whoever was last has made the tables; two may have been.
        ended = [result for result in results if result[0] or not WAITING.search(result[1])]
        status, out, err = max(ended, default=(1, "", "some members are missing, run it again\n"))
    sys.stdout.write(out)
    sys.stderr.write(err)
    raise SystemExit(status)


def launch(arguments, options):
    """Starts the workers and a manager, who needs no core of its own."""
    python = next((path for path in (sys.executable, "/usr/bin/python3") if subprocess.run(
        [path, "-c", "import mpi4py.futures"], capture_output=True).returncode == 0), None)
    if not python:
        fail("no Python has mpi4py, expected it and Open MPI, as by scripts/setup.sh mpi", 1)
    program = Path(os.environ.get("BEAMID_PROGRAM") or release()).resolve()
    environment = {**os.environ, "BEAMID_PROGRAM": str(program)}
    if os.geteuid() == 0:
        # Open MPI wants to hear twice that root is meant, as in a container.
        environment.update(OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
    command = ["mpiexec", "-n", f"{arguments.n + 1}", "--oversubscribe", "-x", "BEAMID_PROGRAM",
               *arguments.mpiexec.split(), python, "-m", "mpi4py.futures", __file__, "-n",
               f"{arguments.n}", arguments.case, *options, "--manage"]
    try:
        raise SystemExit(subprocess.run(command, env=environment).returncode)
    except OSError as error:
        fail(f"mpiexec: {error.strerror}, expected Open MPI, as by scripts/setup.sh mpi", 1)


def main():
    parser = new_parser(__doc__)
    parser.add_argument("case", help="a case file with &ensemble")
    parser.add_argument("-n", type=int, required=True, metavar="RANKS", help="workers")
    parser.add_argument("--out", metavar="DIR", help="as of beamid ensemble")
    parser.add_argument("--only-new", action="store_true", help="as of beamid ensemble")
    parser.add_argument("--mpiexec", default="", metavar="OPTIONS",
                        help="of mpiexec, as '--hostfile machines'")
    parser.add_argument("--manage", action="store_true", help="(of the manager itself)")
    arguments = parser.parse_args()
    if arguments.n < 1:
        fail(f"-n: found {arguments.n}, expected 1 or more")
    options = ["--out", arguments.out] if arguments.out else []
    options += ["--only-new"] if arguments.only_new else []
    if arguments.manage:
        manage(arguments.n, [os.environ["BEAMID_PROGRAM"], "ensemble", arguments.case, *options])
    launch(arguments, options)


if __name__ == "__main__":
    main()
