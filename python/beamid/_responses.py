"""The response of a structure, with exact derivatives."""
from __future__ import annotations

from ctypes import byref, c_int
from dataclasses import dataclass
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._cases import case_text
from ._library import Handle, InputError, compute, numbers


@dataclass
class Response:
    """At the times asked for."""

    t: np.ndarray
    acceleration: np.ndarray               #: (n) as the accelerometer has it
    displacement: np.ndarray               #: (n) of the sensor's place
    velocity: np.ndarray
    derivatives: dict[str, np.ndarray]     #: of the acceleration, by the parameters asked for


def response(t: ArrayLike, *, derivatives: Sequence[str] = (), **groups: Any) -> Response:
    """Response of a structure to a known excitation, as `beamid simulate` computes it.

    t            (n) ascending times
    derivatives  names of parameters
    groups       of a case file, as of `Problem`: beam=dict(...), excitation=dict(...), ...
    """
    t = numbers(t, "response: times")
    if t.size == 0 or not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise InputError("response: found times that are not ascending, expected finite "
                         "ascending ones")
    names = [derivatives] if isinstance(derivatives, str) else list(derivatives)
    text = case_text([{}], [dict(free=names)] if names else [], groups).encode()
    handle = Handle()
    compute("beamid_open", b"beamid", 6, text, len(text), 0, (c_int*1)(), 0, None, None, 0,
         byref(handle.number))
    motion = np.empty((3, t.size))
    by = np.empty((len(names), t.size))
    compute("beamid_respond", handle.number, t.size, t.ctypes.data, len(names),
            motion.ctypes.data, by.ctypes.data)
    acceleration, displacement, velocity = motion
    return Response(t, acceleration, displacement, velocity, dict(zip(names, by)))
