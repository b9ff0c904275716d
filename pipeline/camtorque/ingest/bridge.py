"""A bridge in mV whose supply was recorded beside it: its output in mV/V, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.raw import PairSource, RawChannel
from camtorque.records import Array, Refusal
from camtorque.units import unit_factor

SUPPLY = "supply"
LOOKED_AT = 100_000
SUPPLIES = (0.5, 30.0)
"""Supplies of strain gauge bridges [V]: 1 to 24 V in use."""


def with_supplies(specs: Sequence[ChannelSpec]) -> tuple[ChannelSpec, ...]:
    """Return the channels to read: those of the recording, then the supplies that they name."""
    supplies = (
        replace(spec, quantity=SUPPLY, channel=spec.supply_channel, unit="V", supply_channel="")
        for spec in specs
        if spec.supply_channel
    )
    return (*specs, *supplies)


def over_supplies(specs: Sequence[ChannelSpec], read: Sequence[RawChannel]) -> list[RawChannel]:
    """Return the channels of the recording from what was read of `with_supplies`.

    Raises
    ------
    Refusal : a supply that has other samples than its bridge, or is none
    """
    supplies = iter(read[len(specs) :])
    channels = zip(specs, read, strict=False)
    return [_over(spec, raw, next(supplies)) if spec.supply_channel else raw for spec, raw in channels]


def _over(spec: ChannelSpec, raw: RawChannel, supply: RawChannel) -> RawChannel:
    where = f"{spec.path} {spec.channel!r} supply_channel {spec.supply_channel!r}"
    alike = raw.source.n_samples == supply.source.n_samples and raw.breaks == supply.breaks
    if not alike or abs(raw.start_time - supply.start_time) * raw.sample_rate > 0.5:
        raise Refusal(
            f"{where}: {supply.source.n_samples} samples at {supply.sample_rate:.8g} Hz from {supply.start_time:g} s "
            f"on, the bridge has {raw.source.n_samples} at {raw.sample_rate:.8g} Hz from {raw.start_time:g} s on; "
            "export both on one time base"
        )
    volts = unit_factor(supply.unit.strip("-") or "V", "voltage", f"{where} unit")
    first = supply.source.read(0, min(supply.source.n_samples, LOOKED_AT)) * volts
    usual = float(np.median(np.abs(first[np.isfinite(first)]))) if np.isfinite(first).any() else 0.0
    if not SUPPLIES[0] <= usual <= SUPPLIES[1]:
        raise Refusal(
            f"{where}: is {usual:.4g} V in the median, expected the supply of a bridge, {SUPPLIES[0]:g} to "
            f"{SUPPLIES[1]:g} V; is it another channel or in mV?"
        )
    factor = 1e3 * unit_factor(spec.unit, "voltage", f"{where} unit") / volts

    def ratio(above: Array, below: Array) -> Array:
        return factor * above / np.where(below == 0.0, np.nan, below)  # without a supply there is no number

    return replace(raw, source=PairSource(raw.source, supply.source, ratio), unit=spec.output_unit)
