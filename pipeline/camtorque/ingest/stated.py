"""What sheets state of pump, trigger and sensors, and where recordings of one pump state it differently.

A fit takes these numbers as given: one that was typed otherwise comes out as a change of the pump.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from hashlib import sha256
from math import isnan
from typing import Any

from camtorque.config import RecordingConfig
from camtorque.config.keys import Key
from camtorque.config.quantities import SENSED
from camtorque.config.schemas import RECORDING_TABLES
from camtorque.records import Finding, Recording
from camtorque.units import unit_kind

DIMENSIONS = tuple(f"[pump] {name}" for name in (
    "plunger_diameter_m", "base_circle_radius_m", "roller_radius_m", "follower_offset_m"
))  # fmt: skip
"""What differs between pumps, not between the states of one."""
TRIGGER = "[trigger]"
PLACE = "pressure sensor, place"
NUMBERS = ("number", "whole", "choice", "flag")
"""Kinds of key from which a model is computed."""
DIGITS = 7
MOST_NAMED = 3


def stated(recording: Recording) -> dict[str, str]:
    """Return what a fit takes as given: table and key of a recording.toml, lift table, sensors -> value as text."""
    config, found = recording.config, dict[str, str]()
    for name, record in (("pump", config.pump_sheet), ("trigger", config.trigger)):
        schema = RECORDING_TABLES[name]
        for key in schema.keys if record is not None else ():
            if key.used and key.kind in NUMBERS:
                found[f"{schema.header} {key.name}"] = _text(key, getattr(record, key.attribute))
    if config.trigger is not None:
        found[f"{TRIGGER} source"] = "a recorded angle" if recording.of("angle") else "pulses"
    table = recording.lift_table
    if table is not None:
        found["lift table"] = sha256(table.theta.tobytes() + table.lift.tobytes()).hexdigest()[:8]
    if "pressure" in config.sensors:
        found[PLACE] = "the chamber" if config.measures_chamber else "the line"
    for quantity, unit in (("torque", "N m"), ("pressure", "Pa")):
        sheets = [channel.calibration for channel in recording.of(quantity) if channel.calibration is not None]
        for sheet in sheets[:1]:
            values = {f"gain [{unit}/V]": sheet.gain, "delay [s]": sheet.delay, "cut-off [Hz]": sheet.cutoff_hz}
            texts = {what: "nothing" if isnan(value) else f"{value:.{DIGITS}g}" for what, value in values.items()}
            found |= {f"{quantity} sensor, {what}": text for what, text in texts.items()}
            if sheet.gain == 1.0 and not _in_volts(config, quantity):  # the logger has scaled already
                found[f"{quantity} sensor, gain [{unit}/V]"] = "the logger's"
    return found


def _in_volts(config: RecordingConfig, quantity: str) -> bool:
    """Return whether a channel holds what its sensor gives: 10 V for 10 N m are a gain of one, too."""
    return any(unit_kind(spec.output_unit) in SENSED for spec in config.channels if spec.quantity == quantity)


def _text(key: Key, value: Any) -> str:
    if value is None or value == "":
        return "nothing"
    return f"{key.of_si(value):.{DIGITS}g}" if key.kind == "number" else str(value)


def differences(sides: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """Return what is not stated alike: name -> who states what, in words.

    Parameters
    ----------
    sides : name of a recording -> what is `stated` there
    """
    found = {}
    for name in dict.fromkeys(name for values in sides.values() for name in values):
        by_value = {side: values.get(name, "nothing") for side, values in sides.items()}
        (usual, count), *others = Counter(by_value.values()).most_common()
        if not others:
            continue
        odd = [f"{value} in {side}" for side, value in by_value.items() if value != usual]
        named = ", ".join(odd[:MOST_NAMED]) + (f" and {len(odd) - MOST_NAMED} others" if len(odd) > MOST_NAMED else "")
        rest = "the others" if count > 1 else next(side for side, value in by_value.items() if value == usual)
        found[name] = f"{named}, {usual} in {rest}"
    return found


def other_triggers(sides: Iterable[Mapping[str, str]]) -> bool:
    """Return whether recordings take the cam angle from triggers that are declared differently."""
    return len({tuple(pair for pair in stated.items() if pair[0].startswith(TRIGGER)) for stated in sides}) > 1


def difference_findings(found: Mapping[str, str]) -> tuple[Finding, ...]:
    """Return a warning on each number that the sheets of recordings of one pump state differently: `differences`."""
    triggers = "; ".join(f"{name} is {text}" for name, text in found.items() if name.startswith(TRIGGER))
    rest = {name: text for name, text in found.items() if not name.startswith(TRIGGER)}
    return tuple(
        Finding("sheets_differ", "warning", f"{name} is {text}: each is read by its own sheet, so that a wrong one "
                f"comes out as a change of the pump; {remedy(name)}", name)
        for name, text in rest.items()
    ) + triggers_findings(triggers)  # fmt: skip


def triggers_findings(text: str) -> tuple[Finding, ...]:
    """Return a warning on triggers that are declared differently, in words; none where they are not."""
    said = (
        f"{text}: each recording has its own error of the trigger's angle in the joint fit, which is fitted where a "
        "recording is predicted from the others, and taken as none in a blind prediction; correct a wrong one"
    )
    return (Finding("triggers_differ", "warning", said, TRIGGER),) if text else ()


def remedy(name: str) -> str:
    """Return what to do about a number that is stated differently: a transducer is calibrated, a pump rebuilt."""
    right = (
        "as after a calibration, leave them" if " sensor," in name else "part the recordings by group in [recording]"
    )
    return f"correct it; where all are right, {right}"
