"""What a report proposes to record next: a second tooth, or the same load at another speed.

Another speed is weighed as `camtorque plan` weighs it, as a run of `LASTS` that is fitted jointly. A second tooth is
that of the same recording made again: it tells the twist between both whatever laws and structure are, and with it how
far these are off where they disagree on the twist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.fitted import shift_variance
from camtorque.fit.known_fit import FittedAt, KnownFit, drawn_about
from camtorque.fit.planning import (
    STATED_OF_ALL,
    TOOTH,
    Measuring,
    Offer,
    OperatingPoint,
    TargetQuantity,
    information,
    known_beside,
    operating_point,
    tooth_shifts,
)
from camtorque.fit.problem import FitData
from camtorque.fit.single import Fit
from camtorque.fit.teeth import PLACE_STD
from camtorque.fit.uncertainty import inverse
from camtorque.process.second_process import in_two
from camtorque.records import Array, Refusal
from camtorque.units import RPM

SPEED_FACTORS = (0.6, 1.6)
LASTS = 20.0
"""Duration of a proposed run [s]."""
WORTH = 0.85
"""A proposal is told when it brings a standard uncertainty below this share of today's."""
Draws = Sequence[Array]
"""Values (k,) [SI] at which a run is looked at beside those of the fit."""
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
            texts.append(f"{title} would reduce today's uncertainty of {', '.join(told[:3])}")
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
    draws = tuple(drawn_about(known, fit.deviation))
    followed = partial(_followed, known, data, measuring)
    places: list[tuple[float, Draws]] = [(1.0, ()), *((factor, draws) for factor in SPEED_FACTORS)]
    own, *others = in_two(followed, places)
    if own is None:
        return []
    lasting = shift_variance({name: fit.shifts[name] for name in STATED_OF_ALL if name in fit.shifts}, len(names))
    before = known_beside(known, [Offer(own, seconds, False)], (), 2)
    result = []
    for factor, there in zip(SPEED_FACTORS, others, strict=True):
        if there is None:
            continue
        joint = inverse(before + information(Offer(there, LASTS, False), 2))
        after = np.array([
            TargetQuantity(unit, float(np.sqrt(lasting[k]))).expected(joint, apart=True)
            for k, unit in enumerate(np.eye(len(names)))
        ])  # fmt: skip
        rpm = factor * data.chain.speed / RPM
        result.append((f"the same load at {rpm:.0f} rpm, fitted jointly,", after))
    return result


def _followed(
    known: KnownFit, data: FitData, measuring: Measuring, place: tuple[float, Draws]
) -> OperatingPoint | None:
    """Return a recording's load at a factor of its speed, None where the torque runs away there."""
    factor, draws = place
    chain = replace(data.chain, speed=data.chain.speed * factor)
    try:
        return operating_point(known, chain, known.recordings[0], data.name, measuring, data.lift_basis, draws)
    except Refusal:
        return None
