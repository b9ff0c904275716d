"""Work of a revolution by cause with its standard uncertainty."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.fit.single import Fit
from camtorque.laws.causes import cam_torques, work_per_revolution
from camtorque.laws.chain import ChainInput, evaluate
from camtorque.records import Array

TOGETHER = ("friction", "damping")
"""One recording tells them apart badly, and their sum well."""
STEP = 0.1
"""Step of the differences, in standard uncertainties of the parameter: the work is straight over that."""


def work_at(chain: ChainInput, values: Mapping[str, float], coefficients: Array) -> dict[str, float]:
    """Return the work of each loss at values of the nonlinear and (15,) of the linear parameters [J per revolution]."""
    output = evaluate(chain, values, coefficients)
    none = np.zeros(chain.theta.size)
    return work_per_revolution(chain, output, cam_torques(chain, values, output, coefficients, none))


def work_stderr(fit: Fit, index: int) -> dict[str, float]:
    """Return the standard uncertainty of the work of each loss of one recording [J per revolution].

    The covariance of the fit and its further shifts are carried on by differences, one parameter after the other.
    """
    problem, z = fit.problem, fit.solution.z
    chain = problem.data[index].chain
    least = _with_sum(work_at(chain, *problem.values(z, index)))
    own = [k for k, one in enumerate(problem.parameters) if one.recording in (-1, index)]
    slopes = np.zeros((len(least), z.size))
    for k in own:
        moved, step = z.copy(), STEP * float(fit.std[k])
        moved[k] += step
        after = _with_sum(work_at(chain, *problem.values(moved, index)))
        slopes[:, k] = [(after[name] - value) / step for name, value in least.items()]
    variance = np.einsum("ij,jk,ik->i", slopes, fit.covariance.matrix, slopes)
    for shift in fit.shifts.values():
        variance = variance + (slopes @ shift) ** 2
    return dict(zip(least, np.sqrt(np.maximum(variance, 0.0)).tolist(), strict=True))


def _with_sum(work: dict[str, float]) -> dict[str, float]:
    return {**work, "_and_".join(TOGETHER): sum(work[name] for name in TOGETHER)}
