"""The Pareto front of a task: best of each aim, then evenly spread points between, for every family of flanks."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import combinations, pairwise
from math import ceil, comb

import numpy as np

from camtorque.design.explain import refuse_collision, refuse_idle
from camtorque.design.problem import Problem
from camtorque.design.responses import RESPONSES, Design, Evaluated
from camtorque.design.solver import Scale, Solution, reached, scaled_aims, signs_of, solve, violation
from camtorque.design.task import KNEE, Task
from camtorque.process.second_process import in_two
from camtorque.progress import Progress
from camtorque.records import Array, ReadOnly, Refusal

SAME = 1.0e-4
"""Scaled distance of two points of the front below which they are one."""
WORTHWHILE = 1.0e-6
"""Gain in every aim, scaled, from which one design is better than another."""
FREE = 2.0
"""Reference of the other aims at the best design of one: none is so far from its ideal, so that none holds it."""
NARROW = 1.0e-6
"""Distance of ideal and worst value over the value below which an aim does not pull against the others."""


@dataclass(frozen=True)
class FrontPoint(ReadOnly):
    """One design of the front: the variables of its problem, the reference that it is closest to, its aims 0 to 1."""

    problem: Problem
    variables: Array
    reference: Array
    aims: Array

    @property
    def design(self) -> Design:
        """The design."""
        return self.evaluated.design

    @cached_property
    def evaluated(self) -> Evaluated:
        """The design under the loads of its task."""
        return self.problem.evaluated(self.variables)

    @cached_property
    def responses(self) -> dict[str, float]:
        """Every response of it in its unit."""
        return {name: response.value(self.evaluated) for name, response in RESPONSES.items()}


@dataclass(frozen=True)
class Front:
    """All points that no other is better than, in the order of the first aim; the scale of the aims; the chosen one."""

    points: tuple[FrontPoint, ...]
    scale: Scale
    chosen: int


def find_front(task: Task, tell: Progress) -> Front:
    """Return the front of a task.

    Raises
    ------
    Refusal : a limit limits nothing; no design keeps all limits; the message says which collide, and by how much
    """
    problems = [Problem(task, family) for family in task.families]
    refuse_idle(problems[0])
    ends = [_ends(problem, tell) for problem in problems]
    if not any(ends):
        refuse_collision(problems[0], min((_least_violation(p) for p in problems), key=lambda s: s.violation))
    scale = _common_scale(task, [(p, s) for p, rows in zip(problems, ends, strict=True) for s in rows])
    # each family that keeps the limits gets as many; the answer has fewer where some lose
    share = max(2, ceil(task.points / sum(map(bool, ends))))
    points = [point for problem, rows in zip(problems, ends, strict=True) if rows
              for point in _between(problem, scale, rows, share, tell)]  # fmt: skip
    kept = _filled(_best(points), scale, task.points)
    return Front(kept, scale, _choice(task, kept))


def own_scale(problem: Problem) -> Scale:
    """Return a scale by the size of the aims at the first guess."""
    sizes = np.array([abs(RESPONSES[name].value(problem.first_guess)) for name in problem.task.aims])
    return Scale(np.zeros(sizes.size), np.maximum(sizes, 1e-9))


def _least_violation(problem: Problem) -> Solution:
    found = []
    for start in problem.starts(problem.start(), problem.task.starts):
        found.append(solve(problem, own_scale(problem), start, relaxed=True))
        if found[-1].feasible:
            break
    return min(found, key=lambda solution: solution.violation)


def _ends(problem: Problem, tell: Progress) -> list[Solution]:
    """Return the best design of each aim, empty where the limits cannot be kept."""
    scale, task = own_scale(problem), problem.task
    start = problem.start()
    if violation(problem, start) > 0.0:
        relaxed = _least_violation(problem)
        if not relaxed.feasible:
            tell(f"{problem.family.name}: no design keeps all limits")
            return []
        start = relaxed.variables
    starts = problem.starts(start, task.starts - 1)
    ends = []
    for i, name in enumerate(task.aims):
        best = _best_of(problem, scale, starts, i)
        value = RESPONSES[name].value(problem.evaluated(best.variables))
        tell(f"{problem.family.name}: best {name} {value:.5g}")
        ends.append(best)
    return ends


def _best_of(problem: Problem, scale: Scale, starts: list[Array], aim: int) -> Solution:
    """Return the best design of one aim from several starts; the first one keeps all limits."""
    found = [reached(problem, scale, starts[0])]
    for pair in in_two(partial(_solved_twice, problem, scale, aim), starts):
        found += pair
    return min((s for s in found if s.feasible), key=lambda s: float(s.aims[aim]))


def _solved_twice(problem: Problem, scale: Scale, aim: int, start: Array) -> list[Solution]:
    """Return two runs, one from where the other ended: the second forgets the curvature that led the first astray."""
    first = solve(problem, scale, start, single=aim)
    return [first, solve(problem, scale, first.variables, single=aim)]


def _common_scale(task: Task, ends: list[tuple[Problem, Solution]]) -> Scale:
    """Return offset and width of every aim from its best and its worst value among the best designs."""
    values = np.array([
        signs_of(problem) * [RESPONSES[n].value(problem.evaluated(s.variables)) for n in task.aims]
        for problem, s in ends
    ])  # fmt: skip
    ideal, worst = values.min(axis=0), values.max(axis=0)
    width = np.where(worst - ideal > NARROW * np.abs(worst), worst - ideal, np.maximum(np.abs(worst), 1e-9))
    return Scale(ideal, width)


def references(aims: int, count: int) -> Array:
    """Return evenly spread reference points with a sum of 1, (k, aims): a simplex lattice with at least ``count``."""
    if aims == 1:
        return np.zeros((1, 1))
    steps = 1
    while comb(steps + aims - 1, aims - 1) < count:
        steps += 1
    cuts = combinations(range(steps + aims - 1), aims - 1)
    rows = [np.diff([-1, *cut, steps + aims - 1]) - 1 for cut in cuts]
    return np.array(rows, dtype=np.float64) / steps


def _between(problem: Problem, scale: Scale, ends: list[Solution], count: int, tell: Progress) -> Iterator[FrontPoint]:
    """Yield the points of a family, two at a time, each started from the solved one that is nearest."""
    goals = references(len(ends), count)
    own = FREE * (1.0 - np.eye(len(ends)))
    solved = [FrontPoint(problem, s.variables, goal, scaled_aims(problem, scale, s.variables))
              for s, goal in zip(ends, own, strict=True)]  # fmt: skip
    yield from solved
    if len(ends) == 1:
        return
    # from the corners of the lattice inwards, so that every point has a solved neighbour
    order = np.argsort(-np.max(goals, axis=1), kind="stable")
    done, begun = 0, time.monotonic()
    for first in range(0, order.size, 2):
        wanted = [(goals[at], _nearest(goals[at], solved)) for at in order[first : first + 2]]
        for found in in_two(partial(_approach, problem, scale), wanted):
            if found is not None:
                solved.append(found)
                yield found
        number = first + len(wanted)
        if 10 * number // order.size > done:
            done = 10 * number // order.size
            left = (time.monotonic() - begun) / number * (order.size - number)
            tell(f"{problem.family.name}: {number} of {order.size} points of the front, {left:.0f} s left")


def _nearest(goal: Array, solved: list[FrontPoint]) -> list[FrontPoint]:
    """Return the two points that are nearest to a reference point on the lattice: by what aims have not in common."""
    place = goal - np.mean(goal)
    return sorted(solved, key=lambda point: float(np.sum((point.aims - np.mean(point.aims) - place) ** 2)))[:2]


def _approach(problem: Problem, scale: Scale, wanted: tuple[Array, list[FrontPoint]]) -> FrontPoint | None:
    """Return the design closest to a reference point, from the first of some points that leads to one."""
    goal, near = wanted
    for start in near:
        found = solve(problem, scale, start.variables, reference=goal)
        if found.feasible:
            return FrontPoint(problem, found.variables, goal, found.aims)
    return None


def _best(points: list[FrontPoint]) -> tuple[FrontPoint, ...]:
    """Return the points that no other is better than, each once, in the order of the first aim."""
    kept: list[FrontPoint] = []
    for point in points:
        beaten = any(np.all(other.aims <= point.aims + WORTHWHILE) and np.any(other.aims < point.aims - WORTHWHILE)
                     for other in points)  # fmt: skip
        twice = any(np.max(np.abs(other.aims - point.aims)) < SAME for other in kept)
        if not beaten and not twice:
            kept.append(point)
    return tuple(sorted(kept, key=lambda point: float(point.aims[0])))


def _filled(points: tuple[FrontPoint, ...], scale: Scale, count: int) -> tuple[FrontPoint, ...]:
    """Return a front of two aims with points put into its widest gaps until there are as many as were asked for.

    Where the front runs along an axis, or families take turns, fewer points are left than were searched.
    """
    found, hopeless = list(points), set()
    for _ in range(count):
        if len(found) >= count or not points or points[0].aims.size != 2:
            break
        gaps = [float(np.max(np.abs(b.aims - a.aims))) for a, b in pairwise(found)]
        open_gaps = [k for k in range(len(gaps)) if gaps[k] > 4.0 * SAME and id(found[k]) not in hopeless]
        if not open_gaps:
            break
        at = max(open_gaps, key=lambda k: gaps[k])
        here, there = found[at : at + 2]
        near = [point for point in (here, there) if point.problem is here.problem]
        new = _approach(here.problem, scale, (0.5 * (here.aims + there.aims), near))
        better = _best([*found, new]) if new is not None else tuple(found)
        if len(better) <= len(found):
            hopeless.add(id(found[at]))
        found = list(better)
    return tuple(found)


def _choice(task: Task, points: tuple[FrontPoint, ...]) -> int:
    """Return the point that was asked for: best in one aim, or the knee, where the worst scaled aim is least."""
    if not points:
        raise Refusal(f"{task.path}: no point of the front was found; widen the bounds in [free] or the limits")
    if task.choose == KNEE:
        return int(np.argmin([np.max(point.aims) + 1e-3 * np.sum(point.aims) for point in points]))
    aim = task.aims.index(task.choose)
    return int(np.argmin([point.aims[aim] for point in points]))
