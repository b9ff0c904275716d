"""Friction of guide, camshaft bearings and roller pin as arguments of the closed form, and the jamming of the follower.

Each is in proportion to the load on its joint. The guide's feeds back: its side force comes from the contact force
that it raises, so that the contact load is the frictionless one over ``1 - mu |tan phi| sign y'``, which jams on the
rise as ``mu |tan phi|`` goes to 1 and can do so nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.compiled import elementwise
from camtorque.mechanism.kinematics import Kinematics
from camtorque.records import Refusal

SMOOTH_SLOPE = 2.0e-5
"""Slope of the lift over which the sign of the sliding velocity turns smoothly [m/rad]; a flank has some 1e-2."""
SMOOTH_TANGENT = 1.0e-6
"""tan(phi) over which its magnitude is smooth, for derivatives."""


@dataclass(frozen=True)
class Friction:
    """Friction coefficients of a pump; all 0 is the frictionless mechanism of the source paper.

    Attributes
    ----------
    guide : coefficient between follower and guide
    bearing_arm : coefficient times radius of the camshaft bearings [m]
    pin_arm : coefficient times radius of the roller's pin [m]
    """

    guide: float = 0.0
    bearing_arm: float = 0.0
    pin_arm: float = 0.0

    def __post_init__(self) -> None:
        if min(self.guide, self.bearing_arm, self.pin_arm) < 0.0:
            raise ValueError(f"friction: found {self}, expected coefficients of 0 or more")

    @property
    def none(self) -> bool:
        """Whether the mechanism is frictionless."""
        return self == Friction()


NO_FRICTION = Friction()


@elementwise(cache=True, error_model="numpy")
def sliding_sign(slope):  # type: ignore[no-untyped-def]
    """Return sign y', smooth where the follower turns."""
    return slope / np.sqrt(slope * slope + SMOOTH_SLOPE * SMOOTH_SLOPE)


@elementwise(cache=True, error_model="numpy")
def sliding_sign_by(slope, curve):  # type: ignore[no-untyped-def]
    """Return the derivative of `sliding_sign` by cam angle."""
    size = np.sqrt(slope * slope + SMOOTH_SLOPE * SMOOTH_SLOPE)
    return curve * SMOOTH_SLOPE * SMOOTH_SLOPE / (size * size * size)


@elementwise(cache=True, error_model="numpy")
def guide_share(tangent, slope):  # type: ignore[no-untyped-def]
    """Return |tan phi| sign y', the share of the contact load that a unit of guide friction takes."""
    return np.sqrt(tangent * tangent + SMOOTH_TANGENT * SMOOTH_TANGENT) * sliding_sign(slope)


@elementwise(cache=True, error_model="numpy")
def guide_share_by(tangent, tangent_by, slope, curve):  # type: ignore[no-untyped-def]
    """Return the derivative of `guide_share` by cam angle, ``tangent_by`` that of tan phi."""
    size = np.sqrt(tangent * tangent + SMOOTH_TANGENT * SMOOTH_TANGENT)
    return tangent * tangent_by / size * sliding_sign(slope) + size * sliding_sign_by(slope, curve)


@elementwise(cache=True, error_model="numpy")
def guide_gain(tangent, slope, friction):  # type: ignore[no-untyped-def]
    """Return the contact load over the frictionless one."""
    return 1.0 / (1.0 - friction * guide_share(tangent, slope))


def jamming_friction(path: Kinematics) -> tuple[float, float]:
    """Return the least guide friction that jams the follower, and the cam angle [rad]; inf, nan where nothing rises."""
    share = guide_share(path.tan_pressure_angle, path.velocity)
    worst = int(np.argmax(share))
    if not share[worst] > 0.0:
        return float("inf"), float("nan")
    return float(1.0 / share[worst]), float(path.theta[worst])


def refuse_jammed(path: Kinematics, friction: Friction) -> None:
    """Refuse a guide friction at which the follower jams: mu |tan phi| reaches 1 on the rise."""
    limit, theta = jamming_friction(path)
    if friction.guide >= limit:
        raise Refusal(
            f"guide friction {friction.guide:.3g}: the follower jams in its guide at {np.rad2deg(theta):.1f} degrees "
            f"of cam angle, where the tangent of the pressure angle is {1.0 / limit:.3g} on the rise, expected a "
            f"friction below {limit:.3g} on this cam; lower it, or check offset, base circle and lift table"
        )
