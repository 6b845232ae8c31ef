#!/usr/bin/env python3
"""Runs `beamid ensemble` by several workers, on one machine or on many that share a file system:
Open MPI starts them and a manager, who hands out parts of the members (mpi4py.futures). What was
done stays when a worker dies: run it again and it goes on."""

import os
import re
import shutil
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
                          text=True, env={**os.environ, "OMP_NUM_THREADS": "1",
                                          "OPENBLAS_NUM_THREADS": "1"})
    return done.returncode, done.stdout, done.stderr


def end(status, out, err):
    """Ends the script as the program has ended."""
    sys.stdout.write(out)
    sys.stderr.write(err)
    sys.exit(status)


def manage(workers, members, command):
    """Hands out all members, in parts."""
    from mpi4py.futures import MPIPoolExecutor
    size = max(1, min(LARGEST, members // (PARTS * workers)))
    with MPIPoolExecutor() as pool:
        parts = [pool.submit(run_part, command, first, min(first + size - 1, members))
                 for first in range(2, members + 1, size)]
        results = [part.result() for part in parts]
    failed = [result for result in results if result[0]]
    if failed:
        fail(f"{len(failed)} of {len(parts)} parts failed, run it again and it goes on: "
             f"{failed[0][2] or 'killed'}", 1)
    # Whoever was last has made the tables.
    end(*next(result for result in results if not WAITING.search(result[1])))


def launch(arguments, command):
    """Starts the workers and a manager, who needs no core of its own."""
    # The first member alone: a bad case is refused only once, and the program tells the number of
    # members.
    status, out, err = run_part(command, 1, 1)
    waiting = WAITING.search(out)
    if status or not waiting:
        end(status, out, err)
    python = next((path for path in (sys.executable, "/usr/bin/python3") if subprocess.run(
        [path, "-c", "import mpi4py.futures"], capture_output=True).returncode == 0), None)
    if not python or not shutil.which("mpiexec"):
        fail("no mpiexec or no Python with mpi4py, expected both, as by scripts/setup.sh mpi", 1)
    environment = dict(os.environ)
    if os.geteuid() == 0:
        # Open MPI wants to hear twice that root is meant, as in a container.
        environment.update(OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
    sys.exit(subprocess.run(
        ["mpiexec", "-n", f"{arguments.n + 1}", "--oversubscribe", *arguments.mpiexec.split(),
         python, "-m", "mpi4py.futures", __file__, "-n", f"{arguments.n}", "--members", waiting[1],
         *command], env=environment).returncode)


def main():
    parser = new_parser(__doc__)
    parser.add_argument("case", help="a case file with &ensemble")
    parser.add_argument("-n", type=int, required=True, metavar="RANKS", help="workers")
    parser.add_argument("--out", metavar="DIR", help="as of beamid ensemble")
    parser.add_argument("--only-new", action="store_true", help="as of beamid ensemble")
    parser.add_argument("--mpiexec", default="", metavar="OPTIONS",
                        help="of mpiexec, as '--hostfile machines'")
    if "--members" in sys.argv:
        # The manager: -n RANKS --members N PROGRAM ensemble ...
        manage(int(sys.argv[2]), int(sys.argv[4]), sys.argv[5:])
    arguments = parser.parse_args()
    if arguments.n < 1:
        fail(f"-n: found {arguments.n}, expected 1 or more")
    program = Path(os.environ.get("BEAMID_PROGRAM") or release()).resolve()
    launch(arguments, [str(program), "ensemble", arguments.case,
                       *(["--out", arguments.out] if arguments.out else []),
                       *(["--only-new"] if arguments.only_new else [])])


if __name__ == "__main__":
    main()
