"""Reads .lvm, the text that LabVIEW's "Write To Measurement File" makes.

A header of keys, then segments: each has a header of its own, with one value for each channel, a
line of names and the samples. A special block between ***Start_Special*** and ***End_Special*** is
left out.
"""

from dataclasses import dataclass, field
from pathlib import Path

from channels import REMARKS, Channel, stepped, text_of
from program import fail
from text_tables import NUMBER, decoded

END, SPECIAL, END_SPECIAL = "***End_of_Header***", "***Start_Special***", "***End_Special***"
SEPARATORS = {"tab": "\t", "comma": ",", "": "\t"}
X_COLUMNS = ("no", "one", "multi")


@dataclass
class Segment:
    """A segment: its header, the names of the columns, and rows of text."""

    line: int                                   # of the names
    keys: dict = field(default_factory=dict)    # values for each channel
    names: list = field(default_factory=list)
    rows: list = field(default_factory=list)    # (number of the line, its fields)


class Reader:
    """The lines of a file, and what its header says."""

    def __init__(self, path):
        self.path = path
        self.lines = decoded(Path(path).read_bytes()).splitlines()
        self.at = 0
        if not self.lines or not self.lines[0].startswith("LabVIEW Measurement"):
            self.fail(1, "found no 'LabVIEW Measurement', expected it at the beginning")
        self.mark = "," if self.lines[0].rstrip().endswith(",") else "\t"
        self.keys = {key.lower(): values[0] if values else ""
                     for key, values in self.header().items()}
        named = self.keys.get("separator", "").lower()
        self.mark = SEPARATORS.get(named, self.mark)
        self.comma = self.keys.get("decimal_separator", ".") == ","
        if self.comma and self.mark == ",":
            self.fail(1, "found the separator Comma and decimal commas, expected two signs")
        self.columns = self.keys.get("x_columns", "One").lower()
        if self.columns not in X_COLUMNS:
            self.fail(1, f"found X_Columns {self.columns!a}, expected No, One or Multi")

    def fail(self, line, message):
        """Ends the script with a mistake in a line."""
        fail(f"{self.path}:{line}: {message}")

    def header(self):
        """Reads the keys down to the end of a header."""
        keys, first = {}, self.at + 1
        while self.at < len(self.lines):
            key, *values = [text.strip() for text in self.lines[self.at].split(self.mark)]
            self.at += 1
            if key == END:
                return keys
            keys[key] = values
        self.fail(first, f"found a header without {END}, expected this line at its end")

    def segments(self):
        """Reads all segments."""
        found = []
        while self.at < len(self.lines):
            word = self.lines[self.at].split(self.mark)[0].strip()
            if not self.lines[self.at].strip(" \t,"):
                self.at += 1
            elif word == SPECIAL:
                while self.at < len(self.lines) and END_SPECIAL not in self.lines[self.at]:
                    self.at += 1
                self.at += 1
            elif word == "Channels":
                keys = self.header()
                if self.at == len(self.lines):
                    self.fail(self.at, "found the end of the file, expected the names of columns")
                found.append(Segment(self.at + 1, keys, self.fields(self.at)))
                self.at += 1
                self.read_rows(found[-1])
            else:
                self.fail(self.at + 1, f"found {word[:40]!a}, expected 'Channels', the header of a "
                                       "segment")
        return found

    def fields(self, at):
        """Returns the fields of a line."""
        return [text.strip() for text in self.lines[at].split(self.mark)]

    def read_rows(self, segment):
        """Reads the rows down to a blank line or the next header."""
        while self.at < len(self.lines):
            line = self.lines[self.at]
            if line.startswith(("Channels" + self.mark, SPECIAL)):
                break
            if line.strip(" \t,"):
                segment.rows.append((self.at + 1, self.fields(self.at)))
            self.at += 1

    def numbers(self, segment, column, name):
        """Returns the lines, texts and numbers of a column, up to the last that is not empty."""
        texts = [(line, fields[column] if column < len(fields) else "")
                 for line, fields in segment.rows]
        while texts and not texts[-1][1]:
            texts.pop()
        values = []
        for line, text in texts:
            if not text:
                self.fail(line, f"column {column + 1} ('{name}'): found an empty field, expected a "
                                "number")
            plain = text.replace(",", ".", 1) if self.comma else text
            if (self.comma and "." in text) or not NUMBER.fullmatch(plain):
                sign = self.keys.get("decimal_separator", ".")
                self.fail(line, f"column {column + 1} ('{name}'): found {text[:40]!a}, expected a "
                                f"number (Decimal_Separator is '{sign}')")
            values.append(float(plain.replace("d", "e").replace("D", "e")))
        return texts, values


def read_lvm(path):
    """Returns the channels of all segments; segments that follow one another in time are joined."""
    reader = Reader(path)
    segments = reader.segments()
    if not segments:
        fail(f"{path}: found no segment, expected samples below the header")
    tables = [channels_of(reader, segment) for segment in segments]
    texts = [f"{key} = {text_of(value)}" for key, value in reader.keys.items() if value]
    joined = [tables[0]]
    for channels in tables[1:]:
        if continues(joined[-1], channels):
            joined[-1] = [together(a, b) for a, b in zip(joined[-1], channels)]
        else:
            joined.append(channels)
    for k, channels in enumerate(joined):
        for channel in channels:
            channel.name = f"segment {k + 1}/" * (len(joined) > 1) + channel.name
    return [channel for channels in joined for channel in channels], texts


def channels_of(reader, segment):
    """Returns the channels of a segment."""
    import numpy as np
    names = segment.names[:-1] if segment.names[-1:] == ["Comment"] else segment.names
    names = names[:len(names) - (names[-1:] == [""])]
    places = [k for k, name in enumerate(names) if name != "X_Value"]
    if not segment.rows or not places:
        reader.fail(segment.line, f"found {len(places)} channels and {len(segment.rows)} rows, "
                                  "expected some")
    for line, fields in segment.rows:
        more = [text for text in fields[len(segment.names):] if text]
        if more and all(map(NUMBER.fullmatch, more)):
            reader.fail(line, f"found {len(fields)} fields, expected {len(segment.names)}, as many "
                              "as names")
    stated = segment.keys["Channels"][:1]
    if stated and is_count(stated[0]) and int(stated[0]) != len(places):
        reader.fail(segment.line, f"found {len(places)} names of channels, expected {stated[0]} as "
                                  "Channels says")
    channels = []
    for k, place in enumerate(places):
        own = {key: values[k] for key, values in segment.keys.items() if k < len(values)}
        if own.get("X_Dimension", "Time") not in ("Time", ""):
            REMARKS.append(f"{names[place]} is no function of time: left out")
            continue
        _, values = reader.numbers(segment, place, names[place])
        if not values:
            reader.fail(segment.line, f"found no sample of '{names[place]}', expected some")
        check_count(reader, segment, names[place], own.get("Samples", ""), len(values))
        channels.append(Channel(
            names[place], np.array(values), own.get("Y_Unit_Label", ""),
            times_of(reader, segment, place, len(values), own), "s",
            [f"{key} {own[key]}" for key in ("Date", "Time") if own.get(key)]))
    return channels


def is_count(text):
    """Returns whether a text is a number of samples or channels."""
    return text.isascii() and text.isdigit()


def check_count(reader, segment, name, stated, found):
    """Compares the number of samples with the header. Without Multi_Headings, the rows of later
    segments follow without a header."""
    if not is_count(stated) or int(stated) == found:
        return
    if reader.keys.get("multi_headings", "No").lower() == "yes" or found < int(stated):
        reader.fail(segment.line, f"found {found} samples of '{name}', expected {stated} as "
                                  "Samples says")


def times_of(reader, segment, place, n, own):
    """Returns the times of a channel: its column of times, or X0 and Delta_X; None: unknown."""
    import numpy as np
    grid = None
    numbers = {key: own.get(key, "").replace(",", ".") for key in ("X0", "Delta_X")}
    if all(map(NUMBER.fullmatch, numbers.values())) and float(numbers["Delta_X"]) > 0:
        grid = stepped(n, float(numbers["Delta_X"]), float(numbers["X0"]), name="Delta_X")
    column = {"no": None, "one": 0, "multi": place - 1}[reader.columns]
    if column is None:
        stated = own.get("Samples", "")
        if grid is None or (is_count(stated) and int(stated) < n):
            REMARKS.append(f"{segment.names[place]} gets no times: X_Columns is No, and the header "
                           + ("states no step Delta_X above 0" if grid is None else
                              f"states the step of {stated} of {n} samples"))
            return None
        return grid
    if segment.names[column] != "X_Value":
        reader.fail(segment.line, f"column {column + 1}: found '{segment.names[column]}', expected "
                                  f"'X_Value' as X_Columns says")
    texts, values = reader.numbers(segment, column, "X_Value")
    if len(values) < n:
        reader.fail(segment.line, f"found {len(values)} times for {n} samples, expected as many")
    values = np.array(values[:n])
    # The step is exact where the column is rounded.
    rounding = np.array([0.6 * 10.0**-decimals(text) for _, text in texts[:n]])
    if grid is not None and (abs(values - grid) <= rounding + 1e-9 * abs(grid)).all():
        return grid
    bad = np.flatnonzero(~(np.diff(values) > 0))
    if bad.size:
        line, text = texts[bad[0] + 1]
        reader.fail(line, f"column {column + 1} ('X_Value'): found {text!a} after "
                          f"{texts[bad[0]][1]!a}, expected a later time")
    return values


def decimals(text):
    """Returns the number of digits behind the decimal sign, less the exponent."""
    mantissa, _, exponent = text.upper().replace(",", ".").partition("E")
    return len(mantissa.partition(".")[2]) - int(exponent or 0)


def continues(before, after):
    """Returns whether channels are those before, at later times of the same clock, or one step
    later."""
    def follows(a, b):
        if a.times is None or b.times is None or len(a.times) < 2 or not len(b.times):
            return False
        step, gap = a.times[-1] - a.times[-2], b.times[0] - a.times[-1]
        return gap > 0 and (a.notes == b.notes or gap < 1.5 * step)

    return len(before) == len(after) and all(
        a.name == b.name and a.unit == b.unit and follows(a, b) for a, b in zip(before, after))


def together(a, b):
    """Returns a channel followed by another."""
    import numpy as np
    return Channel(a.name, np.concatenate([a.values, b.values]), a.unit,
                   np.concatenate([a.times, b.times]), a.time_unit, a.notes)
