"""What to record next, from what these data cannot tell apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

from camtorque.fit.next_run import Gain
from camtorque.records import ParameterEstimate

GROUPS: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset({"torque_zero", "shaft_drag", "shaft_viscous"}),
        "torque zero, constant drag and viscous drag are one number at one speed: record standstill readings before "
        "and after the run, and an unpressurised run at two speeds a factor of two apart",
    ),
    (
        frozenset({"dead_volume", "bulk_modulus", "bulk_modulus_slope"}),
        "dead volume and bulk modulus act as their ratio: measure the bulk modulus of the oil (speed of sound) or fill "
        "a known extra volume of about a quarter of the dead volume and repeat one run",
    ),
    (
        frozenset({"delay_error", "shaft_compliance", "trigger_offset", "drive_admittance"}),
        "delay, twist and trigger angle shift the curve alike: the same load at a quarter of the speed separates the "
        "delay (in proportion to speed) from the twist (in proportion to torque)",
    ),
    (
        frozenset({"gain_error", "bearing_arm", "guide_friction"}),
        "gain and load-proportional friction scale the torque alike: a static lever calibration on the mounted "
        "transducer, or a closed-volume run, whose return stroke turns the sign of the friction, separates them",
    ),
    (
        frozenset({"valve_area", "valve_range", "valve_opening"}),
        "the laws of the delivery valve trade against each other: two runs of the same load at speeds a factor of "
        "three apart separate the opening pressure from the flow loss",
    ),
    (
        frozenset({"spring_stiffness_error", "spring_preload_error", "feed_pressure"}),
        "spring rate, preload and feed pressure act alike on the return stroke: weigh the spring at two lengths",
    ),
)
"""Parameters that are known to be mistaken for each other, and the recording that separates them."""


TELLING = 0.75
"""A recording is named only where it brings a standard error below this share of what it is now."""


def next_measurement(parameters: Sequence[ParameterEstimate], gains: Sequence[Gain] = ()) -> tuple[str, ...]:
    """Return what to record next, one sentence for every group in which something is not identified.

    Parameters
    ----------
    parameters : what was fitted
    gains : what recordings that could be made would bring
    """
    advice = []
    for members, text in GROUPS:
        weak = [p for p in parameters if p.name.split("__")[0] in members and not p.identifiable and not p.at_bound]
        if weak:
            state = ", ".join(_state(p) for p in weak[:4])
            advice.append(f"{text} (now: {state}){_expected({p.name for p in weak}, gains)}")
    return tuple(advice)


def _expected(names: set[str], gains: Sequence[Gain]) -> str:
    """Return which single recording would help these parameters most, and by how much."""
    of_run: dict[str, list[Gain]] = {}
    for gain in gains:
        if gain.name in names and gain.before > 0.0:
            of_run.setdefault(gain.recording, []).append(gain)
    if not of_run:
        return ""
    best = min(of_run, key=lambda run: sum(math.log(max(g.after / g.before, 1e-6)) for g in of_run[run]))
    helped = sorted((g for g in of_run[best] if g.after < TELLING * g.before), key=lambda g: g.after / g.before)
    if not helped:
        return "; another run of this kind alone would not tell"
    told = ", ".join(f"{g.name} +- {g.before:.2g} to {g.after:.2g} {g.unit}".rstrip(" -") for g in helped[:3])
    return f"; expected of {best}: {told}"


def _state(parameter: ParameterEstimate) -> str:
    return f"{parameter.name} {parameter.value:.3g} +- {parameter.stderr:.2g} {parameter.unit}".rstrip(" -")
