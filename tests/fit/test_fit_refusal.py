"""What the fit does where nothing can be fitted."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.fit import minima, search, single
from camtorque.fit.starts import Start
from camtorque.records import Refusal
from fit_cases import quick, quick_data

LAND = ("closed_volume", 0, 1000.0)


def overflowing(*_, **__):
    raise FloatingPointError("the derivative of the chain is not finite")


def test_starts_that_all_overflow_are_refused(monkeypatch):
    data = quick_data(LAND)
    start = Start(data, quick(LAND).solution.lift, 1.0)
    for room in (search, single):
        monkeypatch.setattr(room, "followed", overflowing)
    halves = minima.Halves(data, data)
    seen = search.SearchData(halves, np.zeros(data.chain.theta.size))
    found = search.extended(search.SearchState({"land": []}), {"land": [start]}, seen)
    assert found.minima == ()
    assert found.best is None
    assert not list(search.hops(found, seen, search.HOPS))
    with pytest.raises(Refusal, match="no start from which the model of this pump can be fitted"):
        single.every_structure(found, halves)


def test_an_attempt_that_overflows_is_none():
    assert minima.attempted(overflowing) is None
