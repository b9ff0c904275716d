"""A fit with bounds, ties and fixed values of the user's own, by lmfit.

The problem is that of `camtorque run` at its best minimum: the same residual, weights, priors and exact derivatives,
with every parameter in the unit of the report. `lmfit.fit_report` and `lmfit.conf_interval` work on what comes out::

    own = camtorque.own_fit("raw_examples/A_1000rpm")
    parameters = own.parameters()
    parameters["pin_arm"].set(expr="0.05 * bearing_arm")
    minimizer = own.minimizer(parameters)
    result = minimizer.minimize()
    print(lmfit.fit_report(result))
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from numbers import Real
from pathlib import Path
from typing import Any

import lmfit
import numpy as np

from camtorque.align import align
from camtorque.api import read
from camtorque.config.tables import Table, read_schema
from camtorque.fit.problem import Problem
from camtorque.fit.single import prepare
from camtorque.fit.solver import LiftModes
from camtorque.laws.chain import ChainOutput, evaluate
from camtorque.lmfit_minimizer import WithinBounds, probability
from camtorque.process.threads import on_one_thread
from camtorque.records import Array, Recording, Refusal
from camtorque.rehearsal import rigid_torque
from camtorque.units import did_you_mean

SCHEMA = "camtorque-parameters/1"
KEYS: Mapping[str, Any] = {"value": Real, "min": Real, "max": Real, "vary": bool, "expr": str}
"""What a user may set of a parameter, as `lmfit.Parameter.set` takes it -> its type."""
TIE_STEP = 1.0e-6
"""Relative step of the central difference through a tie (ties are short formulas, the chain itself is exact)."""


@dataclass(frozen=True, repr=False)
class OwnFit:
    """One recording ready to be fitted by lmfit.

    Attributes
    ----------
    problem : of the best structure, started at its minimum
    minimum : (k,) that minimum [SI]
    lift : correction of the lift table, integrated out
    """

    problem: Problem
    minimum: Array
    lift: LiftModes

    def __repr__(self) -> str:
        return f"<OwnFit {self.problem.data[0].name}: {len(self.names)} free parameters>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return self.problem.names

    @property
    def units(self) -> Array:
        """SI per unit of the report, (k,)."""
        return np.array([parameter.row.per_unit for parameter in self.problem.parameters])

    def parameters(self) -> lmfit.Parameters:
        """Return every free parameter at the minimum, with its bounds, in the unit of the report (``user_data``)."""
        found = lmfit.Parameters()
        for parameter, value in zip(self.problem.parameters, self.minimum, strict=True):
            row = parameter.row
            found.add(
                parameter.name, float(value) / row.per_unit, min=row.lower / row.per_unit, max=row.upper / row.per_unit
            )
            found[parameter.name].user_data = row.unit
        return found

    def residual(self, parameters: lmfit.Parameters) -> Array:
        """Return measured - model, weighted and whitened by the lift correction, and the pulls of the priors.

        Parameters
        ----------
        parameters : with all names of `parameters`, in the units of the report

        Returns
        -------
        residual : (bins + t + k,); its sum of squares is the chi-square of the fit
        """
        z = self._si(parameters)
        means, stds = self.problem.priors
        left, output = self._left(z)
        teeth = self.problem.data[0].tooth_misfit(output.motion)
        return np.concatenate([self._whitened(left), teeth, (z - means) / stds])

    def jacobian(self, parameters: lmfit.Parameters) -> Array:
        """Return the derivative of `residual` by the varying parameters; exact but for the ties' own formulas."""
        z, weight, (own, chain) = self._si(parameters), self.problem.data[0].weight, self.problem.places[0]
        _, output = self._left(z, tangents=True)
        both = np.column_stack([output.derivative, output.linear])[:, chain]  # type: ignore[list-item]
        left = np.zeros((weight.size, z.size))
        left[:, own] = -both * weight[:, None]
        teeth = -self.problem.data[0].tooth_columns(output.motion, chain, np.ones(own.size))[:, :-1]
        rows = np.vstack([self._whitened(left), teeth, np.diag(1.0 / self.problem.priors[1])])
        return rows * self.units @ self._ties(parameters)

    def minimizer(self, parameters: lmfit.Parameters) -> WithinBounds:
        """Return lmfit's minimizer of these parameters; ``minimize()`` fits, `lmfit.conf_interval` takes it.

        The weights hold the model error, so the covariance is not scaled by the residual.

        Raises
        ------
        Refusal : a parameter of `parameters` is missing, or they are none
        """
        if not isinstance(parameters, lmfit.Parameters):
            raise Refusal(
                f"minimizer: found parameters of type {type(parameters).__name__}, expected those of own.parameters()"
            )
        missing = [name for name in self.names if name not in parameters]
        if missing:
            raise Refusal(f"minimizer: found no parameter {missing[0]!r}, expected all of own.parameters()")
        return WithinBounds(self.residual, parameters, scale_covar=False, jac=self.jacobian, x_scale="jac")

    @staticmethod
    def probability(best: Any, other: Any) -> float:
        """Return the confidence at which a fit with a parameter held is worse than the best, for `lmfit.conf_interval`.

        The weights are absolute: twice the logarithm of the likelihood ratio is the difference of chi-square. lmfit's
        F-test, its default, would scale it by a residual that the weights allow for.
        """
        return probability(best, other)

    def _si(self, parameters: lmfit.Parameters) -> Array:
        return np.array([parameters[name].value for name in self.names]) * self.units

    def _left(self, z: Array, tangents: bool = False) -> tuple[Array, ChainOutput]:
        """Return measured - model, weighted, and what the chain gives."""
        item = self.problem.data[0]
        values, coefficients = self.problem.values(z, 0)
        output = evaluate(item.chain, values, coefficients, tangents=tangents)
        return item.residual(output, coefficients), output

    def _whitened(self, values: Array) -> Array:
        """Return (I + B B^T)^(-1/2) times weighted values: what the lift correction explains counts less."""
        lost = 1.0 - 1.0 / np.sqrt(1.0 + self.lift.strength**2)
        return values - (self.lift.vectors * lost) @ (self.lift.vectors.T @ values)

    def _ties(self, parameters: lmfit.Parameters) -> Array:
        """Return how all parameters follow the varying ones, (k, n_varying)."""
        moved = parameters.copy()
        columns = []
        for name in (name for name, item in parameters.items() if item.vary and not item.expr):
            middle, step = parameters[name].value, TIE_STEP * max(1.0, abs(parameters[name].value))
            ends = []
            for value in (middle + step, middle - step):
                moved[name].set(min=-np.inf, max=np.inf, value=value)
                ends.append(np.array([moved[other].value for other in self.names]))
            moved[name].set(value=middle)
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        return np.column_stack(columns)


@on_one_thread
def own_fit(recording: Recording | Path | str) -> OwnFit:
    """Return a recording at the best minimum of `camtorque run`, ready for bounds, ties and fixed values of your own.

    Parameters
    ----------
    recording : from `read` or `Recording.from_arrays`, or a path

    Returns
    -------
    fit : ``parameters()`` gives them as `lmfit.Parameters` in the units of the report; change them, then
        ``minimizer(parameters).minimize()`` fits (docs/own_fit.md)

    Raises
    ------
    Refusal : what `camtorque.fit` refuses
    """
    item = recording if isinstance(recording, Recording) else read(recording)
    cycles = align(item)
    best = prepare(item, cycles, rigid_torque(item, cycles)).candidates[0]
    return OwnFit(best.problem, best.solution.z, best.solution.lift)


def read_changes(path: Path | str) -> dict[str, dict[str, Any]]:
    """Return what a parameters file changes: name -> some of value, min, max, vary, expr.

    Raises
    ------
    Refusal : missing file, another schema, an unknown key
    """
    file = Path(path)
    _, root = read_schema(file, SCHEMA, f"expected a parameters file (schema {SCHEMA})")
    changes = root.values.get("parameters")
    if not isinstance(changes, dict) or not all(isinstance(row, dict) for row in changes.values()):
        raise Refusal(f"{file}: expected tables [parameters.NAME]")
    for name, row in changes.items():
        Table(row, file, f"[parameters.{name}]").only(tuple(KEYS))
    return changes


def changed(parameters: lmfit.Parameters, changes: Mapping[str, Mapping[str, Any]]) -> lmfit.Parameters:
    """Return the parameters with a user's bounds, ties and fixed values.

    Raises
    ------
    Refusal : a name that is not free in this recording, a value of another type, bounds without room, a tie that
        cannot be evaluated or goes in a circle, nothing left to vary
    """
    found = parameters.copy()
    _refuse_circle(changes)
    for name, row in changes.items():
        if name not in found:
            raise Refusal(f"parameter {name!r}: not free here{did_you_mean(name, tuple(found))}; see result.json")
        _refuse_other_types(name, row)
        try:
            found[name].set(**row)
            if not row.keys() & {"value", "expr"}:  # narrower bounds take the start along
                found[name].set(value=float(np.clip(found[name].value, found[name].min, found[name].max)))
            value, low, high = found[name].value, found[name].min, found[name].max
        except Exception as error:  # lmfit's evaluator raises many kinds
            raise Refusal(f"parameter {name!r}: {' '.join(str(error).split())}; expected {', '.join(KEYS)}") from error
        if low > high:
            own = next((end for end in ("min", "max") if end not in row), "")
            ask = f"give {own} too, it is the fit's own" if own else "exchange them"
            raise Refusal(f"parameter {name!r}: found min {low:g} above max {high:g}, expected it below; {ask}")
        value = row.get("value", value)  # lmfit would move it into the bounds without a word
        if not (np.isfinite(value) and low <= value <= high):
            raise Refusal(f"parameter {name!r}: found {value:g}, expected a value from {low:g} to {high:g}")
    if not any(item.vary for item in found.values()):
        raise Refusal(f"parameters: all {len(found)} are fixed or tied, expected one to vary at least")
    return found


def _refuse_circle(changes: Mapping[str, Mapping[str, Any]]) -> None:
    ties = {name: set(re.findall(r"[A-Za-z_]\w*", str(row.get("expr", "")))) for name, row in changes.items()}
    try:
        TopologicalSorter({name: used & ties.keys() for name, used in ties.items()}).prepare()
    except CycleError as error:
        circle = " -> ".join(reversed(error.args[1]))
        raise Refusal(f"parameters: the ties go in a circle, {circle}; expected a tie to other parameters") from None


def _refuse_other_types(name: str, row: Mapping[str, Any]) -> None:
    for key, value in row.items():
        if not isinstance(value, KEYS[key]) or (isinstance(value, bool) and key != "vary"):
            expected = {"vary": "true or false", "expr": "a text"}.get(key, "a number")
            raise Refusal(f"parameter {name!r} {key}: found {value!r}, expected {expected}")
