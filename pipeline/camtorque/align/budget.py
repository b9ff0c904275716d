"""Angle error budget before the fit: one row per source, as a standard deviation in degrees of cam angle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.align.flanks import APART_DEG
from camtorque.align.timebase import TimeBase
from camtorque.config import TriggerSpec
from camtorque.records import AngleError, Array, Channel
from camtorque.signal.threshold import Threshold
from camtorque.units import DEGREE

HALF_WIDTH_OF_TYPICAL = Threshold(
    0.5, "1", "convention",
    "A sheet that gives a typical switching delay and no limits: half of it is assumed as half width of its spread."
)  # fmt: skip
RECTANGULAR = 1.0 / np.sqrt(3.0)
"""Standard deviation of a rectangular distribution over its half width."""
RESAMPLING_DEG = Threshold(
    2.0e-4, "deg", "simulated rigs",
    "Largest shift of a known signal by resampling, 5 to 200 kHz and 300 to 1250 rpm; held by a test."
)  # fmt: skip
UNKNOWN = float("nan")
SWITCHING_DELAY = "trigger switching delay"
"""Row of the budget that the fit takes up in the trigger angle."""
WANDERED = {
    "pressure": "wandering of the pressure against the trigger",
    "torque": "wandering of the torque against the pressure",
}
"""Quantity -> row of the budget on its clock."""
TWIST = {
    "cam": "not corrected here: torque over stiffness, in the driveline effect",
    "motor": "the trigger sits on the motor's side: the cam lags its angle by torque over stiffness, in the driveline "
    "effect",
}
"""Side of the trigger -> what is said of the twist."""


def angle_error_budget(
    spec: TriggerSpec,
    channels: Mapping[str, Channel],
    base: TimeBase,
    speed: float,
    speed_change: float,
    torque: Array | None,
) -> tuple[AngleError, ...]:
    """Return the rows of the budget.

    Parameters
    ----------
    channels : those that were aligned
    speed : mean speed of the used cycles [rad/s]
    speed_change : rms relative change of the period from one revolution to the next
    torque : (n_theta,) mean cycle, for what it does to the angle; None without a torque channel
    """
    per_second, edge = float(np.degrees(speed)), base.edge_noise
    mounting = float(np.degrees(spec.installation_tolerance)) * RECTANGULAR
    switching = HALF_WIDTH_OF_TYPICAL * RECTANGULAR * spec.switching_delay
    return (
        AngleError("trigger edge time", edge * per_second,
                   f"{1e6 * edge:.2f} us: noise of the plateaus over the slope of the edge, or one sample"),
        AngleError(SWITCHING_DELAY, switching * per_second,
                   "the sheet gives a typical value without limits; half of it is assumed as half width"),
        AngleError("trigger installation", mounting,
                   "mounting tolerance, the same for all runs of one mounting; fitted on the model side"),
        *(AngleError(f"{quantity} delay", (channel.calibration.delay_std if channel.calibration else 0.0) * per_second,
                     f"declared total delay of the {quantity}, times the speed")
          for quantity, channel in channels.items()),
        *(AngleError(f"clock of logger {clock.fit.logger}", clock.fit.stderr_s * per_second, clock.fit.method)
          for clock in base.clocks.values() if clock.fit.stderr_s > 0.0),
        AngleError("resampling", float(RESAMPLING_DEG),
                   "symmetric kernels shift no angle: largest shift found against known signals, 5 to 200 kHz"),
        *_between_pulses(base, speed_change, ripple_text(spec, torque, speed)),
        *_wheel(base),
        AngleError("shaft twist", UNKNOWN, TWIST[spec.side]),
    )  # fmt: skip


def wandered(wander: Mapping[str, float]) -> tuple[AngleError, ...]:
    """Return the rows of channels that wandered; ``wander``: quantity -> half of that, signed [rad]."""
    if not wander:
        return ()
    pressure = wander.get("pressure", 0.0)
    text = "half of the drift over the recording: that the clocks were together at its beginning is supposed"
    halves = {"pressure": pressure, "torque": wander.get("torque", 0.0) - pressure}
    return tuple(AngleError(WANDERED[quantity], abs(half) / DEGREE, text) for quantity, half in halves.items())


def wandered_std(errors: tuple[AngleError, ...], quantity: str) -> float:
    """Return the standard uncertainty that wandering leaves [rad], 0 where nothing wandered; see `WANDERED`."""
    return next((row.std_deg * DEGREE for row in errors if row.source == WANDERED[quantity]), 0.0)


def _between_pulses(base: TimeBase, speed_change: float, unseen: str) -> tuple[AngleError, ...]:
    """Speed between pulses: what changes from revolution to revolution is bounded, what repeats is not seen.

    A speed that changes linearly by the relative amount c over a pulse interval of angle a is off by at most c a / 8 in
    its middle; at a tooth wheel the interval is a tooth.
    """
    n = base.pulses_per_cycle
    change = AngleError(
        "speed change between pulses",
        speed_change / n * 360.0 / n / 8.0,
        "bound from the change of the period from one revolution to the next",
    )
    return (change, AngleError("speed ripple within a revolution", UNKNOWN, unseen)) if n == 1 else (change,)


def _wheel(base: TimeBase) -> tuple[AngleError, ...]:
    """Rows of a wheel: where its teeth are, where its index is, and what one wheel cannot see."""
    n, places = base.pulses_per_cycle, base.places
    text = "spread of the index among the teeth, or one count"
    index = (AngleError("place of the index", np.degrees(base.index_std), text),) if base.index_std > 0.0 else ()
    if n == 1:
        return index
    if places is None:
        unknown = "too few whole turns to tell the places of the teeth from the speed"
        return (*index, AngleError("places of the teeth", UNKNOWN, unknown))
    std = float(np.degrees(np.sqrt(np.mean(places.place_std**2))))
    text = (
        f"teeth are {np.degrees(places.tooth_std):.2g} degrees off their places (from {places.turns} turns); what "
        "could as well be the speed remains"
    )
    centre = (
        "a wheel off its centre by 0.1 % of its radius reads as a speed ripple of order 1 that moves the angle by "
        "0.06 degrees; one wheel at one speed cannot tell"
    )
    return (*index, AngleError("places of the teeth", std, text), AngleError("wheel off its centre", UNKNOWN, centre))


def ripple_text(spec: TriggerSpec, torque: Array | None, speed: float) -> str:
    """Return how large an angle error the speed within the revolution can hide, from what is known of it.

    The torque slows the drive: with the drive's inertia J the angle moves by a double integral of the torque over J
    (`angle_correction`); J is not on the sheet, so its product with the angle is given.
    """
    text = (
        "one pulse per revolution does not show how the speed varies within it: 1 % ripple of order n moves the cam "
        "angle by 0.57 / n degrees"
    )
    if torque is not None:
        moved = np.degrees(np.max(np.abs(angle_correction(torque, speed, spec.nominal_angle, inertia=1.0))))
        text += f"; the measured torque moves it by 1 degree at most on a drive of {moved:.2g} kg m^2, less on heavier"
    return text + (
        "; the fitted driveline rebuilds it from the torque; a warning is given where it moves the two "
        f"spring flanks more than {APART_DEG['spring']:g} degrees apart, or spring and delivery {APART_DEG['all']:g} "
        "degrees"
    )


def angle_correction(torque: Array, speed: float, trigger_angle: float, inertia: float) -> Array:
    """Return what has to be added to the nominal cam angle, which supposes constant speed between two pulses.

    It is for this budget, and for those who know the drive's inertia; the nominal alignment does not use it. The torque
    slows the drive:

        correction(theta) = c(theta) - c(trigger angle),  c = -1 / J  integral integral (T - mean T) dt dt

    with the double integral over a periodic torque taken harmonic by harmonic, T_k / (i k omega)^2.

    Parameters
    ----------
    torque : (n_theta,) delay-corrected torque at uniform nominal angles from 0, end point excluded [N m]
    speed : mean cam speed [rad/s]
    trigger_angle : nominal cam angle of the pulse, where the correction is zero [rad]
    inertia : of the drive's side, J [kg m^2]

    Returns
    -------
    (n_theta,) [rad]
    """
    harmonics = np.fft.rfft(torque)
    order = np.arange(harmonics.size)
    inverse_square = np.zeros(harmonics.size)
    inverse_square[1:] = 1.0 / (order[1:] * speed) ** 2
    correction = harmonics * inverse_square / inertia
    at_trigger = np.fft.irfft(correction * np.exp(1j * order * trigger_angle), torque.size)[0]
    return np.fft.irfft(correction, torque.size) - at_trigger
