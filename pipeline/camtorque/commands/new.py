"""`camtorque new`: look into logs and write a first recording.toml."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from shlex import quote

from camtorque.commands import Outcome, Tell
from camtorque.config.keys import UNKNOWN
from camtorque.config.schemas import RECORDING_FILE
from camtorque.ingest.new_recording import new_recording
from camtorque.ingest.proposal import Proposal, look_into
from camtorque.jsonable import jsonable
from camtorque.records import Refusal, printable
from camtorque.report.files import atomic_file
from camtorque.units import counted

SCHEMA = "camtorque.new/1"


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write recording.toml beside the first log, or into another folder."""
    folder: Path = arguments.out if arguments.out is not None else arguments.files[0].parent
    file = folder / RECORDING_FILE
    if file.exists() or file.is_symlink():
        raise Refusal(f"{file}: is there already and is not overwritten; move it away, or give another --out")
    tell("looking into the logs")
    proposals = look_into(list(dict.fromkeys(arguments.files)))
    new = new_recording(folder, proposals, arguments.like)
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_file(file) as partial:
        partial.write_text(new.text, encoding="utf-8")
    left = "nothing is unknown"
    if new.unknown:
        named = [f"{name} ({count} times)" if count > 1 else name for name, count in Counter(new.unknown).items()]
        left = f'{counted(len(new.unknown), "value is", "values are")} marked "?": {", ".join(named)}'
    told = [(item, UNKNOWN if any(item is one for one in new.asked) else item.quantity) for item in proposals]
    lines = [*(_line(*pair) for pair in told), str(file), left, f"then: camtorque check {quote(str(folder))}"]
    channels = [_entry(*pair) for pair in told]
    document = {"schema": SCHEMA, "file": str(file), "unknown": new.unknown, "channels": channels}
    return Outcome("\n".join(lines), jsonable(document))


def _line(item: Proposal, quantity: str) -> str:
    channel = item.channel
    rate = f"{channel.sample_rate:.6g} Hz" if channel.sample_rate else "rate unknown"
    name = f"{channel.group}/{channel.name}".strip("/")
    return printable(
        f"  {quantity or 'not used':20}{item.path.name:28} {name:24} {channel.n_samples:>9} samples at "
        f"{rate:>12}, {item.low:.4g} to {item.high:.4g} {channel.unit or item.unit or 'without a unit'}"
    )


def _entry(item: Proposal, quantity: str) -> dict[str, object]:
    channel = item.channel
    return {
        "file": str(item.path),
        "format": item.file_format,
        "group": channel.group,
        "channel": channel.name,
        "unit": channel.unit,
        "sample_rate_hz": channel.sample_rate,
        "samples": channel.n_samples,
        "low": item.low,
        "high": item.high,
        "quantity": quantity,
    }
