"""Clock of a logger that recorded no trigger, from the physics it shares with one that did.

While the lift rises, the torque of a pump follows line pressure times lift velocity. The shift that makes them most
alike, revolution by revolution, ties the clocks; which revolution belongs to which is found from the scatter of their
heights.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camtorque.align.angle import CamAngle
from camtorque.align.channels import Turns, align_channels
from camtorque.align.clocks import CLEAR_EVIDENCE, Clock, robust_line
from camtorque.align.options import AlignOptions
from camtorque.align.polarity import lift_velocity
from camtorque.records import Array, CamTable, Channel, ClockFit, Finding, Refusal
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import TURN

SHAPE_STD_DEG = Threshold(
    0.5, "deg", "recordings",
    "What torque and pressure times lift velocity differ in shape: the shift found on five runs of one "
    "pump whose clocks are known was between -0.6 and 0.9 degrees."
)  # fmt: skip
COARSE_RATE = 2000.0
N_THETA = 720
WIDEST_SHIFT = 80
"""Grid steps (40 degrees) within which the coarse correlation has to be right."""
LEAST_CYCLES = Count(5, "cycles", "statistics", "Cycles from which the shift and its scatter are taken, at least.")
RISING = 0.05


@dataclass(frozen=True)
class Pair:
    """Torque and pressure on two loggers; ``own`` is the quantity on the logger without a trigger."""

    channels: Mapping[str, Channel]
    own: str
    table: CamTable
    angle: CamAngle

    @property
    def tied(self) -> Channel:
        """Channel of the logger without a trigger."""
        return self.channels[self.own]

    @property
    def known(self) -> Channel:
        """Channel of the logger with the trigger."""
        return next(channel for quantity, channel in self.channels.items() if quantity != self.own)


def physics_clock(pair: Pair) -> Clock:
    """Return the clock of the logger without a trigger against that of the logger with it.

    Raises
    ------
    Refusal : fewer than five revolutions in common
    """
    offset, sign = _coarse_offset(pair)
    skew, evidence, stderr_skew, stderr = 0.0, 0.0, 0.0, np.inf
    for round_ in range(3):
        clock = Clock(ClockFit(pair.tied.logger, offset, 1e6 * skew, 0.0))
        rows, middle, period = _rows(pair, clock)
        if round_ == 1:
            turns, evidence = _whole_turns(rows, pair.own)
            offset += turns * float(np.median(period))
            continue
        shift = _best_shifts(rows, pair, sign) * period / N_THETA
        good = np.isfinite(shift)
        _refuse_few(pair, int(good.sum()))
        line = robust_line(middle[good], shift[good])
        # Drift is only read where the scatter of the shifts lets it stand out.
        drift = line.slope if abs(line.slope) > 3.0 * line.stderr_slope else 0.0
        offset += float(np.median(shift[good])) - drift * float(np.median(middle[good]))
        skew += drift
        shape = SHAPE_STD_DEG / 360.0 * float(np.median(period))
        stderr, stderr_skew = float(np.hypot(line.stderr_middle, shape)), line.stderr_slope
    findings = [_by_physics(pair, stderr, period)]
    if evidence < CLEAR_EVIDENCE:
        findings.append(_ambiguous(pair, evidence))
    fit = ClockFit(pair.tied.logger, offset, 1e6 * skew, stderr, "torque and pressure")
    return Clock(fit, stderr_skew, evidence=evidence, findings=tuple(findings))


def _coarse_offset(pair: Pair) -> tuple[float, float]:
    """Return own time minus known time where the correlation of the two is largest, from decimated signals.

    Second comes the sign of the torque: -1 where it is inverted, so that it follows the pressure best against it.
    """
    (own_time, own), (known_time, known) = _decimated(pair.tied), _decimated(pair.known)
    if min(own.size, known.size) < 2:
        _refuse_few(pair, 0)
    theta = np.interp(known_time, pair.angle.train.time, pair.angle.angle, left=np.nan, right=np.nan)
    grid = np.arange(N_THETA) * TURN / N_THETA
    velocity = np.nan_to_num(np.interp(theta, grid, lift_velocity(pair.table, N_THETA), period=TURN))
    known = known * np.maximum(velocity, 0.0)
    own, known = _even(own_time, own), _even(known_time, known)
    raw = _correlation(own - own.mean(), known - known.mean())
    # Not divided by the overlap: of equal peaks, one per revolution, the longest overlap is taken first.
    sign = 1.0 if np.max(raw) >= -np.min(raw) else -1.0
    lag = int(np.argmax(sign * raw)) - (known.size - 1)
    return float(own_time[0] + lag / COARSE_RATE - known_time[0]), sign


def _decimated(channel: Channel) -> tuple[Array, Array]:
    """Return times, the delay taken off, and means of samples at about `COARSE_RATE`."""
    step = max(1, round(channel.sample_rate / COARSE_RATE))
    n = channel.n_samples // step
    values = np.nan_to_num(channel.read(0, n * step)).reshape(n, step).mean(axis=1)
    delay = channel.calibration.delay if channel.calibration else 0.0
    start = channel.start_time + 0.5 * (step - 1) / channel.sample_rate - delay
    return start + np.arange(n) * step / channel.sample_rate, values


def _even(time: Array, values: Array) -> Array:
    """Return values at `COARSE_RATE` from the first time on."""
    return np.interp(time[0] + np.arange(round((time[-1] - time[0]) * COARSE_RATE)) / COARSE_RATE, time, values)


def _correlation(own: Array, known: Array) -> Array:
    """Return the full cross-correlation, lags from ``1 - known.size`` on (scipy takes long to import)."""
    n = own.size + known.size - 1
    length = 1 << (n - 1).bit_length()
    return np.fft.irfft(np.fft.rfft(own, length) * np.fft.rfft(known[::-1], length), length)[:n]


def _rows(pair: Pair, clock: Clock) -> tuple[dict[str, Array], Array, Array]:
    """Return both channels on a coarse angle grid with a trial clock, the middles and periods of the cycles."""
    clocks = {pair.known.logger: Clock(ClockFit(pair.known.logger, 0.0, 0.0, 0.0)), pair.tied.logger: clock}
    turns = Turns(pair.angle, clocks, AlignOptions(n_theta=N_THETA))
    complete = turns.covered(pair.channels.values())
    _refuse_few(pair, int(complete.sum()))
    aligned = align_channels(pair.channels, turns, complete)
    begin, end = turns.times[0][complete], turns.times[2][complete]
    return {quantity: item.rows[complete] for quantity, item in aligned.items()}, 0.5 * (begin + end), end - begin


def _refuse_few(pair: Pair, count: int) -> None:
    if count < LEAST_CYCLES:
        raise Refusal(
            f"logger {pair.tied.logger!r}: found {count} whole revolutions in common with logger {pair.known.logger!r},"
            f" expected at least {LEAST_CYCLES} to tie their clocks by torque and pressure; record the trigger on both"
        )


def _best_shifts(rows: Mapping[str, Array], pair: Pair, sign: float) -> Array:
    """Return the grid steps by which the own channel lies late in each cycle, nan where they are not found.

    Each is that of the best correlation over the rising lift.
    """
    velocity, by_line = lift_velocity(pair.table, N_THETA), pair.own == "pressure"
    torques, lines = sign * rows["torque"], np.maximum(rows["pressure"], 0.0)
    rise, shifts = np.flatnonzero(velocity > RISING * velocity.max()), np.arange(-WIDEST_SHIFT, WIDEST_SHIFT + 1)
    found, score = np.full(len(torques), np.nan), np.empty((len(torques), shifts.size))
    for i, shift in enumerate(shifts):
        moved = (rise + shift) % N_THETA
        torque, line = torques[:, rise if by_line else moved], lines[:, moved if by_line else rise] * velocity[rise]
        a, b = (part - np.mean(part, axis=1, keepdims=True) for part in (torque, line))
        score[:, i] = np.sum(a * b, axis=1) / np.sqrt(np.sum(a * a, axis=1) * np.sum(b * b, axis=1))
    best = np.argmax(score, axis=1)
    inside = np.flatnonzero((best > 0) & (best < shifts.size - 1))
    left, middle, right = (score[inside, best[inside] + step] for step in (-1, 0, 1))
    found[inside] = shifts[best[inside]] + 0.5 * (left - right) / (left - 2.0 * middle + right)
    return found


def _whole_turns(rows: Mapping[str, Array], own: str) -> tuple[int, float]:
    """Return how many revolutions the own channel has to move, and the log-likelihood ratio to the next best."""
    other = next(quantity for quantity in rows if quantity != own)
    a, b = np.ptp(rows[other], axis=1), np.ptp(rows[own], axis=1)
    n = a.size
    least = max(LEAST_CYCLES, n // 2)
    scores = []
    for turns in range(-(n - least), n - least + 1):
        x, y = a[max(0, -turns) : n - max(0, turns)], b[max(0, turns) : n - max(0, -turns)]
        known = np.isfinite(x + y)  # a cycle without some samples has no height
        x, y = x[known], y[known]
        correlation = float(np.corrcoef(x, y)[0, 1]) if known.any() and np.ptp(x) * np.ptp(y) > 0.0 else 0.0
        correlation = max(0.0, correlation)
        scores.append((-0.5 * x.size * np.log(max(1e-12, 1.0 - correlation**2)), turns))
    scores.sort(reverse=True)
    if len(scores) < 2:
        return 0, 0.0
    evidence = scores[0][0] - scores[1][0]
    return (scores[0][1] if evidence >= CLEAR_EVIDENCE else 0), float(evidence)


def _by_physics(pair: Pair, stderr: float, period: Array) -> Finding:
    degrees = 360.0 * stderr / float(np.median(period))
    text = (
        f"logger {pair.tied.logger} recorded no trigger: its clock is tied to that of {pair.known.logger} by torque "
        f"and pressure during the rising lift, with a standard error of {1e3 * stderr:.3g} ms ({degrees:.2g} degrees)"
    )
    return Finding("clock_from_physics", "warning", text, pair.tied.path.name)


def _ambiguous(pair: Pair, evidence: float) -> Finding:
    text = (
        f"logger {pair.tied.logger}: the scatter of the revolutions does not say which of its revolutions belongs to "
        f"which (log-likelihood ratio {evidence:.1f}, {CLEAR_EVIDENCE:.0f} wanted); the cam angle is right either way, "
        "but torque and pressure of a cycle may belong to neighbouring revolutions"
    )
    return Finding("clock_lag_ambiguous", "warning", text, pair.tied.path.name)
