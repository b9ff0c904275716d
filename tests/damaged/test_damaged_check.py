"""`camtorque check` against `align` and `run` over the whole corpus: it passes what they do, and nothing else."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import pytest
from camtorque.align import align
from camtorque.commands import check
from camtorque.ingest import read_recording
from camtorque.records import Refusal
from camtorque.rehearsal import rehearse
from damaged.build import BUILDERS
from damaged.logs import Plan, clean_log, write_folder


def verdict_of_the_commands(folder: Path) -> tuple[list[str], str]:
    """Return what can be done with a recording, and the refusal of `align`, by doing it."""
    try:
        recording = read_recording(folder)
        cycles = align(recording)
    except Refusal as refusal:
        return [], str(refusal)
    try:
        rehearse(recording, cycles)
    except Refusal:
        return ["align"], ""
    return ["align", "run"], ""


def verdict_of_check(folder: Path) -> tuple[list[str], str]:
    """Return the same as `check` says it, the first refusal alone."""
    try:
        outcome = check.execute(Namespace(recording=folder), lambda _: None)
    except Refusal as refusal:
        return [], str(refusal)
    refused = outcome.document["refused"]
    assert (outcome.status == check.REFUSED) == bool(refused)
    usable = outcome.document.get("usable", [])
    assert ("enough for: align, run" in outcome.text) == (usable == ["align", "run"])
    return usable, refused[0] if refused else ""


def agree(folder: Path) -> list[str]:
    """Return what can be done; check and the commands have to say the same, check all of what is wrong."""
    usable, refused = verdict_of_the_commands(folder)
    said, first = verdict_of_check(folder)
    assert said == usable
    assert refused.startswith(first)
    assert bool(first) == bool(refused)
    return usable


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_check_says_what_align_and_run_do(name: str, corpus: Callable[[str], Path]) -> None:
    agree(corpus(name))


@pytest.mark.parametrize("lacking", ["torque", "pressure", "pump", "cycles", "nothing"])
def test_check_says_what_run_lacks(lacking: str, tmp_path: Path) -> None:
    log = clean_log(revolutions=3.2 if lacking == "cycles" else 12.0)
    folder = write_folder(tmp_path / "r", [log], Plan("hdf5"))
    toml = folder / "recording.toml"
    text = toml.read_text(encoding="utf-8")
    tables = re.split(r"(?m)^(?=\[)", text)
    gone = {"pump": "[pump]", "torque": 'quantity = "torque"', "pressure": 'quantity = "pressure"'}.get(lacking, "?")
    toml.write_text("".join(table for table in tables if gone not in table), encoding="utf-8")
    assert agree(folder) == (["align", "run"] if lacking == "nothing" else ["align"])
