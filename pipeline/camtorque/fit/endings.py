"""Land or spill: which way a delivery ends that was not fitted, and what it would be if it ended the other way.

A line pressure falls alike after both, but on the return stroke a chamber that a land has closed is squeezed out and a
chamber that a spill port has opened is not. Who gives a load may say which it is; else it is what it was in all fitted
recordings, and where these differ, nobody knows: then bands hold both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.fit.firm_end import END_OF
from camtorque.fit.forecast import Forecast, OtherEnding
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.uncertainty import COVERAGE
from camtorque.records import Array, Refusal

Known = Array | float
EITHER = "either"
ENDINGS = (*END_OF, EITHER)
"""What may be asked for."""


def endings_of(known: KnownFit, speed: float, asked: str) -> tuple[FittedAt, ...]:
    """Return a fitted recording to stand in for each way in which a given load may have ended, the likeliest first.

    Parameters
    ----------
    asked : one of `ENDINGS`; empty: as the fitted recordings, both where these differ

    Raises
    ------
    Refusal : another word, or no fitted recording shows an end of delivery
    """
    if asked and asked not in ENDINGS:
        raise Refusal(f"ending: found {asked!r}, expected one of {', '.join(ENDINGS)}")
    nearest = known.nearest(speed)
    if not asked and nearest.structure not in END_OF:
        return (nearest,)
    shown = {item.structure for item in known.recordings if item.structure in END_OF}
    if not shown:
        raise Refusal(
            f"ending: found {asked}, but no fitted recording shows where delivery ends, expected one that does; leave "
            "the ending out"
        )
    both = sorted(END_OF, key=lambda structure: structure != nearest.structure)
    wanted = [asked] if asked in END_OF else both if asked or len(shown) > 1 else [nearest.structure]
    return tuple(_ending_by(known, speed, structure) for structure in wanted)


def own_ending(known: KnownFit, name: str) -> str:
    """Return how delivery of the fitted recording of a name ends, empty where none has it or shows an end."""
    return next((item.structure for item in known.recordings if item.id == name and item.structure in END_OF), "")


def the_other(known: KnownFit, source: FittedAt, speed: float) -> FittedAt:
    """Return a fitted recording to stand in for the ending that ``source`` does not have."""
    return _ending_by(known, speed, next(structure for structure in END_OF if structure != source.structure))


def _ending_by(known: KnownFit, speed: float, structure: str) -> FittedAt:
    """Return the fitted recording nearest in speed of those that end so, or of all as if it did."""
    return replace(known.nearest(speed, structure), structure=structure)


def either(one: Forecast, other: Forecast) -> Forecast:
    """Return a run of which it cannot be decided which of two it is.

    Its curves lie midway between both bands, its bands hold both.
    """
    torque, torque_std = holding(one.torque, one.torque_std, other.torque, other.torque_std)
    pressure, pressure_std = holding(one.pressure, one.pressure_std, other.pressure, other.pressure_std)
    contact, contact_std = holding(one.contact, one.contact_std, other.contact, other.contact_std)
    volume, volume_std = holding(one.delivered, one.delivered_std, other.delivered, other.delivered_std)
    mean = [float(np.mean(item.torque)) for item in (one, other)]
    causes = {
        name: holding(value, one.by_cause_std[name], other.by_cause[name], other.by_cause_std[name])
        for name, value in one.by_cause.items()
    }
    return replace(
        one, torque=torque, torque_std=torque_std, pressure=pressure, pressure_std=pressure_std, contact=contact,
        shape_std=_reach(torque, (one.torque, one.shape_std), (other.torque, other.shape_std)),
        mean_std=float(_reach(float(np.mean(torque)), (mean[0], one.mean_std), (mean[1], other.mean_std))),
        contact_std=contact_std, delivered=float(volume), delivered_std=float(volume_std),
        by_cause={name: causes[name][0] for name in one.by_cause},
        by_cause_std={name: causes[name][1] for name in one.by_cause}, ending=EITHER, both=(one, other),
        steps=one.steps or other.steps,
    )  # fmt: skip


def holding(
    one: Array | float, std: Array | float, other: Array | float, other_std: Array | float
) -> tuple[Array, Array]:
    """Return the middle of both 95 % bands together, and the standard uncertainty of which half of that width is."""
    low = np.minimum(one - COVERAGE * std, other - COVERAGE * other_std)
    high = np.maximum(one + COVERAGE * std, other + COVERAGE * other_std)
    return 0.5 * (low + high), 0.5 * (high - low) / COVERAGE


def _reach(middle: Known, *bands: tuple[Known, Known]) -> Array:
    """Return the standard uncertainty with which a band about ``middle`` holds some bands (value, standard error)."""
    ends = [np.abs(middle - value) / COVERAGE + std for value, std in bands]
    return np.asarray(np.max(ends, axis=0))


def if_it_ended_so(item: Forecast, other: Forecast) -> OtherEnding | None:
    """Return by how much the torque would differ at most with the other ending, None where the band holds it."""
    apart = other.torque - item.torque
    if np.all(np.abs(apart) < COVERAGE * item.torque_std):
        return None
    place = int(np.argmax(np.abs(apart)))
    return OtherEnding(other.ending, float(apart[place]), float(item.theta[place]))
