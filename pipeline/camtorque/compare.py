"""THE FLOW for a comparison: recordings of one pump, before and after."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.align import align
from camtorque.config import RecordingConfig
from camtorque.config.recording import load_recording_config
from camtorque.config.schemas import RECORDING_FILE
from camtorque.fit.changes import Attribution, attribution
from camtorque.fit.gains import torque_ratio
from camtorque.fit.pair import SAME_SPEED, TwoRecordings, best_pair
from camtorque.fit.prepare import at_cam_angles, mean_cycles
from camtorque.fit.single import Prepared, prepare
from camtorque.fit.valleys import NO_VALLEY
from camtorque.fit.verdicts import (
    Difference,
    common_attributions,
    loss_differences,
    of_a_gain,
    parameter_differences,
    pooled,
    whole_verdict,
)
from camtorque.ingest import read_recording, summarise
from camtorque.ingest.stated import DIMENSIONS, MOST_NAMED, PLACE, differences, stated
from camtorque.jsonable import now
from camtorque.process.folders import files_below
from camtorque.process.threads import on_one_thread
from camtorque.progress import Progress, silent
from camtorque.records import Array, Finding, Recording, Refusal
from camtorque.rehearsal import rigid_torque
from camtorque.report.compare_page import ComparedCurves, write_compare
from camtorque.report.files import inputs_document
from camtorque.report.folder import output_folder
from camtorque.results import CAMPAIGN, NAME, current_campaign, recording_path, refuse_changed, report_named
from camtorque.units import RPM
from camtorque.version import __version__

SCHEMA = "camtorque.compare/1"


@dataclass(frozen=True)
class Compared:
    """Two recordings and what differs between them."""

    before: Prepared
    after: Prepared
    pair: TwoRecordings
    found: Attribution

    @property
    def parameters(self) -> tuple[Difference, ...]:
        """Differences of the pump's parameters."""
        return parameter_differences(self.pair, self.found)

    @property
    def losses(self) -> tuple[Difference, ...]:
        """Differences of the losses."""
        return loss_differences(self.pair, self.found)


@dataclass(frozen=True)
class Matched:
    """Pairs of recordings of one speed, and on each side those that have no partner."""

    pairs: tuple[tuple[Path, Path], ...]
    alone: tuple[Mapping[Path, RecordingConfig], Mapping[Path, RecordingConfig]] = ({}, {})


def matched(before: Path, after: Path) -> Matched:
    """Return the pairs of recordings of one speed that two paths name; each recording is in one pair at most.

    Raises
    ------
    Refusal : no recording of one side has the speed of one of the other
    """
    sides = [_recordings(path) for path in (before, after)]
    if all(len(side) == 1 for side in sides):
        return Matched(((sides[0][0], sides[1][0]),))
    alone = tuple({path: load_recording_config(recording_path(path)) for path in side} for side in sides)
    one, two = ({path: config.nominal_speed for path, config in side.items()} for side in alone)
    first, second = list(one), list(two)
    apart = sorted((abs(two[b] / one[a] - 1.0), i, j) for i, a in enumerate(first) for j, b in enumerate(second))
    pairs: list[tuple[int, int]] = []
    for distance, i, j in apart:
        if distance <= SAME_SPEED and first[i] in alone[0] and second[j] in alone[1]:
            pairs.append((i, j))
            del alone[0][first[i]], alone[1][second[j]]
    if not pairs:
        speeds = ["; ".join(f"{speed / RPM:.0f}" for speed in side.values()) for side in (one, two)]
        raise Refusal(
            f"compare: {before} holds {speeds[0]} rpm and {after} {speeds[1]} rpm, expected some speed in both; "
            "compare recordings of the same speeds"
        )
    return Matched(tuple((first[i], second[j]) for i, j in sorted(pairs)), (alone[0], alone[1]))


def _recordings(path: Path) -> list[Path]:
    """Return the recordings or reports that a path names: itself, those of a campaign's report, or those below it."""
    campaign = path if path.name == CAMPAIGN else path / CAMPAIGN
    if campaign.is_file():
        rows = current_campaign(campaign)["recordings"]
        return [campaign.parent / row["folder"] for row in rows if row["status"] == "ok"]
    if path.is_dir() and not any((path / name).is_file() for name in (RECORDING_FILE, NAME)):
        return [item.parent for item in files_below(path, RECORDING_FILE)] or [path]
    return [path]


@on_one_thread
def compare_prepared(before: Prepared, after: Prepared, progress: Progress = silent) -> Compared:
    """Return what differs between a recording whose minima are found and another one of its pump and speed."""
    progress("fitting both together")
    pair = best_pair(before, after)
    progress("weighing what may have changed")
    found, pair = attribution(pair)
    return Compared(before, after, pair, found)


def _by_name(before: Prepared, after: Prepared) -> dict[str, Prepared]:
    """Return both by what they are called in texts: their ids, with the side behind one that they share."""
    one, two = before.recording.config.id, after.recording.config.id
    return {one: before, two: after} if one != two else {f"{one} (before)": before, f"{two} (after)": after}


def refuse_same(before: Prepared, after: Prepared) -> None:
    """Refuse a measurement that is held against itself: both have the same logs, under whatever ids and sheets."""
    one, two = (_logs(side.recording) for side in (before, after))
    if one == two:
        raise Refusal(
            f"compare: {' and '.join(_by_name(before, after))} have the same logs (by SHA-256), expected two "
            "measurements; name the one before and the one after"
        )


def _logs(recording: Recording) -> set[str]:
    paths = {channel.path for channel in recording.config.channels}
    return {item.sha256 for item in recording.inputs if item.path in paths}


def _stated_differently(before: Prepared, after: Prepared) -> dict[str, str]:
    return differences({name: stated(side.recording) for name, side in _by_name(before, after).items()})


def _refuse_other_pump(before: Prepared, after: Prepared) -> None:
    found = _stated_differently(before, after)
    for name in DIMENSIONS:
        if name in found:
            raise Refusal(
                f"compare: {name} is {found[name]}, expected one pump; compare recordings of the same pump, or correct "
                "the wrong number"
            )
    if PLACE in found:
        raise Refusal(
            f"compare: {PLACE} is {found[PLACE]} by its location, expected one place: a line's pressure is not that on "
            "the plunger; compare recordings whose sensor sits alike, or correct location in [sensors.pressure]"
        )


def _refuse_other_speed(before: Prepared, after: Prepared) -> None:
    speeds = [side.cycles.mean_speed / RPM for side in (before, after)]
    if abs(speeds[1] / speeds[0] - 1.0) > SAME_SPEED:
        one, two = _by_name(before, after)
        raise Refusal(
            f"compare: {one} runs at {speeds[0]:.1f} rpm and {two} at {speeds[1]:.1f} rpm, expected one speed within "
            f"{100 * SAME_SPEED:.0f} %; the laws' error cancels at one speed only; compare recordings of one speed, or "
            "campaigns that hold the same speeds"
        )


def aligned(path: Path, progress: Progress) -> Prepared:
    """Return one recording with its mean cycles, its minima not yet found.

    Raises
    ------
    Refusal : it cannot be used, or is not what the report that names it was made of
    """
    progress(f"reading {path}")
    recording, report = read_recording(recording_path(path)), report_named(path)
    if report is not None:
        refuse_changed(report, recording.inputs)
    cycles = align(recording)
    return Prepared(recording, cycles, rigid_torque(recording, cycles), mean_cycles(cycles), (), NO_VALLEY, np.zeros(0))


def compare_document(
    compared: Sequence[Compared], names: tuple[str, str], alone: Sequence[Mapping[Path, RecordingConfig]] = ({}, {})
) -> dict[str, Any]:
    """Return compare.json of pairs that belong together; ``names`` are those of both sides where there are several."""
    parameters = _over_pairs([item.parameters for item in compared])
    losses = _over_pairs([item.losses for item in compared])
    ratio = torque_ratio([item.before.means for item in compared], [item.after.means for item in compared])
    if ratio is not None:
        parameters, losses = of_a_gain(parameters), of_a_gain(losses)
    rows = (*parameters, *losses)
    found = compared[0].found
    apart = [item.after.means.torque_all - item.before.means.torque_all for item in compared]
    repeat = [item.before.means.torque - item.before.means.held_torque for item in compared]
    return {
        "schema": SCHEMA, "version": __version__, "created": now(),
        "before": _side([item.before for item in compared], names[0], alone[0]),
        "after": _side([item.after for item in compared], names[1], alone[1]),
        "verdict": whole_verdict(rows, found), "changed": [row.name for row in rows if row.verdict == "changed"],
        "events": [
            {"groups": list(item.groups), "probability": probability}
            for item, probability in zip(found.hypotheses, found.probabilities, strict=True) if probability > 0.01
        ],
        "inflation": {"mean": [item.found.inflation[0] for item in compared],
                      "difference": [item.found.inflation[1] for item in compared]},
        "parameters": _rows(parameters), "losses": _rows(losses), "sheets_differ": _sheets(compared),
        "findings": _loud(compared), "pressure_peak_ratio": [item.pair.pressure_ratio for item in compared],
        "torque": {
            "rms_difference_nm": float(np.sqrt(np.mean(np.concatenate(apart) ** 2))),
            "max_difference_nm": float(np.max(np.abs(np.concatenate(apart)))),
            "odd_even_rms_nm": float(np.sqrt(np.mean(np.concatenate(repeat) ** 2))),
            "ratio": ratio,
        },
    }  # fmt: skip


def _loud(compared: Sequence[Compared]) -> list[dict[str, str]]:
    """Return the warnings and errors of both sides, each once, with the recordings that it is of."""
    names: dict[Finding, dict[str, None]] = {}
    for item in compared:
        for name, side in _by_name(item.before, item.after).items():
            for finding in (*summarise(side.recording, side.cycles.pulses).findings, *side.cycles.findings):
                if finding.severity != "info":
                    names.setdefault(finding, {})[name] = None
    return [{**asdict(finding), "recording": ", ".join(found)} for finding, found in names.items()]


def _sheets(compared: Sequence[Compared]) -> list[str]:
    """Return what sheets of one pair state differently, each number once with the pairs that do."""
    pairs: dict[str, dict[str, None]] = {}
    for one in compared:
        for name, text in _stated_differently(one.before, one.after).items():
            pairs.setdefault(name, {})[text] = None
    found = []
    for name, texts in pairs.items():
        more = [f"other pairs: {len(texts) - MOST_NAMED}"] if len(texts) > MOST_NAMED else []
        found.append(f"{name} is {'; '.join([*list(texts)[:MOST_NAMED], *more])}")
    return found


def _over_pairs(rows: Sequence[Sequence[Difference]]) -> tuple[Difference, ...]:
    """Return the differences of all pairs by name, pooled where there are several."""
    by_name: dict[str, list[Difference]] = {}
    for pair in rows:
        for row in pair:
            by_name.setdefault(row.name, []).append(row)
    return tuple(found[0] if len(found) == 1 else pooled(found) for found in by_name.values())


def _side(sides: Sequence[Prepared], name: str, alone: Mapping[Path, RecordingConfig]) -> dict[str, Any]:
    speeds = [side.cycles.mean_speed / RPM for side in sides]
    inputs = {row["path"]: row for side in sides for row in inputs_document(side.recording.inputs)}
    single = len(sides) == 1
    return {
        "name": sides[0].recording.config.id if single else name, "speed_rpm": speeds[0] if single else None,
        "speeds_rpm": speeds, "inputs": list(inputs.values()),
        "left_out": left_out_rows(alone.values()),
    }  # fmt: skip


def left_out_rows(alone: Iterable[RecordingConfig]) -> list[dict[str, Any]]:
    """Return what compare.json says of recordings without a partner: folders of a campaign go by hashes, ids do not."""
    return [{"recording": config.id, "speed_rpm": config.nominal_speed / RPM} for config in alone]


def _rows(differences: Sequence[Difference]) -> dict[str, Any]:
    return {row.name: {**asdict(row), "ci95": list(row.ci95)} for row in differences}


def compared_curves(compared: Compared) -> ComparedCurves:
    """Return the mean cycles of both on the grid of the first."""
    before, after, pair = compared.before, compared.after, compared.pair
    theta = before.cycles.theta
    apart = pair.difference_root @ pair.difference_root.T
    grid = pair.items[0].chain.theta
    centres = (np.arange(apart.shape[0]) + 0.5) * 2.0 * np.pi / apart.shape[0]
    std = np.interp(grid, centres, np.sqrt(np.diag(apart)), period=2.0 * np.pi)

    def fine(angles: Array, values: Array) -> Array:
        return np.asarray(np.interp(theta, angles, values, period=2.0 * np.pi))

    inside = before.recording.config.measures_chamber  # as on the other side: another place is refused
    chains = [item.chain for item in pair.items]
    old, new = (
        None if inside else at_cam_angles(chain, output.pressure, theta.size)
        for chain, output in zip(chains, compared.found.state.outputs, strict=True)
    )
    return ComparedCurves(
        f"{before.cycles.mean_speed / RPM:.0f} rpm", theta, before.rigid.lift, before.means.torque_all,
        fine(after.cycles.theta, after.means.torque_all), at_cam_angles(chains[0], std, theta.size),
        before.means.pressure_all, fine(after.cycles.theta, after.means.pressure_all), old, new,
        "chamber" if inside else "line",
    )  # fmt: skip


def compare(before: Path, after: Path, out: Path, progress: Progress = silent) -> dict[str, Any]:
    """Write the comparison of two recordings and return the content of compare.json.

    ``before`` and ``after`` are recordings, reports of recordings, campaigns, or folders of recordings (paired by
    speed); nothing is left of ``out`` when one is refused.

    Raises
    ------
    Refusal : a recording cannot be used, or they are not one pump at one speed
    """
    paths = matched(before, after)
    for side, rows in zip((before, after), paths.alone, strict=True):
        if rows:
            names = ", ".join(config.id for config in rows.values())
            progress(f"left out: {side}: {names}, for which the other side has no partner of their speed left")
    with output_folder(out, "compare.json") as folder:
        found = [_one_pair(*pair, progress) for pair in paths.pairs]
        joined = common_attributions([item.found for item in found], [item.pair for item in found])
        found = [replace(item, found=one) for item, one in zip(found, joined, strict=True)]
        progress("writing the comparison")
        document = compare_document(found, (before.name, after.name), paths.alone)
        return write_compare(document, [compared_curves(item) for item in found], folder)


def _one_pair(before: Path, after: Path, progress: Progress) -> Compared:
    one, two = (aligned(path, progress) for path in (before, after))
    refuse_same(one, two)
    _refuse_other_pump(one, two)
    _refuse_other_speed(one, two)
    progress(f"fitting {one.recording.config.id}")
    return compare_prepared(prepare(one.recording, one.cycles, one.rigid), two, progress)
