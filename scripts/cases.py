"""Groups and keys of a case file, and the samples of its records, as a picture needs them.

The program is the judge of a case file and of what a fit makes of a record; these readers only
know enough of both to draw a record before any fit, and expect a case that the program accepts.
"""

import re
from pathlib import Path

import numpy as np

import text_tables
from program import fail

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


def column_of(name, default, table):
    """Returns the place of a column that has a name, with or without its unit, or a number."""
    if not name:
        return default
    wanted = name.strip().lower()
    for names in (table.names, [text_tables.split_unit(title)[0] for title in table.names]):
        places = [k for k, title in enumerate(names) if title.strip().lower() == wanted]
        if len(places) == 1:
            return places[0]
        if places:
            break
    if name.strip().isdigit() and 0 < int(name) <= max(len(table.names), len(table.rows[0][1])):
        return int(name) - 1
    fail(f"{table.place}: no column '{name}' (found: {', '.join(table.names)})")


def read_samples(case, keys):
    """Returns times and calibrated accelerations of a &record group: the whole file, no window."""
    if "file" not in keys:
        fail(f"{case}: &record: no file, nothing to draw")
    path = Path(case).parent / unquoted(keys["file"])
    rate = real(keys, "rate", 0)
    columns = ("value_column",) if rate else ("time_column", "value_column")
    table = text_tables.read(path, len(columns))
    places = [column_of(unquoted(keys.get(key)), k, table) for k, key in enumerate(columns)]
    z = text_tables.numbers(table, places[-1])
    if z is None or len(z) < 8 or not np.isfinite(z).all():
        fail(f"{path}: column {places[-1] + 1}: found {0 if z is None else np.isfinite(z).sum()} "
             f"numbers in {len(z) if z is not None else len(table.rows)} rows, expected 8 or more, "
             "and one in each row")
    t = np.arange(len(z)) / rate if rate else text_tables.times_of(table, places[0])[0]
    if t is None:
        fail(f"{path}: column {places[0] + 1}: found text, expected times")
    return t, real(keys, "scale", 1.0) * (z - real(keys, "offset", 0.0))
