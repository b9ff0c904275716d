"""One recording: means, search, polish, structures, relaxed variant, evidence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.align.budget import SWITCHING_DELAY
from camtorque.fit.evidence import NEEDED, NOT_NEEDED, loss_evidence
from camtorque.fit.prepare import INDEPENDENT, MeanCycles, fit_data, mean_cycles, other_half
from camtorque.fit.problem import STRUCTURES, FitData, Problem, build_problem, with_starts
from camtorque.fit.search import search
from camtorque.fit.solver import Solution, solve, try_at
from camtorque.fit.starts import Start, on_other_half, refined
from camtorque.fit.uncertainty import Covariance, covariance
from camtorque.laws.causes import cam_torques, filtered_out_torque
from camtorque.laws.chain import BINS, binned
from camtorque.mechanism.spectral import spectral_law
from camtorque.records import Array, CamCycles, LossEvidence, Recording, Refusal, RigidTorque
from camtorque.units import DEGREE

POLISHED = 3
"""Starts that are followed to their minimum on the fine grid."""
FILTER_ROUNDS = 2
RELAXED_TIME = 2.5e-3
"""Time over which what the delivery valve does after it opens is not trusted in the relaxed variant [s]."""
RELAXED_SHARE = 0.5
"""Torque error there, as a share of the torque of the opening pressure."""
POLISH_ITERATIONS = 40
SWITCHING = "switching delay of the trigger"


@dataclass(frozen=True)
class FitOptions:
    """What a user may choose.

    seed : of random numbers
    evidence : whether each loss is weighed (a campaign's joint fit weighs none)
    """

    seed: int = 0
    evidence: bool = True


@dataclass(frozen=True)
class Candidate:
    """One structure (or minimum) followed to its end on the fine grid.

    ``unseen``: what chi-square rises by, as the mean over both halves of the cycles, where the other half is asked too
    """

    data: FitData
    problem: Problem
    solution: Solution
    unseen: float = 0.0

    @property
    def value(self) -> float:
        """Chi-square with priors."""
        return self.solution.chi_square + self.unseen


@dataclass(frozen=True)
class Prepared:
    """One recording with its best minimum of each structure, least chi-square first."""

    recording: Recording
    cycles: CamCycles
    rigid: RigidTorque
    means: MeanCycles
    candidates: tuple[Candidate, ...]
    measured: Array


@dataclass(frozen=True)
class Fit:
    """Everything that the fit of one or several recordings consists of.

    ``shifts`` are further standard uncertainties by source, (k,) each [SI]; ``pressure_shifts`` those of the chamber
    pressure by recording, (n_shift, n) [Pa]; ``probabilities`` of the candidates; ``measured`` the mean torque of each
    recording on the grid of the fit [N m]; ``pressure_gain_std`` relative, of each recording.
    """

    problem: Problem
    solution: Solution
    covariance: Covariance
    shifts: Mapping[str, Array]
    pressure_shifts: tuple[Array, ...]
    candidates: tuple[Candidate, ...]
    probabilities: tuple[float, ...]
    evidence: tuple[LossEvidence, ...]
    measured: tuple[Array, ...]
    pressure_gain_std: tuple[float, ...]

    @property
    def std(self) -> Array:
        """Total standard uncertainty, (k,) [SI]."""
        return np.sqrt(self.covariance.std**2 + sum(shift**2 for shift in self.shifts.values()))


def prepare(recording: Recording, cycles: CamCycles, rigid: RigidTorque) -> Prepared:
    """Return a recording with the minimum of every structure found."""
    means = mean_cycles(cycles)
    law = spectral_law(recording.cam_table)
    data = fit_data(recording, cycles, law, means.torque, means.pressure, means.scatter_of_mean)
    held = other_half(data, means)
    found = search(data, held, tuple(STRUCTURES))
    ends = polished(data, found)
    seen_twice = (attempted(judged, item, data, held) for item in ends)
    kept = sorted((item for item in seen_twice if item is not None), key=lambda item: item.value)
    return Prepared(recording, cycles, rigid, means, tuple(kept) or ends, data.chain.shaft_torque)


def judged(item: Candidate, data: FitData, held: FitData) -> Candidate:
    """Return a minimum with what it is worth on the half of the cycles that it was not fitted to.

    A delivery valve near chattering can be tuned to follow one mean cycle and be far off on the next: such a minimum is
    not the better one for its lower chi-square.
    """
    lost = item.data.chain.shaft_torque - data.chain.shaft_torque
    problem = build_problem([on_other_half(item.data, held, lost)])
    trial = try_at(problem, item.solution.z, item.solution.lifts)
    return replace(item, unseen=0.5 * (trial.data_chi_square - item.solution.data_chi_square))


def polished(data: FitData, found: Mapping[str, list[Start]]) -> tuple[Candidate, ...]:
    """Return the best starts of all structures at their minima on the fine grid, least chi-square first."""
    best = min((group[0].chi_square for group in found.values() if group), default=0.0)
    starts = sorted((start for group in found.values() for start in group[:2]), key=lambda start: start.chi_square)
    kept = [start for start in starts if start.chi_square < 10.0 * best + 300.0][:POLISHED]
    others = [group[0] for group in found.values() if group and all(group[0] is not start for start in kept)]
    followed_ends = [attempted(followed, data, start) for start in kept]
    ends = sorted((item for item in followed_ends if item is not None), key=lambda item: item.value)
    if not ends:
        raise Refusal(
            f"{data.name}: found no start from which the model of this pump can be fitted, expected one; the recording "
            "may belong to another pump or trigger: `camtorque check` compares them"
        )
    ends = [attempted(with_filtered_out_torque, ends[0]) or ends[0], *ends[1:]]
    quick = [attempted(followed, data, start, 5) for start in others]
    return tuple(sorted([*ends, *(item for item in quick if item is not None)], key=lambda item: item.value))


def attempted(fit: Callable[..., Candidate], *arguments: object) -> Candidate | None:
    """Return a fit, None where it runs to a point at which the tangents of the model overflow."""
    try:
        return fit(*arguments)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None


def followed(data: FitData, start: Start, iterations: int = POLISH_ITERATIONS) -> Candidate:
    """Return the minimum that a start leads to on the fine grid."""
    item = replace(start.data, lift_basis=data.lift_basis, chain=replace(
        data.chain, uses_chamber=start.data.structure != "line", substeps=np.zeros(0, dtype=np.int64)
    ))  # fmt: skip
    problem = build_problem([item])
    item = refined(item, problem.values(problem.start, 0)[0])
    return at_minimum(item, iterations)


def at_minimum(item: FitData, iterations: int = POLISH_ITERATIONS) -> Candidate:
    """Return a recording at the minimum that its own start leads to."""
    problem = build_problem([item])
    solution = solve(problem, None, iterations)
    starts = {parameter.row.name: float(z) for parameter, z in zip(problem.parameters, solution.z, strict=True)}
    item = with_starts(item, starts)
    return Candidate(item, build_problem([item]), solution)


def with_filtered_out_torque(found: Candidate) -> Candidate:
    """Return the minimum with the shaft's torque corrected for what the transducer's low-pass takes away.

    One fixed-point step a round; with stiff shafts it changes nothing that counts.
    """
    measured = found.data.chain.shaft_torque
    for _ in range(FILTER_ROUNDS):
        values, coefficients = found.problem.values(found.solution.z, 0)
        output = found.solution.outputs[0]
        torques = cam_torques(found.data.chain, values, output, coefficients, np.zeros(measured.size))
        lost = filtered_out_torque(found.data.chain, values, torques)
        item = replace(found.data, chain=replace(found.data.chain, shaft_torque=measured + lost))
        item = refined(item, values)
        found = at_minimum(item)
    return found


def fit_prepared(prepared: Prepared, options: FitOptions) -> Fit:
    """Return the full model of one recording with its uncertainty and the evidence for each loss."""
    best = prepared.candidates[0]
    problem, solution = best.problem, best.solution
    cov = covariance(problem, solution)
    probabilities = structure_probabilities(prepared.candidates, cov.inflation)
    shifts, pressures = {}, []
    relaxed = relaxed_variant(best)
    shifts["what the delivery valve does as it opens"] = relaxed.solution.z - solution.z
    pressures.append(relaxed.solution.outputs[0].pressure - solution.outputs[0].pressure)
    shifts["other structures"], moved = structure_spread(prepared.candidates, probabilities)
    pressures.append(moved)
    shifts[SWITCHING] = switching_shift(problem, switching_std(prepared.cycles))
    odd_even = float(np.sqrt(np.mean((prepared.means.torque - prepared.means.held_torque) ** 2)))
    evidence: tuple[LossEvidence, ...] = ()
    if options.evidence:
        evidence = (
            chamber_evidence(prepared.candidates, cov.inflation),
            *loss_evidence(problem, solution, cov, odd_even),
        )
    gain = pressure_gain_std(prepared.recording)
    shifts["gain of the pressure sensor"] = pressure_gain_shift(best, gain)
    return Fit(
        problem, solution, cov, shifts, (np.array(pressures),), prepared.candidates, probabilities, evidence,
        (prepared.measured,), (gain,),
    )  # fmt: skip


def switching_shift(problem: Problem, angle: float) -> Array:
    """Return how far one standard deviation of the trigger's switching delay moves each parameter, (k,) [SI].

    The pulse comes that much later than the tooth, and the fit finds the pulse.
    """
    shift = np.zeros(problem.size)
    shift[problem.index("trigger_offset")] = angle
    return shift


def switching_std(cycles: CamCycles) -> float:
    """Return the standard uncertainty of the trigger's switching delay as an angle [rad], 0 where none is known."""
    return next((row.std_deg * DEGREE for row in cycles.angle_errors if row.source == SWITCHING_DELAY), 0.0)


def pressure_gain_std(recording: Recording) -> float:
    """Return the relative standard uncertainty of the pressure's gain, 0 where no certificate tells it."""
    sheet = recording.of("pressure")[0].calibration
    return float(sheet.gain_relative_std) if sheet is not None and np.isfinite(sheet.gain_relative_std) else 0.0


def pressure_gain_shift(best: Candidate, relative_std: float) -> Array:
    """Return how far one standard deviation of the pressure's gain moves each parameter, (k,) [SI]."""
    if not relative_std:
        return np.zeros(best.problem.size)
    chain = replace(best.data.chain, line_pressure=best.data.chain.line_pressure * (1.0 + relative_std))
    moved = attempted(at_minimum, replace(best.data, chain=chain), 4) or best
    return moved.solution.z - best.solution.z


def structure_probabilities(candidates: tuple[Candidate, ...], inflation: float) -> tuple[float, ...]:
    """Return how probable the candidates are, by their chi-square under the best one's inflation."""
    chi = np.array([item.value for item in candidates]) / inflation
    weight = np.exp(-0.5 * (chi - np.min(chi)))
    return tuple((weight / np.sum(weight)).tolist())


def structure_spread(candidates: tuple[Candidate, ...], probabilities: tuple[float, ...]) -> tuple[Array, Array]:
    """Return the standard deviation that the other structures add to each parameter and to the chamber pressure."""
    best = candidates[0]
    names = best.problem.names
    variance = np.zeros(len(names))
    pressure = np.zeros(best.data.chain.theta.size)
    for item, probability in zip(candidates[1:], probabilities[1:], strict=True):
        if probability < 1e-4:
            continue
        values = dict(zip(item.problem.names, item.solution.z.tolist(), strict=True))
        delta = np.array([values.get(name, z) - z for name, z in zip(names, best.solution.z, strict=True)])
        variance += probability * delta**2
        pressure += probability * (item.solution.outputs[0].pressure - best.solution.outputs[0].pressure) ** 2
    return np.sqrt(variance), np.sqrt(pressure)


def relaxed_variant(best: Candidate) -> Candidate:
    """Return the fit that does not trust the law of the delivery valve just after it opens."""
    item, output = best.data, best.solution.outputs[0]
    chain = item.chain
    values, _ = best.problem.values(best.solution.z, 0)
    if not chain.uses_chamber:
        return best
    opened = int(np.argmax(output.flows[:, 2] > 0.02 * np.max(output.flows[:, 2])))
    since = (chain.theta - chain.theta[opened]) / chain.speed
    fading = np.where(since >= 0.0, np.exp(-np.maximum(since, 0.0) / RELAXED_TIME), 0.0)
    area = chain.pump.plunger_area
    error = RELAXED_SHARE * values["valve_opening"] * area * np.abs(output.motion.lift[1]) * fading
    variance = 1.0 / item.weight**2 + binned(error) ** 2 * (BINS / INDEPENDENT)
    return attempted(at_minimum, replace(item, weight=1.0 / np.sqrt(variance)), 15) or best


def chamber_evidence(candidates: tuple[Candidate, ...], inflation: float) -> LossEvidence:
    """Return the evidence for a chamber whose pressure is not the line's."""

    def least(kinds: tuple[str, ...]) -> Candidate | None:
        found = [item for item in candidates if item.data.structure in kinds]
        return min(found, key=lambda item: item.value) if found else None

    line, chamber = least(("line",)), least(("land", "spill", "open"))
    if line is None or chamber is None:
        return LossEvidence("chamber", np.nan, "cannot tell", False, np.nan, (np.nan, np.nan), "N m", "not compared")
    factor = (line.value - chamber.value) / inflation - np.log(INDEPENDENT) * 4.0
    verdict = "needed" if factor > NEEDED else "not needed" if factor < NOT_NEEDED else "cannot tell"
    weight = line.data.weight
    size = float(np.sqrt(np.mean(((line.solution.residuals[0] - chamber.solution.residuals[0]) / weight) ** 2)))
    text = f"a chamber apart from the line moves the torque by {size:.2g} N m rms (2 ln K = {factor:.0f})"
    return LossEvidence("chamber", float(factor), verdict, True, size, (size, size), "N m", text)
