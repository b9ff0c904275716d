"""From a stranger's fresh log to a recording that runs: `new`, one edit, `check` or `run` at once, for every format."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pytest
from camtorque import cli
from camtorque.ingest import read_recording
from camtorque.ingest.header import name_and_unit
from damaged.logs import CALIBRATION
from test_ingest_new import ANSWERS

Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
SAMPLES = 5_000
EVERY = 5
"""Of the example's samples, which are 20 us apart: a format is no other for more of them."""


@cache
def columns() -> Columns:
    """Return time [s], torque [N m], line pressure [bar] and trigger [V] of ten revolutions of an example."""
    recording = read_recording(CALIBRATION.parent / "raw_examples" / "A_1250rpm")
    torque, pressure, trigger = (recording.of(name)[0] for name in ("torque", "pressure", "trigger"))
    times = np.arange(SAMPLES) * (EVERY / torque.sample_rate)
    end = SAMPLES * EVERY
    kept = (
        values[::EVERY] for values in (torque.read(0, end), 1e-5 * pressure.read(0, end), trigger.read_volts(0, end))
    )
    return times, *kept


def lines(separator: str = ",", scale: float = 1.0, end: str = "") -> list[str]:
    rows = zip(*columns(), strict=True)
    texts = [separator.join((f"{scale * t:.6f}", f"{a:.3f}", f"{b:.2f}", f"{c:.3f}")) + end for t, a, b, c in rows]
    return [text.replace(".", ",") for text in texts] if separator == ";" else texts


def text(*head: str, encoding: str = "utf-8", **layout: object) -> Callable[[Path], None]:
    def write(file: Path) -> None:
        file.write_text("\n".join([*head, *lines(**layout)]) + "\n", encoding=encoding)  # type: ignore[arg-type]

    return write


def dated(file: Path) -> None:
    rows = [f"12.03.2024 10:00:{float(line[:8]):09.6f}{line[8:]}" for line in lines()]
    file.write_text("\n".join(["Datum/Uhrzeit,torque_Nm,pressure_bar,trigger_V", *rows]) + "\n", encoding="utf-8")


def lvm(file: Path) -> None:
    step, end = float(columns()[0][1]), "***End_of_Header***"
    head = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tOne", end, ""]
    head += ["Channels\t3", f"Samples\t{SAMPLES}\t{SAMPLES}\t{SAMPLES}", "Y_Unit_Label\tN·m\tbar\tVolts"]
    head += [f"Delta_X\t{step:g}\t{step:g}\t{step:g}", end, "X_Value\tMoment\tDruck\tGeber\tComment"]
    file.write_text("\r\n".join([*head, *lines("\t")]) + "\r\n", encoding="utf-8", newline="")


def lvm_with_times_each(file: Path) -> None:
    step, end = float(columns()[0][1]), "***End_of_Header***"
    head = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t,", "X_Columns\tMulti", end, ""]
    head += ["Channels\t3", f"Samples\t{SAMPLES}\t\t{SAMPLES}\t\t{SAMPLES}", "Y_Unit_Label\tN·m\t\tbar\t\tVolts"]
    head += [f"Delta_X\t{step:g}\t\t{step:g}\t\t{step:g}", end, "X_Value\tMoment\tX_Value\tDruck\tX_Value\tGeber"]
    rows = [f"{t:.6f}\t{a:.3f}\t{t:.6f}\t{b:.2f}\t{t:.6f}\t{c:.3f}" for t, a, b, c in zip(*columns(), strict=True)]
    text = "\r\n".join([*head, *(row.replace(".", ",") for row in rows), ""])
    file.write_text(text, encoding="cp1252", newline="")


def levels(file: Path) -> None:
    rows = [f"{t:.6f},{a:.3f},{b:.2f},{'ON' if c > 2.5 else 'OFF'}" for t, a, b, c in zip(*columns(), strict=True)]
    file.write_text("\n".join(["Time [s],Torque [Nm],Pressure [bar],DI0", *rows, ""]), encoding="utf-8")


def matrix(file: Path) -> None:
    times, *values = columns()
    with h5py.File(file, "w") as store:
        data = store.create_dataset("acq/data", data=np.column_stack(values))
        data.attrs["names"], data.attrs["units"] = ["drive torque", "line pressure", "prox"], ["Nm", "bar", "V"]
        data.attrs["fs"] = 1.0 / times[1]


def xlsx_of_texts(file: Path) -> None:
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    sheet = book.create_sheet("Daten")
    for row in (["Datum", "12.03.2024"], [], ["Zeit", "Drehmoment", "Druck", "Geber"], ["", "Nm", "bar", "V"]):
        sheet.append(row)
    for time, *row in zip(*(column.tolist() for column in columns()), strict=True):
        sheet.append([f"12.03.2024 10:00:{time:09.6f}", *row])
    book.save(file)


def xlsx(file: Path) -> None:
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    book.create_sheet("Info").append(["bench", 4])
    sheet = book.create_sheet("Daten")
    for row in (["Prüfstand 4"], [], ["Zeit", "Drehmoment", "Druck", "Geber"], ["s", "Nm", "bar", "V"]):
        sheet.append(row)
    for row in zip(*(column.tolist() for column in columns()), strict=True):
        sheet.append(row)
    book.save(file)


def arrow(with_dates: bool) -> Callable[[Path], None]:
    def write(file: Path) -> None:
        pyarrow = pytest.importorskip("pyarrow")
        times, *values = columns()
        dates = pyarrow.array(np.datetime64("2024-03-12") + np.round(1e9 * times).astype("timedelta64[ns]"))
        names = ["__index_level_0__" if with_dates else "Time", "Torque (Nm)", "p_line [bar]", "Trig [V]"]
        table = pyarrow.table([dates if with_dates else pyarrow.array(times), *map(pyarrow.array, values)], names)
        if file.suffix == ".parquet":
            pytest.importorskip("pyarrow.parquet").write_table(table, file)
        else:
            pytest.importorskip("pyarrow.feather").write_feather(table, file)

    return write


def tdms(file: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    times, *values = columns()
    wave = {"wf_increment": float(times[1]), "wf_start_offset": 0.0}
    named = zip(("Drehmoment", "Druck", "Geber"), ("Nm", "bar", "V"), values, strict=True)
    with TdmsWriter(file) as writer:
        writer.write_segment([ChannelObject("Messdaten", n, v, {**wave, "unit_string": unit}) for n, unit, v in named])


def mf4(file: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    times, torque, pressure, trigger = columns()
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(torque, times, name="Drehmoment", unit="N·m")])
        mdf.append([asammdf.Signal(pressure, times, name="Druck", unit="bar")])
        mdf.append([asammdf.Signal((trigger > 2.5).astype("u1"), times, name="Geber", unit="")])
        mdf.save(file, overwrite=True)


def hdf5(file: Path) -> None:
    with h5py.File(file, "w") as store:
        group = store.create_group("data")
        named = zip(("time", "torque", "pressure", "trigger"), ("s", "Nm", "bar", "V"), columns(), strict=True)
        for name, unit, values in named:
            group.create_dataset(name, data=values).attrs["units"] = unit


STRANGERS: dict[str, Callable[[Path], None]] = {
    "lines_before_the_header.csv": text("Bench 4", "By: Müller", "", "Time (s),Torque (Nm),Pressure (bar),Trig (V)"),
    "row_of_units.csv": text("Zeit;Drehmoment;Druck;Geber", "s;Nm;bar;V", separator=";", encoding="cp1252"),
    "comma_at_the_end.csv": text("time [s],torque [Nm],pressure [bar],prox [V],", end=","),
    "slashes.csv": text('"Time / s";"M_d / N·m";"p_rail / bar";"Hall / V"', separator=";"),
    "milliseconds.csv": text("Time [ms],Torque [Nm],Pressure [bar],Trigger [V]", scale=1e3),
    "brackets_below.txt": text("# logger", "t\tMd\tp\tTrig", "[s]\t[Nm]\t[bar]\t[V]", separator="\t"),
    "dates.csv": dated,
    "labview.lvm": lvm,
    "a_time_for_each_channel.lvm": lvm_with_times_each,
    "on_and_off.csv": levels,
    "matrix_with_units.h5": matrix,
    "excel.xlsx": xlsx,
    "stamps_as_texts.xlsx": xlsx_of_texts,
    "seconds.parquet": arrow(False),
    "dates.parquet": arrow(True),
    "seconds.feather": arrow(False),
    "waveforms.tdms": tdms,
    "groups.mf4": mf4,
    "sets.h5": hdf5,
}  # fmt: skip


def new_and_edit(name: str, folder: Path) -> Path:
    """Write a log, let `new` describe it, and fill in what it asks: the one edit."""
    folder.mkdir()
    STRANGERS[name](folder / name)
    assert cli.main(["new", str(folder / name)]) == 0
    toml = folder / "recording.toml"
    written = toml.read_text(encoding="utf-8")
    assert set(re.findall(r'^(\w+) = "\?"', written, re.MULTILINE)) == set(ANSWERS), "only what no log can tell"
    edited = re.sub(r'^(\w+) = "\?"', lambda match: f"{match[1]} = {ANSWERS[match[1]]}", written, flags=re.MULTILINE)
    toml.write_text(edited, encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", STRANGERS)
def test_two_commands_and_one_edit(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = new_and_edit(name, tmp_path / "lab")
    capsys.readouterr()
    assert cli.main(["check", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["usable"] == ["align", "run"]
    recording = read_recording(folder)
    times, torque, pressure, _ = columns()
    assert recording.of("torque")[0].sample_rate == pytest.approx(1.0 / times[1], rel=1e-6)
    np.testing.assert_allclose(recording.of("torque")[0].read(), torque, atol=6e-4)
    np.testing.assert_allclose(1e-5 * recording.of("pressure")[0].read(), pressure, atol=6e-3)


def test_from_a_labview_log_to_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = new_and_edit("labview.lvm", tmp_path / "lab")
    capsys.readouterr()
    assert cli.main(["run", str(folder), "--out", str(tmp_path / "report"), "--json", "--quiet"]) == 0
    doc = json.loads((tmp_path / "report" / "result.json").read_text(encoding="utf-8"))
    assert doc["explained"]
    assert doc["parameters"]["trigger_offset"]["stderr"] < 0.5
    assert (tmp_path / "report" / "report.html").exists()


def test_a_slash_before_a_known_unit_is_one():
    assert name_and_unit("Time / s") == ("Time", "s")
    assert name_and_unit("in / out") == ("in / out", "")
    assert name_and_unit("km/h") == ("km/h", "")
    assert name_and_unit("flow [l/min]") == ("flow", "l/min")
