"""A recording whose logs are being written, read as far as they go."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

from camtorque.align import align
from camtorque.config.recording import load_recording_config
from camtorque.ingest.csv_layout import HEAD_BYTES, wide_codec
from camtorque.ingest.formats import LINE_BY_LINE, content_format
from camtorque.ingest.recording import recording_of
from camtorque.process.threads import on_one_thread
from camtorque.records import CamCycles, Recording, Refusal
from camtorque.units import first_of


@on_one_thread
def read_so_far(folder: Path) -> tuple[Recording, CamCycles]:
    """Return a growing recording up to the last whole line of each of its files.

    Raises
    ------
    Refusal : it cannot be used yet, in words that name its own files
    """
    config = load_recording_config(folder)
    with tempfile.TemporaryDirectory(prefix="camtorque-watch-") as scratch:
        paths = dict.fromkeys(spec.path for spec in config.channels)
        copies = {path: Path(scratch) / str(number) / path.name for number, path in enumerate(paths)}
        channels = tuple(replace(spec, path=copies[spec.path], duration=None) for spec in config.channels)
        for path, copy in copies.items():
            _copied(path, copy)
        try:
            recording = recording_of(replace(config, channels=channels))
            return recording, align(recording)
        except Refusal as refusal:
            text = str(refusal)
            for path, copy in copies.items():
                text = text.replace(str(copy), str(path))
            binary = [path.name for path, copy in copies.items() if not _is_text(copy)]
            hint = f" ({first_of(binary, 3)}: not every binary log can be read before it is finished)" if binary else ""
            raise Refusal(text + hint) from refusal


def _copied(path: Path, copy: Path) -> None:
    """Copy a file that another program writes, a text without the line that is being written."""
    if not path.is_file():
        raise Refusal(f"{path}: found no such file yet, expected the log to begin; start the logger")
    copy.parent.mkdir()
    shutil.copyfile(path, copy)
    if not _is_text(copy):
        return
    with copy.open("rb+") as file:
        line_end = "\n".encode(wide_codec(file.read(HEAD_BYTES)) or "ascii")
        end = file.seek(0, 2)
        tail = min(end, 1 << 16)
        file.seek(end - tail)
        place = file.read(tail).rfind(line_end)
        file.truncate(end - tail + place + len(line_end) if place >= 0 else 0)


def _is_text(path: Path) -> bool:
    with path.open("rb") as file:
        return content_format(file.read(HEAD_BYTES)) in LINE_BY_LINE
