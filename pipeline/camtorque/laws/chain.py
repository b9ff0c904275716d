"""The chain of links: line pressure -> chamber -> mechanism -> friction -> damping -> driveline -> sensor -> torque.

`ChainInput` is what one recording brings; `evaluate` is a pure function of it and of parameter values. The torque is
linear in some parameters (columns of ``linear``) and not in others (columns of ``derivative``); the fit eliminates the
former. All derivatives are exact: tangents in the compiled chamber and mechanics, analytic transfer functions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camtorque.config import PumpData
from camtorque.laws import LINEAR_NAMES, ON_BRIDGE, chamber, driveline, follower, ripple, sensor
from camtorque.laws.chamber import NO_PATH
from camtorque.laws.swing import Swing
from camtorque.laws.torque import bin_restoring, bin_taps, binned_by, torque_columns, torque_tangents
from camtorque.mechanism.cam import lobe_count
from camtorque.mechanism.friction import NO_FRICTION
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.torque import Constants, constants_of
from camtorque.records import Array, ReadOnly
from camtorque.units import TURN

BINS = 600
"""Bins of a revolution in which measured and modelled torque are compared, as a rule."""
LARGEST_STEP = 8.0e-6
"""Time step while the delivery valve moves [s]."""
MOST_SUBSTEPS = 10
ACTIVE_MARGIN = 30.0
"""Pressure below that which opens the valve at which the finer steps begin [bar]."""
SHIFT_NAMES = ("trigger_offset", *driveline.COMPLIANCE_NAMES)
"""Parameters that move the cam angle."""
SENSOR_NAMES = ("cutoff", "filter_damping", "delay_error")
NONLINEAR_NAMES = (*chamber.NAMES, *SHIFT_NAMES, *SENSOR_NAMES, follower.NAME, "guide_friction", "gain_error")
"""Parameters that the torque is not linear in, in the order of the derivative's columns."""
COLUMN_NAMES = (*LINEAR_NAMES, "torque_zero", *ripple.NAMES)
"""Parameters that it is linear in, in the order of the columns."""
ON_CAM = len(LINEAR_NAMES)
"""Of these the first act on cam or bridge, the others in the measured signal alone."""
LOAD_PLACES = [NONLINEAR_NAMES.index(name) for name in (*driveline.COMPLIANCE_NAMES, follower.NAME)]
SENSOR_PLACES = [NONLINEAR_NAMES.index(name) for name in SENSOR_NAMES]
BRIDGE = np.array([False, *ON_BRIDGE])
"""Which of the torque without linear parameters and its columns the bridge alone feels."""
GAIN_PLACE = NONLINEAR_NAMES.index("gain_error")
assert GAIN_PLACE == len(NONLINEAR_NAMES) - 1 == NONLINEAR_NAMES.index("guide_friction") + 1


@dataclass(frozen=True)
class ChainInput(ReadOnly):
    """What one recording brings to the chain, on a uniform grid; `evaluate` needs one that the bins divide.

    Attributes
    ----------
    theta : (n,) uniform nominal cam angle from 0 [rad], even angle where a ``swing`` is known
    speed : mean cam speed [rad/s]
    line_pressure : (n,) mean cycle [Pa]
    shaft_torque : (n,) mean cycle that twists the shaft [N m]
    trigger_angle, low_pass_order : nominal [rad]; of the transducer, of second order below `sensor.STEEP`
    pump, law : catalogue data; lift law with ``derivatives(theta, highest)`` and ``is_round(slope)``
    offset : follower offset as the cam sees it in its direction of running [m]
    uses_chamber : False feeds the line pressure to the plunger, as the source paper does
    substeps : (n,) time steps of the chamber per grid step
    swing : of the cam within a turn, where a wheel on it saw that: twist is rebuilt above its orders only
    ripple_order : times a revolution that the drive repeats a torque, 0 for none
    bins : of a revolution in which the torques are compared; the angles are a multiple
    told : (3, n) of the swing, with two derivatives by the even angle [rad]; else (3, 0)
    lobes, top_lift, top_angle : how many alike the cam has, their lift [m], cam angle of the first one's top [rad]
    in_signal : (bins, 3) columns of the torque's zero and of that ripple
    """

    theta: Array
    speed: float
    line_pressure: Array
    shaft_torque: Array
    trigger_angle: float
    pump: PumpData
    law: Any
    offset: float
    uses_chamber: bool = True
    low_pass_order: int = 0
    substeps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    swing: Swing | None = None
    ripple_order: int = 0
    bins: int = BINS
    twist: driveline.TwistBasis = field(init=False)
    told: Array = field(init=False)
    lobes: int = field(init=False)
    top_lift: float = field(init=False)
    top_angle: float = field(init=False)
    constants: Constants = field(init=False)
    in_signal: Array = field(init=False)

    @property
    def told_order(self) -> int:
        """Highest order of the cam's swing that a wheel tells, 0 without one."""
        return self.swing.order if self.swing else 0

    def __post_init__(self) -> None:
        lift = self.law.evaluate(self.theta, 0)
        told = self.swing.told(self.theta.size) if self.swing else np.zeros((3, 0))
        pump = replace(self.pump, follower_offset=self.offset)
        waves = ripple.binned_waves(self.ripple_order, self.bins, self.theta.size)
        lobes = lobe_count(lift)
        made = {
            "twist": driveline.twist_basis(self.shaft_torque, self.speed, self.trigger_angle, self.told_order),
            "told": told,
            "lobes": lobes, "top_lift": float(np.max(lift)),
            "top_angle": float(self.theta[np.argmax(lift[: lift.size // lobes])]),
            "substeps": self.substeps if self.substeps.size else np.ones(self.theta.size, dtype=np.int64),
            "constants": constants_of(pump, Mounting(), NO_FRICTION)._replace(cam_inertia=0.0),
            "in_signal": np.column_stack([np.ones(self.bins), waves]),
        }  # fmt: skip
        for name, value in made.items():
            object.__setattr__(self, name, value)
        super().__post_init__()


@dataclass(frozen=True)
class Motion:
    """Cam angle, its rates, and the lift with three derivatives at one set of values, (n,) and (4, n).

    ``shifts`` holds the derivatives of the angle by `SHIFT_NAMES` and of its first two angle derivatives, (n, 14) each.
    """

    theta: Array
    rate: Array
    second: Array
    lift: Array
    shifts: tuple[Array, Array, Array]


@dataclass(frozen=True)
class ChainOutput:
    """The chain at one set of values.

    Attributes
    ----------
    torque : (bins,) part of the measured torque that no linear parameter scales [N m]
    linear : (bins, 17) columns of `COLUMN_NAMES`
    derivative : (bins, n_nonlinear) by `NONLINEAR_NAMES` with the linear parameters held; None where not asked for
    motion : cam motion on the fine grid
    pressure : (n,) chamber pressure [Pa]
    pressure_tangents : by `chamber.NAMES`, then `SHIFT_NAMES`, (n, ...) [Pa per SI]; None where not asked for
    load : (n,) contact force along the follower lambda_y, without what the linear columns add [N]
    states : (n, 3) gallery pressure [bar], volume swept by the valve [mm^3], iterations of the chamber
    flows : (n, 4) inlet port, spill, seat, leak [m^3/s]
    path : (1 + m, 3) the chamber after each time step, from which the derivative at the same values needs no search
    least_guide : least 1 - mu |tan phi| sign(y'); the follower jams at 0
    spectra : (bins // 2 + 1, 15) harmonics of torque and columns but the last on the cam, before shaft and sensor
    """

    torque: Array
    linear: Array
    derivative: Array | None
    motion: Motion
    pressure: Array
    pressure_tangents: Array | None
    load: Array
    states: Array
    flows: Array
    path: Array
    least_guide: float
    spectra: NDArray[np.complex128]


def drive_response(
    data: ChainInput, values: Mapping[str, float], tangents: bool = True, n_points: int = 0
) -> NDArray[np.complex128]:
    """Return C(s) and its derivatives by `driveline.COMPLIANCE_NAMES`, (k, 14) or (k, 1).

    Its harmonics are those of the twist and those of ``n_points`` points, 0 for the bins.
    """
    highest = max(data.twist.omega.size, (n_points or data.bins) // 2 + 1)
    return driveline.compliance(np.arange(float(highest)) * data.speed, values, tangents)


def cam_motion(data: ChainInput, values: Mapping[str, float], response: NDArray[np.complex128]) -> Motion:
    """Return the true cam angle after trigger offset, twist and drive, with its rates and the lift there.

    ``response`` is that of `drive_response`.
    """
    moved = driveline.angle_shifts(data.twist, response)
    if data.swing is not None:
        for part, told in zip(moved, data.told, strict=True):
            part[:, 0] += told
    theta = data.theta + values["trigger_offset"] + moved[0][:, 0]
    lift = np.asarray(data.law.compiled_derivatives(theta, 3))
    rate, second = data.speed * (1.0 + moved[1][:, 0]), data.speed**2 * moved[2][:, 0]
    for part, first in zip(moved, (1.0, 0.0, 0.0), strict=True):
        part[:, 0] = first
    return Motion(theta, rate, second, lift, moved)


def binned(values: Array, bins: int = BINS) -> Array:
    """Return means over bins along the first axis, (bins, ...)."""
    return values.reshape(bins, -1, *values.shape[1:]).mean(axis=1)


def transfer(
    data: ChainInput, values: Mapping[str, float], n_points: int, response: NDArray[np.complex128] | None = None
) -> tuple[Any, Any, Any, Any]:
    """Return load -> shaft torque -> signal (k,) on the harmonics of a grid, then their derivatives (k, 14), (k, 3)."""
    omega = np.asarray(np.arange(n_points // 2 + 1) * data.speed, dtype=np.float64)
    both = drive_response(data, values, False, n_points) if response is None else response
    shaft, shaft_d = driveline.shaft_transfer(omega, values, both)
    passed, passed_d = follower.passed_load(omega, data.pump.follower_mass, values[follower.NAME])
    shaft_d = np.column_stack([shaft_d * passed[:, None], shaft * passed_d])
    measured, measured_d = sensor.low_pass(omega, data.low_pass_order, *(values[name] for name in SENSOR_NAMES))
    return shaft * passed, measured, shaft_d, measured_d


def filtered(values: Array, transfer_function: Any) -> Array:
    """Return periodic signals (n,) or (n, k) behind a transfer function on their harmonics."""
    shape = (-1,) + (1,) * (values.ndim - 1)
    spectrum = np.fft.rfft(values, axis=0) * transfer_function.reshape(shape)
    return np.fft.irfft(spectrum, values.shape[0], axis=0)


def chamber_of(
    data: ChainInput, values: Mapping[str, float], motion: Motion, tangents: bool, known: Array = NO_PATH
) -> tuple[Array, Array | None, Array, Array, Array]:
    """Return pressure on the plunger [Pa], its tangents, states, flows and path; the line pressure without a chamber.

    The tangents are by `chamber.NAMES` and by what the motion's ``shifts`` are by, (n, N + k) [Pa per SI].
    ``known`` is the path of a pass with the same values.
    """
    n = data.theta.size
    if not data.uses_chamber:
        by = np.zeros((n, chamber.N + motion.shifts[0].shape[1])) if tangents else None
        if by is not None:
            by[:, chamber.NAMES.index("pressure_zero")] = -1.0
        return data.line_pressure - values["pressure_zero"], by, np.zeros((n, 3)), np.zeros((n, 4)), NO_PATH
    vector = np.array([values[name] for name in chamber.NAMES]) * chamber.UNITS
    end_lift, end_slope = _closed_at(data, values)
    step = 2e3 * np.pi / n / data.speed
    period = TURN / data.lobes if data.lobes > 1 else 0.0
    area, top = data.pump.plunger_area * 1e6, data.top_lift * 1e3
    geometry = np.array([area, top, step, end_lift, end_slope, data.top_angle, period])
    grid = (motion.theta, motion.lift[0] * 1e3, motion.lift[1] * 1e3, data.line_pressure * 1e-5, data.substeps)
    pressure, by, states, flows, path = chamber.revolution(vector, geometry, grid, motion.shifts[0], known, tangents)
    by *= 1e5
    by[:, : chamber.N] *= chamber.UNITS[: by.shape[1]]
    return pressure * 1e5, by if tangents else None, states, flows * 1e-6, path


def _closed_at(data: ChainInput, values: Mapping[str, float]) -> tuple[float, float]:
    """Return lift [mm] and slope [mm/rad] at the end of delivery, 0 where the outlet does not open again there."""
    end = values["end_of_delivery"]
    if values["outlet_return"] <= 0.0 or end >= chamber.NEVER:
        return 0.0, 0.0
    lift, slope = data.law.derivatives(np.array([end]), 1)[:, 0] * 1e3
    return float(lift), float(slope)


@np.errstate(over="ignore", invalid="ignore")  # far from anything physical, where the search turns back
def evaluate(
    data: ChainInput,
    values: Mapping[str, float],
    coefficients: Array | None = None,
    tangents: bool = False,
    known: Array = NO_PATH,
) -> ChainOutput:
    """Return the measured torque that the chain predicts, apart from its linear parameters.

    Parameters
    ----------
    values : every non-linear parameter [SI]
    coefficients : (17,) of `COLUMN_NAMES` at which torque, columns and derivative are exact together, None for zeros:
        the friction of bearings and pin under the plunger's own forces is a product of two of them
    tangents : whether the derivative is wanted
    known : ``path`` of an output at the same values, which saves most of the chamber's work
    """
    each, over = divmod(data.theta.size, bins := data.bins)
    if over:
        raise ValueError(f"chain: {data.theta.size} angles, expected a multiple of {bins}")
    response = drive_response(data, values, tangents)
    motion = cam_motion(data, values, response)
    pressure, by, states, flows, path = chamber_of(data, values, motion, tangents, known)
    c = np.zeros(len(COLUMN_NAMES)) if coefficients is None else coefficients
    torques, slopes, load, least, _ = torque_columns(
        data.constants, values["guide_friction"], motion.theta, motion.lift, motion.rate, motion.second, pressure,
        c[:ON_CAM], tangents,
    )  # fmt: skip
    shaft, measured, shaft_by, measured_by = transfer(data, values, bins, response)
    gain = 1.0 + values["gain_error"]
    ways = (shaft * measured * gain, measured * gain)
    taps, restoring = bin_taps(each), bin_restoring(each, bins)[:, None]
    spectra = np.fft.rfft(binned_by(torques, taps, bins), axis=0) * restoring
    (torque, linear), derivative = _behind(data, spectra, *ways), None
    if tangents:
        width = len(NONLINEAR_NAMES)
        spectrum = sum(
            np.fft.rfft(binned_by(torque_tangents(by, slope, *motion.shifts, data.speed, width), taps, bins), axis=0)
            * (way[:, None] * restoring)
            for slope, way in zip(slopes, ways, strict=True)
        )
        parts = spectra * np.r_[1.0, c[:ON_CAM]]
        loaded, felt = (np.sum(parts[:, side], axis=1)[:, None] * gain for side in (~BRIDGE, BRIDGE))
        spectrum[:, LOAD_PLACES] += loaded * measured[:, None] * shaft_by
        spectrum[:, SENSOR_PLACES] += (loaded * shaft[:, None] + felt) * measured_by
        derivative = np.fft.irfft(spectrum, bins, axis=0)
        derivative[:, GAIN_PLACE] = (torque + linear[:, :ON_CAM] @ c[:ON_CAM]) / gain
    return ChainOutput(
        torque, linear, derivative, motion, pressure, by, load, states, flows, path, float(least), spectra
    )


def coefficients_of(values: Mapping[str, float]) -> Array:
    """Return what the columns of `ChainOutput.linear` are multiplied by, (17,)."""
    return np.array([values[name] for name in COLUMN_NAMES])


def derivative_by(output: ChainOutput, names: Sequence[str]) -> Array:
    """Return the derivatives of the torque by some parameters, (bins, m) [N m per SI]."""
    assert output.derivative is not None
    places = [(*NONLINEAR_NAMES, *COLUMN_NAMES).index(name) for name in names]
    return np.column_stack([output.derivative, output.linear])[:, places]


def _behind(
    data: ChainInput, spectra: NDArray[np.complex128], through: NDArray[np.complex128], measured: NDArray[np.complex128]
) -> tuple[Array, Array]:
    """Return torque and columns (bins,), (bins, 17) from their harmonics: through the shaft, or on the bridge alone."""
    behind = np.fft.irfft(spectra * np.where(BRIDGE, measured[:, None], through[:, None]), data.bins, axis=0)
    return behind[:, 0].copy(), np.concatenate([behind[:, 1:], data.in_signal], axis=1)


def with_transfer(data: ChainInput, output: ChainOutput, values: Mapping[str, float]) -> ChainOutput:
    """Return an output behind the shaft and the sensor of other values; on the cam everything stays as it is."""
    shaft, measured, *_ = transfer(data, values, data.bins)
    gain = 1.0 + values["gain_error"]
    torque, linear = _behind(data, output.spectra, shaft * measured * gain, measured * gain)
    return replace(output, torque=torque, linear=linear, derivative=None)


def with_substeps(data: ChainInput, output: ChainOutput, values: Mapping[str, float]) -> NDArray[np.int64]:
    """Return how finely each grid step is divided: fine while the delivery valve moves or is about to."""
    n = data.theta.size
    steps = int(np.clip(np.ceil(2.0 * np.pi / n / data.speed / LARGEST_STEP), 1, MOST_SUBSTEPS))
    line = data.line_pressure - values["pressure_zero"]
    near = output.pressure - line > values["valve_opening"] - ACTIVE_MARGIN * 1e5
    moving = (near | (output.states[:, 1] > 0.05)) & (output.pressure > 10.0e5)
    reach = max(1, n // 120)
    wide = np.convolve(np.r_[moving[-reach:], moving, moving[:reach]], np.ones(2 * reach + 1), "valid") > 0
    return np.where(wide, steps, 1).astype(np.int64)
