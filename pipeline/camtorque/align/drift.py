"""What moves during a recording: torque and line pressure on the base circle, and the size of the torque.

The mean cycle has one level of each. A transducer that drifts, or a pump that still warms up, gives every cycle another
one, and what the fit then calls constant drag is half of that drift: that half is added to the zero's uncertainty.
A torque whose cycles grow beside what their line pressure does has a gain that drifts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.records import Array, Channel, Finding
from camtorque.signal.damage import converter_step
from camtorque.signal.threshold import Count, Threshold
from camtorque.stacks import products_of
from camtorque.units import short

FEWEST = Count(6, "cycles", "convention", "Cycles below which a drift cannot be told from their scatter.")
SIGNIFICANT = Threshold(3.0, "1", "statistics", "Standard errors that a drift has to exceed before it is reported.")

LEVEL_SHARE = {
    "torque": Threshold(
        0.005, "1", "simulated rigs", "Share of the peak torque by which its level may drift: sound runs reach 0.004."
    ),
    "pressure": Threshold(
        0.02, "1", "convention", "Share of the peak pressure by which the rest pressure of the line may drift."
    ),
}
SIZE_SHARE = Threshold(
    0.01, "1", "simulated rigs",
    "Share by which the cycles of the torque may grow beside what their line pressure does: sound runs reach 0.004."
)  # fmt: skip
STEP_SAMPLES = 1 << 18
"""Samples from which the step of a converter is taken."""


ADVICE = {
    "torque": "the transducer's zero drifts or the pump still warms up; drag and work of the mean cycle contain half "
    "of it; warm up before recording, and note the zero at standstill before and after",
    "pressure": "the load was not settled or the sensor drifts; the mean cycle is used for all; record once it is "
    "steady",
}
"""Quantity whose level drifts -> why it may and what to do."""


def level_drifts(idle: Any, rows: Mapping[str, tuple[Array, Array]], index: Any) -> dict[str, float]:
    """Return which levels drift, and by how much from the first to the last used cycle: quantity -> change [SI].

    Parameters
    ----------
    idle : points of the grid on the base circle
    rows : quantity -> (n_cycles, n_theta) and their mean (n_theta,), in SI
    index : (n_cycles,) cycle number
    """
    if index.size < FEWEST or not idle.size:
        return {}
    found = {}
    for quantity, (values, mean) in rows.items():
        share = np.zeros(values.shape[1])
        share[idle] = 1.0 / idle.size
        drift, stderr = _line(products_of(values, share), index)
        if abs(drift) >= max(SIGNIFICANT * stderr, LEVEL_SHARE[quantity] * float(np.max(mean))):
            found[quantity] = drift
    return found


def beyond_steps(drifts: Mapping[str, float], channels: Mapping[str, Channel]) -> dict[str, float]:
    """Leave out drifts of no more than a step of a converter so coarse that a resting channel repeats its samples.

    A level that moves by a hundredth of a step moves by a whole one where it crosses the border of two.
    """
    return {name: drift for name, drift in drifts.items() if abs(drift) > _coarse_step(channels[name])}


def _coarse_step(channel: Channel) -> float:
    """Return the step of a converter [SI], 0 where most neighbouring samples differ."""
    values = channel.read(0, min(channel.n_samples, STEP_SAMPLES))
    return converter_step(values) if np.count_nonzero(np.diff(values) == 0.0) > 0.5 * values.size else 0.0


def drift_findings(drifts: Mapping[str, float], peaks: Mapping[str, float]) -> tuple[Finding, ...]:
    """Return the findings on level drift; ``peaks``: quantity -> largest value of the mean cycle [SI]."""
    return tuple(
        Finding(
            f"{quantity}_drifts", "warning",
            f"the {quantity} on the base circle drifts by {'+' * (drift > 0.0)}{short(drift * kind.shown_factor)} "
            f"{kind.shown_unit} ({short(100.0 * abs(drift) / peaks[quantity], 2)} % of the peak) during the recording: "
            f"{ADVICE[quantity]}",
            quantity,
        )
        for quantity, drift in drifts.items()
        for kind in (CHANNEL_QUANTITIES[quantity],)
    )  # fmt: skip


def size_findings(torque: tuple[Array, Array], pressure: tuple[Array, Array], index: Any) -> tuple[Finding, ...]:
    """Tell a torque whose cycles grow or shrink beside what their line pressure does.

    Parameters
    ----------
    torque, pressure : (n_cycles, n_theta) and their mean (n_theta,), in SI
    index : (n_cycles,) cycle number
    """
    if index.size < FEWEST:
        return ()
    size, asked = (products_of(values, _shape(mean)) for values, mean in (torque, pressure))
    drift, stderr = _line(size, index, asked)
    if abs(drift) < max(SIGNIFICANT * stderr, SIZE_SHARE):
        return ()
    grown = f"{'+' * (drift > 0.0)}{short(100.0 * drift, 2)} %"
    text = (
        f"the torque of a cycle changes by {grown} during the recording, its line pressure does not: the gain of "
        "transducer or amplifier drifts, or friction does; the fitted mean cycle has the size of no single moment; "
        "warm up, check supply and plugs, record again"
    )
    return (Finding("torque_size_drifts", "warning", text, "torque"),)


def _shape(mean: Array) -> Array:
    """Return the weights whose sum over a cycle is its size over that of the mean, whatever its level."""
    swing = mean - np.mean(mean)
    square = float(np.sum(swing**2))
    return np.asarray(swing / square if square > 0.0 else swing)


def _line(level: Array, place: Any, *beside: Array) -> tuple[float, float]:
    """Return the change of a level from the first to the last cycle by a straight line, and its standard error.

    What the level follows ``beside`` the place, (n,) each, is taken off both.
    """
    columns = np.column_stack([np.ones(place.size), *beside])
    moved, rest = (values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0] for values in (place, level))
    square, span = float(np.sum(moved**2)), float(np.ptp(place))
    slope = float(moved @ rest) / square
    freedom = level.size - 1 - columns.shape[1]
    return slope * span, span * math.sqrt(float(np.sum((rest - slope * moved) ** 2)) / freedom / square)
