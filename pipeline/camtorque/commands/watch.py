"""`camtorque watch`: a look at each block of a test while it runs."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from camtorque.commands import Outcome, Tell
from camtorque.jsonable import jsonable
from camtorque.watch import Block, Waiting, WatchOptions, watch


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Follow a test; each block is printed when it is there."""
    options = WatchOptions(
        every=arguments.every, block_cycles=arguments.block, enough_percent=arguments.enough,
        until_enough=arguments.until_enough, seconds=arguments.seconds,
    )  # fmt: skip
    return Outcome("", {}, stream=_printed(watch(arguments.folder, options)))


def _printed(items: Iterator[Block | Waiting]) -> Iterator[tuple[str, dict[str, Any]]]:
    for item in items:
        kind = "block" if isinstance(item, Block) else "waiting"
        text = block_line(item) if isinstance(item, Block) else f"{item.name}  waiting: {item.reason}"
        yield text, jsonable({"schema": "camtorque.watch/1", "kind": kind, **asdict(item)})


def block_line(block: Block) -> str:
    """Return a block in one line."""
    parts = [f"{block.name}  {block.speed_rpm:.1f} rpm  {block.cycles} cycles"]
    if block.lost:
        parts[0] += f", {block.lost} lost ({', '.join(block.reasons)})"
    if block.base_torque_nm is not None:
        parts.append(f"base circle {block.base_torque_nm:+.3f} N m")
    if block.drift_nm is not None and block.drift_limit_nm is not None:
        mark = " DRIFT" if block.drifted else ""
        parts.append(f"since the first {block.drift_nm:+.3f} of ± {block.drift_limit_nm:.3f}{mark}")
    parts.append(f"jitter {block.jitter_deg:.4f}°")
    if block.clipped:
        parts.append(f"CLIPPED in {block.clipped} cycles")
    if block.noise_percent is not None:
        parts.append(f"noise {block.noise_percent:.3f} % of peak")
        parts.append("enough" if block.enough else f"{block.cycles_wanted} cycles wanted")
    return "; ".join(parts)
