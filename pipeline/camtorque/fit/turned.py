"""Mean cycles of two recordings against each other: the angle between them, and what of both is the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camtorque.records import Array

TURNS = 4
"""Gauss-Newton steps to the angle between two cycles from the best one of their grid."""
REACH = np.radians(8.0)
"""Angle within which one cycle is looked for in another: more than any two teeth are mounted apart."""
STANDS_OUT = 3.0
"""Standard errors beyond which a harmonic differs: noise alone does that in one of eight thousand."""


def at_angle(values: Array, angle: float) -> Array:
    """Return periodic columns read later by an angle, (n,) or (n, m) [rad]."""
    orders = np.arange(values.shape[0] // 2 + 1).reshape(-1, *[1] * (values.ndim - 1))
    turned = np.fft.rfft(values, axis=0) * np.exp(1j * orders * angle)
    return np.asarray(np.fft.irfft(turned, values.shape[0], axis=0))


def angle_between(one: Array, other: Array) -> float:
    """Return the angle by which one periodic signal (n,) has to be read later to be most like another [rad]."""
    spectrum, step = np.fft.rfft(one), 2.0 * np.pi / one.size
    orders, reach = np.arange(spectrum.size), round(REACH / step)
    # a shaft that rings has a next best angle each of its periods, where a descent from none would end
    alike = np.roll(np.fft.irfft(spectrum * np.conj(np.fft.rfft(other)), one.size), reach)[: 2 * reach + 1]
    angle = (int(np.argmax(alike)) - reach) * step
    for _ in range(TURNS):
        here = spectrum * np.exp(1j * orders * angle)
        slope, left = (np.fft.irfft(part, one.size) for part in (1j * orders * here, here))
        angle += float(slope @ (other - left)) / float(slope @ slope)
    return angle


def without_noise_apart(both: Sequence[Array], angle: float, cycles: Sequence[Array]) -> tuple[Array, Array]:
    """Return two mean cycles that differ where their cycles say so, and are their mean elsewhere, (n,) each.

    Both twist the shaft of the model. Noise that one has and the other has not would stand in measured torque and model
    alike, and a shaft soft enough to make both noises the same would explain the difference.

    Parameters
    ----------
    both : mean cycles, (n,) each; angle : by which the first has to be read later to be like the second [rad]
    cycles : of both, (n_cycles, n_theta) each, of the same unit
    """
    size = both[0].size
    one, two = np.fft.rfft(both[0]), np.fft.rfft(at_angle(both[1], -angle))
    variance = np.zeros(one.size)
    for each in cycles:
        known = np.var(np.fft.rfft(each, axis=1), axis=0, ddof=1)[: one.size] * (size / each.shape[1]) ** 2
        variance[: known.size] += known / each.shape[0]
    differs = np.abs(two - one) > STANDS_OUT * np.sqrt(variance)
    middle = 0.5 * (one + two)
    first, second = (np.fft.irfft(np.where(differs, side, middle), size) for side in (one, two))
    return np.asarray(first), at_angle(np.asarray(second), angle)
