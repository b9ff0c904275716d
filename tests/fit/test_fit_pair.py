"""Two recordings of one pump side by side: what the transducer did not see lies where the torque does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.pair import EDGE_SHARE, best_pair, pair_of
from camtorque.fit.pair_scatter import covariance_of_mean
from camtorque.fit.turned import angle_between, at_angle, without_noise_apart
from camtorque.records import DEVIATION
from camtorque.units import DEGREE, angle_grid
from fit_cases import quick_prepared

KEY = ("closed_volume", 0, 1000.0)


def cycle(turned: float) -> np.ndarray:
    theta = angle_grid(1800) + turned
    return np.exp(np.cos(theta) * 8.0 - 8.0) * (1.0 + 0.1 * np.cos(40.0 * theta))


@pytest.mark.parametrize("degrees", [0.0, 0.003, -0.3, 1.0])
def test_the_angle_between_two_cycles_is_found(degrees: float) -> None:
    one, later = cycle(0.0), cycle(degrees * DEGREE)
    np.testing.assert_allclose(at_angle(one, degrees * DEGREE), later, atol=1e-9)
    assert angle_between(one, 1.02 * later + 0.5) == pytest.approx(degrees * DEGREE, abs=1e-9 + 2e-4 * abs(degrees))


@pytest.mark.parametrize("degrees", [0.3, -2.0, 5.0])
def test_the_angle_between_two_cycles_of_a_shaft_that_rings_is_no_other_period_of_it(degrees: float) -> None:
    """A descent from no angle ended at 1.1 degrees for 5."""
    theta = angle_grid(1800)
    one = 50.0 * np.exp(8.0 * np.cos(theta) - 8.0) + 5.0 * np.cos(80.0 * theta) * np.exp(-((theta - 1.0) % (2 * np.pi)))
    assert angle_between(one, 0.9 * at_angle(one, degrees * DEGREE)) == pytest.approx(degrees * DEGREE, abs=1e-4)


@pytest.mark.parametrize("degrees", [0.0, 0.5])
def test_two_cycles_differ_by_what_stands_out_of_their_scatter_and_not_by_their_noise(degrees: float) -> None:
    rng, turn = np.random.default_rng(3), degrees * DEGREE
    one, more = 50.0 * cycle(0.0), np.cos(3.0 * angle_grid(1800))
    both = [side + rng.standard_normal((25, 1800)) for side in (one, at_angle(one + more, turn))]
    before, after = without_noise_apart([np.mean(each, axis=0) for each in both], turn, both)
    left = at_angle(after, -turn) - before - more
    # three harmonics or four of 900 hold a noise of 0.2 sqrt(2) each where they are kept; all of it was 0.28
    assert np.std(left) < 0.04
    assert np.mean(before) == pytest.approx(np.mean(one), abs=0.02)


def test_a_shaft_is_not_twisted_by_the_noise_that_one_recording_alone_has() -> None:
    """A shaft eight times as soft made model and torque alike in their noise, and a trigger 0.50 was told as 0.43."""
    prepared, rng = quick_prepared(*KEY), np.random.default_rng(5)
    clean = np.asarray(prepared.cycles.torque)
    noisy = [replace(prepared, cycles=replace(prepared.cycles, torque=clean + 0.5 * rng.standard_normal(clean.shape)))
             for _ in range(2)]  # fmt: skip
    one, two = (item.chain.shaft_torque for item in pair_of(*noisy, prepared.candidates[0]).items)
    apart = np.std([np.mean(side.cycles.torque, axis=0) for side in noisy] - np.mean(clean, axis=0))
    assert apart > 0.05
    assert np.std(two - one) < 0.2 * apart


def test_a_trigger_is_as_unsure_as_the_angles_of_single_cycles_scatter() -> None:
    """Halves of one recording were two triggers 0.012 degrees apart at 97 %, where cycles scatter by 0.04 degrees."""
    prepared, rng = quick_prepared(*KEY), np.random.default_rng(7)
    cycles = prepared.cycles
    count = cycles.speed.size
    scatter, moved = 0.05 * DEGREE, []
    for _ in range(2):
        angles = scatter * rng.standard_normal(count)
        curves = {
            name: np.array([at_angle(*pair) for pair in zip(getattr(cycles, name), angles, strict=True)])
            for name in ("torque", "pressure")
        }
        moved.append((replace(prepared, cycles=replace(cycles, **curves)), np.std(angles, ddof=1)))
    pair = best_pair(moved[0][0], moved[1][0])
    expected = np.hypot(moved[0][1], moved[1][1]) / np.sqrt(count)
    edges = EDGE_SHARE * np.sqrt(2.0) * np.nan_to_num(cycles.trigger_jitter_s) * cycles.mean_speed
    assert pair.own["trigger_offset"] == pytest.approx(np.hypot(expected, edges), rel=0.1)


def test_what_was_not_seen_moves_with_the_trigger() -> None:
    prepared = quick_prepared(*KEY)
    best = prepared.candidates[0]
    lost = 0.3 * np.cos(150.0 * best.data.chain.theta) * np.exp(-best.data.chain.theta)
    chain = replace(best.data.chain, shaft_torque=prepared.measured + lost)
    start = replace(best, data=replace(best.data, chain=chain))
    turned = 0.4 * DEGREE
    cycles = prepared.cycles
    moved = replace(cycles, **{name: at_angle(getattr(cycles, name).T, turned).T for name in ("torque", "pressure")})
    pair = pair_of(prepared, replace(prepared, cycles=moved, measured=np.zeros(0)), start)
    one, two = (item.chain.shaft_torque for item in pair.items)
    assert np.std(at_angle(one, turned) - one) > 0.1
    np.testing.assert_allclose(two, at_angle(one, turned), atol=2e-3)


def test_each_recording_of_a_pair_has_the_zero_that_its_own_sheet_leaves_open() -> None:
    """Of two runs one without readings at standstill came out as changed, and as not changed the other way round."""
    prepared = quick_prepared(*KEY)
    recording = prepared.recording
    channels = [
        replace(channel, calibration=replace(channel.calibration, zero_std=1.2))
        if channel.quantity == "torque" and channel.calibration is not None else channel
        for channel in recording.channels
    ]  # fmt: skip
    unread = replace(prepared, recording=replace(recording, channels=tuple(channels)))
    for sides in ((prepared, unread), (unread, prepared)):
        pair = pair_of(*sides, prepared.candidates[0])
        known = [item.rows["torque_zero"].prior for item in pair.items]
        assert [prior is not None and prior[1] == pytest.approx(1.2, rel=0.05) for prior in known] == [
            side is unread for side in sides
        ]
        assert pair.own["torque_zero"] == pytest.approx(1.2, rel=0.1)


def test_triggers_of_two_kinds_are_each_off_by_what_their_own_sheet_allows() -> None:
    """A pump recorded by a counter and then by a tooth was told to leak more, at 94 %."""
    prepared = quick_prepared(*KEY)
    recording, start = prepared.recording, prepared.candidates[0]
    trigger = replace(recording.config.trigger, pulses_per_rev=360, installation_tolerance=2.0 * DEGREE)
    other = replace(recording, config=replace(recording.config, trigger=trigger))
    same, apart = pair_of(prepared, prepared, start), pair_of(prepared, replace(prepared, recording=other), start)
    mounted = [recording.config.trigger.installation_tolerance, 2.0 * DEGREE]
    assert same.own["trigger_offset"] < 0.02 * DEGREE
    assert apart.own["trigger_offset"] == pytest.approx(np.hypot(*mounted) / np.sqrt(3.0))


@pytest.mark.parametrize(("side", "order"), [("cam", 2), ("motor", 0)])
def test_each_recording_of_a_pair_turns_as_its_own_wheel_measured(side: str, order: int) -> None:
    """After one pulse a turn the wheel of the second was dropped, and its true cam angle twisted once more."""
    one = quick_prepared(*KEY)
    recording, cycles = one.recording, one.cycles
    trigger = replace(recording.config.trigger, side=side)
    turned = {**cycles.details, DEVIATION: 0.01 * np.cos(3.0 * cycles.theta)}
    wheel = replace(
        one, recording=replace(recording, config=replace(recording.config, trigger=trigger)),
        cycles=replace(cycles, details=turned), wheel_orders=8,
    )  # fmt: skip
    before, after = (item.chain.swing for item in pair_of(one, wheel, one.candidates[0]).items)
    assert before is None
    assert after is not None
    assert after.order == order


@pytest.mark.parametrize(("count", "reach"), [(4, 0.0), (8, 0.0), (8, 3.0), (20, 0.0), (20, 3.0), (48, 0.0)])
def test_two_means_of_few_cycles_differ_by_what_their_scatter_says(count: int, reach: float) -> None:
    """Chi-square per bin of two means of one noise was 2.2 for 8 cycles, and so was the inflation of a difference."""
    rng, bins, pairs = np.random.default_rng(count), 300, 40
    noise = rng.standard_normal((2, count + pairs, bins))
    if reach:  # half of it alike over some bins
        kernel = np.exp(-0.5 * (np.arange(-20, 21) / reach) ** 2)
        alike = np.apply_along_axis(np.convolve, 2, rng.standard_normal(noise.shape), kernel, "same")
        noise = np.sqrt(0.5) * (noise + alike / np.linalg.norm(kernel))
    blocks, others = noise[:, :count], noise[:, count:]
    known = sum(covariance_of_mean(side - np.mean(side, axis=0)) for side in blocks)
    apart = np.sqrt(1.0 / count) * (others[0] - others[1])  # of the size of a difference of two means
    chi_square = np.mean(np.sum(apart.T * np.linalg.solve(known, apart.T), axis=0)) / bins
    # below 1 where few cycles leave the size of their scatter open by so much more
    assert 0.55 < chi_square < 1.1


def test_many_cycles_tell_how_their_scatter_is_alike() -> None:
    """Of 200 blocks that wander as one, half of the covariance and half of the variances count, as it was."""
    rng, shape = np.random.default_rng(0), np.sin(angle_grid(300))
    blocks = rng.standard_normal((200, 1)) * shape + 0.1 * rng.standard_normal((200, 300))
    apart = blocks - np.mean(blocks, axis=0)
    covariance = apart.T @ apart / 199 / 200
    half = 0.5 * (covariance + np.diag(np.diag(covariance)))
    np.testing.assert_allclose(covariance_of_mean(apart), half * 199 / 197, rtol=0.002)
