"""Which torque the drive repeats many times a revolution: the order that stands on the base circle, where no pump acts.

Teeth and poles swing the torque alike all around. What rings after the stroke dies away, and hardly ever a whole number
of times a revolution: between both halves of the base circle its phase and size differ.
"""

from __future__ import annotations

import numpy as np

from camtorque.laws.ripple import waves
from camtorque.mechanism.load_check import on_base
from camtorque.records import Array
from camtorque.units import DEGREE

SETTLING, LEAST_BASE = 40.0 * DEGREE, 60.0 * DEGREE
"""Angle after the lift in which shafts ring; least angle behind it that tells an order."""
ORDERS = range(4, 200)
"""Orders that are looked for: below are misalignment and drift, above is what no transducer shows."""
STANDS_OUT, ALIKE = 0.5, 0.3
"""Share of the variance of the base circle's torque that one order has to be, and difference of both halves over it:
of 64 recordings of four makers 13 without such a drive have an order of 0.5 to 0.78, whose halves differ by 0.59 or
more; one with a gear of 41 teeth has 0.79 and 0.17."""
LEAST_SHARE = 3.0e-4
"""Amplitude that is worth a law, as a share of the peak torque."""


def repeated_order(torque: Array, lift: Array) -> int:
    """Return how many times a revolution a mean torque (n,) repeats itself where the lift (n,) stands, 0 for none."""
    places = base_circle(lift)
    if places.size < torque.size * LEAST_BASE / (2.0 * np.pi):
        return 0
    angle = places * (2.0 * np.pi / torque.size)
    slow = np.vander(np.linspace(-1.0, 1.0, angle.size), 3)
    here = torque[places % torque.size]
    here = here - slow @ np.linalg.lstsq(slow, here, rcond=None)[0]
    left = [float(np.var(here - _wave(order, angle, here)[1])) for order in ORDERS]
    order = ORDERS[int(np.argmin(left))]
    half = angle.size // 2
    parts = (slice(None), slice(half), slice(half, None))
    whole, first, second = (_wave(order, angle[part], here[part])[0] for part in parts)
    stands = min(left) < (1.0 - STANDS_OUT) * np.var(here) and abs(whole) > LEAST_SHARE * np.max(np.abs(torque))
    return order if stands and abs(first - second) < ALIKE * abs(whole) else 0


def base_circle(lift: Array) -> Array:
    """Return the longest run of places (m,) at which a periodic lift (n,) stands, after `SETTLING`; they may pass n."""
    moving = np.flatnonzero(~on_base(lift))
    gaps = np.diff(moving, append=moving[0] + lift.size)
    longest = int(np.argmax(gaps))
    settled = moving[longest] + 1 + round(SETTLING / (2.0 * np.pi) * lift.size)
    return np.arange(settled, moving[longest] + gaps[longest])


def _wave(order: int, angle: Array, torque: Array) -> tuple[complex, Array]:
    """Return amplitude and course of an order in a torque (n,) at some angles."""
    columns = waves(order, angle)
    size = np.linalg.lstsq(columns, torque, rcond=None)[0]
    return complex(*size), columns @ size
