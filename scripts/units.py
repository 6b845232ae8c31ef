"""Units of parameters, for report.py: from the labels that &units of a case gives to length, force,
time and mass."""

import re

import cases as c
import plotting as p

#: The unit of each parameter, by the pattern of its name; the first match counts.
UNITS = (
    (r"m_[A-Z]", "{mass}"), (r"J_[A-Z]", "{mass} {length}^2"), (r"rho", "{mass}/{length}"),
    (r"E", "{force}/{length}^2"), (r"c_D|gamma", "{force} {time}/{length}^2"),
    (r"c_R", "{force} {length} {time}"), (r"c_[A-Z]", "{force} {time}/{length}"),
    (r"k_R", "{force} {length}"), (r"k_[A-Z]", "{force}/{length}"),
    (r"x_[A-Z]|length|place|width|height", "{length}"), (r"I", "{length}^4"), (r"T", "{force}"),
    (r"a_h", "{force} {time}"), (r"b_h", "{length}"), (r"b_\d", "1/{time}"),
    (r"density", "{mass}/{length}^3"), (r"g|cos|sin", "{length}/{time}^2"))
FREQUENCY = re.compile(r"frequency_\d+$")


def frequency(time):
    """Returns the unit of frequencies for a unit of time: Hz for seconds."""
    return "" if not time else "Hz" if time == "s" else f"1/{time}"


class Units:
    """The units of a case: `labels` by quantity, as in labels.csv."""

    def __init__(self, labels):
        self.labels = dict(labels)
        length, time = (self.labels.get(name, "") for name in ("length", "time"))
        self.hertz = frequency(time)
        if length and time:
            self.labels.setdefault("velocity", f"{length}/{time}")
            self.labels.setdefault("acceleration", f"{length}/{time}^2")

    @classmethod
    def of_case(cls, text):
        """Returns the units that a case file states."""
        return cls({key: c.unquoted(values) for name, keys, _ in c.read_groups(text or "")
                    if name == "units" for key, values in keys.items()})

    @classmethod
    def of_folder(cls, folder, text=None):
        """Returns the units of an output folder, or of a case file's text if it states none."""
        path = folder / "labels.csv"
        if path.exists():
            return cls({row["quantity"]: row["unit"]
                        for row in p.read_table(path, "quantity", "unit")})
        return cls.of_case(text)

    def get(self, quantity):
        """Returns the unit of a quantity; empty if the case states none."""
        return self.labels.get(quantity, "")

    def of(self, parameter):
        """Returns the unit of a parameter by its name; empty if it has none or if the case states
        no units."""
        name = parameter.removeprefix("1/")
        if FREQUENCY.match(name):
            return self.hertz
        stem = re.split(r"[(.]", re.sub(r"^(cos|sin)_\d+", r"\1", name))[0]
        template = next((unit for pattern, unit in UNITS if re.fullmatch(pattern, stem)), "")
        if not all(self.get(key) for key in re.findall(r"{(\w+)}", template)):
            return ""
        unit = template.format(**self.labels)
        return f"1/({unit})" if parameter.startswith("1/") and unit else unit
