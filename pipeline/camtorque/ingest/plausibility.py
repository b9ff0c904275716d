"""Numbers that are each within their band but cannot belong together: such a slip is refused with its place.

`PUMP_RATIOS` compares sizes of one pump with each other, `check_loads` the largest torque with what the largest
pressure can cause. The limits come from 46 pumps of three makers, for which the ratios lie in ``seen``, and from sizes
of built ones (fuel pumps of cars to ships); what lies well outside is reported, what lies far outside is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.config import PumpData, RecordingConfig
from camtorque.config.pump import weak_pressure
from camtorque.config.tables import Problems
from camtorque.ingest.largest import largest, marked_missing, overload_findings
from camtorque.ingest.outliers import outliers_text
from camtorque.ingest.proposal import SURE_SHARE, level_share, pulse_count
from camtorque.ingest.wheel import LEAST_PULSES, LOOKED_AT
from camtorque.records import Array, CamTable, Channel, Finding, Recording, Refusal, SensorCalibration
from camtorque.units import BAR, STEEL_DENSITY, short

PRE_STROKE = re.compile(r"pre.?stroke|pressuri[sz]ation|vorhub|f.rderbeginn|start of delivery", re.IGNORECASE)
CLOSING_LIFT = (0.04, 0.5)
"""Share of the lift at which a pre-stroke ends; 21 pumps of other makers have 0.11 to 0.34."""
SMOOTHED = 5.0
"""Slopes and bends of a lift table are taken over this many degrees, to suppress its noise."""
STEEPER = 1.0 / 3.0
"""Part of the trigger's time between its two levels a pulse below which another log is the trigger: pressures and
torques of 69 recordings are between theirs for ten times the trigger's time or longer, exchanged for a tenth of it."""
FAR_BEYOND = 3.0
"""A sensor stands up to twice its range; a pressure of more than so many times that is in another unit."""
LOADED = 30.0 * BAR
"""Below this peak pressure friction and spring rule the torque."""
PRESSURE_SLIPS = {
    1.0e1: "MPa read as bar", 1.0e2: "bar read as kPa", 1.0e3: "kPa read as Pa, or MPa as kPa",
    1.0e5: "bar read as Pa", 1.0e6: "MPa read as Pa",
}  # fmt: skip
"""Factor by which a pressure is too small -> the slip."""
TORQUE_SLIPS = {1.0e3: "N mm read as N m, or N m as kN m", 1.0e-3: "N m read as N mm, or kN m as N m"}
"""Factor by which a torque is too large -> the slip."""
LOAD_USUAL, LOAD_POSSIBLE = (0.55, 2.2), (0.3, 4.0)
HERTZ_USUAL, HERTZ_POSSIBLE = 3.0e9, 6.0e9
"""Contact stress of rolling steel is 0.5 to 2.5 GPa; 6 GPa marks any steel at first touch [Pa]."""


@dataclass(frozen=True)
class Ratio:
    """A ratio of sizes of one pump: what it is, its value, limits, the keys to look at."""

    what: str
    value: Callable[[PumpData, CamTable], float]
    seen: tuple[float, float]
    usual: tuple[float, float]
    possible: tuple[float, float]
    keys: str


def _steel(radius: float) -> float:
    return STEEL_DENSITY * radius**3


def _mean(*sizes: float) -> float:
    return float(math.prod(sizes)) ** (1.0 / len(sizes))


def _roller_disc(pump: PumpData) -> float:
    """Return the mass of a steel disc as large as the roller [kg]."""
    return STEEL_DENSITY * math.pi * pump.roller_radius**2 * pump.roller_width


def _pitch_curvature(pump: PumpData, table: CamTable) -> float:
    """Return roller radius times the largest curvature of its centre's path: at 1 the cam ends in a point."""
    step = np.radians(SMOOTHED)
    angle = np.arange(0.0, 2.0 * np.pi, step)
    before, lift, after = (table.at(angle + d) for d in (-step, 0.0, step))
    slope, bend = (after - before) / (2.0 * step), (after - 2.0 * lift + before) / step**2
    away, offset = slope - pump.follower_offset, pump.follower_offset
    centre = np.sqrt(max((pump.base_circle_radius + pump.roller_radius) ** 2 - offset**2, 0.0)) + lift
    curvature = (centre**2 + away * (slope + away) - centre * bend) / np.hypot(centre, away) ** 3
    return float(np.max(curvature)) * pump.roller_radius


PUMP_RATIOS: dict[str, Ratio] = {
    "lift": Ratio("largest lift over base circle radius", lambda p, t: float(np.max(t.lift)) / p.base_circle_radius,
                  (0.24, 0.54), (0.03, 1.0), (0.003, 1.6), "the unit of the lift table, base_circle_radius_m"),
    "plunger": Ratio("plunger diameter over base circle radius", lambda p, t: p.plunger_diameter / p.base_circle_radius,
                     (0.25, 0.68), (0.08, 1.6), (0.02, 3.0), "plunger_diameter_m, base_circle_radius_m"),
    "roller": Ratio("roller radius over base circle radius", lambda p, t: p.roller_radius / p.base_circle_radius,
                    (0.25, 0.59), (0.08, 1.6), (0.02, 4.0), "roller_radius_m, base_circle_radius_m"),
    "roller_width": Ratio("roller width over its radius", lambda p, t: p.roller_width / p.roller_radius,
                          (0.6, 1.5), (0.1, 6.0), (0.02, 20.0), "roller_width_m, roller_radius_m"),
    "size": Ratio("mean of largest lift and plunger diameter over base circle radius",
                  lambda p, t: _mean(float(np.ptp(t.lift)), p.plunger_diameter) / p.base_circle_radius,
                  (0.22, 0.54), (0.21, 0.85), (0.02, 3.0),
                  "base_circle_radius_m (is it the diameter?), the lift table, plunger_diameter_m (is it the radius?)"),
    "roller_size": Ratio("roller radius over the mean of largest lift, plunger diameter and 0.4 base circle radii",
                         lambda p, t: p.roller_radius / _mean(float(np.ptp(t.lift)), p.plunger_diameter,
                                                              0.4 * p.base_circle_radius),
                         (0.72, 1.46), (0.62, 1.6), (0.05, 10.0),
                         "roller_radius_m (is it the diameter?), base_circle_radius_m, the lift table"),
    "undercut": Ratio("roller radius times the curvature of its path about the cam, which no cam can drive above 1,",
                      _pitch_curvature, (0.28, 0.7), (0.0, 0.85), (-1.0, 1.05),
                      "roller_radius_m, base_circle_radius_m (too small), the lift table"),
    "offset": Ratio("follower offset over base circle and roller radius",
                    lambda p, t: abs(p.follower_offset) / (p.base_circle_radius + p.roller_radius),
                    (0.0, 0.12), (0.0, 0.5), (0.0, 0.95), "follower_offset_m"),
    "cam_inertia": Ratio("cam inertia over its mass times base circle radius squared",
                         lambda p, t: p.cam_inertia / (p.cam_mass * p.base_circle_radius**2),
                         (0.11, 1.03), (0.03, 5.0), (0.003, 50.0), "cam_inertia_kg_m2, cam_mass_kg"),
    "cam_mass": Ratio("cam mass over that of a steel cube of its radius",
                      lambda p, t: p.cam_mass / _steel(p.base_circle_radius),
                      (1.4, 246.0), (0.2, 400.0), (0.02, 2000.0), "cam_mass_kg, base_circle_radius_m"),
    "follower_mass": Ratio("follower mass over that of a steel cube of the cam's radius",
                           lambda p, t: p.follower_mass / _steel(p.base_circle_radius),
                           (0.42, 7.3), (0.06, 10.0), (0.005, 100.0), "follower_mass_kg, base_circle_radius_m"),
    "spring": Ratio("spring preload over the force it gains by the lift",
                    lambda p, t: p.spring_preload / (p.spring_stiffness * float(np.max(t.lift)))
                    if p.spring_stiffness and p.spring_preload else 1.0,
                    (0.22, 2.25), (0.1, 6.0), (0.003, 300.0), "spring_stiffness_N_per_m, spring_preload_N"),
    "roller_mass": Ratio("roller mass over follower mass", lambda p, t: (p.roller_mass or 0.0) / p.follower_mass,
                         (0.0, 0.5), (0.0, 0.9), (0.0, 1.0), "roller_mass_kg, follower_mass_kg"),
    "roller_disc": Ratio("roller mass over that of a steel disc of its size",
                         lambda p, t: p.roller_mass / _roller_disc(p) if p.roller_mass else 1.0,
                         (1.0, 1.0), (0.3, 1.6), (0.05, 8.0),
                         "roller_mass_kg, roller_radius_m (is it the diameter?), roller_width_m"),
    "follower_disc": Ratio("follower mass over that of a steel disc as large as its roller",
                           lambda p, t: p.follower_mass / _roller_disc(p), (1.4, 37.0), (1.0, 150.0), (0.2, 5000.0),
                           "follower_mass_kg, roller_radius_m (is it the diameter?), roller_width_m"),
    "roller_gyration": Ratio("roller inertia over its mass times radius squared, 0.5 to 1 for a disc with a bore,",
                             lambda p, t: p.roller_inertia / (p.roller_mass * p.roller_radius**2)
                             if p.roller_inertia and p.roller_mass else 0.6,
                             (0.5, 0.7), (0.45, 1.0), (0.3, 1.3),
                             "roller_radius_m (is it the diameter?), roller_inertia_kg_m2, roller_mass_kg"),
    "roller_inertia": Ratio("roller inertia over that of a ring of the follower's mass",
                            lambda p, t: (p.roller_inertia or 0.0) / (p.follower_mass * p.roller_radius**2),
                            (0.0, 0.3), (0.0, 0.8), (0.0, 1.0), "roller_inertia_kg_m2, roller_radius_m"),
}  # fmt: skip


OF_ROLLERS = frozenset({"roller", "roller_width", "roller_size", "follower_disc"})
"""Ratios that say nothing of a foot that slides (roller_inertia_kg_m2 = 0), whose radius is that of its crown."""


def check_pump(config: RecordingConfig, table: CamTable) -> list[Finding]:
    """Compare sizes of one pump with each other.

    Raises
    ------
    Refusals : sizes that no one pump has, all of them
    """
    problems, findings = Problems(), []
    where = f"{config.path} [pump]"
    foot, (wrong, _) = config.pump.roller_inertia == 0.0, outliers_text(table)
    # the cam sees the offset on its other side where it runs backwards
    pump = replace(config.pump, follower_offset=config.pump.follower_offset * config.rotation)
    for name, ratio in PUMP_RATIOS.items():
        if foot and name in OF_ROLLERS:
            continue
        value = ratio.value(pump, table)
        ask = f"{wrong}: measure them again" if wrong and "the lift table" in ratio.keys else f"check {ratio.keys}"
        text = f"{ratio.what} is {short(value)}, usual are {ratio.usual[0]:g} to {ratio.usual[1]:g}; {ask}"
        if not ratio.possible[0] <= value <= ratio.possible[1]:
            problems.texts.append(f"{where}: {text}")
        elif not ratio.usual[0] <= value <= ratio.usual[1]:
            findings.append(Finding("pump_unusual", "warning", text, f"{config.path.name} [pump]"))
    problems.raise_any()
    return findings


def check_trigger(config: RecordingConfig, table: CamTable) -> list[Finding]:
    """Hold a nominal angle that is said to end the pre-stroke against the rise of the lift table.

    Raises
    ------
    Refusal : the lift does not rise there
    """
    trigger = config.trigger
    if not PRE_STROKE.search(trigger.meaning) or trigger.side != "cam":
        return []
    at = trigger.nominal_angle + trigger.installation_tolerance * np.linspace(-1.0, 1.0, 21)
    step = np.radians(2.0)
    lift = [table.at(at + shift) for shift in (-step, step)]
    where = f"{config.path} [trigger] nominal_angle_deg"
    said = f"{np.degrees(trigger.nominal_angle):g} degrees is said to be the {trigger.meaning!r}"
    hint = "the lift table is turned or the angle is wrong"
    if not np.any(lift[1] - lift[0] > 4.0 * table.resolution):
        grid = np.radians(np.arange(0.0, 360.0, 1.0))
        rise = np.diff(table.at(np.append(grid, grid[0] + 2.0 * np.pi)))
        rising = np.degrees(grid[rise > 0.05 * rise.max()])
        raise Refusal(f"{where}: {said}, but the lift rises from {rising.min():g} to {rising.max():g} degrees; {hint}")
    share = (table.at(at) - table.lift.min()) / np.ptp(table.lift)
    if share.max() >= CLOSING_LIFT[0] and share.min() <= CLOSING_LIFT[1]:
        return []
    text = (
        f"{said}, where the lift table stands at {100.0 * float(np.median(share)):.0f} % of its lift; ports close at "
        f"{100.0 * CLOSING_LIFT[0]:.0f} to {100.0 * CLOSING_LIFT[1]:.0f} %: {hint}"
    )
    return [Finding("closing_lift_unusual", "warning", text, f"{config.path.name} [trigger]")]


def check_trigger_exchanged(recording: Recording) -> None:
    """Look whether a log named torque or pressure has the two levels and steep flanks of a trigger, which has not.

    Raises
    ------
    Refusal : the two are exchanged
    """
    triggers = recording.of("trigger")
    if not triggers or recording.config.trigger.sensor == "inductive":
        return
    where, (_, usual) = f"{recording.config.path} [[channels]]", _pulse_shape(triggers[0])
    for channel in (*recording.of("torque"), *recording.of("pressure")):
        share, between = _pulse_shape(channel)
        if share > SURE_SHARE and between < STEEPER * usual:
            raise Refusal(
                f"{where}: {channel.quantity} and trigger are exchanged: {channel.name!r}, named {channel.quantity}, "
                f"stands at two levels for {100.0 * share:.0f} % of its samples as pulses do and is between them for "
                f"{short(1e3 * between)} ms a pulse, {triggers[0].name!r}, named trigger, for {short(1e3 * usual)} ms; "
                "exchange the two"
            )


def _pulse_shape(channel: Channel) -> tuple[float, float]:
    """Return the share of samples at two levels, and the time between these a pulse [s], nan where pulses are few."""
    values = _beginning(channel)
    share, pulses = level_share(values), pulse_count(values)
    between = (1.0 - share) * values.size / max(pulses, 1) / channel.sample_rate
    return share, between if pulses >= LEAST_PULSES else math.nan


def _beginning(channel: Channel) -> Array:
    """Return the first samples, each the middle one of itself and its neighbours: a stray sample is no pulse."""
    values = channel.read_volts(0, min(channel.n_samples, LOOKED_AT))
    values = values[np.isfinite(values)]
    before, here, after = values[:-2], values[1:-1], values[2:]
    return np.maximum(np.minimum(before, here), np.minimum(np.maximum(before, here), after))


def check_loads(recording: Recording) -> list[Finding]:
    """Hold torque, contact stress and pressure against each other at their largest values, and against their sensors.

    Raises
    ------
    Refusal : torque and pressure cannot come from this pump; names what each number would have to be
    """
    sheets: dict[str, SensorCalibration] = {}
    peaks: dict[str, float] = {}
    for quantity in ("torque", "pressure"):
        for channel in recording.of(quantity)[:1]:
            if channel.calibration is not None:
                sheets[quantity], peaks[quantity] = channel.calibration, largest(channel)
    overload = [row for quantity, sheet in sheets.items() for row in overload_findings(sheet, peaks[quantity])]
    if recording.lift_table is None or "pressure" not in sheets:
        return overload
    _refuse_other_unit(recording, sheets["pressure"].range_max, peaks["pressure"])
    return [*_against_each_other(recording, recording.lift_table, peaks), *overload]


def _against_each_other(recording: Recording, table: CamTable, peaks: Mapping[str, float]) -> list[Finding]:
    """Hold the largest torque [N m], if there is one, against the largest pressure [Pa]."""
    pump, where = recording.config.pump, f"{recording.config.path} [pump]"
    peak = peaks["pressure"]
    if not peak > 0.0:
        return []
    is_loaded = peak > LOADED
    findings = _contact(pump, pump.plunger_area * peak, where) if is_loaded else [*weak_pressure(pump, peak, where)]
    measured = peaks.get("torque", math.nan)
    if math.isnan(measured):
        return findings
    slope, rise = _steepest(table)
    speed = recording.config.nominal_speed
    spring = pump.spring_preload + pump.spring_stiffness * float(np.max(table.lift))
    by_pressure = pump.plunger_area * peak * slope
    other = (spring + pump.follower_mass * speed**2 * rise) * slope
    text = (
        f"the largest torque is {short(measured)} N m, the largest pressure of {peak / BAR:.4g} bar gives "
        f"{short(by_pressure)} N m on a plunger of {1e3 * pump.plunger_diameter:g} mm where the lift rises steepest "
        f"({short(1e3 * slope)} mm/rad)"
    )
    low, high = measured / (by_pressure + other), measured / by_pressure
    if not is_loaded:
        beyond = low > LOAD_POSSIBLE[1]
        if beyond and (slip := _other_unit("pressure", PRESSURE_SLIPS, high)):
            raise Refusal(f"{where}: {text}; {slip}; else {_implied(pump, slope, high)}")
        impossible = Finding("torque_without_pressure", "error", f"{text}; {_implied(pump, slope, high)}", where)
        return [impossible] if beyond else findings
    if high < LOAD_POSSIBLE[0] or low > LOAD_POSSIBLE[1]:
        slip = _other_unit("torque", TORQUE_SLIPS, high)
        implied = f"{slip}; else {_implied(pump, slope, high)}" if slip else _implied(pump, slope, high)
        raise Refusal(f"{where}: {text}; {marked_missing(recording) or implied}")
    if high < LOAD_USUAL[0] or low > LOAD_USUAL[1]:
        findings.append(Finding("torque_against_pressure", "warning", f"{text}; {_implied(pump, slope, high)}", where))
    return findings


def _refuse_other_unit(recording: Recording, end: float, peak: float) -> None:
    """Refuse a pressure far beyond the end of its sensor's range: the values are in another unit than is said."""
    if peak > FAR_BEYOND * end:  # never where no end is stated
        spec = next(spec for spec in recording.config.channels if spec.quantity == "pressure")
        raise Refusal(
            f"{recording.config.path} [[channels]] {spec.channel!r} unit: the largest pressure is {short(peak / BAR)} "
            f"bar, {peak / end:.3g} times the end of the sensor's range of {end / BAR:.4g} bar; "
            + (
                marked_missing(recording)
                or f"check the unit (found {spec.unit!r}; kPa or psi read as bar are 100 or 14.5 times too large), "
                "then the sensitivity and nominal_range of the sensor"
            )
        )


def _other_unit(quantity: str, slips: Mapping[float, str], ratio: float) -> str:
    """Return which unit makes a torque of so many times what the pressure makes usual, empty where none does."""
    found = [name for factor, name in slips.items() if LOAD_USUAL[0] < ratio / factor < LOAD_USUAL[1]]
    return f"the {quantity} looks like {found[0]}: correct its unit" if found else ""


def _implied(pump: PumpData, slope: float, ratio: float) -> str:
    diameter = 1e3 * pump.plunger_diameter * math.sqrt(ratio)
    return (
        f"one is wrong: plunger_diameter_m ({short(diameter)} mm would fit), the unit of the lift table "
        f"({short(1e3 * slope * ratio)} mm/rad), the sensitivity of pressure (x {short(ratio)}) or of torque "
        f"(x {short(1.0 / ratio)}); or the logs are not of one run, or torque and pressure are exchanged"
    )


def _contact(pump: PumpData, force: float, where: str) -> list[Finding]:
    """Judge the line contact of roller and base circle under the plunger's force (Hertz; both convex)."""
    shares = (1.0 - pump.poisson_ratio**2) * (1.0 / pump.youngs_modulus_cam + 1.0 / pump.youngs_modulus_roller)
    curvature = 1.0 / pump.base_circle_radius + 1.0 / pump.roller_radius
    stress = math.sqrt(force * curvature / (math.pi * pump.roller_width * shares))
    text = (
        f"the contact stress at the largest pressure is {1e-9 * stress:.3g} GPa, rolling steel has 0.5 to 2.5; check "
        "roller_width_m, roller_radius_m, plunger_diameter_m, youngs_modulus_*_Pa"
    )
    if stress > HERTZ_POSSIBLE:
        raise Refusal(f"{where}: {text}")
    return [Finding("contact_stress_unusual", "warning", text, where)] if stress > HERTZ_USUAL else []


def _steepest(table: CamTable) -> tuple[float, float]:
    """Return largest slope [m/rad] and largest rise of slope [m/rad^2], of the lift smoothed."""
    grid = np.radians(np.arange(0.0, 360.0 + SMOOTHED, SMOOTHED))
    lift = table.at(grid)
    slope = np.diff(lift) / np.diff(grid)
    return float(np.max(np.abs(slope))), float(np.max(np.abs(np.diff(slope)))) / float(np.radians(SMOOTHED))
