"""Caches of numba and matplotlib find a place where neither home nor package can be written, and only a private one."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest
from camtorque.process import caches


@pytest.fixture
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home that is a file; temporary folders are made below the path that is returned."""
    (tmp_path / "home").touch()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for name in (*caches.PLACES, "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def placed() -> dict[str, str]:
    """Return what was set, and take it back."""
    return {name: os.environ.pop(name) for name in caches.PLACES if name in os.environ}


def test_a_writable_home_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    before = {name: os.environ.get(name) for name in caches.PLACES}
    caches.find_caches(tmp_path / "package")
    assert {name: os.environ.get(name) for name in caches.PLACES} == before


def test_a_private_folder_where_nothing_can_be_written(nowhere: Path) -> None:
    caches.find_caches(nowhere / "package that is not there")
    found = placed()
    assert set(found) == set(caches.PLACES)
    for place in found.values():
        assert Path(place).is_dir()
        assert Path(place).parent.stat().st_mode & 0o077 == 0


def test_functions_are_kept_beside_the_source_where_that_can_be(nowhere: Path) -> None:
    caches.find_caches(nowhere)
    assert set(placed()) == {"MPLCONFIGDIR"}


def test_what_the_user_chose_stays(nowhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/mine")
    caches.find_caches(nowhere / "package that is not there")
    assert os.environ["NUMBA_CACHE_DIR"] == "/mine"
    os.environ.pop("MPLCONFIGDIR")


@pytest.mark.parametrize("planted", ["link", "open folder"])
def test_a_folder_that_somebody_else_could_fill_is_not_used(nowhere: Path, planted: str) -> None:
    expected = nowhere / f"camtorque-caches-{os.getuid()}"
    if planted == "link":
        (nowhere / "elsewhere").mkdir()
        expected.symlink_to(nowhere / "elsewhere")
    else:
        expected.mkdir()
        expected.chmod(0o777)
    caches.find_caches(nowhere / "package that is not there")
    assert all(expected not in Path(place).parents for place in placed().values())
