"""Figures, pages and files: everything that is written.

bundle        `RunResult`, `CampaignResult`: what is handed to this room
chart         what a drawing shows; svg, charts_svg draw it; payload is the same for the script of a page
figures       `FIGURES`: every figure of a run; curve_figures, fit_figures; plots: trends, studies
document      result.json, as a dictionary; cycles_file writes cycles.h5 and aligned.h5; files: JSON
answer, texts the words of a page; numbers: one typography
page          templates to pages with their content security policy; live.js: curves that one can zoom
folder        output written to a temporary sibling, then renamed; provenance: where it came from, SHA-256
write         `write_run`; alignment, campaign_page, compare_page, forecast_page, plan_page, predict_page: the others
"""
