"""Chamber: from line pressure to the pressure on the plunger.

The sensor sits behind the delivery valve, so line pressure is chamber pressure only while the valve delivers. One
balance of mass holds over the whole revolution::

    d(rho V)/dt = -rho_0 (Q_port + Q_spill + Q_out + Q_leak),   V = V_0 + A (y_top - y)

with the fluid of `fluid`, inlet, spill port and suction valve of `ports`, leakage of `leakage`, outlet and delivery
valve of `valve`.
Delivery ends by a land (the outlet closes at an angle, and opens again on the return or on the base circle), by spill
(a port opens above a lift), or is not seen to end.

Implicit Euler steps for the two masses and the valve, finer while the valve moves; exact for a closed volume whatever
the step, and stable in the stiff valve flow. The tangents by all parameters are those of the same steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camtorque.compiled import njit
from camtorque.laws import fluid, leakage, ports, valve
from camtorque.laws.fluid import specific_volume
from camtorque.laws.leakage import leak_flow
from camtorque.laws.ports import flow_root, opening, suction_root
from camtorque.laws.rows import parameter
from camtorque.laws.valve import RETURN_SPAN, STOP, lifted, seat_drop, stop_force, swept
from camtorque.records import Array

ROWS = (
    parameter("dead_volume", "V_0", "mm^3", 1.0e-9, (800.0, 5.0, 40000.0, 100.0), None,
            "volume above the plunger at full lift, holder and bores up to the outlet", "fitted; no sheet gives it"),
    *fluid.ROWS,
    *ports.ROWS,
    *valve.ROWS,
    *valve.END_ROWS,
    *ports.SPILL_ROWS,
    *leakage.ROWS,
    parameter("pressure_zero", "p_0", "bar", 1.0e5, (0.0, -12.0, 12.0, 0.5), (0.0, 1.0),
            "error of the zero of the line pressure", "certificate and standstill readings", "own"),
)  # fmt: skip

KERNEL_UNITS: dict[str, float] = {
    "dead_volume": 1e9, "bulk_modulus": 1e-5, "bulk_modulus_slope": 1.0, "free_air": 1.0, "feed_pressure": 1e-5,
    "port_closing_lift": 1e3, "port_width": 1e3, "port_span": 1e3, "port_roundness": 1.0, "end_of_delivery": 1.0,
    "end_width": 1.0, "spill_lift": 1e3, "spill_width": 1e3, "spill_span": 1e3, "valve_opening": 1e-5,
    "valve_area": 1e6, "valve_range": 1e-5, "retraction_volume": 1e9, "gallery_volume": 1e9, "valve_mass": 1e-8,
    "valve_damping": 1e-3, "seat_gain": 1e-3, "valve_exposure": 1.0, "leakage": 1e11, "leak_growth": 1e5,
    "pressure_zero": 1e-5, "suction_area": 1e6, "valve_stroke": 1e9, "outlet_return": 1.0, "line_inertance": 1e-8,
    "valve_spring": 1e-14,
}  # fmt: skip
"""Parameters of the kernel in its order, and kernel unit (bar, mm, mm^3, ms) per SI unit."""
NAMES = tuple(KERNEL_UNITS)
N = len(NAMES)
(
    DEAD_VOLUME, BULK_MODULUS, BULK_MODULUS_SLOPE, FREE_AIR, FEED_PRESSURE, PORT_CLOSING_LIFT, PORT_WIDTH, PORT_SPAN,
    PORT_ROUNDNESS, END_OF_DELIVERY, END_WIDTH, SPILL_LIFT, SPILL_WIDTH, SPILL_SPAN, VALVE_OPENING, VALVE_AREA,
    VALVE_RANGE, RETRACTION_VOLUME, GALLERY_VOLUME, VALVE_MASS, VALVE_DAMPING, SEAT_GAIN, VALVE_EXPOSURE, LEAKAGE,
    LEAK_GROWTH, PRESSURE_ZERO, SUCTION_AREA, VALVE_STROKE, OUTLET_RETURN, LINE_INERTANCE, VALVE_SPRING,
) = range(N)  # fmt: skip
"""Place of each of `NAMES`, in the same order."""
UNITS = np.array(list(KERNEL_UNITS.values()))
FLOW = float(ports.DISCHARGE * np.sqrt(1.0e5))
"""C_d sqrt(2/rho): mm/ms per square root of bar."""
PRESSURE_SETTLED, VOLUME_SETTLED = 1.0e-3, 1.0e-5
"""Last change of an iteration in pressure [bar] and volume [mm^3]; what is left then goes with its square."""
SHARE_SETTLED = 1.0e-5
"""The same in pressure where that is low, as a share of it but of no less than 1 bar: air and vapour bend there."""
MOST_ITERATIONS = 70
AHEAD_ITERATIONS = 8
"""Iterations from where the last step points to; what has not settled then begins again from the state before."""
NEVER = 99.0
"""End of delivery [rad] or spill lift [m] that is not reached."""
NO_PATH = np.zeros((0, 3))
FILLED = 0.3
"""Pressure [bar] by which the chamber may miss that of the gallery at the end of a revolution and count as filled."""
LOWEST = -1.8
"""Least gauge pressure that an iteration may try [bar], below what any amount of vapour needs."""


@njit(cache=True, error_model="numpy", inline="always")
def moved_pressure(pressure, change):  # type: ignore[no-untyped-def]
    """Return a pressure after an iteration that goes no further than its distance from vapour allows [bar]."""
    above = pressure + 1.4
    down, up = max(0.15, 0.7 * above), max(0.3, 2.0 * above)
    return max(LOWEST, pressure + min(max(change, -down), up))


@njit(cache=True, error_model="numpy", inline="always")
def settled_change(pressure):  # type: ignore[no-untyped-def]
    """Return the change of an iteration below which a pressure has settled [bar]."""
    return min(PRESSURE_SETTLED, SHARE_SETTLED * max(1.0, pressure))


@njit(cache=True, error_model="numpy", nogil=True)
def integrate(parameters, geometry, theta, lift, slope, line, substeps, shifts, start, start_by, known, want_tangents):  # type: ignore[no-untyped-def]
    """Integrate one revolution from a pressure in chamber and gallery, the delivery valve at rest on its seat.

    Parameters
    ----------
    parameters : (N,) in kernel units, order of `NAMES`
    geometry : plunger area [mm^2], full lift [mm], time step of the grid [ms]; lift at the end of delivery [mm] and its
        slope [mm/rad], angle of the full lift, and that from one lobe to the next, 0 where there is one [rad]
    theta, lift, slope, line : (n,) [rad], [mm], [mm/rad], [bar] (zero error not yet taken off)
    substeps : (n,) steps between grid point i - 1 and i
    shifts : (n, n_shift) derivative of the cam angle by the parameters that move it
    start, start_by : pressure before the first angle [bar] and its derivatives (N + n_shift,)
    known : (1 + m, 3) the ``path`` of a pass with the same parameters and start, from which one iteration is left to
        do; (0, 3): none
    want_tangents : False leaves ``tangents`` empty

    Returns
    -------
    pressure : (n,) on the plunger [bar]
    tangents : (n, N + n_shift) its derivatives
    states : (n, 3) gallery pressure [bar], volume swept by the valve [mm^3], iterations
    flows : (n, 4) inlet port, spill, seat, leak [mm^3/ms]
    path : (1 + m, 3) pressure, gallery pressure and volume swept by the valve at the start and after each of the m time
        steps; (0, 3) where one of them did not settle
    """
    v0, modulus, bend, air, feed, y_port, k_port, h_port, rounded, end, width = parameters[:11]
    y_spill, k_spill, h_spill, p_open, area_out, force, retraction, v_gallery = parameters[11:19]
    mass_valve, damping, seat, exposure, leak, growth, zero, suction, stroke, again, column, spring = parameters[19:]
    plunger, top_lift, grid_step, end_lift, end_slope, top_angle, period = geometry
    n = theta.size
    n_shift = shifts.shape[1]
    n_all = N + n_shift if want_tangents else 0
    pressure = np.empty(n)
    tangents = np.zeros((n, n_all))
    states = np.zeros((n, 3))
    flows = np.zeros((n, 4))
    partial = np.zeros((4, n_all))
    mass_t = np.zeros(n_all)
    gallery_t = np.zeros(n_all)
    u_t = np.zeros(n_all)
    speed_t = np.zeros(n_all)
    w_t = np.zeros(n_all)
    p_t = np.zeros(n_all)
    g_t = np.zeros(n_all)
    path = np.empty((np.sum(substeps) + 1, 3))
    place, settled = 1, True
    p, g, speed, w = start, start, 0.0, 0.0
    u = min((start - (line[0] - zero) - p_open + spring * retraction) / (STOP + spring), 0.0)
    path[0, 0], path[0, 1], path[0, 2] = start, start, u
    p_step, g_step, dt_old = 0.0, 0.0, 1.0
    share, share_p, share_k, share_b, share_a = specific_volume(start, modulus, bend, air)
    volume = v0 + plunger * (top_lift - lift[0])
    room, room_u = swept(u)
    mass, gallery = volume / share, (v_gallery + room) / share
    if want_tangents:
        if u < 0.0:
            for j in range(n_all):
                u_t[j] = start_by[j] / (STOP + spring)
            u_t[VALVE_OPENING] -= 1.0 / (STOP + spring)
            u_t[RETRACTION_VOLUME] += spring / (STOP + spring)
            u_t[PRESSURE_ZERO] += 1.0 / (STOP + spring)
            u_t[VALVE_SPRING] += (retraction - u) / (STOP + spring)
        for both in range(2):
            row = mass_t if both == 0 else gallery_t
            factor = -(v_gallery + room if both else volume) / (share * share)
            for j in range(n_all):
                row[j] = factor * share_p * start_by[j] + (room_u * u_t[j] / share if both else 0.0)
            row[DEAD_VOLUME if both == 0 else GALLERY_VOLUME] += 1.0 / share
            row[BULK_MODULUS] += factor * share_k
            row[BULK_MODULUS_SLOPE] += factor * share_b
            row[FREE_AIR] += factor * share_a
        for j in range(n_shift):
            mass_t[N + j] -= plunger * slope[0] * shifts[0, j] / share
    for i in range(n):
        before = i - 1 if i > 0 else 0
        steps = substeps[i]
        dt = grid_step / steps
        for sub in range(1, steps + 1):
            part = sub / steps
            y = lift[before] + (lift[i] - lift[before]) * part
            angle = theta[before] + (theta[i] - theta[before]) * part
            if period > 0.0:  # a land closes the outlet once a stroke
                angle -= period * np.floor(angle / period)
            behind = line[before] + (line[i] - line[before]) * part - zero
            volume = v0 + plunger * (top_lift - y)
            port_x = (y_port - y) / h_port
            port_s, port_sx, port_sq = opening(port_x, rounded)
            spill_x = (y - y_spill) / h_spill
            spill_s, spill_sx, spill_sq = opening(spill_x, rounded)
            returning = angle > top_angle and again > 0.0 and end < NEVER
            outlet_x = (again * end_lift - y) / RETURN_SPAN if returning else (end - angle) / width
            outlet, outlet_x_d, outlet_q = opening(outlet_x, rounded)
            feeding = FLOW * (k_port * h_port * port_s + k_spill * h_spill * spill_s)
            k_suction = FLOW * suction
            k_out = FLOW * area_out * outlet
            closed = outlet <= 0.0
            p_old, g_old, u_old, speed_old, w_old = p, g, u, speed, w
            pull = column / dt
            count = 0
            last = known.shape[0] == path.shape[0]
            if last:
                p = known[place, 0]
                if not closed:
                    g, u = known[place, 1], known[place, 2]
            else:
                p = moved_pressure(p, p_step * dt / dt_old)
                if not closed:
                    g = moved_pressure(g, g_step * dt / dt_old)
                    u = max(u + dt * speed, -0.5)
            while True:
                if count == AHEAD_ITERATIONS and not last:
                    p, g, u = p_old, g_old, u_old
                    if not closed:
                        u = max(u + 0.5 * dt * speed, -0.5)
                share, share_p, share_k, share_b, share_a = specific_volume(p, modulus, bend, air)
                root, root_d = flow_root(p - feed)
                loss, loss_p, loss_f, loss_l, loss_h = leak_flow(p, feed, leak, growth)
                drawn, drawn_d = suction_root(feed - p)
                f1 = volume / share - mass + dt * (feeding * root + loss - k_suction * drawn)
                j11 = -volume * share_p / (share * share) + dt * (feeding * root_d + loss_p + k_suction * drawn_d)
                count += 1
                # as a balance of room instead of mass, whose iterations do not swing where vapour forms
                if closed:
                    change = -f1 / (j11 + f1 * share_p / share)
                    p_tried, p = p, moved_pressure(p, change)
                    if last or count > MOST_ITERATIONS:
                        break
                    if abs(change) < settled_change(p):
                        if not want_tangents:
                            break
                        last = True
                    continue
                shared, shared_p, shared_k, shared_b, shared_a = specific_volume(g, modulus, bend, air)
                out, out_d = flow_root(p - g)
                lift_u, lift_ud = lifted(u, retraction)
                k_seat = FLOW * seat
                velocity = (u - u_old) / dt
                drop, entry = g - behind, behind
                if pull > 0.0:
                    drop = seat_drop(drop - pull * (velocity - w_old), pull * k_seat * lift_u)
                    entry = g - drop
                through, through_d = flow_root(drop)
                w = velocity + k_seat * lift_u * through
                stop, stop_u, stop_old, stop_top = stop_force(u, velocity, dt, retraction + stroke)
                room, room_u = swept(u)
                room += v_gallery
                f1 += dt * k_out * out
                f2 = room / shared - gallery - dt * (k_out * out - k_seat * lift_u * through)
                inertia = mass_valve * ((velocity - speed_old) / dt + damping * velocity)
                pushing = g + (1.0 - exposure) * (p - g) - entry - p_open - spring * (u - retraction)
                flow_force = force * seat / area_out
                f3 = inertia - pushing + flow_force * lift_u + stop
                j11 += dt * k_out * out_d
                j12 = -dt * k_out * out_d
                j22 = -room * shared_p / (shared * shared) + dt * (k_out * out_d + k_seat * lift_u * through_d)
                j23 = room_u / shared + dt * k_seat * lift_ud * through
                j31 = -(1.0 - exposure)
                j32 = -exposure
                j33 = mass_valve * (1.0 / dt + damping) / dt + spring + flow_force * lift_ud + stop_u
                j11 += f1 * share_p / share
                j22 += f2 * shared_p / shared
                # the flow into the line, f4 = w - u' - Q_seat = 0, is eliminated
                k_through = k_seat * lift_u * through_d
                j42, j43 = -k_through, -1.0 / dt - k_seat * lift_ud * through
                over44 = 1.0 / (1.0 + k_through * pull)
                share2, share3 = -dt * k_through * pull * over44, pull * over44
                j22, j23 = j22 - share2 * j42, j23 - share2 * j43
                j32, j33 = j32 - share3 * j42, j33 - share3 * j43
                # j21 = j12 and j13 = 0
                c11 = j22 * j33 - j23 * j32
                c12 = j12 * j33 - j23 * j31
                c13 = j12 * j32 - j22 * j31
                determinant = j11 * c11 - j12 * c12
                dp = -(c11 * f1 - j12 * j33 * f2 + j12 * j23 * f3) / determinant
                dg = -(-c12 * f1 + j11 * j33 * f2 - j11 * j23 * f3) / determinant
                du = -(c13 * f1 - (j11 * j32 - j12 * j31) * f2 + (j11 * j22 - j12 * j12) * f3) / determinant
                if count > 25 + AHEAD_ITERATIONS:
                    dp, dg, du = 0.5 * dp, 0.5 * dg, 0.5 * du
                if count > 6 + AHEAD_ITERATIONS and abs(du) > 2.0:
                    du = 2.0 if du > 0.0 else -2.0
                p_tried, p = p, moved_pressure(p, dp)
                g_tried, g = g, moved_pressure(g, dg)
                u += du
                w -= (j42 * (g - g_tried) + j43 * du) * over44
                if last or count > MOST_ITERATIONS:
                    break
                if abs(dp) < settled_change(p) and abs(dg) < settled_change(g) and abs(du) < VOLUME_SETTLED:
                    if not want_tangents:
                        break
                    last = True
            settled = settled and count <= MOST_ITERATIONS
            path[place, 0], path[place, 1], path[place, 2] = p, g, u
            place += 1
            p_step, g_step, dt_old = p - p_old, g - g_old, dt
            states[i, 2] += count
            if want_tangents or count > MOST_ITERATIONS:
                share, share_p, share_k, share_b, share_a = specific_volume(p, modulus, bend, air)
            else:
                share += share_p * (p - p_tried)
            mass = volume / share
            if closed:
                speed, u, w = 0.0, 0.0, 0.0
            else:
                speed = (u - u_old) / dt
                if want_tangents or count > MOST_ITERATIONS:
                    shared, shared_p, shared_k, shared_b, shared_a = specific_volume(g, modulus, bend, air)
                else:
                    shared += shared_p * (g - g_tried)
                room, room_u = swept(u)
                room += v_gallery
                gallery = room / shared
            if sub == steps:
                root, root_d = flow_root(p - feed)
                drawn, drawn_d = suction_root(feed - p)
                flows[i, 0] = FLOW * k_port * h_port * port_s * root - k_suction * drawn
                flows[i, 1] = FLOW * k_spill * h_spill * spill_s * root
                flows[i, 3] = loss
                if not closed:
                    flows[i, 2] = k_seat * lift_u * through
            if not want_tangents:
                continue
            # derivatives of f1, f2, f3 at a held new state; those by the old state come from the carried tangents
            over = 1.0 / share
            squared = over * over
            for j in range(n_all):
                partial[0, j] = -mass_t[j]
            root, root_d = flow_root(p - feed)
            partial[0, DEAD_VOLUME] += over
            partial[0, BULK_MODULUS] -= volume * squared * share_k
            partial[0, BULK_MODULUS_SLOPE] -= volume * squared * share_b
            partial[0, FREE_AIR] -= volume * squared * share_a
            drawn, drawn_d = suction_root(feed - p)
            partial[0, FEED_PRESSURE] += dt * (-feeding * root_d + loss_f - k_suction * drawn_d)
            partial[0, SUCTION_AREA] -= dt * FLOW * drawn
            port_flow = dt * FLOW * k_port * root
            spill_flow = dt * FLOW * k_spill * root
            partial[0, PORT_CLOSING_LIFT] += port_flow * port_sx
            partial[0, PORT_WIDTH] += dt * FLOW * h_port * port_s * root
            partial[0, PORT_SPAN] += port_flow * (port_s - port_x * port_sx)
            partial[0, PORT_ROUNDNESS] += port_flow * h_port * port_sq + spill_flow * h_spill * spill_sq
            partial[0, SPILL_LIFT] -= spill_flow * spill_sx
            partial[0, SPILL_WIDTH] += dt * FLOW * h_spill * spill_s * root
            partial[0, SPILL_SPAN] += spill_flow * (spill_s - spill_x * spill_sx)
            partial[0, LEAKAGE] += dt * loss_l
            partial[0, LEAK_GROWTH] += dt * loss_h
            by_lift = -plunger * over - port_flow * port_sx + spill_flow * spill_sx
            slope_here = slope[before] + (slope[i] - slope[before]) * part
            if closed:
                for j in range(n_shift):
                    moved = shifts[before, j] + (shifts[i, j] - shifts[before, j]) * part
                    partial[0, N + j] += by_lift * slope_here * moved
                for j in range(n_all):
                    p_t[j] = -partial[0, j] / j11
                    u_t[j] = 0.0
                    speed_t[j] = 0.0
                    w_t[j] = 0.0
            else:
                shared_over = 1.0 / shared
                shared_squared = shared_over * shared_over
                inverse_time = 1.0 / dt
                old_u = -mass_valve * (inverse_time + damping) * inverse_time + stop_old
                for j in range(n_all):
                    partial[1, j] = -gallery_t[j]
                    partial[1, j] += dt * k_through * pull * w_t[j]
                    partial[2, j] = old_u * u_t[j] - mass_valve * inverse_time * speed_t[j] - pull * w_t[j]
                    partial[3, j] = inverse_time * u_t[j] - k_through * pull * w_t[j]
                flow_out = dt * out
                by_outlet = flow_out * FLOW * area_out
                by_x = by_outlet * outlet_x_d
                by_again = by_x * end_lift / RETURN_SPAN if returning else 0.0
                by_end = by_x * again * end_slope / RETURN_SPAN if returning else by_x / width
                by_width = 0.0 if returning else -by_x * outlet_x / width
                by_angle = -by_x * slope_here / RETURN_SPAN if returning else -by_x / width
                for sign in range(2):
                    direction = 1.0 if sign == 0 else -1.0
                    partial[sign, PORT_ROUNDNESS] += direction * by_outlet * outlet_q
                    partial[sign, END_OF_DELIVERY] += direction * by_end
                    partial[sign, END_WIDTH] += direction * by_width
                    partial[sign, OUTLET_RETURN] += direction * by_again
                    partial[sign, VALVE_AREA] += direction * flow_out * FLOW * outlet
                partial[1, BULK_MODULUS] -= room * shared_squared * shared_k
                partial[1, BULK_MODULUS_SLOPE] -= room * shared_squared * shared_b
                partial[1, FREE_AIR] -= room * shared_squared * shared_a
                partial[1, GALLERY_VOLUME] += shared_over
                partial[1, RETRACTION_VOLUME] -= dt * k_seat * lift_ud * through
                partial[1, SEAT_GAIN] += dt * FLOW * lift_u * through
                partial[1, PRESSURE_ZERO] += dt * k_seat * lift_u * through_d
                partial[2, VALVE_OPENING] += 1.0
                partial[2, VALVE_AREA] -= flow_force * lift_u / area_out
                partial[2, VALVE_RANGE] += seat / area_out * lift_u
                partial[2, RETRACTION_VOLUME] += -spring - flow_force * lift_ud + stop_top
                partial[2, VALVE_STROKE] += stop_top
                partial[2, VALVE_MASS] += (speed - speed_old) * inverse_time + damping * speed
                partial[2, VALVE_DAMPING] += mass_valve * speed
                partial[2, SEAT_GAIN] += force / area_out * lift_u
                partial[2, VALVE_EXPOSURE] += p - g
                partial[2, PRESSURE_ZERO] -= 1.0
                partial[3, RETRACTION_VOLUME] += k_seat * lift_ud * through
                partial[3, SEAT_GAIN] -= FLOW * lift_u * through
                partial[3, PRESSURE_ZERO] -= k_through
                faster = (w - w_old) * inverse_time
                partial[1, LINE_INERTANCE] -= dt * k_through * faster
                partial[2, LINE_INERTANCE] += faster
                partial[3, LINE_INERTANCE] += k_through * faster
                partial[2, VALVE_SPRING] += u - retraction
                for j in range(n_shift):
                    moved = shifts[before, j] + (shifts[i, j] - shifts[before, j]) * part
                    partial[0, N + j] += (by_lift * slope_here + by_angle) * moved
                    partial[1, N + j] -= by_angle * moved
                i11, i12, i13 = c11 / determinant, -j12 * j33 / determinant, j12 * j23 / determinant
                i21, i22, i23 = -c12 / determinant, j11 * j33 / determinant, -j11 * j23 / determinant
                i31 = c13 / determinant
                i32 = -(j11 * j32 - j12 * j31) / determinant
                i33 = (j11 * j22 - j12 * j12) / determinant
                for j in range(n_all):
                    d = partial[3, j]
                    a, b, c = partial[0, j], partial[1, j] - share2 * d, partial[2, j] - share3 * d
                    p_t[j] = -(i11 * a + i12 * b + i13 * c)
                    g_t[j] = -(i21 * a + i22 * b + i23 * c)
                    new_u = -(i31 * a + i32 * b + i33 * c)
                    w_t[j] = -(d + j42 * g_t[j] + j43 * new_u) * over44
                    speed_t[j] = (new_u - u_t[j]) * inverse_time
                    u_t[j] = new_u
                factor = -room * shared_squared
                for j in range(n_all):
                    gallery_t[j] = factor * shared_p * g_t[j] + shared_over * room_u * u_t[j]
                gallery_t[BULK_MODULUS] += factor * shared_k
                gallery_t[BULK_MODULUS_SLOPE] += factor * shared_b
                gallery_t[FREE_AIR] += factor * shared_a
                gallery_t[GALLERY_VOLUME] += shared_over
            factor = -volume * squared
            for j in range(n_all):
                mass_t[j] = factor * share_p * p_t[j]
            mass_t[DEAD_VOLUME] += over
            mass_t[BULK_MODULUS] += factor * share_k
            mass_t[BULK_MODULUS_SLOPE] += factor * share_b
            mass_t[FREE_AIR] += factor * share_a
            for j in range(n_shift):
                moved = shifts[before, j] + (shifts[i, j] - shifts[before, j]) * part
                mass_t[N + j] -= plunger * slope_here * moved * over
        pressure[i] = p
        states[i, 0] = g
        states[i, 1] = u
        for j in range(n_all):
            tangents[i, j] = p_t[j]
    return pressure, tangents, states, flows, path if settled else path[:0]


def revolution(
    parameters: Array, geometry: Array, grid: tuple[Any, ...], shifts: Array, known: Array, want_tangents: bool
) -> tuple[Array, Array, Array, Array, Array]:
    """Return what `integrate` does, from a chamber that is filled from the gallery, or from what is left in it.

    Where the end of a revolution is no filled chamber (a throttled suction valve leaves vapour, a closed one what it
    has trapped), another one begins there. ``grid`` holds theta, lift, slope, line and substeps.
    """
    full, full_by = float(parameters[FEED_PRESSURE]), np.zeros(N + shifts.shape[1])
    full_by[FEED_PRESSURE] = 1.0

    def turn(start: float, start_by: Array, path: Array) -> tuple[Array, Array, Array, Array, Array]:
        return integrate(parameters, geometry, *grid, shifts, start, start_by, path, want_tangents)  # type: ignore[no-any-return]

    again = known.size and known[0, 0] != full
    found = turn(full, full_by, NO_PATH if again else known)
    end, by = float(found[0][-1]), found[1]
    if abs(end - full) >= FILLED:  # not so where nothing finite came out
        return turn(end, by[-1] if want_tangents else full_by, known if again else NO_PATH)
    return found
