"""Which way a long channel is worked on: compiled code where that pays, and the same numbers both ways."""

from __future__ import annotations

import sys

import numba
import numpy as np
import pytest
from align_truth import Rig, make
from camtorque.align import align, resample, resample_compiled
from camtorque.align.resample import resampler
from camtorque.compiled import COMPILED_FROM, LOADED_FROM, compiled_pays
from camtorque.records import Array
from camtorque.signal import passes_compiled
from camtorque.signal.damage import damage_of_each
from camtorque.signal.edges import _transitions
from camtorque.signal.levels import FINE_SAMPLES, level_windows, looked_at
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.mark.parametrize(("samples", "loaded", "wanted"), [
    (COMPILED_FROM - 1, True, False), (COMPILED_FROM, True, True), (LOADED_FROM, True, True),
    (COMPILED_FROM - 1, False, False), (LOADED_FROM - 1, False, False), (LOADED_FROM, False, True),
    (LOADED_FROM + 1, False, True),
])  # fmt: skip
def test_numba_is_loaded_for_long_channels_and_used_where_it_is_there(
    samples: int, loaded: bool, wanted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sys.modules["numba"] is numba
    if not loaded:
        monkeypatch.delitem(sys.modules, "numba")
    assert compiled_pays(samples) is wanted
    assert resampler(wanted) is (resample_compiled if wanted else resample).resample_block


def pulses(seed: int) -> Array:
    """Return pulses of a rounded log: equal neighbours, spikes of one sample, windows that hold both levels or one."""
    rng = np.random.default_rng(seed)
    high = np.cumsum(rng.integers(1, 300, 80))
    level = np.searchsorted(high, np.arange(high[-1] + 70), side="right") % 2
    return np.round(5.0 * level + 0.1 * rng.standard_normal(level.size), rng.integers(1, 4))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), missing=st.sampled_from([None, np.nan, np.inf, 1e12]))
def test_compiled_looks_at_a_trigger_find_the_same_bit_for_bit(seed: int, missing: float | None) -> None:
    volts = pulses(seed)
    if missing is not None:
        volts[volts.size // 3] = missing
    plain, compiled = looked_at(volts, False), looked_at(volts, True)
    np.testing.assert_array_equal(plain[0], compiled[0])
    assert plain[1] == compiled[1] == (missing is not None)
    np.testing.assert_array_equal(plain[2], compiled[2])
    window, level, margin = level_windows(plain[0], plain[2], 0.0)
    for inside in ((0, volts.size), (FINE_SAMPLES + 3, volts.size - 5)):
        bands = (window, level - margin, level + margin)
        found = [function(plain[0], inside, bands) for function in (_transitions, passes_compiled.transitions)]
        assert found[0][0].size > 10
        np.testing.assert_array_equal(found[0][0], found[1][0])
        np.testing.assert_array_equal(found[0][1], found[1][1])


@settings(max_examples=60, deadline=None)
@given(
    values=st.lists(st.sampled_from([-9.0, -1.0, 0.0, 0.1, 5.0, 9.0, np.nan, np.inf]), min_size=1, max_size=60),
    lowest=st.sampled_from([-np.inf, -5.0]),
)
def test_compiled_counts_of_damage_are_the_same(values: list[float], lowest: float) -> None:
    volts = np.repeat(values, np.random.default_rng(len(values)).integers(1, 9, len(values)))
    ends = np.array([[-2.0, 0.3 * volts.size, 0.0], [0.5 * volts.size, volts.size + 3.0, 0.9]])
    plain, compiled = (damage_of_each(volts, ends, (lowest, 5.0), way) for way in (False, True))
    np.testing.assert_array_equal(plain, compiled)


def test_a_recording_is_aligned_alike_both_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = make(Rig(torque_noise=0.3, pressure_noise=1.0e5))
    plain = align(recording)
    for module in ("camtorque.align.channels", "camtorque.signal.edges"):
        monkeypatch.setattr(sys.modules[module], "compiled_pays", lambda n_samples: True)
    compiled = align(recording)
    assert plain.torque is not None
    assert compiled.torque is not None
    np.testing.assert_array_equal(plain.speed, compiled.speed)
    for one, other in ((plain.torque, compiled.torque), (plain.pressure, compiled.pressure)):
        assert 0.0 < np.max(np.abs(one - other)) < 1e-10 * np.max(np.abs(one))
    assert plain.cut_flow == compiled.cut_flow
    assert plain.findings == compiled.findings
