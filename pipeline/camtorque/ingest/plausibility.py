"""Numbers that are each within their band but cannot belong together: such a slip is refused with its place.

The largest torque is held against what the largest pressure can cause, the trigger against the lift table; sizes of the
pump against each other: `camtorque.ingest.pump_sizes`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

import numpy as np

from camtorque.config import PumpData, RecordingConfig
from camtorque.config.pump import HERTZ_POSSIBLE, HERTZ_SEEN, HERTZ_USUAL, weak_pressure
from camtorque.ingest.proposal import SURE_SHARE, level_share, pulse_count
from camtorque.ingest.pump_sizes import SMOOTHED
from camtorque.ingest.wheel import LEAST_PULSES, LOOKED_AT
from camtorque.records import Array, CamTable, Channel, Finding, Recording, Refusal, SampleSource, SensorCalibration
from camtorque.signal.running import percentile
from camtorque.units import BAR, short

PRE_STROKE = re.compile(r"pre.?stroke|pressuri[sz]ation|vorhub|f.rderbeginn|start of delivery", re.IGNORECASE)
CLOSING_LIFT = (0.04, 0.5)
"""Share of the lift at which a pre-stroke ends; 21 pumps of other makers have 0.11 to 0.34."""
STEEPER = 1.0 / 3.0
"""Part of the trigger's time between its two levels a pulse below which another log is the trigger: pressures and
torques of 69 recordings are between theirs for ten times the trigger's time or longer, exchanged for a tenth of it."""
FAR_BEYOND = 3.0
"""A sensor stands up to twice its range; a pressure of more than so many times that is in another unit."""
WHOLE_RANGE, STEADY, LEAST_WRAPS = 0.8, 0.2, 5
"""Share of a range that counts which ran over jump by, at most a tenth of the steps being more than a fifth; times both
ways. A spill takes a pressure down by as much in a sample of 5 kHz, never up again."""
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
BLOCKS, BLOCK_SAMPLES = 16, 50_000
"""Pieces of a log looked at for its largest values; each holds several revolutions at usual rates."""
MOST_RANKED = 200_000
"""Of these samples, as many are ranked as make the highest 0.1 % a sound choice."""
OVERLOAD = 1.1
"""Share of the nominal range that a sensor is run at by those who know it; its class holds up to 1."""
BEYOND_POINTS = 1.05
"""Share of the largest point of its certificate up to which a load counts as within it."""
UNUSED = 0.02
"""Share of it below which no loaded channel stays: 0.24 is the least of 46 recordings."""


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
    said = f"{np.degrees(trigger.stated_angle):g} degrees is said to be the {trigger.meaning!r}"
    hint = "the lift table is shifted in angle, or the angle is wrong"
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


def wrapped_findings(channel: Channel) -> tuple[Finding, ...]:
    """Tell a channel whose counts ran over: it jumps through its whole range within a sample, up and down again."""
    values = _beginning(channel)
    steps, span = np.diff(values), float(np.ptp(values)) if values.size > 1 else 0.0
    if not span > 0.0 or float(np.percentile(np.abs(steps), 90.0)) > STEADY * span:
        return ()
    there, back = (int(np.sum(side * steps > WHOLE_RANGE * span)) for side in (1.0, -1.0))
    if min(there, back) < LEAST_WRAPS:
        return ()
    text = (
        f"the {channel.quantity} jumps through its whole range within one sample, {there} times up and {back} times "
        "down in the samples looked at, as counts do when 8 or 16 bits overflow: use a smaller gain or export wider "
        "numbers; record or export it again"
    )
    return (Finding("values_wrap", "error", text, f"{channel.path.name} {channel.name}"),)


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
    is_loaded = peaks.get("pressure", 0.0) > LOADED
    ranges = [row for name in sheets for row in wrapped_findings(recording.of(name)[0])]
    ranges += [row for name, sheet in sheets.items() for row in range_findings(sheet, peaks[name], is_loaded=is_loaded)]
    ranges += [row for name, sheet in sheets.items() for row in beyond_points(sheet, peaks[name])]
    if recording.lift_table is None or "pressure" not in sheets:
        return ranges
    _refuse_other_unit(recording, sheets["pressure"].range_max, peaks["pressure"])
    return [*_against_each_other(recording, recording.lift_table, peaks), *ranges]


def _against_each_other(recording: Recording, table: CamTable, peaks: Mapping[str, float]) -> list[Finding]:
    """Hold the largest torque [N m], if there is one, against the largest pressure [Pa]."""
    pump, where = recording.config.pump, f"{recording.config.path} [pump]"
    peak = peaks["pressure"]
    if not peak > 0.0:
        return []
    is_loaded = peak > LOADED
    findings = _contact(recording, peak, where) if is_loaded else [*weak_pressure(pump, peak, where)]
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
        told = Finding("torque_without_pressure", "error", f"{text}; {_implied(pump, slope, high)}", where)
        return [told] if beyond else findings
    unusual, impossible = LOAD_USUAL[0], LOAD_POSSIBLE[0]
    if recording.config.measures_chamber:  # closed at last, it is pressed highest where the lift hardly rises any more
        unusual, impossible = impossible, 0.0
    if high < impossible or low > LOAD_POSSIBLE[1]:
        cause = marked_missing(recording) or _slip_or_sheet("torque", TORQUE_SLIPS, pump, slope, high)
        raise Refusal(f"{where}: {text}; {cause}")
    if low > LOAD_USUAL[1]:
        cause = _slip_or_sheet("pressure", PRESSURE_SLIPS, pump, slope, high)
        findings.append(Finding("torque_beyond_pressure", "warning", f"{text}; {cause}", where))
    elif high < unusual:
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


def _slip_or_sheet(quantity: str, slips: Mapping[float, str], pump: PumpData, slope: float, ratio: float) -> str:
    """Return which unit or which number of the sheet makes a torque of so many times what the pressure makes."""
    slip, implied = _other_unit(quantity, slips, ratio), _implied(pump, slope, ratio)
    return f"{slip}; else {implied}" if slip else implied


def _implied(pump: PumpData, slope: float, ratio: float) -> str:
    diameter = 1e3 * pump.plunger_diameter * math.sqrt(ratio)
    return (
        f"one is wrong: plunger_diameter_m ({short(diameter)} mm would fit), the unit of the lift table "
        f"({short(1e3 * slope * ratio)} mm/rad), the sensitivity of pressure (x {short(ratio)}) or of torque "
        f"(x {short(1.0 / ratio)}); or the logs are not of one run, or torque and pressure are exchanged"
    )


def _contact(recording: Recording, pressure: float, where: str) -> list[Finding]:
    """Judge the line contact of roller and base circle under a pressure on the plunger (Hertz; both convex)."""
    pump = recording.config.pump
    force = pump.plunger_area * pressure
    shares = (1.0 - pump.poisson_ratio**2) * (1.0 / pump.youngs_modulus_cam + 1.0 / pump.youngs_modulus_roller)
    curvature = 1.0 / pump.base_circle_radius + 1.0 / pump.roller_radius
    stress = math.sqrt(force * curvature / (math.pi * pump.roller_width * shares))
    if stress <= HERTZ_USUAL:
        return []
    sizes = "check roller_width_m, roller_radius_m, plunger_diameter_m, youngs_modulus_*_Pa"
    text = (
        f"the contact stress at the largest pressure is {1e-9 * stress:.3g} GPa, rolling steel has {HERTZ_SEEN}; "
        f"{marked_missing(recording) or sizes}"
    )
    if stress > HERTZ_POSSIBLE:
        raise Refusal(f"{where}: {text}")
    return [Finding("contact_stress_unusual", "warning", text, where)]


def _steepest(table: CamTable) -> tuple[float, float]:
    """Return largest slope [m/rad] and largest rise of slope [m/rad^2], of the lift smoothed."""
    grid = np.radians(np.arange(0.0, 360.0 + SMOOTHED, SMOOTHED))
    lift = table.at(grid)
    slope = np.diff(lift) / np.diff(grid)
    return float(np.max(np.abs(slope))), float(np.max(np.abs(np.diff(slope)))) / float(np.radians(SMOOTHED))


def range_findings(sheet: SensorCalibration, peak: float, *, is_loaded: bool) -> list[Finding]:
    """Return a warning where the largest value of a channel does not suit the nominal range that its sheet states."""
    if not peak > 0.0:  # a channel without a number has no range of its own either
        return []
    share = peak / sheet.largest_reading
    if share > OVERLOAD:
        code, why = "beyond_nominal_range", "at most 100 %: accuracy and linearity of the sheet do not hold there"
    elif is_loaded and share < UNUSED:
        code, why = "far_below_nominal_range", f"{100.0 * UNUSED:g} % or more under load: class and noise would hide it"
    else:
        return []
    text = (
        f"the {sheet.quantity} reaches {short(100.0 * share)} % of nominal_range, expected {why}; check nominal_range "
        "and sensitivity"
    )
    return [Finding(code, "warning", text, sheet.serial)]


def beyond_points(sheet: SensorCalibration, peak: float) -> list[Finding]:
    """Return a warning where the largest value of a channel lies beyond all points of its certificate."""
    if not peak > BEYOND_POINTS * sheet.calibrated_to:
        return []
    text = (
        f"the {sheet.quantity} reaches {short(peak / sheet.calibrated_to)} times the largest point of its certificate, "
        "expected points up to the loads that are measured: beyond them its line is drawn on; have it calibrated there"
    )
    return [Finding("beyond_certificate", "warning", text, sheet.serial)]


def largest(channel: Channel) -> float:
    """Return the largest value that is no stray sample: the 99.9th percentile of pieces all over the log.

    It is nan for a channel that never changes: `camtorque check` tells that.
    """
    values = np.abs(channel.from_volts(pieces(channel.read_volts, channel.n_samples)))
    return percentile(values, 99.9) if values.size and np.ptp(values) > 0.0 else math.nan


def marked_missing(recording: Recording) -> str:
    """Name samples that stand at one value, farther from all others than these from each other; "" without such."""
    for channel in (*recording.of("torque")[:1], *recording.of("pressure")[:1]):
        values = pieces(channel.read_volts, channel.n_samples)
        for end in (float(np.min(values)), float(np.max(values))):
            there = values == end
            others = values[~there]
            if there.sum() > 1 and others.size and np.min(np.abs(others - end)) > np.ptp(others):
                return (
                    f"samples of {channel.name!r} stand at exactly {end / channel.scale:g}, far beyond all others: "
                    "where that marks missing samples, leave those out or write nan"
                )
    return ""


def extent(source: SampleSource) -> float:
    """Return how far the samples of a log lie apart, as pieces all over it tell, in its own unit."""
    values = pieces(source.read, source.n_samples)
    return float(np.ptp(values)) if values.size else 0.0


def pieces(read: Callable[[int, int], Array], n_samples: int) -> Array:
    """Return the samples of pieces all over a log that are numbers, as many as make its extremes a sound choice."""
    last = max(n_samples - BLOCK_SAMPLES, 0)
    count = min(BLOCKS, -(-n_samples // BLOCK_SAMPLES))
    starts = np.unique(np.linspace(0, last, count).astype(int))
    every = -(-min(n_samples, BLOCKS * BLOCK_SAMPLES) // MOST_RANKED)
    found: Array = np.concatenate([read(int(s), int(s) + BLOCK_SAMPLES)[::every] for s in starts])
    return found[np.isfinite(found)]
