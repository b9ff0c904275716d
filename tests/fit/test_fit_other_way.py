"""What is turned round at a minimum, and what that finds."""

from __future__ import annotations

from dataclasses import replace

import pytest
from camtorque.fit.minima import at_minimum, judged
from camtorque.fit.other_way import GAINED, WAYS, turned, ways
from camtorque.fit.prepare import mean_cycles, other_half
from camtorque.fit.problem import with_starts
from camtorque.laws import ROWS
from fit_cases import bridged, quick, quick_data

LAND = ("closed_volume", 0, 1000.0)


@pytest.fixture(scope="module")
def halves():
    data = quick_data(LAND)
    return data, other_half(data, mean_cycles(bridged(LAND)[1]))


@pytest.fixture(scope="module")
def best(halves):
    return judged(quick(LAND), *halves)


def test_ways_are_values_that_a_parameter_may_have():
    for name, (low, high) in WAYS.items():
        row = ROWS[name]
        assert row.lower <= low < high <= row.upper, name
        # a draw of what is expected of it may be either
        mean, std = row.prior
        assert max(abs(low - mean), abs(high - mean)) < 2.0 * std, name


def test_one_thing_is_turned_at_a_time_where_a_minimum_leaves_doubt(best):
    items = turned(replace(best, unseen=100.0))
    changed = [
        {name for name, row in item.rows.items() if row.start != best.data.rows[name].start} for item in items
    ]  # fmt: skip
    assert [len(names) for names in changed] == [1] * len(items)
    assert {name for names in changed for name in names} == {name for name in WAYS if best.problem.index(name) >= 0}
    assert turned(replace(best, unseen=best.unseen - best.doubt)) == []


def test_an_outlet_that_opens_on_the_wrong_side_is_turned_round(best, halves):
    wrong = judged(at_minimum(with_starts(best.data, {"outlet_return": 1.0})), *halves)
    assert wrong.value > best.value + 100.0  # no small step leads back
    found = ways(wrong, *halves)[0]
    assert found.value < 0.1 * wrong.value
    assert found.solution.z[found.problem.index("outlet_return")] == pytest.approx(0.0, abs=0.05)


def test_what_gains_nothing_leaves_the_minimum_as_it_is(best, halves):
    settled = ways(best, *halves)[0]
    assert settled.value <= best.value
    again = ways(settled, *halves)
    assert again[0].value > settled.value - GAINED
    values = [item.value for item in again]
    assert values == sorted(values)
    assert len(values) == 1 + len(turned(settled))
