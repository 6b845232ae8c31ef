"""The options of to_csv.py --frf."""
from __future__ import annotations

import math
from dataclasses import dataclass

from program import fail

BEFORE = 0.02    # default pre-trigger, as a share of the block
OPTIONS = ("force", "response", "estimator", "block", "averages", "window", "overlap",
           "exponential", "trigger", "pre_trigger", "rate")


@dataclass
class Settings:
    """How to estimate; times are in seconds."""

    estimator: str = "H1"
    block: float | None = None          # length of a block
    averages: int | None = None         # number of blocks, in place of the length
    window: str = "boxcar"
    overlap: float = 0.0                # share of a block
    exponential: float = 0.0            # decay rate [1/s] of the exponential window
    trigger: float | None = None        # magnitude of the force at a blow
    before: float | None = None         # time before the trigger


def add_options(parser):
    """Adds the options of --frf to a command line."""
    group = parser.add_argument_group("frequency responses of a measured force")
    group.add_argument("--frf", action="store_true",
                       help="estimates the FRF of each response per force")
    group.add_argument("--force", metavar="NAME", help="channel of the force, by name or number")
    group.add_argument("--response", metavar="NAME", nargs="+",
                       help="channels of the responses, by name or number")
    group.add_argument("--estimator", choices=("H1", "H2"), help="H1 (default): for noise in the "
                       "response; H2: for noise in the force")
    group.add_argument("--block", metavar="TIME", type=float, help="length of a block, in s")
    group.add_argument("--averages", metavar="N", type=int, help="number of blocks, in place of "
                       "their length; with --trigger, the number of blows to use (default: all)")
    group.add_argument("--window", choices=("boxcar", "hann"),
                       help="boxcar (default): for responses that decay within the block; hann: "
                       "for continuous excitation")
    group.add_argument("--overlap", metavar="SHARE", type=float,
                       help="overlap of the blocks, from 0 (default) to below 1")
    group.add_argument("--exponential", metavar="RATE", type=float, help="decay rate of an "
                       "exponential window, in 1/s (default: 0, no window)")
    group.add_argument("--trigger", metavar="LEVEL", type=float, help="magnitude of the force at "
                       "which a hammer blow begins; each block contains one blow")
    group.add_argument("--pre-trigger", metavar="TIME", type=float, help="time from the beginning "
                       f"of a block to the trigger, in s (default: {100 * BEFORE:.0f} %% of the "
                       "block)")
    group.add_argument("--rate", metavar="RATE", type=float,
                       help="samples per s of a file without times")


def settings_of(arguments):
    """Returns the settings that the command line states; contradictions end the script."""
    found = {key: getattr(arguments, key) for key in
             ("estimator", "block", "averages", "window", "overlap", "exponential", "trigger")}
    found["before"] = arguments.pre_trigger
    settings = Settings(**{key: value for key, value in found.items() if value is not None})
    triggered = settings.trigger is not None
    for name, value, least in (("block", settings.block, 0), ("trigger", settings.trigger, 0),
                               ("averages", settings.averages, 0), ("rate", arguments.rate, 0)):
        if value is not None and not least < value < math.inf:
            fail(f"--{name}: found {value}, expected a number above {least}")
    for name, value in (("exponential", settings.exponential), ("pre-trigger", settings.before)):
        if value is not None and not 0 <= value < math.inf:
            fail(f"--{name}: found {value}, expected 0 or more")
    if not 0 <= settings.overlap < 1:
        fail(f"--overlap: found {settings.overlap}, expected 0 or more and below 1")
    if triggered and settings.block is None:
        fail("--trigger: found no --block, expected the length of the blocks")
    if triggered and (settings.window != "boxcar" or settings.overlap):
        fail("--trigger: found --window hann or --overlap, expected neither: a blow at the "
             "beginning of a block needs the window boxcar")
    if not triggered and (settings.before is not None or settings.exponential):
        fail("--exponential and --pre-trigger: found no --trigger, expected the level of the force "
             "at which a blow begins")
    if not triggered and (settings.block is None) == (settings.averages is None):
        fail("--frf: expected either --block or --averages")
    return settings


def check_options(arguments):
    """Ends the script if options of --frf are missing, or given without --frf."""
    if arguments.frf:
        if arguments.channel:
            fail("--frf: found --channel, expected --force and --response")
        if not arguments.force or not arguments.response:
            fail("--frf: expected --force and --response, the names of channels")
        return
    for name in OPTIONS:
        if getattr(arguments, name) is not None:
            fail(f"--{name.replace('_', '-')}: found no --frf, expected it beside this option")
