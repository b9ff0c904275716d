"""`write_recording`: a run as the folder that a bench delivers, with the truth about its clocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rigs.files import DIALECTS, SUFFIXES, WRITERS, LogChannel, LogFile, write_csv
from rigs.rig import RigRun
from rigs.sense import Signal, pressure_signal, torque_signal, trigger_signal, wheel_edges
from rigs.sheets import ChannelLine, recording_toml, write_lift_table, write_sensor_sheets
from rigs.truth import RigTruth

NAMES = {"torque": "Torque", "pressure": "Line_Pressure", "trigger": "Prox_Trigger"}
GERMAN_NAMES = {"torque": "Drehmoment", "pressure": "Leitungsdruck", "trigger": "Geber"}
LAYOUTS: dict[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "single": (("DAQ1", ("torque", "pressure", "trigger")),),
    "synchronised": (("LOG_TORQUE", ("torque",)), ("LOG_PRESSURE", ("pressure",)), ("LOG_TRIGGER", ("trigger",))),
    "independent": (("LOGGER_A", ("torque", "trigger")), ("LOGGER_B", ("pressure", "trigger"))),
}
RATES = {"torque": 20e3, "pressure": 50e3, "trigger": 50e3}


@dataclass(frozen=True)
class Clock:
    """A logger's clock: it reads ``reading_at_start + (1 + skew) (t - start)`` at true time t."""

    start: float = 0.0
    skew: float = 0.0
    reading_at_start: float = 0.0


@dataclass(frozen=True)
class Written:
    """What was written, and what is true about it.

    Attributes
    ----------
    folder : the recording's folder
    edges : rising trigger edges in true time, switching delay and jitter included [s]
    clocks : logger -> `Clock`
    files : log files written
    """

    folder: Path
    edges: np.ndarray
    clocks: Mapping[str, Clock]
    files: tuple[Path, ...] = field(default=())

    def relative_clock(self, logger: str, reference: str) -> tuple[float, float]:
        """Return (offset [s], skew) of t_logger = offset + (1 + skew) t_reference."""
        own, other = self.clocks[logger], self.clocks[reference]
        skew = (1.0 + own.skew) / (1.0 + other.skew) - 1.0
        at_other_start = own.reading_at_start + (1.0 + own.skew) * (other.start - own.start)
        return at_other_start - (1.0 + skew) * other.reading_at_start, skew


def _clocks(layout: str, rng: np.random.Generator, skew_ppm: float) -> dict[str, Clock]:
    loggers = [logger for logger, _ in LAYOUTS[layout]]
    if layout == "single":
        return {loggers[0]: Clock()}
    starts = np.round(rng.uniform(0.0, 0.1, len(loggers)), 5)
    if layout == "synchronised":
        return {logger: Clock(start, 0.0, start) for logger, start in zip(loggers, starts, strict=True)}
    half = 0.5e-6 * skew_ppm
    return {loggers[0]: Clock(starts[0], -half, 0.0), loggers[1]: Clock(starts[1], half, 0.0)}


def _signal(run: RigRun, quantity: str, rate: float, clock: Clock, edges: np.ndarray, rng) -> Signal:
    true_rate = rate * (1.0 + clock.skew)
    if quantity == "trigger":
        return trigger_signal(run, true_rate, clock.start, edges, rng)
    return {"torque": torque_signal, "pressure": pressure_signal}[quantity](run, true_rate, clock.start, rng)


def _log_rates(quantities: tuple[str, ...], rates: Mapping[str, float], file_format: str) -> dict[str, float]:
    """Return the rate of each channel; only TDMS keeps a rate per channel in one file here."""
    if file_format == "tdms" or len(quantities) == 1:
        return {q: rates[q] for q in quantities}
    fastest = max(rates[q] for q in quantities)
    return dict.fromkeys(quantities, fastest)


def write_recording(
    run: RigRun,
    folder: Path,
    file_format: str = "csv",
    layout: str = "single",
    dialect: str = "comma",
    rates: Mapping[str, float] = RATES,
    standstill: bool = True,
    skew_ppm: float = 40.0,
    seed: int = 0,
    lift_step_deg: float = 1.0,
    lift_noise: float = 0.5e-6,
) -> Written:
    """Write ``recording.toml``, log files and ``calibration/`` into ``folder`` and return the truth about them.

    ``layout`` is ``single`` (one logger), ``synchronised`` (own starts, common time base) or ``independent`` (two
    loggers with a skew of ``skew_ppm`` between them, the trigger on both). In one CSV, HDF5 or MF4 file all channels
    have the fastest of their rates. ``standstill`` False leaves the zero readings out.
    """
    rng = np.random.default_rng(seed)
    (folder / "calibration").mkdir(parents=True, exist_ok=True)
    name = folder.name
    clocks = _clocks(layout, rng, skew_ppm)
    edges = wheel_edges(run, rng)
    names = GERMAN_NAMES if file_format == "csv" and dialect == "semicolon" else NAMES
    lines, files = [], []
    for logger, quantities in LAYOUTS[layout]:
        clock = clocks[logger]
        channels = []
        for quantity, rate in _log_rates(quantities, rates, file_format).items():
            signal = _signal(run, quantity, rate, clock, edges, rng)
            group = {"csv": "", "tdms": f"Grp_{quantity}", "hdf5": "Main", "mf4": "Rec"}[file_format]
            channels.append(LogChannel(quantity, names[quantity], group, clock.reading_at_start, rate, signal.volts))
        tail = "all" if layout == "single" else logger.lower()
        log = LogFile(
            f"{name}_{tail}.{SUFFIXES[file_format]}", logger, name, run.truth.name, run.speed_rpm, tuple(channels)
        )
        path = folder / log.name
        if file_format == "csv":
            write_csv(log, path, DIALECTS[dialect])
        else:
            WRITERS[file_format](log, path)
        files.append(path)
        lines += [ChannelLine(c.quantity, log.name, c.group, c.name, logger, c.rate) for c in channels]

    readings = _standstill(run.truth, rng) if standstill else None
    text = DIALECTS[dialect].text if file_format == "csv" else ""
    toml = recording_toml(run, name, file_format, text, layout, lines, readings)
    (folder / "recording.toml").write_text(toml, encoding="utf-8")
    write_sensor_sheets(run.truth, folder / "calibration", rng)
    write_lift_table(run.truth, folder / "calibration" / "cam.csv", rng, lift_step_deg, lift_noise)
    return Written(folder, edges, clocks, tuple(files))


def _standstill(truth: RigTruth, rng: np.random.Generator) -> dict[str, tuple[float, float]]:
    """Return zero readings before and after [V]; the rig's own residual is in neither."""
    torque, pressure = truth.torque_sensor, truth.pressure_sensor
    torque_zero = torque.volts_per_unit * (torque.zero + 0.01 * rng.standard_normal(2))
    pressure_zero = pressure.volts_per_unit * (pressure.zero + 0.1e5 * rng.standard_normal(2))
    return {"torque": tuple(torque_zero), "pressure": tuple(pressure_zero)}
