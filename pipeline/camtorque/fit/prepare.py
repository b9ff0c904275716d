"""Aligned cycles and certificates -> what the fit needs: mean cycles, bins and weights, the data of one recording.

What a drive repeats many times a revolution is an order that stands on the base circle, where no pump acts: teeth and
poles swing the torque alike all around. What rings after the stroke dies away, and hardly ever a whole number of times
a revolution: between both halves of the base circle its phase and size differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from camtorque.config import RecordingConfig
from camtorque.fit.problem import FitData
from camtorque.fit.rig_rows import loaded_rows, rig_rows
from camtorque.fit.teeth import PLACE_STD
from camtorque.laws.chain import BINS, ChainInput, binned
from camtorque.laws.lift import LiftCorrection, lift_correction
from camtorque.laws.ripple import waves
from camtorque.laws.swing import NO_ERRORS, Swing, swing_of
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.load_check import on_base
from camtorque.records import (
    DEVIATION,
    DEVIATION_ERRORS,
    LEAD,
    PASSED,
    TEETH,
    Array,
    CamCycles,
    CamTable,
    ReadOnly,
    Recording,
    Refusal,
)
from camtorque.stacks import mean_of
from camtorque.units import DEGREE, TURN, angle_grid, counted, on_grid

FIT_GRID = 1800
"""Points per revolution of the model, whatever the grid of the cycles: 0.2 degrees."""
FINER_BINS = 2 * BINS
"""Bins of a revolution of a shaft that rings between `BINS`: 2 kHz at 150 rpm is order 800."""
SMALLEST_SHARE = 2.0e-4
"""Least standard deviation of a bin, as a share of the peak torque: quantisation and grid."""
DISCREPANCY = 1.0e-3
"""Model error per torque that the weights admit; a larger one widens the intervals afterwards."""
CORRELATION = 6.0
"""Angle over which neighbouring residuals are one value [deg]: the transducer's low-pass and smooth errors of laws."""
INDEPENDENT = 360.0 / CORRELATION
"""Independent values per revolution: the one count that weights, evidence and inflation use."""
SETTLING, LEAST_BASE = 40.0 * DEGREE, 60.0 * DEGREE
"""Angle after the lift in which shafts ring; least angle behind it that tells an order."""
ORDERS = range(4, 200)
"""Orders that are looked for: below are misalignment and drift, above is what no transducer shows."""
STANDS_OUT, ALIKE = 0.5, 0.3
"""Share of the variance of the base circle's torque that one order has to be, and difference of both halves over it:
of 64 recordings of four makers 13 without such a drive have an order of 0.5 to 0.78, whose halves differ by 0.59 or
more; one with a gear of 41 teeth has 0.79 and 0.17."""
LEAST_SHARE = 3.0e-4
"""Amplitude that is worth a law, as a share of the peak torque."""


@dataclass(frozen=True)
class MeanCycles(ReadOnly):
    """Mean cycles of the fitted and of the held-out half, on the fine grid.

    torque, pressure : (n_theta,) of the fitted cycles [N m, Pa]; held_torque, held_pressure : of the held-out ones;
    torque_all, pressure_all : of all used cycles; scatter_of_mean : rms of the mean's standard error
    """

    torque: Array
    pressure: Array
    held_torque: Array
    held_pressure: Array
    torque_all: Array
    pressure_all: Array
    scatter_of_mean: float

    @property
    def odd_even(self) -> float:
        """Rms of the difference of both halves [N m]."""
        return float(np.sqrt(np.mean((self.torque - self.held_torque) ** 2)))


def mean_cycles(cycles: CamCycles) -> MeanCycles:
    """Return the mean cycles of both halves.

    Raises
    ------
    Refusal : without torque, or with fewer than four used cycles (two to fit, two to score)
    """
    if cycles.torque is None:
        raise Refusal("fit: the recording has no torque channel; use `camtorque align` for pressure and trigger only")
    if cycles.theta.size < BINS:
        raise Refusal(
            f"fit: found an angle grid of {cycles.theta.size} points, expected at least {BINS}; choose a larger n_theta"
        )
    if cycles.speed.size < 4 or cycles.held_out.all() or not cycles.held_out.any():
        usable = counted(cycles.speed.size, "usable cycle", "usable cycles")
        raise Refusal(f"fit: {usable}, at least 4 are needed (2 to fit, 2 to score)")
    fit, held = ~cycles.held_out, cycles.held_out
    torque, pressure = cycles.torque_halves, [mean_of(cycles.pressure, half) for half in (fit, held)]
    return MeanCycles(
        torque[0], pressure[0], torque[1], pressure[1], cycles.mean_torque, cycles.mean_pressure,
        float(np.sqrt(np.mean(cycles.torque_std**2) / fit.sum())),
    )  # fmt: skip


def law_variance(torque: Array) -> Array:
    """Return the variance of what the laws leave in each bin of mean torques (..., bins) [(N m)^2]."""
    size = np.abs(torque)
    return np.asarray((SMALLEST_SHARE * np.max(size, axis=-1, keepdims=True)) ** 2 + (DISCREPANCY * size) ** 2)


def bin_weights(torque: Array, scatter: float, count: int = 1) -> Array:
    """Return the weight of each bin: scatter of the mean, error of the laws, correlation.

    Parameters
    ----------
    torque : (..., bins) mean measured torque [N m]
    scatter : standard error of the mean of one bin [N m]
    count : recordings that are fitted together: the error of the laws is the same in all of them
    """
    return 1.0 / np.sqrt((scatter**2 + count * law_variance(torque)) * torque.shape[-1] / INDEPENDENT)


def cam_swing(config: RecordingConfig, details: Mapping[str, Any], orders: int = 0) -> Swing | None:
    """Return what a wheel saw of the swing within a turn by details of an alignment, None where none did.

    Up to ``orders`` the cam turns as its teeth say, above as the twist by the torque does; see `teeth`. A wheel on the
    motor's side saw the swing of its own shaft, which the curves are over: it tells nothing of the cam's.
    """
    waves = details.get(DEVIATION)
    if waves is None:
        return None
    waves = np.asarray(waves, dtype=np.float64)
    lead = np.asarray(details.get(LEAD, waves), dtype=np.float64)
    most = 0 if config.trigger.side == "motor" else orders
    return swing_of(lead, waves, most, details.get(DEVIATION_ERRORS, NO_ERRORS))


def further_teeth(config: RecordingConfig, details: Mapping[str, Any]) -> Array:
    """Return what the second and third tooth on a camshaft tell by details of an alignment, as `FitData.teeth`."""
    passed = details.get(PASSED)
    if passed is None or config.trigger.side == "motor":
        return np.zeros((0, 3))
    place, lead, scatter = np.asarray(passed, dtype=np.float64).T
    return np.column_stack([config.trigger.nominal_angle + place, lead, np.hypot(scatter, PLACE_STD)])


def passages_of(config: RecordingConfig, details: Mapping[str, Any]) -> Array:
    """Return when each tooth of a wheel on the camshaft passes by details of an alignment, as `TEETH` says."""
    none = np.zeros((0, 2))
    return none if config.trigger.side == "motor" else np.asarray(details.get(TEETH, none), dtype=np.float64)


def over_even_angle(values: Array, swing: Swing | None, n: int = FIT_GRID) -> Array:
    """Return a mean cycle (n_theta,) as the chain takes it, over even angle, (n,)."""
    return on_grid(values if swing is None else swing.evened(values), n)


def at_cam_angles(chain: ChainInput, values: Array, n: int) -> Array:
    """Return periodic values of a chain (m, ...) at n cam angles, straight between their own."""
    size = values.shape[0]
    place = np.arange(n) * (size / n) if chain.swing is None else chain.swing.even(n) * (size / TURN)
    first = np.floor(place).astype(np.int64)
    share = (place - first).reshape(-1, *([1] * (values.ndim - 1)))
    return np.asarray((1.0 - share) * values[first % size] + share * values[(first + 1) % size])


def cam_angles(chain: ChainInput) -> Array:
    """Return the cam angle, as the alignment has it, at each point of a chain, (n,) [rad]."""
    return chain.theta if chain.swing is None else chain.swing.cam(chain.theta.size)


def fit_data(
    recording: Recording, cycles: CamCycles, law: CamLaw, means: MeanCycles, bins: int = BINS, orders: int = 0
) -> FitData:
    """Return one recording ready to be fitted to the mean of its fitted cycles; its structure is still ``land``.

    ``orders`` of the cam's swing are those of a wheel.
    """
    grid = FIT_GRID // BINS * bins
    config: RecordingConfig = recording.config
    table: CamTable = recording.cam_table
    torque_sheet, pressure_sheet = recording.of("torque")[0].calibration, recording.of("pressure")[0].calibration
    assert torque_sheet is not None
    assert pressure_sheet is not None
    rows = loaded_rows(rig_rows(config, law, torque_sheet, pressure_sheet, cycles), law, cycles, means.torque)
    basis = lift_basis(table, law, cycles.theta)
    swing = cam_swing(config, cycles.details, orders)
    torque, pressure = (over_even_angle(part, swing, grid) for part in (means.torque, means.pressure))
    chain = ChainInput(
        theta=angle_grid(grid), speed=cycles.mean_speed, line_pressure=pressure, shaft_torque=torque,
        trigger_angle=config.trigger.nominal_angle, pump=config.pump, law=law,
        offset=config.pump.follower_offset * config.rotation, low_pass_order=torque_sheet.filter_order, swing=swing,
        ripple_order=repeated_order(on_grid(means.torque, grid), law.evaluate(angle_grid(grid), 0)), bins=bins,
    )  # fmt: skip
    centred = binned(torque, bins)
    weight = bin_weights(centred, means.scatter_of_mean)
    teeth = further_teeth(config, cycles.details)
    return FitData(config.id, chain, centred, weight, "land", rows, basis, config.measures_chamber, teeth)


def lift_basis(table: CamTable, law: CamLaw, theta: Array) -> LiftCorrection:
    """Return the basis of the correction of a lift table; ``theta``: angles at which its law is asked [rad]."""
    step = float(np.median(np.diff(table.theta)))
    return lift_correction(theta, law.evaluate(theta, 0), table.resolution, law.lift_std, step)


def other_half(data: FitData, means: MeanCycles) -> FitData:
    """Return a recording of `fit_data` with the cycles that are held out in place of those that are fitted."""
    swing, n = data.chain.swing, data.chain.theta.size
    torque, pressure = (over_even_angle(part, swing, n) for part in (means.held_torque, means.held_pressure))
    return replace(
        data,
        torque=binned(torque, data.chain.bins),
        chain=replace(data.chain, line_pressure=pressure, shaft_torque=torque),
    )


def repeated_order(torque: Array, lift: Array) -> int:
    """Return how many times a revolution a mean torque (n,) repeats itself where the lift (n,) stands, 0 for none."""
    places = base_circle(lift)
    if places.size < torque.size * LEAST_BASE / (2.0 * np.pi):
        return 0
    angle = places * (2.0 * np.pi / torque.size)
    slow = np.vander(np.linspace(-1.0, 1.0, angle.size), 3)
    here = torque[places % torque.size]
    here = here - slow @ np.linalg.lstsq(slow, here, rcond=None)[0]
    left = [float(np.var(here - _wave(order, angle, here)[1])) for order in ORDERS]
    order = ORDERS[int(np.argmin(left))]
    half = angle.size // 2
    parts = (slice(None), slice(half), slice(half, None))
    whole, first, second = (_wave(order, angle[part], here[part])[0] for part in parts)
    stands = min(left) < (1.0 - STANDS_OUT) * np.var(here) and abs(whole) > LEAST_SHARE * np.max(np.abs(torque))
    return order if stands and abs(first - second) < ALIKE * abs(whole) else 0


def base_circle(lift: Array) -> Array:
    """Return the longest run of places (m,) at which a periodic lift (n,) stands, after `SETTLING`; they may pass n."""
    moving = np.flatnonzero(~on_base(lift))
    gaps = np.diff(moving, append=moving[0] + lift.size)
    longest = int(np.argmax(gaps))
    settled = moving[longest] + 1 + round(SETTLING / (2.0 * np.pi) * lift.size)
    return np.arange(settled, moving[longest] + gaps[longest])


def _wave(order: int, angle: Array, torque: Array) -> tuple[complex, Array]:
    """Return amplitude and course of an order in a torque (n,) at some angles."""
    columns = waves(order, angle)
    size = np.linalg.lstsq(columns, torque, rcond=None)[0]
    return complex(*size), columns @ size
