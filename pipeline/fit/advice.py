"""What to record next, from what these data cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.records import ParameterEstimate

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


def next_measurement(parameters: Sequence[ParameterEstimate]) -> tuple[str, ...]:
    """Return what to record next, one sentence for every group in which something is not identified."""
    advice = []
    for members, text in GROUPS:
        weak = [p for p in parameters if p.name.split("__")[0] in members and not p.identifiable and not p.at_bound]
        if weak:
            advice.append(f"{text} (now: {', '.join(_state(p) for p in weak[:4])})")
    return tuple(advice)


def _state(parameter: ParameterEstimate) -> str:
    return f"{parameter.name} {parameter.value:.3g} +- {parameter.stderr:.2g} {parameter.unit}".rstrip(" -")
