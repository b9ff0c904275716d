"""`camtorque predict`: torque and forces of a pump from its sheet, or of a run that was not made from a fit."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace

from camtorque.commands import FAULTS, Outcome, Tell
from camtorque.commands.arguments import METHODS
from camtorque.commands.texts import finding_lines, fit_name
from camtorque.grid_choice import grid_note
from camtorque.hashes import input_files
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.jsonable import jsonable
from camtorque.mechanism.flight import Aloft
from camtorque.mechanism.predict import SAMPLES, Prediction, predict, prediction_document, sweep_rows
from camtorque.predict_from import predict_from
from camtorque.records import Finding, Refusal
from camtorque.report.files import inputs_document
from camtorque.report.folder import check_output, output_folder
from camtorque.report.forecast_page import with_band, write_forecast
from camtorque.report.predict_page import write_prediction
from camtorque.units import RPM

WIDTHS = (20, 18, 20, 20, 18)
"""Widths of the columns of a sweep."""
LEFT_OUT = "left_out"
"""Finding of a speed that cannot be predicted, beside others that can."""


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Predict a pump at some speeds; write a page where a folder is given; status 1 where a finding is an error."""
    if arguments.out is not None:
        check_output(arguments.out, "predict.json")
    _refuse_mixed(arguments)
    if arguments.fit is not None:
        return _from_fit(arguments)
    prediction, inputs = _prediction(arguments)
    lines = finding_lines([asdict(row) for row in prediction.findings])
    wrong = {row.code for row in prediction.findings if row.severity == "error"}
    if wrong <= {LEFT_OUT}:  # torque and forces of a cam that cannot be made are those of nothing
        lines += _table(prediction)
    if arguments.out is not None:
        write_prediction(prediction, inputs, arguments.pump.stem, arguments.out)
        lines.append(str(arguments.out / "predict.html"))
    return Outcome(
        "\n".join(lines), jsonable({**prediction_document(prediction), "inputs": inputs}), FAULTS if wrong else 0
    )


def _refuse_mixed(arguments: argparse.Namespace) -> None:
    """Refuse options of a fit without one, and none or both of pump file and fit."""
    of_a_fit = ("load_of", "other_pump", "cam", "clearance", "ending")
    named = [f"--{name.replace('other_', '').replace('_', '-')}" for name in of_a_fit if getattr(arguments, name)]
    if arguments.fit is None and named:
        raise Refusal(f"predict: found {', '.join(named)} without --from, expected a fit; name one with --from RESULT")
    if (arguments.fit is None) == (arguments.pump is None):
        found = "neither PUMP nor --from" if arguments.pump is None else "both PUMP and --from"
        raise Refusal(f"predict: found {found}, expected one of them; another pump with the losses of a fit is --pump")
    if arguments.fit is not None and (arguments.method or arguments.tolerance is not None):
        named = ["--method"] if arguments.method else ["--tolerance"]
        raise Refusal(f"predict: found {named[0]} with --from, expected neither: method and grid are those of the fit")


def _from_fit(arguments: argparse.Namespace) -> Outcome:
    found = predict_from(
        arguments.fit, arguments.speed, pressure=arguments.pressure, load_of=arguments.load_of,
        pump=arguments.other_pump, cam=arguments.cam, clearance=arguments.clearance, ending=arguments.ending,
    )  # fmt: skip
    heads = zip(("torque max, N m", "mean, N m", "chamber, bar", "contact, N", "Hertz, GPa"), WIDTHS, strict=True)
    lines = [f"{'rpm':>8}{''.join(f'{head:>{width}}' for head, width in heads)}  (± 95 %)"]
    for row in found.document["sweep"]:
        keys = ("torque_max_nm", "torque_mean_nm", "chamber_peak_bar", "contact_max_n", "hertz_max_gpa")
        cells = [with_band(row[key]) for key in keys]
        beyond = "  beyond the fitted speeds" if row["beyond_fitted_speeds"] else ""
        beyond += "  THE FOLLOWER LEAVES THE CAM, see below" if row["contact_lost"] else ""
        beyond += "  THE MODEL STEPS HERE, see below" if row["model_steps"] else ""
        columns = "".join(f"{cell:>{width}}" for cell, width in zip(cells, WIDTHS, strict=True))
        lines.append(f"{row['speed_rpm']:8.1f}{columns}{beyond}")
    lines += [str(text) for text in found.document["assumed"]]
    if arguments.out is not None:
        with output_folder(arguments.out, "predict.json") as folder:
            name = fit_name(arguments.fit, [row["id"] for row in found.document["recordings"]])
            write_forecast(found.items, found.document, f"Predicted from {name}", folder)
        lines.append(str(arguments.out / "predict.html"))
    return Outcome("\n".join(lines), found.document)


def _prediction(arguments: argparse.Namespace) -> tuple[Prediction, list[dict[str, str]]]:
    config, notes = read_pump(arguments.pump)
    pressure = None if arguments.pressure is None else read_pressure_curve(arguments.pressure)
    inputs = inputs_document(input_files(arguments.pump, config.pump.cam_table_path, arguments.pressure))
    n_theta = SAMPLES
    if arguments.tolerance is not None:
        n_theta, note = grid_note(arguments.tolerance)
        notes = (*notes, note)
    speeds = [speed * RPM for speed in arguments.speed]

    def at(speeds: Sequence[float]) -> Prediction:
        return predict(config, speeds, pressure, n_theta=n_theta, method=arguments.method or METHODS[0])

    prediction, left_out = _what_lands(at, speeds)
    return replace(prediction, findings=(*notes, *left_out, *prediction.findings)), inputs


def _what_lands(
    at: Callable[[Sequence[float]], Prediction], speeds: Sequence[float]
) -> tuple[Prediction, list[Finding]]:
    """Return the prediction at the speeds that can be predicted, and what is to be said of the others.

    Raises
    ------
    Refusal : there is none
    """
    try:
        return at(speeds), []
    except Aloft as first:
        said: dict[float, str] = {}
        for speed in speeds:
            try:
                at([speed])
            except Aloft as refusal:
                said[speed] = str(refusal)
        kept = [speed for speed in speeds if speed not in said]
        if not kept:
            raise first
        found = [
            Finding(LEFT_OUT, "error", f"no row: {text.removeprefix('contact: ')}", f"{v / RPM:.0f} rpm")
            for v, text in said.items()
        ]
        return at(kept), found


def _table(prediction: Prediction) -> list[str]:
    lines = [f"{'rpm':>8}{'torque max':>12}{'min':>9}{'mean':>9} N m{'contact':>10} N{'Hertz':>8} GPa"]
    for row in sweep_rows(prediction):
        lines.append(
            f"{row['speed_rpm']:8.1f}{row['shaft_torque_max_nm']:12.2f}{row['shaft_torque_min_nm']:9.2f}"
            f"{round(row['shaft_torque_mean_nm'], 3) + 0.0:9.3f}    {row['contact_normal_max_n']:10.0f}"
            f"  {row['hertz_max_gpa']:8.3f}{'  THE FOLLOWER LEAVES THE CAM, see above' if row['contact_lost'] else ''}"
        )
    return lines
