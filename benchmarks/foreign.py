"""Recordings of other makers that bring their truth and a scorer: run it with this `camtorque` and sum up.

    python benchmarks/foreign.py SET TRUTH --scorer SCORE.PY --out DIR [--only NAME] [--score]

SET holds recordings, TRUTH what only the scorer reads; SCORE.PY runs `camtorque run` on each and writes DIR/judge.json.
Nothing of the truth reaches the package. ``--score`` scores what an earlier run left in DIR.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
from benches import interval_table


def column(rows: list[dict], name: str) -> np.ndarray:
    """Return the values of one figure where it is known."""
    return np.array([row[name] for row in rows if row.get(name) is not None], dtype=float)


def summary(rows: list[dict]) -> list[str]:
    """Return the lines of the figures over all recordings."""
    done = [row for row in rows if "fit_rms_%" in row]
    trigger, z = np.abs(column(done, "trig_err_deg")), np.abs(column(done, "trig_z"))
    inside, rms = column(done, "chamber_in_2std_%"), column(done, "chamber_rms_%")
    lines = [
        f"{len(done)} of {len(rows)} recordings judged",
        f"trigger: inside 1.96 std {np.sum(z < 1.96)} of {z.size}, median error {np.median(trigger):.3f} deg, worst "
        f"{np.max(trigger):.2f}",
        f"chamber: loaded angles inside 2 std {np.mean(inside):.0f} % (mean), below 90 % in {np.sum(inside < 90.0)} of "
        f"{inside.size}; rms {np.median(rms):.2f} % (median), {np.max(rms):.2f} % (worst)",
        "",
    ]
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for row in done:
        for name, _, value, true, (low, high) in row["coverage"]:
            found.setdefault(name, []).append((true, value, low, high))
    return [*lines, *interval_table(found)]


def main() -> None:
    """Run the scorer and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("set", type=Path, help="folder of recordings")
    parser.add_argument("truth", type=Path, help="folder that only the scorer reads")
    parser.add_argument("--scorer", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", help="recordings whose name contains this")
    parser.add_argument("--score", action="store_true", help="score what lies in --out")
    arguments = parser.parse_args()
    command = [sys.executable, str(arguments.scorer), str(arguments.set), str(arguments.truth)]
    command += ["--out", str(arguments.out), "--cmd", f"{shlex.quote(sys.executable)} -m camtorque.cli"]
    command += ["--only", arguments.only] if arguments.only else []
    command += ["--score"] if arguments.score else []
    subprocess.run(command, check=True)
    rows = json.loads((arguments.out / "judge.json").read_text(encoding="utf-8"))
    print("\n".join(summary(rows)))


if __name__ == "__main__":
    main()
