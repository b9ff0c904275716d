"""Which losses do the data need? Evidence from the full fit, confirmed by refits where it is close.

For a loss e that vanishes with its parameters, Gaussian posterior (mu, C) and prior (d, P) of the full fit and bounds
``box``, the Savage-Dickey ratio gives the Bayes factor without another fit::

    2 ln K = mu_e' C_ee^-1 mu_e + ln det C_ee + 2 ln Pr(box) - 2 ln Pr(rest in box | e = 0) - the same of the prior

and a fit without the loss gives it by Laplace's approximation,
``-2 ln Z = chi^2 - g'Cg + ln det H - ln det P^-1 - 2 ln Pr(box) + 2 ln Pr_prior(box)``,
where g is the slope left at a minimum against the bounds and g'Cg what these cost, which Pr(box) holds already.

Friction and damping have parts of which any may be there: K is then the ratio of the means over all sets of parts
with and without the loss, each set by its ratio against all parts. *Needed*: K above `PROBABLE`, and all parts as one
not below `NOT_NEEDED`. *Not needed*: K below its inverse, or below the root of that where all parts as one are below
`NOT_NEEDED`, both with what a refit adds, and the loss small against the mean torque whatever the data allow (a small
K alone is not absence). Else the data cannot tell, or that one of both is there and not which. A driveline is one
thing: *needed* by `NEEDED`, *not needed* by `NOT_NEEDED` and a small twist, twice as large by `SURELY_NOT`.
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
from camtorque.fit.presence import presence, savage_dickey
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
PROBABLE = 4.0
"""2 ln K from which a torque loss is said to be there, and minus which not: seven to one where both are as likely."""
SMALL_SHARE = 0.15
"""A torque loss is small below this share of the mean torque (rms)."""
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


def loss_evidence(problem: Problem, solution: Solution, cov: Covariance) -> tuple[LossEvidence, ...]:
    """Return the evidence for every loss of one recording's fit, the chamber's aside, and for two together."""
    small = SMALL_SHARE * abs(float(np.mean(problem.data[0].torque)))
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
    torque_losses = present(fit) if set(APART) <= set(losses) else {}
    quickly = {name: fit.factor(fit.members(name)) for name in losses}
    close = [name for name, quick in quickly.items() if quick < REFIT_BELOW or name == "driveline"]
    refits = dict(zip(close, refitted([MEMBERS[name] for name in close]), strict=True)) if refitted else {}
    found = []
    for name, quick in quickly.items():
        refit = refits.get(name, np.nan)
        if name in torque_losses:
            found.append(_torque_loss(fit, name, torque_losses[name], (quick, refit)))
        else:
            found.append(_driveline(fit, name, quick, refit))
    apart = any(row.verdict == "needed" for row in found if row.name in APART)
    either = torque_losses.get(EITHER_LOSS)
    together = None if apart or either is None else _torque_loss(fit, EITHER_LOSS, either)
    if together is None or together.verdict != "needed":
        return tuple(map(_from_zero, found))
    return (*(_from_zero(_one_of_both(row)) for row in found), together)


def _one_of_both(row: LossEvidence) -> LossEvidence:
    """Return a loss that may be the one of both which the data need: it is not needless by the lower limit."""
    if row.name not in APART or row.verdict != "not needed" or row.two_ln_bayes_factor < -PROBABLE:
        return row
    text = (
        f"the data do not tell {row.name} from what they need in its place: at most {row.size_ci95[1]:.2g} N m rms here"
    )
    return replace(row, verdict="cannot tell", text=text)


def present(fit: Weighed) -> dict[str, float]:
    """Return 2 ln K for friction, damping, and either, whichever of their parts are there."""
    groups = [fit.members(loss) for loss in APART]
    places = fit.places([name for group in groups for name in group])
    factors = presence(fit.posterior.of(places), fit.prior.of(places), len(groups[0]))
    return dict(zip((*APART, EITHER_LOSS), factors, strict=True))


def _torque_loss(fit: Weighed, name: str, factor: float, whole: tuple[float, float] = (np.nan, np.nan)) -> LossEvidence:
    """Return the verdict on friction, damping or either; ``whole``: 2 ln K of all its parts, quickly and by a refit.

    A part may stand in for what a law lacks elsewhere: where all parts as one say the contrary, the data cannot tell.
    """
    size, interval, unit = _size(fit, name)
    quick, refit = whole
    missed = float(np.fmax(refit - quick, 0.0))
    limit = 0.5 * PROBABLE if quick + missed < NOT_NEEDED else PROBABLE
    contradicted = (quick if np.isnan(refit) else refit) < NOT_NEEDED
    verdict = "cannot tell"
    if factor > PROBABLE and not contradicted:
        verdict = "needed"
    elif factor + missed < -limit and interval[1] < fit.small:
        verdict = "not needed"
    text = _sentence(_in_words(name, fit.order), verdict, factor, size, interval, unit)
    return LossEvidence(name, factor, verdict, not np.isnan(refit), size, interval, unit, text)


def _driveline(fit: Weighed, name: str, quick: float, refit: float) -> LossEvidence:
    """Return the verdict on a driveline by its factors: without and with a refit, nan where none was made."""
    size, interval, unit = _size(fit, name)
    factor = quick if np.isnan(refit) else refit
    limit = float(np.degrees(SMALL_ANGLE)) * (2.0 if factor < SURELY_NOT else 1.0)
    verdict = "cannot tell"
    if factor > NEEDED:
        verdict = "needed"
    elif LEAST_FACTOR < factor < NOT_NEEDED and interval[1] < limit:
        verdict = "not needed"
    text = _sentence(_in_words(name, fit.order), verdict, factor, size, interval, unit)
    return LossEvidence(name, factor, verdict, not np.isnan(refit), size, interval, unit, text)


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
