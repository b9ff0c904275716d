"""Least squares for any model: exact derivatives by complex steps, linear parameters eliminated, several ways tried.

The same Levenberg-Marquardt core as the fit of the rig, behind `lmfit.Parameters`: bounds, fixed values, ties. From a
start far away different methods end in different valleys, so each way of `METHODS` is walked from each start, and the
lowest minimum is polished by undamped orthogonal steps. Parameters in which the model is linear are found from its
derivatives and eliminated (Golub & Pereyra, Inverse Problems 19 (2003)), which takes most of the difficulty out of a
bad start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import lmfit
import numpy as np
from lmfit.minimizer import MinimizerResult
from scipy.optimize import least_squares

from camtorque.fit.levenberg import Minimum, Rule, covariance_of, finite_jacobian, minimise, point_at, scaling
from camtorque.fit.lmfit_result import Outcome, lmfit_result
from camtorque.fit.ties import Ties, ties_of
from camtorque.records import Array

Residual = Callable[[Mapping[str, Any]], Any]
COMPLEX_STEP = 1.0e-30
PATIENT = Rule(relative_tolerance=1.0e-14, max_iterations=400)
AFFINE_TOLERANCE = 1.0e-8
"""Relative change of a column of the Jacobian below which the model counts as linear in it: rounding, amplified."""


@dataclass(frozen=True)
class Model:
    """A residual of named values as a function of a vector of the free ones.

    Attributes
    ----------
    residual : mapping of names to values, real or complex, -> (m,) weighted residual
    ties : free and tied parameters
    lower, upper : (n,) bounds of the free ones
    """

    residual: Residual
    ties: Ties
    lower: Array
    upper: Array

    def vector(self, x: Array) -> Array:
        """Return the residual, (m,)."""
        return np.asarray(self.residual(self.ties.values(x)), dtype=float)

    def jacobian(self, x: Array) -> Array:
        """Return d(residual)/dx (m, n): one complex evaluation per free parameter."""
        values, slopes = self.ties.values(x), self.ties.slopes(x)
        columns = []
        for j in range(x.size):
            moved = {name: complex(value, 0.0) for name, value in values.items()}
            for name, slope in slopes.items():
                moved[name] += 1j * COMPLEX_STEP * slope[j]
            columns.append(np.imag(np.asarray(self.residual(moved))) / COMPLEX_STEP)
        return np.column_stack(columns)


def model_of(residual: Residual, params: lmfit.Parameters) -> Model:
    """Return the model of the free parameters."""
    ties = ties_of(params)
    lower = np.array([params[name].min for name in ties.free], dtype=float)
    upper = np.array([params[name].max for name in ties.free], dtype=float)
    return Model(residual, ties, lower, upper)


def check_derivative(model: Model, x: Array) -> None:
    """Refuse a residual whose complex step is not its derivative (absolute values, comparisons, casts to real).

    Raises
    ------
    ValueError
        With the name of the first parameter where both differ by more than 1 %.
    """
    exact = finite_jacobian(model.jacobian, x)
    for j, name in enumerate(model.ties.free):
        step = 1e-6 * max(abs(x[j]), 1e-6)
        ahead, behind = np.array(x), np.array(x)
        ahead[j] += step
        behind[j] -= step
        with np.errstate(all="ignore"):
            numeric = (model.vector(ahead) - model.vector(behind)) / (2.0 * step)
        scale = float(np.max(np.abs(numeric)))
        noise = 1e-9 * float(np.max(np.abs(model.vector(x)))) / step
        if np.isfinite(scale) and np.max(np.abs(exact[:, j] - numeric)) > 0.01 * scale + noise:
            raise ValueError(
                f"residual: its complex step is not its derivative with respect to {name!r}; write it without abs(), "
                "comparisons and casts to real numbers"
            )


def linear_indices(model: Model, x: Array, seed: int = 1) -> tuple[int, ...]:
    """Return the free parameters, without bounds, in which the residual is jointly linear.

    A set belongs together when its columns of the Jacobian stay the same while all its members are moved.
    """
    generator = np.random.default_rng(seed)
    unbounded = np.isinf(model.lower) & np.isinf(model.upper)
    chosen: list[int] = []
    here = finite_jacobian(model.jacobian, x)
    for j in np.flatnonzero(unbounded):
        trial = [*chosen, int(j)]
        moved = np.array(x)
        moved[trial] += generator.uniform(0.5, 2.0, len(trial)) * (np.abs(x[trial]) + 1e-3)
        there = finite_jacobian(model.jacobian, moved)
        change = np.linalg.norm(there[:, trial] - here[:, trial], axis=0)
        if np.all(change <= AFFINE_TOLERANCE * np.linalg.norm(here[:, trial], axis=0)) and np.any(here[:, j]):
            chosen = trial
    return tuple(chosen)


def projected(model: Model, start: Array, linear: Sequence[int], rule: Rule) -> Array:
    """Return the end of a descent in the non-linear parameters alone, the linear ones solved at every trial."""
    inner = np.array(linear, dtype=int)
    outer = np.setdiff1d(np.arange(start.size), inner)

    def complete(v: Array) -> Array:
        x = np.zeros(start.size)
        x[outer] = v
        with np.errstate(all="ignore"):
            design = finite_jacobian(model.jacobian, x)[:, inner]
            base = np.nan_to_num(model.vector(x), nan=1e300, posinf=1e300, neginf=-1e300)
        scale = scaling(np.linalg.norm(design, axis=0))
        x[inner] = np.linalg.lstsq(design / scale, -base, rcond=1e-14)[0] / scale
        return x

    def residual(v: Array) -> Array:
        return model.vector(complete(v))

    def jacobian(v: Array) -> Array:
        matrix = finite_jacobian(model.jacobian, complete(v))
        basis = np.linalg.qr(matrix[:, inner] / scaling(np.linalg.norm(matrix[:, inner], axis=0)))[0]
        columns = matrix[:, outer]
        return columns - basis @ (basis.T @ columns)

    if not outer.size:
        return complete(np.zeros(0))
    found = minimise(residual, jacobian, start[outer], model.lower[outer], model.upper[outer], rule)
    return complete(found.x)


def _by_projection(model: Model, start: Array) -> Array:
    linear = linear_indices(model, start)
    return projected(model, start, linear, PATIENT) if linear else start


def _by_damping(model: Model, start: Array) -> Array:
    return minimise(model.vector, model.jacobian, start, model.lower, model.upper, PATIENT).x


def _by_trust_region(model: Model, start: Array) -> Array:
    inside = np.clip(start, model.lower, model.upper)
    with np.errstate(all="ignore"):
        found = least_squares(
            model.vector, inside, lambda x: finite_jacobian(model.jacobian, x), (model.lower, model.upper),
            x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=2000,
        )  # fmt: skip
    return found.x


METHODS: dict[str, Callable[[Model, Array], Array]] = {
    "variable projection": _by_projection,
    "levenberg": _by_damping,
    "trust region": _by_trust_region,
}
"""Ways from a start to a minimum; all are walked, because each fails somewhere."""


def best_minimum(model: Model, starts: Sequence[Array]) -> tuple[Minimum, str]:
    """Return the lowest minimum over methods and starts, polished, and the method that found it."""
    found: list[tuple[float, str, Array]] = []
    for start in starts:
        for name, method in METHODS.items():
            try:
                x = method(model, start)
            except (ValueError, np.linalg.LinAlgError):
                continue  # this way is blocked from this start: a residual that is not finite
            found.append((point_at(model.vector, x).chi_square, name, x))
    if not found or not np.isfinite(min(found, key=lambda entry: entry[0])[0]):
        raise ValueError("no start leads to a finite sum of squares; check the residual at the starts")
    _, name, x = min(found, key=lambda entry: entry[0])
    return minimise(model.vector, model.jacobian, x, model.lower, model.upper, PATIENT), name


def minimize(
    residual: Residual, params: lmfit.Parameters, extra_starts: Sequence[Mapping[str, float]] = (),
    scale_covar: bool = False,
) -> MinimizerResult:  # fmt: skip
    """Return the least-squares fit of any model.

    Parameters
    ----------
    residual : mapping of parameter names to values -> (m,) residual over its standard deviation; it is also called with
        complex values, so it has to be an analytic function of them
    params : starts, bounds, fixed values, ties
    extra_starts : further starts, missing names from ``params``
    scale_covar : True where the standard deviations are known but for a common factor

    Raises
    ------
    ValueError
        When nothing varies, the residual is not analytic, or no start gives a finite residual.
    """
    model = model_of(residual, params)
    first = np.array([params[name].value for name in model.ties.free], dtype=float)
    check_derivative(model, first)
    others = [
        np.array([extra.get(n, v) for n, v in zip(model.ties.free, first, strict=True)]) for extra in extra_starts
    ]
    minimum, name = best_minimum(model, [first, *others])
    bound = (minimum.x <= model.lower) | (minimum.x >= model.upper)
    outcome = Outcome(
        minimum.x, covariance_of(minimum.jacobian, ~bound), minimum.residual, minimum.chi_square,
        float(minimum.residual.size), minimum.evaluations, "least_squares",
        f"lowest of {len(METHODS)} ways, found by {name}", minimum.converged,
    )  # fmt: skip
    return lmfit_result(params, model.ties, outcome, scale_covar)
