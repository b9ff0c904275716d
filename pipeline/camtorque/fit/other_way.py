"""What may be the other way round: minima that no small step leads to, tried from the best one on the fine grid.

An outlet that opens again at the edge of the land or on the base circle, a suction valve that is there or not, a valve
that retracts much or hardly anything, a shaft that yields or is stiff: each is a valley of its own, and where a search
ends up in the wrong one a sum in another order may decide. Turned round one at a time, with all else where it is, they
cost a descent each.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from camtorque.fit.minima import Candidate, Halves, at_minimum, beside
from camtorque.fit.problem import FitData, with_starts
from camtorque.fit.search import UNSURE
from camtorque.fit.swings import ringing_alike
from camtorque.process.second_process import in_two

WAYS: dict[str, tuple[float, float]] = {
    "outlet_return": (0.0, 1.0), "suction_area": (0.0, 10.0e-6), "retraction_volume": (1.0e-9, 20.0e-9),
    "valve_damping": (1.0e3, 12.0e3), "valve_mass": (1.5e6, 12.0e6), "valve_area": (1.5e-6, 6.0e-6),
    "valve_exposure": (0.2, 0.9), "line_inertance": (0.0, 18.0e6), "free_air": (0.0, 6.0e-3),
    "drive_bandwidth": (1.5, 5.5), "valve_spring": (3.0e12, 4.0e13),
}  # fmt: skip
"""Parameter -> the two ends between which it is turned [SI], each well inside what literature has of it."""
SHAFTS, CAM_SIDES = (15.0e-6, 150.0e-6), (1.5, 4.0)
"""Compliances between which the shaft is turned [rad/(N m)], the cam's side then so many times the sheet's cam."""
OCTAVES = (0.5, 2.0)
"""Factors at which the coupling's frequency is tried."""
TOO_LIGHT = 1.0
"""Chi-square of a light cam's side (`Candidate.light_cam_penalty`) from which shafts that ring alike are tried."""
GAINED, SHARE, ROUNDS = 0.5, 0.03, 6
"""What a minimum has to gain, and as a share of chi-square; how often all is turned once more from the one that did."""


def turned(best: Candidate) -> list[FitData]:
    """Return starts with one thing the other way round where doubt is left, and heavier cams where one is asked for."""
    data, found = best.data, []
    if best.doubt > UNSURE:
        found = [{name: other_end(data, name, ends)} for name, ends in WAYS.items() if best.problem.index(name) >= 0]
        found += driveline_turned(data)
    if best.light_cam_penalty > TOO_LIGHT:
        found += ringing_alike(data)
    return [with_starts(data, values) for values in found]


def other_end(data: FitData, name: str, ends: tuple[float, float]) -> float:
    """Return the end that a parameter is farther from."""
    low, high = ends
    value = data.rows[name].start
    return high if abs(value - low) < abs(value - high) else low


def driveline_turned(data: FitData) -> list[dict[str, float]]:
    """Return a stiff shaft for one that yields, or the other way, with likely cams, and the coupling an octave off."""
    yielding = other_end(data, "shaft_compliance", SHAFTS)
    inertias = data.chain.pump.cam_inertia * np.array(CAM_SIDES)
    shafts = [
        {"shaft_compliance": yielding, "shaft_resonance": float(1.0 / np.sqrt(yielding * inertia))}
        for inertia in inertias
    ]
    swings = data.rows["coupling_resonance"].start
    return [*shafts, *({"coupling_resonance": swings * factor} for factor in OCTAVES)]


def ways(best: Candidate, halves: Halves) -> list[Candidate]:
    """Return a minimum and those reached by turning things round one at a time, from the best one again, best first.

    ``best`` is a minimum on the fine grid, judged.
    """
    found = [best]
    for _ in range(ROUNDS):
        before = found[0]
        effort = replace(beside(before.value), basin=before.basin)
        follow = partial(at_minimum, effort=effort, lift=before.solution.lift)
        ends = in_two(partial(halves.minimum, follow), turned(before))
        others = (end for end in ends if end and not before.basin.holds(end.solution))
        found = sorted([*found, *others], key=lambda item: item.value)
        if found[0] is before:
            break
        found[0] = halves.again(found[0])
        if found[0].value > before.value - max(GAINED, SHARE * before.value):
            break
    return sorted(found, key=lambda item: item.value)
