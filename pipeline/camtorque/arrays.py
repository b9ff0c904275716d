"""Arrays in SI -> `Recording`: no files, no sheets; what nothing tells gets a wide prior and a finding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from camtorque.config import ChannelSpec, LoggerSpec, RecordingConfig, SensorRef, TriggerSpec
from camtorque.config.pump import PumpConfig
from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.config.recording import place_findings
from camtorque.config.schemas import CAM_SPEED, SENSOR_DELAY, SWITCH_DELAY
from camtorque.ingest.plausibility import check_loads
from camtorque.ingest.pump_file import read_pump
from camtorque.ingest.raw import ArraySource
from camtorque.ingest.sensors import usual_delay
from camtorque.mechanism.predict import cam_of
from camtorque.records import Array, CamTable, Channel, Finding, Recording, Refusal, SensorCalibration
from camtorque.units import DEGREE, RPM

IN_MEMORY = Path("arrays")
"""Stands for the file of a channel that came as an array."""
QUANTITIES = ("torque", "pressure", "trigger")
WHOLE_TURN_DEG = 360.0
WIDE_GAIN_STD, WIDE_ZERO_SHARE, WIDE_DELAY_STD = 0.01, 0.005, 5.0e-5
"""Of a sensor without a sheet: relative gain, zero as a share of the largest reading, delay [s]. A transducer of class
1 with a certificate stays within half of the first two; the third is half a sample at 10 kHz."""
MOST_GAIN_STD, MOST_ORDER = 0.5, 20
"""Relative gain [-] and order of a filter beyond which a number is a slip of unit."""
ODD_STEP, ODD_START, MOST_DRIFT = 1.5, 0.01, 1.0e-3
"""A step in a series' index from which on it is odd, and beginnings that are two, in sampling intervals; relative
difference of the rate that the index tells from ``sample_rate`` which is none of rounding."""
TABLE_ANGLES = 720
"""Angles at which a cam that is given by sections is tabulated: every half degree."""


@dataclass(frozen=True)
class Sensor:
    """What is known of a sensor whose readings are in SI already.

    Attributes
    ----------
    gain_std : relative standard uncertainty of the gain [-]
    zero_std : standard uncertainty of the zero [N m or Pa]; None for 0.5 % of the largest reading
    delay, delay_std : total delay that is still in the readings, and its standard uncertainty [s]; a delay of None is
        unknown: that of usual amplifiers, no less than that of the low-pass, +- 100 %, as for a sheet that states none
    cutoff_hz, filter_order : -3 dB frequency [Hz] and order of the low-pass in front; nan and 0 where they are not
        known: that of a torque is then fitted from 1 kHz +- 100 %, as for a sheet that states none
    location : where it sits, in words, as in recording.toml: a pressure sensor in the chamber says so
    """

    gain_std: float = WIDE_GAIN_STD
    zero_std: float | None = None
    delay: float | None = None
    delay_std: float = WIDE_DELAY_STD
    cutoff_hz: float = float("nan")
    filter_order: int = 0
    location: str = ""

    def __post_init__(self) -> None:
        _within(self.gain_std, 0.0, MOST_GAIN_STD, "Sensor gain_std")
        _within(0.0 if self.zero_std is None else self.zero_std, 0.0, np.inf, "Sensor zero_std")
        _within(0.0 if self.delay is None else self.delay, SENSOR_DELAY.low, SENSOR_DELAY.high, "Sensor delay [s]")
        _within(self.delay_std, SENSOR_DELAY.low, SENSOR_DELAY.high, "Sensor delay_std [s]")
        if not (isinstance(self.cutoff_hz, Real) and np.isnan(self.cutoff_hz)):
            _positive(self.cutoff_hz, "Sensor cutoff_hz")
        _within(self.filter_order, 0, MOST_ORDER, "Sensor filter_order")
        if self.filter_order % 1:
            raise Refusal(f"Sensor filter_order: found {self.filter_order!r}, expected a whole number")
        if not isinstance(self.location, str):
            raise Refusal(f"Sensor location: found {self.location!r}, expected words such as 'plunger chamber'")
        object.__setattr__(self, "filter_order", int(self.filter_order))


@dataclass(frozen=True)
class Mark:
    """The trigger: cam angle of its rising edge and half width of its mounting tolerance [deg], switching delay [s].

    ``speed_rpm`` is the nominal cam speed [rpm].
    """

    angle_deg: float
    tolerance_deg: float
    delay: float
    speed_rpm: float

    def __post_init__(self) -> None:
        _within(self.speed_rpm, CAM_SPEED.low, CAM_SPEED.high, "speed_rpm")
        _within(self.angle_deg, -WHOLE_TURN_DEG, WHOLE_TURN_DEG, "trigger_angle_deg")
        _within(self.tolerance_deg, 0.0, WHOLE_TURN_DEG / 2.0, "trigger_tolerance_deg")
        _within(self.delay, SWITCH_DELAY.low, SWITCH_DELAY.high, "trigger_delay [s]")


def recording_from_arrays(
    pump: PumpConfig | Path | str,
    arrays: Mapping[str, ArrayLike],
    rates: float | Mapping[str, float],
    mark: Mark,
    sensors: Mapping[str, Sensor],
    name: str,
) -> Recording:
    """Return a recording of arrays in SI on one clock; see `camtorque.Recording.from_arrays`."""
    _refuse_strange(sensors)
    if not (isinstance(name, str) and name.strip()):
        raise Refusal(f"name: found {name!r}, expected a text; pages and tables go by it")
    config, notes = (pump, ()) if isinstance(pump, PumpConfig) else read_pump(pump)
    values = {quantity: _checked(arrays[quantity], quantity) for quantity in QUANTITIES if quantity in arrays}
    every = {quantity: _rate(rates, quantity) for quantity in values}
    sizes = {quantity: array.size for quantity, array in values.items()}
    if not isinstance(rates, Mapping) and len(set(sizes.values())) > 1:
        raise Refusal(
            f"arrays at one sample_rate: found {', '.join(f'{size} of {name}' for name, size in sizes.items())} "
            "samples, expected as many of each; give a sample_rate by name, or cut them to what they share"
        )
    _refuse_other_times({name: arrays[name] for name in values}, every)
    channels = tuple(
        _channel(quantity, array, every[quantity], sensors.get(quantity)) for quantity, array in values.items()
    )
    of_recording = _config(config, channels, mark, name, sensors)
    findings = (
        *notes,
        *place_findings(of_recording),
        *(_assumed(channel) for channel in channels if channel.quantity not in sensors and channel.calibration),
        *(finding for channel in channels for finding in _left_open(channel, sensors.get(channel.quantity))),
    )
    recording = Recording(of_recording, channels, _table(config), (), findings)
    return replace(recording, findings=(*findings, *check_loads(recording)))


def _refuse_strange(sensors: Mapping[str, Sensor]) -> None:
    if not isinstance(sensors, Mapping):
        raise Refusal(
            f"sensors: found a {type(sensors).__name__}, expected one by name, such as {{'torque': Sensor(...)}}"
        )
    strange = [key for key in sensors if key not in ("torque", "pressure")]
    if strange:
        raise Refusal(f"sensors: found {strange[0]!r}, expected 'torque' and 'pressure' as keys")
    for key, sensor in sensors.items():
        if not isinstance(sensor, Sensor):
            raise Refusal(
                f"sensors[{key!r}]: found {sensor!r}, expected a camtorque.Sensor, such as Sensor(gain_std=0.002)"
            )


def _checked(values: ArrayLike, quantity: str) -> Array:
    given: Any = np.ma.asanyarray(values)
    if given.dtype.kind not in "biuf":
        raise Refusal(f"{quantity}: found values of type {given.dtype}, expected real numbers in SI")
    array = np.ma.filled(given.astype(np.float64), np.nan)
    if array.ndim != 1 or array.size < 2:
        raise Refusal(
            f"{quantity}: found an array of shape {array.shape}, expected one dimension and 2 samples or more"
        )
    # beyond the logger's range: missing, as in a file
    array[np.isinf(array)] = np.nan
    if np.isnan(array).all():
        raise Refusal(f"{quantity}: found no finite number among {array.size} samples, expected readings in SI")
    return array


def _refuse_other_times(arrays: Mapping[str, ArrayLike], rates: Mapping[str, float]) -> None:
    """Refuse series whose index says that their samples are not evenly spaced at the rate, or do not begin together."""
    begun: dict[str, tuple[str, float]] = {}
    for name, array in arrays.items():
        index: Any = getattr(array, "index", None)
        if not hasattr(index, "to_numpy"):
            continue
        values = np.asarray(index.to_numpy())
        kind = "dates" if values.dtype.kind in "mM" else "numbers"
        if kind == "numbers" and values.dtype.kind not in "iuf":
            continue
        seconds = _index_seconds(values, rates[name])
        _refuse_uneven(name, seconds, rates[name])
        other, first = begun.setdefault(kind, (name, float(seconds[0])))
        if abs(seconds[0] - first) * rates[name] > ODD_START:
            raise Refusal(
                f"{name}: found an index that begins {seconds[0] - first:.6g} s from that of {other}, expected one "
                "beginning; cut them to what they share, or give to_numpy() of each if the indices mean nothing"
            )


def _index_seconds(values: NDArray[Any], rate: float) -> Array:
    """Return the times that the index of a pandas series tells [s]; whole numbers, or steps of one, count samples."""
    if values.dtype.kind in "mM":
        return np.asarray((values - np.zeros(1, values.dtype)) / np.timedelta64(1, "s"))
    counts = values.dtype.kind in "iu" or bool(np.all(np.diff(values) == 1.0))
    return np.asarray(values / rate if counts else values, dtype=np.float64)


def _refuse_uneven(name: str, seconds: Array, rate: float) -> None:
    steps = np.diff(seconds)
    usual = max(1.0 / rate, float(np.median(steps[steps > 0.0]))) if np.any(steps > 0.0) else 1.0 / rate
    # rounded times are shared by samples, and step by more than one
    odd = np.flatnonzero(~((steps >= 0.0) & (steps < ODD_STEP * usual)))
    mean = float(np.mean(steps))
    if odd.size or abs(mean * rate - 1.0) > MOST_DRIFT + usual * rate / steps.size:
        found = f"{steps[odd[0]]:.6g} s behind sample {odd[0]}" if odd.size else f"{mean:.6g} s"
        raise Refusal(
            f"{name}: found an index that steps by {found}, expected {1.0 / rate:.6g} s at a sample_rate of {rate:g} "
            "Hz; sort the series and keep missing samples as NaN, correct sample_rate, or give "
            f"{name}.to_numpy() if the index means nothing"
        )


def _rate(rates: float | Mapping[str, float], quantity: str) -> float:
    if isinstance(rates, Mapping) and quantity not in rates:
        raise Refusal(f"sample_rate: found no entry {quantity!r}, expected one per array or one number [Hz] for all")
    rate = rates[quantity] if isinstance(rates, Mapping) else rates
    return _positive(rate, "sample_rate")


def _positive(value: float, what: str) -> float:
    if not (isinstance(value, Real) and 0.0 < value <= np.finfo(np.float64).max):
        raise Refusal(f"{what}: found {value!r}, expected a positive number")
    return float(value)


def _within(value: float, low: float, high: float, what: str) -> None:
    if not (isinstance(value, Real) and low <= value <= high):
        raise Refusal(f"{what}: found {value!r}, expected a number from {low:g} to {high:g}")


def _channel(quantity: str, values: Array, rate: float, sensor: Sensor | None) -> Channel:
    calibration = None if quantity == "trigger" else _calibration(quantity, values, sensor or Sensor())
    return Channel(quantity, "arrays", ArraySource(values), 0.0, rate, calibration, IN_MEMORY, quantity)


def _calibration(quantity: str, values: Array, sensor: Sensor) -> SensorCalibration:
    """Return the identity with the sensor's uncertainties; arrays have no end of a range where they could clip."""
    largest = float(np.nanmax(np.abs(values)))
    zero_std = WIDE_ZERO_SHARE * largest if sensor.zero_std is None else sensor.zero_std
    delay, delay_std = (sensor.delay, sensor.delay_std) if sensor.delay is not None else usual_delay(
        quantity, sensor.cutoff_hz, sensor.filter_order
    )  # fmt: skip
    return SensorCalibration(
        quantity, gain_relative_std=sensor.gain_std, zero_std=zero_std, nonlinearity_std=0.0, delay=delay,
        delay_std=delay_std, cutoff_hz=sensor.cutoff_hz, filter_order=sensor.filter_order, range_min=-largest,
        range_max=largest,
    )  # fmt: skip


def _assumed(channel: Channel) -> Finding:
    assert channel.calibration is not None
    shown = CHANNEL_QUANTITIES[channel.quantity]
    zero, delay = channel.calibration.zero_std * shown.shown_factor, 1e3 * channel.calibration.delay
    low_pass = ", low-pass 1 kHz ± 100 %" if channel.quantity == "torque" else ""
    text = (
        f"nothing is known of the {channel.quantity} sensor; assumed: gain ± {100.0 * WIDE_GAIN_STD:g} %, zero ± "
        f"{zero:.2g} {shown.shown_unit}, delay {delay:g} ms ± 100 %{low_pass}; give "
        f"sensors={{{channel.quantity!r}: Sensor(...)}}"
    )
    return Finding("sensor_assumed", "warning", text, channel.name)


def _left_open(channel: Channel, sensor: Sensor | None) -> list[Finding]:
    """Return a warning on each thing that acts in the fit and that a sensor was given without."""
    if sensor is None or channel.calibration is None:
        return []
    open_to = {}
    if sensor.delay is None:
        open_to["delay", "delay"] = f"{1e3 * channel.calibration.delay:.3g} ms ± 100 %"
    if channel.quantity == "torque" and np.isnan(sensor.cutoff_hz):
        open_to["low-pass", "cutoff_hz"] = "1 kHz ± 100 %"
    return [
        Finding(
            f"{what.replace('-', '_')}_assumed", "warning",
            f"nothing states the {what} of the {channel.quantity} sensor; {value} is assumed, give {key} in its Sensor",
            channel.name,
        )
        for (what, key), value in open_to.items()
    ]  # fmt: skip


def _config(
    pump: PumpConfig, channels: tuple[Channel, ...], mark: Mark, name: str, sensors: Mapping[str, Sensor]
) -> RecordingConfig:
    sitting = {
        quantity: SensorRef(quantity, "", None, None, None, location=sensor.location)
        for quantity, sensor in sensors.items()
        if sensor.location
    }
    specs = (ChannelSpec(c.quantity, IN_MEMORY, "", c.name, "", c.logger, c.sample_rate, "") for c in channels)
    sampled = ", ".join(f"{c.quantity} {c.sample_rate:g} Hz" for c in channels)
    text = f"# arrays, sampled at {sampled}; pump file:\n{pump.text}"
    trigger = TriggerSpec(mark.angle_deg * DEGREE, mark.tolerance_deg * DEGREE, switching_delay=mark.delay)
    return RecordingConfig(
        path=IN_MEMORY, text=text, id=name, pump_id=pump.path.stem, nominal_speed=mark.speed_rpm * RPM,
        file_format="arrays", csv_dialect="", rotation=pump.rotation, pump_sheet=pump.pump, trigger=trigger,
        sensors=sitting, loggers=(LoggerSpec("arrays", "single"),), channels=tuple(specs),
    )  # fmt: skip


def _table(pump: PumpConfig) -> CamTable:
    if pump.cam_table is not None:
        return pump.cam_table
    theta = np.linspace(0.0, 2.0 * np.pi, TABLE_ANGLES, endpoint=False)
    # a drawn cam has no rounding; a nanometre keeps what divides by the resolution finite
    return CamTable(theta, cam_of(pump).evaluate(theta, 0), 1.0e-9)
