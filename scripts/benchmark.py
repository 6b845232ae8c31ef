#!/usr/bin/env python3
"""Times beamid against SciPy, JAX and LAPACK in one run, one thread each, and prints the results as
Markdown. Parts, all of them by default:

  table         the fit of Table 4.1 against SciPy's expm and integrators and a jitted fit in JAX
  decay         the fit of a free decay against variable projection in SciPy, and one evaluation of
                it against LAPACK's QR and as many complex exponentials
  elements      the time of a fit of Table 4.1 against the number of elements
  samples       the time of one evaluation against the number of samples, and the memory
  posterior     effective samples a second of Table 4.1 with noise against emcee and NumPyro
  resamples     resampled records and draws of a free decay against SciPy and emcee
  instructions  of a fit and of an evaluation, counted by valgrind's callgrind

What is measured against is installed into build/peers, for this script alone.
"""
from __future__ import annotations

import argparse
import csv
import math
import os
import platform
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from program import CHECKOUT, PYTHON, fail, new_parser, output_of, release, tell

try:
    import peers
    import numpy as np
    import scipy
    HAS_PEERS = True
except ImportError:
    HAS_PEERS = False

PEERS = CHECKOUT / "build" / "peers"
CASE = CHECKOUT / "data" / "table_4_1_fit.nml"
RECORD = CHECKOUT / "data" / "table_4_1_record.csv"
NOISY = CHECKOUT / "data" / "table_4_1_noisy.nml"
PARTS = ("table", "decay", "response", "elements", "samples", "posterior", "resamples",
         "instructions")
NAMES = ("c_D", "m_H", "c_H", "k_H")    # free in Table 4.1

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
AT_MINIMUM = 1e-3      # J within this of the least one, relatively: the fit is at the minimum
SAME_MODEL = 1e-6      # J of beamid and of SciPy for the same parameters, relatively
SAME_MINIMUM = 1e-8    # J of both at their own estimates of the free decay, relatively

# A strip of aluminium with a sensor, of which a free decay is recorded; the search starts at START,
# in E, m_S, c_D and gamma.
DECAY = """&beam       length=0.5, rho=0.27, E={}, width=0.05, height=0.002, c_D={}, gamma={} /
&sensor     m_S={}, x_S=0.44 /
&excitation kind='free', modes=2 /
&discretization elements=8 /
&record     file='decay.csv' /
&stage      free='E','m_S','c_D','gamma','offset', start='case' /
"""
TRUTH, START = (6.8e10, 4e6, 0.08, 0.0045), (6.83e10, 5e6, 0.06, 0.0047)
AMPLITUDES, OFFSET, NOISE, SECONDS = (20 + 5j, 4 - 3j), 0.4, 0.07, 5.0    # m/s^2, s
SAMPLES, UNKNOWNS, LINEAR = 20000, 9, 5
RESAMPLED, RECORDS, DRAWS = 3900, 1000, 10000    # samples, resampled records, draws of a posterior
SIZES = (1000, 4000, SAMPLES, 100000, 300000, 10**6)
# A frequency response of the same strip, struck at the sensor, which stands at a node of the peer.
RESPONSE = """&beam       length=0.5, rho=0.27, E={}, width=0.05, height=0.002, c_D={}, gamma={} /
&sensor     m_S={}, x_S=0.4375 /
&discretization elements=16 /
&record     kind='frf', x_F=0.4375, {} /
"""
LINES, SAME_RESPONSE = 2000, 1e-3    # largest difference of two meshes of cubics, relatively
EXPONENTIALS, FLOOR = "two complex exponentials a sample", "QR and exponentials"

NOTES = """
Times are the processor's, of one thread, without start-up and without JAX' compilation: in each
round the median of repeated fits or evaluations, of the rounds the lowest; what is compared takes
turns in each round, and a ratio is the median of those within the rounds. Fits of more than a
second are done once.

- beamid: a fit includes the mesh (spline integrals, modes of the bare beam; not with "mesh apart"),
  full convergence (1e-10) and the statistics, but not the comparison of derivatives with
  differences, which the others do not make. `process` is the whole program, start to files.
- SciPy, table: `least_squares` alone, ftol = xtol = 1e-4, logarithms of the parameters, forward
  differences; what was fastest: 'lm' and step 1e-6 with expm, 'trf' and step 3 sqrt(rtol) with
  solve_ivp, which has the analytic Jacobian of the equations of motion; rtol: of 1e-4, 1e-6, 1e-8,
  1e-10 the fastest whose J is within 0.001 of the least.
- JAX: `jax.scipy.linalg.expm` in double precision, Jacobian by jacfwd, Levenberg and Marquardt's
  search with the same tolerances, compiled as a whole.
- expm, stepped: one for the pulse, one for 0.1 s, then step by step (JAX: lax.scan); doubled: one
  for both, repeated squaring (JAX: in the modes at the start, which saves squarings).
- All: four Gauss points per element, exact for cubic splines. J is the sum of squares at the
  estimates of the row, by the exact response.
- Free decay: beamid looks for E, m_S, c_D and gamma of a beam, by its poles and the derivative of
  Golub and Pereyra, with statistics. One of its evaluations gives what a search needs, condensed
  rows with the same J, J'J and J'r; "all rows" follow once, after the search.
  SciPy looks for two frequencies and two dampings, with Kaufman's Jacobian and SciPy's own
  tolerances (1e-8), without statistics. Both eliminate two amplitudes, two phases and the offset,
  start at the same motion and must reach the same J: one model, in two sets of four parameters.
- Frequency response: the accelerance of the strip at its sensor, and its derivatives by four
  parameters; NumPy: 16 Hermite elements, one `numpy.linalg.solve` for each line.
- Posterior: four parameters, every value above 0 as likely as any other beforehand, the noise
  integrated out. beamid: the process from start to files, with the fit, its verdict, profiles and
  modes of the draws. emcee (32 walkers that stretch, 4000 steps without the first 500) and NumPyro
  (NUTS, a dense mass matrix, 1000 draws of warm-up and 4000 more) walk from the estimate, with JAX'
  expm, doubled, compiled beforehand. Effective samples: NumPyro's estimate for all, of the
  parameter that has the fewest; of beamid at most what its weights are worth.
- Resamples: the free decay with fewer samples. beamid: the processes from start to files, with the
  fit. SciPy: the fits of 20 records, times 50, each from the estimates of the record itself. emcee:
  32 walkers that stretch over the same four parameters, amplitudes, offset and noise integrated
  out, 300 steps without the first 100, for as many effective draws as beamid's.
- QR: LAPACK's dgeqrf of samples x 9, the number of unknowns (or x 5, of the linear ones): Netlib's
  where Debian has it (liblapack3), and SciPy's OpenBLAS. The floor is Netlib's QR of samples x 9
  and two complex exponentials (NumPy) for each sample."""


def restart_with_peers():
    """Restarts this script with an environment of its own; JAX may be missing there."""
    python = PEERS / "bin" / "python"
    if subprocess.run([CHECKOUT / "scripts" / "setup.sh", "pictures"],
                      stdout=sys.stderr).returncode:
        fail("setup.sh failed", 1)
    if not python.exists():
        subprocess.run([PYTHON, "-m", "venv", PEERS], stdout=sys.stderr)
    for packages in (["numpy", "scipy", "matplotlib"], ["jax"], ["emcee", "numpyro"]):
        works = [python, "-c", "import " + ", ".join(packages)]
        if subprocess.run(works, stderr=subprocess.DEVNULL).returncode:
            tell(f"installing {', '.join(packages)} into {PEERS.relative_to(CHECKOUT)}")
            subprocess.run([python, "-m", "pip", "-q", "--disable-pip-version-check", "install",
                            *packages], stdout=sys.stderr)
            if subprocess.run(works, stderr=subprocess.DEVNULL).returncode:
                if "numpy" in packages:
                    fail(f"could not install {', '.join(packages)} into {PEERS}", 1)
                tell(f"{', '.join(packages)} cannot be installed: what needs them is left out")
    os.execv(python, [str(python), *sys.argv])


def machine(version):
    """One line: processor and versions."""
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    compiler = output_of("gfortran", "-dumpfullversion")
    jax = f"JAX {peers.jax.__version__}" if peers.jax else "no JAX"
    return (f"{os.cpu_count()} cores, {model[1] if model else platform.machine()}, load "
            f"{os.getloadavg()[0]:.1f}; {version}, gfortran {compiler}; "
            f"Python {platform.python_version()}, NumPy {np.__version__}, SciPy "
            f"{scipy.__version__}, {jax}")


def table(header, rows):
    """Prints a table in Markdown, its columns aligned."""
    cells = [[str(cell) for cell in row] for row in (header, *rows)]
    widths = [max(2, *map(len, column)) for column in zip(*cells)]
    cells.insert(1, ["-" * (width - (k > 0)) + ":" * (k > 0) for k, width in enumerate(widths)])
    print()
    for row in cells:
        print("| " + " | ".join(cell.rjust(width) if k else cell.ljust(width)
                                for k, (cell, width) in enumerate(zip(row, widths))) + " |")
    sys.stdout.flush()


def ms(seconds):
    """Milliseconds with three digits."""
    return f"{1000 * seconds:.3g}" if seconds < 1 else f"{1000 * seconds:.0f}"


def times(ratio):
    """A ratio with as many digits as say something."""
    return f"{ratio:.{0 if ratio >= 100 else 1 if ratio >= 2 else 2}f}"


@dataclass
class Effort:
    """How much is repeated: --quick or not."""

    rounds: int = 7
    seconds: float = 0.3        # of one competitor in one round
    largest: int = 10**6        # number of samples
    meshes: tuple = (4, 8, 16, 32, 64)
    slow: bool = True           # integrators


def repeat(call, seconds, prepare=None):
    """Median of the processor's time of a call that is repeated for so long; what `prepare` gives
    is handed to the call, and its time does not count."""
    spent = []
    while sum(spent) < seconds and len(spent) < 301:
        arguments = (prepare(),) if prepare else ()
        begin = time.process_time()
        call(*arguments)
        spent.append(time.process_time() - begin)
    return float(np.median(spent))


def in_turns(competitors, effort):
    """The times of every round for each of some functions of how long they may take."""
    spent = {name: [] for name in competitors}
    for _ in range(effort.rounds):
        for name, run in competitors.items():
            spent[name].append(run(effort.seconds))
    return spent


def ratio(spent, name, reference):
    """Median of the ratios within the rounds."""
    return float(np.median(np.divide(spent[name], spent[reference])))


@dataclass
class Row:
    """One line of the table."""

    method: str
    elements: int
    seconds: float                  # per fit, inside the process; of a fit cut short the cap
    estimates: tuple | None = None  # None: cut short, or not at the minimum
    process: float | None = None    # CPU time of the whole process
    capped: bool = False
    ratio: float | None = None      # to beamid modal, where both took turns


@dataclass
class Beamid:
    """Runs the program, and the one that times it, on cases in a folder of its own."""

    program: Path
    timer: Path
    folder: Path
    text: str = CASE.read_text()
    counts: dict = field(default_factory=dict)

    def __post_init__(self):
        shutil.copy(RECORD, self.folder)

    def write_table_case(self, elements, integrator="method='modal'"):
        """Table 4.1 for one mesh, one integrator and exact quadrature; its path."""
        mesh = f"&discretization degree=3, elements={elements}, gauss_points=4, panels=1 /"
        text = re.sub(r"(?m)^&discretization\b.*", mesh, self.text)
        text = re.sub(r"(?m)^&integrator\b.*", f"&integrator {integrator} /", text)
        return self.write_case(f"table_{elements}.nml", text)

    def write_case(self, name, text):
        """A case file in the folder; its path."""
        (self.folder / name).write_text(text)
        return self.folder / name

    def run(self, command, case, limit=None, failed=fail):
        """One run of the program: its CPU time. Outputs are in `out`; `failed` gets a failure."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([self.program, command, case, "--quiet", "--out",
                               self.folder / "out"], capture_output=True, text=True, timeout=limit)
        if done.returncode:
            failed(f"beamid: {done.stderr.strip()}", 1)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime

    def output(self, name):
        """The rows of one of the last run's outputs."""
        with open(self.folder / "out" / name, newline="") as file:
            return list(csv.DictReader(file))

    def estimates(self, names=NAMES):
        """Estimates and J of the last run."""
        values = {row["parameter"]: float(row["estimate"]) for row in self.output("estimates.csv")}
        return tuple(values[name] for name in names), values["J"]

    def clock(self, case, fits, evaluations, *wrapper, set_ups=0):
        """What `time_fits` prints, as numbers, and standard error."""
        done = subprocess.run([*wrapper, self.timer, case, str(fits), str(evaluations),
                               str(set_ups)], capture_output=True, text=True)
        if done.returncode:
            fail(f"time_fits: {done.stderr.strip()}", 1)
        lines = [line.split() for line in done.stdout.splitlines()]
        return {name: float(value) for name, value in lines}, done.stderr

    def seconds(self, case, what, target):
        """Median time of what is repeated for so long: fit, set_up, evaluation or all_rows."""
        kind = what if what in ("fit", "set_up") else "evaluation"

        def clocked(count):
            return self.clock(case, count * (kind == "fit"), count * (kind == "evaluation"),
                              set_ups=count * (kind == "set_up"))[0][what]

        if (case, kind) not in self.counts:
            self.counts[case, kind] = clocked(3)
        return clocked(max(1, min(301, int(target / self.counts[case, kind]))))

    def slow_row(self, label, elements, integrator, cap):
        """A fit by an integrator: the whole process, and the fit inside it."""
        tell(f"N = {elements}, {label}")
        case = self.write_table_case(elements, integrator)

        def gave_up(*_):    # rtol too large: the integrator has moved the estimates
            raise RuntimeError

        try:
            process = self.run("identify", case, cap, gave_up)
        except subprocess.TimeoutExpired:
            return Row(label, elements, cap, capped=True)
        except RuntimeError:
            return Row(label, elements, cap)
        estimates = self.estimates()[0]
        return Row(label, elements, self.clock(case, 1, 0)[0]["fit"], estimates, process)


def cut_short(*_):
    """What the timer does when a fit takes longer than the cap."""
    raise TimeoutError


def scipy_row(label, model, cap, *fit):
    """One fit by SciPy that may take long; without estimates where it is cut short or fails.

    The clock is the thread's: that of the process moves in ticks of 4 ms while the timer is set.
    """
    tell(f"N = {model.n - 2}, {label}")
    row = Row(label, model.n - 2, cap)
    signal.signal(signal.SIGPROF, cut_short)
    signal.setitimer(signal.ITIMER_PROF, cap)
    begin = time.thread_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            row.estimates = model.fit(*fit)
        row.seconds = time.thread_time() - begin
    except TimeoutError:
        row.capped = True
    except (ArithmeticError, RuntimeError, ValueError):    # the integrator or the fit gave up
        row.seconds = time.thread_time() - begin
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return row


def fastest(method, row_at, model, least):
    """From the loosest tolerance on, the fastest row at the minimum; else a row that says so."""
    best, failed = None, None
    for rtol in TOLERANCES:
        row = row_at(f"{method}, rtol {rtol:.0e}", rtol)
        if row.estimates and model.J(row.estimates) <= (1 + AT_MINIMUM) * least:
            if best and row.seconds >= best.seconds:
                break
            best = row
        elif best:
            break
        elif row.capped or not failed:
            failed = Row(method, row.elements, row.seconds, capped=row.capped)
    return best or failed


def check_model(model, estimates, J):
    """J of beamid must be that of the model in SciPy."""
    difference, elements = abs(model.J(estimates) / J - 1), model.n - 2
    if not difference < SAME_MODEL:
        fail(f"N = {elements}: J of beamid is {J:.9g}, of the model in SciPy "
             f"{model.J(estimates):.9g} for the same parameters: two models, nothing to compare", 1)
    tell(f"N = {elements}: J of beamid and of the model in SciPy, for the same parameters, "
         f"differ by {difference:.0e} of J")


def quick_fits(beamid, case, model, *wanted):
    """Fits of Table 4.1 that take turns: by label a function that gives the estimates, and by label
    one that gives the time, which includes beamid's."""
    fits = {"SciPy expm, stepped": partial(model.fit, model.stepped, "lm", 1e-6),
            "SciPy expm, doubled": partial(model.fit, model.doubled, "lm", 1e-6)}
    if peers.jax:
        fits["JAX expm, stepped"] = peers.JaxModel(model, False).fit
        fits["JAX expm, doubled"] = peers.JaxModel(model, True).fit
    fits = {label: fit for label, fit in fits.items() if not wanted or label in wanted}
    clocks = {"beamid modal": partial(beamid.seconds, case, "fit")}
    clocks.update((label, partial(repeat, fit)) for label, fit in fits.items())
    return fits, clocks


def fast_rows(beamid, model, effort):
    """Rows of one mesh for beamid modal and what takes turns with it."""
    elements = model.n - 2
    case = beamid.write_table_case(elements)
    process = min(beamid.run("identify", case) for _ in range(effort.rounds))
    estimates, J = beamid.estimates()
    check_model(model, estimates, J)
    fits, clocks = quick_fits(beamid, case, model)
    tell(f"N = {elements}, {', '.join(clocks)}: {effort.rounds} rounds")
    found = {label: fit() for label, fit in fits.items()}    # JAX compiles here
    spent = in_turns(clocks, effort)
    rows = [Row(label, elements, min(spent[label]), found.get(label, estimates),
                ratio=ratio(spent, label, "beamid modal")) for label in spent]
    rows[0].process = process
    return rows


def slow_rows(beamid, model, cap, least):
    """Rows of one mesh for integrators: cvode twice, SciPy's."""
    elements = model.n - 2
    rtol_of_case = float(re.search(r"rtol=([^ ,/]+)", beamid.text)[1])

    def cvode(label, rtol):
        return beamid.slow_row(label, elements, f"method='cvode', rtol={rtol}", cap)

    rows = [cvode(f"beamid cvode, case's rtol {rtol_of_case:.0e}", rtol_of_case),
            fastest("beamid cvode", cvode, model, least)]
    for method in ("LSODA", "BDF", "Radau"):
        def integrator(label, rtol, method=method):
            return scipy_row(label, model, cap, lambda q: model.integrated(q, method, rtol), "trf",
                             3 * math.sqrt(rtol))
        rows.append(fastest(f"SciPy {method}", integrator, model, least))
    return rows


def cells_of(row, model, reference):
    """A line of the table; reference: seconds of beamid modal."""
    bound, factor = "> " * row.capped, row.ratio or row.seconds / reference
    spent = [bound + ms(row.seconds), bound + times(factor),
             f"{1000 * row.process:.3g}" if row.process else "-"]
    if not (row.estimates or row.capped):
        spent = ["no minimum", "-", "-"]
    values = ["-"] * 5
    if row.estimates:
        values = [f"{value:.6g}" for value in (model.J(row.estimates), *row.estimates)]
    return [row.method, row.elements, *spent, *values]


def integrator_ratio(rows):
    """SciPy BDF against beamid cvode, each the fastest at the minimum."""
    cvode, bdf = rows[1], rows[3]
    if not cvode.estimates or not (bdf.estimates or bdf.capped):
        return f"N = {cvode.elements}: no ratio of SciPy BDF to beamid cvode, one finds no minimum"
    return (f"N = {cvode.elements}: one fit by {bdf.method} takes {'more than ' * bdf.capped}"
            f"{bdf.seconds / cvode.seconds:.1f} times as long as one by {cvode.method}")


def measured():
    """The record of Table 4.1."""
    return np.loadtxt(RECORD, delimiter=",", skiprows=1)[:, 1]


def part_table(beamid, arguments, effort):
    """Table 4.1 by everything, a table for each mesh."""
    for elements in arguments.elements:
        model = peers.Model(elements, measured())
        rows = fast_rows(beamid, model, effort)
        slow = []
        if effort.slow:
            slow = slow_rows(beamid, model, arguments.cap, model.J(rows[0].estimates))
        table(["One fit of Table 4.1", "N", "ms", "ratio", "process, ms", "J", *NAMES],
              [cells_of(row, model, rows[0].seconds) for row in rows + slow])
        if slow:
            print("", integrator_ratio(slow), sep="\n", flush=True)


def write_decay(beamid, samples, seed=1):
    """A simulated free decay with uneven stamps and its case; its path, times and values."""
    roots = [roots_of(beamid, TRUTH), roots_of(beamid, START)]
    rng = np.random.default_rng(seed)
    t = SECONDS * (np.arange(samples) + 0.6 * rng.random(samples)) / samples
    y = OFFSET + NOISE * rng.standard_normal(samples)
    for amplitude, root in zip(AMPLITUDES, roots[0]):
        y += (amplitude * np.exp(root * t)).real
    np.savetxt(beamid.folder / "decay.csv", np.column_stack([t, y]), "%.9f,%.6f",
               header="t,acceleration", comments="")
    t, y = np.round(t, 9), np.round(y, 6)
    return beamid.write_case("decay.nml", decay_case(START)), t, y, roots[1]


def decay_case(values):
    """The strip's case, with E, c_D, gamma and m_S."""
    return DECAY.format(*values)


def roots_of(beamid, values):
    """Roots of the strip's two lowest modes."""
    beamid.run("modes", beamid.write_case("modes.nml", decay_case(values)))
    return [complex(float(row["real"]), float(row["imag"]))
            for row in beamid.output("modes.csv")[:2]]


def floor_of(samples):
    """By label a function of seconds that times a part of the floor."""
    rng = np.random.default_rng(1)
    exponents = (-0.5 + 40j) * rng.random(2 * samples)
    matrix = rng.standard_normal((UNKNOWNS, samples))
    reference = peers.reference_dgeqrf()
    if not reference:
        tell("Netlib's LAPACK is not installed (liblapack3, libblas3): its rows are left out")

    def qr(call, columns, seconds):
        return repeat(call, seconds, lambda: matrix[:columns].copy().T)

    parts = {EXPONENTIALS: partial(repeat, lambda: np.exp(exponents))}
    for columns in (UNKNOWNS, LINEAR):
        if reference:
            parts[f"Netlib's QR, {columns} columns"] = partial(
                qr, partial(peers.qr_by_reference, reference), columns)
        parts[f"OpenBLAS' QR, {columns} columns"] = partial(qr, peers.qr_by_scipy, columns)
    return parts


def floor(spent):
    """The floor in each round: QR with as many columns as unknowns, and the exponentials."""
    name = f"Netlib's QR, {UNKNOWNS} columns"
    return np.add(spent[EXPONENTIALS], spent.get(name, spent[f"OpenBLAS'{name[8:]}"]))


def part_decay(beamid, _, effort):
    """A free decay: whole fits, then one evaluation and what it cannot do without."""
    case, t, y, roots = write_decay(beamid, SAMPLES)
    beamid.run("identify", case)
    J = beamid.estimates(("E", "m_S"))[1]
    decay = peers.FreeDecay(t, y)
    start = [value for root in roots for value in (-root.real, root.imag)]
    J_there = decay.fit(start)[0]
    if not abs(J_there / J - 1) < SAME_MINIMUM:
        fail(f"free decay: J of beamid is {J:.9g}, of SciPy {J_there:.9g}: two minima", 1)
    tell(f"free decay: J of beamid and of SciPy differ by {abs(J_there / J - 1):.0e} of J; "
         f"{effort.rounds} rounds")
    values, plain = np.array(start), peers.PlainDecay(t, y)
    fits = ("beamid, fit", "SciPy, variable projection, Kaufman's Jacobian",
            "SciPy, variable projection, lstsq and differences")
    evaluations = ("beamid, residuals and Jacobian",
                   "SciPy, residuals and Kaufman's Jacobian",
                   "beamid, all rows of both")
    spent = in_turns({
        fits[0]: partial(beamid.seconds, case, "fit"),
        fits[1]: partial(repeat, lambda: decay.fit(start)),
        fits[2]: partial(repeat, lambda: plain.fit(start)),
        evaluations[0]: partial(beamid.seconds, case, "evaluation"),
        evaluations[1]: partial(repeat, lambda: decay.project(values)),
        evaluations[2]: partial(beamid.seconds, case, "all_rows"),
        **floor_of(SAMPLES)}, effort)
    spent[FLOOR] = floor(spent)
    rows = [[name, ms(min(spent[name])),
             times(ratio(spent, name, reference))]
            for name in spent for reference in [fits[0] if name in fits else evaluations[0]]]
    table([f"Free decay, {SAMPLES} samples", "ms", "ratio"], rows)
    print(f"\nOne evaluation of beamid takes {ratio(spent, evaluations[0], FLOOR):.2f} times as "
          "long as the floor, and "
          f"{ratio(spent, evaluations[0], EXPONENTIALS):.2f} times as long as {EXPONENTIALS}.")


def part_elements(beamid, arguments, effort):
    """Table 4.1 by finer and finer meshes; what is drawn."""
    rows, lines, remarks = [], {}, []
    for elements in effort.meshes:
        model = peers.Model(elements, measured())
        case = beamid.write_table_case(elements)
        fits, clocks = quick_fits(beamid, case, model, "SciPy expm, stepped",
                                  "JAX expm, doubled")
        clocks["mesh"] = partial(beamid.seconds, case, "set_up")
        tell(f"N = {elements}, {', '.join(clocks)}")
        beamid.run("identify", case)
        estimates = beamid.estimates()[0]
        for label, fit in fits.items():
            off = np.max(np.abs(np.divide(fit(), estimates) - 1))    # JAX compiles here
            if not off <= AT_MINIMUM:
                remarks.append(f"N = {elements}: {label}, ends {100 * off:.2g} % away from the "
                               "minimum, by round-off; its time is no fit's.")
        spent = in_turns(clocks, effort)
        apart = np.subtract(spent["beamid modal"], spent.pop("mesh"))
        spent = {"beamid modal": spent["beamid modal"], "beamid, mesh apart": apart, **spent}
        for label, values in spent.items():
            lines.setdefault(label, []).append(min(values))
        rows.append([elements, *(ms(min(values)) for values in spent.values()),
                     *(times(ratio(spent, label, "beamid modal")) for label in fits)])
    table(["N", *(f"{label}, ms" for label in lines), *(f"{label}, ratio" for label in fits)], rows)
    if {8, 64} <= set(effort.meshes):
        apart = dict(zip(effort.meshes, lines["beamid, mesh apart"]))
        remarks.append(f"The fit with N = 64, mesh apart, takes {apart[64] / apart[8]:.1f} times "
                       "as long as that with N = 8.")
    if remarks:
        print("", *remarks, sep="\n", flush=True)
    return effort.meshes, lines


def part_response(beamid, _, effort):
    """A frequency response with derivatives: beamid, and numpy.linalg.solve line by line."""
    band = f"f_first=1, f_last=100, f_step={99 / (LINES - 1):.17g}"
    beamid.run("frf", beamid.write_case("true.nml", RESPONSE.format(*TRUTH, band)))
    rows = beamid.output("frf.csv")
    shutil.copy(beamid.folder / "out" / "frf.csv", beamid.folder / "frf.csv")
    case = beamid.write_case("frf.nml", RESPONSE.format(*START, "file='frf.csv'")
                             + "&stage free='E','m_S','c_D','gamma', start='case' /\n")
    s = 2j * np.pi * np.array([float(row["frequency_hz"]) for row in rows])
    h = np.array([complex(float(row["real"]), float(row["imag"])) for row in rows])
    peer = peers.HermiteBeam(16, 0.5, 0.27, 0.05 * 0.002**3 / 12, 0.4375)
    E, c_D, gamma, m_S = TRUTH
    values = (E, m_S, c_D, gamma)
    difference = np.abs(peer.evaluate(values, s)[:, 0] - h).max() / np.abs(h).max()
    if not difference < SAME_RESPONSE:
        fail(f"frequency response: beamid and NumPy differ by {difference:.1e}: two models", 1)
    tell(f"frequency response: beamid and NumPy differ by {difference:.0e} of the largest value; "
         f"{effort.rounds} rounds")
    names = ("beamid, residuals and Jacobian", "NumPy, solve line by line, with derivatives")
    spent = in_turns({names[0]: partial(beamid.seconds, case, "evaluation"),
                      names[1]: partial(repeat, lambda: peer.evaluate(values, s))}, effort)
    table([f"Frequency response, {LINES} lines, N = 16, 4 parameters", "ms", "ratio"],
          [[name, ms(min(spent[name])), times(ratio(spent, name, names[0]))] for name in names])


def part_samples(beamid, _, effort):
    """One evaluation of longer and longer free decays; what is drawn."""
    sizes = [size for size in SIZES if size <= effort.largest]
    rows, lines = [], {"beamid": [], FLOOR: []}
    for samples in sizes:
        tell(f"{samples} samples")
        case = write_decay(beamid, samples)[0]
        spent = in_turns({"beamid": partial(beamid.seconds, case, "evaluation"),
                          **floor_of(samples)}, effort)
        memory = beamid.clock(case, 0, 1)[0].get("peak_kB", math.nan) / 1024
        beamid.counts.clear()    # the next case has the same name
        spent[FLOOR] = floor(spent)
        for label, line in lines.items():
            line.append(min(spent[label]))
        rows.append([samples, *(ms(min(spent[label])) for label in lines),
                     times(ratio(spent, "beamid", FLOOR)), f"{memory:.0f}"])
    table(["samples", "beamid, one evaluation, ms", f"{FLOOR}, ms", "ratio", "memory, MB"], rows)
    if {SAMPLES, 10**6} <= set(sizes):
        seconds = dict(zip(sizes, lines["beamid"]))
        print(f"\nOne evaluation of 1000000 samples takes {seconds[10**6] / seconds[SAMPLES]:.1f} "
              f"times as long as one of {SAMPLES}.")
    return sizes, lines


def part_posterior(beamid, _, effort):
    """Table 4.1 with noise: draws by everything, effective samples a second, and their means."""
    if not peers.jax or not peers.emcee:
        tell("emcee, numpyro or JAX is not installed: posteriors are not compared")
        return
    shutil.copy(NOISY.with_suffix(".csv"), beamid.folder)
    case = beamid.write_case(NOISY.name, NOISY.read_text())
    measured = np.loadtxt(NOISY.with_suffix(".csv"), delimiter=",", skiprows=1)[:, 1]
    model = peers.Model(4, measured)
    beamid.run("identify", case)
    estimates, J = beamid.estimates()
    check_model(model, estimates, J)
    posterior = peers.Posterior(model, estimates)

    def by_beamid(seed):
        text = NOISY.read_text() + f"&sample seed={seed} /\n"
        seconds = beamid.run("sample", beamid.write_case(NOISY.name, text))
        rows = beamid.output("posterior.csv")
        draws = np.array([[float(row[name]) for name in NAMES] for row in rows]).reshape(4, -1, 4)
        told = (beamid.folder / "out" / "intervals.txt").read_text()
        worth = float(re.search(r"worth\s+(\d+)\s+independent", told)[1])
        return seconds, draws, worth

    def by_peer(call, *counts):
        begin = time.process_time()
        draws = call(*counts)
        return time.process_time() - begin, draws, math.inf

    methods = {"beamid sample": by_beamid,
               "emcee, JAX": lambda seed: by_peer(posterior.by_emcee, 4000, 500, seed),
               "NumPyro NUTS": lambda seed: by_peer(posterior.by_nuts, 1000, 4000, seed)}
    rounds = min(effort.rounds, 3)
    tell(f"posterior, {', '.join(methods)}: {rounds} rounds")
    posterior.by_emcee(2, 0, 0)
    posterior.by_nuts(1000, 4000, 0)    # compiles
    found = {name: [] for name in methods}
    for seed in range(1, rounds + 1):
        for name, run in methods.items():
            seconds, draws, worth = run(seed)
            size = min(worth, float(min(peers.effective(draws))))
            found[name].append((seconds, draws.shape[0] * draws.shape[1], size,
                                *draws.mean(axis=(0, 1))))
    rates = {name: [size / seconds for seconds, _, size, *_ in runs]
             for name, runs in found.items()}
    rows = []
    for name, runs in found.items():
        seconds, draws, size, *means = np.median(runs, axis=0)
        rows.append([name, f"{draws:.0f}", ms(seconds), f"{size:.0f}",
                     f"{np.median(rates[name]):.0f}", times(ratio(rates, "beamid sample", name)),
                     *(f"{mean:.4g}" for mean in means)])
    table(["Posterior of Table 4.1, N = 4, 2 % noise", "draws", "ms", "effective",
           "effective a second", "beamid's lead", *(f"mean {name}" for name in NAMES)], rows)


def part_resamples(beamid, _, effort):
    """Resampled records and posterior draws of a free decay: beamid, SciPy and emcee."""
    case, t, y, roots = write_decay(beamid, RESAMPLED)
    with open(case, "a") as file:
        file.write(f"&bootstrap n={RECORDS} /\n&sample draws={DRAWS} /\n")
    decay = peers.FreeDecay(t, y)
    J, values = decay.fit([value for root in roots for value in (-root.real, root.imag)])
    fitted = y + decay.evaluate(np.log(values))[0]
    sd = math.sqrt(J / (RESAMPLED - UNKNOWNS))
    names = (f"beamid bootstrap, {RECORDS} records", f"SciPy, variable projection, {RECORDS} fits",
             f"beamid sample, {DRAWS} draws", "emcee, as many effective draws")

    def by_scipy(seed, fits=20):
        rng = np.random.default_rng(seed)
        begin = time.process_time()
        for _ in range(fits):
            peers.FreeDecay(t, fitted + sd * rng.standard_normal(RESAMPLED)).fit(values)
        return (time.process_time() - begin) * RECORDS / fits

    def by_emcee(seed):
        begin = time.process_time()
        draws = decay.by_emcee(np.log(values), 300, 100, seed)
        seconds = time.process_time() - begin
        return seconds * DRAWS / float(min(peers.effective(draws)))

    methods = {names[0]: lambda _: beamid.run("bootstrap", case), names[1]: by_scipy,
               names[2]: lambda _: beamid.run("sample", case)}
    if peers.jax and peers.emcee:
        methods[names[3]] = by_emcee
    rounds = min(effort.rounds, 3)
    tell(f"resamples, {', '.join(methods)}: {rounds} rounds")
    spent = {name: [] for name in methods}
    for seed in range(1, rounds + 1):
        for name, run in methods.items():
            spent[name].append(run(seed))
    table([f"Free decay, {RESAMPLED} samples", "ms", "ratio"],
          [[name, ms(min(spent[name])), times(ratio(spent, name, names[k // 2 * 2]))]
           for k, name in enumerate(methods)])


def part_instructions(beamid, *_):
    """Instructions of one fit and one evaluation: the difference of a run with many and one with
    one."""
    if not shutil.which("valgrind"):
        tell("valgrind is not installed: instructions are not counted")
        return

    def count(case, fits, number):
        told = beamid.clock(case, number * fits, number * (not fits), "valgrind",
                            "--tool=callgrind", "--callgrind-out-file=/dev/null")[1]
        return int(re.search(r"Collected : (\d+)", told)[1])

    def difference(case, fits, more=2):
        tell(f"counting instructions: {case.stem}, {'fit' if fits else 'evaluation'}")
        return (count(case, fits, 1 + more) - count(case, fits, 1)) / more / 1e6

    rows = [["fit of Table 4.1, N = 4", f"{difference(beamid.write_table_case(4), True, 10):.3f}"]]
    decay = write_decay(beamid, SAMPLES)[0]
    rows += [[f"{'fit' if fits else 'evaluation'} of the free decay, {SAMPLES} samples",
              f"{difference(decay, fits):.1f}"] for fits in (True, False)]
    table(["beamid, instructions", "millions"], rows)


def draw(path, elements, samples):
    """Times against the number of elements and against that of samples."""
    import plotting as p    # asks for matplotlib

    panels = [(elements, "One fit of Table 4.1", "number of elements $N$"),
              (samples, "Free decay: one evaluation of residuals and Jacobian",
               "number of samples")]
    panels = [panel for panel in panels if panel[0]]
    figure, several = p.plt.subplots(1, len(panels), figsize=(5.25 * len(panels), 4.2),
                                     squeeze=False)
    for axes, ((sizes, lines), title, what) in zip(several[0], panels):
        for k, (label, seconds) in enumerate(lines.items()):
            axes.plot(sizes, 1000 * np.array(seconds), color=p.COLOURS[k], marker=p.MARKERS[k],
                      markersize=5, label=label)
        axes.set(title=title, xlabel=what, ylabel="ms", xscale="log", yscale="log")
        p.plain_logarithmic(axes.yaxis)
        if sizes[-1] < 1000:
            axes.set_xticks(sizes, labels=sizes)
            axes.set_xticks([], minor=True)
        axes.legend()
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    p.save(figure, path)


def meshes(text):
    """4,6 as numbers of elements."""
    if re.fullmatch(r"[0-9]+(,[0-9]+)*", text) and all(2 <= int(n) <= 64 for n in text.split(",")):
        return [int(n) for n in text.split(",")]
    raise argparse.ArgumentTypeError(f"found '{text}', expected numbers from 2 to 64, such as 4,6")


def duration(text):
    """A positive number of seconds."""
    try:
        if 0 < float(text) <= 1e6:
            return float(text)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"found '{text}', expected seconds from above 0 to 1e6")


def part(text):
    """A part's name."""
    if text in PARTS:
        return text
    raise argparse.ArgumentTypeError(f"found '{text}', expected {', '.join(PARTS)}")


def parse():
    """The command line; what is not understood is one line and exit status 2."""
    parser = new_parser(__doc__, epilog=NOTES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", metavar="PART", type=part, nargs="*", help="what to measure")
    parser.add_argument("--elements", metavar="N,N", type=meshes, default=[4, 6],
                        help="meshes of the table (default: 4,6)")
    parser.add_argument("--cap", metavar="SECONDS", type=duration, default=120.0,
                        help="longest time of one fit in the table (default: 120)")
    parser.add_argument("--quick", action="store_true",
                        help="fewer rounds, no integrators, N <= 16, 100000 samples at most")
    parser.add_argument("--plot", metavar="FILE", default=CHECKOUT / "out" / "benchmark.png",
                        help="picture of elements and samples (default: out/benchmark.png)")
    return parser.parse_args()


def main():
    arguments = parse()
    if not HAS_PEERS or Path(sys.prefix).resolve() != PEERS.resolve():
        restart_with_peers()
    effort = Effort(3, 0.1, 10**5, (4, 8, 16), False) if arguments.quick else Effort()
    program, timer = release(), release("--example time_fits")
    print(machine(output_of(program, "version")), flush=True)
    drawn = {}
    with tempfile.TemporaryDirectory() as folder:
        beamid = Beamid(program, timer, Path(folder))
        for name in PARTS:
            if name in (arguments.parts or PARTS):
                drawn[name] = globals()[f"part_{name}"](beamid, arguments, effort)
    print(NOTES)
    if drawn.get("elements") or drawn.get("samples"):
        draw(arguments.plot, drawn.get("elements"), drawn.get("samples"))


if __name__ == "__main__":
    main()
