"""Written studies read again, and what is asked of them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from camtorque.studies.table import Cell, Chart, Point, StabilityMap

FRONT_FACTOR = 1.5
"""A default may cost this many times the cheapest that is as accurate."""


def front_factor(chart: Chart, point: Point) -> float:
    """Return by how much a point costs more than the cheapest that is at least as accurate (1 on the front).

    Where the cost is given, by how much its error exceeds the least at that cost.
    """
    if chart.given_cost:
        same = [p.error for p in chart.points if p.candidate and p.cost == point.cost]
        return point.error / max(min(same, default=point.error), 1e-300)
    as_good = [p.cost for p in chart.points if p.candidate and p.error <= point.error]
    return point.cost / min(as_good, default=point.cost)


def read_charts(path: Path) -> tuple[Chart, ...]:
    """Return the charts of a written study; a missing error comes back as infinite."""
    parts = json.loads(path.read_text(encoding="utf-8"))["parts"]
    for part in parts:
        for point in part["points"]:
            point["error"] = math.inf if point["error"] is None else point["error"]
    return tuple(Chart(**{**part, "points": tuple(Point(**point) for point in part["points"])}) for part in parts)


def read_maps(path: Path) -> tuple[StabilityMap, ...]:
    """Return the maps of a written study."""
    parts = json.loads(path.read_text(encoding="utf-8"))["parts"]
    return tuple(StabilityMap(**{**part, "cells": tuple(Cell(**cell) for cell in part["cells"])}) for part in parts)


def silent_defaults(cells: Sequence[Cell]) -> tuple[Cell, ...]:
    """Return the cells in which a default fails without a word; there must be none."""
    return tuple(item for item in cells if item.default and item.verdict == "fails silently")
