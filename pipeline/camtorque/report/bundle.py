"""The input of the report: the results of a run and of a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from camtorque.limits import Limit
from camtorque.records import CamCycles, Finding, FittedTorque, Recording, RigidTorque

if TYPE_CHECKING:  # only named here: drawing a page does not load the fit
    from camtorque.fit.joint import CampaignFit

SUSPICIONS = frozenset({"torque_against_model", "uneven_running", "pressure_misplaced"})
"""Warnings before the fit that friction and ringing of a sound pump raise too; a fit as expected tells them apart."""
OF_ODD_FITS = frozenset({"prior_pulled", "values_implausible", "cam_side_too_light"})
"""Findings of a fit that is not as expected."""
THUMBNAIL = "thumbnail.svg"
"""Measured and modelled torque, beside the report of a recording of a campaign: hundreds fill a page."""
OF_RECORDING = ("speed_rpm", "cycles_found", "cycles_used")
OF_RESULT = ("explained", "metrics", "effects", "losses", "chamber", "forces")
"""What a campaign repeats of a result.json: of its part ``recording``, and whole parts."""


@dataclass(frozen=True)
class RunResult:
    """Everything that one run found.

    Attributes
    ----------
    timing : seconds by stage; ``report`` and ``total`` are added when the files are written
    created : ISO-8601 with zone
    limits : what a user wants the numbers to stay within
    peak_memory_mb : largest resident size of the process so far, nan where the system does not tell
    """

    recording: Recording
    cycles: CamCycles
    rigid: RigidTorque
    fitted: FittedTorque
    timing: Mapping[str, float]
    created: str
    peak_memory_mb: float = float("nan")
    limits: tuple[Limit, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of all rooms in the order of the flow, each once; what the fit has settled is a note."""
        found = (*self.recording.findings, *self.cycles.findings)
        return tuple(dict.fromkeys((*_settled(found, self.fitted), *self.fitted.findings)))


def _settled(found: tuple[Finding, ...], fitted: FittedTorque) -> tuple[Finding, ...]:
    if not fitted.explained or any(row.code in OF_ODD_FITS for row in fitted.findings):
        return found
    text = "{}; but the fitted model reproduces the recording with values as expected: nothing else here points to that"
    return tuple(
        replace(row, severity="info", text=text.format(row.text)) if row.code in SUSPICIONS else row for row in found
    )


@dataclass(frozen=True)
class CampaignEntry:
    """One recording of a campaign.

    Attributes
    ----------
    name : its folder below the campaign's folder
    id : its name in the joint fit, empty when refused
    status : ``ok`` or ``refused``
    error : the reason of a refusal
    summary : the parts of its result.json that the campaign page shows
    folder : where its report is, relative to the campaign's output
    """

    name: str
    id: str
    status: str
    error: str
    summary: Mapping[str, object]
    folder: str = ""


@dataclass(frozen=True)
class CampaignResult:
    """All recordings of a campaign and their joint fit (None with fewer than two usable recordings)."""

    entries: tuple[CampaignEntry, ...]
    joint: CampaignFit | None
    findings: tuple[Finding, ...]
    timing: Mapping[str, float]
    created: str
