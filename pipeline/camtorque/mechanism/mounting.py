"""How a pump sits on its bench, and what is assumed where its sheet is silent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.config import PumpData
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.friction import NO_FRICTION, Friction
from camtorque.units import STEEL_DENSITY

LARGEST_ROLLER_SHARE = 0.5
"""A roller is at most half of the sliding mass: tappet, plunger and spring third are the rest."""


@dataclass(frozen=True)
class Mounting:
    """Direction of running, gravity and the choices that a planar model needs.

    Attributes
    ----------
    rotation : +1 or -1; the lift table is read along the direction of running, the offset keeps its place in space
    gravity : acceleration of gravity along X1 and Y1 [m/s^2]; (0, 0) leaves it out, (0, -9.81) hangs the pump upright
    spring_mass : mass of the spring [kg], of which a third moves; 0 where the follower mass contains it (as on the
        bench sheets)
    guide_height : height above the cam axis of the point on the follower axis about which the guide moment is taken
        [m]; None takes it about the roller centre
    """

    rotation: int = 1
    gravity: tuple[float, float] = (0.0, 0.0)
    spring_mass: float = 0.0
    guide_height: float | None = None

    def __post_init__(self) -> None:
        if self.rotation not in (1, -1):
            raise ValueError(f"rotation is {self.rotation!r}, expected +1 or -1")
        if self.spring_mass < 0.0:
            raise ValueError(f"spring mass is {self.spring_mass} kg, expected 0 or more")


NO_GRAVITY = Mounting()
"""Positive rotation without gravity."""


@dataclass(frozen=True)
class Roller:
    """Mass [kg], moment of inertia about its axis [kg m^2], and whether they are assumed."""

    mass: float
    inertia: float
    assumed: bool


def assumed_roller(pump: PumpData) -> Roller:
    """Return the roller of the sheet, or a solid steel disk of its radius and width where the sheet is silent.

    A disk m = rho pi r^2 B, I = m r^2 / 2 bounds a bored roller of the same size from above; the mass is capped at
    `LARGEST_ROLLER_SHARE` of the follower, which contains it.
    """
    disk = STEEL_DENSITY * np.pi * pump.roller_radius**2 * pump.roller_width
    mass = min(disk, LARGEST_ROLLER_SHARE * pump.follower_mass) if pump.roller_mass is None else pump.roller_mass
    inertia = 0.5 * mass * pump.roller_radius**2 if pump.roller_inertia is None else pump.roller_inertia
    return Roller(float(mass), float(inertia), pump.roller_mass is None or pump.roller_inertia is None)


def moving_mass(pump: PumpData, mounting: Mounting) -> float:
    """Return the mass that slides with the follower, roller and spring third included [kg]."""
    return pump.follower_mass + mounting.spring_mass / 3.0


@dataclass(frozen=True)
class PumpUnit:
    """One pump on a shaft: its data, its cam, by how much its lobe lags the first [rad], and its friction."""

    pump: PumpData
    law: CamLaw
    phase: float = 0.0
    mounting: Mounting = NO_GRAVITY
    friction: Friction = NO_FRICTION
