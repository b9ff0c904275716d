"""Pumps, laws and motions for the tests of the mechanism, and a Newton-Euler solution written from scratch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from camtorque.mechanism.friction import Friction
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.sections import dwell, flank, section_law
from camtorque.studies.case import study_pump

DEGREE = np.pi / 180.0
STEP = 1e-30


def paper_pump(**changes):
    """The pump of the studies with its follower on the axis."""
    return replace(study_pump(), **{"follower_offset": 0.0, **changes})


def analytic_law(kind="polynomial_4567"):
    rise, fall = flank(kind, 60.0 * DEGREE, 8e-3), flank(kind, 55.0 * DEGREE, -8e-3)
    return section_law([rise, dwell(20.0 * DEGREE), fall, dwell(225.0 * DEGREE)])


@dataclass(frozen=True)
class Motion:
    theta: np.ndarray
    pressure: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray


def motion(varying, size=97, seed=3):
    """Angles out of order and beyond a revolution; speed = 52 + 6 sin(2 theta) where it varies."""
    random = np.random.default_rng(seed)
    theta = random.uniform(-4.0, 9.0, size)
    pressure = 6e7 * random.random(size)
    speed = 52.0 + (6.0 * np.sin(2.0 * theta) if varying else 0.0 * theta)
    acceleration = speed * 12.0 * np.cos(2.0 * theta) if varying else np.zeros(size)
    return Motion(theta, pressure, speed, acceleration)


CASES = {
    "on axis, constant speed": (0.0, 1, False),
    "on axis, varying speed": (0.0, 1, True),
    "offset, constant speed": (5e-3, 1, False),
    "offset, varying speed": (5e-3, 1, True),
    "negative offset, turning backwards": (-4e-3, -1, True),
}


def case(name):
    offset, rotation, varying = CASES[name]
    mounting = Mounting(rotation=rotation, gravity=(2.0, -9.81), spring_mass=0.03, guide_height=0.05)
    return paper_pump(follower_offset=offset), mounting, motion(varying)


def lift_series(law, theta):
    """Lift, velocity, acceleration as functions of a complex shift from a real angle (each piece is a polynomial)."""
    angle = law.knots[0] + np.mod(theta - law.knots[0], 2.0 * np.pi)
    piece = min(np.searchsorted(law.knots, angle, side="right") - 1, law.knots.size - 2)
    local, polynomial = angle - law.knots[piece], law.coefficients[:, piece]
    return [lambda shift, k=k: np.polyval(np.polyder(polynomial, k), local + shift) for k in range(3)]


def kinetic_energy_per_speed(pump, law, mounting, theta, roller_ratio):
    """Inertia J(theta) with T = J omega^2 / 2, as a function of a complex shift."""
    velocity = lift_series(law, theta)[1]
    mass = pump.follower_mass + mounting.spring_mass / 3.0
    return lambda shift: pump.cam_inertia + mass * velocity(shift) ** 2 + pump.roller_inertia * roller_ratio(shift) ** 2


def contact_geometry(pump, law, mounting, theta):
    """Roller centre, outward normal and speed ratio of the roller as functions of a complex shift.

    The pitch curve in the cam's frame is R(-theta) (e, s); its tangent turned back into space is (0, y') - z x (e, s).
    The roller turns so that its surface point at Q moves as the cam's does.
    """
    offset = mounting.rotation * pump.follower_offset
    base = np.sqrt((pump.base_circle_radius + pump.roller_radius) ** 2 - offset**2)
    lift, velocity, _ = lift_series(law, theta)

    def centre(shift):
        return np.array([offset, base + lift(shift)])

    def normal(shift):
        x, y = centre(shift)
        tangent = np.array([0.0, velocity(shift)]) - np.array([-y, x])
        return np.array([-tangent[1], tangent[0]]) / np.sqrt(tangent[0] ** 2 + tangent[1] ** 2)

    def ratio(shift):
        outward = normal(shift)
        along = np.array([outward[1], -outward[0]])
        contact = centre(shift) - pump.roller_radius * outward
        cam_surface = np.array([-contact[1], contact[0]])
        slip = cam_surface - np.array([0.0, velocity(shift)])
        return (slip[0] * along[0] + slip[1] * along[1]) / pump.roller_radius

    return centre, normal, ratio


def newton_euler(pump, law, mounting, theta, pressure, speed, acceleration, friction=None):
    """Return all outputs at one angle from the nine free-body equations of cam, roller and follower, solved at once.

    Nothing is shared with the package but the polynomial of the lift. Friction opposes sliding in guide, bearing and
    pin, in proportion to the contact load: lambda_y |tan phi| on the guide, lambda_y / cos phi on bearing and pin.
    """
    friction = Friction() if friction is None else friction
    turn = mounting.rotation
    gravity_x, gravity_y = turn * mounting.gravity[0], mounting.gravity[1]
    centre, normal, ratio = contact_geometry(pump, law, mounting, theta)
    lift, velocity, change = (f(0.0) for f in lift_series(law, theta))
    n, o2 = normal(0.0), centre(0.0)
    t, q = np.array([n[1], -n[0]]), o2 - pump.roller_radius * n
    spin_change = ratio(0.0) * acceleration + np.imag(ratio(1j * STEP)) / STEP * speed**2
    rise = velocity * acceleration + change * speed**2
    axial = pump.spring_preload + pump.spring_stiffness * lift + pump.plunger_area * pressure
    moving = pump.follower_mass + mounting.spring_mass / 3.0 - pump.roller_mass
    arm = q - o2
    matrix, right = np.zeros((9, 9)), np.zeros(9)
    # unknowns: torque, bearing x y, guide force, guide moment about O2, pin x y, normal, tangential
    matrix[0, [1, 7, 8]], right[0] = [1.0, -n[0], -t[0]], -pump.cam_mass * gravity_x
    matrix[1, [2, 7, 8]], right[1] = [1.0, -n[1], -t[1]], -pump.cam_mass * gravity_y
    matrix[2, [0, 7, 8]], right[2] = [1.0, -_cross(q, n), -_cross(q, t)], pump.cam_inertia * acceleration
    matrix[3, [5, 7, 8]], right[3] = [1.0, n[0], t[0]], -pump.roller_mass * gravity_x
    matrix[4, [6, 7, 8]], right[4] = [1.0, n[1], t[1]], pump.roller_mass * (rise - gravity_y)
    matrix[5, [7, 8]], right[5] = [_cross(arm, n), _cross(arm, t)], pump.roller_inertia * spin_change
    matrix[6, [3, 5]], right[6] = [1.0, -1.0], -moving * gravity_x
    matrix[7, 6], right[7] = -1.0, moving * (rise - gravity_y) + axial
    matrix[8, 4] = 1.0
    load, sine, cosine = np.array([n[1], t[1]]), -n[0], n[1]
    matrix[7, [7, 8]] -= friction.guide * abs(sine / cosine) * np.sign(np.round(velocity, 9)) * load
    matrix[5, [7, 8]] -= friction.pin_arm / cosine * np.sign(ratio(0.0)) * load
    matrix[2, [7, 8]] -= friction.bearing_arm / cosine * load
    torque, bearing_x, bearing_y, guide, moment, pin_x, pin_y, fn, ft = np.linalg.solve(matrix, right)
    lever = o2[1] - mounting.guide_height
    return {
        "torque": torque,
        "contact_normal": fn,
        "contact_tangential": ft,
        "contact_x": turn * (fn * n[0] + ft * t[0]),
        "contact_y": fn * n[1] + ft * t[1],
        "bearing_x": turn * bearing_x,
        "bearing_y": bearing_y,
        "guide": turn * guide,
        "guide_moment": turn * (moment - lever * guide),
        "pin_x": turn * pin_x,
        "pin_y": pin_y,
    }


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def worst(ours, reference):
    """Greatest difference over the greatest reference value."""
    return float(np.max(np.abs(np.asarray(ours) - np.asarray(reference))) / np.max(np.abs(reference)))
