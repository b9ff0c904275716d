"""A run that was not made: torque, chamber and load from the values of a fit, with bands.

Values are drawn about the fit by shares of its covariance and each draw is evaluated whole: where bounds would spoil
the correlations, bands are those of the linearised model; beside a valve near chattering, where the model steps, those
of whole standard deviations. What the laws get wrong is added: as large as predictions of left-out recordings were off,
growing beyond the fitted speeds as they grew. The twist needs the torque itself, which is found by a fixed point. Of
another clearance of the plunger the leakage is another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from camtorque.fit.known_fit import (
    FRACTIONS,
    FittedAt,
    KnownFit,
    LoadKnowledge,
    draws,
    law_share,
    law_std,
    middle,
    steps,
)
from camtorque.fit.prepare import at_cam_angles
from camtorque.fit.problem import LAND_NAMES, NEUTRAL, SPILL_NAMES, WITHOUT
from camtorque.fit.shared_lift import SharedLift
from camtorque.fit.uncertainty import stated_pressure
from camtorque.laws.causes import cam_torques, contact_load, measured_torques
from camtorque.laws.chain import (
    ChainInput,
    ChainOutput,
    coefficients_of,
    evaluate,
    with_substeps,
)
from camtorque.laws.fluid import specific_volume
from camtorque.laws.swing import Swing
from camtorque.laws.valve import SEAT_FLOW
from camtorque.mechanism.cam import stroke_count
from camtorque.mechanism.contact import pulls
from camtorque.records import Array, ReadOnly, Refusal
from camtorque.units import BAR

DRAWS = 60
ROUNDS = 4
"""Fixed-point steps for torque, twist and cam angle."""
OF_TORQUE = ("torque", "mean")
"""What the error of the laws is added to."""
Parts = Callable[[ChainInput, Mapping[str, float]], dict[str, Array]]


@dataclass(frozen=True)
class OtherEnding:
    """What a run would be if its delivery ended the other way: largest difference of torque [N m], where [rad]."""

    structure: str
    difference: float
    angle: float


@dataclass(frozen=True)
class Forecast(ReadOnly):
    """A predicted run at one speed.

    Attributes
    ----------
    speed : [rad/s]
    theta : (n,) cam angle as a recording of the load has it [rad]
    torque, torque_std : (n,) shaft torque [N m], total standard uncertainty
    shape_std : (n,) the same less what is one constant over the revolution, such as drag that no fitted recording tells
        from its zero [N m]: a measured torque whose zero is set to the prediction's lies within it
    mean_std : of the mean torque [N m]
    by_cause, by_cause_std : cause -> (n,) [N m]; the law's error is not split over causes
    pressure, pressure_std : (n,) on the plunger [Pa]
    contact, contact_std : (n,) contact force normal to the cam [N], friction of a follower that stands in its std
    plunger_force : (n,) of packing, drag and the spring's errors, against the lift [N]
    true_angle : (n,) [rad]
    flow : (n,) from the chamber to the line [m^3/s]
    delivered, delivered_std : volume that leaves the chamber for the line in a stroke [m^3]
    law_share : rms of the law's error as a share of the peak
    beyond : distance from the fitted speeds in ln speed, 0 inside
    ending : how delivery ends: ``land``, ``spill``, ``either`` where nobody knows, ``line`` where it is not seen
    both : where nobody knows how it ends: the run with one ending and with the other
    other : what it would be if it ended the other way, None where that is known or makes no difference
    steps : whether the model steps within what the fit leaves open, as beside a valve near chattering
    assumed : sentences on what was assumed
    """

    speed: float
    theta: Array
    torque: Array
    torque_std: Array
    shape_std: Array
    mean_std: float
    by_cause: Mapping[str, Array]
    by_cause_std: Mapping[str, Array]
    pressure: Array
    pressure_std: Array
    contact: Array
    contact_std: Array
    plunger_force: Array
    true_angle: Array
    flow: Array
    delivered: float
    delivered_std: float
    law_share: float
    beyond: float
    ending: str
    both: tuple[Forecast, ...] = ()
    other: OtherEnding | None = None
    steps: bool = False
    assumed: tuple[str, ...] = ()

    @property
    def least_contact(self) -> float:
        """Least contact force, of either run where nobody knows how delivery ends; below 0 the cam pulls [N]."""
        return min(float(np.min(one.contact)) for one in self.both or (self,))

    @property
    def take_off(self) -> float | None:
        """Cam angle at which the follower leaves the cam in its longest pull, None where it stays on it [rad]."""
        pulled = np.any([pulls(one.contact) for one in self.both or (self,)], axis=0)
        starts = np.flatnonzero(pulled & ~np.roll(pulled, 1))
        if not starts.size:  # a cam that pulls all around has no begin
            return float(self.theta[0]) if pulled[0] else None
        lengths = [int(np.argmin(np.roll(pulled, -start))) for start in starts]
        return float(self.theta[starts[int(np.argmax(lengths))]])


def forecast(
    known: KnownFit, chain: ChainInput, source: FittedAt, load: LoadKnowledge, changes: Mapping[str, float]
) -> Forecast:
    """Return a run at the speed and line pressure of a chain.

    Parameters
    ----------
    chain : pump, cam, speed and line pressure; its torque is ignored
    source : fitted recording whose own parameters stand in
    load : what is known of the load beside the line pressure of the chain
    changes : parameter -> factor, such as a leakage after wear
    """
    center, scatters, stepping = _spread(known, chain, source, load, changes)
    std = least_std(scatters)
    if known.predictive is not known.covariance:
        # the error of the laws is added to the torque alone: all else is as unsure as the fit states
        stated = least_std(_spread(replace(known, residual_covariance=None), chain, source, load, changes)[1])
        std |= {name: np.maximum(std[name], stated[name]) for name in center if name not in OF_TORQUE}
    # a friction at rest is as likely anywhere between both directions
    std["contact"] = np.sqrt(std["contact"] ** 2 + (center["held"] ** 2 + std["held"] ** 2) / 3.0)
    share, beyond = law_share(known, chain.speed)
    torque = center["torque"]
    law = law_std(torque, share)
    if known.lift is not None:
        std["cause lift_table"] = np.abs(center["load"]) * known.lift.slope_stderr(center["angle"])
        law = np.hypot(law, std["cause lift_table"])
    total = np.hypot(std["torque"], law)
    shape = np.min([shape_of(item.torque, total) for item in scatters], axis=0)
    causes = [name for name in center if name.startswith("cause ")]
    found = Forecast(
        speed=chain.speed, theta=chain.theta, torque=torque, torque_std=total,
        shape_std=np.hypot(shape, law), mean_std=float(std["mean"]),
        by_cause={name[6:]: center[name] for name in causes}, by_cause_std={name[6:]: std[name] for name in causes},
        pressure=center["pressure"], pressure_std=std["pressure"], contact=center["contact"],
        contact_std=std["contact"], plunger_force=center["plunger_force"], true_angle=center["angle"],
        flow=center["flow"], delivered=float(center["delivered"]),
        delivered_std=float(std["delivered"]), law_share=share, beyond=beyond,
        ending=source.structure, steps=stepping,
    )  # fmt: skip
    return found if chain.swing is None else _over_cam(found, chain, chain.swing)


def _over_cam(item: Forecast, chain: ChainInput, swing: Swing) -> Forecast:
    """Return a run over even angle as one over cam angle."""

    def at(values: Array) -> Array:
        return at_cam_angles(chain, values, chain.theta.size)

    by_cause, by_cause_std = (
        {name: at(part) for name, part in parts.items()} for parts in (item.by_cause, item.by_cause_std)
    )
    return replace(
        item, torque=at(item.torque), torque_std=at(item.torque_std), shape_std=at(item.shape_std), by_cause=by_cause,
        by_cause_std=by_cause_std, pressure=at(item.pressure), pressure_std=at(item.pressure_std),
        contact=at(item.contact), contact_std=at(item.contact_std), plunger_force=at(item.plunger_force),
        true_angle=swing.even(chain.theta.size) + at(item.true_angle - chain.theta), flow=at(item.flow),
    )  # fmt: skip


def _spread(
    known: KnownFit, chain: ChainInput, source: FittedAt, load: LoadKnowledge, changes: Mapping[str, float]
) -> tuple[Mapping[str, Array], tuple[Scatter, ...], bool]:
    """Return the curves of a run, scatters by what the fit leaves open, whether the model steps within that.

    Of the scatters the smallest counts; parameters as in `forecast`.

    Where the model steps within that, the best values may lie on the rare side of the step: the curves are then those
    of the drawn run nearest to the median torque, and the scatter is that of whole standard deviations about it.
    """
    places = known.own(source.id)
    mean = {name: float(known.values[k]) for name, k in places.items()}
    mean.update({"torque_zero": 0.0, "pressure_zero": 0.0, **{name: end.value for name, end in load.ends.items()}})
    parts = partial(_parts, lift=known.lift)

    def drawn(fraction: float) -> list[dict[str, float]]:
        return [values_of(item, source, changes) for item in draws(known, places, mean, load, fraction, DRAWS)]

    def about(best: Mapping[str, float], fractions: Sequence[float]) -> tuple[Mapping[str, Array], tuple[Scatter, ...]]:
        at = settled(chain, best)
        return parts(at, best), tuple(
            _scatter(parts, at, drawn(fraction), best, fraction * load.pressure_std, fraction) for fraction in fractions
        )

    center, (small, whole) = about(values_of(mean, source, changes), FRACTIONS)
    if not steps(small.torque[:DRAWS], whole.torque[:DRAWS]):
        return center, (small, whole), False
    return *about(drawn(1.0)[middle(whole.torque[:DRAWS])], (1.0,)), True


@dataclass(frozen=True)
class Scatter:
    """Standard deviations of all curves, and by how far each draw moved the torque, (m, n) [N m]."""

    std: dict[str, Array]
    torque: Array


def least_std(scatters: Sequence[Scatter]) -> dict[str, Array]:
    """Return the smallest of some scatters, curve by curve and angle by angle."""
    return {name: np.min([item.std[name] for item in scatters], axis=0) for name in scatters[0].std}


def _scatter(
    parts: Parts, chain: ChainInput, drawn: Sequence[Mapping[str, float]], best: Mapping[str, float],
    pressure: Array, fraction: float,
) -> Scatter:  # fmt: skip
    """Return how far drawn values, and a line pressure moved by ``pressure`` (n,), move the curves."""
    center, found = parts(chain, best), [parts(chain, item) for item in drawn]
    moved = {name: np.array([item[name] - middle for item in found]) / fraction for name, middle in center.items()}
    if pressure.size:
        other = parts(replace(chain, line_pressure=chain.line_pressure + pressure), best)
        weight = np.sqrt(len(found)) / fraction  # one more draw that counts as much as all others
        moved = {name: np.vstack([rows.reshape(len(found), -1), weight * (other[name] - center[name])])
                 for name, rows in moved.items()}  # fmt: skip
    std = {
        name: np.sqrt(np.sum(rows**2, axis=0) / len(found)).reshape(center[name].shape) for name, rows in moved.items()
    }
    return Scatter(std, moved["torque"])


def shape_of(moved: Array, std: Array) -> Array:
    """Return the scatter of drawn torques, (m, n), less the constant of each where the torque is sure."""
    constant = moved @ std**-2.0 / np.sum(std**-2.0)
    return np.asarray(np.sqrt(np.sum((moved - constant[:, None]) ** 2, axis=0) / DRAWS))


def values_of(
    values: Mapping[str, float], source: FittedAt, changes: Mapping[str, float] = MappingProxyType({})
) -> dict[str, float]:
    """Return every parameter of the chain; ends that the structure does not have are switched off."""
    full = {**WITHOUT, **{name: value for name, value in values.items() if name in WITHOUT}}
    off = {"land": SPILL_NAMES, "spill": LAND_NAMES}.get(source.structure, (*LAND_NAMES, *SPILL_NAMES))
    full.update({name: NEUTRAL[name] for name in off})
    return {name: value * changes.get(name, 1.0) for name, value in full.items()}


def settled(chain: ChainInput, values: Mapping[str, float]) -> ChainInput:
    """Return the chain whose twist is that of its own torque, with time steps fine where the valve moves.

    Raises
    ------
    Refusal : the torque runs away
    """
    linear = coefficients_of(values)
    for _ in range(ROUNDS):
        output = evaluate(chain, values, linear)
        torque = output.torque + output.linear @ linear
        if not np.all(np.isfinite(torque)):
            raise Refusal(
                f"predict: the model has no finite torque at {chain.speed * 30.0 / np.pi:.0f} rpm, expected a speed "
                "near the fitted ones; ask for other speeds"
            )
        centres = (np.arange(torque.size) + 0.5) * 2.0 * np.pi / torque.size
        shaft = np.interp(chain.theta, centres, torque, period=2.0 * np.pi)
        chain = replace(chain, shaft_torque=shaft, substeps=with_substeps(chain, output, values))
    return chain


def _parts(chain: ChainInput, values: Mapping[str, float], lift: SharedLift | None) -> dict[str, Array]:
    """Return torque, causes, pressure, contact forces and cam angle of one set of values, (n,) each."""
    linear = coefficients_of(values)
    output: ChainOutput = evaluate(chain, values)
    slope = np.zeros(chain.theta.size) if lift is None else lift.slope(output.motion.theta)
    torques, force = cam_torques(chain, values, output, linear, slope)
    causes = measured_torques(chain, values, torques, linear)
    left_out = ("torque_zero", "lift_table") if lift is None else ("torque_zero",)
    named = {f"cause {name}": part for name, part in causes.items() if name not in left_out}
    torque = np.asarray(np.sum(list(causes.values()), axis=0))
    pressure = stated_pressure(chain, output)
    calmed = replace(output, load=output.load + chain.pump.plunger_area * (pressure - output.pressure))
    along, normal, held = contact_load(chain, values, calmed, linear, force)
    return {
        **named, "torque": torque, "mean": np.array(np.mean(torque)), "pressure": pressure,
        "load": along, "contact": normal, "held": held, "plunger_force": force, "angle": output.motion.theta,
        "flow": output.flows[:, SEAT_FLOW], "delivered": np.array(stroke_volume(chain, values, output)),
    }  # fmt: skip


def stroke_volume(chain: ChainInput, values: Mapping[str, float], output: ChainOutput) -> float:
    """Return the volume that leaves the chamber for the line in a stroke, at zero gauge pressure [m^3].

    A cam of several lobes makes as many strokes a revolution: it is their mean. The model's gallery begins a revolution
    at the chamber's pressure, a pump's keeps its own: what stays in it counts.
    """
    fluid = (values["bulk_modulus"] / BAR, values["bulk_modulus_slope"], values["free_air"])
    first, last = (1.0 / specific_volume(output.states[place, 0], *fluid)[0] for place in (0, -1))
    kept = values["gallery_volume"] * (last - first)
    revolution = float(np.mean(output.flows[:, SEAT_FLOW])) * 2.0 * np.pi / chain.speed + kept
    return revolution / stroke_count(output.motion.lift[0])
