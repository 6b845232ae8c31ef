"""Groups and keys of a case file, and the samples of its records, as a picture needs them.

The program is the judge of a case file and of what a fit makes of a record; these readers only
know enough of both to draw a record before any fit, and expect a case that the program accepts.
"""

import re
from pathlib import Path

import numpy as np

from program import fail, reason

TOKEN = re.compile(r"""'(?:[^']|'')*'|"(?:[^"]|"")*"|![^\n]*|&\w+|/|=|[^\s,=/'"!]+""")


def read_groups(text):
    """The groups of a case file: (name in lower case, {key: values as text}, place in the text)."""
    groups, keys, values = [], None, None
    tokens = [match for match in TOKEN.finditer(text) if match[0][0] != "!"]
    for token, behind in zip(tokens, [*tokens[1:], None]):
        if keys is None:
            if token[0][0] == "&":
                keys, values = {}, None
                groups.append((token[0][1:].lower(), keys, (token.start(), len(text))))
        elif token[0] == "/":
            groups[-1] = (*groups[-1][:2], (groups[-1][2][0], token.end()))
            keys = None
        elif behind and behind[0] == "=":
            values = keys.setdefault(token[0].lower(), [])
        elif token[0] != "=" and values is not None:
            values.append(token[0])
    return groups


def without(text, names):
    """A case file without some groups; what is left stands in the lines where it stood."""
    for name, _, (begin, end) in read_groups(text):
        if name in names:
            text = text[:begin] + re.sub(r"[^\n]", " ", text[begin:end]) + text[end:]
    return text


def group_text(name, keys):
    """A group as it stands in a case file."""
    entries = (f"{key}={','.join(values)}" for key, values in keys.items())
    return f"&{name} {', '.join(entries)} /\n"


def unquoted(values):
    """The text of a key's first value."""
    text = values[0] if values else ""
    return text[1:-1].replace(2 * text[0], text[0]) if text[:1] in ("'", '"') else text


def real(keys, key, default):
    """A number, in Fortran's way of writing it."""
    values = keys.get(key)
    return float(values[0].lower().replace("d", "e")) if values else default


def is_number(text):
    """Whether a field holds a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def column_of(name, default, header, path):
    """The place of a column that has a name or a number."""
    if not name:
        return default
    names = [title.strip().strip("\"'").lower() for title in header]
    if name.strip().lower() in names:
        return names.index(name.strip().lower())
    if name.strip().isdigit() and 0 < int(name) <= len(header):
        return int(name) - 1
    fail(f"{path}: no column '{name}' (found: {', '.join(header)})")


def data_lines(path):
    """The lines of a table, with their numbers, that are neither blank nor a comment."""
    try:
        with open(path, encoding="utf-8-sig", errors="replace") as file:
            for k, line in enumerate(file):
                if line.strip() and not line.lstrip().startswith("#"):
                    yield k + 1, line
    except OSError as error:
        fail(f"{path}: {reason(error)}")


def fields_of(line, mark):
    """The fields of a line; between semicolons and tabs a comma is a decimal sign."""
    return (line if mark == "," else line.replace(",", ".")).rstrip("\r\n").split(mark)


def find_rows(lines, least):
    """What separates the columns, the place of the first line of numbers, and the names above."""
    for k, line in enumerate(lines):
        for mark in ",;\t":
            filled = [field for field in fields_of(line, mark) if field.strip()]
            if len(filled) >= least and all(map(is_number, filled[:max(2, least)])):
                wide = len(line.rstrip().split(mark))
                names = [above.rstrip("\r\n").split(mark) for above in lines[:k]
                         if len(above.rstrip().split(mark)) in (wide, wide + 1) or k == 1]
                return mark, k, names[-1] if names else line.split(mark)
    mark = next((mark for mark in ",;\t" if mark in lines[0]), ",")
    return mark, 1, lines[0].rstrip("\r\n").split(mark)


def complain(path, skipped, mark, places):
    """Ends the script with the first line that lacks its two numbers."""
    for n, line in list(data_lines(path))[skipped:]:
        fields = fields_of(line, mark)
        if len(fields) <= max(places) or not all(is_number(fields[k]) for k in places):
            fail(f"{path}:{n}: found {line.strip()[:40]!a}, expected numbers in columns "
                 + " and ".join(str(k + 1) for k in places))
    fail(f"{path}: found no numbers, expected columns of them")


def read_samples(case, keys):
    """Times and calibrated accelerations of a &record group: the whole file, no window."""
    if "file" not in keys:
        fail(f"{case}: &record: no file, nothing to draw")
    path = Path(case).parent / unquoted(keys["file"])
    lines = [line for _, line in data_lines(path)]
    if not lines:
        fail(f"{path}: no data")
    rate = real(keys, "rate", 0)
    columns = ("value_column",) if rate else ("time_column", "value_column")
    mark, skipped, names = find_rows(lines, len(columns))
    places = [column_of(unquoted(keys.get(key)), k, names, path)
              for k, key in enumerate(columns)]
    rows = lines[skipped:] if mark == "," else [line.replace(",", ".") for line in lines[skipped:]]
    try:
        *t, z = np.loadtxt(rows, delimiter=mark, usecols=places, ndmin=2, comments=None).T
    except ValueError:
        complain(path, skipped, mark, places)
    t = t[0] if t else np.arange(len(z)) / rate
    if len(t) < 8 or not (np.isfinite(t).all() and np.isfinite(z).all()):
        fail(f"{path}: {len(t)} samples, expected 8 or more, all of them numbers")
    if not (np.diff(t) > 0).all():
        fail(f"{path}: time does not grow from sample {1 + np.argmin(np.diff(t) > 0)} to the next")
    return t, real(keys, "scale", 1.0) * (z - real(keys, "offset", 0.0))
