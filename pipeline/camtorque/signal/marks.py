"""What tells a trigger that does not give one pulse per turn of the cam: unequal marks, turns that do not repeat."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array, Integers
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import DEGREE, TURN

EVEN = Threshold(
    0.4, "1", "physics",
    "Share of the shorter of two neighbouring periods from which they are turns of a shaft that runs unevenly."
)  # fmt: skip
SAME_SHARE = Threshold(
    0.02, "1", "simulated rigs", "Two marks part a revolution alike in every turn, by this share of it."
)  # fmt: skip
TOLD_APART = Threshold(
    0.08, "1", "convention",
    "Two marks nearer to each other than this share of a turn (29 degrees) tell no wheel: the next is as near."
)  # fmt: skip
NEAREST = Threshold(1.0 / 3.0, "1", "convention", "Nearer than this part of the way to the next number of teeth.")
MOSTLY = Threshold(0.8, "1", "convention", "So many of the turns do: a pulse that is missing spoils two.")
LEAST_PERIODS = Count(6, "1", "convention", "Three turns of two pulses.")

MOST_REVOLUTIONS = Count(8, "1", "convention", "Gears between a motor or crank and a pump are lower.")
UNLIKE = Threshold(
    0.1, "1", "simulated rigs",
    "Mean square difference of neighbouring revolutions, relative to that of two chance ones, above which they are "
    "not of one kind; cycles of sound pumps lie below 0.001."
)  # fmt: skip
ALIKE = Threshold(
    0.1, "1", "simulated rigs",
    "Part of that difference below which revolutions some turns apart are of one kind again."
)  # fmt: skip
LEAST_REPEATS = 2
"""Pairs of like revolutions that are needed."""
STRAY_PERCENT = (2.0, 98.0)
"""Percentiles of all samples beyond which a few are strays; what a pump does lasts longer."""


def two_marks(times: Array) -> float:
    """Return the shorter of two unequal distances at which pulses stand in turn, as a share of a revolution, else 0.

    Parameters
    ----------
    times : (n,) of the pulses [s]
    """
    periods = np.diff(times)
    if periods.size < LEAST_PERIODS:
        return 0.0
    first = periods[:-1] / (periods[:-1] + periods[1:])
    shares = np.minimum(first, 1.0 - first)
    share = float(np.median(shares))
    return 0.0 if share > EVEN or np.mean(np.abs(shares - share) < SAME_SHARE) < MOSTLY else share


def pitches_of(share: float) -> int:
    """Return of how many teeth a wheel is whose two neighbours stand a share of a revolution apart, 0 if of none.

    Two marks at 54 degrees are none of 7 teeth: their second one would put the cam 2.6 degrees off in every turn.
    """
    pitches = round(1.0 / share)
    reach = min(float(SAME_SHARE), NEAREST * (1.0 / pitches - 1.0 / (pitches + 1.0)))
    return pitches if share >= TOLD_APART and abs(share - 1.0 / pitches) <= reach else 0


def uneven_marks(times: Array) -> str:
    """Return what to write where pulses (n,) [s] stand at two unequal distances in turn, empty where they do not."""
    share = two_marks(times)
    if not share:
        return ""
    short, pitches = share * TURN / DEGREE, pitches_of(share)
    seen = f"the pulses stand {short:.0f} and {360.0 - short:.0f} deg apart in turn: two marks on one shaft"
    if not pitches:
        why = "at no whole part of a revolution" if share >= TOLD_APART else "too near each other to tell a wheel"
        return f"{seen}, {why}; take one away, or set it 60 deg after the other"
    return (
        f"{seen}; write pulses_per_rev = {pitches}, missing_teeth = {pitches - 2} under [trigger], nominal_angle_deg "
        "is that of the first after the long way"
    )


def other_gap(step: Integers) -> str:
    """Return what to write where a wheel has another gap than the declared one, empty where none comes again and again.

    ``step`` are the whole pitches since the first pulse, (n,).
    """
    apart = np.diff(step)
    gap = int(np.median(apart[apart > 1])) if np.any(apart > 1) else 0
    turns = np.diff(step[1:][apart == gap])
    usual = int(np.median(turns)) if turns.size >= LEAST_PERIODS else 0
    if not usual or np.mean(turns == usual) < MOSTLY:
        return ""
    return f"found {gap - 1} missing once in {usual}: write missing_teeth = {gap - 1}, pulses_per_rev = {usual}; else "


def repeats_every(rows: Array) -> int:
    """Return the number of revolutions after which a signal repeats, 1 where each is like the next or none is.

    ``rows`` are the signal of successive revolutions, (n_revolutions, n_points); nan where there is none.
    """
    rows = rows[:, np.isfinite(rows).any(axis=0)]
    whole = np.asarray(np.isfinite(rows).all(axis=1))
    if whole.sum() < 2 + LEAST_REPEATS or not rows.size:
        return 1
    rows = np.clip(rows, *np.percentile(rows[whole], STRAY_PERCENT))
    chance = 2.0 * float(np.mean(np.var(rows[whole], axis=1) + np.var(rows[whole].mean(axis=1))))

    def difference(apart: int) -> float:
        pairs = whole[apart:] & whole[:-apart]
        squares = np.mean((rows[apart:] - rows[:-apart])[pairs] ** 2, axis=1)
        return float(np.median(squares)) if squares.size >= LEAST_REPEATS else np.inf

    neighbours = difference(1)
    if not np.isfinite(neighbours) or neighbours < UNLIKE * chance:
        return 1
    apart = (n for n in range(2, MOST_REVOLUTIONS + 1) if difference(n) < ALIKE * neighbours)
    return next(apart, 1)
