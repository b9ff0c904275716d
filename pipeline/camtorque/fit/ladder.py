"""Which effects do the data need? Upward from the rigid model, then back down.

Effects help each other (a twist without the low-pass behind it explains nothing), so the way up adds one effect after
the other and only records what each brings; the way down takes from the chain every effect whose absence costs nothing.
The trigger angle stays in any case: its sheet declares a tolerance. Another effect stays when without it the score
rises and the held-out cycles (in a campaign: the left-out recordings) do not improve.

The score is an information criterion on the number of *independent* residuals: neighbouring bins of a filtered signal
repeat each other, and the plain criterion takes a useless smooth term in half of all trials. A parameter that
no sheet limits costs ``max(ln n_eff, 4.7)`` (chi-square exceeds 4.7 in 3 % of trials); those with
a prior cost what the data narrow it, ``ln det(1 + H/P)``, the Occam factor of the evidence (MacKay 1992).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.many import minimise
from camtorque.fit.predict import HeldOutError
from camtorque.fit.prepare import CORRELATION
from camtorque.fit.problem import FIT_EFFECTS, FitData, build_problem
from camtorque.fit.solve import Solution
from camtorque.records import Array, LadderRung

SCORE_NAME = "BIC on independent residuals"
DECLARED = ("trigger",)
"""Effects that stay: the sheet declares an installation tolerance, so the mounted angle is a nuisance with a prior."""
LEAST_PENALTY = 4.7
RUNG_ITERATIONS = 40
RUNG_TOLERANCE = 1.0e-5
"""A rung is judged by differences of chi-square of several units; the chosen one is solved to the end afterwards."""
LONGEST_CORRELATION = 60.0
EVIDENCE = 2.0
"""Least loss of score for which an effect stays: positive evidence (2 ln K > 2; Kass & Raftery 1995). Parameters
with priors cost no score where the data say nothing about them."""
CROSS_VALIDATION_SLACK = 1.004
"""Held-out misfit may rise by this factor, its own scatter, before a rung counts as worse."""

HeldOut = Callable[[Sequence[str], Solution, Sequence[FitData]], HeldOutError]


@dataclass(frozen=True)
class Rung:
    """One set of effects with its minimum."""

    effects: tuple[str, ...]
    solution: Solution
    n_parameters: float
    score: float
    held_out: HeldOutError


def correlation_length(residual: Array) -> float:
    """Return the bins that carry one independent value: 1 + 2 sum of the autocorrelation up to its first zero.

    Parameters
    ----------
    residual : (m,) over one revolution, periodic
    """
    centred = residual - np.mean(residual)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(centred)) ** 2, residual.size)
    if correlation[0] <= 0.0:
        return 1.0
    correlation = correlation[: residual.size // 2] / correlation[0]
    negative = np.flatnonzero(correlation <= 0.0)
    stop = int(negative[0]) if negative.size else correlation.size
    return float(np.clip(1.0 + 2.0 * np.sum(correlation[1:stop]), 1.0, LONGEST_CORRELATION))


def independent_count(data: Sequence[FitData], residuals: Sequence[Array]) -> float:
    """Return the number of independent residuals of all recordings."""
    return sum(
        residual.size / correlation_length(residual * item.weight)
        for item, residual in zip(data, residuals, strict=True)
    )


def effective_parameters(solution: Solution) -> float:
    """Return the degrees of freedom that the data spend: trace of (H + prior)^-1 H."""
    return float(np.trace(np.linalg.lstsq(solution.hessian, solution.data_hessian, rcond=1e-14)[0]))


def score_of(solution: Solution, mean_square: float, n_independent: float) -> float:
    """Return the score of a minimum; the smaller, the better.

    Parameters
    ----------
    mean_square : data chi-square per independent residual of the whole chain, the common scale of the noise
    n_independent : number of independent residuals
    """
    n_bins = sum(residual.size for residual in solution.residuals)
    prior = np.diag(solution.hessian - solution.data_hessian)
    information = solution.data_hessian / mean_square + np.diag(prior)
    known = prior > 1e-12
    block = information[np.ix_(known, known)]
    if (~known).any():
        cross = information[np.ix_(known, ~known)]
        inner = information[np.ix_(~known, ~known)] + 1e-12 * np.eye(int((~known).sum()))
        block = block - cross @ np.linalg.solve(inner, cross.T)
    ratio = block / np.sqrt(np.outer(prior[known], prior[known]))
    occam = float(np.linalg.slogdet(ratio)[1]) if known.any() else 0.0
    penalty = float((~known).sum()) * max(np.log(n_independent), LEAST_PENALTY)
    priors = (solution.chi_square - solution.data_chi_square) * 1.0
    misfit = n_independent * solution.data_chi_square / n_bins * CORRELATION / mean_square
    return float(misfit + priors + occam + penalty)


def climb(
    data: Sequence[FitData],
    held_out_error: HeldOut,
    order: Sequence[str] = FIT_EFFECTS,
    untested: str = "",
) -> tuple[tuple[str, ...], Solution, tuple[LadderRung, ...]]:
    """Return the chosen effects, their minimum, and every rung with its reason.

    Parameters
    ----------
    data : recordings with starts in the right basin
    held_out_error : on data that the rung has not seen
    order : effects in the order in which they are offered
    untested : remark that is added to each reason, such as "untested on other recordings"
    """
    full = _rung(data, tuple(order), held_out_error, None)
    n_independent = independent_count(data, full.solution.residuals)
    mean_square = full.solution.data_chi_square / sum(r.size for r in full.solution.residuals) * CORRELATION

    seen = {full.effects: replace(full, score=score_of(full.solution, mean_square, n_independent))}

    def tried(effects: tuple[str, ...]) -> Rung:
        if effects not in seen:
            rung = _rung(data, effects, held_out_error, full)
            seen[effects] = replace(rung, score=score_of(rung.solution, mean_square, n_independent))
        return seen[effects]

    rows: list[tuple[Rung, str]] = []
    previous = tried(())
    rows.append((previous, "torque zero alone"))
    for count in range(1, len(order)):
        rung = tried(tuple(order[:count]))
        rows.append((rung, f"upward: with {order[count - 1]} {_change(previous, rung)}"))
        previous = rung
    current = tried(tuple(order))
    rows.append((current, f"upward: with {order[-1]} {_change(previous, current)}"))
    current, down = _descend(current, order, tried)
    rows += down
    # a set may be tried again after another effect has gone: the last of its rows is the choice
    last = max(k for k, (rung, _) in enumerate(rows) if rung is current)
    table = tuple(_row(rung, k == last, reason, untested) for k, (rung, reason) in enumerate(rows))
    return current.effects, current.solution, table


def _descend(
    current: Rung, order: Sequence[str], tried: Callable[[tuple[str, ...]], Rung]
) -> tuple[Rung, list[tuple[Rung, str]]]:
    """Drop effects until every one left is needed; one that helped another may go once the other has gone."""
    rows: list[tuple[Rung, str]] = []
    seen: set[tuple[str, ...]] = set()
    dropped = True
    while dropped:
        dropped = False
        for effect in (name for name in reversed(order) if name in current.effects and name not in DECLARED):
            fewer = tuple(name for name in current.effects if name != effect)
            if fewer in seen:
                continue
            seen.add(fewer)
            trial = tried(fewer)
            missed = trial.score > current.score + EVIDENCE
            stays = missed and trial.held_out.misfit * CROSS_VALIDATION_SLACK > current.held_out.misfit
            verdict = "stays" if stays else "is dropped"
            rows.append((trial, f"back: without {effect} {_change(current, trial)}; it {verdict}"))
            if not stays:
                current, dropped = trial, True
    return current, rows


def _change(before: Rung, after: Rung) -> str:
    score = after.score - before.score
    misfit = after.held_out.misfit / before.held_out.misfit - 1.0
    rms = f"held-out rms {before.held_out.rms:.3f} -> {after.held_out.rms:.3f} N m"
    return f"score {score:+.1f}, {rms}, misfit {100.0 * misfit:+.1f} %"


def _rung(data: Sequence[FitData], effects: tuple[str, ...], held_out_error: HeldOut, full: Rung | None) -> Rung:
    problem = build_problem(data, effects)
    start = None
    if full is not None:
        known = dict(zip([s.name for s in build_problem(data, full.effects).nonlinear], full.solution.x, strict=True))
        start = np.array([known.get(slot.name, slot.row.start) for slot in problem.nonlinear])
    solution = minimise(problem, start, RUNG_ITERATIONS, RUNG_TOLERANCE)
    return Rung(effects, solution, effective_parameters(solution), np.nan, held_out_error(effects, solution, data))


def _row(rung: Rung, chosen: bool, reason: str, untested: str) -> LadderRung:
    rms = float(np.sqrt(np.mean(np.concatenate(rung.solution.residuals) ** 2)))
    text = f"{reason} ({untested})" if untested else reason
    return LadderRung(
        rung.effects, round(rung.n_parameters), rms, rung.score, SCORE_NAME, rung.held_out.rms, chosen, text
    )
