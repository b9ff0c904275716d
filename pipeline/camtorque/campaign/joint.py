"""The joint fit of a campaign, where its recordings allow one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from camtorque.fit.joint import CampaignFit, fit_joint
from camtorque.fit.joint_input import FittedAlone, HeldOnce, JointInput
from camtorque.ingest.stated import DIMENSIONS, difference_findings, differences
from camtorque.process.threads import on_one_thread
from camtorque.records import Finding, Refusal
from camtorque.units import counted


@on_one_thread
def joint_fit(
    count: int, read: Callable[[int], JointInput], threads: int
) -> tuple[CampaignFit | None, tuple[Finding, ...]]:
    """Return the joint fit; recordings of different pumps or groups, or of ids that repeat, cannot be fitted together.

    Parameters
    ----------
    count : usable recordings
    read : gives what the joint fit needs of one of them; nothing is held of those that cannot be fitted together
    threads : recordings that are worked at side by side
    """
    if count < 2:
        return _none(f"{counted(count, 'usable recording', 'usable recordings')}, a joint fit needs at least 2")
    held, known, names, pumps = HeldOnce(), list[FittedAlone](), Counter[str](), set[str]()
    same: dict[bytes, list[str]] = {}
    for item in map(read, range(count)):
        names[item.name] += 1
        pumps.add(item.pump_id)
        same.setdefault(item.measured.tobytes(), []).append(item.name)
        if len(pumps) > 1:
            known.clear()
        else:
            known.append(held(item))
    repeated = sorted(name for name, times in names.items() if times > 1)
    if len(pumps) > 1 or repeated:
        what = f"pumps {', '.join(sorted(pumps))}"
        if len(pumps) == 1:
            what = f"recording ids that repeat: {', '.join(repeated)}"
        return _none(
            f"no joint fit: found {what}, expected one pump, one group and one id per recording; run a campaign of "
            "each pump or group by itself, or give every recording an id of its own in [recording]"
        )
    apart = differences({item.name: item.stated for item in known})
    pump = "; ".join(f"{name} {text}" for name, text in apart.items() if name in DIMENSIONS)
    if pump:
        return _none(f"no joint fit: found {pump}, expected the dimensions of one pump; correct the wrong one")
    try:
        return fit_joint(known, read, threads), (*difference_findings(apart), *_repeated(same.values()))
    except Refusal as refusal:
        return _none(str(refusal), *difference_findings(apart))


def _repeated(same: Iterable[Sequence[str]]) -> tuple[Finding, ...]:
    """Return a warning on recordings that hold the same cycles under several ids."""
    return tuple(
        Finding("recording_repeated", "warning", f"{' and '.join(names)} hold the same cycles: what one tells counts "
                "more than once, intervals are too narrow and each is predicted from itself; leave the copies out")
        for names in same if len(names) > 1
    )  # fmt: skip


def _none(text: str, *more: Finding) -> tuple[None, tuple[Finding, ...]]:
    return None, (Finding("no_joint_fit", "warning", text), *more)
