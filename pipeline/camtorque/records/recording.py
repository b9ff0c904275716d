"""What `ingest` hands on: files, sensors and channels in SI, the lift table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from camtorque.records.base import Array, Finding, ReadOnly, Refusal


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
class SensorCalibration:
    """What turns the volts of one sensor into SI: physical = gain * (volts - zero_volts); nan for what is not known.

    Attributes
    ----------
    quantity, serial : identity
    gain : SI per volt, by least squares through the certificate
    gain_relative_std : relative standard uncertainty of the gain (certificate k=2 halved, fit, span drift)
    zero_volts : volts at zero load: mean of the standstill readings, else of the certificate
    zero_std : standard uncertainty of the zero in SI
    zero_source : ``standstill`` | ``certificate`` | ``idle stretch``
    nonlinearity_std : rms residual of the certificate points in SI
    delay, delay_std : total signal delay and its standard uncertainty [s]
    cutoff_hz : -3 dB frequency of the low-pass, nan where nothing states it
    filter_order, filter_damping : order of the low-pass, 0 when none; its damping ratio, nan where its kind is unknown
    range_min, range_max : nominal range in SI
    output_min_volts, output_max_volts : output range
    calibrated_to : largest load of its certificate in SI, infinite where none has points
    saturates : whether its end is that of an amplifier; nominal ranges of values that a logger has scaled are passed
    """

    quantity: str
    serial: str = ""
    gain: float = 1.0
    gain_relative_std: float = math.nan
    zero_volts: float = 0.0
    zero_std: float = math.nan
    zero_source: str = "certificate"
    nonlinearity_std: float = math.nan
    delay: float = 0.0
    delay_std: float = math.nan
    cutoff_hz: float = math.nan
    filter_order: int = 0
    range_min: float = math.nan
    range_max: float = math.nan
    output_min_volts: float = -math.inf
    output_max_volts: float = math.inf
    filter_damping: float = math.nan
    saturates: bool = True
    calibrated_to: float = math.inf

    @property
    def largest_reading(self) -> float:
        """Largest size of a reading in the nominal range [SI]; the range of one direction may end at zero."""
        return max(abs(self.range_min), abs(self.range_max))


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
    quantity : one of `camtorque.config.quantities.CHANNEL_QUANTITIES`: ``torque`` [N m], ``pressure`` [Pa, gauge], ...
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
    def where(self) -> str:
        """File and name, for findings and refusals."""
        return f"{self.path.name}, channel {self.name!r}"

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


MOST_LOBES = 12
"""Lobes of one cam at most: a lift that repeats itself oftener, or a 36th of a turn, is something else."""


@dataclass(frozen=True)
class CamTable(ReadOnly):
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
        super().__post_init__()

    def at(self, theta: NDArray[np.floating[Any]]) -> Array:
        """Return the lift at any cam angles [rad], straight between the points of the table [m]."""
        return np.interp(theta, self.theta, self.lift, period=2.0 * np.pi)


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
