"""A case file that the page edits: its groups in their order, and their values as text."""
from __future__ import annotations

from decimal import Decimal

import cases

#: Keys as they are usually written; a case file accepts any case.
SPELLED = {name.lower(): name for name in (
    "E", "I", "T", "J_T", "m_T", "c_D", "k_R", "c_R", "m_S", "J_S", "x_S", "x_P", "k_P", "c_P",
    "m_H", "c_H", "k_H", "x_H", "x_F", "J")}
#: Order of the groups in a file; others follow.
ORDER = ("units", "beam", "end", "tip", "mass", "sensor", "support", "hose", "gravity", "axial",
         "along", "excitation", "discretization", "integrator", "observation", "record", "stage",
         "prior")
#: Groups that describe the structure alone.
STRUCTURE = ("units", "beam", "end", "tip", "mass", "sensor", "support", "hose", "gravity", "axial",
             "along", "discretization")

#: A value of a case: its group, the number of the group or the parameter of a prior, and its key.
Input = tuple[str, str, str]


def number_text(text: str, factor: str = "1", divide: bool = False) -> str | None:
    """Return a number as a case file has it, multiplied or divided exactly by a factor of a unit.

    Returns None if the text is no finite number. A decimal comma counts as a point.
    """
    try:
        value = Decimal(text.strip().replace(",", ".").lower().replace("d", "e"))
        value = value / Decimal(factor) if divide else value * Decimal(factor)
    except ArithmeticError:
        return None
    if not value.is_finite():
        return None
    value = value.normalize()
    if value and not Decimal("1e-4") <= abs(value) < Decimal("1e6"):
        return f"{value:e}".replace("e+", "e")
    return f"{value:f}"


def quoted(text: str) -> str:
    """Return a text as a case file has it."""
    return "'" + text.replace("'", "''") + "'"


class Case:
    """The groups of a case file: a name, and the values of each key as they stand in the file."""

    def __init__(self, text: str = "") -> None:
        self.groups: list[tuple[str, dict[str, list[str]]]] = [
            (name, keys) for name, keys, _ in cases.read_groups(text)]
        self.chosen = 0    #: place of the record that is edited, and of its excitation

    def copy(self) -> Case:
        """Return a case that does not follow further changes."""
        copy = Case(self.text())
        copy.chosen = self.chosen
        return copy

    def all(self, name: str) -> list[dict[str, list[str]]]:
        """Return the keys of every group of a name."""
        return [keys for group, keys in self.groups if group == name]

    def edited(self, name: str) -> dict[str, list[str]] | None:
        """Return the keys of the group of a name that is edited; None without such a group.

        It is the first group, but that of the chosen record if each record has one.
        """
        found = self.all(name)
        if not found:
            return None
        of_records = name == "record" or (name == "excitation"
                                          and len(found) == len(self.all("record")))
        return found[self.chosen if of_records else 0]

    def first(self, name: str) -> dict[str, list[str]]:
        """Return the keys of the group of a name that is edited; a new one if there is none."""
        found = self.edited(name)
        return self.add(name) if found is None else found

    def add(self, name: str) -> dict[str, list[str]]:
        """Add a group, and return its keys."""
        keys: dict[str, list[str]] = {}
        self.groups.append((name, keys))
        return keys

    def remove(self, name: str) -> None:
        """Remove every group of a name."""
        self.groups = [group for group in self.groups if group[0] != name]

    def get(self, name: str, key: str) -> str:
        """Return the first value of a key of the group that is edited; '' without one."""
        return cases.unquoted((self.edited(name) or {}).get(key.lower(), []))

    def set(self, name: str, key: str, value: str | None) -> None:
        """Set a key to a value as it stands in a file; None or '' removes the key."""
        if value:
            self.first(name)[key.lower()] = [value]
            return
        keys = self.edited(name)
        if keys is not None:
            keys.pop(key.lower(), None)
            if not keys:
                self.drop(keys)

    def drop(self, keys: dict[str, list[str]]) -> None:
        """Remove one group."""
        self.groups = [group for group in self.groups if group[1] is not keys]

    def remove_record(self, place: int) -> None:
        """Remove a record, its excitation if each record has one, and its priors."""
        records, excitations = self.all("record"), self.all("excitation")
        if len(excitations) == len(records) > 1:
            self.drop(excitations[place])
        self.drop(records[place])
        for keys in self.all("prior"):
            number = cases.unquoted(keys.get("record", []))
            if number == str(place + 1):
                self.drop(keys)
            elif number.isdigit() and int(number) > place:
                keys["record"] = [str(int(number) - 1)]
        self.chosen = max(min(self.chosen, len(records) - 2), 0)

    @property
    def free(self) -> list[str]:
        """Names of the parameters that the last stage estimates."""
        stages = self.all("stage")
        return [cases.unquoted([value]) for value in stages[-1].get("free", [])] if stages else []

    @free.setter
    def free(self, names: list[str]) -> None:
        stages = self.all("stage")
        stage = stages[-1] if stages else self.add("stage")
        if [quoted(name) for name in names] == stage.get("free"):
            return
        stage["free"] = [quoted(name) for name in names]
        # Starts and bounds belong to the names as they were.
        for key in ("start", "lower", "upper"):
            if key in stage and len(stage[key]) > 1:
                del stage[key]
        if "shared" in stage:
            stage["shared"] = [value for value in stage["shared"] if value in stage["free"]]

    def prior(self, parameter: str) -> dict[str, list[str]] | None:
        """Return the keys of the prior of a parameter."""
        return next((keys for keys in self.all("prior") if cases.unquoted(
            keys.get("parameter", [])).lower() == parameter.lower()), None)

    def set_prior(self, parameter: str, sd: str | None) -> None:
        """State the standard deviation of a parameter; None or '' withdraws it."""
        keys = self.prior(parameter)
        if not sd:
            if keys is not None:
                self.drop(keys)
            return
        if keys is None:
            keys = self.add("prior")
            keys["parameter"] = [quoted(parameter)]
        keys["sd"] = [sd]

    def inputs(self) -> dict[Input, tuple[str, ...]]:
        """Return the values of every key; equal numbers are equal texts, in whatever order."""
        found: dict[Input, tuple[str, ...]] = {}
        for name in {name for name, _ in self.groups}:
            for k, keys in enumerate(self.all(name), 1):
                which = str(k)
                if name == "prior":
                    which = " of record ".join(cases.unquoted(keys[key]) for key in
                                               ("parameter", "record") if key in keys)
                for key, values in keys.items():
                    if name == "prior" and key in ("parameter", "record"):
                        continue    # `which` names them
                    found[name, which, key] = tuple(number_text(one) or one for one in values)
        return found

    def text(self, only: tuple[str, ...] | None = None, comment: str = "") -> str:
        """Return the case file.

        only     names of the groups to keep
        comment  lines above the groups
        """
        def place(group: tuple[str, dict[str, list[str]]]) -> int:
            return ORDER.index(group[0]) if group[0] in ORDER else len(ORDER)

        lines = [f"! {line}\n" for line in comment.splitlines()]
        for name, keys in sorted(self.groups, key=place):
            if keys and (only is None or name in only):
                entries = (f"{SPELLED.get(key, key)}={','.join(values)}"
                           for key, values in keys.items())
                lines.append(wrapped(f"&{name}", list(entries)))
        return "".join(lines)


def wrapped(head: str, entries: list[str]) -> str:
    """Return a group as text, in lines of at most about 90 columns."""
    lines, line = [], f"{head:8s}"
    for k, entry in enumerate(entries):
        piece = f" {entry}" + "," * (k < len(entries) - 1)
        if len(line) + len(piece) > 90 and line.strip() != head:
            lines.append(line)
            line = " " * 8
        line += piece
    return "\n".join([*lines, line]) + " /\n"
