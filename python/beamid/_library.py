"""The shared library: its routines, and its messages as exceptions."""
from __future__ import annotations

import ctypes
import threading
from ctypes import POINTER, c_char_p, c_int, c_void_p
from pathlib import Path


class BeamidError(Exception):
    """What the library says is wrong; one line for each problem."""


class InputError(BeamidError, ValueError):
    """Something that was given is not what was expected (the program's exit status 2)."""


class ComputationError(BeamidError, RuntimeError):
    """The computation failed (the program's exit status 1)."""


class NoFit(ComputationError):
    """A search has ended, but not at a fit. `fit` is what it has found, with its evidence."""

    def __init__(self, message: str, fit) -> None:
        super().__init__(message)
        self.fit = fit


def _open_library() -> ctypes.CDLL:
    path = Path(__file__).parent / "lib" / "libbeamid_c.so"
    if not path.exists():
        raise ImportError(f"found no {path}, expected the library that 'pip install ./python' "
                          "builds in a checkout of beamid")
    library = ctypes.CDLL(str(path))
    signatures = {
        "beamid_open": (c_int, c_char_p, c_int, c_char_p, c_int, c_int, POINTER(c_int), c_void_p,
                        c_void_p, c_int, POINTER(c_void_p), c_char_p, c_int),
        "beamid_close": (None, c_void_p),
        "beamid_fit": (c_int, c_void_p, c_int, c_int, c_void_p, POINTER(c_void_p), c_char_p, c_int),
        "beamid_judge": (c_int, c_void_p, c_char_p, c_int),
        "beamid_infer": (c_int, c_void_p, c_char_p, c_int, c_char_p, c_int),
        "beamid_forget": (None, c_void_p),
        "beamid_respond": (c_int, c_void_p, c_int, c_void_p, c_int, c_void_p, c_void_p, c_char_p,
                           c_int),
        "beamid_array": (None, c_void_p, c_char_p, c_int, POINTER(c_void_p), POINTER(c_int),
                         POINTER(c_int)),
        "beamid_text": (c_int, c_void_p, c_char_p, c_int, c_char_p, c_int),
    }
    for name, (result, *arguments) in signatures.items():
        routine = getattr(library, name)
        routine.restype = result
        routine.argtypes = arguments
    return library


library = _open_library()
ROOM = 65536
_of_thread = threading.local()


def message_buffer() -> ctypes.Array:
    """Where the library puts a message; each thread has one."""
    try:
        return _of_thread.message
    except AttributeError:
        _of_thread.message = ctypes.create_string_buffer(ROOM)
        return _of_thread.message


def check(status: int, message: ctypes.Array) -> None:
    """Raises what a status other than 0 stands for."""
    if status:
        raise (InputError if status == 2 else ComputationError)(message.value.decode())
