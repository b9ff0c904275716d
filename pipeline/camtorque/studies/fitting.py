"""Chart 5: what it costs to find the parameters of one recording, and how far each way stays from the minimum."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import lmfit
import numpy as np
from scipy.optimize import differential_evolution, least_squares

from camtorque.align import align
from camtorque.fit import Prepared, prepare
from camtorque.fit.full_space import evaluate_full, full_jacobian, full_limits, full_values
from camtorque.fit.posterior import sample_posterior
from camtorque.fit.problem import Problem, build_problem
from camtorque.fit.solve import Solution, solve, try_at
from camtorque.fit.uncertainty import covariance, parameter_values
from camtorque.ingest import read_recording
from camtorque.mechanism import Mounting, lift_law, solve_rigid
from camtorque.records import Array
from camtorque.studies.replicates import (
    Stated,
    replicate_deviation,
    stated_by_covariance,
    stated_by_profiles,
    uncertainty_points,
)
from camtorque.studies.table import Chart, Point

EFFECTS = ("chamber", "trigger", "driveline", "sensor", "friction")
REDUCED = ("trigger_offset", "dead_volume", "valve_area")
"""What the global search varies; all others stay at the minimum."""
ITERATIONS = (1, 2, 4, 8, 16, 80)
LEAST = 1.0e-8
REPLICATES = 300
Run = Iterator[tuple[str, str, Array, float]]


def prepared_example(folder: Path) -> Prepared:
    """Return one recording, read, aligned and with its start found."""
    recording = read_recording(folder)
    cycles = align(recording)
    mounting = Mounting(rotation=recording.config.rotation)
    law, mean = lift_law(recording.cam_table), cycles.pressure.mean(axis=0)
    rigid = solve_rigid(recording.config.pump, law, cycles.theta, mean, cycles.mean_speed, mounting=mounting)
    return prepare(recording, cycles, rigid)


def _timed(function: Callable[[], Array]) -> tuple[Array, float]:
    start = time.perf_counter()
    value = function()
    return value, time.perf_counter() - start


def projection(problem: Problem, quick: bool) -> Run:
    """Yield variable projection after more and more iterations."""
    for count in ITERATIONS:
        z, seconds = _timed(lambda count=count: full_values(solve(problem, max_iterations=count)))  # type: ignore[misc]
        yield "variable projection", f"{count} iterations", z, seconds


def full(problem: Problem, quick: bool) -> Run:
    """Yield scipy's trust region on all parameters with exact and with numerical derivatives."""
    limits = full_limits(problem)
    trial = try_at(problem, problem.start())
    start = np.clip(np.concatenate([trial.x, trial.c]), limits.lower, limits.upper)
    start = start + 1e-3 * limits.steps * ((start <= limits.lower).astype(float) - (start >= limits.upper))
    for name, jacobian in (
        ("exact", lambda z: full_jacobian(problem, evaluate_full(problem, z))),
        ("numerical", "2-point"),
    ):
        for count in (4, 16) if quick else (2, 4, 8, 16, 32, 64, 200):

            def run(count: int = count, jacobian: object = jacobian) -> Array:
                return least_squares(
                    lambda at: evaluate_full(problem, at).vector, start, jacobian, (limits.lower, limits.upper),
                    x_scale=limits.steps, max_nfev=count, ftol=1e-12, xtol=1e-12, gtol=1e-12,
                ).x  # fmt: skip

            found, seconds = _timed(run)
            yield f"full least squares, {name} derivatives", f"{count} evaluations", found, seconds


def plain_lmfit(problem: Problem, quick: bool) -> Run:
    """Yield `lmfit.minimize` as most users call it."""
    limits = full_limits(problem)
    trial = try_at(problem, problem.start())
    start = np.concatenate([trial.x, trial.c])
    inside = np.clip(start, limits.lower + 1e-2 * limits.steps, limits.upper - 1e-2 * limits.steps)
    params = lmfit.Parameters()
    rows = zip(inside / limits.steps, limits.lower / limits.steps, limits.upper / limits.steps, strict=True)
    for k, (value, low, high) in enumerate(rows):
        params.add(f"p{k}", value, min=low, max=high)

    def residual(values: lmfit.Parameters) -> Array:
        return evaluate_full(problem, np.array(list(values.valuesdict().values())) * limits.steps).vector

    for count in (200,) if quick else (100, 400, 1600):

        def run(count: int = count) -> Array:
            found = lmfit.minimize(residual, params, max_nfev=count, calc_covar=False)
            return np.array(list(found.params.valuesdict().values())) * limits.steps

        z, seconds = _timed(run)
        yield "lmfit leastsq", f"{count} evaluations", z, seconds


def search(problem: Problem, best: Solution, quick: bool) -> Run:
    """Yield differential evolution over `REDUCED`, all other non-linear parameters at the minimum."""
    places = [k for k, slot in enumerate(problem.nonlinear) if slot.row.name in REDUCED]
    bounds = [(problem.nonlinear[k].row.lower, problem.nonlinear[k].row.upper) for k in places]

    def whole(values: Array) -> Array:
        x = best.x.copy()
        x[places] = values
        return x

    for generations in (3, 10) if quick else (3, 10, 30):

        def run(generations: int = generations) -> Array:
            found = differential_evolution(
                lambda v: try_at(problem, whole(v)).chi_square, bounds, maxiter=generations, popsize=10, seed=1,
                polish=False, tol=0.0,
            )  # fmt: skip
            trial = try_at(problem, whole(found.x))
            return np.concatenate([trial.x, trial.c])

        z, seconds = _timed(run)
        yield f"global search, {len(REDUCED)} parameters", f"{generations} generations", z, seconds


def fitting_charts(examples: Path, quick: bool) -> tuple[Chart, ...]:
    """Return the error of the parameters, and of the stated uncertainty, against time."""
    prepared = prepared_example(examples / "A_0500rpm")
    problem = build_problem([prepared.data], EFFECTS)
    best = solve(problem, max_iterations=400)
    least = best.chi_square
    std = np.sqrt(np.maximum(np.diag(covariance(problem, best).matrix), 0.0))
    std[std == 0.0] = np.inf  # held at a bound: no uncertainty to compare with
    exact = parameter_values(problem, best)
    solve(problem, max_iterations=1)
    runs = [*projection(problem, quick), *full(problem, quick), *plain_lmfit(problem, quick)]
    runs += search(problem, best, quick)
    lowest = min(evaluate_full(problem, z).chi_square for _, _, z, _ in runs)
    if lowest < least * (1.0 - 1e-6):
        raise ValueError(f"fitting study: another method found chi-square {lowest:.6g} < {least:.6g}")
    points = [
        Point(
            family, setting, max(float(np.max(np.abs(z[: exact.size] - exact) / std)), LEAST), seconds,
            (family, setting) == ("variable projection", f"{ITERATIONS[-1]} iterations"),
            not family.startswith("global"),
        )
        for family, setting, z, seconds in runs
    ]  # fmt: skip
    sampled = list(_sampling(problem, best, exact, std, quick))
    points += [Point("sampling (emcee)", setting, mean, cost, candidate=False) for _, setting, _, cost, mean in sampled]
    note = (
        f"recording A_0500rpm, {len(EFFECTS)} effects, {exact.size} parameters, same start; largest distance from the "
        "lowest minimum that any of them found, in standard uncertainties; starts from the scan of the package"
    )
    return (
        Chart("fitting", "Fitting", "largest error / standard uncertainty", "time [s]", tuple(points), note),
        _uncertainty(problem, best, [row[:4] for row in sampled], np.isfinite(std), quick),
    )


def _uncertainty(problem: Problem, best: Solution, sampled: list[Stated], free: Array, quick: bool) -> Chart:
    """Return the error of stated uncertainties against the scatter of replicates."""
    count = REPLICATES // 10 if quick else REPLICATES
    reference = replicate_deviation(problem, best, count)
    stated = [stated_by_covariance(problem, best), stated_by_profiles(problem, best), *sampled]
    points = uncertainty_points(reference, iter(stated), lambda family: family.startswith("covariance"), free)
    text = (
        f"median over parameters of |stated / scatter of the estimates over {count} replicates - 1|; every replicate "
        f"draws the noise and the sheets anew; the reference itself is known to {100.0 / np.sqrt(2.0 * count):.0f} %"
    )
    return Chart(
        "uncertainty", "Stated uncertainty", "error of the stated uncertainty", "time after the fit [s]", tuple(points),
        text,
    )  # fmt: skip


def _sampling(
    problem: Problem, best: Solution, exact: Array, std: Array, quick: bool
) -> Iterator[tuple[str, str, Array, float, float]]:
    """Yield family, chain length, deviation of the chains [SI], time, largest error of the mean over ``std``."""
    rows = [slot.row.per_unit for slot in (*problem.nonlinear, *problem.linear)]
    for steps in (10, 30) if quick else (30, 100, 300):
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # chains that stand still have no autocorrelation
            found = sample_posterior(problem, best, steps)
        seconds = time.perf_counter() - start
        samples = found.samples * np.array(rows)
        error = float(np.max(np.abs(samples.mean(axis=0) - exact) / std))
        yield "sampling (emcee)", f"{steps} steps", samples.std(axis=0), seconds, error
