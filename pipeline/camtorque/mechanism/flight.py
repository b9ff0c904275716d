"""Flight of a follower that has left its cam, and where it lands.

Where the balance asks the cam to pull, the follower flies on under spring, fluid and weight alone,
``m y_tt = -(f_s0 + k y + A p - m g_y)``, until it meets the cam again. It lands without rebound: the impulse that takes
its speed against the cam is reported, the blow itself is no part of the curves. In flight the cam carries nothing.
"""

from __future__ import annotations

import numpy as np

from camtorque.compiled import njit
from camtorque.config import PumpData
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.contact import pulls
from camtorque.mechanism.friction import NO_FRICTION
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.torque import constants_of
from camtorque.records import Array, Flight, Mask, Refusal
from camtorque.units import RPM, TURN

SUBSTEPS = 8
"""Steps between two points of the grid: on 3600 points a flight of 20 degrees is followed in 1600 steps."""
WIDEST_GAP = np.deg2rad(3.0)
"""Distance of two angles beyond which a grid is no revolution to fly over."""
TURNS = 5
"""Revolutions after which a follower that does not repeat its flights never does: in the air, or every second one."""


class Aloft(Refusal):
    """A speed at which the follower leaves the cam for longer, or on another shaft, than is modelled."""


def is_revolution(theta: Array) -> bool:
    """Tell whether angles cover one revolution in order, without wide gaps."""
    steps = np.diff(np.append(theta, theta[0] + TURN)) if theta.ndim == 1 and theta.size > 2 else np.zeros(1)
    # both ends of the revolution may be given: their distance is then 0
    return bool(np.all(steps[:-1] > 0.0) and steps[-1] > -1e-9 and np.max(steps) <= WIDEST_GAP)


def fly(
    pump: PumpData, law: CamLaw, theta: Array, pressure: Array, motion: tuple[Array, Array], mounting: Mounting
) -> tuple[tuple[Flight, ...], Mask]:
    """Return the flights of a follower in periodic running, and where over the grid it is in the air, (n_theta,).

    Parameters
    ----------
    theta : (n_theta,) one revolution, see `is_revolution` [rad]
    pressure : (n_theta,) on the plunger [Pa]
    motion : speed and acceleration of the cam, (n_theta,) each [rad/s, rad/s^2]

    Raises
    ------
    Aloft : the flights do not come to repeat with the revolution
    """
    c = constants_of(pump, mounting, NO_FRICTION)
    ends = np.append(theta, theta[0] + TURN)
    fine = np.interp(np.arange(SUBSTEPS * theta.size) / SUBSTEPS, np.arange(ends.size), ends)
    load, speed, change = (np.interp(fine, ends, np.append(v, v[0])) for v in (pressure, *motion))
    lift = law.derivatives(fine, 2)
    force = c.preload + c.weight + c.stiffness * lift[0] + c.area * load
    force += c.mass * (lift[2] * speed**2 + lift[1] * change)
    force = np.where(pulls(force), force, np.abs(force))
    gap, events = np.zeros(fine.size), np.zeros((fine.size, 3))
    steps = np.diff(np.append(fine, fine[0] + TURN))
    count = _fly(c, lift, force, (load, speed, change), steps, _surest(force), gap, events)
    if count < 0:
        raise Aloft(
            f"contact: after {TURNS} revolutions at {np.mean(speed) / RPM:.0f} rpm the follower has not landed, or "
            "flies otherwise from one revolution to the next, expected flights that repeat with the revolution; lower "
            "the speed, or choose a stiffer or more preloaded spring"
        )
    rows = events[:count]
    flights = tuple(Flight(float(fine[int(a)]), float(fine[int(b)]), float(v), float(c.mass * v)) for a, b, v in rows)
    return flights, gap[::SUBSTEPS] > 0.0


def _surest(force: Array) -> int:
    """Return the point at the end of the longest stretch on which the cam carries: a follower lands before it."""
    pulled = np.flatnonzero(force < 0.0)
    if not pulled.size:
        return 0
    length = np.diff(np.append(pulled, pulled[0] + force.size))
    return int((pulled[int(np.argmax(length))] + np.max(length) - 1) % force.size)


@njit(cache=True, error_model="numpy")
def _fly(c, lift, force, drive, steps, start, gap, events):  # type: ignore[no-untyped-def]
    """Follow the follower from ``start`` on; fills gap and events of the last revolution, returns their number.

    Velocity Verlet in cam angle: y'' = y_tt / w^2 - y' w_t / w^2.
    """
    load, speed, change = drive
    n, airborne = gap.size, False
    y, slope, begun, count = 0.0, 0.0, 0, 0
    for _ in range(TURNS):
        count = 0
        gap[:] = 0.0
        began_in_air = airborne
        for k in range(n):
            i, j = (start + k) % n, (start + k + 1) % n
            if not airborne and force[i] < 0.0:
                airborne, y, slope, begun = True, lift[0, i], lift[1, i], i
            if not airborne:
                continue
            gap[i] = y - lift[0, i] if y > lift[0, i] else 0.0
            h, square = steps[i], speed[i] * speed[i]
            rest = c.preload + c.weight
            curve = -(rest + c.stiffness * y + c.area * load[i]) / c.mass / square - slope * change[i] / square
            y = y + h * slope + 0.5 * h * h * curve
            square = speed[j] * speed[j]
            after = -(rest + c.stiffness * y + c.area * load[j]) / c.mass / square - slope * change[j] / square
            slope = slope + 0.5 * h * (curve + after)
            if y <= lift[0, j]:
                airborne = False
                events[count, 0], events[count, 1] = begun, j
                events[count, 2] = max(speed[j] * (lift[1, j] - slope), 0.0)
                count += 1
        if not airborne and not began_in_air:
            return count
    return -1
