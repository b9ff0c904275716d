"""Hooks of the site: decisions and measurements come into the menu, links that leave the docs become paths."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

LINK = re.compile(r"\[([^\]]+)\]\((\.\.?/[^)#\s]*)(#[^)]*)?\)")
TEMPLATE = "0000-template.md"


def on_config(config: Any) -> Any:
    """Return the configuration with every page that the menu does not name yet."""
    docs = Path(config.docs_dir)
    named = set(re.findall(r"[\w/]+\.(?:md|ipynb)", str(config.nav)))
    measured = sorted(path.name for path in docs.glob("*.md") if path.name not in named)
    decided = sorted(f"decisions/{path.name}" for path in (docs / "decisions").glob("*.md") if path.name != TEMPLATE)
    config.nav += [{"Measurements": measured}, {"Decisions": decided}]
    return config


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Return the page with links to files outside docs as plain paths: the site does not hold those."""
    folder = posixpath.dirname(page.file.src_uri)

    def told(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join("docs", folder, match[2]))
        return match[0] if target.startswith("docs/") else f"{match[1]} (`{target}`)"

    return LINK.sub(told, markdown)
