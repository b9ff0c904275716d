"""What differs between two recordings, fitted together.

The mean of both residuals is weighed with the errors that both share, their difference without them::

    chi^2 = |(r_A + r_B) / 2|^2 weighed by (laws, lift table, scatter)  +  |r_B - r_A|^2 weighed by (scatter, share)

All parameters are common; the second recording differs along the directions of a basis, each one standard deviation
long: own zeros and ends of delivery, and the events of `fit.changes`. Minimised by Gauss-Newton steps within bounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from camtorque.fit.gains import GAINS
from camtorque.fit.pair import TwoRecordings
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.turned import at_angle
from camtorque.fit.uncertainty import LEAST_FREEDOM
from camtorque.laws.chain import ChainOutput, coefficients_of, derivative_by, evaluate
from camtorque.records import Array, ReadOnly

GAIN_STEP = 3.0e-3
"""Gain over which a derivative is taken: under a much smaller one of the pressure steps of the valve would count."""


@dataclass(frozen=True)
class Basis(ReadOnly):
    """Directions in which two recordings may differ.

    Attributes
    ----------
    labels : event and parameter of each; the event is empty for what each recording has its own
    columns : (k, m) one standard deviation of each, by the free parameters [SI]
    """

    labels: tuple[tuple[str, str], ...]
    columns: Array


@dataclass(frozen=True)
class PairState:
    """Both recordings at one set of values.

    Attributes
    ----------
    before, after : (k,) values of the free parameters [SI]
    basis, moved : directions in which they differ, and by how many standard deviations along each, (m,)
    residuals : measured less model of each at the true cam angle of the first, (bins,) [N m]
    jacobians : of the model by the free parameters, (bins, k) [N m per SI]
    turned : what differences of trigger and delay do by turning the second residual, (bins, k) [N m per SI]
    outputs : of the chain
    """

    before: Array
    after: Array
    basis: Basis
    moved: Array
    residuals: tuple[Array, Array]
    jacobians: tuple[Array, Array]
    turned: Array
    outputs: tuple[ChainOutput, ChainOutput]


def evaluated(pair: TwoRecordings, before: Array, basis: Basis, moved: Array) -> PairState:
    """Return both recordings at values of the first, (k,) [SI], and a way of the second along a basis, (m,)."""
    after = np.clip(before + basis.columns @ moved, *pair.bounds)
    residuals, jacobians, outputs = [], [], []
    known = [name for name in pair.names if name not in GAINS]
    for side, z in enumerate((before, after)):
        chain, values = pair.sensed(side, z)
        linear = coefficients_of(values)
        output = evaluate(chain, values, linear, tangents=True)
        residuals.append(pair.items[side].torque - output.torque - output.linear @ linear)
        # what gains do is asked for where one is followed: `linearised`
        jacobians.append(np.pad(derivative_by(output, known), ((0, 0), (0, len(pair.names) - len(known)))))
        outputs.append(output)
    # what the laws leave stays where it is on the cam, whatever trigger and delay make of the measured angle
    together = np.column_stack([residuals[1], jacobians[1]])
    together = at_angle(together, _turn(pair, before, after, outputs[0]))
    residuals[1], jacobians[1] = together[:, 0], together[:, 1:]
    turned = -np.outer(angle_slope(residuals[1]), by_angle(pair))
    return PairState(
        before, after, basis, moved, tuple(residuals), tuple(jacobians), turned, tuple(outputs)  # type: ignore[arg-type]
    )  # fmt: skip


def by_gain(pair: TwoRecordings, state: PairState, name: str) -> Array:
    """Return the derivative of the second torque by the gain of a sensor, (bins,) [N m], turned as its residual is."""
    moved = state.after.copy()
    moved[pair.names.index(name)] += GAIN_STEP
    chain, values = pair.sensed(1, moved)
    linear = coefficients_of(values)
    here, there = state.outputs[1], evaluate(chain, values, linear)
    step = there.torque - here.torque + (there.linear - here.linear) @ linear
    return at_angle(step / GAIN_STEP, _turn(pair, state.before, state.after, state.outputs[0]))


def _turn(pair: TwoRecordings, before: Array, after: Array, output: ChainOutput) -> float:
    """Return by how much later the second recording has to be read; ``output`` is that of the first [rad]."""
    return float(by_angle(pair) @ (after - before)) + turn_of_tooth(pair, output)


def by_angle(pair: TwoRecordings) -> Array:
    """Return the angle shift of the second recording per unit difference of each parameter, (k,) [rad per SI]."""
    rates = {"trigger_offset": -1.0, "delay_error": pair.items[1].chain.speed}
    return np.array([rates.get(name, 0.0) for name in pair.names])


def turn_of_tooth(pair: TwoRecordings, output: ChainOutput) -> float:
    """Return by how much the cam gains on even running between the teeth of the first and the second recording [rad].

    Each tooth is the zero of its own recording's even angle; ``output`` is that of the first.
    """
    theta = pair.items[0].chain.theta
    teeth = [item.chain.trigger_angle for item in pair.items]
    one, two = np.interp(teeth, theta, output.motion.theta - theta, period=2.0 * np.pi)
    return float(two - one)


def angle_slope(values: Array) -> Array:
    """Return the derivative of a periodic column by the angle, (n,) [1/rad]."""
    orders = np.arange(values.size // 2 + 1)
    return np.asarray(np.fft.irfft(1j * orders * np.fft.rfft(values), values.size))


def along(pair: TwoRecordings, state: PairState, basis: Basis) -> PairState:
    """Return a state in another basis: directions of the same label keep how far they went."""
    gone = dict(zip(state.basis.labels, state.moved.tolist(), strict=True))
    return evaluated(pair, state.before, basis, np.array([gone.get(label, 0.0) for label in basis.labels]))


def linearised(pair: TwoRecordings, state: PairState, columns: Array) -> tuple[Array, Array]:
    """Return the pair linearised: its whitened derivatives and residual.

    Parameters
    ----------
    columns : directions of differences, (k, m)

    Returns
    -------
    (2 bins, k + m) by common values [1/SI], then by the directions; (2 bins,) at the state
    """
    one, two = state.jacobians[0], state.jacobians[1].copy()
    for place, name in enumerate(pair.names):
        if name in GAINS and columns[place].any():
            two[:, place] = by_gain(pair, state, name)
    way = (two + state.turned) @ columns
    first = np.column_stack([0.5 * (one + two), 0.5 * way, 0.5 * (state.residuals[0] + state.residuals[1])])
    second = np.column_stack([two - one, way, state.residuals[1] - state.residuals[0]])
    stacked = np.vstack([
        solve_triangular(pair.mean_root, first, lower=True),
        solve_triangular(pair.difference_root, second, lower=True),
    ])  # fmt: skip
    return stacked[:, :-1], stacked[:, -1]


def chi_squares(pair: TwoRecordings, state: PairState) -> tuple[float, float]:
    """Return chi-square of the mean and of the difference."""
    mean, apart = 0.5 * (state.residuals[0] + state.residuals[1]), state.residuals[1] - state.residuals[0]
    one = solve_triangular(pair.mean_root, mean, lower=True)
    two = solve_triangular(pair.difference_root, apart, lower=True)
    return float(one @ one), float(two @ two)


def objective(pair: TwoRecordings, state: PairState) -> float:
    """Return chi-square with the priors of values and of differences."""
    means, stds = pair.priors
    away = (state.before - means) / stds
    return sum(chi_squares(pair, state)) + float(away @ away + state.moved @ state.moved)


def normal_equations(pair: TwoRecordings, state: PairState, columns: Array, moved: Array) -> tuple[Array, Array]:
    """Return matrix and vector of a step in common values (in their priors' widths) and along directions, (k + m,).

    Parameters
    ----------
    columns, moved : directions, (k, m), and how far each has gone, (m,)
    """
    means, stds = pair.priors
    derivatives, residual = linearised(pair, state, columns)
    jacobian = derivatives * np.r_[stds, np.ones(moved.size)]
    vector = jacobian.T @ residual - np.r_[(state.before - means) / stds, moved]
    return np.asarray(jacobian.T @ jacobian + np.eye(stds.size + moved.size)), np.asarray(vector)


def minimised(pair: TwoRecordings, state: PairState, iterations: int, common: bool = True) -> PairState:
    """Return the pair at the minimum along the basis of a state.

    Parameters
    ----------
    common : False where what both share stays as it is and the directions alone are followed
    """
    k = len(pair.names)
    stds = pair.priors[1]
    value, damping = objective(pair, state), 1e-2
    for _ in range(iterations):
        matrix, vector = normal_equations(pair, state, state.basis.columns, state.moved)
        if not common:
            matrix[:k, k:], matrix[k:, :k], vector[:k] = 0.0, 0.0, 0.0
        gained = 0.0
        while damping < 1e6:
            step = step_within(matrix + np.diag(damping * np.diag(matrix)), vector, pair, state)
            before = np.clip(state.before + step[:k] * stds, *pair.bounds)
            trial = evaluated(pair, before, state.basis, state.moved + step[k:])
            new = objective(pair, trial)
            if new < value:
                gained, state, value = value - new, trial, new
                damping = max(damping / 5.0, 1e-6)
                break
            damping *= 5.0
        if gained < 1e-3 * value / INDEPENDENT + 0.02:
            break
    return state


def step_within(matrix: Array, vector: Array, pair: TwoRecordings, state: PairState) -> Array:
    """Return the step that leaves those parameters at a bound that it would push beyond it."""
    k = len(pair.names)
    lower, upper = pair.bounds
    stds, columns = pair.priors[1], state.basis.columns
    held = np.zeros(vector.size, dtype=bool)
    step = np.zeros(vector.size)
    for _ in range(6):
        free = ~held
        step = np.zeros(vector.size)
        step[free] = cho_solve(cho_factor(matrix[np.ix_(free, free)]), vector[free])
        common = state.before + step[:k] * stds
        after = common + columns @ (state.moved + step[k:])
        stuck = ((common < lower) & (state.before <= lower)) | ((common > upper) & (state.before >= upper))
        ends = ((after < lower) & (state.after <= lower)) | ((after > upper) & (state.after >= upper))
        out = np.r_[stuck, (np.abs(columns[ends]) > 0.0).any(axis=0)]
        if not (out & free).any():
            break
        held |= out
    return step


def inflation(pair: TwoRecordings, state: PairState) -> tuple[float, float]:
    """Return the factors on the variance of mean and difference that the residuals of a state ask for."""
    mean, apart = chi_squares(pair, state)
    freedom = max(pair.expected - state.moved.size, LEAST_FREEDOM)
    return max(1.0, mean / LEAST_FREEDOM / 1.5), max(1.0, apart / freedom)
