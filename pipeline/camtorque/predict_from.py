"""Runs that were not made, from a finished fit: where values, sheets and load come from.

from camtorque.predict_from import predict_from
found = predict_from("reports/campaign", [600, 900, 1500], load_of="raw/other")
found.items[0].torque, found.items[0].torque_std
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from camtorque.align import align
from camtorque.config import PumpData
from camtorque.config.pump import PumpConfig
from camtorque.config.recording import load_recording_config
from camtorque.design.fitted import FRICTION_NAMES
from camtorque.fit.clearance import leakage_factor, refuse_leaky
from camtorque.fit.draws import Load
from camtorque.fit.end_shape import Curve
from camtorque.fit.endings import either, endings_of, if_it_ended_so, own_ending, the_other
from camtorque.fit.ends import load_for
from camtorque.fit.firm_end import END_OF
from camtorque.fit.forecast import Forecast, forecast
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.load_file import (
    curve_through,
    refuse_below_line,
    refuse_other_load,
    rise_angle,
    rise_range,
    top_range,
)
from camtorque.fit.prepare import FIT_GRID, on_grid
from camtorque.fit.problem import SEPARATOR
from camtorque.ingest import read_recording
from camtorque.ingest.cam_table import read_cam_table
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.ingest.sheet import read_sheet
from camtorque.laws import ROWS
from camtorque.laws.chain import ChainInput, angle_grid
from camtorque.mechanism.friction import Friction
from camtorque.mechanism.lift_laws import lift_law
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.solve import forces_of
from camtorque.mechanism.spectral import spectral_law
from camtorque.mechanism.torque import closed_form_tables
from camtorque.process.threads import on_one_thread
from camtorque.records import Array, CamTable, Estimate, Forces, Refusal
from camtorque.report.fit_file import NAME, SCHEMA, known_covariance, known_lift, known_shown
from camtorque.report.forecast_page import forecast_document
from camtorque.report.forecast_texts import (
    assumptions,
    beyond_text,
    constant_text,
    elsewhere_text,
    end_text,
    ending_text,
    load_text,
    step_text,
)
from camtorque.results import read_document, read_result, recording_of
from camtorque.units import RPM
from camtorque.version import __version__

CYCLES = "cycles.h5"
SAME_SIZE = 0.01
"""Share by which plungers and strokes of one pump may differ: a lift table is measured."""


@dataclass(frozen=True, repr=False)
class Found:
    """Predicted runs, and the document of them."""

    items: tuple[Forecast, ...]
    document: Mapping[str, Any]

    def __repr__(self) -> str:
        peaks = ", ".join(f"{np.max(one.torque):.4g} N m at {one.speed / RPM:.4g} rpm" for one in self.items)
        return f"<Found {peaks}>"


@dataclass(frozen=True)
class Rig:
    """What sheets say: pump, lift table, direction of running, nominal trigger angle [rad], the transducer's filter."""

    pump: PumpData
    table: CamTable
    rotation: int
    trigger_angle: float
    low_pass_order: int = 0


def read_fit(path: Path) -> tuple[KnownFit, Path, list[dict[str, Any]]]:
    """Return the fit beside a result.json or campaign.json (or in such a folder), its folder, and its recordings.

    Raises
    ------
    Refusal : there is none, or it is of another schema or of a version with other parameters
    """
    folder = path if path.is_dir() else path.parent
    file = folder / NAME
    if not file.is_file():
        raise Refusal(
            f"{path}: found no {NAME} beside it, expected the report of `camtorque run` or of a campaign with a joint "
            "fit; make the report again"
        )
    doc = read_document(file, SCHEMA, "a report of `camtorque run`, or make it again")
    rows = [row for row in doc["recordings"] if row["explained"]]
    if not rows:
        raise Refusal(
            f"{file}: its model leaves {', '.join(row['id'] for row in doc['recordings'])} unexplained, expected a fit "
            "whose intervals can be relied on; mend what the report names and make it again"
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
    return known.without([row["id"] for row in doc["recordings"] if not row["explained"]]), folder, rows


def _fitted_at(row: Mapping[str, Any]) -> FittedAt:
    share = (row["left_out_rms_percent"] or {}).get("own_zero_and_end")
    used = row["rms_percent_of_peak"] if share is None else share
    return FittedAt(row["id"], row["speed_rpm"] * RPM, row["structure"], used / 100.0, share is not None)


def rig_of(report: Path, pump: Path | None, cam: Path | None) -> Rig:
    """Return the pump of a report's recording, with another pump or cam if one is given.

    Raises
    ------
    Refusal : the recording's sheets are gone
    """
    config = load_recording_config(recording_of(report))
    data, rotation, table = config.pump, config.rotation, None
    if pump is not None:
        other: PumpConfig = read_pump(pump)[0]
        if other.cam_table is None and cam is None:
            raise Refusal(f"{pump}: its cam is given by sections, expected a lift table; name one with --cam")
        data, rotation, table = other.pump, other.rotation, other.cam_table
    if cam is not None:
        data, table = replace(data, cam_table_path=cam), None
    table = read_cam_table(data)[0] if table is None else table
    torque = config.sensors.get("torque")
    order = read_sheet(torque).filter_order if torque is not None else 0
    return Rig(data, table, rotation, config.trigger.nominal_angle, order)


def curve_of(report: Path, speed: float) -> Curve:
    """Return the mean line pressure of a report."""
    with h5py.File(report / CYCLES) as file:
        return Curve(
            np.asarray(file["theta"], dtype=np.float64), np.asarray(file["mean/pressure"], dtype=np.float64), speed
        )


def load_curve(path: Path) -> tuple[str, Curve]:
    """Return the name of a recording, or of that of a report, and its mean line pressure.

    Raises
    ------
    Refusal : it is neither, or has no pressure
    """
    if (path / CYCLES).is_file():
        said = read_result(path / "result.json")["recording"]
        return said["name"], curve_of(path, said["speed_rpm"] * RPM)
    recording = read_recording(path)
    cycles = align(recording)
    if not cycles.pressure.size:
        raise Refusal(f"{path}: has no pressure channel, expected one: it is the load; name another recording")
    return recording.config.id, Curve(cycles.theta, cycles.mean_pressure, cycles.mean_speed)


def refuse_load_of_another_pump(path: Path, rigs: Sequence[Rig]) -> None:
    """Refuse a load that neither the fitted pump nor the one that is asked for made, by plunger and stroke.

    Raises
    ------
    Refusal : see above; a recording without [pump] does not tell whose load it is
    """
    config = load_recording_config(recording_of(path) if (path / CYCLES).is_file() else path)
    if config.pump_sheet is None:
        return
    other = _sizes(config.pump_sheet, read_cam_table(config.pump_sheet)[0])
    known = [_sizes(rig.pump, rig.table) for rig in rigs]
    if any(np.allclose(other, sizes, rtol=SAME_SIZE) for sizes in known):
        return
    (bore, stroke), (own_bore, own_stroke) = other, known[0]
    raise Refusal(
        f"--load-of {path}: found the load of a pump with a plunger of {1e3 * bore:.4g} mm and a stroke of "
        f"{1e3 * stroke:.4g} mm, expected {1e3 * own_bore:.4g} mm and {1e3 * own_stroke:.4g} mm as the fitted one: "
        "another pump makes another line pressure; name a recording of this pump, the other pump with --pump and "
        "--cam, or give the pressure as a file with --pressure"
    )


def _sizes(pump: PumpData, table: CamTable) -> tuple[float, float]:
    """Return the diameter of the plunger and its stroke [m]."""
    return pump.plunger_diameter, float(np.ptp(table.lift))


def predict_from(
    fit: Path | str,
    speeds_rpm: Sequence[float],
    *,
    pressure: Path | None = None,
    load_of: Path | str | None = None,
    pump: Path | None = None,
    cam: Path | None = None,
    clearance: str = "",
    ending: str = "",
) -> Found:
    """Return runs at some speeds with the values of a fit.

    Parameters
    ----------
    fit : result.json, campaign.json, or a folder that holds one
    pressure : CSV file of the line pressure over cam angle; the end of delivery is looked for in its shape
    load_of : recording or report whose line pressure is used; neither: that of the fitted recording nearest in speed
    pump, cam : another pump file, another lift table
    clearance : change of the plunger's clearance, such as ``+1um``
    ending : how delivery ends under that load: ``land``, ``spill`` or ``either``; empty: as in the fitted recording
        whose load it is, else as in all of them, ``either`` where these differ

    Raises
    ------
    Refusal : an ending without a load; see `read_fit`, `rig_of`, `load_curve`, `curve_through`, `leakage_factor`
    """
    known, folder, rows = read_fit(Path(fit))
    known = known if pump is None and cam is None else replace(known, lift=None)  # it belongs to the fitted cam
    factor = leakage_factor(clearance) if clearance else 1.0
    refuse_leaky(known, clearance, factor)
    name, given = _given(pressure, load_of)
    asked = Asked(
        given, name, ending or own_ending(known, name if load_of else ""), pump, cam, clearance,
        {"leakage": factor} if clearance else {},
    )  # fmt: skip
    if ending and asked.given is None:
        raise Refusal(
            f"predict: found --ending {ending} without a load, expected one that may end so; give it with --load-of or "
            "--pressure: without them the load is that of a fitted recording, whose ending is known"
        )
    reports = {row["id"]: folder / row["folder"] for row in rows}
    templates = {item.id: curve_of(reports[item.id], item.speed) for item in known.recordings}
    if load_of is not None:
        nearest = reports[known.nearest(speeds_rpm[0] * RPM).id]
        refuse_load_of_another_pump(Path(load_of), [rig_of(nearest, None, None), rig_of(nearest, pump, cam)])
    if pressure is not None and asked.given is not None:
        refuse_other_load(asked.given, templates.values(), str(pressure))
    runs = [_at_speed(known, reports, templates, value * RPM, asked) for value in speeds_rpm]
    items, forces = [item for item, _ in runs], [force for _, force in runs]
    origin = {"fit": str(folder / NAME), "recordings": rows, "inputs": []}
    return Found(tuple(items), forecast_document(items, forces, origin))


@dataclass(frozen=True)
class Asked:
    """What a prediction is asked for beside its speeds.

    given : line pressure of the load, None for that of the nearest fitted recording; name : of its recording or file
    changes : parameter -> factor
    """

    given: Curve | None
    name: str
    ending: str
    pump: Path | None
    cam: Path | None
    clearance: str
    changes: Mapping[str, float]


def _given(pressure: Path | None, load_of: Path | str | None) -> tuple[str, Curve | None]:
    if load_of is not None and pressure is not None:
        raise Refusal(
            f"predict: found two loads, --load-of {load_of} and --pressure {pressure}, expected one; leave one out"
        )
    if load_of is not None:
        return load_curve(Path(load_of))
    if pressure is None:
        return "", None
    return pressure.name, curve_through(read_pressure_curve(pressure), str(pressure))


def _at_speed(
    known: KnownFit, reports: Mapping[str, Path], templates: Mapping[str, Curve], speed: float, asked: Asked
) -> tuple[Forecast, tuple[Forces, ...]]:
    """Return a run at one speed [rad/s], by the ending that is asked for or known, with what was assumed."""
    given = asked.given
    sources = (known.nearest(speed),) if given is None else endings_of(known, speed, asked.ending)

    def run(source: FittedAt) -> tuple[Forecast, Forces, Mapping[str, Estimate]]:
        rig = rig_of(reports[source.id], asked.pump, asked.cam)
        return _predicted(known, source, templates, rig, speed, given, asked.changes)

    runs = [run(source) for source in sources]
    item = runs[0][0]
    if given is not None:
        refuse_below_line(given, item.pressure, asked.name)
    if len(runs) > 1:
        item = either(item, runs[1][0])
    elif given is not None and not asked.ending and item.ending in END_OF:
        item = replace(item, other=if_it_ended_so(item, run(the_other(known, sources[0], speed))[0]))
    load = load_text(sources[0], asked.name, given, speed)
    beyond: tuple[str, ...] = ()
    if given is not None:
        beyond = beyond_text(float(np.max(given.pressure)), top_range(templates.values()))
        if asked.pump is None and asked.cam is None:
            beyond += elsewhere_text(rise_angle(given), rise_range(templates.values()))
    texts = [text for source, (_, _, ends) in zip(sources, runs, strict=True)
             for text in end_text(ends, source, known, speed / RPM)]  # fmt: skip
    assumed = assumptions(known, sources[0], load, asked.clearance, asked.pump or asked.cam)
    return replace(
        item, assumed=(*step_text(item), *beyond, *assumed, *texts, *ending_text(item), *constant_text(item))
    ), tuple(one[1] for one in runs)


@on_one_thread
def _predicted(
    known: KnownFit, source: FittedAt, templates: Mapping[str, Curve], rig: Rig, speed: float, given: Curve | None,
    changes: Mapping[str, float],
) -> tuple[Forecast, Forces, Mapping[str, Estimate]]:  # fmt: skip
    curve = templates[source.id] if given is None else given
    chain = chain_of(rig, speed, curve)
    shaped = curve if np.isfinite(curve.speed) else replace(curve, speed=speed)
    load = Load({}, curve.std) if given is None else load_for(known, source, templates, chain, shaped)
    item, forces = with_forces(known, source, rig, chain, load, changes)
    return item, forces, load.ends


def with_forces(
    known: KnownFit, source: FittedAt, rig: Rig, chain: ChainInput, load: Load, changes: Mapping[str, float]
) -> tuple[Forecast, Forces]:
    """Return a run at the speed and line pressure of a chain, with the forces that come with it."""
    item = forecast(known, chain, source, load, changes)
    friction, mounting = Friction(*friction_of(known, source)), Mounting(rotation=rig.rotation)
    tables = closed_form_tables(rig.pump, lift_law(rig.table), item.true_angle, mounting, friction)
    return item, forces_of(rig.pump, tables, item.pressure, chain.speed)


def friction_of(known: KnownFit, source: FittedAt) -> tuple[float, float, float]:
    """Return guide coefficient, bearing and pin arm of a fitted recording [-, m, m]."""
    places = known.own(source.id)
    guide, bearing, pin = (float(known.values[places[n]]) if n in places else 0.0 for n in FRICTION_NAMES)
    return guide, bearing, pin


def chain_of(rig: Rig, speed: float, curve: Curve) -> ChainInput:
    """Return the chain of a pump at a speed and a line pressure; its torque is still zero."""
    pressure: Array = on_grid(curve.pressure, FIT_GRID)
    return ChainInput(
        theta=angle_grid(FIT_GRID), speed=speed, line_pressure=pressure, shaft_torque=np.zeros(FIT_GRID),
        trigger_angle=rig.trigger_angle, pump=rig.pump, law=spectral_law(rig.table),
        offset=rig.pump.follower_offset * rig.rotation, low_pass_order=rig.low_pass_order,
    )  # fmt: skip
