"""Hops between minima and scans of the driveline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import search, swings
from camtorque.fit.problem import build_problem, with_starts
from camtorque.fit.starts import Start, continued, on_search_grid
from camtorque.laws.chain import evaluate
from fit_cases import quick, quick_data

LAND = ("closed_volume", 0, 1000.0)


@pytest.fixture(scope="module")
def found():
    minimum = quick(LAND)
    start = Start(quick_data(LAND), minimum.solution.lifts, minimum.value)
    other = replace(start, data=replace(start.data, structure="spill"), chi_square=2.0 * minimum.value)
    return search.Found({"land": [start], "spill": [other]}, ((start, minimum),))


def test_hops_draw_one_part_anew_and_leave_the_others(found):
    for hop, names in enumerate(search.REDRAWN):
        drawn = search.hop_from(found, hop, False)
        assert drawn.structure == "land"
        before = found.start.data.rows
        changed = {name for name, row in drawn.rows.items() if row.start != before[name].start}
        assert changed
        assert changed <= set(names)


def test_hops_begin_in_another_structure_now_and_then_where_nothing_satisfies(found):
    structures = [search.hop_from(found, hop, True).structure for hop in range(2 * search.ELSEWHERE)]
    assert structures.count("spill") == 2
    assert structures[search.ELSEWHERE - 1] == "spill"


@pytest.mark.parametrize(
    ("scan", "place"), [(swings.with_ringing, "shaft_resonance"), (swings.with_couplings, "coupling_resonance")]
)
def test_a_scan_of_the_driveline_keeps_frequencies_that_are_apart(found, scan, place):
    start = continued(quick_data(LAND), 0.0, core=False, iterations=2)
    tried = np.sort([item.rows[place].start for item in scan(start)])
    assert tried.size == swings.SCANNED_KEPT
    assert np.min(tried[1:] / tried[:-1]) > swings.APART


def test_a_scan_finds_the_coupling_that_a_start_has_lost(found):
    data = quick_data(LAND)
    soft = {"coupling_resonance": 2.0 * np.pi * 700.0, "coupling_compliance": 60e-6, "coupling_damping": 0.1}
    there = continued(on_search_grid(with_starts(data, soft)), 0.0, core=False, iterations=0)
    assert there is not None
    problem = build_problem([there.data])
    torque = evaluate(there.data.chain, problem.values(problem.start, 0)[0]).torque
    lost = with_starts(replace(there.data, torque=torque), {"coupling_compliance": 0.0})
    best = swings.with_couplings(Start(lost, there.lifts, 0.0))[0]
    assert best.rows["coupling_resonance"].start == pytest.approx(soft["coupling_resonance"], rel=0.2)
