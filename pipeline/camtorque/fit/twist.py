"""The torque that twists the shaft is not the one that the transducer's low-pass lets through.

The twist is rebuilt from the measured torque; where the load changes faster than the low-pass follows (soft shafts,
high speeds), the difference matters. The model knows it: its torque before the low-pass less its torque behind it is
added to the measurement, which makes the twist the self-consistent solution of the non-linear driveline, one
fixed-point step a time. With stiff shafts the step changes nothing that counts (docs/decisions).
"""

from __future__ import annotations

import numpy as np

from camtorque.fit.problem import Problem
from camtorque.fit.solve import Solution, chain_coefficients
from camtorque.laws.causes import cam_torques
from camtorque.laws.chain import ChainInput, evaluate_chain, filtered, transfer
from camtorque.records import Array


def hidden_torque(problem: Problem, solution: Solution, index: int, chain: ChainInput) -> Array:
    """Return the torque of the shaft less what the transducer shows of it, (n_theta,) [N m]."""
    values = problem.values(solution.x, index)
    output = evaluate_chain(chain, values)
    torques = cam_torques(chain, values, output, chain_coefficients(problem, solution.c))
    total = np.sum(list(torques.values()), axis=0)
    shaft, measured, _ = transfer(chain, values, chain.theta.size)
    return filtered(total, shaft * (1.0 - measured))
