"""One recording: start, ladder, uncertainty, result."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.bootstrap import bootstrap
from camtorque.fit.budget import pressure_gain_shift
from camtorque.fit.delivery import with_valve_error_at_start
from camtorque.fit.ladder import climb
from camtorque.fit.posterior import sample_posterior
from camtorque.fit.predict import held_out_error
from camtorque.fit.prepare import Halves, fit_data, halves, held_out_data
from camtorque.fit.problem import FitData, build_problem, offered_effects
from camtorque.fit.profiles import Profile, profiles
from camtorque.fit.result import Fit, fitted_torque
from camtorque.fit.solve import solve
from camtorque.fit.starts import SCAN_EFFECTS, find_start, started_at, with_best_coupling
from camtorque.fit.twist import hidden_torque
from camtorque.fit.uncertainty import covariance, spread, variants
from camtorque.mechanism import CamLaw, lift_law
from camtorque.mechanism.spectral import spectral_law
from camtorque.records import CamCycles, FittedTorque, LadderRung, Recording, RigidTorque

BOOTSTRAP_DRAWS = 24
"""Draws of the cycle-block bootstrap: its standard deviations are known to 15 %, enough for a check."""
TWIST_STEPS = 2
TWIST_ITERATIONS = 15
UNTESTED = "untested on other recordings"


@dataclass(frozen=True)
class FitOptions:
    """What a user may choose.

    effects : effects that are offered to the ladder, None for those of `offered_effects`; use_ladder : False keeps all
    posterior_steps : length of the Markov chains of the posterior, 0 for none; seed : of its random numbers
    checks : profile likelihoods and cycle-block bootstrap of a single recording
    """

    effects: tuple[str, ...] | None = None
    use_ladder: bool = True
    posterior_steps: int = 0
    seed: int = 0
    checks: bool = True


@dataclass(frozen=True)
class Prepared:
    """One recording with its start found."""

    recording: Recording
    cycles: CamCycles
    rigid: RigidTorque
    means: Halves
    data: FitData
    held: FitData


def prepare(recording: Recording, cycles: CamCycles, rigid: RigidTorque) -> Prepared:
    """Return a recording whose fit starts in the right basin."""
    means = halves(cycles)
    data = find_start(fit_data(recording, cycles, spectral_law(recording.cam_table), means)).data
    data, held = with_hidden_torque(data, held_out_data(data, means))
    data = with_valve_error_at_start(data, SCAN_EFFECTS)
    return Prepared(recording, cycles, rigid, means, data, held)


def with_hidden_torque(data: FitData, held: FitData) -> tuple[FitData, FitData]:
    """Return both halves with the shaft's torque corrected for what the low-pass hides (see `twist`)."""
    for _ in range(TWIST_STEPS):
        coupled = ("coupling",) if data.rows["coupling_compliance"].start > 0.0 else ()
        problem = build_problem([data], (*SCAN_EFFECTS, *coupled))
        solution = solve(problem, max_iterations=TWIST_ITERATIONS)
        data = started_at(data, problem, solution, 0)
        hidden = hidden_torque(problem, solution, 0, problem.data[0].chain)
        data = replace(data, chain=replace(data.chain, shaft_torque=data.mean_torque + hidden))
        held = replace(held, chain=replace(held.chain, shaft_torque=held.mean_torque + hidden), rows=data.rows)
    return data, held


def other_lift_laws(recording: Recording) -> tuple[CamLaw, ...]:
    """Return other plausible smoothings of the lift table."""
    return (lift_law(recording.cam_table, "smoothing"),)


def with_law(data: FitData, law: CamLaw) -> FitData:
    """Return the recording with another lift law."""
    return replace(data, chain=replace(data.chain, law=law))


def rigid_rung(prepared: Prepared) -> LadderRung:
    """Return the first row of the ladder: line pressure, nominal angle, declared delays, nothing fitted."""
    means, torque = prepared.means, prepared.rigid.torque
    rms = float(np.sqrt(np.mean((means.torque - torque) ** 2)))
    cv_rms = float(np.sqrt(np.mean((means.held_torque - torque) ** 2)))
    return LadderRung((), 0, rms, float("nan"), "not scored", cv_rms, False, "the rigid model, nothing fitted")


def fit_prepared(prepared: Prepared, options: FitOptions) -> Fit:
    """Return the chosen model of one recording with its uncertainty."""
    offered = options.effects if options.effects is not None else offered_effects([prepared.data])
    data, held = with_best_coupling([prepared.data], offered)[0], prepared.held
    if options.use_ladder:
        effects, solution, rungs = climb(
            [data], lambda names, minimum, items: held_out_error(build_problem(items, names), minimum, [held]),
            offered, UNTESTED,
        )  # fmt: skip
        problem = build_problem([data], effects)
        solution = solve(problem, solution.x)
    else:
        problem, rungs = build_problem([data], offered), ()
        solution = solve(problem)
    cov = covariance(problem, solution)
    laws = [[with_law(data, law)] for law in other_lift_laws(prepared.recording)]
    others = variants(problem, solution, laws)
    sampled = None
    if options.posterior_steps:
        sampled = sample_posterior(problem, solution, options.posterior_steps, options.seed)
    rungs = (rigid_rung(prepared), *rungs)
    gain = pressure_gain_shift(problem, solution, pressure_gain_std(prepared))
    spreads = np.hypot(spread(problem, solution, others), gain)
    checked: tuple[Profile, ...] = ()
    redrawn = None
    if options.checks:
        checked = profiles(problem, solution)
        redrawn = bootstrap(problem, solution, [prepared.cycles], BOOTSTRAP_DRAWS, options.seed)
    return Fit(problem, solution, cov, spreads, gain, others, rungs, sampled, checked, redrawn)


def pressure_gain_std(prepared: Prepared) -> float:
    """Return the relative standard uncertainty of the pressure's gain, 0 where no certificate tells it."""
    sheet = prepared.recording.of("pressure")[0].calibration
    return float(sheet.gain_relative_std) if sheet is not None and np.isfinite(sheet.gain_relative_std) else 0.0


def fit_recording(
    recording: Recording, cycles: CamCycles, rigid: RigidTorque, options: FitOptions | None = None
) -> FittedTorque:
    """Return the fitted model of one recording.

    Parameters
    ----------
    recording, cycles, rigid : what the rooms before handed on
    options : effects to offer

    Raises
    ------
    Refusal
        No torque channel, or fewer than four usable cycles.
    """
    prepared = prepare(recording, cycles, rigid)
    fit = fit_prepared(prepared, options or FitOptions())
    return fitted_torque(fit, 0, recording, cycles, rigid, prepared.means)
