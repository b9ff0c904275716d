"""Does the declared cam stand where torque and pressure say? Wrong direction, wrong trigger angle, uneven running.

A pump takes its torque while its lift rises, and on the base circle and near it only the spring is left. So three
places of the measured mean cycle can be laid on the lift table by themselves: the start of the rise and the end of the
return by the torque of the spring, the delivery by torque against pressure times lift velocity. A wrong trigger angle
moves all three alike; a speed that varies within the revolution, which one pulse per revolution cannot see, moves them
apart; a table read against the direction of running has its rise where no torque is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camtorque.align.polarity import at_rest, lift_velocity
from camtorque.config import PumpData
from camtorque.records import Array, CamTable, Finding, Mask, Recording, Refusal
from camtorque.signal.threshold import Threshold
from camtorque.units import angle_grid

APART_DEG = {
    "spring": Threshold(
        3.5, "deg", "simulated rigs",
        "Sound rigs (20 families at 400 and 1100 rpm) and five recordings put the two places of the spring up to 1.9 "
        "degrees apart, two of 40 rigs of other makers 3.6 and 3.9.",
    ),
    "all": Threshold(
        9.5, "deg", "simulated rigs",
        "The same rigs put all three up to 5.4 degrees apart, three of 68 rigs of other makers 7.2 to 8.9: the chamber "
        "behind the delivery valve moves the delivery, and a shaft that rings after a spill.",
    ),
}  # fmt: skip
"""Places -> distance that sound rigs stay below."""
ALIKE_DEG = Threshold(
    5.0, "deg", "simulated rigs", "The same rigs move all places together by up to 1.7 degrees, mounting included."
)
LOCAL_DEG = Threshold(15.0, "deg", "convention", "Shift within which one place is looked for.")
STEP_DEG = 0.1
NEAR_BASE = (0.005, 0.12)
"""Lift over full lift where the spring's torque shows and the pressure does not."""
QUIET = Threshold(
    0.01, "1", "simulated rigs",
    "Pressure above its rest, over its swing, up to which a place belongs to the spring alone."
)  # fmt: skip
FEED_PRESSURE = Threshold(
    3.0e5, "Pa", "physics",
    "Feed pumps hold 2 to 5 bar; beside the spring the difference moves a place by half a degree."
)  # fmt: skip
SMOOTH_DEG = 4.0
"""Rounded lift tables have a noisy second derivative."""
CLEAR_DELIVERY = Threshold(0.8, "1", "simulated rigs", "Correlation from which the delivery says where it lies.")
RESIDUAL = Threshold(
    8.0, "1", "simulated rigs",
    "Force of the pressure that a line rests at, over the preload: the chamber rises to it and the line tells nothing."
)  # fmt: skip
MISFIT = Threshold(
    0.35, "1", "simulated rigs", "A place whose torque is not the spring's to this share of it says nothing."
)
FLAT = Threshold(0.0025, "1", "simulated rigs", "A delivery that follows its nominal place as well lies there.")
DELIVERY = "delivery"
AGREE_DEG = Threshold(
    1.6, "deg", "simulated rigs",
    "Places of the delivery with and without what the line keeps after it differ by up to 1.5 degrees on 80 rigs of "
    "other makers, by 4.5 and more where a spill leaves the line to an orifice."
)  # fmt: skip
CLEAR_TORQUE = Threshold(
    0.1, "1", "simulated rigs", "Part of the peak above which torque drives the pump, not friction or noise."
)
RISING_SHARE = Threshold(
    0.5, "1", "simulated rigs", "Of the driving torque of sound rigs, 96 % and more falls on the rising lift."
)
BETTER = Threshold(
    0.3, "1", "simulated rigs",
    "Gain in correlation by which another place or direction has to explain a torque that misses the rising lift."
)  # fmt: skip
FAR_BETTER = Threshold(
    0.2, "1", "simulated rigs",
    "The same gain where all torque falls on the rising lift: of 53 sound rigs of three makers none gains 0.14."
)  # fmt: skip
EXPLAINS = Threshold(
    0.6, "1", "simulated rigs",
    "Correlation from which a place explains the torque; sound rigs reach 0.8. A hub that rings at a low order of the "
    "speed leaves none."
)  # fmt: skip
TELLS = Threshold(0.02, "1", "simulated rigs", "Correlations closer than this do not tell the two directions apart.")


@dataclass(frozen=True)
class Turned:
    """Best cam angle of the lift table in one direction: shift to be added to the angle [rad], correlation there."""

    shift: float
    correlation: float


@dataclass(frozen=True)
class Flanks:
    """Where torque and pressure place the lift table, as shifts to be added to the nominal cam angle.

    Attributes
    ----------
    places : name -> shift [rad], of those places that say anything
    rising_share : part of the driving torque that falls on the rising lift
    nominal_correlation : of torque with pressure times lift velocity as declared
    forward, mirrored : best place of the table as declared, and read against the direction of running
    mirrored_near : correlation of the mirrored table within `ALIKE_DEG` of its nominal place
    torque_late : by what angle the torque alone comes later than pressure times lift velocity as declared
    """

    places: Mapping[str, float]
    rising_share: float
    nominal_correlation: float
    forward: Turned
    mirrored: Turned
    mirrored_near: float
    torque_late: Turned

    @property
    def apart(self) -> float:
        """Largest distance of two places that is more than sound pumps show [rad], 0 where there is none."""
        spring = [shift for name, shift in self.places.items() if name != DELIVERY]
        found = {"spring": spring, "all": list(self.places.values())}
        wide = [
            np.ptp(shifts) for kind, shifts in found.items() if shifts and np.degrees(np.ptp(shifts)) > APART_DEG[kind]
        ]
        return float(max(wide, default=0.0))


def check_flanks(typical: Mapping[str, Array], recording: Recording, speed: float) -> tuple[Finding, ...]:
    """Return findings on the cam angle from the typical cycle of torque and pressure, uniform over one revolution.

    Raises
    ------
    Refusal : the torque falls where the declared lift does not rise, and another place or direction of the table
        explains it
    """
    if not {"torque", "pressure"} <= set(typical) or recording.lift_table is None:
        return ()
    found = flank_places(typical["torque"], typical["pressure"], recording.cam_table, recording.config.pump, speed)
    _refuse_misplaced(found, recording, speed)
    where = recording.config.id
    return (*_scattered(found, where), *_moved(found, recording, where), *_untold(found, where))


def flank_places(torque: Array, pressure: Array, table: CamTable, pump: PumpData, speed: float) -> Flanks:
    """Return where the typical cycle places the lift table; ``speed`` is that of the cam [rad/s]."""
    n = torque.size
    slope = lift_velocity(table, n)
    lift = table.at(angle_grid(n))
    base = at_rest(torque, slope)
    drive, line = torque - base, np.maximum(pressure, 0.0)
    # as declared, and read against the direction of running
    scores = [_correlations(drive, line, values) for values in (slope, np.roll(-slope[::-1], 1))]
    near = np.r_[0 : _steps(n, ALIKE_DEG) + 1, n - _steps(n, ALIKE_DEG) : n]
    places = {
        name: shift for name, shift in _spring_places(drive, pressure, (lift, slope), pump, speed) if shift is not None
    }
    # behind a valve that has closed, before an orifice, a line keeps its pressure long after a spill: a chamber that
    # presses takes torque
    driven = drive > CLEAR_TORQUE * np.max(drive)
    chamber = np.where(driven, line, np.minimum(line, np.percentile(line, 10)))
    by_line, by_chamber = map(_local_best, (scores[0], _correlations(drive, chamber, slope)))
    if by_line is not None and by_chamber is not None and abs(by_line - by_chamber) <= np.deg2rad(AGREE_DEG):
        places[DELIVERY] = by_line
    strong = np.where(driven, drive, 0.0)
    return Flanks(
        places=places,
        rising_share=float(strong[slope > 0.0].sum() / max(strong.sum(), 1e-300)),
        nominal_correlation=float(scores[0][0]),
        forward=_best(scores[0]),
        mirrored=_best(scores[1]),
        mirrored_near=float(np.max(scores[1][near])),
        torque_late=_best(_correlations(line * slope, np.ones(n), drive)),
    )


def _steps(n: int, degrees: float) -> int:
    return round(degrees * n / 360.0)


def _correlations(drive: Array, line: Array, slope: Array) -> Array:
    """Return the correlation of torque with pressure times lift velocity, for every shift of the table (n,).

    Shift k reads the table k steps further on. The three sums of a correlation are circular convolutions.
    """
    n = drive.size

    def over_shifts(signal: Array, table: Array) -> Array:
        return np.fft.irfft(np.conj(np.fft.rfft(signal)) * np.fft.rfft(table), n)

    centred = drive - np.mean(drive)
    product, mean = over_shifts(centred * line, slope), over_shifts(line, slope) / n
    variance = over_shifts(line**2, slope**2) / n - mean**2
    scale = np.sqrt(np.mean(centred**2) * np.maximum(variance, 1e-12 * np.max(variance)))
    return product / n / np.maximum(scale, 1e-300)


def _signed(step: int, n: int) -> float:
    return ((step + n // 2) % n - n // 2) * 2.0 * np.pi / n


def _best(scores: Array) -> Turned:
    place = int(np.argmax(scores))
    return Turned(_signed(place, scores.size), float(scores[place]))


def _local_best(scores: Array) -> float | None:
    """Return the best shift within `LOCAL_DEG` [rad], None where it lies at the border or is no better than none."""
    reach = _steps(scores.size, LOCAL_DEG)
    near = np.roll(scores, reach)[: 2 * reach + 1]
    place = int(np.argmax(near))
    clear = 0 < place < 2 * reach and near[place] >= max(float(CLEAR_DELIVERY), scores[0] + FLAT)
    return _signed(place - reach, scores.size) if clear else None


def _spring_places(
    drive: Array, pressure: Array, motion: tuple[Array, Array], pump: PumpData, speed: float
) -> list[tuple[str, float | None]]:
    """Return the shift of the start of the rise and of the end of the return, by spring, feed pressure and inertia."""
    lift, slope = motion
    part, rest = lift / np.max(lift), float(np.percentile(pressure, 10))
    low = (part > NEAR_BASE[0]) & (part < NEAR_BASE[1])
    quiet = pressure - rest < QUIET * np.ptp(pressure)
    force = pump.spring_preload + pump.spring_stiffness * lift + pump.plunger_area * FEED_PRESSURE
    spring = (force + pump.follower_mass * speed**2 * _second(slope)) * slope
    quiet &= rest * pump.plunger_area < RESIDUAL * pump.spring_preload
    return [
        ("start of the rise", _spring_shift(drive, spring, low & (slope > 0.0) & quiet)),
        ("end of the return", _spring_shift(drive, spring, low & (slope < 0.0))),
    ]


def _second(slope: Array) -> Array:
    """Return the derivative of the lift velocity over the angle [m/rad^2], averaged over `SMOOTH_DEG`."""
    reach = max(1, _steps(slope.size, 0.5 * SMOOTH_DEG))
    return (np.roll(slope, -reach) - np.roll(slope, reach)) / (2.0 * reach * 2.0 * np.pi / slope.size)


def _spring_shift(drive: Array, spring: Array, places: Mask) -> float | None:
    """Return the shift that lays the spring's torque on the measured one [rad], None where it does not fit."""
    if np.count_nonzero(places) < 4:
        return None
    n = drive.size
    theta = angle_grid(n)
    shifts = np.deg2rad(np.arange(-LOCAL_DEG, LOCAL_DEG + 0.5 * STEP_DEG, STEP_DEG))
    at = theta[places][None, :] + shifts[:, None]
    misfit = np.sqrt(np.mean((drive[places] - np.interp(at, theta, spring, period=2.0 * np.pi)) ** 2, axis=1))
    place = int(np.argmin(misfit))
    size = float(np.sqrt(np.mean(drive[places] ** 2)))
    fits = 0 < place < shifts.size - 1 and misfit[place] < MISFIT * size
    return float(shifts[place]) if fits else None


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):+.1f}"


def _refuse_misplaced(found: Flanks, recording: Recording, speed: float) -> None:
    best, late = max(found.forward, found.mirrored, key=lambda item: item.correlation), found.torque_late
    least = max(found.nominal_correlation + BETTER, EXPLAINS)
    if found.rising_share >= RISING_SHARE or best.correlation < least:
        return
    spec = recording.config.trigger
    delayed = "" if late.correlation < best.correlation or late.shift < 0.0 else (
        f"; or it is the torque alone that comes {1e3 * late.shift / speed:.2f} ms later (correlation "
        f"{late.correlation:.2f}), as by telemetry: group_delay_s of its sheet, or start_time_s of its channel"
    )  # fmt: skip
    raise Refusal(
        f"{recording.config.id}: {100.0 * (1.0 - found.rising_share):.0f} % of the driving torque falls where the "
        "declared lift does not rise, expected next to none; torque follows pressure times lift velocity with the cam "
        f"angle moved by {_degrees(found.forward.shift)} degrees (correlation {found.forward.correlation:.2f}), or by "
        f"{_degrees(found.mirrored.shift)} degrees with the lift table read against the direction of running "
        f"({found.mirrored.correlation:.2f}), as declared {found.nominal_correlation:.2f}; correct the direction of "
        f"the lift table and of rotation, or nominal_angle_deg = {np.degrees(spec.stated_angle):g} of the trigger"
        f"{_starts(recording)}{delayed}"
    )


def _starts(recording: Recording) -> str:
    """Return what else may be wrong where the channels lie in several files, empty where they lie in one."""
    measured = ("torque", "pressure", "trigger")
    files = sorted({channel.path.name for name in measured for channel in recording.of(name)[:1]})
    return f", or the starts of {', '.join(files)}, which have to count from one moment" if len(files) > 1 else ""


def _scattered(found: Flanks, where: str) -> tuple[Finding, ...]:
    """Return a warning where the torque misses the rising lift and no other place of the table explains it."""
    if found.rising_share >= RISING_SHARE:
        return ()
    text = (
        f"{100.0 * (1.0 - found.rising_share):.0f} % of the driving torque falls where the lift does not rise, and no "
        f"other place or direction of the table explains it (correlations up to "
        f"{max(found.forward.correlation, found.mirrored.correlation):.2f}): something rings or swings more than the "
        "pump takes, or the log is not of this pump"
    )
    return (Finding("torque_misses_rise", "warning", text, where),)


def _moved(found: Flanks, recording: Recording, where: str) -> tuple[Finding, ...]:
    listed = ", ".join(f"{name} {_degrees(shift)}" for name, shift in found.places.items())
    spec = recording.config.trigger
    if found.apart and spec.pulses_per_cycle == 1:
        text = (
            f"torque and pressure place parts of the lift table {np.degrees(found.apart):.1f} degrees apart ({listed} "
            f"degrees of cam angle; sound pumps stay below {APART_DEG['spring']:g} for the spring and "
            f"{APART_DEG['all']:g} with the delivery): the speed varies within the revolution, which one pulse per "
            f"revolution cannot see (a ripple of about {100.0 * found.apart:.0f} % of order 2 would do it), or the "
            "lift table is of another cam; the cam angle is wrong by about half of that; record a tooth wheel"
        )
        return (Finding("uneven_running", "warning", text, where),)
    gained = found.forward.correlation - found.nominal_correlation
    limit = np.deg2rad(ALIKE_DEG) + spec.installation_tolerance  # the sheet's own tolerance is in no doubt
    if gained > FAR_BETTER and abs(found.forward.shift) > max(np.deg2rad(LOCAL_DEG), limit):
        text = (
            f"torque follows pressure times lift velocity far better with the cam angle moved by "
            f"{_degrees(found.forward.shift)} degrees (correlation {found.forward.correlation:.2f}, as declared "
            f"{found.nominal_correlation:.2f}): check nominal_angle_deg = {np.degrees(spec.stated_angle):g} of the "
            f"trigger, and the tooth that it stands for{_starts(recording)}"
        )
        return (Finding("trigger_far_off", "warning", text, where),)
    if len(found.places) > 1 and abs(np.median(list(found.places.values()))) > limit:
        text = (
            f"torque and pressure place the lift table away from the trigger's nominal angle ({listed} degrees; the "
            f"mounting is declared within {np.degrees(spec.installation_tolerance):.2g}, the physics of sound pumps "
            f"moves it by less than {ALIKE_DEG:g}): check nominal_angle_deg of the trigger"
        )
        return (Finding("trigger_angle_doubtful", "warning", text, where),)
    return ()


def _untold(found: Flanks, where: str) -> tuple[Finding, ...]:
    """Return a note where a table read against the direction of running would not show."""
    if found.mirrored_near < found.forward.correlation - TELLS:
        return ()
    text = (
        "the direction in which the lift table is read cannot be checked: read the other way it follows torque and "
        f"pressure as well (correlation {found.mirrored_near:.2f} against {found.forward.correlation:.2f})"
    )
    return (Finding("direction_unchecked", "info", text, where),)
