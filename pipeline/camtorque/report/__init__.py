"""Figures, pages and files: everything that is written, and the only room with matplotlib.

bundle        `RunResult`: what one run hands to this room
document      result.json, as a dictionary
cycles_file   cycles.h5 and aligned.h5
figures       `FIGURES`: every figure of a run; style, torque_figures, part_figures, fit_figures draw them
page          report.html, campaign.html, align.html from the templates beside
folder        output written to a temporary sibling, then renamed
write         `write_run`, `write_alignment`, `write_campaign`
"""

from camtorque.report.bundle import CampaignEntry, CampaignResult, RunResult
from camtorque.report.figures import FIGURES
from camtorque.report.folder import check_output, check_writable, output_files, output_folder
from camtorque.report.overview_figures import thumbnail
from camtorque.report.write import write_alignment, write_campaign, write_prediction, write_run

__all__ = [
    "FIGURES",
    "CampaignEntry",
    "CampaignResult",
    "RunResult",
    "check_output",
    "check_writable",
    "output_files",
    "output_folder",
    "thumbnail",
    "write_alignment",
    "write_campaign",
    "write_prediction",
    "write_run",
]
