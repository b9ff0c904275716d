"""Columns of torque: what a law has to state of a torque that is linear in one of its parameters.

A law acts in one of three ways, per unit of its parameter:

* `on_contact`: an arm [m] on which the contact load rubs;
* `on_plunger`: a force along the plunger [N], raised by the guide's friction like every other;
* `on_shaft`: a torque on the shaft [N m].

Each states its derivatives, by cam angle at constant time rates, and by what else it depends on.
"""

from __future__ import annotations

from typing import NamedTuple

from camtorque.compiled import njit


class At(NamedTuple):
    """State of the pump at each cam angle; ``_by`` is the derivative by angle.

    Attributes
    ----------
    lift, slope, curve : y [m], y' [m/rad], y'' [m/rad^2]
    rate, pressure : cam speed [rad/s], pressure on the plunger [Pa]
    sign, sign_by : smooth sign of the sliding velocity
    cosine, sine : of the cam angle
    tangent, tangent_by : tan(phi), share of the contact load that acts across the follower
    lever, lever_by : 1 / cos(phi), contact load normal to the cam over that along the follower
    spin, spin_by : rate of the roller over that of the cam
    turn, turn_by : acceleration of the roller [rad/s^2]
    stiffness, preload, area : of spring [N/m, N] and plunger [m^2]
    """

    lift: float
    slope: float
    curve: float
    rate: float
    pressure: float
    sign: float
    sign_by: float
    cosine: float
    sine: float
    tangent: float
    tangent_by: float
    lever: float
    lever_by: float
    spin: float
    spin_by: float
    turn: float
    turn_by: float
    stiffness: float
    preload: float
    area: float


class Column(NamedTuple):
    """Torque per unit of one parameter: arm of the contact load, force along the plunger, torque on the shaft."""

    arm: float
    arm_by_angle: float
    force: float
    force_by_angle: float
    force_by_rate: float
    force_by_pressure: float
    torque: float
    torque_by_angle: float
    torque_by_rate: float
    torque_by_second: float


@njit(cache=True, error_model="numpy")
def on_contact(arm, by_angle):  # type: ignore[no-untyped-def]
    """Return the column of an arm on which the contact load rubs [m]."""
    return Column(arm, by_angle, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def on_plunger(force, by_angle, by_rate, by_pressure):  # type: ignore[no-untyped-def]
    """Return the column of a force along the plunger [N], positive against the lift."""
    return Column(0.0, 0.0, force, by_angle, by_rate, by_pressure, 0.0, 0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def on_shaft(torque, by_angle, by_rate, by_second=0.0):  # type: ignore[no-untyped-def]
    """Return the column of a torque that the shaft has to overcome [N m]; ``by_second``: by cam acceleration."""
    return Column(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, torque, by_angle, by_rate, by_second)
