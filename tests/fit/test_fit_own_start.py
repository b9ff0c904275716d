"""A pump that is metered at its inlet begins to deliver at a lift of its own in every recording."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.joint_fit import joint_covariance
from camtorque.fit.joint_input import FittedAlone, joint_input
from camtorque.fit.joint_solver import JointSolution, solve_many
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.own_start import (
    BEGIN,
    begins_apart,
    begun_as,
    begun_as_nearest,
    begun_elsewhere,
    predicted_to_begin,
    start_findings,
    with_own_starts,
)
from camtorque.fit.problem import Problem, build_problem, started_at
from camtorque.laws.chain import evaluate
from fit_cases import quick_prepared

LATER = (0.0, 0.4e-3, 0.9e-3)
"""Lift by which the port closes later in each recording [m]."""


def solved(inputs: list[FittedAlone]) -> tuple[Problem, JointSolution]:
    problem = build_problem([item.data for item in inputs])
    return problem, solve_many(problem, problem.start, 25)


@pytest.fixture(scope="module")
def alike() -> list[FittedAlone]:
    known = joint_input(quick_prepared("closed_volume", 0, 1000.0))
    speeds = (1.0, 1.1, 1.2)
    copies = [replace(known, data=replace(known.data, name=f"at {rate}")) for rate in speeds]
    problem, solution = solved(copies)
    items = started_at(problem, solution.z)
    return [replace(one, data=item) for one, item in zip(copies, items, strict=True)]


@pytest.fixture(scope="module")
def apart(alike: list[FittedAlone]) -> list[FittedAlone]:
    """Return the same with what the model says of a port that closes later in each, without anything else changed."""
    found = []
    for one, later in zip(alike, LATER, strict=True):
        problem = build_problem([one.data])
        values, linear = problem.values(problem.start, 0)
        moved = {**values, BEGIN[0]: values[BEGIN[0]] + later}
        before, after = (evaluate(one.data.chain, each, linear) for each in (values, moved))
        change = after.torque + after.linear @ linear - before.torque - before.linear @ linear
        found.append(replace(one, data=replace(one.data, torque=one.data.torque + change)))
    return found


def test_recordings_that_begin_at_lifts_of_their_own_are_met_by_those(apart: list[FittedAlone]) -> None:
    """A petrol pump metered by its inlet valve was met to 2.5 to 7 % by all its speeds together, each alone to 0.1."""
    shared = solved(apart)
    inputs, problem, solution = with_own_starts(apart, *shared, solved)
    assert begins_apart(problem)
    assert not begins_apart(shared[0])
    assert solution.chi_square < 0.1 * shared[1].chi_square
    assert all(item.data.rows[name].role == "own" and name not in item.alone for item in inputs for name in BEGIN)
    lifts = [z for one, z in zip(problem.parameters, solution.z, strict=True) if one.row.name == BEGIN[0]]
    np.testing.assert_allclose(np.diff(lifts), np.diff(LATER), atol=0.1e-3)
    (finding,) = start_findings(problem)
    assert finding.code == "own_starts"


def test_recordings_that_are_met_together_are_not_asked(alike: list[FittedAlone]) -> None:
    def never(_: object) -> tuple[Problem, JointSolution]:
        raise AssertionError("asked")

    shared = solved(alike)
    inputs, *kept = with_own_starts(alike, *shared, never)
    assert (inputs, *kept) == (alike, *shared)
    assert start_findings(shared[0]) == ()


def test_a_start_of_its_own_has_to_pay_for_itself(apart: list[FittedAlone]) -> None:
    shared = solved(apart)
    assert joint_covariance(*shared).inflation > 2.0
    worth = replace(shared[1], chi_square=0.99 * shared[1].chi_square)
    assert with_own_starts(apart, *shared, lambda used: (solved(used)[0], worth))[1] is shared[0]


def test_starts_of_their_own_that_overflow_leave_the_joint_fit_as_it_was(apart: list[FittedAlone]) -> None:
    """A campaign lost its joint fit by a trial that was not taken."""

    def overflowing(_: object) -> tuple[Problem, JointSolution]:
        raise FloatingPointError("overflow encountered in multiply")

    shared = solved(apart)
    assert with_own_starts(apart, *shared, overflowing) == (apart, *shared)


def test_a_blind_prediction_begins_as_the_nearest_other_recording(alike: list[FittedAlone]) -> None:
    data = alike[0].data
    own = replace(data, rows={**data.rows, BEGIN[0]: replace(data.rows[BEGIN[0]], role="own")})
    speed = data.chain.speed
    others = tuple(FittedAt(name, rate * speed, "land", 0.0, True) for name, rate in (("A", 0.7), ("B", 1.2)))
    names = ("leakage", "port_closing_lift__A", "port_closing_lift__B")
    known = KnownFit(names, np.array([0.0, 1.0e-3, 2.0e-3]), ArrowCovariance.whole(np.eye(3)), others)
    assert begun_as_nearest(known, own) == {"port_closing_lift": 2.0e-3}
    measured = replace(known, recordings=(*others, FittedAt("M", speed, "line", 0.0, True)))
    assert begun_as_nearest(measured, own) == {"port_closing_lift": 2.0e-3}, "of none but its own: blind it knew that"
    assert begun_as_nearest(known, data) == {}
    assert "begins at the lift at which that of B does" in predicted_to_begin(known, others[1], "")
    assert predicted_to_begin(known, replace(others[1], id="C"), "") == ""


def test_a_run_under_the_load_of_a_fitted_recording_begins_as_that_does() -> None:
    """It began as the recording nearest in speed: 20 rpm further its torque jumped by 12 %."""
    one, other = (FittedAt(name, speed, "land", 0.0, True) for name, speed in (("A", 50.0), ("B", 90.0)))
    names = ("port_closing_lift__A", "torque_zero__A", "leakage", "port_closing_lift__B", "torque_zero__B")
    known = KnownFit(names, np.arange(5.0), ArrowCovariance.whole(np.eye(5)), (one, other))
    assert begun_as(known, one, "B").own("A") == {"port_closing_lift": 3, "torque_zero": 1, "leakage": 2}
    for load in ("A", "", "a log.csv"):
        assert begun_as(known, one, load).own("A") == known.own("A")
    assert predicted_to_begin(known, one, "B").endswith("that of B does: in this pump each load begins elsewhere")


def test_a_load_that_was_not_fitted_begins_as_unsurely_as_fitted_ones_lie_apart() -> None:
    """Its torque was told to 1.7 % where left-out recordings of the same fit were 5 to 12 % off."""
    recordings = tuple(
        FittedAt(name, speed, "land", 0.0, True) for name, speed in (("A", 50.0), ("B", 70.0), ("C", 90))
    )
    names = tuple(f"port_closing_lift__{item.id}" for item in recordings)
    known = KnownFit(names, np.array([1.0e-3, 1.3e-3, 0.6e-3]), ArrowCovariance.whole(np.eye(3)), recordings)
    begun = begun_elsewhere(known, recordings[0], "a log.csv")["port_closing_lift"]
    assert (begun.value, begun.stderr) == (1.0e-3, pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2.0) * 1.0e-3))
    measured = replace(known, recordings=(*recordings, FittedAt("M", 80.0, "line", 0.0, True)))
    assert begun_elsewhere(measured, recordings[0], "a log.csv")["port_closing_lift"] == begun
    assert begun_elsewhere(known, recordings[0], "B") == begun_elsewhere(known, recordings[0], "") == {}
    assert begun_elsewhere(known, replace(recordings[0], id="D"), "a log.csv") == {}
    text = predicted_to_begin(known, recordings[0], "a log.csv")
    assert re.search("that of A does: .* and how far fitted ones lie apart is in the band", text)
