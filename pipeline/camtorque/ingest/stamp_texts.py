"""Texts of date and time -> seconds, by the kinds of `camtorque.ingest.csv_layout.STAMPS`, with pandas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import pandas as pd

from camtorque.ingest.cells import MONTHS, PERIODS
from camtorque.records import Array

CLOCK = r"(?P<clock>\S+( ?[AaPp][Mm])?)$"
DATES = {
    "day first": r"^(?P<day>\d{1,2})[./-](?P<month>\d{1,2})[./-](?P<year>(\d\d){1,2})[ T]+" + CLOCK,
    "slashes": r"^(?P<month>\d{1,2})/(?P<day>\d{1,2})/(?P<year>(\d\d){1,2})[ T]+" + CLOCK,
    "year first": r"^(?P<year>\d{4})[./](?P<month>\d{1,2})[./](?P<day>\d{1,2})[ T]+(?P<clock>\S+)$",
    "month name": r"^(?P<day>\d{1,2})[- ](?P<month>[A-Za-z]{3})[- ](?P<year>\d{4})[ T]+(?P<clock>\S+)$",
}
"""Kind of a stamp -> its parts."""
MONTH_NAMES = {name: f"{number:02d}" for number, name in enumerate(
    ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"), start=1)}  # fmt: skip
LAST_COLON = r"(?P<clock>:\d\d:\d\d):(?P<part>\d+)$"
"""12:03:04:001, as some loggers write milliseconds."""


def seconds_of_texts(texts: Sequence[str], kind: str) -> Array:
    """Return date and time in seconds as `seconds_of` does; what is none is nan."""
    return seconds_of(pd.Series(texts, dtype=str), kind, errors="coerce").to_numpy(dtype=np.float64)


def seconds_of(texts: pd.Series, kind: str, errors: Literal["raise", "coerce"] = "raise") -> pd.Series:
    """Return date and time in seconds since 1970, a time of day in seconds since midnight."""
    texts = texts.str.strip().str.replace(",", ".")
    texts = texts.str.replace(LAST_COLON, r"\g<clock>.\g<part>", regex=True)
    if kind == "seconds":
        return pd.to_numeric(texts.str.rstrip("sec "), errors=errors)
    if kind == "days":
        return pd.to_timedelta(texts, errors=errors) / pd.Timedelta(seconds=1)
    if kind in PERIODS:
        clock = _whole_day(texts, errors) if kind == "clock" else "00:" + texts
        return pd.to_timedelta(clock, errors=errors) / pd.Timedelta(seconds=1)
    if kind == "iso":
        texts = texts.str.removesuffix("UTC").str.strip()
    else:
        parts = texts.str.extract(DATES[kind])
        parts["year"] = parts["year"].str.replace(r"^(\d\d)$", r"20\1", regex=True)
        parts["month"] = parts["month"].str.lower().replace(MONTH_NAMES)
        padded = [parts[name].str.zfill(2) for name in ("year", "month", "day")]
        clock = _whole_day(parts["clock"], errors).str.replace(r"^(\d):", r"0\1:", regex=True)
        texts = padded[0] + "-" + padded[1] + "-" + padded[2] + "T" + clock
    times = pd.to_datetime(texts, utc=True, format="ISO8601", errors=errors)
    return (times - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1)


def kind_of_dates(texts: pd.Series, kind: str) -> str:
    """Return the kind of stamps; slashes are ``day first`` where more of them have no month in front than behind."""
    if kind != "slashes":
        return kind
    parts = texts.str.extract(r"^\s*(\d+)/(\d+)/").astype(np.float64)
    first, second = (parts > MONTHS).sum()
    return "day first" if first > second else kind


def _whole_day(clock: pd.Series, errors: Literal["raise", "coerce"]) -> pd.Series:
    """Return times of day counted to 24 hours, where they are said to be AM or PM."""
    if not clock.str.contains("M", case=False).any():
        return clock
    return pd.to_datetime(clock, format="mixed", errors=errors).dt.strftime("%H:%M:%S.%f")
