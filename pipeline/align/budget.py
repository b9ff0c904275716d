"""Angle error budget before the fit: one row per source, in degrees of cam angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.align.clocks import Clock
from pipeline.align.quality import CycleTable
from pipeline.records import AngleError, Recording


def angle_error_budget(
    recording: Recording,
    table: CycleTable,
    used: NDArray[np.bool_],
    clocks: Mapping[str, Clock],
    aligned: Mapping[str, Any],
    jitter: float,
) -> tuple[AngleError, ...]:
    """Return the rows of the budget."""
    speed_deg = np.degrees(float(np.mean(table.speed[used])))
    return (AngleError("trigger edge jitter", jitter * speed_deg, "noise of the plateaus over the slope of the edge"),)
