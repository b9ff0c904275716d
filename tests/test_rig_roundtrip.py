"""Bench folders of the independent rig through the package's ingest and alignment, against the rig's own alignment.

`rigs.cycles.as_cycles` knows the true edges and starts from the same histories without files; nothing is shared.
"""

import numpy as np
import pytest
from camtorque.align.cycles import align
from camtorque.ingest import read_recording
from rigs.cycles import as_cycles
from rigs.families import closed_volume, negative_rotation
from rigs.rig import simulate
from rigs.write import write_recording

CASES = [
    ("csv", "single", "semicolon"),
    ("csv", "synchronised", "comma"),
    ("csv", "independent", "tab"),
    ("tdms", "single", "comma"),
    ("tdms", "independent", "comma"),
    ("hdf5", "single", "comma"),
    ("hdf5", "independent", "comma"),
    ("mf4", "synchronised", "comma"),
    ("mf4", "independent", "comma"),
]


@pytest.fixture(scope="module", params=[closed_volume, negative_rotation], ids=lambda family: family.__name__)
def run(request):
    return simulate(request.param(np.random.default_rng(0)), 1000.0, n_cycles=30, seed=4, step=1e-5)


@pytest.mark.parametrize(("file_format", "layout", "dialect"), CASES)
def test_files_give_the_cycles_of_the_rig(run, tmp_path, file_format, layout, dialect):
    written = write_recording(run, tmp_path / "r", file_format, layout, dialect, seed=5, skew_ppm=40.0)
    cycles = align(read_recording(written.folder))
    expected = as_cycles(run)
    assert cycles.torque.shape[0] >= run.n_cycles
    torque = cycles.torque.mean(axis=0) - expected["torque"].mean(axis=0)
    pressure = cycles.pressure.mean(axis=0) - expected["pressure"].mean(axis=0)
    # noise of 0.06 N m in two means of 30 cycles (0.016), a zero reading (0.01), 1 or 2 cycles more on one side,
    # a certificate of 0.05 % (0.03 at the peak): 0.04 in all, doubled
    assert np.sqrt(np.mean(torque**2)) < 0.08
    # zero reading of 0.1 bar, certificate 0.1 % of range (k = 2), steep fronts between 50 kHz samples
    assert np.sqrt(np.mean(pressure**2)) < 1.0e5
    if layout != "independent":
        return
    offset, skew = written.relative_clock("LOGGER_B", "LOGGER_A")
    clock = next(clock for clock in cycles.clocks if clock.logger == "LOGGER_B")
    # 30 pulses over 2 s with flanks of 20 us at 20 and 50 kHz: a tenth of the sample that a plain threshold would give
    assert abs(clock.offset_s - offset) < 2e-6
    assert abs(clock.skew_ppm - 1e6 * skew) < 1.5


@pytest.mark.parametrize("standstill", [True, False])
def test_zero_comes_from_the_standstill_reading(run, tmp_path, standstill):
    written = write_recording(run, tmp_path / "r", "tdms", standstill=standstill)
    recording = read_recording(written.folder)
    sensor = run.truth.torque_sensor
    zero = recording.of("torque")[0].calibration.zero_volts / sensor.volts_per_unit
    if standstill:
        assert zero == pytest.approx(sensor.zero, abs=0.03)
    else:
        # the certificate is older than the drift: it knows nothing of this run's zero
        assert zero == pytest.approx(0.03, abs=0.03)
