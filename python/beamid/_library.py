"""The shared library: its routines, handles, interrupts, progress; its messages as exceptions."""
from __future__ import annotations

import contextlib
import csv
import ctypes
import html
import importlib
import inspect
import io
import re
import signal
import sys
import threading
import weakref
from collections.abc import Mapping
from ctypes import CFUNCTYPE, POINTER, byref, c_char, c_char_p, c_int, c_longlong, c_void_p
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, TypeVar, Union

import numpy as np

if TYPE_CHECKING:
    from ._fits import Fit

#: Hears of the progress: pieces done, pieces in all (0: not known), name of the pieces.
Progress = Union[bool, Callable[[int, int, str], Any]]


class BeamidError(Exception):
    """An error of the library: one line for each problem."""


class InputError(BeamidError, ValueError):
    """Bad input (the program's exit status 2)."""


class ComputationError(BeamidError, RuntimeError):
    """A failed computation (the program's exit status 1)."""


class NoFit(ComputationError):
    """A search that ended without explaining the record; `fit` holds the evidence."""

    def __init__(self, message: str, fit: Fit) -> None:
        super().__init__(message)
        self.fit = fit

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.fit)


_Result = TypeVar("_Result", bound=type)
_CALLBACK = CFUNCTYPE(c_int, c_int, c_int, POINTER(c_char), c_int)


def _open_library(kind: type[ctypes.CDLL]) -> ctypes.CDLL:
    path = Path(__file__).parent / "lib" / "libbeamid_c.so"
    if not path.exists():
        raise ImportError(f"found no {path}, expected the library that 'pip install ./python' "
                          "builds in a checkout of beamid")
    library = kind(str(path))
    message = (c_char_p, c_int)
    signatures = {
        "beamid_watch_forks": (None,),
        "beamid_begin": (c_int, c_int, c_void_p, *message),
        "beamid_end": (c_int,),
        "beamid_open": (c_int, c_char_p, c_int, c_char_p, c_int, c_int, POINTER(c_int), c_int,
                        c_void_p, c_void_p, c_int, POINTER(c_longlong), *message),
        "beamid_close": (c_int, c_longlong, *message),
        "beamid_fit": (c_int, c_longlong, c_int, c_int, c_void_p, POINTER(c_longlong), *message),
        "beamid_judge": (c_int, c_longlong, *message),
        "beamid_set_methods": (c_int, c_longlong, c_longlong, *message),
        "beamid_infer": (c_int, c_longlong, c_char_p, c_int, *message),
        "beamid_run": (c_int, c_char_p, c_int, c_int, POINTER(c_longlong), c_char_p, c_int,
                       POINTER(c_longlong), *message),
        "beamid_track_begin": (c_int, c_longlong, POINTER(c_longlong), *message),
        "beamid_track_take": (c_int, c_longlong, c_int, c_void_p, c_void_p, POINTER(c_int),
                              *message),
        "beamid_track_rows": (c_int, c_longlong, c_int, c_void_p, *message),
        "beamid_respond": (c_int, c_longlong, c_int, c_void_p, c_int, c_void_p, c_void_p, *message),
        "beamid_array": (c_int, c_longlong, c_char_p, c_int, c_longlong, c_void_p, POINTER(c_int),
                         POINTER(c_int), *message),
        "beamid_text": (c_int, c_longlong, c_char_p, c_int, c_char_p, c_int, POINTER(c_int),
                        *message),
        "beamid_groups": (c_int, c_char_p, c_int),
    }
    for name, (result, *arguments) in signatures.items():
        routine = getattr(library, name)
        routine.restype = result
        routine.argtypes = arguments
    return library


library = _open_library(ctypes.CDLL)
# Short routines keep the interpreter's lock, so that no thread can fork while they hold a lock of
# the library, which nobody would release in the child.
_short = _open_library(ctypes.PyDLL)
# Before any fit, so that a forked child knows that threads of the parent are gone.
library.beamid_watch_forks()
ROOM = 65536
_of_thread = threading.local()
# Runs the Python handlers of signals that have arrived, and raises their exceptions.
_handle_signals = ctypes.pythonapi.PyErr_CheckSignals


def _message_buffer() -> ctypes.Array[c_char]:
    """Return the buffer of this thread for a message of the library."""
    buffer: ctypes.Array[c_char] | None = getattr(_of_thread, "message", None)
    if buffer is None:
        buffer = _of_thread.message = ctypes.create_string_buffer(ROOM)
    return buffer


def _check(status: int, message: ctypes.Array[c_char]) -> None:
    """Raise the exception that a status other than 0 stands for."""
    if status:
        # A case in memory has no lines, and the keys of its only stage are arguments.
        text = re.sub(r"^beamid:(\d+:)? (&stage (?=\w+:))?", "", message.value.decode(),
                      flags=re.MULTILINE)
        raise (InputError if status == 2 else ComputationError)(text)


def call(name: str, *arguments: Any) -> None:
    """Call a routine that computes nothing, and raises its error."""
    message = _message_buffer()
    _check(getattr(_short, name)(*arguments, message, ROOM), message)


def compute(name: str, *arguments: Any, progress: Progress | None = None) -> None:
    """Call a routine that computes, and raises its error.

    Ctrl-C stops a computation of the main thread and raises KeyboardInterrupt, also if a handler of
    the caller's own returns. An exception of `progress` stops the computation, and is raised.
    """
    message = _message_buffer()
    with _Listener(progress) as listener:
        # A handler written in Python would have to wait until the library returns.
        catch = (threading.current_thread() is threading.main_thread()
                 and callable(signal.getsignal(signal.SIGINT)))
        refused = None
        try:
            refused = _short.beamid_begin(catch, listener.pointer, message, ROOM)
            # From here on SIGINT sets the flag of the library. Handle an earlier signal now: if
            # another thread has received it, the interpreter may not notice it before this thread
            # takes the interpreter's lock again, at the end of the computation.
            _handle_signals()
            status = refused or getattr(library, name)(*arguments, message, ROOM)
        finally:
            # Also if the handler of a signal from before the beginning raises an exception.
            flag = 0 if refused else _short.beamid_end()
        if flag > 0:
            try:
                signal.raise_signal(flag)
            except BaseException as error:
                raise error from listener.raised
            raise KeyboardInterrupt from listener.raised
        if listener.raised:
            raise listener.raised
        _check(status, message)


class _Listener:
    """Pass the progress of a computation on: to a function, or to a bar on standard error."""

    def __init__(self, progress: Progress | None) -> None:
        self.raised: BaseException | None = None
        self._bar = None
        self.pointer = None
        if not progress:
            return
        if not callable(progress):
            progress = self._bar = _Bar()

        def hear(part: int, whole: int, what: Any, length: int) -> int:
            try:
                progress(part, whole, ctypes.string_at(what, length).decode())
            except BaseException as error:
                self.raised = error
                return 1
            return 0

        self._callback = _CALLBACK(hear)
        self.pointer = ctypes.cast(self._callback, c_void_p)

    def __enter__(self) -> _Listener:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._bar:
            self._bar.close()


class _Bar:
    """A progress bar: by tqdm if that is installed, else a line on standard error."""

    def __init__(self) -> None:
        self._what: str | None = None
        self._bar: Any = None
        self._tqdm: Any = None
        with contextlib.suppress(ImportError):
            from tqdm.auto import tqdm
            self._tqdm = tqdm

    def __call__(self, part: int, whole: int, what: str) -> None:
        if not self._tqdm:
            print(f"\r{part}{f' of {whole}' if whole else ''} {what} ", end="", file=sys.stderr,
                  flush=True)
            self._what = what
            return
        if what != self._what:
            self.close()
            self._bar = self._tqdm(total=whole or None, desc=what, leave=False)
            self._what = what
        self._bar.n = part
        self._bar.refresh()

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
        elif self._what and not self._tqdm:
            print(file=sys.stderr)


class Handle:
    """An object inside the library, closed when nothing refers to it any more.

    Copies of a fit or a problem share the handle. It cannot be sent to another process; fits and
    problems therefore leave it out when they are pickled.
    """

    def __init__(self) -> None:
        self.is_judged = False          #: of a fit: its verdict is there
        self.methods = ""               #: of a fit: text of the case with its settings, or ''
        self.number = c_longlong(0)     #: 0 until the library has written it
        self.lock = threading.RLock()   #: the library allows one call at a time for a fit
        self.folder: Any = None         #: temporary folder with files that a case names
        weakref.finalize(self, _close_number, self.number)

    def __deepcopy__(self, _: Any) -> Handle:
        return self


def _close_number(number: c_longlong) -> None:
    if number.value:
        _short.beamid_close(number, None, 0)


def groups() -> tuple[str, ...]:
    """Return the names of the groups of a case file, as the library knows them."""
    length = _short.beamid_groups(None, 0)
    buffer = ctypes.create_string_buffer(length)
    _short.beamid_groups(buffer, length)
    return tuple(buffer.raw[:length].decode().split())


def numbers(values: Any, what: str) -> np.ndarray:
    """Return values as an array (n) of doubles. A column or a row, (n, 1) or (1, n), is accepted.

    what  name of the values in errors. Masked values and whatever is not a real number are rejected
    """
    return _numbers(values, what, "iufO", float, "real numbers")


def complex_numbers(values: Any, what: str) -> np.ndarray:
    """Return values as an array (n) of complex numbers; as `numbers`."""
    return _numbers(values, what, "iufcO", complex, "numbers")


def _numbers(values: Any, what: str, kinds: str, dtype: type, expected: str) -> np.ndarray:
    if np.ma.is_masked(values):
        raise InputError(f"{what}: found {np.ma.getmaskarray(values).sum()} masked values, "
                         "expected none")
    try:
        array: np.ndarray = np.ascontiguousarray(_without_text(values, kinds), dtype=dtype)
    except (TypeError, ValueError):
        raise InputError(f"{what}: found {_shortened(values)}, expected {expected}") from None
    return _in_a_row(array, what)


def _without_text(values: Any, kinds: str) -> np.ndarray:
    """Return values as an array; raises TypeError if they are of other kinds, or a text is among
    them."""
    array = np.asarray(values)
    if array.size and array.dtype.kind not in kinds:
        raise TypeError
    if array.dtype.kind == "O" and any(isinstance(item, (str, bytes)) for item in array.flat):
        raise TypeError
    return array


def _in_a_row(array: np.ndarray, what: str) -> np.ndarray:
    if array.ndim > 1 and max(array.shape) != array.size:
        raise InputError(f"{what}: found an array of shape {array.shape}, expected one dimension")
    return array.ravel()


def array_of(handle: Handle, name: str) -> np.ndarray:
    """Return a copy of an array of a fit, by its name in the library."""
    rows, columns, key = c_int(), c_int(), name.encode()
    with handle.lock:
        call("beamid_array", handle.number, key, len(key), 0, None, byref(rows), byref(columns))
        array = np.empty((columns.value, rows.value))
        call("beamid_array", handle.number, key, len(key), array.size, array.ctypes.data,
             byref(rows), byref(columns))
    return array.T


def text_of(handle: Handle, name: str) -> str:
    """Return a text of a fit or of other results, by its name in the library; '': no such text."""
    key, length, room = name.encode(), c_int(), 4096
    with handle.lock:
        while True:
            buffer = ctypes.create_string_buffer(room)
            call("beamid_text", handle.number, key, len(key), buffer, room, byref(length))
            if length.value <= room:
                return buffer.raw[:length.value].decode()
            room = length.value


def optional(module: str, what: str) -> Any:
    """Import a package that need not be installed.

    Raises
    ------
    ImportError
        Says what the package is needed for, and how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise ImportError(f"found no {package}, expected it for {what}: pip install {package}"
                          ) from None


def table_of(tables: Mapping[str, str], name: str) -> str:
    """Return a table by its name, with or without '.csv'; raises KeyError if there is none, or if
    it is another text, such as 'case.txt'."""
    stem = name.removesuffix(".csv")
    known = [key.removesuffix(".csv") for key in tables if key.endswith(".csv")]
    if name in tables and stem not in known:
        raise KeyError(f"{name}: found a text, expected a table; tables[{name!r}] is the text")
    if stem not in known:
        raise KeyError(f"{name}: expected one of {', '.join(known)}")
    return tables[stem + ".csv"]


def documented(result: _Result) -> _Result:
    """Give the fields of a named tuple the text that the section Attributes of its docstring has,
    so that help() shows it instead of 'Alias for field number'."""
    # Python 3.13 removes the indentation of docstrings; `getdoc` removes it in all versions.
    section = (inspect.getdoc(result) or "").partition("----------\n")[2]
    for name, text in re.findall(r"^(\w+) : .*\n((?:    .*\n)+)", section + "\n", re.MULTILINE):
        getattr(result, name).__doc__ = " ".join(text.split())
    return result


def beginning(summary: str, longest: int = 14) -> str:
    """Return the first lines of a summary, which may begin with warnings, and what is left out."""
    lines = summary.strip("\n").split("\n")
    if len(lines) > longest + 1:
        lines[longest:] = [f"... {len(lines) - longest} more lines in summary()"]
    return "\n".join(lines)


def html_of(summary: str, table: str, most: int = 10) -> str:
    """Return what a notebook shows of results: the first paragraph of the summary, and the first
    rows of a table (CSV text)."""
    head, *rows = csv.reader(io.StringIO(table))
    lines = "<br>".join(map(html.escape, summary.strip("\n").partition("\n\n")[0].split("\n")))
    cells = ["".join(f"<td>{html.escape(_rounded(field))}</td>" for field in row)
             for row in rows[:most]]
    more = f"<p>... {len(rows) - most} more rows</p>" if len(rows) > most else ""
    names = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return (f"<p>{lines}</p><table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"
            f"{more}")


def _rounded(field: str) -> str:
    """Return a field of a table with six digits, if it is a number that has more."""
    try:
        return field if field.isdigit() else f"{float(field):.6g}"
    except ValueError:
        return field


def kind_of(value: Any) -> str:
    """Return what a message says about a value that is of a wrong kind."""
    if isinstance(value, (bool, int, float, str, type(None))):
        return _shortened(value)
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"


def _shortened(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) < 60 else text[:57] + "..."
