"""What a joint fit needs of a recording that was fitted alone: a tenth of what the fit itself held."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from camtorque.fit.prepare import MeanCycles
from camtorque.fit.problem import FitData
from camtorque.fit.single import Prepared, pressure_gain_std, switching_std
from camtorque.fit.uncertainty import covariance
from camtorque.records import Array, freeze_arrays


@dataclass(frozen=True)
class Alone:
    """A shared parameter as one recording alone tells it: value and standard error [SI], its unit and SI per unit."""

    value: float
    std: float
    unit: str
    per_unit: float


@dataclass(frozen=True)
class JointInput:
    """One recording as a joint fit takes it.

    Attributes
    ----------
    pump_id : recordings of different pumps are not fitted together
    data : the recording in its best structure, started at its own minimum
    means : mean cycles of both halves, without scatter
    rigid_torque, lift, lift_velocity : (n_theta,) of the rigid solution [N m], [m], [m/rad]
    measured : (n,) mean torque on the grid of the fit [N m]
    pressure_gain_std : relative
    switching_std : of the trigger's switching delay as an angle at this speed [rad]
    alone : shared parameter -> as this recording alone tells it
    inflation : of its residual, fitted alone
    """

    pump_id: str
    data: FitData
    means: MeanCycles
    rigid_torque: Array
    lift: Array
    lift_velocity: Array
    measured: Array
    pressure_gain_std: float
    switching_std: float
    alone: Mapping[str, Alone]
    inflation: float

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.data.name


def joint_input(prepared: Prepared) -> JointInput:
    """Return what a joint fit needs of a recording whose minima are found."""
    best = prepared.candidates[0]
    found = covariance(best.problem, best.solution)
    alone = {
        slot.row.name: Alone(float(value), float(std), slot.row.unit, slot.row.per_unit)
        for slot, value, std in zip(best.problem.slots, best.solution.z, found.std, strict=True)
        if slot.row.role == "shared"
    }
    means, rigid = prepared.means, prepared.rigid
    return JointInput(
        prepared.recording.config.pump_id, best.data, replace(means, pressure_all=np.zeros(0)),
        rigid.torque, rigid.lift, rigid.lift_velocity, prepared.measured, pressure_gain_std(prepared.recording),
        switching_std(prepared.cycles), alone, found.inflation,
    )  # fmt: skip


def held_once(inputs: Iterable[JointInput]) -> list[JointInput]:
    """Return the inputs with lift, lift law and grid held once where they are the same: a third of their memory."""
    known: dict[bytes, Any] = {}

    def once(value: Any, *arrays: Array) -> Any:
        digest = sha256(repr([array.shape for array in arrays]).encode())
        for array in arrays:
            digest.update(array.tobytes())
        return known.setdefault(digest.digest(), value)

    result = []
    for item in inputs:
        chain = item.data.chain
        law = once(chain.law, chain.law.knots, chain.law.coefficients)
        data = replace(item.data, chain=replace(chain, theta=once(chain.theta, chain.theta), law=law))
        lift, velocity = (once(array, array) for array in (item.lift, item.lift_velocity))
        result.append(replace(item, data=data, lift=lift, lift_velocity=velocity))
    return result
