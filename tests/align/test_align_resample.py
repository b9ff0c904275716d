"""Which way a channel is resampled: compiled code where that pays, and the same numbers both ways."""

from __future__ import annotations

import sys

import numba
import pytest
from camtorque.align import resample, resample_compiled
from camtorque.align.resample import COMPILED_FROM, LOADED_FROM, resampler

PLAIN, COMPILED = resample.resample_block, resample_compiled.resample_block


@pytest.mark.parametrize(("samples", "loaded", "wanted"), [
    (COMPILED_FROM - 1, True, PLAIN), (COMPILED_FROM, True, COMPILED), (LOADED_FROM, True, COMPILED),
    (COMPILED_FROM - 1, False, PLAIN), (LOADED_FROM - 1, False, PLAIN), (LOADED_FROM, False, COMPILED),
    (LOADED_FROM + 1, False, COMPILED),
])  # fmt: skip
def test_numba_is_loaded_for_long_channels_and_used_where_it_is_there(
    samples: int, loaded: bool, wanted: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sys.modules["numba"] is numba
    if not loaded:
        monkeypatch.delitem(sys.modules, "numba")
    assert resampler(samples) is wanted
