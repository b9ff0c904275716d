"""Minimum, covariance and model spread -> the parameters as they are reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from camtorque.fit.problem import Problem, Slot
from camtorque.fit.profiles import Profile, describe
from camtorque.fit.solve import Solution
from camtorque.fit.uncertainty import (
    PRIOR_DOMINATED,
    Covariance,
    at_bounds,
    confounded_with,
    parameter_values,
)
from camtorque.laws import EFFECT_OF, ROWS
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array, Finding, ParameterEstimate

COVERAGE = 1.96
LIFT_NAME = "lift_correction_max"
PULLED = 2.0
"""A prior that is left by more than this many standard deviations is a finding."""


def estimates(
    problem: Problem, solution: Solution, cov: Covariance, spreads: Array, recording: int | None = None
) -> tuple[ParameterEstimate, ...]:
    """Return every free parameter with statistical and total uncertainty, in the unit of its row.

    ``recording`` leaves out what is another recording's own.
    """
    values = parameter_values(problem, solution)
    bound = at_bounds(problem, solution)
    statistical = np.sqrt(np.maximum(np.diag(cov.matrix), 0.0))
    result = []
    for index, slot in enumerate((*problem.nonlinear, *problem.linear)):
        if recording is not None and slot.recording not in (-1, recording):
            continue
        total = float(np.hypot(statistical[index], spreads[index]))
        result.append(
            _estimate(slot, float(values[index]), float(statistical[index]), total, bool(bound[index]), cov, index)
        )
    if problem.n_lift:
        result.append(_lift_estimate(problem, solution))
    return tuple(result)


def _estimate(
    slot: Slot, value: float, statistical: float, total: float, bound: bool, cov: Covariance, index: int
) -> ParameterEstimate:
    row = slot.row
    per = row.per_unit
    low, high = _interval(row, value, total, bound)
    told = row.prior is None or statistical < PRIOR_DOMINATED * row.prior[1]
    confounded = confounded_with(cov, index)
    return ParameterEstimate(
        name=slot.name, value=value / per, unit=row.unit, stderr=total / per, stderr_statistical=statistical / per,
        ci95=(low / per, high / per), at_bound=bound, identifiable=bool(told and not bound and not confounded),
        confounded_with=confounded, prior=None if row.prior is None else (row.prior[0] / per, row.prior[1] / per),
        meaning=row.meaning, source=row.source, role=row.role, effect=EFFECT_OF[row.name], symbol=row.symbol,
    )  # fmt: skip


def _interval(row: ParameterRow, value: float, total: float, bound: bool) -> tuple[float, float]:
    """Return the 95 % interval inside the bounds; at a bound it is one-sided, from the bound inwards."""
    width = total if total > 0.0 else row.step
    low, high = value - COVERAGE * width, value + COVERAGE * width
    if bound:
        low, high = (value, value + COVERAGE * width) if value <= row.lower + row.step else (low, value)
    return max(low, row.lower), min(high, row.upper)


def with_profiles(
    parameters: Sequence[ParameterEstimate], profiles: Sequence[Profile]
) -> tuple[ParameterEstimate, ...]:
    """Return the parameters with 95 % intervals from profiles where there are any.

    The profile gives each side's statistical width, the model spread is added in quadrature. A side on which the
    profile never ends reaches to the bound; a flat profile says that the parameter is not identifiable.
    """
    known = {profile.name: profile for profile in profiles}
    return tuple(_with_profile(row, known[row.name]) if row.name in known else row for row in parameters)


def _with_profile(row: ParameterEstimate, profile: Profile) -> ParameterEstimate:
    model = COVERAGE * np.sqrt(max(row.stderr**2 - row.stderr_statistical**2, 0.0))
    per, law = ROWS[row.name.split("__")[0]].per_unit, ROWS[row.name.split("__")[0]]
    low = row.value - float(np.hypot(row.value - profile.low, model))
    high = row.value + float(np.hypot(profile.high - row.value, model))
    if profile.kind in ("upper limit", "flat"):
        low = profile.low
    if profile.kind in ("lower limit", "flat"):
        high = profile.high
    interval = (max(low, law.lower / per), min(high, law.upper / per))
    return replace(row, ci95=interval, identifiable=row.identifiable and profile.kind != "flat")


def profile_findings(profiles: Sequence[Profile]) -> tuple[Finding, ...]:
    """Return a finding for every profile that has no end on one side or on both."""
    return tuple(
        Finding("one_sided_profile", "info", describe(profile, ROWS[profile.name.split("__")[0]]), profile.name)
        for profile in profiles if profile.kind != "two-sided"
    )  # fmt: skip


def _lift_estimate(problem: Problem, solution: Solution) -> ParameterEstimate:
    basis = problem.data[0].chain.lift_basis
    assert basis is not None
    lift = solution.c[len(problem.linear) :] * 1e6
    largest = float(np.max(np.abs(lift)))
    bound = basis.bound * 1e6
    return ParameterEstimate(
        LIFT_NAME, largest, "um", basis.prior_std * 1e6, basis.prior_std * 1e6, (0.0, bound), largest >= bound * 0.999,
        True, (), (0.0, basis.prior_std * 1e6),
        f"largest of {lift.size} coefficients of the lift correction (rms {np.std(lift):.2f} um), each within three "
        "standard deviations of the table's noise", "lift table: resolution and scatter", "shared", "lift", "dy",
    )  # fmt: skip


def prior_findings(parameters: Sequence[ParameterEstimate]) -> tuple[Finding, ...]:
    """Return a finding for every parameter that the data pull more than two standard deviations off its prior."""
    result = []
    for parameter in parameters:
        if parameter.prior is None or parameter.name == LIFT_NAME:
            continue
        pull = (parameter.value - parameter.prior[0]) / parameter.prior[1]
        if abs(pull) > PULLED:
            text = (
                f"{parameter.name} is {parameter.value:.4g} {parameter.unit}, {pull:+.1f} standard deviations off what "
                f"was expected ({parameter.prior[0]:.4g} +- {parameter.prior[1]:.2g}): a law may be missing"
            )
            result.append(Finding("prior_pulled", "warning", text, parameter.name))
        if parameter.at_bound:
            text = (
                f"{parameter.name} sits at its bound, {parameter.value:.4g} {parameter.unit}; its interval is one-sided"
            )
            result.append(Finding("parameter_at_bound", "info", text, parameter.name))
    return tuple(result)
