"""The model of one recording at a minimum, on the grid of its cycles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.prepare import on_grid
from camtorque.fit.problem import Problem
from camtorque.fit.single import Fit
from camtorque.laws.causes import cam_torques, measured_torques
from camtorque.laws.chain import ChainInput, ChainOutput, Motion, evaluate
from camtorque.records import Array
from camtorque.units import angle_grid


@dataclass(frozen=True)
class Modelled:
    """The model of one recording on the grid of the cycles, for one pair of mean cycles."""

    chain: ChainInput
    output: ChainOutput
    values: dict[str, float]
    cam: dict[str, Array]
    by_cause: dict[str, Array]
    plunger_force: Array

    @property
    def torque(self) -> Array:
        """Model of the measured torque, (n_theta,) [N m]."""
        return np.sum(list(self.by_cause.values()), axis=0)


def model_on_grid(fit: Fit, torque: Array, pressure: Array) -> Modelled:
    """Return the model of a recording for mean cycles (n_theta,) of torque and pressure [N m, Pa]."""
    solution = fit.solution
    lifts = solution.lift.coefficients(solution.residual)
    return modelled(fit.problem, solution.z, 0, lifts, fit.measured, (torque, pressure))


def modelled(
    problem: Problem, z: Array, index: int, lifts: Array, measured: Array, means: tuple[Array, Array]
) -> Modelled:
    """Return the model of one recording at free parameters z.

    Parameters
    ----------
    lifts : coefficients of the lift correction [m]
    measured : mean torque on the grid of the fit [N m]
    means : mean cycles (n_theta,) of torque and pressure [N m, Pa]
    """
    torque, pressure = means
    item = problem.data[index]
    values, coefficients = problem.values(z, index)
    grid = item.chain.theta.size
    lost = item.chain.shaft_torque - measured
    chain = replace(item.chain, line_pressure=on_grid(pressure, grid), shaft_torque=on_grid(torque, grid) + lost)
    output = evaluate(chain, values, coefficients, tangents=True)
    slope = item.lift_basis.correction(output.motion.theta, lifts, 1)
    cam, force = cam_torques(chain, values, output, coefficients, slope)
    by_cause = measured_torques(chain, values, cam, coefficients)
    return _on_cycles(Modelled(chain, output, values, cam, by_cause, force), torque.size)


def _on_cycles(model: Modelled, n: int) -> Modelled:
    """Return a model on the grid of the cycles, straight between the points of the fit's grid.

    It is not evaluated anew: a delivery valve that is near to chattering answers to the places of the time steps and to
    noise between the points, and the report would show another model than the one that was fitted.
    """
    chain, motion = model.chain, model.output.motion
    if n == chain.theta.size:
        return model

    def at(values: Array) -> Array:
        return resampled(values, n)

    moved = Motion(
        angle_grid(n) + at(motion.theta - chain.theta), at(motion.rate), at(motion.second), at(motion.lift.T).T,
        tuple(at(shift) for shift in motion.shifts),  # type: ignore[arg-type]
    )  # fmt: skip
    tangents = model.output.pressure_tangents
    output = replace(
        model.output, motion=moved, pressure=at(model.output.pressure), load=at(model.output.load),
        pressure_tangents=None if tangents is None else at(tangents), states=at(model.output.states),
        flows=at(model.output.flows),
    )  # fmt: skip
    chain = replace(
        chain, theta=angle_grid(n), line_pressure=at(chain.line_pressure), shaft_torque=at(chain.shaft_torque),
        deviation=at(chain.deviation) if chain.deviation.size else chain.deviation,
        substeps=np.zeros(0, dtype=np.int64),
    )  # fmt: skip
    cam, by_cause = ({name: at(part) for name, part in parts.items()} for parts in (model.cam, model.by_cause))
    return Modelled(chain, output, model.values, cam, by_cause, at(model.plunger_force))


def resampled(values: Array, n: int) -> Array:
    """Return periodic values (m, ...) on a grid of n angles, straight between their own."""
    place = np.arange(n) * (values.shape[0] / n)
    first = place.astype(np.int64)
    share = (place - first).reshape(-1, *([1] * (values.ndim - 1)))
    return np.asarray((1.0 - share) * values[first] + share * values[(first + 1) % values.shape[0]])
