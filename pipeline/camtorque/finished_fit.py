"""What the reports behind a finished fit tell: values, sheets of the pump, line pressures, and whose load one is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from camtorque.align import align
from camtorque.config import PumpData, RecordingConfig
from camtorque.config.recording import load_recording_config
from camtorque.fit.known_ends import Curve
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.prepare import FIT_GRID, cam_swing, over_even_angle
from camtorque.fit.problem import SEPARATOR
from camtorque.hashes import input_file, input_files
from camtorque.ingest import read_recording
from camtorque.ingest.cam_table import read_cam_table
from camtorque.ingest.pump_file import read_pump
from camtorque.ingest.pump_sizes import check_pump
from camtorque.ingest.sheet import read_sheet
from camtorque.laws import ROWS
from camtorque.laws.chain import ChainInput
from camtorque.mechanism.cam import stroke_count
from camtorque.mechanism.lift_laws import spectral_law
from camtorque.records import DEVIATION, LEAD, ORDERS_TOLD, CamTable, Finding, Refusal
from camtorque.report.fit_file import NAME, SCHEMA, known_covariance, known_lift, known_shown
from camtorque.results import CAMPAIGN, read_document, read_result, recording_of, refuse_changed, report_named
from camtorque.units import DEGREE, RPM, TURN, angle_grid, counted
from camtorque.version import __version__

CYCLES = "cycles.h5"
BEGUN, BEGINS_APART = 0.02, 15.0 * DEGREE
"""Share of the stroke from which a lift has begun, and how far from the fitted one's another cam's may begin: flanks
of 40 to 90 degrees, harmonic to 4-5-6-7, reach it 4 to 14 degrees after their start [rad]."""
SAME_SIZE = 0.01
"""Share by which plungers and strokes of one pump may differ: a lift table is measured."""


@dataclass(frozen=True)
class Rig:
    """What sheets say: pump, lift table, direction of running, nominal trigger angle [rad], the transducer's filter.

    findings : what is odd about another pump or cam than the recording's
    has_teeth : whether the recording tells the cam's angle more than once a turn already
    """

    pump: PumpData
    table: CamTable
    rotation: int
    trigger_angle: float
    low_pass_order: int = 0
    findings: tuple[Finding, ...] = ()
    has_teeth: bool = False


class FinishedFit(NamedTuple):
    """A fit, its folder, and what its fit.json says of each recording that it explains."""

    known: KnownFit
    folder: Path
    rows: list[dict[str, Any]]

    @property
    def reports(self) -> dict[str, Path]:
        """Folder of the report of each recording."""
        return {row["id"]: self.folder / row["folder"] for row in self.rows}


def read_fit(path: Path) -> FinishedFit:
    """Return the fit beside a result.json or campaign.json, or in such a folder.

    Raises
    ------
    Refusal : there is none, or it is of another schema or of a version with other parameters
    """
    folder = path if path.is_dir() else path.parent
    file = folder / NAME
    if not file.is_file() and (folder / CAMPAIGN).is_file():
        raise Refusal(
            f"{folder}: a campaign without a joint fit (its page says why), expected one with it; take the report of "
            "one recording, in its runs"
        )
    if not path.exists() or not file.is_file():
        where = "beside it" if path.exists() else "there, nor such a path"
        raise Refusal(
            f"{path}: found no {NAME} {where}, expected the report of `camtorque run` or of a campaign with a joint "
            "fit; make the report again"
        )
    doc = read_document(file, SCHEMA, "a report of `camtorque run`, or make it again")
    rows = [row for row in doc["recordings"] if row["explained"]]
    unexplained = [row["id"] for row in doc["recordings"] if not row["explained"]]
    if not rows:
        raise Refusal(
            f"{file}: its model leaves {', '.join(unexplained)} unexplained, expected a fit whose intervals can be "
            "relied on; mend what the report names and make it again"
        )
    strange = [name for name in doc["names"] if name.split(SEPARATOR)[0] not in ROWS]
    if strange:
        raise Refusal(
            f"{file}: holds {', '.join(strange[:3])}, expected parameters of this version ({__version__}); it was "
            "written by another one: make the report again"
        )
    recordings = tuple(_fitted_at(row) for row in doc["recordings"])
    values = np.array(doc["values"], dtype=np.float64)
    known = KnownFit(tuple(doc["names"]), values, known_covariance(doc), recordings, known_shown(doc), known_lift(doc))
    return FinishedFit(known.without(unexplained), folder, rows)


def _fitted_at(row: Mapping[str, Any]) -> FittedAt:
    share = (row["left_out_rms_percent"] or {}).get("own_zero_and_end")
    used = row["rms_percent_of_peak"] if share is None else share
    return FittedAt(row["id"], row["speed_rpm"] * RPM, row["structure"], used / 100.0, share is not None)


def rig_of(report: Path, pump: Path | None = None, cam: Path | None = None) -> Rig:
    """Return the pump of a report's recording, with another pump or cam if one is given.

    Raises
    ------
    Refusal : the recording's sheets are gone, or have changed since the report was made; sizes that no one pump has
    """
    config = load_recording_config(recording_of(report))
    data, rotation, table = config.pump, config.rotation, None
    findings: tuple[Finding, ...] = ()
    torque = config.sensors.get("torque")
    own_table = data.cam_table_path if pump is None and cam is None else None
    sheets = (own_table, None if torque is None else torque.calibration_path)
    refuse_changed(report, input_files(*sheets))
    if pump is not None:
        other, findings = read_pump(pump)
        if other.cam_table is None and cam is None:
            raise Refusal(f"{pump}: its cam is given by sections, expected a lift table; name one with --cam")
        data, rotation, table = other.pump, other.rotation, other.cam_table
    if cam is not None:
        data = replace(data, cam_table_path=cam, cam_table_zero=0.0)  # the key is of the recording's own table
        table, notes = read_cam_table(data)
        findings = (*notes, *check_pump(data, table, rotation, pump or config.path))
    table = read_cam_table(data)[0] if table is None else table
    order = read_sheet(torque).filter_order if torque is not None else 0
    return Rig(data, table, rotation, config.trigger.nominal_angle, order, findings, config.has_teeth)


def curve_of(report: Path, speed: float) -> Curve:
    """Return the mean line pressure of a report."""
    with h5py.File(report / CYCLES) as file:
        theta, pressure = (np.asarray(file[name], dtype=np.float64) for name in ("theta", "mean/pressure"))
        wheel = {name: np.asarray(file[f"mean/{name}"]) for name in (DEVIATION, LEAD) if f"mean/{name}" in file}
        orders = int(file[f"mean/{ORDERS_TOLD}"][0]) if f"mean/{ORDERS_TOLD}" in file else 0
    swing = cam_swing(load_recording_config(recording_of(report)), wheel, orders) if wheel else None
    return Curve(theta, pressure, speed, swing=swing)


def chain_of(rig: Rig, speed: float, curve: Curve, structure: str) -> ChainInput:
    """Return the chain of a pump at a speed and a line pressure; its torque is still zero.

    ``structure`` is that of the fitted recording that stands in: where it has no chamber, this has none.
    """
    return ChainInput(
        theta=angle_grid(FIT_GRID), speed=speed, line_pressure=over_even_angle(curve.pressure, curve.swing),
        shaft_torque=np.zeros(FIT_GRID),
        trigger_angle=rig.trigger_angle, pump=rig.pump, law=spectral_law(rig.table),
        offset=rig.pump.follower_offset * rig.rotation, low_pass_order=rig.low_pass_order,
        uses_chamber=structure != "line",
        swing=curve.swing,
    )  # fmt: skip


def load_curve(path: Path) -> tuple[str, Curve]:
    """Return the name of a recording, or of that of a report, and its mean line pressure.

    Raises
    ------
    Refusal : it is neither, or has no pressure
    """
    report = report_named(path)
    if report is not None:
        said = read_result(report / "result.json")["recording"]
        return said["name"], curve_of(report, said["speed_rpm"] * RPM)
    recording = read_recording(path)
    cycles = align(recording)
    if not cycles.pressure.size:
        raise Refusal(f"{path}: has no pressure channel, expected one: it is the load; name another recording")
    swing = cam_swing(recording.config, cycles.details)
    return recording.config.id, Curve(cycles.theta, cycles.mean_pressure, cycles.mean_speed, swing=swing)


def _config_of_load(path: Path) -> RecordingConfig:
    report = report_named(path)
    return load_recording_config(path if report is None else recording_of(report))


def refuse_load_of_another_place(path: Path, reports: Iterable[Path]) -> None:
    """Refuse a load measured in the chamber where fitted recordings measured that of a line, and the other way."""
    inside = _config_of_load(path).measures_chamber
    for report in reports:
        if load_recording_config(recording_of(report)).measures_chamber != inside:
            found, wanted = ("chamber", "line") if inside else ("line", "chamber")
            raise Refusal(
                f"--load-of {path}: found a pressure of the {found}, by the location of its sensor, expected one of "
                f"the {wanted} as in {report}; name a recording whose sensor sits there, or correct location in "
                "[sensors.pressure]"
            )


def refuse_load_of_another_pump(path: Path, rigs: Sequence[Rig]) -> None:
    """Refuse a load that neither the fitted pump nor the one that is asked for made, by plunger and stroke.

    A recording without [pump] does not tell whose load it is.
    """
    report, config = report_named(path), _config_of_load(path)
    if config.pump_sheet is None:
        return
    if report is not None:
        refuse_changed(report, [input_file(config.pump_sheet.cam_table_path)])
    other = _sizes(config.pump_sheet, read_cam_table(config.pump_sheet)[0])
    known = [_sizes(rig.pump, rig.table) for rig in rigs]
    if any(np.allclose(other, sizes, rtol=SAME_SIZE) for sizes in known):
        return
    (bore, stroke, lobes), (own_bore, own_stroke, own_lobes) = other, known[0]
    many, own_many = (f", {n} a revolution" if lobes != own_lobes else "" for n in (lobes, own_lobes))
    raise Refusal(
        f"--load-of {path}: found the load of a pump with a plunger of {1e3 * bore:.4g} mm and a stroke of "
        f"{1e3 * stroke:.4g} mm{many}, expected {1e3 * own_bore:.4g} mm and {1e3 * own_stroke:.4g} mm{own_many} as the "
        "fitted one: another pump makes another line pressure; name a recording of this pump, the other pump with "
        "--pump and --cam, or give the pressure as a file with --pressure"
    )


def refuse_other_strokes(fitted: Rig, asked: Rig, path: Path) -> None:
    """Refuse a cam with more or fewer lobes than the fitted one, or elsewhere, under the line pressure of that."""
    lobes, own = stroke_count(asked.table.lift), stroke_count(fitted.table.lift)
    if lobes != own:
        raise Refusal(
            f"{path}: found a cam of {counted(lobes, 'lobe', 'lobes')}, expected {own} as the fitted one: the line "
            "pressure of the fitted recording has as many strokes a revolution; give the load of the other pump with "
            "--load-of or --pressure"
        )
    begins, own_begins = (_rise(rig.table) for rig in (asked, fitted))
    period = TURN / own
    if abs(np.remainder(begins - own_begins + 0.5 * period, period) - 0.5 * period) > BEGINS_APART:
        raise Refusal(
            f"{path}: found a lift that begins at {begins / DEGREE:.0f} deg, expected about {own_begins / DEGREE:.0f} "
            "as of the fitted cam: the line pressure of the fitted recording counts its angles from there; count the "
            "table's from where it counts, or give the load of the other cam with --load-of or --pressure"
        )


def _rise(table: CamTable) -> float:
    """Return the angle at which the lift begins to rise to its top [rad]."""
    top = int(np.argmax(table.lift))
    back = np.roll(table.lift, -top - 1)[::-1]
    below = int(np.argmax(back < np.min(table.lift) + BEGUN * np.ptp(table.lift)))
    return float(table.theta[top - below])


def _sizes(pump: PumpData, table: CamTable) -> tuple[float, float, int]:
    """Return the diameter of the plunger, its stroke [m], and strokes a revolution."""
    return pump.plunger_diameter, float(np.ptp(table.lift)), stroke_count(table.lift)
