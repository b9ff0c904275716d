"""Stability map of the alignment: a synthetic record in memory, damaged, through `camtorque.align.align`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from camtorque.align import align
from camtorque.config import LoggerSpec, RecordingConfig, TriggerSpec
from camtorque.ingest.raw import ArraySource
from camtorque.mechanism.lift_laws import cubic_law
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import Array, CamTable, Channel, Recording, SensorCalibration
from camtorque.studies.case import SPEED, rms_error, study_law, study_pressure, study_pump
from camtorque.studies.grid import torque_on
from camtorque.studies.table import Outcome, StabilityMap, cell
from camtorque.units import TURN, angle_grid, closed

LIMITS = (1.0e-2, 5.0e-2)
RATE = 2.0e4
PULSE = 0.11
"""Width of the trigger pulse [rad]."""
NOWHERE = Path("study")


@dataclass(frozen=True)
class Damage:
    """What is wrong with a record: shares, relative sizes, seconds.

    ``mirrored`` runs the cam against its lift table, ``turned`` declares the wrong direction for the torque's sign,
    ``own_clock`` gives the pressure a second logger, whose clock drifts, with or without a trigger of its own.
    """

    cycles: int = 60
    loss: float = 0.0
    jitter: float = 0.0
    ripple: float = 0.0
    drift_ppm: float = 0.0
    noise: float = 0.1
    trigger_noise: float = 0.02
    samples: int | None = None
    ripple_phase: float = 0.0
    mirrored: bool = False
    turned: bool = False
    own_clock: bool = False
    second_trigger: bool = True
    scatter: float = 0.0


def _calibration(quantity: str, gain: float) -> SensorCalibration:
    return SensorCalibration(
        quantity, gain=gain, gain_relative_std=1e-3, zero_std=0.0, zero_source="standstill", nonlinearity_std=0.0,
        delay_std=0.0, range_min=-200.0 * gain, range_max=200.0 * gain, output_min_volts=-250.0, output_max_volts=250.0,
    )  # fmt: skip


def _config(loggers: tuple[LoggerSpec, ...]) -> RecordingConfig:
    return RecordingConfig(
        path=NOWHERE, text="", id="study", pump_id="study", nominal_speed=SPEED, file_format="csv", csv_dialect="",
        rotation=1, pump_sheet=study_pump(), trigger=TriggerSpec(0.0, np.deg2rad(1.5)), sensors={}, loggers=loggers,
        channels=(),
    )  # fmt: skip


def _running(damage: Damage, random: np.random.Generator) -> Callable[[Array], Array]:
    """Return the shaft's angle over time: it wanders from one revolution to the next and swings within each."""
    wander = 3.0e-3 * np.cumsum(random.standard_normal(damage.cycles + 12))

    def angle(t: Array) -> Array:
        phase = 0.4 + SPEED * t
        phase = phase + np.interp(phase / TURN, np.arange(wander.size), wander)
        at = 2.0 * phase + damage.ripple_phase
        return phase + 0.5 * damage.ripple * (np.sin(at) - np.sin(damage.ripple_phase))

    return angle


def damaged_recording(damage: Damage) -> Recording:
    """Return a record of the study pump with the damage applied; the true pulse stands at angle zero."""
    random = np.random.default_rng(11)
    count = round(damage.cycles * TURN / SPEED * RATE) if damage.samples is None else damage.samples
    # The second logger counts its samples by a clock that runs fast: sample i lies earlier in true time.
    rates = {"A": RATE, "B": RATE * (1.0 + 1e-6 * damage.drift_ppm)} if damage.own_clock else {"A": RATE}
    true = {logger: np.arange(count) / rate for logger, rate in rates.items()}
    angle = _running(damage, random)
    heights = 1.0 + damage.scatter * random.standard_normal(damage.cycles + 12)

    late = damage.jitter * random.standard_normal(damage.cycles + 12)
    lost = random.random(damage.cycles + 12) < damage.loss

    def trigger(t: Array) -> ArraySource:
        theta = angle(t)
        turn = np.floor((theta + PULSE) / TURN).astype(np.int64) % lost.size
        high = (np.mod(theta - SPEED * late[turn], TURN) < PULSE) & ~lost[turn]
        return ArraySource(np.where(high, 5.0, 0.0) + damage.trigger_noise * random.standard_normal(t.size))

    torque_law, pressure_law = _curves(damage.mirrored)
    b = "B" if damage.own_clock else "A"
    torque, pressure = angle(true["A"]), angle(true[b])
    torque = torque_law(np.mod(torque, TURN)) * heights[np.floor(torque / TURN).astype(int)]
    pressure = pressure_law(np.mod(pressure, TURN)) * heights[np.floor(pressure / TURN).astype(int)]
    torque = (-1.0 if damage.turned else 1.0) * torque + damage.noise * random.standard_normal(count)
    bar = _calibration("pressure", 1e7)
    channels = [
        Channel("torque", "A", ArraySource(torque), 0.0, RATE, _calibration("torque", 1.0), NOWHERE, "torque"),
        Channel("pressure", b, ArraySource(pressure / 1e7), 0.0, RATE, bar, NOWHERE, "pressure"),
        Channel("trigger", "A", trigger(true["A"]), 0.0, RATE, None, NOWHERE, "trigger"),
    ]
    if damage.own_clock and damage.second_trigger:
        channels.append(Channel("trigger", "B", trigger(true["B"]), 0.0, RATE, None, NOWHERE, "trigger B"))
    loggers = (LoggerSpec("A", "independent"), LoggerSpec("B", "independent")) if damage.own_clock else ()
    table = CamTable(angle_grid(360), study_law().evaluate(angle_grid(360)), 1e-6)
    return Recording(_config(loggers), tuple(channels), table, (), ())


@cache
def _curves(mirrored: bool) -> tuple[CubicSpline, CubicSpline]:
    """Return torque and pressure over the angle of running; mirrored, the cam rises over its falling flank."""
    grid = angle_grid(7200)
    torque, pressure = torque_on(grid, study_law()), study_pressure(grid)
    if mirrored:
        lift = study_law().evaluate(np.mod(-grid, TURN))
        # delivery begins at the same share of the flank, which now begins where the table's fall ends
        pressure = study_pressure(grid + np.deg2rad(135.0))
        law = cubic_law(CamTable(grid[::20], lift[::20], 0.0))
        torque = closed_form_tables(study_pump(), law, grid).evaluate("torque", pressure, SPEED)
    return CubicSpline(*closed(grid, torque)), CubicSpline(*closed(grid, pressure))


def aligned_error(damage: Damage) -> Outcome:
    """Return the rms error of the mean torque (of two clocks, pressure too) over its peak, and what is said."""
    cycles = align(damaged_recording(damage))
    assert cycles.torque is not None
    exact = torque_on(cycles.theta, study_law())
    error = rms_error(cycles.torque.mean(axis=0), exact)
    at_pressure = rms_error(cycles.pressure.mean(axis=0), study_pressure(cycles.theta))
    # the note on ripple says how large an error it may be: it counts where ripple is what is wrong
    reported = [item.text for item in cycles.findings if item.severity != "info"]
    if damage.ripple and not reported:
        reported = [item.text for item in cycles.findings if item.code == "ripple_unseen"]
    lost = cycles.cycles_found - cycles.speed.size
    reported += [f"cut-flow: {lost} of {cycles.cycles_found} cycles left out"] if lost else []
    return max(error, at_pressure if damage.own_clock else 0.0), "; ".join(reported)


CONDITIONS: dict[str, Damage] = {
    "undamaged": Damage(),
    "5 % of pulses lost": Damage(loss=0.05),
    "20 % of pulses lost": Damage(loss=0.2),
    "50 % of pulses lost": Damage(loss=0.5),
    "jitter of 50 us": Damage(jitter=5e-5),
    "jitter of 1 ms": Damage(jitter=1e-3),
    "speed ripple 1 %": Damage(ripple=0.01),
    "speed ripple 5 %": Damage(ripple=0.05),
    "speed ripple 20 %": Damage(ripple=0.2),
    "speed ripple 20 %, unlucky phase": Damage(ripple=0.2, ripple_phase=np.deg2rad(300.0)),
    "second logger's clock 100 ppm fast": Damage(drift_ppm=100.0, own_clock=True),
    "second logger's clock 1000 ppm fast": Damage(drift_ppm=1000.0, own_clock=True),
    "clock 100 ppm fast, no trigger of its own": Damage(
        drift_ppm=100.0, own_clock=True, second_trigger=False, scatter=0.01
    ),
    "clock 100 ppm fast, no trigger, equal cycles": Damage(drift_ppm=100.0, own_clock=True, second_trigger=False),
    "torque noise of 5 N m": Damage(noise=5.0),
    "trigger noise of 1.5 V": Damage(trigger_noise=1.5),
    "3 cycles": Damage(cycles=3),
    "1 cycle": Damage(cycles=1),
    "one sample": Damage(samples=1),
    "no sample": Damage(samples=0),
    "runs against its lift table": Damage(mirrored=True),
    "rotation declared wrongly": Damage(turned=True),
}
"""Condition -> damage."""


def _one_pulse_script(damage: Damage) -> Outcome:
    """Return the same from the usual script: threshold, `numpy.interp` between pulses, plain mean."""
    recording = damaged_recording(damage)
    volts, torque = recording.of("trigger")[0].read(), recording.of("torque")[0].read()
    edges = np.flatnonzero((volts[1:] >= 2.5) & (volts[:-1] < 2.5)) + 1
    if edges.size < 2:
        raise ValueError("script: fewer than two pulses (zero-size array)")
    grid = angle_grid(3600)
    position = edges[:-1, None] + np.diff(edges)[:, None] * (grid / TURN)
    mean = np.interp(position, np.arange(torque.size), torque).mean(axis=0)
    return rms_error(mean, torque_on(grid, study_law()))


METHODS: dict[str, tuple[Callable[[Damage], Outcome], bool]] = {
    "align": (aligned_error, True),
    "usual script (threshold, interp)": (_one_pulse_script, False),
}
"""Method -> function, and whether it is the package's default."""


def align_map(quick: bool) -> StabilityMap:
    """Return what becomes of the mean torque under damage of trigger, clock, noise and length."""
    names = list(CONDITIONS)[::2] if quick else list(CONDITIONS)
    cells = [
        cell(name, method, partial(run, CONDITIONS[name]), LIMITS, default=default)
        for name in names
        for method, (run, default) in METHODS.items()
    ]
    note = "rms error of the mean torque over its peak: up to 1 % works, up to 5 % or told degrades"
    return StabilityMap("alignment", "Trigger, clock, noise and length of a record", tuple(cells), note)
