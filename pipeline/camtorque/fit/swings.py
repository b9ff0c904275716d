"""Further starts of the driveline: hubs that swing on a yielding coupling, and shafts that ring elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial

import numpy as np

from camtorque.fit.problem import FitData, Problem, build_problem, with_starts
from camtorque.fit.solver import LiftModes, try_at
from camtorque.fit.starts import CORE, Start, continued
from camtorque.laws.chain import ChainOutput, evaluate, with_transfer
from camtorque.laws.driveline import HALF_NAMES
from camtorque.process.second_process import in_two


def coupled(hertz: float, soft: float, ratio: float) -> dict[str, float]:
    """Return a hub that swings at a frequency [Hz] on a coupling of some compliance [rad/(N m)] and damping [-]."""
    return {"coupling_resonance": 2.0 * np.pi * hertz, "coupling_compliance": soft, "coupling_damping": ratio}


HUB_RUNGS = ((3.5, 4, 8), (1.5, 8, 3))
"""Smoothing [deg] of the scan of hubs, iterations, and how many are followed after it."""
SHAFTS_WITH_HUB = ((60.0e-6, 1200.0), (200.0e-6, 620.0), (400.0e-6, 450.0))
"""Compliance [rad/(N m)] and frequency of ringing [Hz] of the shafts on which hubs are tried."""
RINGINGS = tuple(
    {"shaft_resonance": 2.0 * np.pi * hertz, "shaft_damping_ratio": ratio}
    for ratio, count in ((0.02, 72), (0.06, 36), (0.2, 18)) for hertz in np.geomspace(120.0, 2600.0, count)
)  # fmt: skip
"""Shafts on which the cam rings: the true ones stand in a narrow dip of frequency."""
COUPLINGS = tuple(
    coupled(hertz, soft, ratio)
    for ratio, count in ((0.07, 36), (0.3, 18)) for hertz in np.geomspace(30.0, 3000.0, count)
    for soft in (8.0e-6, 40.0e-6, 200.0e-6)
)  # fmt: skip
"""Couplings on which the hub between drive and transducer swings."""
HUBS = tuple(coupled(hertz, soft, 0.07) for hertz in np.geomspace(30.0, 500.0, 11) for soft in (80.0e-6, 300.0e-6))
"""Hubs that swing on a yielding coupling."""
CAM_SIDES = (1.0, 1.4, 2.0, 3.0)
"""Inertias of the cam's side that are tried, over the sheet's cam."""
STIFFER = (1.0, 0.7, 0.5)
"""Compliances that are tried with them, over that of the shaft which they replace."""
ELASTOMER = 2.0
"""Logarithm of the damping time of a coupling's elastomer over that of steel."""
SCANNED_KEPT = 3
APART = 1.1
"""Least ratio of two frequencies of ringing that are followed."""


def expected(data: FitData, names: Iterable[str]) -> dict[str, float]:
    """Return what is expected of the named parameters, those of which something is [SI]."""
    priors = {name: data.rows[name].prior for name in names}
    return {name: prior[0] for name, prior in priors.items() if prior}


def with_hubs(best: Start) -> list[FitData]:
    """Return the best start with the hubs that help it most."""
    return best_of([with_starts(best.data, hub) for hub in HUBS])


def with_hubs_alone(best: Start) -> list[FitData]:
    """Return the best start with hubs on several shafts, all but what places the load as expected.

    A shaft that rings where shaft and hub swing together does not let go of it.
    """
    names = [name for name in build_problem([best.data]).names if name not in CORE]
    item = with_starts(best.data, expected(best.data, names))
    shafts = ({"shaft_compliance": soft, "shaft_resonance": 2.0 * np.pi * hertz} for soft, hertz in SHAFTS_WITH_HUB)
    return best_of([with_starts(item, {**shaft, **hub}) for shaft in shafts for hub in HUBS])


def best_of(items: list[FitData]) -> list[FitData]:
    """Return the best of some starts with other drivelines by two rungs of less and less smoothing.

    Much smoothing hides a hub: at 300 Hz and 600 rpm it swings once in 12 degrees.
    """
    for smoothing, iterations, kept in HUB_RUNGS:
        ends = in_two(partial(continued, smoothing_deg=smoothing, core=False, iterations=iterations), items)
        order = sorted((end for end in ends if end), key=lambda end: end.chi_square)
        items = [end.data for end in order[:kept]]
    return items


def with_ringing(best: Start) -> list[FitData]:
    """Return the best start with the shaft ringing at other frequencies, lightly damped: the best of a scan.

    Ringing is invisible while the residual is smoothed, and an overdamped shaft does not find it afterwards.
    """
    return scanned(best, RINGINGS, "shaft_resonance")


def with_couplings(best: Start) -> list[FitData]:
    """Return the best start with the coupling swinging at other frequencies: the best of a scan."""
    return scanned(best, COUPLINGS, "coupling_resonance")


def with_heavier_cams(best: Start) -> list[FitData]:
    """Return the best start with shafts on which the torque rings alike, and a cam's side no lighter than the cam.

    With the drive held, the load reaches the transducer over 1 + p s^2 + q s^4::

        p = C (I_c + (1 - h) I_h),   q = C^2 h (1 - h) I_h I_c

    (symbols of `camtorque.laws.driveline`): two numbers, met by any I_c. It is the sheet that tells which.
    """
    return best_of([with_starts(best.data, shaft) for shaft in ringing_alike(best.data)])


def ringing_alike(item: FitData) -> list[dict[str, float]]:
    """Return shafts of the same p and q by inertia of the cam's side and compliance, damped as long as the start's."""
    soft, resonance, ratio, half, place, ln_longer = (
        item.rows[name].start for name in ("shaft_compliance", "shaft_resonance", "shaft_damping_ratio", *HALF_NAMES)
    )
    cam = 1.0 / (resonance**2 * soft)
    linear = soft * (cam + (1.0 - place) * half)
    square = soft**2 * place * (1.0 - place) * half * cam
    found = []
    for yielding in soft * np.array(STIFFER):
        for inertia in item.chain.pump.cam_inertia * np.array(CAM_SIDES):
            rest = linear - yielding * inertia
            share = square / (yielding * inertia * rest) if rest > 0.0 else 1.0
            if share < 1.0:
                ringing = 1.0 / np.sqrt(yielding * inertia)
                shaft = {
                    "shaft_compliance": yielding, "shaft_resonance": ringing, "half_place": share,
                    "half_inertia": rest / (yielding * (1.0 - share)),
                    "shaft_damping_ratio": ratio * ringing / resonance,
                }  # fmt: skip
                found += [{**shaft, "half_damping": way} for way in (ln_longer, -ln_longer, ELASTOMER)]
    return found


def scanned(best: Start, swings: Iterable[Mapping[str, float]], place: str) -> list[FitData]:
    """Return the best start with the best of some drivelines [SI], whose frequencies ``place`` are apart.

    What moves on the cam is held meanwhile: a tenth of a search went into asking the chamber of 126 shafts the same
    again.
    """
    problem = build_problem([best.data])
    output = evaluate(best.data.chain, problem.values(problem.start, 0)[0])
    kept: list[Mapping[str, float]] = []
    for swing in sorted(swings, key=lambda swing: _behind(problem, best.lift, output, swing)):
        ratios = [swing[place] / other[place] for other in kept]
        if len(kept) < SCANNED_KEPT and all(max(ratio, 1.0 / ratio) > APART for ratio in ratios):
            kept.append(swing)
    return [with_starts(best.data, swing) for swing in kept]


def _behind(problem: Problem, lift: LiftModes, output: ChainOutput, swing: Mapping[str, float]) -> float:
    """Return chi-square with another driveline behind what the start does on the cam."""
    z = problem.start
    for name, value in swing.items():
        z[problem.index(name)] = value
    z = np.clip(z, *problem.bounds)
    behind = with_transfer(problem.data[0].chain, output, problem.values(z, 0)[0])
    return try_at(problem, z, lift, known=behind).chi_square
