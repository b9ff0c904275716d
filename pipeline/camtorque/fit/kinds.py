"""What kind of pump it is, by the evidence of a fit with each kind: how delivery ends, what the roller's pin runs on.

Ends of delivery are compared by how plausible each minimum is; what the others add widens what the best one tells. One
of them is the line pressure alone: whether there is a chamber at all.

A pin runs on needles or in a plain bush: the better of both is kept, the other one beside it. Their frictions differ by
five times, more than either spreads. One Gaussian for both rules plain bushes out or tells nothing of needles, and what
a pin is denied goes to the camshaft's bearings, whose torque differs from its own in the turning of the roller alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np

from camtorque.fit.evidence import NEEDED, laplace, strength
from camtorque.fit.minima import Candidate, Halves, at_minimum, attempted
from camtorque.fit.prepare import DISCREPANCY, INDEPENDENT
from camtorque.fit.problem import with_rows
from camtorque.fit.truncated import one_sided_moments
from camtorque.fit.uncertainty import covariance, pressure_moved_to
from camtorque.laws import ROWS
from camtorque.laws.rows import ParameterRow
from camtorque.process.second_process import in_two
from camtorque.records import Array, LossEvidence

WEIGHED_WITHIN = 40.0
"""Chi-square over the inflation above the best minimum's up to which a structure is weighed by its evidence."""
ARM = "pin_arm"
BUSH, BUSH_SOURCE = (140.0e-6, 90.0e-6), "plain bush: mu 0.02-0.06 in mixed friction on 3-5 mm"
"""What is known of a pin in a plain bush, expectation and standard deviation [m]; its law's row holds needles."""
BUSHES = 0.4
"""Share of the benches with a plain bush, as far as somebody knows."""


def structure_probabilities(candidates: Sequence[Candidate], inflation: float) -> tuple[float, ...]:
    """Return how probable the candidates are, under the best one's inflation.

    Within a structure their chi-square tells. Between structures it is the mean of what chi-square and what the
    evidence say: by chi-square alone a structure with more parameters is always ahead, and Laplace's approximation is
    off by some units where parameters lie at their bounds.
    """
    chi = np.array([item.value for item in candidates]) / inflation
    by_weights = probabilities_of(chi)
    names = np.array([item.data.structure for item in candidates])
    near = [str(name) for name in dict.fromkeys(names[chi < np.min(chi) + WEIGHED_WITHIN]) if name != "line"]
    if len(near) < 2:
        return tuple(by_weights.tolist())
    logarithms = [_evidence(candidates, name, inflation) for name in near]
    if None in logarithms:
        return tuple(by_weights.tolist())
    by_evidence = by_weights.copy()
    everything = np.sum(by_weights[np.isin(names, near)])
    for name, share in zip(near, probabilities_of(np.array(logarithms, dtype=float)), strict=True):
        by_evidence[names == name] *= everything * share / np.sum(by_weights[names == name])
    return tuple((0.5 * (by_weights + by_evidence)).tolist())


def _best(candidates: Sequence[Candidate], *structures: str) -> Candidate | None:
    """Return the best minimum of some structures, None where they have none."""
    return min((item for item in candidates if item.data.structure in structures), key=lambda item: item.value,
               default=None)  # fmt: skip


def _evidence(candidates: Sequence[Candidate], structure: str, inflation: float) -> float | None:
    """Return -2 ln Z of a structure's best minimum, None where its matrices overflow."""
    best = _best(candidates, structure)
    assert best is not None
    found = attempted(laplace, best.problem, best.solution, inflation)
    return None if found is None else found + (best.value - best.solution.chi_square) / inflation


def probabilities_of(logarithms: Array) -> Array:
    """Return probabilities, which sum to 1, of what is -2 times their logarithm."""
    weight = np.exp(-0.5 * (logarithms - np.min(logarithms)))
    return np.asarray(weight / np.sum(weight))


def structure_spread(candidates: Sequence[Candidate], probabilities: tuple[float, ...]) -> tuple[Array, Array]:
    """Return what the other structures add to parameters (m, k) and chamber pressure (m, n), as signed deviations.

    Each moves all parameters together, by the root of its probability: the sum of two that stand in for one another
    does not move.
    """
    best = candidates[0]
    names = best.problem.names
    shifts, pressures = [np.zeros(len(names))], [np.zeros(best.data.chain.theta.size)]
    for item, probability in zip(candidates[1:], probabilities[1:], strict=True):
        if probability < 1e-4:
            continue
        values = dict(zip(item.problem.names, item.solution.z.tolist(), strict=True))
        delta = np.array([values.get(name, z) - z for name, z in zip(names, best.solution.z, strict=True)])
        moved = pressure_moved_to(best.solution.output, item.solution.output)
        shifts.append(np.sqrt(probability) * delta)
        pressures.append(np.sqrt(probability) * moved)
    return np.array(shifts), np.array(pressures)


def chamber_evidence(candidates: tuple[Candidate, ...], inflation: float) -> LossEvidence:
    """Return the evidence for a chamber whose pressure is not the line's.

    One that moves the torque by less than all laws are trusted to is not needed, however much chi-square it gains.
    """
    line, chamber = _best(candidates, "line"), _best(candidates, "land", "spill", "open")
    if line is None or chamber is None:
        return LossEvidence("chamber", np.nan, "cannot tell", False, np.nan, (np.nan, np.nan), "N m", "not compared")
    factor = (line.value - chamber.value) / inflation - np.log(INDEPENDENT) * 4.0
    weight = line.data.weight
    size = float(np.sqrt(np.mean(((line.solution.residual - chamber.solution.residual) / weight) ** 2)))
    trusted = size > DISCREPANCY * np.max(np.abs(line.data.torque))
    # both sides are fitted: absence does not rest on widths of priors as that of a loss does, and needs no more
    verdict = "needed" if factor > NEEDED and trusted else "not needed" if factor < -NEEDED else "cannot tell"
    text = f"a chamber apart from the line moves the torque by {size:.2g} N m rms ({strength(factor)})"
    return LossEvidence("chamber", float(factor), verdict, True, size, (np.nan, np.nan), "N m", text)


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
    probability = from_log_odds(odds)
    if probability < 0.5:
        return list(minima), OtherPin(bush, probability)
    rest = in_two(partial(_in_bush, halves), minima[1:])
    kept = sorted((item for item in rest if item), key=lambda item: item.value)
    return [bush, *kept], OtherPin(needles, 1.0 - probability)


def from_log_odds(log_odds: float) -> float:
    """Return the probability that odds of that logarithm are."""
    return 0.5 * (1.0 + math.tanh(0.5 * log_odds))


def log_odds(bush: Candidate, needles: Candidate) -> float | None:
    """Return the logarithm of the odds of a plain bush by the evidence of both fits and `BUSHES`.

    It is None where Laplace's approximation overflows. A cam's side that is too light says nothing of a pin.
    """
    inflation = covariance(needles.problem, needles.solution).inflation
    found = [attempted(laplace, item.problem, item.solution, inflation) for item in (needles, bush)]
    if found[0] is None or found[1] is None:
        return None
    beside = [item.holdout_penalty / inflation for item in (needles, bush)]
    return 0.5 * (found[0] + beside[0] - found[1] - beside[1]) + math.log(BUSHES / (1.0 - BUSHES))


@dataclass(frozen=True)
class OtherKind:
    """The kind of pin that a minimum does not have: its prior, the logarithm of its odds, how far it moves the arm [m].

    ``rows`` are what it changes of the arm's row.
    """

    rows: Mapping[str, object]
    log_odds: float
    moved: float


def other_kind(row: ParameterRow, mean: float, std: float) -> OtherKind | None:
    """Return what the other kind of pin makes of a minimum, by its Gaussian with the one prior in place of the other.

    It is None of a foot that slides.

    Parameters
    ----------
    row : of the pin's arm at the minimum
    mean, std : of the arm, as if it had no bounds [m]
    """
    needles, bush = kind_rows(row)
    turned = {ROWS[ARM].source: bush, BUSH_SOURCE: needles}.get(row.source)
    if turned is None or row.prior is None:
        return None
    information = max(1.0 / std**2 - 1.0 / row.prior[1] ** 2, 0.0)
    pulled = mean / std**2 - row.prior[0] / row.prior[1] ** 2
    (log_now, now), (log_other, other) = (
        _with_prior(information, pulled, prior, (row.lower, row.upper))
        for prior in (row.prior, cast(tuple[float, float], turned["prior"]))
    )
    share = BUSHES if turned is bush else 1.0 - BUSHES
    return OtherKind(turned, log_other - log_now + math.log(share / (1.0 - share)), other - now)


def _with_prior(
    information: float, pulled: float, prior: tuple[float, float], bounds: tuple[float, float]
) -> tuple[float, float]:
    """Return the logarithm of the evidence of data with a prior, up to a constant, and the mean within bounds."""
    centre, width = prior
    variance = 1.0 / (information + width**-2)
    mean = variance * (pulled + centre / width**2)
    inside, within, _ = one_sided_moments(mean, math.sqrt(variance), *bounds)
    before, *_ = one_sided_moments(centre, width, *bounds)
    quadratic = mean**2 / variance - (centre / width) ** 2 + math.log(variance / width**2)
    return 0.5 * quadratic + inside - before, within


def of_most(rows: Sequence[ParameterRow]) -> list[ParameterRow]:
    """Return the rows of the kind of pin that most recordings have, needles where as many have either."""
    bushes = [row for row in rows if row.source == BUSH_SOURCE]
    return bushes if 2 * len(bushes) > len(rows) else [row for row in rows if row not in bushes]


def kind_rows(row: ParameterRow) -> tuple[Mapping[str, object], Mapping[str, object]]:
    """Return what needles and a plain bush make of the row of the pin's arm: a larger roller runs on a larger pin."""
    usual = ROWS[ARM]
    assert usual.prior is not None
    scale = row.upper / usual.upper
    needles, bush = (
        {"prior": (scale * mean, scale * std), "source": source}
        for (mean, std), source in ((usual.prior, usual.source), (BUSH, BUSH_SOURCE))
    )
    return needles, bush


def _in_bush(halves: Halves, item: Candidate) -> Candidate | None:
    return halves.minimum(at_minimum, with_rows(item.data, {ARM: kind_rows(item.data.rows[ARM])[1]}))
