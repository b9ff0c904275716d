"""Small changes to a problem: a parameter held where it is, weights that admit what the residual shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.fit.problem import Problem, Slot


def pinned(problem: Problem, name: str, value: float) -> Problem:
    """Return the problem with one free parameter held at a value [SI] by equal bounds.

    Raises
    ------
    KeyError
        When the problem has no such free parameter.
    """

    def hold(slots: tuple[Slot, ...]) -> tuple[Slot, ...]:
        return tuple(
            replace(slot, row=replace(slot.row, start=value, lower=value, upper=value)) if slot.name == name else slot
            for slot in slots
        )

    slot_named(problem, name)
    return replace(problem, nonlinear=hold(problem.nonlinear), linear=hold(problem.linear))


def slot_named(problem: Problem, name: str) -> Slot:
    """Return the free parameter of that label."""
    for slot in (*problem.nonlinear, *problem.linear):
        if slot.name == name:
            return slot
    raise KeyError(f"no free parameter {name!r} in this problem")


def softened(problem: Problem, inflation: float) -> Problem:
    """Return the problem with data variances larger by a factor; what the sheets say stays as it is."""
    scale = 1.0 / np.sqrt(inflation)
    return replace(problem, data=tuple(replace(item, weight=item.weight * scale) for item in problem.data))
