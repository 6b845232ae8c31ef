"""What the program says of the input while it is being edited: natural frequencies, checks, onset.

Every judgement is the program's. This module writes the case as it stands, asks the package
`beamid`, and finds the field of the page that each sentence concerns.
"""
from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import beamid
import numpy as np
import signals

from beamid_studio.case_model import STRUCTURE, Case

#: A field of the page: group and key of the case file.
Field = tuple[str, str]
#: Fields that a sentence without a key concerns, by words of the sentence.
CONCERNS: tuple[tuple[str, Field], ...] = (
    ("time stamps look like", ("record", "times")), ("check rate or the time stamps",
                                                     ("record", "times")),
    ("Nyquist", ("record", "times")), ("in the name of the column", ("record", "scale")),
    ("the motion begins", ("record", "t_first")), ("t_first", ("record", "t_first")),
    ("t_last", ("record", "t_last")), ("scale", ("record", "scale")),
    ("clip", ("record", "value")), ("no parameter counts as determined", ("stage", "free")))
ADVICE = re.compile(r"add '(\w+)' to free")
NAMED = re.compile(r"&(\w+) (\w+):")
#: Group of each parameter that a sentence of the verdict may begin with.
GROUPS = {"E": "beam", "c_D": "beam", "gamma": "beam", "length": "beam", "height": "beam",
          "width": "beam", "density": "beam", "k_R": "beam", "m_S": "sensor", "x_S": "sensor",
          "m_T": "tip"}


@dataclass
class Remark:
    """A sentence of the program, and the field that it concerns."""

    text: str
    field: Field = ("", "")
    kind: str = "warning"    #: or "error", which stands in the way of a fit, or "note"
    advice: str = ""         #: name of the parameter that the program proposes to estimate


@dataclass
class Found:
    """What the program says of a case before a fit."""

    frequencies: np.ndarray = field(default_factory=lambda: np.empty(0))
    damping: np.ndarray = field(default_factory=lambda: np.empty(0))
    x: np.ndarray | None = None
    shapes: np.ndarray | None = None    #: (modes, points), complex if damped
    remarks: list[Remark] = field(default_factory=list)
    onset: float | None = None          #: start of the motion, behind a quiet lead-in
    used: int = 0                          #: samples that a fit uses

    @property
    def has_errors(self) -> bool:
        """Whether something stands in the way of a fit."""
        return any(remark.kind == "error" for remark in self.remarks)


def remark_of(text: str, kind: str = "warning") -> Remark:
    """Return a sentence with its field.

    Names of files and places in them are left out: the page has fields in their place.
    """
    text = " ".join(text.split())
    text = re.sub(r"^(?:beamid: )?(?:\S*\.nml|beamid)(?::\d+)?: ", "", text)
    advice = ADVICE.search(text)
    named = NAMED.search(text)
    first = re.match(r"(\w+) is ", text)
    place: Field = ("", "")
    if named:
        place = (named[1].lower(), named[2].lower())
        text = text.replace(named[0], "", 1).strip()
    elif advice:
        place = ("stage", advice[1].lower())
    elif first and first[1] in GROUPS:
        place = (GROUPS[first[1]], first[1].lower())
    else:
        place = next((where for words, where in CONCERNS if words in text), place)
    return Remark(text[:1].upper() + text[1:] if re.match(r"[a-z]+[ :,]", text) else text, place,
                  kind, advice[1] if advice else "")


def modes_of(case: Case, folder: Path, found: Found) -> None:
    """Add natural frequencies and mode shapes of the structure as it stands, or what is wrong."""
    path = folder / "structure.nml"
    path.write_text(case.text(STRUCTURE), encoding="utf-8")
    try:
        modes = beamid.modes(path)
    except beamid.BeamidError as error:
        found.remarks += [remark_of(line, "error") for line in str(error).splitlines()]
        return
    oscillates = modes.damping_ratios < 1
    found.frequencies = modes.frequencies[oscillates]
    found.damping = modes.damping_ratios[oscillates]
    if "shapes.csv" in modes.tables:
        found.x, found.shapes = modes.x, modes.shapes


#: A structure in place of one that is not complete: only the samples are of interest then. Its
#: first natural frequency is that of the record, and its units have no labels, so that the program
#: finds nothing to compare.
PLACEHOLDER = "&beam length=1, E={modulus!r}, rho=1, I=1 /"


def check_record(case: Case, folder: Path, t: np.ndarray, z: np.ndarray, found: Found,
                 used: dict[str, np.ndarray]) -> None:
    """Add what the program says of the record alone, while the beam is not described yet.

    t, z  (m) times and values of the record
    used  as `check_fit` takes it
    """
    part = slice(0, 100_000)
    frequency = signals.lowest_mode(t[part], z[part]) or 10 / (t[-1] - t[0])
    modulus = float(2 * np.pi * frequency / 1.8751**2)**2
    trial = Case(PLACEHOLDER.format(modulus=modulus))
    trial.groups += [group for group in Case(case.text()).groups
                     if group[0] in ("excitation", "record")]
    check_fit(trial, folder, t, found, used)


def check_fit(case: Case, folder: Path, samples: np.ndarray, found: Found,
              used: dict[str, np.ndarray]) -> None:
    """Add the program's checks of a case with its record, without the search.

    The case is opened as for a fit. A fit of the offset alone then tells which samples are used.

    samples  (m) times of the record
    used     times that a fit uses, by the groups that decide on them; extended on return
    """
    path = folder / "check.nml"
    key = case.text(("record", "excitation"))
    try:
        if case.all("stage"):
            path.write_text(case.text(), encoding="utf-8")
            beamid.load(path)
        if key not in used:
            trial = Case(case.text())
            trial.remove("stage")
            trial.remove("multistart")
            trial.add("stage").update(free=["'offset'"], start=["'case'"])
            path.write_text(trial.text(), encoding="utf-8")
            used[key] = beamid.load(path).fit(judge=False).t
        t = used[key]
    except beamid.BeamidError as error:
        found.remarks += [remark_of(line, "error") for line in str(error).splitlines()
                          if line not in {remark.text for remark in found.remarks}]
        return
    finally:
        path.unlink(missing_ok=True)
    if not t.size:
        return
    found.used = t.size
    window = np.count_nonzero((samples >= t[0]) & (samples <= t[-1]))
    if "thin" not in case.first("record") and window > t.size:
        found.remarks.append(Remark(
            f"{window - t.size} of {window} samples are at a limit of the recorder (clipped); "
            "the fit leaves them out.", ("record", "value"), "note"))
    if not case.get("record", "t_first") and samples.size and t[0] > samples[0]:
        found.onset = float(t[0])


def verdict_remarks(summary: str) -> list[Remark]:
    """Return the sentences of a fit's summary that make reservations, each with its field.

    They stand above the quality of the records; those about what is not determined stand below.
    """
    above = summary.partition("\nrecord 1:")[0] if not summary.startswith("record 1:") else ""
    joined = re.sub(r"\n {4}", " ", above)
    pieces: list[str] = []
    for line in joined.splitlines():
        pieces += line.split("; ") if line.startswith("no fit") else [line]
    below = re.sub(r"\n {4}", " ", summary)
    pieces += [line for line in below.splitlines()
               if line.startswith(("not determined", "warning:"))]
    return [remark_of(piece, "error" if piece.startswith("no fit") else "warning")
            for piece in dict.fromkeys(pieces) if piece.strip()]
