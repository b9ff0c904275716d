"""What is wrong with raw samples: missing, clipped, standing still; one rule each, for `check` and for `align`.

A clipped top is a run of equal samples at the end of the range from which the signal falls steeply on both sides.
"""

from __future__ import annotations

import numba
import numpy as np

from camtorque.records import Array, SensorCalibration
from camtorque.signal.threshold import Count, Threshold

FLAT_RUN = Count(
    6, "samples", "statistics",
    "Equal samples in a row at the end of a cycle's range that may be a clipped top: noise leaves two or "
    "three."
)  # fmt: skip
STEPS_BESIDE_FLAT = Threshold(
    30.0, "steps", "simulated rigs",
    "A clipped top falls by more than this many steps of the converter within its own length on either "
    "side; a smooth peak that is flat only for want of resolution falls by eight."
)  # fmt: skip


NO_VOLTAGE = Threshold(
    1.0e10, "unit of the file", "physics",
    "No logger delivers a larger number in any unit (1000 bar are 1e8 Pa): nan, infinite and absurd ones "
    "are missing."
)  # fmt: skip


@numba.njit(cache=True, nogil=True)
def damage_of(volts: Array, lowest: float, highest: float) -> tuple[int, int, int, int]:
    """Count what is wrong with the samples of a cycle.

    Returns
    -------
    Samples at or beyond the output range; samples that are no numbers, or absurd ones; longest run of equal samples;
    length of the longest clipped top (and bottom, where ``lowest`` is finite). Runs are looked for only where a first,
    fast pass finds equal neighbours.
    """
    clipped, missing, equal = 0, 0, 0
    for i in range(volts.size):
        value = volts[i]
        missing += not (-NO_VOLTAGE < value < NO_VOLTAGE)
        clipped += (value <= lowest) | (value >= highest)
    for i in range(1, volts.size):
        equal += volts[i] == volts[i - 1]
    if equal < 2:
        return clipped, missing, 1, 0
    return clipped, missing, *_runs(volts, lowest > -1e300)


@numba.njit(cache=True, nogil=True)
def _runs(volts: Array, two_sided: bool) -> tuple[int, int]:
    """Return the longest run of equal samples and the longest one at a clipped end."""
    run, longest, step = 1, 1, 1e300
    top, at_top, top_end = volts[0], 1, 0
    bottom, at_bottom, bottom_end = volts[0], 1, 0
    for i in range(1, volts.size):
        value, change = volts[i], abs(volts[i] - volts[i - 1])
        run = run + 1 if change == 0.0 else 1
        if 0.0 < change < step:
            step = change
        longest = max(longest, run)
        if value > top or (value == top and run > at_top):
            top, at_top, top_end = value, run, i
        if value < bottom or (value == bottom and run > at_bottom):
            bottom, at_bottom, bottom_end = value, run, i
    flat = at_top if _is_clipped(volts, at_top, top_end, step) else 0
    if two_sided and _is_clipped(volts, at_bottom, bottom_end, step):
        flat = max(flat, at_bottom)
    return longest, flat


@numba.njit(cache=True, nogil=True)
def _is_clipped(volts: Array, run: int, end: int, step: float) -> bool:
    before, after = end - 2 * run + 1, end + run
    if run < FLAT_RUN or before < 0 or after >= volts.size:
        return False
    fall = min(abs(volts[end] - volts[before]), abs(volts[end] - volts[after]))
    return fall > STEPS_BESIDE_FLAT * step


def clips_below(calibration: SensorCalibration | None) -> bool:
    """Tell whether the lower end of a sensor's output clips: one with an output from zero upward rests there."""
    return calibration is not None and calibration.output_min_volts < 0.0


@numba.njit(cache=True, nogil=True)
def clipped_samples(volts: Array, extreme: float) -> int:
    """Count the samples in clipped runs at one extreme of a channel."""
    step = 1e300
    for i in range(1, volts.size):
        change = abs(volts[i] - volts[i - 1])
        if 0.0 < change < step:
            step = change
    count, run = 0, 0
    for i in range(volts.size + 1):
        if i < volts.size and volts[i] == extreme:
            run += 1
            continue
        if run and _is_clipped(volts, run, i - 1, step):
            count += run
        run = 0
    return count


@numba.njit(cache=True, nogil=True)
def missing_samples(volts: Array, carried: int) -> tuple[int, int, int]:
    """Count the samples that are no voltages.

    Returns
    -------
    How many; the longest run of them, one of ``carried`` samples before the first included; the run that goes on.
    """
    count, longest, run = 0, carried, carried
    for value in volts:
        if -NO_VOLTAGE < value < NO_VOLTAGE:
            run = 0
        else:
            count += 1
            run += 1
            longest = max(longest, run)
    return count, longest, run


def converter_step(volts: Array) -> float:
    """Return the step of the converter as far as neighbouring samples show it: a low percentile of their changes."""
    change = np.abs(np.diff(volts))
    change = change[(change > 0.0) & (change < NO_VOLTAGE)]
    return float(np.percentile(change, 5.0)) if change.size else 0.0
