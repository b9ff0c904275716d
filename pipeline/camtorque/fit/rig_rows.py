"""Sheets, certificates and what the cycles tell -> the rows of one rig: starts, bounds and priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.align.budget import wandered_std
from camtorque.config import FluidSpec, PumpData, RecordingConfig, TriggerSpec
from camtorque.laws import ROWS, ripple
from camtorque.laws.fluid import HEAVY, fuel_temperature, kind_of, modulus_prior, viscosity_ratio
from camtorque.laws.ports import DISCHARGE
from camtorque.laws.rows import ParameterRow
from camtorque.laws.sensor import BUTTERWORTH, LEAST_DAMPING, MOST_DAMPING, STEEP
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.mounting import assumed_roller
from camtorque.records import Array, CamCycles, Recording, SensorCalibration

STATED = "stated in recording.toml"
LOAD_SHARE = 0.1
"""Share of the peak torque at which the rising flank counts as loaded."""
FIRST_ORDER = 5.0
"""Damping ratio at which two poles are one of first order: the other lies at a hundred times its frequency."""
NO_INERTIA = 1.0e-9
"""Standard uncertainty of the inertia of what is stated not to roll: a hundredth of a small roller's [kg m^2]."""
TURNING_SHARE = 1.5e-3
"""Torque that turns with the transducer, over its nominal torque: bending and shear within their limits show as up to
0.3 %, say mounting instructions of torque transducers."""
RIPPLE_SHARE = 0.02
"""Torque that teeth or poles of a drive repeat, over the transducer's nominal torque, where that is a large one's."""
LEAST_CUTOFF = 100.0
"""Lowest low-pass of a torque transducer whose sheet states none [Hz]."""
USUAL_PLUNGER, USUAL_CAM = (0.007, 0.011), (0.015, 0.03)
"""Diameters and base circle radii of the pumps that the literature of the rows speaks of [m]."""
LARGEST_USUAL_ROLLER = 0.015
"""Radius of the largest roller that runs on pins of 2-5 mm radius [m]."""
USUAL_TWIST, COUPLING_TWIST = 5.0e-3, 15.0e-3
"""Twist of shaft and of an elastic coupling at the peak torque: 2-10 mrad of a steel shaft at 30 MPa [rad]."""
SPEED_SWING, LIGHTEST_DRIVE = 0.05, 60.0
"""Swing of the speed within a revolution that a bench may allow [-]; 1/J of a light servo motor [1/(kg m^2)]."""
SLIDING, MOST_SLIDING = 0.04, 0.3
"""Friction coefficient of a foot on the cam: lubricated steel has 0.01 to 0.1; dry steel's at most."""
LEAST_FEED_STD = 0.2e5
"""A gallery sensor's zero, and the way from it to the inlet port [Pa]."""


def rig_rows(
    config: RecordingConfig, law: CamLaw, torque: SensorCalibration, pressure: SensorCalibration, cycles: CamCycles
) -> dict[str, ParameterRow]:
    """Return every parameter row with the starts, bounds and priors that sheets and certificates give."""
    rows = dict(ROWS)
    pump = config.pump
    _set_trigger(rows, config.trigger)
    _set_measured(rows, torque, pressure, cycles)
    _set_bridge(rows, torque)
    _set_filter(rows, torque)
    _set_size(rows, pump)
    lift, slope = law.derivatives(np.linspace(0.0, 2.0 * np.pi, 721), 1)
    top = float(np.max(lift))
    _set(rows, "port_closing_lift", start=0.2 * top, lower=0.001 * top, upper=0.98 * top)
    swept = pump.plunger_area * top
    _set(rows, "dead_volume", start=4.0 * swept, lower=0.05 * swept, upper=60.0 * swept, step=0.3 * swept)
    _set(rows, "spill_lift", start=0.8 * top, lower=0.05 * top, upper=1.2 * top)
    flow = pump.plunger_area * float(np.max(slope)) * cycles.mean_speed
    area = flow / (DISCHARGE * np.sqrt(10.0e5))
    row = rows["valve_area"]
    area = float(np.clip(area, 2.0 * row.lower, 0.5 * row.upper))
    _set(rows, "valve_area", start=area, step=0.2 * area)
    _set_warm(rows, config.fluid, fuel_temperature(config.fluid, cycles))
    _set_roller(rows, pump)
    _set_stated(rows, config)
    _set_gallery(rows, cycles)
    return rows


def own_rows(recording: Recording, cycles: CamCycles) -> dict[str, ParameterRow]:
    """Return the rows of zeros and trigger: each recording has readings of its own, or none, and its own sheet."""
    rows = dict(ROWS)
    torque, pressure = recording.of("torque")[0].calibration, recording.of("pressure")[0].calibration
    assert torque is not None
    assert pressure is not None
    _set_measured(rows, torque, pressure, cycles)
    _set_trigger(rows, recording.config.trigger)
    return {name: rows[name] for name in ("torque_zero", "pressure_zero", "trigger_offset")}


def _set_trigger(rows: dict[str, ParameterRow], trigger: TriggerSpec) -> None:
    """Take the error of the trigger's angle from what its mounting allows."""
    tolerance = max(trigger.installation_tolerance, 1e-4)
    _set(rows, "trigger_offset", prior=(0.0, tolerance / np.sqrt(3.0)), lower=-2.5 * tolerance, upper=2.5 * tolerance)


def _set_measured(
    rows: dict[str, ParameterRow], torque: SensorCalibration, pressure: SensorCalibration, cycles: CamCycles
) -> None:
    """Take gain, zeros and delay from the certificates, as unsure as drifting levels and wandering clocks make them.

    What a sheet leaves open is not cut off: the bounds hold three standard deviations.
    """
    half = {quantity: 0.5 * drift for quantity, drift in cycles.level_drifts.items()}
    late = wandered_std(cycles.angle_errors, "torque") / cycles.mean_speed
    for name, sheet, beside, least in (
        ("torque_zero", torque.zero_std, half.get("torque", 0.0), 1e-4),
        ("pressure_zero", pressure.zero_std, half.get("pressure", 0.0), 1e3),
        ("delay_error", torque.delay_std, late, 1e-7),
        ("gain_error", torque.gain_relative_std, 0.0, 1e-5),
    ):
        std = max(float(np.hypot(sheet, beside)), least)
        row = rows[name]
        _set(rows, name, prior=(0.0, std), lower=min(row.lower, -3.0 * std), upper=max(row.upper, 3.0 * std))


def _set_roller(rows: dict[str, ParameterRow], pump: PumpData) -> None:
    """Take the inertia of the sheet's roller, else that of some disk of its mass or size; no mass has none."""
    roller = assumed_roller(pump)
    if pump.roller_inertia is None and roller.inertia > 0.0:
        disk = roller.inertia
        _set(rows, "roller_inertia", start=disk, prior=(2.0 * disk, 2.0 * disk), lower=0.3 * disk, upper=12.0 * disk,
             step=disk)  # fmt: skip
    else:
        _set_prior(
            rows, "roller_inertia", roller.inertia, max(0.05 * roller.inertia, NO_INERTIA), "roller of the sheet"
        )
    if roller.inertia == 0.0:
        _set_foot(rows, pump.roller_radius)


def _set_foot(rows: dict[str, ParameterRow], crown: float) -> None:
    """Take the friction of a foot with a crown of that radius [m] for that of a pin.

    A roller that does not turn slides by r_r (L/r_r - 1) a radian, so that mu r_r acts as mu r_pin does on a pin.
    """
    arm = SLIDING * crown
    _set(rows, "pin_arm", start=arm, upper=MOST_SLIDING * crown, step=0.1 * arm, prior=(arm, arm),
         meaning="friction coefficient times radius of the foot's crown",
         source="a foot that slides: mu 0.01-0.1 of lubricated steel")  # fmt: skip


def _set_bridge(rows: dict[str, ParameterRow], torque: SensorCalibration) -> None:
    """Take what turns with the transducer, and what a large drive repeats, as a share of the nominal torque."""
    nominal = torque.largest_reading
    if np.isfinite(nominal):
        for name in ("turning_cosine", "turning_sine"):
            _set(rows, name, prior=(0.0, TURNING_SHARE * nominal), step=0.3 * TURNING_SHARE * nominal,
                 lower=-0.05 * nominal, upper=0.05 * nominal)  # fmt: skip
        for name in ripple.NAMES:
            row, std = rows[name], RIPPLE_SHARE * nominal
            if row.prior and std > row.prior[1]:
                _set(rows, name, prior=(0.0, std), lower=min(row.lower, -5.0 * std), upper=max(row.upper, 5.0 * std))


def _set_filter(rows: dict[str, ParameterRow], torque: SensorCalibration) -> None:
    """Take the low-pass of the torque as the sheet states it; what it does not state is wide."""
    cutoff = torque.cutoff_hz
    if np.isfinite(cutoff):
        _set(rows, "cutoff", start=cutoff, lower=0.5 * cutoff, upper=2.0 * cutoff, step=0.05 * cutoff,
             prior=(cutoff, 0.05 * cutoff))  # fmt: skip
    else:
        _set(rows, "cutoff", lower=LEAST_CUTOFF, prior=(rows["cutoff"].start, rows["cutoff"].start),
             source="no sheet states it; amplifiers of transducers, 0.1-5 kHz")  # fmt: skip
    if torque.filter_order == 1:
        ratio = FIRST_ORDER
        _set(rows, "filter_damping", start=ratio, lower=0.5 * ratio, upper=2.0 * ratio, step=0.1 * ratio,
             prior=(ratio, 0.1 * ratio), source="low-pass of first order: poles far apart")  # fmt: skip
    elif np.isfinite(torque.filter_damping):
        ratio = torque.filter_damping
        _set(rows, "filter_damping", start=ratio, prior=(ratio, 0.05), source="kind of low-pass on the sheet")
    if torque.filter_order >= STEEP:
        start = max(rows["filter_damping"].start, BUTTERWORTH)
        _set(rows, "filter_damping", start=start, lower=LEAST_DAMPING, upper=MOST_DAMPING)


def _set_size(rows: dict[str, ParameterRow], pump: PumpData) -> None:
    """Scale what literature knows of usual plungers, cams and rollers to those beyond.

    Similar pumps: lengths go with the diameter, areas with its square. A smaller part is expected smaller, but known
    no better; a small roller may have a pin as large as any.
    """
    plunger = pump.plunger_diameter / float(np.clip(pump.plunger_diameter, *USUAL_PLUNGER))
    cam = pump.base_circle_radius / float(np.clip(pump.base_circle_radius, *USUAL_CAM))
    roller = max(pump.roller_radius / LARGEST_USUAL_ROLLER, 1.0)
    for names, factor in (
        (("port_width", "port_span", "spill_width", "spill_span", "packing_force"), plunger),
        (("plunger_viscous",), plunger**2),
        (("retraction_volume", "gallery_volume"), plunger**3),
        (("bearing_arm", "bending_cosine", "bending_sine"), cam),
        (("pin_arm",), roller),
        (("shaft_drag",), cam**2),
        (("shaft_viscous",), cam**3),
    ):
        for name in names:
            row = rows[name]
            mean, std = row.prior or (row.start, np.inf)
            wider = max(factor, 1.0)
            _set(rows, name, start=row.start * factor, prior=(mean * factor, std * wider), lower=row.lower * factor,
                 upper=row.upper * wider, step=row.step * factor)  # fmt: skip
    # the seat yields by a mm^3 or two under the line's pressure: a gallery of less room than that has none left
    least = ROWS["gallery_volume"].lower
    _set(rows, "gallery_volume", start=max(rows["gallery_volume"].start, 2.0 * least), lower=least)


def _set_torsion(rows: dict[str, ParameterRow], torque: Array, speed: float) -> None:
    """Widen what is expected of shaft, coupling and drive to what this torque (n,) [N m] can have on its shaft.

    Shafts and couplings are made for their torque, a drive for the speed that has to be held at [rad/s]: a small bench
    has softer ones and a lighter motor than the literature's rigs of some 30 N m, and a large one stiffer ones.
    """
    peak = float(np.max(np.abs(torque)))
    swing = float(np.ptp(np.cumsum(torque - np.mean(torque)))) * 2.0 * np.pi / torque.size
    widths = {
        "shaft_compliance": USUAL_TWIST / peak, "coupling_compliance": COUPLING_TWIST / peak,
        "drive_admittance": min(SPEED_SWING * speed**2 / swing, LIGHTEST_DRIVE),
    }  # fmt: skip
    for name, width in widths.items():
        row = rows[name]
        mean, std = row.prior or (row.start, np.inf)
        if row.source != STATED and width > std:
            _set(rows, name, prior=(mean, width), upper=max(row.upper, 5.0 * width))
    row = rows["shaft_compliance"]
    if row.source != STATED:
        _set(rows, "shaft_compliance", lower=min(row.lower, 0.02 * USUAL_TWIST / peak),
             start=float(np.clip(0.5 * USUAL_TWIST / peak, 15.0e-6, row.start)))  # fmt: skip


def _set_gallery(rows: dict[str, ParameterRow], cycles: CamCycles) -> None:
    """Take the measured gallery pressure as feed pressure, as wide as it swings within a revolution."""
    gallery = cycles.channels.get("gallery_pressure")
    if gallery is None or not np.isfinite(gallery).any():
        return
    swing = float(np.nanstd(gallery))
    _set_prior(rows, "feed_pressure", float(np.nanmean(gallery)), max(swing, LEAST_FEED_STD), "measured in the gallery")


def _set_warm(rows: dict[str, ParameterRow], fluid: FluidSpec, temperature: float | None) -> None:
    """Take what name and temperature of the fuel tell: its modulus, and how thin it is in the plunger's gap."""
    modulus = modulus_prior(fluid.name, temperature)
    if modulus is not None:
        _set_prior(rows, "bulk_modulus", *modulus)
        mean, std, _ = modulus
        _set(rows, "bulk_modulus", lower=min(rows["bulk_modulus"].lower, max(mean - 3.0 * std, 0.25 * mean)))
    if temperature is None or kind_of(fluid.name) == HEAVY:  # which is heated until it is as thin as a pump needs it
        return
    ratio = viscosity_ratio(temperature)
    for name, factor in {"leakage": 1.0 / ratio, "plunger_viscous": ratio}.items():
        mean, std = rows[name].prior or (np.nan, np.nan)
        source = f"{rows[name].source}; viscosity {ratio:.2f} of that at 40 degC"
        _set(rows, name, prior=(factor * mean, factor * std), source=source)


def _set_stated(rows: dict[str, ParameterRow], config: RecordingConfig) -> None:
    """Take what the bench states of its fuel and its drive as priors, each with the width that such a figure has."""
    fluid, drive = config.fluid, config.drive
    stated = {
        "bulk_modulus": (fluid.bulk_modulus, 0.05), "bulk_modulus_slope": (fluid.bulk_modulus_slope, 0.1),
        "feed_pressure": (fluid.feed_pressure, 0.1),
        "drive_admittance": (None if drive.inertia is None else 1.0 / drive.inertia, 0.15),
        "shaft_compliance": (None if drive.shaft_stiffness is None else 1.0 / drive.shaft_stiffness, 0.15),
    }  # fmt: skip
    for name, (value, relative) in stated.items():
        if value is not None:
            least = LEAST_FEED_STD if name == "feed_pressure" else 0.0
            _set_prior(rows, name, value, max(relative * abs(value), least), STATED)
    if drive.speed_loop is not None:
        _set_prior(rows, "drive_bandwidth", float(np.log(2.0 * np.pi * drive.speed_loop)), 0.5, STATED)


def _set_prior(rows: dict[str, ParameterRow], name: str, mean: float, std: float, source: str) -> None:
    row = rows[name]
    lower = row.lower if mean >= row.lower else mean - 3.0 * std
    _set(rows, name, start=mean, prior=(mean, std), lower=lower, upper=max(row.upper, mean + 3.0 * std), source=source)


def loaded_rows(
    rows: dict[str, ParameterRow], law: CamLaw, cycles: CamCycles, torque: Array
) -> dict[str, ParameterRow]:
    """Return the rows with what a mean torque (n_theta,) [N m] tells of shaft, drive and closing of the port."""
    found = dict(rows)
    _set_torsion(found, torque, cycles.mean_speed)
    closing = loaded_lift(cycles.theta, torque, law)
    _set(found, "port_closing_lift", start=float(np.clip(closing, found["port_closing_lift"].lower, None)))
    return found


def loaded_lift(theta: Array, torque: Array, law: CamLaw) -> float:
    """Return the lift at which the torque of the rising flank first reaches `LOAD_SHARE` of its peak [m].

    There the port has closed, wherever the trigger's mark may be.
    """
    lift = law.evaluate(theta, 0)
    top = int(np.argmax(lift >= 0.98 * np.max(lift)))
    rising = torque[: top + 1] - np.min(np.abs(torque))
    onset = int(np.argmax(rising >= LOAD_SHARE * np.max(rising)))
    return float(np.clip(lift[onset], 0.02 * np.max(lift), 0.9 * np.max(lift)))


def _set(rows: dict[str, ParameterRow], name: str, **changes: object) -> None:
    rows[name] = replace(rows[name], **changes)  # type: ignore[arg-type]
