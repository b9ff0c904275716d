"""Cycle-block bootstrap: the scatter of the fit over resampled cycles, as a check of its statistical errors.

Neighbouring cycles share drift, so blocks of them are drawn with replacement (Kuensch, Annals of Statistics 17 (1989)).
The means of every draw are fitted again from the minimum. What all cycles share, a missing law above all, stays hidden.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.full_space import full_rows
from camtorque.fit.prepare import swapped
from camtorque.fit.problem import FitData, Problem
from camtorque.fit.solve import Solution, solve
from camtorque.fit.uncertainty import parameter_names, parameter_values
from camtorque.laws.chain import binned
from camtorque.records import Array, CamCycles, freeze_arrays

BLOCK = 3
"""Cycles per block."""
TOLERANCE = 1.0e-5
ITERATIONS = 8
"""Steps from the minimum; a resampled mean is never far."""
QUANTILES = (2.5, 97.5)


@dataclass(frozen=True)
class Bootstrap:
    """Scatter of the free parameters over resampled cycles, in the units of the report.

    names, units : (k,); samples : (count, k); std : (k,); low, high : (k,) 2.5 and 97.5 % quantiles
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    samples: Array
    std: Array
    low: Array
    high: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)


def block_indices(n_cycles: int, block: int, generator: np.random.Generator) -> NDArray[np.int64]:
    """Return ``n_cycles`` indices in blocks of neighbours, the last one cut; blocks wrap around the end."""
    starts = generator.integers(0, n_cycles, int(np.ceil(n_cycles / block)))
    return np.asarray((starts[:, None] + np.arange(block)).ravel()[:n_cycles] % n_cycles, dtype=np.int64)


def resampled(item: FitData, cycles: CamCycles, block: int, generator: np.random.Generator) -> FitData:
    """Return a recording with the means of resampled fitted cycles."""
    if cycles.torque is None:
        raise ValueError(f"{item.name}: no torque to resample")
    fitted = np.flatnonzero(~cycles.held_out)
    drawn = fitted[block_indices(fitted.size, block, generator)]
    torque = np.mean(cycles.torque[drawn], axis=0)
    chain = swapped(item, torque, np.mean(cycles.pressure[drawn], axis=0))
    return replace(item, chain=chain, torque=binned(torque), mean_torque=torque)


def bootstrap(
    problem: Problem, solution: Solution, cycles: Sequence[CamCycles], count: int = 100, seed: int = 0,
    block: int = BLOCK,
) -> Bootstrap:  # fmt: skip
    """Return the scatter of the parameters over resampled cycles.

    Parameters
    ----------
    problem, solution : the chosen model at its minimum
    cycles : aligned cycles of its recordings, in the same order
    count, seed, block : number of draws, seed of the draws, cycles per block
    """
    if len(cycles) != len(problem.data):
        raise ValueError(f"{len(cycles)} sets of cycles for {len(problem.data)} recordings")
    generator = np.random.default_rng(seed)
    per = np.array([row.per_unit for row in full_rows(problem)])
    samples = np.empty((count, per.size))
    for k in range(count):
        data = tuple(resampled(i, c, block, generator) for i, c in zip(problem.data, cycles, strict=True))
        drawn = replace(problem, data=data)
        samples[k] = parameter_values(drawn, solve(drawn, solution.x, ITERATIONS, TOLERANCE)) / per
    low, high = np.percentile(samples, QUANTILES, axis=0)
    units = tuple(row.unit for row in full_rows(problem))
    return Bootstrap(parameter_names(problem), units, samples, np.std(samples, axis=0, ddof=1), low, high)
