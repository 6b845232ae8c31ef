#!/usr/bin/env python3
"""Compute the exact values of data/benchmarks/benchmarks.csv independently of beamid.

Needs mpmath. Prints every exact value that differs from the one in the table by more than 1e-14 of
itself; with --write, replaces these values and the width of SDLL10. Works with 50 digits and takes
a minute.

If E I(x), rho(x) and N(x) are polynomials, (E I w'')'' - (N w')' = omega^2 rho w has power series
as solutions. Two of them satisfy the conditions at the root; a frequency is a zero of the
determinant of the conditions at the tip. Frequencies of beams with several spans or with a sprung
mass in a span are zeros of their known characteristic equations.
"""

import argparse
import csv
import sys
from functools import partial
from pathlib import Path

from mpmath import cos, cot, coth, csc, csch, exp, factorial, findroot, linspace, mp, mpf
from mpmath import pi, sign, sin, sinh, sqrt

mp.dps = 50
FOLDER = Path(__file__).resolve().parent.parent / "data" / "benchmarks"
TERMS = 500    # the slowest series, of tapers to a fifth, converges like .8^k
RIGID = {"clamped": (0, 1), "pinned": (0, 2), "guided": (1, 3), "free": (2, 3)}


def product(p, q):
    """Return the product of two polynomials."""
    return [sum(p[k] * q[n - k] for k in range(len(p)) if 0 <= n - k < len(q))
            for n in range(len(p) + len(q) - 1)]


def solution(begin, EI, rho, N, omega2):
    """Return the power series of w that begins with four coefficients."""
    w = list(begin)
    for n in range(TERMS if len(EI) > 1 else 120):
        # Coefficient n of the equation contains w[n + 4] once, in E I(0) w''''.
        rest = sum(a * (n + 4 - k) * (n + 3 - k) * w[n + 4 - k]
                   for k, a in enumerate(EI[:n + 3]) if k)
        rest = rest * (n + 2) - sum(a * (n + 2 - k) * w[n + 2 - k]
                                    for k, a in enumerate(N[:n + 2]))
        rest = rest * (n + 1) - omega2 * sum(a * w[n - k] for k, a in enumerate(rho[:n + 1]))
        w.append(-rest / (EI[0] * (n + 1) * (n + 2) * (n + 3) * (n + 4)))
    return w


def at_tip(w, EI, N):
    """Return deflection, slope, moment and shear force of a series at x = 1."""
    derivatives = [sum(w)]
    for _ in range(3):
        w = [k * a for k, a in enumerate(w)][1:]
        derivatives.append(sum(w))
    stiffness = sum(EI)
    slope = sum(k * a for k, a in enumerate(EI))
    shear = stiffness * derivatives[3] + slope * derivatives[2] - sum(N) * derivatives[1]
    return [derivatives[0], derivatives[1], stiffness * derivatives[2], shear]


def determinant(omega, ends, EI=(1,), rho=(1,), N=(0,), mass=lambda omega2: 0):
    """Return the determinant of the conditions at the tip of a beam of length 1.

    ends: kinds of root and tip; E I must not vary at a root that is free;
    mass: mass at the tip, as a function of omega^2.
    """
    EI, rho, N = ([mpf(a) for a in p] for p in (EI, rho, N))
    omega2 = omega ** 2
    columns = []
    for place in range(4):
        if place in RIGID[ends[0]]:
            continue
        begin = [mpf(place == k) / factorial(k) for k in range(4)]
        if ends[0] == "free" and place == 1:
            begin[3] = N[0] / EI[0] / 6    # no shear force
        tip = at_tip(solution(begin, EI, rho, N, omega2), EI, N)
        tip[3] += mass(omega2) * omega2 * tip[0]
        columns.append(tip)
    i, j = RIGID[ends[1]]
    return columns[0][i] * columns[1][j] - columns[0][j] * columns[1][i]


def zeros(f, count, step, first=None):
    """Return the first zeros of f above `first`, which lie further apart than step."""
    found = []
    a = mpf(step) / 3 if first is None else mpf(first)
    low = f(a)
    while len(found) < count:
        b = a + step
        high = f(b)
        if sign(low) * sign(high) < 0:
            root = findroot(f, (a, b), solver="illinois", tol=mpf(10) ** -35, verify=False)
            if abs(f(root)) < (abs(low) + abs(high)) * mpf(10) ** -25:    # not a pole
                found.append(root)
        a, low = b, high
    return found


def uniform(root, tip):
    """Return beta l of a uniform beam, modes 1 to 3."""
    return zeros(lambda b: determinant(b ** 2, (root, tip)), 3, mpf("0.4"))


def taper(height, width, unit=1, count=3):
    """Return frequencies of a cantilever whose height and width fall linearly to shares."""
    h, b = ([mpf(1), mpf(share) - 1] for share in (height, width))
    area = product(h, b)
    EI = product(area, product(h, h))
    return [unit * w for w in zeros(partial(determinant, ends=("clamped", "free"), EI=EI, rho=area),
                                    count, 2)]


def steel(length, height, E="2e11", density="7800"):
    """Return the factor from omega of a unit beam to the frequency [Hz] of a rectangular one."""
    return mpf(height) / mpf(length) ** 2 * sqrt(mpf(E) / (12 * mpf(density))) / (2 * pi)


def sdll10():
    """Return the frequencies [Hz] of SDLL10, whose width is .03 exp(-2 x)."""
    field = [(-mpf("1.2")) ** k / factorial(k) for k in range(60)]
    unit = steel("0.6", "0.01")
    return [unit * w for w in zeros(partial(determinant, ends=("clamped", "clamped"), EI=field,
                                            rho=field), 4, 5)]


def sdll15():
    """Return the frequencies [Hz] of a tube with a mass of 1000 kg at its tip, in one plane."""
    outer, inner, length = mpf("0.175"), mpf("0.16"), 10
    rho = 7800 * pi * (outer ** 2 - inner ** 2)
    unit = sqrt(mpf("2.1e11") * pi / 4 * (outer ** 4 - inner ** 4) / (rho * length ** 4)) / (2 * pi)
    return [unit * w for w in tip_mass(1000 / (rho * length), 4)]


def tip_mass(mass, count):
    """Return omega of a unit cantilever with a mass at its tip."""
    return zeros(partial(determinant, ends=("clamped", "free"), mass=lambda _: mass), count,
                 mpf("0.5"))


def hose():
    """Return omega [rad/s] of the structure of the paper's Table 4.1."""
    rho, EI, length, tip, m, k = map(mpf, ("0.03", "80", "4", "0.15", "0.04", "0.3"))
    unit = sqrt(EI / (rho * length ** 4))

    def carried(omega2):
        return (tip + m * k / (k - m * omega2 * unit ** 2)) / (rho * length)

    # The determinant has a pole at the frequency of the hose alone.
    return [unit * w for w in zeros(partial(determinant, ends=("clamped", "free"), mass=carried), 5,
                                    mpf("0.05"))]


def spans(count):
    """Return the frequencies [Hz] of five spans of length 1, with E I = 1 and rho = 1e-4."""
    def bend(k, x):
        return (coth(x) - cot(x) + (csc(x) - csch(x)) * cos(k * pi / 5)) * sin(x)

    found = [pi] + [zeros(partial(bend, k), 1, mpf("0.1"), 3)[0] for k in range(1, 5)]
    found = [*sorted(found), 2 * pi]
    return [x ** 2 * 100 / (2 * pi) for x in found[:count]]


def sdll04(share, count=3):
    """Return the frequencies [Hz] of SDLL04, with a sprung mass of a share of the beam's."""
    share = mpf(share)
    if not share:
        return [k ** 2 * pi / 2 for k in (1, 2)]
    mass, spring = 780 * share, mpf("75979.1") * share
    a, b, length = mpf("7.5"), mpf("2.5"), 10

    def characteristic(f):
        omega2 = (2 * pi * f) ** 2
        r = sqrt(sqrt(omega2 * 78 / mpf("7.8e5")))
        # Receptance of the beam at the mass; 1 = omega^2 (dynamic mass) receptance.
        receptance = (sin(r * a) * sin(r * b) / sin(r * length)
                      - sinh(r * a) * sinh(r * b) / sinh(r * length)) / (2 * mpf("7.8e5") * r ** 3)
        return (1 + mass * omega2 * spring / (spring - mass * omega2) * receptance * -1) \
            * sin(r * length) * (spring - mass * omega2)

    return zeros(characteristic, count, mpf("0.01"), 1)


def buckling(ends):
    """Return the compression that buckles a uniform unit beam."""
    return zeros(lambda force: determinant(mpf(0), ends, N=(-force,)), 1, mpf("0.7"))[:1]


def standing():
    """Return the weight per length that buckles a unit cantilever which stands upright."""
    return zeros(lambda g: determinant(mpf(0), ("clamped", "free"), N=(-g, g)), 1, 1)


def hanging():
    """Return omega of a unit cantilever that hangs under a weight per length of 20."""
    return zeros(partial(determinant, ends=("clamped", "free"), N=(20, -20)), 3, 1)


KINDS = list(RIGID)
PAIRS = [f"{a}-{b}" for i, a in enumerate(KINDS) for b in KINDS[i:]]
BENCHMARKS = {
    **{pair: partial(uniform, *pair.split("-")) for pair in PAIRS},
    "free-bar": lambda: [x ** 2 * steel("0.12", "0.005", density="7850")
                         for x in uniform("free", "free")],
    "sdll04": partial(sdll04, "0"),
    "sdll04-001": partial(sdll04, "0.001"),
    "sdll04-010": partial(sdll04, "0.01"),
    "sdll09": lambda: taper("0.25", "0.25", steel("1", "0.04"), 5),
    "sdll09-wide": lambda: taper("0.25", "0.2", steel("1", "0.04"), 5),
    "sdll10": sdll10,
    "sdll15": sdll15,
    "five-spans": partial(spans, 6),
    "wedge-0.5": partial(taper, "0.5", "1"),
    "wedge-0.2": partial(taper, "0.2", "1"),
    "tip-mass": partial(tip_mass, 1, 5),
    "table-4.1": hose,
    "hanging": hanging,
}
SOLVED: dict[str, list] = {}


def exact(benchmark, quantity):
    """Return the exact value of a row of the table."""
    name, _, mode = quantity.partition(" ")
    if name == "compression":
        return buckling(benchmark.split("-"))[0]
    if name == "gravity":
        return standing()[0]
    if benchmark not in SOLVED:
        SOLVED[benchmark] = BENCHMARKS[benchmark]()
    return SOLVED[benchmark][int(mode) - 1]


def main():
    """Compare or write the exact values."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="replace the values in the table")
    write = parser.parse_args().write
    with open(FOLDER / "benchmarks.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    differing = 0
    for row in rows:
        value = exact(row["benchmark"], row["quantity"])
        if not row["exact"] or abs(mpf(row["exact"]) / value - 1) > mpf("1e-14"):
            differing += 1
            print(row["benchmark"], row["quantity"], row["published"], mp.nstr(value, 16))
        row["exact"] = mp.nstr(value, 16)
    if write:
        with open(FOLDER / "benchmarks.csv", "w", newline="") as file:
            table = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
            table.writeheader()
            table.writerows(rows)
        # Close to the ends the places lie close together, because a natural spline errs there.
        with open(FOLDER / "sdll10_width.csv", "w") as file:
            file.write("x,width\n")
            for angle in linspace(0, pi, 121):
                x = mpf("0.3") * (1 - cos(angle))
                file.write(f"{mp.nstr(x, 17)},{mp.nstr(mpf('0.03') * exp(-2 * x), 17)}\n")
    return differing > 0 and not write


if __name__ == "__main__":
    sys.exit(main())
