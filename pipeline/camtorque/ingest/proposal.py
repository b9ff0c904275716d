"""What logs hold and what their channels may be: by unit, by name, by looking at the samples. For `camtorque new`.

Proposals are written into a file for a person to check; nothing is used unread.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camtorque.config.quantities import CHANNEL_QUANTITIES, SENSED
from camtorque.ingest.formats import FORMATS, file_format
from camtorque.ingest.raw import FileChannel
from camtorque.ingest.sensitivity import SUPPLIES
from camtorque.ingest.wheel import LEAST_PULSES, LOOKED_AT
from camtorque.records import Array, Refusal
from camtorque.units import absolute_unit, is_known_unit, tidy_unit, unit_kind

NAMES: tuple[tuple[str, str], ...] = (
    ("index", r"index|marker|null.?impuls|\bz.?(track|spur)\b|(enc\w*|track|spur)[ _.-]?[zn]\b|tdc|\bot\b"),
    ("encoder_a", r"(enc\w*|track|spur)[ _.-]?a\b"),
    ("encoder_b", r"(enc\w*|track|spur)[ _.-]?b\b"),
    ("angle", r"angle|winkel(?!geber)|degree"),
    (
        "trigger",
        r"trig|prox|geber|schalter|tooth|teeth|pulse|impuls|hall|pick.?up|wheel|tacho|crank|kurbel|\bvr\b|coil",
    ),
    ("chamber_pressure", r"(chamber|cyl\w*|kammer|plunger)\D*(press|druck|\bp\b)"),
    ("gallery_pressure", r"(feed|gallery|inlet|supply|low|vorlauf|zulauf|f.rder)\D*(press|druck|\bp\b)"),
    ("fuel_temperature", r"(fuel|oil|diesel|kraftstoff|.l)[ _.-]*(temp|t\b)"),
    ("housing_temperature", r"temp"),
    ("torque", r"torque|moment|couple|\bmd(?![a-z])|^t\d*$|^m\d*$|\bm_?d\b"),
    ("pressure", r"press|druck|rail|^p\d*$|\bp_|\bp(?-i:[A-Z])"),
    ("shaft_speed", r"speed|rpm|drehzahl|\bn\b|omega"),
    ("delivered_volume", r"volume|menge|delivery|quantity"),
    ("needle_lift", r"needle|nadel"),
    ("angle", r"phi\b|encoder"),
)
"""Quantity -> pattern of names, the more special first."""
FEED = r"feed|gallery|inlet|supply|vorlauf|zulauf|vordruck|f.rder"
"""Names of a pressure in front of the pump; without a unit of pressure they may mean other things."""
RIVALS = ("torque", "pressure")
"""Quantities of which a log may hold two that look alike: both sides of a coupling, two gauges."""
BY_DIMENSION = {
    "torque": ("torque",),
    "pressure": ("pressure", "chamber_pressure", "gallery_pressure"),
    "temperature": ("fuel_temperature", "housing_temperature"),
    "speed": ("shaft_speed",),
    "angle": ("angle",),
    "volume": ("delivered_volume",),
    "length": ("needle_lift",),
}
SUPPLY_NAME = r"exc|suppl|speis|versorg|br.cke.?(sp|u)|bridge.?(v|u)|\bu_?b\b"
"""Names of the supply of a bridge."""
TRAINS = ("trigger", "encoder_a")
TRACKS = ("encoder_a", "encoder_b", "index")
FASTER = 1.5
"""A pulse train with this many times the pulses of another one is a wheel beside its index."""
WAVE_SHARE, LEAST_WAVES = 0.2, 20
"""A coil's wave passes this share of its size to both sides, for this many teeth at least."""
LEVEL_SHARE, LEVEL_BAND = 0.85, 0.2
SURE_SHARE = 0.97
"""A pressure at full load may stand at two levels for less of its samples than pulses do."""
SHORT_SHARE = 0.006
"""A pulse train spends this share of its samples within this part of its swing from either level."""


@dataclass(frozen=True)
class Proposal:
    """A channel of a file and what it seems to be.

    Attributes
    ----------
    quantity : "" where nothing tells it
    unit : of recording.toml: the file's where it is known, logic for pulses of 0 and 1, V for others, else ""
    low, high : of the samples looked at, in the file's unit
    sensor : "inductive" for a trigger that is a coil, else ""
    has_rival : another channel may be this quantity as well
    is_absolute : a pressure that counts from vacuum
    levels : share of the samples at either of two levels
    supply : channel that seems to hold the supply of this bridge
    pulses : of a trigger or encoder, in the samples looked at [1/s, 1/sample where the rate is unknown]
    """

    path: Path
    file_format: str
    channel: FileChannel
    quantity: str
    unit: str
    low: float
    high: float
    sensor: str = ""
    has_rival: bool = False
    is_absolute: bool = False
    levels: float = 0.0
    pulses: float = 0.0
    supply: str = ""


def look_into(paths: list[Path]) -> list[Proposal]:
    """Return every channel of the files with a proposal.

    One trigger per file, any other quantity once; which of two torques or pressures is meant a person has to say. Of
    several pulse trains of a file without an index the slowest is one.

    Raises
    ------
    Refusal : a file that is no log, or one without a channel of numbers
    """
    found: list[Proposal] = []
    for path in paths:
        name = file_format(path, "")
        channels = FORMATS[name].channels(path)
        if not channels:
            raise Refusal(f"{path}: holds no channel of numbers")
        groups = Counter(channel.group for channel in channels)
        looked = [_proposal(path, name, channel, _hint(path, channel, groups)) for channel in channels]
        found += [item for item in looked if np.isfinite(item.low)] or looked
    found = _without_unsure(_with_index(_with_tracks(found)))
    found = [replace(item, supply=_supply_of(item, found)) for item in found]
    alike: dict[tuple[str, Path | None], list[int]] = {}
    for number, item in enumerate(found):
        if item.quantity:
            # pulses of each file, any other quantity once
            own = item.path if CHANNEL_QUANTITIES[item.quantity].is_pulse else None
            alike.setdefault((item.quantity, own), []).append(number)
    kept: dict[int, bool] = {}
    for (quantity, _), numbers in alike.items():
        best = max(_certainty(found[number]) for number in numbers)
        chosen = [number for number in numbers if _certainty(found[number]) == best]
        rivals = quantity in RIVALS and len(chosen) > 1
        kept |= dict.fromkeys(chosen if rivals else chosen[:1], rivals)
    return [
        replace(item, has_rival=kept[number]) if number in kept else _dropped(item) for number, item in enumerate(found)
    ]


def _hint(path: Path, channel: FileChannel, groups: Counter[str]) -> str:
    """Return what names a channel beside its own name: the struct or group, or the file, that holds it alone."""
    if groups.total() == 1:
        return f"{path.stem} {channel.group}"
    return channel.group if groups[channel.group] == 1 else ""


def _with_tracks(found: list[Proposal]) -> list[Proposal]:
    """Take pulse trains that are called A, B and Z (or N) beside each other for the tracks of an encoder."""
    for path in dict.fromkeys(item.path for item in found):
        named = {item.channel.name.strip().upper(): number for number, item in enumerate(found) if item.path == path}
        tracks = dict(zip(TRACKS, ("A", "B", "Z" if "Z" in named else "N"), strict=True))
        if all(name in named and found[named[name]].quantity in ("trigger", "index") for name in tracks.values()):
            for quantity, name in tracks.items():
                found[named[name]] = replace(found[named[name]], quantity=quantity, sensor="")
    return found


def _with_index(found: list[Proposal]) -> list[Proposal]:
    """Take the fastest pulse train of each file for its trigger or encoder, and a slower one for its index."""
    for path in dict.fromkeys(item.path for item in found):
        trains = [number for number, item in enumerate(found) if item.path == path and item.quantity in TRAINS]
        places = [number for number in trains if _is_surely_pulses(found[number])]
        places.sort(key=lambda number: found[number].pulses)
        if len(places) < 2 or found[places[-1]].pulses < FASTER * found[places[0]].pulses:
            continue
        has_index = any(item.quantity == "index" for item in found if item.path == path)
        slow = found[places[0]]
        for number in places[:-1]:
            found[number] = _dropped(found[number])
        if not has_index and not slow.sensor:
            found[places[0]] = replace(slow, quantity="index")
    return found


def _without_unsure(found: list[Proposal]) -> list[Proposal]:
    """Drop triggers that may be a pressure at full load, where torque or pressure is missing beside a sure one."""
    triggers = [item for item in found if item.quantity == "trigger" and not item.sensor]
    if {item.quantity for item in found} >= set(RIVALS) or not any(map(_is_surely_pulses, triggers)):
        return found
    unsure = {id(item) for item in triggers if not _is_surely_pulses(item)}
    return [_dropped(item) if id(item) in unsure else item for item in found]


def _supply_of(item: Proposal, found: list[Proposal]) -> str:
    """Return the channel beside a bridge in mV that is named for its supply and holds one, "" where none does."""
    if item.quantity not in RIVALS or item.unit not in ("mV", "uV"):
        return ""
    place = item.path, item.channel.group, item.channel.n_samples
    for other in found:
        volts = not other.quantity and other.unit in ("V", "") and SUPPLIES[0] <= other.low <= other.high <= SUPPLIES[1]
        is_mate = (other.path, other.channel.group, other.channel.n_samples) == place
        if volts and is_mate and re.search(SUPPLY_NAME, other.channel.name, re.IGNORECASE):
            return other.channel.name
    return ""


def _is_surely_pulses(item: Proposal) -> bool:
    return item.levels > SURE_SHARE or _named(item.channel.name) == "trigger"


def _dropped(item: Proposal) -> Proposal:
    """Return a channel without its quantity, where another channel is more likely."""
    unit = tidy_unit(item.channel.unit or _unit_in(item.channel.name))
    return replace(item, quantity="", unit=unit if is_known_unit(unit) else "", sensor="")


def _proposal(path: Path, name: str, channel: FileChannel, hint: str) -> Proposal:
    values = channel.source.read(0, min(channel.n_samples, LOOKED_AT))
    good = values[np.isfinite(values)]
    low, high = (float(good.min()), float(good.max())) if good.size else (float("nan"), float("nan"))
    base = absolute_unit(channel.unit)
    unit = base or tidy_unit(channel.unit or _unit_in(channel.name))
    if unit == "nm" and (_named(channel.name) or _named(hint)) == "torque":
        unit = ""  # newton metres in small letters: a person has to say
    quantity = _quantity(channel.name, hint, unit, good) if good.size and high > low else ""
    pulses = bool(quantity) and CHANNEL_QUANTITIES[quantity].is_pulse
    guessed = ("logic" if set(np.unique(good)) == {0.0, 1.0} else "V") if pulses else ""
    known = unit if is_known_unit(unit) else guessed
    coil = "inductive" if quantity == "trigger" and not is_pulse_train(good) else ""
    levels = level_share(good) if pulses else 0.0
    beats = (_half_waves(good) / 2.0 if coil else pulse_count(good)) if quantity in TRAINS else 0.0
    every = beats / max(good.size, 1) * (channel.sample_rate or 1.0)
    return Proposal(path, name, channel, quantity, known, low, high, coil, False, bool(base), levels, every)


def _unit_in(name: str) -> str:
    """Return the unit that ends a name such as torque_Nm, "" where none does; one letter but V may mean anything."""
    last = re.split(r"[_ .]", name)[-1]
    return last if last != name and is_known_unit(last) and (len(last) > 1 or last == "V") else ""


def _quantity(name: str, hint: str, unit: str, values: Array) -> str:
    """Return what a channel seems to be by its unit, its name (or that of a file for itself) and its samples."""
    dimension = unit_kind(unit)
    named = _named(name) or _named(hint)
    if dimension in BY_DIMENSION:
        allowed = BY_DIMENSION[dimension]
        if dimension == "pressure" and re.search(FEED, name, re.IGNORECASE):
            return "gallery_pressure"
        return named if named in allowed else allowed[0]
    if named and not CHANNEL_QUANTITIES[named].is_pulse and np.unique(values).size == 2 and is_pulse_train(values):
        named = ""  # a digital line, whatever its name
    if named and (not CHANNEL_QUANTITIES[named].is_pulse or is_pulse_train(values)):
        return named
    if named == "trigger" and _half_waves(values) >= 2 * LEAST_WAVES:
        return "trigger"
    return "trigger" if not named and is_pulse_train(values) else ""


def _named(name: str) -> str:
    return next((quantity for quantity, pattern in NAMES if re.search(pattern, name, re.IGNORECASE)), "")


def _certainty(item: Proposal) -> float:
    """Return how sure a proposal is: a unit of the quantity tells more than a name."""
    is_scaled = (unit_kind(item.unit) or SENSED[0]) not in SENSED
    return 1 + 2 * is_scaled + (_named(item.channel.name) == item.quantity) + 0.5 * item.levels


def is_pulse_train(values: Array) -> bool:
    """Tell a signal of two levels with several pulses."""
    return level_share(values) > LEVEL_SHARE and pulse_count(values) >= LEAST_PULSES


def pulse_count(values: Array) -> int:
    """Return how often a signal rises through its upper half, having been in its lower quarter."""
    low, high = _levels(values)
    marks = np.where(values > low + 0.6 * (high - low), 1, np.where(values < low + 0.3 * (high - low), -1, 0))
    marks = marks[marks != 0]
    return int(np.sum(np.diff(marks) > 0))


def level_share(values: Array) -> float:
    """Return the share of the samples near either of a signal's two levels, 0 where there is one only."""
    low, high = _levels(values)
    band = LEVEL_BAND * (high - low)
    near = (np.abs(values - low) < band) | (np.abs(values - high) < band)
    return float(np.mean(near)) if high > low else 0.0


def _levels(values: Array) -> tuple[float, float]:
    """Return the two levels of a signal, equal where there are none."""
    if values.size < 100:
        return 0.0, 0.0
    low, high = (float(level) for level in np.percentile(values, [0.5, 99.5]))
    # short pulses stay outside of the percentiles
    if np.mean(np.abs(values - low) <= LEVEL_BAND * (float(values.max()) - low)) > 1.0 - SHORT_SHARE:
        high = float(values.max())
    elif np.mean(np.abs(values - high) <= LEVEL_BAND * (high - float(values.min()))) > 1.0 - SHORT_SHARE:
        low = float(values.min())
    return low, high


def _half_waves(values: Array) -> int:
    """Return how often a signal changes to the other side of zero, as that of a coil in front of a wheel does."""
    size = np.percentile(np.abs(values), 99.0)
    signs = np.sign(np.where(np.abs(values) > WAVE_SHARE * size, values, 0.0))
    signs = signs[signs != 0.0]
    return int(np.sum(np.diff(signs) != 0.0))
