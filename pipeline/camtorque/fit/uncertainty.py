"""How sure: covariance of the full model, inflation by what stays unexplained, budget by source, knowledge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.fit.prepare import CORRELATION, INDEPENDENT
from camtorque.fit.problem import Problem
from camtorque.fit.solver import Solution
from camtorque.fit.truncated import Gaussian
from camtorque.laws.chain import SHIFT_NAMES, ChainInput, ChainOutput
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.valve import SEAT_FLOW
from camtorque.records import Array, Mask, ReadOnly
from camtorque.units import COVERAGE, TURN

STATED_VALUES = 10.0
"""Values that the stated variance of a residual is worth: it is known to within half."""
LEAST_FREEDOM = INDEPENDENT / 3.0
"""Degrees of freedom that are counted at least, where parameters and lift correction nearly fill the revolution."""
CYCLES = "cycles and model error"
MEASURED, NARROWED = 0.3, 0.8
"""Posterior over prior standard deviation up to which a parameter counts as measured, as narrowed."""
CONFOUNDED = 0.9
RIPPLE_DEG = CORRELATION / 2.0
"""Angle over which a torque tells nothing of what swings: its residuals are one value over twice as much [deg]."""
SPIKE_DEG = 6.0
"""Angle about a place within which its pressure is looked for [deg]."""
DELIVERING = 0.02
"""Share of the highest flow past the delivery valve above which it delivers."""
LOUDER = 1.6
"""How much more than the line the chamber swings at most while it delivers: of 38 simulated chambers of two makers one
does so 1.6 times, the others less."""


@dataclass(frozen=True)
class Covariance(ReadOnly):
    """Covariance of the free parameters [SI].

    Attributes
    ----------
    matrix : (k, k) of the full model, priors included
    prior_std : (k,) standard deviation before the data; range / sqrt 12 where nothing is known
    inflation : factor on the variance of the residual that its size asks for; below 1 where it is `narrowed`
    freedom : independent values less what parameters and lift correction take
    from_data : (k, k) the part of ``matrix`` that comes from the residual; the rest comes from priors
    """

    matrix: Array
    prior_std: Array
    inflation: float
    freedom: float
    from_data: Array

    @property
    def std(self) -> Array:
        """Standard deviations, (k,) [SI]."""
        return np.sqrt(np.diag(self.matrix))


def prior_std(problem: Problem) -> Array:
    """Return the standard deviation of every free parameter before the data [SI]."""
    lower, upper = problem.bounds
    stds = problem.priors[1]
    flat = (upper - lower) / np.sqrt(12.0)
    return np.where(np.isfinite(stds), stds, flat)


def inverse(matrix: Array) -> Array:
    """Return the inverse of symmetric positive definite matrices (..., k, k) of badly mixed units."""
    scale = 1.0 / np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    units = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.inv(matrix * units + 1e-12 * np.eye(scale.shape[-1])) * units)


def covariance(problem: Problem, solution: Solution) -> Covariance:
    """Return the covariance at a minimum; a parameter at its bound keeps the width that it has without it."""
    before = prior_std(problem)
    matrix = inverse(solution.data_hessian + np.diag(1.0 / before**2))
    taken = float(np.sum(matrix * solution.data_hessian)) + float(np.sum(solution.lift.shrink))
    freedom = max(INDEPENDENT - taken, LEAST_FREEDOM)
    return _scaled(solution, before, max(1.0, solution.data_chi_square / freedom), freedom)


def narrowed(cov: Covariance, solution: Solution) -> Covariance:
    """Return a covariance whose residual counts as what it is where it is smaller than its weights state.

    Scatter that is not one value over `CORRELATION` degrees makes weights too careful, and a small residual may be
    luck: what they state counts as `STATED_VALUES` beside the residual's own (an inverse chi-square prior). A larger
    residual says that laws are missing, which `covariance` takes care of. A search goes by the weights.
    """
    if cov.inflation > 1.0:
        return cov
    scale = min((STATED_VALUES + solution.data_chi_square) / (STATED_VALUES + cov.freedom), 1.0)
    return _scaled(solution, cov.prior_std, scale, cov.freedom)


def _scaled(solution: Solution, before: Array, inflation: float, freedom: float) -> Covariance:
    information = solution.data_hessian / inflation
    matrix = inverse(information + np.diag(1.0 / before**2))
    return Covariance(matrix, before, inflation, freedom, matrix @ information @ matrix)


def posterior_at(problem: Problem, solution: Solution, matrix: Array, inflation: float) -> Gaussian:
    """Return the Gaussian of covariance C whose maximum within the bounds is a minimum: its mean is x + C g."""
    return Gaussian(solution.z + matrix @ (solution.gradient / inflation), matrix, *problem.bounds)


def deviation_within(known: Gaussian, stated: Array) -> Array:
    """Return how far parameters within their bounds lie from stated values (k,): E[(x - s)(x - s)'], (k, k) [SI^2].

    Without the bounds an uncertainty would hold volumes and losses below zero that cancel one another.
    """
    off = known.within.mean - stated
    return np.asarray(known.within.matrix + np.outer(off, off))


def secant_steps(values: Array, std: Array, lower: Array, upper: Array) -> Array:
    """Return a step of each parameter over which a difference stands for a slope, (k,) [SI]; 0 where it has no room.

    It is ``std`` within the bounds: over a part of the standard uncertainty a model that jumps where an outlet opens
    would have a slope without end.
    """
    forth, back = np.minimum(std, upper - values), np.maximum(-std, lower - values)
    return np.where(forth >= np.minimum(std, -back), forth, back)


def along_valley(deviation: Array, index: int, std: float) -> Array:
    """Return the shift (k,) of all parameters that is missing where one of them has a larger deviation [SI].

    The others follow it along the valley of the residual, as they are correlated with it.

    Parameters
    ----------
    deviation : (k, k) `deviation_within` [SI^2]
    index : parameter whose deviation is known from more than the curvature at the minimum
    std : that deviation [SI]; nothing is missing where it is smaller, or nan
    """
    column = deviation[:, index]
    missing = std**2 - column[index]
    return np.asarray(column / column[index] * np.sqrt(missing) if missing > 0.0 else np.zeros(column.size))


def pressure_jacobian(problem: Problem, output: ChainOutput) -> tuple[Array, list[int]]:
    """Return the derivative of the chamber pressure at a cam angle (n, m) [Pa/SI] by parameters, and their places (m,).

    ``output`` is a recording's, with tangents.
    """
    columns = (*CHAMBER_NAMES, *SHIFT_NAMES)
    own = [k for k, one in enumerate(problem.parameters) if one.row.name in columns]
    assert output.pressure_tangents is not None
    tangents = output.pressure_tangents.copy()
    tangents[:, len(CHAMBER_NAMES) :] -= pressure_slope(output)[:, None] * output.motion.shifts[0]
    return tangents[:, [columns.index(problem.parameters[k].row.name) for k in own]], own


def pressure_slope(output: ChainOutput) -> Array:
    """Return the derivative of the chamber pressure by the cam angle, (n,) [Pa/rad]."""
    rise = np.roll(output.pressure, -1) - np.roll(output.pressure, 1)
    turned = np.roll(output.motion.theta, -1) - np.roll(output.motion.theta, 1)
    return np.asarray(rise / np.mod(turned, TURN))


def pressure_moved_to(output: ChainOutput, other: ChainOutput) -> Array:
    """Return how far the chamber pressure at a cam angle lies from an output to another one of its grid, (n,) [Pa]."""
    turned = other.motion.theta - output.motion.theta
    return np.asarray(other.pressure - output.pressure - pressure_slope(output) * turned)


def delivering(output: ChainOutput) -> Mask:
    """Return where fuel goes past the delivery valve into the line, (n,)."""
    flow = output.flows[:, SEAT_FLOW]
    return np.asarray(flow > DELIVERING * np.max(flow))


def unresolved_amplitude(output: ChainOutput, line: Array) -> Array:
    """Return the amplitude of what may swing in the chamber too fast for the torque to tell, (n,) [Pa].

    That is what the fitted chamber does and, while it delivers, what the line pressure (n,) [Pa] does: how much of that
    an open valve lets through is the valve's law again.
    """
    return np.maximum(ripple(output.pressure), np.where(delivering(output), ripple(line), 0.0))


def ripple(pressure: Array) -> Array:
    """Return the amplitude of what swings too fast in a pressure for the torque to tell, (n,) [Pa].

    A delivery valve that rings or chatters does so at a phase, and at a size, that the valve's law alone gives. The
    local amplitude is sqrt 2 times the rms about a parabola over `RIPPLE_DEG`, of the calmest such stretch that a place
    lies in the middle or at an end of: where delivery ends, a pressure falls, which is no swing of what went before.
    """
    half = _half(pressure, RIPPLE_DEG)
    stretches, coefficients, shapes = _parabolas(pressure, half)
    about = np.sqrt(2.0 * np.mean((stretches - coefficients @ shapes.T) ** 2, axis=1))
    return np.minimum.reduce([about, np.roll(about, half), np.roll(about, -half)])


def stated_pressure(chain: ChainInput, output: ChainOutput) -> Array:
    """Return the pressure on the plunger without what swings while the chamber delivers and not in the line, (n,) [Pa].

    What passes a valve that chatters is in the line pressure, too. Beyond `LOUDER` times what that swings,
    the mean over `RIPPLE_DEG` is the better value: of a swing that is not heard neither size nor phase are known.
    """
    pressure, line = output.pressure, chain.line_pressure
    if not chain.uses_chamber:
        return pressure
    open_or_about = np.any(_around(delivering(output), _half(pressure, 2.0 * RIPPLE_DEG)), axis=1)
    if not open_or_about.any():
        return pressure
    amplitude = ripple(pressure)
    own, heard = (float(np.mean(one[open_or_about] ** 2)) for one in (amplitude, ripple(line)))
    if own <= LOUDER**2 * heard:
        return pressure
    _, coefficients, _ = _parabolas(pressure, _half(pressure, RIPPLE_DEG))
    share = (1.0 - LOUDER * np.sqrt(heard / own)) * open_or_about
    # where delivery ends a parabola misses by more than swings there
    return np.asarray(pressure - share * np.clip(pressure - coefficients[:, -1], -2.0 * amplitude, 2.0 * amplitude))


def _parabolas(values: Array, half: int) -> tuple[Array, Array, Array]:
    """Return stretches about each of periodic values (n, m), the parabolas through them (n, 3), and their shapes."""
    shapes = np.vander(np.arange(-half, half + 1) / half, 3)
    stretches = _around(values, half)
    return stretches, stretches @ np.linalg.pinv(shapes).T, shapes


def without_spikes(pressure: Array, std: Array) -> Array:
    """Return the standard uncertainty of a pressure without single angles at which a slope ran away, (n,) [Pa].

    Where a port or valve opens within a time step, a pressure goes by its parameters in a jump, and the slope there is
    any number. What is sure: it lies between its neighbours of half `SPIKE_DEG` on either side, and these are known as
    well as they are.
    """
    half = _half(pressure, SPIKE_DEG)
    near, known = (_around(values, half) for values in (pressure, std))
    return np.minimum(std, np.ptp(near, axis=1) + np.median(known, axis=1))


def _half(values: Array, degrees: float) -> int:
    """Return half of an angle in points of a revolution."""
    return round(values.size * degrees / 720.0)


def _around(values: Array | Mask, half: int) -> Array:
    """Return periodic values (n,) about each of them, (n, 2 half + 1)."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, half, "wrap"), 2 * half + 1)


@dataclass(frozen=True)
class BudgetRow:
    """Where the variance of one parameter comes from.

    total : standard uncertainty [SI]; contributions : source -> standard uncertainty [SI]; squares sum to the total's
    """

    name: str
    total: float
    contributions: dict[str, float]


def uncertainty_budget(
    problem: Problem, cov: Covariance, deviation: Array, spreads: dict[str, Array]
) -> tuple[BudgetRow, ...]:
    """Return the split of every parameter's variance by source, exact by C = C (J'WJ + sum of priors) C.

    What the bounds take away is taken from all of these sources alike.

    Parameters
    ----------
    deviation : (k, k) `deviation_within` [SI^2]
    spreads : source -> (k,) further standard uncertainty, such as other laws
    """
    rows = []
    for k, parameter in enumerate(problem.parameters):
        found = {CYCLES: float(cov.from_data[k, k])}
        for j, other in enumerate(problem.parameters):
            share = float(cov.matrix[k, j] ** 2 / cov.prior_std[j] ** 2)
            found[other.row.source] = found.get(other.row.source, 0.0) + share
        within = float(deviation[k, k] / cov.matrix[k, k])
        found = {source: within * share for source, share in found.items()}
        for source, spread in spreads.items():
            found[source] = float(spread[k] ** 2)
        total = float(np.sqrt(sum(found.values())))
        kept = dict(sorted(found.items(), key=lambda pair: -pair[1])[:6])
        kept |= {source: found[source] for source in spreads if found[source] > 0.0}  # a plan asks which of them last
        kept["others"] = max(sum(found.values()) - sum(kept.values()), 0.0)
        rows.append(BudgetRow(parameter.name, total, {name: float(np.sqrt(value)) for name, value in kept.items()}))
    return tuple(rows)


def knowledge(std: float, before: float, least: float, lower: float, has_prior: bool = True) -> str:
    """Return how far the data went beyond what was known.

    Parameters
    ----------
    std, before : standard deviation with the data and without, neither of them cut off at bounds
    least : lower end of the 95 % interval, which ends at the bounds (`confidence`)
    lower : bound; where it is not negative the least of an amount, which an interval that begins there leaves open
    has_prior : whether a sheet, certificate or literature had told anything
    """
    ratio = std / before
    if ratio < MEASURED:
        return "upper limit" if 0.0 <= least <= lower else "measured"
    if ratio < NARROWED:
        return "narrowed"
    return "from the sheet" if has_prior else "not told by the data"


def correlation_of(matrix: Array) -> Array:
    """Return the correlations (k, k) that a covariance holds."""
    std = np.sqrt(np.diag(matrix))
    return np.asarray(matrix / np.outer(std, std))


def confounded_with(problem: Problem, correlation: Array, index: int) -> tuple[str, ...]:
    """Return the parameters that a parameter is mixed up with, by its correlations (k,)."""
    return tuple(
        problem.parameters[j].name for j in np.argsort(-np.abs(correlation))
        if j != index and abs(correlation[j]) > CONFOUNDED
    )  # fmt: skip


def confidence(value: float, std: float, lower: float, upper: float) -> tuple[float, float]:
    """Return the 95 % interval within the bounds; at a bound it is one-sided.

    An amount whose lower bound is not zero is bounded for the search alone: nothing says that there is not less of it.
    """
    return max(value - COVERAGE * std, min(lower, 0.0)), min(value + COVERAGE * std, upper)
