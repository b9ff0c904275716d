"""Driveline: the shaft twists, the drive is not infinitely heavy, and the transducer sits between them.

The trigger sits on the camshaft, so the cam angle is known at its edge and only there. Between edges (DESIGN: the
correction enters once, here)::

    theta = theta_nominal + d_trigger + psi - psi(edge),   psi = -T/k_t - (1/J) iint (T - mean T) dt^2

with T the torque of the shaft, which the transducer measures. On the load's side, the inertia between transducer and
cam turns the load into shaft torque by the transfer function ``(k_t + i w c) / (k_t + i w c - w^2 I_c)``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.effects.rows import display
from pipeline.records import Array
from pipeline.units import DEGREE

ROWS = (
    display("trigger_offset", "d_trigger", "deg", DEGREE, (0.0, -4.0, 4.0, 0.1), (0.0, 0.866),
            "cam angle of the trigger edge less its nominal value", "installation tolerance of the sheet, rectangular"),
    display("shaft_compliance", "1/k_t", "urad/(N m)", 1.0e-6, (150.0, 0.0, 1500.0, 30.0), (150.0, 200.0),
            "twist per torque between drive and cam", "shafts of 20-30 mm: 2000-50000 N m/rad"),
    display("shaft_damping", "c_t", "N m s/rad", 1.0, (0.5, 0.0, 20.0, 0.3), (0.5, 1.0),
            "damping of the shaft's torsion", "assumed, 2-20 % of critical"),
    display("cam_side_inertia", "I_c", "kg mm^2", 1.0e-6, (50.0, 1.0, 5000.0, 10.0), None,
            "inertia between transducer and cam, camshaft included", "camshaft from the sheet; coupling unknown"),
    display("drive_admittance", "1/J", "1/(kg m^2)", 1.0, (0.0, 0.0, 60.0, 0.5), (0.0, 5.0),
            "inverse of the drive's inertia; 0 for a drive that holds its speed", "assumed: J above 0.1 kg m^2"),
)  # fmt: skip

TWIST_BANDWIDTH_HZ = 2500.0
"""Above this the measured torque holds no twist, only noise; a smooth roll-off of order 8."""


def angle_shifts(shaft_torque: Array, theta: Array, speed: float, trigger_angle: float) -> tuple[Array, Array, Array]:
    """Return the cam-angle shift per unit of trigger offset, compliance and drive admittance.

    Parameters
    ----------
    shaft_torque : (n,) mean cycle of the torque of the shaft [N m]
    theta : (n,) uniform nominal cam angle [rad]
    speed : [rad/s]
    trigger_angle : nominal cam angle of the edge, where the shift of twist and drive is zero [rad]

    Returns
    -------
    shift, rate, second : (n, 3) shift and its first and second derivative with respect to the nominal angle
    """
    n = theta.size
    harmonic = np.arange(n // 2 + 1)
    omega = harmonic * speed
    roll_off = 1.0 / np.sqrt(1.0 + (omega / (2.0 * np.pi * TWIST_BANDWIDTH_HZ)) ** 8)
    spectrum = np.fft.rfft(shaft_torque) * roll_off
    twist = -spectrum
    twist[0] = 0.0
    # double integral over time: divide by (i w)^2, hence the sign
    drive = np.where(harmonic > 0, spectrum / np.maximum(omega, 1e-12) ** 2, 0.0)
    parts = []
    for order in range(3):
        factor = (1j * harmonic) ** order
        parts.append(np.column_stack([np.fft.irfft(part * factor, n) for part in (twist, drive)]))
    at_edge = np.array([np.interp(trigger_angle, theta, parts[0][:, k], period=2.0 * np.pi) for k in range(2)])
    shift = np.column_stack([np.ones(n), parts[0] - at_edge])
    rate = np.column_stack([np.zeros(n), parts[1]])
    second = np.column_stack([np.zeros(n), parts[2]])
    return shift, rate, second


def shaft_transfer(
    omega: Array, compliance: float, damping: float, inertia: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return load torque -> shaft torque, (m,), and its derivatives by compliance, damping, inertia (m, 3).

    The equation is divided by the stiffness so that a rigid shaft (compliance 0) is an ordinary point.
    """
    numerator = 1.0 + 1j * omega * damping * compliance
    denominator = numerator - omega**2 * inertia * compliance
    transfer = numerator / denominator
    by_numerator = (denominator - numerator) / denominator**2
    by_compliance = by_numerator * 1j * omega * damping + numerator / denominator**2 * omega**2 * inertia
    by_damping = by_numerator * 1j * omega * compliance
    by_inertia = numerator / denominator**2 * omega**2 * compliance
    return transfer, np.column_stack([by_compliance, by_damping, by_inertia])
