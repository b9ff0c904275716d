"""Whatever the samples hold, the alignment ends in cycles or in a refusal of one line; warnings are errors here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from align_truth import Rig, Samples, make
from camtorque.align import AlignOptions, align, alignment_summary
from camtorque.records import Refusal

SHORT = Rig(duration=1.2, torque_noise=0.3, pressure_noise=1e5)
RECORDINGS = (
    make(SHORT),
    make(replace(SHORT, clock_kind="independent")),
    make(replace(SHORT, pulses_per_rev=60, missing_teeth=2, trigger_rate=5e4)),
)
DAMAGES = {
    "cut": lambda v, rng: v[: rng.integers(0, v.size)],
    "nan from": lambda v, rng: np.where(np.arange(v.size) < rng.integers(0, v.size), v, np.nan),
    "nan": lambda v, rng: np.full(v.size, np.nan),
    "nan spread": lambda v, rng: np.where(rng.random(v.size) < rng.random(), v, np.nan),
    "noise": lambda v, rng: rng.standard_normal(v.size) * 10.0 ** rng.uniform(-6, 6),
    "stretch lost": lambda v, rng: np.delete(v, slice(*np.sort(rng.integers(0, v.size, 2)))),
    "absurd": lambda v, rng: np.where(rng.random(v.size) < 1e-3, 10.0 ** rng.uniform(-3, 300), v),
    "largest": lambda v, rng: np.sign(v) * 1e308,
    "random pulses": lambda v, rng: 5.0 * (rng.random(v.size) < 10.0 ** rng.uniform(-4, 0)),
}


@pytest.mark.parametrize("name", DAMAGES)
@pytest.mark.parametrize("seed", range(6))
def test_cycles_or_a_refusal(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    recording = RECORDINGS[seed % 3]
    channels = list(recording.channels)
    for k in np.flatnonzero(rng.random(len(channels)) < 0.5):
        channels[k] = replace(channels[k], source=Samples(DAMAGES[name](channels[k].source.values, rng)))
    if seed > 3:
        k = rng.integers(len(channels))
        at = int(rng.integers(1, 1000))
        channels[k] = replace(channels[k], breaks=(at,), break_steps=(float(rng.normal()),))
    message = ""
    try:
        cycles = align(replace(recording, channels=tuple(channels)), AlignOptions(n_theta=360))
    except Refusal as refusal:
        message = str(refusal)
    assert "\n" not in message
    if message:
        return
    assert np.isfinite(cycles.torque).all()
    assert np.isfinite(cycles.pressure).all()
    assert alignment_summary(cycles)["cycles_used"] == cycles.index.size
