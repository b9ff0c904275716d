"""Parameters that users tie to others by an expression: their values, and how they move with the free ones."""

from __future__ import annotations

import ast
import copy
from collections.abc import Mapping
from dataclasses import dataclass

import lmfit
import numpy as np

from camtorque.records import Array

STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))
"""Offsets and weights of the five-point derivative; exact for quartics, 1e-12 for smooth expressions."""
RELATIVE_OFFSET = 1.0e-3


@dataclass(frozen=True)
class Ties:
    """Free, fixed and tied parameters of a set of `lmfit.Parameters`.

    Attributes
    ----------
    params : private copy whose values are changed while expressions are evaluated
    free : names that vary, in order
    tied : names that follow an expression
    needs : tied name -> free names that it depends on, through other ties too
    """

    params: lmfit.Parameters
    free: tuple[str, ...]
    tied: tuple[str, ...]
    needs: Mapping[str, tuple[str, ...]]

    def values(self, free_values: Array) -> dict[str, float]:
        """Return every parameter's value for values of the free ones, (n_free,)."""
        for name, value in zip(self.free, free_values, strict=True):
            self.params[name].value = float(value)
        self.params.update_constraints()
        return {name: float(parameter.value) for name, parameter in self.params.items()}

    def slopes(self, free_values: Array) -> dict[str, Array]:
        """Return d(value)/d(free), (n_free,), of every free and tied parameter."""
        result: dict[str, Array] = dict(zip(self.free, np.eye(len(self.free)), strict=True))
        result.update({name: np.zeros(len(self.free)) for name in self.tied})
        moving = sorted({name for names in self.needs.values() for name in names})
        for name in moving:
            j = self.free.index(name)
            offset = RELATIVE_OFFSET * max(abs(float(free_values[j])), 1.0e-6)
            for k, weight in STENCIL:
                moved = np.array(free_values, dtype=float)
                moved[j] += k * offset
                values = self.values(moved)
                for tied in self.tied:
                    result[tied][j] += weight * values[tied] / offset
        return result


def ties_of(params: lmfit.Parameters) -> Ties:
    """Return the free and tied parameters of a set, with bounds lifted from the private copy.

    Raises
    ------
    ValueError
        When nothing varies.
    """
    work = copy.deepcopy(params)
    tied = tuple(name for name, parameter in params.items() if parameter.expr)
    free = tuple(name for name, parameter in params.items() if parameter.vary and not parameter.expr)
    if not free:
        raise ValueError("no parameter varies; set vary=True for at least one")
    for name in free:
        work[name].set(min=-np.inf, max=np.inf)
    return Ties(work, free, tied, {name: _needs(params, name, free) for name in tied})


def _needs(params: lmfit.Parameters, name: str, free: tuple[str, ...]) -> tuple[str, ...]:
    """Return the free parameters behind an expression; lmfit has refused circles already."""
    found: set[str] = set()
    used = {node.id for node in ast.walk(ast.parse(params[name].expr)) if isinstance(node, ast.Name)}
    for other in used & set(params):
        if params[other].expr:
            found.update(_needs(params, other, free))
        elif other in free:
            found.add(other)
    return tuple(sorted(found))
