"""The joint fit of a campaign, where its recordings allow one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from camtorque.fit.joint import CampaignFit, fit_joint
from camtorque.fit.joint_input import JointInput, held_once
from camtorque.records import Finding, Refusal
from camtorque.threads import on_one_thread


@on_one_thread
def joint_fit(found: Iterable[JointInput], threads: int) -> tuple[CampaignFit | None, tuple[Finding, ...]]:
    """Return the joint fit; recordings of different pumps or ids that repeat cannot be fitted together.

    Parameters
    ----------
    found : what the joint fit needs of each recording
    threads : recordings that are worked at side by side
    """
    usable = held_once(found)
    if len(usable) < 2:
        return _none(f"{len(usable)} usable recordings, a joint fit needs at least 2")
    pumps = sorted({item.pump_id for item in usable})
    names = [item.name for item in usable]
    if len(pumps) > 1 or len(set(names)) < len(names):
        repeated = sorted(name for name, count in Counter(names).items() if count > 1)
        what = f"pumps {', '.join(pumps)}" if len(pumps) > 1 else f"recording ids that repeat: {', '.join(repeated)}"
        return _none(f"no joint fit: found {what}, expected one pump and one id per recording")
    try:
        return fit_joint(usable, threads), ()
    except Refusal as refusal:
        return _none(str(refusal))


def _none(text: str) -> tuple[None, tuple[Finding, ...]]:
    return None, (Finding("no_joint_fit", "warning", text),)
