"""A line pressure that was typed or exported: what lies between its points, and how well that is known."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from camtorque.config.pump import PressureCurve
from camtorque.fit.known_ends import Curve
from camtorque.fit.prepare import FIT_GRID
from camtorque.mechanism.predict import pressure_at
from camtorque.records import Array, Refusal
from camtorque.units import BAR, DEGREE, TURN

LOADED = 0.1
"""Share of the highest line pressure above which the points of a file matter."""
SLIP = 8.0
"""Factor between the highest pressure of a file and those of fitted recordings: MPa for bar is 10."""
BETWEEN = 0.5
"""What is missed between points as a share of what is missed where every second one is left out; 0.3 to 0.9 of it was
seen on recordings thinned to 1 to 3 degrees."""
MOST_GUESSED = 0.1
"""Uncertainty between the points, as a share of the highest pressure, above which a file is refused."""
RISEN = 0.25
"""Share of its swing at which a line pressure has begun to rise: within a campaign at angles that are 1 to 4 degrees
apart."""
BELOW = 0.8
"""A chamber that stays below this share of the line pressure cannot have made it."""
WIDEST_STEP = np.radians(6.0) * (1.0 + 1e-9)
"""Distance of points under load above which nothing tells what the points missed."""


def curve_through(file: PressureCurve, name: str) -> Curve:
    """Return the line pressure of a file's points on the grid of a fit, with how well; its speed is not known (nan).

    Raises
    ------
    Refusal : no pressure, or so few points that what lies between them is a guess
    """
    theta = np.arange(FIT_GRID) * TURN / FIT_GRID
    top = float(np.max(file.pressure))
    if top <= 0.0:
        raise Refusal(
            f"{name}: found no pressure above 0 bar, expected that of a delivery; give the line pressure, gauge"
        )
    loaded = np.maximum(file.pressure, np.roll(file.pressure, -1)) > LOADED * top
    step = float(np.max(np.diff(file.theta, append=file.theta[0] + TURN)[loaded], initial=0.0))
    known = between_points(file)
    worst = float(np.sqrt(np.mean(np.square(known[file.pressure > LOADED * top])))) / top
    if worst > MOST_GUESSED or step > WIDEST_STEP:
        found = f"points {step / DEGREE:.2g} deg apart under load"
        expected = f"{WIDEST_STEP / DEGREE:.2g} deg or closer"
        if step <= WIDEST_STEP:
            found += f", between which the pressure is known to {100.0 * worst:.0f} % of its highest only"
            expected = f"{100.0 * MOST_GUESSED:.0f} % or better"
        raise Refusal(
            f"{name}: found {found}, expected {expected}; give a point every half degree, or name the recording itself "
            "with --load-of"
        )
    std = np.interp(theta, file.theta, known, period=TURN)
    return Curve(theta, pressure_at(file, theta), float("nan"), step, file.theta, std)


def refuse_other_load(curve: Curve, fitted: Iterable[Curve], name: str) -> None:
    """Refuse a file whose highest pressure is so far from those of the fitted recordings that its unit is another."""
    top, (low, high) = float(np.max(curve.pressure)), top_range(fitted)
    if not low / SLIP < top < SLIP * high:
        raise Refusal(
            f"{name}: found a highest pressure of {top / BAR:.3g} bar, where the fitted recordings have "
            f"{low / BAR:.4g} to {high / BAR:.4g} bar, expected less than a factor of {SLIP:g} between them; check the "
            "unit (bar, gauge)"
        )


def top_range(fitted: Iterable[Curve]) -> tuple[float, float]:
    """Return the least and the greatest of the highest line pressures of fitted recordings [Pa]."""
    tops = [float(np.max(one.pressure)) for one in fitted]
    return min(tops), max(tops)


def rise_angle(curve: Curve) -> float:
    """Return the cam angle at which a line pressure begins its rise to the highest value [rad], nan of a steady one."""
    pressure = np.roll(curve.pressure, -int(np.argmax(curve.pressure)))
    low = float(np.min(pressure))
    if float(pressure[0]) - low < LOADED * float(pressure[0]):
        return float("nan")
    below = np.flatnonzero(pressure < low + RISEN * (float(pressure[0]) - low))
    return float(np.roll(curve.theta, -int(np.argmax(curve.pressure)))[below[-1]])


def rise_range(fitted: Iterable[Curve]) -> tuple[float, float]:
    """Return the least and the greatest cam angle at which line pressures of fitted recordings rise [rad].

    Both lie within half a turn of the first; nan where all are steady.
    """
    angles = np.array([angle for angle in map(rise_angle, fitted) if np.isfinite(angle)])
    if not angles.size:
        return float("nan"), float("nan")
    apart = np.remainder(angles - angles[0] + np.pi, TURN) - np.pi
    return float(angles[0] + np.min(apart)), float(angles[0] + np.max(apart))


def refuse_below_line(curve: Curve, chamber: Array, name: str) -> None:
    """Refuse a line pressure that the plunger does not make: the chamber's (n,) stays below it [Pa]."""
    top, made = float(np.max(curve.pressure)), float(np.max(chamber))
    if made < BELOW * top:
        raise Refusal(
            f"{name}: with a line pressure of up to {top / BAR:.4g} bar at these angles the chamber reaches "
            f"{made / BAR:.4g} bar only, expected more than the line; its cam angle has to count as that of the lift "
            "table does, or it is the load of another pump"
        )


def between_points(file: PressureCurve) -> Array:
    """Return the standard uncertainty of the pressure between the points of a file, at each of them, (k,) [Pa].

    Every second point is left out and looked for between the others; half of what is missed then, among neighbours, is
    what is missed between points twice as close.
    """
    missed = np.zeros(file.theta.size)
    for first in (0, 1):
        left = np.arange(file.theta.size) % 2 == first
        others = PressureCurve(file.theta[~left], file.pressure[~left])
        missed[left] = file.pressure[left] - pressure_at(others, file.theta[left])
    near = np.convolve(np.pad(missed**2, 2, mode="wrap"), np.ones(5) / 5.0, mode="valid")
    return np.asarray(BETWEEN * np.sqrt(near))
