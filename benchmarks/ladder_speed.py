"""The ladder of the five-recording campaign: the package's solver against plain `lmfit.minimize`, in one run.

    python benchmarks/ladder_speed.py [--rungs upward|all] [--skip 0] [--limit 600] [--page docs/ladder_speed.md]

Every rung is fitted twice from the same start: by `camtorque.fit.solve`, and by `lmfit.minimize` (leastsq, numerical
derivatives) on the same compiled residual with the same bounds, priors and tolerance. The plain side gets the best
linear parameters at the start as a gift, since a start on a bound has no slope behind lmfit's transformation. Times are
processor times, so that other work on the machine does not count; a plain fit that runs into the limit is stopped, and
its row then holds a lower bound of the ratio.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import lmfit
import numpy as np
from camtorque.align import align
from camtorque.fit import prepare
from camtorque.fit.full_space import full_limits
from camtorque.fit.joint import joint_start
from camtorque.fit.problem import FIT_EFFECTS, FitData, Problem, build_problem
from camtorque.fit.solve import RELATIVE_TOLERANCE, chain_coefficients, solve, try_at
from camtorque.ingest import read_recording
from camtorque.laws.chain import binned, evaluate_chain, filtered, transfer
from camtorque.mechanism import Mounting, solve_rigid
from camtorque.mechanism.spectral import spectral_law
from camtorque.records import Array

ROOT = Path(__file__).resolve().parents[1]
INSIDE = 0.01
"""Starts on a bound are moved inside by this share of the parameter's step, for the plain side."""
SAME = 1.0e-6
"""Chi-squares closer than this share count as equal."""


@dataclass(frozen=True)
class Side:
    """One fit: processor time [s], chi-square, model evaluations, and whether it came to an end."""

    seconds: float
    chi_square: float
    evaluations: int
    finished: bool


@dataclass(frozen=True)
class Row:
    """One rung fitted twice."""

    name: str
    n_free: int
    own: Side
    plain: Side


def campaign_data(folder: Path) -> list[FitData]:
    """Return the recordings below a folder with one common start."""
    data = []
    for path in sorted(folder.glob("*/recording.toml")):
        recording = read_recording(path.parent)
        cycles = align(recording)
        config, law = recording.config, spectral_law(recording.cam_table)
        mounting = Mounting(rotation=config.rotation)
        mean = np.mean(cycles.pressure, axis=0)
        rigid = solve_rigid(config.pump, law, cycles.theta, mean, cycles.mean_speed, mounting=mounting)
        data.append(prepare(recording, cycles, rigid).data)
    return joint_start(data)


def rungs(kind: str) -> dict[str, tuple[str, ...]]:
    """Return name -> effects of the rungs, upward and back down by one."""
    found: dict[str, tuple[str, ...]] = {"torque zero alone": ()}
    for count in range(1, len(FIT_EFFECTS) + 1):
        found[f"+ {FIT_EFFECTS[count - 1]}"] = FIT_EFFECTS[:count]
    if kind == "all":
        for effect in reversed(FIT_EFFECTS[:-1]):
            found[f"all but {effect}"] = tuple(name for name in FIT_EFFECTS if name != effect)
    return found


def own_fit(problem: Problem) -> Side:
    start = time.process_time()
    solution = solve(problem)
    seconds = time.process_time() - start
    return Side(seconds, solution.chi_square, solution.evaluations, solution.converged)


def plain_residual(problem: Problem) -> Callable[[Array], Array]:
    """Return the weighted residual with priors of all parameters; the lift correction as one curve, not by columns."""
    bare = [replace(item.chain, lift_basis=None) for item in problem.data]
    limits, n_x = full_limits(problem), len(problem.nonlinear)
    n_linear = len(problem.linear)
    known = np.isfinite(limits.prior_std)
    zeros = [next((k for k, s in enumerate(problem.linear) if s.recording == i), None) for i in range(len(bare))]

    def residual(z: Array) -> Array:
        c = z[n_x:]
        coefficients = chain_coefficients(problem, c)
        parts = []
        for index, (chain, item) in enumerate(zip(bare, problem.data, strict=True)):
            values = problem.values(z[:n_x], index)
            output = evaluate_chain(chain, values)
            torque = output.torque + output.linear @ coefficients[: output.linear.shape[1]]
            if item.chain.lift_basis is not None:
                slope = item.chain.lift_basis.correction(binned(output.motion.theta), c[n_linear:], 1)
                shaft, measured, _ = transfer(chain, values, torque.size)
                seen = filtered(binned(output.load) * slope, shaft * measured)
                torque = torque + seen * (1.0 + values["gain_error"])
            zero = zeros[index]
            torque = torque + (c[zero] if zero is not None else 0.0)
            parts.append((item.torque - torque) * item.weight)
        prior = (limits.prior_mean[known] - z[known]) / limits.prior_std[known]
        return np.concatenate([*parts, prior])

    return residual


def plain_fit(problem: Problem, limit: float) -> Side:
    limits, model = full_limits(problem), plain_residual(problem)
    sums: list[float] = []
    first = np.concatenate([problem.start(), try_at(problem, problem.start()).c])
    margin = INSIDE * limits.steps
    inside = np.clip(first, limits.lower + margin, limits.upper - margin) / limits.steps
    params = lmfit.Parameters()
    bounds = zip(inside, limits.lower / limits.steps, limits.upper / limits.steps, strict=True)
    for k, (value, low, high) in enumerate(bounds):
        params.add(f"p{k}", value=value, min=low, max=high)

    def residual(current: lmfit.Parameters) -> Array:
        vector = model(np.array([current[f"p{k}"].value for k in range(limits.steps.size)]) * limits.steps)
        sums.append(float(vector @ vector))
        return vector

    start = time.process_time()
    result = lmfit.minimize(
        residual, params, method="leastsq", calc_covar=False, ftol=RELATIVE_TOLERANCE, xtol=RELATIVE_TOLERANCE,
        max_nfev=10**7, iter_cb=lambda *_: time.process_time() - start > limit,
    )  # fmt: skip
    return Side(time.process_time() - start, min(sums), len(sums), not result.aborted)


def compare(data: Sequence[FitData], chosen: dict[str, tuple[str, ...]], limit: float) -> list[Row]:
    solve(build_problem(data, ("chamber",)), max_iterations=1)  # compiled once, for both sides
    rows = []
    for name, effects in chosen.items():
        problem = build_problem(data, effects)
        n_free = full_limits(problem).steps.size
        rows.append(Row(name, n_free, own_fit(problem), plain_fit(problem, limit)))
        print(line(rows[-1]), flush=True)
    return rows


def line(row: Row) -> str:
    own, plain = row.own, row.plain
    mark = "" if plain.finished else " (stopped)"
    ratio = plain.seconds / own.seconds
    return (
        f"| {row.name} | {row.n_free} | {own.seconds:.2f} | {own.evaluations} | {own.chi_square:.6g} | "
        f"{plain.seconds:.1f}{mark} | {plain.evaluations} | {plain.chi_square:.6g} | {ratio:.0f} |"
    )


HEADER = (
    "| rung | free | solver [s] | evaluations | chi-square | plain lmfit [s] | evaluations | chi-square | ratio |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def summary(rows: Sequence[Row]) -> str:
    own, plain = sum(row.own.seconds for row in rows), sum(row.plain.seconds for row in rows)
    stopped = sum(not row.plain.finished for row in rows)
    better = sum(row.own.chi_square <= row.plain.chi_square * (1.0 + SAME) for row in rows)
    bound = "at least " if stopped else ""
    return (
        f"{len(rows)} rungs: {own:.1f} s against {plain:.0f} s, {bound}{plain / own:.0f} times faster; chi-square "
        f"equal or lower on {better} of {len(rows)}; {stopped} plain fits were stopped at the limit."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=ROOT / "raw_examples")
    parser.add_argument("--rungs", choices=("upward", "all"), default="upward")
    parser.add_argument("--skip", type=int, default=0, help="rungs that are left out at the beginning")
    parser.add_argument("--limit", type=float, default=600.0, help="processor seconds per plain fit")
    parser.add_argument("--page", type=Path, help="where the table is written as Markdown")
    arguments = parser.parse_args()
    print(HEADER)
    chosen = dict(list(rungs(arguments.rungs).items())[arguments.skip :])
    rows = compare(campaign_data(arguments.folder), chosen, arguments.limit)
    print(summary(rows))
    if arguments.page:
        assert __doc__ is not None
        body = "\n".join([HEADER, *map(line, rows)])
        arguments.page.write_text(f"# Speed of the ladder\n\n{__doc__.strip()}\n\n{body}\n\n{summary(rows)}\n")


if __name__ == "__main__":
    main()
