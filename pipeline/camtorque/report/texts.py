"""The plain words of a page: verdict, key numbers, what the alignment and the chamber say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from camtorque.report.numbers import UNKNOWN, fixed, near, num, signed

GOOD_RMS_PERCENT, GOOD_GAP_PERCENT, GOOD_RETURN_NM = 0.35, 0.5, 0.4
"""What a fitted model is expected to reach on held-out cycles; beyond it the verdict asks to look closer."""
METRIC_NAMES = {
    "rigid": "rigid model",
    "fitted": "fitted model, fitted cycles",
    "fitted_held_out_cycles": "fitted model, held-out cycles",
}
Document = Mapping[str, Any]


def verdict(doc: Document) -> dict[str, Any]:
    """Return the headline of a run and whether the fit is as good as expected."""
    held, rigid = doc["metrics"]["fitted_held_out_cycles"], doc["metrics"]["rigid"]
    distance = abs(held["return_min_measured_nm"] - held["return_min_model_nm"])
    good = (
        held["rms_percent_of_peak"] <= GOOD_RMS_PERCENT
        and abs(held["forward_gap_percent"]) <= GOOD_GAP_PERCENT
        and distance <= GOOD_RETURN_NM
    )
    start = "The fitted model meets the measurement" if good else "Look closer: the fitted model stays off"
    text = (
        f"{start}: {num(held['rms_percent_of_peak'], 2)} % of the peak torque RMS on cycles that it has not seen, "
        f"where the rigid model alone is off by {num(rigid['rms_percent_of_peak'], 2)} %. Forward stroke "
        f"{signed(rigid['forward_gap_percent'])} % before, {signed(held['forward_gap_percent'])} % after; "
        f"return-stroke minimum {fixed(held['return_min_measured_nm'], 1)} N m measured, "
        f"{fixed(rigid['return_min_model_nm'], 1)} "
        f"rigid, {fixed(held['return_min_model_nm'], 1)} fitted."
    )
    serious = sum(row["severity"] != "info" for row in doc["findings"])
    if serious:
        text += f" {serious} warning{'s' if serious > 1 else ''} below."
    return {"good": good, "text": text}


def cards(doc: Document) -> list[dict[str, str]]:
    """Return the key numbers of a run."""
    held, recording, chamber = doc["metrics"]["fitted_held_out_cycles"], doc["recording"], doc["chamber"]
    rows = [
        (f"{fixed(recording['peak_torque_nm'], 1)} N m", "peak of the measured torque"),
        (f"{num(held['rms_percent_of_peak'], 2)} %", "RMS of peak torque, held-out cycles"),
        (f"{signed(held['forward_gap_percent'])} %", "forward gap after the fit"),
        (f"{recording['cycles_used']} / {recording['cycles_found']}", "cycles used / complete"),
        (f"{fixed(doc['losses']['input'], 2)} J", "drive work per revolution"),
        (f"{signed(doc['losses']['closure_percent'])} %", "of it left unexplained"),
    ]
    peak = chamber["peak_bar"] if chamber else None
    rows.append((f"{near(peak['value'], peak['stderr'])} bar" if peak else UNKNOWN, "peak of the chamber pressure"))
    rows.append((f"{num(doc['forces']['hertz_max_gpa'])} GPa", "largest Hertz pressure"))
    return [{"value": value, "text": text} for value, text in rows]


def inside_text(doc: Document) -> str:
    """Return chamber and forces in words."""
    forces, chamber = doc["forces"], doc["chamber"]
    text = (
        f"Largest values: contact {num(forces['contact_normal_max_n'])} N, bearing {num(forces['bearing_max_n'])} N, "
        f"guide {num(forces['guide_max_n'])} N, Hertz pressure {num(forces['hertz_max_gpa'])} GPa. "
    )
    for key, what in (("peak_bar", "peaks at"), ("return_start_bar", "stands, where the return stroke starts, at")):
        value = chamber[key] if chamber else None
        if value:
            text += (
                f"The chamber pressure {what} {near(value['value'], value['stderr'])} ± {num(value['stderr'], 2)} bar. "
            )
    lost = "The follower leaves the cam." if forces["contact_lost"] else "The follower stays on the cam."
    return text + lost


def alignment_text(doc: Document) -> str:
    """Return trigger angle and delay in words."""
    trigger, delay = doc["alignment"]["trigger_angle_deg"], doc["alignment"]["torque_delay_s"]
    text = f"Trigger angle {near(trigger['value'], trigger['stderr'])} ± {num(trigger['stderr'], 2)} deg"
    text += f" (nominal {num(trigger['nominal'], 4)} deg). "
    if delay["value"] is not None:
        text += f"Torque delay {fixed(1e3 * delay['value'], 4)} ms"
        text += f" ± {fixed(1e3 * delay['stderr'], 4)} ms. " if delay["stderr"] is not None else ". "
    return text + "The residual errors of the cam angle, as standard deviations:"


def budget_rows(before: Sequence[Document], after: Sequence[Document]) -> list[dict[str, Any]]:
    """Return the angle error budget with both columns; sources that only the fit knows stand below."""
    left = {row["source"]: row for row in after}
    aliases = {"trigger installation": "trigger angle", "shaft twist": "shaft compliance"}
    rows = []
    for row in before:
        found = left.pop(aliases.get(row["source"], row["source"]), None)
        text = row["text"] if found is None or found["text"] in ("", row["text"]) else f"{row['text']}; {found['text']}"
        rows.append(
            {"source": row["source"], "before": row["std_deg"], "after": found and found["std_deg"], "text": text}
        )
    rows += [{"source": k, "before": None, "after": v["std_deg"], "text": v["text"]} for k, v in left.items()]
    return rows


def check_rows(doc: Document) -> list[dict[str, Any]]:
    """Return the profiled parameters with their profile, bootstrap and largest sources of uncertainty."""
    told = doc["uncertainty"]
    rows = []
    for name, found in told["profiles"].items():
        parameter, parts = doc["parameters"][name], told["budget"][name]
        width = parameter["stderr_statistical"]
        total = sum(value**2 for value in parts.values()) or 1.0
        largest = sorted(parts.items(), key=lambda item: -item[1])[:3]
        shares = ", ".join(f"{source} {100.0 * value**2 / total:.0f} %" for source, value in largest if value > 0.0)
        rows.append({
            "name": name, "kind": found["kind"], "statistical": width, "resampled": told["bootstrap"].get(name),
            "interval": f"{near(found['low'], width)} … {near(found['high'], width)} {parameter['unit']}",
            "sources": shares,
        })  # fmt: skip
    return rows


def loss_rows(losses: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return the work by cause with its share of the input; what is conserved reads 0."""
    total = losses["input"]
    rows = []
    for name, value in losses.items():
        if name in ("unit", "input", "closure_percent") or value is None:
            continue
        conserved = abs(value) < 1e-6 * abs(total)
        rows.append({
            "name": name.replace("_", " "), "work": "0" if conserved else num(value),
            "share": "0" if conserved else fixed(100.0 * value / total, 2),
        })  # fmt: skip
    return rows


def gap_rows(gap: Document) -> list[dict[str, Any]]:
    """Return the gap by cause with shares of its total; a total of zero has no shares."""
    total = gap["total"]
    return [
        {
            **row,
            "name": row["cause"].replace("_", " "),
            "forward_share": _share(row["forward_nm"], total["forward_nm"]),
            "return_share": _share(row["return_minimum_nm"], total["return_minimum_nm"]),
        }
        for row in gap["causes"]
    ]


def _share(part: float, total: float) -> float | None:
    return 100.0 * part / total if total else None


def gap_text(gap: Document) -> str:
    """Return what closes the gap in words: the largest causes on both strokes."""
    total = gap["total"]
    parts = []
    for key, what in (("forward_nm", "On the forward stroke"), ("return_minimum_nm", "At the return minimum")):
        rows = sorted(gap["causes"], key=lambda row: -abs(row[key]))[:3]
        named = ", ".join(f"{signed(row[key], 3)} N m by {row['cause'].replace('_', ' ')}" for row in rows)
        parts.append(f"{what} the measurement lies {signed(total[key], 3)} N m from the rigid model: {named}.")
    return " ".join(parts)
