#!/usr/bin/env python3
"""Simulates records of beams by independent finite elements, fits them by `beamid identify`, and
compares the total intervals with the true values. Prints a row for each trial and a summary.

  hard       strips of a laboratory: weak mode 2, multiples of mode 1, mains hum, gaps, 12 bits
  careless   plain strips; E in the case is wrong by up to 30 %, m_S by a factor of 3; one to three
             modes are visible, and the window begins up to 6 s late
  folds      the same with two visible modes, whose frequencies belong to two values of m_S
  joint      four strips of uncertain lengths in an elastic clamp, fitted together, with the default
             start and with start='case'
  errors     four errors of the model: damping that grows by 10 % at full amplitude, a frequency
             that grows by 1 %, an unknown mass of 3 g, an elastic clamp
  damage     beams with a dip of E, with a cut, with a crack, and without damage
  coverage   plain strips; length, thickness and m_S are drawn from the priors of the case
  meshes     plain strips, fitted with 2, 3 or 4 elements
  perfect    exact models and white noise: free decay, release, pulse and moving base
  generator  compares records without noise with those of `beamid simulate`

N is the number of trials, in `errors` and `damage` of each of the four sorts, in `joint` of pairs.
Trial k of a seed does not depend on N. Each trial gets one of these verdicts:

  correct    status 0, every parameter is determined, every total interval holds the true value
  near miss  the same, but the true value is outside an interval by up to half of its half width
  declared   status 0, but not every parameter is determined
  refused    status 1 or 2
  SILENT     a determined parameter is further away from its true value

Other rules: `errors` is correct if the summary names the error or says that such records cannot
show it, `damage` if the place is not determined or its interval holds the true one, and `meshes` if
the summary warns. Errors and meshes of which nothing is said are `not named`. `generator` is right
up to 1e-6 of the largest value of the record. Case, record, true values and results of a trial are
in DIR/<number>-<sort>."""

import os
import re
import subprocess
import time
import zlib
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path

from program import fail, need, new_parser, read_table, release, write_text

need("numpy", "scipy")

import numpy as np  # noqa: E402
from trial_kinds import KINDS  # noqa: E402

LIMIT = 600             # s, the longest fit
EXACT = 1e-6            # of the largest value of a record, what the generator may be wrong by
OUTSIDE = 1.5           # half widths from the middle of an interval: further is a silent error
ALARMS = {              # what a summary says
    "spectral line": r"cannot explain a spectral line",
    "distrust": r"no parameter counts as determined",
    "drift": r"not constant during the motion",
    "score test": r"which (the model leaves out|is fixed), |mean of the residuals is not 0",
    "harmonic": r"look like a harmonic",
    "departure": r"the residuals exceed the noise",
    "held": r"\b(is|are) (held|fixed) at",
    "other minimum": r"another minimum",
    "not a dip": r"not a dip of this shape|does not tell that there is a dip",
    "mesh": r"warning: mesh",
    "no fit": r"^no fit",
}
NAMES = {               # how a summary names an error of the model, or says that it cannot show
    "damping": r"not constant during the motion|may depend on the amplitude",
    "hardening": r"not constant during the motion|may depend on the amplitude",
    "mass": r"not in these intervals:.* mass that the model lacks",
    "clamp": r"k_R, which the model leaves out|not in these intervals: a clamp that yields",
}


@dataclass
class Interval:
    """A total interval: its parameter, whether that is called determined, and the distance of the
    true value from the middle in half widths."""

    name: str
    determined: bool
    distance: float


@dataclass
class Outcome:
    """Exit status, first part of the summary, message, seconds, rows of estimates.csv by parameter,
    and the intervals of the parameters with a true value."""

    status: int
    text: str
    message: str
    seconds: float
    rows: dict
    intervals: list


def case_text(groups):
    """A case file."""
    def entry(value):
        return value if isinstance(value, str) else repr(getattr(value, "item", lambda: value)())

    return "".join(f"&{name} " + ", ".join(f"{key}={entry(value)}" for key, value in keys.items())
                   + " /\n" for name, keys in groups)


def write(trial, folder):
    """Writes case, tables and true values of a trial."""
    write_text(folder / "case.nml", case_text(trial.groups))
    for name, columns in trial.tables.items():
        rows = (",".join(f"{value:.12g}" for value in row) for row in zip(*columns))
        write_text(folder / f"{name}.csv", "\n".join(["t,a", *rows, ""]))
    write_text(folder / "truth.csv", "parameter,value\n" + "".join(
        f"{name},{value:.12g}\n" for name, value in trial.truth.items()))


def run(program, trial, folder):
    """Runs the program on the case in a folder."""
    begin, out = time.monotonic(), folder / "out"
    try:
        done = subprocess.run(
            [program, trial.command, folder / "case.nml", "--out", out, "--quiet"],
            capture_output=True, text=True, timeout=LIMIT,
            env={"OMP_NUM_THREADS": "1", **os.environ})
        status, text, message = done.returncode, done.stdout, done.stderr.strip()
    except subprocess.TimeoutExpired:
        status, text, message = 1, "", f"no end after {LIMIT} s"
    text = re.sub(r"\n    +", " ", text.split("\nStage")[0])
    rows = {}
    if trial.command == "identify" and (out / "estimates.csv").exists():
        rows = {row["parameter"]: row for row in read_table(out / "estimates.csv")}
    intervals = [interval(rows[name], name, true) for name, true in trial.truth.items()
                 if rows.get(name, {}).get("total_lower95")]
    return Outcome(status, text, message, time.monotonic() - begin, rows, intervals)


def interval(row, name, true):
    """The total interval of a row of estimates.csv."""
    lower, upper = float(row["total_lower95"]), float(row["total_upper95"])
    if np.isinf(upper):    # of a spring that may be rigid
        lower, upper, true = -1 / lower, 0.0, -1 / true
    half = (upper - lower) / 2
    distance = abs(true - (lower + upper) / 2) / half if half > 0 else np.inf
    return Interval(name, row["determined"] == "yes", distance)


def judge(kind, trial, outcome):
    """The verdict on a trial."""
    known = [one for one in outcome.intervals if one.determined]
    worst = max((one.distance for one in known), default=0.0)
    if kind == "errors" and re.search(NAMES[trial.sort], outcome.text):
        return "correct"
    if outcome.status:
        return "refused"
    if kind == "meshes" and "warning: mesh" in outcome.text:
        return "correct"
    if trial.sort == "sound" and any(outcome.rows[name]["determined"] == "yes"
                                     for name in ("place", "width", "depth")):
        return "SILENT"
    if worst > OUTSIDE:
        return "SILENT"
    if kind in ("errors", "meshes"):
        return "not named"
    if kind == "damage":
        return "near miss" if worst > 1 else "correct"
    if len(known) < len(trial.truth):
        return "declared"
    return "near miss" if worst > 1 else "correct"


def details(trial, outcome):
    """What else a row says: alarms, parameters that are not determined, and those whose interval
    does not hold the true value."""
    words = [name for name, pattern in ALARMS.items() if re.search(pattern, outcome.text)]
    determined = [one.name for one in outcome.intervals if one.determined]
    if trial.truth and len(determined) < len(trial.truth):
        words.append("determined: " + (" ".join(determined) or "none"))
    words += [f"{one.name} at {one.distance:.2f}{'' if one.determined else ' (not determined)'}"
              for one in outcome.intervals if one.distance > 1]
    if outcome.status and not outcome.rows:
        words.append(outcome.message[:100])
    return "; ".join(words)


def compare(trial, folder, outcome):
    """The verdict on the generator, and the largest difference relative to the largest value."""
    if outcome.status:
        return "refused", outcome.message
    ours = trial.tables["record"][1]
    theirs = [float(row["acceleration"])
              for row in read_table(folder / "out" / "response.csv", "acceleration")]
    if len(theirs) != len(ours):
        return "SILENT", f"{len(theirs)} samples, expected {len(ours)}"
    error = np.abs(ours - theirs).max() / np.abs(ours).max()
    return ("correct" if error < EXACT else "SILENT"), f"{error:.1e}"


def summarise(kind, verdicts, outcomes):
    """Prints the number of each verdict, how many intervals hold the true values, and the number
    of each alarm, by sorts where there are few."""
    sorts = defaultdict(list)
    for (sort, verdict), outcome in zip(verdicts, outcomes):
        few = kind in ("joint", "errors", "damage", "coverage", "meshes", "perfect", "generator")
        sorts[sort if few else "all"].append((verdict, outcome))
    for sort, results in sorts.items():
        counts = Counter(verdict for verdict, _ in results)
        print(f"\n{kind} {sort}: {len(results)} trials: "
              + ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common()))
        held, given = Counter(), Counter()
        for _, outcome in results:
            for one in outcome.intervals:
                for key in [(one.name, "all")] + [(one.name, "determined")] * one.determined:
                    given[key] += 1
                    held[key] += one.distance <= 1
        shares = [f"{name} {held[name, 'all']}/{given[name, 'all']} "
                  f"({held[name, 'determined']}/{given[name, 'determined']})"
                  for name in dict.fromkeys(name for name, _ in given)]
        if shares:
            print("   intervals that hold the true value (if determined): " + ", ".join(shares))
        alarms = Counter(name for _, outcome in results for name, pattern in ALARMS.items()
                         if re.search(pattern, outcome.text))
        if alarms:
            print("   " + ", ".join(f"{name}: {alarms[name]}" for name in ALARMS if alarms[name]))


def main():
    parser = new_parser(__doc__.split("\n\n")[0])
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("n", type=int, metavar="N", help="number of trials")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default: 1)")
    parser.add_argument("--out", metavar="DIR", help="default: out/trials/KIND-SEED")
    arguments = parser.parse_args()
    kind, seed = arguments.kind, arguments.seed
    if arguments.n < 1 or seed < 0:
        fail("found a negative number or none, expected N of 1 or more and a seed of 0 or more")
    program = Path(os.environ.get("BEAMID_PROGRAM") or release()).resolve()
    out = Path(arguments.out or f"out/trials/{kind}-{seed}")
    verdicts, outcomes = [], []
    for k in range(1, arguments.n + 1):
        random = np.random.default_rng([seed, zlib.crc32(kind.encode()), k])
        for trial in KINDS[kind](random, k):
            folder = out / f"{k}-{trial.sort}"
            write(trial, folder)
            outcome = run(program, trial, folder)
            if kind == "generator":
                verdict, words = compare(trial, folder, outcome)
            else:
                verdict, words = judge(kind, trial, outcome), details(trial, outcome)
            print(f"{k:4d} {trial.sort:12s} {verdict:10s} {outcome.seconds:6.1f} s  {words}",
                  flush=True)
            verdicts.append((trial.sort, verdict))
            outcomes.append(outcome)
    summarise(kind, verdicts, outcomes)


if __name__ == "__main__":
    main()
