"""Where a result came from, as a Process Run Crate (RO-Crate): what was read, what computed it, what was written."""

from __future__ import annotations

import base64
import mimetypes
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from camtorque.report.checksums import visible_files
from camtorque.report.files import write_json

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
