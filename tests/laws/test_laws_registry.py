"""Rows, names and causes of the laws are complete and come from one place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.evidence import LOSSES
from camtorque.fit.prepare import at_cam_angles
from camtorque.fit.problem import LAND_NAMES, NEUTRAL, SPILL_NAMES
from camtorque.laws import LAW_OF, LAWS, LINEAR_NAMES, ROWS, cause_of, chamber
from camtorque.laws.causes import (
    CAUSES,
    LOSS_GROUPS,
    ON_BRIDGE_ALONE,
    cam_torques,
    contact_load,
    drive_work,
    measured_torques,
    work_per_revolution,
)
from camtorque.laws.chain import COLUMN_NAMES, NONLINEAR_NAMES, evaluate
from camtorque.laws.chamber import KERNEL_UNITS
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.driveline import COMPLIANCE_NAMES
from camtorque.laws.rows import ParameterRow
from camtorque.laws.swing import Swing
from camtorque.laws.torque import cam_torque
from camtorque.mechanism.friction import guide_share
from camtorque.mechanism.lift_laws import cubic_law
from camtorque.mechanism.torque import OUTPUTS, solve_lift
from camtorque.records import CamTable
from camtorque.units import DEGREE
from laws_cases import COEFFICIENTS, THETA, chain_input, start_values, total_torque

UNITS = {
    "%", "-", "1/(kg m^2)", "1/kbar", "1/mm", "1/ms", "10^6 kg/m^4", "GPa", "Hz", "N", "N m", "N m s/rad", "N s/m",
    "bar", "bar/mm^3", "deg", "kg mm^2", "ln(1)", "ln(1/s)", "ln(rad/s)", "ln(s)", "mm", "mm^2", "mm^3", "mm^3/s/bar",
    "nm/N",
    "um", "urad/(N m)", "us",
}  # fmt: skip


@pytest.mark.parametrize("name", ROWS)
def test_row_is_complete(name):
    row = ROWS[name]
    assert row.unit in UNITS
    assert row.per_unit > 0.0
    assert row.lower < row.upper
    assert row.symbol
    assert len(row.meaning) > 10
    assert len(row.source) > 8
    if row.prior is not None:
        mean, std = row.prior
        assert row.lower <= mean <= row.upper, "the prior's mean lies outside the bounds"
        assert std <= row.upper - row.lower
    # a solver scaled by the step crosses what is believed, or allowed, in a sensible number of them
    width = row.prior[1] if row.prior is not None else row.upper - row.lower
    assert 1.0 / 3.0 < width / row.step < 1500.0


def test_every_parameter_is_in_the_chain_once():
    chain = (*NONLINEAR_NAMES, *COLUMN_NAMES)
    assert sorted(chain) == sorted(ROWS)
    assert len(set(chain)) == len(chain)
    assert (*LINEAR_NAMES, "torque_zero", "ripple_cosine", "ripple_sine") == COLUMN_NAMES
    for name, law in LAWS.items():
        assert {*law.linear, *law.causes} <= {row.name for row in law.rows}, name
        assert all(LAW_OF[row.name] == name for row in law.rows)
        assert (law.columns is None) == (not law.linear), name


def test_kernel_and_driveline_take_their_own_rows():
    assert set(CHAMBER_NAMES) == {row.name for row in LAWS["chamber"].rows}
    for name, unit in KERNEL_UNITS.items():
        assert unit > 0.0, name
    rows = {row.name for row in (*LAWS["driveline"].rows, *LAWS["coupling"].rows)}
    assert set(COMPLIANCE_NAMES) == rows - {"trigger_offset"}


def test_losses_and_structures_name_parameters():
    for members in LOSSES.values():
        assert set(members) <= set(ROWS)
        assert all(ROWS[name].lower < 0.01 * ROWS[name].upper for name in members), "a loss vanishes at its lower bound"
    rubbing = {row.name for law in ("friction", "packing") for row in LAWS[law].rows}
    assert set(LOSSES["friction"]) == rubbing
    assert set(LOSSES["damping"]) == {row.name for row in LAWS["damping"].rows}
    assert set(NEUTRAL) == {*LAND_NAMES, *SPILL_NAMES} <= set(ROWS)


def test_causes_come_from_the_laws():
    named = [name for names in LOSS_GROUPS.values() for name in names]
    assert sorted(named) == sorted(set(named))
    assert set(named) == set(CAUSES) - ON_BRIDGE_ALONE
    assert {cause_of(name) for name in LINEAR_NAMES} <= set(CAUSES)
    for law in ("friction", "packing"):
        for row in LAWS[law].rows:
            assert cause_of(row.name) in LOSS_GROUPS["friction"]


@pytest.mark.parametrize("order", [0, 41])
def test_causes_sum_to_the_chain_with_every_loss_on(order):
    data, values = chain_input(ripple_order=order), {**start_values(), "guide_friction": 0.08}
    output = evaluate(data, values)
    slope = 1e-5 * np.sin(9.0 * THETA)
    parts, _ = cam_torques(data, values, output, COEFFICIENTS, slope)
    assert set(parts) == set(CAUSES)
    behind = measured_torques(data, values, parts, COEFFICIENTS)
    assert ("drive_ripple" in behind) == (order > 0)
    total = np.sum(list(behind.values()), axis=0)
    lift_part = behind["lift_table"]
    # the chain filters bins of three points, the causes the points: compared on the bins where that is no difference
    found = (total - lift_part).reshape(output.torque.size, -1).mean(axis=1)
    expected = total_torque(data, values)
    assert np.max(np.abs(found - expected)) < 2e-3 * np.max(np.abs(expected))
    for name in CAUSES:
        assert np.any(parts[name]), name


def test_work_of_the_causes_is_the_work_of_the_shaft():
    data, values = chain_input(), start_values()
    output = evaluate(data, values)
    parts, _ = cam_torques(data, values, output, COEFFICIENTS, np.zeros(THETA.size))
    work = work_per_revolution(data, values, output, parts)
    assert set(work) == {*LOSS_GROUPS, "driveline"}
    torque = np.sum([part for name, part in parts.items() if name not in ON_BRIDGE_ALONE], axis=0)
    advance = output.motion.rate / data.speed * 2.0 * np.pi / THETA.size
    without = sum(value for name, value in work.items() if name != "driveline")
    assert without == pytest.approx(float(np.sum(torque * advance)), rel=1e-12)
    assert work["friction"] > 0.0
    assert work["damping"] > 0.0


def test_what_a_wheel_measured_of_the_speed_does_no_work():
    """A spring takes nothing over a revolution, no shaft loses anything: torque acts over the cam's own angle."""
    deviation = 0.01 * np.sin(THETA) + 0.004 * np.cos(3.0 * THETA)
    none = ("shaft_compliance", "coupling_compliance", "drive_admittance", "guide_friction")
    rigid = {**start_values(), **dict.fromkeys(none, 0.0)}
    data = chain_input(swing=Swing(deviation, deviation, 3))
    output = evaluate(data, rigid)
    assert np.ptp(output.motion.rate) > 0.03 * data.speed
    parts, _ = cam_torques(data, rigid, output, COEFFICIENTS, np.zeros(THETA.size))
    work = work_per_revolution(data, rigid, output, parts)
    assert abs(work["spring"]) < 1e-6
    assert abs(work["driveline"]) < 1e-9
    over_cam = at_cam_angles(data, parts["pressure"], 7200)
    assert work["pressure"] == pytest.approx(2.0 * np.pi * float(np.mean(over_cam)), rel=5e-4)
    assert work["pressure"] != pytest.approx(2.0 * np.pi * float(np.mean(parts["pressure"])), rel=1e-3)


def test_the_contact_force_drives_all_that_acts_along_the_plunger():
    """Virtual work: without arms on which the load rubs, its part along the follower times y' is the torque."""
    data, values = chain_input(), {**start_values(), "guide_friction": 0.08}
    along = ("packing_force", "packing_friction", "plunger_viscous", "spring_stiffness_error", "spring_preload_error")
    chosen = COEFFICIENTS * np.isin(COLUMN_NAMES, along)
    assert np.count_nonzero(chosen) == len(along)
    output = evaluate(data, values)
    parts, force = cam_torques(data, values, output, chosen, np.zeros(THETA.size))
    assert np.max(np.abs(force)) > 50.0
    torque = np.sum([parts[name] for name in CAUSES if name != "lift_table"], axis=0)
    along, normal, held = contact_load(data, values, output, chosen, force)
    assert not held.any(), "this law has no table"
    np.testing.assert_allclose(along * output.motion.lift[1], torque, rtol=1e-12, atol=1e-9)
    flank = np.arctan((output.motion.lift[1] - data.constants.offset) / (data.constants.base + output.motion.lift[0]))
    np.testing.assert_allclose(normal * np.cos(flank), along, rtol=1e-12)
    assert np.max(np.abs(flank)) > 0.2


def test_a_packing_in_which_the_plunger_stands_pushes_either_way():
    """With slopes of a table's error, .02 to .05 mm/rad of either sign, the packing's 30 N came and went at random."""
    data, values = chain_input(), {**start_values(), "guide_friction": 0.08}
    output = evaluate(data, values)
    lift = output.motion.lift.copy()
    round_part = output.motion.theta % (2.0 * np.pi) > np.pi
    noise = 5e-5 * np.random.default_rng(2).standard_normal(np.count_nonzero(round_part))
    lift[:, round_part] = np.array([0.0 * noise, noise, 0.0 * noise, 0.0 * noise])
    law = cubic_law(CamTable(np.arange(360) * DEGREE, np.r_[np.zeros(359), 1e-5], 1e-6))
    assert law.is_round(noise).mean() > 0.98
    noisy = replace(output, motion=replace(output.motion, lift=lift))
    chosen = 30.0 * (np.array(COLUMN_NAMES) == "packing_force")
    given = replace(data, law=law)
    _, force = cam_torques(given, values, noisy, chosen, np.zeros(THETA.size))
    along, normal, held = contact_load(given, values, noisy, chosen, force)
    stands = law.is_round(lift[1])
    assert not force[stands].any()
    np.testing.assert_allclose(np.abs(force[~stands]), 30.0, rtol=0.2)  # smooth where it turns
    tilt = 1.0 + 0.08 * np.abs(normal / along)  # the guide holds less than that of its load beside it
    assert np.all((held[stands] >= 30.0) & (held[stands] <= 30.0 * tilt[stands] + 0.08 * along[stands]))
    assert not held[~stands].any()


def test_a_drive_that_gives_way_is_no_loss_of_shaft_and_coupling():
    data = chain_input()
    gives_way = {**start_values(), "shaft_compliance": 0.0, "coupling_compliance": 0.0, "drive_admittance": 8.0}
    soft = {**gives_way, "shaft_compliance": 2e-4, "shaft_damping_ratio": 0.2}

    def works(values):
        output = evaluate(data, values)
        parts, _ = cam_torques(data, values, output, COEFFICIENTS, np.zeros(THETA.size))
        swing = output.motion.rate / data.speed - 1.0
        taken = float(np.sum(data.shaft_torque * swing)) * 2.0 * np.pi / THETA.size
        return work_per_revolution(data, values, output, parts)["driveline"], drive_work(data, values), taken

    lost, given, taken = works(gives_way)
    assert given < -0.01, "a drive that slows down under load gives less than mean torque times a turn"
    assert given == pytest.approx(taken, rel=1e-9)
    assert abs(lost) < 1e-9 * abs(given)
    lost, same, _ = works(soft)
    assert same == given
    assert lost > 1e-4, "what the shaft's damping takes"


@pytest.mark.parametrize("offset", [0.0, 2e-3, -3e-3])
def test_torque_of_the_laws_is_the_closed_form_of_the_mechanism(offset):
    # the mechanism takes the pin's friction from the force along the surface, the law from an arm of the load
    data = chain_input(offset=offset)
    mu, bearing, pin = 0.07, 2e-4, 3e-5
    lift = data.law.derivatives(THETA, 3)
    speed, acceleration = 60.0 + 3.0 * np.sin(THETA), 900.0 * np.cos(2.0 * THETA)
    vector = np.zeros(len(LINEAR_NAMES))
    vector[:2] = bearing, pin
    vector[LINEAR_NAMES.index("roller_inertia")] = data.constants.roller_inertia
    pressure = data.line_pressure
    plain, columns, _, load, least, _ = cam_torque(
        data.constants, mu, THETA, lift, speed, acceleration, pressure, vector, False
    )
    constants = data.constants._replace(guide_friction=mu, bearing_arm=bearing, pin_arm=pin)
    expected = solve_lift(constants, lift[:3].copy(), np.array(pressure), speed, acceleration)
    torque, along = expected[OUTPUTS.index("torque")], expected[OUTPUTS.index("contact_y")]
    np.testing.assert_allclose(plain + columns @ vector, torque, rtol=0.0, atol=1e-12 * np.max(np.abs(torque)))
    np.testing.assert_allclose(load, along, rtol=1e-13)
    assert least == pytest.approx(1.0 - mu * np.max(guide_share((lift[1] - offset) / path_height(data, lift), lift[1])))


def path_height(data, lift):
    """Return the distance between the centres along the follower from the sheet [m]."""
    distance = data.pump.base_circle_radius + data.pump.roller_radius
    return np.sqrt(distance**2 - data.offset**2) + lift[0]


def test_rows_that_make_no_sense_are_refused():
    good = {
        "name": "x", "symbol": "x", "unit": "N", "per_unit": 1.0, "start": 0.5, "lower": 0.0, "upper": 1.0,
        "step": 0.1, "prior": (0.5, 0.1), "meaning": "nothing at all", "source": "nowhere",
    }  # fmt: skip
    ParameterRow(**good)
    for change, text in [
        ({"start": 2.0}, "outside"), ({"step": 0.0}, "positive and finite"), ({"role": "both"}, "expected one of"),
        ({"prior": (0.5, 0.0)}, "standard deviation"),
    ]:  # fmt: skip
        with pytest.raises(ValueError, match=text):
            ParameterRow(**{**good, **change})


def test_each_place_of_the_chamber_is_called_as_its_parameter() -> None:
    assert [getattr(chamber, name.upper()) for name in CHAMBER_NAMES] == list(range(chamber.N))
