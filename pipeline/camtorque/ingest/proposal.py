"""What logs hold and what their channels may be: by unit, by name, by looking at the samples. For `camtorque new`.

A proposal is written into a file for a person to read; nothing is taken over unread.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camtorque.ingest.formats import FORMATS, file_format
from camtorque.ingest.raw import FileChannel
from camtorque.quantities import CHANNEL_QUANTITIES
from camtorque.records import Array, Refusal
from camtorque.units import BORDER_UNITS, is_known_unit, tidy_unit

LOOKED_AT = 400_000
"""Samples looked at of each channel."""
NAMES: tuple[tuple[str, str], ...] = (
    ("index", r"index|marker|null.?impuls|\bz.?(track|spur)\b|tdc|\bot\b"),
    ("encoder_a", r"(enc\w*|track|spur)[ _.-]?a\b"),
    ("encoder_b", r"(enc\w*|track|spur)[ _.-]?b\b"),
    ("trigger", r"trig|prox|geber|tooth|teeth|pulse|impuls|hall|pick.?up|wheel|tacho"),
    ("chamber_pressure", r"(chamber|cyl\w*|kammer|plunger)\D*(press|druck|\bp\b)"),
    ("gallery_pressure", r"(feed|gallery|inlet|supply|low|vorlauf|zulauf|f.rder)\D*(press|druck|\bp\b)"),
    ("fuel_temperature", r"(fuel|oil|diesel|kraftstoff|.l)[ _.-]*(temp|t\b)"),
    ("housing_temperature", r"temp"),
    ("torque", r"torque|moment|couple|\bmd\b|^t\d*$|\bm_?d\b"),
    ("pressure", r"press|druck|rail|^p\d*$|\bp_"),
    ("shaft_speed", r"speed|rpm|drehzahl|\bn\b|omega"),
    ("delivered_volume", r"volume|menge|delivery|quantity"),
    ("needle_lift", r"needle|nadel"),
    ("angle", r"angle|winkel|phi|degree"),
)
"""Quantity -> pattern of names, the more special first."""
BY_DIMENSION = {
    "torque": ("torque",),
    "pressure": ("pressure", "chamber_pressure", "gallery_pressure"),
    "temperature": ("fuel_temperature", "housing_temperature"),
    "speed": ("shaft_speed",),
    "angle": ("angle",),
    "volume": ("delivered_volume",),
    "length": ("needle_lift",),
}
LEVEL_SHARE, LEVEL_BAND = 0.85, 0.2
"""A pulse train spends this share of its samples within this part of its swing from either level."""
LEAST_PULSES = 4
LONG_PERIOD = 1.5
"""A period longer than the usual one by this factor is a gap of the wheel."""


@dataclass(frozen=True)
class Proposal:
    """A channel of a file and what it seems to be.

    Attributes
    ----------
    quantity : "" where nothing tells it
    unit : of recording.toml: the file's where it is known, V for pulses, else ""
    low, high : of the samples looked at, in the file's unit
    """

    path: Path
    file_format: str
    channel: FileChannel
    quantity: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Wheel:
    """What the pulses of a trigger show: rate of the revolutions [1/s], teeth (missing ones counted), missing ones."""

    revolutions_per_second: float
    pulses_per_rev: int
    missing_teeth: int


def look_into(paths: list[Path]) -> list[Proposal]:
    """Return every channel of the files with a proposal; one quantity once per file.

    Raises
    ------
    Refusal : a file that is no log, or one quantity more would be without a channel of numbers
    """
    found: list[Proposal] = []
    for path in paths:
        name = file_format(path, "")
        channels = FORMATS[name].channels(path)
        if not channels:
            raise Refusal(f"{path}: holds no channel of numbers")
        taken: set[str] = set()
        proposals = [_proposal(path, name, channel) for channel in channels]
        places = {id(item): place for place, item in enumerate(proposals)}
        for item in sorted(proposals, key=lambda item: _certainty(item), reverse=True):
            if item.quantity in taken:
                proposals[places[id(item)]] = Proposal(
                    item.path, item.file_format, item.channel, "", item.unit, item.low, item.high
                )
            taken.add(item.quantity)
        found += proposals
    return found


def _proposal(path: Path, name: str, channel: FileChannel) -> Proposal:
    values = channel.source.read(0, min(channel.n_samples, LOOKED_AT))
    good = values[np.isfinite(values)]
    low, high = (float(good.min()), float(good.max())) if good.size else (float("nan"), float("nan"))
    unit = tidy_unit(channel.unit or _unit_in(channel.name))
    quantity = _quantity(channel.name, unit, good)
    pulses = bool(quantity) and CHANNEL_QUANTITIES[quantity].is_pulse
    known = unit if unit in BORDER_UNITS else "V" if pulses else ""
    return Proposal(path, name, channel, quantity if good.size and high > low else "", known, low, high)


def _unit_in(name: str) -> str:
    """Return the unit that ends a name such as torque_Nm, "" where none does; one letter but V may mean anything."""
    last = re.split(r"[_ .]", name)[-1]
    return last if last != name and is_known_unit(last) and (len(last) > 1 or last == "V") else ""


def _quantity(name: str, unit: str, values: Array) -> str:
    """Return what a channel seems to be, "" where nothing tells."""
    dimension = BORDER_UNITS.get(unit, ("", 1.0))[0]
    named = next((quantity for quantity, pattern in NAMES if re.search(pattern, name, re.IGNORECASE)), "")
    if dimension in BY_DIMENSION:
        allowed = BY_DIMENSION[dimension]
        return named if named in allowed else allowed[0]
    if named and (not CHANNEL_QUANTITIES[named].is_pulse or is_pulse_train(values)):
        return named
    return "trigger" if not named and is_pulse_train(values) else ""


def _certainty(item: Proposal) -> int:
    """Return how sure a proposal is: a unit of the quantity tells more than a name."""
    if not item.quantity:
        return 0
    pattern = dict(NAMES)[item.quantity]
    return 1 + 2 * (item.unit not in ("", "V")) + bool(re.search(pattern, item.channel.name, re.IGNORECASE))


def is_pulse_train(values: Array) -> bool:
    """Tell a signal of two levels with several pulses."""
    if values.size < 100:
        return False
    low, high = np.percentile(values, [0.5, 99.5])
    swing = high - low
    if not swing > 0.0:
        return False
    # short pulses may stay below the percentile
    if np.mean(np.abs(values - low) < LEVEL_BAND * swing) > 1.0 - 1e-3:
        high = float(values.max())
        swing = high - low
    near = (np.abs(values - low) < LEVEL_BAND * swing) | (np.abs(values - high) < LEVEL_BAND * swing)
    return bool(np.mean(near) > LEVEL_SHARE) and rises(values, low, high).size >= LEAST_PULSES


def rises(values: Array, low: float, high: float) -> np.ndarray:
    """Return the samples at which a signal rises through its upper half, having been in its lower quarter."""
    marks = np.where(values > low + 0.6 * (high - low), 1, np.where(values < low + 0.3 * (high - low), -1, 0))
    at = np.flatnonzero(marks)
    kinds = marks[at]
    return at[1:][(kinds[1:] == 1) & (kinds[:-1] == -1)]


def wheel_of(channel: FileChannel) -> Wheel | None:
    """Return what the pulses show, None where there are too few; a gap tells the teeth, else one pulse a turn."""
    values = channel.source.read(0, min(channel.n_samples, LOOKED_AT))
    values = values[np.isfinite(values)]
    if channel.sample_rate is None or not values.size:
        return None
    places = rises(values, float(values.min()), float(values.max()))
    if places.size < LEAST_PULSES:
        return None
    periods = np.diff(places) / channel.sample_rate
    usual = float(np.median(periods))
    gaps = np.flatnonzero(periods > LONG_PERIOD * usual)
    turns = np.diff(gaps)
    if turns.size >= 2 and turns.min() == turns.max() >= 4:
        missing = round(float(np.median(periods[gaps])) / usual) - 1
        length = float(np.mean(np.diff(places[gaps]))) / channel.sample_rate
        return Wheel(1.0 / length, int(turns[0]) + missing, missing)
    return Wheel(1.0 / usual, 1, 0)
