"""Two recordings of one pump at one speed in one structure, and what two runs of an unchanged pump may differ by.

The errors of sheets, certificates, lift table and laws are the same in both, so they weigh on the mean of both
residuals only. Their difference is known by the scatter of the cycles, by what clocks, starts of files and trigger
edges may have shifted, and by the small share of the laws' error that two runs do not have in common.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from camtorque.fit.gains import GAIN_ROWS, GAINS
from camtorque.fit.minima import Candidate
from camtorque.fit.pair_scatter import mean_scatter
from camtorque.fit.prepare import INDEPENDENT, cam_swing, over_even_angle
from camtorque.fit.problem import FitData
from camtorque.fit.residual import mean_square_about
from camtorque.fit.rig_rows import own_rows
from camtorque.fit.single import Prepared
from camtorque.fit.solver import lift_at
from camtorque.fit.turned import angle_between, at_angle, without_noise_apart
from camtorque.ingest.stated import other_triggers, stated
from camtorque.laws import ripple
from camtorque.laws.chain import BINS, COLUMN_NAMES, ChainInput, binned, coefficients_of, evaluate
from camtorque.laws.swing import Swing
from camtorque.process.second_process import in_two
from camtorque.records import Array, CamCycles, ReadOnly

SAME_SPEED = 0.02
"""Relative difference of speed up to which the laws' error counts as common."""
UNCOMMON = 3.0e-4
"""Share of the torque by which two runs of an unchanged pump may differ for reasons no law knows."""
UNCOMMON_FLOOR = 1.0e-4
"""The same as a share of the peak torque."""
RESIDUAL_SHARE, RESIDUAL_REACH = 0.05, 15
"""Share of what the laws leave that two runs do not have in common, and bins over which its size is taken."""
OTHER_LOAD = 0.015
"""Share by which the highest pressures of two recordings differ where their loads do, at which what the laws leave is
another one: 0.4 % at most in pairs of one load (1.2 % where the leakage doubled), 1.7 to 2.7 % where one load was a
tenth above or below the other."""
OWN_NAMES = (
    "torque_zero", "pressure_zero", "end_of_delivery", "end_width", "spill_lift", "spill_width", "trigger_offset",
    "delay_error", *ripple.NAMES,
)  # fmt: skip
"""Parameters that each recording has its own: set anew, or known to the error of edges and starts of files."""
ZERO_DRIFT = 2.0e-3
"""Drift of the torque's zero between its standstill reading and the run, as a share of the peak torque."""
EDGE_SHARE = 0.5
"""Share of the time error of one trigger edge that does not average out: levels and samples are the same in each."""
LEAST_EDGE = np.radians(0.002)
MOST_WORSE = 300.0
"""Chi-square by which a minimum may explain the first recording worse than the best one and still be compared in."""
COMMON_TIME_BASE = "common time base"
START_ERROR = 8.0e-6
"""Standard error of the start of a file that shares a time base with others but starts by itself [s]: headers write it
to 10 us."""


@dataclass(frozen=True)
class TwoRecordings(ReadOnly):
    """Two recordings in one structure.

    Attributes
    ----------
    items : both as the fit sees them, means of all used cycles
    cycles : of both
    names : free parameters, last the gains of the sensors, in which the second alone may be off (`GAINS`)
    fixed : values of the others
    mean_root, difference_root : (bins, bins) lower Cholesky factors of the covariances [N m]
    expected : chi-square of the difference that these covariances lead to expect where nothing is fitted
    other_trigger : whether triggers are declared differently, so that nothing ties the angle of one to the other
    wander : standard error of the angle between both means by how the angles of single cycles scatter [rad]
    """

    items: tuple[FitData, FitData]
    cycles: tuple[CamCycles, CamCycles]
    names: tuple[str, ...]
    fixed: Mapping[str, float]
    mean_root: Array
    difference_root: Array
    expected: float
    other_trigger: bool = False
    wander: float = 0.0

    @property
    def own(self) -> dict[str, float]:
        """Parameters of which each recording has its own, with how far they differ [SI]."""
        # one may have readings at standstill, the other none: each moves by what its own sheet leaves open
        wide = dict(zip(self.names, np.hypot(*(self._priors_of(item)[1] for item in self.items)), strict=True))
        wide["torque_zero"] = np.hypot(wide["torque_zero"], ZERO_DRIFT * np.max(np.abs(self.items[0].torque)))
        edges = [np.nan_to_num(c.trigger_jitter_s) * c.mean_speed for c in self.cycles]
        start = self.start_error
        turned = np.hypot(EDGE_SHARE * np.hypot(*edges), np.hypot(start * self.cycles[0].mean_speed, self.wander))
        if not self.other_trigger:
            wide["trigger_offset"] = max(float(turned), LEAST_EDGE)
        wide["delay_error"] = float(np.hypot(self.clock_error, start))
        return {name: float(wide[name]) for name in self.names if name in OWN_NAMES and wide[name] > 0.0}

    @property
    def pressure_ratio(self) -> float:
        """Highest mean pressure after over that before, by which two loads are told apart."""
        before, after = (float(np.max(item.chain.line_pressure)) for item in self.items)
        return after / before

    @property
    def start_error(self) -> float:
        """Standard error of the starts of both recordings' files of one channel against each other [s]."""
        apart = [any(clock.method == COMMON_TIME_BASE for clock in cycles.clocks) for cycles in self.cycles]
        return START_ERROR * float(np.sqrt(sum(apart)))

    @property
    def clock_error(self) -> float:
        """Standard error of both recordings' clocks against each other [s]."""
        return float(np.linalg.norm([max((c.stderr_s for c in cycles.clocks), default=0.0) for cycles in self.cycles]))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the free parameters [SI]."""
        rows = [[item.rows[name] for item in self.items] for name in self.names]
        lower = [min(row.lower for row in both) for both in rows]
        return np.array(lower), np.array([max(row.upper for row in both) for both in rows])

    @property
    def priors(self) -> tuple[Array, Array]:
        """Means and standard deviations of the free parameters; as wide as the bounds where nothing is known."""
        return self._priors_of(self.items[0])

    def _priors_of(self, item: FitData) -> tuple[Array, Array]:
        rows = [item.rows[name] for name in self.names]
        pairs = [row.prior or (0.5 * (row.lower + row.upper), row.upper - row.lower) for row in rows]
        return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])

    def values(self, free: Array) -> dict[str, float]:
        """Return every parameter of the chain at values of the free ones, (k,) [SI]."""
        return {**self.fixed, **dict(zip(self.names, free.tolist(), strict=True))}

    def sensed(self, side: int, free: Array) -> tuple[ChainInput, dict[str, float]]:
        """Return chain and values of one recording under the gains of its sensors, which move pressure and twist."""
        values, chain = self.values(free), self.items[side].chain
        torque, pressure = (1.0 + values.get(name, 0.0) for name in GAINS)
        if side == 0 or torque == pressure == 1.0:
            return chain, values  # a chain that is made anew works its twist out again
        chain = replace(chain, shaft_torque=chain.shaft_torque / torque, line_pressure=chain.line_pressure / pressure)
        return chain, {**values, "gain_error": (1.0 + values["gain_error"]) * torque - 1.0}


def best_pair(before: Prepared, after: Prepared) -> TwoRecordings:
    """Return two recordings in that minimum of the first which makes their difference most likely.

    Beside a valve near chattering a minimum may explain the first recording a little better and yet say nothing of a
    difference: a microsecond turns its ringing over. The logarithm of the determinant of the difference's covariance
    is what that costs.
    """
    least = before.candidates[0].value
    near = [start for start in before.candidates if start.value < least + MOST_WORSE]
    bare = [pair_of(before, after, start) for start in near]
    weights = in_two(_weights, list(zip(bare, near, strict=True)))
    pairs = [replace(pair, **one) for pair, one in zip(bare, weights, strict=True)]
    cost = [start.value + 2.0 * float(np.sum(np.log(np.diag(pair.difference_root))))
            for start, pair in zip(near, pairs, strict=True)]  # fmt: skip
    return pairs[int(np.argmin(cost))]


def pair_of(before: Prepared, after: Prepared, start: Candidate) -> TwoRecordings:
    """Return two recordings of one speed in the structure of one of the minima of the first, not weighed yet."""
    # what the transducer did not see lies where the torque does, also where a trigger stands elsewhere
    lost = start.data.chain.shaft_torque - before.measured
    n = start.data.chain.theta.size
    torques = [over_even_angle(side.cycles.mean_torque, _swing(side), n) for side in (before, after)]
    angle = angle_between(*torques)
    twisting = without_noise_apart(torques, angle, [_torque(side) for side in (before, after)])
    items = (
        _item(before, start.data, twisting[0] + lost),
        _item(after, start.data, twisting[1] + at_angle(lost, angle)),
    )
    problem = start.problem
    names = (*(item.row.name for item in problem.parameters), *GAINS)
    values, coefficients = problem.values(start.solution.z, 0)
    fixed = {**values, **dict(zip(COLUMN_NAMES, coefficients, strict=True)), **dict.fromkeys(GAINS, 0.0)}
    none, other = np.eye(start.data.torque.size), other_triggers(stated(side.recording) for side in (before, after))
    return TwoRecordings(
        items, (before.cycles, after.cycles), names, fixed, none, none, 0.0, other,  # type: ignore[arg-type]
    )  # fmt: skip


def has_other_load(ratio: float) -> bool:
    """Return whether the highest pressure after over that before is that of two loads."""
    return bool(abs(np.log(ratio)) > OTHER_LOAD)


def _weights(bare: tuple[TwoRecordings, Candidate]) -> dict[str, Any]:
    """Return what a pair lacks until it is weighed, by the minimum of the first recording that it stands at."""
    pair, start = bare
    item, lift = pair.items[0], lift_at(start.problem, start.solution.z)
    modes = lift.vectors * lift.strength / item.weight[:, None]
    (noise, wander), laws = scatter_of_both(pair, pair.fixed), np.diag(1.0 / item.weight**2) + modes @ modes.T
    weights = {"mean_root": np.linalg.cholesky(laws + noise / 4.0), "wander": wander}
    return {**weights, **_difference_weights(pair, pair.fixed, noise, np.zeros(item.torque.size))}


def with_difference(pair: TwoRecordings, values: Mapping[str, float], left: Array) -> TwoRecordings:
    """Return the pair with the covariance of the difference as it is at values of all parameters.

    Parameters
    ----------
    left : (bins,) what the laws leave [N m]; a share of its size is not common to both
    """
    return replace(pair, **_difference_weights(pair, values, scatter_of_both(pair, values)[0], left))


def _difference_weights(pair: TwoRecordings, values: Mapping[str, float], noise: Array, left: Array) -> dict[str, Any]:
    """Return difference_root and expected for a covariance of the scatter; see `with_difference`."""
    item = pair.items[0]
    known = noise + shift_covariance(pair, values)
    peak = float(np.max(np.abs(item.torque)))
    size = mean_square_about(left, RESIDUAL_REACH * left.size // BINS)
    share = 1.0 if has_other_load(pair.pressure_ratio) else RESIDUAL_SHARE
    error = (UNCOMMON * item.torque) ** 2 + (UNCOMMON_FLOOR * peak) ** 2 + share**2 * size
    weighed = known + np.diag(error * item.torque.size / INDEPENDENT)
    # what the laws do not share is correlated over an unknown angle: each bin is weighed as if it were less sure than
    # it is, so that chi-square falls short of the number of bins
    expected = float(np.trace(np.linalg.solve(weighed, known + np.diag(error))))
    return {"difference_root": np.linalg.cholesky(weighed), "expected": expected}


def scatter_of_both(pair: TwoRecordings, values: Mapping[str, float]) -> tuple[Array, float]:
    """Return the covariance of the scatter of the difference, (bins, bins) [(N m)^2], and of its angle [rad]."""
    own = tuple(pair.own)
    first, second = (mean_scatter(c, one, values, own) for c, one in zip(pair.cycles, pair.items, strict=True))
    return first[0] + second[0], float(np.hypot(first[1], second[1]))


def _item(side: Prepared, data: FitData, shaft_torque: Array) -> FitData:
    cycles, swing, n = side.cycles, _swing(side), shaft_torque.size
    torque, pressure = (over_even_angle(part, swing, n) for part in (cycles.mean_torque, cycles.mean_pressure))
    chain = replace(
        data.chain, speed=cycles.mean_speed, line_pressure=pressure, shaft_torque=shaft_torque, swing=swing,
        trigger_angle=side.recording.config.trigger.nominal_angle,
    )  # fmt: skip
    rows = {**data.rows, **own_rows(side.recording, cycles), **GAIN_ROWS}
    return replace(data, name=side.recording.config.id, chain=chain, torque=binned(torque, chain.bins), rows=rows)


def _swing(side: Prepared) -> Swing | None:
    return cam_swing(side.recording.config, side.cycles.details, side.wheel_orders)


def _torque(side: Prepared) -> Array:
    assert side.cycles.torque is not None
    return side.cycles.torque


def shift_covariance(pair: TwoRecordings, values: Mapping[str, float]) -> Array:
    """Return the covariance of what clocks and starts may have shifted the line pressure by, (bins, bins) [(N m)^2].

    The torque is asked for with the pressure earlier and later by one standard error, never by less: beside a valve
    near chattering the model steps, and a derivative taken over a shorter time would make any size of such a step.
    """
    item = pair.items[0]
    chain = item.chain
    linear = coefficients_of(values)
    late = _slope(chain.line_pressure, chain.speed) * float(np.hypot(pair.clock_error, pair.start_error))
    ends = []
    for sign in (-1.0, 1.0):
        output = evaluate(replace(chain, line_pressure=chain.line_pressure + sign * late), values, linear)
        ends.append(output.torque + output.linear @ linear)
    shift = 0.5 * (ends[1] - ends[0])
    return np.outer(shift, shift)


def _slope(values: Array, speed: float) -> Array:
    """Return the time derivative of a periodic signal on a uniform angle grid."""
    step = 2.0 * np.pi / values.size
    return np.asarray((np.roll(values, -1) - np.roll(values, 1)) / (2.0 * step) * speed)
