"""Figures, pages and files: everything that is written.

bundle        `RunResult`, `CampaignResult`: what is handed to this room
chart         what a drawing shows; svg, curves_svg, rows_svg draw it; payload is the same for the script of a page
figures       `FIGURES`: every figure of a run; torque_figures, part_figures, fit_figures say what each shows
document      result.json, as a dictionary; cycles_file writes cycles.h5 and aligned.h5; files: JSON
answer, texts the words of a page; numbers: one typography
page          templates to pages with their content security policy; live.js: curves that one can zoom
folder        output written to a temporary sibling, then renamed
write         `write_run`; alignment, predict_page, campaign_write, compare_page: the other four

Each name is loaded when it is first used: writing aligned cycles does not load the fit.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from camtorque.report.alignment import write_alignment
    from camtorque.report.bundle import CampaignEntry, CampaignResult, RunResult
    from camtorque.report.campaign_write import write_campaign
    from camtorque.report.compare_page import ComparedCurves, ComparePage, write_compare
    from camtorque.report.figures import FIGURES
    from camtorque.report.folder import check_output, check_writable, output_files, output_folder
    from camtorque.report.overview_figures import thumbnail
    from camtorque.report.pdf import write_pdf
    from camtorque.report.predict_page import write_prediction
    from camtorque.report.write import write_run

HOMES = {
    "CampaignEntry": "bundle",
    "CampaignResult": "bundle",
    "ComparePage": "compare_page",
    "ComparedCurves": "compare_page",
    "FIGURES": "figures",
    "RunResult": "bundle",
    "check_output": "folder",
    "check_writable": "folder",
    "output_files": "folder",
    "output_folder": "folder",
    "thumbnail": "overview_figures",
    "write_alignment": "alignment",
    "write_campaign": "campaign_write",
    "write_compare": "compare_page",
    "write_pdf": "pdf",
    "write_prediction": "predict_page",
    "write_run": "write",
}
"""Name -> module that holds it."""

__all__ = [
    "FIGURES",
    "CampaignEntry",
    "CampaignResult",
    "ComparePage",
    "ComparedCurves",
    "RunResult",
    "check_output",
    "check_writable",
    "output_files",
    "output_folder",
    "thumbnail",
    "write_alignment",
    "write_campaign",
    "write_compare",
    "write_pdf",
    "write_prediction",
    "write_run",
]


def __getattr__(name: str) -> Any:
    """Load a name when it is first asked for."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{HOMES[name]}"), name)
