"""`camtorque export`: tables of reports for other programs, and trends over many of them."""

from __future__ import annotations

import argparse
import os
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from camtorque.commands import Outcome, Tell
from camtorque.export import AXES, FORMATS, drawn_table, informed_parameters, report_tables, trend_table
from camtorque.records import Refusal, require
from camtorque.report.files import SUMS
from camtorque.report.folder import check_writable, output_files
from camtorque.report.plots import trend_figure
from camtorque.results import read_results

PACKAGES = {"xlsx": ("openpyxl",), "parquet": ("pyarrow",)}
DRAWN = {"fitted_rms_percent": "fitted RMS / % of peak", "chamber_peak_bar": "chamber peak / bar"}
MOST_PARAMETERS = 6
"""Parameters of the figure; the table has them all."""
DPI = 150
UNSAFE = re.compile(r"[^\w.-]+")
"""What does not belong into the name of a file."""


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the tables of each report, or one trend over all."""
    require(PACKAGES.get(arguments.format, ()), f"--format {arguments.format}", "tables")
    documents, repeated = read_results(arguments.results), dict[str, str]()
    if arguments.trend:
        documents, repeated = each_once(documents)
    check_writable(arguments.out)
    if (arguments.out / SUMS).exists():
        raise Refusal(
            f"--out {arguments.out}: found a finished report, expected another folder: tables in it would not be in "
            f"its {SUMS}"
        )
    with output_files(arguments.out) as folder:
        written = (
            _trend(arguments, documents, folder) if arguments.trend else _tables(arguments, documents, tell, folder)
        )
    paths = [arguments.out / path.name for path in written]
    text = "\n".join(str(path) for path in paths)
    notes = tuple(f"{one} and {other} are of the same inputs: {other} alone is counted, the newer"
                  for one, other in repeated.items())  # fmt: skip
    document = {"schema": "camtorque.export/1", "files": [str(path) for path in paths], "repeated": [*repeated]}
    return Outcome(text, document, notes=notes)


def each_once(documents: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the newest report of each recording, and the others: folder -> that of the one that counts.

    A recording is the same by the SHA-256 of all its inputs; reports made from arrays, which have none, all count.
    """
    inputs = {
        folder: frozenset(row["sha256"] for row in document["inputs"]) or folder
        for folder, document in documents.items()
    }
    newest = sorted(documents, key=lambda folder: str(documents[folder].get("created")))
    kept = {inputs[folder]: folder for folder in newest}
    repeated = {folder: kept[inputs[folder]] for folder in documents if kept[inputs[folder]] != folder}
    return {folder: document for folder, document in documents.items() if folder not in repeated}, repeated


def _tables(arguments: argparse.Namespace, documents: Mapping[str, Any], tell: Tell, out: Path) -> list[Path]:
    paths = []
    for name, stem in _stems(documents).items():
        tell(f"tables of {stem}")
        paths += FORMATS[arguments.format](report_tables(Path(name), documents[name]), out / stem)
    return paths


def _stems(documents: Mapping[str, Any]) -> dict[str, str]:
    """Return how the files of each report begin: the recording's name, with its folder below theirs where names repeat.

    Folders that differ only in what no name of a file holds are numbered.
    """
    names = {folder: UNSAFE.sub("_", document["recording"]["name"]) for folder, document in documents.items()}
    often, taken = Counter(names.values()), set[str]()
    above = os.path.commonpath([os.path.abspath(folder) for folder in names])
    stems = {}
    for folder, name in names.items():
        below = os.path.relpath(folder, above)
        stem = name if often[name] == 1 or below == os.curdir else UNSAFE.sub("_", f"{name}_{below}")
        numbered = (stem, *(f"{stem}_{k}" for k in range(2, len(names) + 2)))
        stems[folder] = next(one for one in numbered if one not in taken)
        taken.add(stems[folder])
    return stems


def _trend(arguments: argparse.Namespace, documents: Mapping[str, Any], out: Path) -> list[Path]:
    table = trend_table(documents)
    paths = FORMATS[arguments.format]({"trend": table}, out / "reports")
    chosen = dict(list(informed_parameters(documents).items())[:MOST_PARAMETERS])
    drawn = {name: label for name, label in {**DRAWN, **chosen}.items() if table[name].notna().any()}
    figure = trend_figure(drawn_table(table, documents, chosen), AXES, drawn)
    for suffix in ("svg", "png"):
        paths.append(out / f"trend.{suffix}")
        figure.savefig(paths[-1], dpi=DPI)
    return paths
