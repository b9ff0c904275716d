"""Every case of the corpus: what reading says of it, what the alignment makes of it, and whether `check` says the same.

All of it stands in one file, so that one worker of the tests reads and aligns each case, and does so once.
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from camtorque.align import align
from camtorque.commands import check
from camtorque.ingest import read_recording, summarise
from camtorque.records import Refusal
from camtorque.rehearsal import rehearse
from damaged.build import BUILDERS
from damaged.cases import ALIGNED, OF_THE_SHEETS, SOUND, VERDICTS
from damaged.conftest import Corpus
from damaged.logs import Plan, clean_log, write_folder


def test_every_case_has_a_verdict_and_there_are_enough() -> None:
    assert set(BUILDERS) == set(VERDICTS)
    assert len(BUILDERS) >= 40
    assert set(ALIGNED) <= {name for name, verdict in VERDICTS.items() if not verdict.refused}


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_verdict(name: str, corpus: Corpus) -> None:
    """None ends in anything but a record or a refusal of one line."""
    verdict = VERDICTS[name]
    if verdict.refused:
        with pytest.raises(Refusal, match=verdict.refused) as caught:
            summarise(corpus.recording(name))
        assert "\n" not in str(caught.value)
        return
    codes = {finding.code for finding in summarise(corpus.recording(name)).findings} - OF_THE_SHEETS
    assert codes == verdict.findings


@pytest.mark.parametrize("name", sorted(name for name in BUILDERS if not VERDICTS[name].refused))
def test_alignment_of(name: str, corpus: Corpus) -> None:
    expected = ALIGNED.get(name, SOUND)
    if expected.refused:
        with pytest.raises(Refusal, match=expected.refused) as caught:
            corpus.cycles(name)
        assert "\n" not in str(caught.value)
        return
    cycles = corpus.cycles(name)
    lost = {row.reason: row.cycles for row in cycles.cut_flow if row.cycles and row.reason != "incomplete"}
    assert lost == expected.lost
    assert cycles.cycles_found == expected.found
    # the note that every recording with one pulse per revolution carries
    assert {finding.code for finding in cycles.findings} - {"ripple_unseen"} == expected.findings


def verdict_of_the_commands(cycles: Callable[[], Any], rehearsed: Callable[[], Any]) -> tuple[list[str], str]:
    """Return what can be done with a recording, and the refusal of `align`, by doing it."""
    try:
        cycles()
    except Refusal as refusal:
        return [], str(refusal)
    try:
        rehearsed()
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


def agree(folder: Path, cycles: Callable[[], Any], rehearsed: Callable[[], Any]) -> list[str]:
    """Return what can be done; check and the commands have to say the same, check all of what is wrong."""
    usable, refused = verdict_of_the_commands(cycles, rehearsed)
    said, first = verdict_of_check(folder)
    assert said == usable
    assert refused.startswith(first)
    assert bool(first) == bool(refused)
    return usable


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_check_says_what_align_and_run_do(name: str, corpus: Corpus, monkeypatch: pytest.MonkeyPatch) -> None:
    # each step is done once; whether check does the same steps itself, the next test asks
    monkeypatch.setattr(check, "read_recording", lambda folder: corpus.recording(folder.name))
    monkeypatch.setattr(check, "align", lambda recording: corpus.cycles(recording.config.id))
    monkeypatch.setattr(check, "rehearse", lambda recording, cycles: corpus.rehearsed(recording.config.id))
    agree(corpus.folder(name), lambda: corpus.cycles(name), lambda: corpus.rehearsed(name))


@pytest.mark.parametrize("lacking", ["torque", "pressure", "pump", "cycles", "nothing"])
def test_check_says_what_run_lacks(lacking: str, tmp_path: Path) -> None:
    log = clean_log(revolutions=3.2 if lacking == "cycles" else 12.0)
    folder = write_folder(tmp_path / "r", [log], Plan("hdf5"))
    toml = folder / "recording.toml"
    text = toml.read_text(encoding="utf-8")
    tables = re.split(r"(?m)^(?=\[)", text)
    gone = {"pump": "[pump]", "torque": 'quantity = "torque"', "pressure": 'quantity = "pressure"'}.get(lacking, "?")
    toml.write_text("".join(table for table in tables if gone not in table), encoding="utf-8")
    recording = read_recording(folder)
    cycles = align(recording)
    usable = agree(folder, lambda: cycles, lambda: rehearse(recording, cycles))
    assert usable == (["align", "run"] if lacking == "nothing" else ["align"])
