"""A better cam for the pump that a fit knows: its chamber pressure as load, and the answer run by the fitted model.

The search itself takes the fitted friction and the fitted chamber pressure over lift, which stay as they are whatever
the cam. What the chamber, the losses and the drive then make of the chosen cam (a slower stroke leaks longer, a faster
one loses more past the valve) is computed once, for the chosen cam and for the fitted one, with 95 % bands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config.pump import PressureCurve
from camtorque.design.answer import COLUMNS, Answer
from camtorque.design.loads import FittedPump, FittedStroke, Load
from camtorque.design.schema import PUMP_FIELDS
from camtorque.finished_fit import FinishedFit, Rig, chain_of, curve_of, read_fit, rig_of
from camtorque.fit.forecast import Forecast
from camtorque.fit.known_ends import Curve
from camtorque.fit.known_fit import FittedAt, KnownFit, LoadKnowledge
from camtorque.ingest.cam_table import read_cam_table
from camtorque.mechanism.cam import CamLaw, stroke_count
from camtorque.mechanism.lift_laws import lift_law
from camtorque.predict_from import friction_of, with_forces
from camtorque.process.threads import on_one_thread
from camtorque.records import Array, Estimate, Forces, Refusal
from camtorque.report.forecast_page import sweep_row
from camtorque.results import read_result
from camtorque.units import TURN

STROKES = np.linspace(0.004, 0.996, 250)
"""Shares of the lift by which angles of one cam are carried to another."""
FINE = 7200
LEAST_FLOW = 0.02
"""Share of the plunger's largest flow below which nothing is said to be delivered by it."""
BASE = 1.0e-3
"""Share of the lift below which the follower rests on the base circle."""


def read_known(path: Path) -> FinishedFit:
    """Return a fit without its correction of the lift table: that of another cam is another, both are run without.

    Raises
    ------
    Refusal : see `camtorque.finished_fit.read_fit`
    """
    fit = read_fit(path)
    return fit._replace(known=replace(fit.known, lift=None))


def _source(fit: FinishedFit, name: str, speed: float) -> FittedAt:
    """Return a recording by its name, or the one nearest in speed."""
    return next((item for item in fit.known.recordings if item.id == name), fit.known.nearest(speed))


def fitted_pump(fit: FinishedFit) -> FittedPump:
    """Return what a design takes of a fit.

    Raises
    ------
    Refusal : the sheets of its recordings are gone; its cam has several lobes
    """
    known, reports = fit.known, fit.reports
    first = reports[known.recordings[0].id]
    law = lift_law(rig_of(first).table)
    _refuse_lobes(fit.folder, law)

    def stroke(name: str, speed: float) -> FittedStroke:
        source = _source(fit, name, speed)
        rig = rig_of(reports[source.id])
        item, _ = _run(known, source, rig, curve_of(reports[source.id], source.speed), speed)
        angle = np.mod(item.true_angle, TURN)
        order = np.argsort(angle, kind="stable")
        pushed = rig.pump.plunger_area * lift_law(rig.table).evaluate(angle, 1) * speed
        share = np.clip(item.flow / np.maximum(pushed, LEAST_FLOW * np.max(pushed)), 0.0, 1.0)
        delivering = np.empty(0) if source.structure == "line" else share[order]
        return FittedStroke(source.id, PressureCurve(angle[order], item.pressure[order]), delivering)

    return FittedPump(
        path=fit.folder, pump_id=str(read_result(first / "result.json")["recording"].get("pump", "")),
        friction=friction_of(known, known.recordings[0]), law=law,
        recordings=tuple(item.id for item in known.recordings), stroke=stroke,
    )  # fmt: skip


def _refuse_lobes(folder: Path, law: CamLaw) -> None:
    """Refuse a cam of several lobes: the loads of the others would act on the base circle of the one of a design."""
    lobes = stroke_count(law.evaluate(np.arange(FINE) * TURN / FINE))
    if lobes > 1:
        raise Refusal(
            f"{folder}: found the fit of a cam of {lobes} lobes, expected one lobe, as a design has; leave --from out "
            "and give the load of one stroke by pressure_bar, closes_mm and spills_mm"
        )


def _run(
    known: KnownFit, source: FittedAt, rig: Rig, curve: Curve, speed: float, ends: Mapping[str, Estimate] | None = None
) -> tuple[Forecast, Forces]:
    chain = chain_of(rig, speed, curve, source.structure)
    return on_one_thread(with_forces)(known, source, rig, chain, LoadKnowledge(ends or {}), {})


def as_fitted(fit: FinishedFit, answer: Answer, table: Path) -> list[dict[str, Any]]:
    """Return fitted pump and chosen design (its lift table) by the fitted model under each load of a recording.

    Raises
    ------
    Refusal : the follower of the design jams or the torque runs away
    """
    chosen = answer.chosen.evaluated
    changed: dict[str, Any] = {field: getattr(chosen.pump, field) for field in PUMP_FIELDS.values()} | COLUMNS
    rows = []
    for load in answer.task.loads:
        if load.source:
            source = _source(fit, load.source, load.speed)
            rig = rig_of(fit.reports[source.id])
            pump = replace(rig.pump, **changed, cam_table_path=table)
            rows.append(_pair(fit, source, rig, replace(rig, pump=pump, table=read_cam_table(pump)[0]), load))
    return rows


def _pair(fit: FinishedFit, source: FittedAt, before: Rig, after: Rig, load: Load) -> dict[str, Any]:
    known, curve = fit.known, curve_of(fit.reports[source.id], source.speed)
    places = known.own(source.id)
    offset = float(known.values[places["trigger_offset"]]) if "trigger_offset" in places else 0.0
    old, new = lift_law(before.table), lift_law(after.table)
    moved = replace(curve, pressure=carried_pressure(curve, old, new, offset))
    ends = {}
    if source.structure == "land":
        angle = float(known.values[places["end_of_delivery"]])
        ends["end_of_delivery"] = Estimate(float(carried_angles(np.array([angle]), new, old)[0]), 0.0)
    sides = {
        "fitted_pump": _run(known, source, before, curve, load.speed),
        "design": _run(known, source, after, moved, load.speed, ends),
    }
    return {"load": load.name, **{name: sweep_row(item, (forces,)) for name, (item, forces) in sides.items()}}


def carried_pressure(curve: Curve, old: CamLaw, new: CamLaw, offset: float) -> Array:
    """Return the line pressure of one cam over the angle of another: at the same lift the same pressure.

    ``offset`` is the true less the nominal cam angle [rad].
    """
    place = carried_angles(curve.theta + offset, old, new) - offset
    return np.interp(place, curve.theta, curve.pressure, period=TURN)


def carried_angles(angles: Array, old: CamLaw, new: CamLaw) -> Array:
    """Return the angles of the old cam at which the lift is that of the new cam at some angles, (n,) [rad].

    Between the flanks angles are carried in proportion.
    """
    lifts = STROKES * min(_top(old), _top(new))
    there, here = stroke_angles(old, lifts), stroke_angles(new, lifts)
    turn = np.mod(angles - here[0], TURN) + here[0]
    return np.interp(turn, np.append(here, here[0] + TURN), np.append(there, there[0] + TURN))


def _top(law: CamLaw) -> float:
    return float(np.max(law.evaluate(np.arange(FINE) * TURN / FINE)))


def stroke_angles(law: CamLaw, lifts: Array) -> Array:
    """Return the angles at which a cam has some lifts, first on the rise, then on the return, increasing, (2k,) [rad].

    Raises
    ------
    Refusal : the cam has no rest on its base circle
    """
    theta = np.arange(FINE) * TURN / FINE
    lift = law.evaluate(theta)
    top = int(np.argmax(lift))
    turned = np.roll(lift, -top)
    rest = np.flatnonzero(turned < BASE * lift[top])
    if not rest.size:
        raise Refusal("design: the lift has no rest on the base circle, expected one; check the lift table")
    step = TURN / FINE
    down = np.maximum.accumulate(turned[rest[0] :: -1])  # of a lift that a wave of its table reaches twice, the last
    back = np.interp(lifts[::-1], down, step * np.arange(rest[0], -1, -1))
    up = np.maximum.accumulate(np.append(turned[rest[-1] :], turned[0]))
    rise = np.interp(lifts, up, step * (np.arange(rest[-1], FINE + 1) - FINE))
    return np.asarray(theta[top] + np.concatenate([rise, back]))
