"""How well a model meets the mean cycle: its metrics, whether it explains it, where it does not, and on unseen angles.

The metrics are defined in docs/result_schema.md.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camtorque.fit.prepare import MeanCycles
from camtorque.fit.problem import FitData, Indices, Problem
from camtorque.fit.solver import Solution
from camtorque.fit.uncertainty import Covariance, inverse
from camtorque.laws.chain import derivative_by
from camtorque.records import Array, Mask, Metrics, ResidualBump, RigidTorque
from camtorque.units import DEGREE, TURN

UNEXPLAINED_TIMES = 3.0
UNEXPLAINED_SHARE = 1.5e-3
"""Unexplained: the residual exceeds so many times odd against even cycles and this share of the peak."""
BLOCK_DEG = 20.0
BUMP_TIMES = 4.0
BUMP_WINDOW_DEG = 3.0
MOST_BUMPS = 4
LEAST_SWINGS, RINGING_SHARE, RINGING_WIDTH = 5, 0.5, 12
"""A bump rings where so many swings at least, within so many quarters of a line of the spectrum, hold this share."""
LEAST_REACH, LEAST_CURVED, LEAST_PLACES = 3.0 * DEGREE, 3, 5
"""Angle to either side over which the slope at a minimum is taken, how many times as far its curvature, and places to
either side that tell how much the slope scatters."""
STROKE = (0.05, 0.95)
"""Shares of the lift between which a stroke counts."""


def mean_square_about(values: Array, reach: int) -> Array:
    """Return the mean square of periodic values (n,) about each of them, ``reach`` to either side, (n,)."""
    about = np.full(2 * reach + 1, 1.0 / (2 * reach + 1))
    return np.convolve(np.pad(values**2, reach, "wrap"), about, "valid")


def is_explained(residual: Array, odd_even: float, peak: float) -> bool:
    """Return whether the model explains the mean cycle."""
    rms = float(np.sqrt(np.mean(residual**2)))
    return not (rms > UNEXPLAINED_TIMES * odd_even and rms > UNEXPLAINED_SHARE * peak)


def explains(item: FitData, solution: Solution, odd_even: float, room: float = 1.0) -> bool:
    """Return whether a fit of one recording explains its mean cycle, beside the lift correction that it asks for.

    ``room``: factor by which the residual may still grow.
    """
    left = room * solution.left / item.weight
    return is_explained(left, odd_even, float(np.max(item.torque)))


def block_cross_validation(problem: Problem, solution: Solution, cov: Covariance) -> Array:
    """Return the rms error on each block of `BLOCK_DEG` that the fit has not seen, by its own linear model, (m,) [N m].

    Each block's residual without it is ``(I - J_b C J_b')^-1 r_b``, exact where the model is linear. Where one block
    alone tells a parameter the matrix is nearly singular: the size of such an error says no more than that.
    """
    weight, lift, left = problem.data[0].weight, solution.lift, solution.left
    jacobian = derivative_by(solution.output, problem.names) * weight[:, None]
    columns = np.column_stack([jacobian * cov.prior_std, lift.vectors * lift.strength])
    matrix = inverse(columns.T @ columns + np.eye(columns.shape[1]))
    errors = []
    for place in np.array_split(np.arange(left.size), round(360.0 / BLOCK_DEG)):
        block = columns[place]
        leverage = np.eye(place.size) - block @ matrix @ block.T
        error = np.linalg.solve(leverage, left[place]) / weight[place]
        errors.append(np.sqrt(np.mean(error**2)))
    return np.array(errors)


def residual_bumps(residual: Array, repeat: Array, fitted: Any) -> tuple[ResidualBump, ...]:
    """Return the stretches where the residual stands out of what the cycles repeat, largest first.

    Parameters
    ----------
    residual, repeat : (n_theta,) measured - model, odd - even cycles [N m]
    fitted : model on the same grid, for the phase of the pump
    """
    n = residual.size
    width = max(1, round(n * BUMP_WINDOW_DEG / 360.0))
    level = float(np.sqrt(np.mean(repeat**2))) + 1e-12
    padded = np.pad(residual, width, "wrap") ** 2
    smooth = np.sqrt(np.convolve(padded, np.ones(width) / width, "same")[width:-width])
    bumps, angles = [], fitted.chain.theta
    first = int(np.argmin(smooth))  # where it is quiet, so that a bump across the zero of the angle is one
    quiet, turned = np.roll(smooth, -first), np.roll(residual, -first)
    for start, stop in _stretches(quiet > BUMP_TIMES * level, width):
        part = turned[start:stop]
        top = (first + start + int(np.argmax(np.abs(part)))) % n
        times = float(np.sqrt(np.mean(part**2))) / level
        begins, ends = (float(angles[(first + place) % n]) for place in (start, min(stop, n - 1)))
        bumps.append(ResidualBump(
            begins, ends, float(residual[top]), times, phase_at(fitted, top),
            ringing(part, 2.0 * np.pi / n / fitted.chain.speed),
        ))  # fmt: skip
    return tuple(sorted(bumps, key=lambda bump: -abs(bump.peak))[:MOST_BUMPS])


def _stretches(above: Mask, least: int) -> list[tuple[int, int]]:
    """Return start and end of every stretch; those nearer to each other than ``least`` points are one."""
    edges = np.flatnonzero(np.diff(np.r_[0, above.astype(int), 0]))
    found: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found and start - found[-1][1] < least:
            start = found.pop()[0]
        found.append((start, stop))
    return found


def ringing(part: Array, step: float) -> float:
    """Return the frequency at which most of a stretch swings [Hz], 0 where it does not.

    Parameters
    ----------
    part : (n,) residual; step : time between its points [s]
    """
    n = part.size
    if n < LEAST_SWINGS**2:
        return 0.0
    power = np.abs(np.fft.rfft((part - np.mean(part)) * np.hanning(n), 4 * n)) ** 2
    top = int(np.argmax(power))
    near = slice(max(0, top - RINGING_WIDTH), top + RINGING_WIDTH + 1)
    swings = top / 4.0
    clear = np.sum(power[near]) > RINGING_SHARE * np.sum(power)
    return swings / (n * step) if clear and LEAST_SWINGS <= swings < n / 4.0 else 0.0


def phase_at(fitted: Any, place: int) -> str:
    """Return what the pump does at a point of the grid."""
    lift, slope = fitted.output.motion.lift[0], fitted.output.motion.lift[1]
    port, spill, seat, _ = fitted.output.flows[place]
    largest = np.max(np.abs(fitted.output.flows))
    rising = slope[place] > 0.0
    share = (lift[place] - np.min(lift)) / np.ptp(lift)
    if share < 0.02:
        return "base circle"
    if abs(spill) > 0.05 * largest:
        return "spill"
    if seat > 0.05 * largest:
        return "delivery"
    if abs(port) > 0.05 * largest:
        return "inlet port open"
    if share > 0.97:
        return "top dwell"
    return "compression" if rising else "expansion on the return"


def stroke_masks(lift: Array, velocity: Array) -> tuple[Mask, Mask]:
    """Return where the lift rises and where it falls between 5 and 95 % of its range, each (n_theta,)."""
    share = (lift - np.min(lift)) / np.ptp(lift)
    inside = (share >= STROKE[0]) & (share <= STROKE[1])
    return inside & (velocity > 0.0), inside & (velocity < 0.0)


def loaded_part(rigid: Array, lift: Array, velocity: Array) -> tuple[Mask, Mask]:
    """Return the loaded part of the forward stroke and the return stroke, each (n_theta,), as `metrics` use them."""
    rise, fall = stroke_masks(lift, velocity)
    return rise & (rigid > 0.2 * np.max(rigid[rise])), fall


def parts_of_gap(rigid: RigidTorque, measured: Array) -> tuple[Mask, Mask, int]:
    """Return both of `loaded_part`, and where the measured torque (n_theta,) is least on the return stroke.

    It is least as its mean over `LEAST_REACH` to either side is, weighed by a parabola: which sample of a flat minimum
    is the lowest is noise.
    """
    forward, fall = loaded_part(rigid.torque, rigid.lift, rigid.lift_velocity)
    apart = _apart(measured.size)
    near = np.flatnonzero(fall)[:, None] + apart
    smooth = np.take(measured, near, mode="wrap") @ (1.0 - (apart / (apart[-1] + 1.0)) ** 2)
    return forward, fall, int(np.flatnonzero(fall)[np.argmin(smooth)])


def _apart(n_theta: int) -> Indices:
    """Return the places within `LEAST_REACH` of one, from it."""
    reach = max(round(LEAST_REACH * n_theta / TURN), 1)
    return np.arange(-reach, reach + 1)


def least_place_std(means: MeanCycles, lowest: int) -> float:
    """Return how far noise moves the place at which the mean torque is least [rad], as `parts_of_gap` finds it.

    It lies where the slope of a straight line through its surroundings is none: that slope of what both halves of the
    cycles differ in, over the curvature.
    """
    step, apart = TURN / means.torque_all.size, _apart(means.torque_all.size)
    wide = np.arange(LEAST_CURVED * apart[0], LEAST_CURVED * apart[-1] + 1)
    curvature = 2.0 * np.polyfit(step * wide, np.take(means.torque_all, lowest + wide, mode="wrap"), 2)[0]
    half = 0.5 * (means.torque - means.held_torque)
    around = lowest + apart[-1] * np.arange(-LEAST_PLACES, LEAST_PLACES + 1)[:, None] + apart
    slopes = np.take(half, around, mode="wrap") @ apart / (step * np.sum(apart**2))
    noise = float(np.sqrt(np.mean(slopes**2)))
    return min(noise / curvature, LEAST_REACH) if curvature > 0.0 else LEAST_REACH


def metrics_of_fit(
    means: MeanCycles, fitted: Array, held: Array, rigid: Array, lift: Array, velocity: Array
) -> dict[str, Metrics]:
    """Return the metrics of the rigid model, of the fitted one and of that on the cycles that were held out.

    ``fitted`` and ``held`` (n_theta,) are the model for both halves of the cycles [N m]; else as in `metrics`.
    """
    pairs = {
        "rigid": (means.torque_all, rigid), "fitted": (means.torque, fitted),
        "fitted_held_out_cycles": (means.held_torque, held),
    }  # fmt: skip
    return {name: metrics(*pair, rigid, lift, velocity) for name, pair in pairs.items()}


def metrics(measured: Array, model: Array, rigid: Array, lift: Array, velocity: Array) -> Metrics:
    """Return the metrics of one model.

    Parameters
    ----------
    measured, model, rigid : (n_theta,) mean cycle, model, rigid model [N m]
    lift, velocity : (n_theta,) lift [m] and its slope [m/rad] at the nominal cam angle
    """
    residual = measured - model
    loaded, fall = loaded_part(rigid, lift, velocity)
    rms = float(np.sqrt(np.mean(residual**2)))
    mean_model = float(np.mean(model[loaded]))
    return Metrics(
        rms_nm=rms,
        rms_percent_of_peak=100.0 * rms / float(np.max(measured)),
        forward_gap_percent=100.0 * (float(np.mean(measured[loaded])) - mean_model) / mean_model,
        forward_peak_error_nm=float(np.max(measured[loaded]) - np.max(model[loaded])),
        return_min_measured_nm=float(np.min(measured[fall])),
        return_min_model_nm=float(np.min(model[fall])),
        return_rms_nm=float(np.sqrt(np.mean(residual[fall] ** 2))),
    )
