"""A short stretch of each fuzz target; the long ones run by hand: ``python tests/damaged/fuzz.py FORMAT SECONDS``."""

from pathlib import Path

import numpy as np
import pytest
from camtorque.ingest.formats import FORMATS
from damaged.fuzz import fuzz, mutate, seed
from damaged.logs import SUFFIXES, WRITERS

CASES = {"xlsx": 5, "mf4": 12, "csv": 12, "lvm": 12}
"""Cases of the slower formats; 30 of the others."""


def test_every_format_has_a_seed():
    assert set(SUFFIXES) == set(WRITERS) == set(FORMATS)


def test_a_mutation_is_repeatable_and_changes_something(tmp_path: Path):
    data = seed("csv", tmp_path)
    first, again, other = (mutate(data, np.random.default_rng(number)) for number in (1, 1, 2))
    assert first == again
    assert len({data, first, other}) == 3


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_a_reader_reads_or_refuses(name: str, tmp_path: Path):
    assert fuzz(name, tmp_path, CASES.get(name, 30)) == []
