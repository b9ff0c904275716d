"""Edge times of any wheel or encoder -> pulses with whole steps since the reference of the nominal angle.

A mark is the gap of missing teeth, an extra tooth, or the pulse of an index channel. Between two marks a wheel has as
many steps as it has teeth: where that is not so, the wheel slipped or teeth were lost, the revolution is not used and
the count starts anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.align.pulses import PulseTrain, clean_pulses
from camtorque.config import TriggerSpec
from camtorque.records import Array, Integers, Mask, Refusal
from camtorque.signal.marks import MOSTLY, SAME_SHARE, other_gap, two_marks, uneven_marks
from camtorque.signal.running import running_median
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import counted

LEAST_PULSES = 2
PITCH_TEETH = 11
"""A running median over this many gaps is deaf to the mark and to single disturbances."""
ONE_PITCH = Threshold(
    0.3, "1", "physics", "Two gaps make one pitch when their sum differs from it by less than this part."
)
BOUNCE = Threshold(
    0.15, "1", "convention",
    "An extra tooth stands further from its neighbours than this part of a pitch: a bounce is nearer."
)  # fmt: skip
SHORT_GAP = Threshold(
    0.7, "1", "physics",
    "The shorter of the two is below this part of a pitch: an engine's ripple stretches single gaps by 20 %."
)  # fmt: skip
STANDSTILL_STEPS = Count(
    8, "steps", "convention",
    "A gap of more steps (or twice the mark's) is a shaft that stood still: how far it turned is not counted from time."
)  # fmt: skip
NEAREST_MARKS = Threshold(
    0.7, "1", "convention",
    "Two marks are further apart than this part of a revolution: a slip loses a few teeth, not a third of them."
)  # fmt: skip
FAR_MARKS = Count(3, "turns", "convention", "A mark is confirmed by another one up to this many revolutions away.")
LATE_INDEX = Threshold(
    0.5, "steps", "convention", "An index that comes this many steps after a mark still belongs to it."
)
INDEX_SPREAD = Threshold(
    0.25, "steps", "simulated rigs",
    "Standard deviation of the index pulse among the others [steps] beyond which it does not belong to this wheel."
)  # fmt: skip


def forward(time: Array, where: str) -> Array:
    """Keep the pulses whose times run forward."""
    time = time[np.isfinite(time)]
    kept = time[np.r_[True, np.diff(np.maximum.accumulate(time)) > 0.0]] if time.size else time
    if kept.size < LEAST_PULSES:
        raise Refusal(
            f"{where}: found {counted(kept.size, 'pulse', 'pulses')} in the order of time, expected at least "
            f"{LEAST_PULSES}; record more revolutions, or check the time of the file"
        )
    return kept


def pitch_of(time: Array, spec: TriggerSpec) -> Array:
    """Return the usual gap around each gap [s]; a wheel with two teeth has as many marks as pitches: by pairs."""
    gaps = np.diff(time)
    if not _has_two_teeth(spec) or gaps.size < 2:
        return running_median(gaps, PITCH_TEETH)
    by_pairs = running_median(gaps[:-1] + gaps[1:], PITCH_TEETH) / spec.pulses_per_rev
    return np.r_[by_pairs, by_pairs[-1]]


def _has_two_teeth(spec: TriggerSpec) -> bool:
    return spec.missing_teeth > 0 and spec.pulses_per_rev - spec.missing_teeth == LEAST_PULSES


def _refuse_other_two(time: Array, spec: TriggerSpec, where: str) -> None:
    """Refuse two teeth that stand elsewhere than declared: their gaps round to whole pitches of any wheel."""
    share = two_marks(time)
    if share and abs(share - 1.0 / spec.pulses_per_rev) > SAME_SHARE:
        raise Refusal(
            f"{where}: expected two teeth {360.0 / spec.pulses_per_rev:.0f} deg apart by pulses_per_rev and "
            f"missing_teeth, but {uneven_marks(time)}"
        )


def _steps(time: Array, spec: TriggerSpec) -> tuple[Integers, Mask]:
    """Return the steps of each gap, and which gaps are a standstill (counted as one step)."""
    most = spec.missing_teeth + 1
    steps = np.maximum(1, np.rint(np.diff(time) / pitch_of(time, spec))).astype(np.int64)
    still = steps > max(STANDSTILL_STEPS, 2 * most)
    return np.where(still, 1, steps), still


def _train_of(time: Array, steps: Integers, still: Mask, n_extra: int, n_missed: int) -> PulseTrain:
    """Return pulses by the steps of the gaps between them, of which some are a standstill."""
    counts = {"bounced": 0, "doubled": n_extra, "missed": n_missed, "gaps": int(still.sum()), "slips": 0}
    none = np.zeros(time.size, dtype=bool)
    return PulseTrain(time, np.r_[0, np.cumsum(steps)], none, np.r_[False, still], 0.0, counts)


def missing_tooth_steps(time: Array, spec: TriggerSpec) -> tuple[PulseTrain, Integers]:
    """Return the pulses of a wheel whose mark is a gap, and which are marks: none where no teeth are missing."""
    kept, n_extra = _without_close_teeth(time, spec)
    steps, still = _steps(kept, spec)
    is_mark = (steps == spec.missing_teeth + 1) & ~still & (spec.missing_teeth > 0)
    n_missed = int(np.sum(steps[~is_mark] - 1))
    return _train_of(kept, steps, still, n_extra, n_missed), 1 + np.flatnonzero(is_mark)


def double_tooth_steps(time: Array, spec: TriggerSpec) -> tuple[PulseTrain, Integers]:
    """Return the pulses of a wheel whose mark is one tooth more, anywhere in a gap, and which are marks."""
    ratio = np.diff(time) / pitch_of(time, spec)
    short, long = np.minimum(ratio[:-1], ratio[1:]), np.maximum(ratio[:-1], ratio[1:])
    parted = (np.abs(short + long - 1.0) < ONE_PITCH) & (short > BOUNCE) & (long < 1.0 - BOUNCE)
    doubled = 1 + np.flatnonzero(parted)
    kept = np.delete(time, doubled)
    steps, still = _steps(kept, spec)
    return _train_of(kept, steps, still, 0, int(np.sum(steps - 1))), doubled - np.arange(doubled.size)


def _without_close_teeth(time: Array, spec: TriggerSpec) -> tuple[Array, int]:
    """Drop a tooth whose two gaps together make one pitch, and the later edge of a bounce."""
    n_before = time.size
    while time.size > 3:
        gaps, pitch = np.diff(time), pitch_of(time, spec)
        both = gaps[:-1] + gaps[1:]
        least = np.minimum(pitch[:-1], pitch[1:])
        extra = (np.abs(both / least - 1.0) < ONE_PITCH) & (np.minimum(gaps[:-1], gaps[1:]) < SHORT_GAP * least)
        if not extra.any():
            break
        first = extra & ~np.r_[False, extra[:-1]]
        time = np.delete(time, 1 + np.flatnonzero(first))
    return time, n_before - time.size


def from_marks(train: PulseTrain, marks: Integers, spec: TriggerSpec, where: str) -> PulseTrain:
    """Return the train of a wheel with a mark: confirmed marks only, counted anew at each.

    Raises
    ------
    Refusal : no gap or extra tooth is there, or the wheel has another number of teeth
    """
    n = spec.pulses_per_rev
    if not marks.size:
        raise Refusal(
            f"{where}: no mark found among {train.time.size} teeth, expected "
            f"{'a double tooth' if spec.double_tooth else f'{spec.missing_teeth} missing teeth'} "
            f"once in {n}; {other_gap(train.step)}check pulses_per_rev, missing_teeth and double_tooth in [trigger], "
            'and sensor ("inductive" for a coil)'
        )
    _refuse_other_wheel(np.diff(train.step[marks]), spec, where)
    found = resynced(train, marks[confirmed(train.step[marks], n)], n, n - spec.missing_teeth)
    return replace(found, counts={**found.counts, "gaps": int(found.broken.sum()) - found.counts["slips"]})


def _refuse_other_wheel(apart: Integers, spec: TriggerSpec, where: str) -> None:
    """Refuse marks that nearly all stand another number of teeth apart, no multiple of the declared one."""
    n = spec.pulses_per_rev
    if apart.size < FAR_MARKS or n - spec.missing_teeth <= LEAST_PULSES:  # of two teeth a lost one makes another gap
        return
    usual = int(np.median(apart))
    if usual % n and np.mean(apart == usual) > MOSTLY:
        counted_so = "the extra ones left out" if spec.double_tooth else "the missing ones counted as if present"
        raise Refusal(
            f"{where}: found a mark every {usual} teeth ({counted_so}), expected one every {n} by pulses_per_rev; "
            f"write pulses_per_rev = {usual} in [trigger]"
        )


def mark_misfit(train: PulseTrain, spec: TriggerSpec) -> float:
    """Return how far the gap and the two intervals beside it are from whole pitches (mean absolute logarithm)."""
    marks = np.flatnonzero((train.step % spec.pulses_per_rev == 0) & (train.step > train.step[0]))
    marks = marks[(marks > 1) & (marks < train.time.size - 1)]
    if not marks.size:
        return np.inf
    gaps, steps = np.diff(train.time), np.diff(train.step)
    pitch = pitch_of(train.time, spec)[marks]
    beside = [np.abs(np.log(gaps[marks + k] / (steps[marks + k] * pitch))) for k in (-2, -1, 0)]
    return float(np.median(np.sum(beside, axis=0)))


def confirmed(step: Integers, n: int) -> Integers:
    """Return which marks are confirmed by others whole revolutions away; of rivals the better confirmed one.

    A tooth that is lost once looks like the mark of a wheel with one tooth missing; it has no others like it.
    """
    support = np.zeros(step.size, dtype=np.int64)
    for turns in range(-FAR_MARKS, FAR_MARKS + 1):
        if turns:
            support += np.isin(step + turns * n, step)
    if not support.any():
        phase = step % n
        return np.flatnonzero(phase == np.bincount(phase, minlength=n).argmax())
    chosen: list[int] = []
    for k in np.flatnonzero(support).tolist():
        if chosen and step[k] - step[chosen[-1]] < NEAREST_MARKS * n and support[k] <= support[chosen[-1]]:
            continue
        while chosen and step[k] - step[chosen[-1]] < NEAREST_MARKS * n:
            chosen.pop()
        chosen.append(k)
    return np.array(chosen, dtype=np.int64)


def resynced(train: PulseTrain, marks: Integers, n: int, present: int) -> PulseTrain:
    """Return pulses with steps of zero (mod n) at every mark; those between marks that do not agree are left out.

    Beyond the first and the last mark as many pulses are kept as the wheel has without showing another mark.

    Parameters
    ----------
    n : steps from mark to mark
    present : steps that the wheel can run before the next mark shows
    """
    step = train.step
    between = np.diff(step[marks])
    turns = np.maximum(1, np.rint(between / n)).astype(np.int64)
    slipped = between != n * turns
    new = step - step[marks[0]]
    shift = np.r_[0, np.cumsum(n * turns - between)]
    last_mark = np.clip(np.searchsorted(marks, np.arange(step.size), side="right") - 1, 0, None)
    new = new + shift[last_mark]
    kept = (new > -n) & (new < new[marks[-1]] + present)
    broken = train.broken.copy()
    for k in np.flatnonzero(slipped):
        kept[marks[k] + 1 : marks[k + 1]] = False
        broken[marks[k + 1]] = True
    counts = {**train.counts, "slips": train.counts.get("slips", 0) + int(slipped.sum())}
    return replace(
        train, time=train.time[kept], step=new[kept], repaired=train.repaired[kept],
        broken=broken_before(broken, kept), counts=counts,
    )  # fmt: skip


def broken_before(broken: Mask, kept: Mask) -> Mask:
    """Tell for each kept pulse whether any way since the kept one before is not proven."""
    total = np.r_[0, np.cumsum(broken)]
    places = np.flatnonzero(kept)
    before = np.r_[places[:1], places[:-1] + 1]
    return (total[places + 1] - total[before]) > 0


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
    if _has_two_teeth(spec):
        _refuse_other_two(time, spec, where)
    if spec.double_tooth or spec.missing_teeth:
        found = (double_tooth_steps if spec.double_tooth else missing_tooth_steps)(time, spec)
        train = from_marks(*found, spec, where)
        if index is None or (spec.revolutions_per_cycle == 1 and spec.reference != "index"):
            return train
        return numbered_by_index(train, index, spec, where)
    if index is None:
        raise _without_mark(spec, where)
    return numbered_by_index(missing_tooth_steps(time, spec)[0], index, spec, where)


def number_counts(time: Array, spec: TriggerSpec, where: str, index: Array | None) -> PulseTrain:
    """Return the pulses of an encoder whose two tracks show every step; where it stood the way is not proven."""
    time = forward(time, where)
    if index is None:
        raise _without_mark(spec, where)
    stood = np.rint(np.diff(time) / pitch_of(time, spec)) > 1.0
    return numbered_by_index(_train_of(time, np.ones(stood.size, dtype=np.int64), stood, 0, 0), index, spec, where)


def _without_mark(spec: TriggerSpec, where: str) -> Refusal:
    return Refusal(
        f"{where}: a wheel of {spec.pulses_per_rev} pulses per revolution without a mark does not tell which tooth "
        "is at nominal_angle_deg; expected missing_teeth or double_tooth in [trigger], or a channel with "
        'quantity = "index"; where all lobes are alike and have a pulse each, pulses_per_rev = 1 and '
        "revolutions_per_cycle = number of lobes take any of them"
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
    found = resynced(train, np.unique(marks[there]), n, n)
    return replace(found, offset=fraction, offset_std=float(spread / np.sqrt(place.size)), by_index=True)


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
