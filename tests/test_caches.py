"""Caches of numba and matplotlib find a place where neither home nor package can be written, and only a private one."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import camtorque
import pytest
from camtorque import compiled
from camtorque.process import caches

PACKAGE = Path(camtorque.__file__).parent
LAMINAR = "LAMINAR = 2.0"


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


def test_every_room_with_compiled_functions_or_their_constants_counts() -> None:
    rooms = set()
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if re.search(r"^@(njit|elementwise)\b", text, flags=re.M):
            rooms.add(path.parent)
            taken = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom) and node.module]
            frozen = [node.module for node in taken if any(alias.name.isupper() for alias in node.names)]
            rooms |= {
                (PACKAGE.parent / name.replace(".", "/")).with_suffix(".py").parent
                for name in frozen
                if name.startswith("camtorque") and not (PACKAGE.parent / name.replace(".", "/")).is_dir()
            }
    names = {room.relative_to(PACKAGE).as_posix() for room in rooms}
    assert {".", "laws"} <= names  # units
    assert names <= set(caches.COMPILED_IN)


def test_what_was_compiled_from_other_sources_is_deleted(tmp_path: Path) -> None:
    kept = [tmp_path / "chamber.integrate.nbi", tmp_path / "chamber.integrate.1.nbc"]
    for path in (*kept, tmp_path / "chamber.pyc"):
        path.touch()
    (tmp_path / caches.SOURCES).write_text("of the version before")
    assert caches.made_from(PACKAGE, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [caches.SOURCES, "chamber.pyc"]
    for path in kept:
        path.touch()
    caches.made_from.cache_clear()
    assert caches.made_from(PACKAGE, tmp_path)
    assert all(path.exists() for path in kept)


def test_what_can_be_neither_trusted_nor_replaced_is_not_used(tmp_path: Path) -> None:
    assert not caches.made_from(PACKAGE, tmp_path / "a folder that is not there")


def test_where_nothing_can_be_kept_nothing_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def doubled(number: float) -> float:
        return 2.0 * number

    monkeypatch.setattr(compiled, "made_from", lambda *_: False)
    function = compiled.njit(doubled, cache=True)
    assert function(2.0) == 4.0
    assert not function.is_kept


def test_a_law_that_changed_is_used_by_functions_that_were_compiled_before(tmp_path: Path) -> None:
    package = tmp_path / "camtorque"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)

    ask = "from camtorque.laws.valve import seat_drop; print(seat_drop.is_kept, seat_drop(2.0, 1.0), seat_drop.is_kept)"

    def drop() -> list[str]:
        asked = [sys.executable, "-c", ask]
        return subprocess.run(asked, env=environment, check=True, capture_output=True, text=True).stdout.split()

    before = drop()
    assert list(package.rglob("*.nbi"))
    assert before[::2] == ["False", "True"]
    assert drop() == ["True", before[1], "True"]
    changed = package / "laws" / "ports.py"
    law = changed.read_text(encoding="utf-8")
    assert LAMINAR in law
    changed.write_text(law.replace(LAMINAR, "LAMINAR = 8.0"), encoding="utf-8")
    changed_drop = drop()
    assert changed_drop[::2] == ["False", "True"]
    assert changed_drop[1] != before[1]
