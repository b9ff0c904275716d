"""Watch: a recording replayed at its own speed by a clock of the test's, finished blocks, drift, enough."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import chain, repeat
from pathlib import Path

import camtorque
import numpy as np
import pytest
from camtorque import cli
from camtorque.align import AlignOptions
from camtorque.records import CutFlowRow, Refusal
from camtorque.watch import Block, Memory, Waiting, WatchOptions, base_level, look, watch

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "raw_examples" / "A_1250rpm"
LOG = "A_1250rpm_all.csv"
DURATION = 2.0
"""Of the part that is replayed [s]."""
RATE = 50000.0


@dataclass
class Replay:
    """Writes the log of a recording at the speed at which it was recorded, by its own clock."""

    folder: Path
    head: bytes
    lines: list[bytes]
    now: float = 0.0

    def clock(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        """Let time pass: write what a logger would have written, the last line half."""
        self.now += seconds
        rows = min(int(self.now * RATE), len(self.lines))
        half = self.lines[rows][:7] if rows < len(self.lines) else b""
        (self.folder / LOG).write_bytes(self.head + b"".join(self.lines[:rows]) + half)


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "calibration", tmp_path / "calibration")
    folder = tmp_path / "raw" / "A"
    shutil.copytree(EXAMPLE, folder)
    (folder / LOG).unlink()
    return folder


@pytest.fixture
def replay(bench: Path) -> Replay:
    lines = (EXAMPLE / LOG).read_bytes().splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if line[:1].isdigit() or line[:1] == b"-")
    return Replay(bench, b"".join(lines[:first]), lines[first : first + int(DURATION * RATE)])


def test_a_growing_recording_block_by_block(bench: Path, replay: Replay) -> None:
    options = WatchOptions(every=0.5, block_cycles=8, seconds=DURATION + 1.0)
    seen = list(watch(bench, options, replay.sleep, replay.clock))
    blocks = [item for item in seen if isinstance(item, Block)]
    assert isinstance(seen[0], Waiting)
    assert "found no such file yet" in seen[0].reason
    assert isinstance(seen[-1], Waiting)
    assert seen[-1].reason == "the files do not grow"
    assert len(blocks) == 4
    whole = camtorque.align(bench)
    assert sum(block.cycles for block in blocks) == whole.index.size
    assert blocks[0].speed_rpm == pytest.approx(1250.0, rel=2e-3)
    noise = [block.noise_percent for block in blocks]
    assert noise == sorted(noise, reverse=True)  # type: ignore[type-var]
    # the zero of this recording creeps by 0.14 N m in two seconds
    first, last = blocks[0].base_torque_nm, blocks[-1].base_torque_nm
    assert first is not None
    assert last is not None
    assert blocks[-1].drift_nm == pytest.approx(last - first)
    assert [block.drifted for block in blocks] == [False, False, False, True]


def test_cycles_that_make_no_block_are_told_when_the_log_ends(bench: Path, replay: Replay) -> None:
    """A log shorter than a block was watched in silence, and the end of a longer one was in no line."""
    options = WatchOptions(every=0.5, block_cycles=30, seconds=DURATION + 2.0)
    seen = list(watch(bench, options, replay.sleep, replay.clock))
    block, last = next(item for item in seen if isinstance(item, Block)), seen[-1]
    assert camtorque.align(bench).index.size > block.cycles
    assert isinstance(last, Waiting)
    assert last.reason == "the files do not grow; the cycles since the last block are fewer than 30"
    (alone,) = watch(bench, WatchOptions(every=0.5, block_cycles=1000, seconds=1.0), replay.sleep, replay.clock)
    assert isinstance(alone, Waiting)
    assert alone.reason.startswith("the files do not grow; ")


def test_it_stops_when_there_are_enough(bench: Path, replay: Replay) -> None:
    options = WatchOptions(every=0.5, block_cycles=8, enough_percent=5.0, until_enough=True)
    *_, last = watch(bench, options, replay.sleep, replay.clock)
    assert isinstance(last, Block)
    assert last.enough
    assert last.cycles_wanted == 4
    assert replay.now < DURATION


def test_a_pause_after_a_block_is_told_again(bench: Path, replay: Replay) -> None:
    looks = watch(bench, WatchOptions(every=1.0, block_cycles=8, seconds=60.0), replay.sleep, replay.clock)
    told = []
    for pause in (0.0, 1.0, 0.0, 1.0):
        replay.now -= pause  # the logger writes nothing between two looks
        told.append(next(item for item in looks if "no such file" not in getattr(item, "reason", "")))
    assert [type(item) for item in told] == [Block, Waiting, Block, Waiting]
    assert told[1] == told[3]


def test_a_log_that_is_begun_again_is_counted_anew(bench: Path, replay: Replay) -> None:
    looks = watch(bench, WatchOptions(every=1.0, block_cycles=8, seconds=60.0), replay.sleep, replay.clock)
    assert any(isinstance(item, Block) for item in looks)
    replay.now = -0.6  # the next look is a second later
    again = [next(looks), next(looks)]
    assert isinstance(again[0], Waiting)
    assert "begun again" in again[0].reason
    assert isinstance(again[1], Block)
    assert again[1].name == "A_1250rpm block 1", "blocks are counted anew, too"
    assert again[1].drift_nm is None


def test_what_cannot_be_used_yet_is_told_by_its_own_name(bench: Path) -> None:
    (bench / LOG).write_text("no log\n")
    (told,) = watch(bench, WatchOptions(seconds=0.0))
    assert isinstance(told, Waiting)
    assert str(bench / LOG) in told.reason
    assert "camtorque-watch" not in told.reason


def test_a_binary_log_is_not_cut_at_a_line(bench: Path) -> None:
    shutil.copytree(ROOT / "raw_examples" / "A_1000rpm", bench.parent / "binary")
    folder = bench.parent / "binary"
    (whole,) = [item for item in watch(folder, WatchOptions(seconds=0.0)) if isinstance(item, Block)]
    assert whole.cycles == camtorque.align(folder).index.size
    (log,) = folder.glob("*.tdms")
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    (told,) = watch(folder, WatchOptions(seconds=0.0))
    assert isinstance(told, Waiting)
    assert told.reason.endswith(f"({log.name}: not every binary log can be read before it is finished)")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_text_is_read_up_to_its_last_whole_line(bench: Path, replay: Replay, encoding: str) -> None:
    text = (replay.head + b"".join(replay.lines[:40_000])).decode("utf-8-sig")
    (bench / LOG).write_bytes((text + "1.23").encode(encoding))
    (told,) = watch(bench, WatchOptions(block_cycles=8, seconds=0.0))
    assert isinstance(told, Block)


def test_finished_recordings_are_told_once_they_do_not_grow(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(EXAMPLE / LOG, bench / LOG)
    (bench.parent / "B").mkdir()
    (bench.parent / "B" / "recording.toml").write_text("no toml", encoding="utf-8")
    assert cli.main(["watch", str(bench.parent), "--every", "0.1", "--seconds", "0.1", "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert rows[0]["reason"].startswith("no finished recording below")
    by_name = {row["name"]: row for row in rows[1:]}
    assert by_name["A"]["kind"] == "block"
    assert by_name["A"]["cycles"] > 40
    assert "is not valid TOML" in by_name["B"]["reason"]


@pytest.mark.parametrize("name", ["result.json", "campaign.json"])
def test_a_report_is_nothing_to_watch(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("{}", encoding="utf-8")
    with pytest.raises(Refusal, match=rf"found {name}, a finished report, expected a recording that grows"):
        next(watch(tmp_path))


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(Refusal, match="found no such folder, expected one to watch"):
        next(watch(tmp_path / "x"))


@pytest.fixture(scope="module")
def aligned() -> tuple[camtorque.Recording, camtorque.CamCycles]:
    recording = camtorque.read(EXAMPLE)
    return recording, camtorque.align(recording, n_theta=AlignOptions().n_theta)


def seen(
    aligned: tuple[camtorque.Recording, camtorque.CamCycles], change: Callable[[np.ndarray], np.ndarray], memory: Memory
) -> Block:
    recording, cycles = aligned
    assert cycles.torque is not None
    return look("x", recording, replace(cycles, torque=change(cycles.torque)), slice(None), 0, memory, 0.1)


def test_a_drift_of_the_zero_is_told(aligned: tuple[camtorque.Recording, camtorque.CamCycles]) -> None:
    memory = Memory()
    first = seen(aligned, lambda torque: torque, memory)
    assert first.drift_nm is None
    assert not seen(aligned, lambda torque: torque, memory).drifted
    moved = seen(aligned, lambda torque: torque + 0.5, memory)
    assert moved.drift_nm == pytest.approx(0.5)
    assert moved.drifted


def test_another_speed_is_no_drift(aligned: tuple[camtorque.Recording, camtorque.CamCycles]) -> None:
    recording, cycles = aligned
    memory = Memory()
    seen(aligned, lambda torque: torque, memory)
    assert cycles.torque is not None
    slower = replace(cycles, torque=cycles.torque - 0.5, speed=0.3 * cycles.speed)
    assert look("slower", recording, slower, slice(None), 0, memory, 0.1).drift_nm is None


def test_the_noise_is_that_of_half_the_cycles(aligned: tuple[camtorque.Recording, camtorque.CamCycles]) -> None:
    rng = np.random.default_rng(3)
    block = seen(aligned, lambda torque: torque.mean(axis=0) + rng.normal(0.0, 0.6, torque.shape), Memory())
    peak = np.max(np.abs(aligned[1].torque.mean(axis=0)))  # type: ignore[union-attr]
    # the variance of so many samples is known to 1 %, the peak of the noisy mean to 0.5 %
    assert block.noise_percent == pytest.approx(100.0 * 0.6 / peak * np.sqrt(2.0 / block.cycles), rel=0.02)
    assert block.cycles_wanted == pytest.approx(2.0 * (100.0 * 0.6 / peak / 0.1) ** 2, rel=0.03)
    assert not block.enough


def test_the_base_circle_is_where_the_follower_rests(aligned: tuple[camtorque.Recording, camtorque.CamCycles]) -> None:
    recording, cycles = aligned
    lift = recording.cam_table.at(cycles.theta)
    marked = np.where(lift < 0.005 * lift.max(), 1.0, np.where(lift > 0.02 * lift.max(), 100.0, 1.0))
    level = base_level(recording, replace(cycles, torque=np.tile(marked, (cycles.index.size, 1))), slice(0, 3))
    assert level is not None
    assert level.mean == 1.0
    assert base_level(recording, replace(cycles, torque=None), slice(None)) is None


def test_blocks_of_one_recording_tell_each_rejected_cycle_once(
    aligned: tuple[camtorque.Recording, camtorque.CamCycles],
) -> None:
    recording, cycles = aligned
    lossy = replace(cycles, cut_flow=(CutFlowRow("misfire", 3, "", 3),))
    memory = Memory()
    blocks = [look(f"block {k}", recording, lossy, slice(None), 3, memory, 0.1) for k in (1, 2)]
    assert [block.reasons for block in blocks] == [("3 misfire",), ()]


def test_two_recordings_of_one_id_tell_each_its_own_rejected_cycles(
    aligned: tuple[camtorque.Recording, camtorque.CamCycles],
) -> None:
    """Of repeats whose recording.toml was copied the second said neither why cycles were lost nor that they clip."""
    recording, cycles = aligned
    clipped = replace(cycles, cut_flow=(CutFlowRow("pressure_clipped", 3, "", 3),))
    memory = Memory()
    for name in ("a", "b"):
        one = replace(recording, config=replace(recording.config, path=Path(name) / "recording.toml"))
        block = look(name, one, clipped, slice(None), 3, memory, 0.1)
        assert (block.reasons, block.clipped) == (("3 pressure_clipped",), 3)


def test_a_growing_log_tells_each_rejected_cycle_once() -> None:
    memory, a, b = Memory(), Path("a"), Path("b")
    first = (CutFlowRow("pressure_clipped", 3, "", 3), CutFlowRow("missed_trigger", 0, ""))
    assert memory.newly_rejected(a, first) == {"pressure_clipped": 3}
    assert memory.newly_rejected(a, first) == {}
    assert memory.newly_rejected(a, (replace(first[0], cycles_single=5), *first[1:])) == {"pressure_clipped": 2}
    assert memory.newly_rejected(b, first) == {"pressure_clipped": 3}


def test_a_watch_ends_when_its_seconds_are_over(replay: Replay, bench: Path) -> None:
    list(watch(bench, WatchOptions(every=600.0, seconds=2.0), replay.sleep, replay.clock))
    assert replay.now == pytest.approx(2.0)


def test_a_recording_whose_log_lies_elsewhere_is_finished_when_that_does_not_grow(bench: Path) -> None:
    text = (bench / "recording.toml").read_text(encoding="utf-8")
    (bench / "recording.toml").write_text(text.replace(LOG, f"../data/{LOG}"), encoding="utf-8")
    log, whole = bench.parent / "data" / LOG, (EXAMPLE / LOG).read_bytes()
    log.parent.mkdir()
    log.write_bytes(whole[: len(whole) // 4])
    now, parts = iter(range(100)), iter([2, *(50 * [1])])

    def sleep(_: float) -> None:
        log.write_bytes(whole[: len(whole) // next(parts)])

    looks = watch(bench.parent, WatchOptions(seconds=20.0), sleep, lambda: float(next(now)))
    (block,) = (item for item in looks if isinstance(item, Block))
    assert block.cycles > 40


def test_a_recording_that_is_moved_away_meanwhile_is_left(tmp_path: Path) -> None:
    (tmp_path / "A").mkdir()
    (tmp_path / "A" / "recording.toml").symlink_to(tmp_path / "gone.toml")
    (only,) = watch(tmp_path, WatchOptions(seconds=0.0), lambda _: None)
    assert isinstance(only, Waiting)
    assert only.reason.startswith("no finished recording below")


def test_a_cycle_is_in_one_block_though_earlier_ones_are_cut_later(
    bench: Path, aligned: tuple[camtorque.Recording, camtorque.CamCycles], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, cycles = aligned
    assert cycles.torque is not None

    def kept(numbers: list[int]) -> camtorque.CamCycles:
        places = np.array(numbers)
        return replace(
            cycles, index=places, torque=cycles.torque[places], pressure=cycles.pressure[places],  # type: ignore[index]
            speed=cycles.speed[places], held_out=cycles.held_out[places], cycles_found=numbers[-1] + 1, channels={},
        )  # fmt: skip

    last = kept([*range(30)])
    looks = chain([kept([*range(10)]), kept([2, 3, *range(5, 20)])], repeat(last))
    monkeypatch.setattr("camtorque.watch.read_so_far", lambda _: (recording, next(looks)))
    replayed = Replay(bench, b"", [b"1;2;3\n"] * int(10 * RATE))
    seen = watch(bench, WatchOptions(every=0.1, block_cycles=10, seconds=0.3), replayed.sleep, replayed.clock)
    blocks = [item for item in seen if isinstance(item, Block)]
    assert [block.cycles for block in blocks] == [10, 10, 10]
