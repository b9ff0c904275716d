"""Which parameters changed between two recordings: evidence over sets of plausible changes.

A change is a group of parameters that one event moves (wear, mounting, temperature). For every set of up to three
groups the linearised pair gives the evidence in closed form (values common to both, zeros and end of delivery
integrated out); the best set is fitted again without linearising until it stays. Probabilities of a change are sums
over the sets. The prior odds of each group, and a width per parameter of four steps that matter, pay for the length
of the list.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from camtorque.fit.difference import OWN_NAMES, Linear, Pair, PairState, linearised, loosened, minimised
from camtorque.fit.prepare import INDEPENDENT
from camtorque.laws.chain import BINS
from camtorque.records import Array

CHANGES: dict[str, tuple[str, ...]] = {
    "leakage": ("leakage",),
    "trigger": ("trigger_offset",),
    "spring": ("spring_preload_error",),
    "friction": ("bearing_arm", "pin_arm", "guide_friction", "shaft_drag"),
    "packing": ("packing_force", "packing_friction"),
    "damping": ("shaft_viscous", "plunger_viscous"),
    "temperature": ("leakage", "bulk_modulus", "shaft_viscous", "plunger_viscous"),
    "fluid": ("bulk_modulus",),
    "air": ("free_air",),
    "feed": ("feed_pressure",),
    "port": ("port_closing_lift",),
    "dead_volume": ("dead_volume",),
    "valve_opening": ("valve_opening",),
    "valve": ("retraction_volume", "valve_damping", "seat_gain", "valve_area"),
    "shaft": ("shaft_compliance", "shaft_damping_ratio"),
    "drive": ("drive_admittance", "drive_bandwidth"),
}
"""Event -> parameters that it moves."""
ALWAYS = tuple(name for name in OWN_NAMES if not any(name in members for members in CHANGES.values()))
"""Parameters that always differ and tell of no event."""
USUAL = ("leakage", "trigger", "spring", "friction", "damping", "temperature")
PRIOR, PRIOR_RARE = 0.10, 0.02
"""Probability of one change before the data, usual ones and others."""
TOLD = 0.90
"""Probability from which a change is told."""
MOST_CHANGES = 3
ROUNDS = 3
TEMPERATURE_STD = 10.0
VISCOSITY_PER_KELVIN, MODULUS_PER_KELVIN = -0.024, -0.0045
"""Test oils and diesel near 40 degrees: viscosity -2.4 % and bulk modulus -0.45 % per kelvin."""
LEAST_FREEDOM = INDEPENDENT / 3.0


@dataclass(frozen=True)
class Hypothesis:
    """A set of groups and its posterior.

    two_ln_evidence : with the prior odds; mean, covariance : of the differences of all candidates, (m,), (m, m) [SI]
    """

    groups: tuple[str, ...]
    two_ln_evidence: float
    mean: Array
    covariance: Array


@dataclass(frozen=True)
class Attribution:
    """What changed.

    Attributes
    ----------
    names : parameters that may differ, own ones first
    hypotheses : best first
    probabilities : of the hypotheses
    mean, covariance : of the differences, mixed over the hypotheses [SI]
    free_mean, free_std : with every parameter free to differ, (m,) [SI]
    inflation : factors on the variance of mean and difference that their residuals ask for
    state : the pair at the best hypothesis
    """

    names: tuple[str, ...]
    hypotheses: tuple[Hypothesis, ...]
    probabilities: tuple[float, ...]
    mean: Array
    covariance: Array
    free_mean: Array
    free_std: Array
    inflation: tuple[float, float]
    state: PairState

    def probability(self, group: str) -> float:
        """Return the probability that a group changed."""
        pairs = zip(self.hypotheses, self.probabilities, strict=True)
        return float(sum(p for item, p in pairs if group in item.groups))

    def moved(self, name: str) -> float:
        """Return the probability that a group changed to which a parameter belongs."""
        pairs = zip(self.hypotheses, self.probabilities, strict=True)
        return float(sum(p for item, p in pairs if any(name in CHANGES[g] for g in item.groups)))

    @property
    def best(self) -> tuple[str, ...]:
        """Groups of the best hypothesis."""
        return self.hypotheses[0].groups


@dataclass(frozen=True)
class Evidence:
    """Normal equations of the differences, linearised and extrapolated to zero, the common values integrated out.

    In units of ``widths`` [SI]; ``own`` says how far each parameter differs without an event, in the same unit.
    """

    names: tuple[str, ...]
    own: Array
    matrix: Array
    vector: Array
    constant: float
    widths: Array
    directions: Mapping[str, Array] = field(default_factory=dict)


def candidates(pair: Pair) -> tuple[str, ...]:
    """Return the parameters that may differ: own ones first."""
    wanted = dict.fromkeys(name for members in CHANGES.values() for name in members)
    return tuple(dict.fromkeys((*pair.own, *(name for name in wanted if name in pair.names))))


def evidence_at(pair: Pair, state: PairState) -> Evidence:
    """Return the normal equations at a state, extrapolated to where nothing differs."""
    names = candidates(pair)
    line: Linear = linearised(pair, state, names)
    place = [pair.names.index(name) for name in names]
    means, stds = pair.priors
    own = np.array([pair.own.get(name, 0.0) for name in names])
    changes = np.array([own[j] if name in ALWAYS else pair.change(name) for j, name in enumerate(names)])
    scale = np.r_[stds, changes]
    k = means.size
    jacobian = line.matrix * scale
    residual = line.residual + line.matrix[:, k:] @ (state.after - state.before)[place]
    prior = np.r_[np.ones(k), np.zeros(len(names))]
    away = np.r_[(state.before - means) / stds, np.zeros(len(names))]
    matrix = jacobian.T @ jacobian + np.diag(prior)
    vector = jacobian.T @ residual - prior * away
    gain = np.linalg.solve(matrix[:k, :k], np.column_stack([matrix[:k, k:], vector[:k]]))
    matrix, rest = matrix[k:, k:] - matrix[k:, :k] @ gain[:, :-1], vector[k:] - matrix[k:, :k] @ gain[:, -1]
    constant = float(residual @ residual + away @ away - vector[:k] @ gain[:, -1])
    directions = {"temperature": temperature(pair, state, names)}
    return Evidence(names, own / changes, matrix, rest, constant, changes, directions)


def temperature(pair: Pair, state: PairState, names: tuple[str, ...]) -> Array:
    """Return what one kelvin does to each difference [SI/K]: thinner fluid, softer fluid."""
    thinner = {"leakage": -VISCOSITY_PER_KELVIN, "bulk_modulus": MODULUS_PER_KELVIN}
    thinner.update(dict.fromkeys(("shaft_viscous", "plunger_viscous"), VISCOSITY_PER_KELVIN))
    size = dict(zip(pair.names, state.before.tolist(), strict=True))
    return np.array([thinner.get(name, 0.0) * size[name] for name in names])


def hypothesis(found: Evidence, groups: tuple[str, ...]) -> Hypothesis:
    """Return the evidence and the posterior differences of a set of groups."""
    m = len(found.names)
    moved = {name for group in groups for name in CHANGES[group]}
    columns = [own * np.eye(m)[j] for j, own in enumerate(found.own) if own and found.names[j] not in moved]
    for group in groups:
        if group in found.directions:
            columns.append(found.directions[group] / found.widths * TEMPERATURE_STD)
        else:
            columns.extend(np.eye(m)[found.names.index(n)] for n in CHANGES[group] if n in found.names)
    basis = np.array(columns).T
    matrix = basis.T @ found.matrix @ basis + np.eye(basis.shape[1])
    vector = basis.T @ found.vector
    inverse = np.linalg.inv(matrix)
    solved = inverse @ vector
    chi = found.constant - float(vector @ solved)
    scaled = found.widths[:, None] * basis
    evidence = -chi - float(np.linalg.slogdet(matrix)[1]) + two_ln_odds(groups)
    return Hypothesis(groups, evidence, scaled @ solved, scaled @ inverse @ scaled.T)


def weighed(found: Evidence, groups: tuple[str, ...]) -> tuple[Hypothesis, ...]:
    """Return all sets of up to `MOST_CHANGES` groups, best first."""
    result = [hypothesis(found, chosen) for size in range(MOST_CHANGES + 1) for chosen in combinations(groups, size)]
    return tuple(sorted(result, key=lambda item: -item.two_ln_evidence))


def members(pair: Pair, groups: tuple[str, ...]) -> dict[str, float]:
    """Return the parameters that differ under a set of groups with how far, own ones first [SI]."""
    named = dict.fromkeys(name for group in groups for name in CHANGES[group] if name in pair.names)
    return {**pair.own, **{name: pair.change(name) for name in named}}


def inflated(pair: Pair, state: PairState, taken: int) -> tuple[Pair, tuple[float, float]]:
    """Return the pair with its covariances widened to what the residuals ask for."""
    line = linearised(pair, state, ())
    chi = [float(part @ part) for part in (line.residual[:BINS], line.residual[BINS:])]
    factors = max(1.0, chi[0] / LEAST_FREEDOM / 1.5), max(1.0, chi[1] / (INDEPENDENT - taken))
    roots = [root * np.sqrt(f) for root, f in zip((pair.mean_root, pair.difference_root), factors, strict=True)]
    return replace(pair, mean_root=roots[0], difference_root=roots[1]), factors


def attribution(pair: Pair, state: PairState) -> tuple[Attribution, Pair]:
    """Return what changed, starting near the minimum without changes, and the pair with the weights that were used."""
    groups = tuple(name for name, names in CHANGES.items() if any(n in pair.names for n in names))
    base = minimised(pair, state, pair.own, 40)
    pair = loosened(pair, base)
    base = minimised(pair, base, pair.own, 40)
    tried: dict[tuple[str, ...], PairState] = {(): base}
    for group in groups:
        tried[(group,)] = minimised(pair, base, members(pair, (group,)), 8)
    chosen = _least(pair, tried)
    for _ in range(ROUNDS):
        state = minimised(pair, tried.get(chosen, state), members(pair, chosen), 40)
        wide, factors = inflated(pair, state, len(members(pair, chosen)))
        state = minimised(wide, state, members(pair, chosen), 20)
        found = evidence_at(wide, state)
        hypotheses = weighed(found, groups)
        if hypotheses[0].groups == chosen:
            break
        chosen = hypotheses[0].groups
    return _mixed(found, hypotheses, factors, state), wide


def _least(pair: Pair, tried: Mapping[tuple[str, ...], PairState]) -> tuple[str, ...]:
    """Return the set whose own linearisation gives the most evidence."""
    scores = {}
    # the weights are those of the set that leaves least: under the weights of "no change" a large change is only noise
    wide = min((inflated(pair, state, 10) for state in tried.values()), key=lambda item: item[1][1])[0]
    for groups, state in tried.items():
        scores[groups] = hypothesis(evidence_at(wide, state), groups).two_ln_evidence
    return max(scores, key=lambda groups: scores[groups])


def _mixed(
    found: Evidence, hypotheses: tuple[Hypothesis, ...], factors: tuple[float, float], state: PairState
) -> Attribution:
    weight, mean, covariance = _mixture(hypotheses, np.array([item.two_ln_evidence for item in hypotheses]))
    every = tuple(name for name in CHANGES if name != "temperature" and any(n in found.names for n in CHANGES[name]))
    free = hypothesis(found, every)
    free_std = np.sqrt(np.maximum(np.diag(free.covariance), 0.0))
    return Attribution(found.names, hypotheses, weight, mean, covariance, free.mean, free_std, factors, state)


def _mixture(hypotheses: Sequence[Hypothesis], evidence: Array) -> tuple[tuple[float, ...], Array, Array]:
    """Return the probabilities of some hypotheses, and mean and covariance over them."""
    weight = np.exp(0.5 * (evidence - np.max(evidence)))
    weight /= np.sum(weight)
    kept = [(float(w), item) for w, item in zip(weight, hypotheses, strict=True) if w > 1e-6]
    mean = np.sum([w * item.mean for w, item in kept], axis=0)
    parts = [w * (item.covariance + np.outer(item.mean - mean, item.mean - mean)) for w, item in kept]
    return tuple(weight.tolist()), np.asarray(mean), np.asarray(np.sum(parts, axis=0))


def together(found: Sequence[Attribution]) -> tuple[Attribution, ...]:
    """Return the attributions of several pairs of one pump when the same events are behind all of them."""
    each = [{item.groups: item for item in one.hypotheses} for one in found]
    common = set.intersection(*(set(one) for one in each))
    score = {g: sum(one[g].two_ln_evidence for one in each) - (len(each) - 1) * two_ln_odds(g) for g in common}
    order = sorted(common, key=lambda groups: (-score[groups], groups))
    evidence = np.array([score[groups] for groups in order])
    result = []
    for one, table in zip(found, each, strict=True):
        hypotheses = tuple(table[groups] for groups in order)
        weight, mean, covariance = _mixture(hypotheses, evidence)
        result.append(replace(one, hypotheses=hypotheses, probabilities=weight, mean=mean, covariance=covariance))
    return tuple(result)


def two_ln_odds(groups: Sequence[str]) -> float:
    """Return twice the logarithm of the prior odds of a set of groups."""
    prior = [PRIOR if group in USUAL else PRIOR_RARE for group in groups]
    return 2.0 * float(sum(np.log(p / (1.0 - p)) for p in prior))
