"""A parameter that is followed through a long record, block by block."""
from __future__ import annotations

import os
from ctypes import byref, c_int
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._cases import (IN_MEMORY, Group, Groups, Names, case_text, check_keys, given,
                     open_case)
from ._library import Handle, InputError, call, compute, kind_of, numbers

_FLAGS = ("", "moving", "unseen", "gap")


@dataclass(frozen=True)
class TrackedWindow:
    """The followed parameter in one window.

    Attributes
    ----------
    first : float
        Time of the first sample [time].
    last : float
        Time of the last sample [time].
    estimate : float
        Estimate [unit of the parameter].
    lower : float
        Lower end of the 95 % interval.
    upper : float
        Upper end of the 95 % interval.
    misfit : float
        Share of the energy that the model does not explain.
    milliseconds : float
        Processor time that the window took.
    flag : str
        '': none. 'moving': one set of parameters does not explain the window. 'unseen': the
        motion is too small to determine the parameter. 'gap': too few samples.
    """

    first: float
    last: float
    estimate: float
    lower: float
    upper: float
    misfit: float
    milliseconds: float
    flag: str


class Tracker:
    """Follows a parameter while samples arrive, as the command `track` does.

        tracker = beamid.Tracker(track=dict(parameter="x_P", window=0.5, hop=0.01, rate=0.05),
                                 beam=dict(...), support=dict(x_P=0.08), sensor=dict(x_S=0.338),
                                 excitation=dict(kind="free", modes=2), free=["x_P", "c_D"])
        for t, a in blocks:
            for window in tracker.feed(t, a):
                print(window.last, window.estimate, window.flag)

    The other arguments are those of `Problem`, which describes them with their units: `free`;
    `beam`, `tip`, `mass`, `hose`, `sensor`, `support`, `end`, `gravity`, `axial`, `along`,
    `excitation`; `discretization`, `prior`; `units`; and any other group, `other`.

    Parameters
    ----------
    case : str or os.PathLike, optional
        Path of a case file with the group &track, as the only argument.
    track : mapping
        `parameter`, the name of a parameter that is free; length `window` of a window and `hop`
        from one window to the next [time]; `rate`, the standard deviation of its random walk [unit
        of the parameter/sqrt(time)]; `frequency_error`, the standard deviation of the relative
        error of the model's natural frequencies.
    record : mapping, optional
        `scale`, `offset`, `sd`, `sensor` and other keys of a record.

    Raises
    ------
    InputError
        If the arguments are incomplete or contradict one another.
    ComputationError
        If the model cannot be computed.
    """

    def __init__(self, case: str | os.PathLike[str] | None = None, *, track: Group = None,
                 record: Group = None, free: Names | None = None, beam: Group = None,
                 tip: Group = None, mass: Groups = None, hose: Groups = None,
                 sensor: Groups = None, support: Groups = None, end: Groups = None,
                 gravity: Group = None, axial: Group = None, along: Groups = None,
                 excitation: Groups = None, discretization: Group = None, prior: Groups = None,
                 units: Group = None, **other: Any) -> None:
        groups = given(locals(), "case", "record", "free")
        if case is None:
            check_keys("track", other)
            stages = [] if free is None else [{"free": free}]
            text = case_text([record or {}], stages, groups)
            opened = open_case(IN_MEMORY, text, [], fits=False)
        else:
            if not isinstance(case, (str, os.PathLike)):
                raise InputError(f"Tracker: found {kind_of(case)}, expected the path of a case "
                                 "file, or the arguments of a case: track=dict(...), "
                                 "beam=dict(...), free=[...] and so on")
            if record or free or any(keys is not None for keys in groups.values()):
                raise InputError("Tracker: found arguments beside a case, expected the case alone")
            opened = open_case(str(Path(case)), "", [], fits=False)
        self._handle = Handle()
        compute("beamid_track_begin", opened.number, byref(self._handle.number))

    def feed(self, t: ArrayLike, a: ArrayLike) -> list[TrackedWindow]:
        """Take a block of samples, and return the windows that it completes.

        Parameters
        ----------
        t : array_like of shape (n,)
            Times, ascending, later than those before [time].
        a : array_like of shape (n,)
            Values in the unit of the record.

        Raises
        ------
        InputError
            If times do not increase, or a number is not finite. The block is then not used.
        """
        t, a = numbers(t, "feed: times"), numbers(a, "feed: values")
        if t.size != a.size:
            raise InputError(f"feed: found {t.size} times and {a.size} values, expected as many")
        rows = c_int()
        with self._handle.lock:
            compute("beamid_track_take", self._handle.number, t.size, t.ctypes.data, a.ctypes.data,
                    byref(rows))
            values = np.empty((rows.value, 8))
            call("beamid_track_rows", self._handle.number, rows.value, values.ctypes.data)
        names = ("first", "last", "estimate", "lower", "upper", "misfit", "milliseconds")
        return [TrackedWindow(flag=_FLAGS[int(row[7])], **dict(zip(names, row)))
                for row in values.tolist()]
