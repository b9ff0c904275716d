"""`camtorque predict`: torque and forces of a pump from its sheet."""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace

from camtorque.commands.outcome import Outcome, Tell
from camtorque.commands.texts import finding_lines
from camtorque.grid_choice import grid_note
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.mechanism.predict import SAMPLES, Prediction, predict, prediction_document, sweep_rows
from camtorque.plain import plain
from camtorque.report import check_output, write_prediction
from camtorque.units import RPM


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Predict a pump at some speeds; write a page where a folder is given."""
    if arguments.out is not None:
        check_output(arguments.out)
    prediction = _prediction(arguments)
    lines = [*finding_lines([asdict(row) for row in prediction.findings]), *_table(prediction)]

    if arguments.out is not None:
        write_prediction(prediction, arguments.pump.stem, arguments.out)
        lines.append(str(arguments.out / "predict.html"))
    return Outcome("\n".join(lines), plain(prediction_document(prediction)))


def _prediction(arguments: argparse.Namespace) -> Prediction:
    config, notes = read_pump(arguments.pump)
    pressure = None if arguments.pressure is None else read_pressure_curve(arguments.pressure)
    n_theta = SAMPLES
    if arguments.tolerance is not None:
        n_theta, note = grid_note(arguments.tolerance)
        notes = (*notes, note)
    speeds = [speed * RPM for speed in arguments.speed]
    prediction = predict(config, speeds, pressure, n_theta=n_theta, method=arguments.method)
    return replace(prediction, findings=(*notes, *prediction.findings))


def _table(prediction: Prediction) -> list[str]:
    lines = [f"{'rpm':>8}{'torque max':>12}{'min':>9}{'mean':>9} N m{'contact':>10} N{'Hertz':>8} GPa"]
    for row in sweep_rows(prediction):
        lines.append(
            f"{row['speed_rpm']:8.1f}{row['shaft_torque_max_nm']:12.2f}{row['shaft_torque_min_nm']:9.2f}"
            f"{row['shaft_torque_mean_nm']:9.3f}    {row['contact_normal_max_n']:10.0f}  {row['hertz_max_gpa']:8.3f}"
        )
    return lines
