"""Sensor: gain and zero within the certificate, low-pass and delay of the torque transducer.

`align` takes the declared total delay off; here the low-pass acts with its own low-frequency delay removed, and the
small error of the declared delay is fitted under its prior. So the delay is counted once::

    H = exp(i w 2 zeta / w_c) / (1 - (w/w_c)^2 + 2 i zeta w/w_c) * exp(-i w d)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camtorque.laws.rows import parameter
from camtorque.records import Array

ROWS = (
    parameter("gain_error", "g_T", "%", 0.01, (0.0, -3.0, 3.0, 0.1), (0.0, 0.25),
            "relative error of the torque gain", "certificate"),
    parameter("torque_zero", "T_0", "N m", 1.0, (0.0, -20.0, 20.0, 0.1), (0.0, 0.1),
            "error of the torque zero", "standstill readings, else tolerance of the sheet", "own"),
    parameter("delay_error", "d", "us", 1.0e-6, (0.0, -80.0, 80.0, 3.0), (0.0, 7.8),
            "total delay of the torque channel less the declared one", "tolerance of the sheet"),
    parameter("cutoff", "f_c", "Hz", 1.0, (1000.0, 300.0, 5000.0, 50.0), (1000.0, 50.0),
            "-3 dB frequency of the transducer's low-pass", "data sheet; tolerance assumed 5 %"),
    parameter("filter_damping", "zeta", "-", 1.0, (0.707, 0.45, 1.1, 0.03), (0.707, 0.05),
            "damping ratio of the second-order low-pass", "Butterworth assumed"),
)  # fmt: skip


def sensor_transfer(
    omega: Array, cutoff_hz: float, damping: float, delay_error: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return shaft torque -> measured torque, (m,), and its derivatives by cut-off, damping, delay (m, 3).

    ``cutoff_hz`` is the -3 dB frequency; the natural frequency follows from it and the damping ratio.
    """
    corner = 2.0 * np.pi * cutoff_hz
    a = 1.0 - 2.0 * damping**2
    ratio = np.sqrt(a + np.sqrt(a * a + 1.0))  # corner / natural frequency for -3 dB
    natural = corner / ratio
    x = omega / natural
    denominator = 1.0 - x**2 + 2j * damping * x
    transfer = np.exp(2j * damping * x - 1j * omega * delay_error) / denominator
    by_x = transfer * (2j * damping - (-2.0 * x + 2j * damping) / denominator)
    by_damping = transfer * (2j * x - 2j * x / denominator)
    ratio_by_damping = -2.0 * damping * (1.0 + a / np.sqrt(a * a + 1.0)) / ratio
    x_by_damping = x * ratio_by_damping / ratio
    derivatives = np.column_stack([by_x * (-x / cutoff_hz), by_damping + by_x * x_by_damping, -1j * omega * transfer])
    return transfer, derivatives
