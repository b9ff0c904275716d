"""What the bench states or measures of its fuel reaches the priors of the fit."""

from dataclasses import replace

import numpy as np
import pytest
from camtorque.config import FluidSpec
from camtorque.fit.prepare import rig_rows
from camtorque.laws import ROWS
from camtorque.laws.fuels import MODULUS_PER_KELVIN, modulus_prior, viscosity_ratio
from camtorque.mechanism.spectral import spectral_law
from fit_cases import bridged

KEY = ("closed_volume",)
ZERO = 273.15


NOTHING = FluidSpec()


def rows_of(fluid: FluidSpec = NOTHING, **channels: np.ndarray):
    recording, cycles, _ = bridged(KEY)
    sheets = [recording.of(quantity)[0].calibration for quantity in ("torque", "pressure")]
    config = replace(recording.config, fluid=fluid)
    law = spectral_law(recording.cam_table)
    return rig_rows(config, law, *sheets, replace(cycles, channels=channels))


def test_nothing_known_of_the_fuel_leaves_the_rows():
    rows = rows_of()
    for name in ("bulk_modulus", "leakage", "plunger_viscous", "feed_pressure"):
        assert rows[name] == ROWS[name]


def test_a_warmer_fuel_is_softer_and_thinner():
    _, cycles, _ = bridged(KEY)
    stated = rows_of(FluidSpec(temperature=ZERO + 80.0))
    # the channel tells more than recording.toml; a cycle that it does not cover counts for nothing
    channel = np.full_like(cycles.pressure, ZERO + 80.0)
    channel[0] = np.nan
    measured = rows_of(FluidSpec(temperature=ZERO + 20.0), fuel_temperature=channel)
    for name in ("bulk_modulus", "leakage", "plunger_viscous"):
        assert measured[name].prior == pytest.approx(stated[name].prior)
    cold = rows_of(FluidSpec(temperature=ZERO + 40.0))
    assert stated["bulk_modulus"].prior[0] < 0.85 * cold["bulk_modulus"].prior[0]
    assert cold["bulk_modulus"].prior[1] < ROWS["bulk_modulus"].prior[1]
    ratio = viscosity_ratio(ZERO + 80.0)
    assert stated["leakage"].prior[0] == pytest.approx(ROWS["leakage"].prior[0] / ratio)
    assert stated["plunger_viscous"].prior[1] == pytest.approx(ROWS["plunger_viscous"].prior[1] * ratio)
    assert cold["leakage"].prior == pytest.approx(ROWS["leakage"].prior)


def test_a_known_fuel_is_known_better():
    diesel, any_fuel = modulus_prior("Diesel EN 590", ZERO + 40.0), modulus_prior("", ZERO + 40.0)
    assert diesel.std < any_fuel.std
    assert (diesel.mean, any_fuel.mean) == (1.33e9, 1.40e9)
    unsure = modulus_prior("ISO 4113", None)
    assert unsure.std > diesel.std
    assert modulus_prior("water", None) is None
    slope = (modulus_prior("diesel", ZERO + 41.0).mean - diesel.mean) / 1.0
    assert slope == pytest.approx(MODULUS_PER_KELVIN, rel=0.01)


def test_viscosity_follows_the_sheet_of_a_test_oil():
    # the two points of the line, and diesel's usual 4 mm^2/s at 20 degrees between them and beyond
    assert viscosity_ratio(ZERO + 40.0) == pytest.approx(1.0)
    assert viscosity_ratio(ZERO + 100.0) == pytest.approx(1.1 / 2.6)
    assert 2.6 * viscosity_ratio(ZERO + 20.0) == pytest.approx(4.0, rel=0.1)


def test_a_stated_modulus_goes_before_the_temperature():
    rows = rows_of(FluidSpec(temperature=ZERO + 80.0, bulk_modulus=3e8))
    assert rows["bulk_modulus"].prior == pytest.approx((3e8, 1.5e7))
    assert rows["bulk_modulus"].lower < 3e8


def test_the_gallery_pressure_is_the_feed_pressure():
    _, cycles, _ = bridged(KEY)
    gallery = 5e5 + 1e5 * np.sin(cycles.theta)[None, :] * np.ones((cycles.speed.size, 1))
    row = rows_of(gallery_pressure=gallery)["feed_pressure"]
    assert row.prior == pytest.approx((5e5, 1e5 / np.sqrt(2.0)), rel=1e-3)
    assert row.source == "measured in the gallery"
    sucked = rows_of(FluidSpec(feed_pressure=-3e4))["feed_pressure"]
    assert sucked.lower < -3e4
