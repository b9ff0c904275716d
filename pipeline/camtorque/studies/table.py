"""What a study returns: measured points of charts, verdicts on attempts in maps, frozen, and written as JSON."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from camtorque.jsonable import jsonable
from camtorque.records import Refusal
from camtorque.report.files import short

LEAST_TIME = 2.0e-3
"""Shorter calls are repeated until they last this long [s]."""
VERDICTS = ("works", "degrades", "fails loudly", "fails silently")


@dataclass(frozen=True)
class Point:
    """One measured choice: its method, drawn as one line, what was varied along it, error and cost as the chart says.

    ``candidate`` is False where it answers another question (an engine without forces, a foreign step).
    """

    family: str
    setting: str
    error: float
    cost: float
    default: bool = False
    candidate: bool = True

    def __post_init__(self) -> None:
        if not (self.cost > 0.0 and math.isfinite(self.cost) and self.error >= 0.0):
            raise ValueError(
                f"{self.family}, {self.setting}: cost {self.cost} and error {self.error} are no measurement"
            )


@dataclass(frozen=True)
class Chart:
    """One work-precision chart.

    ``note`` says how error and cost were measured; ``given_cost`` is True where the user's data fix the cost (points of
    a lift table), so that choices compare by their error at the same cost.
    """

    name: str
    title: str
    error_label: str
    cost_label: str
    points: tuple[Point, ...]
    note: str = ""
    given_cost: bool = False


@dataclass(frozen=True)
class Cell:
    """How one method fares under one condition; ``detail`` is a figure, or the refusal that the user reads."""

    condition: str
    method: str
    verdict: str
    detail: str
    default: bool = False

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise ValueError(f"verdict is {self.verdict!r}, expected one of {VERDICTS}")
        if self.verdict == "fails loudly" and not self.detail:
            raise ValueError(f"{self.condition}, {self.method}: a loud failure has to say what is read")


@dataclass(frozen=True)
class StabilityMap:
    """Conditions by methods."""

    name: str
    title: str
    cells: tuple[Cell, ...]
    note: str = ""


@dataclass(frozen=True)
class Choice:
    """What becomes a `Point` once it is timed: its cost is the time of ``run`` over ``size`` angles, samples, ... ."""

    family: str
    setting: str
    error: float
    run: Callable[[], Any]
    size: int = 1
    default: bool = False
    candidate: bool = True


def measured(choices: Sequence[Choice], repeats: int) -> tuple[Point, ...]:
    """Return the choices with the time that each takes [s]."""
    times = shortest_times([choice.run for choice in choices], repeats)
    return tuple(
        Point(item.family, item.setting, item.error, time / item.size, item.default, item.candidate)
        for item, time in zip(choices, times, strict=True)
    )


def shortest_times(functions: Sequence[Callable[[], Any]], repeats: int) -> list[float]:
    """Return the least time of one call of each function [s], after one call to warm up.

    They take turns, so that other work of the machine hits all alike; short calls are repeated up to `LEAST_TIME`.
    """
    counts = [max(1, math.ceil(LEAST_TIME / max(_duration(function, 1), 1e-9))) for function in functions]
    best = [math.inf] * len(functions)
    for _ in range(repeats):
        for place, (function, count) in enumerate(zip(functions, counts, strict=True)):
            best[place] = min(best[place], _duration(function, count) / count)
    return best


def _duration(function: Callable[[], Any], count: int) -> float:
    start = time.perf_counter()
    for _ in range(count):
        function()
    return time.perf_counter() - start


def document(study: str, parts: Sequence[Chart | StabilityMap], quick: bool) -> dict[str, Any]:
    """Return a study as plain data."""
    return {"study": study, "quick": quick, "parts": [short(jsonable(asdict(part)), 4) for part in parts]}


Outcome = float | tuple[float, str]
"""Error on a scale that the caller chooses; with what the findings say beside the number, if anything."""


def cell(
    condition: str,
    method: str,
    attempt: Callable[[], Outcome],
    limits: tuple[float, float],
    shown: str = "error",
    default: bool = False,
) -> Cell:
    """Return the verdict on one attempt; ``limits`` are the errors up to which it works and degrades.

    What is told degrades, however large the error. A `Refusal` fails loudly with its text; so do the errors that
    numerical libraries raise.
    """
    try:
        outcome = attempt()
    except (Refusal, ValueError, ArithmeticError) as problem:
        return Cell(condition, method, "fails loudly", str(problem).splitlines()[0], default)
    error, told = outcome if isinstance(outcome, tuple) else (outcome, "")
    good, bad = limits
    verdict = "works" if error <= good else "degrades" if error <= bad or told else "fails silently"
    return Cell(condition, method, verdict, f"{shown} {error:.1e}" + (f"; told: {told}" if told else ""), default)
