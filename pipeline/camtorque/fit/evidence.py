"""Which losses do the data need? Evidence from the full fit, confirmed by refits where it is close.

For a loss e that vanishes with its parameters, Gaussian posterior (mu, C) and prior (d, P) of the full fit and bounds
``box``, the Savage-Dickey ratio gives the Bayes factor without another fit::

    2 ln K = mu_e' C_ee^-1 mu_e + ln det C_ee + 2 ln Pr(box) - 2 ln Pr(rest in box | e = 0) - the same of the prior

and a fit without the loss gives it by Laplace's approximation,
``-2 ln Z = chi^2 - g'Cg + ln det H - ln det P^-1 - 2 ln Pr(box) + 2 ln Pr_prior(box)``,
where g is the slope left at a minimum against the bounds and g'Cg what these cost, which Pr(box) holds already.

*Needed*: 2 ln K above `NEEDED`. *Not needed*: both below `NOT_NEEDED` and the loss
small whatever the data allow, against the scatter of the cycles and against the torque itself (a small K alone is not
absence); it may be twice as large where both are below `SURELY_NOT`. Else the data cannot tell. A loss is needed where
one part of it is, however little is known of the others (an unknown constant takes 4 to 7 from all of damping).
Friction is sized by what varies over the revolution: no bearing, pin, or guide has a constant alone, and how much of
that is drag, how much the transducer's zero, hardly any recording can tell.
Sources: Dickey, Ann. Math. Statist. 42 (1971); Kass & Raftery, JASA 90 (1995).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from camtorque import laws
from camtorque.fit.descent import Effort, free_at
from camtorque.fit.minima import attempted
from camtorque.fit.problem import Indices, Problem, build_problem
from camtorque.fit.solver import Solution, solve
from camtorque.fit.truncated import Gaussian, log_share_below
from camtorque.fit.uncertainty import Covariance, inverse, posterior_at, prior_std
from camtorque.laws.chain import SHIFT_NAMES, ChainOutput, derivative_by
from camtorque.laws.rows import ParameterRow
from camtorque.process.second_process import in_two
from camtorque.records import APART, EITHER_LOSS, Array, LossEvidence

NEEDED, NOT_NEEDED = 6.0, -10.0
"""Limits of 2 ln K (Kass & Raftery: 6 is strong, 10 very strong evidence; absence rests on widths of priors alone)."""
SURELY_NOT = -20.0
"""Limit of 2 ln K that stays below `NOT_NEEDED` if the priors of all that belongs to a loss were half as wide."""
SMALL_TORQUE, SMALL_SHARE = 10.0, 0.15
"""A loss is small below this many times odd against even cycles (rms), and below this share of the mean torque."""
LEAST_FACTOR = -100.0
"""2 ln K below which the Gaussian lies far outside the bounds and tells nothing: Occam's share is -10 to -50."""
SMALL_ANGLE = np.radians(0.15)
LARGE = 1000.0
REFIT_BELOW = 30.0
"""A loss with more evidence than this is not refitted."""
SIZE_DRAWS = 400

VARYING = ("friction",)
"""Losses whose size is that of what varies over the revolution."""

LOSSES: dict[str, tuple[str, ...]] = {
    **laws.LOSSES,
    "driveline": ("shaft_compliance", "drive_admittance", "coupling_compliance"),
}
"""Loss -> parameters that vanish with it."""
MEMBERS = {**LOSSES, EITHER_LOSS: tuple(name for loss in APART for name in LOSSES[loss])}
"""The same, and both together: told where one of them is needed and it cannot be decided which, as of a constant at one
speed."""


Refits = Callable[[Sequence[tuple[str, ...]]], list[float]]
"""2 ln K for sets of parameters, each by a fit without them."""


def savage_dickey(posterior: Gaussian, prior: Gaussian, chosen: Array) -> float:
    """Return 2 ln K for parameters (indices ``chosen``) against zero."""
    return _ratio(posterior, chosen) - _ratio(prior, chosen)


def _ratio(whole: Gaussian, chosen: Array) -> float:
    mean, matrix = whole.mean, whole.matrix
    rest = np.setdiff1d(np.arange(mean.size), chosen)
    block = matrix[np.ix_(chosen, chosen)]
    solved = np.linalg.solve(block, mean[chosen])
    quadratic = float(mean[chosen] @ solved) + float(np.linalg.slogdet(block)[1])
    gain = np.linalg.solve(block, matrix[np.ix_(chosen, rest)])
    conditional = matrix[np.ix_(rest, rest)] - matrix[np.ix_(rest, chosen)] @ gain
    given = Gaussian(mean[rest] - gain.T @ mean[chosen], conditional, whole.lower[rest], whole.upper[rest])
    return quadratic + 2.0 * (whole.within.log_probability - given.within.log_probability)


def prior_of(problem: Problem, std: Array, chosen: Indices | None = None) -> Gaussian:
    """Return what is known beforehand; ``std`` (k,) is finite where nothing is, the mean then that of the bounds.

    ``chosen`` are the places of the parameters asked for, all by default.
    """
    places = np.arange(std.size) if chosen is None else chosen
    lower, upper, mean, given = (values[places] for values in (*problem.bounds, *problem.priors))
    return Gaussian(np.where(np.isfinite(given), mean, 0.5 * (lower + upper)), np.diag(std[places] ** 2), lower, upper)


def laplace(problem: Problem, solution: Solution, inflation: float) -> float:
    """Return -2 ln Z of a fit by Laplace's approximation within the bounds."""
    before = prior_std(problem)
    information = solution.data_hessian / inflation + np.diag(1.0 / before**2)
    matrix = inverse(information)
    scaled = information * np.outer(before, before)
    prior_part = solution.chi_square - solution.data_chi_square
    cost = float(solution.gradient @ matrix @ solution.gradient) / inflation**2
    chi = solution.data_chi_square / inflation + prior_part - cost
    inside = posterior_at(problem, solution, matrix, inflation).within.log_probability
    if not np.all(free_at(solution.z, solution.gradient, *problem.bounds)):
        # the box lies beyond the plane through the minimum across the slope that is left there
        inside = min(inside, log_share_below(-math.sqrt(cost)))
    prior_inside = prior_of(problem, before).within.log_probability
    return chi + float(np.linalg.slogdet(scaled)[1]) - 2.0 * inside + 2.0 * prior_inside


@dataclass(frozen=True)
class Weighed:
    """A fit of one recording or more as its losses are weighed.

    Attributes
    ----------
    rows, best : of the parameters that all its recordings share, and their values, (k,) [SI]
    posterior, prior : what is known of them with and without the data
    moves : loss -> mean over its recordings of what `moves_of` returns at the minimum
    small : rms torque below which a loss is small [N m]
    order : highest order of the cam's swing that a wheel tells, 0 without one: the driveline acts above it
    """

    rows: tuple[ParameterRow, ...]
    best: Array
    posterior: Gaussian
    prior: Gaussian
    moves: Mapping[str, Array]
    small: float
    order: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(row.name for row in self.rows)

    def members(self, loss: str) -> tuple[str, ...]:
        """Return the parameters that vanish with a loss."""
        return members_of(loss, self.names)

    def places(self, names: Sequence[str]) -> Array:
        """Return where parameters stand."""
        return np.array([self.names.index(name) for name in names], dtype=int)

    def factor(self, names: Sequence[str]) -> float:
        """Return 2 ln K for parameters against zero, by the Savage-Dickey ratio."""
        return savage_dickey(self.posterior, self.prior, self.places(names))


def members_of(loss: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return those of some parameters that vanish with a loss."""
    return tuple(name for name in MEMBERS[loss] if name in names)


def moves_of(output: ChainOutput, names: Sequence[str], losses: Sequence[str]) -> dict[str, Array]:
    """Return loss -> mean products of the columns by which its parameters move the mean cycle, (m, m).

    They are what its mean square is made of, and all that is kept of a recording: of a thousand the columns would fill
    gigabytes.
    """
    columns = {loss: _columns(output, members_of(loss, names), loss) for loss in losses}
    return {loss: np.asarray(each.T @ each / len(each)) for loss, each in columns.items()}


def small_torque(odd_even: float, mean: float) -> float:
    """Return the rms torque below which a loss is small, by the cycles' scatter and the mean torque [N m]."""
    return min(SMALL_TORQUE * odd_even, SMALL_SHARE * abs(mean))


def loss_evidence(problem: Problem, solution: Solution, cov: Covariance, odd_even: float) -> tuple[LossEvidence, ...]:
    """Return the evidence for every loss of one recording's fit, the chamber's aside, and for two together."""
    small = small_torque(odd_even, float(np.mean(problem.data[0].torque)))
    posterior = posterior_at(problem, solution, cov.matrix, cov.inflation)
    prior = prior_of(problem, cov.prior_std)
    moves = moves_of(solution.output, problem.names, tuple(MEMBERS))
    rows = tuple(one.row for one in problem.parameters)
    fit = Weighed(rows, solution.z, posterior, prior, moves, small, problem.data[0].chain.told_order)
    full = laplace(problem, solution, cov.inflation)

    def refitted(left_out: Sequence[tuple[str, ...]]) -> list[float]:
        return [value - full for value in in_two(partial(_refitted, problem, solution, cov), left_out)]

    return evidence_of(fit, tuple(LOSSES), refitted)


def evidence_of(fit: Weighed, losses: Sequence[str], refitted: Refits | None = None) -> tuple[LossEvidence, ...]:
    """Return the evidence for some losses, and for friction or damping where it cannot be decided which.

    Parameters
    ----------
    refitted : 2 ln K for sets of parameters by fits without them; None of a fit whose Gaussian is good enough
    """

    def weighed(names: Sequence[str]) -> list[LossEvidence]:
        quickly = {name: fit.factor(fit.members(name)) for name in names}
        close = [name for name, quick in quickly.items() if quick < REFIT_BELOW or name == "driveline"]
        refits = dict(zip(close, refitted([MEMBERS[name] for name in close]), strict=True)) if refitted else {}
        return [_judged(fit, name, quick, refits.get(name, np.nan)) for name, quick in quickly.items()]

    found = [_from_zero(_by_part(fit, row, refitted)) for row in weighed(losses)]
    apart = any(row.verdict == "needed" for row in found if row.name in APART)
    together = [] if apart else [row for row in weighed([EITHER_LOSS]) if row.verdict == "needed"]
    return (*(_one_of_both(row) if together else row for row in found), *together)


def _one_of_both(row: LossEvidence) -> LossEvidence:
    """Return a loss of which nobody knows whether it or the other one is there: neither can be done without."""
    if row.name not in APART or row.verdict != "not needed":
        return row
    text = (
        f"the data do not tell {row.name} from what they need in its place: at most {row.size_ci95[1]:.2g} N m rms here"
    )
    return replace(row, verdict="cannot tell", text=text)


def _judged(fit: Weighed, name: str, quick: float, refit: float) -> LossEvidence:
    """Return the verdict on a loss by its factors: without and with a refit, nan where none was made."""
    size, interval, unit = _size(fit, name)
    exact = name == "driveline" and not np.isnan(refit)
    factor = refit if exact else quick
    highest = factor if exact or np.isnan(refit) else max(quick, refit)
    small = float(np.degrees(SMALL_ANGLE)) if unit == "deg" else fit.small
    limit = 2.0 * small if highest < SURELY_NOT else small
    verdict = "cannot tell"
    if factor > NEEDED:
        verdict = "needed"
    elif LEAST_FACTOR < highest < NOT_NEEDED and interval[1] < limit:
        verdict = "not needed"
    text = _sentence(_in_words(name, fit.order), verdict, factor, size, interval, unit)
    return LossEvidence(name, factor, verdict, not np.isnan(refit), size, interval, unit, text)


def _by_part(fit: Weighed, row: LossEvidence, refitted: Refits | None) -> LossEvidence:
    """Return a torque loss as needed where one part of it is, whose factor pays for the choice among the parts."""
    if row.name not in APART or row.verdict == "needed":
        return row
    members = fit.members(row.name)
    factor, part = max(((fit.factor((name,)), name) for name in members), default=(-np.inf, ""))
    if factor <= 0.0:
        return row
    refit = refitted([(part,)])[0] if refitted else np.nan
    factor = (factor if np.isnan(refit) else refit) - 2.0 * math.log(len(members))
    if not factor > NEEDED:
        return row
    size = f"({row.size:.2g} {row.unit} rms; {strength(factor)})"
    meaning = fit.rows[fit.names.index(part)].meaning
    text = f"the data need {row.name} {size}: {meaning}, whatever the rest of it is"
    return replace(row, two_ln_bayes_factor=factor, verdict="needed", confirmed_by_refit=not np.isnan(refit), text=text)


def _from_zero(row: LossEvidence) -> LossEvidence:
    """Return a loss whose interval begins at nothing unless it is needed: draws of what cannot be negative never do."""
    return row if row.verdict == "needed" else replace(row, size_ci95=(0.0, row.size_ci95[1]))


def where_unexplained(evidence: tuple[LossEvidence, ...]) -> tuple[LossEvidence, ...]:
    """Return the evidence of a fit that leaves something unexplained: what it does not need may be what is missing."""
    return tuple(
        replace(row, verdict="cannot tell", text=f"{row.text}; the rest that stays unexplained may be just that")
        if row.verdict == "not needed" else row for row in evidence
    )  # fmt: skip


def _refitted(problem: Problem, solution: Solution, cov: Covariance, names: tuple[str, ...]) -> float:
    """Return -2 ln Z of the fit without some parameters, nan so far from the data that tangents overflow."""
    fewer = build_problem(problem.data, dict.fromkeys(names, 0.0))
    kept = dict(zip(problem.names, solution.z, strict=True))
    start = np.array([kept[name] for name in fewer.names])
    found = attempted(solve, fewer, start, Effort(25), solution.lift)
    return np.nan if found is None else laplace(fewer, found, cov.inflation)


def _size(fit: Weighed, name: str) -> tuple[float, tuple[float, float], str]:
    """Return how much a loss moves the mean cycle, with 95 % interval: rms torque [N m] or rms twist [deg].

    Draws lie about the mean within the bounds, which the minimum may lie beside: the interval holds that, too.
    """
    chosen, inside = fit.places(fit.members(name)), fit.posterior.within
    root = np.linalg.cholesky(inside.matrix[np.ix_(chosen, chosen)] + 1e-30 * np.eye(chosen.size))
    normal = np.random.default_rng(1).standard_normal((SIZE_DRAWS, chosen.size))
    drawn = np.clip(inside.mean[chosen] + normal @ root.T, fit.posterior.lower[chosen], fit.posterior.upper[chosen])
    each = np.vstack([fit.best[chosen], drawn])
    mean_square = np.einsum("ij,jk,ik->i", each, fit.moves[name], each)
    sizes = (180.0 / np.pi if name == "driveline" else 1.0) * np.sqrt(np.maximum(mean_square, 0.0))
    low, high = np.quantile(sizes[1:], [0.025, 0.975])
    best = float(sizes[0])
    return best, (min(float(low), best), max(float(high), best)), "deg" if name == "driveline" else "N m"


def _columns(output: ChainOutput, names: Sequence[str], loss: str) -> Array:
    if loss != "driveline":
        columns = derivative_by(output, list(names))
        return columns - np.mean(columns, axis=0) if loss in VARYING else columns
    shifts = output.motion.shifts[0][:, [SHIFT_NAMES.index(member) for member in names]]
    return np.asarray(shifts - np.mean(shifts, axis=0))


def strength(factor: float) -> str:
    """Return 2 ln K in words; beyond `LARGE` its size tells nothing more."""
    return f"2 ln K > {LARGE:.0f}" if factor > LARGE else f"2 ln K = {factor:.0f}"


def _in_words(name: str, order: int) -> str:
    """Return a loss in words; what a wheel tells of the swing needs no law, whatever it is made by."""
    if name != "driveline":
        return name.replace("_", " ")
    above = f" beyond the {order} orders a turn that the wheel shows" if order else ""
    return f"twist of shaft, coupling and drive{above}"


def _sentence(what: str, verdict: str, factor: float, size: float, interval: tuple[float, float], unit: str) -> str:
    most = f"at most {interval[1]:.2g} {unit} rms"
    if verdict == "needed":
        return f"the data need {what} ({size:.2g} {unit} rms; {strength(factor)})"
    if verdict == "not needed":
        return f"the data do not need {what}: {most} ({strength(factor)})"
    return f"the data cannot tell whether there is {what}: {most} ({strength(factor)})"
