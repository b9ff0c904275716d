"""Finished reports on disk: which there are, and what their result.json holds."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from camtorque.config.schemas import RECORDING_FILE
from camtorque.hashes import file_digest, real_path
from camtorque.process.folders import files_below
from camtorque.records import InputFile, Refusal
from camtorque.units import first_of

NAME, CAMPAIGN, ENTRY = "result.json", "campaign.json", "entry.json"
MOST_NAMED = 5
SCHEMA, CAMPAIGN_SCHEMA, ENTRY_SCHEMA = "camtorque.result/1", "camtorque.campaign/1", "camtorque.entry/1"


def find_results(path: Path) -> list[Path]:
    """Return every result.json that a path names: the file itself, or all in and below a folder, in order.

    A campaign.json names its folder. Of a campaign those that it names itself: its ``runs`` keep what older inputs,
    options and versions gave.

    Raises
    ------
    Refusal : there is none; a campaign.json cannot be used, or is older than results in its ``runs``
    """
    path = _of_campaign(path)
    if path.is_file():
        return [path]
    found = files_below(path, NAME)
    for campaign in files_below(path, CAMPAIGN):
        runs, rows = campaign.parent / "runs", current_campaign(campaign)["recordings"]
        named = {campaign.parent / row["folder"] / NAME for row in rows if row["folder"]}
        found = [file for file in found if file in named or runs not in file.parents]
    if not found:
        raise Refusal(f"{path}: found no {NAME} in or below it, expected a report of `camtorque run`; check the path")
    return found


def _of_campaign(path: Path) -> Path:
    return path.parent if path.name == CAMPAIGN and path.is_file() else path


def read_result(path: Path) -> dict[str, Any]:
    """Return the content of one result.json.

    Raises
    ------
    Refusal : it cannot be read, is no JSON, or not of this product
    """
    return read_document(path, SCHEMA, "a result of `camtorque run`")


def read_campaign(path: Path) -> dict[str, Any]:
    """Return the content of one campaign.json; refused as by `read_result`."""
    return read_document(path, CAMPAIGN_SCHEMA, "what `camtorque campaign` writes")


def current_campaign(path: Path) -> dict[str, Any]:
    """Return the content of a campaign.json that states the newest results beside it.

    Raises
    ------
    Refusal : see `read_campaign`; a recording was computed or refused since it was written, by `--only` or a campaign
        that was stopped
    """
    document = read_campaign(path)
    # what the index states needs no comparing of the clocks of several machines
    named = {(row["folder"], row.get("status")) for row in document["recordings"]}
    others = [entry for folder, entry in _entries(path.parent / "runs").items()
              if (f"runs/{folder.name}", entry["status"]) not in named]  # fmt: skip
    later = sorted({entry["name"] for entry in others if _made(entry) > _made(document)})
    if later:
        raise Refusal(
            f"{path}: is older than results of {first_of(later, MOST_NAMED)} that --only or a campaign that was "
            "stopped has computed since, expected the index of the newest; run the campaign to its end, it computes "
            "nothing twice"
        )
    return document


def _entries(runs: Path) -> dict[Path, dict[str, Any]]:
    """Return what became of each recording, by its folder; a damaged entry is the campaign's to tell."""
    found = {}
    for file in runs.glob(f"[!.]*/{ENTRY}"):
        with suppress(Refusal):
            found[file.parent] = read_document(file, ENTRY_SCHEMA, "what a campaign keeps of a recording")
    return found


def _made(document: Mapping[str, Any]) -> datetime:
    """Return when something was written, long ago where it does not say."""
    created = document.get("created")
    return datetime.fromisoformat(created) if created else datetime.min.replace(tzinfo=UTC)


def read_document(path: Path, schema: str, what: str) -> dict[str, Any]:
    """Return the content of a file that this product wrote.

    Raises
    ------
    Refusal : it cannot be read, is no JSON, or of another schema
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise Refusal(f"{path}: cannot be read ({error.strerror}), expected {what}") from error
    except ValueError as error:
        raise Refusal(f"{path}: is not valid JSON ({error}), expected {what}") from error
    found = document.get("schema") if isinstance(document, dict) else None
    if found != schema:
        raise Refusal(f"{path}: schema is {found!r:.80}, expected {schema}; name {what}")
    return document


def read_results(paths: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Return the documents of all reports below some paths, by their folder; see `find_results`, `read_result`."""
    files = dict.fromkeys(file for path in paths for file in find_results(path))
    return {file.parent.as_posix(): read_result(file) for file in files}


def refused_below(paths: Sequence[Path]) -> list[tuple[str, str]]:
    """Return name and reason of what campaigns in and below some paths refused: it has no report to be found.

    Of a campaign without an index, as `--only` leaves it, that is what each recording came to last; a report that is
    named itself stands for itself alone.
    """
    files = dict.fromkeys(file for path in paths for file in files_below(_of_campaign(path), CAMPAIGN))
    rows = [row for file in files for row in read_campaign(file)["recordings"]]
    single = dict.fromkeys(
        file.absolute().parents[1] for path in paths for file in files_below(path, ENTRY) if file.parent != path
    )
    for runs in single:
        if not (runs.parent / CAMPAIGN).is_file():
            rows += {entry["name"]: entry for entry in sorted(_entries(runs).values(), key=_made)}.values()
    return [(row["name"], row["error"]) for row in rows if row.get("status") == "refused"]


def recording_path(path: Path) -> Path:
    """Return the recording that a path names: a recording, or the report of one.

    Raises
    ------
    Refusal : it names neither, or the report's recording is gone or has changed
    """
    report = report_named(path)
    return path if report is None else recording_of(report)


def report_named(path: Path) -> Path | None:
    """Return the report that a path names, None where it names a recording.

    Raises
    ------
    Refusal : it names neither
    """
    if (path / RECORDING_FILE).is_file() or path.suffix == ".toml":
        return None
    result = path / NAME if path.is_dir() else path
    if result.name != NAME or not result.is_file():
        raise Refusal(
            f"{path}: found neither {RECORDING_FILE} nor {NAME}, expected a recording or the report of one; "
            "name the folder that `camtorque run` was given, or its --out"
        )
    return result.parent


def recording_of(report: Path) -> Path:
    """Return the recording.toml that a report was made of.

    Reports name their inputs as they were given: it is looked for from here and from the folders above the report, and
    is the same by its content.

    Raises
    ------
    Refusal : see `read_result`; it was made from arrays; its recording is in none of these places, or has changed since
    """
    result = report / NAME
    inputs = read_result(result)["inputs"]
    if not inputs:
        raise Refusal(
            f"{result}: was made from arrays by Python, whose samples and pump it does not hold, expected the report "
            "of a recording folder; save the arrays as a file, write its recording.toml (`camtorque new FILE`) and run "
            "that"
        )
    named = inputs[0]
    places = (place / named["path"] for place in (Path(), *real_path(report).parents))
    found = [place for place in places if place.is_file()]
    for place in found:
        if file_digest(place) == named["sha256"]:
            return place
    if found:
        raise _changed(result, found[:1])
    raise Refusal(
        f"{result}: its recording {named['path']} is not there, neither from {Path.cwd()} nor from the folders above "
        "the report, expected the logs and sheets that it was made of; put them back, or run this in the folder where "
        "the report was made"
    )


def refuse_changed(report: Path, files: Iterable[InputFile]) -> None:
    """Refuse files that are not those that a report was made of: changed since, or others in their place."""
    known = {row["sha256"] for row in read_result(report / NAME)["inputs"]}
    others = [file.path for file in files if file.sha256 not in known]
    if others:
        raise _changed(report / NAME, others)


def _changed(result: Path, files: Sequence[Path]) -> Refusal:
    maker = "campaign" if (result.parent / ENTRY).is_file() else "run"
    return Refusal(
        f"{result}: found other content in {', '.join(map(str, files))} than it was made of (by SHA-256), expected the "
        f"same; make the report again with `camtorque {maker}`, or put the old content back, or run this in the folder "
        "where the report was made"
    )
