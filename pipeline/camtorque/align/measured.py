"""Which channels are aligned: torque and pressure, which the cuts look at, and all others, which they do not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from camtorque.align.channels import AlignedChannel, Turns, align_channels
from camtorque.align.sources import ANGLE_CHANNELS
from camtorque.records import Channel, Finding, Recording, Refusal

CUT_BY = ("torque", "pressure")
"""Quantities whose damage costs a cycle."""


@dataclass(frozen=True)
class Measured:
    """Channels by quantity: ``main`` are torque and pressure, ``other`` all that remain but those of the angle."""

    main: Mapping[str, Channel]
    other: Mapping[str, Channel]

    @property
    def reference(self) -> str:
        """Logger whose clock is the time: that of the torque, else of the pressure, else of the first channel."""
        return next(iter((*self.main.values(), *self.other.values()))).logger


def measured(recording: Recording) -> Measured:
    """Return the channels to be aligned.

    Raises
    ------
    Refusal : there is none, or two of one quantity
    """
    found: dict[str, Channel] = {}
    for channel in recording.channels:
        if channel.quantity in ANGLE_CHANNELS:
            continue
        if channel.quantity in found:
            count = len(recording.of(channel.quantity))
            raise Refusal(
                f"{recording.config.id}: found {count} {channel.quantity} channels, expected one; keep one "
                "[[channels]] entry"
            )
        found[channel.quantity] = channel
    if not found:
        raise Refusal(
            f"{recording.config.id}: found nothing but channels of the angle, expected one that measures something; "
            'add a [[channels]] entry, such as quantity = "torque"'
        )
    main = {quantity: found[quantity] for quantity in CUT_BY if quantity in found}
    return Measured(main, {quantity: channel for quantity, channel in found.items() if quantity not in main})


def align_others(
    channels: Mapping[str, Channel], turns: Turns
) -> tuple[dict[str, AlignedChannel], tuple[Finding, ...]]:
    """Return the other channels on the grid, nan in cycles that they do not cover, and findings about those."""
    aligned: dict[str, AlignedChannel] = {}
    findings = []
    for quantity, channel in channels.items():
        if channel.logger not in turns.clocks:
            text = (
                f"the {quantity} is left out: its logger {channel.logger!r} has its own clock and shares no trigger, "
                "torque or pressure with the others"
            )
            findings.append(Finding("channel_untied", "warning", text, channel.where))
            continue
        there = turns.covered([channel])
        if not there.any():
            text = f"the {quantity} is left out: it covers none of {there.size} cycles"
            findings.append(Finding("channel_not_covering", "warning", text, channel.where))
            continue
        aligned |= align_channels({quantity: channel}, turns, there)
    return aligned, tuple(findings)
