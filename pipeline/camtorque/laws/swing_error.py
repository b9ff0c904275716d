"""What the errors of a wheel's swing do to the torque: the cam is elsewhere, and turns otherwise, than its teeth say.

A wheel tells each tooth to a few hundredths of a degree. On a steep flank that is a tenth of a newton metre, and in the
second derivative of orders of ten and more it is inertia torque of the cam: taken as exact, it is made up for by the
shaft's compliance and by friction. The alignment knows how large it may be (`camtorque.align.places`); one standard
deviation of each of its errors is one column here, as of the lift table in `camtorque.laws.lift`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from camtorque.laws import chamber
from camtorque.laws.chain import ON_CAM, ChainInput, ChainOutput, chamber_of, transfer
from camtorque.laws.torque import bin_restoring, bin_taps, binned_by, torque_columns, torque_tangents
from camtorque.records import Array


def swing_error_columns(
    data: ChainInput, output: ChainOutput, values: Mapping[str, float], coefficients: Array
) -> Array:
    """Return the measured torque of each error of a told swing, (bins, k) [N m].

    Parameters
    ----------
    output : the chain at these values
    coefficients : (17,) of `COLUMN_NAMES`
    """
    if data.swing is None or not data.swing.errors.size or not data.told_order:
        return np.zeros((data.bins, 0))
    first, second, third = np.ascontiguousarray(data.swing.told_errors(data.theta.size).transpose(0, 2, 1))
    moved = (first, second, third)
    motion = replace(output.motion, shifts=moved)
    _, pressed, *_ = chamber_of(data, values, motion, True, output.path)
    _, slopes, *_ = torque_columns(
        data.constants, values["guide_friction"], motion.theta, motion.lift, motion.rate, motion.second,
        output.pressure, coefficients[:ON_CAM], True,
    )  # fmt: skip
    bins = data.bins
    each, width = data.theta.size // bins, chamber.N + moved[0].shape[1] + 2
    shaft, measured, *_ = transfer(data, values, bins)
    restored = measured * (1.0 + values["gain_error"]) * bin_restoring(each, bins)
    spectrum = sum(
        np.fft.rfft(binned_by(torque_tangents(pressed, slope, *moved, data.speed, width), bin_taps(each), bins), axis=0)
        * way[:, None]
        for slope, way in zip(slopes, (shaft * restored, restored), strict=True)
    )
    return np.fft.irfft(spectrum[:, chamber.N : -2], bins, axis=0)
