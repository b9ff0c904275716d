"""The public face: lazy, complete, documented; arrays become a recording; results become tables."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import camtorque
import numpy as np
import pandas as pd
import pytest
from camtorque import api
from camtorque.records import Finding
from report.report_cases import NASTY, run_result

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "raw_examples" / "A_1000rpm"


def in_fresh_python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture(scope="module")
def arrays() -> dict[str, np.ndarray]:
    recording = camtorque.read(EXAMPLE)
    return {quantity: recording.of(quantity)[0].read() for quantity in ("torque", "pressure", "trigger")}


@pytest.fixture(scope="module")
def pump_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = (EXAMPLE / "recording.toml").read_text(encoding="utf-8")
    table = text[text.index("[pump]") : text.index("[trigger]")]
    table = table.replace("../../calibration", (ROOT / "calibration").as_posix())
    path = tmp_path_factory.mktemp("pump") / "pump.toml"
    path.write_text(f'schema = "camtorque-pump/1"\n{table}', encoding="utf-8")
    return path


RATES = {"torque": 20e3, "pressure": 100e3, "trigger": 50e3}
KNOWN = {
    "torque": camtorque.Sensor(
        gain_std=5e-4, zero_std=0.05, delay=4.5e-4, delay_std=1e-5, cutoff_hz=1000.0, filter_order=2
    ),
    "pressure": camtorque.Sensor(gain_std=1e-3, zero_std=2e5, delay=4e-6, delay_std=1e-6),
}


def recording(pump_file: Path, arrays: dict[str, np.ndarray], **changes: object) -> camtorque.Recording:
    given = {
        "sample_rate": RATES,
        "speed_rpm": 1000.0,
        "trigger_angle_deg": 20.0,
        "trigger_delay": 4e-5,
        "sensors": KNOWN,
        **arrays,
        **changes,
    }
    return camtorque.Recording.from_arrays(pump_file, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize(("known", "delay"), [({}, 0.5e-3), ({"cutoff_hz": 100.0}, 2.295e-3)])
def test_a_delay_that_nobody_states_is_no_shorter_than_the_low_pass(
    pump_file: Path, arrays: dict[str, np.ndarray], known: dict[str, float], delay: float
) -> None:
    found = recording(pump_file, {**arrays, "sensors": {**KNOWN, "torque": camtorque.Sensor(**known)}})
    sheet = found.of("torque")[0].calibration
    assert sheet is not None
    assert (sheet.delay, sheet.delay_std) == pytest.approx((delay, delay / np.sqrt(3.0)), rel=1e-3)


def test_what_a_sensor_of_arrays_leaves_open_is_told(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    def told(**known: float) -> list[str]:
        found = recording(pump_file, arrays, sensors={**KNOWN, "torque": camtorque.Sensor(**known)})
        return [row.text for row in found.findings if row.code in ("low_pass_assumed", "delay_assumed")]

    delay, low_pass = told()
    assert delay == "nothing states the delay of the torque sensor; 0.5 ms ± 100 % is assumed, give delay in its Sensor"
    assert low_pass.startswith(
        "nothing states the low-pass of the torque sensor; 1 kHz ± 100 % is assumed, give cutoff_hz"
    )
    assert told(delay=4.5e-4, cutoff_hz=1e3) == []


def test_a_sensor_of_arrays_says_that_it_sits_in_the_chamber(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    inside = replace(KNOWN["pressure"], location="plunger chamber")
    found = recording(pump_file, arrays, sensors={**KNOWN, "pressure": inside})
    assert found.config.measures_chamber
    assert "pressure_in_chamber" in {row.code for row in found.findings}
    assert not recording(pump_file, arrays).config.measures_chamber
    for place, far in (("high-pressure line, 174 mm from the pump end", True), ("line, 12 cm behind the pump", True),
                       ("line, 0,3 m downstream", True), ("line, 40 mm from the pump", False), ("pump end", False),
                       ("line of 2 mm bore, 300 mm long", False), ("plunger chamber, 80 mm up", False)):  # fmt: skip
        along = recording(pump_file, arrays, sensors={**KNOWN, "pressure": replace(inside, location=place)})
        told = [row for row in along.findings if row.code == "pressure_along_line"]
        assert bool(told) == far, place
        assert all("mm of line lie before the sensor, expected 50 mm or less" in row.text for row in told)
    with pytest.raises(camtorque.Refusal, match=r"Sensor location: found 3, expected words such as 'plunger chamber'"):
        camtorque.Sensor(location=3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("index", "refused"),
    [
        (lambda n: None, ""),
        (lambda n: np.arange(n) / 50e3, ""),
        (lambda n: np.arange(n) + 7, ""),
        (lambda n: 1.0 * np.arange(n), ""),
        (lambda n: np.round(np.arange(n) / 50e3, 4), ""),
        (lambda n: pd.date_range("2024-05-01", periods=n, freq="20us"), ""),
        (lambda n: pd.timedelta_range("1s", periods=n, freq="20us"), ""),
        (lambda n: list(map(str, range(n))), ""),
        (lambda n: np.arange(n)[::-1], "index that steps by -2e-05 s behind sample 0, expected 2e-05 s"),
        (lambda n: np.arange(n) + 3 * (np.arange(n) > 99), "8e-05 s behind sample 99, .* keep missing samples"),
        (lambda n: np.arange(n) / 50.0, "steps by 0.02 s, expected 2e-05 s at a sample_rate of 50000 Hz"),
    ],
)  # fmt: skip
def test_the_index_of_a_series_agrees_with_the_sample_rate(
    pump_file: Path, arrays: dict[str, np.ndarray], index: Callable[[int], Any], refused: str
) -> None:
    trigger = pd.Series(arrays["trigger"], index=index(arrays["trigger"].size))
    if refused:
        with pytest.raises(camtorque.Refusal, match=refused):
            recording(pump_file, {**arrays, "trigger": trigger})
    else:
        found = recording(pump_file, {**arrays, "trigger": trigger}).of("trigger")[0]
        assert np.array_equal(found.read(), arrays["trigger"], equal_nan=True)


def test_series_that_begin_apart_are_refused(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    """A trigger cut 0.5 ms later than the torque was laid over it as if both had begun at once."""
    series = {name: pd.Series(x, index=1.0 + np.arange(x.size) / RATES[name]) for name, x in arrays.items()}
    assert recording(pump_file, series).of("torque")[0].n_samples == arrays["torque"].size
    late = {**series, "trigger": series["trigger"].iloc[25:]}
    with pytest.raises(camtorque.Refusal, match=r"trigger: found an index that begins 0\.0005 s from that of "):
        recording(pump_file, late)
    assert recording(pump_file, {**late, "trigger": late["trigger"].to_numpy()})


def test_arrays_in_another_unit_and_sensors_of_another_name_are_told(
    pump_file: Path, arrays: dict[str, np.ndarray]
) -> None:
    with pytest.raises(camtorque.Refusal, match=r"the largest torque is .* N m, the largest pressure of .* bar gives"):
        recording(pump_file, {**arrays, "torque": 1e3 * arrays["torque"]})
    for factor, slip in ((1e-5, "bar read as Pa"), (1e-6, "MPa read as Pa"), (1e-3, "kPa read as Pa")):
        with pytest.raises(camtorque.Refusal, match=f"the pressure looks like {slip}.*: correct its unit; else"):
            recording(pump_file, {**arrays, "pressure": factor * arrays["pressure"]})
    low = recording(pump_file, {**arrays, "pressure": 3e-5 * arrays["pressure"]})
    assert [row.severity for row in low.findings if row.code == "torque_without_pressure"] == ["error"]
    volts = recording(pump_file, {**arrays, "pressure": 5e-8 * arrays["pressure"], "torque": 0.025 * arrays["torque"]})
    assert "pressure_weak" in {row.code for row in volts.findings}
    with pytest.raises(camtorque.Refusal, match="predict: found a pressure of type list, expected a CSV file"):
        camtorque.predict(ROOT / "calibration" / "paper_pump.toml", 500.0, pressure=[1e5, 2e5])  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="sensors: found 'Torque', expected 'torque' and 'pressure'"):
        recording(pump_file, arrays, sensors={"Torque": KNOWN["torque"]})
    with pytest.raises(camtorque.Refusal, match="report: found a Recording, expected what"):
        camtorque.report(recording(pump_file, arrays), "nowhere")  # type: ignore[arg-type]


def test_importing_the_package_loads_nothing() -> None:
    assert in_fresh_python("import sys, camtorque; print('numpy' in sys.modules, camtorque.__version__)") == (
        f"False {camtorque.__version__}"
    )


def test_functions_stay_in_place_beside_rooms_of_the_same_name() -> None:
    for name in camtorque.ROOMS_OF_THAT_NAME:
        importlib.import_module(f"camtorque.{name}")
        assert getattr(camtorque, name) is getattr(api, name)
        with pytest.raises(AttributeError, match="cannot be replaced"):
            setattr(camtorque, name, print)


def test_the_face_is_complete_typed_and_documented() -> None:
    assert {*camtorque.ELSEWHERE, "__version__"} < set(camtorque.__all__) == set(dir(camtorque))
    for name in {*camtorque.__all__} - {"__version__"}:
        item = getattr(camtorque, name)
        assert inspect.getdoc(item), name
        if inspect.isfunction(item):
            signature = inspect.signature(item)
            assert signature.return_annotation is not inspect.Signature.empty, name
            assert all(p.annotation is not p.empty for p in signature.parameters.values()), name
            assert all(p in (item.__doc__ or "") for p in signature.parameters), name
    with pytest.raises(AttributeError, match="no attribute 'fitt'; it has"):
        _ = camtorque.fitt  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_script_that_is_checked_strictly_knows_what_it_is_given(tmp_path: Path) -> None:
    """Every attribute of a recording was Any: its base came from the package, which finds names by itself."""
    pytest.importorskip("mypy")
    given = ("read('x')", "read('x').channels", "read('x').of('torque')[0].read()", "fit('x')", "fit('x').fitted",
             "align('x').torque", "predict('x', 3).shaft_torque", "own_fit('x')")  # fmt: skip
    lines = [f"reveal_type(camtorque.{text})" for text in given]
    (tmp_path / "client.py").write_text("\n".join(["import camtorque", *lines]), encoding="utf-8")
    here = {**os.environ, "PYTHONPATH": str(Path(camtorque.__file__).parents[1])}
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), "client.py"]
    done = subprocess.run(command, cwd=tmp_path, env=here, capture_output=True, text=True, check=False)
    told = [line for line in done.stdout.splitlines() if "Revealed type" in line]
    assert done.returncode == 0, done.stdout
    assert len(told) == len(given)
    assert not [line for line in told if line.endswith('is "Any"')]


def test_arrays_align_as_their_files_do(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    ours, theirs = camtorque.align(recording(pump_file, arrays)), camtorque.align(EXAMPLE)
    assert ours.index.size == theirs.index.size
    assert ours.torque is not None
    assert theirs.torque is not None
    np.testing.assert_allclose(ours.torque.mean(axis=0), theirs.torque.mean(axis=0), atol=1e-6)
    assert "sensor_assumed" not in {row.code for row in ours.findings}


def test_a_recording_without_a_pump_is_read_and_aligned(tmp_path: Path) -> None:
    folder = tmp_path / "raw" / "A"
    shutil.copytree(EXAMPLE, folder)
    shutil.copytree(ROOT / "calibration", tmp_path / "calibration")
    toml = folder / "recording.toml"
    text = toml.read_text(encoding="utf-8")
    toml.write_text(re.sub(r"\[pump\].*?(?=\n\[trigger\])", "", text, flags=re.DOTALL), encoding="utf-8")
    found = camtorque.read(folder)
    assert found.lift_table is None
    assert camtorque.align(found).index.size == camtorque.align(EXAMPLE).index.size
    with pytest.raises(camtorque.Refusal, match=r"the table \[pump\] with its cam_table is missing"):
        camtorque.fit(found)


def test_what_is_assumed_of_a_sensor_is_told(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    found = [row.text for row in recording(pump_file, arrays, sensors=None).findings if row.code == "sensor_assumed"]
    assert len(found) == 2
    assert "torque sensor; assumed: gain ± 1 %, zero ± 0.31 N m, delay 0.5 ms ± 100 %" in found[0]
    assert "zero ± 4.3 bar" in found[1]


def test_a_cam_drawn_by_sections_serves_too(arrays: dict[str, np.ndarray]) -> None:
    built = recording(ROOT / "calibration" / "paper_pump.toml", arrays)
    assert built.cam_table.lift.max() == pytest.approx(8e-3, rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"torque": np.zeros((2, 3))}, r"torque: found an array of shape \(2, 3\)"),
        ({"pressure": np.full(9, np.nan)}, "pressure: found no finite number among 9 samples"),
        ({"torque": ["a", "b"]}, "torque: found values of type <U1, expected real numbers in SI"),
        ({"pressure": np.full(9, 1j)}, "pressure: found values of type complex128"),
        ({"trigger_angle_deg": 4000.0}, "trigger_angle_deg: found 4000.0, expected a number from -360 to 360"),
        ({"sample_rate": {"torque": 1e4}}, "found no entry 'pressure'|found no entry 'trigger'"),
        ({"sample_rate": 0.0}, "sample_rate: found 0.0, expected a positive number"),
        (
            {"pressure": np.ones(9), "sample_rate": 1e4},
            "arrays at one sample_rate: found .* 9 of pressure.* expected as many of each",
        ),
        ({"speed_rpm": -1.0}, "speed_rpm: found -1.0, expected a number from 1 to 30000"),
        ({"name": " "}, "name: found ' ', expected a text"),
        ({"name": None}, "name: found None, expected a text"),
        ({"sample_rate": "20e3"}, "sample_rate: found '20e3', expected a positive number"),
        ({"trigger_tolerance_deg": -1.0}, "trigger_tolerance_deg: found -1.0, expected a number from 0 to 180"),
        ({"trigger_tolerance_deg": np.nan}, "trigger_tolerance_deg: found nan"),
        ({"speed_rpm": 6e4}, "speed_rpm: found 60000.0, expected a number from 1 to 30000"),
        ({"trigger_delay": 1.0}, r"trigger_delay \[s\]: found 1.0, expected a number from 0 to 0.005"),
        ({"trigger_delay": np.nan}, r"trigger_delay \[s\]: found nan"),
        ({"sensors": {"torque": 0.01}}, r"sensors\['torque'\]: found 0.01, expected a camtorque.Sensor"),
    ],
)
def test_arrays_that_cannot_be_used_are_refused(
    pump_file: Path, arrays: dict[str, np.ndarray], changes: dict[str, object], text: str
) -> None:
    with pytest.raises(camtorque.Refusal, match=text):
        recording(pump_file, arrays, **changes)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"gain_std": -0.01}, "Sensor gain_std: found -0.01, expected a number from 0 to 0.5"),
        ({"zero_std": np.nan}, "Sensor zero_std: found nan"),
        ({"delay": -4.5e-4}, r"Sensor delay \[s\]: found -0.00045, expected a number from 0 to 0.1"),
        ({"delay_std": 1.0}, r"Sensor delay_std \[s\]: found 1.0"),
        ({"cutoff_hz": 0.0}, "Sensor cutoff_hz: found 0.0, expected a positive number"),
        ({"cutoff_hz": None}, "Sensor cutoff_hz: found None, expected a positive number"),
        ({"filter_order": "four"}, "Sensor filter_order: found 'four'"),
        ({"filter_order": 2.5}, "Sensor filter_order: found 2.5, expected a whole number"),
    ],
)
def test_a_sensor_that_none_can_be_is_refused(changes: dict[str, object], text: str) -> None:
    with pytest.raises(camtorque.Refusal, match=text):
        camtorque.Sensor(**changes)  # type: ignore[arg-type]


def test_an_order_that_is_whole_is_a_whole_number() -> None:
    order = camtorque.Sensor(filter_order=4.0).filter_order  # type: ignore[arg-type]
    assert (order, type(order)) == (4, int)


def test_masked_samples_are_missing(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    masked = np.ma.masked_inside(np.arange(arrays["torque"].size), 30000, 30100)
    torque = np.ma.array(arrays["torque"], mask=masked.mask)
    cycles = camtorque.align(recording(pump_file, {**arrays, "torque": torque}))
    sound = camtorque.align(recording(pump_file, arrays))
    assert next(row.cycles for row in cycles.cut_flow if row.reason == "drop_out") == 1
    assert cycles.index.size == sound.index.size - 1


def test_infinite_samples_are_missing(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    torque = arrays["torque"].copy()
    torque[30_000:30_100] = np.inf
    cycles = camtorque.align(recording(pump_file, {**arrays, "torque": torque}))
    assert next(row.cycles for row in cycles.cut_flow if row.reason == "drop_out") == 1
    assert np.isfinite(cycles.torque).all()


def test_what_is_no_path_is_told_as_that(arrays: dict[str, np.ndarray]) -> None:
    for call in (camtorque.read, camtorque.align, camtorque.fit):
        with pytest.raises(camtorque.Refusal, match="found a value of type NoneType, expected the path of a recording"):
            call(None)  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="found a value of type int, expected the path of a recording"):
        camtorque.own_fit(3)  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="PressureCurve pressure: found no array of numbers, expected rad and"):
        camtorque.PressureCurve([0.0, 1.0], ["low", "high"])  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="found a value of type NoneType, expected the path of a pump file"):
        recording(None, arrays)  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="found a value of type int, expected the path of a pump file"):
        camtorque.predict(3, 500.0)  # type: ignore[arg-type]


def test_a_rate_in_khz_is_told_by_the_speed(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    rates = {name: 1e-3 * rate for name, rate in RATES.items()}
    slow = recording(pump_file, arrays, sample_rate=rates, sensors={}, trigger_delay=0.0)
    told = "a cam speed of 1 rpm, the nominal speed is 1000 rpm, 1000 times that; .* correct the sample rate"
    with pytest.raises(camtorque.Refusal, match=told):
        camtorque.align(slow)


def test_a_speed_that_pulses_and_sheet_state_otherwise_is_told(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    rates = {name: 0.1 * rate for name, rate in RATES.items()}
    slow = recording(pump_file, arrays, sample_rate=rates, sensors={}, trigger_delay=0.0)
    (text,) = (row.text for row in camtorque.align(slow).findings if row.code == "speed_off_nominal")
    assert text.startswith("the pulses give 100 rpm, the nominal speed is 1000 rpm; check nominal_speed_rpm, ")


ANGLE = np.radians(np.arange(0.0, 360.0, 2.0))
LOAD = np.where((ANGLE > 0.3) & (ANGLE < 1.0), 6.0e7, 5.0e5)


@pytest.mark.parametrize(
    ("theta", "pressure", "text"),
    [
        (np.degrees(ANGLE), LOAD, r"theta: found 0 to 358, expected angles .* one revolution \[rad\]; convert degrees"),
        (ANGLE[::-1], LOAD, "expected angles that increase strictly"),
        (ANGLE, LOAD[:9], r"theta of shape \(180,\) and pressure of shape \(9,\), expected"),
        (ANGLE, np.full(180, np.nan), "found values that are no finite numbers"),
        (ANGLE, 1e5 * LOAD, r"a pressure to 6e\+12, expected rad, .* and Pa up to"),
    ],
)
def test_a_pressure_curve_of_arrays_that_is_none_is_refused(theta: np.ndarray, pressure: np.ndarray, text: str) -> None:
    with pytest.raises(camtorque.Refusal, match=text):
        camtorque.predict(ROOT / "calibration" / "paper_pump.toml", 500.0, camtorque.PressureCurve(theta, pressure))


def test_a_pressure_curve_of_arrays_serves_as_one_of_a_file(tmp_path: Path) -> None:
    pump, file = ROOT / "calibration" / "paper_pump.toml", tmp_path / "load.csv"
    rows = np.column_stack([np.degrees(ANGLE), 1e-5 * LOAD])
    np.savetxt(file, rows, delimiter=",", header="cam_angle_deg,pressure_bar", comments="")
    lists = camtorque.predict(pump, [[300.0, 500.0]], camtorque.PressureCurve(list(ANGLE), list(LOAD)))  # type: ignore
    from_file = camtorque.predict(pump, [300.0, 500.0], file)
    np.testing.assert_allclose(lists.shaft_torque, from_file.shaft_torque)
    assert "pressure_weak" not in {row.code for row in from_file.findings}
    theta = ANGLE.copy()
    in_bar = camtorque.predict(pump, 500.0, camtorque.PressureCurve(theta, 1e-5 * LOAD))
    theta[0] = 0.0  # the caller's array stays his
    (text,) = (row.text for row in in_bar.findings if row.code == "pressure_weak")
    assert text.endswith("less than the spring with 110 N: is the pressure in its unit?")


def a_result() -> camtorque.Result:
    return camtorque.Result(**vars(run_result()))


def test_parameters_as_a_table() -> None:
    frame = a_result().to_pandas()
    assert frame.loc["feed_pressure", "value"] == 1.7
    assert frame.loc["feed_pressure", ["low95", "high95"]].tolist() == pytest.approx([1.1, 2.3])


def test_cycles_as_a_table() -> None:
    cycles = a_result().cycles
    frame = camtorque.to_pandas(cycles)
    assert frame.index.tolist() == cycles.index.tolist()
    assert frame["held_out"].sum() == cycles.held_out.sum()


def test_curves_with_units() -> None:
    result = a_result()
    data = result.to_xarray()
    assert data["model_fitted"].attrs["units"] == "N m"
    assert data["cycles_torque"].dims == ("cycle", "theta")
    assert set(data["cycles_role"].values.tolist()) == {"fitted", "held_out"}
    np.testing.assert_allclose(data["mean_torque"], result.cycles.torque.mean(axis=0), rtol=1e-13)
    assert "model_fitted" not in camtorque.to_xarray(result.cycles)


def test_a_prediction_over_speed() -> None:
    prediction = camtorque.predict(ROOT / "calibration" / "paper_pump.toml", [300.0, 500.0], n_theta=360)
    assert camtorque.to_pandas(prediction).index.tolist() == pytest.approx([300.0, 500.0])
    assert camtorque.to_xarray(prediction)["shaft_torque"].shape == (2, 360)


def test_other_things_have_no_table() -> None:
    for function in (camtorque.to_pandas, camtorque.to_xarray):
        with pytest.raises(TypeError, match="found str, expected a result, cycles or a prediction"):
            function("x")  # type: ignore[arg-type]


def test_a_notebook_shows_escaped_texts() -> None:
    shown = a_result()._repr_html_()
    assert NASTY not in shown
    assert "&lt;script&gt;" in shown
    assert "feed_pressure" in shown
    base = camtorque.read(EXAMPLE)
    told = api.Recording.of_record(replace(base, findings=(Finding("x", "warning", NASTY),)))._repr_html_()
    assert NASTY not in told
    assert "20000 Hz" in told


def test_what_python_prints_of_a_record_is_a_line() -> None:
    result = a_result()
    prediction = camtorque.predict(ROOT / "calibration" / "paper_pump.toml", [300.0, 500.0], n_theta=360)
    shown = [repr(item) for item in (camtorque.read(EXAMPLE), result, result.cycles, prediction)]
    assert "torque 3.00 s at 20000 Hz" in shown[0]
    assert "% of the peak rigid" in shown[1]
    assert f"{result.cycles.index.size} of {result.cycles.cycles_found} cycles" in shown[2]
    assert shown[3] == "<Prediction 300, 500 rpm, 360 angles>"
    assert all(len(text) < 200 for text in shown)


@pytest.mark.slow
def test_arrays_to_a_fit_in_ten_lines(pump_file: Path, arrays: dict[str, np.ndarray], tmp_path: Path) -> None:
    steps: list[str] = []
    result = camtorque.fit(recording(pump_file, arrays), progress=steps.append)
    assert result.fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak < 0.35
    assert result.document["recording"]["name"] == "arrays"
    assert len(steps) >= 3
    page = camtorque.report(result, tmp_path / "o")
    assert {"report.html", "result.json", "cycles.h5"} <= {path.name for path in page.parent.iterdir()}


@pytest.mark.parametrize("name", [name for name in camtorque.__all__ if name != "__version__"])
def test_everything_of_the_face_is_documented(name: str) -> None:
    item = getattr(camtorque, name)
    told = inspect.getdoc(item) or ""
    if not isinstance(item, type):
        assert all(f"\n{head}\n---" in told for head in ("Parameters", "Returns", "Raises"))
        names = [*inspect.signature(item).parameters]
    else:
        names = [field.name for field in fields(item)] if is_dataclass(item) else []
    listed = re.findall(r"^[\w, ]+(?= : )", told, re.MULTILINE)
    assert set(names) <= {part.strip() for line in listed for part in line.split(",")}


def test_a_refusal_in_python_speaks_of_no_option(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("x", encoding="utf-8")
    with pytest.raises(camtorque.Refusal, match=r"^output .*: found a folder with other files in it"):
        camtorque.report(a_result(), tmp_path)


def test_arguments_of_another_type_are_refused(pump_file: Path, arrays: dict[str, np.ndarray]) -> None:
    with pytest.raises(camtorque.Refusal, match="found options of type AlignOptions, expected camtorque"):
        camtorque.fit(recording(pump_file, arrays), camtorque.AlignOptions())  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match=r"RunOptions: found a str, expected a camtorque\.Limit"):
        camtorque.RunOptions(limits=("parameters.leakage.value",))  # type: ignore[arg-type]
    alone = camtorque.Limit("parameters.leakage.value", 0.0, 1.0)
    with pytest.raises(camtorque.Refusal, match=r"found limits of type Limit, expected a tuple of camtorque\.Limit"):
        camtorque.RunOptions(limits=alone)  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="found parameter 'leakge', did you mean 'leakage'"):
        camtorque.RunOptions(limits=(camtorque.Limit("parameters.leakge.value", 0.0, 1.0),))
    with pytest.raises(camtorque.Refusal, match="predict: found the speed 'fast', expected numbers in rpm"):
        camtorque.predict(pump_file, "fast")  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="sensors: found a Sensor, expected one by name"):
        recording(pump_file, arrays, sensors=camtorque.Sensor())  # type: ignore[arg-type]
    with pytest.raises(camtorque.Refusal, match="found a value of type NoneType, expected the path of the folder of a"):
        camtorque.report(a_result(), None)  # type: ignore[arg-type]
