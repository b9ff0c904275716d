"""Does the stated zero of a sensor hold the true one? Sheets and standstill readings in, no run and no fit.

The rigs of `tests/rigs` draw a zero, readings before and after and what those miss; ``--set`` and ``--truth`` add
recordings of another maker, whose zero wanders during the run. ``half of the difference`` is what was stated before.

    python benchmarks/zeros.py --draws 20 --set FOLDER --truth FOLDER
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from camtorque.config import SensorRef
from camtorque.ingest import read_recording
from camtorque.ingest.sensors import read_sensor
from camtorque.ingest.zeros import READING_STEP

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
sys.path.insert(0, str(ROOT))

from rigs.families import FAMILIES  # noqa: E402
from rigs.sheets import SERIALS, write_sensor_sheets  # noqa: E402
from rigs.truth import RigTruth, change  # noqa: E402
from rigs.write import _standstill  # noqa: E402

Case = tuple[str, str, float, float, float]
"""Set, quantity, error of the zero, stated standard uncertainty, half of the difference, all in SI."""


def rig_cases(draws: int, share: float, name: str) -> Iterator[Case]:
    """Yield the zeros of simulated rigs; ``share`` of what the readings miss as drawn."""
    for number, family in enumerate(sorted(FAMILIES)):
        for draw in range(draws):
            rng = np.random.default_rng([4000 + draw, number])
            drawn: RigTruth = FAMILIES[family](rng)
            truth = change(
                drawn, torque_sensor__zero_residual=share * drawn.torque_sensor.zero_residual,
                pressure_sensor__zero_residual=share * drawn.pressure_sensor.zero_residual,
            )  # fmt: skip
            readings = _standstill(truth, rng)
            with tempfile.TemporaryDirectory() as folder:
                write_sensor_sheets(truth, Path(folder), rng)
                for quantity, sensor in (("torque", truth.torque_sensor), ("pressure", truth.pressure_sensor)):
                    before, after = (round(value, 4) for value in readings[quantity])
                    sheet = Path(folder) / f"{quantity}.toml"
                    stated = read_sensor(SensorRef(quantity, SERIALS[quantity], sheet, before, after)).calibration
                    true = sensor.volts_per_unit * (sensor.zero + sensor.zero_residual)
                    yield name, quantity, *_errors(stated, true, (before, after))


def foreign_cases(recordings: Path, truths: Path) -> Iterator[Case]:
    """Yield the zeros of recordings whose truth tells z(t); the mean over the run is what counts."""
    for folder in sorted(path.parent for path in recordings.glob("*/recording.toml")):
        truth = json.loads((truths / f"{folder.name}.json").read_text(encoding="utf-8"))
        reading = read_recording(folder)
        t = np.linspace(0.0, 1.0, 1001)
        for quantity in ("torque", "pressure"):
            reference = reading.config.sensors[quantity]
            pair = (reference.zero_before_volts, reference.zero_after_volts)
            zero = truth[f"{quantity}_zero"]
            true = float(np.mean(zero["z0"] + zero["z1"] * t + zero["z2"] * np.sin(4.0 * t + zero["ph"])))
            if None not in pair:
                yield "another maker", quantity, *_errors(reading.of(quantity)[0].calibration, true, pair)


def _errors(stated, true: float, pair: tuple[float, float]) -> tuple[float, float, float]:  # type: ignore[no-untyped-def]
    gain = abs(stated.gain)
    before = math.hypot(0.5 * (pair[1] - pair[0]), READING_STEP / math.sqrt(12.0))
    return gain * (stated.zero_volts - true), stated.zero_std, gain * before


def table(cases: list[Case]) -> str:
    """Return a line a set and quantity: inside two standard uncertainties, before and now, and how wide."""
    lines = [
        "| zeros | number | inside 2 std: half of the difference | now | rms error | median std before | now |",
        "|---|---|---|---|---|---|---|",
    ]
    for key in dict.fromkeys(case[:2] for case in cases):
        error, now, before = np.array([case[2:] for case in cases if case[:2] == key]).T
        unit, factor = ("N m", 1.0) if key[1] == "torque" else ("bar", 1e-5)
        inside = [100.0 * np.mean(np.abs(error) < 2.0 * std) for std in (before, now)]
        figures = [factor * value for value in (np.sqrt(np.mean(error**2)), np.median(before), np.median(now))]
        lines.append(
            f"| {key[1]}, {key[0]} | {error.size} | {inside[0]:.0f} % | {inside[1]:.0f} % | "
            + " | ".join(f"{value:.2g} {unit}" for value in figures) + " |"
        )  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--draws", type=int, default=20, help="rigs of each family")
    parser.add_argument("--set", type=Path, help="recordings of another maker")
    parser.add_argument("--truth", type=Path, help="their truth")
    arguments = parser.parse_args()
    cases = [*rig_cases(arguments.draws, 1.0, "rigs as drawn")]
    cases += rig_cases(arguments.draws, 0.25, "rigs of the coverage table")
    if arguments.set and arguments.truth:
        cases += foreign_cases(arguments.set, arguments.truth)
    print(table(cases))


if __name__ == "__main__":
    main()
