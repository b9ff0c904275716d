"""The public face: `import camtorque`. Everything in SI and radians; a suffix (``_rpm``, ``_deg``) marks what is not.

The physics is that of the project's source (a rigid multibody model by decoupled natural orthogonal complements) with
the laws of docs/architecture.md; the numbers are those of the command `camtorque run`.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from camtorque.align import AlignOptions
from camtorque.align import align as _align
from camtorque.arrays import Mark, Sensor, recording_from_arrays
from camtorque.config.pump import PressureCurve as PressureCurve
from camtorque.config.pump import PumpConfig
from camtorque.frames import to_pandas, to_xarray
from camtorque.ingest import read_recording
from camtorque.ingest.check import speed_findings
from camtorque.ingest.pump_file import checked_curve, read_pressure_curve, read_pump
from camtorque.limits import Limit as Limit
from camtorque.mechanism.predict import Prediction
from camtorque.mechanism.predict import predict as _predict
from camtorque.process.threads import on_one_thread
from camtorque.progress import Progress, silent
from camtorque.records import CamCycles, Finding
from camtorque.records import Recording as RecordingRecord
from camtorque.records import Refusal as Refusal
from camtorque.report.bundle import RunResult
from camtorque.report.document import result_document
from camtorque.report.folder import output_folder
from camtorque.report.numbers import plus_minus, rounded_to_error, unit_text
from camtorque.report.write import write_run
from camtorque.run import RunOptions, analyse_recording
from camtorque.units import RPM


class Recording(RecordingRecord):
    """All that one recording holds.

    From a folder by `read`, from arrays by `Recording.from_arrays`. ``recording.of("torque")[0].read()`` returns
    samples in SI.

    Attributes
    ----------
    config : what recording.toml says, in SI
    channels : calibrated channels; ``of(quantity)`` gives those of one quantity
    lift_table : lift over cam angle, None without [pump]
    inputs : files that were read, with their SHA-256
    findings : everything odd about them
    """

    @classmethod
    def from_arrays(
        cls,
        pump: PumpConfig | Path | str,
        *,
        trigger: ArrayLike,
        pressure: ArrayLike,
        torque: ArrayLike | None = None,
        sample_rate: float | Mapping[str, float],
        speed_rpm: float,
        trigger_angle_deg: float,
        trigger_tolerance_deg: float = 2.0,
        trigger_delay: float = 0.0,
        sensors: Mapping[str, Sensor] | None = None,
        name: str = "arrays",
    ) -> Recording:
        """Return a recording of arrays that share one clock; no sheets are needed.

        Parameters
        ----------
        pump : pump file (docs/predict.md), or what `camtorque.ingest.pump_file.read_pump` returns
        trigger : (n,) one pulse per revolution, rising where the cam passes ``trigger_angle_deg``; any unit
        pressure : (m,) pressure in the line at the pump, gauge [Pa]; masked samples are missing
        torque : (k,) drive torque, positive where it drives the cam [N m]; None to align only
        sample_rate : [Hz], one for all arrays or one by name; sample 0 of all was taken at the same time, which the
            index of a pandas series has to agree with
        speed_rpm : nominal cam speed [rpm]
        trigger_angle_deg, trigger_tolerance_deg : nominal cam angle of the pulse, half width of its tolerance [deg]
        trigger_delay : switching delay that is still in ``trigger`` [s]
        sensors : ``{"torque": Sensor(...), "pressure": Sensor(...)}``; a sensor that is left out gets a wide prior
            and a warning among the findings that says which
        name : of the recording

        Returns
        -------
        recording : as one that `read` returns; what had to be assumed stands among its findings

        Raises
        ------
        Refusal : an array that is empty, not of one dimension or without a finite number; arrays of different lengths
            at one rate; a series whose index tells other times; no positive rate or speed; an angle, delay, tolerance
            or uncertainty that none can be; a sensor of another name; a blank name; torque and pressure that cannot
            come from this pump

        Examples
        --------
        >>> recording = Recording.from_arrays(
        ...     "pump.toml", trigger=u, pressure=p, torque=t, sample_rate=20e3, speed_rpm=1000.0, trigger_angle_deg=20.0
        ... )  # doctest: +SKIP
        """
        arrays = {"trigger": trigger, "pressure": pressure} | ({} if torque is None else {"torque": torque})
        pump = pump if isinstance(pump, PumpConfig) else _path(pump, "a pump file")
        mark = Mark(trigger_angle_deg, trigger_tolerance_deg, trigger_delay, speed_rpm)
        return cls.of_record(recording_from_arrays(pump, arrays, sample_rate, mark, sensors or {}, name))

    @classmethod
    def of_record(cls, record: RecordingRecord) -> Recording:
        """Return the same recording with this face."""
        return cls(**vars(record))

    def __repr__(self) -> str:
        channels = ", ".join(f"{c.quantity} {c.duration:.2f} s at {c.sample_rate:g} Hz" for c in self.channels)
        return f"<Recording {self.config.id}: {channels}>"

    def _repr_html_(self) -> str:
        rows = [[c.quantity, f"{c.n_samples}", f"{c.sample_rate:g} Hz", f"{c.duration:.2f} s"] for c in self.channels]
        return _table(f"Recording {self.config.id}", ["channel", "samples", "rate", "duration"], rows, self.findings)


@dataclass(frozen=True, repr=False)
class Result(RunResult):
    """A fitted recording, from `fit`.

    ``result.fitted.parameter("leakage").value``; ``result.document`` is the content of result.json;
    `to_pandas` gives the parameters, `to_xarray` the curves with units.

    Attributes
    ----------
    recording : what was fitted
    cycles : aligned cycles, see `CamCycles`
    rigid : torque by cause and forces of the rigid model
    fitted : fitted torque by cause, parameters, evidence for each loss, chamber pressure, metrics
    findings : everything odd, of the files, the alignment and the fit
    timing : seconds by stage
    created : ISO-8601 with zone
    peak_memory_mb : largest resident size of the process so far, nan where the system does not tell
    limits : what a user wants the numbers to stay within
    """

    @property
    def document(self) -> dict[str, Any]:
        """The content of result.json (docs/result_schema.md)."""
        return result_document(self)

    def to_pandas(self) -> Any:
        """Return the parameters as a pandas.DataFrame; see `camtorque.to_pandas`."""
        return to_pandas(self)

    def to_xarray(self) -> Any:
        """Return cycles, models and forces as an xarray.Dataset; see `camtorque.to_xarray`."""
        return to_xarray(self)

    def __repr__(self) -> str:
        return f"<Result {self._title}>"

    @property
    def _title(self) -> str:
        held = self.fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak
        rigid = self.fitted.metrics["rigid"].rms_percent_of_peak
        return (
            f"{self.recording.config.id}: {self.cycles.mean_speed / RPM:.1f} rpm, {self.cycles.index.size} of "
            f"{self.cycles.cycles_found} cycles; RMS {rigid:.2f} % of the peak rigid, {held:.2f} % fitted (held-out)"
        )

    def _repr_html_(self) -> str:
        rows = [
            [
                row.name,
                rounded_to_error(row.value, row.stderr),
                f"± {plus_minus(row.stderr)}",
                unit_text(row.unit),
                row.knowledge,
            ]
            for row in self.fitted.parameters
        ]
        return _table(self._title, ["parameter", "value", "", "unit", "known by"], rows, self.findings)


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], findings: Sequence[Finding]) -> str:
    """Return a table with its warnings; every text from a file is escaped."""

    def line(tag: str, cells: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    warnings = "".join(f"<li>{html.escape(row.text)}</li>" for row in findings if row.severity != "info")
    body = "".join(line("td", row) for row in rows)
    listed = f"<ul>{warnings}</ul>" if warnings else ""
    return f"<b>{html.escape(title)}</b><table>{line('th', head)}{body}</table>{listed}"


def read(path: Path | str) -> Recording:
    """Read a recording.

    Parameters
    ----------
    path : folder with recording.toml, or that file (docs/recording_toml.md)

    Returns
    -------
    recording : channels in SI; samples stay in the files until they are asked for

    Raises
    ------
    Refusal : a file, channel, unit or sheet is missing or does not fit; the message says which and what to do
    """
    return Recording.of_record(read_recording(_path(path, "a recording")))


@on_one_thread
def align(recording: RecordingRecord | Path | str, n_theta: int = 3600) -> CamCycles:
    """Return the cycles of a recording on one cam-angle grid; torque is not needed.

    Parameters
    ----------
    recording : from `read` or `Recording.from_arrays`, or a path
    n_theta : points of the angle grid

    Returns
    -------
    cycles : ``theta`` (n_theta,) [rad], ``torque`` [N m] and ``pressure`` [Pa] (n_cycles, n_theta), cut-flow, findings

    Raises
    ------
    Refusal : no pulses, no usable cycle
    """
    given = _recording(recording)
    found = _align(given, AlignOptions(n_theta=n_theta))
    told = speed_findings(found.mean_speed, given.config, given.config.id)
    return replace(found, findings=(*found.findings, *told))


def fit(
    recording: RecordingRecord | Path | str, options: RunOptions | None = None, progress: Progress = silent
) -> Result:
    """Align a recording, solve the rigid model and fit the losses; takes some seconds.

    Parameters
    ----------
    recording : from `read` or `Recording.from_arrays`, or a path
    options : choices of alignment and fit, and limits, those of `camtorque run`:
        ``RunOptions(align=AlignOptions(n_theta=1800), limits=(Limit("parameters.leakage.value", None, 0.6),))``
    progress : called with what is being done, such as ``print``

    Returns
    -------
    result : parameters, fitted torque by cause, how sure, findings; `report` writes it

    Raises
    ------
    Refusal : no torque, fewer than four usable cycles, options of another type, or what `align` refuses
    """
    if not isinstance(options, RunOptions | None):
        raise Refusal(
            f"fit: found options of type {type(options).__name__}, expected camtorque.RunOptions, such as "
            "RunOptions(align=AlignOptions(n_theta=1800))"
        )
    found, _ = analyse_recording(_recording(recording), options or RunOptions(), progress)
    return Result(**vars(found))


def report(result: RunResult, out: Path | str) -> Path:
    """Write report.html, result.json, cycles.h5 and the figures, and return the path of the page.

    Parameters
    ----------
    result : from `fit`
    out : folder; an earlier report is replaced, anything else is refused

    Returns
    -------
    page : path of report.html

    Raises
    ------
    Refusal : ``out`` holds something else or cannot be written to; ``result`` is none
    """
    if not isinstance(result, RunResult):
        raise Refusal(f"report: found a {type(result).__name__}, expected what `camtorque.fit` returns")
    folder = _path(out, "the folder of a report")
    with output_folder(folder, "result.json") as partial:
        write_run(result, partial)
    return folder / "report.html"


@on_one_thread
def predict(
    pump: PumpConfig | Path | str,
    speed_rpm: float | Sequence[float],
    pressure: PressureCurve | Path | str | None = None,
    n_theta: int = 3600,
) -> Prediction:
    """Return torque, forces and Hertz stress of a pump without a recording.

    Parameters
    ----------
    pump : pump file (docs/predict.md), or what `camtorque.ingest.pump_file.read_pump` returns
    speed_rpm : one cam speed or several [rpm]
    pressure : on the plunger over cam angle: a CSV file or a `PressureCurve`; None for a dry pump
    n_theta : points of the angle grid

    Returns
    -------
    prediction : ``theta`` (n_theta,) [rad], ``shaft_torque`` (n_speeds, n_theta) [N m], ``pumps`` by speed

    Raises
    ------
    Refusal : a speed that is not positive, a cam that cannot be built, a file that cannot be read, a pressure that is
        neither
    """
    config, notes = (pump, ()) if isinstance(pump, PumpConfig) else read_pump(_path(pump, "a pump file"))
    curve = read_pressure_curve(pressure) if isinstance(pressure, Path | str) else pressure
    if curve is not None and not isinstance(curve, PressureCurve):
        raise Refusal(
            f"predict: found a pressure of type {type(curve).__name__}, expected a CSV file of the pressure over cam "
            "angle or camtorque.PressureCurve(theta, pressure) in rad and Pa"
        )
    if curve is not None and not isinstance(pressure, Path | str):
        curve = checked_curve(curve)
    try:
        speeds = np.asarray(speed_rpm, dtype=np.float64).ravel() * RPM
    except (TypeError, ValueError):
        raise Refusal(f"predict: found the speed {speed_rpm!r}, expected numbers in rpm") from None
    found = _predict(config, speeds, curve, n_theta=n_theta)
    return replace(found, findings=(*notes, *found.findings))


def _path(given: Path | str, what: str) -> Path:
    try:
        return Path(given)
    except TypeError:
        raise Refusal(f"found a value of type {type(given).__name__}, expected the path of {what}") from None


def _recording(given: RecordingRecord | Path | str) -> RecordingRecord:
    return given if isinstance(given, RecordingRecord) else read(given)
