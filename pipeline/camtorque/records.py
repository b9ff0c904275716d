"""The frozen objects handed from room to room, and the two ways of saying that something is wrong.

`Recording` (files, SI) -> `CamCycles` (cam angle) -> `RigidTorque` (mechanism) -> `FittedTorque` (fit).
Everything is SI and radians; a unit suffix marks a border value. Arrays are made read-only at birth.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from camtorque.stacks import mean_of, std_of

Array = NDArray[np.float64]

SEVERITIES = ("info", "warning", "error")
KNOWLEDGE = ("measured", "narrowed", "from the sheet")
"""How far the data went beyond what was known of a parameter before."""
VERDICTS = ("needed", "not needed", "cannot tell")
"""Of a loss: what the data say of it."""


CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Characters that move a cursor, colour a terminal or turn the direction of a text."""


def printable(text: str) -> str:
    """Return a text that may come from a stranger's file with its control characters written out."""
    return CONTROL.sub(lambda found: " " if found[0].isspace() else ascii(found[0])[1:-1], text)


class Refusal(Exception):
    """The input cannot be used; the message says what was found, what was expected, where and what to do.

    The command line prints it as one line on standard error and exits with status 2.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


@dataclass(frozen=True)
class Finding:
    """Something the user has to know about usable data.

    Attributes
    ----------
    code : short identifier such as ``pressure_clipped``
    severity : one of ``info``, ``warning``, ``error``
    text : one sentence a test engineer understands
    where : file, channel, sample or cycle
    """

    code: str
    severity: str
    text: str
    where: str = ""

    def __post_init__(self) -> None:
        if self.severity not in SEVERITIES:
            raise ValueError(f"severity is {self.severity!r}, expected one of {SEVERITIES}")
        for name in ("text", "where"):
            object.__setattr__(self, name, printable(getattr(self, name)))


def freeze_arrays(record: Any) -> None:
    """Make every array attribute of a record read-only (dict values too)."""
    for item in fields(record):
        value = getattr(record, item.name)
        values = value.values() if isinstance(value, Mapping) else (value,)
        for array in values:
            if isinstance(array, np.ndarray):
                array.setflags(write=False)


@dataclass(frozen=True)
class InputFile:
    """A file that was read, with its SHA-256.

    ``digest`` is the hash in hex, or a function that returns it: hashing a large log takes longer than reading it, so
    it is done when the hash is first asked for.
    """

    path: Path
    digest: str | Callable[[], str]

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file in hex."""
        return self.digest if isinstance(self.digest, str) else self.digest()


@dataclass(frozen=True)
class Estimate:
    """A value with its standard uncertainty, in the unit of the quantity that it belongs to."""

    value: float
    stderr: float
    nominal: float = float("nan")
    stderr_statistical: float = float("nan")


@dataclass(frozen=True)
class SensorCalibration:
    """What turns the volts of one sensor into SI: physical = gain * (volts - zero_volts).

    Attributes
    ----------
    serial, quantity : identity
    gain : SI per volt, by least squares through the certificate
    gain_relative_std : relative standard uncertainty of the gain (certificate k=2 halved, fit, span drift)
    zero_volts : volts at zero load: mean of the standstill readings, else of the certificate
    zero_std : standard uncertainty of the zero in SI
    zero_source : ``standstill`` | ``certificate`` | ``idle stretch``
    nonlinearity_std : rms residual of the certificate points in SI
    delay, delay_std : total signal delay and its standard uncertainty [s]
    cutoff_hz : -3 dB frequency of the low-pass, nan when there is none on the sheet
    filter_order, filter_damping : order of the low-pass, 0 when none; its damping ratio, nan where its kind is unknown
    range_min, range_max : nominal range in SI
    output_min_volts, output_max_volts : output range
    """

    serial: str
    quantity: str
    gain: float
    gain_relative_std: float
    zero_volts: float
    zero_std: float
    zero_source: str
    nonlinearity_std: float
    delay: float
    delay_std: float
    cutoff_hz: float
    filter_order: int
    range_min: float
    range_max: float
    output_min_volts: float
    output_max_volts: float
    filter_damping: float = math.nan


class SampleSource(Protocol):
    """Raw samples of one file channel, read in pieces so that files may be larger than memory."""

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        ...

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)`` in the unit of the file."""
        ...


@dataclass(frozen=True)
class Channel:
    """One channel of one logger on a uniform time base: sample i was taken at ``start_time + i / sample_rate``.

    Attributes
    ----------
    quantity : one of `camtorque.quantities.CHANNEL_QUANTITIES`: ``torque`` [N m], ``pressure`` [Pa, gauge], ...
    logger : id of the logger whose clock the times belong to
    source : raw samples [V]
    start_time : time of sample 0 on the logger's clock [s], as the file says
    sample_rate : [Hz]
    calibration : volts to SI; None for pulses, and for values that ``scale`` turns into SI already
    scale : further factor on the raw samples, to volts (mV files: 1e-3)
    sign : -1 where the reading is turned (negative rotation, inverted torque)
    path, name : where it came from
    breaks, break_steps : samples before which the file's own time jumps, and by how much more than one step [s]
        (``start_time`` and ``sample_rate`` hold up to the first break)
    """

    quantity: str
    logger: str
    source: SampleSource
    start_time: float
    sample_rate: float
    calibration: SensorCalibration | None
    path: Path
    name: str
    scale: float = 1.0
    sign: float = 1.0
    breaks: tuple[int, ...] = ()
    break_steps: tuple[float, ...] = ()

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.source.n_samples

    @property
    def duration(self) -> float:
        """Time from the first to one step past the last sample [s]."""
        return self.n_samples / self.sample_rate

    def read_volts(self, start: int = 0, stop: int | None = None) -> Array:
        """Return samples ``[start, stop)`` in volts."""
        stop = self.n_samples if stop is None else stop
        raw = self.source.read(start, stop)
        return raw if self.scale == 1.0 else raw * self.scale

    def read(self, start: int = 0, stop: int | None = None) -> Array:
        """Return samples ``[start, stop)`` in SI (volts for an uncalibrated channel)."""
        return self.from_volts(self.read_volts(start, stop))

    def from_volts(self, volts: Array) -> Array:
        """Return in SI what samples in volts mean (volts for an uncalibrated channel)."""
        if self.calibration is None:
            return volts
        return (self.sign * self.calibration.gain) * (volts - self.calibration.zero_volts)


@dataclass(frozen=True)
class CamTable:
    """A lift table along the direction of running.

    Attributes
    ----------
    theta : (n,) cam angle, strictly increasing, one revolution without its repeated end point [rad]
    lift : (n,) [m]
    resolution : step to which the lift is rounded [m]
    """

    theta: Array
    lift: Array
    resolution: float

    def __post_init__(self) -> None:
        if self.theta.shape != self.lift.shape or self.theta.ndim != 1:
            raise ValueError(f"lift table: theta {self.theta.shape} and lift {self.lift.shape} differ")
        if not np.all(np.diff(self.theta) > 0.0) or self.theta[-1] - self.theta[0] >= 2.0 * np.pi:
            raise ValueError("lift table: angles have to increase strictly within one revolution")
        freeze_arrays(self)


@dataclass(frozen=True)
class Recording:
    """All that one folder holds: configuration, calibrated channels, cam table, files read, findings.

    ``config`` is a `camtorque.config.RecordingConfig`; ``lift_table`` is None where recording.toml has no [pump]: read
    it as ``cam_table``, which refuses then.
    """

    config: Any
    channels: tuple[Channel, ...]
    lift_table: CamTable | None
    inputs: tuple[InputFile, ...]
    findings: tuple[Finding, ...]

    @property
    def cam_table(self) -> CamTable:
        """The lift table; refused where there is none."""
        if self.lift_table is None:
            raise Refusal(f"{self.config.path}: the table [pump] with its cam_table is missing; the model needs it")
        return self.lift_table

    def of(self, quantity: str) -> tuple[Channel, ...]:
        """Return the channels of a quantity, in the order of the configuration."""
        return tuple(channel for channel in self.channels if channel.quantity == quantity)


@dataclass(frozen=True)
class CutFlowRow:
    """One line of the cut-flow: cycles that fail this cut alone, and those left after it and all before it."""

    reason: str
    cycles: int
    text: str
    cycles_single: int = 0
    cycles_left: int = 0


@dataclass(frozen=True)
class ClockFit:
    """Clock of a logger against that of the torque's logger: t_logger = offset + (1 + skew) t [s, ppm]."""

    logger: str
    offset_s: float
    skew_ppm: float
    stderr_s: float
    method: str = "same clock"


@dataclass(frozen=True)
class AngleError:
    """One source of the angle error budget, before the fit."""

    source: str
    std_deg: float
    text: str = ""


@dataclass(frozen=True)
class CamCycles:
    """Cycles on one cam-angle grid with nominal alignment (declared delays off, nominal trigger angle).

    Attributes
    ----------
    theta : (n_theta,) uniform from 0, end point excluded [rad]
    torque : (n_cycles, n_theta) [N m], or None for a recording without torque
    pressure : (n_cycles, n_theta) line pressure, gauge [Pa]; (0, n_theta) for a recording without pressure
    channels : quantity -> (n_cycles, n_theta), all other channels [SI]; nan in cycles that a channel does not cover
    speed : (n_cycles,) mean cam speed of the cycle [rad/s]
    index : (n_cycles,) cycle number in the recording
    held_out : (n_cycles,) True for the cycles that score (even numbers among the used)
    cycles_found : complete cycles in the recording
    speed_ripple_percent : spread of the cycle speeds, 100 * std / mean
    """

    theta: Array
    torque: Array | None
    pressure: Array
    speed: Array
    index: NDArray[np.int64]
    held_out: NDArray[np.bool_]
    cycles_found: int
    duration: float
    speed_ripple_percent: float
    cut_flow: tuple[CutFlowRow, ...]
    clocks: tuple[ClockFit, ...]
    angle_errors: tuple[AngleError, ...]
    trigger_jitter_s: float
    findings: tuple[Finding, ...]
    torque_delay: Estimate
    details: Mapping[str, Any] = field(default_factory=dict)
    channels: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n_cycles = self.speed.size
        shape = (n_cycles, self.theta.size)
        known = [self.pressure] if self.pressure.size else []
        known += [] if self.torque is None else [self.torque]
        if any(values.shape != shape for values in (*known, *self.channels.values())):
            raise ValueError(f"cycles: expected arrays of shape {shape}, found pressure {self.pressure.shape}")
        if self.index.shape != (n_cycles,) or self.held_out.shape != (n_cycles,):
            raise ValueError("cycles: index and held_out need one entry per cycle")
        freeze_arrays(self)

    @property
    def mean_speed(self) -> float:
        """Mean cam speed [rad/s]."""
        return float(np.mean(self.speed))

    @cached_property
    def mean_torque(self) -> Array:
        """Mean torque of the used cycles (n_theta,) [N m]; only with a torque."""
        return mean_of(cast(Array, self.torque))

    @cached_property
    def mean_pressure(self) -> Array:
        """Mean line pressure of the used cycles (n_theta,) [Pa]; only with a pressure."""
        return mean_of(self.pressure)

    @cached_property
    def torque_std(self) -> Array:
        """Standard deviation of the torque over the used cycles (n_theta,) [N m], nan for one; only with a torque."""
        if self.index.size < 2:
            return np.full(self.theta.size, np.nan)
        return std_of(cast(Array, self.torque), self.mean_torque, 1)

    def means(self, quantity: str) -> Array:
        """Return the mean over each cycle of one of ``channels`` (n_cycles,) [SI]."""
        return np.asarray(np.mean(self.channels[quantity], axis=1), dtype=np.float64)


@dataclass(frozen=True)
class Forces:
    """Forces over the angle grid, each (n_theta,).

    contact_normal, contact_tangential, bearing_x, bearing_y, guide [N]; guide_moment [N m] about the roller centre;
    hertz [Pa]; hertz_shear_max [Pa] and hertz_shear_depth [m] below the surface.
    """

    contact_normal: Array
    contact_tangential: Array
    bearing_x: Array
    bearing_y: Array
    guide: Array
    guide_moment: Array
    hertz: Array
    hertz_shear_max: Array
    hertz_shear_depth: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True)
class RigidTorque:
    """The rigid DeNOC solution on the angle grid.

    Attributes
    ----------
    torque : (n_theta,) driving torque [N m]
    by_cause : name -> (n_theta,) torque of pressure, spring, inertia, ... ; they sum to ``torque``
    forces : contact, joint forces and Hertz stress
    lift, lift_velocity, lift_acceleration : (n_theta,) y [m], y' [m/rad], y'' [m/rad^2]
    contact_lost : True where the follower leaves the cam anywhere
    """

    theta: Array
    torque: Array
    by_cause: Mapping[str, Array]
    forces: Forces
    lift: Array
    lift_velocity: Array
    lift_acceleration: Array
    contact_lost: bool

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True)
class Metrics:
    """How well a model torque meets the measured mean cycle; definitions in docs/result_schema.md."""

    rms_nm: float
    rms_percent_of_peak: float
    forward_gap_percent: float
    forward_peak_error_nm: float
    return_min_measured_nm: float
    return_min_model_nm: float
    return_rms_nm: float


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter as it is reported.

    ``stderr`` and ``ci95`` are total (model spread included), ``stderr_statistical`` is beside them. ``prior`` is
    (mean, std) or None; ``role`` is ``shared``, ``own`` (nuisance of one recording) or ``assumed`` (not fitted).
    """

    name: str
    value: float
    unit: str
    stderr: float
    stderr_statistical: float
    ci95: tuple[float, float]
    at_bound: bool
    identifiable: bool
    confounded_with: tuple[str, ...]
    prior: tuple[float, float] | None
    meaning: str
    source: str
    role: str = "shared"
    symbol: str = ""
    knowledge: str = "from the sheet"

    def __post_init__(self) -> None:
        if self.knowledge not in KNOWLEDGE:
            raise ValueError(f"{self.name}: knowledge is {self.knowledge!r}, expected one of {KNOWLEDGE}")


@dataclass(frozen=True)
class LossEvidence:
    """What the data say about one loss (a group of parameters that vanish together).

    Attributes
    ----------
    name : loss, such as ``friction``
    two_ln_bayes_factor : 2 ln of the Bayes factor for the loss against its absence; nan where it was not computed
    verdict : ``needed``, ``not needed`` or ``cannot tell``
    confirmed_by_refit : True where a fit without the loss was made
    size, size_ci95, unit : how much the loss moves the mean cycle (rms torque [N m] or angle [deg])
    text : one sentence a test engineer understands
    """

    name: str
    two_ln_bayes_factor: float
    verdict: str
    confirmed_by_refit: bool
    size: float
    size_ci95: tuple[float, float]
    unit: str
    text: str = ""

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise ValueError(f"{self.name}: verdict is {self.verdict!r}, expected one of {VERDICTS}")


@dataclass(frozen=True)
class ResidualBump:
    """A stretch of the revolution where the residual stands out of what the cycles repeat.

    start, stop : cam angle [rad]; peak : largest residual [N m]; times_repeatability : its rms over that of odd
    against even cycles; phase : what the pump does there, in words; frequency : at which most of it swings [Hz], 0
    where it does not swing
    """

    start: float
    stop: float
    peak: float
    times_repeatability: float
    phase: str
    frequency: float = 0.0


@dataclass(frozen=True)
class Alternative:
    """Another structure of the model (or another minimum), and how probable the data make it.

    name : ``closed by land``, ``spill``, ``no end seen``, ``line pressure on the plunger``, ...; probability : among
    all that were fitted; trigger_angle [rad] and chamber_peak [Pa] : what it would say
    """

    name: str
    probability: float
    rms_nm: float
    trigger_angle: float
    chamber_peak: float


@dataclass(frozen=True)
class FittedTorque:
    """The fitted model of one recording on its angle grid.

    Attributes
    ----------
    effects : chosen effects
    parameters : every parameter, fitted or assumed
    correlation : (k, k) of the parameters named in ``correlation_names``
    torque : (n_theta,) fitted model for the mean of the fitted cycles [N m]
    torque_held_out : (n_theta,) the same parameters on the pressure of the held-out cycles [N m]
    by_cause : cause -> (n_theta,) [N m]; causes sum to ``torque``
    chamber_pressure : (n_theta,) rebuilt pressure on the plunger [Pa, gauge]
    chamber_pressure_std : (n_theta,) its total standard uncertainty [Pa]
    true_angle : (n_theta,) cam angle of each grid point after trigger angle, twist and delay [rad]
    forces : forces of the fitted model
    losses : cause -> J per revolution, with ``input`` and ``closure_percent``
    metrics : ``rigid``, ``fitted``, ``fitted_held_out_cycles``
    angle_errors_after : the angle error budget after the fit
    evidence : for each loss, whether the data need it
    alternatives : structures that were fitted, the chosen one first
    bumps : where the residual stands out
    explained : False where the residual is above three times odd-even and 0.15 % of the peak
    """

    effects: tuple[str, ...]
    parameters: tuple[ParameterEstimate, ...]
    correlation: Array
    correlation_names: tuple[str, ...]
    torque: Array
    torque_held_out: Array
    by_cause: Mapping[str, Array]
    chamber_pressure: Array | None
    chamber_pressure_std: Array | None
    chamber_peak: Estimate | None
    chamber_return_start: Estimate | None
    true_angle: Array
    forces: Forces
    contact_lost: bool
    losses: Mapping[str, float]
    metrics: Mapping[str, Metrics]
    trigger_angle: Estimate
    torque_delay: Estimate
    angle_errors_after: tuple[AngleError, ...]
    odd_even_rms: float
    next_measurement: tuple[str, ...]
    findings: tuple[Finding, ...]
    details: Mapping[str, Any] = field(default_factory=dict)
    evidence: tuple[LossEvidence, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    bumps: tuple[ResidualBump, ...] = ()
    explained: bool = True

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def parameter(self, name: str) -> ParameterEstimate:
        """Return the parameter of that name."""
        for estimate in self.parameters:
            if estimate.name == name:
                return estimate
        raise KeyError(f"no parameter {name!r}; there are {[p.name for p in self.parameters]}")
