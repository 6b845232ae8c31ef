"""Reads columns of text: CSV files of phones, spreadsheets and loggers, and archives of them."""

import csv
import io
import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath

from channels import REMARKS, Channel
from clocks import Clock, read_stamp
from program import fail, reason

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
MARKS = ",;\t"
LARGEST = 2**31              # bytes of a file in an archive
# Units of time: their number in a second, or the seconds in one of them.
PARTS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
MULTIPLES = {"min": 60, "h": 3600, "d": 86400}
WORDS = {"sec": "s", "second": "s", "seconds": "s", "msec": "ms", "millisecond": "ms",
         "milliseconds": "ms", "millis": "ms", "usec": "us", "microsecond": "us",
         "microseconds": "us", "micros": "us", "\u00b5s": "us", "\u03bcs": "us",
         "nanoseconds": "ns", "minute": "min", "minutes": "min", "hour": "h", "hours": "h",
         "day": "d", "days": "d"}
TIMES = {"t", "time", "times", "timestamp", "timestamps", "zeit", "datetime", "x_value"}
LONG_AGO = 10**8             # [s]; times beyond are counted from the first
MISSING = {"", "nan", "na", "n/a", "null", "none", "-"}
LONG_TEXT = 2**20            # characters; NumPy reads the rows of a longer text if it can
HEAD = 2**16                 # characters of a long text in which its rows must begin


@dataclass
class Table:
    """Rows of text, and the names of the columns."""

    place: str          # file, for messages
    mark: str           # separator of the fields
    names: list         # of the columns; [] without
    rows: Sequence      # (number of the line, its fields)
    above: list         # lines of the header, without names and units
    values: object = None    # (rows, columns) numbers, if NumPy has read all of them

    def fail(self, line, column, message):
        """Ends the script with a mistake in a line and a column."""
        name = f" ('{self.names[column]}')" if column < len(self.names) else ""
        fail(f"{self.place}:{line}: column {column + 1}{name}: {message}")

    def cells(self, column):
        """Returns the lines and the texts of a column; a row without it ends the script."""
        for line, fields in self.rows:
            if column >= len(fields):
                self.fail(line, column, "found the end of the line, expected a number")
            yield line, fields[column]


def decoded(data):
    """Returns the text of bytes in UTF-8, in UTF-16 with a byte order mark, or else in Latin-1."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", "replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def fields_of(line, mark):
    """Returns the fields of a line, without quotes and without blanks around them."""
    if '"' in line:
        try:
            return [field.strip() for field in next(csv.reader([line], delimiter=mark,
                                                               skipinitialspace=True, strict=True))]
        except csv.Error:
            pass    # a quotation mark that is no quotation
    return [field.strip() for field in line.split(mark)]


def filled(fields):
    """Returns the fields up to the last that is not blank."""
    return fields[:max((k + 1 for k, field in enumerate(fields) if field), default=0)]


def is_number(text, comma=True):
    """Returns whether a field is a number; its decimal sign may be a comma."""
    return bool(NUMBER.fullmatch(text.replace(",", ".", 1) if comma else text))


def is_row(fields, comma, columns):
    """Returns whether the first two fields that are not blank are numbers, the first perhaps a time
    stamp."""
    some = [field for field in fields if field][:2]
    return (len(some) >= min(2, columns) and len(fields) >= columns
            and all(is_number(field, comma) or (not k and read_stamp(field))
                    for k, field in enumerate(some)))


def first_row(lines, columns):
    """Returns the place of the first row of numbers and what separates its fields; (None, '')."""
    wide = dict.fromkeys(MARKS, 0)    # numbers of fields of the line above, if it has words only
    for k, (_, line) in enumerate(lines):
        split = {mark: fields_of(line, mark) for mark in MARKS}
        for comma in (False, True):
            for mark, fields in split.items():
                if len(fields) >= min(2, columns) and is_row(fields, comma, columns):
                    return k, mark
        for mark, fields in split.items():
            numbers = [is_number(field) for field in fields]
            if 1 < len(fields) == wide[mark] and fields[0][:1].isdigit() and any(numbers):
                return k, mark
            wide[mark] = 0 if any(numbers) or fields[0][:1].isdigit() else len(fields)
    return None, ""


class Rows(Sequence):
    """Rows of a text, which are split when they are needed: (number of the line, its fields)."""

    def __init__(self, lines, mark):
        self.lines, self.mark = lines, mark

    def __len__(self):
        return len(self.lines)

    def __getitem__(self, k):
        number, line = self.lines[k]
        return number, fields_of(line, self.mark)


def read_quickly(text, columns):
    """Returns the numbers of a long text and the lines at its beginning; (None, text) if NumPy
    cannot read the rows.

    NumPy reads decimal points, one separator and the same number of fields in all rows. Any other
    text is read row by row, which also finds the line of a mistake.
    """
    import numpy as np
    head = text[:HEAD].rpartition("\n")[0]
    lines, at = [], 0
    for line in head.splitlines(keepends=True):
        if line.strip(" ,;\t\r\n") and not line.lstrip().startswith("#"):
            lines.append((at, line.rstrip("\r\n")))
        at += len(line)
    first, mark = first_row(lines, columns)
    if first is None or not mark or first + 2 > len(lines):    # two rows tell a column of times
        return None, text
    rows = text[lines[first][0]:]
    if '"' in rows or "#" in rows:
        return None, text
    try:
        values = np.loadtxt(io.StringIO(rows), delimiter=mark, comments=None, ndmin=2)
    except ValueError:
        return None, text
    return (values, head) if np.isfinite(values).all() else (None, text)


def parse(place, text, columns=2, or_one=False):
    """Returns the table that a text contains: `columns` or more of numbers, or one column if the
    text has no more and `or_one` says so.

    Blank lines and lines that begin with '#' are left out. The last line above the first row that
    is as wide contains the names; a line of units below it is joined to them.
    """
    values = None
    if len(text) > LONG_TEXT:
        values, text = read_quickly(text, columns)
    lines = [(k + 1, line) for k, line in enumerate(text.splitlines())
             if line.strip(' ,;\t') and not line.lstrip().startswith("#")]
    first, mark = first_row(lines, columns)
    if first is None and or_one:
        first, mark = first_row(lines, 1)
    if first is None:
        fail(f"{place}: found no row of numbers, expected {columns} columns or more")
    rows = Rows(lines[first:], mark)
    width = len(filled(rows[0][1]))
    above = [fields_of(line, mark) for _, line in lines[:first]]
    wide = [k for k, fields in enumerate(above) if first == 1 or len(fields) == len(rows[0][1])
            or len(filled(fields)) in (width, width + 1)]
    names = above[wide[-1]] if wide else []
    used = wide[-1:]
    if len(wide) > 1 and wide[-2] == wide[-1] - 1 and all(map(is_unit, filter(None, names))):
        units = [bare(unit) for unit in names]
        used = wide[-2:]
        names = [f"{name} [{unit}]" if unit else name
                 for name, unit in zip(above[wide[-2]], units)]
    return Table(place, mark, names, rows,
                 [line for k, (_, line) in enumerate(lines[:first]) if k not in used], values)


def read(path, columns=2, or_one=False):
    """Returns the table in a file."""
    try:
        return parse(path, decoded(Path(path).read_bytes()), columns, or_one)
    except OSError as error:
        fail(f"{path}: {reason(error)}")


def split_unit(name):
    """Returns a name without its unit, and the unit."""
    name, depth = name.strip(), 0
    for at in range(len(name) - 1, 0, -1):
        depth += (name[at] in ")]") - (name[at] in "([")
        if depth == 0:
            break
    else:
        at = 0
    if at and name[-1] in ")]":
        return name[:at].rstrip().removesuffix(" /").rstrip(), name[at + 1:-1].strip()
    stem, slash, unit = name.rpartition(" / ")
    if not slash:
        stem, _, unit = name.rpartition("_")
        if not time_unit(unit) and unit not in ("g", "mg"):
            stem = ""
    return (stem.strip(), unit.strip()) if stem else (name, "")


def time_unit(word):
    """Returns the unit of time that a word means, or ''."""
    word = WORDS.get(word.strip().lower(), word.strip().lower())
    return word if word in PARTS or word in MULTIPLES else ""


def bare(unit):
    """Returns a unit without brackets around all of it."""
    inner = re.fullmatch(r"[(\[]([^()\[\]]*)[)\]]", unit.strip())
    return inner[1].strip() if inner else unit.strip()


def is_unit(text):
    """Returns whether a text can be a unit in a line of units."""
    word = bare(text).lower()
    return bool(time_unit(word)) or word in {
        "g", "mg", "v", "mv", "c", "k", "n", "%", "-", "1", "hz", "khz", "deg", "\u00b0", "rad",
        "rad/s", "db"} or bool(re.fullmatch(
            r"\(?([mc]?m/s\W*\w?|m?g|[mc]?m)\)?/n|[mc]?m/s\W*\w?|(deg|\u00b0)c", word))


def numbers(table, column):
    """Returns the numbers of a column, NaN where there is none; None if the column contains text
    only. The decimal sign must be the same in all rows; a mistake ends the script."""
    import numpy as np
    if table.values is not None:
        return table.values[:, column].copy()
    values, sign, commas, thousands = [], "", 0, 0
    cells = list(table.cells(column))
    if not any(is_number(text) for _, text in cells):
        return None
    for line, text in cells:
        if text.lower() in MISSING:
            values.append(np.nan)
            continue
        found = "," if "," in text else "." if "." in text else ""
        if not is_number(text) or ("," in text and table.mark == "," and sign == "."):
            table.fail(line, column, f"found {text[:40]!a}, expected a number")
        if found and sign and found != sign:
            table.fail(line, column, f"found {text[:40]!a}, expected a number (a decimal sign is "
                                     f"'{sign}' as in the lines above)")
        sign = sign or found
        commas += found == ","
        thousands += bool(THOUSANDS.fullmatch(text))
        values.append(float(text.replace(",", ".").replace("d", "e").replace("D", "e")))
    if commas and commas == thousands and table.mark != ";":
        fail(f"{table.place}: column {column + 1}: found a comma before three digits in every "
             "number with a comma, expected clear decimal commas (1,5) or decimal points")
    return np.array(values)


def times_of(table, column, unit=""):
    """Returns the times of a column in seconds, their unit, and a remark.

    Time stamps count from the first. Times in another unit than s are converted; without a unit,
    they stay as they are, unless they cannot be seconds.
    """
    import numpy as np
    cells = list(table.cells(column))    # of a table that NumPy has read, only the first
    if read_stamp(cells[0][1]):
        clock, seconds = Clock(), []
        for line, text in cells:
            seconds.append(clock.read(text))
            if seconds[-1] is None:
                table.fail(line, column, f"found {text[:40]!a}, expected a time stamp like "
                           f"'{cells[0][1]}', of the same or the next day")
        values, unit, remark = np.array(seconds), "s", f"seconds since {cells[0][1]}"
    else:
        values, remark = numbers(table, column), ""
        if values is None:
            return None, "", ""
        values, remark = in_seconds(table, column, values, unit)
    bad = np.flatnonzero(~(np.diff(values) > 0))
    if bad.size or not np.isfinite(values).all():
        k = bad[0] + 1 if bad.size else 0
        if table.values is not None:
            fail(f"{table.place}: row {k + 1}: column {column + 1}: found "
                 f"{table.values[k, column]:.17g} after {table.values[k - 1, column]:.17g}, "
                 "expected a later time")
        table.fail(cells[k][0], column, f"found {cells[k][1][:40]!a} after "
                   f"{cells[k - 1][1][:40]!a}, expected a later time" if k else
                   f"found {cells[k][1][:40]!a}, expected a number")
    return values, "s" if remark else unit, remark


def in_seconds(table, column, values, unit):
    """Returns times in s, and a remark on what was converted; those without a unit as they are."""
    start = values[0]
    look = ("days" if (2e4 <= start < 8e4 or 7e5 <= start < 8e5) and values[-1] - start < 1
            and len(values) > 2 and values[1] - start <= 1e-4 else
            "a time since 1970 in ms, us or ns" if start > 0.9e12 else "")
    if not unit and look:
        fail(f"{table.place}: column {column + 1}: found times from {start:.10g}, which look like "
             f"{look}, expected --time-unit to state the unit")
    if unit in ("", "s"):
        return values, ""
    far = bool(abs(start) * MULTIPLES.get(unit, 1) / PARTS.get(unit, 1) > LONG_AGO)
    if far:
        values = values - start
    values = values * MULTIPLES[unit] if unit in MULTIPLES else values / PARTS[unit]
    return values, f"converted from {unit} to s" + f", since {start:.17g}" * far


def channels_of(table, unit="", prefix=""):
    """Returns the columns of a table as channels, with the times of its time column."""
    width = len(filled(table.rows[0][1]))
    widest = max(width, len(table.names))
    for line, fields in table.rows if table.values is None else ():
        if len(filled(fields)) > widest:
            fail(f"{table.place}:{line}: found {len(filled(fields))} fields, expected {widest} at "
                 "most, as in the first row")
    pairs = [split_unit(name) for name in table.names] + [("", "")] * width
    # A column of times has such a name, or a unit of time; without names the first of several is.
    named = [k for k in range(width) if pairs[k][0].lower() in TIMES or time_unit(pairs[k][1])]
    place = next((k for k in named if is_time(table, k)), None if table.names or width < 2 else 0)
    if place is None and width > 1 and is_time(table, 0):
        place = 0
    times, remark = None, ""
    if place is not None:
        times, time, remark = times_of(table, place, time_unit(pairs[place][1]) or unit)
    channels = []
    for k in range(width):
        name = prefix + (pairs[k][0] or f"column {k + 1}")
        values = numbers(table, k) if k != place else None
        if values is not None:
            channels.append(Channel(name, values, pairs[k][1], times, "" if times is None else time,
                                    [f"times {remark}"] * bool(remark)))
        elif k != place:
            REMARKS.append(f"{name} contains no numbers: left out")
    return channels


def is_time(table, column):
    """Returns whether a column can be one of times: stamps, or numbers that grow at first."""
    texts = [text for _, text in islice(table.cells(column), 2)]
    if read_stamp(texts[0]):
        return True
    if not all(map(is_number, texts)):
        return False
    values = [float(text.replace(",", ".").lower().replace("d", "e")) for text in texts]
    return len(values) == 2 and values[0] < values[1]


def read_zip(path, unit=""):
    """Returns the channels of all text files in an archive, without those in a folder 'meta'."""
    channels, texts = [], []
    with zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()
                   and PurePosixPath(member.filename).suffix.lower() in (".csv", ".txt", ".tsv")
                   and PurePosixPath(member.filename).parent.name not in ("meta", "__MACOSX")]
        for member in members:
            if member.file_size > LARGEST:
                fail(f"{path}: {member.filename}: found {member.file_size} bytes, expected at most "
                     f"{LARGEST}")
            table = parse(f"{path}: {member.filename}", decoded(archive.read(member)))
            stem = PurePosixPath(member.filename).stem
            channels += channels_of(table, unit, f"{stem}/" if len(members) > 1 else "")
            texts += table.above
    return channels, texts
