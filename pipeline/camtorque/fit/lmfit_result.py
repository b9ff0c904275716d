"""A minimum in the clothes that users know: `lmfit.minimizer.MinimizerResult` with `fit_report`."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import lmfit
import numpy as np
from lmfit.minimizer import MinimizerResult

from camtorque.fit.ties import Ties
from camtorque.records import Array


@dataclass(frozen=True)
class Outcome:
    """What a minimiser hands over.

    Attributes
    ----------
    values : (n_free,) free parameters
    covariance : (n_free, n_free) by measured standard deviations; zero rows for parameters at a bound
    residual : (m,) weighted residual
    chi_square : its sum of squares (with priors where there are any)
    independent : number of independent residuals, priors counted
    eliminated : further free parameters without a name
    evaluations, method, message, success : what is told about the search
    """

    values: Array
    covariance: Array
    residual: Array
    chi_square: float
    independent: float
    evaluations: int
    method: str
    message: str
    success: bool
    eliminated: int = 0


def lmfit_result(params: lmfit.Parameters, ties: Ties, outcome: Outcome, scale_covar: bool) -> MinimizerResult:
    """Return the result object; the information criteria and the reduced chi-square use the independent residuals.

    Parameters
    ----------
    params : as the user handed them over; a copy is filled
    ties : their free and tied names
    outcome : the minimum
    scale_covar : True multiplies the covariance by the reduced chi-square (weights known but for a factor)
    """
    filled = copy.deepcopy(params)
    n_free = outcome.values.size
    degrees = max(outcome.independent - n_free - outcome.eliminated, 1.0)
    reduced = outcome.chi_square / degrees
    covariance = outcome.covariance * (reduced if scale_covar else 1.0)
    _fill(filled, ties, outcome.values, covariance)
    initial = [float(params[name].value) for name in ties.free]
    log_likelihood = outcome.independent * np.log(max(outcome.chi_square, 1e-300) / outcome.independent)
    count = n_free + outcome.eliminated
    return MinimizerResult(
        params=filled, var_names=list(ties.free), init_vals=initial,
        init_values=dict(zip(ties.free, initial, strict=True)), covar=covariance, residual=outcome.residual,
        chisqr=outcome.chi_square, redchi=reduced, ndata=outcome.residual.size, nvarys=n_free, nfree=degrees,
        aic=float(log_likelihood + 2.0 * count),
        bic=float(log_likelihood + np.log(outcome.independent) * count), nfev=outcome.evaluations,
        success=outcome.success, errorbars=bool(np.all(np.diag(covariance) > 0.0)), method=outcome.method,
        message=outcome.message, aborted=False, ier=0, lmdif_message="", scale_covar=scale_covar,
    )  # fmt: skip


def _fill(params: lmfit.Parameters, ties: Ties, values: Array, covariance: Array) -> None:
    """Set value, standard error and correlations of free and tied parameters."""
    slopes, every = ties.slopes(values), ties.values(values)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    for name in ties.free:
        params[name].init_value = float(params[name].value)
    for j, name in enumerate(ties.free):
        parameter = params[name]
        parameter.value = every[name]
        # no width at a bound: lmfit's report then names the parameter instead of printing +/- 0
        parameter.stderr = float(deviation[j]) if deviation[j] > 0.0 else None
        parameter.correl = {
            other: float(covariance[j, k] / (deviation[j] * deviation[k]))
            for k, other in enumerate(ties.free)
            if k != j and deviation[j] > 0.0 and deviation[k] > 0.0
        }
    params.update_constraints()
    for name in ties.tied:
        params[name].stderr = float(np.sqrt(np.maximum(slopes[name] @ covariance @ slopes[name], 0.0)))
