"""The answer of a run in words: how large the gap is, what closes it, how sure that is, what to do next."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from camtorque.records import APART, EITHER_LOSS, KNOWLEDGE, TOGETHER
from camtorque.report.numbers import (
    in_a_row,
    plus_minus,
    rounded_to_error,
    significant,
    with_decimals,
    with_sign,
    words,
)
from camtorque.report.verdict import Document, bump_places, differs

ABOVE_NOISE = 1.2
"""A residual above this multiple of the repeatability is a shape, not noise."""
LIKELY = 0.05
"""An alternative this probable is named in the answer."""
CHECKS = {
    "base circle": "On the base circle only drag, zero and drive act: check the torque zero and the speed control.",
    "compression": "During compression port closing and trapped volume act: check trigger angle and lift table.",
    "delivery": "During delivery the valve and the line act: check where the pressure sensor sits, and its delay.",
    "spill": "At the spill the end of delivery acts: check that the load was steady.",
    "top dwell": "At the top leakage and the trapped volume act: check the lift table there.",
    "expansion on the return": "On the return leakage and the end of delivery act: check lift table and load.",
    "inlet port open": "With the inlet open feed pressure, spring and friction act: check feed pressure and spring.",
}
"""Phase of the pump -> what to look at where the model fails in it."""
SAME_RESONANCE = 0.05
INPUT_CAUSES = frozenset({
    "base_torque_negative", "base_torque_large", "zero_off_certificate", "several_strokes", "revolutions_alternate",
    "closing_lift_unusual", "trigger_angle_doubtful", "uneven_running", "torque_against_model", "speed_off_nominal",
    "pump_unusual", "torque_drifts", "torque_size_drifts", "lift_table_coarse", "pressure_misplaced",
    "pressure_along_line", "sheet_contradicted", "trigger_far_off", "load_changes",
})  # fmt: skip
"""Findings on the input that explain a model that fails: the first of them is said first."""
NOT_LOSSES = ("unit", "input", "closure_percent")
"""Keys of the losses that are no cause."""
MIXED = 2.0
"""Losses whose sum is so many times surer than the surer of them are told as one."""
ALONE_PERCENT = 20.0
"""Error of a stretch that was left out, in percent of the peak, above which its size tells nothing."""


def answer(doc: Document) -> list[dict[str, str]]:
    """Return the four parts of the answer, each with a heading and a text."""
    return [
        {"head": "The gap", "text": gap_size(doc)},
        {"head": "What closes it", "text": closing_text(doc)},
        {"head": "How sure", "text": sureness_text(doc)},
        {"head": "What to do", "text": next_text(doc)},
    ]


def gap_size(doc: Document) -> str:
    """Return how far the measurement is from the rigid model on both strokes."""
    rigid = doc["metrics"]["rigid"]
    gap = rigid["forward_gap_percent"]
    side = "above" if gap >= 0.0 else "below"
    return (
        f"The measured torque lies {significant(abs(gap))} % {side} the rigid model on the loaded forward stroke. On "
        f"the return stroke it falls to {with_decimals(rigid['return_min_measured_nm'], 1)} N m; the rigid model's own "
        f"minimum is {with_decimals(rigid['return_min_model_nm'], 1)} N m."
    )


STRETCHES = {"forward": "Forward stroke, measured − rigid", "return_minimum": "Return minimum, measured − rigid"}
"""Key of the gap by cause -> what it is of."""
NAMED_CAUSES = 3
SAID = (
    ("needed", "The data need", ""),
    ("cannot tell", "They cannot tell whether they need", "; values given there assume that it acts"),
    ("not needed", "They do not need", "; values given there rest on sheet and literature"),
)
"""Verdict on losses -> what the answer says before and after their names."""


def sure(doc: Document, error: float | None) -> bool:
    """Return whether a standard error is known and can be relied on."""
    return bool(doc["explained"] and error)


def closing_text(doc: Document) -> str:
    """Return the largest causes on both strokes, and the losses that the data need or cannot tell."""
    gap, parts = doc["gap_by_cause"], []
    for part, what in STRETCHES.items():
        key, error = f"{part}_nm", f"{part}_stderr_nm"
        rows = sorted((row for row in gap["causes"] if row["cause"] != "residual"), key=lambda row: -abs(row[key]))
        named = ", ".join(
            f"{words(row['cause'])} {with_sign(row[key])}"
            + (f" ± {with_decimals(row[error])}" if sure(doc, row[error]) else "")
            for row in rows[:NAMED_CAUSES]
        )
        rest = rows[NAMED_CAUSES:]
        others = f", all else {with_sign(sum(row[key] for row in rest))}" if rest else ""
        left = next((row[key] for row in gap["causes"] if row["cause"] == "residual"), None)
        parts.append(f"{what}, {with_sign(gap['total'][key])} N m: {named}{others}; {with_sign(left)} left over.")
    return " ".join([*parts, *needs(doc["evidence"])])


def needs(evidence: Mapping[str, Any]) -> list[str]:
    """Return a sentence each on the losses that the data need, cannot tell, and do not need."""
    if EITHER_LOSS in evidence:  # which of the two nobody knows
        evidence = {name: row for name, row in evidence.items() if name not in APART}
    found = []
    for verdict_word, text, then in SAID:
        names = [words(name) for name, row in evidence.items() if row["verdict"] == verdict_word]
        if names:
            found.append(f"{text} {in_a_row(names)}{then}.")
    return found


def work_parts(losses: Mapping[str, Any], errors: Mapping[str, Any]) -> dict[str, tuple[float, float | None]]:
    """Return work and standard uncertainty by cause, most first; friction and damping as one where they are mixed."""
    parts = {name: (value, errors.get(name)) for name, value in losses.items() if name not in NOT_LOSSES}
    alone = [errors[name] for name in APART if errors.get(name) is not None]
    both = errors.get(TOGETHER)
    if both is None or len(alone) < len(APART) or min(alone) < MIXED * both:
        return parts
    parts[TOGETHER] = (sum(parts.pop(name)[0] for name in APART), both)
    return dict(sorted(parts.items(), key=lambda part: -part[1][0]))


def sureness_text(doc: Document) -> str:
    """Return shape of the residual, repeatability, absolute uncertainty, and what the data determine at all."""
    accuracy, rows = doc["accuracy"], list(doc["parameters"].values())
    text = shape_text(accuracy, bool(doc["bumps"]))
    if doc["bumps"] and doc["explained"]:
        text += f" In the fitted cycles it stands out at {bump_places(doc)}."
    if accuracy["block_cv_percent"] and doc["explained"]:
        text += f" {left_out_text(accuracy['block_cv_percent'])}"
    if not doc["explained"]:
        return f"{text} The model is incomplete: see above."
    if accuracy["absolute_uncertainty_percent"] is not None:
        text += (
            f" Absolute torque: ±{significant(accuracy['absolute_uncertainty_percent'], 2)} % of the peak (k = 1; "
            "gain, linearity and zero as stated or assumed); no residual shows it. Plunger, cam and spring are taken "
            "from the sheet: 1 % of the plunger's diameter is 2 % of the torque from pressure."
        )
    return f"{text} {known_text(rows)}{alternatives_text(doc)}"


def left_out_text(blocks: Sequence[float]) -> str:
    """Return how well stretches of the revolution are predicted without them, in percent of the peak, and the worst."""
    width, worst = 360.0 / len(blocks), blocks.index(max(blocks))
    median, largest = statistics.median(blocks), blocks[worst]
    place = f"{with_decimals(worst * width, 0)} to {with_decimals((worst + 1) * width, 0)} deg"
    text = (
        f"Stretches of {with_decimals(width, 0)} deg, left out of a fit in turn, are predicted with a median error of "
        f"{significant(median, 2)} % of the peak, "
    )
    if largest > ALONE_PERCENT:
        return f"{text}but {place} not at all: only these angles show what acts there."
    return f"{text}the worst ({place}) with {significant(largest, 2)} %."


def known_text(rows: Collection[Document], what: str = "parameters") -> str:
    """Return how many parameters the data tell something about, and what."""
    measured, limited, narrowed = (sum(row["knowledge"] == word for row in rows) for word in KNOWLEDGE[:3])
    limits = f"{limited} have only an upper limit (their interval reaches the lower bound, mostly zero), "
    return (
        f"Of {len(rows)} {what} {measured} are measured, {limits if limited else ''}{narrowed} narrowed; the others "
        "are known no better than from sheet or literature."
    )


def shape_text(accuracy: Document, stands_out: bool = False) -> str:
    """Return the residual on held-out cycles beside what the cycles repeat; ``stands_out``: it does so somewhere."""
    shape, repeat = accuracy["shape_residual_percent"], accuracy["repeatability_percent"]
    text = f"Shape: the residual is {significant(shape, 2)} % of the peak on cycles that were not fitted"
    if repeat and (stands_out or shape > ABOVE_NOISE * repeat):
        return f"{text}, {significant(shape / repeat, 2)} times the cycle repeatability ({significant(repeat, 2)} %)."
    repeated = significant(repeat, 2)
    return f"{text}; these repeat the fitted ones to {repeated} %, so they test the noise rather than the model."


def alternatives_text(doc: Document) -> str:
    """Return the other structures that the data leave possible."""
    rows = [row for row in doc["alternatives"][1:] if (row["probability"] or 0.0) >= LIKELY and differs(row, doc)]
    named = "; ".join(
        f"{_structure(k, rows, doc)} ({significant(100.0 * row['probability'], 2)} %), trigger then at "
        f"{significant(row['trigger_angle_deg'], 4)} deg, chamber peak {significant(row['chamber_peak_bar'], 4)} bar"
        for k, row in enumerate(rows)
    )
    return f" Not ruled out: {named}." if named else ""


def _structure(place: int, rows: Sequence[Document], doc: Document) -> str:
    """Return the name of a structure; a further minimum of the chosen one, or of one named before, as such."""
    name = rows[place]["name"]
    if name == doc["alternatives"][0]["name"]:
        return "a second minimum of the same structure"
    return f"another minimum of '{name}'" if any(row["name"] == name for row in rows[:place]) else str(name)


def next_text(doc: Document) -> str:
    """Return the first of the next measurements, and how many warnings there are."""
    found = Counter(row["severity"] for row in doc["findings"])
    counts = [f"{found[kind]} {kind}{'s' * (found[kind] > 1)}" for kind in ("error", "warning") if found[kind]]
    what = " and ".join(counts).removeprefix("1 ") if len(counts) == 1 else " and ".join(counts)
    text = f"Read the {what} below. " if counts else ""
    if not doc["explained"]:
        odd = next((row["text"] for row in doc["findings"] if row["code"] in INPUT_CAUSES), "")
        return text + (f"First: {odd}. " if odd else "") + unexplained_advice(doc)
    if not doc["next_measurement"]:
        return text + "Nothing: this recording determines everything that was fitted."
    return text + f"To learn more: {doc['next_measurement'][0]}."


def unexplained_advice(doc: Document) -> str:
    """Return what to look at first where the model fails."""
    swings = [bump["frequency_hz"] for bump in doc["bumps"] if bump["frequency_hz"]]
    known = doc["parameters"].get("shaft_resonance")
    if swings:
        at = known["value"] if known else 0.0
        what = f"Something swings at {significant(swings[0], 2)} Hz"
        if at and abs(at / swings[0] - 1.0) < SAME_RESONANCE:
            what += ", where the fitted shaft rings, with another damping or driven by something else"
        elif at:
            what += f", and the fitted shaft rings at {significant(at, 2)} Hz"
        return (
            f"{what}: look for what is elastic between drive and cam or in the mounting of the transducer; tapping the "
            "shaft at standstill while recording shows how it rings."
        )
    phases = dict.fromkeys(bump["phase"] for bump in doc["bumps"])
    first = " ".join(CHECKS[phase] for phase in phases if phase in CHECKS)
    return first or "Check pump sheet, lift table, trigger angle and the units of the sensors, in this order."


def cards(doc: Document) -> list[dict[str, str]]:
    """Return the key numbers of a run; without an interval where the model is incomplete."""
    held, recording, chamber = doc["metrics"]["fitted_held_out_cycles"], doc["recording"], doc["chamber"]
    trigger = doc["alignment"]["trigger_angle_deg"]
    rows = [
        (f"{with_decimals(recording['peak_torque_nm'], 1)} N m", "peak of the measured torque"),
        (f"{significant(held['rms_percent_of_peak'], 2)} %", "shape residual, RMS of the peak torque"),
        (f"{with_sign(held['forward_gap_percent'])} %", "forward gap after the fit"),
        (estimate_text(doc, trigger, "deg"), "trigger angle"),
    ]
    if chamber and chamber["peak_bar"]:
        rows.append((estimate_text(doc, chamber["peak_bar"], "bar"), "peak of the chamber pressure"))
    rows += [
        (f"{significant(doc['forces']['hertz_max_gpa'])} GPa", "largest Hertz pressure"),
        (
            work_text(doc),
            f"work per revolution, {with_sign(doc['losses']['closure_percent'])} % unaccounted for",
        ),
        (f"{recording['cycles_used']} / {recording['cycles_found']}", "cycles used / complete"),
    ]
    return [{"value": value, "text": text} for value, text in rows]


def work_text(doc: Document) -> str:
    """Return the work that a revolution takes, with its standard error."""
    return estimate_text(doc, {"value": doc["losses"]["input"], "stderr": doc["losses_stderr"].get("input")}, "J")


def estimate_text(doc: Document, estimate: Document, unit: str) -> str:
    """Return a value with its standard error, if that can be relied on, and its unit."""
    interval = f" ± {plus_minus(estimate['stderr'])}" if sure(doc, estimate["stderr"]) else ""
    return f"{rounded_to_error(estimate['value'], estimate['stderr'])}{interval} {unit}"
