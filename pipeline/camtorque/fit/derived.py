"""What follows from the fitted values, with the covariance carried on: quantities of a sheet, volume, work by cause."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from camtorque.fit.forecast import stroke_volume
from camtorque.fit.residual import parts_of_gap
from camtorque.fit.single import Fit, FittedParameters
from camtorque.fit.uncertainty import COVERAGE, knowledge, secant_steps
from camtorque.laws.causes import cam_torques, measured_torques, work_per_revolution
from camtorque.laws.chain import SHIFT_NAMES, ChainInput, ChainOutput, evaluate
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.driveline import FOLLOWING, RIGID, SHAFT_NAMES, cam_side_inertia
from camtorque.records import APART, TOGETHER, UNTOLD, Array, Estimate, ParameterEstimate, RigidTorque

NOT_CARRIED = "lift_table"
"""The correction of the lift is no parameter of the fit."""
ANGLE, CHAMBER = "cam angle", "plunger pressure"
"""The two reasons for which pressure makes another torque than the rigid model has."""


def derived_estimates(fit: FittedParameters) -> tuple[ParameterEstimate, ...]:
    """Return inertia on the cam's side and damping of the shaft: log-normal, of a relative deviation to first order."""
    values, _ = fit.problem.values(fit.solution.z, 0)
    compliance, resonance, ratio = (values[name] for name in SHAFT_NAMES)
    if compliance <= RIGID:
        return ()
    found = {"cam_side_inertia": cam_side_inertia(values), "shaft_damping": 2.0 * ratio / (resonance * compliance)}
    rows = []
    for name, (per, unit, symbol, meaning, exponents) in FOLLOWING.items():
        row = np.zeros(fit.problem.size)
        for parameter, exponent in zip(SHAFT_NAMES, exponents, strict=True):
            if fit.problem.index(parameter) >= 0:
                row[fit.problem.index(parameter)] = exponent / values[parameter]
        statistical = float(np.sqrt(row @ fit.deviation @ row))
        total = float(np.sqrt(statistical**2 + sum(float(np.sum((rows @ row) ** 2)) for rows in fit.shifts.values())))
        value, end = found[name] / per, float(np.exp(COVERAGE * np.sqrt(np.log1p(total**2))))
        known = knowledge(total, 1.0, value / end, 0.0, has_prior=False)
        rows.append(ParameterEstimate(
            name=name, value=value, unit=unit, stderr=value * total, stderr_statistical=value * statistical,
            ci95=(value / end, value * end), at_bound=False, identifiable=known not in UNTOLD, confounded_with=(),
            prior=None, meaning=meaning, source="follows from compliance, resonance and damping ratio of the shaft",
            role="shared", symbol=symbol, knowledge=known,
        ))  # fmt: skip
    return tuple(rows)


def delivered_volume(fit: Fit) -> Estimate | None:
    """Return the volume that leaves the chamber for the line in a stroke, at zero gauge pressure; None without one.

    The uncertainty is that of the chamber's parameters by differences: the compiled chamber has no tangents of flows.
    """
    chain = fit.problem.data[0].chain
    if not chain.uses_chamber:
        return None
    z, std = fit.solution.z, fit.statistical_std

    def volume(moved: Array) -> float:
        values, _ = fit.problem.values(moved, 0)
        return stroke_volume(chain, values, evaluate(chain, values))

    base, slope = volume(z), np.zeros(z.size)
    low, high = fit.problem.bounds
    steps = secant_steps(z, 0.5 * std, low, high)
    for k, parameter in enumerate(fit.problem.parameters):
        if parameter.row.name == "outlet_return" and z[k] <= low[k]:
            continue  # an outlet that stays closed does so to any order
        if parameter.row.name in (*CHAMBER_NAMES, *SHIFT_NAMES) and steps[k]:
            moved = z.copy()
            moved[k] += steps[k]
            slope[k] = (volume(moved) - base) / steps[k]
    variance = float(slope @ fit.deviation @ slope)
    total = variance + sum(float(np.sum((rows @ slope) ** 2)) for rows in fit.shifts.values())
    return Estimate(base, float(np.sqrt(total)), stderr_statistical=float(np.sqrt(variance)))


def work_at(chain: ChainInput, values: Mapping[str, float], coefficients: Array) -> dict[str, float]:
    """Return the work of each loss at values of the nonlinear and (17,) of the linear parameters [J per revolution]."""
    return _caused(chain, values, coefficients)[2]


def sureness(fit: Fit, rigid: RigidTorque, measured: Array) -> tuple[dict[str, float], dict[str, Array]]:
    """Return how sure work and torque by cause of a recording are.

    Parameters
    ----------
    rigid : rigid solution, whose strokes are meant
    measured : (n_theta,) mean measured torque on the grid of ``rigid`` [N m]

    Returns
    -------
    work : loss -> standard uncertainty of its work [J per revolution]
    gap : cause -> (3,) that of its torque [N m]: mean over the loaded part of the forward stroke, mean over the return
        stroke, where the measured torque is least there
    """
    chain = fit.problem.data[0].chain
    parts = _parts(chain, rigid, measured)
    work, gap = _both(chain, *fit.problem.values(fit.solution.z, 0), rigid, parts)

    def flat(values: Mapping[str, float], coefficients: Array) -> Array:
        after = _both(chain, values, coefficients, rigid, parts)
        return np.concatenate([list(after[0].values()), *after[1].values()])

    std = carried(fit, flat)
    works = dict(zip(work, std.tolist(), strict=False))
    gaps = dict(zip(gap, std[len(work) :].reshape(len(gap), -1), strict=True))
    del works[NOT_CARRIED], gaps[NOT_CARRIED]
    return works, gaps


def carried(fit: Fit, at: Callable[[Mapping[str, float], Array], Array]) -> Array:
    """Return the standard uncertainty of numbers (m,) that hang on the values of a fit.

    Deviations and further shifts of the fit are carried on by differences, one parameter after the other.
    """
    problem, z = fit.problem, fit.solution.z
    here, steps = at(*problem.values(z, 0)), secant_steps(z, fit.std, *problem.bounds)
    slopes = np.zeros((here.size, z.size))
    for k in np.flatnonzero(steps).tolist():
        moved = z.copy()
        moved[k] += steps[k]
        slopes[:, k] = (at(*problem.values(moved, 0)) - here) / steps[k]
    variance = np.einsum("ij,jk,ik->i", slopes, fit.deviation, slopes)
    for rows in fit.shifts.values():
        variance = variance + np.sum((slopes @ rows.T) ** 2, axis=1)
    return np.sqrt(np.maximum(variance, 0.0))


def _caused(
    chain: ChainInput, values: Mapping[str, float], coefficients: Array
) -> tuple[ChainOutput, dict[str, Array], dict[str, float]]:
    """Return the chain, torque on the cam by cause, and work by loss."""
    output = evaluate(chain, values, coefficients)
    torques, _ = cam_torques(chain, values, output, coefficients, np.zeros(chain.theta.size))
    work = work_per_revolution(chain, values, output, torques)
    return output, torques, {**work, TOGETHER: sum(work[name] for name in APART)}


def line_pressure_torque(rigid: RigidTorque, angle: Array, force: Array) -> Array:
    """Return the torque of a force on the plunger (n,) [N] at cam angles (n,) [rad], where the line pressure makes it.

    The power balance of a frictionless mechanism makes it ``F y'`` whatever the offset is: no new solution is needed.
    """
    return np.asarray(force * np.interp(angle, rigid.theta, rigid.lift_velocity, period=2.0 * np.pi))


def _both(
    chain: ChainInput, values: Mapping[str, float], coefficients: Array, rigid: RigidTorque, parts: Array
) -> tuple[dict[str, float], dict[str, Array]]:
    """Return work by loss, and torque by cause averaged over parts (3, n) of the revolution, apart from a constant."""
    output, torques, work = _caused(chain, values, coefficients)
    curves = measured_torques(chain, values, torques, coefficients)
    angle = line_pressure_torque(rigid, output.motion.theta, chain.line_pressure * chain.pump.plunger_area)
    curves = {CHAMBER: curves.pop("pressure") - angle, ANGLE: angle, **curves}
    return work, {name: parts @ curve for name, curve in curves.items()}


def _parts(chain: ChainInput, rigid: RigidTorque, measured: Array) -> Array:
    """Return the weights (3, n) that average a curve of the fit's grid over the parts of the gap in `sureness`."""
    forward, fall, lowest = parts_of_gap(rigid, measured)
    masks = [np.interp(chain.theta, rigid.theta, mask.astype(np.float64)) for mask in (forward, fall)]
    masks.append(np.zeros(chain.theta.size))
    masks[-1][np.argmin(np.abs(chain.theta - rigid.theta[lowest]))] = 1.0
    return np.array([mask / np.sum(mask) for mask in masks])
