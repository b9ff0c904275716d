"""Whether torque and pressure contradict a sheet: which stated quantity would they have otherwise, and how surely.

A plunger, a spring, a lift, a gain or a delay that is stated wrongly is not missed by the fit: friction, valve and
chamber make up for it within what the weights admit, and chamber pressure and losses are then wrong with narrow
intervals. So one quantity after the other is let go at the minimum, as a factor on what is stated. What that would gain
is known from one derivative; where it is much for one of them, the minimum is followed along the factors until nothing
more is gained, from where it is and from a sixth to either side: what makes up for a wrong sheet is a minimum, too.
The odds are Laplace's evidence for the factor against the sheet's, of which one in fifty is expected to be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.descent import Effort, free_at
from camtorque.fit.minima import POLISH, Candidate, at_minimum, attempted
from camtorque.fit.problem import FitData, build_problem
from camtorque.fit.solver import output_at, with_slopes
from camtorque.fit.turned import at_angle
from camtorque.records import Array

WRONG_SHEETS = 0.02
"""Share of the benches on which a given quantity is stated wrongly, as far as somebody knows."""
WRONG_BY = 0.3
"""Half of them are then wrong by less than this, as the logarithm of a factor; units and slips are off by any."""
WORTH_FOLLOWING, BESIDE = 5.0, 2.0
"""Gain of chi-square that a derivative has to promise (of 43 sound recordings of three makers two do, whose pressure
sensors are far along the line), and that of other quantities that are then followed beside it."""
A_DELAY = 1.0e-3
"""Delay that counts as a factor's unit [s]: 0.3 ms is a logger's filter that no sheet names."""
LEAST, SURE = 0.03, 2.0
"""Deviation of a factor from 1 that is told: smaller is what sheets err by; and its least number of standard errors."""
STARTS = (1.0, 0.87, 1.15)
"""Factors from which a minimum is followed."""
STEP = 2.0e-3
"""Relative step of a difference quotient: rounding and curvature stay below a hundredth of it."""
LARGEST_STEP, ROUNDS, SETTLED = 0.15, 8, 0.2
"""Steps of the factor that are made at once, how many of them, and standard errors of it that are none."""
FOLLOWED = Effort(12)
AS_WELL = 6.0
"""Quantities whose odds come so near to the best one's, as twice their logarithm, are told beside it."""

Scaled = Callable[[FitData, float], FitData]


def _of_pump(field: str) -> Scaled:
    def scaled(item: FitData, factor: float) -> FitData:
        pump = replace(item.chain.pump, **{field: factor * getattr(item.chain.pump, field)})
        return replace(item, chain=replace(item.chain, pump=pump))

    return scaled


def _lift(item: FitData, factor: float) -> FitData:
    law = replace(item.chain.law, coefficients=factor * item.chain.law.coefficients)
    return replace(item, chain=replace(item.chain, law=law))


def _pressure(item: FitData, factor: float) -> FitData:
    return replace(item, chain=replace(item.chain, line_pressure=factor * item.chain.line_pressure))


def _torque(item: FitData, factor: float) -> FitData:
    chain = replace(item.chain, shaft_torque=factor * item.chain.shaft_torque)
    return replace(item, torque=factor * item.torque, weight=item.weight / factor, chain=chain)


def _pressure_later(item: FitData, factor: float) -> FitData:
    return replace(item, chain=replace(item.chain, line_pressure=_later(item, item.chain.line_pressure, factor)))


def _torque_later(item: FitData, factor: float) -> FitData:
    chain = replace(item.chain, shaft_torque=_later(item, item.chain.shaft_torque, factor))
    return replace(item, torque=_later(item, item.torque, factor), chain=chain)


def _later(item: FitData, values: Array, factor: float) -> Array:
    """Return periodic values (n,) that come later by the logarithm of a factor, in units of `A_DELAY`.

    Two factors after one another are then their product, as of everything else.
    """
    return at_angle(values, -item.chain.speed * math.log(factor) * A_DELAY)


OF_PUMP = {
    "plunger_diameter_m": "plunger_diameter", "spring_stiffness_N_per_m": "spring_stiffness",
    "spring_preload_N": "spring_preload", "follower_mass_kg": "follower_mass",
}  # fmt: skip
"""Key of recording.toml -> field of the pump."""
QUANTITIES: Mapping[str, Scaled] = {
    **{key: _of_pump(field) for key, field in OF_PUMP.items()},
    "lift of the cam": _lift,
    "gain of the pressure": _pressure,
    "gain of the torque": _torque,
    "delay of the pressure": _pressure_later,
    "delay of the torque": _torque_later,
}
"""What may be stated wrongly -> the recording as it would be with a factor on it."""
DELAYS = ("delay of the pressure", "delay of the torque")
"""What has no factor: the logarithm of one is by how many times `A_DELAY` a delay is stated too long."""
SIZES = ("plunger_diameter_m", "lift of the cam", "gain of the pressure", "gain of the torque")
"""What stands in for one another: how much torque a pressure makes."""


@dataclass(frozen=True)
class SheetDoubt:
    """A stated quantity that torque and pressure would have otherwise.

    factor, std : on what is stated, and its standard error; two_ln_odds : twice the logarithm of the odds against it
    """

    quantity: str
    factor: float
    std: float
    two_ln_odds: float


@dataclass(frozen=True)
class Pull:
    """What a factor on a quantity promises at a minimum: gain of chi-square, relative step, its standard error."""

    gain: float
    step: float
    std: float


def sheet_doubts(best: Candidate, inflation: float) -> tuple[SheetDoubt, ...]:
    """Return the quantities whose statement is more probably wrong than right, the likeliest first.

    Parameters
    ----------
    best : minimum with everything as it is stated
    inflation : factor on the variance of the residual
    """
    tangents = _tangents(best)
    pulls = {name: attempted(_pull, best, scaled, inflation, tangents) for name, scaled in QUANTITIES.items()}
    gains = {name: pull.gain for name, pull in pulls.items() if pull}
    if max(gains.values(), default=0.0) < WORTH_FOLLOWING:
        return ()
    settled = best if best.solution.converged else _settled(best)
    found = [doubt for name, gain in gains.items() if gain > BESIDE for doubt in _doubts(settled, name, inflation)]
    doubts = sorted(found, key=lambda one: -one.two_ln_odds)
    told = [one for one in doubts if abs(one.factor - 1.0) > max(LEAST, SURE * one.std)]
    return tuple(one for one in told if one.two_ln_odds > max(0.0, doubts[0].two_ln_odds - AS_WELL))


def _doubts(best: Candidate, name: str, inflation: float) -> list[SheetDoubt]:
    """Return the likeliest factor on a quantity, none where all that is found is the sheet's."""
    found = [_followed(best, QUANTITIES[name], inflation, name, start) for start in STARTS]
    return sorted((one for one in found if one), key=lambda one: -one.two_ln_odds)[:1]


def _settled(best: Candidate) -> Candidate:
    """Return where a descent goes on to that ended early: what it gains yet is not the gain of a factor."""
    further = attempted(at_minimum, best.data, POLISH, best.solution.lift)
    return further if further and further.solution.chi_square < best.solution.chi_square else best


def odds_against(gain: float, factor: float, std: float) -> float:
    """Return twice the logarithm of the odds against a sheet.

    Parameters
    ----------
    gain : of chi-square
    factor, std : that it takes, and the standard error of its logarithm; beforehand that one is Cauchy's
    """
    density = WRONG_BY / (math.pi * (WRONG_BY**2 + math.log(factor) ** 2))
    return gain + 2.0 * math.log(math.sqrt(2.0 * math.pi) * std * density * WRONG_SHEETS / (1.0 - WRONG_SHEETS))


def _tangents(item: Candidate) -> Array:
    """Return the weighted columns (bins, k) of the free parameters in units of their steps."""
    columns = with_slopes(item.problem, item.solution.z, 0)[1]
    full = np.zeros((columns.shape[0], item.problem.size))
    full[:, item.problem.places[0][0]] = columns[:, :-1]
    return full


def _pull(item: Candidate, scaled: Scaled, inflation: float, tangents: Array) -> Pull:
    """Return what a factor promises that all free parameters follow."""
    solution, steps = item.solution, item.problem.steps
    up, down = (_residual(scaled(item.data, 1.0 + sign * STEP), solution.z) for sign in (1.0, -1.0))
    column = ((down - up) / (2.0 * STEP))[:, None]
    free = free_at(solution.z, solution.gradient, *item.problem.bounds)
    matrix = (solution.hessian * np.outer(steps, steps))[np.ix_(free, free)]
    along = solution.lift.product(tangents[:, free], column)[:, 0]
    followed = np.linalg.lstsq(matrix, along, rcond=1e-12)[0]
    known = float(solution.lift.product(column, column)[0, 0] - along @ followed)
    asked = float(solution.lift.product(column, solution.residual[:, None])[0, 0])
    asked -= float(followed @ (solution.gradient * steps)[free])
    if not known > 0.0:  # the others can do all that it can
        return Pull(0.0, 0.0, math.inf)
    return Pull(asked**2 / known / inflation, asked / known, math.sqrt(inflation / known))


def _residual(item: FitData, z: Array) -> Array:
    """Return the weighted residual of a recording at values of its free parameters, (bins,)."""
    problem = build_problem([item])
    return item.residual(output_at(problem, z), problem.values(z, 0)[1])


def _followed(best: Candidate, scaled: Scaled, inflation: float, name: str, start: float) -> SheetDoubt | None:
    """Return where a minimum ends along a factor, None where its derivatives run away or nothing is gained."""
    item = best if start == 1.0 else attempted(at_minimum, scaled(best.data, start), FOLLOWED, best.solution.lift)
    if item is None:
        return None
    factor, std = start, math.inf
    for _ in range(ROUNDS):
        pull = attempted(_pull, item, scaled, inflation, _tangents(item))
        if pull is None or not math.isfinite(pull.std):
            return None
        std = pull.std
        if abs(pull.step) < SETTLED * std:
            break
        moved = _stepped(item, scaled, float(np.clip(pull.step, -LARGEST_STEP, LARGEST_STEP)))
        if moved is None:
            break
        item, factor = moved[0], factor * moved[1]
    gain = (best.solution.chi_square - item.solution.chi_square) / inflation
    return SheetDoubt(name, factor, factor * std, odds_against(gain, factor, std)) if gain > 0.0 else None


def _stepped(item: Candidate, scaled: Scaled, step: float) -> tuple[Candidate, float] | None:
    """Return a deeper minimum a step or a part of it along a factor, and that; None where there is none."""
    for part in (1.0, 0.5, 0.25):
        factor = 1.0 + part * step
        new = attempted(at_minimum, scaled(item.data, factor), FOLLOWED, item.solution.lift)
        if new and new.solution.chi_square < item.solution.chi_square:
            return new, factor
    return None
