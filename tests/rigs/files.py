"""Log files in the formats and dialects that benches write. Each writer takes a `LogFile` and a path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import h5py
import numpy as np
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

START = datetime(2025, 3, 12, 9, 0, 0)


@dataclass(frozen=True)
class LogChannel:
    """One channel as a logger stores it: volts at ``start + i / rate`` on the logger's own clock."""

    quantity: str
    name: str
    group: str
    start: float
    rate: float
    volts: np.ndarray


@dataclass(frozen=True)
class LogFile:
    """What one file holds."""

    name: str
    logger: str
    test: str
    pump: str
    speed_rpm: float
    channels: tuple[LogChannel, ...]


@dataclass(frozen=True)
class Dialect:
    """How a CSV file looks."""

    text: str
    separator: str
    decimal: str
    encoding: str
    header: Callable[[LogFile, float], list[str]]
    time_name: str = "Time"


def _english(log: LogFile, rate: float) -> list[str]:
    return [
        f"# Test {log.test}",
        f"# Pump {log.pump}  nominal speed {log.speed_rpm:g} rpm",
        f"# Logger {log.logger}",
        f"# Sample rate {rate:g} Hz",
    ]


def _german(log: LogFile, rate: float) -> list[str]:
    return [
        "Messprotokoll;Pumpenprüfstand 2",
        f"%Versuch;{log.test}",
        f"%Pumpe;{log.pump}",
        f"%Drehzahl;{log.speed_rpm:g};1/min",
        f"%Abtastrate;{rate:g};Hz",
    ]


DIALECTS = {
    "comma": Dialect("comma, decimal point", ",", ".", "utf-8", _english),
    "semicolon": Dialect("semicolon, decimal comma", ";", ",", "cp1252", _german, "Zeit"),
    "tab": Dialect("tab, decimal point", "\t", ".", "utf-8-sig", lambda log, rate: []),
}
"""``semicolon`` is cp1252, ``tab`` starts with a byte order mark and has no comment lines."""


def write_csv(log: LogFile, path: Path, dialect: Dialect) -> None:
    """Write one table: time, then the channels, which need one start and one rate."""
    first = log.channels[0]
    if any((c.start, c.rate) != (first.start, first.rate) for c in log.channels):
        raise ValueError("a CSV table has one time column: give its channels one rate")
    n = min(c.volts.size for c in log.channels)
    times = first.start + np.arange(n) / first.rate
    columns = [np.char.mod("%.6f", times), *(np.char.mod("%.4f", c.volts[:n]) for c in log.channels)]
    rows = [dialect.separator.join(row) for row in zip(*columns, strict=True)]
    if dialect.decimal != ".":
        rows = [row.replace(".", dialect.decimal) for row in rows]
    names = dialect.separator.join([dialect.time_name, *(c.name for c in log.channels)])
    units = dialect.separator.join(["s", *("V" for _ in log.channels)])
    text = "\n".join([*dialect.header(log, first.rate), names, units, *rows]) + "\n"
    path.write_bytes(text.encode(dialect.encoding))


def write_tdms(log: LogFile, path: Path) -> None:
    """Write TDMS with waveform properties, one segment."""
    properties = {"test": log.test, "pump": log.pump, "nominal_speed_rpm": f"{log.speed_rpm:g}"}
    objects = [RootObject(properties)]
    for group in dict.fromkeys(c.group for c in log.channels):
        objects.append(GroupObject(group))
    for c in log.channels:
        waveform = {
            "unit_string": "V",
            "wf_increment": 1.0 / c.rate,
            "wf_start_offset": c.start,
            "wf_start_time": START,
            "wf_samples": c.volts.size,
        }
        objects.append(ChannelObject(c.group, c.name, c.volts.astype(np.float32), waveform))
    with TdmsWriter(path) as writer:
        writer.write_segment(objects)


def write_hdf5(log: LogFile, path: Path) -> None:
    """Write HDF5: a group per rate with ``sample_rate_hz`` and ``t0_s``, gzip with checksum."""
    with h5py.File(path, "w") as file:
        attributes = {"test": log.test, "pump": log.pump, "nominal_speed_rpm": f"{log.speed_rpm:g}"}
        file.attrs.update({**attributes, "start_time": START.isoformat()})
        for c in log.channels:
            group = file.require_group(c.group)
            group.attrs["sample_rate_hz"], group.attrs["t0_s"] = float(c.rate), float(c.start)
            data = group.create_dataset(
                c.name, data=c.volts.astype(np.float32), compression="gzip", compression_opts=1, fletcher32=True
            )
            data.attrs["unit"] = "V"


def write_mf4(log: LogFile, path: Path) -> None:
    """Write MDF 4.10, a channel group per rate."""
    from asammdf import MDF, Signal

    with MDF(version="4.10") as mdf:
        mdf.header.comment = f"test={log.test}; pump={log.pump}; nominal_speed_rpm={log.speed_rpm:g}"
        mdf.header.start_time = START
        for group in dict.fromkeys((c.group, c.rate, c.start) for c in log.channels):
            channels = [c for c in log.channels if (c.group, c.rate, c.start) == group]
            n = min(c.volts.size for c in channels)
            times = group[2] + np.arange(n) / group[1]
            signals = [Signal(c.volts[:n].astype(np.float32), times, unit="V", name=c.name) for c in channels]
            mdf.append(signals, acq_name=group[0], common_timebase=True)
        mdf.save(path, overwrite=True)


WRITERS: dict[str, Callable[[LogFile, Path], None]] = {"tdms": write_tdms, "hdf5": write_hdf5, "mf4": write_mf4}
SUFFIXES = {"csv": "csv", "tdms": "tdms", "hdf5": "h5", "mf4": "mf4"}
