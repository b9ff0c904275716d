"""A minimum applied to data that it has not seen: held-out cycles, left-out recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.problem import FitData, Problem, build_problem
from camtorque.fit.solve import Solution, chain_coefficients, solve
from camtorque.laws.chain import ChainOutput, evaluate_chain
from camtorque.records import Array

NUISANCES = ("torque_zero", "end_of_delivery", "spill_lift", "spill_width")
"""Own parameters that a left-out recording may fit; its pressure zero stays at its prior."""


def torque_zero(problem: Problem, solution: Solution, index: int) -> float:
    """Return the torque zero of one recording [N m]."""
    for slot, value in zip(problem.linear, solution.c, strict=False):
        if slot.row.name == "torque_zero" and slot.recording == index:
            return float(value)
    return float(problem.held_linear.get("torque_zero", 0.0))


def model_torque(problem: Problem, solution: Solution, index: int, item: FitData) -> tuple[Array, ChainOutput]:
    """Return the torque, (m,) in bins, that the minimum predicts for one recording on other cycles."""
    data = replace(item, chain=_like(problem.data[index], item)).chain
    output = evaluate_chain(data, problem.values(solution.x, index))
    coefficients = chain_coefficients(problem, solution.c)
    return output.torque + output.linear @ coefficients + torque_zero(problem, solution, index), output


def _like(template: FitData, item: FitData):  # type: ignore[no-untyped-def]
    """Return the chain of an item with the links that the problem has switched on."""
    basis = item.chain.lift_basis if template.chain.lift_basis is not None else None
    return replace(item.chain, uses_chamber=template.chain.uses_chamber, lift_basis=basis)


@dataclass(frozen=True)
class HeldOutError:
    """How well a minimum predicts what it has not seen.

    rms : measured - model [N m]; misfit : weighted sum of squares, priors of what the prediction had to fit included
    """

    rms: float
    misfit: float


def held_out_error(problem: Problem, solution: Solution, held: Sequence[FitData]) -> HeldOutError:
    """Return the error over the held-out cycles of all recordings."""
    squares, misfit = [], 0.0
    for index, item in enumerate(held):
        residual = item.torque - model_torque(problem, solution, index, item)[0]
        squares.append(np.mean(residual**2))
        misfit += float(np.sum((residual * item.weight) ** 2))
    return HeldOutError(float(np.sqrt(np.mean(squares))), misfit)


def shared_values(problem: Problem, solution: Solution) -> tuple[dict[str, float], Array | None]:
    """Return the shared parameters of a minimum, and its lift coefficients."""
    values = {s.row.name: float(v) for s, v in zip(problem.nonlinear, solution.x, strict=True) if s.recording < 0}
    values.update({s.row.name: float(v) for s, v in zip(problem.linear, solution.c, strict=False) if s.recording < 0})
    lift = solution.c[len(problem.linear) :] if problem.n_lift else problem.held_lift
    return values, lift


def left_out(
    problem: Problem, solution: Solution, item: FitData, extra: dict[str, float] | None = None
) -> tuple[Problem, Solution]:
    """Return the prediction of a recording that the minimum has not seen, its own nuisances fitted.

    Parameters
    ----------
    problem, solution : fit to the other recordings
    item : the left-out recording
    extra : nuisances that are held as well, such as a predicted end of delivery (blind)
    """
    values, lift = shared_values(problem, solution)
    held = {**values, "pressure_zero": 0.0, **(extra or {})}
    if "chamber" not in problem.effects:
        held.pop("pressure_zero")
    own = build_problem([item], problem.effects, held, lift)
    return own, solve(own, max_iterations=30)
