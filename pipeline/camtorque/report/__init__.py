"""Figures, pages and files: everything that is written.

bundle        `RunResult`, `CampaignResult`: what is handed to this room
chart         what a drawing shows; svg, charts_svg draw it; payload is the same for the script of a page
curve_figures, fit_figures: what a run shows; plots: trends, studies
document      result.json, as a dictionary; cycles_file writes cycles.h5 and aligned.h5; files: JSON, SHA-256
answer, texts the words of a page; numbers: one typography
page          templates and figures to pages with their content security policy; live.js: curves that one can zoom
folder        output written to a temporary sibling, then renamed
write         `write_run` and `FIGURES`, all that it draws; alignment and *_page write the others
"""
