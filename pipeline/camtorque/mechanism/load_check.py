"""Measured torque, line pressure and lift against each other: are they of this pump and of one run.

While the valve delivers, the plunger carries at least the line pressure and friction adds to it, so the measured
torque lies above the rigid one: 1.01 to 1.67 times in 44 recordings of 28 simulated pumps of other makers.

A pump delivers against the pressure that it makes: over a revolution the line pressure does work on the plunger, a
share of its swing times the swept volume. 29 recordings of 25 simulated pumps have 0.18 to 0.64; the same pressures a
quarter of a revolution off have at most 0.05, half of one off none. A line that a rail holds steady and that rings has
as little (0.05) wherever in the revolution it is placed: it does not tell its place.
"""

from __future__ import annotations

import math

import numpy as np

from camtorque.config import PumpData
from camtorque.records import Array, CamCycles, Finding, Recording, Refusal, RigidTorque
from camtorque.units import BAR, short

LOADED_SHARE = 0.7
"""Share of the largest rigid torque above which an angle counts."""
USUAL = (0.95, 1.9)
"""Measured over rigid torque that is no finding; 28 pumps gave 1.01 to 1.67."""
LEAST_TOLD = 0.2
"""Ratio below which no plunger would explain it: what rings or is of another run has no diameter."""
BY_PRESSURE = 0.5
"""Share of the rigid torque that pressure has to make; below it the spring is compared, not the pump."""
LEAST_DELIVERY = 0.05
"""Work of the line pressure over its swing times the swept volume below which it is not the pump that makes it."""
ELSEWHERE = 0.18
"""The same where it would be the pump that makes it: the least of sound recordings."""
LARGE_SWING = 0.3
"""Swing of the line pressure times the swept volume, over the measured work, from which its place is judged."""


BASE_LIFT = 0.01
"""Share of the full lift below which the follower stands on the base circle."""
DRIVEN = (3.0, 0.002)
"""Standard uncertainties of the zero and share of the peak torque by which the mean there may lie below zero."""


def load_ratio(cycles: CamCycles, rigid: RigidTorque) -> float:
    """Return mean measured over mean rigid torque at the loaded angles, nan where pressure hardly loads the cam."""
    if cycles.torque is None:
        return math.nan
    loaded = rigid.torque > LOADED_SHARE * np.max(rigid.torque)
    modelled = float(np.mean(rigid.torque[loaded]))
    if not modelled > 0.0 or np.mean(rigid.by_cause["pressure"][loaded]) < BY_PRESSURE * modelled:
        return math.nan
    return float(np.mean(cycles.mean_torque[loaded])) / modelled


def load_findings(recording: Recording, cycles: CamCycles, rigid: RigidTorque) -> tuple[Finding, ...]:
    """Return warnings where torque and pressure cannot well be of this pump and of one run.

    Raises
    ------
    Refusal : the line pressure rises where the plunger does not deliver
    """
    pump = recording.config.pump
    _refuse_misplaced_pressure(cycles, rigid, pump)
    sheets = [channel.calibration for channel in recording.of("torque")]
    zero_std = next((sheet.zero_std for sheet in sheets if sheet is not None), math.inf)
    return (*base_findings(cycles, rigid, zero_std), *ratio_findings(load_ratio(cycles, rigid), pump))


def base_findings(cycles: CamCycles, rigid: RigidTorque, zero_std: float) -> tuple[Finding, ...]:
    """Return a warning where the torque is negative on the base circle, where only drag acts."""
    if cycles.torque is None:
        return ()
    base = rigid.lift < BASE_LIFT * np.max(rigid.lift)
    torque = cycles.mean_torque
    level = float(np.mean(torque[base])) if base.any() else 0.0
    if not level < -DRIVEN[0] * zero_std - DRIVEN[1] * float(np.max(torque)):
        return ()
    text = (
        f"on the base circle the torque is {short(level)} N m in the mean, where nothing drives the cam and drag only "
        "makes it positive: the zero of the torque is off by as much at least, and so are friction and damping; check "
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
    text = (
        f"where the line pressure loads the cam most the measured torque is {ratio:.2f} of the rigid model's, sound "
        f"pumps have 1.0 to 1.7 ({side}): check plunger_diameter_m ({diameter}), the lift "
        "table, nominal_angle_deg, both sensitivities, and that the logs are of one run"
    )
    return (Finding("torque_against_model", "warning", text, "[pump]"),)


def largest_work(pressure: Array, lift: Array) -> float:
    """Return the work of a pressure over a lift, turned to where in the revolution it is largest [J/m^2].

    Parameters
    ----------
    pressure, lift : (n,) over a revolution [Pa, m]
    """
    rising = np.fft.rfft(0.5 * (np.roll(lift, -1) - np.roll(lift, 1)))
    return float(np.max(np.fft.irfft(np.fft.rfft(pressure).conj() * rising, lift.size)))


def _refuse_misplaced_pressure(cycles: CamCycles, rigid: RigidTorque, pump: PumpData) -> None:
    if cycles.torque is None:
        return
    measured = 2.0 * math.pi * abs(float(np.mean(cycles.mean_torque)))
    pressure = cycles.mean_pressure
    possible = pump.plunger_area * float(np.ptp(pressure)) * float(np.ptp(rigid.lift))
    work = 2.0 * math.pi * float(np.mean(rigid.by_cause["pressure"]))
    if possible < LARGE_SWING * measured or work >= LEAST_DELIVERY * possible:
        return
    if pump.plunger_area * largest_work(pressure, rigid.lift) < ELSEWHERE * possible:
        return
    peak, top = (math.degrees(cycles.theta[int(np.argmax(values))]) for values in (pressure, rigid.lift))
    share = round(100.0 * work / possible)
    raise Refusal(
        f"the line pressure swings by {np.ptp(pressure) / BAR:.0f} bar, but not while the plunger delivers: over a "
        f"revolution it does {work:.2g} J of work on the plunger, {share} % of swing times swept volume, expected 18 "
        f"to 64 % (highest pressure at {peak:.0f} deg, top of the lift at {top:.0f} deg); check that both logs are of "
        "one run, the clocks of their loggers, and the lift table"
    )
