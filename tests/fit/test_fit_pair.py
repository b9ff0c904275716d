"""Two recordings of one pump side by side: what the transducer did not see lies where the torque does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.pair import angle_between, at_angle, pair_of
from camtorque.records import DEVIATION
from camtorque.units import DEGREE, angle_grid
from fit_cases import quick_prepared

KEY = ("closed_volume", 0, 1000.0)


def cycle(turned: float) -> np.ndarray:
    theta = angle_grid(1800) + turned
    return np.exp(np.cos(theta) * 8.0 - 8.0) * (1.0 + 0.1 * np.cos(40.0 * theta))


@pytest.mark.parametrize("degrees", [0.0, 0.003, -0.3, 1.0])
def test_the_angle_between_two_cycles_is_found(degrees: float) -> None:
    one, later = cycle(0.0), cycle(degrees * DEGREE)
    np.testing.assert_allclose(at_angle(one, degrees * DEGREE), later, atol=1e-9)
    assert angle_between(one, 1.02 * later + 0.5) == pytest.approx(degrees * DEGREE, abs=1e-9 + 2e-4 * abs(degrees))


@pytest.mark.parametrize("degrees", [0.3, -2.0, 5.0])
def test_the_angle_between_two_cycles_of_a_shaft_that_rings_is_no_other_period_of_it(degrees: float) -> None:
    """A descent from no angle ended at 1.1 degrees for 5."""
    theta = angle_grid(1800)
    one = 50.0 * np.exp(8.0 * np.cos(theta) - 8.0) + 5.0 * np.cos(80.0 * theta) * np.exp(-((theta - 1.0) % (2 * np.pi)))
    assert angle_between(one, 0.9 * at_angle(one, degrees * DEGREE)) == pytest.approx(degrees * DEGREE, abs=1e-4)


def test_what_was_not_seen_moves_with_the_trigger() -> None:
    prepared = quick_prepared(*KEY)
    best = prepared.candidates[0]
    lost = 0.3 * np.cos(150.0 * best.data.chain.theta) * np.exp(-best.data.chain.theta)
    chain = replace(best.data.chain, shaft_torque=prepared.measured + lost)
    start = replace(best, data=replace(best.data, chain=chain))
    turned = 0.4 * DEGREE
    cycles = prepared.cycles
    moved = replace(cycles, **{name: at_angle(getattr(cycles, name).T, turned).T for name in ("torque", "pressure")})
    pair = pair_of(prepared, replace(prepared, cycles=moved, measured=np.zeros(0)), start)
    one, two = (item.chain.shaft_torque for item in pair.items)
    assert np.std(at_angle(one, turned) - one) > 0.1
    np.testing.assert_allclose(two, at_angle(one, turned), atol=2e-3)


def test_each_recording_of_a_pair_has_the_zero_that_its_own_sheet_leaves_open() -> None:
    """Of two runs one without readings at standstill came out as changed, and as not changed the other way round."""
    prepared = quick_prepared(*KEY)
    recording = prepared.recording
    channels = [
        replace(channel, calibration=replace(channel.calibration, zero_std=1.2))
        if channel.quantity == "torque" and channel.calibration is not None else channel
        for channel in recording.channels
    ]  # fmt: skip
    unread = replace(prepared, recording=replace(recording, channels=tuple(channels)))
    for sides in ((prepared, unread), (unread, prepared)):
        pair = pair_of(*sides, prepared.candidates[0])
        known = [item.rows["torque_zero"].prior for item in pair.items]
        assert [prior is not None and prior[1] == pytest.approx(1.2, rel=0.05) for prior in known] == [
            side is unread for side in sides
        ]
        assert pair.own["torque_zero"] == pytest.approx(1.2, rel=0.1)


def test_triggers_of_two_kinds_are_each_off_by_what_their_own_sheet_allows() -> None:
    """A pump recorded by a counter and then by a tooth was told to leak more, at 94 %."""
    prepared = quick_prepared(*KEY)
    recording, start = prepared.recording, prepared.candidates[0]
    trigger = replace(recording.config.trigger, pulses_per_rev=360, installation_tolerance=2.0 * DEGREE)
    other = replace(recording, config=replace(recording.config, trigger=trigger))
    same, apart = pair_of(prepared, prepared, start), pair_of(prepared, replace(prepared, recording=other), start)
    mounted = [recording.config.trigger.installation_tolerance, 2.0 * DEGREE]
    assert same.own["trigger_offset"] < 0.02 * DEGREE
    assert apart.own["trigger_offset"] == pytest.approx(np.hypot(*mounted) / np.sqrt(3.0))


@pytest.mark.parametrize(("side", "order"), [("cam", 2), ("motor", 0)])
def test_each_recording_of_a_pair_turns_as_its_own_wheel_measured(side: str, order: int) -> None:
    """After one pulse a turn the wheel of the second was dropped, and its true cam angle twisted once more."""
    one = quick_prepared(*KEY)
    recording, cycles = one.recording, one.cycles
    trigger = replace(recording.config.trigger, side=side)
    turned = {**cycles.details, DEVIATION: 0.01 * np.cos(3.0 * cycles.theta)}
    wheel = replace(
        one, recording=replace(recording, config=replace(recording.config, trigger=trigger)),
        cycles=replace(cycles, details=turned),
    )  # fmt: skip
    before, after = (item.chain.swing for item in pair_of(one, wheel, one.candidates[0]).items)
    assert before is None
    assert after is not None
    assert after.order == order
