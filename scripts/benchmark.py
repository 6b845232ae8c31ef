#!/usr/bin/env python3
"""Times the fit of Table 4.1 by beamid and by SciPy, side by side, one thread each."""

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
from dataclasses import dataclass
from pathlib import Path

from program import CHECKOUT, PYTHON, fail, new_parser, output_of, release, tell

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")    # before NumPy reads them
try:
    import numpy as np
    import scipy
    from scipy.integrate import solve_ivp
    from scipy.interpolate import BSpline
    from scipy.linalg import expm
    from scipy.optimize import least_squares
except ImportError:
    np = None

CASE = CHECKOUT / "data" / "table_4_1_fit.nml"
RECORD = CHECKOUT / "data" / "table_4_1_record.csv"

# The model of the case file, in its units; `check_model` compares the two.
LENGTH, RHO, E, I, TIP_MASS, PULSE, DELTA = 4.0, 0.03, 80.0, 1.0, 0.15, 0.05, 0.1
NAMES, START = ("c_D", "m_H", "c_H", "k_H"), (0.0035, 0.035, 0.0035, 0.4)

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
AT_MINIMUM = 1e-3      # J within this of the least one, relatively: the fit is at the minimum
SAME_MODEL = 1e-6      # J of beamid and of SciPy for the same parameters, relatively
ROUNDS = 7             # of a fit shorter than a second; of a longer one by beamid 3

NOTES = """
s per fit  without start-up: wall clock for beamid, lowest of three; CPU time for SciPy; of a fit
           shorter than a second the median of many, and of that the lowest of seven rounds
process    CPU time of the whole process: start, one fit, results written
ratio      s per fit over that of beamid modal
J          sum of squares at the estimates of the row, by the exact response
rtol       of 1e-4, 1e-6, 1e-8, 1e-10 the fastest whose J is within 0.001 of the least
beamid     a fit includes the spline integrals, full convergence and the statistics, but not the
           comparison of derivatives with differences, which SciPy does not make
SciPy      a fit is least_squares alone, ftol = xtol = 1e-4; logarithms of the parameters, forward
           differences; what was fastest: 'lm' and step 1e-6 with expm, 'trf' and step 3 sqrt(rtol)
           with solve_ivp, which has the analytic Jacobian of the equations of motion
expm       stepped: one for the pulse, one for 0.1 s; doubled: one for both, repeated squaring
both       four Gauss points per element, exact for cubic splines"""


def restart_with_scipy():
    """Restarts this script with the Python of the environment, with SciPy installed into it."""
    if subprocess.run([CHECKOUT / "scripts" / "setup.sh"], stdout=sys.stderr).returncode:
        fail("setup.sh failed", 1)
    works = [PYTHON, "-c", "import numpy, scipy.optimize"]
    if subprocess.run(works, stderr=subprocess.DEVNULL).returncode:
        tell("SciPy is missing: installing it into .venv with pip")
        subprocess.run([PYTHON, "-m", "pip", "-q", "--disable-pip-version-check", "install",
                        "scipy"], stdout=sys.stderr)
        if subprocess.run(works, stderr=subprocess.DEVNULL).returncode:
            fail("could not install SciPy into .venv", 1)
    os.execv(PYTHON, [str(PYTHON), *sys.argv])


def machine(version):
    """One line: processor and versions."""
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    compiler = output_of("gfortran", "-dumpfullversion")
    return (f"{os.cpu_count()} cores, {model[1] if model else platform.machine()}, load "
            f"{os.getloadavg()[0]:.1f}; {version}, gfortran {compiler}; "
            f"Python {platform.python_version()}, NumPy {np.__version__}, SciPy "
            f"{scipy.__version__}")


@dataclass
class Row:
    """One line of the table."""
    method: str
    elements: int
    seconds: float              # per fit, inside the process; of a fit cut short the cap
    estimates: tuple = None     # None: cut short, or not at the minimum
    process: float = None       # CPU time of the whole process
    capped: bool = False


class Beamid:
    """Runs the program on variants of the case file, in a folder of its own."""

    def __init__(self, program, folder):
        self.program, self.folder, self.text = program, Path(folder), CASE.read_text()
        self.rtol = float(re.search(r"rtol=([^ ,/]+)", self.text)[1])
        shutil.copy(RECORD, folder)

    def write_case(self, elements, integrator):
        """The case for one mesh, one integrator and exact quadrature."""
        mesh = f"&discretization degree=3, elements={elements}, gauss_points=4, panels=1 /"
        text = re.sub(r"(?m)^&discretization\b.*", mesh, self.text)
        text = re.sub(r"(?m)^&integrator\b.*", f"&integrator {integrator} /", text)
        (self.folder / "case.nml").write_text(text)

    def identify(self, *options, limit=None):
        """One run: CPU time and standard error."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([self.program, "identify", self.folder / "case.nml", "--quiet",
                               "--out", self.folder / "out", *options],
                              capture_output=True, text=True, timeout=limit)
        if done.returncode:
            fail(f"beamid: {done.stderr.strip()}", 1)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, done.stderr

    def estimates(self):
        """Estimates and J of the last run."""
        with open(self.folder / "out" / "estimates.csv", newline="") as file:
            values = {row["parameter"]: float(row["estimate"]) for row in csv.DictReader(file)}
        return tuple(values[name] for name in NAMES), values["J"]

    def row(self, label, elements, integrator, cap):
        """The whole process and the fit inside it, timed."""
        tell(f"N = {elements}, {label}")
        self.write_case(elements, integrator)
        try:
            process = [self.identify(limit=cap)[0]]
        except subprocess.TimeoutExpired:
            return Row(label, elements, cap, capped=True)
        short = process[0] < 1
        if short:
            process += [self.identify()[0] for _ in range(8)]
        inside = [float(re.search(r"fits: (\S+) s", self.identify("--time")[1])[1])
                  for _ in range(ROUNDS if short else 3)]
        return Row(label, elements, min(inside), self.estimates()[0], float(np.median(process)))


class Model:
    """The beam by cubic B-splines and Galerkin's method, independent of beamid's."""

    def __init__(self, elements, measured):
        h = LENGTH / elements
        spline = BSpline(h * np.arange(-3, elements + 4), np.eye(elements + 3), 3)
        points, weights = np.polynomial.legendre.leggauss(4)    # exact up to degree 7
        x = (h * (np.arange(elements)[:, None] + (points + 1) / 2)).ravel()
        weights = np.tile(weights * h / 2, elements)
        clamp = np.vstack([np.zeros((2, elements + 1)), np.eye(elements + 1)])
        clamp[:2, 0] = 1, -0.5    # w(0) = w'(0) = 0
        basis, curvature, tip = (np.pad(np.atleast_2d(values) @ clamp, [(0, 0), (0, 1)]) for values
                                 in (spline(x), spline.derivative(2)(x), spline(LENGTH)))
        self.n, self.tip, self.measured = elements + 2, tip[0], measured
        hose = np.eye(self.n)[-1]    # the last unknown
        self.hose = np.outer(hose, hose)
        self.stretch = np.outer(hose - self.tip, hose - self.tip)
        self.mass = RHO * (basis.T * weights) @ basis + TIP_MASS * np.outer(self.tip, self.tip)
        self.bending = I * (curvature.T * weights) @ curvature

    def state(self, q):
        """A of (w, v, f)' = A (w, v, f) with a constant force f."""
        c_D, m_H, c_H, k_H = q
        n, inverse = self.n, np.linalg.inv(self.mass + m_H * self.hose)
        A = np.zeros((2 * n + 1, 2 * n + 1))
        A[:n, n:-1] = np.eye(n)
        A[n:-1, :n] = -inverse @ (E * self.bending + k_H * self.stretch)
        A[n:-1, n:-1] = -inverse @ (c_D * self.bending + c_H * self.stretch)
        A[n:-1, -1] = inverse @ self.tip
        return A

    def stepped(self, q):
        """Tip displacement at Delta, 2 Delta, ...: exact, two exponentials, step by step."""
        A = self.state(q)
        pulse, step = expm(PULSE * A), expm(DELTA * A[:-1, :-1])
        states = np.empty((len(self.measured) + 2, 2 * self.n))
        states[0] = pulse[:-1, :-1] @ pulse[:-1, -1]    # DELTA is twice PULSE
        for k in range(len(states) - 1):
            states[k + 1] = step @ states[k]
        return states[:, :self.n] @ self.tip

    def doubled(self, q):
        """The same by one exponential and repeated squaring."""
        pulse = expm(PULSE * self.state(q))
        half = pulse[:-1, :-1]
        step, states = half @ half, (half @ pulse[:-1, -1])[:, None]
        while states.shape[1] < len(self.measured) + 2:
            states = np.hstack([states, step @ states])
            step = step @ step
        return self.tip @ states[:self.n, :len(self.measured) + 2]

    def integrated(self, q, method, rtol):
        """The same by an integrator that restarts where the pulse ends."""
        A = self.state(q)
        F, load = A[:-1, :-1].copy(), A[:-1, -1].copy()
        times = DELTA * np.arange(1, len(self.measured) + 3)
        options = {"method": method, "rtol": rtol, "atol": 0.1 * rtol,    # 0.1: size of w and v
                   "jac": (lambda t, y: F) if method == "LSODA" else F}
        pulse = solve_ivp(lambda t, y: F @ y + load, (0, PULSE), np.zeros(2 * self.n), **options)
        free = solve_ivp(lambda t, y: F @ y, (PULSE, times[-1]), pulse.y[:, -1], t_eval=times,
                         **options)
        if not (pulse.success and free.success):
            raise RuntimeError(free.message)
        return self.tip @ free.y[:self.n]

    def residuals(self, u):
        """(4.1) minus the record."""
        return (u[2:] - 2 * u[1:-1] + u[:-2]) / DELTA**2 - self.measured

    def J(self, q):
        """Sum of squares by the exact response."""
        return float(np.sum(self.residuals(self.doubled(q))**2))

    def fit(self, response, method, step):
        """Least squares over the logarithms of the parameters; the estimates."""
        found = least_squares(lambda x: self.residuals(response(START * np.exp(x))), np.zeros(4),
                              method=method, diff_step=step, ftol=1e-4, xtol=1e-4)
        return tuple(map(float, START * np.exp(found.x)))


def cut_short(*_):
    """What the timer does when a fit takes longer than the cap."""
    raise TimeoutError


def cpu_time(fit, cap):
    """CPU time of one fit, its estimates or None, and whether it was cut short.

    The clock of the thread: that of the process moves in ticks of 4 ms while the timer is set.
    """
    signal.signal(signal.SIGPROF, cut_short)
    signal.setitimer(signal.ITIMER_PROF, cap)
    begin = time.thread_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            estimates = fit()
        return time.thread_time() - begin, estimates, False
    except TimeoutError:
        return cap, None, True
    except (ArithmeticError, RuntimeError, ValueError):    # the integrator or the fit gave up
        return time.thread_time() - begin, None, False
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def scipy_row(label, model, cap, *fit):
    """One fit by SciPy, or the lowest median of many short ones."""
    elements = model.n - 2
    tell(f"N = {elements}, {label}")
    medians = []
    for _ in range(ROUNDS):
        times = []
        while sum(times) < 1 and len(times) < 101:
            seconds, estimates, capped = cpu_time(lambda: model.fit(*fit), cap)
            if capped or seconds > 1 or not estimates:
                return Row(label, elements, seconds, estimates, capped=capped)
            times.append(seconds)
        medians.append(float(np.median(times)))
    return Row(label, elements, min(medians), estimates)


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
    print(f"N = {elements}: J of beamid and of the model in SciPy, for the same parameters, "
          f"differ by {difference:.0e} of J", flush=True)


def compare(beamid, elements, measured, cap):
    """All rows of one mesh: beamid modal, cvode twice, SciPy's."""
    model = Model(elements, measured)
    modal = beamid.row("beamid modal", elements, "method='modal'", cap)
    if modal.capped:
        fail(f"N = {elements}: beamid modal takes more than {cap:g} s", 1)
    check_model(model, *beamid.estimates())
    least = model.J(modal.estimates)

    def cvode(label, rtol):
        return beamid.row(label, elements, f"method='cvode', rtol={rtol}", cap)

    rows = [modal, cvode(f"beamid cvode, case's rtol {beamid.rtol:.0e}", beamid.rtol),
            fastest("beamid cvode", cvode, model, least),
            scipy_row("SciPy expm, stepped", model, cap, model.stepped, "lm", 1e-6),
            scipy_row("SciPy expm, doubled", model, cap, model.doubled, "lm", 1e-6)]
    for method in ("LSODA", "BDF", "Radau"):
        def integrator(label, rtol):
            return scipy_row(label, model, cap, lambda q: model.integrated(q, method, rtol), "trf",
                             3 * math.sqrt(rtol))
        rows.append(fastest(f"SciPy {method}", integrator, model, least))
    return [(row, model.J(row.estimates) if row.estimates else None) for row in rows]


def print_line(*cells):
    """One line of the table."""
    widths = (33, 3, 13, 9, 9, 13, *[11] * 4)
    print(f"{cells[0]:<{widths[0]}}" + "".join(
        f"{cell:>{width}}" for cell, width in zip(cells[1:], widths[1:])))


def print_rows(rows):
    """The rows of one mesh; the first is beamid modal."""
    for row, J in rows:
        bound, ratio = "> " * row.capped, row.seconds / rows[0][0].seconds
        times = [f"{bound}{row.seconds:.4g}", f"{row.process:.3g}" if row.process else "-",
                 f"{bound}{ratio:.{0 if ratio >= 100 else 1}f}"]
        if not (row.estimates or row.capped):
            times = ["no minimum", "-", "-"]
        values = [f"{J:.5e}", *(f"{value:.6g}" for value in row.estimates)] if J else ["-"] * 5
        print_line(row.method, row.elements, *times, *values)


def integrator_ratio(rows):
    """SciPy BDF against beamid cvode, each the fastest at the minimum."""
    cvode, bdf = rows[2][0], rows[6][0]
    if not cvode.estimates or not (bdf.estimates or bdf.capped):
        return f"N = {cvode.elements}: no ratio of SciPy BDF to beamid cvode, one finds no minimum"
    return (f"N = {cvode.elements}: one fit by {bdf.method} takes {'more than ' * bdf.capped}"
            f"{bdf.seconds / cvode.seconds:.1f} times as long as one by {cvode.method}")


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


def parse():
    """The command line; what is not understood is one line and exit status 2."""
    parser = new_parser(__doc__, epilog=NOTES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--elements", metavar="N,N", type=meshes, default=[4, 6],
                        help="meshes (default: 4,6)")
    parser.add_argument("--cap", metavar="SECONDS", type=duration, default=120.0,
                        help="longest time of one fit (default: 120)")
    return parser.parse_args()


def main():
    arguments = parse()
    if np is None:
        restart_with_scipy()
    program = release()
    print(machine(output_of(program, "version")), flush=True)
    measured = np.loadtxt(RECORD, delimiter=",", skiprows=1)[:, 1]
    with tempfile.TemporaryDirectory() as folder:
        beamid = Beamid(program, folder)
        results = [compare(beamid, n, measured, arguments.cap) for n in arguments.elements]
    print()
    print_line("method", "N", "s per fit", "process", "ratio", "J", *NAMES)
    for rows in results:
        print_rows(rows)
    print("", *map(integrator_ratio, results), sep="\n")
    print(NOTES)


if __name__ == "__main__":
    main()
