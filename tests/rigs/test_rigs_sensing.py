"""Sensors, nominal alignment and files of the rig say what they should."""

import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import h5py
import numpy as np
import pytest
from nptdms import TdmsFile

from rigs.cycles import as_cycles, mean_cycle
from rigs.families import bare, negative_rotation, sensor_only
from rigs.rig import simulate
from rigs.sense import torque_reading, torque_signal, trigger_edges, wheel_edges
from rigs.truth import DEGREE, NO_SCATTER, RigTruth, change
from rigs.write import LAYOUTS, RATES, write_recording

TWO_PI = 2.0 * np.pi


@pytest.fixture(scope="module")
def run():
    return simulate(RigTruth(), 800.0, n_cycles=6, seed=2)


def test_low_pass_against_its_transfer_function():
    truth = change(RigTruth(), scatter=NO_SCATTER)
    truth = change(truth, driveline__drive_inertia=np.inf)
    steady = simulate(truth, 1000.0, n_cycles=2)
    n, w = 3600, 1000.0 * TWO_PI / 60.0
    times = np.arange(n) / n * TWO_PI / w
    start = steady.time[np.argmax(steady.history["cam_angle"] > 0.0)]
    torque = np.interp(start + times, steady.time, steady.history["torque"])
    reading = np.interp(start + times, steady.time, torque_reading(steady))
    s = 1j * w * np.fft.rfftfreq(n, 1.0 / n)
    w0, z = TWO_PI * truth.torque_sensor.cutoff_hz, truth.torque_sensor.damping
    expected = np.fft.irfft(np.fft.rfft(torque) * w0**2 / (s**2 + 2.0 * z * w0 * s + w0**2), n)
    # linear interpolation of both between samples of 0.06 degrees
    assert np.abs(reading - expected).max() < 2e-4 * torque.max()


def test_declared_delay_is_the_delay_of_a_slow_signal(run):
    signal = torque_signal(run, 20e3)
    volts_per_unit, zero = run.truth.torque_sensor.volts_per_unit, run.truth.torque_sensor.zero
    torque = signal.volts / volts_per_unit - zero
    use = (signal.times > 0.05) & (signal.times < run.time[-1] - 0.05)
    lags = np.arange(0.3e-3, 0.6e-3, 1e-6)
    n = int(1.0e-3 / (run.time[1] - run.time[0]))
    slow = np.convolve(run.history["torque"], np.ones(n) / n, "same")
    slow_reading = np.convolve(torque, np.ones(20) / 20, "same")
    miss = [np.std(slow_reading[use] - np.interp(signal.times[use] - lag, run.time, slow)) for lag in lags]
    # both are smoothed over 1 ms (about one sample of either uncertain), so that the group delay at low frequency shows
    assert lags[np.argmin(miss)] == pytest.approx(0.45e-3, abs=0.03e-3)


def test_bare_rig_is_aligned_exactly():
    steady = simulate(bare(np.random.default_rng(1)), 1000.0, n_cycles=3)
    cycles = as_cycles(steady, noise=False)
    assert cycles["torque"].shape == cycles["pressure"].shape == (3, 3600)
    np.testing.assert_allclose(cycles["true_angle"], np.broadcast_to(cycles["theta"], (3, 3600)), atol=1e-6)
    np.testing.assert_allclose(cycles["speed"], 1000.0 * TWO_PI / 60.0, rtol=1e-6)
    truth = steady.true_cycles("torque")
    # 20 kHz samples, cubic between them: a kink of the port laws may fall inside one sample of 0.3 degrees
    assert np.abs(cycles["torque"] - truth).max() < 5e-3 * truth.max()
    assert np.sqrt(np.mean((cycles["torque"] - truth) ** 2)) < 5e-4 * truth.max()


def test_trigger_offset_shows_in_the_true_angle():
    truth = change(sensor_only(np.random.default_rng(4)), trigger__angle_offset=0.8 * DEGREE)
    cycles = as_cycles(simulate(truth, 1000.0, n_cycles=2), noise=False)
    # constant speed: the nominal angle is off by exactly the mounting offset
    np.testing.assert_allclose(cycles["true_angle"] - cycles["theta"], 0.8 * DEGREE, atol=1e-6)


def test_cycles_scatter_as_on_a_bench(run):
    cycles = as_cycles(run)
    peak = cycles["torque"].mean(axis=0).max()
    scatter = cycles["torque"].std(axis=0, ddof=1)
    assert 0.0005 < np.sqrt(np.mean(scatter**2)) / peak < 0.005
    mean = mean_cycle(run)
    np.testing.assert_allclose(mean["torque"], cycles["torque"].mean(axis=0))
    assert mean["chamber_pressure"].max() > mean["pressure"].max()


def test_same_seed_same_run_other_seed_other_run():
    first, again, other = (simulate(RigTruth(), 1000.0, n_cycles=1, seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.history["torque"], again.history["torque"])
    assert not np.array_equal(first.history["torque"], other.history["torque"])


def test_negative_rotation_reads_negative_volts(tmp_path):
    backwards = simulate(negative_rotation(np.random.default_rng(0)), 1000.0, n_cycles=2)
    volts = torque_signal(backwards, 20e3).volts
    assert abs(volts.min()) > volts.max()
    assert as_cycles(backwards)["torque"].max() > 30.0
    written = write_recording(backwards, tmp_path / "back", "hdf5")
    assert tomllib.loads((written.folder / "recording.toml").read_text())["recording"]["rotation"] == "negative"


def read_log(path, group, name):
    """Return (start, rate, volts) of one channel with the plainest reader of its format."""
    if path.suffix == ".tdms":
        channel = TdmsFile.read(path)[group][name]
        return channel.properties["wf_start_offset"], 1.0 / channel.properties["wf_increment"], channel.data
    if path.suffix == ".h5":
        with h5py.File(path) as file:
            attributes = file[group].attrs
            return attributes["t0_s"], attributes["sample_rate_hz"], file[group][name][:]
    if path.suffix == ".mf4":
        asammdf = pytest.importorskip("asammdf")
        with asammdf.MDF(path) as mdf:
            signal = mdf.get(name)
            return signal.timestamps[0], 1.0 / np.diff(signal.timestamps).mean(), signal.samples
    raw = path.read_bytes().decode("cp1252" if b"\xfc" in path.read_bytes()[:200] else "utf-8-sig")
    separator = ";" if ";" in raw else ("\t" if "\t" in raw else ",")
    lines = [line for line in raw.splitlines() if line[0] not in "#%M"]
    names = lines[0].split(separator)
    rows = [line.replace(",", ".") if separator != "," else line for line in lines[2:]]
    table = np.array([[float(cell) for cell in row.split(separator)] for row in rows])
    return table[0, 0], (len(table) - 1) / (table[-1, 0] - table[0, 0]), table[:, names.index(name)]


CASES = [
    *((file_format, layout, "comma") for file_format in ("csv", "tdms", "hdf5", "mf4") for layout in LAYOUTS),
    ("csv", "single", "semicolon"),
    ("csv", "single", "tab"),
]


@pytest.mark.parametrize(("file_format", "layout", "dialect"), CASES)
def test_written_edges_are_the_true_edges(run, tmp_path, file_format, layout, dialect):
    written = write_recording(run, tmp_path / "r", file_format, layout, dialect, seed=3)
    sheet = tomllib.loads((written.folder / "recording.toml").read_text(encoding="utf-8"))
    assert {channel["quantity"] for channel in sheet["channels"]} == set(RATES)
    for channel in sheet["channels"]:
        start, rate, volts = read_log(written.folder / channel["file"], channel["group"], channel["channel"])
        assert rate == pytest.approx(channel["sample_rate_hz"], rel=1e-3)
        if channel["quantity"] != "trigger":
            assert np.ptp(volts) > 1.0
            continue
        clock = written.clocks[channel["logger"]]
        up = np.flatnonzero((volts[:-1] < 2.5) & (volts[1:] >= 2.5))
        crossing = start + (up + (2.5 - volts[up]) / (volts[up + 1] - volts[up])) / channel["sample_rate_hz"]
        true = clock.start + (crossing - clock.reading_at_start) / (1.0 + clock.skew)
        nearest = written.edges[np.argmin(np.abs(written.edges[:, None] - true), axis=0)]
        # one sample (20 us) hides where inside it the 20 us edge was
        assert np.abs(true - nearest).max() < 1.2 / channel["sample_rate_hz"]
        assert abs(np.mean(true - nearest)) < 0.5 / channel["sample_rate_hz"]


def test_relative_clock_maps_one_logger_on_the_other(run, tmp_path):
    written = write_recording(run, tmp_path / "r", "tdms", "independent", skew_ppm=60.0)
    offset, skew = written.relative_clock("LOGGER_B", "LOGGER_A")
    a, b = written.clocks["LOGGER_A"], written.clocks["LOGGER_B"]
    on_a, on_b = ((1.0 + c.skew) * (written.edges - c.start) + c.reading_at_start for c in (a, b))
    np.testing.assert_allclose(on_b, offset + (1.0 + skew) * on_a, atol=1e-12)
    assert skew == pytest.approx(60e-6, rel=1e-3)


def test_standstill_readings_may_be_missing(run, tmp_path):
    written = write_recording(run, tmp_path / "r", "tdms", standstill=False)
    sheet = tomllib.loads((written.folder / "recording.toml").read_text())
    assert "zero_before_V" not in sheet["sensors"]["torque"]
    with_zero = write_recording(run, tmp_path / "s", "tdms")
    sheet = tomllib.loads((with_zero.folder / "recording.toml").read_text())
    expected = run.truth.torque_sensor.volts_per_unit * run.truth.torque_sensor.zero
    assert sheet["sensors"]["torque"]["zero_before_V"] == pytest.approx(expected, abs=2e-3)


def test_trigger_edges_are_where_the_tooth_passes(run):
    trigger = run.truth.trigger
    times = trigger_edges(run) - trigger.switching_delay
    angle = np.interp(times, run.time, run.history["cam_angle"])
    turns = (angle - trigger.nominal_angle - trigger.angle_offset) / TWO_PI
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-7)


def test_wheel_lacks_its_missing_teeth_and_starts_at_the_reference_tooth():
    truth = change(bare(np.random.default_rng(0)), trigger__pulses_per_rev=60, trigger__missing_teeth=2)
    steady = simulate(truth, 1000.0, n_cycles=2)
    edges, reference = wheel_edges(steady), trigger_edges(steady)
    gaps = np.diff(edges) / (60.0 / 1000.0 / 60.0)
    np.testing.assert_allclose(gaps, np.round(gaps), atol=1e-6)
    np.testing.assert_allclose(edges[1:][np.round(gaps) == 3.0], reference[-np.sum(np.round(gaps) == 3.0) :], atol=1e-9)
    assert set(np.round(gaps)) == {1.0, 3.0}


@pytest.mark.parametrize("ramp", [-0.2, 0.3])
def test_a_ramp_changes_the_speed_by_as_much(ramp):
    # a drive at its set speed: the cam follows but for the twist
    truth = change(RigTruth(), scatter=NO_SCATTER, driveline__drive_inertia=np.inf)
    ramped = simulate(truth, 1000.0, n_cycles=10, ramp=ramp)
    periods = np.diff(trigger_edges(ramped))
    # the first and the last period are themselves a tenth of the ramp long
    assert periods[0] / periods[-1] == pytest.approx(1.0 + ramp, abs=1.5 * abs(ramp) / 10.0)
    assert as_cycles(ramped)["torque"].shape[0] == 10


def test_crosstalk_adds_pressure_and_bearing_load(run):
    foreign = {"torque_sensor__pressure_crosstalk": 4e-9, "torque_sensor__bending_crosstalk": 5e-5}
    crossed = replace(run, truth=change(run.truth, **foreign))
    extra = torque_reading(crossed) - torque_reading(run)
    history = run.history
    expected = 4e-9 * history["line_pressure"] + 5e-5 * history["bearing_along"]
    # the low-pass keeps the mean over the run to its own settling time over the run's length
    assert extra[2000:].mean() == pytest.approx(expected[2000:].mean(), rel=1e-3)
    assert extra.max() > 0.2


def test_hysteresis_opens_a_loop_of_its_width(run):
    looped = replace(run, truth=change(run.truth, torque_sensor__hysteresis=0.1))
    extra = torque_reading(looped) - torque_reading(run)
    assert 0.08 < extra.max() < 0.11
    assert -0.11 < extra.min() < -0.08


def test_threads_run_rigs_side_by_side():
    alone = simulate(RigTruth(), 1000.0, n_cycles=1, step=1e-5)
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(lambda seed: simulate(RigTruth(), 1000.0, n_cycles=1, step=1e-5, seed=seed), (0, 1)))
    np.testing.assert_array_equal(both[0].history["torque"], alone.history["torque"])
