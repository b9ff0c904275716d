"""How delivery ends in the recordings of one pump: each searched anew by shared values, and all of them alike.

A pump ends its delivery one way, by a land or by spill. One recording alone may hardly tell which, and a prediction
from the others then ends as another pump would.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from camtorque.fit.joint_solver import JointSolution, solve_many
from camtorque.fit.known_ends import END_OF
from camtorque.fit.minima import attempted
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import FitData, Problem, build_problem, in_structure, started_at, with_starts
from camtorque.fit.search import SCAN_KEPT, SCAN_SHARES
from camtorque.fit.solver import approach, lift_at, try_at
from camtorque.fit.starts import SEARCH_LIFT_CUT, chi_square_at_start, ends_at
from camtorque.process.threads import Each

OWN_ITERATIONS = 12
OTHERWISE = 6.0
"""Chi-square that a recording has to gain by ending otherwise than the others: -2 ln of one in twenty."""


def with_known(item: FitData, values: Mapping[str, float]) -> FitData:
    """Return a recording that starts at shared values, those that it has rows for."""
    return with_starts(item, {name: value for name, value in values.items() if name in item.rows})


def own_fitted(item: FitData, held: Mapping[str, float]) -> tuple[float, FitData]:
    """Return chi-square and recording where some iterations in the parameters that are not held lead."""
    problem = build_problem([item], held)
    modes = lift_at(problem, problem.start, SEARCH_LIFT_CUT)
    trial = approach(problem, try_at(problem, problem.start, modes), OWN_ITERATIONS, modes, 0.0)
    return trial.chi_square, started_at(problem, trial.z)[0]


def searched_anew(item: FitData, structures: tuple[str, ...] = ("land", "spill", "open")) -> FitData:
    """Return a recording in the structure and with the end of delivery that the shared values like best.

    As in the search of one recording only what is large of the lift correction counts. All places are weighed with that
    of the start, the best of them fitted, each with its own. A chamber that was measured is not rebuilt here either.
    """
    held = {name: row.start for name, row in item.rows.items() if row.role == "shared"}
    rough = replace(item, lift_basis=item.lift_basis.thinned())
    problem = build_problem([rough], held)
    lift = lift_at(problem, problem.start, SEARCH_LIFT_CUT)
    tried: list[FitData] = []
    for structure in item.structures if item.measures_chamber else structures:
        other = in_structure(rough, structure)
        tried += [rough] if structure == item.structure and structure in END_OF else []
        tried += [with_starts(other, end) for end in ends_at(other, SCAN_SHARES)] if structure in END_OF else [other]
    values = [chi_square_at_start(trial, lift, held) for trial in tried]
    likely = [tried[k] for k in np.argsort(values, kind="stable")[:SCAN_KEPT]]
    fitted = [attempted(own_fitted, start, held) or (np.inf, start) for start in likely]
    best = min(fitted, key=lambda pair: pair[0])[1]
    return replace(best, lift_basis=item.lift_basis)


def with_one_ending(problem: Problem, solution: JointSolution, each: Each) -> tuple[Problem, JointSolution]:
    """Return a joint minimum in which all recordings end as most do, where the mixed one is not better by enough.

    Most are not turned to the way of few: an end that is none may meet what a law lacks.
    """
    ways = [item.structure for item in problem.data if not item.measures_chamber]
    if len(set(ways)) < 2:
        return problem, solution
    most = max(map(ways.count, ways))
    usual = sorted(way for way in set(ways) if ways.count(way) == most)
    ended = [end for way in usual if (end := _all_ended(problem, solution, way, each))]
    mixed, *alike = costs([(problem, solution), *ended])
    if not alike or min(alike) > mixed + OTHERWISE * (len(ways) - most):
        return problem, solution
    return ended[int(np.argmin(alike))]


def costs(ends: Sequence[tuple[Problem, JointSolution]]) -> list[float]:
    """Return what joint minima of the same recordings cost by evidence: chi-square, and one for each parameter.

    Of chi-square, one is what a further parameter takes by chance; what the best of them leaves of it per independent
    value, where that is more than expected, is its unit.
    """
    problem, _ = ends[0]
    left = min(end.data_chi_square for _, end in ends) / (INDEPENDENT * len(problem.data))
    return [end.chi_square / max(1.0, left) + one.size for one, end in ends]


def _all_ended(problem: Problem, solution: JointSolution, way: str, each: Each) -> tuple[Problem, JointSolution] | None:
    """Return the joint minimum in which all recordings end one way, the others searched anew."""
    found = started_at(problem, solution.z)
    others = [k for k, item in enumerate(found) if item.structure != way and not item.measures_chamber]
    turned = each(partial(searched_anew, structures=(way,)), [found[k] for k in others])
    alike = build_problem([turned.pop(0) if k in others else item for k, item in enumerate(found)])
    ended = attempted(solve_many, alike, alike.start, 25, 0.0, each)
    return (alike, ended) if ended else None
