"""How a design stands the tolerances of the shop: cams drawn at random, each off by what the design file admits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.design.evaluate import Evaluated
from camtorque.design.problem import Problem
from camtorque.design.responses import RESPONSES
from camtorque.design.schema import MILLIMETRE
from camtorque.records import Array

POINTS = 720
HARMONICS = 60
"""Waviness of a ground cam up to 60 per revolution; finer errors do not move a roller of some millimetres."""
SLACK = 1.0e-3
"""Share of a limit that a drawn cam may miss before it counts as a miss: the design itself lies on its limits."""


@dataclass(frozen=True)
class Spread:
    """One response over the drawn cams, in its unit; ``missed``: share of cams beyond its limits, None without one."""

    nominal: float
    low: float
    high: float
    missed: float | None


def spreads(problem: Problem, variables: Array, seed: int) -> Mapping[str, Spread]:
    """Return the spread of every response asked for (2.5 to 97.5 % of the drawn cams); empty without tolerances."""
    tolerances = problem.task.tolerances
    if not any(width for name, width in tolerances.items() if name != "samples"):
        return {}
    nominal = problem.evaluated(variables)
    generator = np.random.default_rng(seed)
    drawn = [_drawn(problem, nominal, generator) for _ in range(tolerances["samples"])]
    found = {}
    for name in problem.names:
        values = np.array([RESPONSES[name].value(design) for design in drawn])
        low, high = np.quantile(values, [0.025, 0.975])
        missed = [limit.missed_by(values) > SLACK * limit.scale for limit in problem.limits if limit.response == name]
        share = float(np.mean(np.any(missed, axis=0))) if missed else None
        found[name] = Spread(RESPONSES[name].value(nominal), float(low), float(high), share)
    return found


def _drawn(problem: Problem, nominal: Evaluated, generator: np.random.Generator) -> Evaluated:
    """Return the design with one draw of every tolerance, each uniform within its half width."""
    tolerances, values = problem.task.tolerances, dict(nominal.design.values)
    off = {name: tolerances[name] / MILLIMETRE * generator.uniform(-1.0, 1.0)
           for name in ("follower_offset_mm", "base_circle_radius_mm", "roller_radius_mm")}  # fmt: skip
    values |= {name: values[name] + width for name, width in off.items()}
    # the pressure acts on the mean of plunger and bore, d (d + clearance)
    clearance = tolerances["plunger_clearance_um"] / MILLIMETRE * generator.uniform(0.0, 1.0)
    values["plunger_diameter_mm"] *= float(np.sqrt(1.0 + clearance / values["plunger_diameter_mm"]))
    moved = Evaluated(replace(nominal.design, values=values), problem.task.config, problem.task.loads)
    lift = nominal.lift + shifted_follower(nominal, 1e-3 * off["follower_offset_mm"] * problem.task.config.rotation)
    lift[:3] += waviness(nominal.theta, tolerances["lift_um"], generator)
    return moved.with_lift(lift)


def shifted_follower(design: Evaluated, shift: float) -> Array:
    """Return the change of lift and derivatives (4, n) where the same cam meets a follower shifted by a little [m].

    The roller centre passes ``x = e`` at another angle: ``dy = shift (y' - e) (1/s - 1/s_0)``; the third derivative
    is left out.
    """
    y, slope, curve, jerk = design.lift
    e, s0 = design.constants.offset, design.constants.base
    s = s0 + y
    lever, gap = slope - e, 1.0 / s - 1.0 / s0
    first = curve * gap - lever * slope / s**2
    second = jerk * gap - (2.0 * slope + lever) * curve / s**2 + 2.0 * lever * slope**2 / s**3
    return shift * np.stack([lever * gap, first, second, np.zeros_like(y)])


def waviness(theta: Array, width: float, generator: np.random.Generator) -> Array:
    """Return a random error of the lift within about +- width and its two derivatives at some angles, (3, n)."""
    noise = np.fft.rfft(generator.uniform(-width, width, POINTS))[1 : HARMONICS + 1] * (2.0 / POINTS)
    order = np.arange(1, HARMONICS + 1)
    waves = np.exp(1j * np.outer(theta, order))
    return np.stack([np.real(waves @ (noise * (1j * order) ** k)) for k in range(3)])
