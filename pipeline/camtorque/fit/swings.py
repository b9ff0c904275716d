"""Further starts of the driveline: hubs that swing on a yielding coupling, and shafts that ring elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial

import numpy as np

from camtorque.fit.problem import FitData, Problem, build_problem, with_starts
from camtorque.fit.solver import LiftModes, try_at
from camtorque.fit.starts import CORE, Start, continued
from camtorque.laws.chain import ChainOutput, evaluate, with_transfer
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
"""Couplings on which the hub behind the transducer swings."""
HUBS = tuple(coupled(hertz, soft, 0.07) for hertz in np.geomspace(30.0, 500.0, 11) for soft in (80.0e-6, 300.0e-6))
"""Hubs that swing on a yielding coupling."""
SCANNED_KEPT = 3
APART = 1.1
"""Least ratio of two frequencies of ringing that are followed."""


def expected(data: FitData, names: Iterable[str]) -> dict[str, float]:
    """Return what is expected of the named parameters, those of which something is [SI]."""
    priors = {name: data.rows[name].prior for name in names}
    return {name: prior[0] for name, prior in priors.items() if prior}


def as_expected(start: Start) -> FitData:
    """Return a start with all but what places the load back at what is expected of it."""
    names = [
        parameter.row.name for parameter in build_problem([start.data]).parameters if parameter.row.name not in CORE
    ]
    return with_starts(start.data, expected(start.data, names))


def with_hubs(best: Start) -> list[FitData]:
    """Return the best start with the hubs that help it most."""
    return scanned_hubs([best.data])


def with_hubs_alone(best: Start) -> list[FitData]:
    """Return the best start with hubs on several shafts, all but what places the load as expected.

    A shaft that rings where shaft and hub swing together does not let go of it.
    """
    item = as_expected(best)
    return scanned_hubs([with_starts(item, {"shaft_compliance": soft, "shaft_resonance": 2.0 * np.pi * hertz})
                         for soft, hertz in SHAFTS_WITH_HUB])  # fmt: skip


def scanned_hubs(shafts: list[FitData]) -> list[FitData]:
    """Return the best hubs on some shafts by two rungs of less and less smoothing.

    Much smoothing hides a hub: at 300 Hz and 600 rpm it swings once in 12 degrees.
    """
    items = [with_starts(item, hub) for item in shafts for hub in HUBS]
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


def scanned(best: Start, swings: Iterable[Mapping[str, float]], place: str) -> list[FitData]:
    """Return the best start with the best of some drivelines [SI], whose frequencies ``place`` are apart.

    What moves on the cam is held meanwhile: a tenth of a search went into asking the chamber of 126 shafts the same
    again.
    """
    problem = build_problem([best.data])
    output = evaluate(best.data.chain, problem.values(problem.start, 0)[0])
    kept: list[Mapping[str, float]] = []
    for swing in sorted(swings, key=lambda swing: _behind(problem, best.lifts, output, swing)):
        ratios = [swing[place] / other[place] for other in kept]
        if len(kept) < SCANNED_KEPT and all(max(ratio, 1.0 / ratio) > APART for ratio in ratios):
            kept.append(swing)
    return [with_starts(best.data, swing) for swing in kept]


def _behind(problem: Problem, lifts: tuple[LiftModes, ...], output: ChainOutput, swing: Mapping[str, float]) -> float:
    """Return chi-square with another driveline behind what the start does on the cam."""
    z = problem.start
    for name, value in swing.items():
        z[problem.index(name)] = value
    z = np.clip(z, *problem.bounds)
    behind = with_transfer(problem.data[0].chain, output, problem.values(z, 0)[0])
    return try_at(problem, z, lifts, known=(behind,)).chi_square
