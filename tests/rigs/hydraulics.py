"""Compiled time stepping of chamber, valve, line and injector: classical RK4 in as many sub-steps as the ports need.

State: 0 chamber mass, 1 pressure at the pump end of the line, 2 valve lift (0..1), 3 its speed, 4 nozzle pressure,
5 needle lift (0..1); then running totals: 6-8 mass through ports, leak and valve, 9-11 their enthalpy, 12 plunger work,
13 mass injected. The chamber is closed by its mass, so a cavity opens and closes without a special case.
"""

from __future__ import annotations

import numpy as np

from rigs.constants import LAMINAR_PORT, LAMINAR_SMALL
from rigs.jit import compiled
from rigs.laws import TWO_PI, density_of, enthalpy_of, lift_law, orifice, pressure_of, ramp

N_HYDRAULIC = 14


@compiled
def valve_opening(k, drop, lift_state):
    """Return the opening (0..1): massless law of the pressure difference, or the lift of a valve with mass."""
    if k.valve_frequency > 0.0:
        return lift_state
    return ramp((drop - k.valve_opening) / k.valve_span)


@compiled
def ports_area(k, lift, angle, spill_lift):
    """Return the effective area of inlet and spill port at a lift."""
    area = k.port_area * ramp((k.port_close_lift - lift) / k.port_height)
    if k.spill:
        area += k.spill_area * ramp((lift - spill_lift) / k.spill_height)
    return area


@compiled
def outlet_factor(k, angle, end_angle):
    """Return how far the outlet is open: 1 before the end of delivery, 0 after it in a closed-volume pump."""
    if k.spill:
        return 1.0
    return 1.0 - ramp((angle - end_angle) / k.close_width)


@compiled
def pipe_inflow(k, pressure, wave):
    """Return the flow into the pipe at an end where ``wave`` = p - Z q arrives."""
    if not k.waves:
        return 0.0
    return (pressure - wave) / (k.impedance + k.resistance)


@compiled
def hydraulic_rates(k, x, out, angle, speed, end_angle, spill_lift, nozzle_factor, wave_pump, wave_nozzle):
    """Write dx/dt of the hydraulic state."""
    wrapped = angle % TWO_PI
    y, y1, _ = lift_law(k, wrapped)
    volume = k.top_volume - k.plunger_area * y
    density = x[0] / volume
    pressure = pressure_of(k, density)

    port = orifice(ports_area(k, y, wrapped, spill_lift), pressure - k.feed_pressure, k.density, LAMINAR_PORT)
    if pressure < k.feed_pressure:
        port += orifice(k.suction_area, pressure - k.feed_pressure, k.density, LAMINAR_PORT)
    port_mass = port * (density if port > 0.0 else k.feed_density)
    growth = 1.0 + k.leak_growth * pressure
    leak_mass = density * k.leak * max(pressure, 0.0) * growth * growth * growth

    drop = pressure - x[1]
    opening = valve_opening(k, drop, x[2]) * outlet_factor(k, wrapped, end_angle)
    valve = orifice(k.valve_area * opening, drop, density, LAMINAR_SMALL) if opening > 0.0 else 0.0
    if k.valve_frequency == 0.0:
        valve = max(valve, 0.0)
    valve_mass = valve * density

    # a valve on its stop neither moves nor displaces liquid
    valve_speed = x[3]
    if (x[2] <= 0.0 and valve_speed < 0.0) or (x[2] >= 1.0 and valve_speed > 0.0):
        valve_speed = 0.0

    out[0] = -port_mass - leak_mass - valve_mass
    line_modulus = k.modulus + k.slope * x[1]
    into_line = valve * (1.0 + drop / line_modulus) + k.unloading_volume * valve_speed
    needle_flow = nozzle_factor * k.nozzle_area * x[5] if x[5] > 1e-6 else 0.0
    if k.waves:
        out[1] = line_modulus / k.end_volume * (into_line - pipe_inflow(k, x[1], wave_pump))
        nozzle_modulus = k.modulus + k.slope * x[4]
        injected = orifice(needle_flow, max(x[4], 0.0), k.density, LAMINAR_SMALL)
        out[4] = nozzle_modulus / k.nozzle_volume * (-pipe_inflow(k, x[4], wave_nozzle) - injected)
        injected_mass = injected * density_of(k, x[4]) if injected > 0.0 else 0.0
        needle_pressure = x[4]
    else:
        injected = orifice(needle_flow, max(x[1], 0.0), k.density, LAMINAR_SMALL)
        out[1] = line_modulus / k.end_volume * (into_line - injected)
        out[4] = out[1]
        injected_mass = injected * density_of(k, x[1]) if injected > 0.0 else 0.0
        needle_pressure = x[1]

    if k.valve_frequency > 0.0:
        target = (drop - k.valve_opening) / k.valve_span
        w = k.valve_frequency
        push = w * w * (target - x[2]) - 2.0 * k.valve_damping * w * valve_speed
        resting = (x[2] <= 0.0 and push < 0.0) or (x[2] >= 1.0 and push > 0.0)
        out[2] = valve_speed
        out[3] = 0.0 if resting and valve_speed == 0.0 else push
    else:
        out[2] = 0.0
        out[3] = 0.0
    # the needle follows a target between 0 and 1; the band between closing and opening pressure is its hysteresis
    if needle_pressure > k.needle_open:
        out[5] = (1.0 - x[5]) / k.needle_time
    elif needle_pressure < k.needle_close:
        out[5] = -x[5] / k.needle_time
    else:
        out[5] = (1.0 - x[5]) / k.needle_time if x[5] > 0.5 else -x[5] / k.needle_time

    out[6] = port_mass
    out[7] = leak_mass
    out[8] = valve_mass
    # the chamber's own enthalpy for either direction: what flows in has lost its excess in the port
    enthalpy = enthalpy_of(k, pressure, max(density, k.floor_density))
    out[9] = port_mass * enthalpy
    out[10] = leak_mass * enthalpy
    out[11] = valve_mass * enthalpy
    out[12] = pressure * k.plunger_area * y1 * speed
    out[13] = injected_mass


@compiled
def sub_steps(k, x, step, angle, end_angle, spill_lift):
    """Return how many RK4 sub-steps keep step * rate below one."""
    wrapped = angle % TWO_PI
    y, _, _ = lift_law(k, wrapped)
    volume = k.top_volume - k.plunger_area * y
    pressure = pressure_of(k, x[0] / volume)
    compliance = volume / (k.modulus + k.slope * pressure)
    speed_factor = np.sqrt(2.0 / k.density)
    excess = abs(pressure - k.feed_pressure)
    area = ports_area(k, y, wrapped, spill_lift) + k.suction_area
    port = area * speed_factor / np.sqrt(np.sqrt(excess * excess + LAMINAR_PORT**2))
    drop = pressure - x[1]
    valve = 0.0
    if drop > 0.0:
        opening = valve_opening(k, drop, x[2])
        slope = np.sqrt(drop) / k.valve_span if opening < 1.0 else 0.0
        valve = k.valve_area * speed_factor * (slope + opening / np.sqrt(drop + LAMINAR_SMALL))
    line = k.end_volume / (k.modulus + k.slope * x[1])
    rate = port / compliance + valve * (1.0 / compliance + 1.0 / line)
    return min(64, 1 + int(step * rate))


@compiled
def advance_hydraulics(k, x, work, step, angle, speed, acceleration, ends, waves):
    """Advance the hydraulic state by one base step in place; ``waves`` holds arriving waves at its start and end."""
    end_angle, spill_lift, nozzle_factor = ends
    n = sub_steps(k, x, step, angle + 0.5 * speed * step, end_angle, spill_lift)
    h = step / n
    k1, k2, k3, k4, y = work[0], work[1], work[2], work[3], work[4]
    for i in range(n):
        for stage in range(4):
            t = (i + (0.0 if stage == 0 else (1.0 if stage == 3 else 0.5))) * h
            part = t / step
            a = angle + t * (speed + 0.5 * acceleration * t)
            w = speed + acceleration * t
            pump = waves[0] + part * (waves[1] - waves[0])
            nozzle = waves[2] + part * (waves[3] - waves[2])
            if stage == 0:
                hydraulic_rates(k, x, k1, a, w, end_angle, spill_lift, nozzle_factor, pump, nozzle)
                for j in range(N_HYDRAULIC):
                    y[j] = x[j] + 0.5 * h * k1[j]
            elif stage == 1:
                hydraulic_rates(k, y, k2, a, w, end_angle, spill_lift, nozzle_factor, pump, nozzle)
                for j in range(N_HYDRAULIC):
                    y[j] = x[j] + 0.5 * h * k2[j]
            elif stage == 2:
                hydraulic_rates(k, y, k3, a, w, end_angle, spill_lift, nozzle_factor, pump, nozzle)
                for j in range(N_HYDRAULIC):
                    y[j] = x[j] + h * k3[j]
            else:
                hydraulic_rates(k, y, k4, a, w, end_angle, spill_lift, nozzle_factor, pump, nozzle)
                for j in range(N_HYDRAULIC):
                    x[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j])
        clip_stops(k, x)


@compiled
def clip_stops(k, x):
    """Inelastic stops of the valve; the line does not go below the cavitation floor (counted in x[14]).

    Liquid displaced by overshooting a stop is given back to the line.
    """
    over = min(x[2], 0.0) + max(x[2] - 1.0, 0.0)
    if over != 0.0:
        x[2] -= over
        x[3] = 0.0
        x[1] -= (k.modulus + k.slope * x[1]) / k.end_volume * k.unloading_volume * over
    for j in (1, 4):
        if x[j] < k.floor:
            x[j] = k.floor
            x[14] += 1.0
