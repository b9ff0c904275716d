"""During a test: what each new block of cycles looks like, and whether there are enough of them.

Two ways to follow a test: a recording whose CSV files grow, and a folder in which finished recordings appear. No model:
pump and losses are `camtorque run`'s, here it is the measurement that is looked at.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from camtorque.align import align
from camtorque.config.recording import load_recording_config
from camtorque.config.schemas import RECORDING_FILE
from camtorque.growing import read_so_far
from camtorque.ingest import read_recording
from camtorque.mechanism.load_check import on_base
from camtorque.process.folders import files_below, why_closed
from camtorque.process.threads import on_one_thread
from camtorque.records import CamCycles, CutFlowRow, Recording, Refusal
from camtorque.results import CAMPAIGN, NAME
from camtorque.units import DEGREE, RPM

LOOK_SHARE = 0.25
"""Looking takes at most this share of the time: a long file is read from its begin each time."""
LEAST_BASE = 5.0 * DEGREE
"""The base circle is at least so long [rad]."""
SAME_SPEED = 0.02
WIDE, DRIFT_SHARE = 3.0, 0.002
"""A drift is beyond this many standard errors and this share of the peak torque: twice the model error that the fit
admits. The uncertainty of the zero itself does not count: it is the same at both times."""


@dataclass(frozen=True)
class WatchOptions:
    """What a user may choose, see `camtorque watch`: times in s, a block in new cycles of a growing recording.

    The fit admits a model error of 0.1 % of the peak torque: less noise of the mean torque adds nothing.
    """

    every: float = 2.0
    block_cycles: int = 20
    enough_percent: float = 0.1
    until_enough: bool = False
    seconds: float = float("inf")


@dataclass(frozen=True)
class Block:
    """What one block of cycles looks like.

    Attributes
    ----------
    name : recording, and number of the block where it grows
    cycles, lost : used and rejected cycles of the block; reasons : why, by cut
    speed_rpm : mean of the block
    base_torque_nm : mean torque on the base circle, None without torque
    drift_nm, drift_limit_nm : its change since the first block at this speed, and what the scatter allows
    jitter_deg : jitter of the trigger edge in cam angle
    clipped : cycles with a clipped channel
    noise_percent : of the mean torque of half the cycles so far at this speed, percent of peak; None without torque
    cycles_wanted : cycles at this speed that make it small enough
    enough : True where there are that many
    """

    name: str
    cycles: int
    lost: int
    reasons: tuple[str, ...]
    speed_rpm: float
    base_torque_nm: float | None
    drift_nm: float | None
    drift_limit_nm: float | None
    jitter_deg: float
    clipped: int
    noise_percent: float | None
    cycles_wanted: int | None
    enough: bool

    @property
    def drifted(self) -> bool:
        """Tell whether the torque on the base circle moved by more than the scatter allows."""
        return (
            self.drift_nm is not None and self.drift_limit_nm is not None and abs(self.drift_nm) > self.drift_limit_nm
        )


@dataclass(frozen=True)
class Waiting:
    """Nothing to report yet, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class Level:
    """Torque on the base circle: mean and standard error of the mean; largest mean torque of the revolution [N m]."""

    mean: float
    stderr: float
    peak: float


@dataclass
class Pool:
    """Cycles at one speed so far: their number, degrees of freedom times mean variance, peak of the mean torque.

    ``first`` is their first torque on the base circle: drag goes with speed, so that a drift shows at one speed only.
    """

    speed: float
    first: Level | None = None
    cycles: int = 0
    squares: float = 0.0
    freedom: int = 0
    peak: float = 0.0


@dataclass
class Memory:
    """What a watch remembers between two looks."""

    pools: list[Pool] = field(default_factory=list)
    rejected: dict[tuple[Path, str], int] = field(default_factory=dict)

    def pool(self, speed: float) -> Pool:
        """Return the cycles at about that speed."""
        for pool in self.pools:
            if abs(pool.speed / speed - 1.0) < SAME_SPEED:
                return pool
        self.pools.append(Pool(speed))
        return self.pools[-1]

    def newly_rejected(self, path: Path, cut_flow: Sequence[CutFlowRow]) -> dict[str, int]:
        """Return by reason how many cycles of a recording were rejected since the last look: a log tells all of it."""
        found = {row.reason: row.cycles_single - self.rejected.get((path, row.reason), 0) for row in cut_flow}
        self.rejected |= {(path, row.reason): row.cycles_single for row in cut_flow}
        return {reason: number for reason, number in found.items() if number > 0}


def base_level(recording: Recording, cycles: CamCycles, rows: slice) -> Level | None:
    """Return the torque of some cycles on the base circle, None without torque or lift table."""
    if cycles.torque is None or recording.lift_table is None:
        return None
    table = recording.lift_table
    lift = table.at(cycles.theta)
    order = np.argsort(lift, kind="stable")
    least = int(np.ceil(LEAST_BASE / (2.0 * np.pi) * lift.size))
    base = order[: max(least, int(np.count_nonzero(on_base(lift))))]
    level = cycles.torque[rows][:, base].mean(axis=1)
    stderr = float(level.std(ddof=1) / np.sqrt(level.size)) if level.size > 1 else float("nan")
    return Level(float(level.mean()), stderr, float(cycles.torque.mean(axis=0).max()))


def look(
    name: str, recording: Recording, cycles: CamCycles, rows: slice, lost: int, memory: Memory, enough_percent: float
) -> Block:
    """Return what the cycles ``rows`` of a recording look like, ``lost`` rejected beside them, and remember them."""
    level = base_level(recording, cycles, rows)
    pool = memory.pool(cycles.mean_speed)
    pool.first = pool.first or level
    drift, limit = _drift(pool.first, level)
    _remember(pool, cycles, rows)
    noise, wanted = _noise(pool, enough_percent)
    rejected = memory.newly_rejected(recording.config.path, cycles.cut_flow)
    speed = float(np.mean(cycles.speed[rows]))
    return Block(
        name, int(cycles.speed[rows].size), lost,
        tuple(f"{number} {reason}" for reason, number in rejected.items()),
        speed / RPM, None if level is None else level.mean, drift, limit, cycles.trigger_jitter_s * speed / DEGREE,
        sum(number for reason, number in rejected.items() if reason.endswith("_clipped")), noise, wanted,
        wanted is not None and pool.cycles >= wanted,
    )  # fmt: skip


def _drift(first: Level | None, level: Level | None) -> tuple[float | None, float | None]:
    if first is None or level is None or first is level:
        return None, None
    scatter = WIDE * float(np.hypot(first.stderr, level.stderr))
    return level.mean - first.mean, max(scatter, DRIFT_SHARE * first.peak) if np.isfinite(scatter) else None


def _remember(pool: Pool, cycles: CamCycles, rows: slice) -> None:
    if cycles.torque is None:
        return
    torque = cycles.torque[rows]
    pool.cycles += len(torque)
    if len(torque) > 1:
        pool.squares += (len(torque) - 1) * float(np.mean(np.var(torque, axis=0, ddof=1)))
        pool.freedom += len(torque) - 1
    pool.peak = max(pool.peak, float(np.max(np.abs(torque.mean(axis=0)))))


def _noise(pool: Pool, enough_percent: float) -> tuple[float | None, int | None]:
    """Return the noise of the mean of half the cycles (the fit sees every other one), and the cycles wanted."""
    if not pool.freedom or not pool.peak:
        return None, None
    one = 100.0 * np.sqrt(pool.squares / pool.freedom) / pool.peak
    # both halves need two cycles at least
    return float(one * np.sqrt(2.0 / pool.cycles)), max(4, int(np.ceil(2.0 * (one / enough_percent) ** 2)))


def watch(
    folder: Path,
    options: WatchOptions | None = None,
    sleep: Callable[[float], None] = time.sleep,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Block | Waiting]:
    """Yield each block as it appears, until there are enough or the time is over.

    Parameters
    ----------
    folder : a recording whose CSV files grow, or a folder in which finished recordings appear
    options : choices of the user
    sleep, clock : of the process; a replay brings its own

    Raises
    ------
    Refusal : there is no such folder, it is a report, or its recording.toml cannot be used
    """
    options = options or WatchOptions()
    if not folder.is_dir():
        raise Refusal(f"{folder}: found no such folder, expected one to watch; check the path")
    report = next((name for name in (NAME, CAMPAIGN) if (folder / name).is_file()), "")
    if report:
        raise Refusal(
            f"{folder}: found {report}, a finished report, expected a recording that grows or the folder in which "
            "recordings appear; name that"
        )
    looks = _growing(folder, options) if (folder / RECORDING_FILE).is_file() else _appearing(folder, options)
    end = clock() + options.seconds
    said: Waiting | None = None
    while True:
        start = clock()
        for item in next(looks):
            if isinstance(item, Block) or item != said:
                yield item
            said = item if isinstance(item, Waiting) else None
            if options.until_enough and isinstance(item, Block) and item.enough:
                return
        if clock() >= end:
            return
        pause = max(options.every, (clock() - start) * (1.0 / LOOK_SHARE - 1.0))
        sleep(max(0.0, min(pause, end - clock())))


Looks = Iterator[list[Block | Waiting]]


def _growing(folder: Path, options: WatchOptions) -> Looks:
    """Yield what is new at each look at one recording that grows."""
    config, memory = load_recording_config(folder), Memory()
    sizes: tuple[int, ...] = ()
    blocks, told, found, rest = 0, 0, 0, False
    while True:
        now = tuple(spec.path.stat().st_size if spec.path.is_file() else 0 for spec in config.channels)
        if now == sizes:
            few = f"; the cycles since the last block are fewer than {options.block_cycles}" if rest else ""
            yield [Waiting(config.id, f"the files do not grow{few}")] if blocks or rest else []
            continue
        if any(size < before for size, before in zip(now, sizes, strict=False)):
            memory, blocks, told, found, sizes = Memory(), 0, 0, 0, now
            yield [Waiting(config.id, "a log has become shorter: it was begun again, and all is counted anew")]
        sizes = now
        try:
            recording, cycles = read_so_far(folder)
        except Refusal as refusal:
            yield [Waiting(config.id, str(refusal))]
            continue
        # by their numbers: what is usual changes as the log grows, and with it which earlier cycles are used
        rows = slice(int(np.searchsorted(cycles.index, told)), cycles.index.size)
        new = rows.stop - rows.start
        rest = 0 < new < options.block_cycles
        if new < options.block_cycles:
            yield []
            continue
        blocks += 1
        lost = max(cycles.cycles_found - found - new, 0)
        told, found = int(cycles.index[-1]) + 1, cycles.cycles_found
        yield [look(f"{config.id} block {blocks}", recording, cycles, rows, lost, memory, options.enough_percent)]


def _appearing(folder: Path, options: WatchOptions) -> Looks:
    """Yield what is new at each look at a folder in which finished recordings appear."""
    memory, done, told, sizes = Memory(), set[Path](), set[Path](), dict[Path, int]()
    while True:
        items: list[Block | Waiting] = []
        closed: list[Path] = []
        for block, size in _by_age(folder, closed):
            # a recording is finished when it has not grown since the look before
            finished, sizes[block] = sizes.get(block) == size, size
            if finished and block not in done:
                done.add(block)
                items.append(_finished(block.relative_to(folder).as_posix(), block, memory, options))
        items += [
            Waiting(path.relative_to(folder).as_posix(), why_closed(path, RECORDING_FILE))
            for path in closed if path not in told
        ]  # fmt: skip
        told |= set(closed)
        yield items if done or told else [Waiting(folder.name, f"no finished recording below {folder} yet")]


def _by_age(folder: Path, closed: list[Path]) -> list[tuple[Path, int]]:
    """Return the recordings below a folder, oldest first, with the size of their files; one just gone is left out.

    Folders that cannot be looked into are added to ``closed``.
    """
    found = []
    for config in files_below(folder, RECORDING_FILE, closed):
        with suppress(FileNotFoundError):
            files = set(config.parent.iterdir())
            with suppress(Refusal):  # what is still being written names no logs; they may lie elsewhere
                files |= {spec.path for spec in load_recording_config(config).channels}
            size = sum(file.stat().st_size for file in files if file.is_file())
            found.append((config.stat().st_mtime, config.parent, size))
    return [(block, size) for _, block, size in sorted(found)]


@on_one_thread
def _finished(name: str, block: Path, memory: Memory, options: WatchOptions) -> Block | Waiting:
    try:
        recording = read_recording(block)
        cycles = align(recording)
    except Refusal as refusal:
        return Waiting(name, f"refused: {refusal}")
    lost = cycles.cycles_found - cycles.index.size
    return look(name, recording, cycles, slice(None), lost, memory, options.enough_percent)
