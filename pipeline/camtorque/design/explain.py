"""Why a task has no solution, and what each limit costs where it has one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from camtorque.design.problem import Problem
from camtorque.design.programme import Scale, limit_scale, signs_of
from camtorque.design.responses import EQUAL, LEAST, MOST, RESPONSES
from camtorque.design.solver import Solution, multipliers
from camtorque.design.task import SLIP, Limit
from camtorque.records import Refusal

NOTHING = 1.0e-6
"""A multiplier below this share of that of the aims is rounding."""
CORNER = 0.1
"""An aim whose own multiplier is below this share of the others' has no price: the front has a corner there."""
SEEN = 1.0e-3
"""A miss above this share of the limit is told."""
SHARE = 0.02
"""A multiplier below this share of the greatest does not take part in a collision."""


@dataclass(frozen=True)
class Price:
    """What a limit or bound costs: the change of each aim per unit by which it is loosened, the other aims held.

    Attributes
    ----------
    what : limit or bound in words
    unit : of the limit
    per_aim : aim -> change of that aim, in its unit, per unit of the limit
    """

    what: str
    unit: str
    per_aim: Mapping[str, float]


ANY_FIRST = ("hollow_radius_mm", "contact_force_n")
"""Responses that may be far from any sensible limit at the first guess: no flank is hollow, or hardly any load."""
UNITS = {
    "mm3_per_deg": "mm³/deg", "mm_per_rad3": "mm/rad³", "mm_per_rad2": "mm/rad²", "mm_per_rad": "mm/rad",
    "N_per_mm": "N/mm", "mm3": "mm³", "mm": "mm", "deg": "deg", "rpm": "rpm", "gpa": "GPa", "nm": "N m", "N": "N",
    "n": "N", "j": "J",
}  # fmt: skip
"""End of a name -> unit; the longer ends first."""
KINDS = {"most": "at most", "least": "at least", "equal": "equal to"}


def _ending(name: str) -> str:
    return next((ending for ending in UNITS if name.endswith("_" + ending)), "")


def unit_of(name: str) -> str:
    """Return the unit that a name carries."""
    return UNITS.get(_ending(name), "")


def plain_name(name: str) -> str:
    """Return a response or quantity as words, without its unit."""
    stem = name.removesuffix(f"_{_ending(name)}") if _ending(name) else name
    return stem.replace("_", " ").replace("hertz", "Hertz pressure")


def limit_words(limit: Limit) -> str:
    """Return a limit as a sentence would say it."""
    return f"{plain_name(limit.response)} {KINDS[limit.kind]} {limit.value:g} {unit_of(limit.response)}".strip()


def prices(problem: Problem, scale: Scale, variables: np.ndarray, reference: np.ndarray | None) -> tuple[Price, ...]:
    """Return what every active limit and bound costs at a point of the front, the dearest first.

    The stationarity of the programme is ``sum mu_i grad f_i = sum lambda_j grad g_j``: with the other aims held, a
    limit loosened by d changes aim i by ``-lambda_j d / mu_i``, each in its own scale.
    """
    goal = np.zeros(len(problem.task.aims)) if reference is None else reference
    found = multipliers(problem, scale, variables, goal)
    aims = problem.task.aims
    weights = {name: found.get(f"aim {name}", 0.0) for name in aims}
    signs = dict(zip(aims, signs_of(problem) * scale.width, strict=True))
    rows = []
    limits = {f"limit {limit.text}": limit for limit in problem.limits}
    for label, weight in found.items():
        size = _size(problem, label, limits)
        if size is None or abs(weight) < NOTHING * max(weights.values()):
            continue
        per_aim = {
            name: -weight / size * signs[name] / weights[name]
            for name in aims
            if weights[name] > CORNER * max(weights.values())
        }
        name = limits[label].response if label in limits else label.split(" ")[1]
        bound = f"{label.split(' ')[0]} bound of {plain_name(name)}"
        what = limit_words(limits[label]) if label in limits else bound
        rows.append((weight, Price(what, unit_of(name), per_aim)))
    return tuple(price for _, price in sorted(rows, key=lambda row: -abs(row[0])))


def _size(problem: Problem, label: str, limits: Mapping[str, Limit]) -> float | None:
    """Return by what the constraint of a label is scaled, in its unit; None for what is no limit of the user."""
    if label in limits:
        return limit_scale(limits[label].value)
    names = [variable.name for variable in problem.task.variables]
    kind, _, name = label.partition(" ")
    if kind in ("lower", "upper") and name in names:
        return float(problem.width[names.index(name)])
    return None


def refuse_idle(problem: Problem) -> None:
    """Refuse limits that are so far from the first guess that they do nothing.

    Raises
    ------
    Refusal : a ``most`` far above it, or a ``least`` far below it: another unit's number
    """
    design = problem.evaluated(problem.start())
    for limit in problem.task.limits:
        first = RESPONSES[limit.response].value(design)
        idle = limit.value > SLIP * first if limit.kind == MOST else 0.0 < limit.value < first / SLIP
        if limit.kind != EQUAL and limit.response not in ANY_FIRST and first > 0.0 and idle:
            unit = unit_of(limit.response)
            raise Refusal(
                f"{problem.task.path} [limits] {limit.response}: found {limit.kind} {limit.value:g} {unit}, but the "
                f"first guess has {first:.3g} {unit}: it would limit nothing; check the unit, or leave it out"
            )


def refuse_collision(problem: Problem, nearest: Solution) -> NoReturn:
    """Refuse a task whose limits cannot be kept together.

    Raises
    ------
    Refusal : names the limits and bounds that collide at the least violation, and by how much
    """
    scale = Scale(np.zeros(len(problem.task.aims)), np.ones(len(problem.task.aims)))
    found = multipliers(problem, scale, nearest.variables, None, relaxed=True)
    limits = {f"limit {limit.text}": limit for limit in problem.limits}
    heavy = max((abs(w) for label, w in found.items() if label in limits), default=0.0)
    colliding = [limits[label] for label in sorted(found, key=lambda k: -abs(found[k]))
                 if label in limits and abs(found[label]) > SHARE * heavy]  # fmt: skip
    bounds = [label.replace(" ", " bound of ", 1) for label in found if label.split(" ")[0] in ("lower", "upper")
              and not label.endswith("shape")]  # fmt: skip
    design = problem.evaluated(nearest.variables)
    reached = {limit: RESPONSES[limit.response].value(design) for limit in problem.limits}
    # a limit of 0 has no size to be scaled by: what gives way to it is missed by little of a large scale
    colliding += [limit for limit, value in reached.items()
                  if limit not in colliding and over(limit, value) > SEEN * abs(limit.value)]  # fmt: skip
    missed = [_missed(limit, reached[limit]) for limit in colliding[:3] or problem.limits[:1]]
    against = " and ".join(missed)
    within = f" within the {', '.join(bounds)}" if bounds else " within the bounds of [free]"
    verb = "collide" if len(missed) > 1 else "cannot be met"
    raise Refusal(
        f"{problem.task.path} [limits]: no design keeps all limits; {against} {verb}{within}: the best compromise "
        "misses each by that much; loosen one of them, or widen those bounds"
    )


def over(limit: Limit, value: float) -> float:
    """Return by how much a value misses a limit, in its unit; below 0 where it is kept."""
    return {MOST: value - limit.value, LEAST: limit.value - value}.get(limit.kind, abs(value - limit.value))


def _missed(limit: Limit, value: float) -> str:
    """Return a limit with what the best compromise reaches."""
    unit = unit_of(limit.response)
    return f"{limit.text} (reached {value:.4g}, missed by {abs(value - limit.value):.3g} {unit})".replace("_", " ")
