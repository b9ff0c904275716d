"""Tables and findings for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from camtorque.hashes import real_path
from camtorque.records import APART, EITHER_LOSS
from camtorque.report.answer import estimate_text, needs, work_parts, work_text
from camtorque.report.numbers import named, plus_minus, typeset, words
from camtorque.report.verdict import (
    bump_place,
    called,
    doubtful,
    doubtful_input,
    known_metrics,
    missed_limits,
    unexplained,
    unusual_values,
)
from camtorque.units import counted

PULLED, MOST_PULLED = "prior_pulled", 3
"""Finding of a value far from what was expected: a run that fails has many, for one cause that is another."""


def run_table(doc: Mapping[str, Any]) -> str:
    """Return the content of result.json as a compact table."""
    recording, metrics = doc["recording"], doc["metrics"]
    lines = [
        f"{recording['name']}  {recording['speed_rpm']:.1f} rpm, {recording['cycles_used']} of "
        f"{recording['cycles_found']} cycles used{_left_out(recording)}",
        *verdict_lines(doc),
        "",
        f"{'':22}{'RMS':>16}{'forward gap':>14}{'return minimum':>17}",
    ]
    for name, label in (("rigid", "rigid model"), ("fitted_held_out_cycles", "fitted (held-out)")):
        row = metrics[name]
        lines.append(
            f"{label:22}{row['rms_nm']:7.3f} N m{row['rms_percent_of_peak']:6.2f} %"
            f"{_signed(row['forward_gap_percent'], 2):>11} %{row['return_min_model_nm']:13.2f} N m"
        )
    lines.append(f"{'measured (held-out)':22}{'':32}{row['return_min_measured_nm']:13.2f} N m")
    trigger, chamber = doc["alignment"]["trigger_angle_deg"], doc["chamber"]
    lines += ["", f"effects   {_effects(doc)}"]
    lines.append(f"trigger   {estimate_text(doc, trigger, 'deg')}, nominal {trigger['nominal']:.2f}")
    if chamber and chamber["peak_bar"]:
        lines.append(f"chamber   peak {estimate_text(doc, chamber['peak_bar'], 'bar')}")
    lines.append(f"work      {work_text(doc)}/rev = {_work(doc)}")
    return "\n".join([*lines, *loud_findings(doc["findings"])])


def _effects(doc: Mapping[str, Any]) -> str:
    """Return what the data need, and of what else they cannot tell, or do not need it."""
    said = [", ".join(map(words, doc["effects"])) or "none"]
    one_of_both = APART if EITHER_LOSS in doc["evidence"] else ()
    for verdict in ("cannot tell", "not needed"):
        rows = [name for name, row in doc["evidence"].items() if row["verdict"] == verdict and name not in one_of_both]
        said += [f"{verdict}: {', '.join(map(words, rows))}"] if rows else []
    return "; ".join(said)


def _left_out(recording: Mapping[str, Any]) -> str:
    """Return what complete cycles were left out for; the incomplete ones are not among those found."""
    rows = [row for row in recording["cut_flow"] if row["cycles"] and row["reason"] != "incomplete"]
    texts = [f"{row['cycles']} {words(row['reason'])}" for row in rows]
    return f" (left out: {', '.join(texts)})" if texts else ""


def verdict_lines(doc: Mapping[str, Any]) -> list[str]:
    """Return where the model fails, or what else asks to look closer; nothing where all is well."""
    if doc["explained"]:
        missed = [*missed_limits(doc["metrics"]["fitted_held_out_cycles"]), *unusual_values(doc), *doubtful_input(doc)]
        return [f"LOOK CLOSER: {'; '.join(missed)}"] if missed else []
    places = [bump_place(bump) for bump in doc["bumps"]]
    where = f" at {'; '.join(places)}" if places else ""
    return [f"UNEXPLAINED: the model fails{where}; no interval below can be relied on"]


def _work(doc: Mapping[str, Any]) -> str:
    """Return where the work of a revolution goes, how surely; what rounds to nothing is left out."""
    losses = doc["losses"]
    parts = work_parts(losses, doc["losses_stderr"])
    if losses["closure_percent"] is not None:
        parts["unaccounted_for"] = (0.01 * losses["closure_percent"] * losses["input"], None)
    texts = []
    for name, (value, error) in parts.items():
        interval = f" ± {error:.2f}" if doc["explained"] and error and error >= 0.005 else ""
        if interval or abs(value) >= 0.005:
            texts.append(f"{words(name)} {value:.2f}{interval}")
    return " + ".join(texts)


def _signed(value: float, decimals: int) -> str:
    """Return a number with its sign; what rounds to nothing has that of nothing."""
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"


def campaign_table(doc: Mapping[str, Any]) -> str:
    """Return the content of campaign.json as a compact table."""
    wide = max(22, *(len(called(row)) for row in doc["recordings"]))
    heads = f"{'rpm':>8}{'rigid RMS':>11}{'fitted':>9}{'joint':>9}{'left out':>9}{'peak error':>12}"
    lines = [f"{'recording':{wide}}{heads}"]
    left = {row["name"]: row["metrics"] for row in doc["held_out"] if row["mode"] == "own_zero_and_end"}
    for row in doc["recordings"]:
        if row["status"] != "ok":
            lines.append(f"{called(row):{wide - 1}} refused: {row['error']}")
            continue
        out = left.get(row["id"])
        shares = [row["metrics"]["rigid"], row["metrics"]["fitted_held_out_cycles"],
                  (row["metrics_joint"] or {}).get("fitted_held_out_cycles"), out]  # fmt: skip
        texts = [f"{m['rms_percent_of_peak']:.{2 if k == 0 else 3}f} %" if m else "-" for k, m in enumerate(shares)]
        high = f"{_signed(known_metrics(out).peak_excess_percent, 1)} %" if out else "-"
        name = f"{called(row):{wide}}{row['speed_rpm']:8.1f}"
        lines.append(f"{name}{texts[0]:>11}{texts[1]:>9}{texts[2]:>9}{texts[3]:>9}{high:>12}")
    if said := needs(doc["evidence"]):
        lines.append(f"losses    {' '.join(said)}")
    if failed := unexplained(doc):
        lines.append(f"UNEXPLAINED: {', '.join(failed)}: the model fails there; the reports say where")
    if look := doubtful(doc):
        lines.append(f"LOOK CLOSER: {', '.join(look)}: the reports say why")
    return "\n".join([*lines, *loud_findings(doc["findings"])])


def finding_lines(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line per finding."""
    lines = []
    for row in findings:
        place = row["where"] if row["where"].startswith("[") else f"[{row['where']}]"
        told = any(name in row["text"] for name in (row["where"], words(row["where"])))
        lines.append(f"{row['severity']:8}  {typeset(named(row['text']))}" + ("" if told else f" {place}"))
    return lines


def loud_findings(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line per warning and error; notes are counted, they stand on the page."""
    loud = sorted((row for row in findings if row["severity"] != "info"), key=lambda row: row["severity"])
    notes = len(findings) - len(loud)
    pulled = [row for row in loud if row.get("code") == PULLED]
    many = pulled[MOST_PULLED:]
    loud = [row for row in loud if row not in many]
    tail = [f"info      {counted(notes, 'note', 'notes')} on the page"] if notes else []
    values = counted(len(many), "more value", "more values")
    more = [f"warning   {values} far from what was expected, see the page"] if many else []
    return [*finding_lines(loud), *more, *tail]


def limit_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line per limit."""
    numbers = ["-" if row["value"] is None else f"{row['value']:.5g}" for row in rows]
    errors = [f"± {plus_minus(row['stderr'])}" if row["stderr"] else "" for row in rows]
    return [
        f"{row['verdict']:12}{row['quantity']:48}{number:>12} {error:10} {_band(row)}"
        for row, number, error in zip(rows, numbers, errors, strict=True)
    ]


def _band(row: Mapping[str, Any]) -> str:
    low, high = ("" if row[end] is None else f"{row[end]:g}" for end in ("min", "max"))
    band = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
    return "; ".join(part for part in (f"{band} {row['unit']}".strip(), row["reason"], row["text"]) if part)


def fit_name(path: Path, recordings: Sequence[str]) -> str:
    """Return what a page calls a fit: its only recording, as runs of a campaign lie in folders named by hashes."""
    folder = path if path.is_dir() else path.parent
    return recordings[0] if len(recordings) == 1 else real_path(folder).name
