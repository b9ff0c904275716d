"""Each recording of a campaign predicted from a joint fit of the others and its own line pressure.

    python benchmarks/predict_left_out.py OUT.csv [CAMPAIGN_DIR ...] [--family closed_volume spill ...] [--step 0]

Campaigns are folders of recordings, or simulated rigs of some families at five speeds, each speed with its own load,
written as files.

The line pressure is taken as the recording has it (`--load-of`), and from a file as a user would type or export it
(`--pressure`), with a point every so many degrees. The constant zero is that of the angles where the prediction is
sure: weighted by the band, so that an error in one place is not spread over the revolution; the band is that of the
torque less a constant. One line per recording and source of the load: whether its speed lies inside those of the
others, rms error and band width as shares of the peak, share of the revolution inside the pointwise 95 % band, and the
same where the torque is or moves. Where the others do not all end as it does, it is predicted with its own ending,
beside as they end, and where none does with either.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from benches import as_declared, plain_parser, rig_of, write_rows
from camtorque.align import align
from camtorque.finished_fit import chain_of
from camtorque.fit import leftout
from camtorque.fit.endings import EITHER, either, endings_of, load_for
from camtorque.fit.forecast import Forecast, forecast
from camtorque.fit.joint import joint_fit_of, solve_joint
from camtorque.fit.joint_fit import residual_covariance
from camtorque.fit.joint_input import joint_input
from camtorque.fit.known_ends import END_OF, Curve
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.load_file import curve_through
from camtorque.fit.prepare import on_grid
from camtorque.fit.shared_lift import shared_lift_from
from camtorque.fit.single import Prepared, prepare
from camtorque.ingest import read_recording
from camtorque.ingest.pump_file import read_pressure_curve
from camtorque.records import Refusal
from camtorque.rehearsal import rigid_torque
from camtorque.units import BAR, RPM
from compare_twins import recorded
from rigs.families import FAMILIES
from rigs.write import write_recording

STEPS_DEG = (0.0, 0.25, 1.0, 2.0, 3.0)
"""Steps of the file of the load; 0: as the recording has it."""

SPEEDS, SPEED_RATIO = 5, 1.28
"""Speeds of a simulated campaign, each so many times the one before."""

TORQUE_OVER, STEP_OVER = 0.4, 0.02
"""Where the torque is above such a share of its peak, or changes by such a share from one angle to the next, it is
counted apart: elsewhere it is easily predicted."""


def known_fit(used: Sequence[Prepared]) -> KnownFit:
    """Return the joint fit of some recordings as a prediction takes it."""
    inputs = [joint_input(item) for item in used]
    problem, solution = solve_joint(inputs)
    fit = joint_fit_of(inputs, problem, solution)
    others = leftout.left_out(fit)
    found = (row for k, item in enumerate(inputs) for row in leftout.predicted(fit, others, k, item)[0])
    held = {row.name: row.metrics.rms_percent_of_peak / 100.0 for row in found if row.mode == "own_zero_and_end"}
    recordings = [
        FittedAt(item.recording.config.id, item.cycles.mean_speed, data.structure, held[item.recording.config.id], True)
        for item, data in zip(used, problem.data, strict=True)
    ]
    cov = fit.covariance
    lift = shared_lift_from(problem, others.lift)
    return KnownFit(problem.names, solution.z, cov.arrow, tuple(recordings), residual_covariance(solution, cov), lift)


def from_file(left: Prepared, step_deg: float) -> Curve:
    """Return the line pressure of a recording as `predict --pressure` reads it from a file with such steps."""
    angles = np.arange(0.0, 360.0, step_deg)
    values = np.interp(np.radians(angles), left.cycles.theta, left.means.pressure_all / BAR, period=2.0 * np.pi)
    rows = "".join(f"{angle:g},{value:.2f}\n" for angle, value in zip(angles, values, strict=True))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pressure.csv"
        path.write_text(f"cam_angle_deg,pressure_bar\n{rows}", encoding="utf-8")
        return replace(curve_through(read_pressure_curve(path), path.name), speed=left.cycles.mean_speed)


def run_of(known: KnownFit, used: Sequence[Prepared], left: Prepared, step_deg: float, ending: str) -> Forecast:
    """Return a recording that is not in the fit as `predict --from` gives it.

    Parameters
    ----------
    step_deg : of the file with its line pressure; 0 for the line pressure as the recording has it
    ending : see `camtorque.fit.endings.endings_of`
    """
    speed = left.cycles.mean_speed
    curve = Curve(left.cycles.theta, left.means.pressure_all, speed)
    curve = from_file(left, step_deg) if step_deg else curve
    templates = {
        item.recording.config.id: Curve(item.cycles.theta, item.means.pressure_all, item.cycles.mean_speed)
        for item in used
    }
    runs = []
    for source in endings_of(known, speed, ending):
        chain = chain_of(rig_of(left), speed, curve, source.structure)
        runs.append(forecast(known, chain, source, load_for(known, source, templates, chain, curve), {}))
    return either(*runs) if len(runs) > 1 else runs[0]


def predicted(
    known: KnownFit, used: Sequence[Prepared], left: Prepared, step_deg: float, ending: str
) -> dict[str, object]:
    """Return how well a recording that is not in the fit is predicted; see `run_of`."""
    item = run_of(known, used, left, step_deg, ending)
    measured = on_grid(left.means.torque_all, item.theta.size)
    error = measured - item.torque
    zero = float(np.average(error, weights=item.torque_std**-2.0))
    error = error - zero
    speeds = [one.speed for one in known.recordings]
    peak = float(np.max(measured))
    inside = np.abs(error) < 1.96 * item.shape_std
    moving = np.abs(measured) / TORQUE_OVER + np.abs(np.gradient(measured)) / STEP_OVER > peak
    return {
        "left_out": left.recording.config.id, "load": f"file, {step_deg:g} deg" if step_deg else "recording",
        "rpm": round(item.speed / RPM), "inside": min(speeds) < item.speed < max(speeds),
        "ending": item.ending, "rms_percent": round(100.0 * float(np.sqrt(np.mean(error**2))) / peak, 3),
        "band_percent": round(100.0 * 1.96 * float(np.sqrt(np.mean(item.shape_std**2))) / peak, 3),
        "covered_percent": round(100.0 * float(np.mean(inside)), 1),
        "covered_moving_percent": round(100.0 * float(np.mean(inside[moving])), 1),
        "peak_error_percent": round(100.0 * float(np.max(item.torque) + zero - peak) / peak, 3),
        "zero_nm": round(zero, 3),
    }  # fmt: skip


def left_out_rows(prepared: Sequence[Prepared], steps: Sequence[float]) -> list[dict[str, object]]:
    """Return every recording predicted by the others."""
    rows = []
    for k, left in enumerate(prepared):
        used = [item for j, item in enumerate(prepared) if j != k]
        known = known_fit(used)
        own, shown = left.candidates[0].data.structure, {item.structure for item in known.recordings}
        others = () if own not in END_OF else (own,) if len(shown) > 1 else (own, EITHER) if own not in shown else ()
        asked = [(ending, 0.0) for ending in ("", *others[1:])] if others else []
        for ending, step_deg in (*asked, *((others[0] if others else "", step_deg) for step_deg in steps)):
            try:
                rows.append(predicted(known, used, left, step_deg, ending))
            except Refusal as refusal:
                rows.append({"left_out": left.recording.config.id, "load": f"file, {step_deg:g} deg: {refusal}"})
            print(rows[-1], flush=True)
    return rows


def read_campaign(folder: Path) -> list[Prepared]:
    """Return the recordings below a folder with their minima."""
    prepared = []
    for file in sorted(folder.glob("*/recording.toml")):
        recording = read_recording(file)
        cycles = align(recording)
        prepared.append(prepare(recording, cycles, rigid_torque(recording, cycles)))
    return prepared


def simulated_campaign(family: str, seed: int) -> list[Prepared]:
    """Return recordings of a simulated rig at five speeds, each with its own load, as a bench leaves them in files.

    Lift table and sensor sheets are written once; each recording has its own zero readings and drift.
    """
    rng = np.random.default_rng(7000 + seed)
    truth, slowest = as_declared(FAMILIES[family](rng)), float(rng.uniform(300.0, 450.0))
    with tempfile.TemporaryDirectory() as temporary:
        folders = [Path(temporary) / f"{family}_{seed}_{k}" for k in range(SPEEDS)]
        for k, folder in enumerate(folders):
            run = recorded(truth, slowest * SPEED_RATIO**k, float(rng.uniform(0.55, 0.9)), 100 * seed + k)
            write_recording(run, folder, "tdms", seed=100 * seed + k)
            if k:
                shutil.copytree(folders[0] / "calibration", folder / "calibration", dirs_exist_ok=True)
        return read_campaign(Path(temporary))


def main() -> None:
    """Write one line per left-out recording."""
    parser = plain_parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("campaigns", type=Path, nargs="*")
    parser.add_argument("--family", nargs="+", default=[], help="simulated rigs, one of each family")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--step", type=float, nargs="+", default=STEPS_DEG, help="of the file of the load [deg]")
    chosen = parser.parse_args()
    rows: list[dict[str, object]] = []
    for folder in chosen.campaigns:
        rows += left_out_rows(read_campaign(folder), chosen.step)
        write_rows(chosen.out, rows)
    for seed, family in enumerate(chosen.family, chosen.first):
        rows += left_out_rows(simulated_campaign(family, seed), chosen.step)
        write_rows(chosen.out, rows)


if __name__ == "__main__":
    main()
