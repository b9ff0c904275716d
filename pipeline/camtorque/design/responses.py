"""One design, evaluated on the nodes of its lobe under every load, and its responses; each may be an aim or a limit.

A new response is one function and one line. One that is a peak over the revolution is given as the greatest value of
each window of it: the optimiser sees all peaks at once, each a smooth function of the design, not only the one that is
highest at the moment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from camtorque.config import PumpData
from camtorque.config.pump import PumpConfig
from camtorque.design.loads import Load
from camtorque.design.profile import SAMPLES, Family, Lobe
from camtorque.design.schema import PUMP_FIELDS, QUANTITIES, phase_name
from camtorque.mechanism.contact import contact_modulus
from camtorque.mechanism.friction import NO_FRICTION, Friction
from camtorque.mechanism.kinematics import path_at
from camtorque.mechanism.predict import mounting_of
from camtorque.mechanism.torque import OUTPUTS, Constants, constants_of, solve_lift
from camtorque.records import Array, Integers, ReadOnly
from camtorque.units import DEGREE, RPM, TURN, closed

PER_FLANK = SAMPLES + 1


@dataclass(frozen=True)
class Solved(ReadOnly):
    """One load on the nodes: pressure (n,) [Pa], outputs name -> (n,) of the first pump, hertz (n,) [Pa]."""

    load: Load
    pressure: Array
    outputs: Mapping[str, Array]
    hertz: Array


@dataclass(frozen=True)
class Design(ReadOnly):
    """One design: the value of every quantity in the unit of its name, and the coefficients of its flanks."""

    family: Family
    values: Mapping[str, float]
    rise: Array
    fall: Array

    def si(self, name: str) -> float:
        """Return a quantity in SI."""
        return self.values[name] * QUANTITIES[name].factor


class Evaluated:
    """A design under the loads of its task; everything is computed when it is first asked for."""

    def __init__(self, design: Design, config: PumpConfig, loads: tuple[Load, ...]) -> None:
        self.design, self.config, self.loads = design, config, loads
        changes: dict[str, Any] = {field: design.si(name) for name, field in PUMP_FIELDS.items()}
        self.pump: PumpData = replace(config.pump, **changes)
        angles = tuple(design.si(name) for name in ("rise_deg", "top_dwell_deg", "return_deg"))
        self.lobe = Lobe(design.family, design.si("lift_mm"), angles, design.rise, design.fall)  # type: ignore[arg-type]

    def with_lift(self, lift: Array) -> Evaluated:
        """Return the same design with another lift at the same angles, lift and three derivatives (4, n)."""
        moved = Evaluated(self.design, self.config, self.loads)
        moved._nodes = (self.theta, lift)
        return moved

    @cached_property
    def constants(self) -> Constants:
        """The pump as the closed form reads it."""
        return constants_of(self.pump, mounting_of(self.config), Friction(*self.config.friction))

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Angles (n,), and lift with three derivatives (4, n)."""
        rise, dwell, fall = self.lobe.angles
        up, down = self.lobe.flanks
        still = np.zeros((4, 4))
        still[0, :2] = self.lobe.lift
        angles, events = self.lobe.crossings(np.unique(np.concatenate([load.events for load in self.loads])))
        # both ends of a dwell: where the acceleration jumps the flank beside it has another load
        ends = np.nextafter([rise + dwell, TURN], 0.0)
        theta = [self.lobe.theta, np.array([rise, ends[0], rise + dwell + fall, ends[1]]), angles]
        return np.concatenate(theta), np.concatenate([up, down, still, events], axis=1)

    @property
    def theta(self) -> Array:
        """Cam angle of the nodes: rise, return, ends of upper dwell and base circle, events [rad]."""
        return self._nodes[0]

    @property
    def lift(self) -> Array:
        """Lift and three derivatives at the nodes, (4, n) [m/rad^k]."""
        return self._nodes[1]

    @cached_property
    def path(self) -> Array:
        """Distance s, tan phi, 1 / cos phi, q, q' and curvature of the pitch curve at the nodes, (6, n)."""
        c = self.constants
        return np.stack(path_at(*self.lift[:3], c.base, c.offset, c.radius))

    @cached_property
    def solved(self) -> tuple[Solved, ...]:
        """Torque, forces and stress under every load."""
        return tuple(self._solve(load) for load in self.loads)

    def _solve(self, load: Load) -> Solved:
        pressure = self.pressure(load)
        outputs = dict(zip(OUTPUTS, self.outputs(pressure, load.speed, self.constants), strict=True))
        relative = np.maximum(1.0 - self.pump.roller_radius * self.path[5], 1e-6)
        scale = contact_modulus(self.pump) / (np.pi * self.pump.roller_width * self.pump.roller_radius)
        hertz = np.sqrt(scale * np.maximum(outputs["contact_normal"], 0.0) / relative)
        return Solved(load, pressure, outputs, hertz)

    def pressure(self, load: Load) -> Array:
        """Return the pressure on the plunger at the nodes [Pa]."""
        lift = self.lift[0]
        pressure = load.on_rise(lift)
        pressure[PER_FLANK : 2 * PER_FLANK] = load.on_return(lift[PER_FLANK : 2 * PER_FLANK])
        pressure[2 * PER_FLANK + 2 : 2 * PER_FLANK + 4] = load.on_return(np.zeros(1))[0]
        return pressure

    def outputs(self, pressure: Array, speed: float, constants: Constants) -> Array:
        """Return all outputs of the closed form at the nodes, (11, n)."""
        return solve_lift(constants, self.lift[:3], pressure, np.full(pressure.size, speed), np.zeros(pressure.size))

    @cached_property
    def dry(self) -> tuple[Array, Array]:
        """Contact force without pressure at standstill [N], and per square of the speed [N s^2/rad^2]."""
        nothing = np.zeros(self.theta.size)
        at_rest = self.outputs(nothing, 0.0, self.constants)[1]
        return at_rest, self.outputs(nothing, 1.0, self.constants)[1] - at_rest

    @property
    def phases(self) -> Array:
        """Lag of each pump on the shaft [rad]."""
        return np.array([self.design.values[phase_name(k + 1)] * DEGREE for k in range(len(self.config.phases))])

    @cached_property
    def order(self) -> Integers:
        """Indices that sort the nodes by angle."""
        return np.argsort(self.theta, kind="stable")

    @cached_property
    def shaft_torques(self) -> tuple[Array, ...]:
        """Per load, torque of all pumps at the drive end at the nodes of each pump, (pumps, n) [N m]."""
        return tuple(self.shaft_torque(solved.outputs["torque"]) for solved in self.solved)

    def shaft_torque(self, torque: Array) -> Array:
        """Return the sum over the pumps of a torque over cam angle, at the nodes of each pump, (pumps, n)."""
        if self.phases.size == 1:
            return torque[None]
        angle, sorted_torque = closed(self.theta[self.order], torque[self.order])
        lag = self.phases[:, None] - self.phases[None, :]
        local = np.mod(self.theta + lag[:, :, None] - angle[0], TURN) + angle[0]
        return np.sum(np.interp(local, angle, sorted_torque), axis=1)

    def over_a_turn(self, values: Array) -> float:
        """Return the integral of values at the nodes over one revolution."""
        angle, sorted_values = closed(self.theta[self.order], values[self.order])
        return float(np.trapezoid(sorted_values, angle))

    @cached_property
    def friction_torques(self) -> tuple[Array, ...]:
        """Per load, the torque of friction at the nodes [N m]."""
        smooth = constants_of(self.pump, mounting_of(self.config), NO_FRICTION)
        return tuple(s.outputs["torque"] - self.outputs(s.pressure, s.load.speed, smooth)[0] for s in self.solved)

    def peaks(self, values: Array) -> Array:
        """Return the greatest value of each window of the nodes, (k,) from (..., n); a single node is a window."""
        return np.concatenate([self.shape_peaks(values), values[..., 2 * PER_FLANK :].ravel()])

    def shape_peaks(self, values: Array) -> Array:
        """Return the same of the flanks alone, for what has no corners where the load has them."""
        flanks = values[..., : 2 * PER_FLANK].reshape(*values.shape[:-1], 2, PER_FLANK)
        return np.maximum.reduceat(flanks, self.design.family.windows, axis=-1).ravel()


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
