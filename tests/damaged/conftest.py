"""The damaged corpus as a fixture: each case is written, read, aligned and rehearsed once, whoever asks for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from camtorque.align import align
from camtorque.ingest import read_recording
from camtorque.records import CamCycles, Finding, Recording, Refusal
from camtorque.rehearsal import rehearse
from damaged.build import BUILDERS


def once(function: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a function that is called once with each name, and gives or refuses the same again."""
    known: dict[str, Any] = {}

    def call(name: str) -> Any:
        if name not in known:
            try:
                known[name] = function(name)
            except Refusal as refusal:
                known[name] = refusal
        if isinstance(known[name], Refusal):
            raise known[name]
        return known[name]

    return call


class Corpus:
    """What becomes of each case, by its name; the folders may be read, not changed."""

    folder: Callable[[str], Path]
    recording: Callable[[str], Recording]
    cycles: Callable[[str], CamCycles]
    rehearsed: Callable[[str], tuple[Finding, ...]]

    def __init__(self, place: Path) -> None:
        self.folder = once(lambda name: BUILDERS[name](place / name))
        self.recording = once(lambda name: read_recording(self.folder(name)))
        self.cycles = once(lambda name: align(self.recording(name)))
        self.rehearsed = once(lambda name: rehearse(self.recording(name), self.cycles(name)))


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    return Corpus(tmp_path_factory.mktemp("corpus"))
