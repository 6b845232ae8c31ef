"""Time stamps as recorders and spreadsheets write them, in seconds since the first.

beamid reads the same stamps (src/beamid/record/time_stamps.f90).
"""

import re
from datetime import date

STAMP = re.compile(
    r"(?:(?P<a>\d{1,4})(?P<sign>[-./])(?P<b>\d{1,2})(?P=sign)(?P<c>\d{1,4})[Tt, ] *)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d))?(?:[.,](?P<fraction>\d+))?"
    r"(?: ?(?P<half>[AaPp][Mm]))?(?: ?(?P<zone>Z|z|UTC|[+-]\d\d(?::?\d\d)?))?", re.ASCII)
SECOND = 10**9      # [ns]
DAY = 86400 * SECOND


def days_of(stamp):
    """Returns the numbers of the day for the orders year-month-day or day-month-year, and
    month-day-year; None if there is no such date."""
    a, b, c = (int(stamp[key]) for key in "abc")
    year = c + 2000 * (c < 100)
    orders = [(a, b, c)] if len(stamp["a"]) == 4 else [(year, b, a), (year, a, b)]
    return [day_number(*order) for order in orders]


def day_number(year, month, day):
    """Returns the number of a day; None if there is no such date."""
    try:
        return date(year, month, day).toordinal()
    except ValueError:
        return None


def read_stamp(text):
    """Returns the form of a time stamp, the numbers of its day, and its time [ns]; None if the text
    is no time stamp."""
    stamp = STAMP.fullmatch(text.strip())
    if not stamp:
        return None
    dated = stamp["a"] is not None
    numbers = [int(stamp[key]) if stamp[key] else 0 for key in ("hour", "minute", "second")]
    form = "date" if dated else "day"
    if stamp["second"] is None:
        if dated == bool(stamp["fraction"]) or (not dated and stamp["half"]):
            return None
        if not dated:
            form, numbers = "hour", [0, *numbers[:2]]
    hour, minute, second = numbers
    if stamp["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (stamp["half"].lower() == "pm")
    days = days_of(stamp) if dated else []
    if hour > 23 or minute > 59 or second > 59 or (dated and not any(days)):
        return None
    fraction = round(int((stamp["fraction"] or "0")[:10].ljust(10, "0")) / 10)
    time = (hour * 3600 + minute * 60 + second) * SECOND + fraction
    if stamp["zone"]:
        if not dated:
            return None
        digits = re.sub(r"\D", "", stamp["zone"]).ljust(4, "0")
        if digits and (int(digits[:2]) > 23 or int(digits[2:]) > 59):
            return None
        away = (int(digits[:2]) * 60 + int(digits[2:])) * 60 * SECOND
        later, time = divmod(time - (-away if stamp["zone"][0] == "-" else away), DAY)
        days = [day and day + later for day in days]
        form = "zone"
    return form, days, time


class Clock:
    """Counts the seconds since the first stamp."""

    def __init__(self):
        self.last = None
        self.elapsed = 0

    def read(self, text):
        """Returns the seconds since the first stamp; None if the text is no stamp of the same form,
        on the same or the next day."""
        stamp = read_stamp(text)
        last, self.last = self.last, stamp or self.last
        if stamp is None or last is None:
            return None if stamp is None else 0.0
        if stamp[0] != last[0]:
            return None
        step = stamp[2] - last[2]
        if stamp[1]:
            later = [day - before for day, before in zip(stamp[1], last[1]) if day and before]
            if 0 not in later and 1 not in later:
                return None
            step += DAY * (0 not in later)
        else:
            period = DAY if stamp[0] == "day" else DAY // 24
            step += period * (step < -period / 2)
        self.elapsed += step
        return self.elapsed / SECOND
