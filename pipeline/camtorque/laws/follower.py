"""Follower: its mass stands on a spring of contact, camshaft and follower.

What chamber and mass push back reaches the cam over that spring, of compliance sigma, on which the mass m rings::

    load on the cam / load on a rigid one = 1 / (1 + (s/w_f)^2 / (1 + 2 zeta s/w_f)),   w_f = (m sigma)^-1/2

The lift's slope changes slowly against that, so that it holds for the torque as it does for the force. A chamber that
collapses at 2 kHz loads the cam by a fifth to a third more than its pressure tells, and a follower that a ringing shaft
shakes weighs as much more. What the spring adds to the chamber's room, A^2 sigma p, is taken for dead volume.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camtorque.laws.rows import parameter
from camtorque.records import Array

DAMPING = 0.05
"""Damping ratio zeta of a contact in oil."""
NAME = "follower_compliance"
ROWS = (
    parameter(NAME, "sigma", "nm/N", 1.0e-9, (5.0, 0.0, 30.0, 1.0), (5.0, 5.0),
            "yielding of contact, camshaft and follower per contact force",
            "line contact .5-1, plunger and tappet 2-5, camshaft between its bearings 1-10 nm/N"),
)  # fmt: skip


def passed_load(omega: Array, mass: float, compliance: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return load on the cam over that on a rigid one, and its derivative by the compliance, (k,) each.

    Parameters
    ----------
    omega : (k,) [rad/s]; ``mass`` [kg]; ``compliance`` [m/N]
    """
    s = 1.0j * omega * np.sqrt(mass)
    root = np.sqrt(compliance)
    slowed = 1.0 / (1.0 + 2.0 * DAMPING * root * s)
    passed = 1.0 / (1.0 + compliance * s**2 * slowed)
    return passed, -(passed**2) * s**2 * slowed * (1.0 - DAMPING * root * s * slowed)
