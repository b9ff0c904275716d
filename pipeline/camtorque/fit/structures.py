"""Ends of delivery compared: how plausible each minimum is, what the others add, whether there is a chamber at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camtorque.fit.evidence import NEEDED, laplace, strength
from camtorque.fit.minima import Candidate, attempted
from camtorque.fit.prepare import DISCREPANCY, INDEPENDENT
from camtorque.records import Array, LossEvidence

COMPARED = 40.0
"""Chi-square over the inflation above the best minimum's up to which a structure is weighed by its evidence."""


def structure_probabilities(candidates: Sequence[Candidate], inflation: float) -> tuple[float, ...]:
    """Return how probable the candidates are, under the best one's inflation.

    Within a structure their chi-square tells. Between structures it is the mean of what chi-square and what the
    evidence say: by chi-square alone a structure with more parameters is always ahead, and Laplace's approximation is
    off by some units where parameters lie at their bounds.
    """
    chi = np.array([item.value for item in candidates]) / inflation
    by_weights = shares(chi)
    names = np.array([item.data.structure for item in candidates])
    near = [str(name) for name in dict.fromkeys(names[chi < np.min(chi) + COMPARED]) if name != "line"]
    if len(near) < 2:
        return tuple(by_weights.tolist())
    logarithms = [_evidence(candidates, name, inflation) for name in near]
    if None in logarithms:
        return tuple(by_weights.tolist())
    by_evidence = by_weights.copy()
    everything = np.sum(by_weights[np.isin(names, near)])
    for name, share in zip(near, shares(np.array(logarithms, dtype=float)), strict=True):
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


def shares(logarithms: Array) -> Array:
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
        moved = item.solution.output.pressure - best.solution.output.pressure
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
    return LossEvidence("chamber", float(factor), verdict, True, size, (size, size), "N m", text)
