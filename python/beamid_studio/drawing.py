"""Drawings of the beam and of its modes, as SVG from numbers only."""
from __future__ import annotations

import math
from collections.abc import Sequence

import cases
import numpy as np

from beamid_studio.case_model import Case

WIDTH, LEFT, RIGHT = 720, 60, 660
MIDDLE = 74          #: height of the beam in the drawing
FRAMES = 24          #: pictures of a cycle
MOST_MODES = 4
POINTS = 60          #: of a mode shape


def real(keys: dict[str, list[str]], key: str, default: float = math.nan) -> float:
    """Return a number of a group; the default if there is none that is finite."""
    try:
        found = float(cases.real(keys, key, default))
    except ValueError:
        return default
    return found if math.isfinite(found) else default


def ends_of(case: Case) -> dict[str, str]:
    """Return the kind of each end: clamped, pinned, guided, free, or 'spring'."""
    kinds = {"root": "clamped", "tip": "free"}
    for keys in case.all("end"):
        at = cases.unquoted(keys.get("at", [])).lower()
        if at in kinds:
            kinds[at] = (cases.unquoted(keys["kind"]).lower() if "kind" in keys else
                         "spring" if {"k_w", "k_r"} & set(keys) else kinds[at])
    if "k_r" in case.first("beam"):
        kinds["root"] = "spring"
    return kinds


def end(kind: str, x: float, side: int) -> str:
    """Draw what holds an end; `side` is -1 at the root and 1 at the tip."""
    y = MIDDLE
    if kind == "clamped":
        hatch = "".join(f"M{x} {y - 34 + 14 * k}l{side * 14} {12}" for k in range(5))
        return f'<path d="M{x} {y - 38}V{y + 38}{hatch}"/>'
    if kind == "guided":
        hatch = "".join(f"M{x + side * 12} {y - 34 + 14 * k}l{side * 14} {12}" for k in range(5))
        return (f'<path d="M{x} {y - 22}V{y + 22}M{x + side * 12} {y - 38}V{y + 38}{hatch}"/>'
                f'<circle cx="{x + side * 6}" cy="{y - 14}" r="5"/>'
                f'<circle cx="{x + side * 6}" cy="{y + 14}" r="5"/>')
    if kind == "pinned":
        return (f'<path d="M{x} {y + 4}l-13 22h26z"/><path d="M{x - 20} {y + 27}h40"/>')
    if kind == "spring":
        hatch = "".join(f"M{x + side * 22} {y - 34 + 14 * k}l{side * 14} {12}" for k in range(5))
        return (f'<path d="M{x + side * 22} {y - 38}V{y + 38}{hatch}"/>'
                f'<path d="M{x} {y}c{side * 30} -26 {side * 30} 26 {side * 4} 18'
                f'c{-side * 14} -6 0 -22 {side * 12} -14"/>')
    return ""


def beam(case: Case) -> str:
    """Return a drawing of the beam with its ends, attachments and sensors, to scale along x."""
    length = real(case.first("beam"), "length")
    if not length > 0:
        return ""

    def at(x: float) -> float:
        return LEFT + (RIGHT - LEFT) * min(max(x / length, -0.03), 1.04)

    y, shapes, names = MIDDLE, [], []
    kinds = ends_of(case)
    height = real(case.first("beam"), "height", 0.0)
    thick = min(max(height / length * (RIGHT - LEFT), 4), 16)
    shapes += [end(kinds["root"], LEFT, -1), end(kinds["tip"], RIGHT, 1)]
    shapes.append(f'<rect class="body" x="{LEFT}" y="{y - thick / 2}" width="{RIGHT - LEFT}" '
                  f'height="{thick}" rx="1"/>')
    def named(x: float, label: str, row: int) -> None:
        names.append((x, label, row))

    for keys in case.all("tip"):
        if real(keys, "m_t", 0.0) > 0:
            shapes.append(f'<rect class="mass" x="{RIGHT - 4}" y="{y - 17}" width="30" height="34"'
                          ' rx="3"/>')
            named(RIGHT + 11, "tip mass", 1)
    for keys in case.all("mass"):
        x = at(real(keys, "x", length))
        shapes.append(f'<circle class="mass" cx="{x:.1f}" cy="{y}" r="11"/>')
        named(x, "mass", 1)
    for keys in case.all("support"):
        x = at(real(keys, "x_p", length))
        shapes.append(f'<path d="M{x:.1f} {y + thick / 2}l-12 20h24z'
                      f'M{x - 18:.1f} {y + thick / 2 + 21}h36"/>')
        named(x, "support", 2)
    for keys in case.all("hose"):
        x = at(real(keys, "x_h", length))
        shapes.append(f'<path d="M{x:.1f} {y + thick / 2}l6 6l-12 6l12 6l-12 6l6 6"/>'
                      f'<rect class="mass" x="{x - 11:.1f}" y="{y + thick / 2 + 30}" width="22" '
                      'height="16" rx="2"/>')
        named(x, "absorber", 3)
    for keys in case.all("sensor"):
        place = real(keys, "x_s", length)
        x = at(place)
        shapes.append(f'<rect class="sensor" x="{x - 9:.1f}" y="{y - thick / 2 - 15}" width="18" '
                      'height="14" rx="2"/>')
        named(x, "sensor" if 0 < place <= length else "sensor, not on the beam", 0)
    force = case.edited("excitation") or {}
    if cases.unquoted(force.get("kind", [])).lower() in ("release", "pulse", "table"):
        x = at(real(force, "x_f", length))
        shapes.append(f'<path d="M{x:.1f} {y + thick / 2 + 34}v-30m-5 9l5 -9l5 9"/>')
        named(x, "force", 2)
    heights = (y - thick / 2 - 22, y - 24, y + 52, y + 70)
    words = "".join(f'<text x="{x:.1f}" y="{heights[row]:.0f}" text-anchor="middle">{name}</text>'
                    for x, name, row in names)
    scale = (f'<path class="thin" d="M{LEFT} 138v10M{RIGHT} 138v10M{LEFT} 143H{RIGHT}"/>'
             f'<text x="{(LEFT + RIGHT) / 2}" y="163" text-anchor="middle">{length:g} '
             f'{_word(case.get("units", "length"))}</text>')
    return (f'<svg class="drawing" viewBox="0 0 {WIDTH} 172" role="img" aria-label="The beam, its '
            f'ends ({kinds["root"]}, {kinds["tip"]}) and what is attached to it">'
            f'{"".join(shapes)}{words}{scale}</svg>')


def _word(text: str) -> str:
    """Return a unit that consists of letters only; '' for any other text."""
    return text if text.isascii() and text.isalpha() and len(text) < 8 else ""


def modes(x: np.ndarray | None, shapes: np.ndarray | None, frequencies: np.ndarray,
          damping: np.ndarray, hertz: str = "Hz", names: Sequence[str] = ()) -> str:
    """Return a moving picture of each of the lowest modes, all at the same pace.

    names  numbers of the modes; none: 1, 2, ...
    """
    if x is None or shapes is None or len(x) < 2:
        return ""
    every = max(1, len(x) // POINTS)
    pieces = []
    for k in range(min(MOST_MODES, len(shapes), len(frequencies))):
        name = names[k] if names else k + 1
        shape = shapes[k][::every]
        across = 16 + 328 * (x[::every] - x[0]) / (x[-1] - x[0])

        def path(turn: complex, shape: np.ndarray = shape, across: np.ndarray = across) -> str:
            y = 46 - 34 * (shape * turn).real
            return "M" + "L".join(f"{a:.0f} {b:.1f}" for a, b in zip(across, y))

        cycle = [path(np.exp(2j * np.pi * frame / FRAMES)) for frame in range(FRAMES + 1)]
        pieces.append(
            f'<figure><svg viewBox="0 0 360 92" role="img" aria-label="mode {name}">'
            '<path class="thin" d="M16 46H344"/>'
            f'<path class="ghost" d="{cycle[0]}"/><path class="ghost" d="{cycle[FRAMES // 2]}"/>'
            f'<path class="mode mode{k + 1}" d="{cycle[0]}"><animate attributeName="d" dur="2.4s" '
            f'repeatCount="indefinite" values="{";".join(cycle)}"/></path></svg>'
            f"<figcaption><b>{name}</b> {frequencies[k]:.5g} {_word(hertz)}, damping ratio "
            f"{damping[k]:.3g}</figcaption></figure>")
    return f'<div class="modes">{"".join(pieces)}</div>' if pieces else ""
