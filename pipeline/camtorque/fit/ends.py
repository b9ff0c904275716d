"""Where a delivery ends that was not fitted: found by the shape of the line pressure, and how well.

Slope and level of the line pressure around the ends of delivery of fitted recordings are looked for in the other line
pressure. The level tells the first fall from that of the wave which returns. A file with few points is compared at its
points alone: between them it knows nothing. How far all that misses is learnt on the fitted recordings themselves, each
looked for by the others, as coarse as the file is. An end is where the fit knows it to be (`firm_end`). How sharply
delivery ends no line pressure shows: it is what it was in the fitted recordings, as uncertain as it went from one to
another. Few recordings tell a spread poorly: what they tell is widened by Student's factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import stdtrit

from camtorque.fit.draws import Load
from camtorque.fit.firm_end import (
    END_OF,
    WIDTHS_OF,
    Flank,
    Lever,
    combined,
    firm_place,
    flank_of,
    levers_of,
    variance_of,
)
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.uncertainty import COVERAGE
from camtorque.laws import ROWS
from camtorque.laws.chain import ChainInput
from camtorque.records import Array, Estimate, ReadOnly, Refusal
from camtorque.units import DEGREE, RPM

MATCH_WINDOW, MATCH_POINTS = 1.0e-3, 41
"""Time before and after an end of delivery over which the slope of the line pressure is compared [s]; points."""
LEAST_STD, UNKNOWN_STD = np.radians(0.06), np.radians(1.0)
"""Standard deviation of an end found by shape: where the fitted recordings never miss, where none can tell."""
GROWTH_STD = np.radians(1.0)
"""Standard deviation of the growth of misses per ln speed before any was seen: a time of 0.15 ms near 1000 rpm."""
LEAST_ENDS, MOST_ENDS = 3, 12
"""Fitted ends from which misses can be learnt; of more, those nearest in speed teach."""
LEVEL = 2.0
"""Weight of a square difference of level (share of the highest) against one of slope (share of the steepest)."""
FINE_POINTS = 4
"""A file with fewer points within `MATCH_WINDOW` is coarse: it blurs the end of delivery."""
COARSE_WINDOW, COARSE_POINTS = 2.0e-3, 3
"""Time [s], and points of a coarse file if that is more, before and after an end over which its shape is compared."""
SHIFTS = 4
"""Places of the points against the end of delivery with which coarse files are rehearsed."""
MOST_TEMPLATES = 2
"""Fitted recordings, the nearest in speed, whose shapes are looked for."""


@dataclass(frozen=True)
class Curve(ReadOnly):
    """Line pressure over cam angle, (n,) [rad], [Pa], and the speed that it was taken at [rad/s].

    Attributes
    ----------
    step : between the points of a file where it is loaded [rad], 0 for a recording
    points : (k,) angles of a file's points [rad], empty for a recording
    std : (n,) standard uncertainty of the pressure between the points [Pa], empty for a recording
    """

    theta: Array
    pressure: Array
    speed: float
    step: float = 0.0
    points: Array = field(default_factory=lambda: np.zeros(0))
    std: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def fine_step(self) -> float:
        """Distance of points up to which they show the end of delivery as a recording does [rad]."""
        return MATCH_WINDOW * self.speed / FINE_POINTS

    @property
    def coarse(self) -> bool:
        """True for a file whose points blur the end of delivery."""
        return self.step > self.fine_step

    @property
    def coarse_step(self) -> float:
        """Distance of the points of a coarse file [rad], 0 for others."""
        return self.step if self.coarse else 0.0

    def at(self, angles: Array) -> Array:
        """Return the pressure at angles as a share of the highest."""
        return np.interp(angles, self.theta, self.pressure, period=2.0 * np.pi) / np.max(self.pressure)


@dataclass(frozen=True)
class KnownEnd:
    """A fitted end of delivery: its angle [rad], the line pressure around it, how it moves with the fit's values.

    ``moves`` : place in the fit -> weight [rad/SI]
    """

    id: str
    angle: float
    curve: Curve
    moves: Mapping[int, float] = field(default_factory=dict)


def shape_around(curve: Curve, angles: Array) -> Array:
    """Return slope (over its greatest size there) and level of the line pressure around angles, (m, 2 MATCH_POINTS)."""
    places = angles[:, None] + np.linspace(-MATCH_WINDOW, MATCH_WINDOW, MATCH_POINTS) * curve.speed
    slope = np.interp(places, curve.theta, np.gradient(curve.pressure, curve.theta), period=2.0 * np.pi)
    return np.hstack([_shares(slope), np.sqrt(LEVEL) * curve.at(places)])


def _shares(slope: Array) -> Array:
    return np.asarray(slope / (np.max(np.abs(slope), axis=1, keepdims=True) + 1e-12))


def misfit(curve: Curve, ends: Sequence[KnownEnd], rising: Array) -> Array:
    """Return how far a line pressure differs from those around known ends if its own were at each angle, (m,)."""
    if curve.coarse:
        return np.asarray(np.sum([_coarse_misfit(curve, end, rising) for end in ends], axis=0))
    shapes = shape_around(curve, rising)
    known = [shape_around(end.curve, np.array([end.angle])) for end in ends]
    return np.asarray(np.sum([np.sum((shapes - one) ** 2, axis=1) for one in known], axis=0))


def _coarse_misfit(curve: Curve, end: KnownEnd, rising: Array) -> Array:
    reach = max(COARSE_WINDOW * curve.speed, COARSE_POINTS * curve.step)
    offset = np.mod(curve.points - rising[:, None] + np.pi, 2.0 * np.pi) - np.pi
    near = np.abs(offset) <= reach
    kept = np.flatnonzero(near.any(axis=0))
    offset, near = offset[:, kept], near[:, kept]
    pair = near[:, 1:] & near[:, :-1]
    own = np.broadcast_to(curve.at(curve.points[kept]), offset.shape)
    other = end.curve.at(end.angle + offset * end.curve.speed / curve.speed)
    slopes = _shares(np.where(pair, np.diff(own, axis=1), 0.0)) - _shares(np.where(pair, np.diff(other, axis=1), 0.0))
    level = LEVEL * np.sum(near * (own - other) ** 2, axis=1) / np.maximum(np.sum(near, axis=1), 1)
    return np.asarray(level + np.sum(slopes**2, axis=1) / np.maximum(np.sum(pair, axis=1), 1))


def matched_end(known: Sequence[KnownEnd], curve: Curve, rising: Array) -> float:
    """Return the angle at which a line pressure looks as known ones do at their ends [rad].

    Parameters
    ----------
    rising : (m,) angles among which the end is [rad]
    """
    return float(rising[int(np.argmin(misfit(curve, nearest_ends(known, curve.speed), rising)))])


def nearest_ends(known: Sequence[KnownEnd], speed: float) -> list[KnownEnd]:
    """Return the known ends whose shapes are looked for at a speed [rad/s]."""
    return sorted(known, key=lambda end: abs(np.log(end.curve.speed / speed)))[:MOST_TEMPLATES]


def load_for(
    known: KnownFit, source: FittedAt, templates: Mapping[str, Curve], chain: ChainInput, curve: Curve
) -> Load:
    """Return what is known of the load under another line pressure: where and how sharply delivery ends [SI].

    Parameters
    ----------
    source : recording whose structure is that of the run; where no fitted recording has it, places are those at which
        the others end, and how sharply it ends is as unsure as before any fit
    templates : line pressure of every fitted recording, by name

    Raises
    ------
    Refusal : the points of a file are too far apart in time to show an end
    """
    if source.structure not in END_OF:
        return Load({}, curve.std)
    if curve.step > MATCH_WINDOW * curve.speed:
        raise Refusal(
            f"predict: found a pressure file with points {curve.step / DEGREE:.2g} deg apart under load, "
            f"{1e3 * curve.step / curve.speed:.2g} ms at {curve.speed / RPM:.0f} rpm, which do not show where delivery "
            f"ends, expected {1e3 * MATCH_WINDOW:g} ms or closer ({MATCH_WINDOW * curve.speed / DEGREE:.2g} deg); give "
            "more points, or name the recording itself with --load-of"
        )
    flank = flank_of(chain)
    shown = [item for item in known.recordings if item.structure in END_OF and item.id in templates]
    alike = [item for item in shown if item.structure == source.structure]
    teachers = sorted(alike or shown, key=lambda item: abs(np.log(item.speed / curve.speed)))[:MOST_ENDS]
    levers = levers_of(known, source.structure, teachers) if alike else (Lever(teachers[0].structure),)
    tried = [
        _ends_at(known, lever, flank, {item.id: templates[item.id] for item in teachers}, curve) for lever in levers
    ]
    lever, (ends, taught, _) = min(zip(levers, tried, strict=True), key=lambda pair: pair[1][2])
    end = found_end(ends, curve, flank.theta, taught)
    near = nearest_ends(ends, curve.speed)
    if not alike:
        left_open = np.mean([variance_of(known, item.moves) for item in near])
        end = Estimate(end.value, float(np.sqrt(end.stderr**2 + UNKNOWN_STD**2 + left_open)))
    slope = flank.per_angle(source.structure, end.value)
    place = Estimate(flank.place(source.structure, end.value), end.stderr * slope)
    if not alike:
        return Load({END_OF[source.structure]: place, **_usual_widths(source.structure)}, curve.std)
    return _with_widths(known, source, teachers, lever, place, [item.id for item in near], curve.std)


def _ends_at(
    known: KnownFit, lever: Lever, flank: Flank, templates: Mapping[str, Curve], curve: Curve
) -> tuple[list[KnownEnd], Taught | None, float]:
    """Return fitted ends where a lever has them, what they teach, and how far they miss each other [SI^2]."""
    ends, per = [], []
    for recording, one in templates.items():
        place, weights = firm_place(known, lever, recording)
        angle = flank.angle(lever.structure, place)
        per.append(flank.per_angle(lever.structure, angle))
        ends.append(KnownEnd(recording, angle, one, combined([(1.0 / per[-1], weights)])))
    taught = taught_by(known, ends, flank.theta, curve.coarse_step)
    return ends, taught, 0.0 if taught is None else float(taught.rest @ np.square(per))


def _with_widths(
    known: KnownFit, source: FittedAt, teachers: Sequence[FittedAt], lever: Lever, place: Estimate,
    near: Sequence[str], pressure_std: Array,
) -> Load:  # fmt: skip
    """Return the load whose delivery ends at a place as the fit knows it, and as sharply as others of its structure."""
    first, end = WIDTHS_OF[source.structure][0], END_OF[source.structure]
    widths = {name: width for name in WIDTHS_OF[source.structure] if (width := width_of(known, name, teachers))}
    means = {name: weights for name, (_, weights) in widths.items()}
    ends = {name: width for name, (width, _) in widths.items()}
    own = known.own(source.id)
    about = [(1.0 / len(near), firm_place(known, lever, item)[1]) for item in near]
    if first not in own:
        return Load({end: place, **ends}, pressure_std, {end: combined(about), **means})
    sharp = ends[first].value if first in ends else float(known.values[own[first]])
    pull = lever.slope(sharp)
    moved = combined([*about, (pull, means.get(first, {own[first]: 1.0}))])
    begins = Estimate(place.value + lever.shift(sharp), place.stderr)
    return Load({end: begins, **ends}, pressure_std, {end: moved, **means}, {end: (first, pull)})


def _usual_widths(structure: str) -> dict[str, Estimate]:
    """Return how sharply delivery ends before anything is known of it [SI]."""
    return {name: Estimate(*prior) for name in WIDTHS_OF[structure] if (prior := ROWS[name].prior) is not None}


def student(freedom: int) -> float:
    """Return the factor on a standard deviation told by few values, so that `COVERAGE` of it still holds 95 %."""
    return float(stdtrit(freedom, 0.975)) / COVERAGE


def width_of(known: KnownFit, name: str, recordings: Sequence[FittedAt]) -> tuple[Estimate, Mapping[int, float]] | None:
    """Return an own parameter of some recordings as another may have it [SI], and the weights of their places.

    The standard error is their spread less what the fit leaves open of each, which is in the covariance. None where
    fewer than two recordings have the parameter of their own.
    """
    places = [own[name] for item in recordings if name in (own := known.own(item.id))]
    n = len(set(places))
    if n < 2:
        return None
    values, left_open = known.values[places], known.predictive.among(places)
    apart = np.eye(n) - 1.0 / n
    spread = (np.var(values, ddof=1) - np.trace(apart @ left_open) / (n - 1)) * (1.0 + 1.0 / n)
    between = max(float(spread), 0.0)
    weights = 1.0 / (between + np.diag(left_open) + 1e-300)
    weights /= np.sum(weights)
    error = student(n - 1) * float(np.sqrt(between))
    return Estimate(float(weights @ values), error), dict(zip(places, weights.tolist(), strict=True))


def _seen(curve: Curve, step: float) -> list[Curve]:
    """Return a recording's line pressure as files with points so far apart would give it, itself for a step of 0."""
    if not step:
        return [curve]
    first = step * np.arange(SHIFTS) / SHIFTS
    return [replace(curve, step=step, points=np.arange(shift, 2.0 * np.pi, step)) for shift in first]


def away(ends: Sequence[KnownEnd], speed: float) -> float:
    """Return how far a speed [rad/s] lies from those of the ends that are looked for there, in ln speed."""
    return float(np.mean([np.log(speed / end.curve.speed) for end in nearest_ends(ends, speed)]))


@dataclass(frozen=True)
class Taught(ReadOnly):
    """How far the ends of fitted recordings are missed by the others'.

    growth : per ln speed [rad], with its information ``known_growth``; rest : (n,) mean squares of what remains
    [rad^2], ``left_open`` what of it the fit leaves open
    """

    growth: float
    known_growth: float
    rest: Array
    left_open: Array


def taught_by(known: KnownFit, ends: Sequence[KnownEnd], rising: Array, step: float) -> Taught | None:
    """Return what the fitted recordings teach, each left out in turn; None where they are too few.

    ``step`` : of the points of a coarse file, as which they are looked at; 0 for a recording
    """
    n = len(ends)
    if n < LEAST_ENDS:
        return None
    missed, distance, left_open = [], np.zeros(n), np.zeros(n)
    for k, end in enumerate(ends):
        others = [other for other in ends if other is not end]
        missed.append([matched_end(others, seen, rising) - end.angle for seen in _seen(end.curve, step)])
        distance[k] = away(others, end.curve.speed)
        near = nearest_ends(others, end.curve.speed)
        apart = combined([(1.0, end.moves), *((-1.0 / len(near), other.moves) for other in near)])
        left_open[k] = variance_of(known, apart)
    mean, squares = np.mean(missed, axis=1), float(distance @ distance) + 1e-12
    scatter = float(np.sum(np.square(mean - distance * float(distance @ mean) / squares))) / (n - 1) + 1e-12
    known_growth = squares / scatter + 1.0 / GROWTH_STD**2
    growth = float(distance @ mean) / scatter / known_growth
    rest = np.mean(np.square(np.array(missed) - growth * distance[:, None]), axis=1)
    return Taught(growth, known_growth, rest, left_open)


def found_end(ends: Sequence[KnownEnd], curve: Curve, rising: Array, taught: Taught | None) -> Estimate:
    """Return the angle at which delivery ends by shape [rad], as the fitted recordings teach.

    Misses that grow with the distance in speed are taken off; the standard error is that of what remains, less what the
    fit itself leaves open, and of that growth.
    """
    place = matched_end(ends, curve, rising)
    if taught is None:
        return Estimate(place, float(np.sqrt(UNKNOWN_STD**2 + curve.coarse_step**2 / 12.0)))
    freedom, new = len(ends) - 1, away(ends, curve.speed)
    widened = student(freedom) ** 2
    variance = max(widened * float(np.sum(taught.rest - taught.left_open)) / freedom, LEAST_STD**2)
    variance += widened * new**2 / taught.known_growth
    return Estimate(place - taught.growth * new, float(np.sqrt(variance)))
