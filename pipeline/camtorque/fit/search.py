"""Where the fit starts: all structures, many starts, moves of the best one, hops between minima.

A move brings further starts from what was found so far: the end of delivery scanned, other ringings and hubs, the load
begun anew. A hop draws the liquid or the valve of the best start anew. Each walks down the ladder of `fit.starts`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from camtorque.fit.minima import Candidate, Halves, beside, followed, lost_torque
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import FitData, in_structure, with_starts
from camtorque.fit.residual import explains
from camtorque.fit.solver import no_lift
from camtorque.fit.starts import (
    COUPLINGS,
    RETRACTIONS,
    RINGINGS,
    SMOOTHINGS_DEG,
    Start,
    Starts,
    chi_square_at_start,
    compile_in_two,
    descend,
    ends_at,
    expected,
    first_starts,
    on_search_grid,
    scanned,
    with_heavier_cams,
    with_hubs,
    with_hubs_alone,
)
from camtorque.laws import chamber, valve
from camtorque.laws.chain import SENSOR_NAMES
from camtorque.laws.driveline import COMPLIANCE_NAMES, COUPLING_NAMES
from camtorque.process.second_process import in_two
from camtorque.records import Array

UNSMOOTHED = (0.0, 0.0)
SCAN_SHARES = tuple(np.linspace(0.3, 0.97, 14))
SCAN_KEPT = 2
UNSURE, DOUBTFUL, SUSPECT, DISSATISFYING, UNEXPLAINED = 20.0, 35.0, 45.0, 100.0, 5.0 * INDEPENDENT
"""Chi-square left to explain above which cheap moves are made, it hops, dear moves are, it hops on, all is in doubt.

The parameters take some 20 of the 60 independent values, so that a residual as large as expected leaves 40;
the weights admit somewhat more than benches show.
"""
FAR = 30.0
"""A structure whose chi-square exceeds the best one's by this factor (and what is unexplained) gets no more starts."""
POLISHED, OF_A_STRUCTURE = 3, 2
"""New starts that are followed to their minimum on the fine grid, in all and of one structure."""
PROMISING_TIMES, PROMISING_PLUS = 10.0, 300.0
"""A start is followed while its chi-square is below the best start's times and plus these."""
HELPED, MOST_MOVES = 0.7, 30
"""Ratio of chi-squares below which a move has helped much, and how many are made at most."""
Hops = tuple[tuple[float, int], ...]
HOPS: Hops = ((DOUBTFUL, 6), (DISSATISFYING, 12))
HOP_SMOOTHINGS_DEG = (1.5, 0.0, 0.0)
"""Chi-square left to explain above which the best start hops, and hops at most; ladder that each walks down."""
REDRAWN = (
    tuple(row.name for row in chamber.ROWS if row.role == "shared" and row not in valve.ROWS),
    tuple(row.name for row in valve.ROWS),
    (*COUPLING_NAMES, *SENSOR_NAMES),
)
"""Parameters that are drawn anew together: liquid, ports and leakage; the delivery valve; couplings and transducer."""
SUCTION = 3.0
"""Area of a suction valve at first, over that of a delivery valve: 1 bar fills what 10 bar deliver."""
ELSEWHERE = 4
"""A hop of so many begins in another structure, where nothing satisfies yet."""
Items = dict[str, list[FitData]]
"""Recordings with their rows' starts, by structure."""


@dataclass(frozen=True)
class SearchData:
    """Both halves of a recording as a search sees them.

    ``lost`` is the torque that twists the shaft unseen by the transducer, on the fine grid [N m].
    """

    halves: Halves
    lost: Array

    @property
    def twisted(self) -> FitData:
        """The half that is fitted, whose shaft is twisted by what the transducer does not see as well."""
        data = self.halves.fitted
        return replace(data, chain=replace(data.chain, shaft_torque=data.chain.shaft_torque + self.lost))

    @property
    def on_search_grid(self) -> FitData:
        """The half that is fitted on the grid of the search."""
        return on_search_grid(self.twisted)

    def left_to_explain(self, found: SearchState) -> float:
        """Return what the best minimum leaves to explain; one that a report calls unexplained leaves much."""
        if found.best is None:
            return np.inf
        _, minimum = found.best
        fitted, other = self.halves.fitted, self.halves.other
        odd_even = float(np.sqrt(np.mean((fitted.torque - other.torque) ** 2)))
        explained = explains(fitted, minimum.solution, odd_even)
        return minimum.left_to_explain if explained else max(minimum.left_to_explain, DISSATISFYING + 1.0)


@dataclass(frozen=True)
class SearchState:
    """What a search has found so far.

    starts : on the search's grid by structure, least chi-square first
    minima : on the fine grid, each with the start that led to it, least mean chi-square of both halves first
    """

    starts: Mapping[str, list[Start]]
    minima: tuple[tuple[Start, Candidate], ...] = ()

    @property
    def best(self) -> tuple[Start, Candidate] | None:
        """The best minimum with a chamber, where one is looked for."""
        chambers = self.starts.keys() - {"line"}
        return next((pair for pair in self.minima if not chambers or pair[1].data.structure != "line"), None)

    @property
    def start(self) -> Start:
        """The start that led to the best minimum, moved to where that is."""
        assert self.best is not None
        start, minimum = self.best
        rows = minimum.data.rows
        return replace(start, data=with_starts(start.data, {name: row.start for name, row in rows.items()}))

    @property
    def value(self) -> float:
        """Chi-square of the best minimum."""
        return self.best[1].value if self.best else np.inf


def rescanned(start: Start, structure: str) -> list[FitData]:
    """Return a start in the same or another structure with the end of delivery at the best places of a scan."""
    item = in_structure(start.data, structure)
    if structure == "open":
        return [with_starts(item, {"retraction_volume": volume}) for volume in RETRACTIONS]
    rest: dict[str, float] = {}
    if structure == "spill" and start.data.structure != "spill":
        rest = expected(item, ("spill_width", "spill_span"))
    tried = [with_starts(item, {**end, **rest}) for end in ends_at(item, SCAN_SHARES)]
    return sorted(tried, key=lambda trial: chi_square_at_start(trial, no_lift(trial.chain.bins)))[:SCAN_KEPT]


def redrawn(start: Start, names: Iterable[str], seed: int) -> FitData:
    """Return a start with some parameters drawn from what is expected of them."""
    rng = np.random.default_rng(seed)
    drawn = {}
    for row in (start.data.rows[name] for name in names):
        if row.prior:
            value = row.prior[0] + row.prior[1] * float(rng.standard_normal())
            drawn[row.name] = min(max(value, row.lower), row.upper)
    return with_starts(start.data, drawn)


def hop_from(found: SearchState, hop: int, elsewhere: bool) -> FitData:
    """Return the best start with one part of it drawn anew; ``elsewhere``: now and then that of another structure."""
    start, part = found.start, hop
    others = [name for name in likely(found) if name != start.data.structure and found.starts[name]]
    if elsewhere and others and hop % ELSEWHERE == ELSEWHERE - 1:
        part = hop // ELSEWHERE
        start = found.starts[others[part % len(others)]][0]
    return redrawn(start, REDRAWN[part % len(REDRAWN)], hop)


def hops(found: SearchState, seen: SearchData, most: Hops) -> Iterator[tuple[str, SearchState]]:
    """Yield what was found with what follows from drawing liquid, valve or driveline of the best minimum anew.

    They stand in for one another in many ways, each a minimum of its own that no small step leaves. Two at a time hop
    from the same minimum, one for each process: one of fourteen finds anything.
    """
    for hop in range(0, max(count for _, count in most), 2):
        left = seen.left_to_explain(found)
        if found.best is None or not any(left > above and hop < count for above, count in most):
            break
        items: Items = {}
        for drawn in (hop_from(found, number, left > DISSATISFYING) for number in (hop, hop + 1)):
            items.setdefault(drawn.structure, []).append(drawn)
        found = extended(found, descend(items, HOP_SMOOTHINGS_DEG, False), seen)
        yield "hops", found


def outlet_opening_again(start: Start) -> list[FitData]:
    """Return a start that ends by a land with its outlet opening the other way on the return, where it is not."""
    if start.data.structure != "land":
        return []
    share = start.data.rows["outlet_return"].start
    return [with_starts(start.data, {"outlet_return": 1.0 if share < 0.7 else 0.0})]


def load_anew(found: SearchState, seen: FitData) -> Items:
    """Return first starts of all structures on the shaft, hub and drive that were found.

    A cam that swings at a resonance keeps every start from the load until the swing is known.
    """
    rows = found.start.data.rows
    known = {name: rows[name].start for name in COMPLIANCE_NAMES}
    return {name: [with_starts(item, known) for item in first_starts(seen, name)]
            for name in found.starts if name != "line"}  # fmt: skip


def through_suction_valve(found: SearchState, seen: FitData) -> Items:
    """Return starts of a pump that no port fills, closed from the lowest lift on; on drives that yield, too.

    Where a line's pressure rests on the cam all around, such a drive moves the whole load.
    """
    if "open" not in found.starts:
        return {}
    item, *_ = first_starts(seen, "open")
    rows = item.rows
    known = {"port_closing_lift": rows["port_closing_lift"].lower, "suction_area": SUCTION * rows["valve_area"].start}
    item = with_starts(item, known)
    return {"open": [item, *with_hubs(Start(item, no_lift(item.chain.bins), np.inf))]}


def scanned_again(found: SearchState, _seen: FitData) -> Items:
    """Return the best start in every likely structure with the end of delivery where a scan puts it."""
    start = found.start
    return {name: rescanned(start, name) for name in likely(found)}


def within_structure(more: Callable[..., list[FitData]], *given: object) -> Callable[[SearchState, FitData], Items]:
    """Return a move that changes the best start within its structure; ``given`` stands behind that start."""

    def moved(found: SearchState, _seen: FitData) -> Items:
        start = found.start
        return {start.data.structure: more(start, *given)}

    return moved


@dataclass(frozen=True)
class Move:
    """Further starts from what was found so far.

    starts : from what was found so far and the recording on the search's grid
    smoothings : ladder that they walk down
    above : chi-square left to explain above which the move is made
    """

    starts: Callable[[SearchState, FitData], Items]
    smoothings: tuple[float, ...]
    above: float


MOVES: dict[str, Move] = {
    "end of delivery": Move(scanned_again, SMOOTHINGS_DEG[2:], 0.0),
    "outlet on the return": Move(within_structure(outlet_opening_again), SMOOTHINGS_DEG[2:], UNSURE),
    "ringing": Move(within_structure(scanned, RINGINGS, "shaft_resonance"), UNSMOOTHED, UNSURE),
    "coupling": Move(within_structure(scanned, COUPLINGS, "coupling_resonance"), UNSMOOTHED, DOUBTFUL),
    "heavier cam": Move(within_structure(with_heavier_cams), UNSMOOTHED, SUSPECT),
    "hub": Move(within_structure(with_hubs), UNSMOOTHED, SUSPECT),
    "suction valve": Move(through_suction_valve, UNSMOOTHED, UNEXPLAINED),
    "load anew": Move(load_anew, SMOOTHINGS_DEG, UNEXPLAINED),
    "hub alone": Move(within_structure(with_hubs_alone), UNSMOOTHED, UNEXPLAINED),
}
"""Moves in the order in which they are tried; after one that helps much, all are tried again, that one too."""


def search(halves: Halves, structures: tuple[str, ...]) -> SearchState:
    """Return the best starts of each structure and the minima that they lead to."""
    *_, (_, found) = stages(halves, structures)
    return found


def stages(halves: Halves, structures: tuple[str, ...], most: Hops = HOPS) -> Iterator[tuple[str, SearchState]]:
    """Yield what was done last and what was found so far, until the search ends.

    Further moves are for recordings that are not explained yet; each is made again after others have helped much.
    """
    seen = SearchData(halves, np.zeros(halves.fitted.chain.theta.size))
    compile_in_two(seen.on_search_grid)
    first = descend({name: first_starts(seen.on_search_grid, name) for name in structures}, SMOOTHINGS_DEG, True)
    found = extended(SearchState({name: [] for name in structures}), first, seen)
    seen, found = with_lost_torque_anew(seen, found)
    yield "first starts", found
    pending = dict(MOVES)
    for move_number in range(MOST_MOVES):
        before, left = found.value, seen.left_to_explain(found)
        name = next((name for name, move in pending.items() if left > move.above), None)
        if name is None or not found.best or (move_number and left <= UNSURE):
            break
        move = pending.pop(name)
        items = {structure: group for structure, group in move.starts(found, seen.on_search_grid).items() if group}
        found = extended(found, descend(items, move.smoothings, False), seen)
        if found.value < HELPED * before:
            seen, found = with_lost_torque_anew(seen, found)
            pending = dict(MOVES)
        yield name, found
    yield from hops(found, seen, most)


def with_lost_torque_anew(seen: SearchData, found: SearchState) -> tuple[SearchData, SearchState]:
    """Return both halves with the torque that the transducer does not see at the best minimum, and that one again."""
    if found.best is None or found.value > UNEXPLAINED:
        return seen, found
    start, minimum = found.best
    seen = replace(seen, lost=lost_torque(minimum))
    return seen, extended(found, {start.data.structure: [found.start]}, seen)


def extended(found: SearchState, more: Starts, seen: SearchData) -> SearchState:
    """Return what was found with further starts and the minima that the promising ones among them lead to."""
    starts = {name: sorted([*group, *more.get(name, [])], key=lambda start: start.chi_square)
              for name, group in found.starts.items()}  # fmt: skip
    least = min((group[0].chi_square for group in starts.values() if group), default=0.0)
    new = sorted((start for group in more.values() for start in group[:OF_A_STRUCTURE]), key=lambda s: s.chi_square)
    new = [start for start in new[:POLISHED] if start.chi_square < PROMISING_TIMES * least + PROMISING_PLUS]
    follow = partial(followed, seen.twisted, effort=beside(found.value))
    ends = in_two(partial(seen.halves.minimum, follow), new)
    minima = [*found.minima, *((start, end) for start, end in zip(new, ends, strict=True) if end)]
    return SearchState(starts, tuple(sorted(minima, key=lambda pair: pair[1].value)))


def likely(found: SearchState) -> list[str]:
    """Return the structures with a chamber that are not far behind the best one; all of them where none explains.

    One whose starts were all lost on the way is not behind: nobody knows where it is.
    """
    names = [name for name in found.starts if name != "line"]
    if found.value > UNEXPLAINED or not names:
        return names
    limit = FAR * min(found.starts[name][0].chi_square for name in names if found.starts[name]) + UNEXPLAINED
    return [name for name in names if not found.starts[name] or found.starts[name][0].chi_square < limit]
