"""How late each cycle comes: samples that a log lost, and clocks that run apart though the sheet gives them one time.

A channel whose logger has the time of the trigger passes the same cam angle in every cycle. Where samples are lost,
all cycles behind lie elsewhere; where two clocks differ, they wander. Both show in the lag of the cycles against the
typical one, to some hundredths of a degree, and neither shows in a mean cycle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from camtorque.align.clocks import LARGEST_SKEW, robust_line
from camtorque.align.quality import POINT_DEG, SAMPLED_CYCLES, CycleTable, ordinary, spread_choice
from camtorque.records import Array, Finding, Integers, Mask
from camtorque.signal.threshold import Count, Threshold
from camtorque.stacks import pieces
from camtorque.units import DEGREE, TURN, short

STEPS = ("samples_lost", "trigger_slipped")
"""Codes of the finding on a step of one channel against the trigger, and of torque and pressure together."""
FEWEST = Count(6, "cycles", "convention", "Cycles below which neither a step nor a drift is looked for.")
BESIDE_STEP = Count(3, "cycles", "convention", "Cycles on either side of a step, at least.")
LEAST_MOVE = Threshold(
    0.2, "deg", "simulated rigs",
    "Smallest step or drift of the lag that is told: sound runs reach 0.18 degrees, by the scatter of their loads."
)  # fmt: skip
SAMPLES_WIDE = Threshold(
    6.0, "1", "statistics",
    "Standard errors of one edge within which edges may wander together: where its place is known to a sample, edges "
    "of neighbouring turns move on by a whole one at once, which a line makes one and a half of (5.2 standard errors)."
)  # fmt: skip
SIGNIFICANT = Threshold(6.0, "1", "statistics", "Standard errors of a step or a drift of the lag, at least.")
STEP_OVER_LINE = Threshold(
    0.25, "1", "statistics", "A step leaves less of the lag's variance than this part of what a straight line leaves."
)
SHIFTED_OVER_PLAIN = Threshold(
    0.3, "1", "physics",
    "What differs by a shift alone differs less than this part once shifted; a changed load or warmer fuel does not."
)  # fmt: skip

ALIKE = Threshold(0.2, "1", "convention", "Channels whose drifts differ by less than this share drift alike.")
PARTS = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Parts of the recording, from its beginning on, in which a step is looked for."""


@dataclass(frozen=True)
class Lags:
    """What the lags of the cycles tell.

    Attributes
    ----------
    slipped : (n_cycles,) cycles behind lost samples
    wander : quantity -> half of the cam angle by which it comes later at the last sound cycle than at the first of all
        [rad]
    """

    slipped: Mask
    wander: Mapping[str, float]
    findings: tuple[Finding, ...]


def settle_lags(table: CycleTable, time: Array, edge_noise: float) -> Lags:
    """Find the cycles behind lost samples, and take off in place what a channel wanders, from the first cycle on.

    Parameters
    ----------
    time : (n_cycles,) when each begins [s]
    edge_noise : standard error of one trigger edge [s]
    """
    least = max(LEAST_MOVE * DEGREE, SAMPLES_WIDE * edge_noise * float(np.median(table.speed)))
    slipped, wander = np.zeros(table.index.size, dtype=bool), dict[str, float]()
    findings: list[Finding] = []
    lags = {quantity: cycle_lags(item.rows, ordinary(table)) for quantity, item in table.aligned.items()}
    for quantity, lag in lags.items():
        rows, sound = table.aligned[quantity].rows, np.flatnonzero(ordinary(table) & ~slipped)
        while (step := _first_step(rows, sound, lag, least)) is not None:
            lost, moved = step
            # samples lost where a cycle is flat do not move that cycle: the one before goes too
            slipped[sound[lost - 1] :] = True
            groups = sound[:lost], sound[lost + 1 :]
            alike = [
                name for name, other in lags.items()
                if name == quantity or abs(_step(other, *groups) - moved) < ALIKE * abs(moved)
            ]  # fmt: skip
            findings = [
                *(finding for finding in findings if finding.code not in STEPS),
                _lost(alike, moved, time[sound[lost]], table, sound[lost - 1]),
            ]
            sound = sound[: lost - 1]
        drift = _drift(rows, sound, lag, time, least)
        if drift:
            span = float(time[sound[-1]] - time[0])
            wander[quantity], turned = drift * span / 2.0, span * float(np.median(table.speed[sound]))
            lag -= drift * (time - time[0])
            for piece in pieces(rows):
                rows[piece] = _turned(rows[piece], -drift * (time[piece] - time[0]))
    if wander:
        findings += _wandering(wander, turned)
    return Lags(slipped, wander, tuple(findings))


def cycle_lags(rows: Array, sound: Mask) -> Array:
    """Return the cam angle by which each cycle comes later than the typical one, (n_cycles,) [rad]; nan: not sound.

    It is the shift at which a cycle and the median of the sound ones are most alike, from their circular correlation.
    """
    lags = np.full(rows.shape[0], np.nan)
    if not sound.any():
        return lags
    stride = max(1, int(POINT_DEG * rows.shape[1] / 360.0))
    typical = np.median(rows[spread_choice(sound), ::stride], axis=0)
    spectrum, n = np.conj(np.fft.rfft(typical - np.mean(typical))), typical.size
    for piece in pieces(rows):
        some = piece.start + np.flatnonzero(sound[piece])
        alike = np.fft.irfft(np.fft.rfft(rows[some, ::stride], axis=1) * spectrum, n, axis=1)
        lags[some] = _peak(alike) * (TURN / n)
    return lags


def _peak(alike: Array) -> Array:
    """Return the place of each row's maximum, between points and from -n/2 to n/2."""
    n, row = alike.shape[1], np.arange(alike.shape[0])
    top = np.argmax(alike, axis=1)
    before, here, after = alike[row, top - 1], alike[row, top], alike[row, (top + 1) % n]
    bend = np.minimum(before - 2.0 * here + after, -1e-300)
    return np.asarray((top + 0.5 * (before - after) / bend + n / 2) % n - n / 2)


def _first_step(rows: Array, sound: Integers, lag: Array, least: float) -> tuple[int, float] | None:
    """Return the place among the sound cycles of the one in which the lag steps, and by how much, ``least`` [rad].

    Several steps look like a drift, so that the first parts of the recording are looked at by themselves too.
    """
    parts = (sound[: round(part * sound.size)] for part in PARTS)
    return next((step for part in parts if (step := _clearest_step(rows, part, lag, least)) is not None), None)


def _clearest_step(rows: Array, sound: Integers, lag: Array, least: float) -> tuple[int, float] | None:
    found = lag[sound]
    n, own = found.size, int(BESIDE_STEP)
    if n < max(FEWEST, 2 * own + 1):
        return None
    torn = np.arange(own, n - own, dtype=np.int64)
    left = _squares(found, 0, torn) + _squares(found, torn + 1, n)
    lost = int(torn[np.argmin(left)])
    before, after = sound[:lost], sound[lost + 1 :]
    moved = _step(lag, before, after)
    scatter = 1.4826 * float(np.median(np.abs(np.diff(found)))) / np.sqrt(2.0)
    sure = SIGNIFICANT * scatter * np.sqrt(1.0 / before.size + 1.0 / after.size)
    line = np.polynomial.Polynomial.fit(np.arange(n), found, 1)(np.arange(n))
    clear = np.min(left) < STEP_OVER_LINE * np.sum((found - line) ** 2)
    if abs(moved) < max(least, sure) or not clear or not _shift_alone(rows, before, after, moved):
        return None
    return lost, moved


def _squares(values: Array, begin: Integers | int, end: Integers | int) -> Array:
    """Return the sums of squares about the mean of stretches of values."""
    sums, squares = (np.r_[0.0, np.cumsum(item)] for item in (values, values**2))
    total = sums[end] - sums[begin]
    return np.asarray(squares[end] - squares[begin] - total**2 / (np.asarray(end) - begin))


def _drift(rows: Array, sound: Integers, lag: Array, time: Array, least: float) -> float:
    """Return by how much a channel wanders as one clock against another [rad/s], 0 where it does not."""
    if sound.size < FEWEST:
        return 0.0
    line = robust_line(time[sound], lag[sound])
    span, third = float(np.ptp(time[sound])), max(1, sound.size // 3)
    if abs(line.slope) * span < least or abs(line.slope) < SIGNIFICANT * line.stderr_slope:
        return 0.0
    ends = sound[:third], sound[-third:]
    moved = line.slope * float(np.mean(time[ends[1]]) - np.mean(time[ends[0]]))
    return line.slope if _shift_alone(rows, *ends, moved) else 0.0


def _shift_alone(rows: Array, before: Integers, after: Integers, moved: float) -> bool:
    """Return whether the mean cycles of two groups differ by a shift alone."""
    one, other = (np.mean(rows[group[:: -(-group.size // SAMPLED_CYCLES)]], axis=0) for group in (before, after))
    one, other = one - np.mean(one), other - np.mean(other)
    plain, shifted = (float(np.sum((turned - one) ** 2)) for turned in (other, _turned(other, -moved)))
    return shifted < SHIFTED_OVER_PLAIN**2 * plain


def _turned(row: Array, angle: Array | float) -> Array:
    """Return cycles (..., n_theta) that come later by angles [rad]."""
    spectrum = np.fft.rfft(row)
    delayed = np.exp(-1j * np.arange(spectrum.shape[-1]) * np.asarray(angle)[..., None])
    return np.asarray(np.fft.irfft(spectrum * delayed, row.shape[-1]))


def _step(lag: Array, before: Integers, after: Integers) -> float:
    """Return by how much later a channel comes in the second of two groups of cycles [rad]."""
    return float(np.median(lag[after]) - np.median(lag[before]))


def _lost(quantities: Sequence[str], moved: float, moment: float, table: CycleTable, first: int) -> Finding:
    """Tell where channels step: all of them against the trigger, or one against it and the others."""
    kept, both, quantity = int(ordinary(table)[:first].sum()), len(quantities) > 1, " and ".join(quantities)
    lost = "log lost samples there or its clock was reset"
    cause = f"the trigger slipped, or its {lost}" if both else f"a {lost}"
    late = short(1e3 * abs(moved) / float(np.median(table.speed)), 3)
    return Finding(
        STEPS[both], "warning",
        f"from {short(moment, 7)} s on the {quantity} come{'s' * (not both)} {short(abs(moved) / DEGREE)} degrees of "
        f"cam angle ({late} ms) {'later' if moved > 0.0 else 'earlier'} than before, a pure shift: {cause}; only the "
        f"{kept} cycles before it are used, "
        f"{'and the nominal angle is theirs' if both else 'where the logs still agree in time'}",
        quantity,
    )  # fmt: skip


def _wandering(wander: Mapping[str, float], turned: float) -> list[Finding]:
    """Tell what wanders while the cam turns by ``turned`` [rad]; what does so alike, once: then the trigger does."""
    halves = list(wander.values())
    alike = len(halves) > 1 and abs(halves[0] - halves[1]) < ALIKE * abs(halves[0])
    told = {" and ".join(wander): halves[0]} if alike else wander
    findings = []
    for names, half in told.items():
        ppm = 2e6 * abs(half) / turned
        clock = f"clocks that differ by {short(ppm, 2)} ppm" if ppm <= 1e6 * LARGEST_SKEW else (
            f"a sample rate {short(1e-4 * ppm, 2)} % off"
        )  # fmt: skip
        text = (
            f"{names} wander{'' if alike else 's'} by {short(2.0 * abs(half) / DEGREE, 2)} degrees of cam angle over "
            f"the recording against the trigger, by a shift alone: {clock}; taken off as if all had started together, "
            'which is unsure by half of that; write clock = "independent" and record the trigger on every logger, or '
            "correct sample_rate_hz"
        )
        findings.append(Finding("clock_wanders", "warning", text, names))
    return findings
