"""What a user may choose about the alignment; every default has its reason beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.records import Finding, Refusal

LINEAR, CUBIC, AVERAGE = 0, 1, 2
RULES = {"cubic": CUBIC, "linear": LINEAR, "average": AVERAGE}
"""Name -> number of a rule of resampling."""
INTERPOLATIONS = ("auto", *RULES)
LARGEST_GRID = 36_000
"""Points of the angle grid: 0.01 degree, of the order of what a recording of a minute can hold in memory."""


@dataclass(frozen=True)
class AlignOptions:
    """Choices of the alignment.

    Attributes
    ----------
    n_theta : points of the angle grid (0.1 degree by default: finer than one sample at the usual rates)
    interpolation : ``auto`` averages over a grid step where samples lie finer than the grid and interpolates by a
        cubic where they lie coarser; the others force one rule
    steady_change : largest relative change of speed from one revolution to the next of a steady cycle
    steady_band : largest relative distance of a cycle's speed from the recording's
    outlier_z : robust z of a cycle's distance from the robust mean cycle beyond which it is an outlier
    repaired_angle_deg : a repaired pulse is used when its expected error is below this
    notes : remarks on how these options were chosen; they stand among the findings
    """

    n_theta: int = 3600
    interpolation: str = "auto"
    steady_change: float = 0.005
    steady_band: float = 0.02
    outlier_z: float = 8.0
    repaired_angle_deg: float = 0.15
    notes: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.n_theta, int | np.integer) or not 36 <= self.n_theta <= LARGEST_GRID:
            raise Refusal(f"align: n_theta is {self.n_theta!r}, expected a whole number from 36 to {LARGEST_GRID}")
        for name in ("steady_change", "steady_band", "outlier_z", "repaired_angle_deg"):
            if not getattr(self, name) > 0.0:
                raise Refusal(f"align: {name} is {getattr(self, name)!r}, expected a positive number")
        if self.interpolation not in INTERPOLATIONS:
            raise Refusal(f"align: interpolation is {self.interpolation!r}, expected one of {INTERPOLATIONS}")
