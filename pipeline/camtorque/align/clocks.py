"""Clocks of several loggers: t_logger = offset + (1 + skew) t, t on the clock of the torque's logger.

`single` and `synchronised` loggers share one time base. Of `independent` loggers each has its own offset and drift;
which pulse belongs to which is found from the pattern of pulse periods, never from the start times of the headers.

A clock may jump inside a recording, which shows in pulse periods that no shaft can run: a shaft has inertia, one
revolution cannot differ from both its neighbours while these agree. Where it does, samples were lost or a clock was
set: the revolution is not used, and the ones beside it are not touched by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.align.pulses import PulseTrain
from camtorque.records import Array, ClockFit, Finding, Mask, Recording, Refusal
from camtorque.signal.logger_time import pause_intervals
from camtorque.signal.threshold import Count, Threshold

LEAST_OVERLAP = Threshold(
    0.3, "1", "statistics", "Part of the shorter pulse train that has to overlap for a lag to be tried."
)
LEAST_PULSES = Count(4, "pulses", "statistics", "A line and its scatter need two pulses more than its two parameters.")
STEP_TIMES_SCATTER = Threshold(
    10.0, "1", "statistics",
    "A step of a clock is this many robust scatters of the difference: noise makes none in a long log."
)  # fmt: skip
LEAST_STEP = Threshold(20.0e-6, "s", "simulated rigs", "Steps of a clock smaller than this are edge noise.")
STEP_TIMES_EDGES = Threshold(
    4.0, "1", "statistics",
    "Nor is a step of fewer standard errors of the difference of two edges: where edges are known to one sample, "
    "one that moves on by a sample is 2.4 to 3.5 of them."
)  # fmt: skip
LARGEST_SKEW = Threshold(
    300.0e-6, "1", "physics",
    "Two crystals differ by 10 to 100 ppm; a common difference of the periods beyond this is no drift."
)  # fmt: skip
CLEAR_EVIDENCE = Threshold(
    5.0, "nat", "statistics", "Logarithm of the odds (nats) by which the best lag has to beat the next: 150 to 1."
)
APART_BEFOREHAND = Threshold(
    4.0, "nat", "convention",
    "Loggers of one test are started together: the odds beforehand of a lag that leaves nothing in common."
)  # fmt: skip
STAIRS_FROM, STAIR_FACTOR = 20, 1.5
"""Changes from which on stairs are kept apart from jumps (fewer than one in ten), and height of a jump over a stair."""
LEAST_JUMP = Threshold(
    0.003, "1", "recordings",
    "Relative difference of a period from its neighbours that may be a jump: pumps without a flywheel "
    "change by less from turn to turn."
)  # fmt: skip
NEIGHBOURS_AGREE = Threshold(
    0.25, "1", "convention", "The neighbours differ from each other by less than this part of the jump."
)
TIMES_USUAL = Threshold(
    8.0, "1", "statistics", "And the difference is this many times the usual one from revolution to revolution."
)
EDGE_NOISES = Threshold(
    7.0, "1", "statistics",
    "Difference of neighbouring periods, in standard errors of an edge, that the edges alone can make: "
    "edges known to one sample, q / sqrt(12), move it by up to 2 q."
)  # fmt: skip
TOOTH_NOISES = Threshold(
    10.5, "1", "statistics",
    "The same on a wheel, where each period is held against the usual one of its tooth: that is known to half a "
    "sample, so edges known to one sample move the difference by up to 3 q."
)  # fmt: skip


@dataclass(frozen=True)
class Clock:
    """A logger's clock against that of the reference.

    Attributes
    ----------
    fit : offset, skew and standard error
    stderr_skew : [-]
    residual_std : of one pulse about the line [s]
    lag, evidence : pulse ``i`` of the reference is pulse ``i + lag``; logarithm of the odds against the next best lag
    breaks, steps : reference times at which the clock jumps, and what is added to its time before, between, after [s]
    """

    fit: ClockFit
    stderr_skew: float = 0.0
    residual_std: float = 0.0
    lag: int = 0
    evidence: float = float("inf")
    findings: tuple[Finding, ...] = ()
    breaks: tuple[float, ...] = ()
    steps: tuple[float, ...] = (0.0,)

    def to_reference(self, time: Array) -> Array:
        """Return times of the logger on the clock of the reference [s]."""
        rate = 1.0 + 1e-6 * self.fit.skew_ppm
        borders = self.fit.offset_s + rate * np.array(self.breaks) + 0.5 * (np.array(self.steps[:-1]) + self.steps[1:])
        return (time - self.fit.offset_s - np.array(self.steps)[np.searchsorted(borders, time)]) / rate

    def from_reference(self, time: Array) -> Array:
        """Return times of the reference on the clock of the logger [s]."""
        straight = self.fit.offset_s + (1.0 + 1e-6 * self.fit.skew_ppm) * time
        return straight + np.array(self.steps)[np.searchsorted(self.breaks, time)]


def against(clock: Clock, reference: Clock) -> Clock:
    """Return a clock against another reference, both given against the same third one."""
    rate = (1.0 + 1e-6 * clock.fit.skew_ppm) / (1.0 + 1e-6 * reference.fit.skew_ppm)
    offset = clock.fit.offset_s - rate * reference.fit.offset_s
    stderr = float(np.hypot(clock.fit.stderr_s, reference.fit.stderr_s))
    fit = replace(clock.fit, offset_s=offset, skew_ppm=1e6 * (rate - 1.0), stderr_s=stderr)
    breaks = tuple(float(moment) for moment in reference.from_reference(np.array(clock.breaks)))
    return replace(clock, fit=fit, breaks=breaks)


def same_clock(logger: str, method: str) -> Clock:
    """Return the clock of a logger that shares the reference's time base."""
    return Clock(ClockFit(logger, 0.0, 0.0, 0.0, method))


def best_lag(reference: Array, other: Array, edge_noise: float) -> tuple[int, float, int]:
    """Return lag, evidence and next best lag: ``other[i + lag]`` is the pulse ``reference[i]``.

    The periods of the right lag differ by edge noise only, those of a wrong one by the scatter of the speed too. Of
    the many lags that are tried some look alike by chance, most of all those of few common periods, so that each is
    held against what the periods of two wrong pulses differ by, the median of all lags. Evidence is the logarithm of
    the odds against the next best lag, in nats.

    Parameters
    ----------
    edge_noise : standard error of the difference of two edges, one of each logger [s]
    """
    noise = 2.0 * edge_noise**2
    lags, overlap, found = _lag_trials(np.diff(reference), np.diff(other), noise)
    if len(lags) < 2:
        return (lags[0], 0.0, lags[0]) if lags else (0, 0.0, 0)
    odds = _log_odds(np.array(overlap, dtype=float), np.array(found), noise)
    order = np.argsort(-odds)
    best, rival = (lags[i] for i in order[:2])
    evidence = float(odds[order[0]] - odds[order[1]])
    if evidence >= CLEAR_EVIDENCE:
        return best, evidence, rival
    # Where the pattern does not tell, the lag that lets most pulses overlap loses the fewest cycles.
    chosen = lags[max((i for i in order if odds[order[0]] - odds[i] < CLEAR_EVIDENCE), key=overlap.__getitem__)]
    return chosen, evidence, best if chosen != best else rival


def _lag_trials(period: Array, other_period: Array, noise: float) -> tuple[list[int], list[int], list[float]]:
    """Return all lags at which enough periods overlap, how many do, and the robust mean square of their differences.

    ``noise`` is the variance that edges alone make [s^2].
    """
    shorter = min(period.size, other_period.size)
    least = max(LEAST_PULSES - 1, int(np.ceil(LEAST_OVERLAP * shorter)))
    most = LARGEST_SKEW * float(np.nanmedian(period))
    lags, overlap, found = list[int](), list[int](), list[float]()
    for lag in range(least - period.size, other_period.size - least + 1):
        a = period[max(0, -lag) : other_period.size - lag]
        b = other_period[max(0, lag) : max(0, lag) + a.size]
        difference = a[: b.size] - b
        difference = difference[np.isfinite(difference)]
        if difference.size >= least:
            difference = difference - np.clip(np.median(difference), -most, most)
            lags.append(lag)
            overlap.append(difference.size)
            found.append(_robust_mean_square(difference, noise))
    return lags, overlap, found


def _log_odds(overlap: Array, found: Array, noise: float) -> Array:
    """Return the logarithm of the odds of each lag, (n,) [nat], by what `_lag_trials` returns."""
    # few periods, told to whole samples, are the same by chance; many are not, and show what edges really scatter
    floor = min(noise, float(np.min(found[overlap > 0.7 * np.max(overlap)]))) + 1e-9**2
    ratio = np.maximum(found, floor) / np.median(np.maximum(found, floor))
    alike = 0.5 * overlap * np.where(ratio < 1.0, ratio - 1.0 - np.log(ratio), 0.0)
    return np.asarray(alike - APART_BEFOREHAND * (1.0 - overlap / np.max(overlap)))


def _robust_mean_square(values: Array, noise: float) -> float:
    # edges told to whole samples make most differences nothing and the others a sample: none of these is an outlier
    limit = 5.0 * max(1.4826 * float(np.median(np.abs(values))), float(np.sqrt(noise))) + 1e-12
    return float(np.mean(np.minimum(np.abs(values), limit) ** 2))


def fit_clock(logger: str, reference: Array, other: Array, where: str, edge_noise: float) -> Clock:
    """Return the clock of a logger from the pulses that it and the reference both recorded.

    Parameters
    ----------
    reference, other : pulse times on either clock, one per revolution, nan where a pulse is not proven [s]
    edge_noise : standard error of the difference of two edges, one of each logger [s]

    Raises
    ------
    Refusal : fewer than four common pulses
    """
    lag, evidence, rival = best_lag(reference, other, edge_noise)
    first, stop = max(0, -lag), min(reference.size, other.size - lag)
    a, b = reference[first:stop], other[first + lag : stop + lag]
    good = np.isfinite(a) & np.isfinite(b)
    if good.sum() < LEAST_PULSES:
        raise Refusal(
            f"{where}: found {int(good.sum())} trigger pulses common to both loggers, expected at least "
            f"{LEAST_PULSES}; record the trigger on both loggers for longer"
        )
    a, difference = a[good], (b - a)[good]
    breaks, steps = clock_steps(a, difference, edge_noise)
    line = robust_line(a, difference - np.array(steps)[np.searchsorted(breaks, a)])
    findings = [] if evidence >= CLEAR_EVIDENCE else [_ambiguous(logger, lag, rival, evidence, a.size, where)]
    findings += [_jumped(logger, moment, steps[i + 1] - steps[i], where) for i, moment in enumerate(breaks)]
    stderr = float(np.hypot(line.stderr_middle, line.stderr_slope * np.std(a)))
    fit = ClockFit(logger, line.intercept, 1e6 * line.slope, stderr, "trigger pulses")
    return Clock(fit, line.stderr_slope, line.residual_std, lag, evidence, tuple(findings), breaks, steps)


def clock_steps(time: Array, difference: Array, edge_noise: float = 0.0) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Find lasting steps of the difference of two clocks; ``edge_noise``: standard error of that of two edges [s].

    Returns
    -------
    Times of the steps (middle of the interval), and the sum of the steps before, between and after them [s].
    """
    change = np.diff(difference)
    centred = change - np.median(change)
    limit = max(
        STEP_TIMES_SCATTER * 1.4826 * float(np.median(np.abs(centred))), LEAST_STEP, STEP_TIMES_EDGES * edge_noise
    )
    if change.size >= STAIRS_FROM:
        # Edges within one sample are known to one sample: drift then climbs in stairs of that height, most steps none.
        limit = max(limit, STAIR_FACTOR * float(np.percentile(np.abs(centred), 90.0)))
    breaks, steps = [], [0.0]
    for i in np.flatnonzero(np.abs(centred) > limit):
        drift = np.median(change) * (np.arange(difference.size) - i)
        level = difference - drift
        before, after = level[max(0, i - 3) : i + 1], level[i + 1 : i + 5]
        lasting = float(np.median(after) - np.median(before))
        # A single wrong edge makes two opposite changes and leaves no step behind.
        if abs(lasting) > limit and abs(lasting - centred[i]) < 0.5 * abs(centred[i]):
            breaks.append(float(0.5 * (time[i] + time[i + 1])))
            steps.append(steps[-1] + lasting)
    return tuple(breaks), tuple(steps)


def _jumped(logger: str, moment: float, step: float, where: str) -> Finding:
    text = (
        f"the clock of logger {logger} jumps by {1e3 * step:+.4g} ms against the reference; the cycle there is cut out "
        "and the stretches before and after have their own offset"
    )
    return Finding("clock_jump", "warning", text, f"{where}, near {moment:.7g} s")


def _ambiguous(logger: str, lag: int, rival: int, evidence: float, n_pulses: int, where: str) -> Finding:
    text = (
        f"logger {logger}: the pattern of {n_pulses} pulse periods does not say which pulse belongs to which: a lag of "
        f"{lag} pulses is used, {rival} fits nearly as well or better (logarithm of the odds {evidence:.1f}, "
        f"{CLEAR_EVIDENCE:.0f} wanted); the cam angle is right either way, but torque and pressure of a cycle may "
        "belong to neighbouring revolutions"
    )
    return Finding("clock_lag_ambiguous", "warning", text, where)


@dataclass(frozen=True)
class Line:
    """Robust straight line with its standard errors."""

    intercept: float
    slope: float
    stderr_middle: float
    stderr_slope: float
    residual_std: float


def robust_line(x: Array, y: Array) -> Line:
    """Fit y = intercept + slope x by Tukey's biweight, iterated from the least-squares line."""
    middle = float(np.mean(x))
    u = x - middle
    weights = np.ones(x.size)
    for _ in range(20):
        total = weights.sum()
        mean_u, mean_y = (weights @ u) / total, (weights @ y) / total
        slope = (weights @ ((u - mean_u) * (y - mean_y))) / (weights @ (u - mean_u) ** 2)
        residual = y - mean_y - slope * (u - mean_u)
        scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-12)
        weights = np.clip(1.0 - (residual / (4.685 * scale)) ** 2, 0.0, None) ** 2
    kept: Mask = weights > 0.0
    n = max(3, int(kept.sum()))
    std = float(np.sqrt(np.sum(residual[kept] ** 2) / (n - 2)))
    spread = float(np.sum((u - np.mean(u))[kept] ** 2))
    centre = float(mean_y - slope * mean_u)
    # Tukey's biweight has an efficiency of 95 % for normal noise.
    grow = 1.0 / np.sqrt(0.95)
    stderr_middle, stderr_slope = grow * std / np.sqrt(n), grow * std / np.sqrt(spread)
    return Line(centre - float(slope) * middle, float(slope), stderr_middle, stderr_slope, std)


def mark_jumps(
    train: PulseTrain, clocks: Mapping[str, Clock], recording: Recording, edge_noise: float, n: int
) -> tuple[PulseTrain, tuple[Finding, ...]]:
    """Mark the pulses whose interval holds a jump, of the main trigger, between two clocks or of a file's time.

    ``edge_noise`` [s] is that of one pulse, ``n`` the pulses per turn of the cam.
    """
    jump = _odd_periods(train, n, edge_noise)
    odd = int(jump.sum())
    findings = []
    if odd:
        places = ", ".join(f"{t:.7g} s" for t in train.time[jump][:5])
        text = (
            f"{odd} pulse period{'s differ' if odd > 1 else ' differs'} from both neighbours more than a shaft "
            "can: samples or pulses were lost, or the clock was reset; the cycles there are cut out"
        )
        findings.append(Finding("clock_jump", "warning", text, f"near {places}"))
    for clock in clocks.values():
        for moment in clock.breaks:
            jump[np.clip(np.searchsorted(train.time, moment), 1, jump.size - 1)] = True
    for channel in recording.channels:
        if channel.logger not in clocks:
            continue
        for begin, end in clocks[channel.logger].to_reference(pause_intervals(channel)):
            first, last = np.searchsorted(train.time, (begin, end))
            jump[max(1, first) : last + 1] = True
    return replace(train, jumped=jump), tuple(findings)


def _odd_periods(train: PulseTrain, n: int, edge_noise: float) -> np.ndarray:
    """Flag the pulse at the end of each odd interval; on a wheel, pitch errors repeat and are taken off first."""
    jump = np.zeros(train.time.size, dtype=bool)
    period = np.diff(train.time) / np.maximum(np.diff(train.step), 1)
    if period.size < 5:
        return jump
    quantum = (TOOTH_NOISES if n > 1 else EDGE_NOISES) * edge_noise / np.median(period)
    if n > 1:
        tooth = np.unique(train.step[1:] % n, return_inverse=True)[1]
        period = period / np.array([np.median(period[tooth == k]) for k in range(tooth.max() + 1)])[tooth]
    before, after, here = period[:-2], period[2:], period[1:-1]
    beside = 0.5 * (before + after)
    difference = np.abs(here - beside) / beside
    usual = 1.4826 * np.median(difference)
    agree = np.abs(before - after) / beside < NEIGHBOURS_AGREE * difference
    odd = (difference > max(LEAST_JUMP, TIMES_USUAL * usual, quantum)) & agree
    guessed = train.broken[1:-2] | train.broken[2:-1] | train.broken[3:]  # how many turns such an interval holds
    jump[2:-1] = odd & ~guessed & ~train.repaired[2:-1]
    return jump
