"""How a delivery ends that was not fitted: by which port, where and how sharply, and how well that is known.

The shapes around the ends of delivery of fitted recordings are looked for in the other line pressure. How far that
misses is learnt on the fitted recordings themselves, each looked for by the others, as coarse in time as a file is.
Ends and shapes are those of `known_ends`. How sharply delivery ends no line pressure shows: it is what it was in the
fitted recordings, as uncertain as it went from one to another. Few recordings tell a spread poorly: what they tell is
widened by Student's factor.

A line pressure falls alike after a land and a spill port, but on the return stroke a chamber that a land has closed is
squeezed out and a chamber that a spill port has opened is not. Who gives a load may say which it is; else it is what it
was in all fitted recordings, and where these differ, nobody knows: then bands hold both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from camtorque.config.pump import PressureCurve
from camtorque.fit.forecast import Forecast, OtherEnding
from camtorque.fit.known_ends import (
    END_OF,
    MATCH_WINDOW,
    WIDTHS_OF,
    Curve,
    EndTradeOff,
    KnownEnd,
    RisingFlank,
    combined,
    firm_place,
    flank_of,
    ln_speed_from,
    matched_end,
    nearest_ends,
    trade_offs_of,
    variance_of,
)
from camtorque.fit.known_fit import FittedAt, KnownFit, LoadKnowledge
from camtorque.laws import ROWS
from camtorque.laws.chain import ChainInput
from camtorque.mechanism.predict import pressure_at
from camtorque.records import Array, Estimate, ReadOnly, Refusal
from camtorque.units import COVERAGE, DEGREE, RPM, TURN

LEAST_STD, UNKNOWN_STD = np.radians(0.06), np.radians(1.0)
"""Standard deviation of an end found by shape: where the fitted recordings never miss, where none can tell."""
GROWTH_STD = np.radians(1.0)
"""Standard deviation of the growth of misses per ln speed before any was seen: a time of 0.15 ms near 1000 rpm."""
LEAST_ENDS, MOST_ENDS = 3, 12
"""Fitted ends from which misses can be learnt; of more, those nearest in speed teach."""
SHIFTS = 4
"""Places of the points against the end of delivery with which files are rehearsed."""
EITHER = "either"
ENDINGS = (*END_OF, EITHER)
"""What may be asked for."""


def load_for(
    known: KnownFit, source: FittedAt, templates: Mapping[str, Curve], chain: ChainInput, curve: Curve
) -> LoadKnowledge:
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
        return LoadKnowledge({}, curve.std)
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
    trade_offs = trade_offs_of(known, source.structure, teachers) if alike else (EndTradeOff(teachers[0].structure),)
    shapes = {item.id: templates[item.id] for item in teachers}
    tried = [_ends_at(known, trade_off, flank, shapes) for trade_off in trade_offs]
    trade_off, (ends, learned, _) = min(zip(trade_offs, tried, strict=True), key=lambda pair: pair[1][2])
    learned = learned_from(known, ends, flank.theta, curve.pause) if curve.pause else learned
    end = found_end(ends, curve, flank.theta, learned)
    near = nearest_ends(ends, curve.speed)
    if not alike:
        left_open = np.mean([variance_of(known, item.moves) for item in near])
        end = Estimate(end.value, float(np.sqrt(end.stderr**2 + UNKNOWN_STD**2 + left_open)))
    slope = flank.per_angle(source.structure, end.value)
    place = Estimate(flank.place(source.structure, end.value), end.stderr * slope)
    if not alike:
        priors = {name: ROWS[name].prior for name in WIDTHS_OF[source.structure]}
        usual = {name: Estimate(*prior) for name, prior in priors.items() if prior is not None}
        return LoadKnowledge({END_OF[source.structure]: place, **usual}, curve.std)
    return _with_widths(known, source, teachers, trade_off, place, [item.id for item in near], curve.std)


def _ends_at(
    known: KnownFit, trade_off: EndTradeOff, flank: RisingFlank, templates: Mapping[str, Curve]
) -> tuple[list[KnownEnd], EndErrorModel | None, float]:
    """Return fitted ends where a trade-off has them, what they teach, and how far they miss each other [SI^2]."""
    ends, per = [], []
    for recording, one in templates.items():
        place, weights = firm_place(known, trade_off, recording)
        angle = flank.angle(trade_off.structure, place)
        per.append(flank.per_angle(trade_off.structure, angle))
        ends.append(KnownEnd(recording, angle, one, combined([(1.0 / per[-1], weights)])))
    learned = learned_from(known, ends, flank.theta, 0.0)
    return ends, learned, 0.0 if learned is None else float(learned.rest @ np.square(per))


def _with_widths(
    known: KnownFit, source: FittedAt, teachers: Sequence[FittedAt], trade_off: EndTradeOff, place: Estimate,
    near: Sequence[str], pressure_std: Array,
) -> LoadKnowledge:  # fmt: skip
    """Return the load whose delivery ends at a place as the fit knows it, and as sharply as others of its structure."""
    first, end = WIDTHS_OF[source.structure][0], END_OF[source.structure]
    widths = {name: width for name in WIDTHS_OF[source.structure] if (width := width_of(known, name, teachers))}
    means = {name: weights for name, (_, weights) in widths.items()}
    ends = {name: width for name, (width, _) in widths.items()}
    own = known.own(source.id)
    about = [(1.0 / len(near), firm_place(known, trade_off, item)[1]) for item in near]
    if first not in own:
        return LoadKnowledge({end: place, **ends}, pressure_std, {end: combined(about), **means})
    sharp = ends[first].value if first in ends else float(known.values[own[first]])
    pull = trade_off.slope(sharp)
    moved = combined([*about, (pull, means.get(first, {own[first]: 1.0}))])
    begins = Estimate(place.value + trade_off.shift(sharp), place.stderr)
    return LoadKnowledge({end: begins, **ends}, pressure_std, {end: moved, **means}, {end: (first, pull)})


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


def _seen(curve: Curve, pause: float) -> list[Curve]:
    """Return a recording's line pressure as files with such a time between points would give it, itself for 0."""
    if not pause:
        return [curve]
    step, found = pause * curve.speed, []
    for shift in step * np.arange(SHIFTS) / SHIFTS:
        points = np.arange(shift, TURN, step)
        file = PressureCurve(points, np.interp(points, curve.theta, curve.pressure, period=TURN))
        found.append(replace(curve, pressure=pressure_at(file, curve.theta), step=step, points=points))
    return found


@dataclass(frozen=True)
class EndErrorModel(ReadOnly):
    """How far the ends of fitted recordings are missed by the others'.

    growth : per ln speed [rad], with its information ``known_growth``; rest : (n,) mean squares of what remains
    [rad^2], ``left_open`` what of it the fit leaves open
    """

    growth: float
    known_growth: float
    rest: Array
    left_open: Array


def learned_from(known: KnownFit, ends: Sequence[KnownEnd], rising: Array, pause: float) -> EndErrorModel | None:
    """Return what the fitted recordings teach, each left out in turn; None where they are too few.

    ``pause`` : time between the points of a file, as which they are looked at [s]; 0 for a recording
    """
    n = len(ends)
    if n < LEAST_ENDS:
        return None
    missed, distance, left_open = [], np.zeros(n), np.zeros(n)
    for k, end in enumerate(ends):
        others = [other for other in ends if other is not end]
        missed.append([matched_end(others, seen, rising).angle - end.angle for seen in _seen(end.curve, pause)])
        distance[k] = ln_speed_from(others, end.curve.speed)
        near = nearest_ends(others, end.curve.speed)
        apart = combined([(1.0, end.moves), *((-1.0 / len(near), other.moves) for other in near)])
        left_open[k] = variance_of(known, apart)
    mean, squares = np.mean(missed, axis=1), float(distance @ distance) + 1e-12
    scatter = float(np.sum(np.square(mean - distance * float(distance @ mean) / squares))) / (n - 1) + 1e-12
    known_growth = squares / scatter + 1.0 / GROWTH_STD**2
    growth = float(distance @ mean) / scatter / known_growth
    rest = np.mean(np.square(np.array(missed) - growth * distance[:, None]), axis=1)
    return EndErrorModel(growth, known_growth, rest, left_open)


def found_end(ends: Sequence[KnownEnd], curve: Curve, rising: Array, learned: EndErrorModel | None) -> Estimate:
    """Return the angle at which delivery ends by shape [rad], as the fitted recordings teach.

    Misses that grow with the distance in speed are taken off; the standard error is that of what remains, less what the
    fit itself leaves open, and of that growth.
    """
    match, coarse = matched_end(ends, curve, rising), curve.coarse * curve.step
    if learned is None:
        return Estimate(match.angle, float(np.sqrt(UNKNOWN_STD**2 + coarse**2 / 12.0 + match.variance)))
    freedom, new = len(ends) - 1, ln_speed_from(ends, curve.speed)
    widened = student(freedom) ** 2
    seen = widened * float(np.sum(learned.rest - learned.left_open)) / freedom
    variance = max(seen, match.variance, LEAST_STD**2)
    variance += widened * new**2 / learned.known_growth
    return Estimate(match.angle - learned.growth * new, float(np.sqrt(variance)))


def endings_of(known: KnownFit, speed: float, asked: str) -> tuple[FittedAt, ...]:
    """Return a fitted recording to stand in for each way in which a given load may have ended, the likeliest first.

    Parameters
    ----------
    asked : one of `ENDINGS`; empty: as the fitted recordings, both where these differ

    Raises
    ------
    Refusal : another word, or no fitted recording shows an end of delivery
    """
    if asked and asked not in ENDINGS:
        raise Refusal(f"ending: found {asked!r}, expected one of {', '.join(ENDINGS)}")
    nearest = known.nearest(speed)
    if not asked and nearest.structure not in END_OF:
        return (nearest,)
    shown = {item.structure for item in known.recordings if item.structure in END_OF}
    if not shown:
        raise Refusal(
            f"ending: found {asked}, but no fitted recording shows where delivery ends, expected one that does; leave "
            "the ending out"
        )
    both = sorted(END_OF, key=lambda structure: structure != nearest.structure)
    wanted = [asked] if asked in END_OF else both if asked or len(shown) > 1 else [nearest.structure]
    return tuple(_ending_by(known, speed, structure) for structure in wanted)


def own_ending(known: KnownFit, name: str) -> str:
    """Return how delivery of the fitted recording of a name ends, empty where none has it or shows an end."""
    return next((item.structure for item in known.recordings if item.id == name and item.structure in END_OF), "")


def the_other(known: KnownFit, source: FittedAt, speed: float) -> FittedAt:
    """Return a fitted recording to stand in for the ending that ``source`` does not have."""
    return _ending_by(known, speed, next(structure for structure in END_OF if structure != source.structure))


def _ending_by(known: KnownFit, speed: float, structure: str) -> FittedAt:
    """Return the fitted recording nearest in speed of those that end so, or of all as if it did."""
    return replace(known.nearest(speed, structure), structure=structure)


def either(one: Forecast, other: Forecast) -> Forecast:
    """Return a run of which it cannot be decided which of two it is.

    Its curves lie midway between both bands, its bands hold both.
    """
    torque, torque_std = holding(one.torque, one.torque_std, other.torque, other.torque_std)
    pressure, pressure_std = holding(one.pressure, one.pressure_std, other.pressure, other.pressure_std)
    contact, contact_std = holding(one.contact, one.contact_std, other.contact, other.contact_std)
    volume, volume_std = holding(one.delivered, one.delivered_std, other.delivered, other.delivered_std)
    mean = [float(np.mean(item.torque)) for item in (one, other)]
    causes = {
        name: holding(value, one.by_cause_std[name], other.by_cause[name], other.by_cause_std[name])
        for name, value in one.by_cause.items()
    }
    return replace(
        one, torque=torque, torque_std=torque_std, pressure=pressure, pressure_std=pressure_std, contact=contact,
        shape_std=_reach(torque, (one.torque, one.shape_std), (other.torque, other.shape_std)),
        mean_std=float(_reach(float(np.mean(torque)), (mean[0], one.mean_std), (mean[1], other.mean_std))),
        contact_std=contact_std, delivered=float(volume), delivered_std=float(volume_std),
        by_cause={name: causes[name][0] for name in one.by_cause},
        by_cause_std={name: causes[name][1] for name in one.by_cause}, ending=EITHER, both=(one, other),
        steps=one.steps or other.steps,
    )  # fmt: skip


def holding(
    one: Array | float, std: Array | float, other: Array | float, other_std: Array | float
) -> tuple[Array, Array]:
    """Return the middle of both 95 % bands together, and the standard uncertainty of which half of that width is."""
    low = np.minimum(one - COVERAGE * std, other - COVERAGE * other_std)
    high = np.maximum(one + COVERAGE * std, other + COVERAGE * other_std)
    return 0.5 * (low + high), 0.5 * (high - low) / COVERAGE


def _reach(middle: Array | float, *bands: tuple[Array | float, Array | float]) -> Array:
    """Return the standard uncertainty with which a band about ``middle`` holds some bands (value, standard error)."""
    ends = [np.abs(middle - value) / COVERAGE + std for value, std in bands]
    return np.asarray(np.max(ends, axis=0))


MOST_PRESSED = 4.0e8
"""Chamber pressure that no injection pump holds [Pa]: an outlet that closes far below full lift asks for more."""


def if_it_ended_so(item: Forecast, other: Forecast) -> OtherEnding | None:
    """Return by how much the torque would differ at most with the other ending.

    None where the band holds it, or where no pump would hold the pressure that it makes.
    """
    apart = other.torque - item.torque
    if np.all(np.abs(apart) < COVERAGE * item.torque_std) or np.max(other.pressure) > MOST_PRESSED:
        return None
    place = int(np.argmax(np.abs(apart)))
    return OtherEnding(other.ending, float(apart[place]), float(item.theta[place]))
