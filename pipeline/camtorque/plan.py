"""The cheapest next recordings of a campaign for one number that has to be known better."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from camtorque.finished_fit import CYCLES, Rig, chain_of, curve_of, read_fit, rig_of
from camtorque.fit.known_fit import FittedAt, KnownFit, drawn_about
from camtorque.fit.planning import (
    AS_GOOD,
    SETUP_MINUTES,
    STATED_OF_ALL,
    TOOTH_MINUTES,
    Measuring,
    Offer,
    OperatingPoint,
    Step,
    TargetQuantity,
    chamber_peak,
    operating_point,
    plan,
    weighed,
)
from camtorque.fit.prepare import lift_basis
from camtorque.hashes import input_file
from camtorque.jsonable import now as created
from camtorque.laws import ROWS
from camtorque.process.threads import on_one_thread
from camtorque.records import Array, Refusal
from camtorque.report.files import inputs_document
from camtorque.report.fit_file import NAME as FIT_NAME
from camtorque.results import CAMPAIGN, NAME, read_campaign, read_result
from camtorque.units import BAR, COVERAGE, DECIMAL, RPM, did_you_mean, plain_unit
from camtorque.version import __version__

CHAMBER_PEAK = "chamber_peak"
SPEED_FACTORS = (0.7, 0.85, 1.0, 1.2, 1.45)
"""Speeds on offer where none are named, as shares of the middle of the fitted ones."""
DURATIONS = (20.0, 60.0, 180.0)


@dataclass(frozen=True)
class Target:
    """A number: name, recording (or none), unit, value, SI per unit, wanted standard uncertainty [SI], gradient."""

    name: str
    of: str
    unit: str
    value: float
    per_unit: float
    wanted: float
    number: TargetQuantity


def wanted_number(text: str, names: Sequence[str]) -> tuple[str, float, bool]:
    """Return name, number and whether it is relative, of a text such as ``chamber_peak 0.5 %``.

    Raises
    ------
    Refusal : another text, an unknown name, a number that is not positive, another unit than the report's
    """
    match = re.fullmatch(rf"\s*(\w+)\s+({DECIMAL}(?:[eE]-?\d{{1,3}})?)\s*([^\s\d.].*?)?\s*", text)
    if match is None or not 0.0 < float(match[2]) < np.inf:
        raise Refusal(
            f"plan: found --target {text!r}, expected a name and a standard uncertainty such as 'chamber_peak 0.5 %' "
            "or 'leakage 0.05' (in the unit of the report)"
        )
    if match[1] not in names:
        raise Refusal(f"plan: {match[1]!r} is no number of this fit{did_you_mean(match[1], tuple(names))}; there are "
                      f"{', '.join(names)}")  # fmt: skip
    unit, _ = shown_in(match[1])
    if match[3] not in (None, "%") and plain_unit(match[3]) != plain_unit(unit):
        raise Refusal(f"plan: found --target {text!r}, expected % or {unit}, the unit of the report")
    return match[1], float(match[2]), match[3] == "%"


def shown_in(name: str) -> tuple[str, float]:
    """Return the unit in which a report states a number, and SI per unit."""
    return ("bar", BAR) if name == CHAMBER_PEAK else (ROWS[name].unit, ROWS[name].per_unit)


@on_one_thread
def plan_runs(fit: Path | str, target: str, tooth: bool = True, speeds_rpm: Sequence[float] = ()) -> dict[str, Any]:
    """Return the next recordings that bring a number of a fit to a wanted standard uncertainty, as a document.

    Parameters
    ----------
    fit : campaign.json, result.json, or the folder that holds one
    target : such as ``chamber_peak 0.5 %``
    tooth : whether a second tooth may be asked for, where the bench has none
    speeds_rpm : that the rig can run; none: `SPEED_FACTORS` times the middle of the fitted ones

    Raises
    ------
    Refusal : see `wanted_number`, `camtorque.finished_fit.read_fit`
    """
    found = read_fit(Path(fit))
    known, folder, reports = found.known, found.folder, found.reports
    inputs = inputs_document([input_file(folder / FIT_NAME)])
    loads = _loads(known)
    known = known.only([item.id for item in (*loads, _fastest(known))])
    shared = [name for name in known.names if name in ROWS and ROWS[name].role == "shared"]
    wanted = wanted_number(target, [CHAMBER_PEAK, *shared])
    goal = _target(known, folder, reports, wanted)
    middle = float(np.exp(np.mean([np.log(item.speed) for item in known.recordings])))
    speeds = [speed * RPM for speed in speeds_rpm] or [middle * factor for factor in SPEED_FACTORS]
    points, fitted, rigs = [], [], {item.id: rig_of(reports[item.id]) for item in loads}
    drawn = tuple(drawn_about(known, goal.number.deviation(known.matrix)))
    usual = usual_spreads(list(reports.values()))
    for item in loads:
        report, rig = reports[item.id], rigs[item.id]
        scatter, own = scatter_of(report), own_spreads(report)
        [made] = points_of(known, item, rig, report, Measuring(scatter, own), [item.speed])
        fitted.append(Offer(made, recorded_seconds(report), False))
        points += points_of(known, item, rig, report, Measuring(scatter, usual), speeds, drawn)
    teeth = (False, True) if tooth and not any(rig.has_teeth for rig in rigs.values()) else (False,)
    steps = plan(known, goal.number, goal.wanted, points, DURATIONS, teeth, fitted)
    offers = [Offer(point, DURATIONS[0], tooth) for tooth in teeth for point in points]
    alone = weighed(known, goal.number, offers, (), fitted)
    names = [row["id"] for row in found.rows]
    zero = Measuring(0.0, usual).spread("torque_zero")
    document = _document(known, goal, steps, alone)
    return {**document, "zero_stderr_nm": zero, "recordings": names, "inputs": inputs}


def _fastest(known: KnownFit) -> FittedAt:
    return max(known.recordings, key=lambda one: one.speed)


def _loads(known: KnownFit) -> list[FittedAt]:
    ordered = sorted(known.recordings, key=lambda item: item.speed)
    places = sorted({0, len(ordered) // 2, len(ordered) - 1})
    return [ordered[k] for k in places]


def points_of(
    known: KnownFit, item: FittedAt, rig: Rig, report: Path, measuring: Measuring, speeds: Sequence[float],
    drawn: Sequence[Array] = (),
) -> list[OperatingPoint]:  # fmt: skip
    """Return the load of a fitted recording at some speeds [rad/s]; ``drawn`` as `operating_point` takes it."""
    curve = curve_of(report, item.speed)
    chains = [chain_of(rig, speed, curve, item.structure) for speed in speeds]
    basis = lift_basis(rig.table, chains[0].law, chains[0].theta)
    return [operating_point(known, chain, item, item.id, measuring, basis, drawn) for chain in chains]


def recorded_seconds(report: Path) -> float:
    """Return how long the cycles of a report lasted that it used."""
    with h5py.File(report / CYCLES) as file:
        return float(np.sum(2.0 * np.pi / np.asarray(file["cycles/speed"])))


def scatter_of(report: Path) -> float:
    """Return the standard deviation of one cycle's torque [N m] that a report states."""
    with h5py.File(report / CYCLES) as file:
        return float(np.sqrt(np.mean(np.asarray(file["mean/torque_std"]) ** 2)))


def own_spreads(report: Path) -> dict[str, float]:
    """Return how well a recording's own parameters, such as its zero, were known beforehand [SI]."""
    rows = read_result(report / NAME)["parameters"].items()
    own = {name: row["prior"][1] for name, row in rows if row["role"] == "own" and row["prior"]}
    return {name: std * ROWS[name].per_unit for name, std in own.items()}


def usual_spreads(reports: Sequence[Path]) -> dict[str, float]:
    """Return how well own parameters of a run are known beforehand on a bench [SI]: as in the middle one of its runs.

    How a zero was read is no property of a load: half of the recordings have one that was known as well or better.
    """
    every: dict[str, list[float]] = {}
    for report in reports:
        for name, std in own_spreads(report).items():
            every.setdefault(name, []).append(std)
    return {name: sorted(stds)[(len(stds) - 1) // 2] for name, stds in every.items()}


def _target(known: KnownFit, folder: Path, reports: Mapping[str, Path], wanted: tuple[str, float, bool]) -> Target:
    name, size, relative = wanted
    unit, per = shown_in(name)
    item = _fastest(known)
    if name == CHAMBER_PEAK:
        if item.structure == "line":
            raise Refusal(
                f"plan: found --target {name}, but the pressure on the plunger of {item.id} is the measured one, "
                "expected one that the fit rebuilds; its sensor's sheet says how well it is known: name a parameter"
            )
        rig, curve = rig_of(reports[item.id]), curve_of(reports[item.id], item.speed)
        chain = chain_of(rig, item.speed, curve, item.structure)
        value, gradient = chamber_peak(known, chain, item)
        of = item.id
    else:
        gradient = np.eye(len(known.names))[known.names.index(name)]
        of = ""
        value = float(known.values[known.names.index(name)])
    number = told_beside(TargetQuantity(gradient), known, folder, reports[item.id], name)
    if relative:
        need_size(name, value / per, number.std(known.matrix) / per, unit)
    std = size / 100.0 * abs(value) if relative else size * per
    return Target(name, of, unit, value, per, std, number)


def told_beside(number: TargetQuantity, known: KnownFit, folder: Path, report: Path, name: str) -> TargetQuantity:
    """Return a number with what its report states beside the covariance of the fit.

    The covariance of a joint fit knows of no bounds, its statement does; it states no chamber peak. A report of one
    recording does not say of which spreads that of its chamber peak is.
    """
    per = shown_in(name)[1]
    if (folder / CAMPAIGN).is_file():
        number = replace(number, within=known.within)
        row = read_campaign(folder / CAMPAIGN)["shared_parameters"].get(name)
        if not row or not row["stderr_statistical"]:
            return number
        own = row["stderr_statistical"] * per
        lasting = np.sqrt(max((row["stderr"] * per) ** 2 - own**2, 0.0))
        return replace(number, lasting=float(lasting), scale=own / number.std(known.matrix))
    document = read_result(report / NAME)
    row = (document["chamber"] or {}).get("peak_bar") if name == CHAMBER_PEAK else document["parameters"].get(name)
    stated = ((row or {}).get("stderr") or 0.0) * per
    beside = max(stated**2 - number.std(known.matrix) ** 2, 0.0)
    budget = document["uncertainty"]["budget"].get(name, {})
    kept = beside if name == CHAMBER_PEAK else sum((budget.get(one, 0.0) * per) ** 2 for one in STATED_OF_ALL)
    lasting = min(kept, beside)
    return replace(number, lasting=float(np.sqrt(lasting)), passing=float(np.sqrt(beside - lasting)))


def need_size(name: str, value: float, std: float, unit: str) -> None:
    """Refuse a share of a number that may as well be zero: its 95 % interval holds zero."""
    if abs(value) < COVERAGE * std:
        raise Refusal(
            f"plan: {name} is {value:.2g} ± {std:.2g} {unit}, so that zero is not excluded and a share of it means "
            f"nothing; expected the wanted uncertainty in {unit}, such as --target '{name} {0.5 * std:.1g}'"
        )


def _document(known: KnownFit, goal: Target, steps: Sequence[Step], alone: Sequence[Step]) -> dict[str, Any]:
    now = goal.number.std(known.matrix)
    last = steps[-1].std if steps else now
    return {
        "schema": "camtorque.plan/1", "version": __version__, "created": created(), "target": goal.name,
        "of": goal.of, "unit": goal.unit, "value": goal.value / goal.per_unit,
        "stderr_now": now / goal.per_unit, "stderr_wanted": goal.wanted / goal.per_unit,
        "stderr_between_fits": goal.number.passing / goal.per_unit,
        "reached": last <= AS_GOOD * goal.wanted, "runs": [_row(step, goal) for step in steps],
        "minutes": sum(step.minutes for step in steps), "on_offer": [_row(step, goal) for step in alone],
        "setup_minutes": SETUP_MINUTES, "tooth_minutes": TOOTH_MINUTES, "durations_s": DURATIONS,
        "fitted_speeds_rpm": sorted(item.speed / RPM for item in known.recordings),
    }  # fmt: skip


def _row(step: Step, goal: Target) -> dict[str, Any]:
    return {
        "speed_rpm": step.offer.point.speed / RPM, "load_of": step.offer.point.load, "duration_s": step.offer.duration,
        "second_tooth": step.offer.tooth, "minutes": step.minutes, "stderr_after": step.std / goal.per_unit,
    }  # fmt: skip
