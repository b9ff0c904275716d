"""Hops between minima and scans of the driveline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import search, starts
from camtorque.fit.problem import build_problem, with_starts
from camtorque.fit.starts import Start, continued, on_search_grid
from camtorque.laws.chain import evaluate
from camtorque.laws.driveline import COMPLIANCE_NAMES, cam_side_inertia, compliances, shaft_transfer
from fit_cases import quick, quick_data

LAND = ("closed_volume", 0, 1000.0)


@pytest.fixture(scope="module")
def found():
    minimum = quick(LAND)
    start = Start(quick_data(LAND), minimum.solution.lift, minimum.value)
    other = replace(start, data=replace(start.data, structure="spill"), chi_square=2.0 * minimum.value)
    return search.SearchState({"land": [start], "spill": [other]}, ((start, minimum),))


def test_hops_draw_one_part_anew_and_leave_the_others(found):
    for hop, names in enumerate(search.REDRAWN):
        drawn = search.hop_from(found, hop, False)
        assert drawn.structure == "land"
        before = found.start.data.rows
        changed = {name for name, row in drawn.rows.items() if row.start != before[name].start}
        assert changed
        assert changed <= set(names)


def test_a_structure_that_lost_all_its_starts_is_tried_again(found):
    ((start, minimum),) = found.minima
    far = replace(start, chi_square=1e9 * start.chi_square)
    lost = search.SearchState({"land": [start], "spill": [], "open": [far], "line": [start]}, ((start, minimum),))
    assert lost.value <= search.UNEXPLAINED
    assert search.likely(lost) == ["land", "spill"]
    assert {item.structure for item in search.scanned_again(lost, start.data)["spill"]} == {"spill"}


def test_hops_begin_in_another_structure_now_and_then_where_nothing_satisfies(found):
    structures = [search.hop_from(found, hop, True).structure for hop in range(2 * search.ELSEWHERE)]
    assert structures.count("spill") == 2
    assert structures[search.ELSEWHERE - 1] == "spill"


@pytest.mark.parametrize(
    ("swings", "place"), [(starts.RINGINGS, "shaft_resonance"), (starts.COUPLINGS, "coupling_resonance")]
)
def test_a_scan_of_the_driveline_keeps_frequencies_that_are_apart(found, swings, place):
    start = continued(quick_data(LAND), 0.0, core=False, iterations=2)
    tried = np.sort([item.rows[place].start for item in starts.scanned(start, swings, place)])
    assert tried.size == starts.SCANNED_KEPT
    assert np.min(tried[1:] / tried[:-1]) > starts.APART


def test_a_scan_finds_the_coupling_that_a_start_has_lost(found):
    data = quick_data(LAND)
    soft = {"coupling_resonance": 2.0 * np.pi * 700.0, "coupling_compliance": 60e-6, "coupling_damping": 0.1}
    there = continued(on_search_grid(with_starts(data, soft)), 0.0, core=False, iterations=0)
    assert there is not None
    problem = build_problem([there.data])
    torque = evaluate(there.data.chain, problem.values(problem.start, 0)[0]).torque
    lost = with_starts(replace(there.data, torque=torque), {"coupling_compliance": 0.0})
    best = starts.scanned(Start(lost, there.lift, 0.0), starts.COUPLINGS, "coupling_resonance")[0]
    assert best.rows["coupling_resonance"].start == pytest.approx(soft["coupling_resonance"], rel=0.2)


MIRRORED = {
    "shaft_compliance": 300e-6, "shaft_resonance": 2.0 * np.pi * 300.0, "half_inertia": 1.1e-3, "half_place": 0.3,
    "half_damping": 0.0,
}  # fmt: skip
"""A coupling's half, with less than half of the compliance between it and a cam of 0.94 g m^2."""


def on_a_heavy_cam(data, cam):
    return replace(data, chain=replace(data.chain, pump=replace(data.chain.pump, cam_inertia=cam)))


def test_a_pump_without_a_port_starts_with_a_suction_valve_on_drives_that_yield(found, monkeypatch):
    monkeypatch.setattr(search, "with_hubs", lambda start: [with_starts(start.data, {"coupling_damping": 0.07})])
    seen = found.start.data
    moved = search.through_suction_valve(replace(found, starts={**found.starts, "open": []}), seen)
    assert list(moved) == ["open"]
    assert len(moved["open"]) == 2
    for item in moved["open"]:
        assert item.rows["port_closing_lift"].start == item.rows["port_closing_lift"].lower
        assert item.rows["suction_area"].start > item.rows["valve_area"].start
    assert search.through_suction_valve(found, seen) == {}  # whose pump is not asked for that way of ending


def test_shafts_that_ring_alike_pass_the_torque_alike_and_turn_no_lighter_cam():
    item = on_a_heavy_cam(with_starts(quick_data(LAND), MIRRORED), 1.15e-3)
    omega = 2.0 * np.pi * np.linspace(0.0, 1500.0, 40)
    held = {name: item.rows[name].start for name in COMPLIANCE_NAMES} | {
        "shaft_damping_ratio": 0.0, "drive_admittance": 0.0, "coupling_compliance": 0.0,
    }  # fmt: skip

    def passed(values):
        both = compliances(omega, np.array([values[name] for name in COMPLIANCE_NAMES]), False)
        return shaft_transfer(omega, values, both)[0]

    shafts = starts.ringing_alike(item)
    assert len(shafts) >= 3
    for shaft in shafts:
        assert cam_side_inertia(held | shaft) >= 1.15e-3 * (1.0 - 1e-12)
        alike = passed(held | shaft | {"shaft_damping_ratio": 0.0})
        np.testing.assert_allclose(1.0 / alike, 1.0 / passed(held), rtol=1e-9, atol=1e-9)
    # a cam that weighs more than all that rings leaves none
    assert starts.ringing_alike(on_a_heavy_cam(item, 1.0)) == []


def test_a_start_whose_cam_is_too_light_finds_the_shaft_that_rings_alike(found):
    shaft = starts.ringing_alike(on_a_heavy_cam(with_starts(quick_data(LAND), MIRRORED), 1.3e-3))[0]
    data = on_a_heavy_cam(with_starts(quick_data(LAND), shaft), 1.3e-3)
    there = continued(on_search_grid(data), 0.0, core=False, iterations=0)
    problem = build_problem([there.data])
    torque = evaluate(there.data.chain, problem.values(problem.start, 0)[0]).torque
    lost = with_starts(replace(there.data, torque=torque), MIRRORED)
    best = starts.with_heavier_cams(Start(lost, there.lift, 0.0))[0]
    for name in ("shaft_compliance", "half_place"):
        assert best.rows[name].start == pytest.approx(shaft[name], rel=0.3), name
