"""The damaged corpus: name -> function(folder) -> recording folder. Each is one log of `logs.clean_log` with one fault.

The verdicts stand in `cases.py`. ``python tests/damaged/build.py DIR`` writes the whole corpus below DIR.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from damaged.logs import SUFFIXES, Log, Plan, clean_log, write_folder, write_mat5, write_mat73, write_tdms

Builder = Callable[[Path], Path]
MAT = Plan("mat", channel_lines='time_channel = "t"\n')
PLANS = {name: Plan(name) for name in SUFFIXES} | {"mat": MAT, "numpy": replace(MAT, file_format="numpy")}
UNCOMPRESSED = {
    "mf4": replace(PLANS["mf4"], writer_options={"compression": 0}),
    "hdf5": replace(PLANS["hdf5"], writer_options={"checksum": False}),
    "mat": replace(MAT, writer_options={"compress": False}),
}


def clean(file_format: str) -> Builder:
    """A recording without damage."""
    return lambda folder: write_folder(folder, [clean_log()], PLANS[file_format])


def dialect(name: str, hint: str = "") -> Builder:
    return lambda folder: write_folder(folder, [clean_log()], Plan("csv", writer_options={"dialect": name}, hint=hint))


def edited(*edits: tuple[str, str], file_format: str = "hdf5") -> Builder:
    """A clean log with a changed recording.toml."""
    return lambda folder: write_folder(folder, [clean_log()], replace(PLANS[file_format], edits=edits))


def log_file(folder: Path) -> Path:
    """Return the one log of a recording."""
    return next(path for path in folder.iterdir() if path.suffix != ".toml")


def rewritten(file_format: str, change: Callable[[bytes], bytes], plan: Plan | None = None) -> Builder:
    """Change the bytes of a log that is written whole."""

    def build(folder: Path) -> Path:
        file = log_file(write_folder(folder, [clean_log()], plan or PLANS[file_format]))
        file.write_bytes(change(file.read_bytes()))
        return folder

    return build


def cut(file_format: str, part: float, plan: Plan | None = None) -> Builder:
    """Cut the file after a part of its bytes."""
    return rewritten(file_format, lambda data: data[: int(part * len(data))], plan)


def cut_at(file_format: str, size: int) -> Builder:
    """Cut the file after so many bytes (0: empty)."""
    return rewritten(file_format, lambda data: data[:size])


def flipped(file_format: str, part: float) -> Builder:
    """Flip a bit of one byte at a part of the file."""

    def flip(data: bytes) -> bytes:
        at = int(part * len(data))
        return data[:at] + bytes([data[at] ^ 0x40]) + data[at + 1 :]

    return rewritten(file_format, flip)


def text_edit(change: Callable[[list[str]], list[str]]) -> Builder:
    """Change the lines of a CSV log (the first data row is line 5)."""
    return rewritten("csv", lambda data: "\n".join(change(data.decode().split("\n"))).encode())


def changed(change: Callable[[Log], Log], file_format: str = "hdf5", **options: float) -> Builder:
    """A log whose samples or times are changed before it is written."""
    return lambda folder: write_folder(folder, [change(clean_log(**options))], PLANS[file_format])


def two_loggers(trigger_on_both: bool = True) -> Builder:
    """Two loggers with separate clocks."""

    def build(folder: Path) -> Path:
        first = clean_log()
        second = clean_log(rate=20_000.0 * (1.0 + 40e-6), start=0.237, seed=2)
        one = replace(first, logger="A", volts={q: first.volts[q] for q in ("torque", "trigger")})
        names = ("pressure", "trigger") if trigger_on_both else ("pressure",)
        count = second.volts["pressure"].size
        two = Log(20_000.0, 0.0, {q: second.volts[q] for q in names}, np.arange(count) / 20_000.0, "B")
        return write_folder(folder, [one, two], replace(PLANS["hdf5"], clock="independent"))

    return build


def companion_cut(folder: Path) -> Path:
    """Three CSV logs on one time base, one of them cut at a row's end."""
    log = clean_log()
    parts = [replace(log, logger=quantity.upper(), volts={quantity: volts}) for quantity, volts in log.volts.items()]
    write_folder(folder, parts, replace(PLANS["csv"], clock="synchronised"))
    file = folder / "PRESSURE.csv"
    lines = file.read_text().split("\n")
    file.write_text("\n".join(lines[:15000]) + "\n")
    return folder


def _swap(log: Log) -> Log:
    return replace(log, volts={**log.volts, "torque": log.volts["pressure"], "pressure": log.volts["torque"]})


def _put(quantity: str, where: slice, value: float | Callable[[np.ndarray], np.ndarray]) -> Callable[[Log], Log]:
    def change(log: Log) -> Log:
        volts = log.volts[quantity].copy()
        volts[where] = value(volts[where]) if callable(value) else value
        return log.with_volts(quantity, volts)

    return change


def _gap(log: Log) -> Log:
    """Take 137 samples out; the times tell."""
    keep = np.r_[0:9000, 9137 : log.times.size]
    return replace(log, times=log.times[keep], volts={q: v[keep] for q, v in log.volts.items()})


def _jump(by: float) -> Callable[[Log], Log]:
    """The times of the later samples are off [s]."""
    return lambda log: replace(log, times=log.times + np.where(np.arange(log.times.size) < 12000, 0.0, by))


def _jitter(log: Log) -> Log:
    return replace(log, times=np.sort(log.times + np.random.default_rng(3).uniform(-1, 1, log.times.size) / log.rate))


def _trigger(change: Callable[[np.ndarray, np.ndarray], None]) -> Callable[[Log], Log]:
    """Change the trigger, knowing the first sample of each pulse."""

    def edit(log: Log) -> Log:
        volts = log.volts["trigger"].copy()
        high = volts > 2.5
        change(volts, np.flatnonzero(high[1:] & ~high[:-1]) + 1)
        return log.with_volts("trigger", volts)

    return edit


def _missed(volts: np.ndarray, edges: np.ndarray) -> None:
    volts[edges[9] - 5 : edges[9] + 40] = 0.05


def _doubled(volts: np.ndarray, edges: np.ndarray) -> None:
    volts[edges[9] + 500 : edges[9] + 520] = 5.05


def _bounced(volts: np.ndarray, edges: np.ndarray) -> None:
    volts[edges[9] + 3] = 0.05
    volts[edges[12] + 3 : edges[12] + 5] = 0.05


def _ramp(log: Log) -> Log:
    """The same log with a speed that rises by a fifth: samples are taken at stretched times."""
    count = log.times.size
    at = np.arange(count) * (1.0 + 0.1 * np.arange(count) / count)
    at = at[at < count - 1]
    volts = {q: np.interp(at, np.arange(count), v) for q, v in log.volts.items()}
    return Log(log.rate, log.start, volts, log.times[: at.size])


def _dead_trigger(where: slice) -> Callable[[Log], Log]:
    """The cable of the trigger is off for a part of the log, its input reads noise."""
    return _put("trigger", where, lambda volts: 0.05 + 5e-3 * np.random.default_rng(5).standard_normal(volts.size))


def _start_stop(log: Log) -> Log:
    """Half a second of standstill before and after."""
    idle = round(0.5 * log.rate)
    rng = np.random.default_rng(4)
    rest = {"torque": 0.03, "pressure": 0.01, "trigger": 0.05}
    volts = {
        q: np.concatenate([rest[q] + 1e-3 * rng.standard_normal(idle), v, rest[q] + 1e-3 * rng.standard_normal(idle)])
        for q, v in log.volts.items()
    }
    count = log.times.size + 2 * idle
    return Log(log.rate, log.start, volts, log.start + np.arange(count) / log.rate)


def _invert_torque(log: Log) -> Log:
    return log.with_volts("torque", 0.06 - log.volts["torque"])


def _misfire(log: Log) -> Log:
    period = round(log.rate * 0.1)
    return _put("pressure", slice(8 * period, 9 * period), 0.31)(
        _put("torque", slice(8 * period, 9 * period), 0.1)(log)
    )


def wrong_content(folder: Path) -> Path:
    """HDF5 says the toml, TDMS is the file."""
    write_folder(folder, [clean_log()], PLANS["hdf5"])
    write_tdms(log_file(folder), clean_log())
    return folder


def missing_log(folder: Path) -> Path:
    write_folder(folder, [clean_log()], PLANS["hdf5"])
    log_file(folder).unlink()
    return folder


def mat73(change: Callable[[Path], None] = lambda file: None) -> Builder:
    def build(folder: Path) -> Path:
        write_folder(folder, [clean_log()], MAT)
        write_mat73(log_file(folder), clean_log())
        change(log_file(folder))
        return folder

    return build


def mat_struct(folder: Path) -> Path:
    write_folder(folder, [clean_log()], replace(MAT, edits=(('group = ""', 'group = "rec"'),)))
    write_mat5(log_file(folder), clean_log(), struct_name="rec")
    return folder


def _shorten(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-5000])


BUILDERS: dict[str, Builder] = {
    **{f"clean_{name}": clean(name) for name in SUFFIXES},
    **{f"empty_{name}": cut_at(name, 0) for name in SUFFIXES},
    **{f"cut_half_{name}": cut(name, 0.5) for name in SUFFIXES},
    **{f"cut_in_header_{name}": cut_at(name, 30) for name in SUFFIXES},
    **{f"cut_last_byte_{name}": cut(name, 0.99999) for name in SUFFIXES},
    "header_only_csv": text_edit(lambda lines: [*lines[:4], ""]),
    "cut_half_uncompressed_mf4": cut("mf4", 0.5, UNCOMPRESSED["mf4"]),
    "cut_half_contiguous_hdf5": cut("hdf5", 0.5, UNCOMPRESSED["hdf5"]),
    "cut_half_uncompressed_mat": cut("mat", 0.5, UNCOMPRESSED["mat"]),
    "cut_mat73": mat73(_shorten),
    "clean_mat73": mat73(),
    "clean_mat_struct": mat_struct,
    "flipped_hdf5_checksum": flipped("hdf5", 0.6),
    "flipped_mf4_deflate": flipped("mf4", 0.5),
    "flipped_mat_deflate": flipped("mat", 0.6),
    "flipped_numpy_deflate": flipped("numpy", 0.6),
    "flipped_tdms_lead_in": flipped("tdms", 0.0),
    "flipped_csv_digit": text_edit(lambda lines: [*lines[:9000], lines[9000].replace(",0.", ",7.", 1), *lines[9001:]]),
    "flipped_csv_separator": text_edit(lambda lines: [*lines[:9000], lines[9000].replace(",", "l", 1), *lines[9001:]]),
    "flipped_csv_row_end": text_edit(lambda lines: [*lines[:9000], lines[9000] + "*" + lines[9001], *lines[9002:]]),
    "letters_in_csv": text_edit(lambda lines: [*lines[:9000], lines[9000][:-6] + ",x.3", *lines[9001:]]),
    "row_missing_csv": text_edit(lambda lines: [*lines[:9000], *lines[9001:]]),
    "companion_cut_csv": companion_cut,
    "unfinished_mf4": rewritten("mf4", lambda data: b"UnFinMF " + data[8:]),
    # a logger that died: the length of the last segment was never written
    "unclosed_tdms": rewritten("tdms", lambda data: data[:12] + b"\xff" * 8 + data[20:-4000]),
    "wrong_content": wrong_content,
    "missing_log": missing_log,
    "dialect_semicolon": dialect("semicolon", "semicolon, decimal comma"),
    "dialect_tab_bom": dialect("tab"),
    "dialect_brackets": dialect("brackets"),
    "dialect_milliseconds": dialect("milliseconds"),
    "dialect_iso_stamps": dialect("iso"),
    "dialect_no_time": dialect("no_time"),
    "dialect_crlf": dialect("crlf"),
    "dialect_blanks": dialect("blanks"),
    "dialect_bars": dialect("bars"),
    "dialect_latin1": dialect("latin1"),
    "dialect_day_first": dialect("day_first"),
    "dialect_utf16": dialect("utf16"),
    "dialect_utf16_plain": dialect("utf16_plain"),
    "dialect_surplus": dialect("surplus"),
    "flipped_parquet": flipped("parquet", 0.5),
    "flipped_xlsx": flipped("xlsx", 0.5),
    "segments_lvm": lambda folder: write_folder(
        folder, [clean_log()], replace(PLANS["lvm"], writer_options={"segments": 2})
    ),
    "dialect_hint_wrong": dialect("semicolon", "comma, decimal point"),
    "unit_in_file_differs": lambda folder: write_folder(
        folder, [clean_log()], replace(PLANS["tdms"], writer_options={"unit": "mV"})
    ),
    "unit_unknown": edited(('unit = "V"', 'unit = "Vlt"')),
    "unit_of_other_kind": edited(('unit = "V"', 'unit = "mm"')),
    "channel_unknown": edited(('channel = "Torque"', 'channel = "Torqe"')),
    "group_unknown": edited(('group = "Grp_torque"', 'group = "Torque"'), file_format="tdms"),
    "key_missing": edited(("nominal_speed_rpm = 600.0\n", "")),
    "key_unknown": edited(('\nnote = ""', '\nnote = ""\nroom_temperature_C = 21.0')),
    "key_misspelt": edited(("level_V = 5.0", "level_v = 5.0")),
    "value_impossible": edited(("plunger_diameter_m = 0.008", "plunger_diameter_m = -0.008")),
    "rate_contradicts": edited(("sample_rate_hz = 10000.0", "sample_rate_hz = 20000.0")),
    "rate_off_a_little": edited(("sample_rate_hz = 10000.0", "sample_rate_hz = 10010.0")),
    "nan_run_csv": changed(_put("pressure", slice(9000, 9050), np.nan), "csv"),
    "nan_run_hdf5": changed(_put("torque", slice(9000, 9400), np.nan)),
    "gap_csv": changed(_gap, "csv"),
    "gap_mf4": changed(_gap, "mf4"),
    "clock_jump_mat": changed(_jump(0.0421), "mat"),
    "clock_jump_catman": changed(_jump(0.0421), "catman"),
    "time_runs_back_csv": changed(_jump(-0.5), "csv"),
    "time_not_uniform_csv": changed(_jitter, "csv"),
    "clipped_pressure": changed(lambda log: log.with_volts("pressure", np.minimum(log.volts["pressure"], 1.8))),
    "clipped_torque": changed(lambda log: log.with_volts("torque", np.minimum(log.volts["torque"], 0.9))),
    "constant_pressure": changed(_put("pressure", slice(None), 0.01)),
    "constant_trigger": changed(_put("trigger", slice(None), 0.05)),
    "swapped_channels": changed(_swap),
    "inverted_torque": changed(_invert_torque),
    "trigger_missed": changed(_trigger(_missed)),
    "trigger_doubled": changed(_trigger(_doubled)),
    "trigger_dies": changed(_dead_trigger(slice(11_300, None))),
    "trigger_wakes_late": changed(_dead_trigger(slice(None, 11_300))),
    "trigger_bounced": changed(_trigger(_bounced)),
    "misfire": changed(_misfire),
    "speed_ramp": changed(_ramp),
    "start_stop": changed(_start_stop),
    "three_cycles_only": changed(lambda log: log, revolutions=4.2),
    "two_loggers": two_loggers(),
    "two_loggers_one_trigger": two_loggers(trigger_on_both=False),
    "spike_tdms": changed(_put("torque", slice(9000, 9001), 4.9), "tdms"),
    "out_of_range_tdms": changed(_put("pressure", slice(9000, 9003), 900.0), "tdms"),
}


def build_all(root: Path) -> None:
    """Write every case below ``root``."""
    for name, builder in BUILDERS.items():
        builder(root / name)


if __name__ == "__main__":
    build_all(Path(sys.argv[1]))
