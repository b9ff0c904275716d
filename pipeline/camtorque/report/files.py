"""How the files of an output are written, each whole: pages, JSON, where it came from (RO-Crate), SHA-256 of all."""

from __future__ import annotations

import base64
import json
import mimetypes
import os
import platform
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path, PurePath
from typing import Any

from camtorque.hashes import file_digest
from camtorque.jsonable import jsonable
from camtorque.records import Finding, InputFile, Refusal
from camtorque.report.numbers import typeset
from camtorque.units import first_of

ESCAPED = "backslashreplace"
"""A path may hold bytes that are not text; they are written escaped."""


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside a path: renamed to it when all is written, removed where writing failed."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def write_page(path: Path, html: str) -> None:
    """Write a page."""
    path.write_text(html, encoding="utf-8", errors=ESCAPED)


def write_json(path: Path, document: Mapping[str, Any], lines: bool = True) -> None:
    """Write a document that appears whole; NaN is never written. ``lines``: one for each value."""
    text = json.dumps(jsonable(document), indent=1 if lines else None, ensure_ascii=False, allow_nan=False)
    with atomic_file(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8", errors=ESCAPED)


def write_rows(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document of many rows: one line each, numbers to 7 digits; each row's own report has all digits."""
    with atomic_file(path) as partial, partial.open("w", encoding="utf-8", errors=ESCAPED) as stream:
        stream.write("{")
        for place, (key, value) in enumerate(jsonable(document).items()):
            stream.write(f"{',' if place else ''}\n {json.dumps(key)}: ")
            if isinstance(value, list) and value and isinstance(value[0], dict | list):
                stream.write("[\n  " + ",\n  ".join(map(_line, value)) + "\n ]")
            else:
                stream.write(_line(value))
        stream.write("\n}\n")


def _line(value: Any) -> str:
    return json.dumps(short(value, 7), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def short(value: Any, digits: int) -> Any:
    """Return JSON-ready values with numbers rounded to ``digits`` significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{digits}g}")
    if isinstance(value, dict):
        return {key: short(item, digits) for key, item in value.items()}
    return [short(item, digits) for item in value] if isinstance(value, list) else value


def inputs_document(files: Iterable[InputFile]) -> list[dict[str, str]]:
    """Return files that were read with their SHA-256."""
    return [{"path": str(item.path), "sha256": item.sha256} for item in files]


def findings_document(findings: Iterable[Finding]) -> list[dict[str, str]]:
    """Return findings with the typography of the page."""
    return [{**asdict(row), "text": typeset(row.text)} for row in findings]


SUMS = "SHA256SUMS"
LINE = re.compile(r"([0-9a-f]{64})  (\S.*)")


def write_checksums(folder: Path, files: Iterable[Path]) -> None:
    """Write SHA256SUMS of a folder; ``sha256sum -c SHA256SUMS`` reads it too."""
    lines = [f"{file_digest(file)}  {file.relative_to(folder).as_posix()}\n" for file in sorted(files)]
    with atomic_file(folder / SUMS) as partial:
        partial.write_text("".join(lines), encoding="utf-8")


def visible_files(folder: Path) -> list[Path]:
    """Return the files of a folder and below it but for hidden ones and its own SHA256SUMS."""
    found = (path for path in folder.rglob("*") if path.is_file() and path != folder / SUMS)
    return sorted(p for p in found if not any(part.startswith(".") for part in p.relative_to(folder).parts))


def listed_files(folder: Path) -> set[str]:
    """Return the names, relative to the folder of an output, that its SHA256SUMS lists; none without one."""
    return {row[0] for row in _listed(folder) if row} if (folder / SUMS).is_file() else set()


def unlisted_files(folder: Path) -> list[str]:
    """Return the files of an output that its SHA256SUMS does not list: somebody put them there; none without one."""
    return _unlisted(folder, listed_files(folder)) if (folder / SUMS).is_file() else []


def verify(folder: Path) -> tuple[int, dict[str, str]]:
    """Return how many files were compared, and what those are that are not as they were written: ``changed`` and so on.

    A SHA256SUMS that another one lists is followed, so the index of a campaign vouches for all its recordings.

    Raises
    ------
    Refusal : the folder holds no SHA256SUMS
    """
    if not (folder / SUMS).is_file():
        below = sorted(path.parent.as_posix() for path in folder.glob(f"*/{SUMS}"))
        what = f"there are {first_of(below, 3)}" if below else "check the path"
        raise Refusal(f"{folder}: found no {SUMS}, expected the output of a command; {what}")
    compared = dict(_compared(folder, Path()))
    faults = {name: kind for name, kind in compared.items() if kind}
    listed = set(compared)
    more = (name for name in _unlisted(folder, listed) if not _in_a_folder_of_its_own(name, listed))
    return len(compared), faults | dict.fromkeys(more, "not listed")


def _listed(folder: Path) -> list[tuple[str, str] | None]:
    """Return name and digest by the lines of a folder's SHA256SUMS, None for one that is damaged or leads elsewhere."""
    text = (folder / SUMS).read_text(encoding="utf-8", errors="replace")
    found = [LINE.fullmatch(line) for line in text.splitlines()]
    return [(row[2], row[1]) if row and row[2][0] != "/" and ".." not in row[2].split("/") else None for row in found]


def _unlisted(folder: Path, listed: set[str]) -> list[str]:
    names = (path.relative_to(folder).as_posix() for path in visible_files(folder))
    return [name for name in names if name not in listed]


def _compared(folder: Path, below: Path) -> Iterator[tuple[str, str]]:
    """Yield each listed file with its fault, "" where it is as it was."""
    for number, found in enumerate(_listed(folder / below), 1):
        if found is None:
            yield f"{(below / SUMS).as_posix()} line {number}", "damaged"
            continue
        place = below / found[0]
        kind = _kind(folder / place, found[1])
        yield place.as_posix(), kind
        if place.name == SUMS and kind != "missing" and place.parent != below:
            yield from _compared(folder, place.parent)


def _kind(path: Path, digest: str) -> str:
    try:
        return "" if file_digest(path) == digest else "changed"
    except FileNotFoundError:
        return "missing"


def _in_a_folder_of_its_own(name: str, listed: set[str]) -> bool:
    """Tell whether a file lies in a ``runs/KEY`` that this index does not list: of other options, or unfinished."""
    parts = name.split("/")
    return parts[0] == "runs" and len(parts) > 2 and f"runs/{parts[1]}/{SUMS}" not in listed


CRATE, COMPUTATION = "ro-crate-metadata.json", "#computation"
SPECIFICATION = "https://w3id.org/ro/crate/1.1"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
TERMS = "https://w3id.org/ro/terms/workflow-run/context"
LICENCE = "https://spdx.org/licenses/MIT"
SOFTWARE = "https://pypi.org/project/camtorque/"
MEDIA = {".h5": "application/x-hdf5", ".json": "application/json", ".svg": "image/svg+xml", ".bin": "application/zlib"}
Entity = Mapping[str, Any]
DESCRIPTOR = {"@id": CRATE, "@type": "CreativeWork", "conformsTo": {"@id": SPECIFICATION}, "about": {"@id": "./"}}
PROCESS_RUN = {"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
MIT = {"@id": LICENCE, "@type": "CreativeWork", "name": "MIT", "description": "licence of the software"}


def write_crate(folder: Path, doc: Mapping[str, Any], title: str) -> None:
    """Write ro-crate-metadata.json of a finished folder; ``doc``: its result.json or align.json."""
    inputs = [_input(item) for item in doc["inputs"]]
    outputs = [_output(path, folder) for path in visible_files(folder) if path != folder / CRATE]
    root = {
        "@id": "./", "@type": "Dataset", "name": title,
        "description": f"What camtorque {doc['version']} computed of {title}",
        "datePublished": doc["created"], "license": {"@id": LICENCE}, "conformsTo": {"@id": PROFILE},
        "hasPart": references([*inputs, *outputs]), "mentions": {"@id": COMPUTATION},
    }  # fmt: skip
    software = {
        "@id": SOFTWARE, "@type": "SoftwareApplication", "name": "camtorque", "url": SOFTWARE,
        "softwareVersion": doc["version"], "softwareRequirements": f"Python {platform.python_version()}",
        "operatingSystem": platform.system(),
    }  # fmt: skip
    action = {
        "@id": COMPUTATION, "@type": "CreateAction", "name": f"{doc['schema']} of {title}",
        "description": "the options stand in the report",
        "instrument": {"@id": SOFTWARE}, "endTime": doc["created"], "actionStatus": "http://schema.org/CompletedActionStatus",
        "object": references(inputs), "result": references(outputs),
    }  # fmt: skip
    graph = [DESCRIPTOR, root, PROCESS_RUN, MIT, software, action, *inputs, *outputs]
    write_json(folder / CRATE, {"@context": [f"{SPECIFICATION}/context", TERMS], "@graph": graph})


def _input(item: Mapping[str, str]) -> Entity:
    """Return a file that was read, named by its content, not by its place on this disk."""
    digest = base64.urlsafe_b64encode(bytes.fromhex(item["sha256"])).decode().rstrip("=")
    name = PurePath(item["path"]).name
    return {"@id": f"ni:///sha-256;{digest}", "@type": "File", "name": name, "encodingFormat": media_type(name),
            "sha256": item["sha256"]}  # fmt: skip


def _output(path: Path, folder: Path) -> Entity:
    name = path.relative_to(folder).as_posix()
    return {"@id": name, "@type": "File", "name": name, "encodingFormat": media_type(name),
            "contentSize": str(path.stat().st_size)}  # fmt: skip


def references(entities: Sequence[Entity]) -> list[Entity]:
    """Return references to entities."""
    return [{"@id": entity["@id"]} for entity in entities]


def media_type(name: str) -> str:
    """Return the media type of a file by its name."""
    suffix = PurePath(name).suffix.lower()
    return MEDIA.get(suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream"
