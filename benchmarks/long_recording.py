"""A long recording made of the cycles of an example: three channels at 100 kHz, single precision, TDMS.

python benchmarks/long_recording.py FOLDER SECONDS
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from camtorque.align import align
from camtorque.ingest import read_recording
from camtorque.records import CamCycles, Channel
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "raw_examples" / "A_1000rpm"
RATE = 100_000.0
PIECE = 10.0
"""Seconds written at a time."""
TURN = 2.0 * np.pi
FLANK, PULSE, HEIGHT, NOISE = 2.0e-5, 1.5e-3, 5.0, 0.03
"""Of the trigger: rise time and length [s], height and noise [V]."""
SERIALS = {"torque": "T22-40117", "pressure": "K4067-40117", "trigger": "PROX-01"}
Values = NDArray[np.float64]


def volts_of(channel: Channel, rows: Values, cycles: CamCycles, time: Values, noise: Values) -> Values:
    """Return the mean cycle over time with the scatter of single cycles, as the sensor shows it."""
    assert channel.calibration is not None
    mean = np.mean(rows, axis=0)
    angle = (cycles.mean_speed * (time - channel.calibration.delay)) % TURN
    values = np.interp(angle, cycles.theta, mean, period=TURN) + float(np.std(rows - mean)) * noise
    return channel.sign * values / channel.calibration.gain + channel.calibration.zero_volts


def trigger_volts(cycles: CamCycles, nominal_angle: float, delay: float, time: Values, noise: Values) -> Values:
    """Return one pulse per revolution."""
    since = ((cycles.mean_speed * (time - delay) - nominal_angle) % TURN) / cycles.mean_speed
    pulse = np.clip(since / FLANK, 0.0, 1.0) - np.clip((since - PULSE) / FLANK, 0.0, 1.0)
    return HEIGHT * pulse + NOISE * noise


def write_long(folder: Path, seconds: float) -> Path:
    """Write a bench folder with one TDMS file."""
    folder.mkdir(parents=True)
    recording = read_recording(EXAMPLE)
    cycles, spec = align(recording), recording.config.trigger
    assert cycles.torque is not None
    measured = {"torque": cycles.torque, "pressure": cycles.pressure}
    properties = {"wf_increment": 1.0 / RATE, "wf_start_offset": 0.0, "unit_string": "V"}
    with TdmsWriter(folder / "log.tdms") as writer:
        for begin in np.arange(0.0, seconds, PIECE):
            noise = np.random.default_rng(int(begin))
            time = np.arange(round(begin * RATE), round(min(begin + PIECE, seconds) * RATE)) / RATE
            volts = {
                name: volts_of(recording.of(name)[0], rows, cycles, time, noise.standard_normal(time.size))
                for name, rows in measured.items()
            }
            volts["trigger"] = trigger_volts(
                cycles, spec.nominal_angle, spec.switching_delay, time, noise.standard_normal(time.size)
            )
            writer.write_segment(
                [ChannelObject("Main", name, part.astype(np.float32), properties) for name, part in volts.items()]
            )
    text = (EXAMPLE / "recording.toml").read_text()
    head = text[: text.index("[[channels]]")].replace("../../calibration", str(ROOT / "calibration"))
    tables = [
        f'[[channels]]\nquantity = "{name}"\nfile = "log.tdms"\ngroup = "Main"\nchannel = "{name}"\nunit = "V"\n'
        f'logger = "DAQ1"\nsample_rate_hz = {RATE}\nsensor = "{serial}"\n'
        for name, serial in SERIALS.items()
    ]
    (folder / "recording.toml").write_text(head + "\n".join(tables))
    return folder


if __name__ == "__main__":
    print(write_long(Path(sys.argv[1]), float(sys.argv[2])))
