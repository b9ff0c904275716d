"""What a cell of a text may hold: a number, a time, a level, or a word for none."""

from __future__ import annotations

import re
from contextlib import suppress
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

LONGEST_MONTH, MONTHS, CENTURY = 31, 12, 2000
STAMPS: dict[str, re.Pattern[str]] = {
    "iso": re.compile(r"^(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d([.,:]\d+)?|\d{8}T\d{6}([.,]\d+)?)"
                      r"( ?(Z|UTC|[+-]\d\d(:?\d\d)?))?$"),
    "year first": re.compile(r"^\d{4}[/.]\d{1,2}[/.]\d{1,2}[ T]+\d{1,2}:\d\d:\d\d([.,:]\d+)?$"),
    "month name": re.compile(r"^\d{1,2}[- ][A-Za-z]{3}[- ]\d{4}[ T]+\d{1,2}:\d\d:\d\d([.,:]\d+)?$"),
    "day first": re.compile(r"^\d{1,2}([.-])\d{1,2}\1(\d\d){1,2}[ T]+\d\d:\d\d:\d\d([.,:]\d+)?$"),
    "slashes": re.compile(r"^\d{1,2}/\d{1,2}/(\d\d){1,2}[ T]+\d{1,2}:\d\d:\d\d([.,]\d+)?( ?[AP]M)?$", re.IGNORECASE),
    "days": re.compile(r"^\d+ days? \d\d:\d\d:\d\d(\.\d+)?$"),
    "clock": re.compile(r"^\d{1,3}:\d\d:\d\d([.,:]\d+)?( ?[AP]M)?$", re.IGNORECASE),
    "minutes": re.compile(r"^\d{1,2}:\d\d[.,]\d+$"),
    "seconds": re.compile(r"^\d+([.,]\d+)?([eE][+-]?\d+)? ?(s|sec)$"),
    "date": re.compile(r"^\d{4}([-/.])\d{1,2}\1\d{1,2}$|^\d{1,2}([./-])\d{1,2}\2(\d\d){1,2}$"),
}  # fmt: skip
"""Kinds of date and time; a date alone is a column that is skipped."""
LEVELS = {"true": 1.0, "false": 0.0, "on": 1.0, "off": 0.0, "high": 1.0, "low": 0.0, "wahr": 1.0, "falsch": 0.0,
          "ein": 1.0, "aus": 0.0}  # fmt: skip
"""Words for the two levels of a digital line."""
UNDATED = ("", "days", "clock", "minutes", "seconds")
"""Kinds of stamps without a day; "" is a number."""
PERIODS = {"clock": 86_400.0, "minutes": 3600.0}
"""Period after which a stamp without a date starts again [s]."""
PARTING = "'\u2019 \u00a0\u202f"
"""Signs between thousands that are never decimal signs: apostrophes and blanks."""
THOUSANDS = {
    ".": re.compile(r"^[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?$"),
    ",": re.compile(r"^[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?$"),
    **{sign: re.compile(rf"^[+-]?[1-9]\d{{0,2}}({sign}\d{{3}})+([.,]\d*)?$") for sign in PARTING},
}
"""Sign between thousands -> a number that shows it."""
NUMBER = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$", re.IGNORECASE)
MISSING = (
    "", "nan", "na", "n/a", "<na>", "none", "-", "--", "null", "#nv", "#n/a", "1.#qnan", "-1.#ind", "nan(ind)",
    "-nan(ind)", "#div/0!", "#value!", "#wert!", "#ref!", "#bezug!", "#num!", "#zahl!", "#name?", "#null!", "err",
    "error", "fehler", "bad", "invalid", "no data", "nodata",
)  # fmt: skip
OVERRANGE = re.compile(
    r"^[+-]?(∞|inf\w*|1\.#inf\w*|ov\w{0,3}fl\w*|ovl?d?|ovfw|ovr\w*|o\.?l|#?over[ \w]*|clip\w*|#+|\*+|[+-]{3,}|"
    r"-+[.,]-+)$",
    re.IGNORECASE,
)
"""What loggers print for a value beyond their range."""
NO_VALUE = 9.0e36
"""Instruments print 9.9E+37 for a value beyond their range, 9.91E+37 for none (SCPI 1999, 7.2.1.4)."""


START_DATE = re.compile(
    r"(?<![a-z])(start\w*|begin\w*|first[ _-]?sample)\b[^\d]{0,24}"
    r"(?P<date>\d{4}([-/.])\d\d\3\d\d|(?P<day>\d\d)\.(?P<month>\d\d)\.(?P<year>\d{4}))[T ]+"
    r"(?P<clock>\d\d:\d\d:\d\d[.,]\d{3,9}) ?(?P<zone>Z|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)
"""A start in whole seconds would lay logs apart that began together."""


def unwrapped(stamps: NDArray[np.float64], kind: str, before: float = np.nan) -> NDArray[np.float64]:
    """Return stamps that run on where they start again without a date: a test may run over midnight.

    ``before`` is the last one of the block before, nan for none; stamps that are nan stay so.
    """
    sound = np.isfinite(stamps)
    if kind not in PERIODS or not sound.any():
        return stamps
    first = stamps[sound][:1] if np.isnan(before) else [before]
    result = stamps.copy()
    result[sound] = np.unwrap(np.concatenate([first, stamps[sound]]), period=PERIODS[kind])[1:]
    return result


def day_of(text: str) -> float | None:
    """Return a date in seconds since 1970, None where it is no day of the calendar."""
    parts = [int(part) for part in re.split(r"[-./]", text)]
    if parts[0] > LONGEST_MONTH:
        year, month, day = parts
    elif "/" in text and parts[0] <= MONTHS:
        month, day, year = parts
    else:
        day, month, year = parts
    try:
        return datetime(year + (CENTURY if year < 100 else 0), month, day, tzinfo=UTC).timestamp()
    except ValueError:
        return None


def header_date(header: list[str]) -> float | None:
    """Return the date of the start that a header states to a thousandth of a second [s since 1970], None without one.

    Dates with slashes and the year last read two ways and are none.
    """
    for match in filter(None, map(START_DATE.search, header)):
        date = "-".join(match.group("year", "month", "day")) if match["year"] else re.sub(r"[/.]", "-", match["date"])
        with suppress(ValueError):  # the 30th of February is no start
            return seconds_of_date(f"{date}T{match['clock'].replace(',', '.')}{match['zone'] or ''}")
    return None


def seconds_of_date(text: str) -> float:
    """Return a date and time of ISO 8601 in seconds since 1970; without a zone it counts as UTC."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def is_word(field: str) -> bool:
    """Tell a word that stands for a value that is missing or beyond the range."""
    return bool(field) and (field.lower() in MISSING or bool(OVERRANGE.match(field)))


def is_value(field: str, decimal: str, thousands: str = "") -> bool:
    """Tell a number, a level, a time, or an empty cell."""
    plain = field.replace(thousands, "") if thousands and THOUSANDS[thousands].match(field) else field
    text = plain.replace(",", ".") if decimal == "," else plain
    return not field or bool(NUMBER.match(text)) or field.lower() in LEVELS or is_stamp(field)


def is_stamp(field: str) -> bool:
    """Tell a date or a time."""
    return any(pattern.match(field) for pattern in STAMPS.values())
