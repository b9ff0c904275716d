"""The roller's pin, on needles or in a plain bush: the better of both by evidence, and the other one beside it.

Their frictions differ by five times, more than either spreads. One Gaussian for both rules plain bushes out or tells
nothing of needles, and what a pin is denied goes to the camshaft's bearings, whose torque differs from its own in the
turning of the roller alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from camtorque.fit.evidence import laplace
from camtorque.fit.minima import Candidate, Halves, at_minimum, attempted
from camtorque.fit.problem import with_rows
from camtorque.fit.uncertainty import covariance
from camtorque.laws import ROWS
from camtorque.laws.rows import ParameterRow
from camtorque.process.second_process import in_two

ARM = "pin_arm"
BUSH: Mapping[str, object] = {
    "prior": (140.0e-6, 90.0e-6),
    "source": "plain bush: mu 0.02-0.06 in mixed friction on 3-5 mm",
}
"""What is known of a pin in a plain bush [m]; its law's row holds needles."""
BUSHES = 0.4
"""Share of the benches with a plain bush, as far as somebody knows."""


@dataclass(frozen=True)
class OtherPin:
    """The best minimum with the less probable kind of pin, and how probable that kind is."""

    candidate: Candidate
    probability: float


def pin_decided(minima: Sequence[Candidate], halves: Halves) -> tuple[list[Candidate], OtherPin | None]:
    """Return minima, the best one first, with the more probable kind of pin, and the best one with the other kind.

    The second is None where no fit with a plain bush ends anywhere, and of a foot that slides.
    """
    needles = minima[0]
    rolls = needles.data.rows[ARM].source == ROWS[ARM].source
    bush = _in_bush(halves, needles) if rolls else None
    odds = None if bush is None else log_odds(bush, needles)
    if bush is None or odds is None:
        return list(minima), None
    probability = 0.5 * (1.0 + math.tanh(0.5 * odds))
    if probability < 0.5:
        return list(minima), OtherPin(bush, probability)
    rest = in_two(partial(_in_bush, halves), minima[1:])
    kept = sorted((item for item in rest if item), key=lambda item: item.value)
    return [bush, *kept], OtherPin(needles, 1.0 - probability)


def log_odds(bush: Candidate, needles: Candidate) -> float | None:
    """Return the logarithm of the odds of a plain bush by the evidence of both fits and `BUSHES`.

    It is None where Laplace's approximation overflows. A cam's side that is too light says nothing of a pin.
    """
    inflation = covariance(needles.problem, needles.solution).inflation
    found = [attempted(laplace, item.problem, item.solution, inflation) for item in (needles, bush)]
    if found[0] is None or found[1] is None:
        return None
    beside = [item.unseen / inflation for item in (needles, bush)]
    return 0.5 * (found[0] + beside[0] - found[1] - beside[1]) + math.log(BUSHES / (1.0 - BUSHES))


def of_most(rows: Sequence[ParameterRow]) -> list[ParameterRow]:
    """Return the rows of the kind of pin that most recordings have, needles where as many have either."""
    bushes = [row for row in rows if row.source == BUSH["source"]]
    return bushes if 2 * len(bushes) > len(rows) else [row for row in rows if row not in bushes]


def _in_bush(halves: Halves, item: Candidate) -> Candidate | None:
    return halves.minimum(at_minimum, with_rows(item.data, {ARM: BUSH}))
