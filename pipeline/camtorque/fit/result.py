"""A minimum -> `FittedTorque`: torque by cause, forces, losses, metrics, uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camtorque.fit.advice import next_measurement
from camtorque.fit.bootstrap import Bootstrap
from camtorque.fit.budget import BudgetRow, uncertainty_budget
from camtorque.fit.combinations import combinations
from camtorque.fit.estimates import estimates, prior_findings, profile_findings, with_profiles
from camtorque.fit.metrics import metrics, stroke_masks
from camtorque.fit.next_run import expected_gains
from camtorque.fit.posterior import Posterior
from camtorque.fit.predict import torque_zero
from camtorque.fit.prepare import Halves, swapped
from camtorque.fit.problem import Problem
from camtorque.fit.profiles import Profile
from camtorque.fit.solve import Solution, chain_coefficients
from camtorque.fit.uncertainty import Covariance, Variant
from camtorque.laws import ROWS
from camtorque.laws.causes import cam_torques, measured_torques, work_per_revolution
from camtorque.laws.chain import SHIFT_NAMES, ChainInput, ChainOutput, evaluate_chain
from camtorque.laws.chamber import KERNEL_ORDER
from camtorque.laws.driveline import COMPLIANCE_NAMES
from camtorque.mechanism import Mounting, closed_form_tables, forces_of, lift_law
from camtorque.mechanism.outliers import outlying_points
from camtorque.mechanism.smoothing import table_error
from camtorque.records import (
    AngleError,
    Array,
    CamCycles,
    CamTable,
    Estimate,
    Finding,
    FittedTorque,
    LadderRung,
    Metrics,
    ParameterEstimate,
    Recording,
    RigidTorque,
)
from camtorque.units import DEGREE


@dataclass(frozen=True)
class Fit:
    """Everything that one chosen model consists of.

    ``spreads`` (k,) is all that is not statistical [SI], ``gain_shift`` (k,) the pressure gain's part of it.
    """

    problem: Problem
    solution: Solution
    covariance: Covariance
    spreads: Array
    gain_shift: Array
    variants: tuple[Variant, ...]
    ladder: tuple[LadderRung, ...]
    posterior: Posterior | None = None
    profiles: tuple[Profile, ...] = ()
    bootstrap: Bootstrap | None = None


@dataclass(frozen=True)
class Modelled:
    """The model of one recording on the fine grid, for one pair of mean cycles."""

    chain: ChainInput
    output: ChainOutput
    values: dict[str, float]
    cam: dict[str, Array]
    by_cause: dict[str, Array]

    @property
    def torque(self) -> Array:
        """Model of the measured torque, (n_theta,) [N m]."""
        return np.sum(list(self.by_cause.values()), axis=0)


def model_on_grid(problem: Problem, solution: Solution, index: int, chain: ChainInput) -> Modelled:
    """Return the model of one recording on the fine grid.

    Parameters
    ----------
    index : recording in the problem
    chain : its input with the pressure and torque of the cycles in question, and the links of the problem
    """
    values = problem.values(solution.x, index)
    output = evaluate_chain(chain, values)
    coefficients = chain_coefficients(problem, solution.c)
    cam = cam_torques(chain, values, output, coefficients)
    by_cause = measured_torques(chain, values, cam, torque_zero(problem, solution, index))
    return Modelled(chain, output, values, cam, by_cause)


def fitted_torque(
    fit: Fit, index: int, recording: Recording, cycles: CamCycles, rigid: RigidTorque, means: Halves
) -> FittedTorque:
    """Return the record of one recording of a fit.

    Parameters
    ----------
    fit : the chosen model of one or several recordings
    index : which recording
    recording, cycles, rigid, means : the recording, its cycles, rigid solution and mean cycles
    """
    problem, solution = fit.problem, fit.solution
    fitted = model_on_grid(problem, solution, index, problem.data[index].chain)
    held = model_on_grid(problem, solution, index, swapped(problem.data[index], means.held_torque, means.held_pressure))
    parameters = _own_parameters(fit, index)
    gains = expected_gains(problem, solution, index) if len(problem.data) == 1 else ()
    config = recording.config
    mounting = Mounting(rotation=config.rotation)
    smooth = lift_law(recording.cam_table)  # curvature and Hertz stress need the smoother law
    tables = closed_form_tables(config.pump, smooth, fitted.output.motion.theta, mounting)
    motion = fitted.output.motion
    forces = forces_of(config.pump, tables, fitted.output.pressure, motion.rate, motion.second)
    pressure_std = _pressure_std(fit, index, fitted)
    trigger = _trigger(parameters, config.trigger.nominal_angle)
    return FittedTorque(
        effects=problem.effects, parameters=parameters, correlation=fit.covariance.correlation,
        correlation_names=fit.covariance.names, torque=fitted.torque, torque_held_out=held.torque,
        by_cause=fitted.by_cause,
        chamber_pressure=fitted.output.pressure if fitted.chain.uses_chamber else None,
        chamber_pressure_std=pressure_std, chamber_peak=_chamber_peak(fitted, pressure_std),
        chamber_return_start=_return_start(fitted, pressure_std), true_angle=motion.theta, forces=forces,
        contact_lost=bool(np.min(fitted.output.load) <= 0.0), losses=_losses(fit, index, fitted, means),
        metrics=_metrics(means, fitted.torque, held.torque, rigid), ladder=fit.ladder, trigger_angle=trigger,
        torque_delay=_delay(parameters, cycles.torque_delay),
        angle_errors_after=_angle_budget(parameters, fitted, cycles, trigger),
        odd_even_rms=float(np.sqrt(np.mean((means.torque - means.held_torque) ** 2))),
        next_measurement=next_measurement(parameters, gains),
        findings=(
            *prior_findings(parameters), *profile_findings(fit.profiles), *table_findings(recording.cam_table),
            *_fit_findings(fit, index, fitted),
        ),
        details=_details(fit, index, fitted),
    )  # fmt: skip


def _details(fit: Fit, index: int, fitted: Modelled) -> dict[str, object]:
    solution = fit.solution
    return {
        "variants": {variant.name: variant.solution.chi_square for variant in fit.variants},
        "inflation": fit.covariance.inflation, "iterations": solution.iterations, "converged": solution.converged,
        "chi_square": solution.chi_square, "lift_correction": _lift_curve(fit, fitted), "flows": fitted.output.flows,
        "delivery": fit.problem.data[index].delivery, "posterior": fit.posterior, "budget": _budget(fit),
        "profiles": fit.profiles, "bootstrap": fit.bootstrap,
        "combinations": combinations(fit.problem, fit.solution, fit.covariance) if len(fit.problem.data) == 1 else (),
    }  # fmt: skip


def _budget(fit: Fit) -> tuple[BudgetRow, ...]:
    """Return the budget of a single recording's fit; that of a joint fit is asked for by itself, once."""
    if len(fit.problem.data) > 1:
        return ()
    return uncertainty_budget(fit.problem, fit.solution, fit.covariance, fit.spreads, fit.gain_shift)


def _own_parameters(fit: Fit, index: int) -> tuple[ParameterEstimate, ...]:
    """Return shared parameters and those of one recording."""
    rows = estimates(fit.problem, fit.solution, fit.covariance, fit.spreads, index)
    return with_profiles(rows, fit.profiles)


def _metrics(means: Halves, fitted: Array, held: Array, rigid: RigidTorque) -> dict[str, Metrics]:
    lift, velocity = rigid.lift, rigid.lift_velocity
    return {
        "rigid": metrics(means.torque_all, rigid.torque, rigid.torque, lift, velocity),
        "fitted": metrics(means.torque, fitted, rigid.torque, lift, velocity),
        "fitted_held_out_cycles": metrics(means.held_torque, held, rigid.torque, lift, velocity),
    }


def _losses(fit: Fit, index: int, fitted: Modelled, means: Halves) -> dict[str, float]:
    """Return work per revolution by cause [J], the input and how well they close."""
    work = work_per_revolution(fitted.chain, fitted.output, fitted.cam)
    zero = torque_zero(fit.problem, fit.solution, index)
    total = 2.0 * np.pi * (float(np.mean(means.torque)) - zero)
    return {**work, "input": total, "closure_percent": 100.0 * (total - sum(work.values())) / total}


def _pressure_std(fit: Fit, index: int, fitted: Modelled) -> Array | None:
    """Return the total standard uncertainty of the chamber pressure over angle, (n_theta,) [Pa]."""
    if fitted.output.pressure_tangents is None:
        return None
    problem = fit.problem
    tangents = fitted.output.pressure_tangents
    columns = (*KERNEL_ORDER, *SHIFT_NAMES)
    used = [
        (j, columns.index(slot.row.name)) for j, slot in enumerate(problem.nonlinear)
        if slot.recording in (-1, index) and slot.row.name in columns
    ]  # fmt: skip
    rows = [j for j, _ in used]
    jacobian = tangents[:, [k for _, k in used]]
    variance = np.einsum("ij,jk,ik->i", jacobian, fit.covariance.matrix[np.ix_(rows, rows)], jacobian)
    for variant in fit.variants:
        other = evaluate_chain(variant.problem.data[index].chain, variant.problem.values(variant.solution.x, index))
        variance = variance + (other.pressure - fitted.output.pressure) ** 2 / len(fit.variants)
    return np.sqrt(np.maximum(variance, 0.0))


def _chamber_peak(fitted: Modelled, std: Array | None) -> Estimate | None:
    if std is None:
        return None
    top = int(np.argmax(fitted.output.pressure))
    return Estimate(float(fitted.output.pressure[top]), float(std[top]))


def _return_start(fitted: Modelled, std: Array | None) -> Estimate | None:
    """Return the chamber pressure where the lift has fallen to 95 %."""
    if std is None:
        return None
    lift, velocity = fitted.output.motion.lift[0], fitted.output.motion.lift[1]
    start = int(np.flatnonzero(stroke_masks(lift, velocity)[1])[0])
    return Estimate(float(fitted.output.pressure[start]), float(std[start]))


def _trigger(parameters: Sequence[ParameterEstimate], nominal: float) -> Estimate:
    for parameter in parameters:
        if parameter.name == "trigger_offset":
            return Estimate(
                nominal + parameter.value * DEGREE, parameter.stderr * DEGREE, nominal,
                parameter.stderr_statistical * DEGREE,
            )  # fmt: skip
    return Estimate(nominal, float("nan"), nominal)


def _delay(parameters: Sequence[ParameterEstimate], nominal: Estimate) -> Estimate:
    for parameter in parameters:
        if parameter.name == "delay_error":
            return Estimate(
                nominal.value + parameter.value * 1e-6, parameter.stderr * 1e-6, nominal.value,
                parameter.stderr_statistical * 1e-6,
            )  # fmt: skip
    return nominal


def _angle_budget(
    parameters: Sequence[ParameterEstimate], fitted: Modelled, cycles: CamCycles, trigger: Estimate
) -> tuple[AngleError, ...]:
    """Return what is left of the angle errors after the fit, in degrees."""
    known = {parameter.name: parameter for parameter in parameters}
    speed_deg = cycles.mean_speed / DEGREE
    rows = []
    if "trigger_offset" in known:
        text = f"fitted {known['trigger_offset'].value:+.3f} deg off nominal; model spread included"
        rows.append(AngleError("trigger angle", float(trigger.stderr / DEGREE), text))
    if "delay_error" in known:
        rows.append(
            AngleError("torque delay", known["delay_error"].stderr * 1e-6 * speed_deg, "fitted under its prior")
        )
    for name in COMPLIANCE_NAMES:
        if name in known and known[name].value != 0.0:
            shift = np.ptp(fitted.output.motion.shifts[0][:, SHIFT_NAMES.index(name)]) / DEGREE / 2.0
            rows.append(AngleError(name.replace("_", " "), float(known[name].stderr * ROWS[name].per_unit * shift)))
    before = {row.source: row for row in cycles.angle_errors}
    kept = [row for source, row in before.items() if "install" not in source and "torque delay" not in source]
    return (*rows, *kept)


def _lift_curve(fit: Fit, fitted: Modelled) -> Array:
    basis = fitted.chain.lift_basis
    if basis is None or not fit.problem.n_lift:
        return np.zeros(fitted.chain.theta.size)
    return basis.correction(fitted.chain.theta, fit.solution.c[len(fit.problem.linear) :])


def table_findings(table: CamTable) -> tuple[Finding, ...]:
    """Return what is odd about a lift table: single points that stick out, and scatter beyond the stated resolution."""
    result = []
    outliers = outlying_points(table)
    if outliers.size:
        where = ", ".join(f"{angle / DEGREE:.1f}" for angle in table.theta[outliers[:5]])
        text = (
            f"{outliers.size} points of the lift table stick out of their neighbours; torque and stress are wrong there"
        )
        result.append(Finding("lift_outlier", "warning", text, f"{where} deg"))
    scatter = table_error(np.append(table.theta, table.theta[0] + 2.0 * np.pi), table.lift, table.resolution)
    if scatter > 0.6 * table.resolution:
        text = (
            f"the lift table scatters by {scatter * 1e6:.2f} um about a smooth curve, rounding to "
            f"{table.resolution * 1e6:g} um alone gives {table.resolution * 1e6 / np.sqrt(12.0):.2f} um; "
            "it is smoothed by its scatter"
        )
        result.append(Finding("lift_scatter", "info", text))
    return tuple(result)


def _fit_findings(fit: Fit, index: int, fitted: Modelled) -> tuple[Finding, ...]:
    result = []
    if not fit.solution.converged:
        text = "the fit has not ended in a minimum: chi-square still falls slowly along a flat direction"
        result.append(Finding("not_converged", "warning", text))
    if fit.covariance.inflation > 1.0:
        text = (
            f"the residual exceeds the scatter of the cycles and the admitted model error of 0.1 %; the uncertainties "
            f"are widened by {np.sqrt(fit.covariance.inflation):.2f}"
        )
        result.append(Finding("model_discrepancy", "info", text))
    if np.min(fitted.output.load) <= 0.0:
        angle = float(fitted.chain.theta[int(np.argmin(fitted.output.load))] / DEGREE)
        text = f"the follower leaves the cam near {angle:.0f} deg"
        result.append(Finding("contact_lost", "warning", text))
    factor = (
        fitted.values["guide_friction"]
        * np.max(np.abs(fitted.output.motion.lift[1]))
        / (fitted.chain.pump.base_circle_radius + fitted.chain.pump.roller_radius)
    )
    if factor > 0.5:
        result.append(
            Finding("guide_near_jamming", "warning", f"mu tan(phi) reaches {factor:.2f}; the guide jams at 1")
        )
    return tuple(result)
