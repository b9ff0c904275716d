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

import numpy as np

from camtorque.finished_fit import (
    Rig,
    chain_of,
    curve_of,
    load_curve,
    read_fit,
    refuse_load_of_another_place,
    refuse_load_of_another_pump,
    refuse_other_strokes,
    rig_of,
)
from camtorque.fit.clearance import leakage_factor, refuse_leaky
from camtorque.fit.endings import MOST_PRESSED, either, endings_of, if_it_ended_so, load_for, own_ending, the_other
from camtorque.fit.forecast import Forecast, forecast
from camtorque.fit.known_ends import END_OF, Curve
from camtorque.fit.known_fit import FittedAt, KnownFit, LoadKnowledge
from camtorque.fit.load_file import (
    curve_through,
    refuse_below_line,
    refuse_other_load,
    rise_angle,
    rise_range,
    top_range,
)
from camtorque.fit.own_start import begun_as, begun_elsewhere, predicted_to_begin
from camtorque.hashes import input_file, input_files
from camtorque.ingest import read_recording
from camtorque.ingest.pump_file import read_pressure_curve
from camtorque.laws.chain import ChainInput
from camtorque.mechanism.friction import Friction
from camtorque.mechanism.lift_laws import lift_law
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.solve import forces_of
from camtorque.mechanism.torque import closed_form_tables
from camtorque.process.threads import on_one_thread
from camtorque.records import Estimate, Forces, Refusal
from camtorque.report.files import inputs_document
from camtorque.report.fit_file import NAME
from camtorque.report.forecast_page import (
    ENDED_BY,
    assumptions,
    beyond_text,
    constant_text,
    elsewhere_text,
    end_text,
    ending_text,
    flight_text,
    forecast_document,
    load_text,
    step_text,
)
from camtorque.results import report_named
from camtorque.units import BAR, RPM, TURN, short

SAME_LOAD = 0.005
"""Root mean square difference over the peak below which two line pressures are one load: cycles scatter less."""


@dataclass(frozen=True, repr=False)
class Found:
    """Predicted runs, and the document of them."""

    items: tuple[Forecast, ...]
    document: Mapping[str, Any]

    def __repr__(self) -> str:
        peaks = ", ".join(f"{np.max(one.torque):.4g} N m at {one.speed / RPM:.4g} rpm" for one in self.items)
        return f"<Found {peaks}>"


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
    found = read_fit(Path(fit))
    folder, reports = found.folder, found.reports
    # the correction of the lift table belongs to the fitted cam
    known = found.known if pump is None and cam is None else replace(found.known, lift=None)
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
    templates = {item.id: curve_of(reports[item.id], item.speed) for item in known.recordings}
    if load_of is not None:
        nearest = reports[known.nearest(speeds_rpm[0] * RPM).id]
        refuse_load_of_another_pump(Path(load_of), [rig_of(nearest), rig_of(nearest, pump, cam)])
        sources = {item.id for value in speeds_rpm for item in endings_of(known, value * RPM, asked.ending)}
        refuse_load_of_another_place(Path(load_of), [reports[item] for item in sorted(sources)])
    if pressure is not None and asked.given is not None:
        refuse_other_load(asked.given, templates.values(), str(pressure))
    runs = [_at_speed(known, reports, templates, value * RPM, asked) for value in speeds_rpm]
    items, forces = [item for item, _ in runs], [force for _, force in runs]
    inputs = _inputs((folder / NAME, pressure, pump, cam), load_of)
    origin = {"fit": str(folder / NAME), "recordings": found.rows, "inputs": inputs}
    return Found(tuple(items), forecast_document(items, forces, origin))


def _inputs(named: Sequence[Path | None], load_of: Path | str | None) -> list[dict[str, str]]:
    """Return the fit and every file that was named beside it, those of a recording whose load it is included."""
    files = [*input_files(*named)]
    if load_of is not None:
        report = report_named(Path(load_of))
        files += read_recording(Path(load_of)).inputs if report is None else [input_file(report / "result.json")]
    return inputs_document(files)


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
    sources, fitted = _sources(known, templates, speed, asked)

    @on_one_thread
    def run(source: FittedAt) -> tuple[Forecast, Forces, Rig, Mapping[str, Estimate]]:
        rig = rig_of(reports[source.id], asked.pump, asked.cam)
        if given is None and (other := asked.cam or asked.pump):
            refuse_other_strokes(rig_of(reports[source.id]), rig, other)
        curve = templates[source.id] if given is None else given
        chain = chain_of(rig, speed, curve, source.structure)
        shaped = curve if np.isfinite(curve.speed) else replace(curve, speed=speed)
        load = LoadKnowledge({}, curve.std) if fitted else load_for(known, source, templates, chain, shaped)
        load = replace(load, ends={**load.ends, **begun_elsewhere(known, source, asked.name)})
        begun = begun_as(known, source, asked.name)
        return *with_forces(begun, source, rig, chain, load, asked.changes), rig, load.ends

    runs = [run(source) for source in sources]
    item = runs[0][0]
    if given is not None:
        refuse_below_line(given, item.pressure, asked.name)
    if len(runs) > 1:
        item = either(item, runs[1][0])
    elif given is not None and not asked.ending and item.ending in END_OF:
        item = replace(item, other=if_it_ended_so(item, run(the_other(known, sources[0], speed))[0]))
    load = load_text(sources[0], asked.name, given, speed) + predicted_to_begin(known, sources[0], asked.name)
    beyond: tuple[str, ...] = ()
    if given is not None:
        beyond = beyond_text(float(np.max(given.pressure)), top_range(templates.values()))
        if asked.pump is None and asked.cam is None:
            beyond += elsewhere_text(rise_angle(given), rise_range(templates.values()))
    texts = [text for source, (*_, ends) in zip(sources, runs, strict=True)
             for text in end_text(ends, source, known, speed / RPM)]  # fmt: skip
    assumed = assumptions(known, sources[0], load, asked.clearance, asked.pump or asked.cam)
    odd = [f"{row.where}: {row.text}." for row in runs[0][2].findings if row.severity == "warning"]
    texts = [*pressed_text(item), *flight_text(item), *step_text(item), *odd, *beyond, *assumed, *texts,
             *ending_text(item), *constant_text(item)]  # fmt: skip
    return replace(item, assumed=tuple(texts)), tuple(one[1] for one in runs)


def _sources(
    known: KnownFit, templates: Mapping[str, Curve], speed: float, asked: Asked
) -> tuple[tuple[FittedAt, ...], bool]:
    """Return the recordings that stand in for a run, one for each ending, and whether the load is their own."""
    if asked.given is None:
        return (known.nearest(speed),), True
    own = fitted_load(known, templates, asked.name, asked.given, asked.ending)
    return (endings_of(known, speed, asked.ending), False) if own is None else ((own,), True)


def fitted_load(
    known: KnownFit, templates: Mapping[str, Curve], name: str, given: Curve, ending: str
) -> FittedAt | None:
    """Return the fitted recording whose load a line pressure is, so that the fit knows where its delivery ends.

    None for another one of that name, or where it is asked what it would be with another ending.
    """
    found = next((item for item in known.recordings if item.id == name), None)
    if found is None or ending not in ("", found.structure):
        return None
    fitted = templates[name]
    apart = given.pressure - np.interp(given.theta, fitted.theta, fitted.pressure, period=TURN)
    return found if np.sqrt(np.mean(apart**2)) < SAME_LOAD * np.max(fitted.pressure) else None


def pressed_text(item: Forecast) -> tuple[str, ...]:
    """Return that no pump holds the pressure of a run, where delivery ends at an angle at which it cannot end so."""
    peak, one = max(((float(np.max(one.pressure)), one) for one in item.both or (item,)), key=lambda pair: pair[0])
    if peak <= MOST_PRESSED or one.ending not in ENDED_BY:
        return ()
    return (
        f"Do not rely on the run at {item.speed / RPM:.4g} rpm: if {ENDED_BY[one.ending]} ended delivery where this "
        f"load ends, the chamber would be pressed to {short(peak / BAR, 2)} bar, which no pump holds; it ends another "
        "way.",
    )


def with_forces(
    known: KnownFit, source: FittedAt, rig: Rig, chain: ChainInput, load: LoadKnowledge, changes: Mapping[str, float]
) -> tuple[Forecast, Forces]:
    """Return a run at the speed and line pressure of a chain, with the forces that come with it."""
    item = forecast(known, chain, source, load, changes)
    friction, mounting = Friction(*friction_of(known, source)), Mounting(rotation=rig.rotation)
    tables = closed_form_tables(rig.pump, lift_law(rig.table), item.true_angle, mounting, friction)
    pushed = item.pressure + item.plunger_force / rig.pump.plunger_area
    return item, forces_of(rig.pump, tables, pushed, chain.speed)


def friction_of(known: KnownFit, source: FittedAt) -> tuple[float, float, float]:
    """Return guide coefficient, bearing and pin arm of a fitted recording [-, m, m]."""
    places, names = known.own(source.id), ("guide_friction", "bearing_arm", "pin_arm")
    guide, bearing, pin = (float(known.values[places[name]]) if name in places else 0.0 for name in names)
    return guide, bearing, pin
