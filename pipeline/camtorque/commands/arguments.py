"""Every option of the command line with its bounds, as a table. Imports nothing heavy: `--help` reads this alone."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

STUDIES = ("speed-accuracy", "stability")
METHODS = ("closed", "recursion", "denoc")
"""Ways to solve the mechanics; a test holds them to those of the mechanism."""
ENDINGS = ("land", "spill", "either")
"""Ways in which a delivery may end; a test holds them to those of the fit."""
FORMATS = ("csv", "xlsx", "mat", "parquet")
SHELLS = ("bash", "zsh", "fish")
LARGEST_TOLERANCE = 0.01
"""The coarsest grid of the speed-accuracy study is off by less than this share of the peak torque."""
FASTEST_RPM = 30000.0
"""A test holds it to that of recording.toml."""
LEAST_GRID, LARGEST_GRID = 600, 36000
"""Points of the angle grid; a test holds the least to what the fit needs."""


def number(low: float, high: float = float("inf"), above: bool = False, unit: str = "") -> Callable[[str], float]:
    """Return a reader of numbers from ``low`` (``above``: greater than it) to ``high``, in a unit if they have one."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not (low < value <= high if above else low <= value <= high):
            band = f"{_range(low, high, above)} {unit}".strip()
            raise argparse.ArgumentTypeError(f"found {text!r}, expected a number {band}")
        return value

    return read


def whole(low: int, high: float = float("inf")) -> Callable[[str], int]:
    """Return a reader of whole numbers from ``low`` to ``high``."""

    def read(text: str) -> int:
        digits = text.strip().removeprefix("-").removeprefix("+")
        if not digits.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"found {text!r}, expected a whole number {_range(low, high, False)}")
        return int(text)

    return read


def _range(low: float, high: float, above: bool) -> str:
    start = f"above {low:g}" if above else f"from {low:g}"
    return start if high == float("inf") else f"{start} to {high:g}"


Option = Mapping[str, Any]


def option(metavar: str, help: str, type: Callable[[str], Any] = Path, **how: Any) -> Option:
    """Return the keywords of `argparse.ArgumentParser.add_argument` for an option with a value."""
    return {"metavar": metavar, "help": help, "type": type, **how}


def flag(help: str) -> Option:
    """Return the keywords of an option without a value."""
    return {"help": help, "action": "store_true"}


def out(otherwise: str = "") -> dict[str, Option]:
    """Return the option of the output folder, required where nothing is written otherwise."""
    text = "output folder" + (f" (default {otherwise})" if otherwise else "")
    return {"--out": option("DIR", text, required=not otherwise)}


SPEED = number(0.0, FASTEST_RPM, above=True, unit="rpm")
RECORDING = {"recording": option("RECORDING", "folder with recording.toml, or that file")}
RESULTS = {"results": option("RESULT", "result.json, its folder, or a folder with reports below it", nargs="+")}
GRID = {"--n-theta": option("N", "points of the angle grid (default 3600)", whole(LEAST_GRID, LARGEST_GRID))}
TOLERANCE = {
    "--tolerance": option(
        "SHARE", f"wanted error of the angle grid, share of the peak torque, at most {LARGEST_TOLERANCE:g}",
        number(0.0, LARGEST_TOLERANCE, above=True),
    ),
}  # fmt: skip
ARGUMENTS: dict[str, dict[str, Option]] = {
    "new": {
        "files": option("FILE", "logs of one recording", nargs="+"),
        "--like": option("RECORDING", "recording or pump file to copy pump, trigger and sensors from"),
        **out("the folder of the first log"),
    },
    "check": RECORDING,
    "align": {**RECORDING, **out(), **GRID},
    "run": {
        **RECORDING, **out("reports/NAME, NAME being the recording's folder"), **GRID, **TOLERANCE,
        "--pdf": flag("the page as PDF too (extra `pdf`)"),
        "--limits": option("FILE", "bands that the numbers have to stay in, see docs/limits.md; exit status 3 where "
                           "one does not pass"),
    },
    "campaign": {
        "folder": option("DIR", "folder with recordings at or below it"), **out(), **GRID, **TOLERANCE,
        "--workers": option("N", "processes (default: as many as processors)", whole(1)),
        "--scheduler": option("URL", "running Dask scheduler, tcp://host:8786", str, default=""),
        "--cluster": option("FILE", "batch system to ask for workers (docs/campaigns.md)"),
        "--only": option("NAME", "one recording by its name in --list; no joint fit", str),
        "--list": flag("name, status and key of every recording; nothing is computed"),
        "--prune": flag("remove results of older inputs, options and versions"),
        "--retry-failed": flag("compute again what was refused before"),
    },
    "fit": {
        **RECORDING,
        "--parameters": option("FILE", "bounds, ties and fixed values, see docs/own_fit.md"),
        "--intervals": option("NAME", "parameters whose confidence intervals are sought by refits (slow)", str,
                              nargs="+", default=[]),
    },
    "compare": {
        "before": option("BEFORE", "recording or report of one; campaign or folder of recordings (paired by speed)"),
        "after": option("AFTER", "the same pump at the same speeds, later"), **out(),
    },
    "plan": {
        "fit": option("RESULT", "campaign.json, result.json, or the folder that holds it"),
        "--target": option("TEXT", "number and wanted standard uncertainty, such as 'chamber_peak 0.5 %%' or "
                           "'leakage 0.05'", str, required=True),
        "--no-tooth": flag("the rig cannot take a second tooth"),
        "--speed": option("RPM", "speeds that the rig can run (default: 0.7 to 1.45 times the middle of the fitted "
                          "ones)", SPEED, nargs="+", default=[]),
        **out("none: the table alone"),
    },
    "watch": {
        "folder": option("FOLDER", "recording whose CSV files grow, or folder in which finished recordings appear"),
        "--every": option("S", "seconds between looks (default 2)", number(0.1, 3600.0, unit="s"), default=2.0),
        "--block": option("CYCLES", "new cycles of a block (default 20)", whole(2, 100000), default=20),
        "--enough": option("PERCENT", "noise of the mean torque that is small enough, percent of its peak (default "
                           "0.1)", number(0.0, 10.0, above=True, unit="%"), default=0.1),
        "--until-enough": flag("stop when there are enough cycles"),
        "--seconds": option("S", "stop after that time", number(0.0, unit="s"), default=float("inf")),
    },
    "limits": {"file": option("LIMITS", "bands, see docs/limits.md"), **RESULTS},
    "export": {
        **RESULTS,
        "--out": option("DIR", "folder to be written (default tables)", default=Path("tables")),
        "--format": {"choices": FORMATS, "default": "csv", "help": "format of the tables (default csv)"},
        "--trend": flag("one row per report, and a figure over date and speed"),
    },
    "verify": {"folder": option("DIR", "folder that a command wrote")},
    "predict": {
        "pump": option("PUMP", "pump file, see docs/predict.md", nargs="?"),
        "--from": option("RESULT", "values of a fit: result.json, campaign.json, or the folder that holds it",
                         dest="fit"),
        "--load-of": option("RECORDING", "recording or report whose line pressure is the load (default: the fitted "
                            "one nearest in speed)"),
        "--pump": option("FILE", "another pump with the fit's losses", dest="other_pump"),
        "--cam": option("FILE", "another lift table, of the columns of the fitted one"),
        "--clearance": option("CHANGE", "change of the plunger's clearance, such as +1um (=-1um: less), or 3um+1um "
                              "from a known one (default 4 um)", str, default=""),
        "--ending": option("NAME", f"how delivery ends under that load: {', '.join(ENDINGS)} (default: as in the "
                           "fitted recordings)", str, choices=ENDINGS, default=""),
        "--speed": option("RPM", "cam speeds [rpm]", SPEED, nargs="+", required=True),
        "--pressure": option("FILE", "pressure on the plunger over cam angle (CSV)"),
        "--method": option("NAME", f"{' or '.join(METHODS)} (default: {METHODS[0]})", str, choices=METHODS),
        **out("none: the table alone"), **TOLERANCE,
    },
    "design": {
        "task": option("DESIGN", "design file, see docs/design.md"),
        "--from": option("RESULT", "friction, chamber and losses of a fit of this pump: result.json, campaign.json, "
                         "or the folder that holds it", dest="fit"),
        **out(),
    },
    "study": {
        "name": option("NAME", " or ".join(STUDIES), str, choices=STUDIES), **out(),
        "--quick": flag("a coarse version within about a minute"),
    },
    "completion": {"shell": option("SHELL", ", ".join(SHELLS), str, choices=SHELLS)},
}  # fmt: skip
"""Command -> option -> keywords of `argparse.ArgumentParser.add_argument`, in the order of the help."""
JSON = {"--json": flag("one JSON object on standard output")}
WITHOUT_DOCUMENT = ("study", "completion")
EVERYWHERE = {
    "--quiet": flag("no progress lines on standard error"), "--debug": flag("show where an unexpected error arose"),
}  # fmt: skip
EXCLUSIVE = {"campaign": ("--scheduler", "--cluster", "--only", "--list", "--prune")}
"""Command -> options of which one may be given."""


def add_arguments(parser: argparse.ArgumentParser, command: str) -> None:
    """Add the options of a command to its parser."""
    alone = EXCLUSIVE.get(command, ())
    group = parser.add_mutually_exclusive_group() if alone else parser
    json = {} if command in WITHOUT_DOCUMENT else JSON
    for name, how in {**ARGUMENTS[command], **json, **EVERYWHERE}.items():
        (group if name in alone else parser).add_argument(name, **how)
