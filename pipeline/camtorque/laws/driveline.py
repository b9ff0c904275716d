"""Driveline: the shaft twists, the drive is not infinitely heavy, and the transducer sits between them.

The trigger sits on the camshaft, so the cam angle is known at its edge and only there. Between edges (DESIGN: the
correction enters once, here), with T the torque of the shaft, which the transducer measures, and s = i w::

    theta = theta_nominal + d_trigger + psi - psi(edge),   psi = -C(s) T
    C(s)  = 1/(k_t + c_t s) + (1/J) / (s^2 + 2 zeta w_d s + w_d^2)
                            + (1/k_c) w_c^2 / (s^2 + 2 zeta_c w_c s + w_c^2)

The first term is the shaft. The second is a drive of inertia J; an effect of its own (``controller``) holds its speed:
its proportional part is the damping ``2 zeta w_d = K_p / J``, its integral part the frequency ``w_d^2 = K_i / J``, and
w_d = 0 leaves the inertia alone. The third, an effect of its own as well (``coupling``), is a coupling half that swings
behind the transducer on a yielding coupling; far below w_c it is more compliance, so a shaft stiffness fitted without
it is wrong. The inertia between transducer and cam turns the load into shaft torque by ``1 / (1 + I_c s^2 C(s))``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camtorque.laws.rows import display
from camtorque.records import Array
from camtorque.units import DEGREE

ROWS = (
    display("trigger_offset", "d_trigger", "deg", DEGREE, (0.0, -4.0, 4.0, 0.1), (0.0, 0.866),
            "cam angle of the trigger edge less its nominal value", "installation tolerance of the sheet, rectangular"),
    display("shaft_compliance", "1/k_t", "urad/(N m)", 1.0e-6, (150.0, 0.0, 1500.0, 30.0), (150.0, 200.0),
            "twist per torque between drive and cam", "shafts of 20-30 mm: 2000-50000 N m/rad"),
    display("shaft_damping", "c_t", "N m s/rad", 1.0, (0.5, 0.0, 20.0, 0.3), (0.5, 1.0),
            "damping of the shaft's torsion", "assumed, 2-20 % of critical"),
    display("cam_side_inertia", "I_c", "kg mm^2", 1.0e-6, (50.0, 1.0, 5000.0, 10.0), None,
            "inertia between transducer and cam, camshaft included", "camshaft from the sheet; coupling unknown"),
    display("drive_admittance", "1/J", "1/(kg m^2)", 1.0, (1.0, 0.0, 60.0, 0.5), (0.0, 5.0),
            "inverse of the drive's inertia; 0 for a drive that holds its speed", "assumed: J above 0.1 kg m^2"),
)  # fmt: skip

CONTROLLER_ROWS = (
    display("drive_frequency", "w_d", "Hz", 2.0 * np.pi, (5.0, 0.0, 60.0, 1.0), (0.0, 10.0),
            "frequency at which the drive swings on its speed controller", "bandwidths of drive controllers: 1-30 Hz"),
    display("drive_damping", "zeta", "-", 1.0, (0.7, 0.3, 3.0, 0.1), (0.7, 0.2),
            "damping ratio of that swing", "controllers are tuned to 0.5-1"),
)  # fmt: skip

COUPLING_ROWS = (
    display("coupling_compliance", "1/k_c", "urad/(N m)", 1.0e-6, (0.0, 0.0, 2000.0, 30.0), (0.0, 200.0),
            "compliance of the coupling behind the transducer", "catalogues of elastic couplings: 1000-50000 N m/rad"),
    display("coupling_resonance", "w_c", "Hz", 2.0 * np.pi, (120.0, 20.0, 600.0, 5.0), (120.0, 80.0),
            "frequency at which the coupling half behind the transducer swings", "1-10 g m^2 on such a coupling"),
    display("coupling_damping", "zeta_c", "-", 1.0, (0.1, 0.01, 1.5, 0.03), (0.1, 0.1),
            "damping ratio of that motion", "elastomer couplings: 0.05-0.15"),
)  # fmt: skip

TWIST_BANDWIDTH_HZ = 2500.0
"""Above this the measured torque holds no twist, only noise; a smooth roll-off of order 8."""


@dataclass(frozen=True)
class TwistBasis:
    """What the measured torque says about the cam angle, before stiffness and drive are known.

    Attributes
    ----------
    spectrum : (n/2 + 1,) harmonics of the shaft's torque, noise rolled off
    omega : (n/2 + 1,) their angular frequencies [rad/s]
    edge : cam angle of the trigger edge, where the shift is zero [rad]
    n_theta : points of the grid
    """

    spectrum: NDArray[np.complex128]
    omega: Array
    edge: float
    n_theta: int


def twist_basis(shaft_torque: Array, speed: float, trigger_angle: float) -> TwistBasis:
    """Return the basis of a mean cycle of the shaft's torque (n,) [N m] at a speed [rad/s]."""
    omega = np.asarray(np.arange(shaft_torque.size // 2 + 1) * speed, dtype=np.float64)
    roll_off = 1.0 / np.sqrt(1.0 + (omega / (2.0 * np.pi * TWIST_BANDWIDTH_HZ)) ** 8)
    spectrum = np.fft.rfft(shaft_torque) * roll_off
    spectrum[0] = 0.0
    return TwistBasis(spectrum, omega, trigger_angle, shaft_torque.size)


COMPLIANCE_NAMES = (
    "shaft_compliance", "shaft_damping", "drive_admittance", "drive_frequency", "drive_damping", "coupling_compliance",
    "coupling_resonance", "coupling_damping",
)  # fmt: skip
"""Parameters of C(s), in the order of its derivatives."""


def compliance(omega: Array, values: Mapping[str, float]) -> tuple[Any, Any]:
    """Return C(s) on harmonics (k,) [rad/(N m)] and its derivatives by `COMPLIANCE_NAMES` (k, 8).

    The mean torque turns nothing that a trigger on the camshaft could see: the drive's term is zero at w = 0.
    """
    shaft, damping, admittance, drive, drive_ratio, soft, resonance, ratio = (values[n] for n in COMPLIANCE_NAMES)
    s = 1j * omega
    slowed = 1.0 + s * damping * shaft
    yielding, by_drive, by_drive_ratio = _swing(s, drive, drive_ratio)
    response, by_resonance, by_ratio = _swing(s, resonance, ratio)
    total = shaft / slowed + admittance * yielding + soft * resonance**2 * response
    derivatives = (
        1.0 / slowed**2, -s * shaft**2 / slowed**2, yielding, admittance * by_drive, admittance * by_drive_ratio,
        resonance**2 * response, soft * (2.0 * resonance * response + resonance**2 * by_resonance),
        soft * resonance**2 * by_ratio,
    )  # fmt: skip
    return total, np.column_stack(derivatives)


def _swing(s: Any, frequency: float, ratio: float) -> tuple[Any, Any, Any]:
    """Return ``1 / (s^2 + 2 zeta w s + w^2)``, zero at s = 0, and its derivatives by w and zeta."""
    swing = s**2 + 2.0 * ratio * frequency * s + frequency**2
    response = np.where(s != 0.0, 1.0 / np.where(s != 0.0, swing, 1.0), 0.0)
    by_frequency = -2.0 * (ratio * s + frequency) * response**2
    return response, by_frequency, -2.0 * frequency * s * response**2


def angle_shifts(basis: TwistBasis, values: Mapping[str, float]) -> tuple[Array, Array, Array]:
    """Return psi - psi(edge) and its derivatives by `COMPLIANCE_NAMES`, with their first two angle derivatives.

    Returns
    -------
    shift, rate, second : (n, 9) each; column 0 the shift itself, then its derivatives by the parameters
    """
    total, derivatives = compliance(basis.omega, values)
    spectrum = -basis.spectrum[:, None] * np.column_stack([total, derivatives])
    harmonic = np.arange(basis.omega.size)[:, None]
    shift, rate, second = (np.fft.irfft(spectrum * (1j * harmonic) ** k, basis.n_theta, axis=0) for k in range(3))
    phase = np.exp(1j * harmonic * basis.edge)
    phase[1:] *= 2.0
    at_edge = np.real(np.sum(spectrum * phase, axis=0)) / basis.n_theta
    return shift - at_edge, rate, second


def shaft_transfer(omega: Array, inertia: float, values: Mapping[str, float]) -> tuple[Any, Any]:
    """Return load torque -> shaft torque (k,), and its derivatives by inertia, then `COMPLIANCE_NAMES` (k, 9)."""
    total, derivatives = compliance(omega, values)
    square = -(omega**2)
    transfer = 1.0 / (1.0 + inertia * square * total)
    factor = -(transfer**2) * square
    return transfer, np.column_stack([factor * total, (factor * inertia)[:, None] * derivatives])
