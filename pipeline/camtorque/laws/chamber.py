"""Chamber: from line pressure to the pressure on the plunger.

The sensor sits behind the delivery valve, so line pressure is chamber pressure only while the valve delivers. The
chamber is one closed volume with four ways out, and the same balance of mass holds over the whole revolution::

    d(rho V)/dt = -rho_0 (Q_port + Q_spill + Q_valve + Q_leak),   V = V_0 + A (y_top - y)
    rho(p)/rho_0 = (1 + b p / beta_0)**(1/b)                      bulk modulus beta = beta_0 + b p
    Q_port  = k_port max(0, y_port - y) sqrt(p - p_feed)          open until the plunger covers the port
    Q_spill = k_spill max(0, y - y_spill) sqrt(p - p_feed)  the helix uncovers a port above this lift
    Q_valve = a k_valve z(d / w) sqrt(p - p_line),  d = p - p_line - p_open   a: outlet open until end of delivery
    Q_leak  = g (p - p_feed) ((1 + h p) / (1 + h p_r))**3         g: leakage per pressure at p_r = 500 bar

Pressure never falls below vapour pressure. Delivery ends either by spill or because the outlet closes (a goes to
zero) while the lift still rises; the closed volume is then compressed, held through the dwell, and drives the cam on
the return. Sources: Rezeau and others for the valve law (area in proportion to the valve lift up to its stop);
the clearance of a plunger widens with the pressure in it, and leaks with its third power;
bulk modulus of diesel fuel: Payri et al., Fuel 90 (2011), slope about 10 over 15-180 MPa.

The balance is integrated by an implicit Euler rule for the mass, which is exact for a closed volume whatever the
step, and unconditionally stable in the stiff valve flow.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from camtorque.laws.rows import display
from camtorque.units import BAR, DEGREE

MM3 = 1.0e-9
FLUID_DENSITY = 830.0
"""Diesel-like test oil (ISO 4113 is 820-830) [kg/m^3]; only scales the flow coefficients into areas."""
DISCHARGE = 0.7 * np.sqrt(2.0 / FLUID_DENSITY)
"""Flow per area and square root of pressure, Cd sqrt(2/rho) with Cd = 0.7 [m/s/sqrt(Pa)]."""
VAPOUR_PRESSURE = -0.9 * BAR
"""Gauge pressure at which the liquid stops following the plunger [Pa]."""
SMOOTHING_PRESSURE = 2.0 * BAR
"""Below this difference the square root goes over into a straight line (laminar) [Pa]."""
KBAR = 1.0e3 * BAR
LEAK_PRESSURE = 500.0 * BAR
"""Pressure at which the leakage is stated [Pa]."""
MM3_PER_SECOND_BAR = 1.0e-9 / BAR

ROWS = (
    display("dead_volume", "V_0", "mm^3", MM3, (800.0, 10.0, 20000.0, 100.0), None,
            "volume above the plunger at full lift, holder and bores up to the valve", "fitted; no sheet gives it"),
    display("bulk_modulus", "beta_0", "GPa", 1.0e9, (1.30, 1.0, 1.7, 0.02), (1.30, 0.05),
            "bulk modulus of the fuel at feed pressure", "Payri, Fuel 2011: 1.25-1.33 GPa"),
    display("bulk_modulus_slope", "b", "-", 1.0, (10.0, 5.0, 15.0, 0.5), (10.0, 2.0),
            "increase of the bulk modulus with pressure", "Payri, Fuel 2011; Nikolic, Thermal Science 2012"),
    display("feed_pressure", "p_feed", "bar", BAR, (3.0, 0.0, 15.0, 1.0), (3.0, 2.0),
            "gauge pressure in the feed gallery", "typical of gallery pumps, 1-6 bar"),
    display("valve_opening", "p_open", "bar", BAR, (20.0, 0.0, 120.0, 3.0), (25.0, 20.0),
            "pressure difference at which the delivery valve lifts", "catalogues of delivery valves: 5-50 bar"),
    display("valve_area", "A_valve", "mm^2", DISCHARGE * 1.0e-6, (1.0, 0.02, 60.0, 0.1), None,
            "flow area of the delivery valve at its stop (Cd = 0.7)", "fitted"),
    display("valve_range", "w", "bar", BAR, (20.0, 0.3, 300.0, 5.0), (20.0, 20.0),
            "further pressure difference that lifts the valve to its stop", "spring rate of delivery valves"),
    display("leakage", "g", "mm^3/s/bar", MM3_PER_SECOND_BAR, (0.5, 0.0, 200.0, 0.3), (0.5, 2.0),
            "leakage past the plunger, per pressure at 500 bar", "clearances of 2-6 um: 0.05-0.8, worn ones more"),
    display("leak_growth", "h", "1/kbar", 1.0 / KBAR, (0.3, 0.0, 2.0, 0.1), (0.3, 0.4),
            "widening of the plunger's clearance with pressure", "2-3 um at rest, about 1 um more at 1000 bar"),
    display("port_closing_lift", "y_port", "mm", 1.0e-3, (1.4, 0.02, 12.0, 0.02), None,
            "lift at which the plunger closes the inlet port", "end of pre-stroke; nominally at the trigger angle"),
    display("port_width", "b_port", "mm", DISCHARGE * 1.0e-3, (4.0, 0.1, 60.0, 1.0), (6.0, 6.0),
            "port area per lift while the plunger covers it (Cd = 0.7)", "port diameters of 2-4 mm, two ports"),
    display("end_of_delivery", "theta_end", "deg", DEGREE, (45.0, 5.0, 175.0, 0.3), None,
            "cam angle at which the outlet has closed", "depends on the load; fitted", "own"),
    display("end_width", "w_end", "deg", DEGREE, (0.8, 0.1, 6.0, 0.2), (0.8, 0.6),
            "cam angle that the outlet takes to close", "assumed; closing times of 0.1-0.5 ms"),
    display("spill_lift", "y_spill", "mm", 1.0e-3, (5.0, 0.05, 30.0, 0.02), None,
            "lift at which the helix uncovers the spill port, and covers it again on the return",
            "depends on the load; fitted", "own"),
    display("spill_width", "b_spill", "mm", DISCHARGE * 1.0e-3, (3.0, 0.05, 60.0, 0.5), (4.0, 4.0),
            "spill area per lift above it (Cd = 0.7)", "port diameters of 2-4 mm", "own"),
    display("pressure_zero", "p_0", "bar", BAR, (0.0, -12.0, 12.0, 0.5), (0.0, 1.0),
            "error of the zero of the line pressure", "certificate and standstill readings", "own"),
)  # fmt: skip

KERNEL_ORDER = (
    "dead_volume", "bulk_modulus", "bulk_modulus_slope", "feed_pressure", "valve_opening", "valve_area", "valve_range",
    "leakage", "port_closing_lift", "port_width", "end_of_delivery", "end_width", "spill_lift", "spill_width",
    "pressure_zero", "leak_growth",
)  # fmt: skip
"""Order of the parameters in the kernel's vector."""


@njit(cache=True, error_model="numpy")
def _root(difference, scale):  # type: ignore[no-untyped-def]
    """Odd square root, a straight line through zero: value and derivative."""
    s = (difference * difference + scale * scale) ** 0.25
    return difference / s, 1.0 / s - 0.5 * difference * difference / s**5


@njit(cache=True, error_model="numpy")
def _opening(ratio):  # type: ignore[no-untyped-def]
    """Valve opening between 0 (closed) and 1 (fully open), with derivative.

    Between a hard stop and a valve whose flow force, growing with the pressure difference, alone limits the lift.
    """
    if ratio <= 0.0:
        return 0.0, 0.0
    root = np.sqrt(1.0 + ratio * ratio)
    return ratio / root, 1.0 / root**3


@njit(cache=True, error_model="numpy")
def _ramp(theta, end, width):  # type: ignore[no-untyped-def]
    """Outlet: 1 before ``end - width``, 0 after ``end``."""
    u = (end - theta) / width
    if u >= 1.0:
        return 1.0
    if u <= 0.0:
        return 0.0
    return u


@njit(cache=True, error_model="numpy")
def _leak(x, feed, leak, widening, at_reference):  # type: ignore[no-untyped-def]
    """Leakage through a clearance that widens with the pressure: flow and derivative."""
    ratio = max(1.0 + widening * x, 0.0) / at_reference
    flow = leak * (x - feed) * ratio**3
    return flow, leak * ratio**3 + 3.0 * leak * (x - feed) * ratio**2 * widening / at_reference


@njit(cache=True, error_model="numpy")
def integrate_chamber(parameters, area, top_lift, time_step, theta, lift, slope, line_pressure, shifts):  # type: ignore[no-untyped-def]
    """Integrate the mass balance over one revolution from the open port, with exact tangents.

    Parameters
    ----------
    parameters : (16,) in `KERNEL_ORDER` [SI]
    area, top_lift, time_step : plunger area [m^2], full lift [m], [s]
    theta, lift, slope, line_pressure : (n,) cam angle [rad], y [m], y' [m/rad], line pressure [Pa]
    shifts : (n, n_shift) derivative of the cam angle with respect to the parameters that shift it

    Returns
    -------
    pressure : (n,) chamber pressure [Pa]
    tangents : (n, 16 + n_shift) derivative of the pressure with respect to parameters and shifts
    flows : (n, 4) port, spill, valve, leak [m^3/s]
    """
    v0, beta, b, feed, p_open, k_valve, w, leak, y_port, k_port, end, width, spill, k_spill = parameters[:14]
    p_zero, widening = parameters[14:]
    n = theta.size
    n_shift = shifts.shape[1]
    n_all = 16 + n_shift
    pressure = np.empty(n)
    tangents = np.zeros((n, n_all))
    flows = np.zeros((n, 4))
    volume = v0 + area * (top_lift - lift[0])
    density = (1.0 + b * feed / beta) ** (1.0 / b)
    mass = volume * density
    mass_tangent = np.zeros(n_all)
    mass_tangent[0] = density
    mass_tangent[1] = volume * density * (-feed / (beta * (beta + b * feed)))
    mass_tangent[2] = volume * density * (-np.log(density) / b + feed / (b * (beta + b * feed)))
    mass_tangent[3] = volume * density / (beta + b * feed)
    for j in range(n_shift):
        mass_tangent[16 + j] = -area * slope[0] * shifts[0, j] * density
    partial = np.zeros(n_all)
    x = feed
    at_reference = 1.0 + widening * LEAK_PRESSURE
    for i in range(n):
        volume = v0 + area * (top_lift - lift[i])
        port_gap = y_port - lift[i]
        port_area = k_port * port_gap if port_gap > 0.0 else 0.0
        spill_gap = lift[i] - spill
        spill_area = k_spill * spill_gap if spill_gap > 0.0 else 0.0
        outlet = _ramp(theta[i], end, width)
        line = line_pressure[i] - p_zero
        clamped = False
        slope_f = 1.0
        for _ in range(60):
            density = (1.0 + b * x / beta) ** (1.0 / b)
            feed_root, feed_root_d = _root(x - feed, 2.0e5)
            line_root, line_root_d = _root(x - line, 2.0e5)
            z, z_d = _opening((x - line - p_open) / w)
            valve = outlet * k_valve * z * line_root
            loss, loss_d = _leak(x, feed, leak, widening, at_reference)
            out = (port_area + spill_area) * feed_root + valve + loss
            out_d = (port_area + spill_area) * feed_root_d + loss_d
            out_d += outlet * k_valve * (z_d / w * line_root + z * line_root_d)
            slope_f = volume * density / (beta + b * x) + time_step * out_d
            change = -(volume * density - mass + time_step * out) / slope_f
            x += change
            if x < -0.9e5:
                if clamped:
                    x = -0.9e5
                    break
                clamped = True
                x = -0.9e5
            elif abs(change) < 1.0e-3:
                clamped = False
                break
            else:
                clamped = False
        density = (1.0 + b * x / beta) ** (1.0 / b)
        modulus = beta + b * x
        feed_root, feed_root_d = _root(x - feed, 2.0e5)
        line_root, line_root_d = _root(x - line, 2.0e5)
        z, z_d = _opening((x - line - p_open) / w)
        flows[i, 0] = port_area * feed_root
        flows[i, 1] = spill_area * feed_root
        flows[i, 2] = outlet * k_valve * z * line_root
        loss, loss_d = _leak(x, feed, leak, widening, at_reference)
        flows[i, 3] = loss
        density_beta = density * (-x / (beta * modulus))
        density_b = density * (-np.log(density) / b + x / (b * modulus))
        pressure[i] = x
        if clamped:
            mass = volume * density
            mass_tangent[:] = 0.0
            mass_tangent[0] = density
            mass_tangent[1] = volume * density_beta
            mass_tangent[2] = volume * density_b
            for j in range(n_shift):
                mass_tangent[16 + j] = -area * slope[i] * shifts[i, j] * density
            continue
        valve_area = outlet * k_valve
        out_d = (port_area + spill_area) * feed_root_d + loss_d
        out_d += valve_area * (z_d / w * line_root + z * line_root_d)
        slope_f = volume * density / modulus + time_step * out_d
        partial[:] = 0.0
        partial[0] = density
        partial[1] = volume * density_beta
        partial[2] = volume * density_b
        ratio = max(1.0 + widening * x, 0.0) / at_reference
        partial[3] = -time_step * ((port_area + spill_area) * feed_root_d + leak * ratio**3)
        partial[4] = -time_step * valve_area * z_d / w * line_root
        partial[5] = time_step * outlet * z * line_root
        partial[6] = -time_step * valve_area * z_d * (x - line - p_open) / (w * w) * line_root
        partial[7] = time_step * (x - feed) * ratio**3
        partial[15] = time_step * leak * (x - feed) * 3.0 * ratio**2 * (x - LEAK_PRESSURE) / at_reference**2
        if port_gap > 0.0:
            partial[8] = time_step * k_port * feed_root
            partial[9] = time_step * port_gap * feed_root
        outlet_theta = 0.0
        if 0.0 < outlet < 1.0:
            outlet_theta = -1.0 / width
            partial[10] = time_step * k_valve * z * line_root / width
            partial[11] = -time_step * k_valve * z * line_root * outlet / width
        if spill_gap > 0.0:
            partial[12] = -time_step * k_spill * feed_root
            partial[13] = time_step * spill_gap * feed_root
        partial[14] = time_step * valve_area * (z_d / w * line_root + z * line_root_d)
        for j in range(n_shift):
            by_lift = -area * density
            if port_gap > 0.0:
                by_lift -= time_step * k_port * feed_root
            if spill_gap > 0.0:
                by_lift += time_step * k_spill * feed_root
            by_theta = time_step * k_valve * z * line_root * outlet_theta
            partial[16 + j] = (by_lift * slope[i] + by_theta) * shifts[i, j]
        for k in range(n_all):
            tangents[i, k] = -(partial[k] - mass_tangent[k]) / slope_f
        mass = volume * density
        for k in range(n_all):
            mass_tangent[k] = volume * density / modulus * tangents[i, k]
        mass_tangent[0] += density
        mass_tangent[1] += volume * density_beta
        mass_tangent[2] += volume * density_b
        for j in range(n_shift):
            mass_tangent[16 + j] -= area * slope[i] * shifts[i, j] * density
    return pressure, tangents, flows
