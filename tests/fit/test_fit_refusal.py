"""What the fit does where nothing can be fitted."""

from __future__ import annotations

import pytest
from camtorque.fit import single
from camtorque.records import Refusal
from fit_cases import quick_data


def overflowing(*_):
    raise FloatingPointError("the derivative of the chain is not finite")


def test_starts_that_all_overflow_are_refused(monkeypatch):
    monkeypatch.setattr(single, "followed", overflowing)
    data = quick_data(("closed_volume", 0, 1000.0))
    start = type("Start", (), {"chi_square": 1.0})()
    with pytest.raises(Refusal, match="no start from which the model of this pump can be fitted"):
        single.polished(data, {"land": [start]})


def test_an_attempt_that_overflows_is_none():
    assert single.attempted(overflowing) is None
