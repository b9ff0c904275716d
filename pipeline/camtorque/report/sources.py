"""Where uncertainty comes from: shares of a variance by source, the largest named, the rest together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.report.chart import CYCLE, WIDE, Marks, RowPanel, Rows
from camtorque.report.numbers import words

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
        rows.append({"outcome": words(outcome), "sources": ", ".join(f"{name} {share:.0f} %" for name, share in first)})
    return rows
