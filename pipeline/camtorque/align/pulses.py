"""Edge times -> a pulse train with nominal cam angles: bounced, doubled and missed pulses repaired and counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camtorque.records import Array, Channel, Finding, Integers, Mask
from camtorque.signal.edges import Edges, without_bounces
from camtorque.signal.running import running_median
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import counted

SAME_PERIOD = Threshold(
    0.15, "1", "simulated rigs", "Relative difference within which two gaps together count as one period."
)
PROVEN_PERIOD = Threshold(
    0.02, "1", "simulated rigs",
    "A gap is an integer number of periods when the neighbours' periods agree with it this closely."
)  # fmt: skip
MAX_EXTRA = Count(4, "pulses", "convention", "Pulses too many within one period that neighbours can prove.")
MAX_MISSED = Count(3, "pulses", "convention", "Pulses missed in a row that neighbours can prove.")
LOCAL_PERIODS = 9


@dataclass(frozen=True)
class PulseTrain:
    """Pulses in time order, on one clock.

    Attributes
    ----------
    time : (n,) [s]
    step : (n,) whole pitches since the first pulse (a missing tooth counts)
    repaired : (n,) True where the pulse was put in
    broken : (n,) True where the way from the pulse before is not proven
    repair_error : expected error of a repaired pulse, in parts of a period
    counts : ``bounced``, ``doubled``, ``missed``, ``gaps``, ``slips``
    jumped : (n,) True where a clock jumps on the way from the pulse before; None before it was looked for
    offset : steps from the pulse of step 0 to where the nominal angle is passed (an index between two pulses)
    offset_std : its standard error [steps]
    by_index : True where the nominal angle is that of an index pulse
    phase_open : True where the wheel turns several times per cycle and nothing shows which turn is which
    """

    time: Array
    step: Integers
    repaired: Mask
    broken: Mask
    repair_error: float
    counts: Mapping[str, int]
    jumped: Mask | None = None
    offset: float = 0.0
    offset_std: float = 0.0
    by_index: bool = False
    phase_open: bool = False

    @property
    def jumps(self) -> Mask:
        """``jumped``, or none before it was looked for."""
        return np.zeros(self.time.size, dtype=bool) if self.jumped is None else self.jumped


@dataclass(frozen=True)
class TriggerTrain:
    """Pulses of one channel on its own logger's clock; ``edges`` holds their noise.

    ``pulses_per_cycle`` counts the steps of a turn of the cam in ``train``.
    """

    channel: Channel
    edges: Edges
    train: PulseTrain
    pulses_per_cycle: int
    findings: tuple[Finding, ...] = ()


def clean_pulses(time: Array) -> PulseTrain:
    """Remove bounced and doubled pulses of an evenly divided shaft and put in missed ones; edge times in seconds."""
    time, n_bounced = without_bounces(time)
    time, n_doubled = _without_extras(time)
    gaps = np.diff(time)
    n_periods = np.ones(gaps.size, dtype=np.int64)
    broken = np.zeros(gaps.size, dtype=bool)
    # Only a gap clearly longer than its surroundings can hold a missed pulse.
    for i in np.flatnonzero(gaps > 1.4 * _local_period(time)).tolist() if gaps.size else ():
        n_periods[i], broken[i] = _periods_in_gap(gaps, i)
    inserted = np.where(broken, 0, n_periods - 1)
    # each pulse is followed by those that are put in before the next one
    within = np.arange(inserted.sum() + time.size) - np.repeat(
        np.r_[0, np.cumsum(inserted + 1)], np.r_[inserted + 1, 1]
    )
    which = np.repeat(np.arange(time.size), np.r_[inserted + 1, 1])
    part = np.r_[gaps / n_periods, 0.0]
    out_time = time[which] + within * part[which]
    step = np.r_[0, np.cumsum(n_periods)][which] + within
    repaired = within > 0
    out_broken = np.r_[False, broken][which] & ~repaired
    single = np.diff(gaps[n_periods == 1])
    scatter = 1.4826 * np.median(np.abs(single)) / np.sqrt(2.0) / np.median(gaps) if single.size else 1.0
    counts = {"bounced": n_bounced, "doubled": n_doubled, "missed": int(np.sum(repaired)), "gaps": int(np.sum(broken))}
    return PulseTrain(out_time, step, repaired, out_broken, float(scatter), counts)


def _local_period(time: Array) -> Array:
    return running_median(np.diff(time), LOCAL_PERIODS)


def _without_extras(time: Array) -> tuple[Array, int]:
    """Drop pulses between two that lie one period apart."""
    n_before, i = time.size, 0
    period = _local_period(time)
    while i < time.size - 2:
        expected = period[min(i, period.size - 1)]
        ahead = time[i + 2 : i + 2 + MAX_EXTRA] - time[i]
        if time[i + 1] - time[i] < (1.0 - SAME_PERIOD) * expected and ahead.size:
            nearest = int(np.argmin(np.abs(ahead - expected)))
            if abs(ahead[nearest] / expected - 1.0) < SAME_PERIOD:
                time = np.delete(time, slice(i + 1, i + 2 + nearest))
                period = _local_period(time)
        i += 1
    return time, n_before - time.size


def _periods_in_gap(gaps: Array, i: int) -> tuple[int, bool]:
    """Whole periods in gap i, and whether the neighbours fail to prove it."""
    near = np.r_[gaps[max(0, i - 3) : i], gaps[i + 1 : i + 4]]
    if not near.size:
        return 1, False
    n = max(1, round(float(gaps[i] / np.median(near))))
    if n == 1:
        return 1, False
    sides = [
        side[np.argmin(np.abs(side - gaps[i] / n))]
        for side in (gaps[max(0, i - 2) : i], gaps[i + 1 : i + 3])
        if side.size
    ]
    proven = n <= MAX_MISSED + 1 and all(abs(side * n / gaps[i] - 1.0) < PROVEN_PERIOD for side in sides)
    return n, not proven


def train_findings(train: PulseTrain, where: str) -> tuple[Finding, ...]:
    """Count the repairs."""
    texts = {
        "bounced": ("trigger_bounced", "trigger edge followed another within a bounce and was left out",
                    "trigger edges followed another within a bounce and were left out"),
        "doubled": ("trigger_doubled", "trigger pulse too many between regular neighbours was left out",
                    "trigger pulses too many between regular neighbours were left out"),
        "missed": ("trigger_missed", "trigger pulse was missing and its neighbours prove where it belongs",
                   "trigger pulses were missing and their neighbours prove where they belong"),
        "gaps": ("trigger_gap", "stretch of the trigger holds no regular pulses; the revolutions there are not used",
                 "stretches of the trigger hold no regular pulses; the revolutions there are not used"),
        "slips": ("trigger_slipped", "revolution has another number of teeth; counted anew from the next mark",
                  "revolutions have another number of teeth; counted anew from the next mark"),
    }  # fmt: skip
    return tuple(
        Finding(code, "warning", counted(train.counts[key], one, many), where)
        for key, (code, one, many) in texts.items()
        if train.counts.get(key)
    )
