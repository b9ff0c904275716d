"""Sensors stated in recording.toml itself, values that the logger has scaled, channels of other quantities."""

import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.ingest import read_recording, summarise
from camtorque.ingest.raw import ArraySource, RawChannel
from camtorque.ingest.recording import _span
from camtorque.ingest.zeros import zero_of_readings
from camtorque.records import Refusal
from camtorque.units import BAR
from damaged.logs import CALIBRATION, Plan, clean_log, write_folder

LOG = clean_log(revolutions=6.0)
SHEET = f"""serial = "T22-40117"
calibration = "{CALIBRATION.as_posix()}/torque_T22-40117.toml"
zero_before_V = 0.0299
zero_after_V = 0.0301
"""
PRESSURE_SHEET = f"""serial = "K4067-40117"
calibration = "{CALIBRATION.as_posix()}/pressure_K4067-40117.toml"
zero_before_V = 0.0099
zero_after_V = 0.0101
"""
INLINE = 'unit = "N m"\nsensitivity_V_per_unit = 0.025\nzero_V = 0.03\ngroup_delay_s = 0.00045\ncutoff_hz = 1000\n'


def recording(tmp_path: Path, *edits: tuple[str, str]):
    return read_recording(write_folder(tmp_path / "r", [LOG], Plan("csv", edits=edits)))


def codes(read) -> set[str]:
    return {finding.code for finding in read.findings}


def test_a_sensor_may_be_stated_in_the_recording(tmp_path: Path):
    stated = recording(tmp_path, (SHEET, INLINE), ('sensor = "T22-40117"\n', ""))
    channel = stated.of("torque")[0]
    assert np.allclose(channel.read(), (channel.read_volts() - 0.03) / 0.025, rtol=0.0, atol=1e-12)
    calibration = channel.calibration
    assert calibration is not None
    assert (calibration.delay, calibration.cutoff_hz, calibration.zero_volts) == (0.00045, 1000.0, 0.03)
    # nobody stated how exact it is
    assert calibration.gain_relative_std == pytest.approx(0.01 / math.sqrt(3.0))
    assert "accuracy_assumed" in codes(stated)


def test_a_stated_accuracy_is_used_and_nothing_is_assumed(tmp_path: Path):
    exact = INLINE + "accuracy_percent_fs = 0.1\nnominal_range = [-200, 200]\noutput_range_V = [-5, 5]\n"
    stated = recording(tmp_path, (SHEET, exact), ('sensor = "T22-40117"\n', ""))
    calibration = stated.of("torque")[0].calibration
    assert calibration is not None
    assert calibration.gain_relative_std == pytest.approx(0.001 / math.sqrt(3.0))
    assert calibration.zero_std == pytest.approx(0.001 * 200.0 / math.sqrt(3.0))
    assert (calibration.range_max, calibration.output_max_volts) == (200.0, 5.0)
    assert "accuracy_assumed" not in codes(stated)


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ('unit = "N m"\n', "nothing says what a volt means"),
        ("sensitivity_V_per_unit = 0.025\n", "nothing says what a volt means"),
        ('unit = "bar"\nsensitivity_V_per_unit = 0.025\n', "unit 'bar' is a pressure, expected a torque unit"),
        ('unit = "N m"\nsensitivity_V_per_unit = 0\n', "not 0"),
        (SHEET + "cutoff_hz = 500\n", "is given beside the sheet"),
    ],
)
def test_half_a_sensor_is_refused(tmp_path: Path, sensor: str, message: str):
    with pytest.raises(Refusal, match=message):
        recording(tmp_path, (SHEET, sensor), ('sensor = "T22-40117"\n', ""))


BAR_UNIT = ('channel = "Line_Pressure"\nunit = "V"', 'channel = "Line_Pressure"\nunit = "bar"')


def scaled_log(tmp_path: Path, pressure: str) -> Path:
    """A log whose pressure is in bar already."""
    log = LOG.with_volts("pressure", 200.0 * LOG.volts["pressure"])
    edits = ((PRESSURE_SHEET, pressure), BAR_UNIT)
    folder = write_folder(tmp_path / "r", [log], Plan("parquet", edits=edits))
    file = folder / "DAQ1.parquet"
    table = pq.read_table(file)
    fields = [f.with_metadata({"unit": "bar"}) if f.name == "Line_Pressure" else f for f in table.schema]
    pq.write_table(pa.table(table.columns, schema=pa.schema(fields)), file)
    return folder


def test_scaled_values_need_no_sheet_and_what_is_assumed_is_told(tmp_path: Path):
    read = read_recording(scaled_log(tmp_path, 'location = "pump end"\n'))
    channel = read.of("pressure")[0]
    calibration = channel.calibration
    assert calibration is not None
    assert np.allclose(channel.read(), 200.0 * BAR * LOG.volts["pressure"])
    assert {"already_scaled", "accuracy_assumed", "delay_assumed"} <= codes(read)
    assert (calibration.delay, calibration.delay_std) == (25e-6, pytest.approx(25e-6 / math.sqrt(3.0)))
    assert summarise(read_recording(tmp_path / "r")).channels[1].high == pytest.approx(channel.read().max())


def test_stray_samples_are_no_part_of_a_range_that_nobody_states():
    """Its accuracy is a share of the range: samples of 9999 bar had made a pressure of 900 bar known to 100."""
    found = {}
    for name, stray in (("clean", slice(0)), ("stray", slice(500, 510))):
        volts = LOG.volts["pressure"].copy()
        volts[stray] = 9999.0 / 200.0
        found[name] = _span(RawChannel("p", "bar", ArraySource(200.0 * volts), 0.0, 20e3), BAR)
    assert found["clean"] == BAR * 200.0 * LOG.volts["pressure"].max()
    assert 0.5 * found["clean"] < found["stray"] <= found["clean"]


def test_the_zero_of_scaled_values_is_in_their_unit(tmp_path: Path):
    read = read_recording(scaled_log(tmp_path, "zero_before = 1.5\nzero_after = 2.5\naccuracy_percent_fs = 0.3\n"))
    channel = read.of("pressure")[0]
    assert np.allclose(channel.read(), BAR * (200.0 * LOG.volts["pressure"] - 2.0))
    largest = float(200.0 * LOG.volts["pressure"].max())
    _, std = zero_of_readings([1.5, 2.5], 1e-5 * largest, 0.003 * largest)
    assert channel.calibration.zero_std == pytest.approx(std * BAR)


def test_channels_beside_torque_and_pressure(tmp_path: Path):
    channels = """
[[channels]]
quantity = "{quantity}"
file = "extra.csv"
channel = "x"
unit = "{unit}"
logger = "DAQ1"
sample_rate_hz = 1000.0
"""
    values = {
        "fuel_temperature": ("degC", 40.0, 313.15),
        "housing_temperature": ("degF", 104.0, 313.15),
        "gallery_pressure": ("bar", 3.0, 3e5),
        "needle_lift": ("um", 250.0, 250e-6),
        "shaft_speed": ("1/min", 600.0, 62.83185307),
        "delivered_volume": ("mm^3", 120.0, 120e-9),
        "angle": ("deg", 180.0, np.pi),
        "index": ("logic", 1.0, 1.0),
    }
    for quantity, (unit, value, si) in values.items():
        folder = write_folder(tmp_path / quantity, [LOG], Plan("csv"))
        rows = "".join(f"{n / 1000:.3f},{value}\n" for n in range(6000))
        (folder / "extra.csv").write_text(f"time,x\ns,{unit}\n{rows}", encoding="utf-8")
        toml = folder / "recording.toml"
        toml.write_text(toml.read_text() + channels.format(quantity=quantity, unit=unit), encoding="utf-8")
        channel = read_recording(folder).of(quantity)[0]
        assert np.allclose(channel.read(), si, rtol=1e-9), quantity
    assert set(values) < set(CHANNEL_QUANTITIES)


def test_a_unit_of_another_quantity_names_the_legal_ones(tmp_path: Path):
    with pytest.raises(
        Refusal, match=r"unit 'mm' is a length, expected a torque unit or voltage unit or bridge output unit \(V, .*N m"
    ):
        recording(tmp_path, ('channel = "Torque"\nunit = "V"', 'channel = "Torque"\nunit = "mm"'))


def test_a_log_of_another_pump_is_told(tmp_path: Path):
    file = tmp_path / "cam_FIP-B.csv"
    file.write_text("# lift of FIP-B\n" + (CALIBRATION / "cam_A.csv").read_text())
    read = recording(tmp_path, (f"{CALIBRATION.as_posix()}/cam_A.csv", file.as_posix()))
    assert "lift_table_of_other_pump" in codes(read)
    assert "lift_table_of_other_pump" not in codes(recording(tmp_path))


def test_groups_of_an_mf4_keep_their_own_time(tmp_path: Path):
    asammdf = pytest.importorskip("asammdf")
    folder = write_folder(tmp_path / "r", [LOG], Plan("mf4"))
    slow = slice(0, None, 4)
    with asammdf.MDF(version="4.10") as mdf:
        for name, part in (("Torque", slow), ("Line_Pressure", slice(None)), ("Prox_Trigger", slice(None))):
            quantity = {"Torque": "torque", "Line_Pressure": "pressure", "Prox_Trigger": "trigger"}[name]
            signal = asammdf.Signal(LOG.volts[quantity][part], LOG.times[part], unit="V", name=name)
            mdf.append([signal], acq_name="Rec", common_timebase=False)
        mdf.save(folder / "DAQ1.mf4", overwrite=True)
    toml = folder / "recording.toml"
    toml.write_text(toml.read_text().replace("sample_rate_hz = 10000.0", "sample_rate_hz = 2500.0", 1))
    read = read_recording(folder)
    assert [c.sample_rate for c in read.channels] == pytest.approx([2500.0, 10000.0, 10000.0])
    assert np.array_equal(read.of("torque")[0].read_volts(), LOG.volts["torque"][slow])
