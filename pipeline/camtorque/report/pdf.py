"""A page as PDF for those who need paper; WeasyPrint (extra `pdf`) prints the drawings that stand in the page."""

from __future__ import annotations

import logging
import os
from pathlib import Path

from camtorque.records import Refusal


def write_pdf(page: Path) -> Path:
    """Write a page of this room beside itself as PDF and return its path.

    Raises
    ------
    Refusal : WeasyPrint is not installed, or lacks a library of the system
    """
    try:
        from weasyprint import HTML
    except (ImportError, OSError) as error:
        raise Refusal(
            f"--pdf: WeasyPrint cannot be used ({error}), expected the extra 'pdf'; pip install 'camtorque[pdf]'"
        ) from error
    logging.getLogger("weasyprint").setLevel(logging.ERROR)  # it warns of every rule for screens
    partial = page.with_name(f".{page.stem}.pdf.partial")
    HTML(string=page.read_text(encoding="utf-8"), base_url=None).write_pdf(partial)
    target = page.with_suffix(".pdf")
    os.replace(partial, target)
    return target
