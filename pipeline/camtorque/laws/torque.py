"""Torque on the cam from motion and chamber pressure, with all friction and damping, and its exact derivatives.

The closed form of the mechanism for one pump (contact force along the follower, its lever, the roller's spin)::

    F_axial  = F_s0 + k y + A p + m (y'' w^2 + y' w')
    lambda_y = F_axial / (1 - mu_g |tan phi| sign(y'))                 guide friction feeds back on the contact
    tau      = y' (F_axial + F_extra) / (1 - mu_g |tan phi| sign(y')) + lambda_y (L/s) (a_b + a_p (L/r_r - 1))
               + I_r q (q w' + q' w^2) + T_drag + c_s w,               q = 1 - L/r_r

F_extra are forces along the plunger: spring errors, viscous and packing friction. The torque is linear in all
coefficients but mu_g; `LINEAR_NAMES` are their columns.
"""

from __future__ import annotations

import numpy as np
from numba import njit

SMOOTH_SLOPE = 2.0e-5
"""Follower slope over which the sign of the sliding velocity turns smoothly [m/rad]."""
SMOOTH_TANGENT = 1.0e-6
"""Tangent of the pressure angle below which its absolute value is rounded."""
LINEAR_NAMES = (
    "bearing_arm", "pin_arm", "shaft_drag", "shaft_viscous", "plunger_viscous", "spring_stiffness_error",
    "spring_preload_error", "packing_force", "packing_friction",
)  # fmt: skip
"""Coefficients that scale a column of torque, in the order of the columns."""
DERIVATIVES = ("angle", "rate", "second", "pressure", "guide_friction")
"""What the torque is differentiated by, in the order of its rows."""


@njit(cache=True, error_model="numpy", nogil=True)
def cam_torque(pump, mu, lift, rate, second, pressure, coefficients):  # type: ignore[no-untyped-def]
    """Return torque, columns, derivatives and contact force over the angle.

    Parameters
    ----------
    pump : rise (base circle and roller radius) [m], offset [m], roller radius [m], follower mass [kg], spring rate
        [N/m], preload [N], plunger area [m^2], roller inertia [kg m^2]
    mu : friction coefficient of the guide
    lift : (4, n) y, y', y'', y''' [m/rad^k]
    rate, second : (n,) cam speed and acceleration [rad/s, rad/s^2]
    pressure : (n,) on the plunger [Pa]
    coefficients : (9,) of `LINEAR_NAMES`, used in the derivatives alone

    Returns
    -------
    torque : (n,) without the linear coefficients [N m]
    columns : (n, 9) per coefficient
    by : (5, n) derivatives of the torque with its coefficients, order of `DERIVATIVES`
    load : (n,) contact force along the follower [N]; the least denominator of it tells whether the guide jams
    least : least value of 1 - mu |tan phi| sign(y')
    """
    rise, offset, radius, mass, stiffness, preload, area, inertia = pump
    a_bearing, a_pin, _drag, c_shaft, c_plunger, e_stiff, e_load, f_pack, s_pack = coefficients
    base = np.sqrt(rise * rise - offset * offset)
    n = rate.size
    torque = np.empty(n)
    columns = np.empty((n, 9))
    by = np.empty((5, n))
    load = np.empty(n)
    least = 1.0
    for i in range(n):
        y, y1, y2, y3 = lift[0, i], lift[1, i], lift[2, i], lift[3, i]
        w, dw, p = rate[i], second[i], pressure[i]
        height = base + y
        tangent = (y1 - offset) / height
        tangent_a = y2 / height - (y1 - offset) * y1 / (height * height)
        steep = np.sqrt(tangent * tangent + SMOOTH_TANGENT * SMOOTH_TANGENT)
        steep_a = tangent * tangent_a / steep
        rounded = np.sqrt(y1 * y1 + SMOOTH_SLOPE * SMOOTH_SLOPE)
        sign = y1 / rounded
        sign_a = y2 * SMOOTH_SLOPE * SMOOTH_SLOPE / (rounded * rounded * rounded)
        guide = 1.0 - mu * steep * sign
        guide_a = -mu * (steep_a * sign + steep * sign_a)
        if guide < least:
            least = guide
        if guide < 0.05:
            guide, guide_a = 0.05, 0.0
        axial = preload + stiffness * y + area * p + mass * (y2 * w * w + y1 * dw)
        axial_a = stiffness * y1 + mass * (y3 * w * w + y2 * dw)
        reach = np.sqrt(height * height + (y1 - offset) * (y1 - offset))
        reach_a = (height * y1 + (y1 - offset) * y2) / reach
        reach_aa_top = y1 * y1 + height * y2 + y2 * y2 + (y1 - offset) * y3
        reach_aa = (reach_aa_top - reach_a * reach_a) / reach
        lever = reach / height
        lever_a = reach_a / height - reach * y1 / (height * height)
        spin = 1.0 - reach / radius
        spin_a = -reach_a / radius
        spin_aa = -reach_aa / radius
        roller = inertia * spin * (spin * dw + spin_a * w * w)
        normal = axial / guide
        load[i] = normal
        torque[i] = normal * y1 + roller
        slope = y1 / guide
        columns[i, 0] = normal * lever
        columns[i, 1] = -normal * lever * spin
        columns[i, 2] = 1.0
        columns[i, 3] = w
        columns[i, 4] = slope * y1 * w
        columns[i, 5] = slope * stiffness * y
        columns[i, 6] = slope * preload
        columns[i, 7] = slope * sign
        columns[i, 8] = slope * sign * area * p
        arm = lever * (a_bearing - a_pin * spin)
        arm_a = lever_a * (a_bearing - a_pin * spin) - lever * a_pin * spin_a
        packing = f_pack + s_pack * area * p
        extra = c_plunger * y1 * w + e_stiff * stiffness * y + e_load * preload + sign * packing
        extra_a = c_plunger * y2 * w + e_stiff * stiffness * y1 + sign_a * packing
        force = axial + extra
        top = y1 * force + axial * arm
        top_a = y2 * force + y1 * (axial_a + extra_a) + axial_a * arm + axial * arm_a
        by[0, i] = top_a / guide - top * guide_a / (guide * guide)
        by[0, i] += inertia * (spin_a * (spin * dw + spin_a * w * w) + spin * (spin_a * dw + spin_aa * w * w))
        axial_w = 2.0 * mass * y2 * w
        by[1, i] = (y1 * (axial_w + c_plunger * y1) + axial_w * arm) / guide + c_shaft
        by[1, i] += inertia * spin * spin_a * 2.0 * w
        by[2, i] = mass * y1 * (y1 + arm) / guide + inertia * spin * spin
        by[3, i] = area * (y1 * (1.0 + sign * s_pack) + arm) / guide
        by[4, i] = top * steep * sign / (guide * guide)
    return torque, columns, by, load, least
