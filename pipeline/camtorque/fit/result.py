"""A minimum -> `FittedTorque`: torque by cause, forces, losses, metrics, uncertainty, what stays unexplained."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.fit.derived import (
    INPUT,
    Modelled,
    delivered_volume,
    derived_estimates,
    input_work,
    model_of,
    on_cycles,
    sureness,
)
from camtorque.fit.evidence import where_unexplained
from camtorque.fit.findings import (
    fit_findings,
    frictionless_findings,
    implausible_findings,
    light_cam_findings,
    mounting_findings,
    prior_findings,
    sheet_findings,
    spill_findings,
    stress_findings,
    table_findings,
    wheel_findings,
)
from camtorque.fit.fitted import FittedParameters
from camtorque.fit.planning import Measuring
from camtorque.fit.prepare import MeanCycles, at_cam_angles
from camtorque.fit.problem import SEPARATOR, STRUCTURES
from camtorque.fit.proposals import next_measurement
from camtorque.fit.residual import (
    STROKE,
    block_cross_validation,
    is_explained,
    least_place_std,
    metrics_of_fit,
    parts_of_gap,
    residual_bumps,
)
from camtorque.fit.single import Fit
from camtorque.fit.uncertainty import (
    confounded_with,
    correlation_of,
    knowledge,
    pressure_jacobian,
    stated_pressure,
    uncertainty_budget,
    unresolved_amplitude,
    without_spikes,
)
from camtorque.laws import ROWS
from camtorque.laws.causes import work_per_revolution
from camtorque.laws.chain import COLUMN_NAMES, SHIFT_NAMES
from camtorque.laws.driveline import COMPLIANCE_NAMES
from camtorque.mechanism.contact import pulls
from camtorque.mechanism.friction import Friction
from camtorque.mechanism.lift_laws import lift_law
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.solve import forces_of
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import (
    ORDERS_TOLD,
    UNTOLD,
    Alternative,
    AngleError,
    Array,
    CamCycles,
    Estimate,
    FittedTorque,
    ParameterEstimate,
    Recording,
    RigidTorque,
)
from camtorque.units import DEGREE

WORTH_TELLING = 0.01
"""Least probability of another structure that is reported."""


def fitted_torque(
    fit: Fit, recording: Recording, cycles: CamCycles, rigid: RigidTorque, means: MeanCycles
) -> FittedTorque:
    """Return the record of a fit."""
    even = model_of(fit, means.torque, means.pressure)
    fitted = on_cycles(even, cycles.theta.size)
    held = on_cycles(model_of(fit, means.held_torque, means.held_pressure), cycles.theta.size)
    parameters = parameter_estimates(fit)
    config = recording.config
    smooth = lift_law(recording.cam_table)  # curvature and Hertz stress need the smoother law
    motion = fitted.output.motion
    _, coefficients = fit.problem.values(fit.solution.z, 0)
    arms = (float(coefficients[COLUMN_NAMES.index(name)]) for name in ("bearing_arm", "pin_arm"))
    friction = Friction(fitted.values["guide_friction"], *arms)
    mounting = Mounting(rotation=config.rotation)
    tables = closed_form_tables(config.pump, smooth, motion.theta, mounting, friction)
    pushed = fitted.chamber_pressure + fitted.plunger_force / config.pump.plunger_area
    forces = forces_of(config.pump, tables, pushed, motion.rate, motion.second)
    lost = pulls(tables.evaluate("contact_normal", pushed, motion.rate, motion.second))
    stds = pressure_stds(fit, fitted)
    known = {row.name.split(SEPARATOR)[0]: row for row in parameters}
    trigger = _moved(config.trigger.nominal_angle, known["trigger_offset"], DEGREE)
    place_std = least_place_std(means, parts_of_gap(rigid, means.torque_all)[2])
    losses_stderr, gap_stderr = sureness(fit, rigid, means.torque_all, place_std)
    residual = means.torque - fitted.torque
    peak = float(np.max(means.torque_all))
    explained = is_explained(residual, means.odd_even, peak)
    evidence = fit.evidence if explained else where_unexplained(fit.evidence)
    left = 100.0 * float(np.sqrt(np.mean(residual**2))) / peak
    chamber = fitted.chamber_pressure if fitted.chain.uses_chamber else None
    delivered = delivered_volume(fit) if "delivered_volume" in cycles.channels else None
    return FittedTorque(
        effects=("trigger", "sensor", *(row.name for row in evidence if row.verdict == "needed")),
        parameters=parameters, correlation=correlation_of(fit.deviation),
        correlation_names=fit.problem.names,
        torque=fitted.torque, torque_held_out=held.torque, by_cause=fitted.by_cause, chamber_pressure=chamber,
        chamber_pressure_std=None if stds is None else stds[0], chamber_peak=_chamber_peak(fitted, stds),
        chamber_return_start=return_start(fitted, stds), true_angle=motion.theta, forces=forces,
        contact_lost=bool(np.any(lost)), losses=_losses(fit, even),
        losses_stderr=losses_stderr, gap_stderr=gap_stderr,
        metrics=metrics_of_fit(means, fitted.torque, held.torque, rigid.torque, rigid.lift, rigid.lift_velocity),
        trigger_angle=trigger,
        torque_delay=_moved(cycles.torque_delay.value, known["delay_error"], 1e-6),
        angle_errors_after=_angle_budget(known, fitted, cycles, trigger), odd_even_rms=means.odd_even,
        next_measurement=proposed(fit, cycles, config.has_teeth),
        findings=(
            *prior_findings(parameters), *mounting_findings(parameters), *implausible_findings(parameters, explained),
            *light_cam_findings(parameters, config.pump.cam_inertia), *frictionless_findings(parameters),
            *table_findings(recording.cam_table), *sheet_findings(fit.doubts, config.pump),
            *wheel_findings(fit.problem.data[0].chain.told_order),
            *spill_findings(parameters, fitted.chain.top_lift), *stress_findings(forces.hertz),
            *fit_findings(fit, fitted.output.least_guide, lost, None if explained else left),
        ),
        details={**_details(fit, recording, peak), "delivered_volume": delivered}, evidence=evidence,
        alternatives=alternatives(fit, config.trigger.nominal_angle),
        bumps=residual_bumps(residual, means.torque - means.held_torque, fitted), explained=explained,
    )  # fmt: skip


def proposed(fit: Fit, cycles: CamCycles, has_teeth: bool) -> tuple[str, ...]:
    """Return `next_measurement` for the bench of a recording."""
    rows = [parameter.row for parameter in fit.problem.parameters]
    own = {row.name: row.prior[1] for row in rows if row.role == "own" and row.prior}
    measuring = Measuring(float(np.sqrt(np.mean(cycles.torque_std**2))), own)
    return next_measurement(fit, measuring, float(np.sum(2.0 * np.pi / cycles.speed)), has_teeth)


def parameter_estimates(fit: FittedParameters) -> tuple[ParameterEstimate, ...]:
    """Return the parameters of a recording, then what the structure leaves out."""
    problem, total, told = fit.problem, fit.std, fit.unbounded_std
    statistical, correlation = fit.statistical_std, correlation_of(fit.deviation)
    rows = []
    for k, parameter in enumerate(problem.parameters):
        row, value, std = parameter.row, float(fit.solution.z[k]), float(total[k])
        low, high = fit.interval(k)
        before = float(fit.covariance.prior_std[k])
        known = knowledge(float(told[k]), before, low, row.lower, row.prior is not None)
        per = row.per_unit
        rows.append(ParameterEstimate(
            name=parameter.name, value=value / per, unit=row.unit, stderr=std / per,
            stderr_statistical=float(statistical[k]) / per, ci95=(low / per, high / per),
            at_bound=value <= row.lower or value >= row.upper, identifiable=known not in UNTOLD,
            confounded_with=confounded_with(problem, correlation[k], k) if known not in UNTOLD else (),
            prior=None if row.prior is None else (row.prior[0] / per, row.prior[1] / per), meaning=row.meaning,
            source=row.source, role=row.role, symbol=row.symbol, knowledge=known,
        ))  # fmt: skip
    return (*rows, *derived_estimates(fit))


def alternatives(fit: Fit, nominal: float) -> tuple[Alternative, ...]:
    """Return the structures (and second minima) that were compared and are not out of the question, best first."""
    rows: list[Alternative] = []
    for item, probability in zip(fit.candidates, fit.probabilities, strict=True):
        if rows and probability < WORTH_TELLING:
            continue
        trigger = item.problem.index("trigger_offset")
        residual = item.solution.left / item.data.weight
        pressure = stated_pressure(item.data.chain, item.solution.output)
        rows.append(Alternative(
            STRUCTURES[item.data.structure], probability, float(np.sqrt(np.mean(residual**2))),
            nominal + float(item.solution.z[trigger]), float(np.max(pressure)),
        ))  # fmt: skip
    return tuple(rows)


def _details(fit: Fit, recording: Recording, peak: float) -> dict[str, object]:
    solution, problem = fit.solution, fit.problem
    blocks = 100.0 / peak * block_cross_validation(problem, solution, fit.covariance)
    sheet = recording.of("torque")[0].calibration
    absolute, zero = float("nan"), problem.data[0].rows["torque_zero"].prior
    if sheet is not None and zero is not None:
        absolute = 100.0 * float(np.hypot(sheet.gain_relative_std, np.hypot(zero[1], sheet.nonlinearity_std) / peak))
    spreads = {name: np.sqrt(np.sum(rows**2, axis=0)) for name, rows in fit.shifts.items()}
    return {
        "delivery": problem.data[0].structure, ORDERS_TOLD: problem.data[0].chain.told_order,
        "budget": uncertainty_budget(problem, fit.covariance, fit.deviation, spreads),
        "block_cv_percent": blocks.tolist(), "absolute_uncertainty_percent": absolute,
    }  # fmt: skip


def _losses(fit: Fit, fitted: Modelled) -> dict[str, float]:
    """Return work per revolution by cause [J], the input and how well they close."""
    work = work_per_revolution(fitted.chain, fitted.values, fitted.output, fitted.cam)
    _, coefficients = fit.problem.values(fit.solution.z, 0)
    total = input_work(fit.problem.data[0], fitted.chain, fitted.values, coefficients, fitted.cam)
    closure = 100.0 * (total - sum(work.values())) / total if total else float("nan")
    return {**work, INPUT: total, "closure_percent": closure}


def pressure_stds(fit: Fit, fitted: Modelled) -> Array | None:
    """Return the chamber pressure's standard uncertainty, total and statistical, over angle, (2, n_theta) [Pa]."""
    if fitted.output.pressure_tangents is None or not fitted.chain.uses_chamber:
        return None
    jacobian, own = pressure_jacobian(fit.problem, fitted.output)
    variance = np.einsum("ij,jk,ik->i", jacobian, fit.deviation[np.ix_(own, own)], jacobian)
    statistical = variance
    for shift in fit.pressure_shifts:
        variance = variance + at_cam_angles(fit.problem.data[0].chain, shift, variance.size) ** 2
    gain = fit.pressure_gain_std * fitted.chamber_pressure
    variance = variance + gain**2 + unresolved_amplitude(fitted.output, fitted.chain.line_pressure) ** 2
    found = (np.sqrt(np.maximum(part, 0.0)) for part in (variance, statistical))
    return np.array([without_spikes(fitted.chamber_pressure, std) for std in found])


def _chamber_peak(fitted: Modelled, stds: Array | None) -> Estimate | None:
    if stds is None:
        return None
    top = int(np.argmax(fitted.chamber_pressure))
    total, statistical = stds[:, top].tolist()
    return Estimate(float(fitted.chamber_pressure[top]), total, stderr_statistical=statistical)


def return_start(fitted: Modelled, stds: Array | None) -> Estimate | None:
    """Return the chamber pressure where the lift has fallen to 95 %, whatever the grid; ``stds``: `pressure_stds`."""
    if stds is None:
        return None
    lift = fitted.output.motion.lift[0]
    above = (lift - np.min(lift)) / np.ptp(lift) - STROKE[1]
    after = np.roll(above, -1)
    start = int(np.flatnonzero((above >= 0.0) & (after < 0.0))[0])
    part = above[start] / (above[start] - after[start])
    places = [start, (start + 1) % lift.size]
    curves = np.vstack([fitted.chamber_pressure, stds])
    pressure, total, statistical = (curves[:, places] @ [1.0 - part, part]).tolist()
    return Estimate(pressure, total, stderr_statistical=statistical)


def _moved(nominal: float, row: ParameterEstimate, unit: float) -> Estimate:
    """Return what a parameter moves off its nominal value; ``unit``: SI per unit of the parameter."""
    return Estimate(nominal + row.value * unit, row.stderr * unit, nominal, row.stderr_statistical * unit)


def _angle_budget(
    known: Mapping[str, ParameterEstimate], fitted: Modelled, cycles: CamCycles, trigger: Estimate
) -> tuple[AngleError, ...]:
    """Return what is left of the angle errors after the fit, in degrees."""
    text = f"fitted {known['trigger_offset'].value:+.3f} deg off nominal; other laws and structures included"
    late = known["delay_error"].stderr * 1e-6 * cycles.mean_speed / DEGREE
    rows = [
        AngleError("trigger angle", float(trigger.stderr / DEGREE), text),
        AngleError("torque delay", late, "under its prior"),
    ]
    for name in COMPLIANCE_NAMES:
        if name in known:
            shift = np.ptp(fitted.output.motion.shifts[0][:, SHIFT_NAMES.index(name)]) / DEGREE / 2.0
            error = float(known[name].stderr * ROWS[name].per_unit * shift)
            if error > 0.0:
                rows.append(AngleError(name.replace("_", " "), error))
    before = {row.source: row for row in cycles.angle_errors}
    kept = [row for source, row in before.items() if "install" not in source and "torque delay" not in source]
    return (*rows, *kept)
