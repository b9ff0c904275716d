"""The joint fit of a campaign, where its recordings allow one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

from camtorque.fit.joint import CampaignFit, fit_joint
from camtorque.fit.joint_input import FittedAlone, HeldOnce, JointInput
from camtorque.ingest.stated import DIMENSIONS, MOST_NAMED, difference_findings, differences
from camtorque.process.threads import on_one_thread
from camtorque.records import Finding, Refusal
from camtorque.units import counted, first_of


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
    held, known = HeldOnce(), list[FittedAlone]()
    pumps: dict[str, list[str]] = {}
    same: dict[bytes, list[str]] = {}
    for item in map(read, range(count)):
        pumps.setdefault(item.pump_id, []).append(item.name)
        same.setdefault(item.measured.tobytes(), []).append(item.name)
        if len(pumps) > 1:
            known.clear()
        else:
            known.append(held(item))
    mixed = _mixed(pumps)
    if mixed:
        return _none(f"no joint fit: {mixed}")
    apart = differences({item.name: item.stated for item in known})
    pump = "; ".join(f"{name} {text}" for name, text in apart.items() if name in DIMENSIONS)
    if pump:
        return _none(f"no joint fit: found {pump}, expected the dimensions of one pump; correct the wrong one")
    try:
        return fit_joint(known, read, threads), (*difference_findings(apart), *_repeated(same.values()))
    except Refusal as refusal:
        return _none(str(refusal), *difference_findings(apart))


def _mixed(pumps: Mapping[str, Sequence[str]]) -> str:
    """Return why recordings cannot be fitted together and what to do, all of it; empty where they can."""
    times = Counter(name for names in pumps.values() for name in names)
    repeated = sorted(name for name, number in times.items() if number > 1)
    found, todo = [], []
    if len(pumps) > 1:
        whose = [f"{pump} ({first_of(names, MOST_NAMED)})" for pump, names in sorted(pumps.items())]
        found.append(f"pumps {', '.join(whose)}")
        todo.append("run a campaign of each pump or group by itself")
    if repeated:
        found.append(f"recording ids that repeat: {', '.join(repeated)}")
        todo.append("leave out what was copied, give every other recording an id of its own in [recording]")
    expected = "expected one pump, one group and one id per recording"
    return f"found {' and '.join(found)}, {expected}; {'; '.join(todo)}" if found else ""


def _repeated(same: Iterable[Sequence[str]]) -> tuple[Finding, ...]:
    """Return a warning on recordings that hold the same cycles under several ids."""
    return tuple(
        Finding("recording_repeated", "warning", f"{' and '.join(names)} hold the same cycles: what one tells counts "
                "more than once, intervals are too narrow and each is predicted from itself; leave the copies out")
        for names in same if len(names) > 1
    )  # fmt: skip


def _none(text: str, *more: Finding) -> tuple[None, tuple[Finding, ...]]:
    return None, (Finding("no_joint_fit", "warning", text), *more)
