"""Optimisers on the design of the paper's pump: quality and time of the best peak torque, and of a front.

    python benchmarks/design_methods.py

One aim under the limits of calibration/paper_design.toml, by the product's own programme (SLSQP on the epigraph), by
scipy's trust-constr on the same programme, and by pymoo's NSGA-II (where installed) on the greatest values themselves.
"""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path

import numpy as np
from camtorque.design import read_task
from camtorque.design.front import own_scale
from camtorque.design.problem import Problem
from camtorque.design.responses import RESPONSES
from camtorque.design.solver import Programme, scaled_aims, solve, violation
from scipy.optimize import Bounds, NonlinearConstraint, minimize

ROOT = Path(__file__).resolve().parents[1]
GENERATIONS, POPULATION = 250, 60


def report(name, seconds, problem, variables):
    design = problem.evaluated(np.clip(variables, 0.0, 1.0))
    values = [RESPONSES[key].value(design) for key in problem.task.aims]
    missed = violation(problem, np.clip(variables, 0.0, 1.0))
    print(f"| {name} | {seconds:.1f} | {values[0]:.3f} | {values[1]:.3f} | {missed:.1e} |", flush=True)


def by_trust_constr(problem, scale):
    programme = Programme(problem, scale, None)
    gradient = programme.objective()
    gradient[programme.at_aims] = 1.0
    limit = NonlinearConstraint(
        lambda v: np.concatenate(programme.blocks(v, False)[0]), 0.0, np.inf,
        jac=lambda v: np.concatenate(programme.blocks(v, True)[1]),
    )  # fmt: skip
    low, high = zip(*[(a if a is not None else -np.inf, b if b is not None else np.inf) for a, b in programme.bounds()],
                    strict=True)  # fmt: skip
    found = minimize(
        lambda v: float(gradient @ v), programme.first(problem.start()), jac=lambda v: gradient,
        hess=lambda v: np.zeros((v.size, v.size)), bounds=Bounds(low, high, keep_feasible=True), constraints=[limit],
        method="trust-constr", options={"maxiter": 300},
    )  # fmt: skip
    return found.x[: problem.size]


def by_nsga(problem):
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize as evolve

    rules = problem.shape_rules()

    class Task(ElementwiseProblem):
        def __init__(self):
            super().__init__(n_var=problem.size, n_obj=2, n_ieq_constr=len(problem.limits) + len(rules), xl=0.0, xu=1.0)

        def _evaluate(self, x, out, *args, **kwargs):
            design = problem.evaluated(np.ascontiguousarray(x))
            out["F"] = [RESPONSES[name].value(design) for name in problem.task.aims]
            over = [x.missed_by(RESPONSES[x.response].value(design)) / x.scale for x in problem.limits]
            out["G"] = np.concatenate([over, -(rules @ x)])

    result = evolve(Task(), NSGA2(pop_size=POPULATION), ("n_gen", GENERATIONS), seed=0)
    return np.atleast_2d(result.X) if result.X is not None else np.empty((0, problem.size))


def main():
    task = read_task(ROOT / "calibration" / "paper_design.toml")
    problem = Problem(task, task.families[0])
    scale = own_scale(problem)
    solve(problem, scale, problem.start(), single=0)
    print("| method | s | peak torque [N m] | Hertz [GPa] | scaled violation |\n|---|---|---|---|---|")
    for k, name in enumerate(task.aims):
        start = time.perf_counter()
        found = solve(problem, scale, problem.start(), single=k)
        report(f"SLSQP, least {name}", time.perf_counter() - start, problem, found.variables)
    start = time.perf_counter()
    variables = by_trust_constr(problem, scale)
    report("trust-constr, least peak_torque_nm", time.perf_counter() - start, problem, variables)
    if importlib.util.find_spec("pymoo") is not None:
        start = time.perf_counter()
        front = by_nsga(problem)
        spent = time.perf_counter() - start
        values = np.array([scaled_aims(problem, scale, row) for row in front])
        for k, name in enumerate(task.aims):
            if len(front):
                row = front[int(np.argmin(values[:, k]))]
                report(f"NSGA-II, {GENERATIONS} x {POPULATION}, least {name}", spent, problem, row)


if __name__ == "__main__":
    main()
