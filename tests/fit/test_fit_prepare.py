"""What the bench states or measures of its fuel reaches the priors of the fit."""

from dataclasses import replace

import numpy as np
import pytest
from camtorque.align.budget import wandered
from camtorque.config import FluidSpec
from camtorque.fit.kinds import KINDS, PIN
from camtorque.fit.prepare import fit_data, mean_cycles
from camtorque.fit.rig_rows import LARGEST_USUAL_ROLLER, NO_INERTIA, USUAL_CAM, USUAL_PLUNGER, _set_warm, rig_rows
from camtorque.laws import ROWS
from camtorque.laws.fluid import MODULUS_PER_KELVIN, modulus_prior, viscosity_ratio
from camtorque.laws.sensor import LEAST_DAMPING, sensor_transfer
from camtorque.laws.valve import stop_force
from camtorque.mechanism.lift_laws import spectral_law
from fit_cases import bridged
from scipy.optimize import brentq

KEY = ("closed_volume",)
ZERO = 273.15


NOTHING = FluidSpec()


def rows_of(fluid: FluidSpec = NOTHING, pump=None, torque=None, **channels: np.ndarray):
    recording, cycles, _ = bridged(KEY)
    sheets = [recording.of(quantity)[0].calibration for quantity in ("torque", "pressure")]
    sheets[0] = replace(sheets[0], **(torque or {}))
    usual = {"plunger_diameter": USUAL_PLUNGER[1], "base_circle_radius": USUAL_CAM[1]}
    sheet = replace(recording.config.pump, **(usual if pump is None else pump))
    config = replace(recording.config, fluid=fluid, pump_sheet=sheet)
    law = spectral_law(recording.cam_table)
    return rig_rows(config, law, *sheets, replace(cycles, channels=channels))


def test_nothing_known_of_the_fuel_leaves_the_rows():
    rows = rows_of()
    for name in ("bulk_modulus", "leakage", "plunger_viscous", "feed_pressure"):
        assert rows[name] == ROWS[name]


def test_levels_that_drift_and_clocks_that_wander_widen_zeros_and_delay():
    recording, cycles, _ = bridged(KEY)
    sheets = [recording.of(quantity)[0].calibration for quantity in ("torque", "pressure")]
    law = spectral_law(recording.cam_table)
    late = np.degrees(cycles.mean_speed * 50.0e-6)
    moving = replace(
        cycles,
        level_drifts={"torque": -30.0, "pressure": 8.0e5},
        angle_errors=(*cycles.angle_errors, *wandered({"torque": np.deg2rad(-late)})),
    )
    rows = rig_rows(recording.config, law, *sheets, moving)
    assert rows["torque_zero"].prior[1] == pytest.approx(np.hypot(sheets[0].zero_std, 15.0))
    assert rows["torque_zero"].upper > 45.0
    assert rows["pressure_zero"].prior[1] == pytest.approx(np.hypot(sheets[1].zero_std, 4.0e5))
    assert rows["delay_error"].prior[1] == pytest.approx(np.hypot(sheets[0].delay_std, 50.0e-6))
    assert rows["delay_error"].lower < -150.0e-6
    still = rig_rows(recording.config, law, *sheets, cycles)
    assert still["torque_zero"].prior[1] == pytest.approx(max(sheets[0].zero_std, 1e-4))


@pytest.mark.parametrize(
    ("name", "quantity", "stated"),
    [("delay_error", "torque", {"delay_std": 289.0e-6}), ("gain_error", "torque", {"gain_relative_std": 0.05}),
     ("torque_zero", "torque", {"zero_std": 30.0}), ("pressure_zero", "pressure", {"zero_std": 12.0e5})],
)  # fmt: skip
def test_what_a_sheet_leaves_open_is_not_cut_off(name, quantity, stated):
    recording, cycles, _ = bridged(KEY)
    sheets = {one: recording.of(one)[0].calibration for one in ("torque", "pressure")}
    sheets[quantity] = replace(sheets[quantity], **stated)
    row = rig_rows(recording.config, spectral_law(recording.cam_table), sheets["torque"], sheets["pressure"], cycles)[
        name
    ]
    (std,) = stated.values()
    assert row.prior == pytest.approx((0.0, std))
    assert row.lower <= -3.0 * std < 3.0 * std <= row.upper


def test_a_transducer_of_one_direction_turns_with_its_whole_range():
    both, one = (rows_of(torque={"range_min": -200.0, "range_max": top}) for top in (200.0, 0.0))
    assert one["turning_cosine"] == both["turning_cosine"]
    assert one["turning_cosine"].prior[1] > 0.0


def test_the_drive_of_a_large_bench_may_repeat_more():
    small, large = (rows_of(torque={"range_min": -top, "range_max": top})["ripple_sine"] for top in (50.0, 2000.0))
    assert small.prior == ROWS["ripple_sine"].prior
    assert large.prior == (0.0, 40.0)
    assert large.upper == 200.0


def test_a_warmer_fuel_is_softer_and_thinner():
    _, cycles, _ = bridged(KEY)
    stated = rows_of(FluidSpec(temperature=ZERO + 80.0))
    # the channel tells more than recording.toml; a cycle that it does not cover counts for nothing
    channel = np.full_like(cycles.pressure, ZERO + 80.0)
    channel[0] = np.nan
    measured = rows_of(FluidSpec(temperature=ZERO + 20.0), fuel_temperature=channel)
    for name in ("bulk_modulus", "leakage", "plunger_viscous"):
        assert measured[name].prior == pytest.approx(stated[name].prior)
    # a wire that breaks on the way, or was never whole
    broken = np.where(np.arange(len(channel))[:, None] < 3, 0.0, channel)
    assert rows_of(fuel_temperature=broken)["leakage"].prior == pytest.approx(stated["leakage"].prior)
    assert rows_of(FluidSpec(temperature=ZERO + 80.0), fuel_temperature=np.zeros_like(channel)) == stated
    cold = rows_of(FluidSpec(temperature=ZERO + 40.0))
    assert stated["bulk_modulus"].prior[0] < 0.85 * cold["bulk_modulus"].prior[0]
    assert cold["bulk_modulus"].prior[1] < ROWS["bulk_modulus"].prior[1]
    ratio = viscosity_ratio(ZERO + 80.0)
    assert stated["leakage"].prior[0] == pytest.approx(ROWS["leakage"].prior[0] / ratio)
    assert stated["plunger_viscous"].prior[1] == pytest.approx(ROWS["plunger_viscous"].prior[1] * ratio)
    assert cold["leakage"].prior == pytest.approx(ROWS["leakage"].prior)


def test_a_known_fuel_is_known_better():
    diesel, any_fuel = modulus_prior("Diesel EN 590", ZERO + 40.0), modulus_prior("", ZERO + 40.0)
    assert diesel[1] < any_fuel[1]
    assert (diesel[0], any_fuel[0]) == (1.33e9, 1.35e9)
    unsure = modulus_prior("ISO 4113", None)
    assert unsure[1] > diesel[1]
    assert modulus_prior("", None) is None
    # a name that tells nothing is no fuel of any kind: freon would be softer, mercury stiffer
    named = modulus_prior("V-Oil 7", ZERO + 40.0)
    assert named[1] > 2.0 * any_fuel[1]
    assert named[2] == "V-Oil 7, of which nothing is known, at 40 degC"
    for other in ("DOT 4 glycol ether", "polyglycol", "polyalkylene glycol"):  # without the water
        assert modulus_prior(other, ZERO + 40.0)[:2] == named[:2]
    slope = (modulus_prior("diesel", ZERO + 41.0)[0] - diesel[0]) / 1.0
    assert slope == pytest.approx(MODULUS_PER_KELVIN, rel=0.01)


def test_the_bound_of_the_modulus_gives_way_to_a_soft_fuel():
    rows = dict(ROWS)
    _set_warm(rows, FluidSpec(name="DME"), ZERO + 60.0)
    mean, std = rows["bulk_modulus"].prior
    assert rows["bulk_modulus"].lower < mean - 2.0 * std < ROWS["bulk_modulus"].lower
    _set_warm(diesel := dict(ROWS), FluidSpec(name="diesel"), ZERO + 60.0)
    assert diesel["bulk_modulus"].lower == ROWS["bulk_modulus"].lower


def test_a_heavy_fuel_is_as_soft_as_it_is_hot_and_as_thin_as_a_pump_needs_it():
    # 1300 m/s and 925 kg/m^3 at 110 degrees give 1.56 GPa
    assert modulus_prior("heavy fuel oil", ZERO + 110.0)[0] == pytest.approx(1.56e9, rel=0.02)
    rows = dict(ROWS)
    _set_warm(rows, FluidSpec(name="HFO"), ZERO + 110.0)
    assert rows["plunger_viscous"] == ROWS["plunger_viscous"]
    assert rows["bulk_modulus"].prior != ROWS["bulk_modulus"].prior


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


def test_a_larger_pump_is_expected_larger_and_a_smaller_one_no_better_known():
    usual = rows_of()
    large = rows_of(pump={"plunger_diameter": 2.0 * USUAL_PLUNGER[1], "base_circle_radius": 3.0 * USUAL_CAM[1],
                          "roller_radius": 5.0 * LARGEST_USUAL_ROLLER})  # fmt: skip
    for name, factor in {"spill_width": 2.0, "port_span": 2.0, "retraction_volume": 8.0, "plunger_viscous": 4.0,
                         "bearing_arm": 3.0, "pin_arm": 5.0, "shaft_drag": 9.0}.items():  # fmt: skip
        assert large[name].prior == pytest.approx([factor * value for value in usual[name].prior])
        assert large[name].upper == pytest.approx(factor * usual[name].upper)
    bush = KINDS[PIN]
    mean, std = bush.prior
    assert bush.rows(large["pin_arm"])[1] == {"prior": pytest.approx((5.0 * mean, 5.0 * std)), "source": bush.source}
    assert bush.rows(large["pin_arm"])[0]["prior"] == pytest.approx(large["pin_arm"].prior)
    small = rows_of(pump={"plunger_diameter": 0.5 * USUAL_PLUNGER[0]})
    assert small["spill_width"].prior == pytest.approx(
        (0.5 * usual["spill_width"].prior[0], usual["spill_width"].prior[1])
    )
    assert small["spill_width"].lower < usual["spill_width"].lower


@pytest.mark.parametrize("share", [1.0, 0.5, 0.2])
def test_the_gallery_of_a_small_pump_has_the_room_by_which_the_seat_yields(share):
    row = rows_of(pump={"plunger_diameter": share * USUAL_PLUNGER[0]})["gallery_volume"]
    assert row.lower == ROWS["gallery_volume"].lower
    assert row.start >= 2.0 * row.lower
    line = 700.0  # bar: the residual pressure that presses the valve on its seat
    depth = brentq(lambda u: stop_force(-u, 0.0, 1.0, 30.0)[0] + line, 0.0, 50.0)
    assert 1e9 * row.lower > 2.0 * depth


def test_a_low_pass_that_no_sheet_states_is_left_to_the_data():
    unknown, stated = (rows_of(torque={"cutoff_hz": value})["cutoff"] for value in (np.nan, 1000.0))
    assert (unknown.prior, stated.prior) == ((1000.0, 1000.0), (1000.0, 50.0))
    assert (unknown.lower, unknown.upper) == (100.0, 5000.0)
    assert unknown.source.startswith("no sheet")
    assert stated.source.startswith("data sheet")


def test_the_kind_of_low_pass_on_the_sheet_is_the_one_that_is_fitted():
    assert rows_of(torque={"filter_damping": 0.866})["filter_damping"].prior == (0.866, 0.05)
    row = rows_of(torque={"filter_order": 1})["filter_damping"]
    omega = 2.0 * np.pi * np.linspace(10.0, 3000.0, 50)
    found = sensor_transfer(omega, 1000.0, row.prior[0], 0.0)[0]
    lag = 1j * omega / (2.0 * np.pi * 1000.0)
    expected = 1.0 / (1.0 + lag) * np.exp(lag)
    assert found == pytest.approx(expected, abs=0.02)
    assert row.lower < row.start < row.upper


def test_a_steep_low_pass_starts_and_stays_where_its_poles_are_stable():
    row = rows_of(torque={"filter_order": 4})["filter_damping"]
    assert row.prior == ROWS["filter_damping"].prior
    assert row.lower == LEAST_DAMPING < row.start
    assert rows_of(torque={"filter_order": 2})["filter_damping"].lower < LEAST_DAMPING


@pytest.mark.parametrize(("mass", "inertia"), [(0.0, 0.0), (None, 0.0), (0.0, None)])
def test_a_foot_that_does_not_roll_has_no_inertia_to_fit(mass, inertia):
    row = rows_of(pump={"roller_mass": mass, "roller_inertia": inertia})["roller_inertia"]
    assert row.prior == (0.0, NO_INERTIA)


def test_a_foot_that_slides_rubs_on_its_crown():
    foot, roller = (
        rows_of(pump={"roller_inertia": inertia, "roller_radius": 0.15})["pin_arm"] for inertia in (0.0, 1e-6)
    )
    scale = 0.15 / LARGEST_USUAL_ROLLER
    assert roller.prior == pytest.approx([scale * value for value in ROWS["pin_arm"].prior])
    # of lubricated steel: a coefficient of 0.01 to 0.1 on the radius of the crown
    low, high = (coefficient * 0.15 for coefficient in (0.01, 0.1))
    assert abs(low - foot.prior[0]) < foot.prior[1]
    assert abs(high - foot.prior[0]) < 2.0 * foot.prior[1]
    assert foot.upper > 2.0 * high
    assert "crown" in foot.meaning


def test_a_stated_inertia_of_the_roller_counts_without_its_mass():
    row = rows_of(pump={"roller_mass": None, "roller_inertia": 4.0e-7})["roller_inertia"]
    assert row.prior == pytest.approx((4.0e-7, 2.0e-8))


def torsion(torque_scale: float, **drive: float):
    recording, cycles, _ = bridged(KEY)
    law = spectral_law(recording.cam_table)
    recording = replace(recording, config=replace(recording.config, drive=replace(recording.config.drive, **drive)))
    means = mean_cycles(cycles)
    means = replace(means, torque=torque_scale * means.torque)
    return fit_data(recording, cycles, law, means).rows, float(np.max(np.abs(means.torque)))


def test_a_shaft_is_expected_to_be_made_for_its_torque():
    small, peak = torsion(0.1)
    assert small["shaft_compliance"].prior[1] == pytest.approx(5e-3 / peak)
    assert small["shaft_compliance"].upper > ROWS["shaft_compliance"].upper
    assert small["drive_admittance"].prior[1] > ROWS["drive_admittance"].prior[1]
    large, _ = torsion(10.0)
    assert large["shaft_compliance"].start < ROWS["shaft_compliance"].start
    assert large["shaft_compliance"].prior == ROWS["shaft_compliance"].prior
    stated, _ = torsion(0.1, shaft_stiffness=5000.0)
    assert stated["shaft_compliance"].prior == pytest.approx((2e-4, 3e-5))


@pytest.mark.parametrize(("name", "like", "low", "high"), [
    ("biodiesel", "RME", 1.45e9, 1.65e9), ("gasoline", "petrol", 0.9e9, 1.1e9),
    ("B7 diesel", "petroleum diesel", 1.28e9, 1.38e9), ("methanol", "E85", 0.8e9, 0.95e9),
    ("Jet A-1", "kerosene", 1.1e9, 1.3e9), ("marine distillate", "MGO DMA", 1.4e9, 1.6e9),
    ("heavy fuel oil", "IFO 380", 1.9e9, 2.2e9), ("HVO", "paraffinic diesel EN 15940", 1.15e9, 1.3e9),
    ("AdBlue", "urea solution", 2.5e9, 2.9e9), ("gasoline with 10 % ethanol", "Otto fuel", 0.9e9, 1.1e9),
    ("diesel with 20 % ethanol", "residual-free test oil", 1.28e9, 1.38e9), ("E10", "petrol E5", 0.9e9, 1.1e9),
    ("EN 590 with 6,5 % FAME", "winter diesel (kerosene 30 %)", 1.28e9, 1.38e9), ("RMG 380", "Schweroel", 1.9e9, 2.2e9),
    ("test oil, jet at 40 bar", "No. 2 diesel free of FAME", 1.28e9, 1.38e9),
    ("dimethyl ether", "DME", 0.4e9, 0.6e9), ("water glycol", "50 % ethylene glycol", 2.6e9, 3.1e9),
    ("40 % glycol in water", "water, glycol 45 %", 2.6e9, 3.1e9), ("2 % glycol in water", "water", 2.2e9, 2.4e9),
    ("demineralised water", "water", 2.2e9, 2.4e9), ("water-free ethanol", "alcohol", 0.8e9, 0.95e9),
    ("M85", "100 % ethanol", 0.8e9, 0.95e9), ("diesel of 87.5 % kerosene", "jet A1", 1.1e9, 1.3e9),
])  # fmt: skip
def test_a_fuel_is_known_by_its_names(name, like, low, high) -> None:
    mean, _, source = modulus_prior(name, ZERO + 40.0)
    assert low < mean < high
    assert mean == modulus_prior(like, ZERO + 40.0)[0]
    assert source.startswith(name)
