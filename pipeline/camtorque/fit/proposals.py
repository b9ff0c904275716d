"""What a report proposes to record next: a second tooth, or the same load at another speed.

Another speed is weighed as `camtorque plan` weighs it, as a run of `LASTS` that is fitted jointly. A second tooth is
that of the same recording made again: it tells the twist between both whatever laws and structure are, and with it how
far these are off where they disagree on the twist.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.known_fit import FittedAt, KnownFit, drawn_about
from camtorque.fit.planning import (
    STATED_OF_ALL,
    TOOTH,
    Measuring,
    Offer,
    TargetQuantity,
    information,
    known_beside,
    operating_point,
    tooth_shifts,
)
from camtorque.fit.single import Fit, shift_variance
from camtorque.fit.teeth import PLACE_STD
from camtorque.fit.uncertainty import inverse
from camtorque.records import Array, Refusal

SPEED_FACTORS = (0.6, 1.6)
LASTS = 20.0
"""Duration of a proposed run [s]."""
WORTH = 0.85
"""A proposal is told when it brings a standard uncertainty below this share of today's."""
OUTCOMES = ("trigger_offset", "dead_volume", "leakage", "bearing_arm", "shaft_compliance", "shaft_viscous")


def next_measurement(fit: Fit, measuring: Measuring, seconds: float, has_teeth: bool = False) -> tuple[str, ...]:
    """Return proposals for the next recording, each with what it is expected to bring.

    Parameters
    ----------
    measuring : how well the recording was measured
    seconds : how long its used cycles last
    has_teeth : more than one pulse tells a turn of the cam already, or its angle was recorded
    """
    names, today = fit.problem.names, fit.std
    watched = [name for name in OUTCOMES if name in names]
    expected = [] if has_teeth else [(TOOTH, with_tooth(fit))]
    expected += at_other_speeds(fit, measuring, seconds)
    texts = []
    for title, after in expected:
        gains = sorted((float(after[names.index(name)] / today[names.index(name)]), name) for name in watched)
        told = [f"{name.replace('_', ' ')} to {100.0 * share:.0f} %" for share, name in gains if share < WORTH]
        if told:
            texts.append(f"{title} would reduce the uncertainty of {', '.join(told[:3])} of the present one")
    return tuple(texts)


def with_tooth(fit: Fit) -> Array:
    """Return the standard uncertainties expected of the recording with a second tooth, (k,) [SI]."""
    turned = tooth_shifts(fit.problem.data[0].chain, fit.solution.output)
    row = np.array([turned.get(parameter.row.name, 0.0) for parameter in fit.problem.parameters])
    spread = sum((rows.T @ rows for rows in fit.shifts.values()), np.zeros_like(fit.deviation))
    told = inverse(fit.deviation + spread) + np.outer(row, row) / PLACE_STD**2
    return np.asarray(np.sqrt(np.diag(inverse(told))))


def at_other_speeds(fit: Fit, measuring: Measuring, seconds: float) -> list[tuple[str, Array]]:
    """Return what is expected of a joint fit with a run at another speed, (k,) [SI]."""
    data, names = fit.problem.data[0], fit.problem.names
    source = FittedAt(data.name, data.chain.speed, data.structure, 0.0, False)
    known = KnownFit(names, fit.solution.z, ArrowCovariance.whole(fit.deviation), (source,))
    lasting = shift_variance({name: fit.shifts[name] for name in STATED_OF_ALL if name in fit.shifts}, len(names))
    result = []
    for factor in SPEED_FACTORS:
        chain = replace(data.chain, speed=data.chain.speed * factor)
        try:
            own, there = (
                operating_point(known, at, source, data.name, measuring, data.lift_basis, drawn)
                for at, drawn in ((data.chain, ()), (chain, tuple(drawn_about(known, fit.deviation))))
            )
        except Refusal:
            continue  # the torque runs away there
        told = information(Offer(there, LASTS, False), 2)
        joint = inverse(known_beside(known, [Offer(own, seconds, False)], (), 2) + told)
        after = np.array([
            TargetQuantity(unit, float(np.sqrt(lasting[k]))).expected(joint, apart=True)
            for k, unit in enumerate(np.eye(len(names)))
        ])  # fmt: skip
        result.append((f"the same load at {chain.speed * 30.0 / np.pi:.0f} rpm, fitted jointly,", after))
    return result
