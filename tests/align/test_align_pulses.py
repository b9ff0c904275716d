"""Pulse trains: whatever is lost, doubled or bounced, the pulses that remain keep their number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from align_truth import TWO_PI, Rig, Samples, angle_error_deg, make, pressure_of, torque_of
from camtorque.align import align, resample_compiled
from camtorque.align.clocks import best_lag, clock_steps, fit_clock, robust_line
from camtorque.align.pulses import clean_pulses
from camtorque.align.resample import hermite_slopes, interval_polynomials, resample_block
from camtorque.signal.running import median, percentile, running_median
from hypothesis import given, settings
from hypothesis import strategies as st

PERIOD = 0.12
WIDTH = 2.0e-3


def train_of(n: int, seed: int, scatter: float = 2e-4) -> np.ndarray:
    periods = PERIOD * (1.0 + scatter * np.random.default_rng(seed).standard_normal(n))
    return np.cumsum(periods)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 1000),
    missing=st.lists(st.integers(2, 8), max_size=3, unique=True),
    extra=st.lists(st.tuples(st.integers(0, 8), st.floats(0.2, 0.8)), max_size=3, unique_by=lambda e: e[0]),
    bounced=st.lists(st.integers(0, 8), max_size=3, unique=True),
)
def test_pulses_keep_their_numbers(seed: int, missing: list[int], extra: list, bounced: list[int]) -> None:
    truth = train_of(90, seed)
    # One disturbance of a kind in each ten pulses, none at the ends: neighbours can prove it.
    lost = [10 * (k + 1) + m for k, m in enumerate(missing)]
    extras = [truth[40 + 10 * k + place] + part * PERIOD for k, (place, part) in enumerate(extra)]
    bounces = [truth[70 + b] + 1.5 * WIDTH for b in bounced]
    train = clean_pulses(np.sort(np.r_[np.delete(truth, lost), extras, bounces]))
    assert train.counts == {"bounced": len(bounces), "doubled": len(extras), "missed": len(lost), "gaps": 0}
    np.testing.assert_array_equal(train.step, np.arange(90))
    np.testing.assert_allclose(train.time[~train.repaired], np.delete(truth, lost))
    # A repaired pulse lies between its neighbours: off by the scatter of the periods, 2e-4, some sigma.
    np.testing.assert_allclose(train.time, truth, atol=5.0 * 2e-4 * PERIOD)


@given(seed=st.integers(0, 1000))
def test_sound_trains_are_left_alone(seed: int) -> None:
    truth = train_of(30, seed, 3e-3)
    train = clean_pulses(truth)
    np.testing.assert_array_equal(train.time, truth)
    assert not any(train.counts.values())


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 1000), lag=st.integers(-10, 10), lost=st.integers(5, 30))
def test_lag_is_found_from_the_pattern_of_periods(seed: int, lag: int, lost: int) -> None:
    rng = np.random.default_rng(seed)
    truth = np.cumsum(PERIOD * (1.0 + 1e-4 * rng.standard_normal(80)))
    reference, other = truth[10:60] + 1e-6 * rng.standard_normal(50), truth[10 - lag : 60 - lag] * (1.0 + 5e-5) + 7.0
    other = other.copy()
    other[lost] = np.nan
    found, evidence, _ = best_lag(reference, other, 0.0)
    assert found == lag
    assert evidence > 5.0


@pytest.mark.parametrize("quantum", [2e-5, 5e-5])
def test_few_periods_that_are_alike_by_chance_do_not_cost_cycles(quantum: float) -> None:
    # a steady speed, edges told to a sample of each logger: no lag shows, and many that leave a third look alike
    lost = []
    for seed in range(100):
        truth = np.cumsum(PERIOD * (1.0 + 1e-4 * np.random.default_rng(seed).standard_normal(60)))
        reference = np.ceil(truth[5:50] / quantum) * quantum
        other = np.ceil((truth[4:49] * (1.0 + 5e-5) + 7.0) / quantum) * quantum
        lost.append(abs(best_lag(reference, other, quantum / np.sqrt(6.0))[0]))
    assert np.mean(lost) < 0.05 * 45
    assert np.mean(np.array(lost) > 0.3 * 45) <= 0.02  # clear at odds of 150 to 1 and yet wrong


def test_edges_told_to_whole_samples_do_not_pass_for_a_pattern() -> None:
    # most periods of a steady shaft then differ by no sample and some by one: by chance at a wrong lag, too
    wrong = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        truth, quantum = np.cumsum(0.3 * (1.0 + 10.0 ** rng.uniform(-5.0, -3.5) * rng.standard_normal(40))), 5e-5
        reference = np.ceil(truth[5:30] / quantum) * quantum
        other = np.ceil((truth[5:30] * (1.0 + 5e-5) + 7.0) / quantum) * quantum
        lag, evidence, _ = best_lag(reference, other, quantum / np.sqrt(6.0))
        wrong += evidence > 5.0 and lag != 0
    assert wrong == 0


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), offset=st.floats(-100.0, 100.0), skew_ppm=st.floats(-100.0, 100.0))
def test_clock_is_within_its_standard_error(seed: int, offset: float, skew_ppm: float) -> None:
    rng = np.random.default_rng(seed)
    truth = np.cumsum(PERIOD * (1.0 + 1e-4 * rng.standard_normal(100)))
    other = offset + (1.0 + 1e-6 * skew_ppm) * truth + 2e-6 * rng.standard_normal(100)
    other[17] += 3e-3  # one edge is plainly wrong
    clock = fit_clock("B", truth, other, "log", 0.0)
    middle = truth.mean()
    error = clock.fit.offset_s + 1e-6 * clock.fit.skew_ppm * middle - offset - 1e-6 * skew_ppm * middle
    # Five standard errors: one in two million tries fails by chance.
    assert abs(error) < 5.0 * clock.fit.stderr_s
    assert abs(clock.fit.skew_ppm - skew_ppm) < 5.0e6 * clock.stderr_skew
    np.testing.assert_allclose(clock.to_reference(clock.from_reference(truth)), truth, atol=1e-9)
    assert clock.breaks == ()


def test_standard_error_of_the_clock_is_honest() -> None:
    rng = np.random.default_rng(5)
    x = np.linspace(0.0, 10.0, 60)
    slopes, claimed = [], []
    for _ in range(300):
        line = robust_line(x, 3.0 + 0.5 * x + 0.1 * rng.standard_normal(60))
        slopes.append(line.slope)
        claimed.append(line.stderr_slope)
    # The spread over 300 trials is known within 4 %; the biweight's own approximation takes some more.
    assert np.std(slopes) == pytest.approx(np.mean(claimed), rel=0.15)


def test_a_pulse_far_off_counts_neither_in_the_line_nor_in_its_error() -> None:
    x = np.linspace(0.0, 10.0, 60)
    y = 3.0 + 0.5 * x + 0.1 * np.random.default_rng(5).standard_normal(60)
    clean, one_off = robust_line(x, y), robust_line(x, np.where(np.arange(60) == 30, 1000.0, y))
    assert one_off.slope == pytest.approx(clean.slope, abs=0.2 * clean.stderr_slope)
    assert one_off.stderr_slope == pytest.approx(clean.stderr_slope, rel=0.05)
    assert one_off.residual_std == pytest.approx(0.1, rel=0.3)


def test_step_of_a_clock_is_found_and_a_wrong_edge_is_none() -> None:
    time = np.arange(50) * PERIOD
    difference = 2e-5 * time + 1e-7 * np.sin(np.arange(50))
    difference[20] += 1e-3
    assert clock_steps(time, difference) == ((), (0.0,))
    difference[30:] += 5e-3
    breaks, steps = clock_steps(time, difference)
    np.testing.assert_allclose(breaks, [29.5 * PERIOD])
    np.testing.assert_allclose(steps, [0.0, 5e-3], atol=1e-5)


def test_stairs_of_edges_within_one_sample_are_no_jumps() -> None:
    # 100 ppm at 8 revolutions per second and 20 kHz: a stair of one sample every fourth revolution
    time = PERIOD * np.arange(60)
    stairs = np.round(1e-4 * time / 5e-5) * 5e-5
    assert clock_steps(time, stairs) == ((), (0.0,))
    stairs[30:] += 5e-3
    breaks, _ = clock_steps(time, stairs)
    np.testing.assert_allclose(breaks, [time[29:31].mean()])


def test_one_stair_of_edges_within_one_sample_is_no_jump() -> None:
    """14 ppm moved a sharp edge on by one sample of 20 kHz once in 3 s: told as two jumps, three cycles cut."""
    time, sample = PERIOD * np.arange(33), 5e-5
    stair = np.where(np.arange(33) < 24, 0.0, -sample)
    edges = sample * np.sqrt(2.0 / 12.0)
    assert clock_steps(time, stair)[0]
    assert clock_steps(time, stair, edges) == ((), (0.0,))
    assert clock_steps(time, 2.0 * stair, edges)[0], "two samples that were lost are"


def test_negative_rotation_reads_as_its_channel_is_turned() -> None:
    recording = make(Rig(duration=1.5))
    torque = recording.channels[0]
    turned = replace(torque, source=Samples(-torque.source.values), sign=-1.0)
    cycles = align(replace(recording, channels=(turned, *recording.channels[1:])))
    np.testing.assert_allclose(cycles.torque, align(recording).torque, atol=1e-12)
    assert {f.code for f in cycles.findings} == {"ripple_unseen"}


@dataclass(frozen=True)
class StartStopShaft:
    """Runs up from standstill, holds its speed, runs down: the speed is a product of two logistic steps in time."""

    rpm: float = 500.0
    begin: float = 0.8
    end: float = 4.2
    tau: float = 0.06

    @property
    def speed(self) -> float:
        return self.rpm * TWO_PI / 60.0

    def angle(self, t: np.ndarray) -> np.ndarray:
        up = self.tau * np.log1p(np.exp((t - self.begin) / self.tau))
        down = self.tau * np.log1p(np.exp((t - self.end) / self.tau))
        return 0.3 + self.speed * (up - down)

    def time_of(self, angle: np.ndarray) -> np.ndarray:
        t = np.linspace(0.0, 7.0, 2_000_001)
        theta = self.angle(t)
        rising = np.r_[True, np.diff(theta) > 1e-12]
        times = np.interp(angle, theta[rising], t[rising], left=-1.0, right=np.inf)
        return times[np.isfinite(times)]


def test_start_and_stop_are_cut_and_the_steady_part_is_used() -> None:
    shaft = StartStopShaft()
    cycles = align(make(Rig(shaft=shaft, duration=5.0, torque_noise=0.3, pressure_noise=1e5)))
    reasons = {row.reason for row in cycles.cut_flow if row.cycles}
    assert "start_stop" in reasons
    # 3.4 s at 500 rpm are 28 revolutions, some of which belong to run-up and run-down.
    assert 20 <= len(cycles.index) <= 28
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05
    assert abs(angle_error_deg(cycles.pressure, pressure_of, cycles.theta)) < 0.05


def test_tooth_that_stands_before_the_sensor_is_no_inverted_trigger() -> None:
    recording = make(Rig(duration=3.0))
    channels = []
    for c in recording.channels:
        still = 5.0 if c.quantity == "trigger" else c.source.values[0]
        n = int(6.0 * c.sample_rate)
        channels.append(replace(c, source=Samples(np.r_[np.full(n, still), c.source.values])))
    cycles = align(replace(recording, channels=tuple(channels)))
    assert {f.code for f in cycles.findings} == {"ripple_unseen"}
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), samples_per_step=st.floats(0.3, 8.0), rule=st.sampled_from([0, 1, 2]))
def test_resampling_reproduces_a_straight_line(seed: int, samples_per_step: float, rule: int) -> None:
    rng = np.random.default_rng(seed)
    n_theta, slope, level = 180, *rng.uniform(-1.0, 1.0, 2)
    volts = level + slope * np.arange(int(samples_per_step * n_theta) + 20)
    angle = np.array([0.0, TWO_PI, 2 * TWO_PI])
    time = np.array([0.0, 1.0, 2.0])
    left, right = hermite_slopes(angle, time, np.zeros(2, dtype=bool))
    rate = samples_per_step * n_theta
    polynomials = interval_polynomials(angle, time, left, right)
    for resample in (resample_block, resample_compiled.resample_block):
        rows = np.empty((1, n_theta))
        resample(volts, rate, np.array([10.0]), np.array([0]), angle, polynomials, rule, (0.0, 1.0), rows)
        expected = level + slope * (10.0 + rate * np.arange(n_theta) / n_theta)
        np.testing.assert_allclose(rows[0], expected, atol=1e-9 * rate)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), samples_per_step=st.floats(0.3, 8.0), rule=st.sampled_from([0, 1, 2]))
def test_the_compiled_pass_and_the_plain_one_agree(seed: int, samples_per_step: float, rule: int) -> None:
    """Uneven running, pulses that begin after the first cycle and end before the last, a missing sample."""
    rng = np.random.default_rng(seed)
    n_theta, n_cycles = 90, 4
    angle = 0.7 + np.arange(3 * n_cycles) * TWO_PI / 3.0
    time = np.cumsum(rng.uniform(0.9, 1.1, angle.size)) / 3.0
    slopes = hermite_slopes(angle, time, np.zeros(angle.size - 1, dtype=bool))
    rate = samples_per_step * n_theta
    volts = rng.standard_normal(int(1.3 * rate * n_cycles) + 20)
    volts[volts.size // 2] = np.nan
    arguments = (
        rate,
        rng.uniform(5.0, 6.0, n_cycles),
        np.arange(n_cycles),
        angle,
        interval_polynomials(angle, time, *slopes),
    )
    plain, compiled = np.empty((n_cycles, n_theta)), np.empty((n_cycles, n_theta))
    resample_block(volts, *arguments, rule, (0.1, -3.0), plain)
    resample_compiled.resample_block(volts, *arguments, rule, (0.1, -3.0), compiled)
    np.testing.assert_allclose(plain, compiled, atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(
    values=st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=12),
    share=st.sampled_from([0.0, 5.0, 10.0, 50.0, 95.0, 99.9, 100.0]),
)
def test_percentiles_and_medians_are_those_of_numpy_bit_for_bit(values: list[float], share: float) -> None:
    assert median(np.array(values)) == np.median(values)
    assert np.isnan(median(np.array([*values, np.nan])))
    assert percentile(np.array(values), share) == np.percentile(values, share)
    whole = np.array(values).astype(np.int64)
    assert percentile(whole, share) == np.percentile(whole, share)


@pytest.mark.parametrize("missing", [None, 0, 4])
@pytest.mark.parametrize("size", [1, 3, 9])
def test_running_median_shrinks_at_the_ends(size: int, missing: int | None) -> None:
    values = np.random.default_rng(size).standard_normal(7)
    if missing is not None and size == 9:  # where no whole window fits
        values[missing] = np.nan
    half = size // 2
    expected = [np.median(values[max(0, k - half) : k + half + 1]) for k in range(values.size)]
    np.testing.assert_array_equal(running_median(values, size), expected)


def test_smooth_time_is_monotone_and_meets_every_pulse() -> None:
    angle = np.arange(8) * TWO_PI
    time = np.cumsum([0.0, 1.0, 1.0, 0.4, 0.4, 3.0, 0.9, 1.0])
    left, right = hermite_slopes(angle, time, np.zeros(7, dtype=bool))
    polynomials = interval_polynomials(angle, time, left, right)
    u = np.linspace(0.0, TWO_PI, 200)
    for k, (a, b, c, d) in enumerate(polynomials):
        t = a + u * (b + u * (c + u * d))
        np.testing.assert_allclose(t[[0, -1]], time[k : k + 2], atol=1e-12)
        assert np.all(np.diff(t) > 0.0)
