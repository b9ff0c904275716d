"""Sensor: gain and zero within the certificate, low-pass and delay of the torque transducer.

`align` takes the declared total delay off; here the low-pass acts with its own low-frequency delay removed, and the
small error of the declared delay is fitted under its prior. So the delay is counted once::

    H = exp(i w 2 zeta / w_c) / (1 - (w/w_c)^2 + 2 i zeta w/w_c) * exp(-i w d)
"""

from __future__ import annotations

import numpy as np

from camtorque.compiled import njit
from camtorque.laws.driveline import inverse
from camtorque.laws.rows import parameter

ROWS = (
    parameter("gain_error", "g_T", "%", 0.01, (0.0, -3.0, 3.0, 0.1), (0.0, 0.25),
            "relative error of the torque gain", "certificate"),
    parameter("torque_zero", "T_0", "N m", 1.0, (0.0, -20.0, 20.0, 0.1), (0.0, 0.1),
            "error of the torque zero", "standstill readings, else tolerance of the sheet", "own"),
    parameter("delay_error", "d", "us", 1.0e-6, (0.0, -80.0, 80.0, 3.0), (0.0, 7.8),
            "total delay of the torque channel less the declared one", "tolerance of the sheet"),
    parameter("cutoff", "f_c", "Hz", 1.0, (1000.0, 300.0, 5000.0, 50.0), (1000.0, 50.0),
            "-3 dB frequency of the transducer's low-pass", "data sheet; tolerance assumed 5 %"),
    parameter("filter_damping", "zeta", "-", 1.0, (0.707, 0.45, 1.1, 0.03), (0.75, 0.09),
            "damping ratio of the second-order low-pass", "Butterworth 0.71, Bessel 0.87"),
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
