"""Every option of the command line with its bounds. Imports nothing heavy: `--help` reads this alone."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

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
LEAST_GRID, LARGEST_GRID = 36, 36000


def number(low: float, high: float = float("inf"), above: bool = False) -> Callable[[str], float]:
    """Return a reader of numbers from ``low`` (``above``: greater than it) to ``high``."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not (low < value <= high if above else low <= value <= high):
            raise argparse.ArgumentTypeError(f"found {text!r}, expected a number {_range(low, high, above)}")
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


def _recording(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="folder with recording.toml, or that file")


def _out(parser: argparse.ArgumentParser, required: bool = True, otherwise: str = "") -> None:
    text = "folder to be written" + (f" (default {otherwise})" if otherwise else "")
    parser.add_argument("--out", type=Path, required=required, metavar="DIR", help=text)


def _grid(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--n-theta", type=whole(LEAST_GRID, LARGEST_GRID), metavar="N", help="points of the angle grid (default 3600)"
    )


def _tolerance(parser: argparse._ActionsContainer) -> None:
    text = f"wanted error of the angle grid, share of the peak torque, at most {LARGEST_TOLERANCE:g}"
    parser.add_argument("--tolerance", type=number(0.0, LARGEST_TOLERANCE, above=True), metavar="SHARE", help=text)


def _fit(parser: argparse.ArgumentParser) -> None:
    _grid(parser)
    _tolerance(parser)


def new(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `new`."""
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="logs of one recording")
    parser.add_argument(
        "--like", type=Path, metavar="RECORDING", help="recording or pump file whose pump, trigger and sensors it takes"
    )
    _out(parser, required=False, otherwise="the folder of the first log")


def check(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `check`."""
    _recording(parser)


def align(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `align`."""
    _recording(parser)
    _out(parser)
    _grid(parser)


def run(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `run`."""
    _recording(parser)
    _out(parser, required=False, otherwise="reports/NAME, NAME being the recording's folder")
    _fit(parser)
    parser.add_argument("--seed", type=whole(0), default=0, metavar="N", help="of the random numbers (default 0)")
    _pdf(parser)
    _limits(parser)


def _pdf(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--pdf", action="store_true", help="the page as PDF too (extra `pdf`)")


def _limits(parser: argparse.ArgumentParser) -> None:
    text = "bands that the numbers have to stay in, see docs/limits.md; exit status 3 where one does not pass"
    parser.add_argument("--limits", type=Path, metavar="FILE", help=text)


def limits(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `limits`."""
    parser.add_argument("file", type=Path, metavar="LIMITS", help="bands, see docs/limits.md")
    _results(parser)


def _results(parser: argparse.ArgumentParser) -> None:
    text = "result.json, its folder, or a folder with reports below it"
    parser.add_argument("results", type=Path, nargs="+", metavar="RESULT", help=text)


def export(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `export`."""
    _results(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("tables"), metavar="DIR", help="folder to be written (default tables)"
    )
    parser.add_argument("--format", choices=FORMATS, default="csv", help="of the tables (default csv)")
    parser.add_argument("--trend", action="store_true", help="one row per report, and a figure over date and speed")


def fit(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fit`."""
    _recording(parser)
    text = "bounds, ties and fixed values, see docs/own_fit.md"
    parser.add_argument("--parameters", type=Path, metavar="FILE", help=text)
    text = "parameters whose confidence intervals are sought by refits (slow)"
    parser.add_argument("--intervals", nargs="+", default=[], metavar="NAME", help=text)


def campaign(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `campaign`."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder with recordings at or below it")
    _out(parser)
    _fit(parser)
    parser.add_argument("--workers", type=whole(1), metavar="N", help="processes (default: as many as processors)")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--scheduler", default="", metavar="URL", help="running Dask scheduler, tcp://host:8786")
    where.add_argument(
        "--cluster", type=Path, metavar="FILE", help="batch system to ask for workers (docs/campaigns.md)"
    )
    where.add_argument("--only", default="", metavar="KEY", help="one recording by its name of --list; no joint fit")
    where.add_argument(
        "--list", action="store_true", help="name, status and key of every recording; nothing is computed"
    )
    where.add_argument("--prune", action="store_true", help="remove results of older inputs, options and versions")
    parser.add_argument("--retry-failed", action="store_true", help="compute again what was refused before")


def compare(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    text = "recording or report of one; campaign or folder of recordings (paired by speed)"
    parser.add_argument("before", type=Path, metavar="BEFORE", help=text)
    parser.add_argument("after", type=Path, metavar="AFTER", help="the same pump at the same speeds, later")
    _out(parser)


def watch(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `watch`."""
    text = "recording whose CSV files grow, or folder in which finished recordings appear"
    parser.add_argument("folder", type=Path, metavar="FOLDER", help=text)
    every = number(0.1, 3600.0)
    parser.add_argument("--every", type=every, default=2.0, metavar="S", help="seconds between looks (default 2)")
    parser.add_argument(
        "--block", type=whole(2, 100000), default=20, metavar="CYCLES", help="new cycles of a block (default 20)"
    )
    share = number(0.0, 10.0, above=True)
    text = "noise of the mean torque that is small enough, percent of its peak (default 0.1)"
    parser.add_argument("--enough", type=share, default=0.1, metavar="PERCENT", help=text)
    parser.add_argument("--until-enough", action="store_true", help="stop when there are enough cycles")
    forever = float("inf")
    parser.add_argument("--seconds", type=number(0.0), default=forever, metavar="S", help="stop after that time")


def verify(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `verify`."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="output of run, align, predict or campaign")


def predict(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `predict`."""
    speeds = number(0.0, FASTEST_RPM, above=True)
    parser.add_argument("pump", type=Path, nargs="?", metavar="PUMP", help="pump file, see docs/predict.md")
    text = "values of a fit: result.json, campaign.json, or the folder that holds it"
    parser.add_argument("--from", dest="fit", type=Path, metavar="RESULT", help=text)
    text = "recording or report whose line pressure is the load (default: the fitted one nearest in speed)"
    parser.add_argument("--load-of", type=Path, metavar="RECORDING", help=text)
    parser.add_argument(
        "--pump", dest="other_pump", type=Path, metavar="FILE", help="another pump with the fit's losses"
    )
    parser.add_argument("--cam", type=Path, metavar="FILE", help="another lift table, of the columns of the fitted one")
    text = "change of the plunger's clearance, such as +1um (=-1um: less), or 3um+1um from a known one (default 4 um)"
    parser.add_argument("--clearance", default="", metavar="CHANGE", help=text)
    text = f"how delivery ends under that load: {', '.join(ENDINGS)} (default: as in the fitted recordings)"
    parser.add_argument("--ending", choices=ENDINGS, default="", metavar="NAME", help=text)
    parser.add_argument("--speed", type=speeds, nargs="+", required=True, metavar="RPM", help="cam speeds [rpm]")
    parser.add_argument("--pressure", type=Path, metavar="FILE", help="pressure on the plunger over cam angle (CSV)")
    text = f"{' or '.join(METHODS)} (default: {METHODS[0]})"
    parser.add_argument("--method", choices=METHODS, metavar="NAME", help=text)
    _out(parser, required=False, otherwise="none: the table alone")
    _tolerance(parser)


def design(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `design`."""
    parser.add_argument("task", type=Path, metavar="DESIGN", help="design file, see docs/design.md")
    text = "friction, chamber and losses of a fit of this pump: result.json, campaign.json, or the folder that holds it"
    parser.add_argument("--from", dest="fit", type=Path, metavar="RESULT", help=text)
    _out(parser)


def plan(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    text = "campaign.json, result.json, or the folder that holds it"
    parser.add_argument("fit", type=Path, metavar="RESULT", help=text)
    text = "number and wanted standard uncertainty, such as 'chamber_peak 0.5 %%' or 'leakage 0.05'"
    parser.add_argument("--target", required=True, metavar="TEXT", help=text)
    parser.add_argument("--no-tooth", action="store_true", help="a second tooth cannot be fitted")
    speeds = number(0.0, FASTEST_RPM, above=True)
    text = "speeds that the rig can run (default: 0.7 to 1.45 times the middle of the fitted ones)"
    parser.add_argument("--speed", type=speeds, nargs="+", default=[], metavar="RPM", help=text)
    _out(parser, required=False, otherwise="none: the table alone")


def study(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `study`."""
    parser.add_argument("name", choices=STUDIES, metavar="NAME", help=" or ".join(STUDIES))
    _out(parser)
    parser.add_argument("--quick", action="store_true", help="a coarse version within about a minute")


def completion(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `completion`."""
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))
