"""The `camtorque` command: reads its arguments, calls one room, prints. The only room that prints.

Exit status: 0 done, 1 a campaign with refused recordings (or findings of severity error in `check`), 2 refused,
70 an unexpected error, 130 stopped by the user.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

from camtorque import __version__

REFUSED, UNEXPECTED, STOPPED = 2, 70, 130
STUDIES = ("speed-accuracy", "stability")
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Threads of the linear algebra: the matrices are small, and a campaign already fills the processors."""


class OneLineParser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and leave with status 2."""
        self.exit(REFUSED, f"{self.prog}: {message}; see {self.prog} --help\n")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = OneLineParser(prog="camtorque", description="Measured-vs-model drive torque of cam-driven pumps.")
    parser.add_argument("--version", action="version", version=f"camtorque {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (_, help_text, add_arguments) in COMMANDS.items():
        command = commands.add_parser(name, help=help_text, description=help_text)
        add_arguments(command)
        command.add_argument("--quiet", action="store_true", help="no progress lines on standard error")
        command.add_argument("--debug", action="store_true", help="show where an unexpected error arose")
    return parser


def _recording_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="folder with recording.toml, or that file")


def _output_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to be written")


def _align_arguments(parser: argparse.ArgumentParser) -> None:
    _recording_arguments(parser)
    _output_argument(parser)
    _grid_argument(parser)


def _grid_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--n-theta", type=int, metavar="N", help="points of the angle grid (default 3600)")


def _fit_arguments(parser: argparse.ArgumentParser) -> None:
    _grid_argument(parser)
    parser.add_argument("--effects", metavar="A,B,...", help="effects that are offered to the ladder (default: all)")
    parser.add_argument("--no-ladder", action="store_true", help="keep every offered effect, needed or not")
    parser.add_argument(
        "--tolerance", type=float, metavar="SHARE", help="wanted error of grid and curve, share of the peak torque"
    )


def _run_arguments(parser: argparse.ArgumentParser) -> None:
    _recording_arguments(parser)
    _output_argument(parser)
    _fit_arguments(parser)
    parser.add_argument(
        "--posterior", type=int, default=0, metavar="STEPS", help="sample the posterior by chains of that length (slow)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the posterior's random numbers (default 0)")


def _campaign_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder with recordings at or below it")
    _output_argument(parser)
    _fit_arguments(parser)
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: as many as processors)")


def _predict_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("pump", type=Path, metavar="PUMP", help="pump file, see docs/predict.md")
    parser.add_argument("--speed", type=float, nargs="+", required=True, metavar="RPM", help="cam speeds [rpm]")
    parser.add_argument("--pressure", type=Path, metavar="FILE", help="pressure on the plunger over cam angle (CSV)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to be written")
    parser.add_argument(
        "--tolerance", type=float, metavar="SHARE", help="wanted error of the angle grid (default: 3600)"
    )


def _study_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", choices=STUDIES, metavar="NAME", help=" or ".join(STUDIES))
    _output_argument(parser)
    parser.add_argument("--quick", action="store_true", help="a coarse version within about a minute")


def _progress(arguments: argparse.Namespace) -> Callable[[str], None]:
    def tell(text: str) -> None:
        if not arguments.quiet:
            print(f"camtorque: {text}", file=sys.stderr, flush=True)

    return tell


def _options(arguments: argparse.Namespace) -> Any:
    from camtorque.align import AlignOptions
    from camtorque.fit import FitOptions
    from camtorque.fit.problem import FIT_EFFECTS
    from camtorque.records import Refusal
    from camtorque.run import RunOptions

    effects: tuple[str, ...] | None = None
    if arguments.effects is not None:
        effects = tuple(name.strip() for name in arguments.effects.split(",") if name.strip())
        unknown = [name for name in effects if name not in FIT_EFFECTS]
        if unknown:
            raise Refusal(f"--effects: found {', '.join(unknown)}, expected some of {', '.join(FIT_EFFECTS)}")
    align = AlignOptions() if arguments.n_theta is None else AlignOptions(n_theta=arguments.n_theta)
    if arguments.tolerance is not None:
        n_theta, note = _grid_for(arguments)
        align = AlignOptions(n_theta=n_theta, notes=(note,))
    steps, seed = getattr(arguments, "posterior", 0), getattr(arguments, "seed", 0)
    if steps < 0:
        raise Refusal(f"--posterior: found {steps} steps, expected 0 (none) or more, 1500 is usual")
    return RunOptions(align, FitOptions(effects, not arguments.no_ladder, steps, seed))


def _grid_for(arguments: argparse.Namespace) -> tuple[int, Any]:
    """Return the coarsest grid that the speed-accuracy chart allows for a wanted error, and what that implies."""
    from camtorque.fit.prepare import LEAST_GRID
    from camtorque.records import Refusal
    from camtorque.studies import grid_note

    if arguments.n_theta is not None:
        raise Refusal("--tolerance, --n-theta: found both, expected one of them; the tolerance chooses the grid")
    n_theta, note = grid_note(arguments.tolerance, LEAST_GRID)
    _progress(arguments)(note.text)
    return n_theta, note


def _run(arguments: argparse.Namespace) -> int:
    from camtorque.run import run_recording

    doc = run_recording(arguments.recording, arguments.out, _options(arguments), _progress(arguments))
    print(run_table(doc))
    print(f"\n{arguments.out / 'report.html'}")
    return 0


def _campaign(arguments: argparse.Namespace) -> int:
    from camtorque.campaign import run_campaign
    from camtorque.records import Refusal

    if arguments.workers is not None and arguments.workers < 1:
        raise Refusal(f"--workers: found {arguments.workers}, expected at least 1")
    progress = _progress(arguments)
    doc = run_campaign(arguments.folder, arguments.out, _options(arguments), arguments.workers, progress)
    print(campaign_table(doc))
    print(f"\n{arguments.out / 'campaign.html'}")
    refused = doc["n_refused"]
    return 0 if refused == 0 else REFUSED if refused == len(doc["recordings"]) else 1


def _check(arguments: argparse.Namespace) -> int:
    from camtorque.ingest import summarise_recording

    summary = summarise_recording(arguments.recording)
    print(f"{summary.id}  ({summary.file_format}), {summary.speed_rpm:.1f} rpm by its pulses")
    for row in summary.channels:
        unit, factor = {"torque": ("N m", 1.0), "pressure": ("bar", 1e-5)}.get(row.quantity, ("V", 1.0))
        print(
            f"  {row.quantity:9}{row.n_samples:>9} samples at {row.sample_rate:>9.6g} Hz, {row.duration:7.2f} s, "
            f"{factor * row.low:9.4g} to {factor * row.high:9.4g} {unit:4} {row.file} [{row.logger}]"
        )
    print("\n".join(_finding_lines([vars(row) for row in summary.findings])) or "  nothing wrong was found")
    return 1 if any(row.severity == "error" for row in summary.findings) else 0


def _align(arguments: argparse.Namespace) -> int:
    from camtorque.align import AlignOptions
    from camtorque.run import align_recording

    options = None if arguments.n_theta is None else AlignOptions(n_theta=arguments.n_theta)
    doc = align_recording(arguments.recording, arguments.out, options, _progress(arguments))
    print(f"{doc['name']}  {doc['cycles_used']} of {doc['cycles_found']} cycles used, {doc['speed_rpm']:.1f} rpm")
    print("\n".join(_finding_lines(doc["findings"])))
    print(arguments.out / "align.html")
    return 0


def _predict(arguments: argparse.Namespace) -> int:
    from camtorque.ingest.pump_file import read_pressure_curve, read_pump
    from camtorque.mechanism.predict import SAMPLES, predict, sweep_rows
    from camtorque.report import check_output, write_prediction
    from camtorque.studies import grid_note
    from camtorque.units import RPM

    if arguments.out is not None:
        check_output(arguments.out)
    config, findings = read_pump(arguments.pump)
    pressure = None if arguments.pressure is None else read_pressure_curve(arguments.pressure)
    n_theta, notes = SAMPLES, findings
    if arguments.tolerance is not None:
        n_theta, note = grid_note(arguments.tolerance)
        notes = (*findings, note)
    prediction = predict(config, [speed * RPM for speed in arguments.speed], pressure, n_theta=n_theta)
    prediction = replace(prediction, findings=(*notes, *prediction.findings))
    print("\n".join(_finding_lines([vars(row) for row in prediction.findings])))
    print(f"{'rpm':>8}{'torque max':>12}{'min':>9}{'mean':>9} N m{'contact':>10} N{'Hertz':>8} GPa")
    for row in sweep_rows(prediction):
        print(
            f"{row['speed_rpm']:8.1f}{row['shaft_torque_max_nm']:12.2f}{row['shaft_torque_min_nm']:9.2f}"
            f"{row['shaft_torque_mean_nm']:9.3f}    {row['contact_normal_max_n']:10.0f}  {row['hertz_max_gpa']:8.3f}"
        )
    if arguments.out is not None:
        write_prediction(prediction, arguments.pump.stem, arguments.out)
        print(arguments.out / "predict.html")
    return 0


def _study(arguments: argparse.Namespace) -> int:
    from camtorque.studies import run_speed_accuracy, run_stability

    run = run_speed_accuracy if arguments.name == "speed-accuracy" else run_stability
    for path in run(arguments.out, arguments.quick):
        print(path)
    return 0


COMMANDS: dict[str, tuple[Callable[[argparse.Namespace], int], str, Callable[[argparse.ArgumentParser], None]]] = {
    "run": (_run, "one recording: align, model, fit, report", _run_arguments),
    "campaign": (_campaign, "every recording below a folder, then one joint fit", _campaign_arguments),
    "check": (_check, "what a recording holds and what is wrong with it", _recording_arguments),
    "align": (_align, "logs to cam angle without a model (torque not needed)", _align_arguments),
    "study": (_study, "speed charted against accuracy; stability where methods fail", _study_arguments),
    "predict": (_predict, "torque and forces of a pump from its sheet", _predict_arguments),
}
"""Command -> what it does, its help, its arguments."""


def run_table(doc: Mapping[str, Any]) -> str:
    """Return the result of a run as a compact table for a terminal."""
    recording, metrics = doc["recording"], doc["metrics"]
    lines = [
        f"{recording['name']}  {recording['speed_rpm']:.1f} rpm, {recording['cycles_used']} of "
        f"{recording['cycles_found']} cycles used",
        "",
        f"{'':22}{'RMS':>16}{'forward gap':>14}{'return minimum':>17}",
    ]
    for name, label in (("rigid", "rigid model"), ("fitted_held_out_cycles", "fitted (held-out)")):
        row = metrics[name]
        lines.append(
            f"{label:22}{row['rms_nm']:7.3f} Nm{row['rms_percent_of_peak']:6.2f}%{row['forward_gap_percent']:+13.2f}%"
            f"{row['return_min_model_nm']:14.2f} Nm"
        )
    lines.append(f"{'measured':22}{'':30}{metrics['rigid']['return_min_measured_nm']:14.2f} Nm")
    trigger, chamber, losses = doc["alignment"]["trigger_angle_deg"], doc["chamber"], doc["losses"]
    lines += ["", f"effects   {', '.join(doc['effects']) or 'none'}"]
    lines.append(f"trigger   {_value(trigger, 'deg')}, nominal {trigger['nominal']:.2f}")
    if chamber and chamber["peak_bar"]:
        lines.append(f"chamber   peak {_value(chamber['peak_bar'], 'bar')}")
    parts = [f"{k.replace('_', ' ')} {losses[k]:.2f}" for k in ("pressure", "friction", "damping") if k in losses]
    lines.append(f"work      {losses['input']:.2f} J/rev = {', '.join(parts)}; open {losses['closure_percent']:+.2f} %")
    return "\n".join([*lines, *_finding_lines(doc["findings"])])


def _value(estimate: Mapping[str, Any], unit: str) -> str:
    error = estimate["stderr"]
    return f"{estimate['value']:.2f} {unit}" if error is None else f"{estimate['value']:.2f} +- {error:.2f} {unit}"


def campaign_table(doc: Mapping[str, Any]) -> str:
    """Return the result of a campaign as a compact table for a terminal."""
    lines = [f"{'recording':24}{'rpm':>8}{'rigid RMS':>12}{'fitted':>9}{'joint':>9}{'left out':>10}"]
    left = {row["name"]: row["metrics"] for row in doc["held_out"] if row["mode"] == "own_zero_and_end"}
    for row in doc["recordings"]:
        if row["status"] != "ok":
            lines.append(f"{row['name']:24}refused: {row['error']}")
            continue
        shares = [row["metrics"]["rigid"], row["metrics"]["fitted_held_out_cycles"],
                  (row["metrics_joint"] or {}).get("fitted_held_out_cycles"), left.get(row["id"])]  # fmt: skip
        texts = [f"{m['rms_percent_of_peak']:.2f}%" if m else "-" for m in shares]
        lines.append(f"{row['name']:24}{row['speed_rpm']:8.1f}{texts[0]:>12}{texts[1]:>9}{texts[2]:>9}{texts[3]:>10}")
    return "\n".join([*lines, *_finding_lines(doc["findings"])])


def _finding_lines(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    return [f"{row['severity']:8}  {row['text']}" + (f" [{row['where']}]" if row["where"] else "") for row in findings]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status.

    Parameters
    ----------
    arguments : without the program's name; None for those of the process
    """
    parsed = build_parser().parse_args(arguments)
    for name in THREADS:
        os.environ.setdefault(name, "1")
    if not parsed.debug:
        warnings.simplefilter("ignore")
    try:
        return COMMANDS[parsed.command][0](parsed)
    except KeyboardInterrupt:
        return STOPPED
    except BrokenPipeError:
        # the reader of our output (a pager) has gone; keep the interpreter from complaining at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _failed(error, parsed)


def _failed(error: Exception, parsed: argparse.Namespace) -> int:
    """Say in one line what went wrong."""
    from camtorque.records import Refusal

    if isinstance(error, Refusal):
        print(f"camtorque {parsed.command}: {' '.join(str(error).split())}", file=sys.stderr)
        return REFUSED
    if parsed.debug:
        raise error
    text = " ".join(str(error).split())
    if isinstance(error, OSError):
        print(f"camtorque {parsed.command}: {text}; check the path and its permissions", file=sys.stderr)
        return REFUSED
    print(
        f"camtorque {parsed.command}: unexpected {type(error).__name__}: {text}; run again with --debug and report it",
        file=sys.stderr,
    )
    return UNEXPECTED


if __name__ == "__main__":
    sys.exit(main())
