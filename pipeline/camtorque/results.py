"""Finished reports on disk: which there are, and what their result.json holds."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from camtorque.records import Refusal

NAME = "result.json"
SCHEMA_STEM = "camtorque.result/"


def find_results(path: Path) -> list[Path]:
    """Return every result.json that a path names: the file itself, or all in and below a folder, in order.

    Raises
    ------
    Refusal : there is none
    """
    if path.is_file():
        return [path]
    files = sorted(path.rglob(NAME)) if path.is_dir() else []
    # a folder that begins with a point is one that is being written, or was left behind
    found = [file for file in files if not any(part.startswith(".") for part in file.relative_to(path).parts)]
    if not found:
        raise Refusal(f"{path}: found no {NAME} in or below it, expected a report of `camtorque run`; check the path")
    return found


def read_result(path: Path) -> dict[str, Any]:
    """Return the content of one result.json.

    Raises
    ------
    Refusal : it cannot be read, is no JSON, or not of this product
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise Refusal(f"{path}: cannot be read ({error.strerror}), expected a result of `camtorque run`") from error
    except ValueError as error:
        raise Refusal(f"{path}: is not valid JSON ({error}), expected a result of `camtorque run`") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if not str(schema).startswith(SCHEMA_STEM):
        raise Refusal(f"{path}: schema is {schema!r:.80}, expected {SCHEMA_STEM}1; name a result of `camtorque run`")
    return document


def read_results(paths: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Return the documents of all reports below some paths, by their folder.

    Raises
    ------
    Refusal : see `find_results`, `read_result`
    """
    files = dict.fromkeys(file for path in paths for file in find_results(path))
    return {file.parent.as_posix(): read_result(file) for file in files}
