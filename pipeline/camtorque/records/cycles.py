"""What `align` hands on: cycles over cam angle, which were cut, clocks, and how sure the angle is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from camtorque.records.base import Array, Estimate, Finding, Mask, ReadOnly
from camtorque.stacks import mean_of, std_of

DEVIATION, LEAD = "angle_deviation", "angle_lead"
"""Details of an alignment by a wheel: how far the cam is ahead of even running, as waves and as it was interpolated."""
DEVIATION_ERRORS = "angle_deviation_errors"
"""And what the waves may be off by, as harmonics."""

ORDERS_TOLD = "wheel_orders"
"""Detail of a fit: orders of the waves that the model has from the wheel; above them the driveline's law holds."""
TEETH = "angle_teeth"
"""And when each tooth passes, (t, 2): in even angle since the pulse of the nominal angle, and how much less that is
than its place on a perfect wheel [rad]."""
PASSED = "angle_passed"
"""Detail of an alignment by two or three pulses a turn, (t, 3) of each but the first: how much later it passes in even
angle, how much less that is than its place on the wheel, standard error of both [rad]."""


@dataclass(frozen=True)
class CutFlowRow:
    """One line of the cut-flow: cycles that fail this cut alone, and those left after it and all before it."""

    reason: str
    cycles: int
    text: str
    cycles_single: int = 0
    cycles_left: int = 0


@dataclass(frozen=True)
class ClockFit:
    """Clock of a logger against that of the torque's logger: t_logger = offset + (1 + skew) t [s, ppm]."""

    logger: str
    offset_s: float
    skew_ppm: float
    stderr_s: float
    method: str = "same clock"


@dataclass(frozen=True)
class AngleError:
    """One source of the angle error budget, before the fit."""

    source: str
    std_deg: float
    text: str = ""


@dataclass(frozen=True, repr=False)
class CamCycles(ReadOnly):
    """Cycles on one cam-angle grid with nominal alignment (declared delays off, nominal trigger angle).

    Attributes
    ----------
    theta : (n_theta,) uniform from 0, end point excluded [rad]
    torque : (n_cycles, n_theta) [N m], or None for a recording without torque
    pressure : (n_cycles, n_theta) line pressure, gauge [Pa]; (0, n_theta) for a recording without pressure
    channels : quantity -> (n_cycles, n_theta), all other channels [SI]; nan in cycles that a channel does not cover
    speed : (n_cycles,) mean cam speed of the cycle [rad/s]
    index : (n_cycles,) cycle number in the recording
    held_out : (n_cycles,) True for the cycles that score (even numbers among the used)
    cycles_found : complete cycles in the recording
    duration : of the longest channel [s]
    speed_ripple_percent : spread of the cycle speeds, 100 * std / mean
    cut_flow : how many cycles each cut rejects, in the order of the cuts
    clocks : every logger's clock against that of the torque
    angle_errors : the angle error budget by source, before a fit
    trigger_jitter_s : standard deviation of the time of one trigger edge [s]
    findings : everything odd about the alignment
    torque_delay : declared delay of the torque against the trigger with its uncertainty [s]
    details : further numbers of the alignment, for result.json
    level_drifts : quantity -> by how much its level on the base circle drifts, where that is told [SI]
    pulses : logger -> times of the edges of its first trigger (or of what tells the angle) as found, on its clock [s]
    """

    theta: Array
    torque: Array | None
    pressure: Array
    speed: Array
    index: NDArray[np.int64]
    held_out: Mask
    cycles_found: int
    duration: float
    speed_ripple_percent: float
    cut_flow: tuple[CutFlowRow, ...]
    clocks: tuple[ClockFit, ...]
    angle_errors: tuple[AngleError, ...]
    trigger_jitter_s: float
    findings: tuple[Finding, ...]
    torque_delay: Estimate
    details: Mapping[str, Any] = field(default_factory=dict)
    channels: Mapping[str, Array] = field(default_factory=dict)
    pulses: Mapping[str, Array] = field(default_factory=dict)
    level_drifts: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n_cycles = self.speed.size
        shape = (n_cycles, self.theta.size)
        known = [self.pressure] if self.pressure.size else []
        known += [] if self.torque is None else [self.torque]
        if any(values.shape != shape for values in (*known, *self.channels.values())):
            raise ValueError(f"cycles: expected arrays of shape {shape}, found pressure {self.pressure.shape}")
        if self.index.shape != (n_cycles,) or self.held_out.shape != (n_cycles,):
            raise ValueError("cycles: index and held_out need one entry per cycle")
        super().__post_init__()

    def __repr__(self) -> str:
        used = f"{self.index.size} of {self.cycles_found} cycles"
        return f"<CamCycles {used}, {self.mean_speed * 30.0 / np.pi:.1f} rpm, {self.theta.size} angles>"

    @property
    def mean_speed(self) -> float:
        """Mean cam speed [rad/s]."""
        return float(np.mean(self.speed))

    @cached_property
    def mean_torque(self) -> Array:
        """Mean torque of the used cycles (n_theta,) [N m]; only with a torque."""
        return mean_of(cast(Array, self.torque))

    @cached_property
    def torque_halves(self) -> tuple[Array, Array]:
        """Mean torque of the fitted and of the held-out cycles (n_theta,) [N m]; only with a torque."""
        torque = cast(Array, self.torque)
        return mean_of(torque, ~self.held_out), mean_of(torque, self.held_out)

    @cached_property
    def mean_pressure(self) -> Array:
        """Mean line pressure of the used cycles (n_theta,) [Pa]; only with a pressure."""
        return mean_of(self.pressure)

    @cached_property
    def torque_std(self) -> Array:
        """Standard deviation of the torque over the used cycles (n_theta,) [N m], nan for one; only with a torque."""
        if self.index.size < 2:
            return np.full(self.theta.size, np.nan)
        return std_of(cast(Array, self.torque), self.mean_torque, 1)

    def means(self, quantity: str) -> Array:
        """Return the mean over each cycle of one of ``channels`` (n_cycles,) [SI]."""
        return np.asarray(np.mean(self.channels[quantity], axis=1), dtype=np.float64)

    def mean_cycle(self, quantity: str) -> Array | None:
        """Return the mean of the cycles that one of ``channels`` covers (n_theta,) [SI], None where it covers none."""
        values = self.channels.get(quantity)
        if values is None:
            return None
        whole = np.isfinite(values).all(axis=1)
        return np.asarray(np.mean(values[whole], axis=0)) if whole.any() else None
