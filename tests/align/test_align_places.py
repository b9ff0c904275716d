"""Teeth and swing of a wheel against the covariance of all passages written out, and at the size of an encoder."""

from __future__ import annotations

import numpy as np
import pytest
from align_truth import Shaft
from camtorque.align import align
from camtorque.align.pattern import (
    COMMON_SHIFT,
    FREE_TOOTH,
    RIPPLE_STD,
    TOOTH_STD,
    Sizes,
    pattern_of,
    posteriors,
    score_of,
    waves_of,
)
from camtorque.align.places import _beside_gap
from camtorque.config import TriggerSpec
from camtorque.records import DEVIATION_ERRORS
from wheel_truth import Wheel, true_deviation, wheel_recording

CASES = {
    "60-2": TriggerSpec(0.3, 0.0, pulses_per_rev=60, missing_teeth=2),
    "coil of 36-2": TriggerSpec(0.3, 0.0, pulses_per_rev=36, missing_teeth=2, sensor="inductive"),
    "12 on the crank": TriggerSpec(0.3, 0.0, pulses_per_rev=12, missing_teeth=1, revolutions_per_cycle=2),
    "4": TriggerSpec(0.3, 0.0, pulses_per_rev=4),
}


@pytest.mark.parametrize("name", CASES)
def test_sums_of_squares_are_the_whole_covariance(name: str) -> None:
    spec, rng = CASES[name], np.random.default_rng(1)
    n = spec.pulses_per_cycle
    shown = np.arange(spec.pulses_per_rev - spec.missing_teeth)
    tooth = np.concatenate([turn * spec.pulses_per_rev + shown for turn in range(spec.revolutions_per_cycle)])
    if spec.revolutions_per_cycle > 1:
        tooth = np.delete(tooth, 5)  # one that is lost in most turns of one half of the cycle
    mean, variance = 0.01 * rng.standard_normal(tooth.size), 1e-6
    pattern = pattern_of(tooth, mean, variance, _beside_gap(spec, n), n)
    which = (tooth % spec.pulses_per_rev)[:, None] == np.arange(spec.pulses_per_rev)
    waves = -waves_of(tooth * (2.0 * np.pi / n), pattern.orders)
    each = variance + np.where(which @ pattern.free, FREE_TOOTH, 0.0) ** 2

    def written_out(sizes: Sizes) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        covariance = np.diag(each) + sizes.tooth**2 * which @ which.T + COMMON_SHIFT**2
        covariance = covariance + (waves * sizes.waves(pattern.orders)) @ waves.T
        weight = np.linalg.inv(covariance)
        value = -0.5 * (mean @ weight @ mean + np.linalg.slogdet(covariance)[1])
        for size, (usual, spread) in ((sizes.tooth, TOOTH_STD), (sizes.ripple, RIPPLE_STD)):
            value -= 0.5 * (np.log(size / usual) / spread) ** 2
        found = []
        for design, prior in (
            (which.astype(float), np.where(pattern.free, FREE_TOOTH, sizes.tooth) ** 2),
            (waves, sizes.waves(pattern.orders)),
        ):
            gain = prior[:, None] * design.T @ weight
            found += [gain @ mean, np.diag(prior) - gain @ design * prior]
        return value, *found

    for sizes in (Sizes(1e-3, 1e-2), Sizes(2e-5, 0.1, ((4, 0.02),)), Sizes(0.03, 1e-5)):
        value, place, spread, coefficient, covariance = written_out(sizes)
        assert score_of(pattern, sizes) == pytest.approx(value, rel=1e-9)
        teeth, swing = posteriors(pattern, sizes)
        assert teeth[0] == pytest.approx(place, rel=1e-6, abs=1e-12)
        assert teeth[1] == pytest.approx(np.diag(spread), rel=1e-5, abs=1e-14)
        assert swing[0] == pytest.approx(coefficient, rel=1e-6, abs=1e-12)
        assert swing[1] == pytest.approx(covariance, rel=1e-5, abs=1e-14)


@pytest.mark.parametrize(("teeth", "missing"), [(60, 2), (12, 1)])
def test_errors_of_the_deviation_are_its_covariance(teeth: int, missing: int) -> None:
    wheel = Wheel(shaft=Shaft(rpm=600.0, ripple=0.03, order=3), teeth=teeth, missing=missing, duration=3.0)
    details = align(wheel_recording(wheel)).details
    errors = np.fft.irfft(details[DEVIATION_ERRORS], 3600) * 1800.0
    assert errors.shape[0] == 2 * ((teeth - missing - 1) // 2)
    np.testing.assert_allclose(np.sqrt(np.sum(errors**2, axis=0)), details["angle_deviation_std"], rtol=1e-6)


def test_an_encoder_of_3600_lines_tells_the_swing() -> None:
    """A covariance of all passages took it longer than a scorer waits: 3600 of them, some two thousand times."""
    wheel = Wheel(shaft=Shaft(rpm=100.0, ripple=0.05, order=4), teeth=3600, missing=0, index=True, rate=250e3,
                  duration=6.0, error_deg=0.005, flank_rad=2e-4)  # fmt: skip
    cycles = align(wheel_recording(wheel))
    truth = true_deviation(wheel.shaft, cycles.theta)
    assert cycles.details["angle_deviation"] == pytest.approx(truth - truth.mean(), abs=2e-4)
    assert np.max(cycles.details["angle_deviation_std"]) < 2e-4
