"""What to record next: how much a second tooth, another speed or more cycles would narrow what is least known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.fit.single import Fit
from camtorque.fit.solver import normal_equations
from camtorque.fit.uncertainty import inverse
from camtorque.laws.chain import SHIFT_NAMES, ChainInput, ChainOutput
from camtorque.records import Array

TOOTH_STD = np.radians(0.02)
"""How well the place of a second tooth against the first is known from many revolutions [rad]."""
TOOTH_ANGLE = np.radians(60.0)
TOOTH = "a second tooth 60 degrees after the first (pulses_per_rev = 6, missing_teeth = 4)"
"""The tooth with the keys that describe two teeth in place of one."""
SPEED_FACTORS = (0.6, 1.6)
WORTH = 0.85
"""A proposal is told when it brings a standard uncertainty below this share of today's."""
OUTCOMES = ("trigger_offset", "dead_volume", "leakage", "bearing_arm", "shaft_compliance", "shaft_viscous")


def next_measurement(fit: Fit) -> tuple[str, ...]:
    """Return proposals for the next recording, each with what it is expected to bring."""
    names = fit.problem.names
    watched = [name for name in OUTCOMES if name in names]
    today = fit.unbounded_std
    rest = today**2 - fit.covariance.std**2  # other laws and structures, the trigger's switching: no run narrows these
    texts = []
    for title, matrix in proposals(fit):
        after = np.sqrt(np.maximum(np.diag(matrix), 0.0) + rest)
        gains = sorted((float(after[names.index(n)] / today[names.index(n)]), n) for n in watched)
        told = [f"{name.replace('_', ' ')} to {100.0 * share:.0f} %" for share, name in gains if share < WORTH]
        if told:
            texts.append(f"{title} would reduce the uncertainty of {', '.join(told[:3])} of the present one")
    return tuple(texts)


def proposals(fit: Fit) -> list[tuple[str, Array]]:
    """Return what could be recorded next and the covariance expected after it."""
    information = inverse(fit.covariance.matrix)
    result = [(TOOTH, inverse(information + _tooth(fit)))]
    for factor in SPEED_FACTORS:
        rpm = fit.problem.data[0].chain.speed * factor * 30.0 / np.pi
        result.append((f"the same load at {rpm:.0f} rpm, fitted jointly,", _joined(fit, information, factor)))
    return result


def tooth_shifts(chain: ChainInput, output: ChainOutput) -> dict[str, float]:
    """Return by how much each parameter of the driveline turns a second tooth against the first [rad/SI]."""
    place, columns = np.mod(chain.trigger_angle + TOOTH_ANGLE, 2.0 * np.pi), output.motion.shifts[0].T
    return {
        name: float(np.interp(place, chain.theta, column, period=2.0 * np.pi))
        for name, column in zip(SHIFT_NAMES, columns, strict=True)
        if name != "trigger_offset"
    }


def _tooth(fit: Fit) -> Array:
    """Return the information that the angle between two teeth brings."""
    problem = fit.problem
    turned = tooth_shifts(problem.data[0].chain, fit.solution.output)
    row = np.array([turned.get(parameter.row.name, 0.0) for parameter in problem.parameters])
    return np.outer(row, row) / TOOTH_STD**2


def _joined(fit: Fit, information: Array, factor: float) -> Array:
    """Return the covariance after a further recording at another speed, its own parameters apart."""
    problem = fit.problem
    item = problem.data[0]
    other = replace(item, chain=replace(item.chain, speed=item.chain.speed * factor))
    moved = replace(problem, data=(other,))
    scaled, _, _ = normal_equations(moved, fit.solution.z, fit.solution.residual, fit.solution.lift)
    steps = problem.steps
    added = scaled / np.outer(steps, steps) / fit.covariance.inflation
    own = np.array([parameter.row.role == "own" for parameter in problem.parameters])
    block = added[np.ix_(own, own)] + np.diag(1.0 / fit.covariance.prior_std[own] ** 2)
    shared = np.ix_(~own, ~own)
    cross = added[np.ix_(~own, own)]
    total = information.copy()
    total[shared] += added[shared] - cross @ np.linalg.solve(block, cross.T)
    return inverse(total)
