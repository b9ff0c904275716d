"""What the work costs, as ratios with named peers in one run; processor time, so that a busy machine counts little.

    python benchmarks/speed.py [--peers] [--write FILE]

The fit against `scipy.optimize.least_squares` (jac="3-point") and plain `lmfit.minimize`, both on the same compiled
chain, residuals and priors from the same start (``--peers``: minutes); aligning against a script with npTDMS and
`pandas.groupby`; stages of the fit; cost against grid, angles of the cycles and number of recordings.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import lmfit
import numpy as np
from scipy.optimize import least_squares

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "fit")]

from camtorque.align import AlignOptions, align  # noqa: E402
from camtorque.fit import joint_solver, single  # noqa: E402
from camtorque.fit.minima import Halves  # noqa: E402
from camtorque.fit.problem import STRUCTURES, FitData, Problem, build_problem  # noqa: E402
from camtorque.fit.search import search  # noqa: E402
from camtorque.fit.single import fit_prepared, prepare  # noqa: E402
from camtorque.fit.solver import WHOLE, lift_at, normal_equations, solve, try_at  # noqa: E402
from camtorque.fit.starts import coarse, refined  # noqa: E402
from camtorque.fit.valleys import profile_trigger_angle  # noqa: E402
from camtorque.ingest import read_recording  # noqa: E402
from camtorque.laws.chain import evaluate  # noqa: E402
from fit_cases import bridged, quick_data, quick_prepared  # noqa: E402
from usual_script import mean_cycles  # noqa: E402

CASE = ("closed_volume", 0, 1000.0)
EXAMPLE = ROOT / "raw_examples" / "A_1000rpm"
MOST_TRIALS = 4000


def seconds(action: Callable[[], Any], repeat: int = 5) -> float:
    """Return the least processor time of one call after a first one."""
    action()
    return min(once(action)[0] for _ in range(repeat))


def once(action: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of one call, and what it returns."""
    began = time.process_time()
    found = action()
    return time.process_time() - began, found


def stepped(item: FitData) -> Problem:
    """Return the problem of one recording with the fine time steps that the fit takes while the valve moves."""
    problem = build_problem([item])
    return build_problem([refined(item, problem.values(problem.start, 0)[0])])


def all_residuals(problem: Problem) -> Callable[[np.ndarray], np.ndarray]:
    """Return weighted residuals and priors of all free parameters at once, as a general solver wants them."""
    item, steps = problem.data[0], problem.steps
    means, stds = problem.priors
    lifts = lift_at(problem, problem.start)
    shrunk = 1.0 - 1.0 / np.sqrt(1.0 + lifts.strength**2)

    def residual(scaled: np.ndarray) -> np.ndarray:
        z = scaled * steps
        values, coefficients = problem.values(z, 0)
        output = evaluate(item.chain, values)
        missing = (item.torque - output.torque - output.linear @ coefficients) * item.weight
        missing = missing - lifts.vectors @ (shrunk * (lifts.vectors.T @ missing))
        return np.r_[missing, np.where(np.isfinite(stds), (z - means) / stds, 0.0)]

    return residual


def peer_lines(problem: Problem) -> Iterator[str]:
    """Yield the fit of one recording by this package and by general solvers, from one start."""
    lifts = lift_at(problem, problem.start)
    own, found = once(lambda: solve(problem, None, WHOLE, lifts))
    yield "| solver, same start, same residuals | processor time | ratio | chi-square reached |"
    yield "|---|---|---|---|"
    yield f"| camtorque (variable projection, exact derivatives) | {own:.2f} s | 1 | {found.chi_square:.1f} |"
    residual, steps = all_residuals(problem), problem.steps
    lower, upper = (bound / steps for bound in problem.bounds)
    start = np.clip(problem.start / steps, lower + 1e-6, upper - 1e-6)
    cost, peer = once(
        lambda: least_squares(residual, start, "3-point", bounds=(lower, upper), max_nfev=MOST_TRIALS // 100)
    )
    yield f"| scipy least_squares, jac='3-point' | {cost:.1f} s | {cost / own:.0f} | {2.0 * peer.cost:.1f} |"
    parameters = lmfit.Parameters()
    for k, parameter in enumerate(problem.parameters):
        parameters.add(parameter.name, float(start[k]), min=float(lower[k]), max=float(upper[k]))
    names = problem.names

    def by_name(given: lmfit.Parameters) -> np.ndarray:
        return residual(np.array([given[name].value for name in names]))

    cost, peer = once(lambda: lmfit.minimize(by_name, parameters, max_nfev=MOST_TRIALS))
    yield f"| lmfit.minimize (leastsq) | {cost:.1f} s | {cost / own:.0f} | {peer.chisqr:.1f} |"


def trial_lines(problem: Problem) -> Iterator[str]:
    """Yield what a trial, exact and numerical derivatives cost."""
    z, lifts = problem.start, lift_at(problem, problem.start)
    trial = try_at(problem, z, lifts)
    plain = seconds(lambda: try_at(problem, z, lifts))
    exact = seconds(lambda: normal_equations(problem, trial.z, trial.residual, lifts))
    numerical = 2.0 * problem.n_nonlinear * plain
    yield "| step | processor time | ratio |"
    yield "|---|---|---|"
    yield f"| trial: chain, linear parameters, lift correction | {1e3 * plain:.1f} ms | 1 |"
    what = f"exact derivatives by {problem.size} parameters and normal equations"
    yield f"| {what} | {1e3 * exact:.1f} ms | {exact / plain:.1f} |"
    yield f"| the same by central differences | {1e3 * numerical:.0f} ms | {numerical / plain:.0f} |"


def grid_lines(problem: Problem) -> Iterator[str]:
    """Yield the cost of a trial against the grid of the model, and of preparing cycles against theirs."""
    item = problem.data[0]
    yield "| points of the model | trial | points of the cycles | mean cycles to bins |"
    yield "|---|---|---|---|"
    for grid, n_theta in ((600, 900), (1200, 1800), (1800, 3600), (3600, 7200)):
        moved = stepped(coarse(item, grid))
        lifts = lift_at(moved, moved.start)
        cost = seconds(partial(try_at, moved, moved.start, lifts))
        cycles = bridged(CASE, n_theta)[1]
        means = seconds(partial(single.mean_cycles, cycles))
        yield f"| {grid} | {1e3 * cost:.1f} ms | {n_theta} | {1e3 * means:.2f} ms |"


def recording_lines(problem: Problem) -> Iterator[str]:
    """Yield the cost of one pass of a joint fit against the number of recordings."""
    item = problem.data[0]
    yield "| recordings | parameters | one pass (trial and normal equations) | for each |"
    yield "|---|---|---|---|"
    for count in (1, 2, 5, 10, 20):
        joint = build_problem([replace(item, name=f"r{k}") for k in range(count)])
        setup = joint_solver.joint_setup(joint, joint.start, 0.0)

        def one_pass(setup: joint_solver.JointSetup = setup) -> None:
            joint_solver.linearised(setup, joint_solver.try_at(setup, setup.problem.start))

        cost = seconds(one_pass, 2)
        yield f"| {count} | {joint.size} | {1e3 * cost:.0f} ms | {1e3 * cost / count:.1f} ms |"


def stage_lines() -> Iterator[str]:
    """Yield where the fit of one recording spends its time."""
    quick_prepared(*CASE)  # compiled
    recording, cycles, rigid = bridged(CASE)
    prepared = prepare(recording, cycles, rigid)
    data = quick_data(CASE)
    halves = Halves(data, data)
    searching, _ = once(lambda: search(halves, tuple(STRUCTURES)))
    walking, _ = once(lambda: profile_trigger_angle(prepared.candidates[0], halves))
    plain, _ = once(lambda: fit_prepared(prepared, weighed=False))
    told, _ = once(lambda: fit_prepared(prepared))
    total = searching + walking + told
    yield "| stage of the fit | processor time | share |"
    yield "|---|---|---|"
    for name, cost in (
        ("search over structures and starts", searching), ("valley of the trigger angle", walking),
        ("covariance and variants", plain), ("evidence", max(told - plain, 0.0)), ("all", total),
    ):  # fmt: skip
        yield f"| {name} | {cost:.2f} s | {100.0 * cost / total:.0f} % |"


def align_lines() -> Iterator[str]:
    """Yield reading and aligning an example against the script."""
    path = next(EXAMPLE.glob("*.tdms"))
    script = seconds(lambda: mean_cycles(path, "Prox_Trigger"), 3)
    own = seconds(lambda: align(read_recording(EXAMPLE), AlignOptions()), 3)
    yield "| raw file to mean cycles, 3 s, TDMS | processor time | ratio |"
    yield "|---|---|---|"
    yield f"| npTDMS, pandas groupby: no checks, clocks, delays, cuts | {1e3 * script:.0f} ms | 1 |"
    yield f"| camtorque: read, check, align | {1e3 * own:.0f} ms | {own / script:.1f} |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--peers", action="store_true", help="the general solvers too (minutes)")
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    problem = stepped(quick_data(CASE))
    parts = [trial_lines(problem), grid_lines(problem), recording_lines(problem), align_lines(), stage_lines()]
    if arguments.peers:
        parts.append(peer_lines(problem))
    lines = [f"{platform.machine()}, Python {platform.python_version()}"]
    for part in parts:
        lines.append("")
        with contextlib.redirect_stdout(io.StringIO()):
            rows = list(part)
        lines += rows
        print("\n".join(["", *rows]), flush=True)
    if arguments.write:
        arguments.write.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
