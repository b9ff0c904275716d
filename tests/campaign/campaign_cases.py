"""Recordings whose analysis is a word: they sleep, are refused, fail or kill their worker. Everything else is real.

Run as a script it is the command `camtorque` with that analysis:  python campaign_cases.py campaign DIR --out OUT
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from campaign_words import act
from camtorque.campaign import flow, task
from camtorque.records import Finding
from camtorque.report.files import write_json

STOPPED = "camtorque: stopped; the same command goes on where it was\n"


def make(folder: Path, **words: str) -> Path:
    """Write recordings: name -> word."""
    for name, word in words.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "recording.toml").write_text(word)
    return folder


def analyse(path: Path, options: object) -> tuple[Any, Finding]:
    """Stand for the analysis of a recording; the second value is what the joint fit would get."""
    act((path / "recording.toml").read_text(), path / "tried")
    return SimpleNamespace(name=path.name), Finding(path.name, "info", "x" * 1000)


def write_run(result: Any, folder: Path) -> dict[str, Any]:
    """Write a report of one line."""
    (folder / "figures").mkdir()
    (folder / "figures" / "torque.svg").write_text("<svg></svg>")
    nothing = {"rms_percent_of_peak": 1.0, "forward_gap_percent": 1.0, "return_min_measured_nm": -1.0,
               "return_min_model_nm": -1.0}  # fmt: skip
    doc = {
        "schema": "camtorque.result/1",
        "recording": {"name": result.name, "speed_rpm": 1000.0, "cycles_found": 9, "cycles_used": 9},
        "metrics": {"rigid": nothing, "fitted": nothing, "fitted_held_out_cycles": nothing},
        "explained": True, "verdict": {"level": "good"}, "effects": [], "losses": {}, "chamber": None, "forces": {},
    }  # fmt: skip
    write_json(folder / "result.json", doc)
    return doc


def no_joint_fit(
    count: int, read: Callable[[int], Finding], threads: int, folders: object
) -> tuple[None, tuple[Finding, ...]]:
    """Tell what the joint fit would have got."""
    return None, (Finding("joint", "info", " ".join(item.code for item in map(read, range(count)))),)


def stand_in() -> None:
    """Put the stand-ins into this process."""
    task.analyse, task.write_run = analyse, write_run  # type: ignore[assignment]
    task.thumbnail, task.joint_input = lambda result: "<svg></svg>", lambda prepared: prepared


def run_task(item: task.Task) -> Any:
    """Do the real work of a worker with the stand-in analysis."""
    stand_in()
    return task.run_task(item)


if __name__ == "__main__":
    from camtorque import cli

    flow.run_task, flow.joint_fit = run_task, no_joint_fit  # type: ignore[assignment]
    sys.exit(cli.main(sys.argv[1:]))
