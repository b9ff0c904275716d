"""Design files for the tests, put together from parts."""

from __future__ import annotations

from pathlib import Path

from camtorque.design import read_task

PAPER = Path(__file__).resolve().parents[2] / "calibration" / "paper_pump.toml"
LOAD = "[[load]]\nspeed_rpm = 500\npressure_bar = 600\ncloses_mm = 1.5\nspills_mm = 4.5\n"
LIFT = '[lift]\nlaw = "modified_sine"\n'


def design_file(folder, *, lift=LIFT, free="", load=LOAD, aims="", limits="", more="", pump=PAPER):
    """Write a design file and return its path."""
    parts = [f'schema = "camtorque-design/1"\npump = "{pump}"\n', lift, f"[free]\n{free}\n", load, f"[aims]\n{aims}\n"]
    if limits:
        parts.append(f"[limits]\n{limits}\n")
    path = folder / "design.toml"
    path.write_text("\n".join([*parts, more]), encoding="utf-8")
    return path


def task_of(folder, **parts):
    """Return the task of such a file."""
    return read_task(design_file(folder, **parts))


def shaft(folder, pumps):
    """Return the paper's pump with several lobes on a shaft, all in phase."""
    path = folder / "shaft.toml"
    phases = ", ".join("0.0" for _ in range(pumps))
    path.write_text(PAPER.read_text(encoding="utf-8") + f"\n[shaft]\nphases_deg = [{phases}]\n", encoding="utf-8")
    return path
