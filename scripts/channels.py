"""Channels of a recorder's file, as the readers of to_csv.py return them."""

import math
from dataclasses import dataclass, field

REMARKS: list[str] = []             # on what is left out


@dataclass
class Channel:
    """Samples; their times, if the file states them; remarks of the file on them."""

    name: str
    values: object
    unit: str = ""
    times: object = None
    time_unit: str = ""
    notes: list = field(default_factory=list)
    measured: str = ""          # acceleration, velocity, displacement or force, if the file says so


class BadTimes(Exception):
    """A rate, a step or times that cannot be those of a record."""


def stepped(n, step, start=0.0, rate=None, name="the step"):
    """Returns the times of n samples; by the rate if the file has a rate, so that they are rounded
    once. Raises BadTimes if they do not grow; `name` is that of the rate or step in the file."""
    import numpy as np
    given = step if rate is None else rate
    if not 0 < given < math.inf:
        raise BadTimes(f"{name}: found {given}, expected a finite value above 0")
    times = start + (np.arange(n) / rate if rate else np.arange(n) * step)
    if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise BadTimes(f"{name}: found {given}, which with the start {start} makes no times that "
                       "grow from sample to sample")
    return times


def text_of(value):
    """Returns text as one line."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return " ".join(str(value).split())
