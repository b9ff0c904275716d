"""Measured torque, line pressure, lift and what else was recorded against each other: are they of this pump, one run.

While the valve delivers, the plunger carries at least the line pressure and friction adds to it, so the measured
torque lies above the rigid one: 1.00 to 1.67 times in 67 recordings of 52 simulated pumps.

A pump makes the pressure that it delivers against: the line pressure, without what rings, rises while the plunger
rises. In 67 recordings of 51 simulated pumps 0.61 to 1.00 of all its rises are there, and of the same pressures a
quarter of a revolution off or more 0.28 at most. A line that a rail holds steady and that rings has few of them there,
0.25 on another pump, and nowhere more than 0.4: it does not tell its place.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from camtorque.config import PumpData
from camtorque.records import Array, CamCycles, Finding, Mask, Recording, Refusal, RigidTorque
from camtorque.units import BAR, RPM, TURN, short

LOADED_SHARE = 0.7
"""Share of the largest rigid torque above which an angle counts."""
USUAL = (0.95, 1.9)
"""Measured over rigid torque that is no finding; 52 pumps gave 1.00 to 1.67."""
MOUNTED_DEG = 5.0
"""Tolerance of a trigger [deg] above which that range is asked for where the torque lies, not at the nominal angle."""
LEAST_TOLD = 0.2
"""Ratio below which no plunger would explain it: what rings or is of another run has no diameter."""
BY_PRESSURE = 0.5
"""Share of the rigid torque that pressure has to make; below it the spring is compared, not the pump."""
MADE_ELSEWHERE = 0.45
"""Share of the rises of the line pressure during the plunger's below which it is not the pump that makes it."""
MADE = 0.6
"""The same where it would be the pump that makes it: the least of sound recordings."""
RINGS_DEG = 8.0
"""Width at half height of the smoothing over which a line rings and no pump delivers [deg]."""
STANDS = 0.02
"""Share of the steepest slope of the lift below which the plunger stands."""
LARGE_SWING = 0.3
"""Swing of the line pressure times the swept volume, over the measured work, from which its place is judged."""
HELD = 0.4
"""Least over largest pressure above which a rail holds the line, of which what rings may be most of the swing: 0.5 to
0.9 on rails, 0.3 at most on 60 lines that empty."""

CHAMBER = (0.5, 3.0)
"""Largest measured pressure in the chamber over that in the line: valve and outlet take 5 to 60 % of it."""
SAME_SPEED, GEARS = 0.1, (0.5, 1.0, 2.0)
"""Share by which a recorded speed may miss the one by the trigger; speeds of shafts that drive a pump, over its own."""

BASE_LIFT = 0.01
"""Share of the stroke below which the follower stands on the base circle."""
DRIVEN = (3.0, 0.002)
"""Standard uncertainties of the zero and share of the peak torque by which the mean there may lie below zero."""
DRAGGED = 0.3
"""Mean torque on the base circle over what the load adds to it; of 63 simulated pumps 61 have less than 0.07, the
largest 0.19."""


def on_base(lift: Array) -> Mask:
    """Return where a follower stands on the base circle, (n,); a lift table (n,) [m] may stay above zero there."""
    return np.asarray(lift - np.min(lift) < BASE_LIFT * np.ptp(lift))


def load_ratio(cycles: CamCycles, rigid: RigidTorque) -> float:
    """Return mean measured over mean rigid torque at the loaded angles, nan where pressure hardly loads the cam.

    A rail, or a line behind a valve, holds its pressure when the pump has ceased to deliver, and the rigid model
    carries it on: a ratio too small for a pump is that of the angles at which the measured torque loads the cam too.
    """
    loaded = rigid.torque > LOADED_SHARE * np.max(rigid.torque)
    modelled = float(np.mean(rigid.torque[loaded]))
    if not modelled > 0.0 or np.mean(rigid.by_cause["pressure"][loaded]) < BY_PRESSURE * modelled:
        return math.nan
    torque = cycles.mean_torque
    ratio = float(np.mean(torque[loaded])) / modelled
    both = loaded & (torque > LOADED_SHARE * np.max(torque))
    if ratio >= USUAL[0] or not both.any():
        return ratio
    return float(np.mean(torque[both]) / np.mean(rigid.torque[both]))


def load_findings(recording: Recording, cycles: CamCycles, rigid: RigidTorque) -> tuple[Finding, ...]:
    """Return warnings where torque and pressure cannot well be of this pump and of one run.

    Raises
    ------
    Refusal : the line pressure rises where the plunger does not deliver, and no rail holds it
    """
    further = further_findings(cycles)
    if cycles.torque is None:
        return further
    pump = recording.config.pump
    misplaced = _misplaced_findings(cycles, rigid, pump)
    sheets = [channel.calibration for channel in recording.of("torque")]
    zero_std = next((sheet.zero_std for sheet in sheets if sheet is not None), math.inf)

    def against(model: RigidTorque) -> tuple[Finding, ...]:
        return (*base_findings(cycles, model, zero_std), *ratio_findings(load_ratio(cycles, model), pump))

    found, tolerance = against(rigid), recording.config.trigger.installation_tolerance
    if found and tolerance > math.radians(MOUNTED_DEG):
        found = against(placed(cycles, rigid, pump, tolerance))
    return (*misplaced, *found, *further)


def placed(cycles: CamCycles, rigid: RigidTorque, pump: PumpData, tolerance: float) -> RigidTorque:
    """Return the rigid torque at the cam angle within a tolerance [rad] at which the measured torque follows it best.

    The sheet of the trigger admits all of these angles. What does not come from the pressure moves with the lift.
    """
    reach = min(math.floor(tolerance / TURN * rigid.theta.size), rigid.theta.size // 2)
    by_lift, push = rigid.torque - rigid.by_cause["pressure"], pump.plunger_area * cycles.mean_pressure

    def at(steps: int) -> RigidTorque:
        pressure = push * np.roll(rigid.lift_velocity, steps)
        by_cause = {**rigid.by_cause, "pressure": pressure}
        torque = np.roll(by_lift, steps) + pressure
        return replace(rigid, torque=torque, by_cause=by_cause, lift=np.roll(rigid.lift, steps))

    follows = [float(np.corrcoef(cycles.mean_torque, at(k).torque)[0, 1]) for k in range(-reach, reach + 1)]
    return at(int(np.argmax(follows)) - reach) if reach else rigid


def base_findings(cycles: CamCycles, rigid: RigidTorque, zero_std: float) -> tuple[Finding, ...]:
    """Return a warning where the torque on the base circle, where only drag acts, is negative or that of no drag."""
    base = on_base(rigid.lift)
    torque = cycles.mean_torque
    level, peak = float(np.mean(torque[base])) if base.any() else 0.0, float(np.max(torque))
    too_large = level > max(DRIVEN[0] * zero_std, DRAGGED * (peak - level))
    if too_large and math.isfinite(load_ratio(cycles, rigid)):
        text = (
            f"on the base circle the torque is {short(level)} N m in the mean, {100.0 * level / (peak - level):.0f} % "
            "of what the load adds to it; drag alone makes at most 19 % on sound pumps: the zero of the torque is off "
            "(zero_before_V and zero_after_V, or that of a log in N m), or the transducer drives more than the pump"
        )
        return (Finding("base_torque_large", "warning", text, "torque"),)
    if not level < -DRIVEN[0] * zero_std - DRIVEN[1] * peak:
        return ()
    text = (
        f"on the base circle the torque is {short(level)} N m in the mean, where nothing drives the cam and drag only "
        "makes it positive: the torque zero is off by at least that much, and friction and damping with it; check "
        "zero_before_V and zero_after_V, and rotation"
    )
    return (Finding("base_torque_negative", "warning", text, "torque"),)


def ratio_findings(ratio: float, pump: PumpData) -> tuple[Finding, ...]:
    """Return a warning where measured over rigid torque (`load_ratio`) is what no pump has."""
    if not math.isfinite(ratio) or USUAL[0] <= ratio <= USUAL[1]:
        return ()
    diameter = f"{1e3 * pump.plunger_diameter:g} mm"
    if ratio > LEAST_TOLD:
        diameter += f", {1e3 * pump.plunger_diameter * math.sqrt(ratio / 1.15):.2g} mm would be usual"
    side = "friction adds to it, and the chamber while it delivers" if ratio < USUAL[0] else "no friction adds so much"
    slow = ", whether a low-pass of amplifier or logger smooths the torque" if ratio < USUAL[0] else ""
    text = (
        f"where line pressure loads the cam most, the measured torque is {ratio:.2f} times the rigid model's; sound "
        f"pumps have 1.0 to 1.7 ({side}): check plunger_diameter_m ({diameter}), the lift "
        f"table, nominal_angle_deg, both sensitivities{slow}, and that the logs are of one run"
    )
    return (Finding("torque_against_model", "warning", text, "[pump]"),)


def rises_together(pressure: Array, lift: Array) -> tuple[float, float]:
    """Return the share of a pressure's rises while a lift rises, and the largest wherever the pressure were turned to.

    Parameters
    ----------
    pressure, lift : (n,) over a revolution [Pa, m]
    """
    n = lift.size
    width = np.radians(RINGS_DEG) / np.sqrt(8.0 * np.log(2.0))
    smoothing = np.exp(-0.5 * (np.arange(n // 2 + 1) * width) ** 2)
    smooth = np.fft.irfft(np.fft.rfft(pressure) * smoothing, n)
    rises = np.maximum(np.roll(smooth, -1) - smooth, 0.0)
    slope = np.roll(lift, -1) - lift
    rising = (slope > STANDS * np.max(slope)).astype(np.float64)
    turned = np.fft.irfft(np.fft.rfft(rises).conj() * np.fft.rfft(rising), n) / max(np.sum(rises), np.finfo(float).tiny)
    return float(turned[0]), float(np.max(turned))


def misplaced_text(theta: Array, pressure: Array, lift: Array) -> str:
    """Return how a pressure that the plunger would make lies off its rise, "" where it does not or cannot be told."""
    here, anywhere = rises_together(pressure, lift)
    if here >= MADE_ELSEWHERE or anywhere < MADE:
        return ""
    peak, top = (math.degrees(theta[int(np.argmax(values))]) for values in (pressure, lift))
    return (
        f"{100.0 * here:.0f} % of its rises are where the plunger rises, expected {100.0 * MADE:.0f} % or more "
        f"(highest pressure at {peak:.0f} deg, top of the lift at {top:.0f} deg)"
    )


def _misplaced_findings(cycles: CamCycles, rigid: RigidTorque, pump: PumpData) -> tuple[Finding, ...]:
    pressure = cycles.mean_pressure
    measured = 2.0 * math.pi * abs(float(np.mean(cycles.mean_torque)))
    if pump.plunger_area * float(np.ptp(pressure)) * float(np.ptp(rigid.lift)) < LARGE_SWING * measured:
        return ()
    said = misplaced_text(cycles.theta, pressure, rigid.lift)
    if not said:
        return ()
    text = f"the line pressure swings by {np.ptp(pressure) / BAR:.0f} bar, but not while the plunger delivers: {said}"
    checks = (
        "check that both logs are of one run, the clocks of their loggers, nominal_angle_deg in [trigger], and the "
        "lift table"
    )
    if np.min(pressure) < HELD * np.max(pressure):
        raise Refusal(f"{text}; {checks}")
    return (Finding("pressure_misplaced", "warning", f"{text}; a ringing rail may do this, else {checks}", "pressure"),)


def further_findings(cycles: CamCycles) -> tuple[Finding, ...]:
    """Return warnings where a recorded chamber pressure or speed is off by a factor, as a slip of unit makes it."""
    return (*_chamber_findings(cycles), *_speed_findings(cycles))


def _chamber_findings(cycles: CamCycles) -> tuple[Finding, ...]:
    curve = cycles.mean_cycle("chamber_pressure")
    if curve is None:
        return ()
    chamber, line = float(np.max(curve)), float(np.max(cycles.mean_pressure))
    if CHAMBER[0] * line < chamber < CHAMBER[1] * line:
        return ()
    text = (
        f"the chamber pressure reaches {short(chamber / BAR)} bar, the line pressure {short(line / BAR)} bar, expected "
        f"{CHAMBER[0]:g} to {CHAMBER[1]:g} times as much in the chamber: check unit and sensitivity of both"
    )
    return (Finding("chamber_against_line", "warning", text, "chamber_pressure"),)


def _speed_findings(cycles: CamCycles) -> tuple[Finding, ...]:
    curve = cycles.mean_cycle("shaft_speed")
    if curve is None:
        return ()
    speed = float(np.mean(curve))
    if min(abs(abs(speed) / cycles.mean_speed / gear - 1.0) for gear in GEARS) < SAME_SPEED:
        return ()
    text = (
        f"the recorded speed is {short(speed / RPM)} rpm, the trigger tells {short(cycles.mean_speed / RPM)} rpm of "
        "the cam: check the unit of the one (rpm, Hz, rad/s), and how many marks of the other pass in a turn"
    )
    return (Finding("speed_against_trigger", "warning", text, "shaft_speed"),)
