"""Small synthetic logs and writers for every format. Sheets and lift table are those of the top-level ``calibration/``.

The signals are closed formulas: good enough to be read, checked and aligned, not a model of a pump.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

CALIBRATION = Path(__file__).resolve().parents[2] / "calibration"
START = datetime(2025, 3, 12, 9, 0, 0)
NAMES = {"torque": "Torque", "pressure": "Line_Pressure", "trigger": "Prox_Trigger"}
SENSORS = {"torque": "T22-40117", "pressure": "K4067-40117", "trigger": "PROX-01"}


def edit(file: Path, old: str, new: str) -> None:
    """Replace a text that the file must hold."""
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


@dataclass(frozen=True)
class Log:
    """Volts of one logger at ``start + i / rate``; ``times`` may be damaged apart from it."""

    rate: float
    start: float
    volts: dict[str, np.ndarray]
    times: np.ndarray
    logger: str = "DAQ1"

    def with_volts(self, quantity: str, values: np.ndarray) -> Log:
        return replace(self, volts={**self.volts, quantity: values})


def bump(angle: np.ndarray, first: float, last: float) -> np.ndarray:
    """A smooth hill between two angles in degrees."""
    inside = (np.rad2deg(angle) % 360.0 - first) / (last - first)
    return np.where((inside > 0.0) & (inside < 1.0), np.sin(np.pi * np.clip(inside, 0.0, 1.0)) ** 2, 0.0)


def clean_log(
    rpm: float = 600.0, rate: float = 10_000.0, revolutions: float = 22.0, start: float = 0.0, seed: int = 1
) -> Log:
    """A log without damage: pressure 60 to 460 bar, torque -15 to 43 N m, a pulse of 8 degrees from 20 degrees on."""
    count = round(revolutions * 60.0 / rpm * rate)
    time = np.arange(count) / rate
    angle = 2.0 * np.pi * rpm / 60.0 * (start + time) + 0.4
    noise = np.random.default_rng(seed)
    hill = bump(angle, 18.0, 75.0)
    volts = {
        "torque": 0.03
        + (3.0 + 40.0 * hill - 18.0 * bump(angle, 80.0, 130.0)) / 40.0
        + 1e-3 * noise.standard_normal(count),
        "pressure": 0.01 + (60.0 + 400.0 * bump(angle, 22.0, 95.0)) / 200.0 + 1e-3 * noise.standard_normal(count),
        "trigger": 0.05 + 5.0 * pulse(angle) + 5e-3 * noise.standard_normal(count),
    }
    return Log(rate, start, volts, start + time)


def pulse(angle: np.ndarray) -> np.ndarray:
    """A pulse with flanks of half a degree."""
    degrees = (np.rad2deg(angle) - 20.0) % 360.0
    return np.clip(degrees / 0.5 + 0.5, 0.0, 1.0) * np.clip((8.0 - degrees) / 0.5 + 0.5, 0.0, 1.0) + np.clip(
        (degrees - 359.75) / 0.5, 0.0, 1.0
    )


@dataclass(frozen=True)
class Dialect:
    """How a CSV file looks."""

    separator: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    comments: tuple[str, ...] = ("# Test synthetic", "# Sample rate {rate:g} Hz")
    time_name: str = "Time"
    time_unit: str = "s"
    units_in_brackets: bool = False
    unit_row: bool = True
    line_end: str = "\n"
    iso: bool = False
    no_time: bool = False
    day_first: bool = False
    surplus: str = ""


DIALECTS: dict[str, Dialect] = {
    "comma": Dialect(),
    "semicolon": Dialect(";", ",", "cp1252", ("Messprotokoll;Pumpenprüfstand µ °", "%Abtastrate;{rate:g};Hz"), "Zeit"),
    "tab": Dialect("\t", ".", "utf-8-sig", (), "time"),
    "brackets": Dialect(unit_row=False, units_in_brackets=True, comments=()),
    "milliseconds": Dialect(time_unit="ms"),
    "iso": Dialect(iso=True, unit_row=False, comments=(), time_name="timestamp"),
    "no_time": Dialect(no_time=True),
    "crlf": Dialect(line_end="\r\n"),
    "blanks": Dialect(separator=" "),
    "bars": Dialect(separator="|"),
    "day_first": Dialect(";", ",", iso=True, day_first=True, unit_row=False, comments=(), time_name="Zeitstempel"),
    "utf16": Dialect("\t", encoding="utf-16"),
    "utf32": Dialect("\t", encoding="utf-32"),
    "utf16_plain": Dialect("\t", encoding="utf-16-le"),
    "surplus": Dialect(surplus=";Bemerkung", separator=";", unit_row=False),
    "latin1": Dialect(";", ".", "latin-1", ("# Temperatur 23 °C, Weg in µm",)),
}


def csv_text(log: Log, dialect: Dialect) -> str:
    """Return the file's text."""
    names, units, columns = [], [], []
    if not dialect.no_time:
        names.append(dialect.time_name)
        units.append(dialect.time_unit)
        columns.append(_time_texts(log, dialect))
    for quantity, volts in log.volts.items():
        names.append(NAMES[quantity])
        units.append("V")
        columns.append(["" if np.isnan(v) else f"{v:.4f}" for v in volts])
    if dialect.units_in_brackets:
        names = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    if dialect.decimal == ",":
        plain = [column if dialect.day_first and n == 0 else _with_commas(column) for n, column in enumerate(columns)]
        columns = plain
    rows = [dialect.separator.join(row) for row in zip(*columns, strict=True)]
    head = [line.format(rate=log.rate) for line in dialect.comments]
    head.append(dialect.separator.join(names) + dialect.surplus)
    if dialect.unit_row:
        head.append(dialect.separator.join(units))
    return dialect.line_end.join([*head, *rows, ""])


def _with_commas(column: list[str]) -> list[str]:
    return [text.replace(".", ",") for text in column]


def _time_texts(log: Log, dialect: Dialect) -> list[str]:
    if dialect.iso:
        base = np.datetime64(START, "us")
        texts = [str(base + np.timedelta64(round(1e6 * t), "us")) for t in log.times]
        if dialect.day_first:
            return [f"{t[8:10]}.{t[5:7]}.{t[:4]} {t[11:]}" for t in texts]
        return texts
    if dialect.time_unit == "ms":
        return [f"{1e3 * t:.4f}" for t in log.times]
    return ["" if np.isnan(t) else f"{t:.6f}" for t in log.times]


def write_csv(path: Path, log: Log, dialect: str = "comma") -> None:
    kind = DIALECTS[dialect]
    path.write_bytes(csv_text(log, kind).encode(kind.encoding))


def write_tdms(path: Path, log: Log, *, scaled: bool = False, segments: int = 1, unit: str = "V") -> None:
    from nptdms import ChannelObject, RootObject, TdmsWriter

    with TdmsWriter(path) as writer:
        for number in range(segments):
            objects = [RootObject({"test": "synthetic"})]
            for quantity, volts in log.volts.items():
                waveform = {
                    "unit_string": unit,
                    "wf_increment": 1.0 / log.rate,
                    "wf_start_offset": log.start,
                    "wf_start_time": START,
                    "wf_samples": volts.size,
                }
                data = np.array_split(volts, segments)[number]
                if scaled:
                    waveform |= {
                        "NI_Scaling_Status": "unscaled",
                        "NI_Number_Of_Scales": np.uint32(1),
                        "NI_Scale[0]_Scale_Type": "Linear",
                        "NI_Scale[0]_Linear_Slope": 10.0 / 32768.0,
                        "NI_Scale[0]_Linear_Y_Intercept": 0.0,
                        "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),
                    }
                    data = np.round(data * 3276.8).astype(np.int16)
                objects.append(ChannelObject(f"Grp_{quantity}", NAMES[quantity], data, waveform))
            writer.write_segment(objects)


def write_hdf5(path: Path, log: Log, *, checksum: bool = True, unit: str = "V") -> None:
    options = {"compression": "gzip", "fletcher32": True, "chunks": (1024,)} if checksum else {}
    with h5py.File(path, "w") as file:
        group = file.create_group("Main")
        group.attrs["sample_rate_hz"], group.attrs["t0_s"] = log.rate, log.start
        for quantity, volts in log.volts.items():
            group.create_dataset(NAMES[quantity], data=volts, **options).attrs["unit"] = unit


def write_mf4(path: Path, log: Log, *, compression: int = 2, unit: str = "V") -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as mdf:
        mdf.header.start_time = START
        signals = [
            Signal(volts.astype(np.float32), log.times, unit=unit, name=NAMES[quantity])
            for quantity, volts in log.volts.items()
        ]
        mdf.append(signals, acq_name="Rec", comment="Rec", common_timebase=True)
        mdf.save(path, overwrite=True, compression=compression)


def write_mat5(path: Path, log: Log, *, compress: bool = True, struct_name: str = "") -> None:
    values = {"t": log.times, **{NAMES[quantity]: volts for quantity, volts in log.volts.items()}}
    savemat(path, {struct_name: values} if struct_name else values, do_compression=compress)


def write_numpy(path: Path, log: Log) -> None:
    np.savez_compressed(path, t=log.times, **{NAMES[quantity]: volts for quantity, volts in log.volts.items()})


def write_mat73(path: Path, log: Log) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("t", data=log.times[np.newaxis, :])
        for quantity, volts in log.volts.items():
            file.create_dataset(NAMES[quantity], data=volts[np.newaxis, :], compression="gzip")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)


def write_catman(
    path: Path, log: Log, *, width: int = 8, with_time: bool = True, time_unit: str = "s", with_step: bool = True
) -> None:
    """catman binary: headers of all channels, then the channels one after the other."""
    times = log.times / {"s": 1.0, "ms": 1e-3}[time_unit]
    columns = [("Time  1 - default sample rate", time_unit, times)] if with_time else []
    columns += [(NAMES[quantity], "V", volts) for quantity, volts in log.volts.items()]
    export = {8: 0, 4: 1, 2: 2}[width]

    def text(value: str, form: str = "<h") -> bytes:
        return struct.pack(form, len(value)) + value.encode("cp1252")

    headers, data = b"", b""
    for number, (name, unit, values) in enumerate(columns, start=1):
        kind = 0 if name.startswith("Time") else export
        extended = struct.pack("<dd4h3f4f", 45728.375, with_step * 1e3 / log.rate, *[0] * 4, *[0.0] * 7) + bytes(
            32 + 8 + 8 + 8 + 8
        )
        extended += bytes(6 + 2 + 4 + 4 + 8) + struct.pack("<b7x", kind)
        headers += struct.pack("<hi", number, values.size) + text(name) + text(unit) + text("")
        headers += struct.pack("<hhdi", 0, 8, 45728.375, len(extended)) + extended
        headers += b"\x00\x00\x00" + struct.pack("<h", 0) + text("") + text("", "<i")
        if kind == 2:
            low, high = float(values.min()), float(values.max())
            counts = np.round((values - low) / (high - low) * 32767.0).astype("<u2")
            data += struct.pack("<dd", low, high) + counts.tobytes()
        else:
            data += values.astype("<f8" if kind == 0 else "<f4").tobytes()
    head = text("a comment") + text("") * 32 + struct.pack("<hi", len(columns), 0)
    head += struct.pack(f"<{len(columns) + 1}i", *[0] * (len(columns) + 1))
    path.write_bytes(struct.pack("<hi", 5012, 6 + len(head) + len(headers)) + head + headers + data)


def _table(log: Log) -> tuple[list[str], list[str], list[np.ndarray]]:
    """Return names, units and columns, the time first."""
    names = ["Time", *(NAMES[quantity] for quantity in log.volts)]
    return names, ["s", *("V" for _ in log.volts)], [log.times, *log.volts.values()]


BOOKS: dict[bytes, bytes] = {}
"""Workbooks by their samples: writing one takes a second, and many cases begin with the same."""


def write_xlsx(path: Path, log: Log) -> None:
    from openpyxl import Workbook

    names, units, columns = _table(log)
    content = b"".join(column.tobytes() for column in columns)
    if content not in BOOKS:
        book = Workbook(write_only=True)
        sheet = book.create_sheet("Log")
        for row in (["measured on the bench"], names, units, *zip(*(part.tolist() for part in columns), strict=True)):
            sheet.append(row)
        book.save(path)
        BOOKS[content] = path.read_bytes()
    path.write_bytes(BOOKS[content])


def write_parquet(path: Path, log: Log, *, feather: bool = False, checksum: bool = True) -> None:
    import pyarrow as pa
    from pyarrow import feather as arrow
    from pyarrow import parquet

    names, units, columns = _table(log)
    fields = [pa.field(n, pa.float64(), metadata={"unit": u}) for n, u in zip(names, units, strict=True)]
    table = pa.table([pa.array(column) for column in columns], schema=pa.schema(fields))
    arrow.write_feather(table, path) if feather else parquet.write_table(table, path, write_page_checksum=checksum)


def write_lvm(path: Path, log: Log, *, x_columns: str = "One", segments: int = 1) -> None:
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t."]
    head += ["Multi_Headings\tNo", f"X_Columns\t{x_columns}", "Time_Pref\tRelative", "***End_of_Header***\t", "\t"]
    n = len(log.volts)
    part = [f"Channels\t{n}\t", "Samples\t" + "\t".join([str(log.times.size)] * n) + "\t"]
    part += ["Y_Unit_Label\t" + "\t".join(["Volts"] * n), "X_Dimension\t" + "\t".join(["Time"] * n)]
    part += ["X0\t" + "\t".join([f"{log.start:.7f}"] * n), "Delta_X\t" + "\t".join([f"{1.0 / log.rate:.9f}"] * n)]
    part += ["***End_of_Header***\t", "\t".join(["X_Value", *(NAMES[q] for q in log.volts), "Comment"])]
    times = [f"{t:.6f}" if x_columns == "One" else "" for t in log.times]
    rows = [
        "\t".join([t, *(f"{v:.6f}" for v in row)])
        for t, row in zip(times, zip(*log.volts.values(), strict=True), strict=True)
    ]
    path.write_text("\r\n".join([*head, *(segments * [*part, *rows, ""])]), encoding="utf-8", newline="")


SUFFIXES = {
    "csv": "csv",
    "tdms": "tdms",
    "mf4": "mf4",
    "hdf5": "h5",
    "mat": "mat",
    "numpy": "npz",
    "catman": "bin",
    "xlsx": "xlsx",
    "parquet": "parquet",
    "lvm": "lvm",
}
WRITERS: dict[str, Callable[..., None]] = {
    "csv": write_csv,
    "tdms": write_tdms,
    "mf4": write_mf4,
    "hdf5": write_hdf5,
    "mat": write_mat5,
    "numpy": write_numpy,
    "catman": write_catman,
    "xlsx": write_xlsx,
    "parquet": write_parquet,
    "lvm": write_lvm,
}
GROUPS = dict.fromkeys(SUFFIXES, "") | {"tdms": "Grp_{quantity}", "mf4": "Rec", "hdf5": "Main"}

TOML = """schema = "fip-bench-recording/1"

[recording]
id = "{id}"
pump_id = "FIP-A"
nominal_speed_rpm = {rpm}
file_format = "{file_format}"
csv_dialect = "{dialect}"
acquisition = "synthetic"
rotation = "positive"
note = ""

[pump]
base_circle_radius_m = 0.02
roller_radius_m = 0.008
roller_width_m = 0.005
follower_offset_m = 0.0
cam_mass_kg = 0.25
cam_inertia_kg_m2 = 5e-05
follower_mass_kg = 0.075
follower_mass_note = ""
spring_stiffness_N_per_m = 20000.0
spring_preload_N = 110.0
plunger_diameter_m = 0.008
youngs_modulus_cam_Pa = 210000000000.0
youngs_modulus_roller_Pa = 210000000000.0
cam_table = "{calibration}/cam_A.csv"
cam_table_angle_column = "cam_angle_deg"
cam_table_lift_column = "lift_mm"

[trigger]
nominal_angle_deg = 20.0
installation_tolerance_deg = 1.5
meaning = "end of pre-stroke"
edge = "rising"
pulses_per_rev = 1
level_V = 5.0
switching_delay_typ_s = 4e-05

[sensors.torque]
serial = "T22-40117"
calibration = "{calibration}/torque_T22-40117.toml"
zero_before_V = 0.0299
zero_after_V = 0.0301

[sensors.pressure]
serial = "K4067-40117"
calibration = "{calibration}/pressure_K4067-40117.toml"
zero_before_V = 0.0099
zero_after_V = 0.0101
"""


@dataclass(frozen=True)
class Plan:
    """How a recording is written: format, clock of its loggers, one file per log, edits of the toml text."""

    file_format: str = "hdf5"
    clock: str = "single"
    writer_options: dict[str, object] = field(default_factory=dict)
    hint: str = ""
    edits: tuple[tuple[str, str], ...] = ()
    channel_lines: str = ""


def write_folder(folder: Path, logs: list[Log], plan: Plan, rpm: float = 600.0) -> Path:
    """Write logs and recording.toml into ``folder`` and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    text = TOML.format(
        id=folder.name,
        rpm=float(rpm),
        file_format=plan.file_format,
        dialect=plan.hint,
        calibration=CALIBRATION.as_posix(),
    )
    for log in logs:
        text += f'\n[[loggers]]\nid = "{log.logger}"\nclock = "{plan.clock}"\n'
    for log in logs:
        file = f"{log.logger}.{SUFFIXES[plan.file_format]}"
        WRITERS[plan.file_format](folder / file, log, **plan.writer_options)
        for quantity in log.volts:
            group = GROUPS[plan.file_format].format(quantity=quantity)
            text += (
                f'\n[[channels]]\nquantity = "{quantity}"\nfile = "{file}"\ngroup = "{group}"\n'
                f'channel = "{NAMES[quantity]}"\nunit = "V"\nlogger = "{log.logger}"\n'
                f'sample_rate_hz = {log.rate}\nsensor = "{SENSORS[quantity]}"\n{plan.channel_lines}'
            )
    for old, new in plan.edits:
        if old not in text:
            raise ValueError(f"{old!r} is not in the text of recording.toml")
        text = text.replace(old, new)
    (folder / "recording.toml").write_text(text, encoding="utf-8")
    return folder
