"""What can be told of parameters that cannot be told apart: one well-determined combination of each group.

Groups are parameters whose estimates, from the data alone, are correlated beyond `CONFOUNDED`, or act alike once all
others are held. In units of their own
standard errors the group's correlation matrix has one small eigenvalue or more: its eigenvector is what the data fix,
while each member by itself is loose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.problem import Problem
from camtorque.fit.solve import Solution
from camtorque.fit.uncertainty import CONFOUNDED, Covariance, at_bounds, parameter_values
from camtorque.records import Array

ALIKE = 0.999
"""Correlation of a pair with all others held, above which the two act alike."""
TELLING = 0.5
"""Largest standard error of a combination worth telling, as a share of that of its first member alone."""


@dataclass(frozen=True)
class Combination:
    """A sum of parameters that is told well, in the unit of the first.

    names, coefficients, units : its terms, the first coefficient is 1; the others carry unit of the first per their own
    value, stderr : of the sum, statistical; alone : (k,) standard errors of the members, in their own units
    """

    names: tuple[str, ...]
    coefficients: tuple[float, ...]
    units: tuple[str, ...]
    value: float
    stderr: float
    alone: tuple[float, ...]

    @property
    def text(self) -> str:
        """Return the combination in words."""
        terms = " ".join(
            f"{'-' if c < 0.0 else '+'} {_factor(c)}{name}"
            for c, name in zip(self.coefficients, self.names, strict=True)
        )
        alone = ", ".join(
            f"{name} +- {std:.2g} {unit}".rstrip(" -")
            for name, std, unit in zip(self.names, self.alone, self.units, strict=True)
        )
        total = f"{self.value:.4g} +- {self.stderr:.2g} {self.units[0]}".rstrip(" -")
        return f"{terms.removeprefix('+ ')} = {total} (each by itself: {alone})"


def _factor(coefficient: float) -> str:
    return "" if abs(coefficient) == 1.0 else f"{abs(coefficient):.3g} x "


def combinations(problem: Problem, solution: Solution, cov: Covariance) -> tuple[Combination, ...]:
    """Return the best-determined combination of every group that the data cannot separate."""
    slots = (*problem.nonlinear, *problem.linear)
    values, free = parameter_values(problem, solution), ~at_bounds(problem, solution)
    result = []
    for group in _groups(_linked(cov.data_correlation), free):
        deviation = cov.data_deviation[group]
        eigenvalues, vectors = np.linalg.eigh(cov.data_correlation[np.ix_(group, group)])
        weights = vectors[:, int(np.argmin(eigenvalues))] / deviation
        lead = int(np.argmax(np.abs(weights * deviation)))
        order = [lead, *[k for k in range(len(group)) if k != lead]]
        per = np.array([slots[group[k]].row.per_unit for k in order])
        coefficients = weights[order] / weights[lead] * per / per[0]
        chosen = [group[k] for k in order]
        scaled = coefficients / per
        variance = scaled @ cov.matrix[np.ix_(chosen, chosen)] @ scaled
        result.append(Combination(
            tuple(slots[k].name for k in chosen), tuple(map(float, coefficients)),
            tuple(slots[k].row.unit for k in chosen), float(scaled @ values[chosen]),
            float(np.sqrt(max(variance, 0.0))),
            tuple(float(np.sqrt(cov.matrix[k, k]) / slots[k].row.per_unit) for k in chosen),
        ))  # fmt: skip
    return tuple(item for item in result if item.stderr < TELLING * item.alone[0])


def _linked(correlation: Array) -> NDArray[np.bool_]:
    """Return which pairs cannot be told apart, by themselves or once all others are held.

    Three that act alike, such as zero, drag and viscous drag at one speed, hide in the plain correlation of each pair.
    """
    precision = np.linalg.inv(correlation + 1e-10 * np.eye(correlation.shape[0]))
    scale = np.sqrt(np.diag(precision))
    partial = np.abs(precision / np.outer(scale, scale))
    return np.asarray((np.abs(correlation) > CONFOUNDED) | (partial > ALIKE), dtype=bool)


def _groups(linked: NDArray[np.bool_], free: NDArray[np.bool_]) -> list[list[int]]:
    """Return the connected groups of at least two parameters that are off their bounds."""
    left = [k for k in range(linked.shape[0]) if free[k]]
    groups = []
    while left:
        group, open_ends = [], [left[0]]
        while open_ends:
            k = open_ends.pop()
            if k in left:
                left.remove(k)
                group.append(k)
                open_ends += [j for j in left if linked[k, j]]
        if len(group) > 1:
            groups.append(sorted(group))
    return groups
