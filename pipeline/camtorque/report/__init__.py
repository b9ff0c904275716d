"""Figures, pages and files: everything that is written.

bundle        `RunResult`, `CampaignResult`: what is handed to this room
chart         what a drawing shows; svg, curves_svg, rows_svg draw it; payload is the same for the script of a page
figures       `FIGURES`: every figure of a run; torque_figures, part_figures, fit_figures say what each shows
document      result.json, as a dictionary; cycles_file writes cycles.h5 and aligned.h5
answer, texts the words of a page; numbers: one typography
page          templates to pages with their content security policy; live.js: curves that one can zoom
folder        output written to a temporary sibling, then renamed
write         `write_run`, `write_alignment`, `write_prediction`; campaign_write, compare_page: the other two
"""

from camtorque.report.bundle import CampaignEntry, CampaignResult, RunResult
from camtorque.report.campaign_write import write_campaign
from camtorque.report.compare_page import ComparedCurves, ComparePage, write_compare
from camtorque.report.figures import FIGURES
from camtorque.report.folder import check_output, check_writable, output_files, output_folder
from camtorque.report.overview_figures import thumbnail
from camtorque.report.pdf import write_pdf
from camtorque.report.write import write_alignment, write_prediction, write_run

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
