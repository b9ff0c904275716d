"""Output folders under faults: one line each, an older result is kept, nothing is left behind."""

from __future__ import annotations

import errno
import json
import os
import resource
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import h5py
import numpy as np
import pytest
from camtorque.commands.run import default_out, refuse_report_of_another
from camtorque.records import Refusal
from camtorque.report.folder import check_output, output_files, output_folder

EXAMPLES = Path(__file__).resolve().parents[2] / "raw_examples"
OLD = '{"schema": "camtorque.result/1"}'


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """A folder with an older result."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "result.json").write_text(OLD)
    return tmp_path / "out"


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_links_in_a_circle_are_named(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(Refusal, match=r"found links in a circle at .*, expected folders; choose another name"):
        check_output(tmp_path / "a" / "out", "result.json")
    assert default_out(tmp_path / "a").name == "a"


def test_a_report_of_a_recording_of_the_same_name_elsewhere_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of ``before/run1`` and ``after/run1`` the second report took the place of the first without a word."""
    monkeypatch.chdir(tmp_path)
    for state in ("before", "after"):
        (tmp_path / state / "run1").mkdir(parents=True)
        (tmp_path / state / "run1" / "recording.toml").touch()
    out = tmp_path / "reports" / "run1"
    out.mkdir(parents=True)
    inputs = [{"path": "before/run1/recording.toml", "sha256": "0"}]
    (out / "result.json").write_text(json.dumps({"schema": "camtorque.result/1", "inputs": inputs}))
    refuse_report_of_another(out, Path("before/run1"))
    refuse_report_of_another(out, tmp_path / "before" / "run1" / "recording.toml")
    refuse_report_of_another(tmp_path / "elsewhere", Path("after/run1"))
    found = r"found the report of before/run1, expected none or one of after/run1; keep both with --out, such as --out "
    with pytest.raises(Refusal, match=found + ".*after_run1"):
        refuse_report_of_another(out, Path("after/run1"))
    (tmp_path / "before" / "run1" / "recording.toml").unlink()  # renamed since: nothing tells it from this one
    refuse_report_of_another(out, Path("after/run1"))


def test_two_runs_into_one_folder(target: Path) -> None:
    with output_folder(target, "result.json") as folder:
        (folder / "result.json").write_text(OLD)
        with pytest.raises(Refusal, match="another run is writing there"), output_folder(target, "result.json"):
            pass
        assert left(folder) == [".lock", "result.json"]
    assert left(target.parent) == ["out"]
    assert left(target) == ["SHA256SUMS", "result.json"]


def test_a_second_run_leaves_alone_what_the_first_has_set_aside_to_replace(
    target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rename, told = Path.rename, list[str]()

    def at_the_worst_moment(self: Path, place: Path) -> Path:
        if self.name == ".out.partial":  # the earlier result stands aside, the new one is not in its place yet
            with pytest.raises(Refusal, match="another run is writing there"), output_folder(target, "result.json"):
                pass
            told.extend(left(target.parent))
        return rename(self, place)

    monkeypatch.setattr(Path, "rename", at_the_worst_moment)
    with output_folder(target, "result.json") as folder:
        (folder / "result.json").write_text(OLD.replace("1", "2"))
    assert told == [".out.earlier", ".out.partial"]
    assert (target / "result.json").read_text() == OLD.replace("1", "2")
    assert left(target.parent) == ["out"]


def test_what_a_killed_run_left_is_cleared_away(target: Path) -> None:
    partial = target.with_name(".out.partial")
    (partial / "figures").mkdir(parents=True)
    (partial / "cycles.h5").touch()
    target.rename(target.with_name(".out.earlier"))
    with output_folder(target, "result.json") as folder:
        assert left(folder) == [".lock"]
        assert left(target) == ["result.json"], "killed between two renames: the older result is put back"
    assert left(target.parent) == ["out"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_keeps_the_older_result(target: Path, code: int) -> None:
    with pytest.raises(Refusal, match=r"cannot be written .* and run again"), output_folder(target, "result.json"):
        raise OSError(code, os.strerror(code))
    assert left(target.parent) == ["out"]
    assert (target / "result.json").read_text() == OLD


def test_a_full_disk_is_told_though_hdf5_has_no_number_for_it(target: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
        with pytest.raises(Refusal, match=r"output .*out: cannot be written \(File too large"):  # noqa: SIM117
            with output_folder(target, "result.json") as folder, h5py.File(folder / "a.h5", "w") as file:
                file["a"] = np.zeros(100_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert left(target.parent) == ["out"]


def test_too_little_space_is_told_before_anything_is_read(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda place: usage(1, 1, 3_000_000))
    command = pytest.raises(Refusal, match=r"found 3.0 MB of free space, expected at least 20 MB")
    with command, output_folder(target, "result.json"):
        raise AssertionError("nothing may be computed")
    monkeypatch.setattr(shutil, "disk_usage", lambda place: usage(0, 0, 0))  # such as /proc
    command = pytest.raises(Refusal, match=r"is no place on a disk; choose another place")
    with command, output_folder(target, "result.json"):
        raise AssertionError("nothing may be computed")


def test_a_read_only_place_is_told_before_anything_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(Refusal, match=r"Read-only file system.*choose a place that can be written"):  # noqa: SIM117
        with output_folder(tmp_path / "out", "result.json"):
            raise AssertionError("nothing may be computed")


def test_a_file_in_the_way_of_the_parents(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(Refusal, match="on the way"), output_folder(tmp_path / "file" / "below" / "out", "result.json"):
        pass


def test_an_output_that_went_away(target: Path) -> None:
    with pytest.raises(Refusal, match="went away"), output_folder(target, "result.json") as folder:  # noqa: PT012
        shutil.rmtree(folder)
        (folder / "result.json").write_text(OLD)
    assert left(target) == ["result.json"]


def test_an_error_of_another_file_is_not_blamed_on_the_output(target: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"log\.csv"), output_folder(target, "result.json"):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), "/data/log.csv")


def test_parents_made_for_a_failing_run_are_removed(tmp_path: Path) -> None:
    with pytest.raises(Refusal, match="no"), output_folder(tmp_path / "a" / "b" / "out", "result.json"):
        raise Refusal("no")
    assert left(tmp_path) == []


def test_a_replacement_that_fails_puts_the_older_result_back(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rename = Path.rename

    def interrupted(self: Path, other: Path) -> Path:
        if self.name == ".out.partial":
            raise KeyboardInterrupt
        return rename(self, other)

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt), output_folder(target, "result.json"):
        pass
    assert left(target.parent) == ["out"]
    assert (target / "result.json").read_text() == OLD


def test_a_name_at_the_limit_of_the_disk(tmp_path: Path) -> None:
    with output_folder(tmp_path / ("é" * 127), "result.json") as folder:
        (folder / "x").touch()
    assert left(tmp_path / ("é" * 127)) == ["SHA256SUMS", "x"]
    with (
        pytest.raises((Refusal, OSError), match=r"name too long"),
        output_folder(tmp_path / ("é" * 128), "result.json"),
    ):
        pass


def test_files_join_those_of_another_output(target: Path) -> None:
    with output_files(target) as folder:
        (folder / "chart.png").touch()
    assert left(target) == ["chart.png", "result.json"]
    with pytest.raises(Refusal, match="no"), output_files(target) as folder:  # noqa: PT012
        (folder / "half.png").touch()
        raise Refusal("no")
    assert left(target) == ["chart.png", "result.json"]
    assert left(target.parent) == ["out"]


def test_files_are_written_within_a_folder_that_is_there(target: Path) -> None:
    # its parent may be another disk or not one's own, as that of a mounted drive is
    with output_files(target) as folder:
        assert folder.parent == target.resolve()
    with output_files(target / "new") as folder:
        assert folder.parent == target.resolve()
    assert left(target) == ["result.json"]


def test_a_command_that_cannot_write_says_so_in_one_line(target: Path) -> None:
    (target / "result.json").rename(target / "align.json")
    code = (
        "import resource, sys\nresource.setrlimit(resource.RLIMIT_FSIZE, (200_000, resource.RLIM_INFINITY))\n"
        "from camtorque import cli\nsys.exit(cli.main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "align", EXAMPLES / "A_0300rpm", "--out", target, "--quiet"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert "cannot be written (File too large" in line
    assert left(target.parent) == ["out"]
    assert left(target) == ["align.json"]


def test_a_file_of_the_users_in_a_report_is_not_lost(tmp_path: Path) -> None:
    target = tmp_path / "out"
    for _ in range(2):
        with output_folder(target, "result.json") as folder:
            (folder / "result.json").write_text(OLD)
    (target / "mine").mkdir()
    (target / "mine" / "notes.md").write_text("seen on the bench")
    with pytest.raises(Refusal, match=r"found mine/notes.md beside an earlier report, which would be lost"):
        output_folder(target, "result.json").__enter__()
    assert (target / "mine" / "notes.md").read_text() == "seen on the bench"


def test_a_file_saved_there_while_the_report_is_made_is_not_lost(tmp_path: Path) -> None:
    target = tmp_path / "out"
    output = output_folder(target, "result.json")
    (output.__enter__() / "result.json").write_text(OLD)
    target.mkdir()
    (target / "notes.txt").write_text("seen on the bench")
    with pytest.raises(Refusal, match=r"output .*out: found a folder with other files in it, expected a new folder"):
        output.__exit__(None, None, None)
    assert (target / "notes.txt").read_text() == "seen on the bench"
    assert left(tmp_path) == ["out"]


def test_a_folder_reached_through_one_that_is_missing_is_not_lost(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "notes.txt").write_text("seen on the bench")
    with pytest.raises(Refusal, match=r"missing/\.\./mine: found a folder with other files in it"):
        output_folder(tmp_path / "missing" / ".." / "mine", "result.json").__enter__()
    assert (mine / "notes.txt").exists()
    with output_files(tmp_path / "missing" / ".." / "mine") as folder:
        (folder / "page.html").write_text("")
    assert left(tmp_path) == ["mine"]
    assert left(mine) == ["notes.txt", "page.html"]


def test_a_folder_that_cannot_be_replaced_as_a_whole_is_refused_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Refusal, match=r"the folder in which the command runs, .*; choose one inside it"):
        check_output(Path("."), "result.json")
    with pytest.raises(Refusal, match=r"output /: found the place of a disk, .* such as /report"):
        check_output(Path("/"), "result.json")


def test_the_report_of_another_command_is_no_place_for_this_one(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text('{"schema": "camtorque.plan/1"}', encoding="utf-8")
    check_output(tmp_path, "plan.json")
    with pytest.raises(Refusal, match=r"a report of another command \(plan.json\), expected .* result.json"):
        check_output(tmp_path, "result.json")
