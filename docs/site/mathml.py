"""Equations as MathML, made when the site is built: the page needs no script and nothing from the web."""

from __future__ import annotations

from typing import Any

from latex2mathml.converter import convert


def fence(source: str, language: str, css_class: str, options: Any, md: Any, **kwargs: Any) -> str:
    """Return a fenced block of LaTeX as MathML, one formula a line."""
    lines = [line for line in source.strip().splitlines() if line.strip()]
    return "".join(f'<p class="{css_class}">{convert(line, display="block")}</p>' for line in lines)
