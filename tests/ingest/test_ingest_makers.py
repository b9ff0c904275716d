"""Exports as makers of instruments write them, with their own header lines: what is read, and what is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from camtorque import cli
from camtorque.config import ChannelSpec
from camtorque.ingest import read_recording
from camtorque.ingest.csv_log import channels, read
from camtorque.ingest.formats import FORMATS
from camtorque.ingest.header import header_rate
from camtorque.ingest.raw import RawChannel, RawFile
from camtorque.records import Refusal
from test_ingest_new import ANSWERS
from test_ingest_new_formats import columns

N, RATE = 400, 2e4
TIME = np.arange(N) / RATE
TORQUE = np.round(1.2 * np.sin(0.05 * np.arange(N)), 3)
PRESSURE = np.round(2.0 + 1.5 * np.cos(0.05 * np.arange(N)), 3)
Row = Callable[[int, float, float, float], str]


@dataclass(frozen=True)
class Maker:
    """An export: lines above the numbers, a row, and what has to be read of it."""

    head: list[str]
    row: Row
    names: tuple[str, str] = ("CH1", "CH2")
    units: tuple[str, str] = ("", "")
    start: float = 0.0
    codes: tuple[str, ...] = ()
    encoding: str = "utf-8"


def separated(separator: str = ",", scale: float = 1.0, start: float = 0.0, end: str = "", comma: bool = False) -> Row:
    def row(_: int, t: float, a: float, b: float) -> str:
        text = separator.join((f"{scale * (t + start):.8f}", f"{a:+.5f}", f"{b:+.5f}")) + end
        return text.replace(".", ",") if comma else text

    return row


TEK_KEYS = [
    "Record Length,4.000000e+02", "Sample Interval,5.000000e-05", "Trigger Point,2.000000000000e+02", ",", ",",
    "Source,CH1", "Vertical Units,V", "Vertical Scale,2.000000e+00", "Vertical Offset,0.000000e+00",
    "Horizontal Units,s", "Horizontal Scale,7.2e-02", "Pt Fmt,Y", "Yzero,0.000000e+00", "Probe Atten,1.000000e+00",
    "Model Number,TDS2024B", "Serial Number,C101234", "Firmware Version,FV:v22.11",
]  # fmt: skip
GRAPHTEC = [
    "Vendor,GRAPHTEC Corporation", "Model,GL980", "Version,Ver1.35,Rev0001", "MaxChannel,8", "Sampling interval,50us",
    "Total data points,400", "Trigger,0", "Start time,2024/03/12,10:00:00", "AMP settings",
    "CH,Signal name,Amp,Input,Range,Filter,Span,,Unit", "CH1,Torque,M,DC,5V,Off,5,-5,V",
    "CH2,Pressure,M,DC,10V,Off,10,-10,V", "Data", "Number,Date,Time,us,CH1,CH2,Alarm,AlarmOut",
]  # fmt: skip
TEK = [
    "Model,MSO46", "Firmware Version,1.44.3.433", "", "Waveform Type,ANALOG,,", "Horizontal Units,s,,",
    "Sample Interval,5e-05,,", "Record Length,400,,", "Gating,0.0% to 100.0%,,", "Vertical Units,V,V,", ",,,",
    "Label,,,",
]  # fmt: skip
SIGLENT = [
    "Record Length,Analog:400,", "Sample Interval,Analog:5.000000E-05,", "Vertical Units,CH1:V, CH2:V,,",
    "Vertical Scale,CH1:1.00E+00, CH2:2.00E+00,,", "Horizontal Units,s,", "Horizontal Scale,5.00E-02,",
    "Model Number,SDS1104X-U,", "Serial Number,SDSAHBAX5R1440,", "Software Version,2.1.1.1.5",
]  # fmt: skip
INFINIIUM = [
    "Revision:,0", "Type:,raw", "Points:,400", "XDispOrg:,-1.00000000E-002", "XInc:,5.00000000E-005",
    "YInc:,1.20000000E-004", "Frame:,MSO9404A:MY50000000", "Date:,02 JUL 2012", "Time:,15:10:04:50",
    "X Units:,second", "Y Units:,Volt", "Data:,",
]  # fmt: skip
HIOKI = [
    '"File name","AUTO0001.CSV","V 1.00a"', '"Title comment",""', '"Start trigger time","\'24-03-12 10:00:00"',
    '"CH","U1-1","U1-2",', '"Mode","Voltage","Voltage",', '"Range","5V","10V",', '"Scaling","OFF","OFF",',
    '"Ratio"," 1.00000E+00"," 1.00000E+00",', '"Time","U1-1[V]","U1-2[V]","Event",',
]  # fmt: skip
DEWESOFT = [
    "Data info", "File name:\tTest_0001.dxd", "Sample rate:\t20000", "", "Events", "Event Type\tEvent\tTime\tComment",
    "1\tstoring started at\t10:00:00.000\t", "2\tstoring stopped at\t10:00:00.020\t", "", "Data1",
    "Time (s)\tCH1 (Nm)\tCH2 (bar)",
]  # fmt: skip
YOKOGAWA = [
    '"Header Size",16', '"Model Name","DL850E"', '"BlockNumber",1', '"TraceName","CH1","CH2"', '"BlockSize",400,400',
    '"VUnit","V","V"', '"SampleRate",20000,20000', '"HResolution",5.0E-05,5.0E-05', '"HOffset",-3.6E-01,-3.6E-01',
    '"HUnit","s","s"', '"DisplayPointNo.",1,1', '"Date","2024/03/12","2024/03/12"',
    '"Time","10:00:00.0000000","10:00:00.0000000"', "",
]  # fmt: skip
ETAS = ["ETASAsciiItemFile\trecord\tCrLf\tTab", "sampleCount\t400            ", "time\tCH1\tCH2", "f8\tf8\tf8"]
CATMAN = [
    "Zeit  1 - Standardmessrate\tCH1\tCH2", "s\tNm\tbar", "CH=1\tCH=2\tCH=3", "SR=20000\tSR=20000\tSR=20000",
    "T0 = 12.03.2024 10:00:00\tT0 = 12.03.2024 10:00:00\tT0 = 12.03.2024 10:00:00",
]  # fmt: skip
TOA5 = [
    '"TOA5","CR6","CR6","1234","CR6.Std.09","CPU:p.CR6","1234","Fast"', '"TIMESTAMP","RECORD","CH1","CH2"',
    '"TS","RN","Nm","bar"', '"","","Smp","Smp"',
]  # fmt: skip
VOLTS, SCALED = ("V", "V"), ("Nm", "bar")
PLACES = ("column 2", "column 3")
MAKERS: dict[str, Maker] = {
    "Tektronix MSO": Maker([*TEK, "TIME,CH1,CH2"], separated(start=-0.01), start=-0.01),
    "Tektronix MDO, analog and digital": Maker(
        ["Model,MDO3014", "Waveform Type,ANALOG,,Waveform Type,DIGITAL", "Sample Interval,5e-05,,Sample Interval,5e-05",
         "TIME,CH1,,TIME,D0"],
        lambda _, t, a, b: f"{t:.6e},{a:.5g},,{t:.6e},{b:.5g}", names=("CH1", "D0")),
    "Tektronix TDS, TBS": Maker(
        [], lambda n, t, a, b: f"{TEK_KEYS[n] if n < len(TEK_KEYS) else ','},,{t - 0.01:017.12f}, {a:.5f},{b:.5f}",
        names=("column 5", "column 6"), start=-0.01),
    "Keysight InfiniiVision": Maker(
        ["x-axis,1,2", "second,Volt,Volt"], separated(start=-0.01), ("1", "2"), ("Volt", "Volt"), -0.01),
    "Keysight Infiniium": Maker(INFINIIUM, separated(start=-0.01), PLACES, start=-0.01),
    "Teledyne LeCroy": Maker(
        ["LECROYWS3104z,12345,Waveform", "Segments,1,SegmentSize,400", "Segment,TrigTime,TimeSinceSegment1",
         "#1,06-Mar-2013 11:51:48,0", "Time,Ampl,Ampl2"], separated(), ("Ampl", "Ampl2")),
    "Rohde & Schwarz RTB": Maker(["in s,CH1 in V,CH2 in V"], separated(start=-0.01), units=VOLTS, start=-0.01),
    "Rohde & Schwarz RTM": Maker(["[s],CH1[V],CH2[V]"], separated(), units=VOLTS),
    "Rohde & Schwarz RTO values": Maker([], separated(";"), PLACES),
    "PicoScope": Maker(["Time,Channel A,Channel B", "(ms),(V),(V)", ""], separated(scale=1e3),
                       ("Channel A", "Channel B"), VOLTS),
    "PicoScope, German": Maker(["Zeit;Kanal A;Kanal B", "(ms);(V);(V)", ""], separated(";", 1e3, comma=True),
                               ("Kanal A", "Kanal B"), VOLTS),
    "Rigol DS1000Z": Maker(
        ["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-1.000000e-02,5.000000e-05"],
        lambda n, t, a, b: f"{n},{a:.5e},{b:.5e},", units=("Volt", "Volt"), codes=("samples_counted",)),
    "Rigol DS1000E": Maker(["X,CH1,CH2,", "Second,Volt,Volt,"], separated(end=","), units=("Volt", "Volt")),
    "Rigol MSO5000": Maker(["CH1V,CH2V,t0 =-1.000000e-02, tInc = 5.000000e-05,"],
                           lambda n, t, a, b: f"{a:.5e},{b:.5e},", ("CH1V", "CH2V")),
    "Siglent": Maker([*SIGLENT, "Source,CH1,CH2", "Second,Value,Value"], separated(start=-0.01), start=-0.01),
    "Siglent, older": Maker(
        ["Record Length,Analog:400", "Sample Rate,20000.0", "Vertical Scale,CH1: 1.00,CH2: 2.00",
         "Vertical Offset,CH1:0.00000,CH2:0.00000", "Horizontal Scale, 0.000500000", "Second,Volt,Volt"],
        separated(start=-0.01), PLACES, ("Volt", "Volt"), -0.01),
    "Yokogawa DL": Maker(YOKOGAWA, lambda n, t, a, b: f",{a:.6E},{b:.6E},", units=VOLTS),
    "DEWESoft": Maker(DEWESOFT, separated("\t"), units=SCALED),
    "catman ASCII": Maker(CATMAN, separated("\t", comma=True), units=SCALED, encoding="cp1252"),
    "Perception": Maker(["Perception ASCII Export", "Recording name: Test001.pnrf", "",
                         "Time (s);CH1 (Nm);CH2 (bar)"], separated(";"), units=SCALED),
    "imc FAMOS": Maker(["'x-Achse'\t'CH1'\t'CH2'", "'s'\t'Nm'\t'bar'"], separated("\t", comma=True), units=SCALED),
    "SignalExpress": Maker(["Time - CH1\tAmplitude - CH1\tTime - CH2\tAmplitude - CH2"],
                           lambda n, t, a, b: f"{t:.6f}\t{a:.5f}\t{t:.6f}\t{b:.5f}",
                           ("Amplitude - CH1", "Amplitude - CH2")),
    "TDMS by nptdms": Maker([",CH1,CH2"], lambda n, t, a, b: f"{t:.8g},{a},{b}"),
    "Gantner": Maker(["Timestamp;CH1;CH2", "[UTC];[Nm];[bar]"],
                     lambda n, t, a, b: f"2024-03-12 10:00:00.{50 * n:06d};{a};{b}", units=SCALED),
    "CANape": Maker(["time;CH1;CH2", "s;Nm;bar"], separated(";"), units=SCALED),
    "ETAS INCA": Maker([*ETAS, "s\tNm\tbar"], separated("\t"), units=SCALED),
    "ETAS INCA, quoted units": Maker([*ETAS, '"s"\t"Nm"\t"bar"'], separated("\t"), units=SCALED),
    "MATLAB timetable": Maker(["Time,CH1,CH2"], lambda n, t, a, b: f"{t:.15g} sec,{a},{b}"),
    "Graphtec GL980": Maker(GRAPHTEC, lambda n, t, a, b:
                            f"{n + 1},2024/03/12,10:00:00,{50 * n},{a:+.4f},{b:+.4f},LLLLLLLLLL,LLLL"),
    "Graphtec, blank behind signs": Maker(GRAPHTEC, lambda n, t, a, b: (
        f"{n + 1},2024/03/12,10:00:00,{50 * n},{a:+.4f},{b:+.4f},LLLL,LLLL".replace(",+", ",+ ").replace(",-", ",- "))),
    "Graphtec GL7000": Maker(
        ['Vendor,"GRAPHTEC Corporation"', 'Sampling interval,50us', "No.,Date&Time,us,CH1,CH2,Alarm1-10,AlarmOut",
         'NO.,Time,us,"V","V","A1234567890","AO1234"'],
        lambda n, t, a, b: f'{n + 1},2024-03-12 10:00:00,{50 * n},{a:+.4f},{b:+.4f},"LLLLLLLLLL","LLLL"', units=VOLTS),
    "Hioki": Maker(HIOKI, lambda n, t, a, b: f"{t: .9E},{a: .5E},{b: .5E},0,", ("U1-1", "U1-2"), VOLTS),
    "Saleae, analog": Maker(["Time [s],Channel 0,Channel 1"], separated(), ("Channel 0", "Channel 1")),
    "sigrok": Maker(["; CSV generated by libsigrok 0.6.0", "; Channels (2/2): CH1, CH2", "; Samplerate: 20 kHz", "V,V"],
                    lambda n, t, a, b: f"{a:.6f},{b:.6f}", units=VOLTS),
    "DAQami": Maker(
        ["File Name:,run.tdms", "Device:,USB-1608G", "Sample Rate:,20000", "",
         "Sample,Date/Time,CH1 (V),CH2 (V),Events"],
        lambda n, t, a, b: f"{n + 1},03/12/2024 10:00:00.{50 * n:06d} AM,{a:.6f},{b:.6f},", units=VOLTS),
    "LabJack": Maker(["Time\tv0\tv1\ty0\ty1"], lambda n, t, a, b: f"{t:.6f}\t0.1\t0.2\t{a:.6f}\t{b:.6f}", ("y0", "y1")),
    "pandas, range": Maker([",time_s,CH1,CH2"], lambda n, t, a, b: f"{n},{t:.8g},{a},{b}"),
    "pandas, dates": Maker([",CH1,CH2"], lambda n, t, a, b: f"2024-03-12 10:00:00.{50 * n:06d},{a},{b}"),
    "pandas, time deltas": Maker([",CH1,CH2"], lambda n, t, a, b: f"0 days 00:00:00.{50 * n:06d},{a},{b}"),
    "Excel, German": Maker(["Zeit [s];CH1 [Nm];CH2 [bar]"], separated(";", comma=True), units=SCALED,
                           encoding="utf-8-sig"),
    "Excel, with its separator": Maker(["sep=;", "Zeit [s];CH1 [Nm];CH2 [bar];"], separated(";", comma=True, end=";"),
                                       units=SCALED, encoding="cp1252"),
    "units behind a word": Maker(["Zeit in ms;CH1 in Nm;CH2 in bar"], separated(";", 1e3, comma=True), units=SCALED),
    "Micsig": Maker(
        ["ProID,Info,,time,Vol.,Vol2,"],
        lambda n, t, a, b: f"{TEK_KEYS[n] if n < 2 else ','},,{t:.6e},{a:.5e},{b:.5e},", ("Vol.", "Vol2")),
    "Campbell TOA5": Maker(
        TOA5,
        lambda n, t, a, b: f'"2024-03-12 10:00:00.{50 * n:06d}",{n},{a},{b}'.replace('000",', '",'), units=SCALED),
}  # fmt: skip


def written(folder: Path, maker: Maker) -> Path:
    file = folder / "log.csv"
    rows = [maker.row(n, t, a, b) for n, (t, a, b) in enumerate(zip(TIME, TORQUE, PRESSURE, strict=True))]
    file.write_bytes(("\r\n".join([*maker.head, *rows]) + "\r\n").encode(maker.encoding))
    return file


def read_as(file: Path, *wanted: tuple[str, str, str], rate: float = RATE, time: str = "") -> RawFile:
    specs = (ChannelSpec(q, file, "", name, unit, "L", rate, "", time_channel=time) for q, name, unit in wanted)
    return read(file, tuple(specs), "")


ONE_EACH: dict[str, tuple[list[str], str, str]] = {
    "Teledyne LeCroy": (
        ["LECROYWS3104z,12345,Waveform", "Segments,1,SegmentSize,400", "Segment,TrigTime,TimeSinceSegment1",
         "#1,06-Mar-2013 11:51:48,0", "Time,Ampl"], "Ampl", ""),
    "Keysight Infiniium": (INFINIIUM, "column 2", ""),
    "Siglent, older": (
        ["Record Length,Analog:400", "Sample Rate,20000.0", "Vertical Scale,CH1: 1.00", "Vertical Offset,CH1:0.00000",
         "Horizontal Scale, 0.000500000", "Second,Volt"], "column 2", "Volt"),
    "Rohde & Schwarz RTC": (["in s,CH1 in V"], "CH1", "V"),
}  # fmt: skip
"""Of makers that write a file for each channel."""


@pytest.mark.parametrize("name", ONE_EACH)
def test_a_file_for_each_channel(tmp_path: Path, name: str):
    head, channel, unit = ONE_EACH[name]
    file = tmp_path / "log.csv"
    body = [f"{t - 0.01:.8E},{a:.5f}" for t, a in zip(TIME, TORQUE, strict=True)]
    file.write_text("\r\n".join([*head, *body, ""]), encoding="utf-8")
    (found,) = channels(file)
    assert (found.name, found.unit, found.sample_rate) == (channel, unit, pytest.approx(RATE))
    raw = read_as(file, ("torque", channel, unit or "N m"), time=found.time_channel)
    np.testing.assert_allclose(raw.channels[0].source.read(0, N), TORQUE, atol=1e-6)
    assert (raw.channels[0].start_time, raw.findings) == (pytest.approx(-0.01), ())


@pytest.mark.parametrize("name", MAKERS)
def test_exports_of_makers_are_read_as_they_are(tmp_path: Path, name: str):
    maker = MAKERS[name]
    file = written(tmp_path, maker)
    listed = {channel.name: channel for channel in channels(file)}
    first, second = (listed[channel] for channel in maker.names)
    assert (first.unit, second.unit) == maker.units
    assert first.sample_rate == second.sample_rate == pytest.approx(RATE)
    assert len(listed) <= 4, "neither times nor counts nor words"
    wanted = (("torque", first.name, first.unit or "N m"), ("pressure", second.name, second.unit or "bar"))
    raw = read_as(file, *wanted, time=first.time_channel)
    for channel, truth in zip(raw.channels, (TORQUE, PRESSURE), strict=True):
        np.testing.assert_allclose(channel.source.read(0, 10**6), truth, atol=1e-6)
        assert channel.sample_rate == pytest.approx(RATE, rel=1e-5)
        assert channel.start_time == pytest.approx(maker.start, abs=1e-9)
    assert {finding.code for finding in raw.findings} == set(maker.codes)


def test_every_kind_of_channel_beside_its_own_times_in_one_table(tmp_path: Path):
    """CANoe and INCA write a row for each message: the cells of the other channels are blank in it."""
    events = [(t, 0, a) for t, a in zip(TIME, TORQUE, strict=True)]
    events += [(t + 1.2e-5, 1, b) for t, b in zip(TIME[::3], PRESSURE[::3], strict=True)]
    body = [f"{t:.6f};{'' if k else f'{x:.4f}'};{f'{x:.4f}' if k else ''}" for t, k, x in sorted(events)]
    file = tmp_path / "canoe.csv"
    file.write_text("\n".join(["Time[s];Torque[Nm];Pressure[bar]", *body, ""]), encoding="utf-8")
    assert [(c.name, c.sample_rate) for c in channels(file)] == [
        ("Torque", pytest.approx(RATE)), ("Pressure", pytest.approx(RATE / 3, rel=1e-4))]  # fmt: skip
    specs = [ChannelSpec("torque", file, "", "Torque", "N m", "L", RATE, "")]
    specs += [ChannelSpec("pressure", file, "", "Pressure", "bar", "L", RATE / 3, "")]
    raw = read(file, tuple(specs), "")
    for channel, truth, start in zip(raw.channels, (TORQUE, PRESSURE[::3]), (0.0, 1.2e-5), strict=True):
        np.testing.assert_allclose(channel.source.read(0, N), truth, atol=1e-6)
        assert channel.start_time == pytest.approx(start, abs=1e-9)
    assert raw.findings == ()


def test_a_column_of_words_is_named_as_that_where_it_is_wanted(tmp_path: Path):
    body = [f"{t:.5f},{a},{'closed' if n % 40 else 'open'}" for n, (t, a) in enumerate(zip(TIME, TORQUE, strict=True))]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["Time [s],Torque [Nm],Switch", *body, ""]), encoding="utf-8")
    assert [channel.name for channel in channels(file)] == ["Torque"]
    with pytest.raises(Refusal, match="column 'Switch' holds words, expected numbers, or levels as true and false"):
        read_as(file, ("trigger", "Switch", "logic"))


def test_milliseconds_that_run_on_are_no_fraction_of_the_second_beside(tmp_path: Path):
    stamps = [f"10:00:{n // 100:02d};{10 * n}" for n in range(N)]
    file = tmp_path / "log.csv"
    body = [f"{stamp};{a}" for stamp, a in zip(stamps, TORQUE, strict=True)]
    file.write_text("\n".join(["Time;ms;Torque [Nm]", *body, ""]), encoding="utf-8")
    raw = read_as(file, ("torque", "Torque", "N m"), rate=100.0)
    assert [finding.code for finding in raw.findings] == ["time_stamps_coarse"]
    np.testing.assert_allclose(raw.channels[0].source.read(0, N), TORQUE)


def changes(folder: Path, head: list[str], times: np.ndarray) -> Path:
    file = folder / "digital.csv"
    body = [f"{t:.9f},{n % 2}" for n, t in enumerate(times)]
    file.write_text("\n".join([*head, *body, ""]), encoding="utf-8")
    return file


DSVIEW = ["; CSV, generated by libsigrok4DSL 0.2.0", "; Channels (1/16)", "; Sample rate: 1 MHz", "Time(s), PROX"]


@pytest.mark.parametrize(("head", "name"), [(["Time [s],Channel 0"], "Channel 0"), (DSVIEW, "PROX")])
def test_levels_that_are_written_at_their_changes_are_held(tmp_path: Path, head: list[str], name: str):
    times = np.concatenate([[0.0], np.cumsum(np.tile([0.003, 0.057], 20))])
    file = changes(tmp_path, head, times)
    assert [(c.name, c.sample_rate, c.n_samples) for c in channels(file)] == [(name, 1e5, 120_001)]
    raw = read_as(file, ("trigger", name, "logic"), rate=1e5)
    values = raw.channels[0].source.read(0, 10**6)
    np.testing.assert_allclose(np.flatnonzero(np.diff(values)) + 1, np.round(1e5 * times[1:]))
    assert [finding.code for finding in raw.findings] == ["levels_held"]
    without = changes(tmp_path, [*head[:-1], f"Time,{name}"], times)
    with pytest.raises(Refusal, match="the time column 'Time' has no unit; write the unit behind its name, as in Time"):
        read_as(without, ("trigger", name, "logic"), rate=1e5)
    changes(tmp_path, head, times)
    with pytest.raises(Refusal, match=r"held from change to change, would be 1\.2e\+09 samples at 1e\+09 Hz"):
        read_as(file, ("trigger", name, "logic"), rate=1e9)


def cycles(head: list[str], body: list[str], folder: Path) -> Path:
    file = folder / "cycles.csv"
    file.write_text("\n".join([*head, *body, ""]), encoding="utf-8")
    return file


ANGLES = np.arange(0.0, 360.0, 0.5)


def test_a_table_of_three_rates_without_times_is_listed(tmp_path: Path):
    """No column is filled in half of the rows: the last one's name was taken for that of an angle beside cycles."""
    file = tmp_path / "three.csv"
    cells = [",".join(f"{n % 7}" if n % 3 == place else "" for place in range(3)) for n in range(300)]
    file.write_text("\n".join(["p,q,angle", *cells]) + "\n")
    assert [channel.name for channel in channels(file)] == ["p", "q", "angle"]


def test_cycles_side_by_side_are_refused_with_what_to_export(tmp_path: Path):
    beside = [f"{angle:.1f};" + ";".join(f"{np.sin(angle / 57.3) + k:.4f}" for k in range(4)) for angle in ANGLES]
    indicom = cycles(["CRANK ANGLE;TQ_1;TQ_2;TQ_3;TQ_4", "deg;Nm;Nm;Nm;Nm"], beside, tmp_path)
    with pytest.raises(
        Refusal, match=r"'CRANK ANGLE' runs once over 0\.999 turns.* \(4 here\).*export the recording ov"
    ):
        channels(indicom)
    numbered = cycles(["CA;TQ;TQ;TQ;TQ", "deg;Nm;Nm;Nm;Nm", ";1;2;3;4"], beside, tmp_path)
    with pytest.raises(Refusal, match="'CA' runs once over"):
        channels(numbered)
    rows = [f"{k};" + ";".join(f"{np.sin(angle / 57.3) + k:.4f}" for angle in ANGLES) for k in range(4)]
    kibox = cycles(
        ["Signal;TORQUE", "Unit;Nm", "Cycle;" + ";".join(f"{angle:.1f}" for angle in ANGLES)], rows, tmp_path
    )
    with pytest.raises(Refusal, match="holds 721 columns of 4 rows, as cycles in rows do; expected samples over time"):
        channels(kibox)


def test_the_number_of_a_cycle_is_no_time(tmp_path: Path):
    body = [f"{k + 1};{angle:.1f};{angle / 9:.3f}" for k in range(12) for angle in ANGLES]
    file = cycles(["Cycle;CA;TORQUE", "-;deg;Nm"], body, tmp_path)
    assert {(c.name, c.sample_rate, c.time_channel) for c in channels(file)} == {
        ("Cycle", None, ""), ("CA", None, ""), ("TORQUE", None, "")}  # fmt: skip


def test_a_step_may_stand_below_its_name_or_behind_a_sign():
    assert header_rate(["X,CH1,Start,Increment,", "Sequence,Volt,-1.0e-02,5.0e-05"], ",") == pytest.approx(2e4)
    assert header_rate(["CH1V,t0 =-1.000000e-02, tInc = 5.000000e-05,"], ",") == pytest.approx(2e4)
    assert header_rate(["X,CH1,Start,Increment,", "Sequence,Volt"], ",") is None


def test_times_of_variables_named_after_them_are_no_channels(tmp_path: Path):
    from scipy.io import savemat

    file = tmp_path / "dewesoft.mat"
    named = {"Data1_Torque": TORQUE, "Data1_time_Torque": TIME, "Data1_Pressure": PRESSURE, "Data1_time_Pressure": TIME}
    savemat(file, {name: values.reshape(-1, 1) for name, values in named.items()})
    assert [(c.name, c.sample_rate, c.time_channel) for c in FORMATS["mat"].channels(file)] == [
        ("Data1_Torque", pytest.approx(RATE), "Data1_time_Torque"),
        ("Data1_Pressure", pytest.approx(RATE), "Data1_time_Pressure")]  # fmt: skip


def mat_channels(file: Path, variables: dict[str, object], *names: tuple[str, str]) -> list[RawChannel]:
    """Return what a MATLAB file of some variables has to say of channels by (group, name)."""
    from scipy.io import savemat

    savemat(file, variables)
    specs = [ChannelSpec("torque", file, group, name, "V", "L", RATE, "") for group, name in names]
    return list(FORMATS["mat"].read(file, tuple(specs), "").channels)


def test_a_variable_is_timed_by_the_one_named_after_it(tmp_path: Path):
    """Each channel has times of its own; a shift of 12 ms between them was lost where nobody named them."""
    held = {
        "Data1_Torque": TORQUE,
        "Data1_time_Torque": TIME,
        "Data1_Pressure": PRESSURE,
        "Data1_time_Pressure": TIME + 0.012,
    }
    torque, pressure = mat_channels(tmp_path / "log.mat", held, ("", "Data1_Torque"), ("", "Data1_Pressure"))
    assert pressure.start_time - torque.start_time == pytest.approx(0.012, abs=1e-9)


@pytest.mark.parametrize("step", ["dt", "Ts", "Sample_Interval", "Tinterval"])
def test_step_and_start_in_the_struct_of_a_channel_count(tmp_path: Path, step: str):
    held = {name: {"Data": TORQUE, step: 1.0 / RATE, "Start": start} for name, start in (("T", 0.0), ("P", 0.25))}
    torque, pressure = mat_channels(tmp_path / "log.mat", held, ("T", "Data"), ("P", "Data"))
    assert (torque.start_time, pressure.start_time, pressure.sample_rate) == pytest.approx((0.0, 0.25, RATE))
    slow = {"T": {"Data": TORQUE, step: 2.0 / RATE}}
    with pytest.raises(Refusal, match="the file says"):
        mat_channels(tmp_path / "slow.mat", slow, ("T", "Data"))


def test_from_a_logic_analyser_beside_a_logger_to_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    times, torque, pressure, trigger = columns()
    (tmp_path / "lab").mkdir()
    log = tmp_path / "lab" / "analog.csv"
    body = [f"{t:.6f},{a:.3f},{b:.2f}" for t, a, b in zip(times, torque, pressure, strict=True)]
    log.write_text("\n".join(["Time [s],Torque [Nm],Pressure [bar]", *body, ""]), encoding="utf-8")
    level = (trigger > 2.5).astype(int)
    at = np.concatenate([[0], np.flatnonzero(np.diff(level)) + 1])
    digital = tmp_path / "lab" / "digital.csv"
    rows = [f"{times[n]:.9f},{level[n]}" for n in at]
    digital.write_text("\n".join(["Time [s],Channel 0", *rows, ""]), encoding="utf-8")
    assert cli.main(["new", str(log), str(digital)]) == 0
    toml = log.parent / "recording.toml"
    answers = {**ANSWERS, "clock": '"synchronised"'}
    text = toml.read_text(encoding="utf-8")
    toml.write_text(re.sub(r'^(\w+) = "\?"', lambda m: f"{m[1]} = {answers[m[1]]}", text, flags=re.MULTILINE))
    capsys.readouterr()
    assert cli.main(["check", str(log.parent), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["usable"] == ["align", "run"]
    held = read_recording(log.parent).of("trigger")[0]
    np.testing.assert_allclose(np.flatnonzero(np.diff(held.read_volts())) / held.sample_rate, times[at[1:]], atol=2e-5)
