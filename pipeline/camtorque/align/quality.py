"""Each cycle is used or rejected for a named reason, without looking at any model.

`CUTS` is the registry: reason -> (test, text). A test receives the `CycleTable` and marks the cycles that fail it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from camtorque.align.channels import AlignedChannel
from camtorque.align.options import AlignOptions
from camtorque.records import Array, CutFlowRow, Finding, Integers, Mask, Refusal
from camtorque.signal.threshold import Count, Threshold
from camtorque.stacks import distance_of
from camtorque.units import RPM, short

SAMPLED_CYCLES = 41
"""The robust mean cycle is taken over at most this many cycles, spread evenly."""
POINT_DEG = 0.4
"""Distance of the points at which cycles are compared: an outlier is no matter of a tenth of a degree."""
CLIPPED_SAMPLES = Count(
    3, "samples", "convention",
    "Samples at the end of the output range that make a cycle clipped: one or two may be a disturbance."
)  # fmt: skip
FROZEN_DEGREES = Threshold(
    3.0, "deg", "simulated rigs",
    "A channel that does not change over this angle, and four times longer than in its other cycles, has dropped out."
)  # fmt: skip
CONSTANT_DEGREES = Threshold(270.0, "deg", "physics", "No channel of a running pump stands still over this angle.")
MISFIRE_SWING = Threshold(
    0.7, "1", "convention",
    "Pressure swing, relative to the median cycle's, below which a cycle has not built up pressure."
)  # fmt: skip
OUTLIER_SWING = Threshold(
    0.01, "1", "recordings",
    "A cycle closer than this part of the swing is none: single cycles of sound pumps scatter by 0.2 to 0.8 %."
)  # fmt: skip
OUTLIER_FACTOR = Threshold(
    2.5, "1", "simulated rigs", "An outlier is also this much further from the robust mean cycle than the median cycle."
)
STRETCH = Count(4, "cycles", "convention", "Outliers in a row that are no disturbance any more.")
OTHER_WAY = Threshold(0.1, "1", "convention", "Outliers here and there that are more than this share are none, either.")
LEAST_PERIODS = Count(8, "periods", "statistics", "A correlation of neighbouring periods needs some.")
MOST_LOST = Threshold(
    0.5, "1", "convention",
    "Part of the complete cycles that may fail the cut on steady speed before its cause is looked for."
)  # fmt: skip
ALTERNATES = Threshold(
    -0.25, "1", "statistics",
    "Correlation of neighbouring periods: -0.5 for edges that jitter independently, near +1 for a speed that changes."
)  # fmt: skip
LEAST_MEAN = Threshold(
    0.005, "1", "simulated rigs",
    "Mean of a torque over its peak below which its mean was taken off: 0.014 or more on 147 benches of six makers."
)  # fmt: skip
TOP = Threshold(
    0.02, "1", "convention", "Share of its swing below its highest value over which a torque is at its top."
)
FLAT_DEGREES = Threshold(
    3.0, "deg", "simulated rigs",
    "Width from which on a level top of the pressure is cut off: a nozzle held one for 2.2 of 147 sound benches."
)  # fmt: skip
TOPS = {"torque": ("N m", 1.0, 0.0), "pressure": ("bar", 1.0e5, FLAT_DEGREES)}
"""Quantity whose top may be cut off -> unit that it is told in, SI per unit, least width of a level top [deg]."""
FLAT_TOP = Threshold(
    0.7, "1", "simulated rigs",
    "Share of the top that lies on one level, within a tenth of the top's height, from which it is cut off: 0.8 to 1 "
    "behind an amplifier at its limit, below 0.45 of 170 sound torques, which bend or ring."
)  # fmt: skip

TOP_POINTS = Count(
    8, "points", "statistics",
    "Points of the angle grid that a top has to hold: of fewer, as of a peak before a spill on a coarse grid, most lie "
    "on one level by themselves."
)  # fmt: skip


@dataclass(frozen=True)
class CycleTable:
    """What the cuts look at; one row per cycle that the pulses cover.

    ``edge_change`` is the relative change of the period that the errors of the edges alone can make.
    """

    index: Integers
    speed: Array
    speed_change: Array
    complete: Mask
    unproven: Mask
    clock_jump: Mask
    aligned: Mapping[str, AlignedChannel]
    options: AlignOptions
    slipped: Mask
    edge_change: float = 0.0

    @property
    def steady_change(self) -> float:
        """Largest relative change of the period that counts as steady: the chosen one, or what the edges can make."""
        return max(self.options.steady_change, self.edge_change)

    @property
    def undamaged(self) -> Mask:
        """Complete cycles without missing samples: those that statistics may be taken over."""
        fine = self.complete.copy()
        for item in self.aligned.values():
            fine &= item.damage.missing == 0
        return fine


def _drop_out(table: CycleTable) -> Mask:
    lost = np.zeros(table.index.size, dtype=bool)
    for item in table.aligned.values():
        damage = item.damage
        degrees = 360.0 * damage.longest_run / np.maximum(damage.n_samples, 1)
        usual = np.median(damage.longest_run[table.complete]) if table.complete.any() else 0.0
        frozen = (degrees > FROZEN_DEGREES) & (damage.longest_run > 4.0 * usual)
        lost |= (damage.missing > 0) | (frozen & (damage.longest_run > damage.flat_run)) | (degrees > CONSTANT_DEGREES)
    return lost


def _clipped(quantity: str) -> Callable[[CycleTable], Mask]:
    def test(table: CycleTable) -> Mask:
        if quantity not in table.aligned:
            return np.zeros(table.index.size, dtype=bool)
        damage = table.aligned[quantity].damage
        return (damage.clipped >= CLIPPED_SAMPLES) | (damage.flat_run > 0)

    return test


def _start_stop(table: CycleTable) -> Mask:
    return np.abs(table.speed_change) > table.steady_change


def _steady(table: CycleTable) -> Mask:
    return table.complete & ~_start_stop(table)


def _speed_outlier(table: CycleTable) -> Mask:
    steady = _steady(table)
    usual = usual_speed(table.speed[steady] if steady.any() else table.speed, table.options.steady_band)
    return np.abs(table.speed / usual - 1.0) > table.options.steady_band


def usual_speed(speeds: Array, band: float) -> float:
    """Return the speed about which most of some speeds (n,) lie, within a relative band to either side [rad/s].

    Of a recording that holds several steady speeds the median may be a rare one.
    """
    ordered = np.sort(speeds)
    within = np.searchsorted(ordered, ordered * (1.0 + band), "right") - np.searchsorted(
        ordered, ordered * (1.0 - band)
    )
    most = np.flatnonzero(within == within.max())
    centre = ordered[most[np.argmin(np.abs(most - 0.5 * ordered.size))]]
    return float(np.median(ordered[np.abs(ordered / centre - 1.0) <= band]))


def _misfire(table: CycleTable) -> Mask:
    weak = np.zeros(table.index.size, dtype=bool)
    if "pressure" not in table.aligned:
        return weak
    low, high = table.aligned["pressure"].extremes.T
    sound = table.undamaged
    if sound.any():
        swing = high[sound] - low[sound]
        weak[sound] = swing < MISFIRE_SWING * np.median(swing)
    return weak


def ordinary(table: CycleTable) -> Mask:
    """Return the complete cycles that nothing is wrong with but, maybe, their shape or place."""
    return ~np.any([test(table) for reason, (test, _) in CUTS.items() if reason not in ("samples_lost", "outlier")], 0)


def _outlier(table: CycleTable) -> Mask:
    normal = ordinary(table) & ~table.slipped
    outlier = np.zeros(table.index.size, dtype=bool)
    if normal.sum() < 4:
        return outlier
    for rows in (item.rows for item in table.aligned.values()):
        stride = max(1, int(POINT_DEG * rows.shape[1] / 360.0))
        distance = distance_of(rows, np.median(rows[spread_choice(normal), ::stride], axis=0), stride)
        usual = np.median(distance[normal])
        spread = 1.4826 * np.median(np.abs(distance[normal] - usual))
        swing = float(np.ptp(rows[np.flatnonzero(normal)[int(normal.sum()) // 2]]))
        limit = max(usual + table.options.outlier_z * spread, OUTLIER_FACTOR * usual, OUTLIER_SWING * swing)
        outlier |= np.nan_to_num(distance) > limit
    return outlier


def spread_choice(flags: Mask) -> Integers:
    """Return at most `SAMPLED_CYCLES` of the flagged places, spread evenly."""
    return _some(np.flatnonzero(flags))


def _some(chosen: Integers) -> Integers:
    return chosen[np.unique(np.linspace(0, chosen.size - 1, min(chosen.size, SAMPLED_CYCLES)).astype(int))]


CUTS: dict[str, tuple[Callable[[CycleTable], Mask], str]] = {
    "incomplete": (lambda table: ~table.complete, "the recording of a channel begins or ends inside the cycle"),
    "clock_jump": (lambda table: table.clock_jump, "a logger's clock jumps inside the cycle"),
    "missed_trigger": (
        lambda table: table.unproven, "a trigger pulse of the cycle is missing and the neighbours do not show where"),
    "drop_out": (_drop_out, "samples are missing, or a channel stands still"),
    "pressure_clipped": (_clipped("pressure"), "the pressure stands at the end of its output range or at a flat top"),
    "torque_clipped": (_clipped("torque"), "the torque stands at an end of its output range or at a flat top"),
    "start_stop": (_start_stop, "the speed changes from one revolution to the next"),
    "speed_outlier": (_speed_outlier, "the speed lies outside the recording's steady band"),
    "misfire": (_misfire, "the pressure does not build up as in the other cycles"),
    "samples_lost": (
        lambda table: table.slipped, "samples of a log were lost before the cycle: torque or pressure lies elsewhere"),
    "outlier": (_outlier, "the cycle lies far from the robust mean cycle"),
}  # fmt: skip


def changed_running(table: CycleTable, time: Array) -> tuple[Finding, ...]:
    """Tell outliers that are no disturbance: one stretch of the recording, or many here and there.

    ``time`` : (n_cycles,) when each cycle begins [s]
    """
    looked = np.flatnonzero(ordinary(table) & ~table.slipped)
    far = np.flatnonzero(_outlier(table)[looked])
    if far.size < STRETCH:
        return ()
    begin, end = (short(float(time[looked[k]]), 4) for k in (far[0], far[-1]))
    if np.ptp(far) + 1 == far.size:
        text = (
            f"{far.size} of {looked.size} cycles, those from {begin} s to {end} s, are outliers and no other is: load, "
            "speed or state changed there; this report covers the rest; record each state separately"
        )
        return (Finding("running_changes", "warning", text, "cut-flow"),)
    if far.size >= OTHER_WAY * looked.size:
        text = (
            f"{far.size} of {looked.size} cycles, here and there between {begin} s and {end} s, are outliers: the pump "
            "runs in more than one way, as when the pressure left in the line differs from stroke to stroke; "
            "this report covers what most cycles do; another load or speed may run evenly"
        )
        return (Finding("running_alternates", "warning", text, "cut-flow"),)
    return ()


def several_speeds(table: CycleTable) -> tuple[Finding, ...]:
    """Tell a recording that holds more than one steady speed: the report is of one."""
    left, band = table.speed[_steady(table)], table.options.steady_band
    found = list[tuple[float, int]]()
    while left.size >= STRETCH:
        speed = usual_speed(left, band)
        near = np.abs(left / speed - 1.0) <= band
        turns = int(np.count_nonzero(near))
        # a speed that drifts goes from one end of its band to the other, and on into the next band
        if turns >= STRETCH and np.ptp(left[near]) < band * speed:
            found.append((speed, turns))
        left = left[~near]
    if len(found) < 2:
        return ()
    listed = ", ".join(f"{short(speed / RPM, 4)} rpm ({turns} turns)" for speed, turns in found)
    text = (
        f"the recording holds several steady speeds: {listed}; this report is of the first; cut the logs so that a "
        "recording has one speed, and let a campaign take them together"
    )
    return (Finding("several_speeds", "warning", text, "cut-flow"),)


def apply_cuts(table: CycleTable) -> tuple[Mask, tuple[CutFlowRow, ...]]:
    """Return the used cycles and the cut-flow; the first row counts the cycles that were found."""
    left = np.ones(table.index.size, dtype=bool)
    rows = []
    for reason, (test, text) in CUTS.items():
        fails = test(table)
        rejected = int(np.sum(left & fails))
        left &= ~fails
        rows.append(CutFlowRow(reason, rejected, text, int(fails.sum()), int(left.sum())))
    return left, tuple(rows)


def refuse_jitter(table: CycleTable, name: str) -> None:
    """Refuse a recording of which most cycles are lost because the edges jitter, not because the speed changes.

    An edge that comes late by e makes its period longer by e and the next shorter: periods of variance 2 e^2 whose
    neighbours correlate by -1/2.
    """
    known = table.complete & ~table.unproven & ~table.clock_jump
    lost = int(np.sum(_start_stop(table) & known))
    if known.sum() < LEAST_PERIODS or lost <= MOST_LOST * known.sum():
        return
    period = 2.0 * np.pi / table.speed[known]
    places = np.arange(period.size)
    scatter = period - np.polyval(np.polyfit(places, period, 1), places)
    alternation = float(np.corrcoef(scatter[1:], scatter[:-1])[0, 1])
    if not alternation < ALTERNATES:
        return
    jitter = float(np.std(scatter)) / np.sqrt(2.0)
    raise Refusal(
        f"{name}: the trigger edges jitter by {1e3 * jitter:.2g} ms, {360.0 * jitter / np.median(period):.2g} degrees "
        f"of cam angle: {lost} of {int(known.sum())} cycles change their period by more than "
        f"{100.0 * table.steady_change:.2g} %, and a long one follows a short one (correlation "
        f"{alternation:.2f}), which no shaft does; expected edges that repeat; check gap, mounting and shielding of "
        "the pick-up and the declared edge, or record a tooth wheel"
    )


def no_mean_findings(mean: Array) -> tuple[Finding, ...]:
    """Tell a mean torque (n,) [N m] whose mean over the revolution was taken off: a pump that delivers takes work."""
    left, peak = float(np.mean(mean)), float(np.max(np.abs(mean)))
    if not abs(left) < LEAST_MEAN * peak:
        return ()
    text = (
        f"the torque is {left:.2g} N m in the mean over the revolution, {100.0 * abs(left) / peak:.1g} % of its peak, "
        f"expected {100.0 * LEAST_MEAN:.1g} % or more of a pump that delivers or rubs: an input that lets no DC "
        "through, or a mean that was subtracted; record with DC coupling, since work and losses rest on the mean"
    )
    return (Finding("torque_without_mean", "warning", text, "torque"),)


def flat_top_findings(rows: Array, mean: Array, quantity: str) -> tuple[Finding, ...]:
    """Tell cycles (m, n) of mean (n,) whose top is cut off before the logger, in all of them or in either half.

    Noise that is added behind the cut leaves no equal samples.
    """
    unit, per, degrees = TOPS[quantity]
    halves = np.array_split(np.arange(rows.shape[0]), 2)
    tops = (
        _level_top(cycle) for cycle in (mean, *(np.mean(rows[_some(half)], axis=0) for half in halves if half.size))
    )
    level, wide = next((top for top in tops if top[1] and top[1] >= degrees), (0.0, 0.0))
    if not wide:
        return ()
    text = (
        f"the {quantity} stays at {level / per:.4g} {unit} over {wide:.2g} degrees where it is highest, "
        "expected a top that bends: an amplifier or the range of the transducer's output cuts it off; widen the range "
        "and record again, since peak, work and all that is fitted rest on what is missing"
    )
    return (Finding(f"{quantity}_flat_top", "warning", text, quantity),)


def _level_top(cycle: Array) -> tuple[float, float]:
    """Return level and width [deg] of a cycle's top (n,) where that is level, zeros where it is not."""
    height = TOP * float(np.ptp(cycle))
    top = cycle[cycle > np.max(cycle) - height]
    if top.size < TOP_POINTS:
        return 0.0, 0.0
    level = float(np.median(top))
    is_level = np.mean(np.abs(top - level) < 0.1 * height) >= FLAT_TOP
    return (level, 360.0 * top.size / cycle.size) if is_level else (0.0, 0.0)
