"""The documents: commands that they show exist, the picture is that of the code, the menu leads somewhere."""

from __future__ import annotations

import json
import re
import runpy
import shlex
from pathlib import Path

import pytest
from camtorque.cli import build_parser
from camtorque.design import read_task

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "pipeline" / "camtorque"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"```sh\n(.*?)```", re.DOTALL)
COMMAND = re.compile(r"(?:^|&& )(?:\S*/)?camtorque (.+?)(?: *#.*| [>|] .*)?$")


def shown_commands() -> list[tuple[str, str]]:
    found = []
    for page in PAGES:
        for block in FENCE.findall(page.read_text(encoding="utf-8")):
            found += [(page.name, match[1]) for line in block.splitlines() if (match := COMMAND.search(line))]
    return found


def test_commands_are_found_in_the_documents() -> None:
    assert {"run", "limits", "export", "watch", "check", "align", "campaign"} <= {
        line.split()[0] for _, line in shown_commands()
    }


@pytest.mark.parametrize(("page", "line"), shown_commands())
def test_every_command_that_a_document_shows_is_understood(page: str, line: str) -> None:
    build_parser().parse_args(shlex.split(line))


def test_the_picture_of_the_rooms_is_that_of_the_code() -> None:
    drawn = runpy.run_path(str(ROOT / "docs" / "examples" / "architecture.py"))["drawing"]()
    kept = (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
    assert drawn == kept, "python docs/examples/architecture.py"


def test_the_page_of_cam_profiles_is_that_of_the_code() -> None:
    """Its tables that no search decides; of the searched ones rounding picks the digits."""
    made = runpy.run_path(str(ROOT / "docs" / "examples" / "cam_profiles.py"))
    tables = made["unsearched"](read_task(ROOT / "calibration" / "paper_design.toml"))
    page = (ROOT / "docs" / "cam_profiles.md").read_text(encoding="utf-8")
    frame = re.split(r"\{[^{}]*\}", made["PAGE"])
    assert not [text for text in (*tables.values(), *frame) if text not in page], "python docs/examples/cam_profiles.py"


def test_the_menu_names_pages_that_exist() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = re.findall(r"[\w/]+\.(?:md|ipynb)\b", text)
    assert len(pages) > 15
    assert not [name for name in pages if not (ROOT / "docs" / name).is_file()]


def test_places_that_the_architecture_names_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text[text.index("| change |") :]
    named = set(re.findall(r"`((?:\w+/)+[\w.]*|\w+\.py)`", table))
    assert len(named) > 12
    assert not [name for name in named if not any((root / name).exists() for root in (PACKAGE, ROOT))]
    registries = re.findall(r"`([A-Z]+)` of `([\w/]+\.py)`", table)
    assert len(registries) >= 4
    for name, place in registries:
        assert re.search(rf"^{name}\b", (PACKAGE / place).read_text(encoding="utf-8"), re.MULTILINE), (name, place)


def test_the_map_of_the_readme_names_what_is_there_and_no_room_is_missing() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text[text.index("## Where things are") : text.index("Rooms depend on each other")]
    named = set(re.findall(r"`((?:\w+/)+(?:[\w.]+)?|[\w.]+\.(?:py|yml))`", table))
    assert len(named) > 20
    assert not [name for name in named if not any((root / name).exists() for root in (PACKAGE, ROOT))]
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert not [room for room in rooms - {"process"} if f"{room}/`" not in table]


def test_the_tutorial_is_kept_without_outputs() -> None:
    book = json.loads((ROOT / "docs" / "tutorial.ipynb").read_text(encoding="utf-8"))
    assert not [cell for cell in book["cells"] if cell.get("outputs")]


def test_a_docstring_keeps_its_meanings_on_the_site() -> None:
    pytest.importorskip("griffe")
    change = runpy.run_path(str(ROOT / "docs" / "site" / "docstrings.py"))["with_meanings"]
    head, notes = "Do.\n\nParameters\n----------\n", "\n\nNotes\n-----\nx : y\n\nRaises\n------\n"
    given = f"{head}a, b : both\n    go on\nc : one{notes}E : why"
    assert change(given) == f"{head}a, b\n    both\n    go on\nc\n    one{notes}E\n    why"
