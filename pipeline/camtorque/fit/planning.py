"""The cheapest runs to one wanted number: what each tells, what it costs, when to stop.

A run's expected information is J' W J, its own zeros and end of delivery and the error of the lift table integrated
out, with the weights that it would have: scatter of as many cycles as it lasts, and the error of the laws. That and the
table's are the same in all runs and therefore count as often as there are runs: the fitted ones tell less beside
another one. J is that at the values of the fit and at some drawn from what the fit leaves open: a resonance that is
hardly known would tell much just where the best values put it. Of a run counts what it brings at the best values or
in the middle of the draws, whichever is less: only the best values are those at which the fit's own covariance holds.
Runs are chosen one by one, the most gain per minute first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.forecast import settled, values_of
from camtorque.fit.kinds import PIN
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.prepare import bin_weights
from camtorque.fit.problem import SEPARATOR
from camtorque.fit.single import SOFTER, SWITCHING
from camtorque.fit.teeth import PLACE_STD
from camtorque.fit.truncated import Gaussian
from camtorque.fit.uncertainty import deviation_within, inverse
from camtorque.fit.valleys import TRIGGER_ANGLE
from camtorque.laws import ROWS
from camtorque.laws.chain import SHIFT_NAMES, ChainInput, ChainOutput, coefficients_of, derivative_by, evaluate
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.lift import LiftCorrection, lift_columns
from camtorque.records import Array, ReadOnly, Refusal
from camtorque.units import RPM

TOOTH_ANGLE = np.radians(60.0)
TOOTH = "a second tooth 60 degrees after the first (pulses_per_rev = 6, missing_teeth = 4)"
"""The tooth with the keys that describe two teeth in place of one."""
SETUP_MINUTES, TOOTH_MINUTES = 10.0, 45.0
"""What it costs to set a point and to fit a second tooth."""
STATED_OF_ALL = (SWITCHING, PIN, SOFTER)
"""Spreads between fits that a joint fit states, too; other laws and structures it does not."""
ANOTHER_SPEED = 0.1
"""Difference in ln speed from a recording beyond which a run tells structures apart."""
MOST_RUNS = 6
AS_GOOD = 1.01
"""An uncertainty of so many times what is wanted is as good: it is printed with two digits."""
LEAST_GAIN = 0.02
"""A run that narrows the number by less than this share for what one setting of the bench costs is not worth making."""


def tooth_shifts(chain: ChainInput, output: ChainOutput) -> dict[str, float]:
    """Return by how much each parameter of the driveline turns a second tooth against the first [rad/SI]."""
    place, columns = np.mod(chain.trigger_angle + TOOTH_ANGLE, 2.0 * np.pi), output.motion.shifts[0].T
    return {
        name: float(np.interp(place, chain.theta, column, period=2.0 * np.pi))
        for name, column in zip(SHIFT_NAMES, columns, strict=True)
        if name != "trigger_offset"
    }


@dataclass(frozen=True)
class OperatingPoint(ReadOnly):
    """One speed and load: columns by shared parameters, by prior deviations of own ones and lift, twist at a tooth.

    Of the values of a fit and of drawn ones each array but ``scatter`` has a first axis more.
    """

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
    """A number of a fit: gradient by its parameters (k,), and what is stated beside the covariance of the fit [SI].

    lasting : what no run narrows, such as the switching of the trigger
    passing : what a joint fit with a run at another speed does not state any more: other structures and laws
    within : values and bounds, where covariances are those without bounds and the deviation within them is stated
    scale : what is stated of that deviation as a share of it
    """

    gradient: Array
    lasting: float = 0.0
    passing: float = 0.0
    within: Gaussian | None = None
    scale: float = 1.0

    def deviation(self, covariance: Array) -> Array:
        """Return how far the parameters lie from their values with a covariance of them, (k, k)."""
        if self.within is None:
            return covariance
        return deviation_within(replace(self.within, matrix=covariance), self.within.mean)

    def std(self, covariance: Array, apart: bool = False) -> float:
        """Return its standard uncertainty with a covariance of the parameters (k, k); ``apart``: see `expected`."""
        known = self.scale**2 * self.gradient @ self.deviation(covariance) @ self.gradient
        return float(np.sqrt(known + self.lasting**2 + (0.0 if apart else self.passing**2)))

    def expected(self, covariances: Array, apart: bool) -> float:
        """Return that with the covariance expected at the fit's values, (k, k), or there and at drawn ones, (d, k, k).

        ``apart``: there is a run at another speed.
        """
        each = np.reshape(covariances, (-1, *covariances.shape[-2:]))
        variances = np.einsum("i,dij,j->d", self.gradient, each, self.gradient)
        middle = int(np.argsort(variances)[variances.size // 2])
        return self.std(each[middle if variances[middle] > variances[0] else 0], apart)


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
    known: KnownFit, chain: ChainInput, source: FittedAt, load: str, measuring: Measuring, basis: LiftCorrection,
    drawn: Sequence[Array] = (),
) -> OperatingPoint:  # fmt: skip
    """Return one speed and load.

    Parameters
    ----------
    chain : pump, cam, speed, line pressure
    source : recording whose own parameters stand in; at another speed it has its own start of delivery where each has
    basis : of the correction of the lift table
    drawn : further values (k,) [SI] at which it is looked at; one whose torque runs away is left out
    """
    columns = [_columns(known, chain, source, measuring, basis)]
    for values in drawn:
        try:
            columns.append(_columns(replace(known, values=values), chain, source, measuring, basis))
        except Refusal:
            columns.append(columns[0])
    if not drawn:
        torque, shared, own, tooth, lift = columns[0]
    else:
        torque, shared, own, tooth, lift = (np.array(part) for part in zip(*columns, strict=True))
    return OperatingPoint(chain.speed, load, torque, shared, own, tooth, measuring.scatter, lift)


def _columns(
    known: KnownFit, chain: ChainInput, source: FittedAt, measuring: Measuring, basis: LiftCorrection
) -> tuple[Array, ...]:
    """Return the arrays of an `OperatingPoint`."""
    places, chain, output, values = evaluated(known, chain, source)
    by = derivative_by(output, list(places))
    shared = np.zeros((by.shape[0], len(known.names)))
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
    found = (torque, shared, np.column_stack(own), tooth, lift)
    if not all(np.all(np.isfinite(part)) for part in found):
        raise Refusal(
            f"plan: the model has no finite slope at {chain.speed / RPM:.0f} rpm, expected a speed near the fitted "
            "ones; ask for other speeds"
        )
    return found


def evaluated(
    known: KnownFit, chain: ChainInput, source: FittedAt
) -> tuple[dict[str, int], ChainInput, ChainOutput, dict[str, float]]:
    """Return the places of the parameters in the fit, the settled chain, it with its derivatives, all values."""
    places = known.own(source.id)
    values = values_of({name: float(known.values[k]) for name, k in places.items()}, source)
    chain = settled(chain, values)
    return places, chain, evaluate(chain, values, coefficients_of(values), tangents=True), values


def information(offer: Offer, runs: int) -> Array:
    """Return what a run tells of the fit's parameters, (..., k, k) [1/SI^2], when it is one of so many."""
    point = offer.point
    cycles = max(0.5 * offer.duration * point.speed / (2.0 * np.pi), 4.0)  # the other half is held out
    weight = bin_weights(point.torque, point.scatter / np.sqrt(cycles), runs)[..., None]
    shared = point.shared * weight
    own = np.concatenate([point.own, np.sqrt(runs) * point.lift], axis=-1) * weight
    taken = inverse(own.mT @ own + np.eye(own.shape[-1])) @ (own.mT @ shared)
    left = shared - own @ taken  # a sum of squares, in which no rounding makes a run take knowledge away
    return np.asarray(left.mT @ left + taken.mT @ taken + told_by_tooth(offer))


def told_by_tooth(offer: Offer) -> Array:
    """Return what the second tooth of a run tells of the fit's parameters, (..., k, k) [1/SI^2], nothing without."""
    twist = offer.point.tooth / PLACE_STD * offer.tooth
    return np.asarray(twist[..., :, None] * twist[..., None, :])


def known_beside(known: KnownFit, fitted: Sequence[Offer], made: Sequence[Step], runs: int) -> Array:
    """Return the information after the runs made, (..., k, k) [1/SI^2], when there are so many runs with all others.

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
    unit = np.sqrt(np.diag(information))
    size, axes = np.linalg.eigh(0.5 * (information + information.T) / np.outer(unit, unit))
    # an inverse of what the data hardly tell may be below zero by its rounding
    root = np.sqrt(np.maximum(size, np.finfo(np.float64).eps * size[-1]))
    apart = axes.T / root[:, None] / unit
    share, directions = np.linalg.eigh(apart @ lost @ apart.T)
    turned = (axes * root) @ directions * unit[:, None]
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
    found, by_torque = [], dict[tuple[int, float], Array]()  # the same with a second tooth and without
    for offer in offers:
        place = (id(offer.point), offer.duration)
        if place not in by_torque:
            by_torque[place] = information(replace(offer, tooth=False), runs)
        told = by_torque[place] + told_by_tooth(offer)
        apart = any(at_another_speed(known, one) for one in (*(row.offer for row in made), offer)) and bool(told.any())
        tooth = TOOTH_MINUTES if offer.tooth and not has_tooth else 0.0
        minutes = SETUP_MINUTES + offer.duration / 60.0 + tooth
        found.append(Step(offer, minutes, target.expected(inverse(before + told), apart)))
    return found


def at_another_speed(known: KnownFit, offer: Offer) -> bool:
    """Return whether a run lies at another speed than all fitted recordings."""
    return all(abs(np.log(offer.point.speed / one.speed)) > ANOTHER_SPEED for one in known.recordings)


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
