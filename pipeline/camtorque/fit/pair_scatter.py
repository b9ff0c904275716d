"""How well the mean residual of a recording is known by the scatter of its cycles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from camtorque.fit.prepare import over_even_angle
from camtorque.fit.problem import FitData
from camtorque.laws.chain import binned, coefficients_of, derivative_by, evaluate
from camtorque.records import Array, CamCycles

MOST_BLOCKS = 48
"""Blocks of consecutive cycles at most whose scatter tells how well a mean residual is known."""
TOGETHER = 0.5
"""Share of the blocks' covariance in that of their mean, and least share of its variances alone."""


def mean_scatter(
    cycles: CamCycles, item: FitData, values: Mapping[str, float], own: Sequence[str]
) -> tuple[Array, float]:
    """Return the covariance of the mean residual, (bins, bins) [(N m)^2], and the standard error of its angle [rad].

    Each block of cycles is modelled with its own line pressure, its own zeros and its own end of delivery: what noise,
    jitter and changing loads do to torque and model together is no scatter of the difference, since each recording has
    its own ``own`` parameters there too. How far these turn from block to block is how well the mean knows its angle.
    """
    assert cycles.torque is not None
    swing, n, linear = item.chain.swing, item.chain.theta.size, coefficients_of(values)
    blocks = np.array_split(np.arange(cycles.speed.size), min(MOST_BLOCKS, cycles.speed.size))
    each = []
    for block in blocks:
        pressure = over_even_angle(np.mean(cycles.pressure[block], axis=0), swing, n)
        output = evaluate(replace(item.chain, line_pressure=pressure), values, linear)
        torque = binned(over_even_angle(np.mean(cycles.torque[block], axis=0), swing, n), item.chain.bins)
        each.append(torque - output.torque - output.linear @ linear)
    apart = np.array(each) - np.mean(each, axis=0)
    count = apart.shape[0]
    size = np.sqrt(np.mean(apart**2, axis=0)) + 1e-12
    columns = derivative_by(evaluate(item.chain, values, linear, tangents=True), own) / size[:, None]
    length = np.linalg.norm(columns, axis=0) + 1e-300
    columns /= length
    share = np.linalg.lstsq(columns, (apart / size).T, rcond=1e-6)[0]
    apart = apart - (columns @ share).T * size
    angles = (share / length[:, None])[[name == "trigger_offset" for name in own]]
    wander = float(np.sqrt(np.sum(angles**2) / (count - 1) / count))
    return covariance_of_mean(apart), wander


def covariance_of_mean(apart: Array) -> Array:
    """Return the covariance of the mean of blocks (n, bins) that are given less their mean.

    The covariance of n blocks lies in n - 1 directions; in all others what counts of the variances alone is all there
    is, and half of them is half of the noise. So they count by as much as the blocks leave the rest untold (`untold`).
    An inverse variance of n blocks is too large by (n - 1) / (n - 3) in the mean (Student).
    """
    count = apart.shape[0]
    covariance = apart.T @ apart / (count - 1) / count
    student = 1.0 + 2.0 / max(count - 3.0, 0.5)
    return np.asarray(student * (TOGETHER * covariance + untold(apart) * np.diag(np.diag(covariance))))


def untold(apart: Array) -> float:
    """Return how much of the correlations of bins is chance, from `TOGETHER` to 1, of blocks (n, bins) less their mean.

    The best weight of variances alone by Schaefer & Strimmer (2005), Statistical Applications in Genetics 4, 32.
    """
    count = apart.shape[0]
    scaled = apart / (np.sqrt(np.sum(apart**2, axis=0) / (count - 1)) + 1e-300)
    squares = scaled**2
    # sums over all pairs of bins of the squares of their correlation, and of its variance, without the pairs of one bin
    size = (np.sum((scaled @ scaled.T) ** 2) - np.sum(np.sum(squares, axis=0) ** 2)) / (count - 1) ** 2
    products = np.sum(np.sum(squares, axis=1) ** 2) - np.sum(squares**2)
    chance = count / (count - 1) ** 3 * (products - (count - 1) ** 2 / count * size)
    return float(np.clip(chance / size, TOGETHER, 1.0)) if size > 0.0 else 1.0
