"""`simulate`: one rig, one speed, one load, many revolutions, by time stepping.

Shares no code with the package under test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigs.constants import Constants, flatten, segment_transits
from rigs.hydraulics import N_HYDRAULIC
from rigs.laws import TWO_PI, density_of, lift_law
from rigs.loop import COLUMNS, N_WORK, TOTALS, run_loop
from rigs.mechanics import N_FORCE, N_MECHANIC
from rigs.truth import RPM, RigTruth

STEP = 5.0e-6
KNOT_STEP = 0.02
START_ANGLE = np.pi
"""The run starts on the base circle behind the lobe."""
CONSTANT_SPEED_CYCLES = 4
RUN_IN_CYCLES = 6


@dataclass(frozen=True)
class RigRun:
    """True time histories of one run, on a uniform time base from 0.

    Attributes
    ----------
    time : (n,) [s]
    history : name in `rigs.loop.COLUMNS` -> (n,), SI, gauge pressures; cam angle unwrapped, revolution 0 is the
        first whole one; torque is the true torque in the shaft at the transducer, positive when driving
    totals : name in `rigs.loop.TOTALS` -> (n_cycles + 1,) running sums at the starts of the revolutions
    end_angle : (n_cycles,) what the scatter drew for revolutions 0 .. n_cycles - 1
    step : base time step [s]
    line_clips : how often the line pressure met the cavitation floor (0 for a sound rig)
    """

    truth: RigTruth
    speed_rpm: float
    load: float
    seed: int
    n_cycles: int
    step: float
    time: np.ndarray
    history: dict[str, np.ndarray]
    totals: dict[str, np.ndarray]
    end_angle: np.ndarray
    line_clips: int

    @property
    def contact_lost(self) -> bool:
        """True where the contact force would have to pull."""
        return bool(self.history["contact_normal"].min() <= 0.0)

    def at_angle(self, name: str, angle: np.ndarray) -> np.ndarray:
        """Return a history at unwrapped true cam angles [rad]."""
        return np.interp(angle, self.history["cam_angle"], self.history[name])

    def true_cycles(self, name: str, n_theta: int = 3600) -> np.ndarray:
        """Return (n_cycles, n_theta) of a history on the true cam angle, 0 at the start of the lift table."""
        theta = TWO_PI * np.arange(n_theta) / n_theta
        return self.at_angle(name, theta[None, :] + TWO_PI * np.arange(self.n_cycles)[:, None])


def lift_of(truth: RigTruth, angle) -> np.ndarray:
    """Return the exact lift at cam angles [rad]."""
    k = flatten(truth, 0.0)
    return np.array([lift_law(k, a % TWO_PI)[0] for a in np.atleast_1d(np.asarray(angle, dtype=float))])


def _constants(truth: RigTruth) -> Constants:
    return flatten(truth, float(lift_of(truth, truth.chamber.port_close_angle)[0]))


def _set_speed(truth: RigTruth, speed: float, duration: float, rng: np.random.Generator) -> np.ndarray:
    """Return knots of the set speed: an AR(1) wander with the stated spread and correlation time."""
    n = int(duration / KNOT_STEP) + 4
    memory = np.exp(-KNOT_STEP / truth.scatter.speed_correlation_s)
    noise = rng.standard_normal(n) * np.sqrt(1.0 - memory**2)
    wander = np.empty(n)
    wander[0] = rng.standard_normal()
    for i in range(1, n):
        wander[i] = memory * wander[i - 1] + noise[i]
    return speed * (1.0 + truth.scatter.speed * wander)


def end_angle(truth: RigTruth, load: float) -> float:
    """Return the mean cam angle at which delivery ends at a load [rad]."""
    return truth.chamber.end_angle_zero_load + load * truth.chamber.end_angle_span


def _cycle_table(truth: RigTruth, load: float, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return (n, 3): end angle, lift at it, nozzle factor of every revolution, scatter included."""
    ends = end_angle(truth, load) + truth.scatter.end_angle * rng.standard_normal(n)
    nozzle = 1.0 + truth.scatter.nozzle * rng.standard_normal(n)
    return np.column_stack([ends, lift_of(truth, ends), nozzle])


def _first_states(truth: RigTruth, k: Constants, speed: float) -> tuple[np.ndarray, np.ndarray]:
    mech = np.zeros(N_MECHANIC)
    mech[[0, 2, 4]] = START_ANGLE
    mech[[1, 3, 5]] = speed
    hyd = np.zeros(N_HYDRAULIC + 1)
    hyd[0] = density_of(k, truth.chamber.feed_pressure) * k.top_volume
    hyd[[1, 4]] = truth.line.needle_close
    return mech, hyd


def _waves(truth: RigTruth, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the line's empty ring buffers (everything at rest) and the segment delays in steps."""
    delays = segment_transits(truth) / step
    if delays.min() < 2.0:
        raise ValueError(f"a pipe segment is shorter than two steps of {step} s: use a longer line or a smaller step")
    size = int(delays.max()) + 4
    return np.full((2, delays.size, size), truth.line.needle_close), np.round(delays, 9)


def simulate(
    truth: RigTruth,
    speed_rpm: float,
    load: float = 0.8,
    n_cycles: int = 30,
    seed: int = 0,
    step: float = STEP,
    run_in: int = RUN_IN_CYCLES,
    record_deg: float = 0.06,
    ramp: float = 0.0,
) -> RigRun:
    """Return a run of ``n_cycles`` whole revolutions (and one more at either end) after running in.

    Rows are kept about every ``record_deg`` of cam angle; for minutes of running take 0.3 and a ``step`` of 10 us.
    ``ramp`` is the relative change of the set speed from the first kept revolution to the last.

    The first `CONSTANT_SPEED_CYCLES` turn at constant speed to find the mean torque that the speed control starts from.
    """
    rng = np.random.default_rng(seed)
    k = _constants(truth)
    speed = speed_rpm * RPM
    revolution = 2.0 * np.pi / speed
    lead = CONSTANT_SPEED_CYCLES + run_in
    n_all = lead + n_cycles + 6
    cycles = _cycle_table(truth, load, int(n_all * (1.0 + max(ramp, 0.0))) + 8, rng)
    slowest = min(1.0, 1.0 + ramp)
    knots = _set_speed(truth, speed, 1.05 * n_all * revolution / slowest, rng)
    knots[: 1 + int(CONSTANT_SPEED_CYCLES * revolution / KNOT_STEP)] = speed
    turned = np.arange(knots.size) * KNOT_STEP / revolution
    knots *= 1.0 + ramp * np.clip((turned - lead) / n_cycles, 0.0, 1.0)
    mech, hyd = _first_states(truth, k, speed)
    lines, delays = _waves(truth, step)
    f, sums, clock = np.zeros(N_FORCE), np.zeros(N_WORK), np.zeros(2)
    common = (mech, hyd, f, sums, clock, lines, delays, knots, KNOT_STEP, cycles)

    def advance(constants, n_steps, every, feed_forward, n_rows, n_totals):
        out, totals = np.empty((n_rows, len(COLUMNS))), np.empty((n_totals, len(TOTALS)))
        rows, total_rows = run_loop(constants, step, n_steps, every, *common, feed_forward, out, totals)
        return out[:rows], totals[:total_rows]

    steps = round(CONSTANT_SPEED_CYCLES * revolution / step)
    _, totals = advance(k._replace(prescribed=True), steps, steps + 1, 0.0, 0, CONSTANT_SPEED_CYCLES + 2)
    work = np.diff(totals[:, 0])[-1]
    mean_torque = work / TWO_PI
    advance(k, round(run_in * revolution / step), 1 << 60, mean_torque, 0, 0)

    every = max(1, int(record_deg / 360.0 * revolution / step))
    n_steps = int((n_cycles + 2.6) * revolution / step / slowest)
    hyd[N_HYDRAULIC] = 0.0
    start = clock[0]
    out, totals = advance(k, n_steps, every, mean_torque, n_steps // every, n_cycles + 4)
    first = int(np.ceil(out[0, 0] / TWO_PI))
    out[:, [0, 3]] -= TWO_PI * first
    totals[:, -1] -= start + every * step
    kept = totals[: n_cycles + 1]
    return RigRun(
        truth=truth,
        speed_rpm=speed_rpm,
        load=load,
        seed=seed,
        n_cycles=n_cycles,
        step=step,
        time=np.arange(out.shape[0]) * (every * step),
        history={name: np.ascontiguousarray(out[:, j]) for j, name in enumerate(COLUMNS)},
        totals={name: kept[:, j].copy() for j, name in enumerate(TOTALS)},
        end_angle=cycles[first : first + n_cycles, 0],
        line_clips=int(hyd[N_HYDRAULIC]),
    )
