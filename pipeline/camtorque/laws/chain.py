"""The chain of links: line pressure -> chamber -> mechanism -> friction -> damping -> driveline -> sensor -> torque.

`ChainInput` is what one recording brings; `evaluate_chain` is a pure function of it and of parameter values. The
torque is linear in some parameters (columns of ``linear``) and not in others (columns of ``derivative``); the fit
eliminates the former. All derivatives are exact: hand-written tangents in the chamber, complex step through the
pointwise mechanics, analytic transfer functions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from camtorque.config import PumpData
from camtorque.laws import chamber, driveline, friction, sensor
from camtorque.laws.lift import LiftCorrection
from camtorque.records import Array, Refusal, freeze_arrays

BIN = 5
"""Fine grid points per bin of the fit's grid: 3600 -> 720."""
COMPLEX_STEP = 1.0e-30
SHIFT_NAMES = ("trigger_offset", *driveline.COMPLIANCE_NAMES)
"""Parameters that move the cam angle."""
SHAFT_NAMES = ("cam_side_inertia", *driveline.COMPLIANCE_NAMES)
"""Parameters of the transfer from the load to the shaft."""
SENSOR_NAMES = ("cutoff", "filter_damping", "delay_error")
LINEAR_NAMES = (
    "bearing_arm", "pin_arm", "shaft_drag", "shaft_viscous", "plunger_viscous", "spring_stiffness_error",
    "spring_preload_error",
)  # fmt: skip
STATIC_NAMES = ("guide_friction",)
NONLINEAR_NAMES = tuple(
    dict.fromkeys((*chamber.KERNEL_ORDER, *SHIFT_NAMES, *SHAFT_NAMES, *SENSOR_NAMES, *STATIC_NAMES, "gain_error"))
)


@dataclass(frozen=True)
class ChainInput:
    """What one recording brings to the chain.

    Attributes
    ----------
    theta : (n,) uniform nominal cam angle from 0 [rad]
    speed : mean cam speed [rad/s]
    line_pressure : (n,) mean cycle [Pa]
    shaft_torque : (n,) mean cycle that twists the shaft [N m]
    trigger_angle : nominal [rad]
    pump, law : catalogue data; lift law with ``evaluate(theta, derivative)``
    offset : follower offset as the cam sees it in its direction of running [m]
    roller_inertia : about its axis [kg m^2]
    lift_basis : correction of the lift table, or None
    uses_chamber : False feeds the line pressure to the plunger, as the source paper does
    """

    theta: Array
    speed: float
    line_pressure: Array
    shaft_torque: Array
    trigger_angle: float
    pump: PumpData
    law: Any
    offset: float
    roller_inertia: float
    lift_basis: LiftCorrection | None
    uses_chamber: bool = True
    twist: driveline.TwistBasis = field(init=False)
    top_lift: float = field(init=False)

    def __post_init__(self) -> None:
        twist = driveline.twist_basis(self.shaft_torque, self.speed, self.trigger_angle)
        object.__setattr__(self, "twist", twist)
        object.__setattr__(self, "top_lift", float(np.max(self.law.evaluate(self.theta, 0))))
        freeze_arrays(self)


@dataclass(frozen=True)
class Motion:
    """Cam angle, its rates, and the lift with three derivatives at one set of values, each (n,).

    ``shifts`` holds the derivatives of the angle by `SHIFT_NAMES` and of its first two angle derivatives, (n, 9) each.
    """

    theta: Array
    rate: Array
    second: Array
    lift: tuple[Array, Array, Array, Array]
    shifts: tuple[Array, Array, Array]


@dataclass(frozen=True)
class ChainOutput:
    """The chain at one set of values.

    Attributes
    ----------
    torque : (m,) part of the measured torque that no linear parameter scales, on the binned grid [N m]
    linear : (m, n_linear + n_basis) columns of the linear parameters, then of the lift correction
    motion : cam motion on the fine grid
    pressure : (n,) chamber pressure [Pa]
    pressure_tangents : (n, 16 + 9) in kernel order, then `SHIFT_NAMES`; None where the line pressure is used
    load : (n,) contact force along the follower lambda_y [N]
    flows : (n, 4) port, spill, valve, leak [m^3/s]
    """

    torque: Array
    linear: Array
    motion: Motion
    pressure: Array
    pressure_tangents: Array | None
    load: Array
    flows: Array


def cam_motion(data: ChainInput, values: Mapping[str, float]) -> Motion:
    """Return the true cam angle after trigger offset, twist and drive, with its rates and the lift there."""
    moved = driveline.angle_shifts(data.twist, values)
    theta = data.theta + values["trigger_offset"] + moved[0][:, 0]
    lift = tuple(data.law.derivatives(theta, 3))
    rate, second = data.speed * (1.0 + moved[1][:, 0]), data.speed**2 * moved[2][:, 0]
    n = data.theta.size
    shifts = tuple(
        np.column_stack([np.full(n, first), part[:, 1:]]) for first, part in zip((1.0, 0.0, 0.0), moved, strict=True)
    )
    return Motion(theta, rate, second, lift, shifts)  # type: ignore[arg-type]


def contact_load(data: ChainInput, lift: tuple[Any, Any, Any], rates: tuple[Any, Any], pressure: Any, mu: Any) -> Any:
    """Return lambda_y [N]: spring, plunger and inertia, raised or lowered by the friction of the guide.

    ``lambda_y = (F_s0 + k y + A p + m (y'' w^2 + y' w')) / (1 - mu |tan phi| sign y')``

    Raises
    ------
    Refusal : the follower jams, ``mu tan(phi) >= 1`` on the rising lift
    """
    pump = data.pump
    y, slope, curve = lift
    rate, second = rates
    axial = pump.spring_preload + pump.spring_stiffness * y + pump.plunger_area * pressure
    axial = axial + pump.follower_mass * (curve * rate**2 + slope * second)
    factor = _guide_factor(data, y, slope, mu)
    if np.min(np.real(factor)) <= 0.0:
        raise _jammed(data, np.real(factor), float(np.real(mu)))
    return axial / factor


def _jammed(data: ChainInput, factor: Array, mu: float) -> Refusal:
    place = int(np.argmin(factor))
    return Refusal(
        f"guide_friction = {mu:.3g}: the follower jams in its guide at {np.degrees(data.theta[place]):.1f} degrees of "
        f"cam angle, where guide friction times the tangent of the pressure angle is {1.0 - factor[place]:.3g}, "
        f"expected less than 1; this cam bears less than {mu / (1.0 - factor[place]):.3g}: lower guide_friction, or "
        "check offset, base circle and lift table"
    )


def _guide_factor(data: ChainInput, y: Any, slope: Any, mu: Any) -> Any:
    rise = data.pump.base_circle_radius + data.pump.roller_radius
    height = np.sqrt(rise**2 - data.offset**2) + y
    tangent = (slope - data.offset) / height
    smooth = friction.SMOOTH_SLOPE
    return 1.0 - mu * np.sqrt(tangent**2 + 1e-12) * slope / np.sqrt(slope**2 + smooth**2)


def mechanical_torque(
    data: ChainInput, lift: tuple[Any, Any, Any], rates: tuple[Any, Any], pressure: Any, mu: Any
) -> tuple[Any, tuple[Any, ...]]:
    """Return the torque on the cam and the columns of `LINEAR_NAMES`; complex arguments give exact derivatives."""
    pump = data.pump
    y, slope, _curve = lift
    rate, second = rates
    load = contact_load(data, lift, rates, pressure, mu)
    height = np.sqrt((pump.base_circle_radius + pump.roller_radius) ** 2 - data.offset**2) + y
    reach = np.sqrt(height**2 + (slope - data.offset) ** 2)
    reach_rate = (height * slope + (slope - data.offset) * lift[2]) / reach
    spin = 1.0 - reach / pump.roller_radius
    roller = data.roller_inertia * spin * (spin * second - reach_rate / pump.roller_radius * rate**2)
    guide = _guide_factor(data, y, slope, mu)
    one = rate / rate
    columns = (
        load * reach / height,
        -load * reach / height * spin,
        one,
        rate,
        slope**2 * rate / guide,
        slope * pump.spring_stiffness * y / guide,
        slope * pump.spring_preload / guide,
    )
    return load * slope + roller, columns


def binned(values: Array) -> Array:
    """Return means over `BIN` neighbouring points along the first axis."""
    return values.reshape(values.shape[0] // BIN, BIN, *values.shape[1:]).mean(axis=1)


def transfer(data: ChainInput, values: Mapping[str, float], n_points: int) -> tuple[Any, Any, Any]:
    """Return shaft and sensor transfer (k,) and the derivative of their product (k, 12) on the harmonics of a grid."""
    omega = np.asarray(np.arange(n_points // 2 + 1) * data.speed, dtype=np.float64)
    shaft, shaft_d = driveline.shaft_transfer(omega, values["cam_side_inertia"], values)
    measured, measured_d = sensor.sensor_transfer(omega, *(values[name] for name in SENSOR_NAMES))
    return shaft, measured, np.column_stack([shaft_d * measured[:, None], measured_d * shaft[:, None]])


def filtered(values: Array, transfer_function: Any) -> Array:
    """Return periodic signals (n,) or (n, k) behind a transfer function on their harmonics."""
    shape = (-1,) + (1,) * (values.ndim - 1)
    spectrum = np.fft.rfft(values, axis=0) * transfer_function.reshape(shape)
    return np.fft.irfft(spectrum, values.shape[0], axis=0)


def chamber_of(data: ChainInput, values: Mapping[str, float], motion: Motion) -> tuple[Array, Array | None, Array]:
    """Return pressure on the plunger, its tangents and the flows; the line pressure itself without the effect."""
    if not data.uses_chamber:
        return data.line_pressure - values["pressure_zero"], None, np.zeros((data.theta.size, 4))
    vector = np.array([values[name] for name in chamber.KERNEL_ORDER])
    time_step = 2.0 * np.pi / data.theta.size / data.speed
    return chamber.integrate_chamber(
        vector, data.pump.plunger_area, data.top_lift, time_step, motion.theta, motion.lift[0], motion.lift[1],
        data.line_pressure, motion.shifts[0],
    )  # fmt: skip


def evaluate_chain(data: ChainInput, values: Mapping[str, float]) -> ChainOutput:
    """Return the measured torque that the chain predicts, apart from its linear parameters."""
    motion = cam_motion(data, values)
    pressure, tangents, flows = chamber_of(data, values, motion)
    rates = (motion.rate, motion.second)
    torque, columns = mechanical_torque(data, motion.lift[:3], rates, pressure, values["guide_friction"])
    load = contact_load(data, motion.lift[:3], rates, pressure, values["guide_friction"])
    stacked = binned(np.column_stack([torque, *columns]))
    if data.lift_basis is not None:
        basis = data.lift_basis.basis(binned(motion.theta), 1)
        stacked = np.column_stack([stacked, binned(load)[:, None] * basis])
    shaft, measured, _ = transfer(data, values, stacked.shape[0])
    stacked = filtered(stacked, shaft * measured) * (1.0 + values["gain_error"])
    return ChainOutput(stacked[:, 0], stacked[:, 1:], motion, pressure, tangents, load, flows)


def chain_derivative(
    data: ChainInput, values: Mapping[str, float], output: ChainOutput, coefficients: Array, names: tuple[str, ...]
) -> Array:
    """Return d(torque)/d(parameter) (m, len(names)) with the linear coefficients held, in bin averages.

    ``coefficients`` are those of the columns of ``output.linear``.
    """
    mechanical = _mechanical_derivative(data, values, output, coefficients, names)
    n_bins = output.torque.size
    shaft, measured, by_filter = transfer(data, values, n_bins)
    gain = 1.0 + values["gain_error"]
    derivative = filtered(mechanical, shaft * measured) * gain
    unfiltered = _unfiltered(data, values, output, coefficients)
    spectrum = np.fft.rfft(unfiltered) * gain
    for k, name in enumerate((*SHAFT_NAMES, *SENSOR_NAMES)):
        if name in names:
            derivative[:, names.index(name)] += np.fft.irfft(spectrum * by_filter[:, k], n_bins)
    if "gain_error" in names:
        derivative[:, names.index("gain_error")] = (output.torque + output.linear @ coefficients) / gain
    return derivative


def _unfiltered(data: ChainInput, values: Mapping[str, float], output: ChainOutput, coefficients: Array) -> Array:
    """Return the torque on the cam in bin averages, linear parts and lift correction included."""
    motion = output.motion
    rates = (motion.rate, motion.second)
    mu = values["guide_friction"]
    torque, columns = mechanical_torque(data, motion.lift[:3], rates, output.pressure, mu)
    n_linear = len(LINEAR_NAMES)
    total = binned(torque + sum(c * column for c, column in zip(coefficients, columns, strict=False)))
    if data.lift_basis is not None:
        slope = data.lift_basis.correction(binned(motion.theta), coefficients[n_linear:], 1)
        total = total + binned(output.load) * slope
    return total


def _mechanical_derivative(
    data: ChainInput, values: Mapping[str, float], output: ChainOutput, coefficients: Array, names: tuple[str, ...]
) -> Array:
    """Return the derivative of the torque on the cam, before shaft and sensor, in bin averages (m, len(names))."""
    motion = output.motion
    y, slope, curve, jerk = motion.lift
    mu = values["guide_friction"]
    correction, correction_d = _correction_slopes(data, motion, coefficients)

    def total(lift: tuple[Any, Any, Any], rates: tuple[Any, Any], pressure: Any, guide: Any, extra: Any) -> Array:
        torque, columns = mechanical_torque(data, lift, rates, pressure, guide)
        torque = torque + contact_load(data, lift, rates, pressure, guide) * extra
        return np.imag(torque + sum(c * v for c, v in zip(coefficients, columns, strict=False))) / COMPLEX_STEP

    step = 1j * COMPLEX_STEP
    lift = (y, slope, curve)
    rates = (motion.rate, motion.second)
    moved = (y + step * slope, slope + step * curve, curve + step * jerk)
    by_angle = total(moved, rates, output.pressure, mu, correction + step * correction_d)
    by_rate = total(lift, (motion.rate + step, motion.second), output.pressure, mu, correction)
    by_second = total(lift, (motion.rate, motion.second + step), output.pressure, mu, correction)
    by_pressure = total(lift, rates, output.pressure + step, mu, correction)
    result = np.zeros((data.theta.size, len(names)))
    shift, rate, second = motion.shifts
    for j, name in enumerate(names):
        if name in SHIFT_NAMES:
            k = SHIFT_NAMES.index(name)
            result[:, j] += by_angle * shift[:, k]
            result[:, j] += by_rate * data.speed * rate[:, k] + by_second * data.speed**2 * second[:, k]
            if output.pressure_tangents is not None:
                result[:, j] += by_pressure * output.pressure_tangents[:, len(chamber.KERNEL_ORDER) + k]
        elif name in chamber.KERNEL_ORDER:
            if output.pressure_tangents is not None:
                result[:, j] += by_pressure * output.pressure_tangents[:, chamber.KERNEL_ORDER.index(name)]
            elif name == "pressure_zero":
                result[:, j] -= by_pressure
        elif name == "guide_friction":
            result[:, j] += total(lift, rates, output.pressure, mu + step, correction)
    return binned(result)


def _correction_slopes(data: ChainInput, motion: Motion, coefficients: Array) -> tuple[Array, Array]:
    """Return slope of the lift correction and its derivative on the fine grid, from the bins' angles."""
    if data.lift_basis is None:
        return np.zeros(data.theta.size), np.zeros(data.theta.size)
    basis, lifts = data.lift_basis, coefficients[len(LINEAR_NAMES) :]
    theta = binned(motion.theta)
    return np.repeat(basis.correction(theta, lifts, 1), BIN), np.repeat(basis.correction(theta, lifts, 2), BIN)
