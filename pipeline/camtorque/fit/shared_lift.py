"""The correction of the lift table that all recordings of a joint fit ask for: it is the cam's, so every run has it.

A fit lets each recording have its own. What is the cam's is one for all: the coefficients that explain what the fitted
laws leave in all recordings together, with the table's stated error as prior. What one recording asks for alone may as
well be an error of the laws there; the sum over recordings of other speeds and loads is small there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.problem import Problem
from camtorque.fit.solver import lift_modes
from camtorque.laws.chain import evaluate
from camtorque.laws.lift import LiftCorrection
from camtorque.records import Array, ReadOnly

FELT = 0.3
"""Modes weaker than this, in standard deviations of one weighted residual, are left out: no torque shows them."""


@dataclass(frozen=True)
class SharedLift(ReadOnly):
    """Correction of a lift table with how sure it is.

    knots : (n + 4,) of the splines [rad]; values : (n,) coefficients [m]
    slope_std : (n,) standard uncertainty of its slope in the middle of each spline [m/rad], less what no torque feels
    """

    knots: Array
    values: Array
    slope_std: Array

    def slope(self, theta: Array) -> Array:
        """Return the slope of the correction at angles (n,) of any revolution [m/rad]."""
        return LiftCorrection(self.knots, 0.0).correction(theta, self.values, 1)

    def slope_stderr(self, theta: Array) -> Array:
        """Return its standard uncertainty at angles (n,) of any revolution [m/rad], 0 beside the lift."""
        middle = self.knots[2:-2]
        return np.interp(np.mod(theta - self.knots[0], 2.0 * np.pi) + self.knots[0], middle, self.slope_std, 0.0, 0.0)


@dataclass(frozen=True)
class LiftInformation(ReadOnly):
    """What recordings ask of the correction: information (n, n), and coefficients times it (n,), over its prior."""

    information: Array
    coefficients: Array

    def __add__(self, other: LiftInformation) -> LiftInformation:
        return LiftInformation(self.information + other.information, self.coefficients + other.coefficients)

    def __sub__(self, other: LiftInformation) -> LiftInformation:
        return LiftInformation(self.information - other.information, self.coefficients - other.coefficients)


def lift_information(problem: Problem, z: Array, index: int, inflation: float) -> LiftInformation:
    """Return what one recording of a joint minimum asks for.

    Parameters
    ----------
    z : (k,) free parameters
    inflation : factor on the variance of the residuals
    """
    basis = problem.data[0].lift_basis
    item = replace(problem.data[index], lift_basis=basis)
    values, coefficients = problem.values(z, index)
    output = evaluate(item.chain, values, coefficients)
    modes = lift_modes(item, output, (values, coefficients))
    residual = item.residual(output, coefficients)
    # columns of the residual are vectors @ felt_by.T
    felt_by = modes.to_lift[: basis.n_basis] / basis.prior_std * modes.strength
    return LiftInformation(felt_by @ felt_by.T / inflation, felt_by @ (modes.vectors.T @ residual) / inflation)


def all_lift_information(problem: Problem, z: Array, inflation: float) -> LiftInformation:
    """Return what all recordings of a joint minimum ask for together; parameters as in `lift_information`."""
    found = lift_information(problem, z, 0, inflation)
    for index in range(1, len(problem.data)):
        found = found + lift_information(problem, z, index, inflation)
    return found


def shared_lift_from(problem: Problem, asked: LiftInformation) -> SharedLift:
    """Return the correction that answers what recordings ask for."""
    basis = problem.data[0].lift_basis
    squares, vectors = np.linalg.eigh(asked.information)
    felt = squares > FELT**2
    squares, vectors = squares[felt], vectors[:, felt]
    best = basis.prior_std * vectors @ (vectors.T @ asked.coefficients / (1.0 + squares))
    open_slope = basis.basis(basis.knots[2:-2], 1) @ vectors * (basis.prior_std / np.sqrt(1.0 + squares))
    return SharedLift(basis.knots, best, np.sqrt(np.sum(open_slope**2, axis=1)))
