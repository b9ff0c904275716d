"""Chart 3: the periodic torque of one pump behind an elastic shaft, and the ways to integrate it.

Fixed steps in time, Gauss collocation in cam angle, harmonics, scipy's solvers. The drive end turns at Omega, theta is
the cam's angle, delta = theta - Omega t its lead (negative where it lags)::

    J(theta) omega' + c_2(theta) omega^2 + c_0(theta) + c_1(theta) p(theta) = T,   T = -k delta - c (omega - Omega)

with the four rows of the closed form. In cam angle d delta/d theta = 1 - Omega/omega, d omega/d theta = omega'/omega.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from camtorque.compiled import njit
from camtorque.laws.chain import filtered
from camtorque.laws.driveline import COUPLING_ROWS, ROWS, compliance, shaft_transfer
from camtorque.mechanism.elastic import ElasticShaft, solve_by_harmonics, solve_elastic
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.periodic import lobe_rows, solve_orbit
from camtorque.records import Array
from camtorque.studies.case import SPEED, knotted_law, peak_error, study_pressure, study_pump
from camtorque.studies.table import Chart, Choice, measured
from camtorque.units import TURN, angle_grid, closed

SCHEMES = ("explicit Euler", "symplectic Euler", "Heun", "RK4", "generalized-alpha 0.8", "generalized-alpha 1.0")
"""Fixed-step schemes, in the order of `march`."""


class Shaft(NamedTuple):
    """Stiffness [N m/rad], damping [N m s/rad] and drive speed [rad/s]."""

    stiffness: float = 4000.0
    damping: float = 0.5
    speed: float = SPEED


def load_rows(theta: Array) -> Array:
    """Return load at rest with pressure [N m], factor of omega^2 and inertia J, (3, n)."""
    return lobe_rows(PumpUnit(study_pump(), knotted_law()), study_pressure, theta)


TABLE, TURNS = 36000, 5


@njit(cache=True)
def _load(table, theta):  # type: ignore[no-untyped-def]
    """Cubic through four points of the 0.01 degree table: error below 1e-9 of the load."""
    n = table.shape[1]
    x = theta / TURN
    x = (x - np.floor(x)) * n
    i = int(x)
    f = x - i
    g, m, p = 1.0 - f, f + 1.0, 2.0 - f
    wa, wb, wc, wd = -f * g * p / 6.0, m * p * g / 2.0, m * p * f / 2.0, -f * g * m / 6.0
    a, b, c, d = (i - 1) % n, i % n, (i + 1) % n, (i + 2) % n
    rest = wa * table[0, a] + wb * table[0, b] + wc * table[0, c] + wd * table[0, d]
    square = wa * table[1, a] + wb * table[1, b] + wc * table[1, c] + wd * table[1, d]
    inertia = wa * table[2, a] + wb * table[2, b] + wc * table[2, c] + wd * table[2, d]
    return rest, square, inertia


@njit(cache=True)
def acceleration(table, shaft, time, lead, rate):  # type: ignore[no-untyped-def]
    """Second derivative of the lead at a time."""
    stiffness, damping, speed = shaft
    rest, square, inertia = _load(table, speed * time + lead)
    omega = speed + rate
    return (-stiffness * lead - damping * rate - rest - square * omega * omega) / inertia


@njit(cache=True)
def alpha_coefficients(rho):  # type: ignore[no-untyped-def]
    """Return alpha_m, alpha_f, beta, gamma of generalized-alpha (Chung & Hulbert 1993)."""
    mass, force = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + force - mass
    return mass, force, 0.25 * (gamma + 0.5) ** 2, gamma


@njit(cache=True)
def _alpha_step(table, shaft, time, h, lead, rate, change, auxiliary, rho):  # type: ignore[no-untyped-def]
    """One step of generalized-alpha (Chung & Hulbert 1993; Arnold & Bruls 2007), Newton by the linear stiffness."""
    am, af, beta, gamma = alpha_coefficients(rho)
    new, settled, count = change, False, 0
    while True:
        aux = ((1.0 - af) * new + af * change - am * auxiliary) / (1.0 - am)
        q = lead + h * rate + h * h * ((0.5 - beta) * auxiliary + beta * aux)
        v = rate + h * ((1.0 - gamma) * auxiliary + gamma * aux)
        if settled or count == 40:
            return q, v, new, aux
        _, _, inertia = _load(table, shaft[2] * (time + h) + q)
        residual = new - acceleration(table, shaft, time + h, q, v)
        scale = (1.0 - af) / (1.0 - am)
        slope = 1.0 + (shaft[0] * beta * h * h + shaft[1] * gamma * h) * scale / inertia
        new -= residual / slope
        settled, count = abs(residual) <= 1e-10 * (1.0 + abs(new)), count + 1


@njit(cache=True)
def march(table, shaft, scheme, steps, kept):  # type: ignore[no-untyped-def]
    """Integrate `TURNS` of ``steps`` steps from rest; ``kept`` (steps, 2) gets the last; False when it runs away."""
    h, lead, rate = TURN / shaft[2] / steps, 0.0, 0.0
    change = acceleration(table, shaft, 0.0, lead, rate)
    auxiliary = change
    for n in range(TURNS * steps):
        t, place = n * h, n - (TURNS - 1) * steps
        if place >= 0:
            kept[place, 0], kept[place, 1] = lead, rate
        a = acceleration(table, shaft, t, lead, rate)
        if scheme == 0:
            lead, rate = lead + h * rate, rate + h * a
        elif scheme == 1:
            rate = rate + h * a
            lead = lead + h * rate
        elif scheme == 2:
            q, v = lead + h * rate, rate + h * a
            b = acceleration(table, shaft, t + h, q, v)
            lead, rate = lead + 0.5 * h * (rate + v), rate + 0.5 * h * (a + b)
        elif scheme == 3:
            v2 = rate + 0.5 * h * a
            a2 = acceleration(table, shaft, t + 0.5 * h, lead + 0.5 * h * rate, v2)
            v3 = rate + 0.5 * h * a2
            a3 = acceleration(table, shaft, t + 0.5 * h, lead + 0.5 * h * v2, v3)
            v4 = rate + h * a3
            a4 = acceleration(table, shaft, t + h, lead + h * v3, v4)
            lead, rate = lead + h * (rate + 2 * v2 + 2 * v3 + v4) / 6.0, rate + h * (a + 2 * a2 + 2 * a3 + a4) / 6.0
        else:
            rho = 0.8 if scheme == 4 else 1.0
            lead, rate, change, auxiliary = _alpha_step(table, shaft, t, h, lead, rate, change, auxiliary, rho)
        if not abs(lead) < 10.0 or not abs(rate) < 100.0 * shaft[2]:
            return False
    return True


def march_periodic(table: Array, shaft: Shaft, scheme: str, steps: int) -> tuple[Array, Array, bool]:
    """Return cam angle (steps,), shaft torque (steps,) of the fifth turn from rest, and whether it stayed bounded."""
    kept = np.empty((steps, 2))
    bounded = bool(march(table, shaft, SCHEMES.index(scheme), steps, kept))
    lead, rate = kept.T
    return angle_grid(steps) + lead, -shaft.stiffness * lead - shaft.damping * rate, bounded


def collocation(shaft: Shaft, elements: int, stages: int) -> tuple[Array, Array, bool]:
    """Return stage angles, shaft torque there and success of the periodic solution by Gauss collocation in cam angle.

    Elements on the pieces of the law when their number is a multiple of 360; Newton on the state at the border of the
    revolution closes the period.
    """
    borders = np.linspace(0.0, TURN, elements + 1)
    orbit = solve_orbit(load_rows, borders, stages, (*shaft,))
    return orbit.theta, orbit.torque, orbit.closed


def alpha_accelerations(lift: Array, h: float, turns: int, rho: float, start: tuple[float, float]) -> Array:
    """Return the follower's acceleration over the last turn by generalized-alpha on the cut joint, index 3.

    The joint is kept in position, ``y_(n+1) = Y(theta_(n+1))``, at every step; velocity, auxiliary and true
    acceleration, and with it the multiplier, follow from the recursion (Arnold & Bruls 2007, Section 3).

    Parameters
    ----------
    lift : (n,) Y over one turn of even steps, starting at 0 [m]
    h : step [s]
    start : velocity and acceleration at the first step [m/s, m/s^2]
    """
    mass, force, beta, gamma = alpha_coefficients(rho)
    velocity, change = start
    auxiliary, found = change, np.empty(lift.size)
    for n in range(turns * lift.size):
        found[n % lift.size] = change
        step = lift[(n + 1) % lift.size] - lift[n % lift.size]
        aux = ((step - h * velocity) / h**2 - (0.5 - beta) * auxiliary) / beta
        change = ((1.0 - mass) * aux + mass * auxiliary - force * change) / (1.0 - force)
        velocity += h * ((1.0 - gamma) * auxiliary + gamma * aux)
        auxiliary = aux
    return found


REFERENCE_ELEMENTS, REFERENCE_STAGES = 3600, 6
CYCLES = 4
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)
LINEAR, PREDICT = "linear harmonic", "predict (elastic shaft)"
DEFAULTS = ((LINEAR, "720/rev"), (PREDICT, "3600/rev"))
"""What the fit's chain uses (3600 points in bins of 5), and what a prediction uses."""
Curve = tuple[Array, Array]


def at_angles(theta: Array, torque: Array, *_: bool, check: Array) -> Array:
    """Return torque at checking angles from samples of one turn (any increasing angles)."""
    order = np.argsort(np.mod(theta, TURN))
    angle, value = closed(np.mod(theta, TURN)[order], torque[order])
    return CubicSpline(angle, value, bc_type="periodic")(np.where(check < angle[0], check + TURN, check))


def harmonic(rows: Array, shaft: Shaft) -> Curve:
    """Return the driveline of the fit's chain: rigid torque through the shaft's transfer, linear, over drive angle.

    ``rows`` are those of `load_rows` on a uniform grid.
    """
    size = rows.shape[1]
    inertia = float(np.mean(rows[2]))
    omega = np.arange(size // 2 + 1) * shaft.speed
    resonance = float(np.sqrt(shaft.stiffness / inertia))
    values = {
        **{row.name: row.start for row in (*ROWS, *COUPLING_ROWS)}, "drive_admittance": 0.0,
        "shaft_compliance": 1.0 / shaft.stiffness, "shaft_resonance": resonance,
        "shaft_damping_ratio": 0.5 * shaft.damping * resonance / shaft.stiffness,
    }  # fmt: skip
    transfer, _ = shaft_transfer(omega, values, compliance(omega, values, False))
    return angle_grid(size), filtered(rows[0] + rows[1] * shaft.speed**2, transfer)


def elastic(shaft: Shaft, size: int, solve: Callable[..., ElasticShaft] = solve_elastic) -> Curve:
    """Return what a prediction uses, collocation read on a uniform grid of the drive's angle, over cam angle.

    ``solve_by_harmonics`` is the non-linear harmonic balance, which also solves several lobes.
    """
    theta, unit = angle_grid(size), PumpUnit(study_pump(), knotted_law())
    values = np.array([shaft.stiffness]), np.array([shaft.damping])
    found = solve([unit], study_pressure(theta)[None], shaft.speed, *values)
    return theta + found.twist[0], found.torque


def adaptive(
    table: Array, shaft: Shaft, method: str, tolerance: float, capped: bool = True
) -> tuple[Array, Array, bool]:
    """Return scipy's solution of the last of `CYCLES` turns from rest; ``capped`` limits the step to 5 degrees."""
    period, steps = TURN / shaft.speed, 3600
    times = (CYCLES - 1) * period + np.arange(steps) * (period / steps)
    found = solve_ivp(
        lambda t, state: [state[1], acceleration(table, shaft, t, *state)], (0.0, CYCLES * period), [0.0, 0.0],
        method=method, t_eval=times, rtol=tolerance, atol=[tolerance * 1e-2, tolerance * shaft.speed],
        max_step=period / 72 if capped else np.inf,
    )  # fmt: skip
    lead, rate = found.y
    return angle_grid(steps) + lead, -shaft.stiffness * lead - shaft.damping * rate, bool(found.success)


def _from_pump(solve: Callable[..., Any], *arguments: Any) -> Any:
    """Return a solution by an integrator from pump and lift law on, its load table included."""
    return solve(load_rows(angle_grid(TABLE)), *arguments)


def candidates(shaft: Shaft, quick: bool) -> dict[tuple[str, str], Callable[[], Any]]:
    """Return (method, setting) -> function that returns cam angle and torque first."""
    found: dict[tuple[str, str], Callable[[], Any]] = {}
    for size in (180, 360, 720, 1800, 3600):
        found[LINEAR, f"{size}/rev"] = partial(harmonic, load_rows(angle_grid(size)), shaft)
    for size in (360, 720, 1800, 3600):
        found["non-linear harmonic", f"{size}/rev"] = partial(elastic, shaft, size, solve_by_harmonics)
    found[PREDICT, "3600/rev"] = partial(elastic, shaft, 3600)
    for elements, place in ((360, "on"), (377, "off")):
        for stages in (1, 2, 3, 4, 6):
            name = f"collocation, {elements} elements {place} the knots"
            found[name, f"{stages} stages"] = partial(collocation, shaft, elements, stages)
    for scheme in ("RK4", "generalized-alpha 0.8"):
        for size in (720, 1800, 3600, 7200, 18000)[: 4 if quick else 5]:
            found[scheme, f"{size}/rev"] = partial(_from_pump, march_periodic, shaft, scheme, size)
    for method in ("DOP853", "Radau") if quick else ("RK45", "DOP853", "Radau", "BDF", "LSODA"):
        for tolerance in TOLERANCES[:2] if quick else TOLERANCES:
            found[f"scipy {method}", f"rtol {tolerance:g}"] = partial(_from_pump, adaptive, shaft, method, tolerance)
    return found


def driveline_chart(quick: bool) -> Chart:
    """Return torque error against time per periodic solution."""
    shaft, check = Shaft(), angle_grid(5003)
    reference = at_angles(*collocation(shaft, REFERENCE_ELEMENTS, REFERENCE_STAGES), check=check)
    choices = [
        Choice(*names, peak_error(at_angles(*run(), check=check), reference), run, default=names in DEFAULTS)
        for names, run in candidates(shaft, quick).items()
    ]
    points = measured(choices, 1 if quick else 4)
    note = (
        f"k = {shaft.stiffness:g} N m/rad, c = {shaft.damping:g} N m s/rad, 500 rpm; reference: collocation with "
        f"{REFERENCE_ELEMENTS} elements of {REFERENCE_STAGES} stages; integrators run five turns from rest, "
        "scipy four; times from pump and lift law on, but for the linear form, whose load the fit's chain has at hand"
    )
    return Chart(
        "driveline", "Periodic driveline", "torque error / peak", "time of one periodic solution [s]", points, note
    )
