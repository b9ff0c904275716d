"""What the errors of a wheel's swing do to the torque: the cam is elsewhere, and turns otherwise, than its teeth say.

A wheel tells each tooth to a few hundredths of a degree. On a steep flank that is a tenth of a newton metre, and in the
second derivative of orders of ten and more it is inertia torque of the cam: taken as exact, it is made up for by the
shaft's compliance and by friction. The alignment knows how large it may be (`camtorque.align.places`); one standard
deviation of each of its errors is one column here, as of the lift table in `camtorque.laws.lift`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.laws import chamber
from camtorque.laws.chain import BINS, ON_CAM, SHIFT_NAMES, ChainInput, ChainOutput, evaluate, transfer
from camtorque.laws.torque import bin_restoring, bin_taps, binned_by, torque_columns, torque_tangents
from camtorque.records import Array

OFFSET = chamber.N + SHIFT_NAMES.index("trigger_offset")


def swing_error_columns(
    data: ChainInput, output: ChainOutput, values: Mapping[str, float], coefficients: Array
) -> Array:
    """Return the measured torque of each error of a told swing, (BINS, k) [N m].

    The chamber answers to a cam that is ahead there as to one that is ahead everywhere: within the degrees in which it
    forgets, the errors are waves of low order.

    Parameters
    ----------
    output : the chain at these values
    coefficients : (17,) of `COLUMN_NAMES`
    """
    if data.swing is None or not data.swing.errors.size or not data.swing.order:
        return np.zeros((BINS, 0))
    at = evaluate(data, values, coefficients, tangents=True, known=output.path)
    assert at.pressure_tangents is not None
    motion = at.motion
    _, slopes, *_ = torque_columns(
        data.constants, values["guide_friction"], motion.theta, motion.lift, motion.rate, motion.second, at.pressure,
        coefficients[:ON_CAM], True,
    )  # fmt: skip
    moved = [np.ascontiguousarray(part.T) for part in data.swing.told_errors(data.theta.size)]
    pressed = at.pressure_tangents[:, OFFSET, None] * moved[0]
    each, count = data.theta.size // BINS, moved[0].shape[1]
    shaft, measured, *_ = transfer(data, values, BINS)
    restored = measured * (1.0 + values["gain_error"]) * bin_restoring(each, BINS)
    columns = (torque_tangents(pressed, slope, *moved, data.speed, count + 2)[:, :count] for slope in slopes)
    spectrum = sum(
        np.fft.rfft(binned_by(fine, bin_taps(each), BINS), axis=0) * way[:, None]
        for fine, way in zip(columns, (shaft * restored, restored), strict=True)
    )
    return np.fft.irfft(spectrum, BINS, axis=0)
