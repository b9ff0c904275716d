"""Two recordings of one pump at one speed: what differs between them.

The errors of sheets, certificates, lift table and laws are the same in both, so the mean of both residuals is weighed
with them and their difference without: the difference is known by the scatter of the cycles, what clocks and trigger
may have shifted, and the small share of the laws' error that two runs do not have in common::

    chi^2 = |(r_A + r_B) / 2|^2 weighed by (laws, lift table, scatter)  +  |r_B - r_A|^2 weighed by (scatter, share)

All parameters are common; zeros and the end of delivery are each recording's own. Which further parameters differ is
`fit.changes`. Minimised by Gauss-Newton steps within bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from camtorque.fit.prepare import INDEPENDENT, binned_at_centres, on_grid
from camtorque.fit.problem import FitData, build_problem
from camtorque.fit.single import Candidate, Prepared
from camtorque.fit.solver import lifts_at
from camtorque.laws.chain import BINS, COLUMN_NAMES, NONLINEAR_NAMES, ChainOutput, evaluate
from camtorque.records import Array, CamCycles, Refusal, freeze_arrays

SAME_SPEED = 0.02
"""Relative difference of speed up to which the laws' error counts as common."""
UNCOMMON = 3.0e-4
"""Share of the torque by which two runs of an unchanged pump may differ for reasons no law knows."""
UNCOMMON_FLOOR = 1.0e-4
"""The same as a share of the peak torque."""
OWN_NAMES = (
    "torque_zero", "pressure_zero", "end_of_delivery", "end_width", "spill_lift", "spill_width", "trigger_offset",
)  # fmt: skip
"""Parameters that belong to the recording and not to the pump; the trigger within the error of its edges."""
STEPS_OF_CHANGE = 4.0
"""Standard deviation of a plausible change, in steps that matter (`ParameterRow.step`)."""
ZERO_DRIFT = 2.0e-3
"""Drift of the torque's zero between its standstill reading and the run, as a share of the peak torque."""
MOST_BLOCKS = 48
"""Blocks of consecutive cycles at most whose scatter tells how well a mean residual is known."""
EDGE_SHARE = 0.5
"""Share of the time error of one trigger edge that does not average out: levels and samples are the same in each."""
LEAST_EDGE = np.radians(0.002)
RESIDUAL_SHARE, RESIDUAL_REACH = 0.15, 15
"""Share of what the laws leave that two runs do not have in common, and bins over which its size is taken."""
PRESSURE_SHIFT = 1.0e-6
"""Time by which the line pressure is shifted to see what a clock error does [s]."""


@dataclass(frozen=True)
class Pair:
    """Two recordings in one structure.

    Attributes
    ----------
    items : both as the fit sees them, means of all used cycles
    cycles : of both
    names : free parameters
    fixed : values of the others
    mean_root, difference_root : (BINS, BINS) lower Cholesky factors of the covariances [N m]
    """

    items: tuple[FitData, FitData]
    cycles: tuple[CamCycles, CamCycles]
    names: tuple[str, ...]
    fixed: Mapping[str, float]
    mean_root: Array
    difference_root: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def own(self) -> dict[str, float]:
        """Parameters of which each recording has its own, with how far they differ [SI]."""
        wide = dict(zip(self.names, np.sqrt(2.0) * self.priors[1], strict=True))
        wide["torque_zero"] = np.hypot(wide["torque_zero"], ZERO_DRIFT * np.max(np.abs(self.items[0].torque)))
        edges = [np.nan_to_num(c.trigger_jitter_s) * c.mean_speed for c in self.cycles]
        wide["trigger_offset"] = max(EDGE_SHARE * float(np.hypot(*edges)), LEAST_EDGE)
        return {name: float(wide[name]) for name in self.names if name in OWN_NAMES}

    def change(self, name: str) -> float:
        """Return how far a parameter of the pump plausibly changes between the recordings [SI]."""
        return STEPS_OF_CHANGE * self.items[0].rows[name].step

    def row_values(self, field: str) -> Array:
        """Return one field of the rows of the free parameters."""
        return np.array([getattr(self.items[0].rows[name], field) for name in self.names])

    @property
    def priors(self) -> tuple[Array, Array]:
        """Means and standard deviations of the free parameters; as wide as the bounds where nothing is known."""
        lower, upper = self.row_values("lower"), self.row_values("upper")
        rows = [self.items[0].rows[name].prior for name in self.names]
        means = [row[0] if row else 0.5 * (a + b) for row, a, b in zip(rows, lower, upper, strict=True)]
        stds = [row[1] if row else b - a for row, a, b in zip(rows, lower, upper, strict=True)]
        return np.array(means), np.array(stds)


@dataclass(frozen=True)
class PairState:
    """Both recordings at one set of values.

    Attributes
    ----------
    before, after : (k,) values of the free parameters [SI]
    residuals : measured less model of each, (BINS,) [N m]
    jacobians : of the model by the free parameters, (BINS, k) [N m per SI]
    outputs : of the chain
    """

    before: Array
    after: Array
    residuals: tuple[Array, Array]
    jacobians: tuple[Array, Array]
    outputs: tuple[ChainOutput, ChainOutput]


def pair_of(before: Prepared, after: Prepared, start: Candidate) -> Pair:
    """Return two recordings in the structure of one of the minima of the first.

    Raises
    ------
    Refusal : they run at different speeds
    """
    speeds = [item.cycles.mean_speed * 30.0 / np.pi for item in (before, after)]
    if abs(speeds[1] / speeds[0] - 1.0) > SAME_SPEED:
        raise Refusal(
            f"compare: {before.recording.config.id} runs at {speeds[0]:.1f} rpm and {after.recording.config.id} at "
            f"{speeds[1]:.1f} rpm, "
            f"expected one speed within {100 * SAME_SPEED:.0f} %; the laws' error cancels at one speed only; compare "
            "recordings of one speed, or campaigns that hold the same speeds"
        )
    hidden = start.data.chain.shaft_torque - before.measured
    items = tuple(_item(side, start.data, hidden) for side in (before, after))
    problem = start.problem
    names = tuple(slot.row.name for slot in problem.slots)
    values, coefficients = problem.values(start.solution.z, 0)
    fixed = {**values, **dict(zip(COLUMN_NAMES, coefficients, strict=True))}
    mean = mean_covariance(items[0], start)
    none = np.eye(BINS)
    pair = Pair(items, (before.cycles, after.cycles), names, fixed, none, none)  # type: ignore[arg-type]
    noise, apart = difference_covariance(pair, fixed, np.zeros(BINS))
    return replace(pair, mean_root=root_of(mean + noise / 4.0), difference_root=root_of(apart))


def difference_covariance(pair: Pair, values: Mapping[str, float], left: Array) -> tuple[Array, Array]:
    """Return the covariance of the scatter, and of all by which two runs differ, (BINS, BINS) each [(N m)^2].

    Parameters
    ----------
    values : of all parameters
    left : (BINS,) what the laws leave [N m]; a share of its size is not common to both
    """
    item = pair.items[0]
    noise = sum(mean_scatter(c, one, values) for c, one in zip(pair.cycles, pair.items, strict=True))
    peak = float(np.max(np.abs(item.torque)))
    reach = np.full(2 * RESIDUAL_REACH + 1, 1.0 / (2 * RESIDUAL_REACH + 1))
    size = np.convolve(np.pad(left**2, RESIDUAL_REACH, "wrap"), reach, "valid")
    error = (UNCOMMON * item.torque) ** 2 + (UNCOMMON_FLOOR * peak) ** 2 + RESIDUAL_SHARE**2 * size
    return np.asarray(noise), noise + np.diag(error * BINS / INDEPENDENT) + shift_covariance(pair, values)


def root_of(covariance: Array) -> Array:
    """Return the lower Cholesky factor."""
    return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)


def loosened(pair: Pair, state: PairState) -> Pair:
    """Return the pair with the covariance of the difference as it is at a state."""
    values = {**pair.fixed, **dict(zip(pair.names, state.before.tolist(), strict=True))}
    _, apart = difference_covariance(pair, values, 0.5 * (state.residuals[0] + state.residuals[1]))
    return replace(pair, difference_root=root_of(apart))


def _item(side: Prepared, data: FitData, hidden: Array) -> FitData:
    cycles = side.cycles
    assert cycles.torque is not None
    n = data.chain.theta.size
    torque = np.mean(cycles.torque, axis=0)
    turned = cycles.details.get("angle_deviation")  # of each recording, where a wheel on the cam measured it
    deviation = on_grid(np.asarray(turned), n) if data.chain.deviation.size and turned is not None else np.zeros(0)
    chain = replace(
        data.chain, speed=cycles.mean_speed, line_pressure=on_grid(np.mean(cycles.pressure, axis=0), n),
        shaft_torque=on_grid(torque, n) + hidden, deviation=deviation,
    )  # fmt: skip
    return replace(data, name=side.recording.config.id, chain=chain, torque=binned_at_centres(torque))


def mean_covariance(item: FitData, start: Candidate) -> Array:
    """Return the covariance of what the laws and the lift table leave, (BINS, BINS) [(N m)^2]."""
    problem = build_problem([start.data])
    lift = lifts_at(problem, start.solution.z)[0]
    modes = lift.vectors * lift.strength / item.weight[:, None]
    return np.asarray(np.diag(1.0 / item.weight**2) + modes @ modes.T)


def mean_scatter(cycles: CamCycles, item: FitData, values: Mapping[str, float]) -> Array:
    """Return the covariance of the mean residual, (BINS, BINS) [(N m)^2].

    Each block of cycles is modelled with its own line pressure: what noise, jitter and changing loads do to torque
    and model together is in the scatter of the blocks' residuals.
    """
    assert cycles.torque is not None
    n = item.chain.theta.size
    nonlinear = {name: values[name] for name in NONLINEAR_NAMES}
    linear = np.array([values[name] for name in COLUMN_NAMES])
    blocks = np.array_split(np.arange(cycles.speed.size), min(MOST_BLOCKS, cycles.speed.size))
    each = []
    for block in blocks:
        pressure = on_grid(np.mean(cycles.pressure[block], axis=0), n)
        output = evaluate(replace(item.chain, line_pressure=pressure), nonlinear)
        torque = binned_at_centres(np.mean(cycles.torque[block], axis=0))
        each.append(torque - output.torque - output.linear @ linear)
    apart = np.array(each) - np.mean(each, axis=0)
    count = apart.shape[0]
    covariance = apart.T @ apart / (count - 1) / count
    return np.asarray(0.5 * (covariance + np.diag(np.diag(covariance))))


def shift_covariance(pair: Pair, values: Mapping[str, float]) -> Array:
    """Return the covariance of what the recordings' clocks may have shifted, (BINS, BINS) [(N m)^2]."""
    item = pair.items[0]
    chain = item.chain
    nonlinear = {name: values[name] for name in NONLINEAR_NAMES}
    linear = np.array([values[name] for name in COLUMN_NAMES])
    late = _slope(chain.line_pressure, chain.speed) * PRESSURE_SHIFT
    ends = []
    for sign in (-1.0, 1.0):
        output = evaluate(replace(chain, line_pressure=chain.line_pressure + sign * late), nonlinear)
        ends.append(output.torque + output.linear @ linear)
    clock = float(np.linalg.norm([max((c.stderr_s for c in cycles.clocks), default=0.0) for cycles in pair.cycles]))
    pressure = (ends[1] - ends[0]) / (2.0 * PRESSURE_SHIFT)
    shifts = np.column_stack([pressure, _slope(item.torque, chain.speed)]) * clock
    return np.asarray(shifts @ shifts.T)


def _slope(values: Array, speed: float) -> Array:
    """Return the time derivative of a periodic signal on a uniform angle grid."""
    step = 2.0 * np.pi / values.size
    return np.asarray((np.roll(values, -1) - np.roll(values, 1)) / (2.0 * step) * speed)


def evaluated(pair: Pair, before: Array, after: Array) -> PairState:
    """Return both recordings at their values, (k,) each [SI]."""
    residuals, jacobians, outputs = [], [], []
    n = len(NONLINEAR_NAMES)
    order = {name: k for k, name in enumerate((*NONLINEAR_NAMES, *COLUMN_NAMES))}
    columns = [order[name] for name in pair.names]
    for item, z in zip(pair.items, (before, after), strict=True):
        values = {**pair.fixed, **dict(zip(pair.names, z.tolist(), strict=True))}
        linear = np.array([values[name] for name in COLUMN_NAMES])
        output = evaluate(item.chain, {name: values[name] for name in NONLINEAR_NAMES}, linear, tangents=True)
        residuals.append(item.torque - output.torque - output.linear @ linear)
        assert output.derivative is not None
        jacobians.append(np.column_stack([output.derivative[:, :n], output.linear])[:, columns])
        outputs.append(output)
    return PairState(before, after, tuple(residuals), tuple(jacobians), tuple(outputs))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Linear:
    """The pair linearised: whitened columns of common values and of differences, and the whitened residual.

    Attributes
    ----------
    matrix : (2 BINS, k + m) by common values, then by the differences of ``differing``
    residual : (2 BINS,) at the state
    differing : names, in the order of the columns
    """

    matrix: Array
    residual: Array
    differing: tuple[str, ...]


def linearised(pair: Pair, state: PairState, differing: Sequence[str]) -> Linear:
    """Return the whitened residual and columns for the parameters that may differ."""
    place = [pair.names.index(name) for name in differing]
    one, two = state.jacobians
    first = np.column_stack([0.5 * (one + two), 0.5 * two[:, place], 0.5 * sum(state.residuals)])  # type: ignore[arg-type]
    second = np.column_stack([two - one, two[:, place], state.residuals[1] - state.residuals[0]])
    stacked = np.vstack([
        solve_triangular(pair.mean_root, first, lower=True),
        solve_triangular(pair.difference_root, second, lower=True),
    ])  # fmt: skip
    return Linear(stacked[:, :-1], stacked[:, -1], tuple(differing))


def objective(pair: Pair, state: PairState, differing: Mapping[str, float]) -> float:
    """Return chi-square with the priors of values and of differences."""
    line = linearised(pair, state, ())
    place = [pair.names.index(name) for name in differing]
    means, stds = pair.priors
    away = (state.after - state.before)[place] / np.array(list(differing.values()))
    return float(line.residual @ line.residual + np.sum(((state.before - means) / stds) ** 2) + away @ away)


def minimised(pair: Pair, state: PairState, differing: Mapping[str, float], iterations: int) -> PairState:
    """Return the pair at the minimum.

    Parameters
    ----------
    differing : parameters that may differ, with the standard deviation of the difference [SI]
    """
    place = [pair.names.index(name) for name in differing]
    k = len(pair.names)
    means, stds = pair.priors
    change = np.array(list(differing.values()))
    lower, upper = pair.row_values("lower"), pair.row_values("upper")
    scale = np.r_[pair.row_values("step"), pair.row_values("step")[place]]
    value, damping = objective(pair, state, differing), 1e-2
    for _ in range(iterations):
        line = linearised(pair, state, tuple(differing))
        prior = np.r_[1.0 / stds, 1.0 / change] * scale
        jacobian = line.matrix * scale
        matrix = jacobian.T @ jacobian + np.diag(prior**2)
        away = np.r_[state.before - means, (state.after - state.before)[place]] / scale
        vector = jacobian.T @ line.residual - prior**2 * away
        gained = 0.0
        while damping < 1e6:
            damped = matrix + np.diag(damping * np.diag(matrix))
            step = within(damped, vector, state, place, (lower, upper), scale)
            before = np.clip(state.before + step[:k], lower, upper)
            after = before.copy()
            after[place] = np.clip(state.after[place] + step[:k][place] + step[k:], lower[place], upper[place])
            trial = evaluated(pair, before, after)
            new = objective(pair, trial, differing)
            if new < value:
                gained, state, value = value - new, trial, new
                damping = max(damping / 5.0, 1e-6)
                break
            damping *= 5.0
        if gained < 1e-3 * value / INDEPENDENT + 0.02:
            break
    return state


def within(
    matrix: Array, vector: Array, state: PairState, place: Sequence[int], bounds: tuple[Array, Array], scale: Array
) -> Array:
    """Return the step that leaves those parameters at a bound that it would push beyond it [SI]."""
    k = state.before.size
    lower, upper = bounds
    held = np.zeros(scale.size, dtype=bool)
    step = np.zeros(scale.size)
    for _ in range(6):
        free = ~held
        step = np.zeros(scale.size)
        step[free] = cho_solve(cho_factor(matrix[np.ix_(free, free)]), vector[free])
        common = state.before + step[:k] * scale[:k]
        own = state.after[list(place)] + (step * scale)[:k][list(place)] + (step * scale)[k:]
        out = np.r_[
            ((common < lower) & (state.before <= lower)) | ((common > upper) & (state.before >= upper)),
            ((own < lower[list(place)]) & (state.after[list(place)] <= lower[list(place)]))
            | ((own > upper[list(place)]) & (state.after[list(place)] >= upper[list(place)])),
        ]
        if not (out & free).any():
            break
        held |= out
    return np.asarray(step * scale)
