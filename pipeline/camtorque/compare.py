"""THE FLOW for a comparison: two recordings of one pump, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.align import align
from camtorque.fit import Prepared, prepare
from camtorque.fit.changes import Attribution, attribution
from camtorque.fit.difference import Pair, evaluated, pair_of
from camtorque.fit.prepare import halves
from camtorque.fit.verdicts import Difference, loss_differences, parameter_differences
from camtorque.ingest import read_recording
from camtorque.records import Array, Refusal
from camtorque.report import ComparedCurves, ComparePage, output_folder, write_compare
from camtorque.report.document import inputs_document
from camtorque.results import NAME, read_result
from camtorque.run import Progress, RunOptions, now, rigid_torque, silent
from camtorque.threads import on_one_thread
from camtorque.units import RPM
from camtorque.version import __version__

SCHEMA = "camtorque.compare/1"
RECORDING = "recording.toml"


@dataclass(frozen=True)
class Compared:
    """Two recordings and what differs between them."""

    before: Prepared
    after: Prepared
    pair: Pair
    found: Attribution
    parameters: tuple[Difference, ...]
    losses: tuple[Difference, ...]

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of parameters and losses that are told as changed."""
        return tuple(row.name for row in (*self.parameters, *self.losses) if row.verdict == "changed")

    @property
    def verdict(self) -> str:
        """The verdict on the whole."""
        if self.changed:
            return "changed"
        kinds = {row.verdict for row in (*self.parameters, *self.losses)}
        return "not changed" if kinds == {"not changed"} else "cannot tell"


def recording_path(path: Path) -> Path:
    """Return the recording that a path names: a recording, or the report of one.

    Raises
    ------
    Refusal : it names neither, or the report's recording is gone
    """
    if (path / RECORDING).is_file() or path.suffix == ".toml":
        return path
    result = path / NAME if path.is_dir() else path
    if result.name != NAME or not result.is_file():
        raise Refusal(
            f"{path}: found neither {RECORDING} nor {NAME}, expected a recording or the report of one; name the folder "
            "that `camtorque run` was given, or its --out"
        )
    inputs = [Path(item["path"]) for item in read_result(result)["inputs"]]
    found = [item for item in inputs if item.name == RECORDING]
    if not found or not found[0].is_file():
        raise Refusal(
            f"{result}: its recording {found[0] if found else ''} is not there any more, expected the logs that it was "
            "made from: a comparison needs the cycles; name the recording's folder instead"
        )
    return found[0]


@on_one_thread
def compare_prepared(before: Prepared, after: Prepared, progress: Progress = silent) -> Compared:
    """Return what differs between a recording whose minima are found and another one.

    Raises
    ------
    Refusal : they are recordings of different pumps or speeds
    """
    progress("fitting both together")
    pair = pair_of(before, after, before.candidates[0])
    values = np.array([pair.fixed[name] for name in pair.names])
    state = evaluated(pair, values, values)
    progress("weighing what may have changed")
    found, pair = attribution(pair, state)
    return Compared(before, after, pair, found, parameter_differences(pair, found), loss_differences(pair, found))


def _refuse_other_pump(before: Prepared, after: Prepared) -> None:
    one, two = (side.recording.config.pump for side in (before, after))
    for name in ("plunger_diameter", "base_circle_radius", "roller_radius", "follower_offset"):
        if not np.isclose(getattr(one, name), getattr(two, name), rtol=1e-6):
            raise Refusal(
                f"compare: {name.replace('_', ' ')} is {getattr(one, name):.6g} m in {before.recording.config.id} and "
                f"{getattr(two, name):.6g} m in {after.recording.config.id}, expected one pump; compare recordings of "
                "the same pump"
            )


def aligned(path: Path, options: RunOptions, progress: Progress) -> Prepared:
    """Return one recording with its mean cycles, its minima not yet found.

    Raises
    ------
    Refusal : it cannot be used
    """
    progress(f"reading {path}")
    recording = read_recording(path)
    cycles = align(recording, options.align)
    return Prepared(recording, cycles, rigid_torque(recording, cycles), halves(cycles), (), np.zeros(0))


def compare_document(compared: Compared) -> dict[str, Any]:
    """Return the content of compare.json."""
    before, after = compared.before, compared.after
    one, two = (side.means.torque_all for side in (before, after))
    odd_even = float(np.sqrt(np.mean((before.means.torque - before.means.held_torque) ** 2)))
    found = compared.found
    return {
        "schema": SCHEMA, "version": __version__, "created": now(),
        "before": _side(before), "after": _side(after),
        "verdict": compared.verdict, "changed": list(compared.changed),
        "events": [
            {"groups": list(item.groups), "probability": probability}
            for item, probability in zip(found.hypotheses, found.probabilities, strict=True) if probability > 0.01
        ],
        "inflation": {"mean": found.inflation[0], "difference": found.inflation[1]},
        "parameters": _rows(compared.parameters), "losses": _rows(compared.losses),
        "torque": {
            "rms_difference_nm": float(np.sqrt(np.mean((two - one) ** 2))),
            "max_difference_nm": float(np.max(np.abs(two - one))), "odd_even_rms_nm": odd_even,
        },
    }  # fmt: skip


def _side(side: Prepared) -> dict[str, Any]:
    recording = side.recording
    return {
        "name": recording.config.id,
        "speed_rpm": side.cycles.mean_speed / RPM,
        "inputs": inputs_document(recording),
    }


def _rows(differences: Sequence[Difference]) -> dict[str, Any]:
    return {row.name: {**asdict(row), "ci95": list(row.ci95)} for row in differences}


def compared_curves(compared: Compared) -> ComparedCurves:
    """Return the mean cycles of both on the grid of the first."""
    before, after, pair = compared.before, compared.after, compared.pair
    theta = before.cycles.theta
    n = pair.items[0].chain.theta
    apart = pair.difference_root @ pair.difference_root.T
    centres = (np.arange(apart.shape[0]) + 0.5) * 2.0 * np.pi / apart.shape[0]

    def fine(angles: Array, values: Array) -> Array:
        return np.asarray(np.interp(theta, angles, values, period=2.0 * np.pi))

    pressures = [output.pressure for output in compared.found.state.outputs]
    return ComparedCurves(
        f"{before.cycles.mean_speed / RPM:.0f} rpm", theta, before.rigid.lift, before.means.torque_all,
        fine(after.cycles.theta, after.means.torque_all), fine(centres, np.sqrt(np.diag(apart))),
        before.means.pressure_all, fine(after.cycles.theta, after.means.pressure_all), fine(n, pressures[0]),
        fine(n, pressures[1]),
    )  # fmt: skip


def compare(
    before: Path, after: Path, out: Path, options: RunOptions | None = None, progress: Progress = silent
) -> dict[str, Any]:
    """Write the comparison of two recordings and return the content of compare.json.

    Parameters
    ----------
    before, after : recordings, or reports of recordings
    out : folder to be written; nothing is left of it when a recording is refused
    options, progress : see `camtorque.run.analyse`

    Raises
    ------
    Refusal : a recording cannot be used, or they are not one pump at one speed
    """
    options = options or RunOptions()
    paths = [recording_path(path) for path in (before, after)]
    with output_folder(out) as folder:
        one, two = (aligned(path, options, progress) for path in paths)
        _refuse_other_pump(one, two)
        progress(f"fitting {one.recording.config.id}")
        compared = compare_prepared(prepare(one.recording, one.cycles, one.rigid), two, progress)
        progress("writing the comparison")
        return write_compare(ComparePage(compare_document(compared), (compared_curves(compared),)), folder)
