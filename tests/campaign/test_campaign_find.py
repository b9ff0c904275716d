"""Recordings are found through links, loops are refused, a recording counts once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from campaign_cases import make
from camtorque import cli, compare, watch
from camtorque.campaign.find import search
from camtorque.process.folders import files_below
from camtorque.records import Refusal
from camtorque.results import find_results


def test_links_are_followed(tmp_path: Path) -> None:
    make(tmp_path / "elsewhere" / "deep", b="")
    make(tmp_path / "raw", a="")
    (tmp_path / "raw" / "link").symlink_to(tmp_path / "elsewhere")
    assert list(search(tmp_path / "raw")[0]) == ["a", "link/deep/b"]


def test_a_loop_is_refused(tmp_path: Path) -> None:
    make(tmp_path, a="")
    (tmp_path / "a" / "up").symlink_to(tmp_path)
    with pytest.raises(Refusal, match="up: found a link that leads back"):
        search(tmp_path)


def test_a_recording_counts_once_and_the_other_name_is_told(tmp_path: Path) -> None:
    make(tmp_path, run_017="")
    (tmp_path / "zz_latest").symlink_to(tmp_path / "run_017")
    found, (finding,) = search(tmp_path)
    assert list(found) == ["run_017"]
    assert finding.text.startswith("zz_latest is the recording run_017")


def test_no_recording_hides_another_of_the_same_name(tmp_path: Path) -> None:
    make(tmp_path, raw="", **{"raw/raw": ""})
    with pytest.raises(Refusal, match=r"raw/raw: found another recording called raw, .*raw; rename one"):
        search(tmp_path / "raw")


def test_half_written_hidden_folders_are_passed_over(tmp_path: Path) -> None:
    make(tmp_path, **{"a": "", ".a.partial": ""})
    assert list(search(tmp_path)[0]) == ["a"]


def test_a_link_to_itself_is_no_folder(tmp_path: Path) -> None:
    make(tmp_path, a="")
    (tmp_path / "self").symlink_to(tmp_path / "self")
    assert list(search(tmp_path)[0]) == ["a"]


@pytest.fixture
def closed_private(monkeypatch) -> None:
    """No folder called private may be read: for root, as whom tests may run, rights close nothing."""
    scandir = os.scandir

    def closed(folder: Path):
        if Path(folder).name == "private":
            raise PermissionError(13, "Permission denied", str(folder))
        return scandir(folder)

    monkeypatch.setattr(os, "scandir", closed)


def test_a_report_that_may_not_be_read_is_not_passed_over(tmp_path: Path, closed_private: None) -> None:
    """A gate passed, and a trend was drawn, without the report that could not be looked at."""
    for name in ("a", "private"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").touch()
    with pytest.raises(Refusal, match=r"private: may not be read: each result.json in it is missed"):
        find_results(tmp_path)
    (tmp_path / "private").rename(tmp_path / "b")
    (tmp_path / "b link").symlink_to(tmp_path / "share")
    with pytest.raises(Refusal, match=r"b link: is a link that leads nowhere"):
        find_results(tmp_path)


def test_a_folder_that_may_not_be_read_is_told_and_the_others_are_found(
    tmp_path: Path, closed_private: None, capsys
) -> None:
    for name in ("a", "private"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "recording.toml").touch()
    names, (told,) = search(tmp_path)
    assert list(names) == ["a"]
    assert (told.code, told.severity, told.where) == ("folder_unreadable", "warning", str(tmp_path / "private"))
    assert cli.main(["campaign", str(tmp_path), "--out", str(tmp_path / "out"), "--list"]) == 0
    printed = capsys.readouterr()
    assert printed.out.count("\n") == 1, "scripts take every line for a recording"
    assert "private: may not be read" in printed.err
    (first, *_) = watch.watch(tmp_path, watch.WatchOptions(seconds=0.0))
    assert (first.name, first.reason[:15]) == ("private", "may not be read")
    (tmp_path / "a" / "recording.toml").unlink()
    with pytest.raises(Refusal, match=r"found no recording.toml .*private may not be read: .*; correct its rights"):
        search(tmp_path)
    with pytest.raises(PermissionError):
        search(tmp_path / "private")


def test_a_link_that_leads_nowhere_is_told(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "recording.toml").touch()
    (tmp_path / "b").symlink_to(tmp_path / "share" / "b")
    names, (told,) = search(tmp_path)
    assert list(names) == ["a"]
    assert (told.severity, told.where) == ("warning", str(tmp_path / "b"))
    assert "is a link that leads nowhere: each recording.toml behind it is missed" in told.text


def test_what_links_lead_to_is_found_by_every_command_once(tmp_path: Path) -> None:
    """A comparison of two folders of links had left out every pair behind one, without a word."""
    for folder, name in (("raw", "recording.toml"), ("reports", "result.json")):
        for run in ("a", "b", "c"):
            (tmp_path / "disk" / folder / run).mkdir(parents=True)
            (tmp_path / "disk" / folder / run / name).touch()
        (tmp_path / folder / "a").mkdir(parents=True)
        (tmp_path / folder / "a" / name).touch()
        for link, run in (("b", "b"), ("c", "c"), ("c again", "c")):
            (tmp_path / folder / link).symlink_to(tmp_path / "disk" / folder / run)
    found = [tmp_path / "raw" / run for run in "abc"]
    assert compare._recordings(tmp_path / "raw") == found
    assert sorted(place for place, _ in watch._by_age(tmp_path / "raw", [])) == found
    assert find_results(tmp_path / "reports") == [tmp_path / "reports" / run / "result.json" for run in "abc"]


def test_a_folder_that_a_link_stands_before_keeps_its_place_in_the_order(tmp_path: Path) -> None:
    make(tmp_path, b="", c="")
    (tmp_path / "a").symlink_to(tmp_path / "c")
    assert files_below(tmp_path, "recording.toml") == [tmp_path / run / "recording.toml" for run in "ab"]
