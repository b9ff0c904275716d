"""`camtorque campaign`: every recording below a folder, then one joint fit."""

from __future__ import annotations

import argparse

from camtorque.campaign import run_campaign
from camtorque.commands.options import run_options
from camtorque.commands.outcome import Outcome, Tell
from camtorque.commands.texts import campaign_table

SOME_REFUSED, ALL_REFUSED = 1, 2


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the reports of all recordings and the joint fit."""
    doc = run_campaign(arguments.folder, arguments.out, run_options(arguments, tell), arguments.workers, tell)
    page, refused = arguments.out / "campaign.html", doc["n_refused"]
    status = 0 if refused == 0 else ALL_REFUSED if refused == len(doc["recordings"]) else SOME_REFUSED
    return Outcome(f"{campaign_table(doc)}\n\n{page}", {**doc, "report": str(page)}, status)
