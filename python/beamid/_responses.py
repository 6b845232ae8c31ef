"""The response of a structure, with exact derivatives."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._cases import (IN_MEMORY, Group, Groups, Names, case_text, checked_names, given,
                     open_case)
from ._fits import describe_arguments
from ._library import InputError, compute, numbers


@dataclass
class Response:
    """The response of a structure at given times.

    Attributes
    ----------
    t : ndarray
        Times, shape (n,) [time].
    acceleration : ndarray
        Acceleration that the accelerometer reads, shape (n,) [length/time²].
    displacement : ndarray
        Displacement at the sensor, shape (n,) [length].
    velocity : ndarray
        Velocity at the sensor, shape (n,) [length/time].
    derivatives : dict[str, ndarray]
        Derivatives of the acceleration with respect to the named parameters, each of shape
        (n,).
    """

    t: np.ndarray
    acceleration: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    derivatives: dict[str, np.ndarray]


@describe_arguments
def response(t: ArrayLike, *, derivatives: Names = (), beam: Group = None, tip: Group = None,
             mass: Groups = None, hose: Groups = None, sensor: Groups = None,
             support: Groups = None, end: Groups = None, gravity: Group = None, axial: Group = None,
             along: Groups = None, excitation: Groups = None, discretization: Group = None,
             integrator: Group = None, observation: Group = None, units: Group = None,
             **other: Any) -> Response:
    """Compute the response of a structure to a known excitation.

    The other arguments are those of `Problem`, which describes them with their units: `beam`,
    `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`, `axial`, `along`, `excitation`;
    `discretization`, `integrator`, `observation`; `units`; and any other group, `other`.

    Parameters
    ----------
    t : array_like of shape (n,)
        Times, ascending [time].
    derivatives : str or sequence of str
        Names of the parameters with respect to which the acceleration is differentiated.

    Returns
    -------
    Response

    Raises
    ------
    InputError
        If the times are not ascending, or the arguments are incomplete or contradict one another.
    ComputationError
        If the response cannot be computed.
    """
    groups = given(locals(), "t", "derivatives")
    t = numbers(t, "response: times")
    if t.size == 0 or not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise InputError("response: found times that are not ascending, expected finite "
                         "ascending ones")
    names = list(checked_names(derivatives, "derivatives")) if len(derivatives) else []
    text = case_text([{}], [dict(free=names)] if names else [], groups)
    handle = open_case(IN_MEMORY, text, [], fits=False)
    motion = np.empty((3, t.size))
    by = np.empty((len(names), t.size))
    compute("beamid_respond", handle.number, t.size, t.ctypes.data, len(names),
            motion.ctypes.data, by.ctypes.data)
    acceleration, displacement, velocity = motion
    return Response(t, acceleration, displacement, velocity, dict(zip(names, by)))
