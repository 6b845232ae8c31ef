"""What the program says of the input while it is being edited: natural frequencies, checks, onset.

Every judgement is the program's. This module writes the case as it stands, asks the package
`beamid`, and finds the field of the page that each sentence concerns.
"""
from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import beamid
import cases
import numpy as np
import signals

from beamid_studio.case_model import STRUCTURE, Case, number_text
from beamid_studio.records import Record

#: A field of the page: group and key of the case file.
Field = tuple[str, str]
#: Fields that a sentence without a key concerns, by words of the sentence.
CONCERNS: tuple[tuple[str, Field], ...] = (
    ("time stamps look like", ("record", "times")), ("check rate or the time stamps",
                                                     ("record", "times")),
    ("Nyquist", ("record", "times")), ("in the name of the column", ("record", "scale")),
    ("the motion begins", ("record", "t_first")), ("t_first", ("record", "t_first")),
    ("t_last", ("record", "t_last")), ("scale", ("record", "scale")),
    ("in the window", ("record", "t_first")), ("clip", ("record", "value")),
    ("no parameter counts as determined", ("stage", "free")))
ADVICE = re.compile(r"add '(\w+)' to free")
#: Advice in the words of the command line, and in those of the page.
WORDS: tuple[tuple[re.Pattern[str], str], ...] = tuple(
    (re.compile(old), new) for old, new in (
        (("may exaggerate it: if the length or a position has a &prior, add it to free, keep the "
          "prior, and run `beamid profile`"),
         "may exaggerate it: tick what has a standard deviation as well, and use Profile"),
        ("set more elements", "set more elements in the case file"),
        ("add (it|them) to free and keep (its|their) &prior",
         r"tick \1 and keep \2 standard deviation"),
        (ADVICE.pattern, r"estimate \1"),
        ("state a &prior", "state a standard deviation"),
        (r"Begin at this time \(t_first=([-+.\deE]+)\)", r"Begin at \1"),
        (r"these times \(t_first\)", "these times"),
        ("columns, t_first and t_last, or use start='case'", "columns and its window")))
NAMED = re.compile(r"&(\w+) (\w+):")
BEGIN = re.compile(r"Begin at (-?[\d.]+(?:[eE][-+]?\d+)?), and fit again")
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
    record: int | None = None    #: place of the record that it concerns, if it is about one

    @property
    def begin(self) -> str:
        """The time at which the program proposes to begin; '' if it proposes none."""
        found = BEGIN.search(self.text)
        return found[1] if found else ""


@dataclass
class Found:
    """What the program says of a case before a fit."""

    frequencies: np.ndarray = field(default_factory=lambda: np.empty(0))
    damping: np.ndarray = field(default_factory=lambda: np.empty(0))
    x: np.ndarray | None = None
    shapes: np.ndarray | None = None    #: (modes, points), complex if damped
    #: relative change of E by the error of a parameter that `SENSOR_ERRORS` states
    effects: dict[str, float] = field(default_factory=dict)
    remarks: list[Remark] = field(default_factory=list)

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
    text = re.sub(r"^&\w+: (?:\S*\.csv: )?", "", text)
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
    text = in_words_of_page(text)
    return Remark(text[:1].upper() + text[1:] if re.match(r"[a-z]+[ :,]", text) else text, place,
                  kind, advice[1] if advice else "")


def in_words_of_page(text: str) -> str:
    """Return a text of the program with the words of the page in its advice."""
    for old, new in WORDS:
        text = old.sub(new, text)
    return text


def modes_of(case: Case, folder: Path, found: Found) -> None:
    """Add natural frequencies and mode shapes of the structure as it stands, or what is wrong."""
    path = folder / "structure.nml"
    case = case.copy()
    # A record may have a length of the beam and a place of the sensor of its own.
    for key, group in (("length", "beam"), ("x_s", "sensor"), ("x_p", "support")):
        if case.get("record", key) and case.all(group):
            case.set(group, key, case.get("record", key))
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


#: What the page calls a parameter of the sensor, and an error relative to it, whose effect tells
#: whether it must be known well.
SENSOR_ERRORS = {"m_S": ("mass", 0.1), "x_S": ("place", 0.005)}
#: The effect on E from which such an error counts: half of that of 1 mm in a length of 200 mm.
LEAST_EFFECT = 0.005


def effects_of_sensor(case: Case, folder: Path, found: Found) -> None:
    """Add by how much errors of mass and place of the sensor move E, which keeps frequency 1.

    Nothing is added for a parameter that is estimated, or has a standard deviation.
    """
    if len(case.all("sensor")) != 1 or not found.frequencies.size:
        return
    free = {name.lower() for name in case.free}
    for name, (_, error) in SENSOR_ERRORS.items():
        value = float(number_text(case.get("sensor", name.lower()) or "0") or 0)
        if value <= 0 or case.prior(name) or name.lower() in free:
            continue
        # Towards the clamp, because the sensor may stand at the tip.
        changed, after = case.copy(), Found()
        changed.set("sensor", name.lower(), repr((1 - error) * value))
        modes_of(changed, folder, after)
        if after.frequencies.size:
            found.effects[name] = abs(float((found.frequencies[0] / after.frequencies[0])**2 - 1))


#: A structure in place of one that is not complete: only the samples are of interest then. Its
#: first natural frequency is that of the record, and its units have no labels, so that the program
#: finds nothing to compare.
PLACEHOLDER = "&beam length=1, E={modulus!r}, rho=1, I=1 /"


def check_record(case: Case, folder: Path, record: Record, found: Found,
                 used: dict[str, np.ndarray]) -> float | None:
    """Add what the program says of a record in time, while the beam is not described yet.

    Returns the onset. The arguments are those of `check_fit`.
    """
    part = slice(0, 100_000)
    t = record.t
    frequency = signals.lowest_mode(t[part], record.z[part]) or 10 / (t[-1] - t[0])
    modulus = float(2 * np.pi * frequency / 1.8751**2)**2
    trial = Case(PLACEHOLDER.format(modulus=modulus))
    trial.add("record").update(case.first("record"))
    return samples_used(trial, folder, record, found, used)


def check_fit(case: Case, folder: Path, record: Record, found: Found,
              used: dict[str, np.ndarray]) -> float | None:
    """Add the program's checks of a case with its records, without the search.

    record  that is edited
    used    times that a fit uses, by the group of the record; extended on return

    Returns the onset of the record, behind a quiet lead-in; None without one.
    """
    path = folder / "check.nml"
    try:
        if case.all("stage"):
            path.write_text(case.text(), encoding="utf-8")
            beamid.load(path)
    except beamid.BeamidError as error:
        add_errors(error, found, path.read_text(encoding="utf-8"))
        return None
    finally:
        path.unlink(missing_ok=True)
    if record.kind != "time" or not record.is_ready:
        return None
    trial = case.copy()
    for name in ("stage", "multistart", "prior", "record", "excitation"):
        trial.remove(name)
    trial.add("record").update(case.first("record"))
    return samples_used(trial, folder, record, found, used,
                        case.get("excitation", "kind").lower() == "free")


def samples_used(trial: Case, folder: Path, record: Record, found: Found,
                 used: dict[str, np.ndarray], is_free: bool = True) -> float | None:
    """Add what the program says of the samples of a record, and return its onset.

    A fit of the offset alone, as of a free decay, tells which samples are used.

    trial    a structure and the record
    is_free  whether the record is a free decay; no other motion has an onset
    """
    path = folder / "check.nml"
    trial.add("excitation").update(kind=["'free'"], modes=["1"])
    trial.add("stage").update(free=["'offset'"], start=["'case'"])

    def times() -> np.ndarray:
        key = trial.text(("record",))
        if key not in used:
            path.write_text(trial.text(), encoding="utf-8")
            used[key] = beamid.load(path).fit(judge=False).t
        return used[key]

    try:
        t = times()
    except beamid.BeamidError as error:
        if is_free:
            add_errors(error, found)
        return None
    finally:
        path.unlink(missing_ok=True)
    if not t.size:
        return None
    if is_free and record.get("t_first"):
        trial.chosen = 0
        trial.set("record", "t_first", None)
        try:
            onset = float(times()[0])
        except (beamid.BeamidError, IndexError):    # before the window there is no more to say
            onset = -np.inf
        finally:
            path.unlink(missing_ok=True)
        if t[0] < onset and onset > record.t[0]:
            found.remarks.append(Remark(
                f"The motion begins at {onset:.6g} s; the window begins before it. Begin at "
                f"{onset:.6g} s or later.", ("record", "t_first")))
    window = np.count_nonzero((record.t >= t[0]) & (record.t <= t[-1]))
    if "thin" not in record.keys and window > t.size:
        found.remarks.append(Remark(
            f"{window - t.size} of {window} samples are at a limit of the recorder (clipped); "
            "the fit leaves them out.", ("record", "value"), "note"))
    onset = float(t[0])
    return onset if is_free and not record.get("t_first") and onset > record.t[0] else None


def add_errors(error: beamid.BeamidError, found: Found, text: str = "") -> None:
    """Add the lines of an error, each once, and the record that each is about.

    text  of the case file whose lines the error names
    """
    groups = [place for name, _, place in cases.read_groups(text) if name == "record"]
    for line in str(error).splitlines():
        remark = remark_of(line, "error")
        number = re.match(r"(?:beamid: )?\S*\.nml:(\d+):", line)
        if number and len(groups) > 1:
            at = sum(map(len, text.splitlines(keepends=True)[:int(number[1]) - 1]))
            remark.record = next((k for k, (begin, end) in enumerate(groups)
                                  if begin <= at < end), None)
        if remark.text not in {other.text for other in found.remarks}:
            found.remarks.append(remark)


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
