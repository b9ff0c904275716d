"""Every number that decides what becomes of data says its unit, its reason and what it was set on."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import camtorque
from camtorque.signal.threshold import BASES, Count, Threshold

PACKAGE = Path(camtorque.__file__).parent
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "thresholds.md"
NUMERICS = {
    "BEYOND", "RECTANGULAR", "UNKNOWN", "MARGIN", "STEP_DEG", "SMOOTH_DEG", "POINTS", "COARSE", "COARSE_RATE",
    "N_THETA", "WIDEST_SHIFT", "RISING", "MOST_ORDERS", "SMOOTHNESS", "MOST_OWN", "LEAST_WEIGHT", "SAMPLED_CYCLES",
    "COARSE_GRID", "COMPARED", "LEAST_REPEATS", "LEVEL_SAMPLES", "POINT_DEG", "MOST_PULSES", "PITCH_TEETH",
    "LEAST_PULSES", "LOCAL_PERIODS", "MOST_SAMPLES", "MOST_STEPS", "LEAST_STEPS", "CHANGES_PER_STEP", "POOLED_EDGES",
    "LEAST_PAIRS", "LEAST_FOR_DENSITY", "STEEPEST", "LONGEST_HALF_WINDOW", "BUNDLE", "HIGHEST", "NEIGHBOURS",
    "USUAL_PERCENTILE", "MIDDLE_OF_FLANK", "MOST_FLANK", "LEAST_FOR_NOISE", "FINE_SAMPLES", "LEAST_POOLED",
    "WINDOW_PERIODS", "USUAL_DISTANCE", "LEAST_STARTS", "POOLED_WINDOWS", "NEIGHBOUR_WINDOWS", "NOISE_PAIRS", "BLOCK",
    "OVERLAP", "LEAST_SWING_VOLTS", "TURN", "STAIRS_FROM", "STAIR_FACTOR", "LINEAR", "CUBIC", "AVERAGE", "BAR",
    "DEGREE", "RPM", "CACHED_WINDOWS", "LEAST_ORDERS", "LOBES",
    "LINES", "ROWS", "PIECE", "COMPILED_FROM", "LOADED_FROM", "PART", "BENT", "LOOSELY", "LISTED", "NOISELESS",
    "LARGEST_GRID", "STEP_SAMPLES", "LEAST_VARIANCE",
}  # fmt: skip
"""Sizes of windows, grids and loops: they cost time or a little accuracy, and reject nothing."""


def constants() -> Iterator[tuple[str, str, object]]:
    """Yield module, name and value of every number of the two rooms, once."""
    seen: set[int] = set()
    for room in ("signal", "align"):
        for path in sorted((PACKAGE / room).glob("*.py")):
            module = import_module(f"camtorque.{room}.{path.stem}")
            for name, value in vars(module).items():
                for key, number in value.items() if isinstance(value, dict) else [("", value)]:
                    if name.isupper() and isinstance(number, float | int) and id(number) not in seen:
                        seen.add(id(number))
                        yield f"{room}.{path.stem}", f"{name}[{key}]" if key else name, number


def table() -> str:
    rows = [
        f"| {module} | {name} | {number:g} | {number.unit} | {number.basis} | {number.reason} |"
        for module, name, number in constants()
        if isinstance(number, Threshold | Count)
    ]
    return "\n".join(["| module | name | value | unit | set on | reason |", "|---|---|---|---|---|---|", *rows]) + "\n"


def test_numbers_that_decide_are_thresholds() -> None:
    plain = {name for _, name, number in constants() if not isinstance(number, Threshold | Count)}
    assert {name for name in plain if "[" not in name} <= NUMERICS


def test_every_threshold_says_what_it_was_set_on() -> None:
    for module, name, number in constants():
        if isinstance(number, Threshold | Count):
            assert number.basis in BASES, f"{module}.{name}"
            assert number.unit, f"{module}.{name}"
            assert number.reason.endswith("."), f"{module}.{name}"


def test_a_threshold_is_copied_with_all_that_it_knows() -> None:
    for item in (Threshold(0.5, "s", "physics", "So."), Count(3, "samples", "physics", "So.")):
        for twin in (copy.deepcopy(item), pickle.loads(pickle.dumps(item))):
            assert (twin, twin.unit, twin.reason) == (item, item.unit, "So.")


def test_the_document_lists_every_threshold() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    for basis, meaning in BASES.items():
        assert f"**{basis}**: {meaning}" in text
    assert table() in text, f"docs/thresholds.md has to hold:\n{table()}"
