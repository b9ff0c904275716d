"""Events that may lie between two recordings: the parameters that each moves, how far, and how usual it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camtorque.fit.difference import Basis
from camtorque.fit.gains import GAINS, PRESSURE_GAIN, TORQUE_GAIN
from camtorque.fit.pair import OWN_NAMES, TwoRecordings
from camtorque.laws.fluid import shares_per_kelvin
from camtorque.records import Array

CHANGES: dict[str, tuple[str, ...]] = {
    "leakage": ("leakage",),
    "trigger": ("trigger_offset",),
    "spring": ("spring_preload_error",),
    "spring_rate": ("spring_stiffness_error",),
    "friction": ("bearing_arm", "pin_arm", "guide_friction", "shaft_drag"),
    "packing": ("packing_force", "packing_friction"),
    "damping": ("shaft_viscous", "plunger_viscous"),
    "temperature": ("leakage", "bulk_modulus", "shaft_viscous", "plunger_viscous"),
    "fluid": ("bulk_modulus",),
    "air": ("free_air",),
    "feed": ("feed_pressure",),
    "port": ("port_closing_lift",),
    "dead_volume": ("dead_volume",),
    "valve_opening": ("valve_opening",),
    "valve": ("retraction_volume", "valve_damping", "seat_gain", "valve_area"),
    "shaft": ("shaft_compliance", "shaft_resonance", "shaft_damping_ratio"),
    "coupling": ("coupling_compliance", "coupling_resonance", "coupling_damping"),
    "drive": ("drive_admittance", "drive_bandwidth"),
    "torque_gain": (TORQUE_GAIN,),
    "pressure_gain": (PRESSURE_GAIN,),
}
"""Event -> parameters that it moves."""
ALWAYS = tuple(name for name in OWN_NAMES if not any(name in members for members in CHANGES.values()))
"""Parameters that always differ and tell of no event."""
USUAL = ("leakage", "trigger", "spring", "friction", "damping", "temperature", "torque_gain", "pressure_gain")
PRIOR, PRIOR_RARE = 0.10, 0.02
"""Probability of one change before the data, usual ones and others."""
STEPS_OF_CHANGE = 4.0
"""Standard deviation of a plausible change, in steps that matter (`ParameterRow.step`)."""
TEMPERATURE_STD = 10.0
GAIN_STD = 0.03
"""Standard deviation of a gain that slipped: shunts, amplifiers and ranges that were set anew are off by percents."""


def may_differ(pair: TwoRecordings) -> tuple[str, ...]:
    """Return the parameters that may differ: own ones first."""
    wanted = dict.fromkeys(name for members in CHANGES.values() for name in members)
    return tuple(dict.fromkeys((*pair.own, *(name for name in wanted if name in pair.names))))


def basis_of(pair: TwoRecordings, values: Array, groups: Sequence[str]) -> Basis:
    """Return the directions of a set of events at values of the free parameters, (k,) [SI]; own ones first."""
    labels: list[tuple[str, str]] = [("", name) for name in pair.own]
    columns = [pair.own[name] * _unit(pair, name) for name in pair.own]
    for group in groups:
        if group == "temperature":
            labels.append((group, ""))
            columns.append(temperature(pair.names, values) * TEMPERATURE_STD)
            continue
        for name in CHANGES[group]:
            if name in pair.names:
                labels.append((group, name))
                std = GAIN_STD if name in GAINS else STEPS_OF_CHANGE * pair.items[0].rows[name].step
                columns.append(std * _unit(pair, name))
    return Basis(tuple(labels), np.array(columns).T.reshape(len(pair.names), -1))


def _unit(pair: TwoRecordings, name: str) -> Array:
    return np.eye(len(pair.names))[pair.names.index(name)]


def temperature(names: Sequence[str], values: Array) -> Array:
    """Return what one kelvin does to each parameter, (k,) [SI/K]: thinner fluid, softer fluid."""
    viscosity, modulus = shares_per_kelvin()
    thinner = {"leakage": -viscosity, "bulk_modulus": modulus, "shaft_viscous": viscosity, "plunger_viscous": viscosity}
    return np.array([thinner.get(name, 0.0) for name in names]) * values


def two_ln_odds(groups: Sequence[str]) -> float:
    """Return twice the logarithm of the prior odds of a set of groups."""
    prior = [PRIOR if group in USUAL else PRIOR_RARE for group in groups]
    return 2.0 * float(sum(np.log(p / (1.0 - p)) for p in prior))
