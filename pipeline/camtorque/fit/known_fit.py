"""A finished fit as predictions take it: values, covariance, recordings; and how far its laws are off at a speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.problem import SEPARATOR
from camtorque.fit.shared_lift import SharedLift
from camtorque.records import Array, ReadOnly

GROWTH = 0.02
"""Error as a share of the peak per unit of ln speed away from the fitted speeds, where no left-out run teaches it."""
LEAST_LEFT_OUT = 3
"""Left-out recordings that tell an error within the fitted speeds and its growth beyond them."""
FLOOR = 0.15
"""Share of the law's error that is spread over the revolution whatever the torque is."""


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

    shown : the covariance as the residual alone has it (`joint_fit.shown_covariance`), None where it is the same
    lift : correction of the lift table that all recordings ask for, None where it is not known or the cam is another
    unexplained : recordings of the fit that it does not explain, of which nothing is taken (`without`)
    """

    names: tuple[str, ...]
    values: Array
    covariance: ArrowCovariance
    recordings: tuple[FittedAt, ...]
    shown: ArrowCovariance | None = None
    lift: SharedLift | None = None
    unexplained: tuple[str, ...] = ()

    @property
    def taught(self) -> bool:
        """Whether left-out recordings tell what the laws get wrong in another run, beyond the fitted speeds as well."""
        return len(self.recordings) >= LEAST_LEFT_OUT and all(item.left_out for item in self.recordings)

    @property
    def predictive(self) -> ArrowCovariance:
        """The covariance that goes into bands: where left-out runs tell the laws' error it need not hold that, too."""
        return self.shown if self.taught and self.shown is not None else self.covariance

    @property
    def matrix(self) -> Array:
        """The whole covariance, (k, k)."""
        return self.covariance.among(range(len(self.names)))

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
        shown = None if self.shown is None else ArrowCovariance.whole(self.shown.among(kept))
        explained = self.only([item.id for item in rest])
        return replace(explained, recordings=rest, shown=shown, lift=self.lift, unexplained=tuple(recordings))


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
