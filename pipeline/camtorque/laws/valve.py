"""Outlet and delivery valve: chamber -> outlet -> gallery -> valve with retraction volume and mass -> line.

::

    Q_out  = a A_out C sqrt(p - g)       a: outlet open until its land closes (end of delivery), and again below a
                                            share of that lift on the return
    d[(V_g + max(0, u)) rho(g)]/dt = Q_out - Q_seat
    h      = max(0, u - u_0 - V_r)
    Q_seat = alpha h C sqrt(g - p_in)
    p_in   = p_line + I d(u' + Q_seat)/dt
    M (u'' + r u') = g + (1 - sigma)(p - g) - p_in - p_open - S (u - V_r) - w (alpha / A_out) h + stops

u is the volume that the valve has swept from its seat, which is touched below u_0; V_r what it sweeps from there until
its collar clears the seat (retraction volume), M its mass over the square of its area, S its spring rate over the same.
sigma is the share of the pressure difference over the outlet that the valve does not feel, w the flow force where seat
and outlet area are equal. I is the inertance rho L / A of the oil up to the sensor, short against the waves.
Without mass and with a small V_r this is the usual massless valve.
"""

from __future__ import annotations

import numpy as np

from camtorque.compiled import njit
from camtorque.laws.ports import flow_root
from camtorque.laws.rows import parameter
from camtorque.units import DEGREE

STOP = 400.0
"""Stiffness of seat and stop [bar/mm^3]."""
STOP_LOSS = 0.05
"""Increase of their force per speed of approach [ms/mm^3]."""
CUSHION, STOP_CUSHION = 0.5, 3.0
"""Volume before and behind seat and stop over which their stiffness sets in [mm^3], 10 and 100 micrometres of lift."""
SEATED = 1.0
"""Volume to either side of the seat over which it is rounded what room the valve makes [mm^3]."""
RETURN_SPAN = 0.3
"""Lift over which the outlet opens again on the return [mm]."""
LIFTED = 0.3
"""Volume to either side over which the seat's opening is rounded [mm^3]."""
SEAT_FLOW = 2
"""Column of the chamber's flows that is the one past the delivery valve's seat."""
SEAT_ITERATIONS, SEAT_SETTLED = 30, 1.0e-12
"""Steps to the drop over the seat at most, and their last change over one bar and the total."""

ROWS = (
    parameter("valve_opening", "p_open", "bar", 1.0e5, (20.0, 1.0, 150.0, 3.0), (25.0, 20.0),
            "pressure difference at which the delivery valve lets fuel through",
            "catalogues of delivery valves: 5-50 bar"),
    parameter("valve_area", "A_out", "mm^2", 1.0e-6, (2.0, 0.3, 60.0, 0.2), (3.0, 6.0),
            "flow area between chamber and delivery valve (Cd = 0.7)", "bores of 1-4 mm"),
    parameter("valve_range", "w", "bar", 1.0e5, (5.0, 0.0, 150.0, 3.0), (5.0, 15.0),
            "flow force on the valve where seat and outlet area are equal", "spring and flow forces of such valves"),
    parameter("retraction_volume", "V_r", "mm^3", 1.0e-9, (12.0, 0.0, 150.0, 3.0), (15.0, 20.0),
            "volume that the delivery valve sweeps before its collar clears the seat", "0-60 mm^3 in catalogues"),
    parameter("gallery_volume", "V_g", "mm^3", 1.0e-9, (100.0, 5.0, 1500.0, 20.0), (100.0, 120.0),
            "volume between outlet and delivery valve", "bores and spring chamber, 20-400 mm^3"),
    parameter("valve_mass", "M", "10^6 kg/m^4", 1.0e6, (6.0, 0.3, 60.0, 2.0), (6.0, 5.0),
            "mass of the delivery valve over the square of its area", "3-10 g on 20-50 mm^2"),
    parameter("valve_damping", "r", "1/ms", 1.0e3, (2.0, 0.5, 40.0, 1.0), (6.0, 12.0),
            "damping of the delivery valve over its mass", "assumed; a fifth of critical to ten times critical"),
    parameter("seat_gain", "alpha", "1/mm", 1.0e3, (0.5, 0.03, 3.0, 0.1), (0.5, 0.3),
            "flow area of the valve's seat per swept volume (Cd = 0.7)", "circumference over area of the valve"),
    parameter("valve_exposure", "sigma", "-", 1.0, (0.9, 0.0, 2.0, 0.1), (0.9, 0.4),
            "share of the outlet's pressure drop that the valve does not feel", "shape of the valve's face"),
    parameter("valve_stroke", "u_max", "mm^3", 1.0e-9, (30.0, 3.0, 300.0, 3.0), (30.0, 20.0),
            "volume that the delivery valve sweeps from V_r to its stop", "0.4-1.6 mm on 20-50 mm^2"),
    parameter("valve_spring", "S", "bar/mm^3", 1.0e14, (0.1, 0.0, 2.0, 0.05), (0.1, 0.2),
            "spring rate of the delivery valve over the square of its area", "5-20 N/mm on 15-50 mm^2"),
    parameter("line_inertance", "I", "10^6 kg/m^4", 1.0e6, (0.0, 0.0, 100.0, 2.0), (0.0, 10.0),
            "inertance of the oil between the delivery valve and the pressure sensor", "0-40 mm of 2 mm bore"),
)  # fmt: skip
END_ROWS = (
    parameter("end_of_delivery", "theta_end", "deg", DEGREE, (45.0, 3.0, 178.0, 0.3), None,
            "cam angle at which the outlet has closed", "depends on the load; fitted", "own"),
    parameter("end_width", "w_end", "deg", DEGREE, (2.0, 0.4, 20.0, 0.3), (2.5, 2.5),
            "cam angle that the outlet takes to close", "assumed; closing times of 0.1-1 ms", "own"),
    parameter("outlet_return", "c_end", "-", 1.0, (0.0, 0.0, 1.0, 0.1), (0.0, 0.6),
            "lift at which the outlet opens again on the return, over that at which it closed",
            "1: edge of the plunger; 0: on the base circle"),
)  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def lifted(u, retraction):  # type: ignore[no-untyped-def]
    """Return max(0, u - u_0 - V_r) with a rounded corner, and its derivative by u; the seat is touched below u_0.

    A valve that rests is shut: through a corner with tails, a line of 250 bar ran back over half of a stroke.
    """
    x = (u - CUSHION - retraction) / LIFTED
    if x <= -1.0:
        return 0.0, 0.0
    if x >= 1.0:
        return x * LIFTED, 1.0
    share = 0.5 * (x + 1.0)
    return share * share * LIFTED, share


@njit(cache=True, error_model="numpy", inline="always")
def swept(u):  # type: ignore[no-untyped-def]
    """Return max(0, u) with a rounded corner, and its derivative by u.

    A seat that is pressed in takes no room: its stiffness is that of a search. Under a rail of 1850 bar it was as soft
    as a chamber of 150 mm^3, and the fuel became stiffer by as much.
    """
    if u >= SEATED:
        return u, 1.0
    share = max(0.5 * (u + SEATED) / SEATED, 0.0)
    return share * share * SEATED, share


@njit(cache=True, error_model="numpy")
def seat_drop(total, share):  # type: ignore[no-untyped-def]
    """Return the pressure drop over the seat [bar] where its flow takes a share of the total to be accelerated.

    It is ``x + share root(x) = total``: from the root without its rounded corner, a few steps.

    Parameters
    ----------
    total : drop over seat and oil where nothing flowed through the seat [bar]
    share : pressure that the oil takes, over the root of the drop over the seat [bar^(1/2)]
    """
    size = abs(total)
    root = 2.0 * size / (share + np.sqrt(share * share + 4.0 * size)) if size > 0.0 else 0.0
    drop = root * root if total > 0.0 else -root * root
    for _ in range(SEAT_ITERATIONS):
        value, slope = flow_root(drop)
        change = (total - drop - share * value) / (1.0 + share * slope)
        drop += change
        if abs(change) < SEAT_SETTLED * (1.0 + size):
            break
    return drop


@njit(cache=True, error_model="numpy", inline="always")
def stop_force(u, velocity, time_step, top):  # type: ignore[no-untyped-def]
    """Return the force of seat and stop on the valve [bar] and its derivatives by u, by the start of the step, by top.

    Stiffness times penetration, more on the way in than on the way out (Hunt and Crossley), so that nothing jumps. The
    stiffness sets in over a cushion: a valve that just grazes a hard stop answers any change with an infinite slope,
    and descents end there.

    Parameters
    ----------
    u, velocity : volume that the valve has swept and its rate [mm^3, mm^3/ms]
    time_step : that the velocity is a difference over [ms]
    top : volume at the stop [mm^3]
    """
    if u < CUSHION:
        depth, cushion, sign = -u, CUSHION, -1.0
    elif u > top - STOP_CUSHION:
        depth, cushion, sign = u - top, STOP_CUSHION, 1.0
    else:
        return 0.0, 0.0, 0.0, 0.0
    share = 1.0
    if depth < cushion:
        share = 0.5 * (depth + cushion) / cushion
        depth = share * share * cushion
    factor = 1.0 + sign * STOP_LOSS * velocity
    by_velocity = STOP * depth * STOP_LOSS
    if factor < 0.2:
        factor, by_velocity = 0.2, 0.0
    stiffness = STOP * factor * share
    by_top = -stiffness if sign > 0.0 else 0.0
    return sign * STOP * depth * factor, stiffness + by_velocity / time_step, -by_velocity / time_step, by_top
