"""A load case of a design: one speed, and the pressure on the plunger over lift."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from camtorque.records import Array, ReadOnly


@dataclass(frozen=True)
class Load(ReadOnly):
    """One speed with the pressure on the plunger over lift, on the rise and on the return.

    The pressure belongs to the stroke, not to the cam angle: whatever the cam, the same volume is delivered at the same
    pressure.

    Attributes
    ----------
    name : for messages
    speed : [rad/s]
    lifts, pressures : (k,) corners on the rise, linear in between [m, Pa]
    back_lifts, back_pressures : on the return
    events : (j,) lifts at which the rise is evaluated exactly [m]
    source : recording whose fitted chamber pressure it is, empty for none
    delivering : (k,) share of the plunger's flow that leaves for the line at ``lifts``; empty: as the pressure is high
    """

    name: str
    speed: float
    lifts: Array
    pressures: Array
    back_lifts: Array
    back_pressures: Array
    events: Array
    source: str = ""
    delivering: Array = field(default_factory=lambda: np.zeros(0))

    def on_rise(self, lift: Array) -> Array:
        """Return the pressure at some lifts of the rise [Pa]."""
        return np.interp(lift, self.lifts, self.pressures)

    def on_return(self, lift: Array) -> Array:
        """Return the pressure at some lifts of the return [Pa]."""
        return np.interp(lift, self.back_lifts, self.back_pressures)

    @property
    def share(self) -> tuple[Array, Array]:
        """Corners of the share of the plunger's flow that is delivered over lift on the rise.

        Where it is not known it is the share of the peak pressure.
        """
        if self.delivering.size:
            return self.lifts, self.delivering
        peak = float(np.max(self.pressures))
        return self.lifts, self.pressures / peak if peak > 0.0 else np.ones_like(self.pressures)

    @cached_property
    def half(self) -> tuple[float, float]:
        """The lifts between which that share is at least a half [m]; inf where it stays so to the end."""
        corners, share = self.share
        steps = np.flatnonzero(np.diff(share >= 0.5))
        ends = corners[steps] + (0.5 - share[steps]) / np.diff(share)[steps] * np.diff(corners)[steps]
        first = 0.0 if share[0] >= 0.5 or not ends.size else float(ends[0])
        return first, float(ends[-1]) if ends.size and share[-1] < 0.5 else float("inf")

    def delivered(self, lift: float) -> float:
        """Return the stroke that delivers on a rise to some lift: the integral of the share over lift [m]."""
        corners, share = self.share
        grid = np.unique(np.clip(np.concatenate([[0.0, lift], corners]), 0.0, lift))
        return float(np.trapezoid(np.interp(grid, corners, share), grid))
