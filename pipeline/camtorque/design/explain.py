"""Why a task has no solution; where it has one, what each limit costs, and how the design stands the tolerances.

Tolerances: cams drawn at random, each off by what the design file admits of the shop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np

from camtorque.design.problem import Problem
from camtorque.design.responses import EQUAL, MOST, RESPONSES, Evaluated
from camtorque.design.schema import MILLIMETRE
from camtorque.design.solver import Label, Scale, Solution, multipliers, signs_of
from camtorque.design.task import SLIP, Limit
from camtorque.records import Array, Refusal

NOTHING = 1.0e-3
"""A multiplier below this share of that of the aims has no price: loosened by all its size, the limit would move them
by less than a thousandth of the front, which is where the search stopped."""
CORNER = 0.1
"""An aim whose own multiplier is below this share of the others' has no price: the front has a corner there."""
SEEN = 1.0e-3
"""A miss above this share of the limit is told."""
SHARE = 0.02
"""A multiplier below this share of the greatest does not take part in a collision."""
ANY_FIRST = ("hollow_radius_mm", "contact_force_n")
"""Responses that may be far from any sensible limit at the first guess: no flank is hollow, or hardly any load."""
UNITS = {
    "mm3_per_deg": "mm³/deg", "mm_per_rad3": "mm/rad³", "mm_per_rad2": "mm/rad²", "mm_per_rad": "mm/rad",
    "N_per_mm": "N/mm", "mm3": "mm³", "mm": "mm", "deg": "deg", "rpm": "rpm", "gpa": "GPa", "nm": "N m", "N": "N",
    "n": "N", "j": "J",
}  # fmt: skip
"""End of a name -> unit; the longer ends first."""
KINDS = {"most": "at most", "least": "at least", "equal": "equal to"}
SIDES = ("lower", "upper")
"""Of the bounds of a free quantity."""


@dataclass(frozen=True)
class Price:
    """What a limit or bound (in words) costs: the change of each aim, in its unit, per unit by which it is loosened.

    The other aims are held.
    """

    what: str
    unit: str
    per_aim: Mapping[str, float]


def _ending(name: str) -> str:
    return next((ending for ending in UNITS if name.endswith("_" + ending)), "")


def unit_of(name: str) -> str:
    """Return the unit that a name carries."""
    return UNITS.get(_ending(name), "")


def plain_name(name: str) -> str:
    """Return a response or quantity as words, without its unit."""
    stem = name.removesuffix(f"_{_ending(name)}") if _ending(name) else name
    return stem.replace("_", " ").replace("hertz", "Hertz pressure")


def limit_words(limit: Limit) -> str:
    """Return a limit as a sentence would say it."""
    return f"{plain_name(limit.response)} {KINDS[limit.kind]} {limit.value:g} {unit_of(limit.response)}".strip()


def prices(problem: Problem, scale: Scale, variables: Array, reference: Array) -> tuple[Price, ...]:
    """Return what every active limit and bound costs at a point of the front, most expensive first.

    The stationarity of the programme is ``sum mu_i grad f_i = sum lambda_j grad g_j``: with the other aims held, a
    limit loosened by d changes aim i by ``-lambda_j d / mu_i``, each in its own scale. A limit of kind ``equal`` is
    loosened towards the side that is better, which its words name.
    """
    found = multipliers(problem, scale, variables, reference)
    aims = problem.task.aims
    weights = {name: found.get(("aim", name), 0.0) for name in aims}
    signs = dict(zip(aims, signs_of(problem) * scale.width, strict=True))
    heaviest = max(weights.values())
    rows = []
    for label, weight in sorted(found.items(), key=lambda item: -abs(item[1])):
        limited = _limited(problem, label)
        if limited is not None and abs(weight) >= NOTHING * heaviest:
            what, unit, size = limited
            if isinstance(label[1], Limit) and label[1].kind == EQUAL:
                what += " (upwards)" if weight < 0.0 else " (downwards)"
            per_aim = {name: -abs(weight) / size * signs[name] / weights[name] for name in aims
                       if weights[name] > CORNER * heaviest}  # fmt: skip
            rows.append(Price(what, unit, per_aim))
    return tuple(rows)


def _limited(problem: Problem, label: Label) -> tuple[str, str, float] | None:
    """Return words, unit and scale of a limit or a bound that the user set; None for any other constraint."""
    side, what = label
    if isinstance(what, Limit):
        return limit_words(what), unit_of(what.response), what.scale
    widths = {variable.name: variable.high - variable.low for variable in problem.task.variables}
    if side in SIDES and what in widths:
        return f"{side} bound of {plain_name(what)}", unit_of(what), widths[what]
    return None


def refuse_idle(problem: Problem) -> None:
    """Refuse a ``most`` far above the first guess, or a ``least`` far below it: another unit's number does nothing."""
    for limit in problem.task.limits:
        first = RESPONSES[limit.response].value(problem.first_guess)
        idle = limit.value > SLIP * first if limit.kind == MOST else 0.0 < limit.value < first / SLIP
        if limit.kind != EQUAL and limit.response not in ANY_FIRST and first > 0.0 and idle:
            unit = unit_of(limit.response)
            raise Refusal(
                f"{problem.task.path} [limits] {limit.response}: found {limit.kind} {limit.value:g} {unit}, but the "
                f"first guess has {first:.3g} {unit}: it would limit nothing; check the unit, or leave it out"
            )


def refuse_collision(problem: Problem, nearest: Solution) -> NoReturn:
    """Refuse a task whose limits cannot be kept together: which collide at the least violation, and by how much."""
    scale = Scale(np.zeros(len(problem.task.aims)), np.ones(len(problem.task.aims)))
    found = multipliers(problem, scale, nearest.variables, None, relaxed=True)
    weights = {what: abs(weight) for (_, what), weight in found.items() if isinstance(what, Limit)}
    heaviest = max(weights.values(), default=0.0)
    colliding = [limit for limit in sorted(weights, key=lambda limit: -weights[limit])
                 if weights[limit] > SHARE * heaviest]  # fmt: skip
    bounds = [f"{side} bound of {what}" for side, what in found if side in SIDES and what != "shape"]
    design = problem.evaluated(nearest.variables)
    reached = {limit: RESPONSES[limit.response].value(design) for limit in problem.limits}
    # a limit of 0 has no size to be scaled by: what gives way to it is missed by little of a large scale
    colliding += [limit for limit, value in reached.items()
                  if limit not in colliding and limit.missed_by(value) > SEEN * abs(limit.value)]  # fmt: skip
    missed = [_missed(limit, reached[limit]) for limit in colliding[:3] or problem.limits[:1]]
    against = " and ".join(missed)
    within = f" within the {', '.join(bounds)}" if bounds else " within the bounds of [free]"
    verb = "collide" if len(missed) > 1 else "cannot be met"
    raise Refusal(
        f"{problem.task.path} [limits]: no design keeps all limits; {against} {verb}{within}: the best compromise "
        "misses each by that much; loosen one of them, or widen those bounds"
    )


def _missed(limit: Limit, value: float) -> str:
    """Return a limit with what the best compromise reaches."""
    missed = f"{abs(limit.missed_by(value)):.3g} {unit_of(limit.response)}"
    return f"{limit.text} (reached {value:.4g}, missed by {missed})".replace("_", " ")


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
