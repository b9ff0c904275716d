"""What further teeth of a turn tell of the cam's swing, which the fit rebuilds from the torque.

When a second or third tooth passes is one number each that the fit has to meet. The teeth of a wheel do not tell the
swing from their own errors without saying how it looks; the law of the driveline says that better than any guess. They
tell where the law does not hold: behind a joint, an engine or a gear the cam swings otherwise, and then what they say
of the low orders counts.
"""

from __future__ import annotations

import numpy as np

from camtorque.align.pattern import waves_of
from camtorque.laws.chain import NONLINEAR_NAMES, SHIFT_NAMES, ChainInput, Motion
from camtorque.records import Array
from camtorque.units import TURN

PLACE_STD = np.radians(0.05)
"""How well the place of a second tooth against the first is known: milled wheels are 0.02 to 0.1 degrees off."""
WHEEL_ORDERS = 8
"""Orders that are taken from a wheel where the driveline's law does not hold; engines and joints have no higher ones
to speak of, and above them what is told is the guess of how a swing looks."""
RUNOUT = 1
"""Order that a wheel out of centre has, whatever the cam does."""
SWINGS_OTHERWISE = np.radians(0.1)
"""Root mean square of the orders between them by which a wheel contradicts the law; on simulated rigs of three makers
whose drives follow it they are 0.01 to 0.05 degrees apart, a joint that swings by one percent makes 0.2."""
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


def told_otherwise(motion: Motion, chain: ChainInput, passed: Array) -> float:
    """Return by how much the cam swings otherwise than a law's motion by the teeth of a wheel, rms [rad].

    Parameters
    ----------
    passed : (t, 2) of each tooth, as `camtorque.records.TEETH` says
    """
    highest = min(WHEEL_ORDERS, passed.shape[0] // 2 - 2)
    if highest <= RUNOUT:
        return 0.0
    places = chain.trigger_angle + passed[:, 0]
    waves = waves_of(places, np.arange(1, highest + 1))
    columns = np.column_stack([np.ones(places.size), waves])
    apart = passed[:, 1] - leads_at(motion, chain, places)
    inverse = np.linalg.pinv(columns)
    size = inverse @ apart
    noise = np.sum((apart - columns @ size) ** 2) / (places.size - size.size)
    # errors of teeth have all orders alike: their share is no swing
    shown = size**2 - noise * np.sum(inverse**2, axis=1)
    return float(np.sqrt(max(0.5 * np.sum(shown[1:].reshape(2, -1)[:, RUNOUT:]), 0.0)))


def _at(chain: ChainInput, values: Array, places: Array) -> Array:
    return np.asarray(np.interp(np.mod(places, TURN), chain.theta, values, period=TURN))
