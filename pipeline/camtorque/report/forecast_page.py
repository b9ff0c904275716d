"""The page and the document of runs predicted with the values of a fit, and what they assume, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.fit.clearance import CLEARANCE
from camtorque.fit.endings import EITHER, holding
from camtorque.fit.forecast import Forecast
from camtorque.fit.known_ends import Curve
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.jsonable import jsonable, now
from camtorque.records import Array, Estimate, Forces
from camtorque.report.chart import CAM_ANGLE, CYCLE, Band, Curves, Line, Panel
from camtorque.report.files import write_json, write_page
from camtorque.report.numbers import UNKNOWN, in_a_row, plus_minus, rounded_to_error, significant, words
from camtorque.report.page import Drawing, drawing_of, render
from camtorque.units import BAR, COVERAGE, DEGREE, RPM, TURN, short
from camtorque.version import __version__

SCHEMA = "camtorque.predict_from/1"
KEPT = 600
PRESSURE = "pressure"
"""Cause that dwarfs the others; it is drawn with the torque."""
SAME_SPEED = 0.02
"""Distance in ln speed that is still a fitted speed."""
TITLES = {
    "speed_rpm": "speed [rpm]", "torque_max_nm": "torque, largest [N m]", "torque_min_nm": "torque, smallest [N m]",
    "torque_mean_nm": "torque, mean [N m]", "chamber_peak_bar": "chamber pressure, largest [bar]",
    "delivered_mm3": "volume delivered in a stroke [mm³]", "contact_max_n": "contact force, largest [N]",
    "contact_min_n": "contact force, smallest; below 0 the cam pulls [N]",
    "hertz_max_gpa": "Hertz pressure, largest [GPa]",
    "law_error_percent": "error of the model in these bands [% of the peak torque, standard deviation]",
}  # fmt: skip
"""Key of a row of the sweep -> what the page calls it."""


def sweep_row(item: Forecast, forces: Sequence[Forces]) -> dict[str, Any]:
    """Return the extremes of one speed, each with its standard uncertainty.

    Parameters
    ----------
    forces : of the run, or of both where nobody knows how delivery ends
    """
    rows = [_extremes(one, force) for one, force in zip(item.both or (item,), forces, strict=True)]
    causes = {name: float(np.mean(values)) for name, values in item.by_cause.items()}
    other = item.other
    return {
        "speed_rpm": item.speed / RPM,
        **{name: _value(*(holding(*value, *rows[-1][name]))) for name, value in rows[0].items()},
        "law_error_percent": 100.0 * item.law_share, "beyond_fitted_speeds": item.beyond > SAME_SPEED,
        "contact_lost": item.take_off is not None,
        "model_steps": item.steps, "ending": item.ending, "other_ending": None if other is None else {
            "ending": other.structure, "torque_difference_nm": other.difference, "theta_deg": other.angle / DEGREE,
        },
        "mean_by_cause_nm": causes,
    }  # fmt: skip


def _extremes(item: Forecast, forces: Forces) -> dict[str, tuple[float, float]]:
    """Return the extremes of a run, each with its standard uncertainty."""
    top, low = int(np.argmax(item.torque)), int(np.argmin(item.torque))
    peak, load, least = int(np.argmax(item.pressure)), int(np.argmax(item.contact)), int(np.argmin(item.contact))
    hertz = float(np.nanmax(forces.hertz)) / 1e9
    # without a chamber its pressure is the measured one: how sure that is, and what leaves it, the fit does not tell
    rebuilt = np.nan if item.ending == "line" else 1.0
    relative = float(item.contact_std[load] / max(abs(item.contact[load]), 1e-9))
    return {
        "torque_max_nm": (item.torque[top], item.torque_std[top]),
        "torque_min_nm": (item.torque[low], item.torque_std[low]),
        "torque_mean_nm": (float(np.mean(item.torque)), item.mean_std),
        "chamber_peak_bar": (rebuilt * item.pressure[peak] / BAR, rebuilt * item.pressure_std[peak] / BAR),
        "delivered_mm3": (1e9 * rebuilt * item.delivered, 1e9 * rebuilt * item.delivered_std),
        "contact_max_n": (item.contact[load], item.contact_std[load]),
        "contact_min_n": (item.contact[least], item.contact_std[least]),
        "hertz_max_gpa": (hertz, 0.5 * relative * hertz),
    }


def _value(value: Array | float, std: Array | float) -> dict[str, Any]:
    return {
        "value": float(value),
        "stderr": float(std),
        "ci95": [float(value - COVERAGE * std), float(value + COVERAGE * std)],
    }


def assumed_of(items: Sequence[Forecast]) -> list[str]:
    """Return what was assumed, each sentence once, in the order of the runs."""
    return list(dict.fromkeys(text for item in items for text in item.assumed))


def forecast_document(
    items: Sequence[Forecast], forces: Sequence[Sequence[Forces]], source: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the predicted runs as JSON-ready values in border units.

    Parameters
    ----------
    forces : of each run, of both where nobody knows how its delivery ends
    source : where the values come from: ``fit``, ``recordings``, ``inputs``
    """
    return jsonable({
        "schema": SCHEMA, "version": __version__, "created": now(), **source,
        "assumed": assumed_of(items),
        "sweep": [sweep_row(item, force) for item, force in zip(items, forces, strict=True)],
        "curves": [
            {
                "theta_deg": _thin(item.theta / DEGREE), "torque_nm": _thin(item.torque),
                "torque_stderr_nm": _thin(item.torque_std), "shape_stderr_nm": _thin(item.shape_std),
                "pressure_bar": _thin(item.pressure / BAR),
                "pressure_stderr_bar": _thin(item.pressure_std / BAR), "contact_n": _thin(item.contact),
                "contact_stderr_n": _thin(item.contact_std),
                "by_cause_nm": {name: _thin(values) for name, values in item.by_cause.items()},
                "by_cause_stderr_nm": {name: _thin(values) for name, values in item.by_cause_std.items()},
            }
            for item in items
        ],
    })  # fmt: skip


def _thin(values: Array) -> Array:
    return values[:: max(1, values.size // KEPT)]


def write_forecast(items: Sequence[Forecast], document: Mapping[str, Any], title: str, folder: Path) -> None:
    """Write predict.json and predict.html of predicted runs into an existing folder."""
    drawings = [_drawing(f"speed_{k + 1}", item) for k, item in enumerate(items)]
    rows = document["sweep"]
    beyond = [f"{row['speed_rpm']:.0f}" for row in rows if row["beyond_fitted_speeds"]]
    peaks = "; ".join(
        f"{with_band(row['torque_max_nm'])} N m at {significant(row['speed_rpm'], 4)} rpm" for row in rows
    )
    answer = f"{peaks}."
    if beyond:
        answer += (
            f" {in_a_row(beyond)} rpm {'lie' if len(beyond) > 1 else 'lies'} beyond the fitted speeds: the bands "
            "are wider there, and a recording near that speed would narrow them."
        )
    unsure = [text for item in items for text in (*flight_text(item), *step_text(item), *ending_text(item))]
    answer = " ".join((answer, *dict.fromkeys(unsure)))
    html = render(
        "forecast.html", drawings, title=title, answer=answer,
        look=bool(beyond or unsure), assumed=document["assumed"],
        sweep=[(TITLES[key], [_cell(row[key]) for row in rows]) for key in TITLES],
    )  # fmt: skip
    write_page(folder / "predict.html", html)
    write_json(folder / "predict.json", document)


def with_band(estimate: Mapping[str, Any]) -> str:
    """Return a value with half the width of its 95 % interval, as many decimals as that has; one that nobody knows."""
    if estimate["value"] is None or np.isnan(estimate["value"]):
        return UNKNOWN
    half = COVERAGE * estimate["stderr"]
    return f"{rounded_to_error(estimate['value'], half)} ± {plus_minus(half)}"


def _cell(value: Any) -> str:
    return with_band(value) if isinstance(value, Mapping) else significant(value)


def _drawing(name: str, item: Forecast) -> Drawing:
    def panel(title: str, label: str, values: Array, std: Array, height: float) -> Panel:
        band = Band("95 % band", values - COVERAGE * std, values + COVERAGE * std, "chamber")
        return Panel(title, (Line(label, values, "fitted", 1.6),), (band,), height)

    causes = tuple(
        Line(words(cause), values, CYCLE[k % len(CYCLE)], 1.2)
        for k, (cause, values) in enumerate(item.by_cause.items())
        if cause != PRESSURE and np.any(np.abs(values) > 1e-9)
    )  # fmt: skip
    torque = panel("torque [N m]", "torque", item.torque, item.torque_std, 200.0)
    pressure = Line("of it by pressure", item.by_cause[PRESSURE], "c1", 1.2, "6 4")
    both = tuple(
        Line(f"if {ENDED_BY[one.ending]} ends delivery", one.torque, tone, 1.2)
        for one, tone in zip(item.both, CYCLE[2:], strict=False)
    )
    panels = (
        replace(torque, lines=(*torque.lines, *both, pressure)),
        Panel("other causes [N m]", causes, height=140.0),
        panel("chamber [bar]", "pressure on the plunger", item.pressure / BAR, item.pressure_std / BAR, 120.0),
    )
    return drawing_of(
        name, Curves(item.theta / DEGREE, CAM_ANGLE, panels), f"Torque at {significant(item.speed / RPM, 4)} rpm"
    )


SAME_LOAD = 1.1
"""Factor beyond the highest line pressures of the fitted recordings that is still a fitted load."""
SAME_PLACE, SPREAD = 2.0 * DEGREE, 4.0 * DEGREE
"""A line pressure that rises so far beyond those of fitted recordings has another zero of its angle, or is of another
pump; within a campaign they rise up to 4 degrees apart, which one or two recordings do not show [rad]."""
NOT_TOLD = "A line pressure does not tell whether a land or a spill ended delivery"
ENDED_BY = {"land": "a land", "spill": "spill"}
"""Structure -> what ends delivery."""


def load_text(source: FittedAt, name: str, given: Curve | None, speed: float) -> str:
    """Return what was taken as the load; ``name`` of the recording or file that was given."""
    if given is None:
        return (
            f"at {speed / RPM:.0f} rpm the line pressure of {source.id} ({source.speed / RPM:.0f} rpm), over cam angle "
            "as it was recorded"
        )
    if np.isfinite(given.speed):
        return f"the line pressure of {name}"
    text = f"the line pressure of {name}, at every speed, over the cam angle that the trigger's nominal angle counts"
    at_speed = replace(given, speed=speed)
    if at_speed.coarse:
        text += (
            f"; its points are {given.step / DEGREE:.2g} deg apart under load, which widens the band; "
            f"{_rounded(at_speed.fine_step / DEGREE):g} deg would do at {speed / RPM:.0f} rpm"
        )
    return text


def beyond_text(top: float, fitted: tuple[float, float]) -> tuple[str, ...]:
    """Return that a load lies beyond the fitted ones, where it does; both by the highest line pressure [Pa]."""
    low, high = fitted
    if low / SAME_LOAD < top < high * SAME_LOAD:
        return ()
    return (
        f"The load lies beyond the fitted ones: its line pressure reaches {top / BAR:.4g} bar, those of the fitted "
        f"recordings {low / BAR:.4g} to {high / BAR:.4g} bar. The bands cover the errors of left-out recordings, each "
        "with its own load, and no more.",
    )


def elsewhere_text(angle: float, fitted: tuple[float, float]) -> tuple[str, ...]:
    """Return that a load rises at another cam angle than the fitted ones, where it does [rad]."""
    low, high = fitted
    margin, middle = max(SAME_PLACE, SPREAD - (high - low)), 0.5 * (low + high)
    apart = abs(float(np.remainder(angle - middle + np.pi, TURN)) - np.pi)
    if not apart > 0.5 * (high - low) + margin:  # nan: steady pressures have no angle
        return ()
    return (
        f"Do not rely on this load before its angle is checked: it begins to rise at {angle / DEGREE:.1f} deg of cam "
        f"angle, those of the fitted recordings at {low / DEGREE:.1f} to {high / DEGREE:.1f} deg; it has to count from "
        "the zero of the lift table. Each degree moves end of delivery and chamber, beyond these bands.",
    )


def _rounded(step_deg: float) -> float:
    """Return a round step that is not larger."""
    return next((step for step in (1.0, 0.5, 0.25, 0.2) if step <= step_deg), 0.1)


def assumptions(known: KnownFit, source: FittedAt, load: str, clearance: str, other: Path | None) -> tuple[str, ...]:
    """Return what load, error of the model, clearance and pump were taken to be; ``other`` pump file or lift table."""
    laws = "as large as predictions of left-out recordings were off" if source.left_out else (
        "what the fit left over on its own held-out cycles, and 2 % of the peak torque more for each factor of 2.7 in "
        "speed away from it; a campaign over several speeds would tell it better"
    )  # fmt: skip
    texts = [f"Load: {load}.", "The zero error of a torque transducer is not added.",
             f"Error of the model: {laws}. It follows the torque over the revolution."]  # fmt: skip
    if clearance:
        base = "" if "um" in clearance[:-2] else f", counted from {CLEARANCE * 1e6:g} µm"
        texts.append(f"Clearance {clearance}{base}: leakage in proportion to its third power.")
    if known.lift is not None and np.any(known.lift.values):
        largest = float(np.max(np.abs(known.lift.values)))
        texts.append(f"The lift table is corrected by up to {1e6 * largest:.1g} µm, as all fitted recordings require.")
    if known.unexplained:
        them = "it" if len(known.unexplained) == 1 else "them"
        texts.append(f"Nothing is taken from {', '.join(known.unexplained)}: the fit does not explain {them}.")
    if other is not None:
        texts.append(f"Pump or cam of {other.name}; losses and chamber are those of the fitted pump.")
    return tuple(texts)


def end_text(ends: Mapping[str, Estimate], source: FittedAt, known: KnownFit, speed_rpm: float) -> tuple[str, ...]:
    """Return where delivery was taken to end, and how well that is known."""
    units = {"end_of_delivery": (DEGREE, "deg of cam angle"), "spill_lift": (1e-3, "mm of lift")}
    found = [(ends[name], per, unit) for name, (per, unit) in units.items() if name in ends]
    if not found:  # of a structure whose delivery ends nowhere
        return ()
    alike = any(item.structure == source.structure for item in known.recordings)
    kind = ENDED_BY[source.structure]
    how = "as the mean of these; what another sharpness would shift is in the bands" if alike else (
        "as before any fit, and as unsure"
    )  # fmt: skip
    by = f"by {kind} as in {source.id}" if alike else f"by {kind}, as no fitted recording does"
    return (
        *(
            f"Delivery at {speed_rpm:g} rpm ends at {end.value / per:.3g} ± {2.0 * end.stderr / per:.2g} {unit}, {by}."
            for end, per, unit in found
        ),
        f"Delivery by {kind} is taken to end where the line pressure looks as it does at the fitted ends, and how "
        f"sharply {how}.",
    )


def ending_text(item: Forecast) -> tuple[str, ...]:
    """Return the assumption on how delivery ends under a given load."""
    if item.ending == EITHER:
        return (
            f"{NOT_TOLD}: the bands hold both, the curves lie midway; --ending {' or --ending '.join(ENDED_BY)} "
            "predicts one of them.",
        )
    if item.other is None:
        return ()
    other, so = item.other, ENDED_BY[item.other.structure]
    more = "higher" if other.difference > 0.0 else "lower"
    apart = f"{short(abs(other.difference), 2)} N m {more} at {other.angle / DEGREE:.0f} deg of cam angle"
    return (
        f"{NOT_TOLD}: it is {ENDED_BY[item.ending]} as in the fitted recordings. If {so} ends it, the torque at "
        f"{item.speed / RPM:.4g} rpm is up to {apart}: --ending {other.structure} predicts it, --ending {EITHER} holds "
        "both.",
    )


def step_text(item: Forecast) -> tuple[str, ...]:
    """Return that the model steps within what the fit leaves open, where it does."""
    if not item.steps:
        return ()
    top = int(np.argmax(item.torque))
    return (
        f"Do not rely on the torque at {item.speed / RPM:.4g} rpm: within what the fit leaves open it may jump either "
        "way, as with a delivery valve close to chattering. The curve is the middle one of many, its peak "
        f"known to ± {short(100.0 * COVERAGE * item.torque_std[top] / item.torque[top], 2)} %; a recording near that "
        "speed would tell.",
    )


def flight_text(item: Forecast) -> tuple[str, ...]:
    """Return that the follower leaves the cam, where it does: the model of a fit keeps it there."""
    if item.take_off is None:
        return ()
    return (
        f"Do not rely on the run at {item.speed / RPM:.0f} rpm: the follower leaves the cam at "
        f"{item.take_off / DEGREE:.0f} deg of cam angle. From there, until it would land, torque and forces are those "
        f"of a cam that pulls (with up to {-item.least_contact:.3g} N); ask for lower speeds.",
    )


def constant_text(item: Forecast) -> tuple[str, ...]:
    """Return how much of the band is one constant, where that is most of it."""
    constant = COVERAGE * float(np.sqrt(np.median(item.torque_std**2 - item.shape_std**2).clip(0.0)))
    if constant < COVERAGE * float(np.median(item.shape_std)):
        return ()
    return (
        f"At {item.speed / RPM:.0f} rpm ± {constant:.2g} N m of the band is one constant over the revolution: steady "
        "drag that the fitted recordings do not tell from their zeros.",
    )
