"""Load cases of a design: speed and pressure on the plunger over lift, from the [[load]] of its file.

A pressure is a trapezoid over lift, a file carried by the lift, or that of a fitted chamber, which is what a fit knows
of the pump to be improved beside its friction.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config.pump import PressureCurve, PumpConfig
from camtorque.config.tables import Table
from camtorque.design.schema import LOAD, MILLIMETRE, read_values
from camtorque.ingest.pump_file import read_pressure_curve
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.predict import cam_of, pressure_at
from camtorque.records import Array, ReadOnly, Refusal
from camtorque.units import RPM, angle_grid, did_you_mean


@dataclass(frozen=True)
class FittedStroke(ReadOnly):
    """The pressure on the plunger over the angle of the fitted cam, by the fitted chamber under a recording's load.

    ``delivering`` is the share of the plunger's flow that leaves for the line, at the angles of ``pressure``; empty
    where no chamber was fitted, which alone would tell it.
    """

    recording: str
    pressure: PressureCurve
    delivering: Array


@dataclass(frozen=True)
class FittedPump:
    """A pump as a fit knows it.

    Attributes
    ----------
    path : of the fit, for messages
    pump_id : of its recordings
    friction : guide coefficient, bearing and pin arm [-, m, m]
    law : lift of the cam that it was fitted with
    recordings : names of what was fitted
    stroke : recording ("" for the one nearest in speed), speed [rad/s] -> what the fitted chamber does there
    """

    path: Path
    pump_id: str
    friction: tuple[float, float, float]
    law: CamLaw
    recordings: tuple[str, ...]
    stroke: Callable[[str, float], FittedStroke]


def same_pump(path: Path, config: PumpConfig, there: str) -> None:
    """Refuse a fit of another pump, or a pump file without an id to compare."""
    here = str(tomllib.loads(config.text).get("pump", {}).get("id", ""))
    if not here or here != there:
        raise Refusal(
            f"{path}: is a fit of the pump {there!r}, expected that of {config.path}, whose id is {here!r}; name the "
            "fit of this pump, or give it the same id where it is the same"
        )


WAYS = (("pressure_bar", "closes_mm", "spills_mm", "ramp_mm"), ("pressure_file",), ("recording",))
"""Keys of the ways to a pressure, of which a load takes one."""
Corners = tuple[Array, Array, Array, Array, Array]
"""Lifts and pressures of a load on the rise and on the return, and lifts at which it is evaluated exactly."""


@dataclass(frozen=True)
class Load(ReadOnly):
    """One speed with the pressure on the plunger over lift, on the rise and on the return.

    The pressure belongs to the stroke, not to the cam angle: whatever the cam, the same volume is delivered at the same
    pressure.

    Attributes
    ----------
    name : for messages
    speed : [rad/s]
    lifts, pressures : (k,) corners on the rise, linear in between [m, Pa]
    back_lifts, back_pressures : on the return
    events : (j,) lifts at which the rise is evaluated exactly [m]
    source : recording whose fitted chamber pressure it is, empty for none
    delivering : (k,) share of the plunger's flow that leaves for the line at ``lifts``; empty: as the pressure is high
    pressure_file : its pressure was read from, None for another origin
    """

    name: str
    speed: float
    lifts: Array
    pressures: Array
    back_lifts: Array
    back_pressures: Array
    events: Array
    source: str = ""
    delivering: Array = field(default_factory=lambda: np.zeros(0))
    pressure_file: Path | None = None

    def on_rise(self, lift: Array) -> Array:
        """Return the pressure at some lifts of the rise [Pa]."""
        return np.interp(lift, self.lifts, self.pressures)

    def on_return(self, lift: Array) -> Array:
        """Return the pressure at some lifts of the return [Pa]."""
        return np.interp(lift, self.back_lifts, self.back_pressures)

    @property
    def share(self) -> tuple[Array, Array]:
        """Corners of the share of the plunger's flow that is delivered over lift on the rise.

        Where it is not known it is the share of the peak pressure.
        """
        if self.delivering.size:
            return self.lifts, self.delivering
        peak = float(np.max(self.pressures))
        return self.lifts, self.pressures / peak if peak > 0.0 else np.ones_like(self.pressures)

    @cached_property
    def half(self) -> tuple[float, float]:
        """The lifts between which that share is at least a half [m]; inf where it stays so to the end."""
        corners, share = self.share
        steps = np.flatnonzero(np.diff(share >= 0.5))
        ends = corners[steps] + (0.5 - share[steps]) / np.diff(share)[steps] * np.diff(corners)[steps]
        first = 0.0 if share[0] >= 0.5 or not ends.size else float(ends[0])
        return first, float(ends[-1]) if ends.size and share[-1] < 0.5 else float("inf")

    def delivered(self, lift: float) -> float:
        """Return the stroke that delivers on a rise to some lift: the integral of the share over lift [m]."""
        corners, share = self.share
        grid = np.unique(np.clip(np.concatenate([[0.0, lift], corners]), 0.0, lift))
        return float(np.trapezoid(np.interp(grid, corners, share), grid))


def loads_of(table: Table, config: PumpConfig, fitted: FittedPump | None) -> list[Load]:
    """Return one load per speed of a [[load]] table."""
    one = table.values.get("speed_rpm")
    given = {**table.values, "speed_rpm": [one]} if isinstance(one, int | float) else table.values
    values = read_values(Table(given, table.file, table.header), LOAD)
    named = [next(key for key in way if table.has(key)) for way in WAYS if any(map(table.has, way))]
    if len(named) > 1:
        raise Refusal(
            f"{table.where(named[0])}: found {' and '.join(named)} in one load, expected one of them; leave the other "
            "out, or write a [[load]] for each"
        )
    stated = values["pressure_bar"] is not None or values["pressure_file"] is not None
    if values["recording"] or (fitted is not None and not stated):
        return [_fitted_load(table, values["recording"], speed, fitted) for speed in values["speed_rpm"]]
    if values["pressure_file"] is not None:
        curve = _carried(read_pressure_curve(values["pressure_file"]), cam_of(config), table.where("pressure_file"))
    else:
        curve = _trapezoid(table, values)
    file = values["pressure_file"]
    return [Load(f"{speed / RPM:g} rpm", speed, *curve, pressure_file=file) for speed in values["speed_rpm"]]


def _fitted_load(table: Table, recording: str, speed: float, fitted: FittedPump | None) -> Load:
    where = table.where("recording")
    if fitted is None:
        raise Refusal(f"{where}: found {recording!r} without a fit, expected one; name it with --from RESULT")
    if recording and recording not in fitted.recordings:
        raise Refusal(
            f"{where}: {recording!r} is no recording of {fitted.path}{did_you_mean(recording, fitted.recordings)}; "
            f"there are {', '.join(fitted.recordings)}"
        )
    stroke = fitted.stroke(recording, speed)
    corners = _carried(stroke.pressure, fitted.law, where)
    theta, lift = _from_rest(fitted.law)
    rise = slice(0, int(np.argmax(lift)) + 1)
    delivering = stroke.delivering
    if delivering.size:
        share = np.interp(theta[rise], stroke.pressure.theta, delivering, period=2.0 * np.pi)
        delivering = np.interp(corners[0], np.maximum.accumulate(lift[rise]), share)
    name = f"{speed / RPM:g} rpm, {stroke.recording}"
    return Load(name, speed, *corners, source=stroke.recording, delivering=delivering)


def _trapezoid(table: Table, values: Mapping[str, Any]) -> Corners:
    """Return a pressure that comes and goes over lift on the rise; nothing on the return."""
    for name in ("pressure_bar", "spills_mm"):
        if values[name] is None:
            raise Refusal(f"{table.where(name)}: this key is missing; give it, or a pressure_file, or a fit (--from)")
    closes, spills, ramp = (values[name] for name in ("closes_mm", "spills_mm", "ramp_mm"))
    if spills < closes + ramp:
        raise Refusal(
            f"{table.where('spills_mm')}: found {spills / MILLIMETRE:g} mm, expected at least {ramp / MILLIMETRE:g} mm "
            f"(ramp_mm) above closes_mm, {closes / MILLIMETRE:g} mm"
        )
    lifts = np.array([closes, closes + ramp, spills, spills + ramp])
    shape = values["pressure_bar"] * np.array([0.0, 1.0, 1.0, 0.0])
    return lifts, shape, np.array([0.0, 1.0]), np.zeros(2), lifts


def _carried(curve: PressureCurve, law: CamLaw, where: str) -> Corners:
    """Return a curve over the angle of a cam as pressure over lift: it belongs to the stroke; ``where``: its key."""
    theta, lift = _from_rest(law)
    pressure, peak = pressure_at(curve, theta), int(np.argmax(lift))
    highest = np.minimum(lift[int(np.argmax(pressure))], lift[peak])
    grid = np.unique(np.append(np.linspace(0.0, lift[peak], 400), highest))
    rise, back = np.maximum.accumulate(lift[: peak + 1]), np.maximum.accumulate(lift[:peak:-1])
    if rise.size < 3 or back.size < 3:
        raise Refusal(f"{where}: its cam has no rise and return to carry it by")
    up, down = (np.interp(grid, y, p) for y, p in ((rise, pressure[: peak + 1]), (back, pressure[:peak:-1])))
    return grid, up, grid, down, grid[[int(np.argmax(up))]]


def _from_rest(law: CamLaw) -> tuple[Array, Array]:
    """Return a revolution that begins where the return ends, (3600,): angles [rad] and lift [m]."""
    theta = angle_grid(3600)
    lift = law.evaluate(theta)
    top = int(np.argmax(lift))
    shift = -int(np.argmin(np.where(lift < 1e-3 * lift[top], (theta - theta[top]) % (2.0 * np.pi), np.inf)))
    return np.roll(theta, shift), np.roll(lift, shift)
