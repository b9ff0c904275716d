"""Compiled mechanics: cam, roller, follower with friction, and the driveline.

The contact forces and the cam acceleration are solved together at each stage.

State: 0 drive angle, 1 drive speed, 2 coupling angle, 3 its speed, 4 cam angle, 5 cam speed, 6 integral of the speed
error, 7 pre-sliding state of the guide (-1..1).
"""

from __future__ import annotations

import numpy as np

from rigs.jit import compiled
from rigs.laws import TWO_PI, lift_law

N_MECHANIC = 8
# entries of the force vector
TORQUE, ACCELERATION, NORMAL, TANGENTIAL, GUIDE, LOAD, ALONG = 0, 1, 2, 3, 4, 5, 6
BEARING_LOSS, PIN_LOSS, GUIDE_LOSS, SEAL_LOSS, PLUNGER_LOSS, SHAFT_LOSS = 7, 8, 9, 10, 11, 12
SPRING_POWER, DRIVE_TORQUE = 13, 14
N_FORCE = 15


@compiled
def smooth_sign(value, width):
    """Coulomb sign, smooth over ``width``."""
    return value / np.sqrt(value * value + width * width)


@compiled
def solve_contact(k, angle, w, pressure, guide_state, shaft_torque, given_acceleration, known, f):
    """Fill the force vector: cam acceleration from the shaft torque, or (``known``) shaft torque from the acceleration.

    Vertical, horizontal and moment balance of follower and roller, moment balance of the camshaft. The magnitudes of
    guide reaction and contact load that friction needs are iterated to rounding, from their last values.
    """
    y, y1, y2 = lift_law(k, angle % TWO_PI)
    s = k.centre_distance + y
    lever = y1 - k.offset
    distance = np.sqrt(s * s + lever * lever)
    sin_phi, cos_phi = lever / distance, s / distance
    velocity = y1 * w
    r = k.roller_radius
    gear = 1.0 - distance / r
    gear_slope = -(s * y1 + lever * y2) / (distance * r)
    pin_sign = smooth_sign(w * gear, 0.1)
    moving = smooth_sign(velocity, k.smoothing_speed)
    guide_sign = guide_state if k.guide_presliding > 0.0 else moving
    mu = k.bearing_mu + (k.bearing_mu_static - k.bearing_mu) * np.exp(-((w / k.stribeck_speed) ** 2))
    shaft_sign = smooth_sign(w, 0.05)
    losses = k.drag_torque * shaft_sign + k.shaft_viscous * w + k.churning * w * abs(w)
    passive = (
        k.spring_preload
        + k.spring_stiffness * y
        + k.plunger_area * pressure
        + k.seal_force * moving
        + k.plunger_viscous * velocity
    )
    arm_n = y1 * cos_phi
    arm_t = r - distance + y1 * sin_phi
    # tangential = t0 + t1 a, normal = n0 + n1 a, torque = q0 + q1 a for frozen friction magnitudes
    t1 = k.roller_inertia * gear / r
    n1 = (k.follower_mass * y1 - t1 * sin_phi) / cos_phi
    q1 = k.shaft_inertia + n1 * arm_n + t1 * arm_t
    load, guide = f[LOAD], f[GUIDE]
    a = given_acceleration
    for _ in range(30):
        t0 = (k.roller_inertia * w * w * gear_slope + k.pin_mu * k.pin_radius * load * pin_sign) / r
        rub = k.guide_mu * k.guide_lever * guide * guide_sign
        n0 = (k.follower_mass * y2 * w * w + passive + rub - t0 * sin_phi) / cos_phi
        q0 = n0 * arm_n + t0 * arm_t + mu * k.bearing_radius * load * shaft_sign + losses
        if not known:
            a = (shaft_torque - q0) / q1
        normal, tangential = n0 + n1 * a, t0 + t1 * a
        new_load = np.sqrt(normal * normal + tangential * tangential)
        new_guide = abs(normal * sin_phi - tangential * cos_phi)
        change = abs(new_load - load) + abs(new_guide - guide)
        load, guide = new_load, new_guide
        if change < 1e-7 * (1.0 + load):
            break
    f[TORQUE] = q0 + q1 * a if known else shaft_torque
    f[ACCELERATION] = a
    f[NORMAL], f[TANGENTIAL], f[GUIDE], f[LOAD] = normal, tangential, guide, load
    f[ALONG] = normal * cos_phi + tangential * sin_phi
    f[BEARING_LOSS] = mu * k.bearing_radius * load * shaft_sign * w
    f[PIN_LOSS] = k.pin_mu * k.pin_radius * load * pin_sign * w * gear
    f[GUIDE_LOSS] = k.guide_mu * k.guide_lever * guide * guide_sign * velocity
    f[SEAL_LOSS] = k.seal_force * moving * velocity
    f[PLUNGER_LOSS] = k.plunger_viscous * velocity * velocity
    f[SHAFT_LOSS] = losses * w
    f[SPRING_POWER] = (k.spring_preload + k.spring_stiffness * y) * velocity
    return velocity, q0, q1


@compiled
def mechanic_rates(k, x, out, f, pressure, set_speed, set_acceleration, feed_forward):
    """Write dx/dt of the mechanical state and fill the force vector."""
    w_set = set_speed
    drive = feed_forward + k.control_p * (w_set - x[1]) + k.control_i * x[6]
    drive += k.drive_ripple * np.sin(k.drive_ripple_order * x[0])
    if k.rigid_shaft:
        if k.prescribed:
            velocity, _, _ = solve_contact(k, x[4], x[5], pressure, x[7], 0.0, set_acceleration, True, f)
        else:
            # one rigid shaft: (J + q1) a = drive - q0, solved by two secant steps of an affine relation
            velocity, q0, q1 = solve_contact(k, x[4], x[5], pressure, x[7], 0.0, f[ACCELERATION], True, f)
            for _ in range(20):
                a = (drive - q0) / (k.drive_inertia + q1)
                if abs(a - f[ACCELERATION]) < 1e-9 * (1.0 + abs(a)):
                    break
                velocity, q0, q1 = solve_contact(k, x[4], x[5], pressure, x[7], 0.0, a, True, f)
        a = f[ACCELERATION]
        out[0], out[1], out[2], out[3], out[4], out[5] = x[5], a, x[5], a, x[5], a
    else:
        near, near_speed = (x[2], x[3]) if k.yielding else (x[0], x[1])
        torque = k.shaft_stiffness * (near - x[4]) + k.shaft_damping * (near_speed - x[5])
        velocity, _, _ = solve_contact(k, x[4], x[5], pressure, x[7], torque, 0.0, False, f)
        behind = torque
        if k.yielding:
            behind = k.coupling_stiffness * (x[0] - x[2]) + k.coupling_damping * (x[1] - x[3])
            out[2], out[3] = x[3], (behind - torque) / k.coupling_inertia
        out[0] = x[1]
        out[1] = set_acceleration if k.prescribed else (drive - behind) / k.drive_inertia
        if not k.yielding:
            out[2], out[3] = out[0], out[1]
        out[4], out[5] = x[5], f[ACCELERATION]
    f[DRIVE_TORQUE] = drive
    out[6] = w_set - x[1]
    out[7] = 0.0
    if k.guide_presliding > 0.0:
        out[7] = (velocity - abs(velocity) * x[7]) / k.guide_presliding
