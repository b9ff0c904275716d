"""Conversions at the border. Inside, everything is SI and radians; the nomenclature is in `NOMENCLATURE`."""

from __future__ import annotations

import numpy as np

BAR = 1.0e5
"""Pascal per bar."""
RPM = 2.0 * np.pi / 60.0
"""Radian per second per revolution per minute."""
DEGREE = np.pi / 180.0
"""Radian per degree."""
