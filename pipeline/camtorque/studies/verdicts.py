"""From an attempt to a verdict: a refusal is loud, a finding makes an error known, an unknown error is silent."""

from __future__ import annotations

from collections.abc import Callable

from camtorque.records import Refusal
from camtorque.studies.table import Cell

Outcome = float | tuple[float, str]
"""Error on a scale that the caller chooses; with what the user is told beside the number, if anything."""


def judge(error: float, told: str, good: float, bad: float, shown: str) -> tuple[str, str]:
    """Return verdict and detail of a number: below ``good`` it works, below ``bad`` or told it degrades."""
    text = f"{shown} {error:.1e}" + (f"; told: {told}" if told else "")
    if error <= good:
        return "works", text
    if error <= bad or told:
        return "degrades", text
    return "fails silently", text


def cell(
    condition: str,
    method: str,
    attempt: Callable[[], Outcome],
    limits: tuple[float, float],
    shown: str = "error",
    default: bool = False,
) -> Cell:
    """Return the verdict on one attempt; ``limits`` are the errors up to which it works and degrades.

    A `Refusal` fails loudly with its text; so do the errors that numerical libraries raise.
    """
    try:
        outcome = attempt()
    except (Refusal, ValueError, ArithmeticError) as problem:
        return Cell(condition, method, "fails loudly", str(problem).splitlines()[0], default)
    error, told = outcome if isinstance(outcome, tuple) else (outcome, "")
    return Cell(condition, method, *judge(error, told, *limits, shown), default=default)
