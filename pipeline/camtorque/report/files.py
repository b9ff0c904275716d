"""What every document holds and how it is written: inputs with their hashes, findings, JSON that appears whole."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from camtorque.jsonable import jsonable
from camtorque.records import Finding, InputFile
from camtorque.report.numbers import typeset

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
