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
FOLLOWS = (0.5, 1.5)
"""Share of its pressure's change by which a torque may change under another load: springs and friction do not."""
CHANGED_SHARE = Threshold(
    0.05, "1", "simulated rigs",
    "Share by which the torque's size may differ between fifths of a recording: sound runs reach 0.028."
)  # fmt: skip
SCATTERED_SHARE = Threshold(
    0.08, "1", "simulated rigs", "Share within which nine of ten cycles' torque has its size: sound runs reach 0.049."
)
FIFTHS = 5
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
    size, asked = (sizes(*rows) for rows in (torque, pressure))
    drift, stderr = _line(size, index, asked)
    alone, load = (_line(values, index)[0] for values in (size, asked))
    beside = np.array([alone - share * load for share in FOLLOWS])
    # where both change along a line, the regression tells them apart by their scatter
    is_load = beside[0] * beside[1] <= 0.0 or float(np.min(np.abs(beside))) < SIZE_SHARE
    if is_load or abs(drift) < max(SIGNIFICANT * stderr, SIZE_SHARE):
        return ()
    text = (
        f"the torque of a cycle changes by {_percent(alone)} during the recording, its line pressure by "
        f"{_percent(load)}: the gain of transducer or amplifier drifts, or friction does; the fitted mean cycle has "
        "the size of no single moment; warm up, check supply and plugs, record again"
    )
    return (Finding("torque_size_drifts", "warning", text, "torque"),)


def changed_load(torque: tuple[Array, Array]) -> tuple[Finding, ...]:
    """Tell cycles of several loads in one recording: their mean is of no moment that was.

    Parameters
    ----------
    torque : (n_cycles, n_theta) and their mean (n_theta,) [N m]
    """
    size = sizes(*torque)
    if size.size < 2 * FIFTHS:
        return ()
    along = [float(np.median(part)) for part in np.array_split(size, FIFTHS)]
    low, high = (float(value) for value in np.quantile(size, (0.05, 0.95)))
    every_other = float(np.median(size[::2]) - np.median(size[1::2]))
    if abs(every_other) > CHANGED_SHARE:
        how = f"every other cycle by {short(100.0 * abs(every_other), 2)} %: record where the pump runs evenly"
    elif np.ptp(along) > CHANGED_SHARE:
        parts = ", ".join(short(100.0 * part, 3) for part in along)
        how = f"from one fifth of the recording to the next ({parts} %): cut the logs, one load in each"
    elif high - low > SCATTERED_SHARE:
        how = "from cycle to cycle: record once the load is steady"
    else:
        return ()
    text = (
        f"nine of ten cycles have {short(100.0 * low, 3)} to {short(100.0 * high, 3)} % of the torque of their mean, "
        f"which is fitted and is of no moment that was; it changes {how}"
    )
    return (Finding("load_changes", "warning", text, "torque"),)


def sizes(values: Array, mean: Array) -> Array:
    """Return how large each cycle (n_cycles, n_theta) is beside their mean (n_theta,), whatever its level."""
    return products_of(values, _shape(mean))


def _percent(share: float) -> str:
    return f"{'+' * (share > 0.0)}{short(100.0 * share, 2)} %"


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
