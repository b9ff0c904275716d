"""The tables of a page as rows, and what the alignment and the chamber say in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from camtorque.laws import ROWS
from camtorque.records import APART, KNOWLEDGE, TOGETHER, UNTOLD
from camtorque.report.answer import NOT_LOSSES, estimate_text, sure
from camtorque.report.gaps import STRETCHES
from camtorque.report.numbers import (
    UNKNOWN,
    plus_minus,
    rounded_to_error,
    signed_significant,
    significant,
    unit_text,
    with_decimals,
    words,
)
from camtorque.report.verdict import Document
from camtorque.units import LOGARITHM

METRIC_NAMES = {
    "rigid": "rigid model",
    "fitted": "fitted model, fitted cycles",
    "fitted_held_out_cycles": "fitted model, held-out cycles",
}
SMALL_ERROR = 0.05
"""A source of angle error below this share of the largest one stands in a line below the table."""
STRONG = 0.9
"""Correlation from which on two parameters are shown as a pair."""


def inside_text(doc: Document) -> str:
    """Return chamber and forces in words."""
    forces, chamber = doc["forces"], doc["chamber"]
    text = (
        f"Largest values: contact {significant(forces['contact_normal_max_n'])} N, "
        f"bearing {significant(forces['bearing_max_n'])} N, "
        f"guide {significant(forces['guide_max_n'])} N, Hertz pressure {significant(forces['hertz_max_gpa'])} GPa. "
    )
    for key, what in (("peak_bar", "peaks at"), ("return_start_bar", "at 95 % of the lift on the return is still")):
        value = chamber[key] if chamber else None
        if value and value["value"] is not None:
            text += f"The chamber pressure {what} {estimate_text(doc, value, 'bar')}. "
    lost = "The follower leaves the cam." if forces["contact_lost"] else "The follower stays on the cam."
    return text + lost + measured_text(doc)


def measured_text(doc: Document) -> str:
    """Return measured chamber pressure and delivered volume against the model in words, empty without them."""
    text, chamber, volume = "", doc["measured"]["chamber_pressure"], doc["measured"]["delivered_volume"]
    if chamber:
        text += (
            f" The measured chamber pressure peaks at {significant(chamber['peak_bar'], 4)} bar, the rebuilt one at "
            f"{significant(chamber['rebuilt_peak_bar'], 4)} bar; they differ by "
            f"{significant(chamber['rms_difference_bar'], 2)} bar RMS "
            f"({significant(chamber['rms_difference_percent'], 2)} % of the peak), most at "
            f"{with_decimals(chamber['largest_difference_at_deg'], 0)} deg "
            f"({signed_significant(chamber['largest_difference_bar'])} bar)"
        )
        inside = with_decimals(chamber["loaded_inside_two_std_percent"], 0)
        agree = f", and agree within two standard uncertainties at {inside} % of the loaded angles"
        text += (agree if doc["explained"] else "") + "."
    if volume:
        model = volume["modelled_mm3"]
        text += (
            f" Delivered per stroke: {significant(volume['measured_mm3'], 4)} mm³ measured, "
            f"{estimate_text(doc, model, 'mm³')} by the model "
            f"({signed_significant(volume['difference_percent'])} %)."
        )
    return text


def alignment_text(doc: Document) -> str:
    """Return trigger angle and delay in words."""
    trigger, delay = doc["alignment"]["trigger_angle_deg"], doc["alignment"]["torque_delay_s"]
    text = f"Trigger angle {estimate_text(doc, trigger, 'deg')} (nominal {significant(trigger['nominal'], 4)} deg). "
    if delay["value"] is not None:
        interval = f" ± {with_decimals(1e3 * delay['stderr'], 4)}" if sure(doc, delay["stderr"]) else ""
        text += f"Torque delay {with_decimals(1e3 * delay['value'], 4)}{interval} ms. "
    return text + (
        "Remaining errors of the cam angle (standard deviations). After the fit each is that of one parameter; "
        "they compensate one another and do not add up:"
    )


def budget_rows(before: Sequence[Document], after: Sequence[Document]) -> list[dict[str, Any]]:
    """Return the angle error budget with both columns; None where neither fit nor sheet gives a number.

    Sources go by the name of the parameter that stands for them after the fit, so that none is listed twice.
    """
    aliases = {"trigger installation": "trigger angle", "shaft twist": "shaft compliance"}
    rows: dict[str, dict[str, Any]] = {}
    for column, part in (("before", before), ("after", after)):
        for item in part:
            name = str(aliases.get(item["source"], item["source"]))
            row = rows.setdefault(name, {"source": name, "before": None, "after": None, "text": ""})
            row[column] = item["std_deg"] if row[column] is None else row[column]
            if item["text"] and item["text"] not in row["text"]:
                row["text"] += ("; " if row["text"] else "") + item["text"]
    return list(rows.values())


def by_size(rows: Sequence[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the sources of angle error that matter before or after the fit, the largest first, and the small ones."""
    known = [row for row in rows if row["before"] or row["after"]]
    known.sort(key=lambda row: -(row["after"] or 0.0))
    largest = max((max(row["before"] or 0.0, row["after"] or 0.0) for row in known), default=0.0)
    small = [
        row
        for row in known
        if row["after"] is not None and max(row["before"] or 0.0, row["after"]) < SMALL_ERROR * largest
    ]
    return [row for row in known if row not in small], small


def parameter_groups(doc: Document) -> list[dict[str, Any]]:
    """Return the parameters by what the data added, each group with its rows in the order of the fit."""
    texts = (
        "The data determine the value; what was known before hardly matters.",
        "The data give an upper limit only: the interval reaches its lower bound in the fit, mostly zero.",
        "The data narrowed what was known before.",
        "Known no better than from sheet, certificate or literature; the fit may shift them within that uncertainty.",
        "Neither the data nor a sheet or literature determine these: the value is where the search stopped.",
    )
    rows = [parameter_row(name, row, doc["explained"]) for name, row in doc["parameters"].items()]
    return [
        {"name": name, "text": text, "untold": name in UNTOLD, "rows": found}
        for name, text in zip(KNOWLEDGE, texts, strict=True)
        if (found := [row for row in rows if row["knowledge"] == name])
    ]


def parameter_row(name: str, row: Document, explained: bool) -> dict[str, Any]:
    """Return one parameter as the texts of a table; no interval where the model does not explain the data."""
    logarithm = LOGARITHM.fullmatch(row["unit"])
    shown = _factors(row) if logarithm else _amounts(row, least_of(name))
    if not (explained and row["stderr"] is not None):
        shown |= {"error": UNKNOWN, "interval": UNKNOWN}
    return {
        **shown, "name": words(name), "meaning": row["meaning"].removeprefix("logarithm of "),
        "unit": unit_text(logarithm[1] if logarithm else row["unit"]), "knowledge": row["knowledge"],
        "at_bound": row["at_bound"], "mixed": [words(other) for other in row["confounded_with"]],
        "source": row["source"],
    }  # fmt: skip


def least_of(name: str) -> float:
    """Return the lower bound of a parameter in the unit that it is shown in, none of what is no parameter of a law."""
    row = ROWS.get(name.split("__")[0])
    return -math.inf if row is None else row.lower / row.per_unit


def _amounts(row: Document, least: float) -> dict[str, str]:
    prior, stderr, (low, high) = row["prior"], row["stderr"], row["ci95"]
    top = rounded_to_error(high, stderr)
    only_top = row["knowledge"] == KNOWLEDGE[1] or low < least  # a bound of the search: nothing tells what lies below
    return {
        "value": rounded_to_error(row["value"], stderr), "error": plus_minus(stderr),
        "interval": f"at most {top}" if only_top else f"{rounded_to_error(low, stderr)} … {top}",
        "prior": f"{significant(prior[0])} ± {significant(prior[1], 2)}" if prior else UNKNOWN,
    }  # fmt: skip


def _factors(row: Document) -> dict[str, str]:
    """Return a parameter that is fitted by its logarithm as it is: with a factor in place of an amount more or less."""

    def factor(value: float | None, digits: int = 2) -> str:
        return significant(None if value is None else math.exp(value), digits)

    prior = row["prior"]
    return {
        "value": factor(row["value"], 3), "error": f"×/÷ {factor(row['stderr'])}",
        "interval": " … ".join(factor(end) for end in row["ci95"]),
        "prior": f"{factor(prior[0])} ×/÷ {factor(prior[1])}" if prior else UNKNOWN,
    }  # fmt: skip


def pair_rows(names: Sequence[str], correlation: Any) -> list[dict[str, Any]]:
    """Return the pairs of parameters that the recording can hardly tell apart, the strongest first."""
    pairs = [
        {"first": words(names[j]), "second": words(names[k]), "correlation": float(correlation[j][k])}
        for j in range(len(names))
        for k in range(j)
        if abs(correlation[j][k]) >= STRONG
    ]
    return sorted(pairs, key=lambda row: -abs(row["correlation"]))


def loss_rows(doc: Document) -> list[dict[str, str]]:
    """Return the work by cause with its uncertainty and share of the input; what is conserved reads 0."""
    losses, errors = doc["losses"], doc["losses_stderr"]
    total = losses["input"]
    work = {name: value for name, value in losses.items() if name not in NOT_LOSSES and value is not None}
    if errors.get(TOGETHER) is not None:
        work[TOGETHER] = sum(work[name] for name in APART)
    rows = []
    for name, value in work.items():
        error = errors.get(name)
        conserved = abs(value) < 1e-6 * abs(total) and (error or 0.0) < 1e-3 * abs(total)
        known = not conserved and sure(doc, error)
        rows.append({
            "name": words(name),
            "work": "0" if conserved else rounded_to_error(value, error) if known else significant(value),
            "error": f"± {plus_minus(error)}" if known else "",
            "share": "0" if conserved else with_decimals(_share(value, total), 2),
        })  # fmt: skip
    return rows


def gap_rows(doc: Document) -> list[dict[str, Any]]:
    """Return the gap by cause with uncertainties and shares of its total; a total of zero has no shares."""
    gap = doc["gap_by_cause"]
    total = gap["total"]
    return [
        {
            **row,
            "name": words(row["cause"]),
            **{
                f"{part}_error": f"± {with_decimals(error, 3)}" if sure(doc, error := row[f"{part}_stderr_nm"]) else ""
                for part in STRETCHES
            },
            "forward_share": _share(row["forward_nm"], total["forward_nm"]),
            "return_share": _share(row["return_minimum_nm"], total["return_minimum_nm"]),
        }
        for row in gap["causes"]
    ]


def _share(part: float, total: float) -> float | None:
    return 100.0 * part / total if total else None
