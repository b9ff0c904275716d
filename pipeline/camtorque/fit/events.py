"""Where the line pressure shows the end of delivery: needed to predict a recording that nothing was fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import find_peaks

from camtorque.fit.problem import FitData, Problem
from camtorque.fit.solve import Solution

PROMINENCE = 0.03
"""Least fall of the line pressure behind a peak, as a share of its range, that counts as an end of delivery."""


def delivery_event(data: FitData) -> float:
    """Return the cam angle of the first peak of the line pressure that is followed by a real fall [rad].

    The highest peak may be a later, reflected one; the first prominent one is where the flow stopped.
    """
    pressure = data.chain.line_pressure
    peaks, _ = find_peaks(pressure, prominence=PROMINENCE * np.ptp(pressure))
    high = peaks[pressure[peaks] > np.min(pressure) + 0.5 * np.ptp(pressure)]
    index = high[0] if high.size else int(np.argmax(pressure))
    return float(data.chain.theta[index])


def predicted_end(problem: Problem, solution: Solution, item: FitData) -> dict[str, float]:
    """Return the end of delivery of a left-out recording from its line pressure and the others' fitted ends.

    The lag of the end behind the event grows with the speed (closing time, wave travel): a straight line over the
    others' speeds, their mean where there are fewer than three. A spill run, whose lift no other run teaches, spills at
    its event.
    """
    event = delivery_event(item)
    if item.delivery == "spill":
        return {"spill_lift": float(item.chain.law.evaluate(np.array([event]), 0)[0])}
    speeds, lags = _lags(problem, solution)
    if not lags:
        return {"end_of_delivery": event}
    if len(lags) < 3:
        return {"end_of_delivery": event + float(np.mean(lags))}
    slope, intercept = np.polyfit(speeds, lags, 1)
    return {"end_of_delivery": event + float(intercept + slope * item.chain.speed)}


def _lags(problem: Problem, solution: Solution) -> tuple[Sequence[float], Sequence[float]]:
    speeds, lags = [], []
    for slot, value in zip(problem.nonlinear, solution.x, strict=True):
        if slot.row.name == "end_of_delivery":
            data = problem.data[max(slot.recording, 0)]
            speeds.append(data.chain.speed)
            lags.append(float(value) - delivery_event(data))
    return speeds, lags
