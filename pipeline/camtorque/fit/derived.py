"""What follows from the fitted parameters: quantities of a sheet that the data do not tell one by one."""

from __future__ import annotations

import numpy as np

from camtorque.fit.forecast import stroke_volume
from camtorque.fit.single import Fit, FittedParameters
from camtorque.fit.uncertainty import COVERAGE, knowledge, secant_steps
from camtorque.laws.chain import SHIFT_NAMES, evaluate
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.driveline import RIGID, cam_side_inertia
from camtorque.records import UNTOLD, Array, Estimate, ParameterEstimate

SHAFT = ("shaft_compliance", "shaft_resonance", "shaft_damping_ratio")
SHOWN: dict[str, tuple[float, str, str, str, tuple[float, float, float]]] = {
    "cam_side_inertia": (
        1.0e-6, "kg mm^2", "I_c", "inertia between transducer and cam, camshaft included", (-1.0, -2.0, 0.0)),
    "shaft_damping": (1.0, "N m s/rad", "c_t", "damping of the shaft's torsion", (-1.0, -1.0, 1.0)),
}  # fmt: skip
"""Quantity -> SI per unit, unit, symbol, meaning, and its exponents of the parameters of `SHAFT`."""


def derived_estimates(fit: FittedParameters) -> tuple[ParameterEstimate, ...]:
    """Return inertia on the cam's side and damping of the shaft: log-normal, of a relative deviation to first order."""
    values, _ = fit.problem.values(fit.solution.z, 0)
    compliance, resonance, ratio = (values[name] for name in SHAFT)
    if compliance <= RIGID:
        return ()
    found = {"cam_side_inertia": cam_side_inertia(values), "shaft_damping": 2.0 * ratio / (resonance * compliance)}
    rows = []
    for name, (per, unit, symbol, meaning, exponents) in SHOWN.items():
        row = np.zeros(fit.problem.size)
        for parameter, exponent in zip(SHAFT, exponents, strict=True):
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
