"""What `fit` hands on: the fitted model of one recording, how sure it is, and what the data say of each loss."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from camtorque.records.base import Array, Estimate, Finding, ReadOnly
from camtorque.records.cycles import AngleError
from camtorque.records.rigid import Forces

APART, TOGETHER, EITHER_LOSS = ("friction", "damping"), "friction_and_damping", "friction_or_damping"
"""Losses that one recording tells apart badly, and their sum, which it tells well."""
KNOWLEDGE = ("measured", "upper limit", "narrowed", "from the sheet", "not told by the data")
UNTOLD = KNOWLEDGE[3:]
"""How far the data went beyond what was known of a parameter before; an amount whose interval reaches its lower bound,
mostly zero, has an upper limit; `UNTOLD`: the data added nothing to a prior, or to no prior at all."""
VERDICTS = ("needed", "not needed", "cannot tell")
"""Of a loss: what the data say of it."""


@dataclass(frozen=True)
class Metrics:
    """How well a model torque meets the measured mean cycle; definitions in docs/result_schema.md."""

    rms_nm: float
    rms_percent_of_peak: float
    forward_gap_percent: float
    forward_peak_error_nm: float
    return_min_measured_nm: float
    return_min_model_nm: float
    return_rms_nm: float

    @property
    def peak_excess_percent(self) -> float:
        """How much the model's highest torque exceeds the measured one, in percent of that; nan where unknown."""
        peak = 100.0 * self.rms_nm / self.rms_percent_of_peak if self.rms_percent_of_peak else math.nan
        return -100.0 * self.forward_peak_error_nm / peak


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter as it is reported.

    ``stderr`` and ``ci95`` are total (model spread included), ``stderr_statistical`` is beside them. ``prior`` is
    (mean, std) or None; ``role`` is ``shared`` or ``own`` (nuisance of one recording).
    """

    name: str
    value: float
    unit: str
    stderr: float
    stderr_statistical: float
    ci95: tuple[float, float]
    at_bound: bool
    identifiable: bool
    confounded_with: tuple[str, ...]
    prior: tuple[float, float] | None
    meaning: str
    source: str
    role: str = "shared"
    symbol: str = ""
    knowledge: str = "from the sheet"

    def __post_init__(self) -> None:
        if self.knowledge not in KNOWLEDGE:
            raise ValueError(f"{self.name}: knowledge is {self.knowledge!r}, expected one of {KNOWLEDGE}")


@dataclass(frozen=True)
class LossEvidence:
    """What the data say about one loss (a group of parameters that vanish together).

    Attributes
    ----------
    name : loss, such as ``friction``
    two_ln_bayes_factor : 2 ln of the Bayes factor for the loss against its absence; nan where it was not computed
    verdict : ``needed``, ``not needed`` or ``cannot tell``
    confirmed_by_refit : True where a fit without the loss was made
    size, size_ci95, unit : how much the loss moves the mean cycle (rms torque [N m] or angle [deg]); the interval
        begins at 0 unless the loss is needed, and is nan of a chamber, which is there or not
    text : one sentence a test engineer understands
    """

    name: str
    two_ln_bayes_factor: float
    verdict: str
    confirmed_by_refit: bool
    size: float
    size_ci95: tuple[float, float]
    unit: str
    text: str = ""

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise ValueError(f"{self.name}: verdict is {self.verdict!r}, expected one of {VERDICTS}")


@dataclass(frozen=True)
class ResidualBump:
    """A stretch of the revolution where the residual stands out of what the cycles repeat.

    start, stop : cam angle [rad]; peak : largest residual [N m]; times_repeatability : its rms over that of odd
    against even cycles; phase : what the pump does there, in words; frequency : at which most of it swings [Hz], 0
    where it does not swing
    """

    start: float
    stop: float
    peak: float
    times_repeatability: float
    phase: str
    frequency: float = 0.0


@dataclass(frozen=True)
class Alternative:
    """Another structure of the model (or another minimum), and how probable the data make it.

    name : ``closed by land``, ``spill``, ``no end seen``, ``line pressure on the plunger``, ...; probability : among
    all that were fitted; trigger_angle [rad] and chamber_peak [Pa] : what it would say
    """

    name: str
    probability: float
    rms_nm: float
    trigger_angle: float
    chamber_peak: float


@dataclass(frozen=True)
class FittedTorque(ReadOnly):
    """The fitted model of one recording on its angle grid.

    Attributes
    ----------
    effects : chosen effects
    parameters : every parameter
    correlation : (k, k) of the parameters named in ``correlation_names``
    torque : (n_theta,) fitted model for the mean of the fitted cycles [N m]
    torque_held_out : (n_theta,) the same parameters on the pressure of the held-out cycles [N m]
    by_cause : cause -> (n_theta,) [N m]; causes sum to ``torque``
    chamber_pressure : (n_theta,) rebuilt pressure on the plunger [Pa, gauge]
    chamber_pressure_std : (n_theta,) its total standard uncertainty at the cam angle ``true_angle`` [Pa]
    true_angle : (n_theta,) cam angle of each grid point after trigger angle, twist and delay [rad]
    forces : forces of the fitted model
    losses : cause -> J per revolution, with ``input`` and ``closure_percent`` (nan without input)
    losses_stderr : cause -> standard uncertainty [J per revolution], and of friction and damping together and the input
    gap_stderr : cause -> (3,) standard uncertainty of its torque [N m]: mean over the loaded part of the forward
        stroke, over the return stroke, and where the measured torque is least there
    metrics : ``rigid``, ``fitted``, ``fitted_held_out_cycles``
    angle_errors_after : the angle error budget after the fit
    evidence : for each loss, whether the data need it
    alternatives : structures that were fitted, the chosen one first
    bumps : where the residual stands out
    explained : False where the residual is above three times odd-even and 0.15 % of the peak
    """

    effects: tuple[str, ...]
    parameters: tuple[ParameterEstimate, ...]
    correlation: Array
    correlation_names: tuple[str, ...]
    torque: Array
    torque_held_out: Array
    by_cause: Mapping[str, Array]
    chamber_pressure: Array | None
    chamber_pressure_std: Array | None
    chamber_peak: Estimate | None
    chamber_return_start: Estimate | None
    true_angle: Array
    forces: Forces
    contact_lost: bool
    losses: Mapping[str, float]
    losses_stderr: Mapping[str, float]
    gap_stderr: Mapping[str, Array]
    metrics: Mapping[str, Metrics]
    trigger_angle: Estimate
    torque_delay: Estimate
    angle_errors_after: tuple[AngleError, ...]
    odd_even_rms: float
    next_measurement: tuple[str, ...]
    findings: tuple[Finding, ...]
    details: Mapping[str, Any] = field(default_factory=dict)
    evidence: tuple[LossEvidence, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    bumps: tuple[ResidualBump, ...] = ()
    explained: bool = True

    def parameter(self, name: str) -> ParameterEstimate:
        """Return the parameter of that name."""
        for estimate in self.parameters:
            if estimate.name == name:
                return estimate
        raise KeyError(f"no parameter {name!r}; there are {[p.name for p in self.parameters]}")
