"""What recordings of one pump have in common before their joint fit: bounds, priors, the error of the laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from camtorque.fit.prepare import INDEPENDENT, law_variance
from camtorque.fit.problem import FitData, with_rows
from camtorque.laws.chain import BINS
from camtorque.laws.rows import ParameterRow

ALIKE_WIDTH = 1.25
"""Priors whose widths differ by less than this factor count alike."""


def common_error(item: FitData, count: int) -> FitData:
    """Return a recording whose weights hold the error of the laws ``count`` times: it is the same in all."""
    variance = 1.0 / item.weight**2 + (count - 1.0) * law_variance(item.torque) * BINS / INDEPENDENT
    return replace(item, weight=1.0 / np.sqrt(variance))


def with_common_rows(data: Sequence[FitData]) -> list[FitData]:
    """Return the recordings with the same bounds and priors of the shared parameters, whichever comes first."""
    names = [name for name, row in data[0].rows.items() if row.role == "shared"]
    common: dict[str, Mapping[str, object]] = {}
    for name in names:
        rows = [item.rows[name] for item in data]
        common[name] = {
            "lower": min(row.lower for row in rows), "upper": max(row.upper for row in rows), **common_prior(rows),
        }  # fmt: skip
    return [with_rows(item, common) for item in data]


def common_prior(rows: Sequence[ParameterRow]) -> Mapping[str, object]:
    """Return prior and source of a parameter of the pump that each recording has a row of.

    Of one mean the widest counts, which is the same knowledge for a larger load. Of several the narrowest does, which
    somebody stated or measured, in the mean with others that are hardly wider: they spread as far as they are apart.
    """
    widest: dict[float, ParameterRow] = {}
    for row in rows:
        if row.prior and (row.prior[0] not in widest or row.prior[1] > _width(widest[row.prior[0]])):
            widest[row.prior[0]] = row
    if not widest:
        return {}
    least = min(widest.values(), key=_width)
    near = {mean: _width(row) for mean, row in widest.items() if _width(row) <= ALIKE_WIDTH * _width(least)}
    mean, spread = float(np.mean(list(near))), float(np.std(list(near)))
    return {"prior": (mean, float(np.hypot(max(near.values()), spread))), "source": least.source}


def _width(row: ParameterRow) -> float:
    return row.prior[1] if row.prior else np.inf
