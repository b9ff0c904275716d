"""THE FLOW for one recording: one call per room."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from camtorque.align import AlignOptions, align
from camtorque.compiled import load_compiler
from camtorque.fit.result import fitted_torque
from camtorque.fit.single import Prepared, fit_prepared, prepare
from camtorque.ingest import read_recording, summarise
from camtorque.ingest.check import angle_speed_findings
from camtorque.jsonable import now
from camtorque.laws import STATED_NAMES
from camtorque.limits import Limit, refuse_unknown_parameters
from camtorque.mechanism.load_check import load_findings
from camtorque.process.threads import on_one_thread
from camtorque.progress import Progress, silent
from camtorque.records import Recording, Refusal
from camtorque.rehearsal import rigid_torque
from camtorque.report.bundle import RunResult
from camtorque.report.folder import output_folder
from camtorque.report.write import write_run

try:
    import resource
except ImportError:  # not on Windows: the figure is then null
    resource = None  # type: ignore[assignment]


@dataclass(frozen=True)
class RunOptions:
    """What a user may choose about a run.

    Attributes
    ----------
    align : options of the alignment
    limits : bands that numbers of result.json have to stay in; the page and result.json say whether they do
    """

    align: AlignOptions = field(default_factory=AlignOptions)
    limits: tuple[Limit, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.limits, tuple | list):
            kind = type(self.limits).__name__
            raise Refusal(f"RunOptions: found limits of type {kind}, expected a tuple of camtorque.Limit")
        given = ((self.align, AlignOptions), *((limit, Limit) for limit in self.limits))
        for value, kind in given:
            if not isinstance(value, kind):
                raise Refusal(f"RunOptions: found a {type(value).__name__}, expected a camtorque.{kind.__name__}")
        refuse_unknown_parameters(self.limits, STATED_NAMES)


@contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - start


def peak_memory_mb() -> float:
    """Return the largest resident size of this process so far [MB], nan where the system does not tell."""
    if resource is None:
        return float("nan")
    per_mb = 2.0**20 if sys.platform == "darwin" else 2.0**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / per_mb


def analyse(path: Path, options: RunOptions, progress: Progress = silent) -> tuple[RunResult, Prepared]:
    """Return everything about one recording, and what a joint fit needs of it; see `analyse_recording`."""
    seconds: dict[str, float] = {}
    progress(f"reading {path}")
    with _timed(seconds, "ingest"):
        recording = read_recording(path)
    return analyse_recording(recording, options, progress, seconds)


@on_one_thread
def analyse_recording(
    recording: Recording, options: RunOptions, progress: Progress = silent, seconds: Mapping[str, float] | None = None
) -> tuple[RunResult, Prepared]:
    """Return everything about one recording that is read already; ``seconds``: time spent so far by stage.

    Raises
    ------
    Refusal : the recording cannot be used
    """
    spent = {"ingest": 0.0, **(seconds or {})}
    progress("aligning to the cam angle")
    with _timed(spent, "align"):
        load_compiler()  # the fit needs it, and a long log is aligned in a third of the time
        cycles = align(recording, options.align)
    progress(f"rigid model of {cycles.index.size} cycles")
    with _timed(spent, "model"):
        rigid = rigid_torque(recording, cycles)
        found = load_findings(recording, cycles, rigid)
        found = (*found, *angle_speed_findings(recording, cycles.mean_speed))
        recording = replace(recording, findings=(*summarise(recording, cycles.pulses).findings, *found))
    progress("fitting: which effects, which values, how sure")
    with _timed(spent, "fit"):
        prepared = prepare(recording, cycles, rigid)
        fitted = fitted_torque(fit_prepared(prepared), recording, cycles, rigid, prepared.means)
    result = RunResult(recording, cycles, rigid, fitted, spent, now(), peak_memory_mb(), limits=options.limits)
    return result, prepared


def run_recording(
    path: Path, out: Path, options: RunOptions | None = None, progress: Progress = silent
) -> dict[str, Any]:
    """Write the report of one recording, or nothing where it is refused, and return the content of its result.json.

    Raises
    ------
    Refusal : the recording cannot be used, or ``out`` holds something else
    """
    with output_folder(out, "result.json") as folder:
        result, _ = analyse(path, options or RunOptions(), progress)
        progress("writing the report")
        return write_run(result, folder)
