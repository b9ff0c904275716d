"""A minimizer of lmfit that goes down as a run does.

lmfit's own leastsq bends bounds into a sine, which is flat where a parameter rests on its bound. And a refit with one
parameter moved, as `lmfit.conf_interval` makes it, begins high above a narrow valley: a trust region loses its way
there and chi-square jumps. A refit here begins where the normal equations at the best fit expect the others.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import lmfit
import numpy as np

from camtorque.fit.descent import Descent, DescentTrial, free_at, minimise, promised
from camtorque.fit.quadratic import bounded_step
from camtorque.fit.solver import WHOLE
from camtorque.records import Array, Refusal

LAST_GAIN = 1.0e-3
"""Share of chi-square below which a step of the trust region ends it: the descent before has found the minimum."""
LEAST_INFORMATION = 1.0e-9
"""Added to the normal equations, in units of their diagonal: parameters that act alike have a solution, too."""
LOWER, ROUNDS = 0.1, 10
"""Chi-square by which a refit is a lower minimum, a third of a standard deviation; how often all begins again there."""
SAME = 0.01
"""Share by which the ends of two confidences differ at least, unless chi-square jumps there."""

Point = tuple[Array, Array]
"""Normal equations and direction of descent, in units of the steps."""


@dataclass(frozen=True)
class _Varying:
    """The varying parameters of a fit, as a descent sees them.

    Attributes
    ----------
    parameters : all of them; a trial writes its values here
    names : of those that vary
    bounds : (k,) lower and upper ones, in the units of the parameters
    steps : (k,) length of a step that is felt as one standard deviation of the residual
    """

    minimizer: WithinBounds
    parameters: lmfit.Parameters
    names: tuple[str, ...]
    bounds: tuple[Array, Array]
    steps: Array

    @property
    def start(self) -> Array:
        """Their values, (k,)."""
        return np.array([self.parameters[name].value for name in self.names])

    def put(self, values: Array) -> None:
        """Write values (k,) into the parameters."""
        for name, value in zip(self.names, values, strict=True):
            self.parameters[name].set(value=value)

    def try_at(self, values: Array) -> DescentTrial:
        """Return the chi-square at values (k,)."""
        self.put(values)
        chi_square = float(np.sum(self.minimizer.userfcn(self.parameters) ** 2))
        return DescentTrial(values, chi_square, chi_square)

    def linearise(self, trial: DescentTrial) -> Point:
        """Return the normal equations at a trial."""
        self.put(trial.z)
        return self.minimizer.normal_equations(self.parameters, self.steps)

    def step(self, point: Point, values: Array, damping: float) -> tuple[Array, float]:
        """Return a damped step within the bounds, and how much chi-square it promises."""
        more = LEAST_INFORMATION + damping * np.maximum(np.diag(point[0]), 1e-3)
        lower, upper = self.bounds
        step, promise = bounded_step(
            point[0], more, point[1], values / self.steps, lower / self.steps, upper / self.steps
        )
        return step * self.steps, promise

    def promise(self, point: Point, values: Array) -> float:
        """Return how much chi-square the undamped step promises."""
        return promised(*point, free_at(values, point[1], *self.bounds))

    def descended(self) -> int:
        """Write the minimum into the parameters; return how many evaluations that took."""
        descent = Descent[DescentTrial, Point](self.try_at, self.linearise, self.step, self.promise, self.bounds)
        ended = minimise(descent, self.try_at(np.clip(self.start, *self.bounds)), WHOLE)
        self.put(ended.trial.z)
        return ended.cost[1]


@dataclass(frozen=True)
class Intervals:
    """Intervals that refits found.

    Attributes
    ----------
    result : the fit that they are of
    rows : name -> pairs of confidence and value, as `lmfit.conf_interval` gives them; infinite where there is no end
    notes : what a reader has to know of them
    """

    result: Any
    rows: dict[str, list[tuple[float, float]]]
    notes: tuple[str, ...]


class _Deeper(Exception):
    """A refit lies below the fit."""

    def __init__(self, parameters: lmfit.Parameters) -> None:
        super().__init__()
        self.parameters = parameters


class WithinBounds(lmfit.Minimizer):
    """Goes down as a run does; then scipy's trust region, which knows bounds, polishes and fills in lmfit's result."""

    _best: tuple[_Varying, Array, Point] | None = None

    def leastsq(self, params: Any = None, max_nfev: int | None = None, **kws: Any) -> Any:
        """Fit the varying parameters."""
        varying = self._varying((self.params if params is None else params).copy())
        refit = self._follow(varying)
        evaluations = varying.descended()
        result = self.least_squares(varying.parameters, max_nfev, **{"ftol": LAST_GAIN, **kws})
        result.nfev += evaluations
        if not refit:
            best = self._varying(result.params.copy())
            self._best = best, best.start, self.normal_equations(best.parameters, best.steps)
        return result

    def intervals(self, result: Any, names: Sequence[str]) -> Intervals:
        """Return the intervals of varying parameters at 1, 2 and 3 standard deviations, by `lmfit.conf_interval`.

        Where a refit finds a lower minimum, that is the fit, and its intervals are sought.

        Raises
        ------
        Refusal : fewer than two parameters vary, or the refits do not lead to an interval
        """
        if len(result.var_names) < 2:
            raise Refusal("intervals: found one varying parameter, expected two; its uncertainty is its interval")
        first = float(result.chisqr)
        for more in reversed(range(ROUNDS)):
            try:
                rows, notes = self._sought(result, names, follow=more > 0)
            except _Deeper as found:
                for name in result.var_names:
                    found.parameters[name].set(vary=True)
                result = self.minimize(params=found.parameters)
            else:
                break
        if result.chisqr < first - LOWER:
            notes.insert(
                0, f"refits found a lower minimum, which this is: chi-square {result.chisqr:.4g}, was {first:.4g}"
            )
        return Intervals(result, rows, tuple(notes))

    def _sought(self, result: Any, names: Sequence[str], follow: bool) -> tuple[dict[str, Any], list[str]]:
        def compared(best: Any, other: Any) -> float:
            if follow and other.chisqr < best.chisqr - LOWER:
                raise _Deeper(other.params)
            return probability(best, other)

        rows: dict[str, Any] = {}
        notes: list[str] = []
        for name in names:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                try:
                    rows |= lmfit.conf_interval(self, result, p_names=[name], prob_func=compared)
                except (ValueError, lmfit.MinimizerException) as error:  # no root between two ends; no stderr
                    raise Refusal(
                        f"intervals: {name} has none by refits, which do not get worse steadily as it is moved; take "
                        "its uncertainty, or fix what it cannot be told apart from"
                    ) from error
            notes += _told_of_ends(name, rows[name], [str(item.message) for item in told])
        return rows, notes

    def normal_equations(self, parameters: lmfit.Parameters, steps: Array) -> Point:
        """Return J^T J and -J^T r, in units of steps (k,)."""
        columns = self.kws["jac"](parameters) * steps
        return columns.T @ columns, -columns.T @ self.userfcn(parameters)

    def _varying(self, parameters: lmfit.Parameters) -> _Varying:
        names = tuple(name for name, item in parameters.items() if item.vary and not item.expr)
        bounds = np.array([[parameters[name].min, parameters[name].max] for name in names]).T
        lengths = np.linalg.norm(self.kws["jac"](parameters), axis=0)
        steps = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
        return _Varying(self, parameters, names, (bounds[0], bounds[1]), steps)

    def _follow(self, varying: _Varying) -> bool:
        """Take the others along with the parameters that were moved and held since the best fit; whether there are."""
        if self._best is None:
            return False
        best, values, (matrix, vector) = self._best
        kept = np.array([name in varying.names for name in best.names])
        if kept.all() or tuple(np.array(best.names)[kept]) != varying.names:
            return False
        if not np.array_equal(values[kept], varying.start):
            return False  # a start of the user's own
        moved = np.array([varying.parameters[name].value for name in best.names]) - values
        pulled = (vector - matrix @ (moved / best.steps))[kept]
        here = _Varying(self, varying.parameters, varying.names, varying.bounds, best.steps[kept])
        step, _ = here.step((matrix[np.ix_(kept, kept)], pulled), values[kept], 0.0)
        varying.put(values[kept] + step)
        return True


def probability(best: Any, other: Any) -> float:
    """Return the confidence at which a fit is worse than the best, by their chi-square."""
    return math.erf(math.sqrt(0.5 * max(other.chisqr - best.chisqr, 0.0)))


def _told_of_ends(name: str, row: Sequence[tuple[float, float]], told: Sequence[str]) -> list[str]:
    """Return what to say of ends that are infinite or coincide; ``told`` are lmfit's warnings."""
    best = next(value for confidence, value in row if confidence == 0.0)
    reached = [re.match(rf"Bound reached with prob\({name}=([^)]*)\)", text) for text in told]
    sides = {"lower" if float(item[1]) <= best else "upper" for item in reached if item}
    notes = []
    for side, sign in (("lower", -1.0), ("upper", 1.0)):
        levels = sorted(confidence for confidence, value in row if value == sign * math.inf)
        if levels:
            why = "its bound comes first" if side in sides else "refits do not get worse steadily up to there"
            shares = ", ".join(f"{100.0 * level:.2f} %" for level in levels)
            notes.append(f"{name} has no {side} end at {shares}: {why}")
        ends = sorted(abs(value - best) for _, value in row if value * sign > best * sign and abs(value) < math.inf)
        if any(further < (1.0 + SAME) * nearer for nearer, further in pairwise(ends)):
            notes.append(f"{name}: two {side} ends are one, where refits fall into another minimum")
    return notes
