"""Where something is left that no law knows, the residual weighs less there and the rest keeps its say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import local_error
from camtorque.fit.local_error import LOCAL_FROM, REACH, local_factor, weighed_locally
from camtorque.fit.minima import Candidate, Halves, at_minimum
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.residual import explains
from camtorque.fit.uncertainty import covariance
from camtorque.laws.chain import BINS
from fit_cases import quick, quick_data

LAND = ("closed_volume", 0, 1000.0)
AS_EXPECTED = np.sqrt(INDEPENDENT / BINS)


def with_burst(size: float) -> tuple[Candidate, Halves]:
    """Return the minimum of a rig whose torque rings by a share of its peak over 30 degrees of the return."""
    data = quick_data(LAND)
    place = np.arange(BINS)
    near = np.exp(-(((place - 170.0) / 15.0) ** 2))
    torque = data.torque + size * np.max(data.torque) * near * np.cos(0.45 * place)
    data = replace(quick(LAND).data, torque=torque)
    halves = Halves(data, data)
    found = halves.minimum(at_minimum, data)
    assert found is not None
    return found, halves


def test_a_residual_that_its_weights_allow_weighs_as_it_did() -> None:
    assert np.all(local_factor(AS_EXPECTED * np.ones(BINS)) == pytest.approx(1.0))
    assert np.all(local_factor(np.zeros(BINS)) == 1.0)


def test_a_burst_weighs_less_about_itself_alone() -> None:
    residual = np.zeros(BINS)
    residual[100:110] = 10.0
    factor = local_factor(residual)
    reach = round(REACH * BINS)
    assert np.all(factor[100 - reach : 110 + reach] > 5.0)
    assert np.all(factor[110 + reach :] == 1.0)


def test_a_fit_that_leaves_no_more_than_expected_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    found, halves = with_burst(0.0)
    monkeypatch.setattr(local_error, "LOCAL_FROM", 1.01 * covariance(found.problem, found.solution).inflation)
    assert weighed_locally([found], halves, 1e-3)[0] is found


def test_what_was_explained_stays_so() -> None:
    """A burst of 2 % of the peak is left where it weighs less: as much as is explained, of torque known to 1e-3 N m."""
    pulled, halves = with_burst(0.02)
    for odd_even in (1e-3, 1.0):
        (found,) = weighed_locally([pulled], halves, odd_even)
        assert explains(found.data, found.solution, odd_even) >= explains(pulled.data, pulled.solution, odd_even)


def test_what_no_law_knows_pulls_the_values_less() -> None:
    truth, _ = with_burst(0.0)
    pulled, halves = with_burst(0.03)
    before = covariance(pulled.problem, pulled.solution).inflation
    assert before > 10.0 * LOCAL_FROM
    (found,) = weighed_locally([pulled], halves, 1.0)
    assert covariance(found.problem, found.solution).inflation < 0.1 * before  # weights and residual settle together
    std = covariance(truth.problem, truth.solution).std
    off = [np.sqrt(np.mean(((item.solution.z - truth.solution.z) / std) ** 2)) for item in (pulled, found)]
    assert off[1] < 0.7 * off[0]
