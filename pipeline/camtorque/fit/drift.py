"""Shared parameters as each recording alone tells them: what should be the same but drifts with speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camtorque.fit.joint_input import SAME_SPEED, FittedAlone
from camtorque.fit.problem import Problem
from camtorque.records import Array, Finding
from camtorque.units import short

DRIFT_SIGMA = 2.5
"""Standard errors beyond which a slope widens the joint interval."""
CHANCE = 0.05
"""Odds that chance alone makes a finding of one of all parameters that are compared (Bonferroni)."""
CONTRADICTED = 0.5
"""Contradiction beyond which it is a finding: a quarter of the residual's variance comes from sharing parameters."""
EXCLUSION_FACTOR = 25.0
"""Times the median misfit of a joint fit from which on a recording is left out of it."""


@dataclass(frozen=True)
class Drift:
    """A shared parameter fitted to each recording alone, to see whether it drifts with speed.

    values and stderrs in ``unit``, in the order of ``recordings``; slope_per_1000_rpm of a weighted straight line and
    its standard error
    """

    name: str
    unit: str
    recordings: tuple[str, ...]
    speeds_rpm: tuple[float, ...]
    values: tuple[float, ...]
    stderrs: tuple[float, ...]
    slope_per_1000_rpm: float
    slope_stderr: float

    @property
    def significant(self) -> bool:
        """Whether the slope stands out of its standard error."""
        return self.slope_stderr > 0.0 and abs(self.slope_per_1000_rpm) > DRIFT_SIGMA * self.slope_stderr

    @property
    def chance(self) -> float:
        """Probability of a slope this far from zero where nothing drifts."""
        known = self.slope_stderr > 0.0
        return math.erfc(abs(self.slope_per_1000_rpm) / (math.sqrt(2.0) * self.slope_stderr)) if known else 1.0


def shared_drifts(inputs: Sequence[FittedAlone]) -> tuple[Drift, ...]:
    """Return every shared parameter as each recording alone tells it, with its slope over speed."""
    speeds = np.array([item.data.chain.speed for item in inputs]) * 60.0 / (2.0 * np.pi)
    names = tuple(item.name for item in inputs)
    result = []
    for name, first in inputs[0].alone.items():
        if not all(name in item.alone for item in inputs):
            continue
        values = np.array([item.alone[name].value for item in inputs]) / first.per_unit
        errors = np.array([item.alone[name].std for item in inputs]) / first.per_unit
        result.append(Drift(
            name, first.unit, names, tuple(speeds.tolist()), tuple(values.tolist()), tuple(errors.tolist()),
            *_slope(speeds, values, errors),
        ))  # fmt: skip
    return tuple(result)


def _slope(speeds: Array, values: Array, errors: Array) -> tuple[float, float]:
    """Return the slope of a weighted straight line per 1000 rpm and its standard error, nan at one speed."""
    if np.max(speeds) <= (1.0 + SAME_SPEED) * np.min(speeds):
        return math.nan, math.nan
    design = np.column_stack([np.ones_like(speeds), (speeds - np.mean(speeds)) / 1000.0]) / errors[:, None]
    cov = np.linalg.pinv(design.T @ design)
    return float((cov @ design.T @ (values / errors))[1]), float(np.sqrt(cov[1, 1]))


def contradiction(inflation: float, alone: Sequence[float]) -> float:
    """Return how far recordings that each are met alone contradict one another under the laws: 0 not at all, to 1.

    It is the root of the share of the residual's variance that comes from sharing parameters.

    Parameters
    ----------
    inflation, alone : of the residual of the joint fit, and of each recording fitted alone
    """
    return float(np.sqrt(max(1.0 - float(np.median(alone)) / inflation, 0.0)))


def drift_spread(problem: Problem, z: Array, drifts: Sequence[Drift], contradicted: float) -> Array:
    """Return how far the mean of the single values lies off the joint one of each parameter, with its sign, (k,) [SI].

    All of that counts where the parameter drifts. Where the recordings contradict one another it counts for all of
    them, as far as they do: what a missing law shifts is then one thing in each and another in all together.
    """
    spread = np.zeros(problem.size)
    for drift in drifts:
        k = problem.index(drift.name)
        if k >= 0:
            weight = 1.0 / np.array(drift.stderrs) ** 2
            mean = float(np.sum(weight * np.array(drift.values)) / np.sum(weight)) * problem.parameters[k].row.per_unit
            spread[k] = (mean - z[k]) * (1.0 if drift.significant else contradicted)
    return spread


def drift_findings(drifts: Sequence[Drift]) -> tuple[Finding, ...]:
    """Return a warning for each parameter that drifts more than chance makes one of them drift."""
    return tuple(
        Finding(
            "shared_parameter_drifts", "warning",
            f"{drift.name} should be the same in every recording, but where each is fitted alone it drifts by "
            f"{drift.slope_per_1000_rpm:+.3g} +- {short(drift.slope_stderr, 2)} {drift.unit} per 1000 rpm: "
            "a law may be missing. Its joint interval holds that drift; where the recordings that were left out are "
            "predicted well, it does no harm", drift.name,
        )
        for drift in drifts if drift.significant and drift.chance * len(drifts) < CHANCE
    )  # fmt: skip


def contradiction_findings(contradicted: float) -> tuple[Finding, ...]:
    """Return a warning where the recordings contradict one another under the laws."""
    if contradicted <= CONTRADICTED:
        return ()
    return (
        Finding(
            "recordings_contradict", "warning",
            f"{100.0 * contradicted**2:.0f} % of the residual's variance comes from fitting the recordings together: "
            "each is matched alone, but not all together; a law is missing or the pump changed between them, and the "
            "intervals of the shared parameters are widened to cover what each recording gives alone",
        ),
    )  # fmt: skip


def aside_findings(excluded: Sequence[str], unexplained: Sequence[str]) -> tuple[Finding, ...]:
    """Return a warning on each recording that the joint fit is made without, and on each that it does not explain."""
    out = f"does not fit the others (more than {EXCLUSION_FACTOR:.0f} times their misfit); excluded from the joint fit"
    left = "the joint fit misses {} by more than its cycles scatter: predictions do not use this recording"
    return (
        *(Finding("recording_excluded", "warning", f"{name} {out}", name) for name in excluded),
        *(Finding("joint_unexplained", "warning", left.format(name), name) for name in unexplained),
    )
