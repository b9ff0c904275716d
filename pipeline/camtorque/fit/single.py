"""One recording: its minima, stage by stage, then how sure the best one is and which losses the data need.

A stage takes minima, the best one first, and hands them on so; what each is for, and the decision in docs/decisions
that holds its measurements:

=======================  ==================================================================================  ==========
`told_otherwise`         all anew by what a wheel says of the swing, where the driveline's law does not hold  0193
`search`                 minima of all structures from many starts, moves of the best one and hops           0058, 0087
`every_structure`        one of each structure, so that they can be compared                                 0152
`with_lost_torque`       what the transducer's low-pass takes away twists the shaft all the same             0094
`turned_round`           what no small step leads to: one thing at a time the other way round                0118, 0120
`profile_trigger_angle`  a deeper place in the bent valley of the trigger angle, and how wide that is        0094, 0095
`with_oil_at_rest`       the same again without the oil up to the sensor, where much is left to explain      0123
`distinct`               each basin once: what differs stays among what is compared                          0118
`weighed_locally`        where laws are missing the residual weighs less                                     0155
`kinds_decided`          a part's other kind, if it is the likelier one; else beside the best one       0158, 0187
`softer_shaft`           a stiff shaft that yields more, beside the best one                                 0159
=======================  ==================================================================================  ==========
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from camtorque.align.budget import SWITCHING_DELAY, wandered_std
from camtorque.fit.descent import Effort
from camtorque.fit.fitted import FittedParameters
from camtorque.fit.kinds import (
    KINDS,
    PIN,
    OtherFit,
    chamber_evidence,
    kinds_decided,
    structure_probabilities,
    structure_spread,
    weighed_losses,
)
from camtorque.fit.local_error import weighed_locally
from camtorque.fit.minima import (
    Candidate,
    Halves,
    at_minimum,
    attempted,
    beside,
    distinct,
    followed,
    in_bins_of,
    with_its_lost_torque,
)
from camtorque.fit.prepare import FINER_BINS, INDEPENDENT, MeanCycles, fit_data, mean_cycles, other_half, passages_of
from camtorque.fit.problem import Problem, with_rows
from camtorque.fit.residual import explains
from camtorque.fit.search import DISSATISFYING, SearchState, search
from camtorque.fit.sheet_doubts import SheetDoubt, sheet_doubts
from camtorque.fit.solver import Solution
from camtorque.fit.teeth import SWINGS_OTHERWISE, WHEEL_ORDERS, told_otherwise
from camtorque.fit.uncertainty import (
    along_valley,
    covariance,
    delivering,
    deviation_within,
    narrowed,
    posterior_at,
    pressure_jacobian,
    pressure_moved_to,
)
from camtorque.fit.valleys import TRIGGER_ANGLE, Valley, profile_trigger_angle, softer_shaft, turned_round
from camtorque.laws.chain import binned
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.lift_laws import spectral_law
from camtorque.process.second_process import in_two
from camtorque.records import Array, CamCycles, LossEvidence, Recording, Refusal, RigidTorque
from camtorque.units import DEGREE

RELAXED_TIME = 2.5e-3
"""Time over which what the delivery valve does after it opens is not trusted in the relaxed variant [s]."""
RELAXED_SHARE = 0.5
"""Torque error there, as a share of the torque of the opening pressure."""
SWITCHING = "switching delay and clock of the trigger"
BENT = "valley of the trigger angle beyond its slope at the minimum"
SOFTER = "valley of a stiff shaft's compliance"
MINIMA = 5
"""Minima that are compared at most."""
AT_REST = 1.0e3
"""Inertance that moves nothing [kg/m^4]."""


@dataclass(frozen=True)
class Prepared:
    """One recording with its minima, least chi-square first, and the valley of the best one along the trigger angle.

    ``wheel_orders`` of the cam's swing are those of a wheel, 0 where the driveline's law rebuilds all (`teeth`).
    ``other_kinds`` are the best one with the less probable kind of a part, by its name, ``softer_shaft`` with a stiff
    shaft that yields by a standard deviation more.
    """

    recording: Recording
    cycles: CamCycles
    rigid: RigidTorque
    means: MeanCycles
    candidates: tuple[Candidate, ...]
    valley: Valley
    measured: Array
    other_kinds: Mapping[str, OtherFit] = field(default_factory=dict)
    softer_shaft: Candidate | None = None
    wheel_orders: int = 0


@dataclass(frozen=True)
class Fit(FittedParameters):
    """Everything that the fit of a recording consists of.

    ``pressure_shifts`` are further deviations of the chamber pressure, (m, n) [Pa]; ``probabilities`` of the
    candidates; ``measured`` the mean torque on the grid of the fit, (n,) [N m]; ``pressure_gain_std`` relative;
    ``doubts`` of what is stated.
    """

    solution: Solution
    pressure_shifts: Array
    candidates: tuple[Candidate, ...]
    probabilities: tuple[float, ...]
    evidence: tuple[LossEvidence, ...]
    measured: Array
    pressure_gain_std: float
    doubts: tuple[SheetDoubt, ...]


def prepare(recording: Recording, cycles: CamCycles, rigid: RigidTorque) -> Prepared:
    """Return a recording with the minima found and how far the trigger angle moves along the valley of the best one."""
    means, orders = mean_cycles(cycles), 0
    law = spectral_law(recording.cam_table)
    minima, halves = searched(recording, cycles, law, means)
    passed = passages_of(recording.config, cycles.details)
    if told_otherwise(minima[0].solution.output.motion, minima[0].data.chain, passed) > SWINGS_OTHERWISE:
        orders = WHEEL_ORDERS
        minima, halves = searched(recording, cycles, law, means, orders)
    if minima[0].left_to_explain > DISSATISFYING and not halves.fitted.measures_chamber:
        minima = with_oil_at_rest(minima, halves)
    weighed, other_kinds = kinds_decided(weighed_locally(distinct(minima), halves, means.odd_even), halves, KINDS)
    best, valley = profile_trigger_angle(weighed[0], halves)
    kept = distinct([best, *weighed])
    softer = softer_shaft(best, halves)
    torque = halves.fitted.chain.shaft_torque
    return Prepared(recording, cycles, rigid, means, kept, valley, torque, other_kinds, softer, orders)


def searched(
    recording: Recording, cycles: CamCycles, law: CamLaw, means: MeanCycles, orders: int = 0
) -> tuple[list[Candidate], Halves]:
    """Return `search_minima`, in finer bins where the best one rings between the usual ones, and what they are of."""
    data = fit_data(recording, cycles, law, means, orders=orders)
    halves = Halves(data, other_half(data, means))
    minima = search_minima(halves)
    if minima[0].rings_between_bins and cycles.theta.size >= FINER_BINS:
        data = fit_data(recording, cycles, law, means, FINER_BINS, orders)
        halves = Halves(data, other_half(data, means))
        near = in_bins_of(halves, distinct(minima))
        sound = bool(near) and explains(near[0].data, near[0].solution, means.odd_even)
        minima = near if sound else search_minima(halves)
    return minima, halves


def search_minima(halves: Halves) -> list[Candidate]:
    """Return all minima that a search ends at, the best one first."""
    minima = every_structure(search(halves, halves.fitted.structures), halves)
    minima = turned_round(with_lost_torque(minima, halves), halves)
    return [reconverged(minima[0], halves), *minima[1:]]


def with_lost_torque(minima: list[Candidate], halves: Halves) -> list[Candidate]:
    """Return minima with the best one as it is with the torque that is lost at it, where that is better."""
    corrected = halves.minimum(with_its_lost_torque, minima[0], halves.fitted.chain.shaft_torque)
    return [corrected, *minima[1:]] if corrected and corrected.value < minima[0].value else minima


def reconverged(found: Candidate, halves: Halves) -> Candidate:
    """Return where the descent to a minimum ends, if it was left before it had settled."""
    return found if found.solution.converged else halves.again(found)


def with_oil_at_rest(minima: list[Candidate], halves: Halves) -> list[Candidate]:
    """Return `search_minima` with what a search finds whose oil up to the sensor stays at rest, where that is better.

    Search and parameters are the same but for one that is not there, so that other basins are found.
    """
    data = halves.fitted
    upper = data.rows["line_inertance"].upper
    resting = replace(halves, fitted=with_rows(data, {"line_inertance": {"upper": AT_REST}}))
    still = search_minima(resting)[0]
    freed = halves.minimum(at_minimum, with_rows(still.data, {"line_inertance": {"upper": upper}}))
    return minima if freed is None or freed.value > minima[0].value else [freed, *minima]


def every_structure(found: SearchState, halves: Halves) -> list[Candidate]:
    """Return minima that differ and one of every structure that has starts, least chi-square first."""
    data = halves.fitted
    ends = list(distinct([item for _, item in found.minima])[:MINIMA])
    rest = [group[0] for name, group in found.starts.items()
            if group and all(item.data.structure != name for item in ends)]  # fmt: skip
    follow = partial(followed, data, effort=beside(found.value))
    ends += [end for end in in_two(partial(halves.minimum, follow), rest) if end]
    if not ends:
        raise Refusal(
            f"{data.name}: found no start from which the model of this pump can be fitted, expected one; the recording "
            "may belong to another pump or trigger: `camtorque check` compares them"
        )
    return sorted(ends, key=lambda item: item.value)


def fit_prepared(prepared: Prepared, weighed: bool = True) -> Fit:
    """Return the full model of one recording with its uncertainty; ``weighed``: with the evidence for each loss."""
    best = prepared.candidates[0]
    problem, solution = best.problem, best.solution
    careful = covariance(problem, solution)
    # the inflation by the weights alone: a structure with more parameters always leaves less
    probabilities = structure_probabilities(prepared.candidates, careful.inflation)
    cov = narrowed(careful, solution)
    deviation = deviation_within(posterior_at(problem, solution, cov.matrix, cov.inflation), solution.z)
    along = along_valley(deviation, problem.index(TRIGGER_ANGLE), prepared.valley.std(cov.inflation))
    shifts, pressures = {BENT: along[None]}, [pressure_moved(best, along)]
    for source, variant, known, share in variants(prepared):
        shifts[source] = share * (variant.solution.z - known.solution.z)[None]
        pressures.append(share * pressure_moved_to(known.solution.output, variant.solution.output))
    shifts["other structures"], moved = structure_spread(prepared.candidates, probabilities)
    pressures.extend(moved)
    shifts[SWITCHING] = switching_shift(problem, [switching_std(prepared.cycles)])[None]
    evidence: tuple[LossEvidence, ...] = ()
    if weighed:
        evidence = weighed_losses(best, prepared.other_kinds, cov)
        if not best.data.measures_chamber:
            evidence = (chamber_evidence(prepared.candidates, careful.inflation), *evidence)
    gain = pressure_gain_std(prepared.recording)
    shifts["gain of the pressure sensor"] = pressure_gain_shift(best, gain)[None]
    pin = prepared.other_kinds.get(PIN)
    return Fit(
        problem, solution, cov, deviation, shifts, pin.probability if pin else 0.0, np.array(pressures),
        prepared.candidates, probabilities, evidence,
        prepared.measured, gain, sheet_doubts(best, cov.inflation),
    )  # fmt: skip


def variants(prepared: Prepared) -> Iterator[tuple[str, Candidate, Candidate, float]]:
    """Yield pairs of fits: their name, what differs, from what, and what share of their distance is a deviation."""
    best = prepared.candidates[0]
    yield "what the delivery valve does as it opens", relaxed_variant(best), best, 1.0
    for name, other in prepared.other_kinds.items():
        yield name, other.candidate, other.beside, math.sqrt(other.probability)
    if prepared.softer_shaft is not None:
        yield SOFTER, prepared.softer_shaft, best, 1.0


def pressure_moved(best: Candidate, shift: Array) -> Array:
    """Return how far a shift of the parameters (k,) [SI] moves the chamber pressure, (n,) [Pa]."""
    jacobian, places = pressure_jacobian(best.problem, best.solution.output)
    return np.asarray(jacobian @ shift[places])


def switching_shift(problem: Problem, angles: Sequence[float]) -> Array:
    """Return how far one standard deviation of the trigger's switching delay moves each parameter, (k,) [SI].

    The pulse comes that much later than the tooth, and the fit finds the pulse.

    Parameters
    ----------
    angles : that deviation in each recording [rad]; of one trigger for all, the mean counts
    """
    shift = np.zeros(problem.size)
    for k, parameter in enumerate(problem.parameters):
        if parameter.row.name == TRIGGER_ANGLE:
            shift[k] = np.mean(angles) if parameter.recording < 0 else angles[parameter.recording]
    return shift


def switching_std(cycles: CamCycles) -> float:
    """Return the standard uncertainty of the trigger's time as an angle [rad]: switching delay, and its clock's."""
    switching = next((row.std_deg * DEGREE for row in cycles.angle_errors if row.source == SWITCHING_DELAY), 0.0)
    return float(np.hypot(switching, wandered_std(cycles.angle_errors, "pressure")))


def pressure_gain_std(recording: Recording) -> float:
    """Return the relative standard uncertainty of the pressure's gain, 0 where no certificate tells it."""
    sheet = recording.of("pressure")[0].calibration
    return float(sheet.gain_relative_std) if sheet is not None and np.isfinite(sheet.gain_relative_std) else 0.0


def pressure_gain_shift(best: Candidate, relative_std: float) -> Array:
    """Return how far one standard deviation of the pressure's gain moves each parameter, (k,) [SI]."""
    if not relative_std:
        return np.zeros(best.problem.size)
    chain = replace(best.data.chain, line_pressure=best.data.chain.line_pressure * (1.0 + relative_std))
    moved = attempted(at_minimum, replace(best.data, chain=chain), Effort(4), best.solution.lift) or best
    return moved.solution.z - best.solution.z


def relaxed_variant(best: Candidate) -> Candidate:
    """Return the fit that does not trust the law of the delivery valve just after it opens."""
    item, output = best.data, best.solution.output
    chain = item.chain
    values, _ = best.problem.values(best.solution.z, 0)
    if not chain.uses_chamber:
        return best
    opened = int(np.argmax(delivering(output)))
    since = (chain.theta - chain.theta[opened]) / chain.speed
    fading = np.where(since >= 0.0, np.exp(-np.maximum(since, 0.0) / RELAXED_TIME), 0.0)
    area = chain.pump.plunger_area
    error = RELAXED_SHARE * values["valve_opening"] * area * np.abs(output.motion.lift[1]) * fading
    variance = 1.0 / item.weight**2 + binned(error, chain.bins) ** 2 * (chain.bins / INDEPENDENT)
    return attempted(at_minimum, replace(item, weight=1.0 / np.sqrt(variance)), Effort(15)) or best
