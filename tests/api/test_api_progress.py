"""Progress: which part, how many, and how long the rest takes once one is done."""

from __future__ import annotations

import pytest
from camtorque import progress


def test_each_part_is_told_before_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([0.0, 30.0, 50.0])
    monkeypatch.setattr(progress.time, "perf_counter", lambda: next(now))
    lines: list[str] = []
    done = [(item, len(lines)) for item in progress.announced({"a": 1, "b": 2, "c": 3}, lines.append)]
    assert done == [(1, 1), (2, 2), (3, 3)]
    assert lines == ["a, 1 of 3", "b, 2 of 3, about 60 s left", "c, 3 of 3, about 25 s left"]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.1, "about 1 s"), (89.0, "about 89 s"), (600.0, "about 10 min"), (7200.0, "about 2.0 h")]
)
def test_a_time_is_told_as_a_person_says_it(seconds: float, text: str) -> None:
    assert progress.duration_text(seconds) == text
