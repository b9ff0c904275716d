"""The model at a minimum on the grid of the cycles, and what follows: quantities of a sheet, volume, work by cause.

The covariance is carried on to what follows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from camtorque.fit.fitted import FittedParameters
from camtorque.fit.forecast import stroke_volume
from camtorque.fit.prepare import at_cam_angles, cam_angles, over_even_angle
from camtorque.fit.problem import FitData, Problem
from camtorque.fit.residual import parts_of_gap
from camtorque.fit.single import Fit
from camtorque.fit.uncertainty import knowledge, secant_steps, stated_pressure
from camtorque.laws.causes import ON_BRIDGE_ALONE, cam_torques, drive_work, measured_torques, work_per_revolution
from camtorque.laws.chain import COLUMN_NAMES, SHIFT_NAMES, ChainInput, ChainOutput, Motion, evaluate
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.driveline import FOLLOWING, RIGID, SHAFT_NAMES, cam_side_inertia
from camtorque.records import APART, TOGETHER, UNTOLD, Array, Estimate, ParameterEstimate, RigidTorque
from camtorque.units import COVERAGE, TURN, angle_grid

NOT_CARRIED = "lift_table"
"""The correction of the lift is no parameter of the fit."""
INPUT = "input"
PARTS_OF_VOLUME = ("dead_volume", "gallery_volume")
VOLUME_TO_VALVE = (
    "volume_to_valve", 1.0e-9, "mm^3", "V_0 + V_g", "volume above the plunger at full lift, up to the delivery valve",
    "follows from dead and gallery volume",
)  # fmt: skip
"""Sum of `PARTS_OF_VOLUME`: name, SI per unit, unit, symbol, meaning, source."""
ANGLE, CHAMBER = "cam angle", "plunger pressure"
"""The two reasons for which pressure makes another torque than the rigid model has."""


@dataclass(frozen=True)
class Modelled:
    """The model of one recording for one pair of mean cycles, on the grid of the fit or of the cycles."""

    chain: ChainInput
    output: ChainOutput
    values: dict[str, float]
    cam: dict[str, Array]
    by_cause: dict[str, Array]
    plunger_force: Array

    @property
    def torque(self) -> Array:
        """Model of the measured torque, (n,) [N m]."""
        return np.sum(list(self.by_cause.values()), axis=0)

    @cached_property
    def chamber_pressure(self) -> Array:
        """The pressure on the plunger as it is stated, (n,) [Pa]."""
        return stated_pressure(self.chain, self.output)


def model_of(fit: Fit, torque: Array, pressure: Array) -> Modelled:
    """Return the model of a recording for mean cycles (n_theta,) of torque and pressure [N m, Pa]."""
    solution = fit.solution
    lifts = solution.lift.coefficients(solution.residual)
    return modelled(fit.problem, solution.z, 0, lifts, fit.measured, (torque, pressure))


def modelled(
    problem: Problem, z: Array, index: int, lifts: Array, measured: Array, means: tuple[Array, Array]
) -> Modelled:
    """Return the model of one recording at free parameters z, on the grid of the fit.

    Parameters
    ----------
    lifts : coefficients of the lift correction [m], and of the errors of a wheel's swing behind them
    measured : mean torque on the grid of the fit [N m]
    means : mean cycles (n_theta,) of torque and pressure [N m, Pa]
    """
    item = problem.data[index]
    values, coefficients = problem.values(z, index)
    torque, pressure = (over_even_angle(part, item.chain.swing, item.chain.theta.size) for part in means)
    lost = item.chain.shaft_torque - measured
    lifts, errors = np.split(lifts, [item.lift_basis.n_basis])
    swing = None if item.chain.swing is None else item.chain.swing.corrected(errors)
    chain = replace(item.chain, line_pressure=pressure, shaft_torque=torque + lost, swing=swing)
    output = evaluate(chain, values, coefficients, tangents=True)
    slope = item.lift_basis.correction(output.motion.theta, lifts, 1)
    cam, force = cam_torques(chain, values, output, coefficients, slope)
    by_cause = measured_torques(chain, values, cam, coefficients)
    return Modelled(chain, output, values, cam, by_cause, force)


def on_cycles(model: Modelled, n: int) -> Modelled:
    """Return a model over n cam angles, as the cycles have them, straight between the points of the fit's grid.

    It is not evaluated anew: a delivery valve that is near to chattering answers to the places of the time steps and to
    noise between the points, and the report would show another model than the one that was fitted.
    """
    chain, motion = model.chain, model.output.motion
    if n == chain.theta.size and chain.swing is None:
        return model

    def at(values: Array) -> Array:
        return at_cam_angles(chain, values, n)

    even = angle_grid(n) if chain.swing is None else chain.swing.even(n)
    moved = Motion(
        even + at(motion.theta - chain.theta), at(motion.rate), at(motion.second), at(motion.lift.T).T,
        tuple(at(shift) for shift in motion.shifts),  # type: ignore[arg-type]
    )  # fmt: skip
    tangents = model.output.pressure_tangents
    output = replace(
        model.output, motion=moved, pressure=at(model.output.pressure), load=at(model.output.load),
        pressure_tangents=None if tangents is None else at(tangents), states=at(model.output.states),
        flows=at(model.output.flows),
    )  # fmt: skip
    over_cam = replace(
        chain, theta=angle_grid(n), line_pressure=at(chain.line_pressure), shaft_torque=at(chain.shaft_torque),
        swing=None, substeps=np.zeros(0, dtype=np.int64),
    )  # fmt: skip
    cam, by_cause = ({name: at(part) for name, part in parts.items()} for parts in (model.cam, model.by_cause))
    return Modelled(over_cam, output, model.values, cam, by_cause, at(model.plunger_force))


def derived_estimates(fit: FittedParameters) -> tuple[ParameterEstimate, ...]:
    """Return what follows from parameters by products of their powers or by their sum.

    Inertia on the cam's side and damping of the shaft; the volume above the plunger up to the delivery valve, of which
    the data tell the parts on both sides of the outlet worse than the sum.
    """
    values, _ = fit.problem.values(fit.solution.z, 0)
    compliance, resonance, ratio = (values[name] for name in SHAFT_NAMES)
    rows = []
    if compliance > RIGID:
        found = {"cam_side_inertia": cam_side_inertia(values), "shaft_damping": 2.0 * ratio / (resonance * compliance)}
        source = "follows from compliance, resonance and damping ratio of the shaft"
        for name, (per, unit, symbol, meaning, exponents) in FOLLOWING.items():
            slopes = {one: power / values[one] for one, power in zip(SHAFT_NAMES, exponents, strict=True)}
            rows.append(_derived(fit, found[name], slopes, (name, per, unit, symbol, meaning, source)))
    if fit.problem.index(PARTS_OF_VOLUME[0]) >= 0:
        total = sum(values[name] for name in PARTS_OF_VOLUME)
        slopes = dict.fromkeys(PARTS_OF_VOLUME, 1.0 / total)
        rows.append(_derived(fit, total, slopes, VOLUME_TO_VALVE))
    return tuple(rows)


def _derived(
    fit: FittedParameters, found: float, slopes: Mapping[str, float], texts: tuple[str, float, str, str, str, str]
) -> ParameterEstimate:
    """Return a value that follows from others: log-normal, of a relative deviation to first order.

    Parameters
    ----------
    slopes : parameter -> relative change per SI
    texts : name, SI per unit, unit, symbol, meaning, source
    """
    name, per, unit, symbol, meaning, source = texts
    row = np.zeros(fit.problem.size)
    for parameter, slope in slopes.items():
        if fit.problem.index(parameter) >= 0:
            row[fit.problem.index(parameter)] = slope
    statistical = float(np.sqrt(row @ fit.deviation @ row))
    total = float(np.sqrt(statistical**2 + sum(float(np.sum((rows @ row) ** 2)) for rows in fit.shifts.values())))
    value, end = found / per, float(np.exp(COVERAGE * np.sqrt(np.log1p(total**2))))
    known = knowledge(total, 1.0, value / end, 0.0, has_prior=False)
    return ParameterEstimate(
        name=name, value=value, unit=unit, stderr=value * total, stderr_statistical=value * statistical,
        ci95=(value / end, value * end), at_bound=False, identifiable=known not in UNTOLD, confounded_with=(),
        prior=None, meaning=meaning, source=source, role="shared", symbol=symbol, knowledge=known,
    )  # fmt: skip


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


def input_work(
    item: FitData, chain: ChainInput, values: Mapping[str, float], coefficients: Array, torques: Mapping[str, Array]
) -> float:
    """Return the work past the transducer [J per revolution]; ``torques`` are those of `cam_torques`."""
    felt = sum(float(np.mean(torques[name])) for name in ON_BRIDGE_ALONE)
    mean = float(np.mean(item.torque)) - float(coefficients[COLUMN_NAMES.index("torque_zero")]) - felt
    return TURN * mean + drive_work(chain, values)


def sureness(
    fit: Fit, rigid: RigidTorque, measured: Array, place_std: float
) -> tuple[dict[str, float], dict[str, Array]]:
    """Return how sure work and torque by cause of a recording are.

    Parameters
    ----------
    rigid : rigid solution, whose strokes are meant
    measured : (n_theta,) mean measured torque on the grid of ``rigid`` [N m]
    place_std : how far noise moves the place at which that is least on the return [rad]

    Returns
    -------
    work : loss, and the input -> standard uncertainty of its work [J per revolution]
    gap : cause -> (3,) that of its torque [N m]: mean over the loaded part of the forward stroke, mean over the return
        stroke, where the measured torque is least there
    """
    item = fit.problem.data[0]
    parts = _parts(item.chain, rigid, measured)
    work, gap = _both(item, *fit.problem.values(fit.solution.z, 0), rigid, parts)

    def flat(values: Mapping[str, float], coefficients: Array) -> Array:
        after = _both(item, values, coefficients, rigid, parts)
        return np.concatenate([list(after[0].values()), *after[1].values()])

    std = carried(fit, flat)
    works = dict(zip(work, std.tolist(), strict=False))
    gaps = dict(zip(gap, std[len(work) :].reshape(len(gap), -1), strict=True))
    for name, row in gaps.items():
        gaps[name] = np.array([*row[:2], np.hypot(row[2], place_std * gap[name][3])])
    del works[NOT_CARRIED], gaps[NOT_CARRIED]
    # its value is by the certificate's gain, whatever gain is fitted
    works[INPUT] = float(np.hypot(works[INPUT], work[INPUT] * (item.rows["gain_error"].prior or (0.0, 0.0))[1]))
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
    item: FitData, values: Mapping[str, float], coefficients: Array, rigid: RigidTorque, parts: Array
) -> tuple[dict[str, float], dict[str, Array]]:
    """Return work by loss and put in, and torque by cause, less a constant, weighed by parts (4, n) of the angle."""
    chain = item.chain
    output, torques, work = _caused(chain, values, coefficients)
    work[INPUT] = input_work(item, chain, values, coefficients, torques)
    curves = measured_torques(chain, values, torques, coefficients)
    angle = line_pressure_torque(rigid, output.motion.theta, chain.line_pressure * chain.pump.plunger_area)
    curves = {CHAMBER: curves.pop("pressure") - angle, ANGLE: angle, **curves}
    return work, {name: parts @ curve for name, curve in curves.items()}


def _parts(chain: ChainInput, rigid: RigidTorque, measured: Array) -> Array:
    """Return the weights (4, n) that average a curve of the fit's grid over the parts of the gap in `sureness`.

    The last ones are those of its slope where the torque is least [1/rad].
    """
    forward, fall, lowest = parts_of_gap(rigid, measured)
    cam = cam_angles(chain)
    masks = [np.interp(cam, rigid.theta, mask.astype(np.float64), period=TURN) for mask in (forward, fall)]
    least = np.zeros(cam.size)
    least[np.argmax(np.cos(cam - rigid.theta[lowest]))] = 1.0
    slope = (np.roll(least, 1) - np.roll(least, -1)) * cam.size / (2.0 * TURN)
    return np.array([*(mask / np.sum(mask) for mask in masks), least, slope])
