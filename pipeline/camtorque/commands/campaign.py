"""`camtorque campaign`: every recording below a folder, then one joint fit."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from camtorque.campaign import CampaignOptions, list_recordings, prune, run_campaign, run_only
from camtorque.campaign.find import search
from camtorque.commands import FAULTS, REFUSED, Outcome, Tell
from camtorque.commands.run import run_options
from camtorque.commands.texts import campaign_table


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the reports of all recordings and the joint fit, or of one of them, or list them."""
    if arguments.list:
        return _list(arguments, tell)
    if arguments.prune:
        found = prune(arguments.folder, arguments.out, run_options(arguments, tell))
        text = f"{found['removed']} older results removed, {found['bytes'] / 1e6:.0f} MB; {found['kept']} kept"
        return Outcome(text, {"schema": "camtorque.prune/1", **found})
    if arguments.only is not None:  # an empty name is that of a variable that nothing set
        return _only(arguments, tell)
    how = CampaignOptions(
        arguments.workers, scheduler=arguments.scheduler, cluster=arguments.cluster, retry_failed=arguments.retry_failed
    )
    doc = run_campaign(arguments.folder, arguments.out, run_options(arguments, tell), how, tell)
    page, refused = arguments.out / "campaign.html", doc["n_refused"]
    status = 0 if refused == 0 else REFUSED if refused == len(doc["recordings"]) else FAULTS
    return Outcome(f"{campaign_table(doc)}\n\n{page}", {**doc, "report": str(page)}, status)


def _list(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    _, findings = search(arguments.folder)
    rows = list_recordings(arguments.folder, arguments.out, run_options(arguments, tell))
    text = "\n".join(f"{row['name']}\t{row['status']}\t{row['key']}" for row in rows)
    told = [asdict(finding) for finding in findings]
    # scripts take every line of the list for a recording
    notes = tuple(f"{finding.where}: {finding.text}" for finding in findings if finding.severity != "info")
    return Outcome(text, {"schema": "camtorque.list/1", "recordings": rows, "findings": told}, notes=notes)


def _only(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    options = run_options(arguments, tell)
    entry = run_only(arguments.only, arguments.folder, arguments.out, options, arguments.retry_failed)
    found = {"name": entry.name, "status": entry.status, "error": entry.error or None, "folder": entry.folder or None}
    document = {"schema": "camtorque.only/1", **found}
    if entry.status != "ok":
        return Outcome(f"{entry.name}  refused: {entry.error}", document, REFUSED)
    return Outcome(str(arguments.out / entry.folder / "report.html"), document)
