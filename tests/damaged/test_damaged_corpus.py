"""Every case of the corpus meets its verdict, and none ends in anything but a record or a refusal of one line."""

from collections.abc import Callable
from pathlib import Path

import pytest
from camtorque.ingest import read_recording, summarise
from camtorque.records import Refusal
from damaged.build import BUILDERS
from damaged.cases import OF_THE_SHEETS, VERDICTS


def test_every_case_has_a_verdict_and_there_are_enough():
    assert set(BUILDERS) == set(VERDICTS)
    assert len(BUILDERS) >= 40


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_verdict(name: str, corpus: Callable[[str], Path]):
    verdict = VERDICTS[name]
    folder = corpus(name)
    if verdict.refused:
        with pytest.raises(Refusal, match=verdict.refused) as caught:
            summarise(read_recording(folder))
        assert "\n" not in str(caught.value)
        return
    codes = {finding.code for finding in summarise(read_recording(folder)).findings} - OF_THE_SHEETS
    assert codes == verdict.findings
