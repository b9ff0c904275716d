"""The ladder's criterion on residuals that repeat each other, beside the plain one; its parts; metrics; prediction."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.fit.ladder import correlation_length, independent_count, score_of
from camtorque.fit.prepare import CORRELATION
from camtorque.fit.solve import Solution

BINS = 720
ANGLE = np.arange(BINS) * 360.0 / BINS
TRIALS = 200


def periodic_noise(correlation, generator):
    """Return noise of unit variance whose periodic autocorrelation over the angle [deg] is given."""
    distance = np.minimum(ANGLE, 360.0 - ANGLE)
    spectrum = np.maximum(np.fft.rfft(correlation(distance)).real, 0.0)
    white = np.fft.rfft(generator.standard_normal(BINS))
    return np.fft.irfft(white * np.sqrt(spectrum), BINS)


NOISES = {
    "white": lambda d: np.where(d == 0.0, 1.0, 0.0),
    "decays over 10 deg": lambda d: np.exp(-d / 10.0),
    "mean over 10 deg": lambda d: np.maximum(0.0, 1.0 - d / 10.0),
    "bell of 10 deg": lambda d: np.exp(-0.5 * (d / 10.0) ** 2),
}


def bump(generator):
    """Return a smooth term that nothing causes: a bell 8 to 40 degrees wide somewhere."""
    distance = (ANGLE - generator.uniform(0.0, 360.0) + 180.0) % 360.0 - 180.0
    return np.exp(-0.5 * (distance / generator.uniform(8.0, 40.0)) ** 2)


def linear_fit(columns, data) -> Solution:
    """Return the least-squares minimum of columns without priors, in the solver's form."""
    design = np.column_stack(columns)
    c = np.linalg.lstsq(design, data, rcond=None)[0]
    residual = data - design @ c
    chi, gram = float(residual @ residual), design.T @ design
    return Solution(np.zeros(0), c, chi, chi, gram, np.array(gram), (residual,), (), 1, 1, True)


def taken(noise, generator) -> tuple[bool, bool]:
    """Return whether the ladder's score and the plain BIC take in a useless term."""
    data = periodic_noise(NOISES[noise], generator)
    without = linear_fit([np.ones(BINS)], data)
    full = linear_fit([np.ones(BINS), bump(generator)], data)
    item = SimpleNamespace(weight=np.ones(BINS))
    n_independent = independent_count([item], full.residuals)
    mean_square = full.data_chi_square / BINS * CORRELATION
    own = score_of(full, mean_square, n_independent) < score_of(without, mean_square, n_independent)
    plain = BINS * np.log(full.chi_square / without.chi_square) + np.log(BINS) < 0.0
    return own, bool(plain)


@pytest.mark.parametrize("noise", NOISES)
def test_useless_smooth_term_is_rarely_taken(noise):
    generator = np.random.default_rng(11)
    counts = np.sum([taken(noise, generator) for _ in range(TRIALS)], axis=0)
    # Designed for 3 % (chi-square exceeds 4.7), which is met with the true correlation length. Estimated from the one
    # record it scatters, and 1200 trials take in 1 % (white), 4 %, 7 % (bell) and 7 % (decay, which reaches 40 deg).
    assert counts[0] <= 0.08 * TRIALS
    if noise != "white":
        # the plain criterion: 57 to 75 % in the same 1200 trials
        assert counts[1] >= 0.45 * TRIALS


@pytest.mark.parametrize(("noise", "bins"), [("white", 1.0), ("mean over 10 deg", 20.0), ("bell of 10 deg", 50.1)])
def test_correlation_length_is_that_of_the_noise(noise, bins):
    # 1 + 2 sum rho: 20 bins for a mean over 20, 20 sqrt(2 pi) for a bell; the estimate leans on a few dozen
    # independent values and loses their mean, hence a tenth below and a few per cent of scatter in the mean of 100
    generator = np.random.default_rng(7)
    found = [correlation_length(periodic_noise(NOISES[noise], generator)) for _ in range(100)]
    assert np.mean(found) == pytest.approx(bins, rel=0.15)


def test_needed_term_is_taken():
    # the same bells, three standard deviations high in white noise: hundreds of units of chi-square
    generator = np.random.default_rng(5)
    for _ in range(20):
        term = bump(generator)
        data = periodic_noise(NOISES["white"], generator) + 3.0 * term
        without, full = linear_fit([np.ones(BINS)], data), linear_fit([np.ones(BINS), term], data)
        count = independent_count([SimpleNamespace(weight=np.ones(BINS))], full.residuals)
        scale = full.data_chi_square / BINS * CORRELATION
        assert score_of(full, scale, count) < score_of(without, scale, count)


def test_independent_count_adds_over_recordings():
    generator = np.random.default_rng(5)
    items = [SimpleNamespace(weight=np.full(BINS, 2.0))] * 2
    noise = [periodic_noise(NOISES["mean over 10 deg"], generator) for _ in range(2)]
    assert independent_count(items, noise) == pytest.approx(sum(BINS / correlation_length(n) for n in noise))
