"""Simulated rigs prepared for the fit, started at the truth: a minimum without a search."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from camtorque.fit.descent import Effort
from camtorque.fit.minima import Candidate, Halves, followed
from camtorque.fit.prepare import fit_data, mean_cycles, other_half
from camtorque.fit.problem import FitData, build_problem, with_starts
from camtorque.fit.single import Prepared
from camtorque.fit.solver import lift_at, solve
from camtorque.fit.starts import Start
from camtorque.fit.valleys import NO_VALLEY
from camtorque.mechanism.lift_laws import lift_law, spectral_law
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.solve import solve_rigid
from camtorque.records import CamCycles, Recording, RigidTorque
from rig_bridge import cycles_of, recording_of
from rigs.families import FAMILIES, change
from rigs.rig import RigRun, end_angle, lift_of, simulate
from rigs.truth import RigTruth

LOAD = 0.8


def plain_bush(rng: np.random.Generator) -> RigTruth:
    """Return a rig whose roller turns in a plain bush."""
    return change(FAMILIES["closed_volume"](rng), friction__pin_mu=0.05, friction__pin_radius=4e-3)


def stiff_shaft(rng: np.random.Generator) -> RigTruth:
    """Return a rig whose shaft yields by a tenth of what is usual."""
    return change(FAMILIES["closed_volume"](rng), driveline__shaft_stiffness=60.0e3)


def suction_valve(rng: np.random.Generator) -> RigTruth:
    """Return `spill` whose chamber is filled through a valve on the whole return."""
    return change(FAMILIES["spill"](rng), chamber__suction_area=12.0e-6)


CASES = {**FAMILIES, "suction_valve": suction_valve, "plain_bush": plain_bush, "stiff_shaft": stiff_shaft}


@cache
def rig(family: str, draw: int = 0, rpm: float = 1000.0, load: float = LOAD) -> RigRun:
    """Return 16 revolutions of a rig of `CASES`."""
    truth = CASES[family](np.random.default_rng(100 + draw))
    return simulate(truth, rpm, load, n_cycles=16, seed=draw, step=1e-5, record_deg=0.12)


@cache
def bridged(run_key: tuple, n_theta: int = 1800) -> tuple[Recording, CamCycles, RigidTorque]:
    """Return recording, cycles and rigid torque of `rig(*run_key)`."""
    run = rig(*run_key)
    recording = recording_of(run, name="_".join(str(part) for part in run_key))
    cycles = cycles_of(run, n_theta)
    law = lift_law(recording.cam_table)
    mounting = Mounting(rotation=recording.config.rotation)
    rigid = solve_rigid(
        recording.config.pump, law, cycles.theta, cycles.pressure.mean(axis=0), cycles.mean_speed, mounting=mounting
    )
    return recording, cycles, rigid


def true_starts(truth: RigTruth, load: float = LOAD) -> dict[str, float]:
    """Return the true values of the parameters that place the load [SI]."""
    chamber = truth.chamber
    ends = end_angle(truth, load)
    starts = {
        "trigger_offset": truth.trigger.angle_offset, "dead_volume": chamber.dead_volume,
        "bulk_modulus": truth.fluid.modulus, "feed_pressure": chamber.feed_pressure, "leakage": chamber.leak,
        "port_closing_lift": float(lift_of(truth, np.array([chamber.port_close_angle]))[0]),
        "shaft_compliance": 1.0 / truth.driveline.shaft_stiffness,
        "drive_admittance": 1.0 / truth.driveline.drive_inertia, "valve_area": truth.valve.area,
        "valve_opening": truth.valve.opening_pressure, "retraction_volume": 1e-9,
    }  # fmt: skip
    if chamber.end == "spill":
        return {**starts, "spill_lift": float(lift_of(truth, np.array([ends]))[0])}
    return {**starts, "end_of_delivery": ends + chamber.close_width}


@cache
def quick_data(run_key: tuple, n_theta: int = 1800) -> FitData:
    """Return a rig as the fit sees it, started at the truth."""
    recording, cycles, _ = bridged(run_key, n_theta)
    means = mean_cycles(cycles)
    law = spectral_law(recording.cam_table)
    data = fit_data(recording, cycles, law, means)
    truth = rig(*run_key).truth
    data = replace(data, structure="spill" if truth.chamber.end == "spill" else "land")
    return with_starts(data, true_starts(truth, rig(*run_key).load))


def quick_halves(run_key: tuple) -> Halves:
    """Return both halves of a rig's cycles as the fit sees them."""
    data = quick_data(run_key)
    return Halves(data, other_half(data, mean_cycles(bridged(run_key)[1])))


@cache
def quick(run_key: tuple, n_theta: int = 1800, iterations: int = 40) -> Candidate:
    """Return the minimum next to the truth, without a search."""
    data = quick_data(run_key, n_theta)
    problem = build_problem([data])
    lift = lift_at(problem, problem.start)
    return followed(data, Start(data, lift, solve(problem, None, Effort(1), lift).chi_square), Effort(iterations))


def quick_prepared(*run_key) -> Prepared:
    """Return a rig prepared from the minimum next to the truth."""
    recording, cycles, rigid = bridged(run_key)
    found = quick(run_key)
    return Prepared(recording, cycles, rigid, mean_cycles(cycles), (found,), NO_VALLEY, found.data.chain.shaft_torque)
