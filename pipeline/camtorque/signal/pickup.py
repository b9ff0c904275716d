"""The pulses of any pick-up: the one finder of edges for `check` and for `align`."""

from __future__ import annotations

from collections.abc import Callable

from camtorque.records import Channel
from camtorque.signal.edges import Edges, find_edges
from camtorque.signal.inductive import find_crossings

FINDERS: dict[str, Callable[[Channel, str, int], Edges]] = {
    "digital": find_edges,
    "hall": find_edges,
    "inductive": find_crossings,
}
"""``sensor`` of [trigger] -> finder."""


def find_pulses(channel: Channel, sensor: str, edge: str, block_samples: int = 1 << 18) -> Edges:
    """Return the declared edge of every pulse of a pick-up; ``sensor`` is a key of `FINDERS`.

    Raises
    ------
    Refusal : no pulses in the channel
    """
    return FINDERS[sensor](channel, edge, block_samples)
