"""Torque on the cam from motion and chamber pressure, with all friction and damping, and its exact derivatives.

The closed form of `camtorque.mechanism.torque`, with the columns of the linear laws::

    lambda_y = (F_axial + F_extra) / (1 - mu_g |tan phi| sign(y'))     guide friction feeds back on the contact
    tau      = lambda_y (y' + arm) + T_extra

arm, F_extra and T_extra are the sums over `camtorque.laws.LINEAR_NAMES` of coefficient times column. What packing,
damping and the spring's errors push along the plunger lies on the cam, and bearings and pin rub under it: one product
of two coefficients, which is linearised about given ones. Here stand what is differentiated and how the columns join;
the mechanics and the laws themselves are called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from camtorque.compiled import njit
from camtorque.laws import LAWS, LINEAR_NAMES, ON_BRIDGE
from camtorque.laws.rows import At
from camtorque.mechanism.friction import guide_share, guide_share_by, sliding_sign, sliding_sign_by
from camtorque.mechanism.kinematics import path_at
from camtorque.mechanism.torque import axial_force
from camtorque.records import Array

LEAST_GUIDE = 0.05
"""Least 1 - mu |tan phi| sign(y') that is computed with; a fit on its way there is turned back by the torque."""
LOW_PASS, LOW_PASS_WINDOW = 0.55, 3.0
"""Low-pass of the bins: where it cuts, in cycles per bin, and the shape of its Kaiser window."""
_N = len(LINEAR_NAMES)
_SIDE = np.array(ON_BRIDGE, dtype=np.int64)


def _all_of(functions: Sequence[Callable[..., Any]]) -> Callable[..., Any]:
    """Return one compiled function that joins the tuples which all give."""
    if len(functions) == 1:
        return functions[0]
    middle = len(functions) // 2  # in halves: each joint copies what it joins, and all of it is compiled
    first, second = _all_of(functions[:middle]), _all_of(functions[middle:])
    return njit(error_model="numpy")(lambda at: (*first(at), *second(at)))


_columns_at = _all_of([law.columns for law in LAWS.values() if law.columns is not None])


@njit(cache=True, error_model="numpy", nogil=True)
def torque_columns(pump, mu, theta, lift, rate, second, pressure, coefficients, wanted):  # type: ignore[no-untyped-def]
    """Return torque, columns, derivatives and contact force over the angle.

    Parameters
    ----------
    pump : `camtorque.mechanism.torque.Constants`; its own friction, roller and cam inertia and weights are left out
    mu : friction coefficient of the guide
    theta : (n,) cam angle [rad]
    lift : (4, n) y, y', y'', y''' [m/rad^k]
    rate, second : (n,) cam speed and acceleration [rad/s, rad/s^2]
    pressure : (n,) on the plunger [Pa]
    coefficients : (k,) of `LINEAR_NAMES`, about which arm times F_extra is linearised
    wanted : whether derivatives are

    Returns
    -------
    torques : (n, 1 + k) what no column scales [N m], then per coefficient
    by : (2, 5, n) derivatives, by angle, rate, second, pressure and mu, of the torque with its coefficients and of what
        the bridge feels beside it; else (2, 5, 0)
    load : (n,) contact force along the follower without F_extra [N]
    least : least value of 1 - mu |tan phi| sign(y'); the follower jams at 0
    extra : (n,) force of the columns along the plunger, F_extra [N]
    """
    n = rate.size
    torques = np.empty((n, 1 + _N))
    by = np.empty((2, 5, n if wanted else 0))
    sums = np.empty((2, 9))
    load = np.empty(n)
    extra_force = np.empty(n)
    least = 1.0
    for i in range(n):
        y, y1, y2, y3 = lift[0, i], lift[1, i], lift[2, i], lift[3, i]
        w, dw, p = rate[i], second[i], pressure[i]
        height, tangent, lever, spin, spin_a, _ = path_at(y, y1, y2, pump.base, pump.offset, pump.radius)
        reach, reach_a = height * lever, -spin_a * pump.radius
        tangent_a = (y2 - tangent * y1) / height
        lever_a = (reach_a - lever * y1) / height
        spin_aa_top = y1 * y1 + height * y2 + y2 * y2 + (y1 - pump.offset) * y3 - reach_a * reach_a
        spin_aa = -spin_aa_top / (reach * pump.radius)
        share = guide_share(tangent, y1)
        guide, guide_a = 1.0 - mu * share, -mu * guide_share_by(tangent, tangent_a, y1, y2)
        least = min(least, guide)
        if guide < LEAST_GUIDE:
            guide, guide_a = LEAST_GUIDE, 0.0
        axial = axial_force(pump, 1.0, p, y2 * w * w + y1 * dw, y)
        axial_a = pump.stiffness * y1 + pump.mass * (y3 * w * w + y2 * dw)
        axial_w = 2.0 * pump.mass * y2 * w
        turn, turn_a = spin * dw + spin_a * w * w, spin_a * dw + spin_aa * w * w
        normal = axial / guide
        load[i] = normal
        torques[i, 0] = normal * y1
        at = At(
            y, y1, y2, w, p, sliding_sign(y1), sliding_sign_by(y1, y2), np.cos(theta[i]),
            np.sin(theta[i]), tangent, tangent_a, lever, lever_a, spin, spin_a,
            turn, turn_a, pump.stiffness, pump.preload, pump.area,
        )  # fmt: skip
        sums[:] = 0.0
        parts = _columns_at(at)
        for k in range(_N):
            part, row, c = parts[k], sums[_SIDE[k]], coefficients[k]
            row[0] += c * part.arm
            row[2] += c * part.force
            if not wanted:
                continue
            row[1] += c * part.arm_by_angle
            row[3] += c * part.force_by_angle
            row[4] += c * part.force_by_rate
            row[5] += c * part.force_by_pressure
            row[6] += c * part.torque_by_angle
            row[7] += c * part.torque_by_rate
            row[8] += c * part.torque_by_second
        arm_own, extra = sums[0, 0], sums[0, 2]
        extra_force[i] = extra
        torques[i, 0] -= extra * arm_own / guide
        for k in range(_N):
            part = parts[k]
            torques[i, 1 + k] = ((axial + extra) * part.arm + (y1 + arm_own) * part.force) / guide + part.torque
        if not wanted:
            continue
        force, force_a = axial + extra, axial_a + sums[0, 3]
        force_w, force_p = axial_w + sums[0, 4], pump.area + sums[0, 5]
        for side in range(2):
            own = 1.0 - side  # the cam's own torque is in the first alone
            arm, arm_a = own * y1 + sums[side, 0], own * y2 + sums[side, 1]
            top = force * arm
            top_a = force_a * arm + force * arm_a
            by[side, 0, i] = (top_a - top * guide_a / guide) / guide + sums[side, 6]
            by[side, 1, i] = force_w * arm / guide + sums[side, 7]
            by[side, 2, i] = pump.mass * y1 * arm / guide + sums[side, 8]
            by[side, 3, i] = force_p * arm / guide
            by[side, 4, i] = top * share / (guide * guide)
    return torques, by, load, least, extra_force


def cam_torque(*arguments: Any) -> tuple[Array, Array, Array, Array, float, Array]:
    """Return torque (n,), columns (n, k), and the rest of what `torque_columns` returns, to which the arguments go."""
    torques, *rest = torque_columns(*arguments)
    return torques[:, 0], torques[:, 1:], *rest


@cache
def bin_taps(each: int) -> Array:
    """Return the weights of fine points in a bin of ``each`` of them, (5 each,) or (1,): its mean behind a low-pass.

    A mean alone lets what is too fast for the bins through as something slow (of order 485 a quarter as order 115 of
    600 bins), and a shaft that rings there answers it twentyfold. Windowed sinc; Oppenheim & Schafer, Discrete-Time
    Signal Processing, ch. 7.
    """
    if each == 1:
        return np.ones(1)
    reach = np.arange(-2 * each, 2 * each + 1)
    low_pass = np.sinc(2.0 * LOW_PASS / each * reach) * np.kaiser(reach.size, LOW_PASS_WINDOW)
    return np.convolve(low_pass / np.sum(low_pass), np.full(each, 1.0 / each))


@cache
def bin_restoring(each: int, bins: int) -> Array:
    """Return what takes the low-pass of `bin_taps`, but not the mean, off the harmonics, (bins // 2 + 1,)."""
    turn = np.arange(bins // 2 + 1) * (2.0 * np.pi / (bins * each))
    taps = bin_taps(each)
    place = np.arange(taps.size) - 0.5 * (taps.size - 1)
    mean = np.ones_like(turn)
    mean[1:] = np.sin(0.5 * each * turn[1:]) / (each * np.sin(0.5 * turn[1:]))
    return np.asarray(mean / (np.cos(np.outer(turn, place)) @ taps))


@njit(cache=True, error_model="numpy", nogil=True)
def binned_by(fine, taps, bins):  # type: ignore[no-untyped-def]
    """Return periodic columns (n, k) on bins by the weights of `bin_taps`, (bins, k)."""
    n, k = fine.shape
    each = n // bins
    reach = (taps.size - each) // 2
    out = np.zeros((bins, k))
    for b in range(bins):
        row = out[b]
        for t in range(taps.size):
            weight, source = taps[t], fine[(each * b + t - reach) % n]
            for j in range(k):
                row[j] += weight * source[j]
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def torque_tangents(by_pressure, by, shifts, rates, seconds, speed, width):  # type: ignore[no-untyped-def]
    """Return the torque's derivatives by all that acts through pressure, cam angle and guide friction, (n, width).

    Parameters
    ----------
    by_pressure : (n, m) of the pressure on the plunger, the last k of them by parameters that move the cam angle
    by : (5, n) of `cam_torque`
    shifts, rates, seconds : (n, k) derivatives of the cam angle and of its first two angle derivatives
    speed : mean cam speed [rad/s]
    width : number of columns; the last but one is by the guide's friction
    """
    n, m = by_pressure.shape
    k = shifts.shape[1]
    out = np.zeros((n, width))
    for i in range(n):
        row = out[i]
        angle, rate, second = by[0, i], speed * by[1, i], speed * speed * by[2, i]
        for j in range(m):
            row[j] += by[3, i] * by_pressure[i, j]
        for j in range(k):
            row[m - k + j] += angle * shifts[i, j] + rate * rates[i, j] + second * seconds[i, j]
        row[width - 2] += by[4, i]
    return out
