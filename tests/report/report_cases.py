"""A plausible finished run without files: a smooth cam, a pressure pulse, laws of the right size and sign."""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from camtorque.fit.known_ends import Curve
from camtorque.fit.residual import metrics
from camtorque.records import (
    Alternative,
    AngleError,
    CamCycles,
    CamTable,
    ClockFit,
    CutFlowRow,
    Estimate,
    Finding,
    FittedTorque,
    Forces,
    InputFile,
    LossEvidence,
    ParameterEstimate,
    Recording,
    ResidualBump,
    RigidTorque,
)
from camtorque.report.bundle import RunResult

NASTY = '<script>alert("x")</script> & <b>'
N_THETA, N_CYCLES = 720, 9
THETA = np.linspace(0.0, 2.0 * np.pi, 1800, endpoint=False)


def parameter(name: str, value: float, **changes: object) -> ParameterEstimate:
    known: dict[str, object] = {
        "name": name, "value": value, "unit": "bar", "stderr": 0.3, "stderr_statistical": 0.1,
        "ci95": (value - 0.6, value + 0.6), "at_bound": False, "identifiable": True, "confounded_with": (),
        "prior": (1.0, 2.0), "meaning": "what it means", "source": "sheet",
    }  # fmt: skip
    return ParameterEstimate(**{**known, **changes})  # type: ignore[arg-type]


def forces(load: np.ndarray) -> Forces:
    none = np.zeros_like(load)
    return Forces(load, 0.01 * load, 0.2 * load, load, -0.2 * load, none, 1e9 * load / 3000.0, none, none)


def falling(end: float, speed: float) -> Curve:
    """Return a line pressure that falls at an end of delivery."""
    fall = 1.0 / (1.0 + np.exp((THETA - end) / (2e-4 * speed)))
    return Curve(THETA, 1e7 + 4e7 * fall * np.minimum(THETA, 1.0), speed)


def run_result(recording_name: str = "case", with_chamber: bool = True, explained: bool = True) -> RunResult:
    """Return a run whose metrics are computed from its own curves, so that they can be checked from the files."""
    theta = np.linspace(0.0, 2.0 * np.pi, N_THETA, endpoint=False)
    rise = np.clip(theta / 1.5, 0.0, 1.0)
    fall = np.clip((theta - 2.0) / 1.5, 0.0, 1.0)
    lift = 4e-3 * (np.cos(np.pi * fall) - np.cos(np.pi * rise))
    velocity = np.gradient(lift, theta)
    pressure = 3e7 + 6e7 * np.exp(-(((theta - 0.9) / 0.3) ** 2))
    rigid = velocity * 5e-5 * pressure
    truth = 1.1 * rigid + np.where(velocity < 0.0, 0.5 * rigid, 0.0) + 0.3
    noise = np.random.default_rng(5).normal(0.0, 0.05, (N_CYCLES, N_THETA))
    torque = truth + noise
    held_out = np.arange(N_CYCLES) % 2 == 1
    fitted = truth + 0.02 * np.sin(3.0 * theta)
    parts = [(fitted, torque[~held_out].mean(0)), (fitted, torque[held_out].mean(0)), (rigid, torque.mean(0))]
    scores = [metrics(measured, model, rigid, lift, velocity) for model, measured in parts]
    cycles = CamCycles(
        theta, torque, np.tile(pressure, (N_CYCLES, 1)), np.full(N_CYCLES, 105.0), np.arange(1, N_CYCLES + 1),
        held_out, N_CYCLES + 2, 1.2, 0.05, (CutFlowRow("missed_trigger", 2, "a pulse is missing", 2, N_CYCLES),),
        (ClockFit("DAQ1", 0.0, 0.0, 0.0), ClockFit("DAQ2", 0.12, 33.0, 2e-6, "pulse pattern")),
        (AngleError("trigger installation", 0.87, "tolerance"), AngleError("shaft twist", float("nan"))), 1e-6,
        (Finding("pressure_clipped", "warning", f"3 samples clipped {NASTY}", "DAQ2"),), Estimate(4.5e-4, 1e-5, 4.5e-4),
    )  # fmt: skip
    load = 500.0 + 5e-5 * pressure
    rigid_record = RigidTorque(
        theta, rigid, {"pressure": rigid}, forces(load), lift, velocity, np.gradient(velocity, theta), False
    )
    chamber = pressure * 1.2 if with_chamber else None
    evidence = (
        LossEvidence("chamber", 4123.0, "needed", True, 3.1, (2.9, 3.3), "N m", f"what it is {NASTY}"),
        LossEvidence("driveline", 31.0, "needed", False, 0.7, (0.6, 0.8), "deg"),
        LossEvidence("friction", 1.0, "cannot tell", True, 0.1, (0.0, 0.2), "N m"),
        LossEvidence("spring", -4.0, "not needed", False, 0.01, (0.0, 0.02), "N m"),
    )
    alternatives = (Alternative("closed by land", 0.9, 0.02, 0.36, 1.1e8), Alternative("spill", 0.1, 0.03, 0.35, 1.0e8))
    record = FittedTorque(
        effects=("chamber", "friction"),
        parameters=(parameter("feed_pressure", 1.7, knowledge="measured"),
                    parameter("dead_volume", 3.0, prior=None, stderr=float("nan"),
                    confounded_with=("bulk_modulus",), identifiable=False, meaning=NASTY),
                    parameter("guide_friction", 0.0, at_bound=True, stderr=0.0, stderr_statistical=0.0, unit="um")),
        correlation=np.array([[1.0, 0.4], [0.4, 1.0]]), correlation_names=("feed_pressure", "dead_volume"),
        torque=fitted, torque_held_out=fitted.copy(),
        by_cause={"pressure": fitted - 0.3, "torque_zero": 0.3 + 0 * theta},
        chamber_pressure=chamber, chamber_pressure_std=None if chamber is None else 1e5 + 0 * chamber,
        chamber_peak=None if chamber is None else Estimate(1.1e8, 1e6),
        chamber_return_start=None if chamber is None else Estimate(float("nan"), float("nan")),
        true_angle=theta + 0.01, forces=forces(1.2 * load), contact_lost=False,
        losses={"pressure": 7.0, "friction": 0.6, "damping": 0.4, "input": 8.04, "closure_percent": 0.5},
        gap_stderr={"plunger pressure": np.array([0.2, 0.1, 0.3]), "cam angle": np.array([0.1, 0.1, 0.1])},
        losses_stderr={"pressure": 0.1, "friction": 0.3, "damping": 0.3, "friction_and_damping": 0.05},
        metrics={"rigid": scores[2], "fitted": scores[0], "fitted_held_out_cycles": scores[1]},
        trigger_angle=Estimate(0.36, 0.001, 0.349), torque_delay=Estimate(4.5e-4, 8e-6, 4.5e-4),
        angle_errors_after=(AngleError("trigger angle", 0.06, "fitted"),), odd_even_rms=0.03,
        next_measurement=("record standstill readings",), findings=(),
        details={"block_cv_percent": [0.1] * 4 + [0.7] + [0.2] * 13, "absolute_uncertainty_percent": 0.42},
        evidence=evidence,
        alternatives=alternatives, explained=explained,
        bumps=() if explained else (ResidualBump(0.7, 0.9, -0.4, 9.5, f"end of delivery {NASTY}"),),
    )  # fmt: skip
    config = SimpleNamespace(id=recording_name, pump_id="P1", text=f"id = '{NASTY}'", rotation=1, date=None,
                             measures_chamber=False, fluid=SimpleNamespace(temperature=313.15),
                             pump=SimpleNamespace(plunger_area=5e-5))  # fmt: skip
    table = CamTable(theta[::2], lift[::2], 1e-6)
    inputs = (InputFile(Path("recording.toml"), hashlib.sha256(recording_name.encode()).hexdigest()),)
    return RunResult(
        Recording(config, (), table, inputs, ()), cycles, rigid_record, record,
        {"ingest": 0.1, "align": 0.2, "model": 0.1, "fit": 1.0}, "2026-01-02T03:04:05+00:00", 120.0,
    )  # fmt: skip
