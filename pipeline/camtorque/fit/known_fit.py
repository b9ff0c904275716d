"""A finished fit as predictions take it: values, covariance, recordings, errors of its laws; and values drawn from it.

Beside a valve near chattering the torque of a run that was not made is a matter of the last digit of the values, and
the best ones may lie on the rare side of a step: what is typical is the drawn run nearest to the median of all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.problem import SEPARATOR
from camtorque.fit.quadratic import bounded_quadratic
from camtorque.fit.shared_lift import SharedLift
from camtorque.fit.truncated import Gaussian
from camtorque.laws import ROWS
from camtorque.records import Array, Estimate, ReadOnly

GROWTH = 0.02
"""Error as a share of the peak per unit of ln speed away from the fitted speeds, where no left-out run teaches it."""
LEAST_LEFT_OUT = 3
"""Left-out recordings that tell an error within the fitted speeds and its growth beyond them."""
FLOOR = 0.15
"""Share of the law's error that is spread over the revolution whatever the torque is."""
FRACTIONS = (0.2, 1.0)
"""Draws are such shares of the covariance's standard deviations away; their scatter is scaled up again, and the smaller
one counts: small draws make too much of a step of the model, large ones of the bounds."""
PORT = "port_closing_lift"
NEARLY_SINGULAR = 1.0e-9
"""Added to correlations, some of which are those of one thing told twice."""
SPREAD_DRAWS = 8
"""Draws that tell whether a slope at the best values is one for all that a fit leaves open."""
STEP_RATIO, RARE_RATIO = 2.5, 0.7
"""Scatter of small draws, scaled up, over that of whole ones: 0.1 to 1.4 in 33 left-out runs, 4 to 5 where steps are
all; less is enough where the best values lie on the rare side of a step."""


@dataclass(frozen=True)
class FittedAt:
    """One recording that a fit rests on.

    share : rms error of its prediction as a share of the peak: left out where the fit is joint, else on held-out cycles
    left_out : whether ``share`` is that of a left-out prediction
    """

    id: str
    speed: float
    structure: str
    share: float
    left_out: bool


@dataclass(frozen=True)
class KnownFit(ReadOnly):
    """Values and covariance of a fit [SI], and the recordings behind it.

    residual_covariance : as `joint_fit.residual_covariance`, None where it is the same
    lift : correction of the lift table that all recordings ask for, None where it is not known or the cam is another
    unexplained : recordings of the fit that it does not explain, of which nothing is taken (`without`)
    """

    names: tuple[str, ...]
    values: Array
    covariance: ArrowCovariance
    recordings: tuple[FittedAt, ...]
    residual_covariance: ArrowCovariance | None = None
    lift: SharedLift | None = None
    unexplained: tuple[str, ...] = ()

    @property
    def taught(self) -> bool:
        """Whether left-out recordings tell what the laws get wrong in another run, beyond the fitted speeds as well."""
        return len(self.recordings) >= LEAST_LEFT_OUT and all(item.left_out for item in self.recordings)

    @property
    def predictive(self) -> ArrowCovariance:
        """The covariance that goes into bands: where left-out runs tell the laws' error it need not hold that, too."""
        return self.residual_covariance if self.taught and self.residual_covariance is not None else self.covariance

    @property
    def matrix(self) -> Array:
        """The whole covariance, (k, k)."""
        return self.covariance.among(range(len(self.names)))

    @property
    def within(self) -> Gaussian:
        """The fit as a Gaussian within the bounds of the rows; a value that was fitted beyond one has none there."""
        rows = [ROWS[name.split(SEPARATOR)[0]] for name in self.names]
        lower, upper = (np.array([getattr(row, end) for row in rows]) for end in ("lower", "upper"))
        low = np.where(self.values >= lower, lower, -np.inf)
        return Gaussian(self.values, self.matrix, low, np.where(self.values <= upper, upper, np.inf))

    def nearest(self, speed: float, structure: str = "") -> FittedAt:
        """Return the recording nearest in speed, of those of a structure where there are any."""
        alike = tuple(item for item in self.recordings if item.structure == structure)
        return min(alike or self.recordings, key=lambda item: abs(np.log(item.speed / speed)))

    def own(self, recording: str) -> dict[str, int]:
        """Return the place of every parameter that acts in a recording: shared ones and its own."""
        parts = [name.partition(SEPARATOR) for name in self.names]
        plain = {name: k for k, (name, separator, _) in enumerate(parts) if not separator}
        mine = {name: k for k, (name, separator, whose) in enumerate(parts) if separator and whose == recording}
        return {**plain, **mine}

    def only(self, recordings: Sequence[str]) -> KnownFit:
        """Return the fit with the shared parameters and the own ones of some recordings alone.

        The other recordings stay: what they say of the laws' error holds.
        """
        kept = sorted({place for recording in recordings for place in self.own(recording).values()})
        covariance = ArrowCovariance.whole(self.covariance.among(kept))
        return KnownFit(tuple(self.names[k] for k in kept), self.values[kept], covariance, self.recordings)

    def without(self, recordings: Sequence[str]) -> KnownFit:
        """Return the fit without some recordings: neither their own parameters nor what they say of the laws."""
        if not recordings:
            return self
        rest = tuple(item for item in self.recordings if item.id not in recordings)
        kept = sorted({place for item in rest for place in self.own(item.id).values()})
        of_residual = self.residual_covariance
        smaller = None if of_residual is None else ArrowCovariance.whole(of_residual.among(kept))
        explained = self.only([item.id for item in rest])
        return replace(
            explained, recordings=rest, residual_covariance=smaller, lift=self.lift, unexplained=tuple(recordings)
        )


def law_share(known: KnownFit, speed: float) -> tuple[float, float]:
    """Return the rms error of the laws at a speed as a share of the peak, and how far beyond the fitted speeds it is.

    Inside: the rms of the inner left-out predictions. Outside: what the outermost ones say of the growth per ln speed.
    """
    ordered = sorted(known.recordings, key=lambda item: item.speed)
    speeds = np.log([item.speed for item in ordered])
    shares = np.array([item.share for item in ordered])
    beyond = float(max(speeds[0] - np.log(speed), np.log(speed) - speeds[-1], 0.0))
    if not known.taught:
        return float(
            np.sqrt(np.mean(shares**2)) + GROWTH * max(beyond, abs(np.log(speed / known.nearest(speed).speed)))
        ), beyond
    inside = float(np.sqrt(np.mean(shares[1:-1] ** 2)))
    gaps = np.array([speeds[1] - speeds[0], speeds[-1] - speeds[-2]])
    growth = float(np.max(np.maximum(shares[[0, -1]] - inside, 0.0) / np.maximum(gaps, 0.05)))
    return inside + growth * beyond, beyond


def law_std(torque: Array, share: float) -> Array:
    """Return the law's error over the angle, (n,) [N m]: rms ``share`` of the peak, mostly where the torque is."""
    square = torque**2
    shape = np.sqrt((1.0 - FLOOR) * square + FLOOR * np.mean(square)) / np.sqrt(np.mean(square))
    return np.asarray(share * np.max(np.abs(torque)) * shape)


@dataclass(frozen=True)
class LoadKnowledge(ReadOnly):
    """What is known of the load of a run that was not made, beside its line pressure.

    Attributes
    ----------
    ends : own parameters that are known otherwise, such as the end of delivery, with how well [SI]
    pressure_std : (n,) standard uncertainty of the line pressure on the chain's grid [Pa], empty for none
    means : such parameters that are weighted means of fitted ones -> place of each in the fit -> weight; what the fit
        leaves open of the mean is in its covariance, the standard error of ``ends`` is what comes on top
    pulls : end -> width that moves it, and by how much per unit of the width's own error [SI]
    """

    ends: Mapping[str, Estimate]
    pressure_std: Array = field(default_factory=lambda: np.zeros(0))
    means: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    pulls: Mapping[str, tuple[str, float]] = field(default_factory=dict)


def draws(
    known: KnownFit,
    places: Mapping[str, int],
    mean: Mapping[str, float],
    load: LoadKnowledge,
    fraction: float,
    count: int,
) -> list[dict[str, float]]:
    """Return drawn values within the bounds of the rows, ``count`` of them.

    Parameters
    ----------
    places : parameter -> its place in the fit; mean : parameter -> what it is drawn about [SI]
    fraction : of the covariance's standard deviations
    """
    parts = [load.means.get(name, {place: 1.0}) for name, place in places.items()]
    index = sorted({place for part in parts for place in part})
    mixing = np.array([[part.get(place, 0.0) for place in index] for part in parts])
    block = mixing @ known.predictive.among(index) @ mixing.T
    root = root_of(block)
    every = np.random.default_rng(0).standard_normal((count, len(parts) + len(load.ends)))
    normal, found = np.split(every, [len(parts)], axis=1)
    result = []
    center, rooms = np.array([mean[name] for name in places]), [_room(name, mean[name]) for name in places]
    for k, drawn in enumerate(within(center + fraction * normal @ root.T, center, block, np.array(rooms))):
        item = dict(zip(places, drawn.tolist(), strict=True))
        item["torque_zero"] = 0.0
        away = {name: fraction * end.stderr * one for (name, end), one in zip(load.ends.items(), found[k], strict=True)}
        for name, error in away.items():
            other, pull = load.pulls.get(name, ("", 0.0))
            item[name] = item.get(name, mean[name]) + float(error + pull * away.get(other, 0.0))
        result.append({name: float(np.clip(v, *_room(name, mean[name]))) for name, v in item.items()})
    return result


def within(drawn: Array, center: Array, covariance: Array, rooms: Array) -> Array:
    """Return draws (m, k) within their rooms (k, 2): those outside go to the most probable place on the border.

    What is cut off at a bound alone leaves the others where they went with it: a coupling cut off at rigid left the
    shaft stiffer by what it lost.
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    low, high = (rooms.T - center) / scale
    matrix = np.linalg.inv(covariance / np.outer(scale, scale) + NEARLY_SINGULAR * np.eye(center.size))
    found = (drawn - center) / scale
    for k in np.flatnonzero(np.any((found < low) | (found > high), axis=1)):
        found[k] = bounded_quadratic(matrix, matrix @ found[k], low, high, np.clip(found[k], low, high))
    return np.asarray(np.clip(center + found * scale, *rooms.T))


def drawn_about(known: KnownFit, deviation: Array) -> Array:
    """Return values drawn about those of a fit by a covariance (k, k), within bounds, (`SPREAD_DRAWS`, k) [SI]."""
    normal = np.random.default_rng(0).standard_normal((SPREAD_DRAWS, len(known.names)))
    rooms = [_room(name.split(SEPARATOR)[0], value) for name, value in zip(known.names, known.values, strict=True)]
    return within(known.values + normal @ root_of(deviation).T, known.values, deviation, np.array(rooms))


def root_of(covariance: Array) -> Array:
    """Return a matrix whose product with its transpose is a covariance, (k, k)."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) * scale[:, None])


def _room(name: str, value: float) -> tuple[float, float]:
    """Return the bounds of what is drawn about a value [SI].

    One beyond the bounds of literature was fitted within the wider ones of its own rig, and is known by its covariance.
    A port that never opens, beside a suction valve, tells nothing of where it closes, and is opened by no draw.
    """
    row, beyond = ROWS[name], 0.5 * abs(value)
    if name == PORT and value < row.lower:
        return value, value
    return (
        row.lower if value >= row.lower else value - beyond,
        row.upper if value <= row.upper else value + beyond,
    )


def steps(small: Array, whole: Array) -> bool:
    """Return whether the model steps within what a fit leaves open.

    Small draws scatter more than whole ones then. On the rare side of a step the best values are farther from the
    median of the draws than most draws.

    Parameters
    ----------
    small, whole : how far draws move the torque, by both of `FRACTIONS`, scaled up by them, (m, n) [N m]
    """
    median = np.median(whole, axis=0)
    rare = np.linalg.norm(median) > np.median(np.linalg.norm(whole - median, axis=1))
    return bool(np.linalg.norm(small) >= (RARE_RATIO if rare else STEP_RATIO) * np.linalg.norm(whole))


def middle(moved: Array) -> int:
    """Return which of some drawn torques, (m, n), is nearest to their median."""
    return int(np.argmin(np.sum(np.abs(moved - np.median(moved, axis=0)), axis=1)))
