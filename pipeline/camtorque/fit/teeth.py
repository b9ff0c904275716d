"""Where a second or third tooth passes: what two pulses a turn tell of how far the shaft swings between them.

They are too few for the speed within a turn, which the fit rebuilds from the torque; when the others pass is one number
each that it has to meet.
"""

from __future__ import annotations

import numpy as np

from camtorque.laws.chain import NONLINEAR_NAMES, SHIFT_NAMES, ChainInput, Motion
from camtorque.records import Array
from camtorque.units import TURN

PLACE_STD = np.radians(0.05)
"""How well the place of a second tooth against the first is known: milled wheels are 0.02 to 0.1 degrees off."""
_SWINGS = [name != "trigger_offset" for name in SHIFT_NAMES]
_PLACES = [NONLINEAR_NAMES.index(name) for name, swings in zip(SHIFT_NAMES, _SWINGS, strict=True) if swings]


def leads_at(motion: Motion, chain: ChainInput, places: Array) -> Array:
    """Return the cam angle less the even one at some even angles (t,) [rad], (t,), apart from the trigger's offset."""
    lead = motion.theta - chain.theta
    edge, there = (_at(chain, lead, np.atleast_1d(place)) for place in (chain.trigger_angle, places))
    return there - edge


def lead_slopes(motion: Motion, chain: ChainInput, places: Array) -> Array:
    """Return the derivatives of `leads_at` by `NONLINEAR_NAMES`, (t, n)."""
    slopes = np.zeros((places.size, len(NONLINEAR_NAMES)))
    slopes[:, _PLACES] = np.column_stack([_at(chain, column, places) for column in motion.shifts[0][:, _SWINGS].T])
    return slopes


def _at(chain: ChainInput, values: Array, places: Array) -> Array:
    return np.asarray(np.interp(np.mod(places, TURN), chain.theta, values, period=TURN))
