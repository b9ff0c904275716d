"""The responses of a design; each may be an aim or a limit. A new one is one function and one line.

A response that is a peak over the revolution is given as the greatest value of each window of it: the optimiser sees
all peaks at once, each a smooth function of the design, not only the one that is highest at the moment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camtorque.design.evaluate import PER_FLANK, Evaluated
from camtorque.records import Array
from camtorque.units import DEGREE, RPM

MOST, LEAST, EQUAL = "most", "least", "equal"
FLAT = 1.0
"""Curvature below which a surface counts as flat, 1 m of radius [1/m]."""
FASTEST = 1.0e5
"""A follower that leaves the cam above this never does [rpm]."""


@dataclass(frozen=True)
class Response:
    """A response of a design, in the unit of its name.

    Attributes
    ----------
    extreme : ``max``, ``min`` or ``range`` of the values, or ``single`` for one number
    values : the values; for a range those of the upper and of the lower end under each load in turn
    aim : what an aim asks of it, ``least`` or ``most``
    """

    extreme: str
    values: Callable[[Evaluated], tuple[Array, ...]]
    aim: str = LEAST

    @property
    def limits(self) -> tuple[str, ...]:
        """The kinds of limits that it takes."""
        return {"max": (MOST,), "min": (LEAST,), "range": (MOST,), "single": (MOST, LEAST, EQUAL)}[self.extreme]

    def value(self, design: Evaluated) -> float:
        """Return the response as one number."""
        parts = self.values(design)
        if self.extreme == "min":
            return float(np.min(parts[0]))
        if self.extreme == "range":
            return float(max(np.max(a) - np.min(b) for a, b in zip(parts[::2], parts[1::2], strict=True)))
        return float(np.max(parts[0]))


def _over_loads(one: Callable[[Evaluated, int], Array]) -> Callable[[Evaluated], tuple[Array, ...]]:
    """Return the values under every load, one after the other."""
    return lambda design: (np.concatenate([one(design, k) for k in range(len(design.loads))]),)


def _lift(derivative: int) -> Callable[[Evaluated], tuple[Array, ...]]:
    # every node for itself: a flank that is held at its bound is level, and all of a level stretch counts
    return lambda design: (1e3 * np.abs(design.lift[derivative, : 2 * PER_FLANK]),)


def _single(one: Callable[[Evaluated], float]) -> Callable[[Evaluated], tuple[Array, ...]]:
    return lambda design: (np.array([one(design)]),)


def _ripple(design: Evaluated) -> tuple[Array, ...]:
    return tuple(part for total in design.shaft_torques for part in (design.peaks(total), -design.peaks(-total)))


def _pressure_angle_rise(design: Evaluated) -> tuple[Array, ...]:
    rise = np.arctan(np.abs(design.path[1])) / DEGREE
    rise[PER_FLANK : 2 * PER_FLANK] = 0.0
    return (design.shape_peaks(rise),)


def _convex_radius(design: Evaluated) -> tuple[Array, ...]:
    # the dwells count too: the base circle is convex
    curvature = design.peaks(np.maximum(design.path[5], FLAT))
    return (1e3 * (1.0 / curvature - design.pump.roller_radius),)


def _hollow_radius(design: Evaluated) -> tuple[Array, ...]:
    curvature = design.shape_peaks(np.maximum(-design.path[5], FLAT))
    return (1e3 * (1.0 / curvature + design.pump.roller_radius),)


def _jump_speed(design: Evaluated) -> tuple[Array, ...]:
    at_rest, per_square = design.dry
    slowest = 1.0 / np.maximum(-per_square / np.maximum(at_rest, 1e-9), (FASTEST * RPM) ** -2)
    return (-design.peaks(-np.sqrt(slowest)) / RPM,)


def _delivery(design: Evaluated) -> float:
    return 1e9 * design.pump.plunger_area * max(load.delivered(design.lobe.lift) for load in design.loads)


def _cam_radius(design: Evaluated) -> float:
    # on the upper dwell the roller's centre, the contact and the axis are in line
    c = design.constants
    return 1e3 * (float(np.hypot(c.offset, c.base + design.lobe.lift)) - c.radius)


def _delivery_rate(design: Evaluated, k: int) -> Array:
    corners, share = design.loads[k].share
    rate = design.pump.plunger_area * design.lift[1] * np.interp(design.lift[0], corners, share)
    return design.peaks(1e9 * DEGREE * np.maximum(rate, 0.0))


def _delivery_angle(design: Evaluated) -> float:
    ends = np.array([load.half for load in design.loads])
    angles, _ = design.lobe.crossings(ends.ravel())
    return float(np.max(np.diff(angles.reshape(ends.shape), axis=1))) / DEGREE


RESPONSES: dict[str, Response] = {
    "peak_torque_nm": Response("max", _over_loads(lambda d, k: d.peaks(d.shaft_torques[k]))),
    "torque_ripple_nm": Response("range", _ripple),
    "hertz_gpa": Response("max", _over_loads(lambda d, k: d.peaks(1e-9 * d.solved[k].hertz))),
    "side_force_n": Response("max", _over_loads(lambda d, k: d.peaks(np.abs(d.solved[k].outputs["guide"])))),
    "contact_force_n": Response("min", _over_loads(lambda d, k: -d.peaks(-d.solved[k].outputs["contact_normal"]))),
    "friction_work_j": Response(
        "max", _over_loads(lambda d, k: np.array([d.phases.size * d.over_a_turn(d.friction_torques[k])]))
    ),
    "pressure_angle_deg": Response("max", lambda d: (d.peaks(np.arctan(np.abs(d.path[1]))) / DEGREE,)),
    "pressure_angle_rise_deg": Response("max", _pressure_angle_rise),
    "velocity_mm_per_rad": Response("max", _lift(1)),
    "acceleration_mm_per_rad2": Response("max", _lift(2)),
    "jerk_mm_per_rad3": Response("max", _lift(3)),
    "convex_radius_mm": Response("min", _convex_radius, MOST),
    "hollow_radius_mm": Response("min", _hollow_radius, MOST),
    "jump_speed_rpm": Response("min", _jump_speed, MOST),
    "delivery_mm3": Response("single", _single(_delivery), MOST),
    "delivery_rate_mm3_per_deg": Response("max", _over_loads(_delivery_rate)),
    "delivery_angle_deg": Response("single", _single(_delivery_angle)),
    "cam_radius_mm": Response("single", _single(_cam_radius)),
    "spring_force_n": Response(
        "single", _single(lambda d: d.pump.spring_preload + d.pump.spring_stiffness * d.lobe.lift)
    ),
    "lobe_angle_deg": Response("single", _single(lambda d: sum(d.lobe.angles) / DEGREE)),
}
"""Name, which carries the unit -> response; what each means: docs/design.md."""
