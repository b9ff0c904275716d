"""What a fit found, in rows: gap and work by cause, evidence for losses, values against priors, sources of error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from camtorque.records import UNTOLD, LossEvidence
from camtorque.report.answer import NOT_LOSSES
from camtorque.report.bundle import RunResult
from camtorque.report.chart import CYCLE, WIDE, Marks, RowPanel, Rows
from camtorque.report.gaps import RESIDUAL, GapShare, gap_shares
from camtorque.report.numbers import UNKNOWN, significant, unit_text, with_decimals, with_sign, words

CONSERVED = 1.0e-4
"""Share of the input below which a cause gives back over the revolution what it takes."""
SMALLEST_SHARE = 2.0e-3
"""A cause below this share of the largest one, in both panels, stands in the table only."""
GAP_PANELS = {0: "forward stroke, mean [N m]", 2: "at the return minimum [N m]"}
"""Place among the parts of a gap -> what its panel is called."""
VERDICT_TONES = {"needed": "c0", "cannot tell": "c5", "not needed": "c7"}
EVIDENCE_SHOWN = 30.0
PAST_DOUBT = 100.0
"""Where the bars of evidence end, and from where on its number says no more."""

NO_TORQUE = 1.0e-4
"""A loss is drawn at least as large: rounding left at a bound would stretch the scale by ten decades [N m]."""


def evidence(result: RunResult) -> Rows | None:
    """Show for each loss how strongly the data ask for it, and how large it is."""
    rows = result.fitted.evidence
    if not rows:
        return None
    tones = tuple(VERDICT_TONES[row.verdict] for row in rows)
    values = tuple(float(np.clip(row.two_ln_bayes_factor, -EVIDENCE_SHOWN, EVIDENCE_SHOWN)) for row in rows)
    notes = tuple(f"{_evidence_text(row.two_ln_bayes_factor)}, {row.verdict}" for row in rows)
    factor = RowPanel("2 ln K for the loss", (Marks("", values, tones),), notes=notes,
                      limits=(1.25 * min(-4.0, *filter(math.isfinite, values)), 1.9 * EVIDENCE_SHOWN))  # fmt: skip
    return Rows(tuple(words(row.name) for row in rows), (factor, _sizes(rows, tones)), WIDE)


def _evidence_text(value: float) -> str:
    return f"> {PAST_DOUBT:g}" if value > PAST_DOUBT else significant(value, 2)


def _sizes(rows: tuple[LossEvidence, ...], tones: tuple[str, ...]) -> RowPanel:
    """Return the size of each loss with its interval; an angle stands as text beside the torques."""
    torque = [row.unit == "N m" for row in rows]
    pick = [
        (max(row.size, NO_TORQUE), *row.size_ci95) if mine else (math.nan,) * 3
        for row, mine in zip(rows, torque, strict=True)
    ]
    size, low, high = (tuple(float(item[k]) for item in pick) for k in range(3))
    notes = tuple("" if mine else size_text(row) for row, mine in zip(rows, torque, strict=True))
    marks = (Marks("", size, tones, "point", low, high),)
    positive = [value for value in size if math.isfinite(value) and value > 0.0]
    spread = bool(positive) and max(positive) > 30.0 * min(positive)
    return RowPanel("what it moves in the mean cycle, RMS with 95 % interval [N m]", marks, log=spread, notes=notes)


def size_text(row: LossEvidence) -> str:
    """Return the size of a loss with its interval in words."""
    if not math.isfinite(row.size):
        return UNKNOWN
    if not math.isfinite(row.size_ci95[1]):
        return f"{significant(row.size, 2)} {unit_text(row.unit)}"
    low, high = (significant(end, 2) for end in row.size_ci95)
    return f"{significant(row.size, 2)} ({low} … {high}) {unit_text(row.unit)}"


def priors(result: RunResult) -> Rows | None:
    """Show each parameter with a prior in standard deviations of the prior; two of them are shaded."""
    known = [(row, *row.prior) for row in result.fitted.parameters if row.prior is not None]
    if not known:
        return None
    rows = [row for row, *_ in known]
    pulls = [(row.value - mean) / std for row, mean, std in known]
    errors = [row.stderr / std for row, _, std in known]
    tones = tuple("c7" if row.knowledge in UNTOLD else "fitted" for row in rows)
    low, high = (tuple(p + side * e for p, e in zip(pulls, errors, strict=True)) for side in (-1.0, 1.0))
    marks = Marks("", tuple(pulls), tones, "point", low, high)
    panel = RowPanel("distance from what was expected [standard deviations of the prior]", (marks,), shaded=(-2.0, 2.0))
    return Rows(tuple(words(row.name) for row in rows), (panel,))


def losses(result: RunResult) -> Rows:
    """Show where the work of one revolution goes."""
    smallest = CONSERVED * abs(result.fitted.losses["input"])
    rows = {k: v for k, v in result.fitted.losses.items() if k not in NOT_LOSSES and abs(v) > smallest}
    values = tuple(rows.values())
    errors = result.fitted.losses_stderr if result.fitted.explained else {}
    bars = _bars(values, [errors.get(name) for name in rows])
    panel = RowPanel("work [J per revolution]", (bars,), notes=tuple(with_decimals(value) for value in values))
    return Rows(tuple(words(name) for name in rows), (panel,))


def _bars(values: tuple[float, ...], errors: Sequence[float | None]) -> Marks:
    """Return bars with lines over two standard uncertainties on either side; an unknown one has none."""
    reach = [2.0 * error if error else math.nan for error in errors]
    low, high = (tuple(v + side * r for v, r in zip(values, reach, strict=True)) for side in (-1.0, 1.0))
    return Marks("", values, tuple("fitted" if value >= 0 else "c1" for value in values), low=low, high=high)


def gap(result: RunResult) -> Rows:
    """Show what each cause adds to the rigid torque on the forward stroke and at the return minimum."""
    rows = shown(gap_shares(result))
    sure = [row.stderr if result.fitted.explained else None for row in rows]
    panels = tuple(
        RowPanel(name, (_bars(tuple(row.parts[k] for row in rows), [None if one is None else one[k] for one in sure]),),
                 notes=tuple(with_sign(row.parts[k]) for row in rows))
        for k, name in GAP_PANELS.items()
    )  # fmt: skip
    return Rows(tuple(words(row.cause) for row in rows), panels)


def shown(rows: tuple[GapShare, ...]) -> list[GapShare]:
    """Return the rows that can be seen in a figure; the residual always."""
    least = {k: SMALLEST_SHARE * max(abs(row.parts[k]) for row in rows) for k in GAP_PANELS}
    return [row for row in rows if row.cause == RESIDUAL or any(abs(row.parts[k]) > least[k] for k in GAP_PANELS)]


def budget(result: RunResult) -> Rows | None:
    """Show the share of each source in the variance of every parameter that the data say something about."""
    source_of = {row.name: row.source for row in result.fitted.parameters}
    informed = {row.name for row in result.fitted.parameters if row.knowledge not in UNTOLD}
    rows = [row for row in result.fitted.details.get("budget", ()) if row.total > 0.0 and row.name in informed]
    table = {row.name: shares(row.contributions, source_of) for row in rows}
    return source_chart(table, "share of the variance [%]")


MOST_SOURCES = 9
"""Sources shown in a chart: more colours cannot be distinguished."""
OTHERS = "other sources"
LUMPED = ("others", OTHERS)
"""What a budget itself calls the sum of small sources, and what a chart does."""


def shares(parts: Mapping[str, float], source_of: Mapping[str, str]) -> dict[str, float]:
    """Return the shares of a variance by source [%].

    Parameters
    ----------
    parts : source -> standard uncertainty, in any one unit
    source_of : parameter -> where what was known of it comes from; such a source goes by the name of its parameter
    """
    total = sum(value**2 for value in parts.values())
    names: dict[str, list[str]] = {}
    for parameter, source in source_of.items():
        names.setdefault(source, []).append(words(parameter))
    found: dict[str, float] = {}
    for source, value in parts.items():
        label = OTHERS if source in LUMPED else ", ".join(names.get(source, [source]))
        found[label] = found.get(label, 0.0) + (100.0 * value**2 / total if total > 0.0 else 0.0)
    return found


def largest(table: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return the sources that matter most over all outcomes, the largest first."""
    total: dict[str, float] = {}
    for parts in table.values():
        for source, share in parts.items():
            total[source] = total.get(source, 0.0) + share
    ranked = sorted((name for name in total if name != OTHERS), key=lambda name: -total[name])
    return ranked[:MOST_SOURCES]


def source_chart(table: Mapping[str, Mapping[str, float]], abscissa: str) -> Rows | None:
    """Show the shares of the largest sources for every outcome, the rest together; None without outcomes."""
    if not table:
        return None
    outcomes, named = tuple(table), largest(table)
    left, marks = np.zeros(len(outcomes)), []
    for source, tone in zip(named, CYCLE, strict=False):
        share = np.array([table[outcome].get(source, 0.0) for outcome in outcomes])
        marks.append(Marks(source, tuple(left + share), (tone,), "stack", tuple(left), tuple(left + share)))
        left = left + share
    rest = np.array([sum(table[outcome].values()) for outcome in outcomes])
    if np.any(rest - left > 0.5):
        marks.append(Marks(OTHERS, tuple(rest), ("band",), "stack", tuple(left), tuple(rest)))
    panel = RowPanel(abscissa, tuple(marks), limits=(0.0, 100.0))
    return Rows(tuple(words(outcome) for outcome in outcomes), (panel,), WIDE)


def ranking(table: Mapping[str, Mapping[str, float]]) -> list[dict[str, str]]:
    """Return for each outcome its three largest sources in words."""
    rows = []
    for outcome, parts in table.items():
        first = sorted(parts.items(), key=lambda item: -item[1])[:3]
        rows.append({"outcome": words(outcome), "sources": "; ".join(f"{name} {share:.0f} %" for name, share in first)})
    return rows
