"""What a joint fit needs of a recording that was fitted alone, a tenth of what the fit held.

Are the recordings of one pump; what they have in common: bounds, priors, the error of the laws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from sys import intern
from typing import Any

import numpy as np

from camtorque.fit.kinds import KINDS
from camtorque.fit.prepare import INDEPENDENT, MeanCycles, law_variance
from camtorque.fit.problem import FitData, with_rows
from camtorque.fit.single import Prepared, switching_std
from camtorque.fit.uncertainty import covariance
from camtorque.fit.valleys import TRIGGER_ANGLE
from camtorque.ingest.stated import other_triggers, stated
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array, ReadOnly, Refusal

TEXTS = ("name", "symbol", "unit", "meaning", "source", "role")
"""Of a parameter row, the same in most recordings."""
SAME_SPEED = 0.05
TWO_STATES = 5.0
"""Standard errors between two recordings at one speed beyond which they are not one pump in one state."""
COMPARED = (
    "trigger_offset", "leakage", "dead_volume", "bearing_arm", "spring_preload_error", "port_closing_lift",
    "shaft_drag", "shaft_compliance",
)  # fmt: skip
"""Shared parameters that tell whether recordings belong to one pump in one state."""
ALIKE_WIDTH = 1.25
"""Priors whose widths differ by less than this factor count alike."""


@dataclass(frozen=True)
class Alone:
    """A shared parameter as one recording alone tells it: value and standard error [SI], its unit and SI per unit."""

    value: float
    std: float
    unit: str
    per_unit: float


@dataclass(frozen=True)
class FittedAlone:
    """What is held of a recording while all are fitted.

    Attributes
    ----------
    pump_id : with its group; recordings of different pumps or groups are not fitted together
    data : the recording in its best structure, started at its own minimum
    switching_std : of the trigger's switching delay as an angle at this speed [rad]
    alone : shared parameter -> as this recording alone tells it
    inflation : of its residual, fitted alone
    stated : what its sheets state (`camtorque.ingest.stated`)
    """

    pump_id: str
    data: FitData
    switching_std: float
    alone: Mapping[str, Alone]
    inflation: float
    stated: Mapping[str, str]

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.data.name


@dataclass(frozen=True)
class JointInput(FittedAlone, ReadOnly):
    """One recording as a joint fit takes it: what is held of it, and what is read again when all are fitted.

    Attributes
    ----------
    means : mean cycles of both halves, without scatter
    rigid_torque, lift, lift_velocity : (n_theta,) of the rigid solution [N m], [m], [m/rad]
    measured : (n,) mean torque on the grid of the fit [N m]
    """

    means: MeanCycles
    rigid_torque: Array
    lift: Array
    lift_velocity: Array
    measured: Array


def joint_input(prepared: Prepared) -> JointInput:
    """Return what a joint fit needs of a recording whose minima are found."""
    best = prepared.candidates[0]
    found = covariance(best.problem, best.solution)
    alone = {
        parameter.row.name: Alone(float(value), float(std), parameter.row.unit, parameter.row.per_unit)
        for parameter, value, std in zip(best.problem.parameters, best.solution.z, found.std, strict=True)
        if parameter.row.role == "shared"
    }
    means, rigid = prepared.means, prepared.rigid
    return JointInput(
        prepared.recording.config.pump_state, best.data, switching_std(prepared.cycles), alone, found.inflation,
        stated(prepared.recording), replace(means, pressure_all=np.zeros(0)), rigid.torque, rigid.lift,
        rigid.lift_velocity, prepared.measured,
    )  # fmt: skip


class HeldOnce:
    """Takes of each recording what is held of it, with lift law, grid and texts once where they are the same."""

    def __init__(self) -> None:
        self._known: dict[bytes, Any] = {}

    def __call__(self, item: JointInput) -> FittedAlone:
        """Return what is held of a recording."""
        chain = item.data.chain
        law = self._once(chain.law, chain.law.knots, chain.law.coefficients)
        rows = {
            intern(name): replace(row, **{field: intern(getattr(row, field)) for field in TEXTS})  # type: ignore[arg-type]
            for name, row in item.data.rows.items()
        }
        alone = {intern(name): replace(row, unit=intern(row.unit)) for name, row in item.alone.items()}
        chain = replace(chain, theta=self._once(chain.theta, chain.theta), law=law)
        data = replace(item.data, chain=chain, rows=rows)
        sheets = {intern(name): intern(text) for name, text in item.stated.items()}
        return FittedAlone(intern(item.pump_id), data, item.switching_std, alone, item.inflation, sheets)

    def _once(self, value: Any, *arrays: Array) -> Any:
        digest = sha256(repr([array.shape for array in arrays]).encode())
        for array in arrays:
            digest.update(array.tobytes())
        return self._known.setdefault(digest.digest(), value)


def refuse_two_states(inputs: Sequence[FittedAlone]) -> None:
    """Refuse recordings at one speed whose shared parameters contradict each other.

    Where delivery begins alone is no other state: a pump that is metered at its inlet begins elsewhere at each load.
    """
    speeds = np.array([item.data.chain.speed for item in inputs])
    rows = [[item.alone.get(name) for name in COMPARED] for item in inputs]
    if other_triggers(item.stated for item in inputs):
        for line in rows:
            line[COMPARED.index(TRIGGER_ANGLE)] = None
    values = np.array([[np.nan if row is None else row.value for row in line] for line in rows])
    stds = np.array([[np.nan if row is None else row.std for row in line] for line in rows])
    for k, one in enumerate(inputs):
        near = np.abs(speeds[k] / speeds[:k] - 1.0) <= SAME_SPEED
        apart = np.abs(values[k] - values[:k]) > TWO_STATES * np.hypot(stds[k], stds[:k])
        apart &= near[:, None]
        apart[np.sum(apart, axis=1) == 1, COMPARED.index("port_closing_lift")] = False
        found = np.argwhere(apart)
        if found.size:
            j, place = (int(number) for number in found[0])
            raise _two_states(inputs[j], one, COMPARED[place])


def _two_states(other: FittedAlone, one: FittedAlone, name: str) -> Refusal:
    first, second = one.alone[name], other.alone[name]
    (a, s), (b, t) = ((row.value / row.per_unit, row.std / row.per_unit) for row in (first, second))
    return Refusal(
        f"joint fit: {other.name} and {one.name} run at one speed but differ in {name.replace('_', ' ')} "
        f"({b:.3g} +- {t:.2g} and {a:.3g} +- {s:.2g} {first.unit}): they are not one pump in one state and are not "
        "averaged; run a campaign of each state by itself, or use `camtorque compare`"
    )


def with_own_triggers(inputs: Sequence[FittedAlone]) -> list[FittedAlone]:
    """Return the recordings, each with its own error of the trigger's angle where triggers are declared differently.

    One that is mounted anew, or an encoder in the place of a tooth, is off by something else; the pump is the same.
    """
    if not other_triggers(item.stated for item in inputs):
        return list(inputs)
    own = {TRIGGER_ANGLE: {"role": "own"}}
    kept = [{name: row for name, row in item.alone.items() if name != TRIGGER_ANGLE} for item in inputs]
    return [
        replace(item, data=with_rows(item.data, own), alone=alone) for item, alone in zip(inputs, kept, strict=True)
    ]


def common_error(item: FitData, count: int) -> FitData:
    """Return a recording whose weights hold the error of the laws ``count`` times: it is the same in all."""
    variance = 1.0 / item.weight**2 + (count - 1.0) * law_variance(item.torque) * item.torque.size / INDEPENDENT
    return replace(item, weight=1.0 / np.sqrt(variance))


def with_common_rows(data: Sequence[FitData]) -> list[FitData]:
    """Return the recordings with the same bounds and priors of the shared parameters, whichever comes first.

    A part of the pump is of the kind that most recordings have.
    """
    of_most = {kind.parameter: kind.of_most for kind in KINDS.values()}
    names = [name for name, row in data[0].rows.items() if row.role == "shared"]
    common: dict[str, Mapping[str, object]] = {}
    for name in names:
        rows = [item.rows[name] for item in data]
        common[name] = {
            "lower": min(row.lower for row in rows), "upper": max(row.upper for row in rows),
            **common_prior(of_most.get(name, list)(rows)),
        }  # fmt: skip
    return [with_rows(item, common) for item in data]


def common_prior(rows: Sequence[ParameterRow]) -> Mapping[str, object]:
    """Return prior and source of a parameter of the pump that each recording has a row of.

    Of one mean the widest counts, which is the same knowledge for a larger load. Of several the narrowest does, which
    somebody stated or measured, in the mean with others that are hardly wider: they spread as far as they are apart.
    """
    widest: dict[float, ParameterRow] = {}
    for row in rows:
        if row.prior and (row.prior[0] not in widest or row.prior[1] > _width(widest[row.prior[0]])):
            widest[row.prior[0]] = row
    if not widest:
        return {}
    least = min(widest.values(), key=_width)
    near = {mean: _width(row) for mean, row in widest.items() if _width(row) <= ALIKE_WIDTH * _width(least)}
    mean, spread = float(np.mean(list(near))), float(np.std(list(near)))
    return {"prior": (mean, float(np.hypot(max(near.values()), spread))), "source": least.source}


def _width(row: ParameterRow) -> float:
    return row.prior[1] if row.prior else np.inf
