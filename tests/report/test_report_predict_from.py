"""Predictions from a fit: what widens them, how a load's end is found, what is refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import make_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from camtorque import predict_from as predict_flow
from camtorque.cli import build_parser
from camtorque.commands.predict import execute
from camtorque.config.pump import PressureCurve
from camtorque.finished_fit import (
    FinishedFit,
    chain_of,
    curve_of,
    load_curve,
    read_fit,
    refuse_load_of_another_place,
    refuse_load_of_another_pump,
    refuse_other_strokes,
    rig_of,
)
from camtorque.fit import endings as endings_module
from camtorque.fit import forecast as forecast_module
from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.clearance import leakage_factor
from camtorque.fit.endings import LEAST_STD, UNKNOWN_STD, found_end, learned_from, load_for, width_of
from camtorque.fit.forecast import DRAWS, shape_of
from camtorque.fit.known_ends import Curve, KnownEnd, MatchedEnd, matched_end
from camtorque.fit.known_fit import FRACTIONS, FittedAt, KnownFit, LoadKnowledge, draws, law_share, law_std
from camtorque.fit.load_file import curve_through, refuse_below_line, refuse_other_load, rise_angle, rise_range
from camtorque.fit.shared_lift import SharedLift
from camtorque.hashes import file_digest
from camtorque.ingest.pump_file import read_pressure_curve
from camtorque.laws.swing import Swing
from camtorque.laws.valve import SEAT_FLOW
from camtorque.predict_from import Found
from camtorque.records import Estimate, Refusal
from camtorque.report.fit_file import run_fit_document
from camtorque.report.forecast_page import assumed_of, assumptions, beyond_text, elsewhere_text, step_text
from camtorque.report.write import write_run
from camtorque.units import angle_grid
from report_cases import THETA, falling, run_result

SHEETS = Path(__file__).resolve().parents[2] / "calibration"
BENCH = SHEETS.parent / "raw_examples" / "A_1000rpm"


def known(shares: list[float], left_out: bool = True) -> KnownFit:
    speeds = 50.0 * 1.25 ** np.arange(len(shares))
    recordings = [FittedAt(f"r{k}", float(s), "land", share, left_out)
                  for k, (s, share) in enumerate(zip(speeds, shares, strict=True))]  # fmt: skip
    names, covariance = ("leakage", "end_of_delivery__r1"), ArrowCovariance.whole(np.eye(2))
    return KnownFit(names, np.array([1.0, 2.0]), covariance, tuple(recordings))


def test_error_beyond_the_fitted_speeds_grows_as_left_out_ends_were_off() -> None:
    fit = known([0.010, 0.002, 0.002, 0.006])
    inside, beyond = law_share(fit, 60.0)
    assert (inside, beyond) == (pytest.approx(0.002), 0.0)
    share, beyond = law_share(fit, fit.recordings[-1].speed * 1.25)
    assert beyond == pytest.approx(np.log(1.25))
    assert share == pytest.approx(0.010), "one gap beyond is as bad as the worse end one gap beyond the others"


def test_one_recording_teaches_no_growth_and_is_widened_all_the_same() -> None:
    fit = known([0.001], left_out=False)
    assert law_share(fit, 50.0)[0] == pytest.approx(0.001)
    assert law_share(fit, 100.0)[0] > 0.01


def test_error_of_the_laws_has_the_stated_size_and_follows_the_torque() -> None:
    torque = 40.0 * np.maximum(np.sin(np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False)), 0.0)
    std = law_std(torque, 0.01)
    assert np.sqrt(np.mean(std**2)) == pytest.approx(0.4)
    assert std[150] > 2.0 * std[450] > 0.0


def test_own_parameters_are_those_of_the_recording() -> None:
    assert known([0.1, 0.1, 0.1]).own("r1") == {"leakage": 0, "end_of_delivery": 1}
    assert known([0.1, 0.1, 0.1]).own("r0") == {"leakage": 0}


RISING = THETA[(THETA > 0.3) & (THETA < 1.4)]


def test_an_end_of_delivery_is_found_by_the_shape_of_the_line_pressure() -> None:
    place = matched_end([KnownEnd("a", 0.7, falling(0.7, 60.0))], falling(0.9, 90.0), RISING).angle
    assert place == pytest.approx(0.9, abs=0.006)


def test_the_first_fall_is_the_end_and_not_the_wave_that_returns() -> None:
    def twice(end: float, returned: float) -> Curve:
        falls = [1.0 / (1.0 + np.exp((THETA - at) / 0.012)) for at in (end, returned)]
        return Curve(THETA, 1e7 + 2e7 * np.sum(falls, axis=0), 60.0)

    known_ends = [KnownEnd("a", 0.70, twice(0.70, 1.16)), KnownEnd("b", 0.74, twice(0.74, 1.23))]
    assert matched_end(known_ends, twice(0.72, 0.98), RISING).angle == pytest.approx(0.72, abs=0.02)


def learned(ends: list[float], width: float = 1e-3, step: float = 0.0, at: float = 60.0) -> Estimate:
    """Return the end found where it is 0.8 rad, by recordings of three speeds whose fitted ends are others."""
    speeds = {"a": 50.0, "b": 60.0, "c": 75.0}
    recordings = tuple(FittedAt(name, speed, "land", 0.01, True) for name, speed in speeds.items())
    names = tuple(f"end_of_delivery__{name}" for name in speeds)
    fit = KnownFit(names, np.array(ends), ArrowCovariance.whole(width**2 * np.eye(3)), recordings)
    known_ends = [
        KnownEnd(n, end, falling(0.8, speeds[n]), {k: 1.0}) for k, (n, end) in enumerate(zip("abc", ends, strict=True))
    ]
    curve = replace(falling(0.8, at), step=step, points=np.arange(0.0, 2.0 * np.pi, step) if step else np.zeros(0))
    return found_end(known_ends, curve, RISING, learned_from(fit, known_ends, RISING, curve.pause))


def test_fitted_recordings_teach_how_well_an_end_is_found() -> None:
    sure = learned([0.8, 0.8, 0.8])
    assert sure.value == pytest.approx(0.8, abs=0.004)
    assert sure.stderr == pytest.approx(LEAST_STD, abs=0.004)
    assert learned([0.8, 0.85, 0.8]).stderr > 0.02, "an end that the shape does not show is in the band"
    assert learned([0.8, 0.85, 0.8], 0.05).stderr < 0.005, "what the fit leaves open is in its covariance"
    coarse = learned([0.8, 0.8, 0.8], step=np.radians(6.0))
    assert coarse.stderr > 2.0 * LEAST_STD, "what a coarse file blurs is learnt on them, too"
    alone = FittedAt("a", 50.0, "land", 0.01, True)
    fit = KnownFit(("end_of_delivery__a",), np.array([0.8]), ArrowCovariance.whole(np.eye(1)), (alone,))
    known_ends = [KnownEnd("a", 0.8, falling(0.8, 50.0))]
    end = found_end(known_ends, falling(0.8, 60.0), RISING, learned_from(fit, known_ends, RISING, 0.0))
    assert end.stderr == pytest.approx(UNKNOWN_STD)


def test_misses_that_grow_with_speed_are_taken_off_and_widen_beyond_the_fitted_speeds() -> None:
    late = 0.05
    ends = [0.8 - late * float(np.log(speed / 60.0)) for speed in (50.0, 60.0, 75.0)]
    truth = 0.8 - late * float(np.log(90.0 / 60.0))
    found = learned(ends, at=90.0)
    blind = matched_end([KnownEnd("b", ends[1], falling(0.8, 60.0)), KnownEnd("c", ends[2], falling(0.8, 75.0))],
                        falling(0.8, 90.0), RISING)  # fmt: skip
    assert abs(found.value - truth) < 0.4 * abs(blind.angle - truth)
    scattered = [0.8, 0.82, 0.8]
    assert learned(scattered, at=90.0).stderr > learned(scattered, at=61.0).stderr


def test_how_sharply_another_delivery_ends_is_what_it_was_before_and_as_unsure_as_it_went() -> None:
    speeds = {"a": 50.0, "b": 60.0, "c": 75.0}
    recordings = tuple(FittedAt(name, speed, "land", 0.01, True) for name, speed in speeds.items())
    names = tuple(f"end_width__{name}" for name in speeds)
    values = np.array([0.02, 0.03, 0.05])

    def told(open_std: list[float]) -> tuple[Estimate, dict[int, float]]:
        covariance = ArrowCovariance.whole(np.diag(np.square(open_std)))
        return width_of(KnownFit(names, values, covariance, recordings), "end_width", recordings)  # type: ignore[return-value]

    sure, weights = told([1e-6] * 3)
    assert sure.value == pytest.approx(np.mean(values), rel=1e-3)
    spread = np.std(values, ddof=1) * np.sqrt(4.0 / 3.0)
    assert sure.stderr == pytest.approx(4.3027 / 1.95996 * spread, rel=1e-3), "two degrees of freedom"
    assert weights == pytest.approx({0: 1 / 3, 1: 1 / 3, 2: 1 / 3}, rel=1e-3)
    unsure, weights = told([0.05, 0.05, 0.1])
    assert unsure.stderr == 0.0, "what the fit leaves open is in its covariance"
    assert weights[0] == pytest.approx(4.0 * weights[2])
    alone = KnownFit(names[:1], values[:1], ArrowCovariance.whole(np.eye(1)), recordings[:1])
    assert width_of(alone, "end_width", recordings[:1]) is None


def test_a_mean_of_fitted_values_is_drawn_with_what_the_fit_leaves_open_of_the_mean() -> None:
    fit = KnownFit(("pressure_zero", "end_width__r0", "end_width__r1"), np.array([0.0, 0.02, 0.04]),
                   ArrowCovariance.whole(np.diag([1e6, 1e-6, 1e-6])), ())  # fmt: skip
    load = LoadKnowledge({"end_width": Estimate(0.03, 0.0)}, means={"end_width": {1: 0.5, 2: 0.5}})
    mean = {"torque_zero": 0.0, "pressure_zero": 0.0, "end_width": 0.03}
    drawn = [item["end_width"] for item in draws(fit, {"pressure_zero": 0, "end_width": 1}, mean, load, 0.1, 60)]
    assert np.std(drawn) / 0.1 == pytest.approx(1e-3 / np.sqrt(2.0), rel=0.2)


@pytest.mark.parametrize(("name", "value"), [
    ("delay_error", -4.5e-4), ("delay_error", 4.5e-4), ("shaft_compliance", 1e-6), ("dead_volume", 1e-4),
])  # fmt: skip
def test_a_value_that_its_own_rig_let_beyond_the_usual_bounds_is_drawn_about(name: str, value: float) -> None:
    std = 0.02 * abs(value)
    fit = KnownFit((name,), np.array([value]), ArrowCovariance.whole(np.array([[std**2]])), ())
    for fraction in FRACTIONS:
        found = draws(fit, {name: 0}, {name: value, "torque_zero": 0.0}, LoadKnowledge({}), fraction, 400)
        drawn = np.array([item[name] for item in found])
        assert np.mean(drawn) == pytest.approx(value, abs=0.3 * fraction * std)
        assert np.std(drawn) == pytest.approx(fraction * std, rel=0.1)


@pytest.mark.parametrize(("curve", "torque", "wanted", "steps"), [
    (lambda leakage: 3.0 * (leakage > 1e-15), None, 3.0 / np.sqrt(2.0), True),
    (lambda leakage: 3.0 * (np.abs(leakage - 1e-15) < 1e-18), 1.0, 1.0, True),
    (lambda leakage: (leakage - 1e-15) / 1e-17, 1.0, 1.0, False),
])  # fmt: skip
def test_a_step_of_the_model_is_not_scaled_up(
    curve: Callable[[float], float], torque: float | None, wanted: float, steps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = FittedAt("a", 50.0, "land", 0.0, True)
    fit = KnownFit(("leakage", "pressure_zero"), np.array([1e-15, 0.0]),
                   ArrowCovariance.whole(np.diag([1e-34, 1.0])), (source,) * 3)  # fmt: skip
    names = ("torque", "mean", "pressure", "contact", "held", "plunger_force", "angle", "flow", "delivered")

    def parts(chain: object, values: dict[str, float], lift: None) -> dict[str, np.ndarray]:
        return {name: np.full(4, 1.0 + curve(values["leakage"])) * (1.0 if name == "torque" else 0.0) for name in names
                } | {"mean": np.array(0.0), "delivered": np.array(0.0)}  # fmt: skip

    monkeypatch.setattr(forecast_module, "settled", lambda chain, values: chain)
    monkeypatch.setattr(forecast_module, "_parts", parts)
    chain = SimpleNamespace(speed=50.0, theta=np.zeros(4), swing=None)
    found = forecast_module.forecast(fit, chain, source, LoadKnowledge({}), {})  # type: ignore[arg-type]
    assert found.torque_std == pytest.approx(np.full(4, wanted), rel=0.25)
    assert np.max(found.shape_std) < 1e-9, "all of it is one constant"
    assert found.steps == steps
    assert torque is None or found.torque == pytest.approx(np.full(4, torque)), "the middle of what may be"
    texts = step_text(found)
    assert len(texts) == steps
    assert not texts or "Do not rely on the torque at 477.5 rpm" in texts[0]


def test_what_the_error_of_the_laws_is_not_added_to_is_as_unsure_as_the_fit_states(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The chamber had the narrow covariance of the torque, to which that error is added: 24 % of one inside 2 std."""
    source = FittedAt("a", 50.0, "land", 0.0, True)
    stated, shown = (ArrowCovariance.whole(np.diag([factor * 1e-34, 1.0])) for factor in (1.0, 0.04))
    fit = KnownFit(("leakage", "pressure_zero"), np.array([1e-15, 0.0]), stated, (source,) * 3, shown)
    names = ("torque", "pressure", "contact", "plunger_force", "angle", "flow", "cause pressure")

    def parts(chain: object, values: dict[str, float], lift: None) -> dict[str, np.ndarray]:
        moved = 1.0 + 1e17 * (values["leakage"] - 1e-15)
        means = {"mean": np.array(moved), "delivered": np.array(moved), "held": np.zeros(4)}
        return {name: np.full(4, moved) for name in names} | means

    monkeypatch.setattr(forecast_module, "settled", lambda chain, values: chain)
    monkeypatch.setattr(forecast_module, "_parts", parts)
    chain = SimpleNamespace(speed=50.0, theta=np.zeros(4), swing=None)
    found = forecast_module.forecast(fit, chain, source, LoadKnowledge({}), {})  # type: ignore[arg-type]
    assert found.torque_std == pytest.approx(np.full(4, 0.2), rel=0.25)
    assert found.mean_std == pytest.approx(0.2, rel=0.25)
    for std in (found.pressure_std, found.contact_std, found.by_cause_std["pressure"], [found.delivered_std]):
        assert std == pytest.approx(np.full(len(std), 1.0), rel=0.25)


def test_a_friction_at_rest_widens_the_contact_force_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest 60 N of packing carry anything within 60 N; the force there had been 60 N off with a band of 8."""
    source = FittedAt("a", 50.0, "land", 0.0, True)
    fit = KnownFit(("leakage", "pressure_zero"), np.array([1e-15, 0.0]),
                   ArrowCovariance.whole(np.diag([1e-36, 1.0])), (source,) * 3)  # fmt: skip
    names = ("torque", "pressure", "contact", "plunger_force", "angle", "flow")
    rests = np.array([60.0, 60.0, 0.0, 0.0])
    monkeypatch.setattr(forecast_module, "settled", lambda chain, values: chain)
    monkeypatch.setattr(forecast_module, "_parts", lambda chain, values, lift: {
        **{name: np.full(4, 100.0 + 1e17 * values["leakage"]) for name in names}, "held": rests,
        "mean": np.array(100.0), "delivered": np.array(1.0)})  # fmt: skip
    chain = SimpleNamespace(speed=50.0, theta=np.zeros(4), swing=None)
    found = forecast_module.forecast(fit, chain, source, LoadKnowledge({}), {})  # type: ignore[arg-type]
    assert found.contact_std == pytest.approx(np.hypot(found.pressure_std, rests / np.sqrt(3.0)))
    assert found.pressure_std == pytest.approx(found.pressure_std[0])


def test_a_run_behind_a_wheel_is_shown_over_cam_angle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the speed swings, curves over time lay up to degrees beside those of the recording."""
    theta = angle_grid(1800)
    lead = 0.05 * np.sin(theta)  # over cam angle
    swing = Swing(lead, lead, 1)
    source = FittedAt("a", 50.0, "land", 0.0, True)
    fit = KnownFit(("leakage", "pressure_zero"), np.array([1e-15, 0.0]),
                   ArrowCovariance.whole(np.diag([1e-34, 1.0])), (source,) * 3)  # fmt: skip
    cam = swing.cam(1800)
    names = ("torque", "pressure", "contact", "plunger_force", "flow", "cause pressure")

    def parts(chain: object, values: dict[str, float], lift: None) -> dict[str, np.ndarray]:
        size = 1.0 + 1e16 * values["leakage"]
        return {name: size * (2.0 + np.cos(4.0 * cam)) for name in names} | {
            "angle": cam + 0.1, "held": 0.0 * cam, "mean": np.array(0.0), "delivered": np.array(0.0)}  # fmt: skip

    monkeypatch.setattr(forecast_module, "settled", lambda chain, values: chain)
    monkeypatch.setattr(forecast_module, "_parts", parts)
    chain = SimpleNamespace(speed=50.0, theta=theta, swing=swing)
    found = forecast_module.forecast(fit, chain, source, LoadKnowledge({}), {})  # type: ignore[arg-type]
    shape = 2.0 + np.cos(4.0 * theta)
    curves = (found.torque, found.pressure, found.contact, found.plunger_force, found.flow, found.by_cause["pressure"])
    for values in (*curves, found.pressure_std, found.contact_std, found.by_cause_std["pressure"]):
        assert values / values[0] == pytest.approx(shape / 3.0, abs=1e-4)
    assert np.argmax(found.torque_std) % 450 == pytest.approx(0, abs=1)
    assert found.true_angle == pytest.approx(theta + 0.1, abs=1e-5)


def test_the_lift_correction_moves_the_torque_by_slope_times_contact_force(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing else of the chain is real here: 1 kN and 10 um over a spline of 0.1 rad."""
    knots = 0.1 * np.arange(14)
    lift = SharedLift(knots, 1e-5 * (np.arange(10) == 4), np.full(10, 2e-4))
    theta = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    given = {
        "torque": np.zeros(400), "load": np.full(400, 1e3), "motion": SimpleNamespace(theta=theta),
        "linear": np.zeros((400, 1)), "pressure": np.zeros(400), "flows": np.zeros((400, 4)),
    }  # fmt: skip
    output = make_dataclass("Output", given)(**given)
    monkeypatch.setattr(forecast_module, "settled", lambda chain, values: chain)
    monkeypatch.setattr(forecast_module, "evaluate", lambda chain, values: output)
    monkeypatch.setattr(forecast_module, "cam_torques", lambda chain, values, output, linear, slope: ({
        "pressure": np.full(400, 20.0), "lift_table": output.load * slope}, np.zeros(400)))  # fmt: skip
    monkeypatch.setattr(forecast_module, "measured_torques", lambda chain, values, cam, zero: {
        **cam, "torque_zero": np.zeros(400)})  # fmt: skip
    monkeypatch.setattr(forecast_module, "contact_load", lambda chain, values, output, linear, force: (
        output.load, output.load, np.zeros(400)))  # fmt: skip
    monkeypatch.setattr(forecast_module, "stroke_volume", lambda *values: 0.0)
    pump = SimpleNamespace(plunger_area=5e-5)
    chain = SimpleNamespace(speed=50.0, theta=theta, swing=None, line_pressure=None, uses_chamber=False, pump=pump)

    def run(lift: SharedLift | None) -> forecast_module.Forecast:
        fit = replace(known([1e-9] * 3), values=np.array([1e-15, 2.0]), lift=lift)
        return forecast_module.forecast(fit, chain, fit.recordings[1], LoadKnowledge({}), {})  # type: ignore[arg-type]

    plain, moved = run(None), run(lift)
    bump = np.trapezoid((moved.torque - plain.torque)[theta < 0.6], theta[theta < 0.6]) / 1e3
    assert bump == pytest.approx(1e-5 * 2.0 / 3.0, rel=0.02), "the height of the spline in its middle"
    assert np.max(np.abs(moved.torque - plain.torque)[theta > 0.8]) < 1e-9
    assert moved.by_cause["lift_table"] == pytest.approx(moved.torque - plain.torque)
    assert "lift_table" not in plain.by_cause
    assert moved.torque_std[(theta > 0.2) & (theta < 1.1)] == pytest.approx(0.2, rel=1e-3)
    assert np.max(moved.torque_std[theta > 1.3]) < 1e-6


@pytest.mark.parametrize("lobes", [1, 2, 3])
def test_a_stroke_of_a_cam_of_several_lobes_is_one_of_them(lobes: int) -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    flows = np.zeros((360, 4))
    flows[:, SEAT_FLOW] = 1e-6
    motion = SimpleNamespace(lift=np.array([1.0 - np.cos(lobes * theta)]))
    output = SimpleNamespace(flows=flows, states=np.full((360, 1), 10.0), motion=motion)
    values = {"bulk_modulus": 1.4e9, "bulk_modulus_slope": 9.0, "free_air": 0.0, "gallery_volume": 1e-7}
    chain = SimpleNamespace(speed=2.0 * np.pi)
    found = forecast_module.stroke_volume(chain, values, output)  # type: ignore[arg-type]
    assert found == pytest.approx(1e-6 / lobes)


def test_a_constant_of_the_band_is_no_part_of_its_shape() -> None:
    rng = np.random.default_rng(3)
    wave = np.sin(np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False))
    steady, moving = rng.standard_normal((2, DRAWS))
    shape = shape_of(5.0 * steady[:, None] + moving[:, None] * wave, np.ones(200)) / np.std(moving)
    assert shape == pytest.approx(np.abs(wave), abs=0.12)


def of_file(folder: Path, step_deg: float, curve: Curve | None = None) -> Curve:
    """Return a line pressure written with a point every so many degrees and read back."""
    angles = np.arange(0.0, 360.0, step_deg)
    pressure = np.interp(np.radians(angles), THETA, (curve or falling(0.8, 50.0)).pressure) / 1e5
    rows = "".join(f"{a:g},{p:.2f}\n" for a, p in zip(angles, pressure, strict=True))
    (folder / "p.csv").write_text(f"cam_angle_deg,pressure_bar\n{rows}")
    return replace(curve_through(read_pressure_curve(folder / "p.csv"), "p.csv"), speed=50.0)


def test_a_file_that_leaves_out_the_rise_at_the_zero_of_the_angle_is_refused() -> None:
    angles = np.arange(50.0, 360.0, 0.5)
    file = PressureCurve(np.radians(angles), 1e7 + 2e7 * np.exp(-(((angles - 50.0) / 20.0) ** 2)))
    with pytest.raises(Refusal, match="points 50 deg apart under load"):
        curve_through(file, "p.csv")


def test_points_too_far_apart_are_refused_as_that_and_not_for_what_is_known_between_them() -> None:
    def smooth(step_deg: float) -> Curve:
        angles = np.radians(np.arange(0.0, 360.0, step_deg))
        return curve_through(PressureCurve(angles, 6e6 + 5e7 * np.exp(-(((angles - 0.9) / 0.6) ** 2))), "p.csv")

    assert smooth(6.0).step == pytest.approx(np.radians(6.0))
    with pytest.raises(Refusal, match=r"points 8 deg apart under load, expected 6 deg or closer; give"):
        smooth(8.0)


def test_the_end_of_delivery_in_a_coarse_file_is_found_by_its_points_alone(tmp_path: Path) -> None:
    known_ends = [KnownEnd("a", 0.7, falling(0.7, 60.0))]
    for step_deg in (1.5, 3.0, 4.0):
        found = matched_end(known_ends, of_file(tmp_path, step_deg), RISING)
        assert found.angle == pytest.approx(0.8, abs=np.radians(0.4 * step_deg))


def test_few_points_that_look_like_an_end_at_two_places_leave_both_open() -> None:
    """Two falls alike, 15 degrees apart: the file has a point every 3 degrees, and one fall is the end."""
    known_ends = [KnownEnd(n, 0.8, falling(0.8, speed)) for n, speed in (("a", 55.0), ("b", 60.0))]
    both = 0.8 + np.radians([-7.5, 7.5])
    falls = [1.0 / (1.0 + np.exp((THETA - at) / 0.01)) for at in both]
    curve = Curve(THETA, 1e7 + 2e7 * np.sum(falls, axis=0), 50.0)
    step = np.radians(3.0)
    coarse = matched_end(known_ends, replace(curve, step=step, points=np.arange(0.0, 2.0 * np.pi, step)), RISING)
    assert np.all(np.abs(both - coarse.angle) < 1.96 * np.sqrt(coarse.variance))
    assert matched_end(known_ends, curve, RISING).variance == 0.0, "a recording is looked at point by point"


@pytest.mark.parametrize("place", [0.72, 0.95])
def test_of_two_falls_alike_the_one_where_others_end_is_the_end_of_delivery(place: float) -> None:
    known_ends = [KnownEnd(n, place + apart, falling(place + apart, 50.0)) for n, apart in (("a", 0.01), ("b", -0.01))]
    curve = Curve(THETA, 1e7 + 2e7 * sum(1.0 / (1.0 + np.exp((THETA - at) / 0.01)) for at in (0.7, 0.96)), 50.0)
    nearer = 0.7 if place < 0.83 else 0.96
    assert matched_end(known_ends, curve, RISING).angle == pytest.approx(nearer, abs=0.01)


@pytest.mark.parametrize("place", [0.55, 0.75, 1.2])
def test_an_end_of_delivery_where_none_was_before_is_found(place: float) -> None:
    known_ends = [KnownEnd(n, 0.8 + apart, falling(0.8, 50.0)) for n, apart in (("a", 0.0), ("b", 1e-3), ("c", -1e-3))]
    assert matched_end(known_ends, falling(place, 50.0), RISING).angle == pytest.approx(place, abs=0.01)


def test_what_a_coarse_file_blurs_is_learnt_at_the_same_time_between_points(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Curve] = []

    def matched(others: list[KnownEnd], curve: Curve, rising: np.ndarray) -> MatchedEnd:
        seen.append(curve)
        return MatchedEnd(0.8, 1e-4)

    monkeypatch.setattr(endings_module, "matched_end", matched)
    found = learned([0.8, 0.8, 0.8], step=np.radians(3.0), at=40.0)
    assert {round(curve.step / curve.speed, 9) for curve in seen} == {round(np.radians(3.0) / 40.0, 9)}
    assert found.stderr == pytest.approx(0.01, rel=0.05), "what the points of this file leave open is the least"


def test_coarse_points_of_a_file_widen_the_end_of_delivery_and_fine_ones_do_not(tmp_path: Path) -> None:
    names = ("end_of_delivery__a",)
    source = FittedAt("a", 50.0, "land", 0.01, True)
    fit = KnownFit(names, np.array([0.8]), ArrowCovariance.whole(1e-8 * np.eye(1)), (source,))
    law = SimpleNamespace(evaluate=lambda theta, order: np.sin(np.minimum(theta, np.pi)))
    chain = SimpleNamespace(theta=THETA, lobes=1, law=law)

    def end(curve: Curve) -> Estimate:
        return load_for(fit, source, {"a": falling(0.8, 50.0)}, chain, curve).ends["end_of_delivery"]  # type: ignore[arg-type]

    assert of_file(tmp_path, 3.0).step == pytest.approx(np.radians(3.0))
    fine, coarse = end(of_file(tmp_path, 0.25)), end(of_file(tmp_path, 2.8))
    assert [of_file(tmp_path, step).coarse for step in (0.5, 1.0)] == [False, True]
    assert not replace(of_file(tmp_path, 1.0), speed=75.0).coarse, "what is fine goes with the time between points"
    assert fine.value == pytest.approx(0.8, abs=0.01)
    assert fine.stderr == pytest.approx(float(UNKNOWN_STD))
    assert coarse.stderr > 1.2 * fine.stderr
    assert abs(coarse.value - 0.8) < 2.0 * coarse.stderr


def test_points_too_far_apart_in_time_to_show_an_end_are_refused(tmp_path: Path) -> None:
    source = FittedAt("a", 50.0, "land", 0.01, True)
    fit = KnownFit(("end_of_delivery__a",), np.array([0.8]), np.eye(1), (source,))
    coarse = replace(of_file(tmp_path, 4.0), speed=40.0)
    with pytest.raises(Refusal, match=r"points 4 deg apart under load, 1\.7 ms at 382 rpm, .* expected 1 ms"):
        load_for(fit, source, {"a": falling(0.8, 50.0)}, SimpleNamespace(), coarse)  # type: ignore[arg-type]


def ringing() -> Curve:
    """Return a line pressure with a wave that points 4 degrees apart cannot follow."""
    wave = np.where((THETA > 0.4) & (THETA < 1.6), 2e7 * (1.0 + 0.5 * np.sin(75.0 * THETA)), 1e6)
    return Curve(THETA, wave, 50.0)


def test_what_a_file_misses_between_its_points_is_told(tmp_path: Path) -> None:
    truth = ringing()
    curve = of_file(tmp_path, 1.0, truth)
    missed = np.abs(np.interp(curve.theta, truth.theta, truth.pressure) - curve.pressure)[100:450]
    told = curve.std[100:450]
    assert np.mean(missed < 2.0 * told) > 0.85
    assert np.sqrt(np.mean(told**2)) < 4.0 * np.sqrt(np.mean(missed**2))
    smooth = of_file(tmp_path, 1.0)
    assert np.max(smooth.std) < 0.02 * np.max(smooth.pressure)


@pytest.mark.parametrize("step_deg", [3.0, 8.0])
def test_a_file_that_leaves_its_pressure_to_guesses_is_refused(tmp_path: Path, step_deg: float) -> None:
    with pytest.raises(Refusal, match=f"found points {step_deg:g} deg apart .* give a point every half degree"):
        of_file(tmp_path, step_deg, ringing())


@pytest.mark.parametrize(("factor", "text"), [
    (1e5, r"pressure_bar reaches 2e\+07 bar, expected 10000 bar or less; give bar, not Pa or kPa"),
    (0.1, r"found a highest pressure of 20 bar, where the fitted recordings have 200 to 300 bar, .* check the unit"),
    (0.0, "found no pressure above 0 bar, expected that of a delivery"),
])  # fmt: skip
def test_a_pressure_in_another_unit_is_refused(tmp_path: Path, factor: float, text: str) -> None:
    curve = Curve(THETA, np.where((THETA > 0.4) & (THETA < 1.6), 2e7, 0.0), 50.0)
    fitted = [curve, replace(curve, pressure=1.5 * curve.pressure)]
    refuse_other_load(curve, fitted, "p.csv")
    with pytest.raises(Refusal, match=text):
        refuse_other_load(of_file(tmp_path, 0.5, replace(curve, pressure=factor * curve.pressure)), fitted, "p.csv")


def test_angles_in_radians_or_turns_are_refused(tmp_path: Path) -> None:
    rows = "".join(f"{angle:.4f},100\n" for angle in np.linspace(0.0, 6.28, 200))
    (tmp_path / "p.csv").write_text(f"cam_angle_deg,pressure_bar\n{rows}")
    with pytest.raises(Refusal, match=r"spans 6\.28 deg, expected a revolution, .* give degrees, not radians or turns"):
        read_pressure_curve(tmp_path / "p.csv")


def test_a_load_beyond_the_fitted_ones_is_told() -> None:
    assert beyond_text(2.1e7, (2e7, 3e7)) == beyond_text(3.2e7, (2e7, 3e7)) == ()
    (text,) = beyond_text(3.5e7, (2e7, 3e7))
    assert "reaches 350 bar, those of the fitted recordings 200 to 300 bar" in text


def test_a_load_that_rises_elsewhere_than_the_fitted_ones_is_told() -> None:
    curve = Curve(THETA, np.where((THETA > 0.4) & (THETA < 1.6), 2e7, 0.0), 50.0)
    assert rise_angle(curve) == pytest.approx(0.4, abs=0.01)
    turned = replace(curve, pressure=np.roll(curve.pressure, -round(0.5 / (THETA[1] - THETA[0]))))
    assert rise_angle(turned) == pytest.approx(2.0 * np.pi - 0.1, abs=0.01), "a rise across the zero is one rise"
    fitted = rise_range([curve, replace(curve, pressure=np.roll(curve.pressure, 3))])
    assert elsewhere_text(rise_angle(curve), fitted) == ()
    (text,) = elsewhere_text(rise_angle(curve) - np.radians(5.0), fitted)
    assert "before its angle is checked: it begins to rise at 17.8 deg" in text
    steady = replace(curve, pressure=np.full(THETA.size, 2e7))
    assert np.isnan(rise_angle(steady))
    assert elsewhere_text(rise_angle(steady), fitted) == elsewhere_text(0.4, rise_range([steady])) == ()
    around = rise_range([turned, replace(turned, pressure=np.roll(turned.pressure, 60))])
    assert np.ptp(around) == pytest.approx(np.radians(12.0), abs=0.01), "across the zero"
    assert elsewhere_text(0.02, around) == ()
    assert elsewhere_text(3.0, around)


def test_a_line_pressure_that_the_chamber_does_not_reach_is_refused() -> None:
    curve = Curve(THETA, np.where((THETA > 0.4) & (THETA < 1.6), 2e7, 0.0), 50.0)
    refuse_below_line(curve, 0.9 * curve.pressure, "p.csv")
    with pytest.raises(Refusal, match=r"p\.csv: with a line pressure of up to 200 bar .* reaches 140 bar only"):
        refuse_below_line(curve, 0.7 * curve.pressure, "p.csv")


def test_assumptions_stand_in_the_order_of_the_runs() -> None:
    runs = [SimpleNamespace(assumed=("Laws.", "At 900 rpm.")), SimpleNamespace(assumed=("Laws.", "At 1400 rpm."))]
    assert assumed_of(runs) == ["Laws.", "At 900 rpm.", "At 1400 rpm."]  # type: ignore[arg-type]


def test_what_python_prints_of_predicted_runs_is_a_line() -> None:
    items = (SimpleNamespace(torque=np.array([1.0, 61.26]), speed=50.0 * np.pi / 3.0),)
    assert repr(Found(items, {})) == "<Found 61.26 N m at 500 rpm>"  # type: ignore[arg-type]


def test_clearance_changes_leakage_by_its_third_power() -> None:
    assert leakage_factor("+1um") == pytest.approx(1.25**3)
    assert leakage_factor("2um+1µm") == pytest.approx(1.5**3)
    for text in ("1mm", "+1.2.3um", "+.um", "1..2um+1um"):
        with pytest.raises(Refusal, match="expected a change such as"):
            leakage_factor(text)
    with pytest.raises(Refusal, match="expected a known clearance above 0 um"):
        leakage_factor("0um+1um")
    with pytest.raises(Refusal, match="leaves no clearance"):
        leakage_factor("-5um")


@pytest.mark.parametrize(("options", "text"), [
    ({"load_of": "a", "pressure": Path("b.csv")}, "found two loads, --load-of a and --pressure b.csv"),
    ({"clearance": "+1000um"}, r"--clearance: \+1000um makes a leakage of 1\.5.e\+07 mm\^3/s/bar, expected 200"),
])  # fmt: skip
def test_two_loads_and_a_leakage_that_no_pump_has_are_refused(
    options: dict[str, Any], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = replace(known([0.1]), values=np.array([1e-14, 2.0]))
    monkeypatch.setattr(predict_flow, "read_fit", lambda path: FinishedFit(fit, tmp_path, []))
    with pytest.raises(Refusal, match=text):
        predict_flow.predict_from(tmp_path, [500.0], **options)


def test_a_prediction_names_the_files_that_it_rests_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "fit.json").write_text("{}")
    fit = replace(known([0.1]), recordings=())
    monkeypatch.setattr(predict_flow, "read_fit", lambda path: FinishedFit(fit, tmp_path, []))
    monkeypatch.setattr(predict_flow, "_at_speed", lambda *rest: (None, ()))
    monkeypatch.setattr(predict_flow, "forecast_document", lambda items, forces, origin: origin)
    found = predict_flow.predict_from(tmp_path, [500.0], cam=SHEETS / "cam_A.csv").document["inputs"]
    assert [Path(row["path"]).name for row in found] == ["fit.json", "cam_A.csv"]
    assert found[1]["sha256"] == file_digest(SHEETS / "cam_A.csv")
    found = predict_flow._inputs((tmp_path / "fit.json", None), BENCH)
    assert {"fit.json", "recording.toml", "A_1000rpm_all.tdms"} < {Path(row["path"]).name for row in found}


@pytest.mark.parametrize(("options", "kept"), [
    ({}, True), ({"cam": Path("cam.csv")}, False), ({"pump": Path("pump.toml")}, False), ({"clearance": "+1um"}, True),
])  # fmt: skip
def test_the_lift_correction_goes_with_the_fitted_cam_and_with_no_other(
    options: dict[str, Any], kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lift = SharedLift(np.arange(8.0), np.full(4, 2e-6), np.zeros(4))
    fit = replace(known([0.1]), values=np.array([1e-15, 2.0]), recordings=(), lift=lift)
    taken: list[KnownFit] = []
    monkeypatch.setattr(predict_flow, "read_fit", lambda path: FinishedFit(fit, tmp_path, []))
    monkeypatch.setattr(predict_flow, "_at_speed", lambda known, *rest: taken.append(known) or (None, ()))
    monkeypatch.setattr(predict_flow, "forecast_document", lambda *parts: {})
    monkeypatch.setattr(predict_flow, "_inputs", lambda *paths: [])
    predict_flow.predict_from(tmp_path, [500.0], **options)
    assert (taken[0].lift is lift) == kept
    texts = assumptions(taken[0], FittedAt("a", 50.0, "land", 0.1, True), "that of a", "", None)
    assert any("corrected by up to 2 µm, as all fitted recordings require" in text for text in texts) == kept
    exact = replace(taken[0], lift=replace(lift, values=np.zeros(4)))
    said = assumptions(exact, FittedAt("a", 50.0, "land", 0.1, True), "that of a", "", None)
    assert not any("The lift table is corrected" in text for text in said), "by up to 0 µm"


def test_a_fit_that_leaves_its_recording_unexplained_is_refused(tmp_path: Path) -> None:
    (tmp_path / "fit.json").write_text(json.dumps(run_fit_document(run_result(explained=False))), encoding="utf-8")
    with pytest.raises(Refusal, match=r"its model leaves .* unexplained, expected a fit whose intervals"):
        read_fit(tmp_path)


def test_of_a_recording_that_a_joint_fit_leaves_unexplained_nothing_is_taken(tmp_path: Path) -> None:
    row = run_fit_document(run_result())["recordings"][0]
    own = {"names": ["torque_zero__A"], "through": [[0.0, 0.0]], "rest": [[1.0]]}
    rows = [
        {**row, "id": name, "explained": explained, "own": {**own, "names": [f"torque_zero__{name}"]}}
        for name, explained in (("A", True), ("B", False), ("C", True))
    ]
    doc = {
        **run_fit_document(run_result()), "recordings": rows, "stderr": [1e4, 1e-9, 0.1, 0.2, 0.3],
        "names": ["feed_pressure", "dead_volume", "torque_zero__A", "torque_zero__B", "torque_zero__C"],
        "values": [2e5, 4e-7, 0.1, 0.2, 0.3],
    }  # fmt: skip
    (tmp_path / "fit.json").write_text(json.dumps(doc))
    fit, _, left = read_fit(tmp_path)
    assert [item.id for item in fit.recordings] == [item["id"] for item in left] == ["A", "C"]
    assert fit.names == ("feed_pressure", "dead_volume", "torque_zero__A", "torque_zero__C")
    np.testing.assert_allclose(np.sqrt(np.diag(fit.matrix)), [1e4, 1e-9, 0.1, 0.3])
    said = assumptions(fit, fit.recordings[0], "that of A", "", None)
    assert "Nothing is taken from B: the fit does not explain it." in said
    several = assumptions(replace(fit, unexplained=("B", "D")), fit.recordings[0], "that of A", "", None)
    assert "Nothing is taken from B, D: the fit does not explain them." in several


def test_a_fit_of_another_version_is_refused(tmp_path: Path) -> None:
    doc = run_fit_document(run_result())
    (tmp_path / "fit.json").write_text(json.dumps({**doc, "names": ["feed_pressure", "twist_damping__A"]}))
    with pytest.raises(Refusal, match="holds twist_damping__A, expected parameters of this version"):
        read_fit(tmp_path)


def test_fit_file_holds_values_in_si_with_their_covariance(tmp_path: Path) -> None:
    doc = run_fit_document(run_result())
    assert doc["names"] == ["feed_pressure", "dead_volume"]
    assert doc["values"][0] == pytest.approx(1.7e5)
    (tmp_path / "fit.json").write_text(json.dumps({**doc, "stderr": [1e4, 1e-9]}))
    (tmp_path / "result.json").write_text("{}")
    fit, folder, _ = read_fit(tmp_path / "result.json")
    assert folder == tmp_path
    with pytest.raises(Refusal, match=r"runs: found no fit\.json there, nor such a path, expected the report of"):
        read_fit(tmp_path / "runs")
    (tmp_path / "fit.json").unlink()
    (tmp_path / "campaign.json").touch()
    with pytest.raises(
        Refusal, match=r"a campaign without a joint fit .* take the report of one recording, in its runs"
    ):
        read_fit(tmp_path)
    assert fit.covariance.among([0, 1])[0, 1] == pytest.approx(0.4 * 1e4 * 1e-9)
    assert fit.recordings[0].id == "case"


@pytest.mark.parametrize(("content", "text"), [
    (None, r"found no fit\.json"), ("{", "not valid JSON"), ('{"schema": "other"}', "expected camtorque.fit/1; name"),
])  # fmt: skip
def test_a_fit_that_cannot_be_read_is_refused(tmp_path: Path, content: str | None, text: str) -> None:
    if content is not None:
        (tmp_path / "fit.json").write_text(content)
    with pytest.raises(Refusal, match=text):
        read_fit(tmp_path)


@pytest.mark.parametrize(("words", "text"), [
    ([], "found neither PUMP nor --from"), (["pump.toml", "--from", "report"], "found both PUMP and --from"),
    (["pump.toml", "--clearance", "+1um"], "found --clearance without --from"),
    (["pump.toml", "--load-of", "x", "--pump", "y"], "found --load-of, --pump without --from"),
    (["--from", "report", "--method", "denoc"], "found --method with --from"),
    (["--from", "report", "--tolerance", "0.001"], "found --tolerance with --from"),
])  # fmt: skip
def test_options_that_do_not_go_together_are_refused(words: list[str], text: str) -> None:
    parsed = build_parser().parse_args(["predict", *words, "--speed", "500"])
    with pytest.raises(Refusal, match=text):
        execute(parsed, lambda line: None)


def copied_report(folder: Path) -> tuple[Path, dict[str, Path]]:
    """Return a report of an example's copy, and the files of the copy that a prediction reads."""
    root = Path(__file__).resolve().parents[2]
    names = ("raw_examples/A_1000rpm/recording.toml", "calibration/cam_A.csv", "calibration/torque_T22-40117.toml")
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(root / name, folder / name)
    inputs = [{"path": str(folder / name), "sha256": file_digest(folder / name)} for name in names]
    (folder / "cycles.h5").touch()
    (folder / "result.json").write_text(json.dumps({"schema": "camtorque.result/1", "inputs": inputs}))
    return folder, {Path(name).stem: folder / name for name in names}


def test_a_bench_knows_whether_it_has_teeth(tmp_path: Path) -> None:
    report, files = copied_report(tmp_path)
    assert not rig_of(report).has_teeth
    text = files["recording"].read_text(encoding="utf-8").replace("pulses_per_rev = 1", "pulses_per_rev = 60")
    files["recording"].write_text(text, encoding="utf-8")
    inputs = [{"path": str(path), "sha256": file_digest(path)} for path in files.values()]
    (report / "result.json").write_text(json.dumps({"schema": "camtorque.result/1", "inputs": inputs}))
    assert rig_of(report).has_teeth


@pytest.mark.parametrize("name", ["recording", "cam_A", "torque_T22-40117"])
def test_what_has_changed_since_the_fit_is_not_predicted_with(tmp_path: Path, name: str) -> None:
    """A plunger of 8.5 mm for 8 in recording.toml had turned 63.6 N m into 73.4, without a word."""
    report, files = copied_report(tmp_path)
    rig_of(report, None, None)
    with files[name].open("a") as file:
        file.write("\n")
    with pytest.raises(
        Refusal, match=rf"other content in .*{files[name].name} than it was made of .*, expected the same; make"
    ):
        rig_of(report, None, None)


def test_a_cam_that_is_not_used_may_have_changed(tmp_path: Path) -> None:
    report, files = copied_report(tmp_path)
    other = shutil.copy(files["cam_A"], tmp_path / "other.csv")
    files["cam_A"].write_text("gone")
    assert rig_of(report, None, other).table.theta.size
    for named in (report, report / "result.json"):
        with pytest.raises(Refusal, match="other content in"):
            refuse_load_of_another_pump(named, [])


def test_a_cam_of_other_lobes_does_not_run_under_the_load_of_the_fitted_one(tmp_path: Path) -> None:
    """One lobe under the line pressure of three strokes came out with 3e13 N m."""
    report, _ = copied_report(tmp_path)
    angles = np.arange(0.0, 360.0)
    lift = 8.0 * np.sin(np.radians(angles)) ** 2  # the stroke of the fitted one, twice
    cam = tmp_path / "two.csv"
    cam.write_text("cam_angle_deg,lift_mm\n" + "".join(f"{a:g},{y:.4f}\n" for a, y in zip(angles, lift, strict=True)))
    rig, other = rig_of(report), rig_of(report, None, cam)
    refuse_other_strokes(rig, rig, cam)
    with pytest.raises(Refusal, match=r"two\.csv: found a cam of 2 lobes, expected 1 as the fitted one"):
        refuse_other_strokes(rig, other, cam)
    with pytest.raises(Refusal, match="mm, 1 a revolution, expected 8 mm and 8 mm, 2 a revolution as the"):
        refuse_load_of_another_pump(BENCH, [other])


def test_a_cam_whose_table_is_turned_does_not_run_under_the_load_of_the_fitted_one(tmp_path: Path) -> None:
    """Its chamber came out with 2530 bar for 1393."""
    report, files = copied_report(tmp_path)
    lift = np.loadtxt(files["cam_A"], delimiter=",", skiprows=2)[:, 1]
    for turned, name in ((30, "late.csv"), (8, "near.csv"), (-40, "early.csv")):
        rig, cam, moved = rig_of(report), tmp_path / name, np.roll(lift, turned)
        other = replace(rig, table=replace(rig.table, lift=moved))
        if turned == 8:
            refuse_other_strokes(rig, other, cam)
            continue
        begins = rf"found a lift that begins at {(8 + turned) % 360} deg, expected about 8 as of the fitted cam"
        with pytest.raises(Refusal, match=begins):
            refuse_other_strokes(rig, other, cam)


def test_a_load_of_the_line_is_none_of_a_fit_in_the_chamber(tmp_path: Path) -> None:
    """The line's 736 bar went on the plunger where its chamber has 1153: a third less torque, without a word."""
    line, files = copied_report(tmp_path / "line")
    chamber, others = copied_report(tmp_path / "chamber")
    text = files["recording"].read_text(encoding="utf-8").replace("high-pressure line, pump end", "chamber")
    others["recording"].write_text(text, encoding="utf-8")
    result = json.loads((chamber / "result.json").read_text())
    result["inputs"][0]["sha256"] = file_digest(others["recording"])
    (chamber / "result.json").write_text(json.dumps(result))
    for load, fitted, words in ((line, chamber, "line.* of the chamber"), (chamber, line, "chamber.* of the line")):
        refuse_load_of_another_place(load, [load])
        with pytest.raises(Refusal, match=f"found a pressure of the {words} as in .* correct location"):
            refuse_load_of_another_place(load, [load, fitted])


def test_the_report_of_a_load_may_be_named_by_its_result(tmp_path: Path) -> None:
    write_run(run_result(), tmp_path)
    for named in (tmp_path, tmp_path / "result.json"):
        name, curve = load_curve(named)
        assert (name, round(curve.speed, 3), float(np.max(curve.pressure))) == (
            "case",
            105.0,
            pytest.approx(9e7, rel=1e-4),
        )


@pytest.mark.parametrize("side", ["cam", "motor"])
def test_a_run_under_the_load_of_a_wheel_turns_as_its_wheel_measured(tmp_path: Path, side: str) -> None:
    """A twist rebuilt on top of the measured angle put the run of a soft shaft 4.4 N m of 50 off itself."""
    report, files = copied_report(tmp_path)
    text = files["recording"].read_text(encoding="utf-8").replace("[trigger]", f'[trigger]\nside = "{side}"')
    files["recording"].write_text(text, encoding="utf-8")
    result = json.loads((report / "result.json").read_text())
    result["inputs"][0]["sha256"] = file_digest(files["recording"])
    (report / "result.json").write_text(json.dumps(result))
    ahead = 0.01 * np.cos(3.0 * THETA)
    with h5py.File(report / "cycles.h5", "w") as file:
        file["theta"], file["mean/pressure"] = THETA, falling(1.0, 105.0).pressure
        file["mean/angle_deviation"], file["mean/wheel_orders"] = ahead, [8]
    curve = curve_of(report, 105.0)
    # ends of delivery, rises and another cam's pressure are looked for at its cam angles
    assert np.array_equal(curve.pressure, falling(1.0, 105.0).pressure)
    chain = chain_of(rig_of(report, None, None), 105.0, curve, "land")
    assert chain.swing is not None
    assert chain.swing.order == (2 if side == "cam" else 0)
    top = falling(1.0, 105.0).pressure.argmax()
    late = 0.01 * np.cos(3.0 * THETA[top])
    assert THETA[top] - chain.theta[chain.line_pressure.argmax()] == pytest.approx(late, abs=2.0 * np.pi / 1800)
    with h5py.File(report / "cycles.h5", "a") as file:
        del file["mean/angle_deviation"]
    assert curve_of(report, 105.0).swing is None


def test_another_pump_or_cam_than_the_fitted_one_is_held_against_itself(tmp_path: Path) -> None:
    report, _ = copied_report(tmp_path)
    text = (SHEETS / "pump_A.toml").read_text(encoding="utf-8").replace("cam_A.csv", str(SHEETS / "cam_A.csv"))
    (pump := tmp_path / "other.toml").write_text(text.replace("follower_mass_kg = 0.075", "follower_mass_kg = 0.75"))
    for other, told in ((SHEETS / "pump_A.toml", False), (pump, True)):
        assert ("pump_unusual" in {row.code for row in rig_of(report, other, None).findings}) == told
    rows = (SHEETS / "cam_A.csv").read_text(encoding="utf-8").splitlines()
    lifts = (f"{angle},{10.0 * float(lift)}" for angle, lift in (row.split(",") for row in rows[2:]))
    (cam := tmp_path / "cam.csv").write_text("\n".join([*rows[:2], *lifts]))
    with pytest.raises(Refusal, match="largest lift over base circle radius is 4"):
        rig_of(report, None, cam)
