"""A strain gauge bridge that no amplifier has scaled: its output over its supply in mV/V, with what a sheet states."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camtorque import cli
from camtorque.config import ChannelSpec, SensorRef
from camtorque.ingest import read_recording
from camtorque.ingest.raw import ArraySource, RawChannel
from camtorque.ingest.sensitivity import over_supplies
from camtorque.ingest.sensors import read_sensor
from camtorque.records import Refusal

FULL = {"unit": "N m", "nominal_range": (-200.0, 200.0), "bridge_sensitivity": 1.5}
GAIN = {"unit": "N m", "unit_per_mV_per_V": 400.0 / 3.0}


def sensor(sheet: dict[str, Any], before: float | None = None, after: float | None = None, output: str = "mV/V"):
    keys = {"group_delay": 0.4e-3, "accuracy_percent_fs": 0.1, **sheet}
    reference = SensorRef("torque", "", None, None, None, zero_before=before, zero_after=after, sheet=keys)
    return read_sensor(reference, output, 1.2).calibration


@pytest.mark.parametrize("sheet", [FULL, GAIN, FULL | GAIN], ids=["full scale", "gain", "both"])
def test_output_at_full_scale_and_gain_say_the_same(sheet: dict[str, Any]):
    calibration = sensor({**sheet, "bridge_zero": 0.012})
    assert calibration.gain * (0.762 - calibration.zero_volts) == pytest.approx(100.0)
    assert (calibration.output_min_volts, calibration.output_max_volts) == (-math.inf, math.inf)


def test_standstill_readings_count_in_the_unit_of_the_channel():
    assert sensor(FULL, 0.02, 0.03).zero_volts == pytest.approx(0.025)
    assert sensor(FULL, 20.0, 30.0, "uV/V").zero_volts == pytest.approx(0.025)
    assert sensor(FULL, 0.02, 0.03).zero_source == "standstill"


def test_a_zero_that_cannot_be_is_told_in_its_own_unit():
    keys = {"group_delay": 0.4e-3, "accuracy_percent_fs": 0.1, **FULL}
    reference = SensorRef("torque", "", None, None, None, zero_before=0.4, zero_after=0.5, sheet=keys)
    texts = {finding.code: finding.text for finding in read_sensor(reference, "mV/V").findings}
    assert "the zero was 0.4 mV/V before and 0.5 mV/V after the run" in texts["zero_readings_apart"]
    assert "zero_off_certificate" in texts


@pytest.mark.parametrize(
    ("sheet", "output", "message"),
    [
        ({"unit": "N m"}, "mV/V", "nothing says what a mV/V means; give unit with sensitivity_mV_per_V"),
        ({"unit": "N m", "bridge_sensitivity": 1.5}, "mV/V", r"\(output at the upper end\) and nominal_range"),
        (GAIN | {"unit": ""}, "mV/V", "nothing says what a mV/V means"),
        (FULL | {"unit_per_mV_per_V": 100.0}, "mV/V", r"100, but 1.5 mV/V at 200 are 133.3 per mV/V"),
        (FULL | {"sensitivity_V_per_unit": 0.05}, "mV/V", "sensitivity_V_per_unit: is about an output in V, the chann"),
        (
            FULL | {"output_range": (-10.0, 10.0)},
            "mV/V",
            "output_range_V: is about an output in V, the channel is in m",
        ),
        (FULL | {"zero_tolerance": 0.1}, "mV/V", "zero_tolerance_V: is about an output in V, the channel is in mV/V"),
        (FULL, "V", "sensitivity_mV_per_V: is about an output in mV/V, the channel is in V; correct its unit"),
    ],
)
def test_what_a_bridge_means_is_never_guessed(sheet: dict[str, Any], output: str, message: str):
    with pytest.raises(Refusal, match=message):
        sensor(sheet, output=output)


@pytest.mark.parametrize("column", ["output_mV/V", "output_mV_per_V"])
def test_a_certificate_of_a_bridge_is_read_for_a_channel_in_its_unit(tmp_path: Path, column: str):
    points = "0,0.01\n100,0.76\n200,1.51\n"
    (tmp_path / "t.csv").write_text(f"# T-0001, k=2 uncertainty 0.1 %\napplied_torque_N m,{column}\n{points}")
    text = '[sensor]\nserial = "T-0001"\nquantity = "torque"\nunit = "N m"\nnominal_range = [-200, 200]\n'
    (tmp_path / "t.toml").write_text(text + 'group_delay_s = 4e-4\ncertificate = "t.csv"\n')
    reference = SensorRef("torque", "T-0001", tmp_path / "t.toml", None, None)
    calibration = read_sensor(reference, "mV/V").calibration
    assert (calibration.gain, calibration.zero_volts) == (pytest.approx(400.0 / 3.0), pytest.approx(0.01))
    with pytest.raises(Refusal, match="unit 'mV/V' is a bridge output, expected a voltage unit"):
        read_sensor(reference, "V")


def filled(text: str, zero: str) -> str:
    text = re.sub(r"\[pump\].*?(?=\n\[)", "", text, count=1, flags=re.DOTALL).replace('_deg = "?"', "_deg = 1.0")
    text = text.replace('pump_id = "?"', "").replace('nominal_range = "?"', "nominal_range = [-200, 200]")
    return text.replace('sensitivity_mV_per_V = "?"', f"sensitivity_mV_per_V = 2.0\nzero_before = {zero}")


def test_from_a_log_in_millivolts_per_volt_to_newton_metres(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    rate, turn = 10e3, 2.0 * np.pi * 10.0 * np.arange(6000) / 10e3
    torque, volts = 60.0 * np.maximum(np.sin(turn), 0.0) ** 2, 5.0 * (turn % (2.0 * np.pi) < 0.3)
    rows = [
        f"{n / rate:.4f},{t / 200.0 * 2.0 + 0.03:.6f},{v:.1f}"
        for n, (t, v) in enumerate(zip(torque, volts, strict=True))
    ]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["time [s],Md / mV/V,trigger [V]", *rows]) + "\n")
    assert cli.main(["new", str(file)]) == 0
    toml = tmp_path / "recording.toml"
    text = toml.read_text()
    assert re.search(r'unit = "N m".*\nnominal_range = "\?".*\nsensitivity_mV_per_V = "\?"', text)
    toml.write_text(filled(text, "0.03"))
    np.testing.assert_allclose(read_recording(tmp_path).of("torque")[0].read(), torque, atol=1e-3)
    toml.write_text(toml.read_text().replace("zero_before = 0.03", "zero_before_V = 0.03"))
    with pytest.raises(Refusal, match=r"the channel is in mV/V, the zero of \[sensors.torque\] in V; give it as"):
        read_recording(tmp_path)


def bench(folder: Path, supply: np.ndarray) -> np.ndarray:
    """Write a bridge in mV with its supply, which sags; return the torque [N m]."""
    rate, turn = 10e3, 2.0 * np.pi * 10.0 * np.arange(6000) / 10e3
    torque, pulses = 60.0 * np.maximum(np.sin(turn), 0.0) ** 2, turn % (2.0 * np.pi) < 0.3
    columns = zip(torque / 200.0 * 2.0 * supply, supply, pulses, strict=True)
    rows = [f"{n / rate:.4f},{t:.9f},{u:.6f},{v:d}" for n, (t, u, v) in enumerate(columns)]
    (folder / "log.csv").write_text("\n".join(["time [s],Md [mV],U_exc [V],trigger", *rows]) + "\n")
    return torque


def test_millivolts_over_a_recorded_supply_are_taken_sample_by_sample(tmp_path: Path, capsys):
    torque = bench(tmp_path, 5.0 - 0.5 * np.arange(6000) / 6000)
    assert cli.main(["new", str(tmp_path / "log.csv")]) == 0
    toml = tmp_path / "recording.toml"
    text = toml.read_text()
    assert re.search(r'unit = "mV".*\n.*\n.*\nsupply_channel = "U_exc"', text)
    toml.write_text(filled(text, "0.0"))
    np.testing.assert_allclose(read_recording(tmp_path).of("torque")[0].read(), torque, atol=1e-3)
    edited = toml.read_text()
    toml.write_text(edited.replace("zero_before = ", "zero_before_V = "))
    with pytest.raises(Refusal, match=r"the channel is in mV/V, the zero of \[sensors.torque\] in V"):
        read_recording(tmp_path)
    toml.write_text(edited.replace('supply_channel = "U_exc"', 'supply_channel = "trigger"'))
    with pytest.raises(Refusal, match=r"supply_channel 'trigger': is 0 V in the median, expected the supply of a bri"):
        read_recording(tmp_path)
    toml.write_text(edited.replace('unit = "mV"', 'unit = "N m"'))
    with pytest.raises(Refusal, match=r"supply_channel: unit of the bridge: unit 'N m' is a torque, expected a volt"):
        read_recording(tmp_path)


def test_a_supply_of_other_samples_is_refused():
    spec = ChannelSpec("torque", Path("log.tdms"), "", "Md", "mV", "L", 1e4, "", supply_channel="U")
    bridge, supply = (RawChannel(n, "", ArraySource(np.ones(size)), 0.0, rate) for n, size, rate in
                      (("Md", 1000, 1e4), ("U", 10, 100.0)))  # fmt: skip
    with pytest.raises(Refusal, match=r"10 samples at 100 Hz from 0 s on, the bridge has 1000 at 10000 Hz .* export"):
        over_supplies((spec,), (bridge, supply))
