"""Cam angle inside a revolution, rebuilt from the measured torque: what one pulse per revolution cannot see.

For the angle error budget, and for those who know the drive's inertia; the nominal alignment does not use it.
"""

from __future__ import annotations

import numpy as np

from camtorque.records import Array


def angle_correction(torque: Array, speed: float, trigger_angle: float, inertia: float) -> Array:
    """Return what has to be added to the nominal cam angle, which supposes constant speed between two pulses.

    The torque slows the drive:

        correction(theta) = c(theta) - c(trigger angle),  c = -1 / J  integral integral (T - mean T) dt dt

    with the double integral over a periodic torque taken harmonic by harmonic, T_k / (i k omega)^2.

    Parameters
    ----------
    torque : (n_theta,) delay-corrected torque at uniform nominal angles from 0, end point excluded [N m]
    speed : mean cam speed [rad/s]
    trigger_angle : nominal cam angle of the pulse, where the correction is zero [rad]
    inertia : of the drive's side, J [kg m^2]

    Returns
    -------
    (n_theta,) [rad]
    """
    harmonics = np.fft.rfft(torque)
    order = np.arange(harmonics.size)
    inverse_square = np.zeros(harmonics.size)
    inverse_square[1:] = 1.0 / (order[1:] * speed) ** 2
    correction = harmonics * inverse_square / inertia
    at_trigger = np.fft.irfft(correction * np.exp(1j * order * trigger_angle), torque.size)[0]
    return np.fft.irfft(correction, torque.size) - at_trigger
