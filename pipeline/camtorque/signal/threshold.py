"""Numbers that decide what becomes of data: each with its unit, its reason and what it was set on.

They are numbers like any other, so that a rule reads as it always did; `docs/thresholds.md` lists them all.
"""

from __future__ import annotations

BASES = {
    "physics": "follows from what a shaft, a sensor or a logger can do",
    "statistics": "odds or efficiencies of a test, whatever the data",
    "simulated rigs": "set on rigs simulated by the tests, with margin; other rigs may lie closer",
    "recordings": "set on recordings of real rigs",
    "convention": "a choice that users may have made otherwise",
}
"""What a threshold was set on -> what that means."""


class Threshold(float):
    """A number with unit, reason and basis (key of `BASES`).

    Attributes
    ----------
    unit : of the number, ``1`` where it has none
    basis : what it was set on
    reason : why it is what it is
    """

    unit: str
    basis: str
    reason: str

    def __new__(cls, value: float, unit: str, basis: str, reason: str) -> Threshold:
        """Return a number that knows where it comes from."""
        self = super().__new__(cls, value)
        self.unit, self.basis, self.reason = unit, basis, reason
        return self

    def __getnewargs__(self) -> tuple[float, str, str, str]:  # type: ignore[override]
        """Copy and pickle with all that it knows."""
        return float(self), self.unit, self.basis, self.reason


class Count(int):
    """A whole number with unit, reason and basis; see `Threshold`."""

    unit: str
    basis: str
    reason: str

    def __new__(cls, value: int, unit: str, basis: str, reason: str) -> Count:
        """Return a whole number that knows where it comes from."""
        self = super().__new__(cls, value)
        self.unit, self.basis, self.reason = unit, basis, reason
        return self

    def __getnewargs__(self) -> tuple[int, str, str, str]:  # type: ignore[override]
        """Copy and pickle with all that it knows."""
        return int(self), self.unit, self.basis, self.reason
