"""How the site reads docstrings: ``name : meaning`` in one line is a name with its meaning, not with a type."""

from __future__ import annotations

import re
from typing import Any

import griffe

SECTIONS = ("Parameters", "Attributes", "Returns", "Raises")
HEAD = re.compile(rf"^(?:{'|'.join(SECTIONS)})\n-+\n", re.MULTILINE)
LINE = re.compile(r"^(\w[\w, ]*) : (.+)$", re.MULTILINE)


def with_meanings(text: str) -> str:
    """Return a docstring whose one-line entries have their meaning in a line of its own."""
    parts = []
    end = 0
    for head in HEAD.finditer(text):
        stop = text.find("\n\n", head.end())
        stop = len(text) if stop < 0 else stop
        parts += [text[end : head.end()], LINE.sub(r"\1\n    \2", text[head.end() : stop])]
        end = stop
    return "".join([*parts, text[end:]])


class Meanings(griffe.Extension):
    """Changes every docstring before it is parsed."""

    def on_object(self, *, obj: Any, **kwargs: Any) -> None:
        """Rewrite one docstring."""
        if obj.docstring is not None:
            obj.docstring.value = with_meanings(obj.docstring.value)
