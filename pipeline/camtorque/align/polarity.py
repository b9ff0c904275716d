"""Inverted torque is turned with a finding; swapped torque and pressure are refused.

Both are seen without a model: the torque of a pump follows line pressure times lift velocity, the pressure does not
follow torque times lift velocity; a torque swings to both sides or rests near zero on the base circle, a gauge
pressure stays above zero and keeps a residual there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from camtorque.align.quality import spread_choice
from camtorque.records import Array, CamTable, Channel, Finding, Mask, Recording, Refusal
from camtorque.signal.marks import repeats_every, uneven_marks
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import BAR, TURN, angle_grid

INVERTED_CORRELATION = Threshold(
    -0.3, "1", "simulated rigs",
    "Torque against pressure times lift velocity below which the torque is read with the wrong sign."
)  # fmt: skip
SWAPPED_CORRELATION = Threshold(
    0.5, "1", "simulated rigs",
    "Torque and pressure that follow each other less than this are not each other's, but something else."
)  # fmt: skip
LEAST_SWING = Threshold(
    4.0, "1", "statistics",
    "A channel that follows the cam swings by more than this many times its scatter from cycle to cycle."
)  # fmt: skip
LEAST_SWING_OF_MANY = Threshold(
    12.0, "1", "statistics",
    "The same for many cycles, over the root of their number: the median of n cycles of noise alone swings by 9 there."
)  # fmt: skip
STILL = Threshold(
    1.0e-4, "1", "convention",
    "Nor does a channel follow the cam that moves by less than this part of its sensor's range."
)  # fmt: skip
TENSION = Threshold(
    -0.04, "1", "physics",
    "A pressure below this part of its peak is no pressure of a liquid: zero drift is 0.15 % of the range."
)  # fmt: skip
REST_FACTOR = Threshold(
    1.3, "1", "simulated rigs",
    "On the base circle a line pressure keeps this much more of its peak than a torque, at least."
)  # fmt: skip
DWELL_LIFT_VELOCITY = Threshold(
    0.05, "1", "convention", "Part of the largest lift velocity below which the follower stands still."
)
SAME_STROKE = Threshold(0.97, "1", "simulated rigs", "Correlation of the torque with itself a part of a turn on.")
MOST_STROKES = Count(4, "1", "convention", "Strokes looked for in what the pulses call a revolution.")
NEVER_NEGATIVE = Threshold(
    0.03, "1", "simulated rigs",
    "Torque below its rest, over its peak, down to which it is never negative: 43 of 44 sound recordings go lower."
)  # fmt: skip
DRIVES_BACK = Threshold(
    0.1, "1", "simulated rigs",
    "Torque above its rest on the falling lift over that on the rising one from which a torque that is never negative "
    "has lost its sign: the one sound recording has none, 21 of the 44 without sign have more."
)  # fmt: skip
COARSE_GRID = 720
COMPARED = 200
"""Cycles that are compared with their neighbours, at most."""


def check_quantities(
    rows: Mapping[str, Array], sound: Mask, recording: Recording, pulses: Array
) -> tuple[dict[str, Array], tuple[Finding, ...]]:
    """Turn an inverted torque in place and return the typical cycles on the coarse grid and the findings.

    There are no typical cycles without sound ones; the torque in them is positive when driving.

    Parameters
    ----------
    rows : quantity -> (n_cycles, n_theta)
    sound : (n_cycles,) complete cycles without missing samples
    pulses : (n,) times of the pulses [s]

    Raises
    ------
    Refusal : a channel does not follow the cam; the data of torque and pressure look like each other's
    """
    if not sound.any() or not rows:
        return {}, ()
    stride = max(1, next(iter(rows.values())).shape[1] // COARSE_GRID)
    repeating = _repeating(next(iter(rows.values())), sound, stride, recording, pulses)
    ask = partial(_what_to_check, recording, pulses)
    typical = {
        quantity: _typical(values, sound, stride, recording.of(quantity)[0], repeating, ask)
        for quantity, values in rows.items()
    }
    if len(typical) < 2 or recording.lift_table is None:
        return typical, repeating
    torque, pressure = typical["torque"], typical["pressure"]
    velocity = lift_velocity(recording.cam_table, rows["torque"].shape[1])[::stride]
    repeating = (*repeating, *_strokes(torque, velocity, recording))
    _refuse_swapped(torque, pressure, velocity, recording.config.id)
    straight = correlation(torque, np.maximum(pressure, 0.0) * velocity)
    # A pump takes work over a revolution: where it does, a torque against the lift is a cam that stands wrong.
    work = float(np.mean(torque) - at_rest(torque, velocity))
    if straight > INVERTED_CORRELATION or work > 0.0:
        return typical, (*repeating, *_unsigned(torque, velocity))
    rows["torque"][...] *= -1.0
    return {**typical, "torque": -torque}, (*repeating, _turned(recording, float(np.mean(torque)), straight))


def _repeating(rows: Array, sound: Mask, stride: int, recording: Recording, pulses: Array) -> tuple[Finding, ...]:
    """Tell revolutions that are alike only some turns apart: the pulses come from a faster shaft than the cam."""
    some = np.where(sound[:COMPARED, None], rows[:COMPARED, ::stride], np.nan)
    every = repeats_every(some)
    if every == 1:
        return ()
    trigger = recording.config.trigger
    now = trigger.revolutions_per_cycle
    marks = uneven_marks(pulses) if trigger.pulses_per_rev == 1 else ""
    why = marks or (
        f"where the pulses come from a shaft that turns {every * now} times per turn of the cam, or from "
        f"{every * now} even marks on it, write revolutions_per_cycle = {every * now} under [trigger] (it is {now})"
    )
    text = f"a revolution is like the one {every} later, not like the next: {why}"
    return (Finding("revolutions_alternate", "error", text, f"{recording.config.path.name} [trigger]"),)


def _strokes(torque: Array, velocity: Array, recording: Recording) -> tuple[Finding, ...]:
    """Tell a revolution that holds the torque several times where the lift table rises once: pulses are missing."""
    for n in range(MOST_STROKES, 1, -1):
        turned = [np.roll(curve, curve.size // n) for curve in (torque, velocity)]
        if correlation(torque, turned[0]) > SAME_STROKE and correlation(velocity, turned[1]) < 0.5:
            text = (
                f"a revolution by the pulses holds the same torque {n} times, the lift table rises once: {n - 1} "
                f"of {n} pulses are missing, or the lift table lacks lobes; check the sensor's gap and its pulses, or "
                "give the whole lift table"
            )
            return (Finding("several_strokes", "error", text, f"{recording.config.path.name} [trigger]"),)
    return ()


def _unsigned(torque: Array, velocity: Array) -> tuple[Finding, ...]:
    """Tell a torque that drives the cam while its lift falls and is never negative: its sign was lost."""
    above = torque - at_rest(torque, velocity)
    rising, falling = (float(np.sum(above[(side * velocity > 0.0) & (above > 0.0)])) for side in (1.0, -1.0))
    if np.min(above) < -NEVER_NEGATIVE * np.max(above) or falling < DRIVES_BACK * rising:
        return ()
    text = (
        f"the torque is never negative and {100.0 * falling / (rising + falling):.0f} % of it drives the cam where "
        "the lift falls, where spring and pressure push it back: the sign was lost (a display or logger that stores "
        "the size alone); record the torque with its sign"
    )
    return (Finding("torque_unsigned", "error", text, "torque"),)


def _turned(recording: Recording, mean: float, straight: float) -> Finding:
    declared = "positive" if recording.config.rotation > 0 else "negative"
    text = (
        f"the torque reads {mean:+.2f} N m on average and falls while the pressure resists the rising lift "
        f"(correlation {straight:+.2f}): its sign was reversed, positive drives the pump; either the transducer is "
        f'wired the other way, or rotation = "{declared}" is wrong, which also turns the side forces of a follower '
        "with an offset"
    )
    return Finding("torque_inverted", "warning", text, recording.of("torque")[0].name)


def at_rest(torque: Array, velocity: Array) -> float:
    """Return the median torque while the follower stands still, else over the whole revolution [N m]."""
    rest = np.abs(velocity) < DWELL_LIFT_VELOCITY * np.max(np.abs(velocity))
    return float(np.median(torque[rest] if rest.any() else torque))


def lift_velocity(table: CamTable, n_theta: int) -> Array:
    """Return dy/dtheta of the lift table on the angle grid by central differences [m/rad]."""
    theta, lift = table.theta, table.lift
    slope = np.gradient(np.r_[lift[-1], lift, lift[0]], np.r_[theta[-1] - TURN, theta, theta[0] + TURN])[1:-1]
    return np.interp(angle_grid(n_theta), theta, slope, period=TURN)


def _what_to_check(recording: Recording, pulses: Array) -> str:
    """Return what to do about channels that do not follow the cam: a wheel of many teeth may be taken for one pulse."""
    trigger, period = recording.config.trigger, float(np.median(np.diff(pulses)))
    teeth = round(TURN / period / recording.config.nominal_speed / trigger.revolutions_per_cycle)
    if trigger.pulses_per_rev > 1 or teeth < 2:
        return "check the sensor, its cable, the supply and the channel's name"
    return (
        f"the pulses come {teeth} times as often as the nominal speed turns the cam: where they are those of a wheel "
        f"of about {teeth} teeth, write their number as pulses_per_rev under [trigger]"
    )


def _typical(
    rows: Array, sound: Mask, stride: int, channel: Channel, repeating: tuple[Finding, ...], ask: Callable[[], str]
) -> Array:
    """Return the median of some cycles on a coarser grid; it has to stand out of their scatter."""
    some = rows[spread_choice(sound), ::stride]
    middle = np.median(some, axis=0)
    apart = some - middle
    apart -= np.mean(apart, axis=1, keepdims=True)  # a level that wanders from cycle to cycle hides no shape
    swing, scatter = float(np.ptp(middle)), 1.4826 * float(np.median(np.abs(apart)))
    calibration = channel.calibration
    least = STILL * (calibration.range_max - calibration.range_min) if calibration else 0.0
    times = LEAST_SWING if repeating else min(LEAST_SWING, LEAST_SWING_OF_MANY / np.sqrt(some.shape[0]))
    if swing > max(times * scatter, least):
        return middle
    if repeating:
        raise Refusal(f"{channel.where}: {repeating[0].text}")
    still = float(np.mean(np.ptp(some, axis=1) <= 1e-3 * least))
    if 0.0 < still < 1.0:
        raise Refusal(
            f"{channel.where}: the {channel.quantity} stands still in "
            f"{100.0 * still:.0f} % of the cycles, expected in few: sensor, cable or amplifier failed during the "
            "recording; cut the log there, or record again"
        )
    unit, size = {"torque": ("N m", 1.0), "pressure": ("bar", BAR)}[channel.quantity]
    reason = (
        f"while single cycles scatter by {scatter / size:.3g} {unit}, expected at least {times:.2g} times that"
        if times * scatter > least
        else f"expected at least {least / size:.3g} {unit}, a ten-thousandth of the sensor's range"
    )
    raise Refusal(
        f"{channel.where}: the {channel.quantity} does not follow the cam: the mean "
        f"cycle swings by {swing / size:.3g} {unit}, {reason}; {ask()}"
    )


def correlation(a: Array, b: Array) -> float:
    """Return the correlation of two signals, 0 where one of them is constant."""
    return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0.0 and np.ptp(b) > 0.0 else 0.0


def _refuse_swapped(torque: Array, pressure: Array, velocity: Array, name: str) -> None:
    straight = abs(correlation(torque, pressure * velocity))
    swapped = abs(correlation(pressure, torque * velocity))
    dwell = np.abs(velocity) < DWELL_LIFT_VELOCITY * np.max(np.abs(velocity))
    rest = [abs(float(np.median(signal[dwell]))) / np.max(np.abs(signal)) for signal in (torque, pressure)]
    as_pressure, lowest = (float(signal.min()) / np.max(np.abs(signal)) for signal in (torque, pressure))
    impossible = lowest <= TENSION < as_pressure  # as named, and the other way round
    if swapped < max(straight, SWAPPED_CORRELATION) or not impossible or rest[0] < REST_FACTOR * rest[1]:
        return
    raise Refusal(
        f"{name}: torque and pressure are swapped: the channel named pressure goes down to {100 * lowest:.0f} % of its "
        f"peak and rests at {100 * rest[1]:.0f} % on the base circle like a torque, the one named torque rests at "
        f"{100 * rest[0]:.0f} % like a line pressure (correlation {swapped:.2f} swapped, {straight:.2f} as named); "
        "exchange the two in [[channels]]"
    )
