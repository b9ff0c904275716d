"""The damaged corpus as a fixture: three files of tests read it, each case is written once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from damaged.build import BUILDERS


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return what gives the folder of a case; it may be read, not changed."""
    place = tmp_path_factory.mktemp("corpus")
    return cache(lambda name: BUILDERS[name](place / name))
