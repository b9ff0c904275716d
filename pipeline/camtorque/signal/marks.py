"""Two marks at unequal angles of one revolution: how they are described in recording.toml."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import DEGREE, TURN

EVEN = Threshold(
    0.4, "1", "physics",
    "Share of the shorter of two neighbouring periods from which they are turns of a shaft that runs unevenly."
)  # fmt: skip
SAME_SHARE = Threshold(
    0.02, "1", "simulated rigs", "Two marks part a revolution alike in every turn, by this share of it."
)  # fmt: skip
MOSTLY = Threshold(0.8, "1", "convention", "So many of the turns do: a pulse that is missing spoils two.")
LEAST_PERIODS = Count(6, "1", "convention", "Three turns of two pulses.")


def uneven_marks(times: Array) -> str:
    """Return what to write where pulses stand at two unequal distances in turn, empty where they do not.

    Parameters
    ----------
    times : (n,) of the pulses [s]
    """
    periods = np.diff(times)
    if periods.size < LEAST_PERIODS:
        return ""
    first = periods[:-1] / (periods[:-1] + periods[1:])
    shares = np.minimum(first, 1.0 - first)
    share = float(np.median(shares))
    if share > EVEN or np.mean(np.abs(shares - share) < SAME_SHARE) < MOSTLY:
        return ""
    short, pitches = share * TURN / DEGREE, round(1.0 / share)
    seen = f"the pulses stand {short:.0f} and {360.0 - short:.0f} deg apart in turn: two marks on one shaft"
    if abs(share - 1.0 / pitches) > SAME_SHARE:
        return f"{seen}, at no whole part of a revolution; take one away, or set it 60 deg after the other"
    return (
        f"{seen}; write pulses_per_rev = {pitches}, missing_teeth = {pitches - 2} under [trigger], nominal_angle_deg "
        "is that of the first after the long way"
    )
