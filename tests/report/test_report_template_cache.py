"""Compiled templates are kept where Python keeps modules, and are never in the way."""

import sys
from pathlib import Path

import pytest
from camtorque.report.page import template_cache
from jinja2 import DictLoader, Environment


def shown(folder: Path, source: str) -> str:
    environment = Environment(
        loader=DictLoader({"page": source}), autoescape=True, bytecode_cache=template_cache(folder)
    )
    return environment.get_template("page").render(value="<torque>")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (tmp_path / "__pycache__").mkdir()
    return tmp_path


def test_a_kept_template_is_not_compiled_again(folder: Path, monkeypatch: pytest.MonkeyPatch):
    first = shown(folder, "a {{ value }}")
    monkeypatch.setattr(Environment, "_compile", None)
    assert shown(folder, "a {{ value }}") == first == "a &lt;torque&gt;"


def test_a_changed_template_is_compiled_again(folder: Path):
    assert [shown(folder, text) for text in ("a {{ value }}", "b")] == ["a &lt;torque&gt;", "b"]


@pytest.mark.parametrize("kept", [0, 20, 60])
def test_a_damaged_file_is_passed_over(folder: Path, kept: int):
    shown(folder, "a {{ value }}")
    (file,) = (folder / "__pycache__").iterdir()
    file.write_bytes(file.read_bytes()[:kept])
    assert shown(folder, "a {{ value }}") == "a &lt;torque&gt;"


def test_a_full_disk_is_no_error(folder: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object, **__: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("tempfile.NamedTemporaryFile", full)
    assert shown(folder, "a {{ value }}") == "a &lt;torque&gt;"
    assert not list((folder / "__pycache__").iterdir())


def test_nothing_is_kept_where_python_keeps_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch):
    assert template_cache(folder / "elsewhere") is None
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert template_cache(folder) is None
