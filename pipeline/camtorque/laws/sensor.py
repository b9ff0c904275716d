"""Sensor: gain and zero within the certificate, low-pass and delay of the torque transducer.

`align` takes the declared total delay off; here the low-pass acts with its own low-frequency delay removed, and the
small error of the declared delay is fitted under its prior. So the delay is counted once::

    H = exp(i w 2 zeta / w_c) / (1 - (w/w_c)^2 + 2 i zeta w/w_c) * exp(-i w d)

A low-pass of higher order has as many poles p_k as its sheet says, with x = w / (2 pi f_c)::

    H = exp(i x T) / prod_k (1 - i x / p_k) * exp(-i w d),   T = sum_k Re(-1 / p_k)

The damping ratio is that of the second-order filter of its kind: it leads the poles on straight lines from Butterworth
(0.71) to Bessel (0.87), all of them scaled so that the -3 dB frequency is f_c.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from camtorque.compiled import njit
from camtorque.laws.driveline import inverse
from camtorque.laws.rows import parameter
from camtorque.records import Array

BUTTERWORTH, BESSEL = math.sqrt(0.5), math.sqrt(0.75)
"""Damping ratios of second-order filters of these kinds."""
STEEP, STEEPEST = 3, 8
"""Order from which a low-pass has poles of its own here, and the highest: steeper ones are alike at what a fit sees."""
LEAST_DAMPING, MOST_DAMPING = 0.70, 0.90
"""Damping ratios of steep filters, which keep the poles of `STEEPEST` to the left."""

ROWS = (
    parameter("gain_error", "g_T", "%", 0.01, (0.0, -3.0, 3.0, 0.1), (0.0, 0.25),
            "relative error of the torque gain", "certificate, else accuracy as stated or assumed"),
    parameter("torque_zero", "T_0", "N m", 1.0, (0.0, -20.0, 20.0, 0.1), (0.0, 0.1),
            "error of the torque zero", "standstill readings, else tolerance as stated or assumed", "own"),
    parameter("delay_error", "d", "us", 1.0e-6, (0.0, -80.0, 80.0, 3.0), (0.0, 7.8),
            "total delay of the torque channel minus the declared one", "tolerance of the delay as stated or assumed"),
    parameter("cutoff", "f_c", "Hz", 1.0, (1000.0, 300.0, 5000.0, 50.0), (1000.0, 50.0),
            "-3 dB frequency of the transducer's low-pass", "data sheet; tolerance assumed 5 %"),
    parameter("filter_damping", "zeta", "-", 1.0, (0.707, 0.45, 1.1, 0.03), (0.75, 0.09),
            "kind of the low-pass, as its damping ratio at second order", "Butterworth 0.71, Bessel 0.87"),
)  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True)
def sensor_transfer(omega, cutoff_hz, damping, delay_error):  # type: ignore[no-untyped-def]
    """Return shaft torque -> measured torque, (m,), and its derivatives by cut-off, damping, delay (m, 3).

    ``cutoff_hz`` is the -3 dB frequency; the natural frequency follows from it and the damping ratio.
    """
    a = 1.0 - 2.0 * damping**2
    wide = np.sqrt(a * a + 1.0)
    ratio = np.sqrt(a + wide)  # corner / natural frequency for -3 dB
    natural = 2.0 * np.pi * cutoff_hz / ratio
    ratio_by_damping = -2.0 * damping * (1.0 + a / wide) / ratio
    transfer = np.empty(omega.size, dtype=np.complex128)
    derivatives = np.empty((omega.size, 3), dtype=np.complex128)
    for k in range(omega.size):
        x = omega[k] / natural
        over = inverse(1.0 - x * x + 2j * damping * x)
        turn = 2.0 * damping * x - omega[k] * delay_error
        transfer[k] = (np.cos(turn) + 1j * np.sin(turn)) * over
        by_x = transfer[k] * (2j * damping - (-2.0 * x + 2j * damping) * over)
        by_damping = transfer[k] * (2j * x - 2j * x * over)
        derivatives[k, 0] = by_x * (-x / cutoff_hz)
        derivatives[k, 1] = by_damping + by_x * (x * ratio_by_damping / ratio)
        derivatives[k, 2] = -1j * omega[k] * transfer[k]
    return transfer, derivatives


def low_pass(
    omega: Array, order: int, cutoff_hz: float, damping: float, delay_error: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return what `sensor_transfer` does for a low-pass of any order."""
    if order < STEEP:
        return sensor_transfer(omega, cutoff_hz, damping, delay_error)  # type: ignore[no-any-return]
    first, line, corner = poles_of(min(order, STEEPEST))
    apart = damping - BUTTERWORTH
    scale, slope = np.polyval(corner, apart), np.polyval(np.polyder(corner), apart)
    poles, way = (first + line * apart) * scale, line * scale + (first + line * apart) * slope
    x = omega / (2.0 * np.pi * cutoff_hz)
    over = 1.0 / (1.0 - 1j * x[:, None] / poles)
    delay, delay_by_damping = np.sum((-1.0 / poles).real), np.sum((way / poles**2).real)
    transfer = np.asarray(np.exp(1j * (x * delay - omega * delay_error)) * np.prod(over, axis=1), dtype=np.complex128)
    by_x = 1j * delay + over @ (1j / poles)
    by_damping = 1j * x * delay_by_damping - 1j * x * (over @ (way / poles**2))
    derivatives = np.stack([by_x * (-x / cutoff_hz), by_damping, -1j * omega], axis=1) * transfer[:, None]
    return transfer, np.asarray(derivatives, dtype=np.complex128)


@cache
def poles_of(order: int) -> tuple[NDArray[np.complex128], NDArray[np.complex128], Array]:
    """Return the poles of a Butterworth low-pass, and their way to Bessel ones per damping ratio; -3 dB at 1 rad/s.

    The last is a polynomial of the damping ratio less Butterworth's: what scales the poles between to -3 dB at 1 rad/s.

    Sources: Butterworth, Wireless Engineer 7 (1930); Thomson, Proc. IEE 96 (1949): the poles of a Bessel low-pass are
    the roots of the reverse Bessel polynomial.
    """
    turns = 0.5j * np.pi * (2.0 * np.arange(order) + order + 1.0) / order
    butterworth = np.asarray(np.exp(turns), dtype=np.complex128)
    powers = [
        math.factorial(2 * order - k) / (2 ** (order - k) * math.factorial(k) * math.factorial(order - k))
        for k in range(order, -1, -1)
    ]
    bessel = np.asarray(np.roots(powers), dtype=np.complex128)
    first, last = (poles[np.argsort(poles.imag)] for poles in (butterworth, bessel / _corner(bessel)))
    line = (last - first) / (BESSEL - BUTTERWORTH)
    apart = np.r_[np.linspace(LEAST_DAMPING, MOST_DAMPING, 27), BUTTERWORTH, BESSEL] - BUTTERWORTH
    scales = [*(1.0 / _corner(first + line * one) for one in apart[:-2]), 1.0, 1.0]
    exact = np.r_[np.ones(27), 1e6, 1e6]  # filters that sheets name
    return first, line, np.polyfit(apart, scales, 8, w=exact)


def _corner(poles: NDArray[np.complex128]) -> float:
    """Return the highest frequency at which a low-pass of these poles lets -3 dB through [rad/s]."""
    x = np.linspace(0.3, 4.0, 12001)
    size = np.prod(np.abs(1.0 - 1j * x[:, None] / poles), axis=1)
    last = int(np.flatnonzero(size < math.sqrt(2.0))[-1])
    return float(np.interp(math.sqrt(2.0), size[last : last + 2], x[last : last + 2]))
