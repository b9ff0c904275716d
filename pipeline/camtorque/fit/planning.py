"""What to record next: what a second tooth or another speed would narrow, and the cheapest runs to one wanted number.

A run's expected information is J' W J at the values of the fit, its own zeros and end of delivery and the error of the
lift table integrated out, with the weights that it would have: scatter of as many cycles as it lasts, and the error of
the laws. That and the table's are the same in all runs and therefore count as often as there are runs: the fitted ones
tell less beside another one. Runs are chosen one by one, the most gain per minute first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.forecast import settled, values_of
from camtorque.fit.joint_input import common_error
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.prepare import bin_weights
from camtorque.fit.problem import SEPARATOR
from camtorque.fit.single import Fit
from camtorque.fit.solver import lift_columns, lift_modes, normal_equations
from camtorque.fit.teeth import PLACE_STD
from camtorque.fit.uncertainty import inverse
from camtorque.fit.valleys import TRIGGER_ANGLE
from camtorque.laws import ROWS
from camtorque.laws.chain import BINS, SHIFT_NAMES, ChainInput, ChainOutput, coefficients_of, derivative_by, evaluate
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.lift import LiftCorrection
from camtorque.records import Array, ReadOnly

TOOTH_ANGLE = np.radians(60.0)
TOOTH = "a second tooth 60 degrees after the first (pulses_per_rev = 6, missing_teeth = 4)"
"""The tooth with the keys that describe two teeth in place of one."""
SPEED_FACTORS = (0.6, 1.6)
WORTH = 0.85
"""A proposal is told when it brings a standard uncertainty below this share of today's."""
OUTCOMES = ("trigger_offset", "dead_volume", "leakage", "bearing_arm", "shaft_compliance", "shaft_viscous")
SETUP_MINUTES, TOOTH_MINUTES = 10.0, 45.0
"""What it costs to set a point and to fit a second tooth."""
ROUNDING = 1.0e-6
"""Share by which the information of a sum may fall short of its part."""
MOST_RUNS = 6
AS_GOOD = 1.01
"""An uncertainty of so many times what is wanted is as good: it is printed with two digits."""
LEAST_GAIN = 0.02
"""A run that narrows the number by less than this share for what one setting of the bench costs is not worth making."""


def next_measurement(fit: Fit, has_teeth: bool = False) -> tuple[str, ...]:
    """Return proposals for the next recording, each with what it is expected to bring.

    ``has_teeth``: more than one pulse tells a turn of the cam already, or its angle was recorded.
    """
    names = fit.problem.names
    watched = [name for name in OUTCOMES if name in names]
    today = fit.std
    # other laws and structures, the trigger's switching: no run narrows these
    rest = fit.unbounded_std**2 - fit.covariance.std**2
    texts = []
    for title, matrix in proposals(fit):
        if title == TOOTH and has_teeth:
            continue
        after = np.sqrt(np.maximum(np.diag(matrix), 0.0) + rest)
        gains = sorted((float(after[names.index(n)] / today[names.index(n)]), n) for n in watched)
        told = [f"{name.replace('_', ' ')} to {100.0 * share:.0f} %" for share, name in gains if share < WORTH]
        if told:
            texts.append(f"{title} would reduce the uncertainty of {', '.join(told[:3])} of the present one")
    return tuple(texts)


def proposals(fit: Fit) -> list[tuple[str, Array]]:
    """Return what could be recorded next and the covariance expected after it."""
    information = inverse(fit.covariance.matrix)
    turned = tooth_shifts(fit.problem.data[0].chain, fit.solution.output)
    row = np.array([turned.get(parameter.row.name, 0.0) for parameter in fit.problem.parameters])
    result = [(TOOTH, inverse(information + np.outer(row, row) / PLACE_STD**2))]
    alone = _one_of_two(fit, 1.0) + np.diag(1.0 / fit.covariance.prior_std**2)
    for factor in SPEED_FACTORS:
        rpm = fit.problem.data[0].chain.speed * factor * 30.0 / np.pi
        total = _joined(fit, alone, factor)
        # a run takes no knowledge away: where it does, a tangent ran away there and the sums are rounding
        if np.all(np.diag(total) > (1.0 - ROUNDING) * np.diag(alone)):
            result.append((f"the same load at {rpm:.0f} rpm, fitted jointly,", inverse(total)))
    return result


def tooth_shifts(chain: ChainInput, output: ChainOutput) -> dict[str, float]:
    """Return by how much each parameter of the driveline turns a second tooth against the first [rad/SI]."""
    place, columns = np.mod(chain.trigger_angle + TOOTH_ANGLE, 2.0 * np.pi), output.motion.shifts[0].T
    return {
        name: float(np.interp(place, chain.theta, column, period=2.0 * np.pi))
        for name, column in zip(SHIFT_NAMES, columns, strict=True)
        if name != "trigger_offset"
    }


def _joined(fit: Fit, alone: Array, factor: float) -> Array:
    """Return the information after a further recording at another speed, its own parameters apart.

    Both are weighed as one of two: the error of laws and lift table is the same in them. ``alone``: before it.
    """
    before, added = fit.covariance.prior_std, _one_of_two(fit, factor)
    own = np.array([parameter.row.role == "own" for parameter in fit.problem.parameters])
    block = added[np.ix_(own, own)] + np.diag(1.0 / before[own] ** 2)
    shared = np.ix_(~own, ~own)
    cross = added[np.ix_(~own, own)]
    total = alone.copy()
    total[shared] += added[shared] - cross @ np.linalg.solve(block, cross.T)
    return total


def _one_of_two(fit: Fit, factor: float) -> Array:
    """Return what the recording would tell at so many times its speed as one of two that are fitted together."""
    item = common_error(fit.problem.data[0], 2)
    moved = replace(item, chain=replace(item.chain, speed=item.chain.speed * factor))
    problem = replace(fit.problem, data=(moved,))
    values, _ = problem.values(fit.solution.z, 0)
    lift = lift_modes(moved, fit.solution.output, values, math.sqrt(2.0))
    scaled, _, _ = normal_equations(problem, fit.solution.z, fit.solution.residual, lift)
    # a joint fit does not count a residual for less than its weights
    return scaled / np.outer(problem.steps, problem.steps) / max(fit.covariance.inflation, 1.0)


@dataclass(frozen=True)
class OperatingPoint(ReadOnly):
    """One speed and load: columns by shared parameters, by prior deviations of own ones and lift, twist at a tooth."""

    speed: float
    load: str
    torque: Array
    shared: Array
    own: Array
    tooth: Array
    scatter: float
    lift: Array


@dataclass(frozen=True)
class Offer:
    """A run that could be made: speed and load, duration [s], a second tooth or not."""

    point: OperatingPoint
    duration: float
    tooth: bool


@dataclass(frozen=True)
class TargetQuantity(ReadOnly):
    """A number of a fit: gradient by its parameters (k,), and the part of its uncertainty that no run narrows [SI].

    That part is what the report states beside the covariance of the fit: other structures and laws, the sensor's gain.
    """

    gradient: Array
    rest: float = 0.0

    def std(self, covariance: Array) -> float:
        """Return its standard uncertainty with a covariance of the parameters, (k, k)."""
        return float(np.sqrt(self.gradient @ covariance @ self.gradient + self.rest**2))


@dataclass(frozen=True)
class Step:
    """A run with what it costs and the standard uncertainty expected after it and those before it."""

    offer: Offer
    minutes: float
    std: float


@dataclass(frozen=True)
class Measuring:
    """How well a bench measures.

    Attributes
    ----------
    scatter : standard deviation of one cycle's torque [N m]
    own_std : own parameter of a run, such as its zero -> standard uncertainty beforehand [SI]
    """

    scatter: float
    own_std: Mapping[str, float]

    def spread(self, name: str) -> float:
        """Return how well an own parameter of another run is known beforehand [SI]."""
        row = ROWS[name]
        return self.own_std.get(name, row.prior[1] if row.prior else (row.upper - row.lower) / np.sqrt(12.0))


def operating_point(
    known: KnownFit, chain: ChainInput, source: FittedAt, load: str, measuring: Measuring, basis: LiftCorrection
) -> OperatingPoint:
    """Return one speed and load.

    Parameters
    ----------
    chain : pump, cam, speed, line pressure
    source : recording whose own parameters stand in; at another speed it has its own start of delivery where each has
    basis : of the correction of the lift table
    """
    places, chain, output, values = evaluated(known, chain, source)
    by = derivative_by(output, list(places))
    shared = np.zeros((BINS, len(known.names)))
    tooth = np.zeros(len(known.names))
    turned, own = tooth_shifts(chain, output), []
    for at, (name, k) in enumerate(places.items()):
        apart = chain.speed != source.speed and SEPARATOR in known.names[k] and name != TRIGGER_ANGLE
        if apart or ROWS[name].role == "own":
            own.append(by[:, at] * measuring.spread(name))
            continue
        shared[:, k] = by[:, at]
        tooth[k] = turned.get(name, 0.0)
    torque = output.torque + output.linear @ coefficients_of(values)
    lift = lift_columns(chain, basis, output, values) * basis.prior_std
    return OperatingPoint(chain.speed, load, torque, shared, np.column_stack(own), tooth, measuring.scatter, lift)


def evaluated(
    known: KnownFit, chain: ChainInput, source: FittedAt
) -> tuple[dict[str, int], ChainInput, ChainOutput, dict[str, float]]:
    """Return the places of the parameters in the fit, the settled chain, it with its derivatives, all values."""
    places = known.own(source.id)
    values = values_of({name: float(known.values[k]) for name, k in places.items()}, source)
    chain = settled(chain, values)
    return places, chain, evaluate(chain, values, coefficients_of(values), tangents=True), values


def information(offer: Offer, runs: int) -> Array:
    """Return what a run tells of the fit's parameters, (k, k) [1/SI^2], when it is one of so many."""
    point = offer.point
    cycles = max(0.5 * offer.duration * point.speed / (2.0 * np.pi), 4.0)  # the other half is held out
    weight = bin_weights(point.torque, point.scatter / np.sqrt(cycles), runs)
    shared = point.shared * weight[:, None]
    own = np.column_stack([point.own, np.sqrt(runs) * point.lift]) * weight[:, None]
    cross = shared.T @ own
    block = own.T @ own + np.eye(own.shape[1])
    found = shared.T @ shared - cross @ np.linalg.solve(block, cross.T)
    return np.asarray(found + (np.outer(point.tooth, point.tooth) / PLACE_STD**2 if offer.tooth else 0.0))


def known_beside(known: KnownFit, fitted: Sequence[Offer], made: Sequence[Step], runs: int) -> Array:
    """Return the information after the runs made, (k, k) [1/SI^2], when there are so many runs with all others.

    Parameters
    ----------
    fitted : recordings of the fit, or some that stand for all
    """
    before, count = inverse(known.matrix), len(known.recordings)
    if fitted:
        lost = np.sum([information(run, count) - information(run, runs) for run in fitted], axis=0)
        before = lessened(before, count / len(fitted) * lost, 1.0 - count / runs)
    return np.asarray(before + sum(information(row.offer, runs) for row in made))


def lessened(information: Array, lost: Array, most: float) -> Array:
    """Return an information (k, k) less what of it is lost, in no direction more than a share of it."""
    root = np.linalg.cholesky(information)
    half = np.linalg.solve(root, lost)
    share, directions = np.linalg.eigh(np.linalg.solve(root, half.T))
    turned = root @ directions
    return np.asarray(information - turned * np.clip(share, 0.0, most) @ turned.T)


def plan(
    known: KnownFit, target: TargetQuantity, wanted: float, points: Sequence[OperatingPoint],
    durations: Sequence[float], teeth: Sequence[bool] = (False, True), fitted: Sequence[Offer] = (),
) -> tuple[Step, ...]:  # fmt: skip
    """Return the runs that bring the standard uncertainty of a number to ``wanted`` [SI], best first.

    The run that narrows most per minute is taken, then the next; at each place the cheapest run that would suffice is
    kept as an end of the plan, and the cheapest whole is returned.

    Parameters
    ----------
    durations : that may be chosen [s]
    teeth : whether runs without and with a second tooth may be chosen
    fitted : see `known_beside`
    """
    chosen: list[Step] = []
    sufficient: list[list[Step]] = []
    std = target.std(known.matrix)
    wanted *= AS_GOOD
    while std > wanted and len(chosen) < MOST_RUNS:
        offers = [Offer(point, d, tooth) for point in points for d in durations for tooth in teeth]
        worth = weighed(known, target, offers, chosen, fitted)
        tried = [row for row in worth if row.std <= (1.0 - LEAST_GAIN) ** (row.minutes / SETUP_MINUTES) * std]
        if not tried:
            break
        enough = [row for row in tried if row.std <= wanted]
        if enough:
            sufficient.append([*chosen, min(enough, key=lambda row: (row.minutes, row.std))])
        best = max(tried, key=lambda row: float(np.log(std / row.std)) / row.minutes)
        chosen, std = [*chosen, best], best.std
    if std <= wanted and chosen:
        sufficient.append(chosen)
    if not sufficient:
        return tuple(chosen)
    trimmed = [needed(known, target, wanted, rows, fitted) for rows in sufficient]
    return tuple(min(trimmed, key=lambda rows: sum(row.minutes for row in rows)))


def weighed(
    known: KnownFit, target: TargetQuantity, offers: Sequence[Offer], made: Sequence[Step] = (),
    fitted: Sequence[Offer] = (),
) -> list[Step]:  # fmt: skip
    """Return every run on offer as the next one after those made; a second tooth that is there costs nothing more."""
    runs = len(known.recordings) + len(made) + 1
    before = known_beside(known, fitted, made, runs)
    has_tooth = any(row.offer.tooth for row in made)
    found = []
    for offer in offers:
        after = inverse(before + information(offer, runs))
        tooth = TOOTH_MINUTES if offer.tooth and not has_tooth else 0.0
        minutes = SETUP_MINUTES + offer.duration / 60.0 + tooth
        found.append(Step(offer, minutes, target.std(after)))
    return found


def needed(
    known: KnownFit, target: TargetQuantity, wanted: float, chosen: Sequence[Step], fitted: Sequence[Offer] = ()
) -> list[Step]:
    """Return the runs without those that later ones made needless, the most expensive of these first."""
    kept = list(chosen)
    for row in sorted(chosen, key=lambda item: -item.minutes):
        rest: list[Step] = []
        for item in kept:
            if item.offer is not row.offer:
                rest += weighed(known, target, [item.offer], rest, fitted)
        if rest and rest[-1].std <= wanted:
            kept = rest
    return kept


def chamber_peak(known: KnownFit, chain: ChainInput, source: FittedAt) -> tuple[float, Array]:
    """Return the highest chamber pressure at a point [Pa] and its gradient by the fit's parameters, (k,)."""
    places, _, output, _ = evaluated(known, chain, source)
    top = int(np.argmax(output.pressure))
    gradient = np.zeros(len(known.names))
    assert output.pressure_tangents is not None
    for place, name in enumerate((*CHAMBER_NAMES, *SHIFT_NAMES)):
        if name in places:
            gradient[places[name]] = output.pressure_tangents[top, place]
    return float(output.pressure[top]), gradient
