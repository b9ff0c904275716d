"""What the weights leave open during delivery: a valve law of few numbers is not the valve.

While the valve delivers, the chamber stands above the line by what the quasi-static valve law says, and a mass on a
spring, in oil that has inertia, answers a wave of the line differently. Where the volume is closed nothing of the kind
is in doubt. Equal trust in both lets the certain part (leakage, guide friction, trigger angle) make good what the
valve law lacks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from camtorque.fit.prepare import CORRELATION
from camtorque.fit.problem import FitData, build_problem
from camtorque.fit.solve import try_at
from camtorque.laws.chain import ChainInput, ChainOutput, binned
from camtorque.records import Array

VALVE_ERROR = 0.02
"""Standard deviation of the valve law, as a share of its pressure drop."""
DISTRUSTED = 0.1
"""The same for the model variant that trusts the law much less."""
LARGEST_DROP = 150.0e5
"""Beyond this the outlet is closing, and chamber and line have parted [Pa]."""


def drop_torque(chain: ChainInput, output: ChainOutput, values: Mapping[str, float]) -> Array:
    """Return the torque of the pressure drop over the open valve, in bin averages (m,) [N m]."""
    drop = output.pressure - (chain.line_pressure - values["pressure_zero"])
    drop = np.where(output.flows[:, 2] > 0.0, np.clip(drop, 0.0, LARGEST_DROP), 0.0)
    return binned(drop * chain.pump.plunger_area * np.abs(output.motion.lift[1]))


def with_valve_error(data: FitData, drop: Array, share: float) -> FitData:
    """Return the recording whose weights admit an error of the valve law.

    Parameters
    ----------
    drop : (m,) torque of the pressure drop over the valve [N m]
    share : standard deviation of the error, as a share of the drop
    """
    return replace(data, weight=1.0 / np.sqrt(1.0 / data.weight**2 + CORRELATION * (share * drop) ** 2))


def with_valve_error_at_start(data: FitData, effects: tuple[str, ...]) -> FitData:
    """Return the recording with `VALVE_ERROR` in its weights, the drop being that of its start."""
    problem = build_problem([data], effects)
    trial = try_at(problem, problem.start())
    chain = problem.data[0].chain
    return with_valve_error(data, drop_torque(chain, trial.outputs[0], problem.values(trial.x, 0)), VALVE_ERROR)
