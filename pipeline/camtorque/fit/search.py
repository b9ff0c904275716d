"""Where the fit starts: all structures, many starts, moves of the best one, hops between minima.

A move brings further starts from what was found so far: the end of delivery scanned, other ringings and hubs, the load
begun anew. A hop draws the liquid or the valve of the best start anew. Each walks down the ladder of `fit.starts`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import FitData, build_problem, with_starts
from camtorque.fit.solver import no_lift
from camtorque.fit.starts import (
    CORE,
    RETRACTIONS,
    SMOOTHINGS_DEG,
    Start,
    Starts,
    begun,
    candidates,
    continued,
    descend,
    ends_at,
    on_other_half,
    rough,
)
from camtorque.laws import chamber, valve

UNSMOOTHED = (0.0, 0.0)
SCAN_SHARES = tuple(np.linspace(0.3, 0.97, 14))
SCAN_KEPT = 2
DOUBTFUL, DISSATISFYING, UNEXPLAINED = 20.0, INDEPENDENT, 5.0 * INDEPENDENT
"""Chi-square above which the best start is moved on, hops on, and nothing found so far is believed."""
HUBS = tuple((hertz, soft) for hertz in np.geomspace(30.0, 500.0, 11) for soft in (80.0e-6, 300.0e-6))
"""Frequency [Hz] of the hub on its coupling alone, and the coupling's compliance [rad/(N m)]."""
HUB_RUNGS = ((3.5, 4, 8), (1.5, 8, 3))
"""Smoothing [deg] of the scan of hubs, iterations, and how many are followed after it."""
SHAFTS_WITH_HUB = ((60.0e-6, 1200.0), (200.0e-6, 620.0), (400.0e-6, 450.0))
"""Compliance [rad/(N m)] and frequency of ringing [Hz] of the shafts on which hubs are tried."""
SHAFT = (
    "shaft_compliance", "shaft_resonance", "shaft_damping_ratio", "coupling_compliance", "coupling_resonance",
    "coupling_damping", "drive_admittance", "drive_bandwidth", "drive_reset", "drive_lag",
)  # fmt: skip
"""Parameters of shaft, hub and drive."""
RINGINGS = tuple(
    (hertz, ratio) for ratio, count in ((0.02, 72), (0.06, 36), (0.2, 18))
    for hertz in np.geomspace(120.0, 2600.0, count)
)  # fmt: skip
"""Frequency at which the cam rings on the shaft [Hz] and damping ratio: the true ones stand in a narrow dip."""
RINGINGS_KEPT = 3
APART = 1.1
"""Least ratio of two frequencies of ringing that are followed."""
FAR = 30.0
"""A structure whose chi-square exceeds the best one's by this factor (and what is unexplained) gets no more starts."""
HELPED, MOST_MOVES = 0.7, 14
"""Ratio of chi-squares below which a move has helped much, and how many are made at most."""
Hops = tuple[tuple[float, int], ...]
HOPS: Hops = ((DOUBTFUL, 6), (DISSATISFYING, 20))
HOP_SMOOTHINGS_DEG = (1.5, 0.0, 0.0)
"""Chi-square above which the best start hops, and hops at most; ladder that each walks down."""
JUDGED = "judged on both halves"
FALLEN = 1e12
"""Chi-square of a start so near an edge that the tangents overflow on the other half of the cycles."""
REDRAWN = (
    tuple(row.name for row in chamber.ROWS if row.role == "shared" and row not in valve.ROWS),
    tuple(row.name for row in valve.ROWS),
)
"""Parameters that are drawn anew together: liquid, ports and leakage, or the delivery valve."""
Items = dict[str, list[FitData]]
"""Recordings with their rows' starts, by structure."""


def with_hub(item: FitData, hertz: float, soft: float) -> FitData:
    """Return a start with a hub that swings on a yielding coupling, lightly damped."""
    return with_starts(item, {
        "coupling_resonance": 2.0 * np.pi * hertz, "coupling_compliance": soft, "coupling_damping": 0.07
    })  # fmt: skip


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
    items = [with_hub(item, *hub) for item in shafts for hub in HUBS]
    for smoothing, iterations, kept in HUB_RUNGS:
        ends = [continued(item, smoothing, False, iterations) for item in items]
        order = sorted((end for end in ends if end), key=lambda end: end.chi_square)
        items = [end.data for end in order[:kept]]
    return items


def with_ringing(best: Start) -> list[FitData]:
    """Return the best start with the shaft ringing at other frequencies, lightly damped: the best of a scan.

    Ringing is invisible while the residual is smoothed, and an overdamped shaft does not find it afterwards.
    """
    scored = []
    for hertz, ratio in RINGINGS:
        item = with_starts(best.data, {"shaft_resonance": 2.0 * np.pi * hertz, "shaft_damping_ratio": ratio})
        scored.append((begun(item, best.lifts), hertz, item))
    kept: list[tuple[float, FitData]] = []
    for _, hertz, item in sorted(scored, key=lambda one: one[0]):
        if len(kept) < RINGINGS_KEPT and all(max(hertz / f, f / hertz) > APART for f, _ in kept):
            kept.append((hertz, item))
    return [item for _, item in kept]


def rescanned(start: Start, structure: str) -> list[FitData]:
    """Return a start in the same or another structure with the end of delivery at the best places of a scan."""
    item = replace(start.data, structure=structure)
    if structure == "open":
        return [with_starts(item, {"retraction_volume": volume}) for volume in RETRACTIONS]
    rest: dict[str, float] = {}
    if structure == "spill" and start.data.structure != "spill":
        rest = expected(item, ("spill_width", "spill_span"))
    tried = [with_starts(item, {**end, **rest}) for end in ends_at(item, SCAN_SHARES)]
    return sorted(tried, key=lambda trial: begun(trial, (no_lift(),)))[:SCAN_KEPT]


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


def redrawn(start: Start, names: Iterable[str], seed: int) -> FitData:
    """Return a start with some parameters drawn from what is expected of them."""
    rng = np.random.default_rng(seed)
    drawn = {}
    for row in (start.data.rows[name] for name in names):
        if row.prior:
            value = row.prior[0] + row.prior[1] * float(rng.standard_normal())
            drawn[row.name] = min(max(value, row.lower), row.upper)
    return with_starts(start.data, drawn)


def hops(result: dict[str, list[Start]], most: Hops, held: FitData) -> Iterator[tuple[str, dict[str, list[Start]]]]:
    """Yield the starts with those that follow from drawing the chamber or the valve of the best one anew.

    Valve and liquid stand in for one another in many ways, each a minimum of its own that no small step leaves. From
    here on a start is worth what it is on both halves of the cycles.
    """
    result = judged(result, held)
    yield JUDGED, result
    for hop in range(max(count for _, count in most)):
        best = least(result)
        if not any(best.chi_square > above and hop < count for above, count in most):
            break
        items = {best.data.structure: [redrawn(best, REDRAWN[hop % len(REDRAWN)], hop)]}
        result = joined(result, judged(descend(items, HOP_SMOOTHINGS_DEG, False), held))
        yield "hop", result


def judged(starts: Starts, held: FitData) -> dict[str, list[Start]]:
    """Return starts with the mean of their chi-square on both halves of the cycles, least first."""
    return {name: sorted((_judged(start, held) for start in group), key=lambda start: start.chi_square)
            for name, group in starts.items()}  # fmt: skip


def _judged(start: Start, held: FitData) -> Start:
    try:
        there = begun(on_other_half(start.data, held), start.lifts)
    except (FloatingPointError, np.linalg.LinAlgError):
        there = FALLEN
    return replace(start, chi_square=0.5 * (start.chi_square + there))


def load_anew(result: Starts, rough: FitData) -> Items:
    """Return first starts of all structures on the shaft, hub and drive that were found.

    A cam that swings at a resonance keeps every start from the load until the swing is known.
    """
    rows = least(result).data.rows
    found = {name: rows[name].start for name in SHAFT}
    return {name: [with_starts(item, found) for item in candidates(rough, name)] for name in result if name != "line"}


def scanned_again(result: Starts, _rough: FitData) -> Items:
    """Return the best start in every likely structure with the end of delivery where a scan puts it."""
    return {name: rescanned(least(result), name) for name in likely(result)}


def of_the_best(more: Callable[[Start], list[FitData]]) -> Callable[[Starts, FitData], Items]:
    """Return a move that changes the best start within its structure."""
    return lambda result, _rough: {least(result).data.structure: more(least(result))}


@dataclass(frozen=True)
class Move:
    """Further starts from what was found so far.

    starts : from the starts so far and the recording on the search's grid
    smoothings : ladder that they walk down
    above : chi-square of the best start above which the move is made
    """

    starts: Callable[[Starts, FitData], Items]
    smoothings: tuple[float, ...]
    above: float


MOVES: dict[str, Move] = {
    "end of delivery": Move(scanned_again, SMOOTHINGS_DEG[2:], 0.0),
    "ringing": Move(of_the_best(with_ringing), UNSMOOTHED, DOUBTFUL),
    "hub": Move(of_the_best(with_hubs), UNSMOOTHED, DOUBTFUL),
    "load anew": Move(load_anew, SMOOTHINGS_DEG, UNEXPLAINED),
    "hub alone": Move(of_the_best(with_hubs_alone), UNSMOOTHED, UNEXPLAINED),
}
"""Moves in the order in which they are tried; after one that helps much, all are tried again, that one too."""


def search(data: FitData, held: FitData, structures: tuple[str, ...]) -> dict[str, list[Start]]:
    """Return the best starts of each structure, least mean chi-square of both halves of the cycles first."""
    *_, (_, result) = stages(data, held, structures)
    return result


def stages(
    data: FitData, held: FitData, structures: tuple[str, ...], most: Hops = HOPS
) -> Iterator[tuple[str, dict[str, list[Start]]]]:
    """Yield what was done last and the best starts of each structure so far, until the search ends.

    Further moves are for recordings that are not explained yet; each is made again after others have helped much.

    Parameters
    ----------
    data, held : the half of the cycles that is fitted and the other one
    structures : that are tried
    most : hops between minima
    """
    seen = rough(data)
    first = descend({name: candidates(seen, name) for name in structures}, SMOOTHINGS_DEG, True)
    result = {name: first.get(name, []) for name in structures}
    yield "first starts", result
    if not set(first) - {"line"}:
        return
    pending = dict(MOVES)
    for _ in range(MOST_MOVES):
        before = least(result).chi_square
        name = next((name for name, move in pending.items() if before > move.above), None)
        if name is None:
            break
        move = pending.pop(name)
        items = {structure: group for structure, group in move.starts(result, seen).items() if group}
        result = joined(result, descend(items, move.smoothings, False))
        yield name, result
        if least(result).chi_square < HELPED * before:
            pending = dict(MOVES)
    yield from hops(result, most, held)


def likely(result: Starts) -> list[str]:
    """Return the structures with a chamber that are not far behind the best one; all of them where none explains."""
    best = least(result).chi_square
    limit = FAR * best + UNEXPLAINED
    return [name for name, group in result.items()
            if name != "line" and (best > UNEXPLAINED or (group and group[0].chi_square < limit))]  # fmt: skip


def joined(one: Starts, other: Starts) -> dict[str, list[Start]]:
    """Return the starts of both by structure, best first."""
    return {name: sorted([*group, *other.get(name, [])], key=lambda start: start.chi_square)
            for name, group in one.items()}  # fmt: skip


def least(result: Starts) -> Start:
    """Return the start of least chi-square among those with a chamber."""
    return min((group[0] for name, group in result.items() if group and name != "line"), key=lambda s: s.chi_square)
