"""The compiled time loop: hydraulics, then mechanics, then the waves of the line, one fixed base step at a time."""

from __future__ import annotations

import numpy as np

from rigs.hydraulics import advance_hydraulics
from rigs.jit import compiled
from rigs.laws import TWO_PI, lift_law, pressure_of
from rigs.mechanics import (
    ACCELERATION,
    BEARING_LOSS,
    DRIVE_TORQUE,
    N_MECHANIC,
    SHAFT_LOSS,
    SPRING_POWER,
    TORQUE,
    mechanic_rates,
)

COLUMNS = [
    "cam_angle",
    "cam_speed",
    "cam_acceleration",
    "drive_angle",
    "drive_speed",
    "torque",
    "drive_torque",
    "chamber_pressure",
    "line_pressure",
    "nozzle_pressure",
    "needle",
    "valve",
    "chamber_mass",
    "contact_normal",
    "contact_tangential",
    "guide_force",
    "bearing_load",
    "bearing_along",
]
TOTALS = [
    "shaft_work",
    "pressure_work",
    "bearing",
    "pin",
    "guide",
    "seal",
    "plunger",
    "shaft_drag",
    "spring_work",
    "port_mass",
    "leak_mass",
    "valve_mass",
    "port_enthalpy",
    "leak_enthalpy",
    "valve_enthalpy",
    "plunger_work",
    "injected_mass",
    "kinetic",
    "chamber_mass",
    "time",
]
N_WORK = 9


@compiled
def _delayed(buffer, size, index, delay):
    """Return what was sent ``delay`` steps before step ``index``, linear between steps."""
    whole = int(delay)
    part = delay - whole
    near = buffer[(index - whole) % size]
    if part == 0.0:
        return near
    return near + part * (buffer[(index - whole - 1) % size] - near)


@compiled
def _arrivals(k, forward, backward, delays, index, waves):
    """Return the waves that reach both ends at steps ``index`` and ``index + 1``."""
    if not k.waves:
        return
    size = forward.shape[1]
    last = delays.size - 1
    waves[0] = _delayed(backward[0], size, index, delays[0])
    waves[1] = _delayed(backward[0], size, index + 1, delays[0])
    waves[2] = _delayed(forward[last], size, index, delays[last])
    waves[3] = _delayed(forward[last], size, index + 1, delays[last])


@compiled
def _send_waves(k, x, forward, backward, delays, index, waves):
    """Store the waves that leave the ends and the lumped resistances at step ``index`` (method of characteristics)."""
    if not k.waves:
        return
    size = forward.shape[1]
    last = delays.size - 1
    z, r = k.impedance, k.resistance
    here = index % size
    flow = (x[1] - waves[1]) / (z + r)
    forward[0, here] = x[1] + (z - r) * flow
    flow = (waves[3] - x[4]) / (z + r)
    backward[last, here] = x[4] + (r - z) * flow
    for j in range(last):
        right = _delayed(forward[j], size, index, delays[j])
        left = _delayed(backward[j + 1], size, index, delays[j + 1])
        flow = (right - left) / (2.0 * z + r)
        forward[j + 1, here] = left + 2.0 * z * flow
        backward[j, here] = right - 2.0 * z * flow


@compiled
def _advance_mechanics(k, x, work, f, step, pressure, time, knots, knot_step, feed_forward):
    """Advance the mechanical state by one RK4 step in place; pressure is linear over the step."""
    last, k1, y, total = work[0], work[1], work[2], work[3]
    # the first stage is what the last step ended with
    for j in range(N_MECHANIC):
        total[j] = step / 6.0 * last[j]
        y[j] = x[j] + 0.5 * step * last[j]
    for stage in range(1, 4):
        part = 1.0 if stage == 3 else 0.5
        t = time + part * step
        n = int(t / knot_step)
        slope = (knots[n + 1] - knots[n]) / knot_step
        set_speed = knots[n] + slope * (t - n * knot_step)
        p = pressure[0] + part * (pressure[1] - pressure[0])
        mechanic_rates(k, y, k1, f, p, set_speed, slope, feed_forward)
        weight = step / 6.0 if stage == 3 else step / 3.0
        ahead = step * (0.5 if stage == 1 else 1.0)
        for j in range(N_MECHANIC):
            total[j] += weight * k1[j]
            y[j] = x[j] + ahead * k1[j]
    for j in range(N_MECHANIC):
        x[j] += total[j]
    n = int((time + step) / knot_step)
    slope = (knots[n + 1] - knots[n]) / knot_step
    mechanic_rates(k, x, last, f, pressure[1], knots[n] + slope * (time + step - n * knot_step), slope, feed_forward)


@compiled
def _powers(k, f, w, pressure, angle, powers):
    """Fill the powers that are summed into the mechanical totals."""
    _, y1, _ = lift_law(k, angle % TWO_PI)
    powers[0] = f[TORQUE] * w
    powers[1] = pressure * k.plunger_area * y1 * w
    for j in range(SHAFT_LOSS - BEARING_LOSS + 1):
        powers[2 + j] = f[BEARING_LOSS + j]
    powers[8] = f[SPRING_POWER]


@compiled
def _kinetic(k, x):
    y, y1, _ = lift_law(k, x[4] % TWO_PI)
    lever = y1 - k.offset
    gear = 1.0 - np.sqrt((k.centre_distance + y) ** 2 + lever * lever) / k.roller_radius
    inertia = k.shaft_inertia + k.follower_mass * y1 * y1 + k.roller_inertia * gear * gear
    return 0.5 * inertia * x[5] * x[5]


@compiled
def run_loop(
    k,
    step,
    n_steps,
    every,
    mech,
    hyd,
    f,
    sums,
    clock,
    lines,
    delays,
    knots,
    knot_step,
    cycles,
    feed_forward,
    out,
    totals,
):
    """Advance ``n_steps``; write a row of ``out`` every ``every`` steps and of ``totals`` at each revolution.

    ``clock`` holds (time, step index) and is advanced, as are ``mech``, ``hyd``, ``f``, ``sums`` and the waves in
    ``lines``. ``cycles`` is (n, 3): end angle, spill lift, nozzle factor of each revolution. Returns rows written.
    """
    hyd_work = np.zeros((5, hyd.size))
    mech_work = np.zeros((4, N_MECHANIC))
    waves = np.zeros(4)
    pressure = np.zeros(2)
    powers = np.zeros(N_WORK)
    before = np.zeros(N_WORK)
    forward, backward = lines[0], lines[1]
    row = 0
    total_row = 0
    y, _, _ = lift_law(k, mech[4] % TWO_PI)
    pressure[0] = pressure_of(k, hyd[0] / (k.top_volume - k.plunger_area * y))
    _powers(k, f, mech[5], pressure[0], mech[4], before)
    start_time = clock[0]
    start_index = int(clock[1])
    first = int(start_time / knot_step)
    mechanic_rates(k, mech, mech_work[0], f, pressure[0], knots[first], 0.0, feed_forward)
    for i in range(n_steps):
        time = start_time + i * step
        index = start_index + i
        revolution = int(np.floor(mech[4] / TWO_PI))
        ends = (cycles[revolution, 0], cycles[revolution, 1], cycles[revolution, 2])
        _arrivals(k, forward, backward, delays, index, waves)
        advance_hydraulics(k, hyd, hyd_work, step, mech[4], mech[5], f[ACCELERATION], ends, waves)
        _send_waves(k, hyd, forward, backward, delays, index + 1, waves)
        angle = mech[4] + step * (mech[5] + 0.5 * f[ACCELERATION] * step)
        y, _, _ = lift_law(k, angle % TWO_PI)
        pressure[1] = pressure_of(k, hyd[0] / (k.top_volume - k.plunger_area * y))
        _advance_mechanics(k, mech, mech_work, f, step, pressure, time, knots, knot_step, feed_forward)
        _powers(k, f, mech[5], pressure[1], mech[4], powers)
        for j in range(N_WORK):
            sums[j] += 0.5 * step * (before[j] + powers[j])
            before[j] = powers[j]
        pressure[0] = pressure[1]
        if int(np.floor(mech[4] / TWO_PI)) > revolution and total_row < totals.shape[0]:
            for j in range(N_WORK):
                totals[total_row, j] = sums[j]
            for j in range(8):
                totals[total_row, N_WORK + j] = hyd[6 + j]
            totals[total_row, N_WORK + 8] = _kinetic(k, mech)
            totals[total_row, N_WORK + 9] = hyd[0]
            totals[total_row, N_WORK + 10] = time + step
            total_row += 1
        if (i + 1) % every == 0 and row < out.shape[0]:
            for j in range(2):
                out[row, j] = mech[4 + j]
                out[row, 3 + j] = mech[j]
            out[row, 2] = f[ACCELERATION]
            out[row, 5] = f[TORQUE]
            out[row, 6] = f[DRIVE_TORQUE]
            out[row, 7] = pressure[1]
            out[row, 8] = hyd[1]
            out[row, 9] = hyd[4]
            out[row, 10] = hyd[5]
            out[row, 11] = hyd[2]
            out[row, 12] = hyd[0]
            for j in range(5):
                out[row, 13 + j] = f[2 + j]
            row += 1
    clock[0] = start_time + n_steps * step
    clock[1] = start_index + n_steps
    return row, total_row
