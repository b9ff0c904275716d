"""Another plunger and another cam on the same simulated rig, predicted from the fit of the first.

    python benchmarks/predict_other_pump.py OUT.csv [--family closed_volume] [--first 0] [--rigs 2]

One line per run: peak torque predicted with its 95 % interval, and what the simulated rig then measures; the same for
the run that was fitted, made again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from benches import plain_parser, rig_of, write_rows
from camtorque.finished_fit import chain_of
from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.endings import load_for
from camtorque.fit.forecast import forecast
from camtorque.fit.known_ends import Curve
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.prepare import on_grid
from camtorque.fit.single import Prepared, fit_prepared, prepare
from compare_twins import compared_side, recorded
from rigs.families import FAMILIES
from rigs.truth import RigTruth, change

SPEED, LOAD = 700.0, 0.7
SHARE = 0.002
"""Error of the laws as a share of the peak: what the fits of these rigs leave of their held-out cycles."""


def known_fit(item: Prepared) -> KnownFit:
    """Return the fit of one recording as a prediction takes it."""
    fit = fit_prepared(item, weighed=False)
    source = FittedAt(item.recording.config.id, item.cycles.mean_speed, fit.problem.data[0].structure, SHARE, False)
    names = fit.problem.names
    return KnownFit(names, fit.solution.z, ArrowCovariance.whole(fit.covariance.matrix), (source,))


def others(truth: RigTruth) -> dict[str, RigTruth]:
    """Return the rig made again, with another plunger and with another cam."""
    pump = truth.pump
    return {
        "again": truth, "plunger + 6 %": change(truth, pump__plunger_diameter=1.06 * pump.plunger_diameter),
        "lift - 8 %": change(truth, pump__cam__lift=0.92 * truth.pump.cam.lift),
    }  # fmt: skip


def rig_rows(family: str, seed: int) -> list[dict[str, object]]:
    """Return the predictions on one rig."""
    truth = FAMILIES[family](np.random.default_rng(300 + seed))
    run = recorded(truth, SPEED, LOAD, 50 * seed)
    side = compared_side(run, run, "fitted")
    first = prepare(side.recording, side.cycles, side.rigid)
    known = known_fit(first)
    source = known.recordings[0]
    templates = {source.id: Curve(first.cycles.theta, first.means.pressure_all, first.cycles.mean_speed)}
    rows = []
    for number, (name, other) in enumerate(others(truth).items(), 1):
        made = recorded(other, SPEED, LOAD, 50 * seed + number)
        item = compared_side(made, made, name)
        speed = item.cycles.mean_speed
        curve = Curve(item.cycles.theta, item.means.pressure_all, speed)
        chain = chain_of(rig_of(item), speed, curve, source.structure)
        load = load_for(known, source, templates, chain, curve)
        found = forecast(known, chain, source, load, {})
        measured = on_grid(item.means.torque_all, found.theta.size)
        top = int(np.argmax(found.torque))
        half = 1.96 * float(found.torque_std[top])
        rows.append({
            "family": family, "seed": seed, "run": name, "predicted_nm": round(float(found.torque[top]), 3),
            "half_interval_nm": round(half, 3), "measured_nm": round(float(np.max(measured)), 3),
            "inside": abs(float(found.torque[top]) - float(np.max(measured))) < half,
        })  # fmt: skip
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Write one line per prediction."""
    parser = plain_parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--family", default="closed_volume")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rigs", type=int, default=2)
    chosen = parser.parse_args()
    rows = [row for k in range(chosen.first, chosen.first + chosen.rigs) for row in rig_rows(chosen.family, k)]
    write_rows(chosen.out, rows)


if __name__ == "__main__":
    main()
