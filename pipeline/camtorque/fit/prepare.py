"""Aligned cycles and certificates -> what the fit needs: bins, weights, and rows with this rig's priors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camtorque.align.budget import wandered_std
from camtorque.config import FluidSpec, PumpData, RecordingConfig
from camtorque.fit.problem import FitData
from camtorque.laws import ROWS
from camtorque.laws.chain import BINS, ChainInput, angle_grid, binned
from camtorque.laws.fuels import fuel_temperature, modulus_prior, viscosity_ratio
from camtorque.laws.lift import lift_correction
from camtorque.laws.ports import DISCHARGE
from camtorque.laws.rows import ParameterRow
from camtorque.laws.sensor import BUTTERWORTH, LEAST_DAMPING, MOST_DAMPING, STEEP
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.mounting import assumed_roller
from camtorque.records import Array, CamCycles, CamTable, ReadOnly, Recording, Refusal, SensorCalibration
from camtorque.stacks import mean_of

FIT_GRID = 1800
"""Points per revolution of the model, whatever the grid of the cycles: 0.2 degrees."""
SMALLEST_SHARE = 2.0e-4
"""Least standard deviation of a bin, as a share of the peak torque: quantisation and grid."""
DISCREPANCY = 1.0e-3
"""Model error per torque that the weights admit; a larger one widens the intervals afterwards."""
LOAD_SHARE = 0.1
"""Share of the peak torque at which the rising flank counts as loaded."""
STATED = "stated in recording.toml"
CORRELATION = 6.0
"""Angle over which neighbouring residuals are one value [deg]: the transducer's low-pass and smooth errors of laws."""
FIRST_ORDER = 5.0
"""Damping ratio at which two poles are one of first order: the other lies at a hundred times its frequency."""
NO_INERTIA = 1.0e-9
"""Standard uncertainty of the inertia of what is stated not to roll: a hundredth of a small roller's [kg m^2]."""
TURNING_SHARE = 1.5e-3
"""Torque that turns with the transducer, over its nominal torque: bending and shear within their limits show as up to
0.3 %, say mounting instructions of torque transducers."""
USUAL_PLUNGER, USUAL_CAM = (0.007, 0.011), (0.015, 0.03)
"""Diameters and base circle radii of the pumps that the literature of the rows speaks of [m]."""
USUAL_TWIST, COUPLING_TWIST = 5.0e-3, 15.0e-3
"""Twist of shaft and of an elastic coupling at the peak torque: 2-10 mrad of a steel shaft at 30 MPa [rad]."""
SPEED_SWING, LIGHTEST_DRIVE = 0.05, 60.0
"""Swing of the speed within a revolution that a bench may allow [-]; 1/J of a light servo motor [1/(kg m^2)]."""
LEAST_FEED_STD = 0.2e5
"""A gallery sensor's zero, and the way from it to the inlet port [Pa]."""
INDEPENDENT = 360.0 / CORRELATION
"""Independent values per revolution: the one count that weights, evidence and inflation use."""


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
        raise Refusal(f"fit: {cycles.speed.size} usable cycles, at least 4 are needed (2 to fit, 2 to score)")
    fit, held = ~cycles.held_out, cycles.held_out
    torque, pressure = cycles.torque_halves, [mean_of(cycles.pressure, half) for half in (fit, held)]
    return MeanCycles(
        torque[0], pressure[0], torque[1], pressure[1], cycles.mean_torque, cycles.mean_pressure,
        float(np.sqrt(np.mean(cycles.torque_std**2) / fit.sum())),
    )  # fmt: skip


def rig_rows(
    config: RecordingConfig, law: CamLaw, torque: SensorCalibration, pressure: SensorCalibration, cycles: CamCycles
) -> dict[str, ParameterRow]:
    """Return every parameter row with the starts, bounds and priors that sheets and certificates give."""
    rows = dict(ROWS)
    trigger, pump = config.trigger, config.pump
    tolerance = max(trigger.installation_tolerance, 1e-4)
    _set(rows, "trigger_offset", prior=(0.0, tolerance / np.sqrt(3.0)), lower=-2.5 * tolerance, upper=2.5 * tolerance)
    _set(rows, "gain_error", prior=(0.0, max(torque.gain_relative_std, 1e-5)))
    _set(rows, "torque_zero", prior=(0.0, max(torque.zero_std, 1e-4)))
    _set(rows, "pressure_zero", prior=(0.0, max(pressure.zero_std, 1e3)))
    _set_delay(rows, float(np.hypot(torque.delay_std, wandered_std(cycles.angle_errors, "torque") / cycles.mean_speed)))
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


def _set_delay(rows: dict[str, ParameterRow], std: float) -> None:
    reach = max(rows["delay_error"].upper, 3.0 * std)
    _set(rows, "delay_error", prior=(0.0, max(std, 1e-7)), lower=-reach, upper=reach)


def _set_roller(rows: dict[str, ParameterRow], pump: PumpData) -> None:
    """Take the roller of the sheet, else some disk of its radius."""
    roller = assumed_roller(pump)
    if roller.assumed:
        disk = roller.inertia
        _set(rows, "roller_inertia", start=disk, prior=(2.0 * disk, 2.0 * disk), lower=0.3 * disk, upper=12.0 * disk,
             step=disk)  # fmt: skip
    else:
        _set_prior(
            rows, "roller_inertia", roller.inertia, max(0.05 * roller.inertia, NO_INERTIA), "roller of the sheet"
        )


def _set_bridge(rows: dict[str, ParameterRow], torque: SensorCalibration) -> None:
    """Take what turns with the transducer as a share of its nominal torque."""
    nominal = torque.range_max
    if np.isfinite(nominal):
        for name in ("turning_cosine", "turning_sine"):
            _set(rows, name, prior=(0.0, TURNING_SHARE * nominal), step=0.3 * TURNING_SHARE * nominal,
                 lower=-0.05 * nominal, upper=0.05 * nominal)  # fmt: skip


def _set_filter(rows: dict[str, ParameterRow], torque: SensorCalibration) -> None:
    """Take the low-pass of the torque as the sheet states it; what it does not state is wide."""
    cutoff = torque.cutoff_hz
    if np.isfinite(cutoff):
        _set(rows, "cutoff", start=cutoff, lower=0.5 * cutoff, upper=2.0 * cutoff, step=0.05 * cutoff,
             prior=(cutoff, 0.05 * cutoff))  # fmt: skip
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
    """Scale what literature knows of usual plungers and cams to those beyond.

    Similar pumps: lengths go with the diameter, areas with its square. A smaller part is expected smaller, but known
    no better.
    """
    plunger = pump.plunger_diameter / float(np.clip(pump.plunger_diameter, *USUAL_PLUNGER))
    cam = pump.base_circle_radius / float(np.clip(pump.base_circle_radius, *USUAL_CAM))
    for names, factor in (
        (("port_width", "port_span", "spill_width", "spill_span", "packing_force"), plunger),
        (("plunger_viscous",), plunger**2),
        (("retraction_volume", "gallery_volume"), plunger**3),
        (("bearing_arm", "bending_cosine", "bending_sine"), cam),
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
        _set_prior(rows, "bulk_modulus", modulus.mean, modulus.std, modulus.source)
    if temperature is None:
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


def law_variance(torque: Array) -> Array:
    """Return the variance of what the laws leave in each bin of a mean torque (BINS,) [(N m)^2]."""
    return (SMALLEST_SHARE * np.max(np.abs(torque))) ** 2 + (DISCREPANCY * np.abs(torque)) ** 2


def bin_weights(torque: Array, scatter: float, count: int = 1) -> Array:
    """Return the weight of each bin: scatter of the mean, error of the laws, correlation.

    Parameters
    ----------
    torque : (BINS,) mean measured torque [N m]
    scatter : standard error of the mean of one bin [N m]
    count : recordings that are fitted together: the error of the laws is the same in all of them
    """
    return 1.0 / np.sqrt((scatter**2 + count * law_variance(torque)) * BINS / INDEPENDENT)


def on_grid(values: Array, n: int) -> Array:
    """Return a periodic signal (m,) on another uniform grid from the same zero, by its harmonics."""
    if values.size == n:
        return np.ascontiguousarray(values)
    return np.asarray(np.fft.irfft(np.fft.rfft(values)[: n // 2 + 1], n) * (n / values.size))


def fit_data(recording: Recording, cycles: CamCycles, law: CamLaw, means: MeanCycles) -> FitData:
    """Return one recording ready to be fitted to the mean of its fitted cycles; its structure is still ``land``."""
    config: RecordingConfig = recording.config
    table: CamTable = recording.cam_table
    torque_sheet, pressure_sheet = recording.of("torque")[0].calibration, recording.of("pressure")[0].calibration
    assert torque_sheet is not None
    assert pressure_sheet is not None
    rows = rig_rows(config, law, torque_sheet, pressure_sheet, cycles)
    _set_torsion(rows, means.torque, cycles.mean_speed)
    closing = loaded_lift(cycles.theta, means.torque, law)
    _set(rows, "port_closing_lift", start=float(np.clip(closing, rows["port_closing_lift"].lower, None)))
    step = float(np.median(np.diff(table.theta)))
    basis = lift_correction(cycles.theta, law.evaluate(cycles.theta, 0), table.resolution, law.lift_std, step)
    turned = cycles.details.get("angle_deviation")
    measured = turned is not None and config.trigger.side != "motor"
    chain = ChainInput(
        deviation=on_grid(np.asarray(turned), FIT_GRID) if measured else np.zeros(0),
        theta=angle_grid(FIT_GRID), speed=cycles.mean_speed, line_pressure=on_grid(means.pressure, FIT_GRID),
        shaft_torque=on_grid(means.torque, FIT_GRID), trigger_angle=config.trigger.nominal_angle, pump=config.pump,
        law=law, offset=config.pump.follower_offset * config.rotation, low_pass_order=torque_sheet.filter_order,
    )  # fmt: skip
    centred = binned_at_centres(means.torque)
    return FitData(config.id, chain, centred, bin_weights(centred, means.scatter_of_mean), "land", rows, basis)


def other_half(data: FitData, means: MeanCycles) -> FitData:
    """Return a recording of `fit_data` with the cycles that are held out in place of those that are fitted."""
    torque, pressure = (on_grid(part, FIT_GRID) for part in (means.held_torque, means.held_pressure))
    chain = replace(data.chain, line_pressure=pressure, shaft_torque=torque)
    return replace(data, torque=binned_at_centres(means.held_torque), chain=chain)


def binned_at_centres(values: Array) -> Array:
    """Return the mean over each bin of a periodic signal on any grid, (BINS,)."""
    return binned(on_grid(values, FIT_GRID))
