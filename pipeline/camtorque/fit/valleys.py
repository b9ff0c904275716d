"""Valleys of the residual beside the best minimum: those that no small step leads to, and the bent one that it lies in.

An outlet that opens again at the edge of the land or on the base circle, a suction valve that is there or not, a valve
that retracts much or hardly anything, a shaft that yields or is stiff: each is a valley of its own, and where a search
ends up in the wrong one a sum in another order may decide. Turned round one at a time, with all else where it is, they
cost a descent each.

Trigger angle, friction and drive trade against one another along a bent valley of the residual. Its curvature at one
point tells neither its width nor whether a deeper place lies further on, so it is walked: the angle is held, all else
follows, both halves of the cycles judge. Where the posterior along the walk (profile likelihood; Raue et al.,
Bioinformatics 25 (2009) 1923) is wider than the curvature says, the angle is that uncertain; narrower it may be rugged,
and is not believed.

Of a stiff shaft the torque tells little more than where it rings, which is compliance times inertia: a hyperbola, which
looks narrow where the compliance is at its bound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from camtorque.fit.descent import Effort
from camtorque.fit.minima import Candidate, Halves, at_minimum, beside
from camtorque.fit.problem import FitData, with_rows, with_starts
from camtorque.fit.search import UNSURE
from camtorque.fit.starts import ringing_alike
from camtorque.fit.uncertainty import covariance
from camtorque.laws.rows import ParameterRow
from camtorque.process.second_process import in_two
from camtorque.records import Array, ReadOnly
from camtorque.units import DEGREE

WAYS: dict[str, tuple[float, float]] = {
    "outlet_return": (0.0, 1.0), "suction_area": (0.0, 10.0e-6), "retraction_volume": (1.0e-9, 20.0e-9),
    "valve_damping": (1.0e3, 12.0e3), "valve_mass": (1.5e6, 12.0e6), "valve_area": (1.5e-6, 6.0e-6),
    "valve_exposure": (0.2, 0.9), "line_inertance": (0.0, 18.0e6), "free_air": (0.0, 6.0e-3),
    "drive_bandwidth": (1.5, 5.5), "valve_spring": (3.0e12, 4.0e13),
}  # fmt: skip
"""Parameter -> the two ends between which it is turned [SI], each well inside what literature has of it."""
SHAFTS, CAM_SIDES = (15.0e-6, 150.0e-6), (1.5, 4.0)
"""Compliances between which the shaft is turned [rad/(N m)], the cam's side then so many times the sheet's cam."""
OCTAVES = (0.5, 2.0)
"""Factors at which the coupling's frequency is tried."""
RISEN, CLOSED_BEFORE = 10.0e5, 0.1
"""Pressure at which a chamber has no empty room left [Pa]; share of the lift by which its port has closed before."""
TOO_LIGHT = 1.0
"""Chi-square of a light cam's side (`Candidate.light_cam_penalty`) from which shafts that ring alike are tried."""
GAINED, GAINED_SHARE, TURNED_AGAIN = 0.5, 0.03, 6
"""What a minimum has to gain, and as a share of chi-square; how often all is turned once more from the one that did."""
TRIGGER_ANGLE = "trigger_offset"
COMPLIANCE = "shaft_compliance"
HELD = 1.0e-9
"""Standard deviation of what is held [rad], [rad/(N m)]."""
STEP_SHARE, STEPS_DEG = 0.6, (0.02, 0.3)
"""Step in standard deviations of the angle at the minimum, and its limits [deg]."""
MOST_STEPS, ROUNDS = 14, 3
A_STEP = Effort(12, gain=2.0e-3)
STIFF, FACTOR, MOST_FACTORS = 2.0, 2.0, 7
"""A shaft is stiff whose compliance lies that many standard deviations above its lower bound or less; it is walked by
that factor a step, in so many steps at most."""
WALKED = 9.0
"""Rise of chi-square at which a walk ends: three standard deviations."""
DEEPER = 1.0
"""Fall of chi-square on the walk from which a minimum is sought there; it has to gain `GAINED`."""
E = TypeVar("E")
Changes = Mapping[str, Mapping[str, object]]
Follow = Callable[[E, Changes], tuple[E, float, float] | None]


class HeldValue(NamedTuple, Generic[E]):
    """Value that was held [SI], chi-square there with the priors and without, and the fit, of one recording or many."""

    place: float
    chi_square: float
    data_chi_square: float
    end: E


def starts_turned_round(best: Candidate) -> list[FitData]:
    """Return starts with one thing the other way round where doubt is left, and heavier cams where one is asked for."""
    data, found = best.data, []
    if best.left_to_explain > UNSURE:
        found = [{name: other_end(data, name, ends)} for name, ends in WAYS.items() if best.problem.index(name) >= 0]
        found += [*driveline_turned(data), *port_turned(best)]
    if best.light_cam_penalty > TOO_LIGHT:
        found += ringing_alike(data)
    return [with_starts(data, values) for values in found]


def other_end(data: FitData, name: str, ends: tuple[float, float]) -> float:
    """Return the end that a parameter is farther from."""
    low, high = ends
    value = data.rows[name].start
    return high if abs(value - low) < abs(value - high) else low


def port_turned(best: Candidate) -> list[dict[str, float]]:
    """Return a port that closes where the pressure rises, for one that closed long before a chamber left half empty.

    Filled on the base circle alone or through a port up to there: the torque is all but the same.
    """
    chain, output = best.data.chain, best.solution.output
    if not chain.uses_chamber:
        return []
    rising = slice(0, int(np.argmax(output.motion.lift[0][: chain.theta.size // chain.lobes])))
    risen = output.motion.lift[0][rising][output.pressure[rising] > RISEN]
    lift, closing = float(np.min(risen, initial=chain.top_lift)), best.data.rows["port_closing_lift"].start
    if lift - closing < CLOSED_BEFORE * chain.top_lift or lift == chain.top_lift:
        return []
    return [{"port_closing_lift": lift, "suction_area": 0.0}]


def driveline_turned(data: FitData) -> list[dict[str, float]]:
    """Return a stiff shaft for one that yields, or the other way, with likely cams, and the coupling an octave off."""
    yielding = other_end(data, "shaft_compliance", SHAFTS)
    inertias = data.chain.pump.cam_inertia * np.array(CAM_SIDES)
    shafts = [
        {"shaft_compliance": yielding, "shaft_resonance": float(1.0 / np.sqrt(yielding * inertia))}
        for inertia in inertias
    ]
    swings = data.rows["coupling_resonance"].start
    return [*shafts, *({"coupling_resonance": swings * factor} for factor in OCTAVES)]


def turned_round(minima: Sequence[Candidate], halves: Halves) -> list[Candidate]:
    """Return minima, the best one first, with those reached by turning things round one at a time, again from the best.

    All are minima on the fine grid, judged.
    """
    found = [minima[0]]
    for _ in range(TURNED_AGAIN):
        before = found[0]
        effort = replace(beside(before.value), basin=before.basin)
        follow = partial(at_minimum, effort=effort, lift=before.solution.lift)
        ends = in_two(partial(halves.minimum, follow), starts_turned_round(before))
        others = (end for end in ends if end and not before.basin.holds(end.solution))
        found = sorted([*found, *others], key=lambda item: item.value)
        if found[0] is before:
            break
        found[0] = halves.again(found[0])
        if found[0].value > before.value - max(GAINED, GAINED_SHARE * before.value):
            break
    return sorted([*found, *minima[1:]], key=lambda item: item.value)


@dataclass(frozen=True)
class Valley(ReadOnly):
    """Values of a parameter that were held (m,) [SI] with what they cost, and its value at the best minimum [SI].

    ``chi_square`` is that of the residual on both halves of the cycles, ``prior`` that of all parameters, (m,) each.
    """

    places: Array
    chi_square: Array
    prior: Array
    at: float

    def std(self, inflation: float) -> float:
        """Return the root mean square distance from the minimum under the posterior along the valley [SI].

        It is nan where the valley was not walked. ``inflation``: factor on the residual's variance.
        """
        if self.places.size < 3:
            return float("nan")
        between = np.linspace(self.places[0], self.places[-1], 50 * self.places.size)
        chi = np.interp(between, self.places, self.chi_square / inflation + self.prior)
        weight = np.exp(-0.5 * (chi - np.min(chi)))
        return float(np.sqrt(np.sum(weight * (between - self.at) ** 2) / np.sum(weight)))


NO_VALLEY = Valley(np.zeros(0), np.zeros(0), np.zeros(0), float("nan"))
"""Of a minimum that nobody walked from."""


def profile_trigger_angle(best: Candidate, halves: Halves) -> tuple[Candidate, Valley]:
    """Return the deepest minimum of the valley that a minimum lies in, and the valley.

    ``best`` is a minimum on the fine grid, judged.
    """
    for _ in range(ROUNDS):
        points = _walked(best, halves)
        deepest = min(points, key=lambda point: point.chi_square)
        if deepest.chi_square > best.value - DEEPER:
            break
        prior = best.data.rows[TRIGGER_ANGLE].prior
        freed = halves.minimum(at_minimum, with_rows(deepest.end.data, {TRIGGER_ANGLE: {"prior": prior}}))
        if freed is None or freed.value > best.value - GAINED:
            break
        best = freed
    return best, _valley(_unheld(best, TRIGGER_ANGLE).place, points)


def softer_shaft(best: Candidate, halves: Halves) -> Candidate | None:
    """Return the fit with a stiff shaft that is more compliant by the deviation of the valley from its value up.

    It is None of a shaft that yields enough, and where the valley leads nowhere.
    """
    index = best.problem.index(COMPLIANCE)
    if index < 0:
        return None
    cov = covariance(best.problem, best.solution)
    row = best.data.rows[COMPLIANCE]
    return softer(_unheld(best, COMPLIANCE), row, float(cov.std[index]), cov.inflation, partial(_follow, best, halves))


def softer(
    stiff: HeldValue[E],
    row: ParameterRow,
    std: float,
    inflation: float,
    follow: Follow[E],
) -> E | None:
    """Return the fit with a shaft that is more compliant by the deviation of the valley, None as in `softer_shaft`.

    Parameters
    ----------
    stiff : the minimum, whose compliance is free
    row, std, inflation : of the compliance, its standard deviation there [SI], and that of the residual's variance
    follow : as in `held_at`
    """
    if stiff.place > row.lower + STIFF * std:
        return None
    places = np.asarray(stiff.place * FACTOR ** np.arange(1.0, MOST_FACTORS + 1.0), dtype=np.float64)
    ends = held_at(row, places[places < row.upper], stiff.end, follow)
    points = [stiff, *_until_risen(ends, stiff.chi_square, WALKED * inflation)]
    yielding = stiff.place + _valley(stiff.place, points).std(inflation)
    if not np.isfinite(yielding):
        return None
    nearest = max((point for point in points if point.place <= yielding), key=lambda point: point.place)
    return next((point.end for point in held_at(row, np.array([yielding]), nearest.end, follow)), None)


def _valley(at: float, points: Sequence[HeldValue[E]]) -> Valley:
    places, values, of_data = np.array([point[:3] for point in points]).T
    return Valley(places, of_data, values - of_data, at)


def _unheld(best: Candidate, name: str) -> HeldValue[Candidate]:
    """Return a minimum as the value that a parameter has there, which nothing holds."""
    return HeldValue(float(best.solution.z[best.problem.index(name)]), best.value, best.data_value, best)


def _walked(best: Candidate, halves: Halves) -> list[HeldValue[Candidate]]:
    """Return all points in order."""
    index = best.problem.index(TRIGGER_ANGLE)
    cov = covariance(best.problem, best.solution)
    std = float(cov.std[index])
    step = min(max(STEP_SHARE * std, STEPS_DEG[0] * DEGREE), STEPS_DEG[1] * DEGREE)
    points, rise = [_unheld(best, TRIGGER_ANGLE)], WALKED * cov.inflation
    for walked in in_two(partial(_one_way, best, halves, rise), (step, -step)):
        points += _until_risen(walked, min(point.chi_square for point in points), rise)
    return sorted(points, key=lambda point: point.place)


def _until_risen(points: Iterable[HeldValue[E]], least: float, rise: float) -> list[HeldValue[E]]:
    """Return points up to the first whose chi-square is that far above the least of them and what was the least."""
    kept = []
    for point in points:
        kept.append(point)
        least = min(least, point.chi_square)
        if point.chi_square > least + rise:
            break
    return kept


def _one_way(best: Candidate, halves: Halves, rise: float, step: float) -> list[HeldValue[Candidate]]:
    """Return steps away from a minimum until chi-square has risen."""
    row = best.data.rows[TRIGGER_ANGLE]
    places = float(best.solution.z[best.problem.index(TRIGGER_ANGLE)]) + step * np.arange(1.0, MOST_STEPS + 1.0)
    inside = places[(row.lower <= places) & (places <= row.upper)]
    return _until_risen(held_at(row, inside, best, partial(_follow, best, halves)), best.value, rise)


def held_at(row: ParameterRow, places: Array, near: E, follow: Follow[E]) -> Iterator[HeldValue[E]]:
    """Yield fits with a parameter held at some places [SI], each from the one before.

    ``follow``: a fit and what is held of it -> the next one with its chi-squares, None where it ends nowhere.
    """
    mean, std = row.prior or (0.0, np.inf)
    for place in places.tolist():
        found = follow(near, {row.name: {"start": place, "prior": (place, HELD)}})
        if found is None:
            return
        near, chi_square, of_data = found
        yield HeldValue(place, chi_square + ((place - mean) / std) ** 2, of_data, near)


def _follow(best: Candidate, halves: Halves, near: Candidate, there: Changes) -> tuple[Candidate, float, float] | None:
    """Return the fit with something held from the one near it, with the lift correction of the minimum."""
    end = halves.minimum(at_minimum, with_rows(near.data, there), A_STEP, best.solution.lift)
    return None if end is None else (end, end.value, end.data_value)
