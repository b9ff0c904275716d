"""The headline of a run: explained, to look at more closely, or unexplained; and why, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from camtorque.records import Metrics
from camtorque.report.numbers import in_a_row, signed_significant, significant, with_decimals, words

Document = Mapping[str, Any]
WIDE_DEG, AROUND_DEG = 90.0, 320.0
"""A wider stretch of the residual has more than one phase; one all around the revolution is nowhere."""
GOOD_RMS_PERCENT, GOOD_GAP_PERCENT, GOOD_RETURN_NM = 0.35, 0.5, 0.4
"""What a fitted model is expected to reach on held-out cycles; beyond it the verdict asks to look closer."""
NOTICED, NEWS = 0.5, 1.0
"""A second minimum is named where it moves trigger or chamber peak by more than so many standard uncertainties, in the
headline where by more than so many."""
EVEN = 0.3
"""A second solution this probable stands in the headline."""
UNUSUAL = {
    "values_implausible": "values that are unusual together",
    "cam_side_too_light": "a shaft that rings as if the cam were lighter than it is",
    "trigger_beyond_tolerance": "a trigger beyond its mounting tolerance",
}
"""Finding on values that may stand in for what the model lacks -> how the headline names them."""
FAR_PULLED, FAR_OFF = 3.5, "values far from what was expected"
"""Standard deviations off what was expected from which on a single value is named so: with 50 values one bench in forty
has one."""
STAND_INS, BEYOND_CATALOGUES = ("drive_admittance", "coupling_compliance", "half_inertia"), 2.5
"""What stands in for a driveline that no law here describes, and the standard deviations from which on that is named:
drives as light, couplings as soft and hubs as heavy are in no catalogue."""
STATED, CONTRADICTED = (
    "gain_error", "torque_zero", "pressure_zero", "delay_error", "spring_stiffness_error", "spring_preload_error",
), 3.0  # fmt: skip
"""What certificate, readings and sheet state of this very bench, and the standard deviations from which on the data
contradict that: of 91 sound benches of five makers none has one beyond 2.6."""
DOUBTFUL = {
    "base_torque_negative": "a torque that is negative on the base circle",
    "base_torque_large": "a torque on the base circle that is too large for drag",
    "torque_against_model": "a torque that does not suit the plunger of the sheet",
    "torque_beyond_pressure": "a torque too large for the pressure",
    "torque_inverted": "a torque whose sign was reversed",
    "speed_off_nominal": "a speed far from the nominal one",
    "torque_without_mean": "a torque without a mean",
    "torque_flat_top": "a torque whose top is cut off",
    "pressure_flat_top": "a pressure whose top is cut off",
    "low_cycles_used": "only those cycles that stay within the range of a sensor",
    "load_changes": "a load that was not one",
    "torque_size_drifts": "a torque whose size drifts beside its pressure",
    "csv_cut_row": "a log that may be cut short",
    "mains_hum": "mains hum that stays in the mean torque",
    "no_load_friction": "a pump without friction under load",
    "trigger_slipped": "a trigger that slipped",
    "trigger_far_off": "a trigger far from where torque and pressure put it",
    "sheet_contradicted": "a sheet that torque and pressure contradict",
    "sensitivity_off_nominal": "a certificate that contradicts its sheet",
    "sensitivity_off_ranges": "a sensitivity that contradicts the ranges of its sheet",
    "lift_outlier": "a lift table with outliers",
    "contact_stress_impossible": "a contact stress that no steel bears",
    "pressure_along_line": "a pressure that is measured far along the line",
    "chamber_contradicted": "a measured chamber pressure that contradicts the rebuilt one",
    "delivery_contradicted": "a measured delivery that contradicts the model",
    "contact_lost": "a follower that leaves its cam",
    "not_converged": "a search that stopped short of its minimum",
}
"""Warning on what a fit rests on -> how the headline names it; an error is named by its code."""


def verdict(doc: Document) -> dict[str, Any]:
    """Return the headline of a run: ``level`` is ``good``, ``look`` or ``unexplained``."""
    held, rigid = doc["metrics"]["fitted_held_out_cycles"], doc["metrics"]["rigid"]
    if not doc["explained"]:
        return {"level": "unexplained", "head": "UNEXPLAINED", "text": unexplained_text(doc)}
    text = (
        f"the fitted model matches the measured torque to {significant(held['rms_percent_of_peak'], 2)} % of its peak "
        f"(RMS); the rigid model misses it by {significant(rigid['rms_percent_of_peak'], 2)} %."
    )
    missed, odd = missed_limits(held), unusual_values(doc)
    if missed:
        text += f" More than expected: {'; '.join(missed)}. Look at the residual before using the values."
    if odd:
        text += f" The model matches it only with {in_a_row(odd)}: see the warnings before using the values."
    doubtful = doubtful_input(doc)
    if doubtful:
        text += f" Something it rests on is in doubt ({'; '.join(doubtful)}): see the findings before using the values."
    second = next((row for row in doc["alternatives"][1:] if (row["probability"] or 0.0) >= EVEN), None)
    if second is not None and moves(second, doc, NEWS):
        kind = f" ({second['name']})" if second["name"] != doc["alternatives"][0]["name"] else ""
        text += (
            f" Another solution fits about as well{kind}, with the trigger at "
            f"{significant(second['trigger_angle_deg'], 4)} deg and a chamber peak of "
            f"{significant(second['chamber_peak_bar'], 4)} bar."
        )
    look = bool(missed or odd or doubtful)
    return {"level": "look" if look else "good", "head": "Look closer" if look else "Explained", "text": text}


def unusual_values(doc: Document) -> list[str]:
    """Return that the values are unusual, in words, where no bench as expected has them."""
    limits = {**dict.fromkeys(STAND_INS, BEYOND_CATALOGUES), **dict.fromkeys(STATED, CONTRADICTED)}
    far = [FAR_OFF] if any(pull(row) > limits.get(name, FAR_PULLED) for name, row in doc["parameters"].items()) else []
    return list(dict.fromkeys([*far, *(UNUSUAL[row["code"]] for row in doc["findings"] if row["code"] in UNUSUAL)]))


def pull(row: Document) -> float:
    """Return how many standard deviations a parameter lies off what was expected, 0 where nothing was."""
    if not row["prior"] or row["value"] is None:
        return 0.0
    mean, std = row["prior"]
    return abs(row["value"] - mean) / std


def doubtful_input(doc: Document) -> list[str]:
    """Return what is wrong with that on which an explained fit rests, in words, each once."""
    loud = [row for row in doc["findings"] if row["severity"] != "info"]
    return list(dict.fromkeys(
        DOUBTFUL.get(row["code"], words(row["code"])) for row in loud
        if row["code"] in DOUBTFUL or row["severity"] == "error"
    ))  # fmt: skip


def missed_limits(held: Document) -> list[str]:
    """Return which limits of a good fit the held-out cycles miss, in words."""
    known = {key: math.nan if value is None else value for key, value in held.items()}
    distance = abs(known["return_min_measured_nm"] - known["return_min_model_nm"])
    checks = (
        (known["rms_percent_of_peak"], GOOD_RMS_PERCENT, "residual", "%"),
        (abs(known["forward_gap_percent"]), GOOD_GAP_PERCENT, "forward gap", "%"),
        (distance, GOOD_RETURN_NM, "return minimum off by", "N m"),
    )
    return [
        f"{name} {significant(value, 2)} {unit}, at most {limit:g} {unit} expected"
        for value, limit, name, unit in checks
        if not value <= limit
    ]


def called(row: Document) -> str:
    """Return what a recording of a campaign.json is called: its folder, and its id where that is another.

    A joint fit and a recording's own page go by ids.
    """
    folder, known_by = row["name"], row.get("id")
    return folder if not known_by or known_by == folder.rpartition("/")[2] else f"{folder} ({known_by})"


def unexplained(doc: Document) -> list[str]:
    """Return the names of the recordings of a campaign.json that the model does not explain."""
    return [called(row) for row in doc["recordings"] if row.get("explained") is False]


def doubtful(doc: Document) -> list[str]:
    """Return the names of the recordings of a campaign.json whose own page asks to look closer."""
    return [called(row) for row in doc["recordings"] if row.get("verdict") == "look"]


def known_metrics(row: Document) -> Metrics:
    """Return the metrics of a result; null is nan."""
    return Metrics(**{key: math.nan if value is None else value for key, value in row.items()})


def bump_place(bump: Mapping[str, Any]) -> str:
    """Return the stretch where a residual stands out, and the phase of its largest value."""
    start, stop = bump["start_deg"], bump["stop_deg"]
    width = (stop - start) % 360.0 or 360.0
    place = "all around" if width > AROUND_DEG else f"{with_decimals(start, 0)} to {with_decimals(stop, 0)} deg"
    return f"{place} ({'largest: ' if width > WIDE_DEG else ''}{bump['phase']})"


def bump_places(doc: Document) -> str:
    """Return where the residual stands out, in words, empty where it does not."""
    return "; ".join(
        f"{bump_place(bump)}: up to {signed_significant(bump['peak_nm'])} N m, "
        f"{significant(bump['times_repeatability'], 2)} times the cycle repeatability"
        + (f", swinging at {significant(bump['frequency_hz'], 2)} Hz" if bump["frequency_hz"] else "")
        for bump in doc["bumps"]
    )


def unexplained_text(doc: Document) -> str:
    """Return where the model fails, and what follows for every value on the page."""
    held, accuracy, places = doc["metrics"]["fitted_held_out_cycles"], doc["accuracy"], bump_places(doc)
    start = (
        f"the best fit is {significant(held['rms_percent_of_peak'], 2)} % of the peak torque (RMS) off, while the "
        f"cycles repeat to {significant(accuracy['repeatability_percent'], 2)} %. "
    )
    where = f"It fails (by the fitted cycles) at {places}. " if places else "The misfit is spread over the revolution. "
    return (
        start + where + "Something acts there that is not in the model. The values below come from an incomplete "
        "model: do not rely on any of their intervals."
    )


def differs(row: Document, doc: Document) -> bool:
    """Return whether an alternative says anything else of structure, trigger or chamber than the chosen one."""
    return row["name"] != doc["alternatives"][0]["name"] or moves(row, doc, NOTICED)


def moves(row: Document, doc: Document, times: float) -> bool:
    """Return whether an alternative has trigger or chamber peak off by more than so many standard uncertainties."""
    first = doc["alternatives"][0]
    shown = ((doc["alignment"]["trigger_angle_deg"], "trigger_angle_deg"),
            ((doc["chamber"] or {}).get("peak_bar"), "chamber_peak_bar"))  # fmt: skip
    return any(
        abs((row[key] or 0.0) - (first[key] or 0.0)) > times * (estimate["stderr"] or 0.0)
        for estimate, key in shown if estimate
    )  # fmt: skip
