"""What kind of pump it is, by the evidence of a fit with each kind: how delivery ends, what its parts are.

Ends of delivery are compared by how plausible each minimum is; what the others add widens what the best one tells. One
of them is the line pressure alone: whether there is a chamber at all.

A part that a pump has in one of two kinds (`KINDS`) is fitted as either: the better one is kept, the other one beside
it. A pin runs on needles or in a plain bush, whose frictions differ by five times, more than either spreads: one
Gaussian for both rules plain bushes out or tells nothing of needles, and what a pin is denied goes to the camshaft's
bearings, whose torque differs from its own in the turning of the roller alone. A chamber is filled through ports that
the plunger covers, or through a suction valve or a solenoid's as well, which stands open on the whole return. The loss
in it goes with the inverse square of its area: beyond a few square millimetres no torque tells the area, and a Gaussian
about none at all throttles every valve, for which the plunger's viscous drag pays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np

from camtorque.fit.evidence import NEEDED, laplace, loss_evidence, strength
from camtorque.fit.minima import Candidate, Halves, at_minimum, attempted, beside
from camtorque.fit.prepare import DISCREPANCY, INDEPENDENT
from camtorque.fit.problem import with_rows, with_starts
from camtorque.fit.truncated import one_sided_moments
from camtorque.fit.uncertainty import Covariance, covariance, narrowed, posterior_at, pressure_moved_to
from camtorque.laws import ROWS
from camtorque.laws.rows import ParameterRow
from camtorque.process.second_process import in_two
from camtorque.records import EITHER_LOSS, Array, LossEvidence

UNSURE = 0.01
"""Probability of a fit without a part above which the data do not surely need the part: 2 ln K of 9."""
WEIGHED_WITHIN = 40.0
"""Chi-square over the inflation above the best minimum's up to which a structure is weighed by its evidence."""


@dataclass(frozen=True)
class Kind:
    """A part's other kind; the usual one is what the row of its parameter says.

    Attributes
    ----------
    parameter : that differs between the two
    prior : of the other kind, expectation and standard deviation [SI]
    source : where that comes from
    share : of the benches that have it, as far as somebody knows
    begins : whether its fit begins at the expectation, not where the usual kind's ends
    absent : the usual kind has no such part: standard deviation about zero of what stands in for one [SI], 0 else
    """

    parameter: str
    prior: tuple[float, float]
    source: str
    share: float
    begins: bool = False
    absent: float = 0.0

    def asked_of(self, item: Candidate) -> bool:
        """Return whether a pump has the part, of a kind that nobody states."""
        usual = item.data.rows[self.parameter].source == ROWS[self.parameter].source
        return usual and item.problem.index(self.parameter) >= 0

    def is_without(self, item: Candidate) -> bool:
        """Return whether a minimum is one without the part, which the other kind has."""
        return self.absent > 0.0 and item.data.rows[self.parameter].source != self.source

    def rows(self, row: ParameterRow) -> tuple[Mapping[str, object], Mapping[str, object]]:
        """Return what the usual and the other kind make of the parameter's row: a larger roller has a larger pin."""
        usual = ROWS[self.parameter]
        assert usual.prior is not None
        scale = row.upper / usual.upper
        first, second = (
            {"prior": (scale * mean, scale * std), "source": source}
            for (mean, std), source in ((usual.prior, usual.source), (self.prior, self.source))
        )
        return first, second

    def turned(self, row: ParameterRow) -> Mapping[str, object] | None:
        """Return what the kind that a row is not of makes of it; None of a row that is of neither."""
        usual, second = self.rows(row)
        return {ROWS[self.parameter].source: second, self.source: usual}.get(row.source)

    def of_most(self, rows: Sequence[ParameterRow]) -> list[ParameterRow]:
        """Return the rows of the kind that most recordings have, the usual one where as many have either."""
        others = [row for row in rows if row.source == self.source]
        return others if 2 * len(others) > len(rows) else [row for row in rows if row not in others]


PIN, INLET = "kind of the roller's pin", "kind of the inlet"
KINDS: dict[str, Kind] = {
    PIN: Kind("pin_arm", (140.0e-6, 90.0e-6), "plain bush: mu 0.02-0.06 in mixed friction on 3-5 mm", 0.4),
    INLET: Kind(
        "suction_area",
        (12.0e-6, 8.0e-6),
        "suction or solenoid valve: 6-12 mm, lifted 0.3-0.8 mm",
        0.5,
        begins=True,
        absent=1.0e-6,
    ),
}
"""Name in the budget -> part that is of one of two kinds."""


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
class OtherFit:
    """The best minimum with the less probable kind of a part, beside the one with the other, and how probable it is."""

    candidate: Candidate
    beside: Candidate
    probability: float


def kinds_decided(
    minima: Sequence[Candidate], halves: Halves, kinds: Mapping[str, Kind]
) -> tuple[list[Candidate], dict[str, OtherFit]]:
    """Return minima with the more probable kind of each part, the best one first, and by name what the others add.

    Those are the best one with a part's other kind; none where no such fit ends anywhere, and of a pump that has no
    such part.
    """
    found, others = list(minima), {}
    kinds = {name: kind for name, kind in kinds.items() if kind.asked_of(found[0])}
    at_once = in_two(partial(_with_other, halves), [(kind, found[0]) for kind in kinds.values()])
    for (name, kind), other in zip(kinds.items(), at_once, strict=True):
        turned = other if found[0] is minima[0] else _with_other(halves, (kind, found[0]))
        found, beside = decided(found, halves, kind, turned)
        if beside is not None:
            others[name] = beside
    return found, others


def decided(
    minima: list[Candidate], halves: Halves, kind: Kind, other: Candidate | None
) -> tuple[list[Candidate], OtherFit | None]:
    """Return minima with the more probable kind of a part and the best one with the less probable one.

    ``other`` is the first of ``minima``, the best, with the kind that these do not have.
    """
    usual = minima[0]
    odds = None if other is None else log_odds(kind, other, usual)
    if other is None or odds is None:
        return minima, None
    probability = from_log_odds(odds)
    if probability < 0.5:
        return minima, OtherFit(other, usual, probability)
    rest = in_two(partial(_with_other, halves), [(kind, item) for item in minima[1:]])
    kept = sorted((item for item in rest if item), key=lambda item: item.value)
    return [other, *kept], OtherFit(usual, other, 1.0 - probability)


def from_log_odds(log_odds: float) -> float:
    """Return the probability that odds of that logarithm are."""
    return 0.5 * (1.0 + math.tanh(0.5 * log_odds))


def log_odds(kind: Kind, other: Candidate, usual: Candidate) -> float | None:
    """Return the logarithm of the odds of a part's other kind by the evidence of both fits and its share.

    It is None where Laplace's approximation overflows. A cam's side that is too light says nothing of a pin.
    """
    cov = covariance(usual.problem, usual.solution)
    found = [attempted(laplace, item.problem, item.solution, cov.inflation) for item in (usual, other)]
    if found[0] is None or found[1] is None:
        return None
    beside = [item.holdout_penalty / cov.inflation for item in (usual, other)]
    odds = 0.5 * (found[0] + beside[0] - found[1] - beside[1]) + math.log(kind.share / (1.0 - kind.share))
    return odds - (_for_none(kind, usual, cov) if kind.absent else 0.0)


def _for_none(kind: Kind, usual: Candidate, cov: Covariance) -> float:
    """Return by how much the logarithm of the evidence rises where the usual kind has no such part, 0 at least.

    The usual row's prior holds every size: it doubts a part that is not there for all sizes that it does not have.
    """
    place = usual.problem.index(kind.parameter)
    mean = posterior_at(usual.problem, usual.solution, cov.matrix, cov.inflation).mean[place]
    risen, _ = _swapped(usual.problem.parameters[place].row, float(mean), float(cov.std[place]), (0.0, kind.absent))
    return max(risen, 0.0)


def weighed_losses(best: Candidate, others: Mapping[str, OtherFit], cov: Covariance) -> tuple[LossEvidence, ...]:
    """Return the evidence for each loss; ``cov`` is the covariance of the best fit, ``others`` are by name in `KINDS`.

    What it leaves open is not needed where a fit without a part that not every pump has does not need it: unless the
    data surely need that part, they do not need what comes with it.
    """
    found = loss_evidence(best.problem, best.solution, cov)
    usual = next((other.candidate for name, other in others.items()
                  if other.probability > UNSURE and KINDS[name].is_without(other.candidate)), None)  # fmt: skip
    left_open = any(row.verdict == "cannot tell" for row in found)
    if usual is None or not left_open or EITHER_LOSS in [row.name for row in found]:
        return found
    sure = narrowed(covariance(usual.problem, usual.solution), usual.solution)
    rows = loss_evidence(usual.problem, usual.solution, sure)
    absent = {row.name: row for row in rows if row.verdict == "not needed"}
    return tuple(absent.get(row.name, row) if row.verdict == "cannot tell" else row for row in found)


@dataclass(frozen=True)
class OtherKind:
    """The kind that a minimum does not have: its prior, the logarithm of its odds, how far it moves the parameter [SI].

    ``rows`` are what it changes of the parameter's row.
    """

    rows: Mapping[str, object]
    log_odds: float
    moved: float


def other_kind(kind: Kind, row: ParameterRow, mean: float, std: float) -> OtherKind | None:
    """Return what a part's other kind makes of a minimum, by its Gaussian with the one prior in place of the other.

    It is None of a pump that has no such part, as a foot that slides has no pin.

    Parameters
    ----------
    row : of the part's parameter at the minimum
    mean, std : of the parameter, as if it had no bounds [SI]
    """
    turned = kind.turned(row)
    if turned is None or row.prior is None:
        return None
    risen, moved = _swapped(row, mean, std, cast(tuple[float, float], turned["prior"]))
    share = 1.0 - kind.share if row.source == kind.source else kind.share
    return OtherKind(turned, risen + math.log(share / (1.0 - share)), moved)


def _swapped(row: ParameterRow, mean: float, std: float, prior: tuple[float, float]) -> tuple[float, float]:
    """Return by how much log evidence and mean rise with a prior in place of the row's; mean, std without bounds."""
    assert row.prior is not None
    information = max(1.0 / std**2 - 1.0 / row.prior[1] ** 2, 0.0)
    pulled = mean / std**2 - row.prior[0] / row.prior[1] ** 2
    (log_now, now), (log_other, other) = (
        _with_prior(information, pulled, one, (row.lower, row.upper)) for one in (row.prior, prior)
    )
    return log_other - log_now, other - now


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


def _with_other(halves: Halves, turned: tuple[Kind, Candidate]) -> Candidate | None:
    kind, item = turned
    data = with_rows(item.data, {kind.parameter: kind.rows(item.data.rows[kind.parameter])[1]})
    if not kind.begins:
        return halves.minimum(at_minimum, data)
    effort = beside(item.value)
    return halves.minimum(at_minimum, with_starts(data, {kind.parameter: kind.prior[0]}), effort, item.solution.lift)
