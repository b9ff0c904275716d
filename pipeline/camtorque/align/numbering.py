"""Edge times of any wheel or encoder -> pulses with whole steps since the reference of the nominal angle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.align.pulses import PulseTrain, clean_pulses
from camtorque.align.teeth import (
    ONE_PITCH,
    Counted,
    double_tooth_steps,
    forward,
    from_marks,
    missing_tooth_steps,
    pitch_of,
    resynced,
    train_of,
)
from camtorque.config import TriggerSpec
from camtorque.records import Array, Refusal
from camtorque.signal.threshold import Threshold

LATE_INDEX = Threshold(
    0.5, "steps", "convention", "An index that comes this many steps after a mark still belongs to it."
)
INDEX_SPREAD = Threshold(
    0.25, "steps", "simulated rigs",
    "Standard deviation of the index pulse among the others [steps] beyond which it does not belong to this wheel."
)  # fmt: skip


def number_teeth(time: Array, spec: TriggerSpec, where: str, index: Array | None) -> PulseTrain:
    """Return the pulses with ``step`` zero (mod pulses per cycle) at the reference of the nominal angle.

    The reference is the first tooth after the gap, the first regular tooth after an extra one, or the pulse of an
    index channel. Where the wheel turns several times per cycle, the first mark at or after the index pulse.

    Parameters
    ----------
    time : edge times [s]
    index : edge times of the index channel [s], None without one

    Raises
    ------
    Refusal : the wheel has no mark, or the mark is not found once per revolution
    """
    train = _numbered(forward(time, where), spec, where, index)
    return replace(train, phase_open=True) if spec.revolutions_per_cycle > 1 and index is None else train


def _numbered(time: Array, spec: TriggerSpec, where: str, index: Array | None) -> PulseTrain:
    if spec.pulses_per_rev == 1:
        train = clean_pulses(time)
        return train if index is None else numbered_by_index(train, index, spec, where)
    if spec.double_tooth or spec.missing_teeth:
        counted = double_tooth_steps(time) if spec.double_tooth else missing_tooth_steps(time, spec.missing_teeth)
        train = from_marks(counted, spec, where)
        if index is None or (spec.revolutions_per_cycle == 1 and spec.reference != "index"):
            return train
        return numbered_by_index(train, index, spec, where)
    if index is None:
        raise _without_mark(spec, where)
    return numbered_by_index(train_of(missing_tooth_steps(time, 0)), index, spec, where)


def number_counts(time: Array, spec: TriggerSpec, where: str, index: Array | None) -> PulseTrain:
    """Return the pulses of an encoder whose two tracks show every step; where it stood the way is not proven."""
    time = forward(time, where)
    if index is None:
        raise _without_mark(spec, where)
    steps = np.rint(np.diff(time) / pitch_of(time))
    stood = np.r_[False, steps > 1.0]
    counted = Counted(time, np.arange(time.size), stood, np.empty(0, dtype=np.int64))
    return numbered_by_index(train_of(counted), index, spec, where)


def _without_mark(spec: TriggerSpec, where: str) -> Refusal:
    return Refusal(
        f"{where}: a wheel of {spec.pulses_per_rev} pulses per revolution without a mark does not tell which tooth "
        "is at nominal_angle_deg; expected missing_teeth or double_tooth in [trigger], or a channel with "
        'quantity = "index"'
    )


def numbered_by_index(train: PulseTrain, index: Array, spec: TriggerSpec, where: str) -> PulseTrain:
    """Return the train with its steps counted from the index pulse, anew at each one.

    Raises
    ------
    Refusal : the index does not come once per turn of the cam, or wanders among the pulses
    """
    n, per_rev = spec.pulses_per_cycle, spec.pulses_per_rev
    place = np.interp(index, train.time, train.step.astype(np.float64), left=np.nan, right=np.nan)
    place = place[np.isfinite(place)]
    by_mark = bool(spec.missing_teeth or spec.double_tooth or per_rev == 1)
    _refuse_odd_index(place, n, where)
    if by_mark and spec.reference != "index":
        # the index only tells which turn of the wheel; the nominal angle is that of the mark at or after it
        late = min(LATE_INDEX, 0.1 * per_rev)
        turn = np.ceil((_circular_mean(place, n) - late) / per_rev) * per_rev
        return replace(train, step=train.step - int(turn))
    fraction, spread = _fraction(place)
    if spread > INDEX_SPREAD:
        raise Refusal(
            f"{where}: the index pulse wanders by {spread:.2g} of a pulse interval among the pulses, expected a place "
            "that repeats; check that both channels belong to one encoder and pulses_per_rev"
        )
    zeros = np.rint(place - fraction).astype(np.int64)
    marks = np.searchsorted(train.step, zeros)
    there = train.step[np.minimum(marks, train.step.size - 1)] == zeros
    found = resynced(Counted(train.time, train.step, train.broken, np.unique(marks[there])), n, n)
    kept = np.isin(train.time, found.time)
    counts = {**train.counts, "slips": train.counts.get("slips", 0) + found.n_slips}
    return PulseTrain(
        found.time, found.step, train.repaired[kept], found.broken, train.repair_error, counts,
        offset=fraction, offset_std=float(spread / np.sqrt(place.size)), by_index=True,
    )  # fmt: skip


def _refuse_odd_index(place: Array, n: int, where: str) -> None:
    apart = float(np.median(np.diff(place))) if place.size > 1 else float(n)
    if place.size and abs(apart / n - 1.0) < ONE_PITCH:
        return
    found = f"one every {apart:.1f} pulses" if place.size else "none beside the pulses"
    raise Refusal(
        f"{where}: found {place.size} index pulses, {found}, expected one every {n} (per turn of the cam); check "
        "pulses_per_rev, revolutions_per_cycle and the index channel"
    )


def _circular_mean(place: Array, n: int) -> float:
    return float(np.angle(np.mean(np.exp(2j * np.pi * place / n))) / (2.0 * np.pi) * n)


def _fraction(place: Array) -> tuple[float, float]:
    """Return where between two pulses the index lies (-0.5 to 0.5) and its robust spread [steps]."""
    centre = _circular_mean(place, 1)
    around = (place - centre + 0.5) % 1.0 - 0.5
    middle = float(np.median(around))
    return centre + middle, 1.4826 * float(np.median(np.abs(around - middle)))
