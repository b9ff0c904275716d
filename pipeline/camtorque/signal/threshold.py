"""Numbers that decide what becomes of data: each with its unit, its reason and what it was set on.

They are numbers like any other, so that a rule reads as it always did; `docs/thresholds.md` lists them all.
"""

from __future__ import annotations

from typing import Self

BASES = {
    "physics": "follows from what a shaft, a sensor or a logger can do",
    "statistics": "odds or efficiencies of a test, whatever the data",
    "simulated rigs": "set on rigs simulated by the tests, with margin; other rigs may lie closer",
    "recordings": "set on recordings of real rigs",
    "convention": "a choice that users may have made otherwise",
}
"""What a threshold was set on -> what that means."""


class _Reasoned:
    """A number with its unit (``1``: none), what it was set on (key of `BASES`), and why it is what it is."""

    unit: str
    basis: str
    reason: str

    def __new__(cls, value: float, unit: str, basis: str, reason: str) -> Self:
        """Return a number that knows where it comes from."""
        self = super().__new__(cls, value)  # type: ignore[call-arg]
        self.unit, self.basis, self.reason = unit, basis, reason
        return self

    def __getnewargs__(self) -> tuple[float, str, str, str]:
        """Copy and pickle with all that it knows."""
        return self.real, self.unit, self.basis, self.reason  # type: ignore[attr-defined]


class Threshold(_Reasoned, float):  # type: ignore[misc]
    """A number that decides."""


class Count(_Reasoned, int):  # type: ignore[misc]
    """A whole number that decides."""
