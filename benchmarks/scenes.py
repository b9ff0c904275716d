"""Are the causes right? Simulated benches whose losses are known, as files; what `camtorque run` says of each loss.

A scene is a pump on the independent rig (`tests/rigs`) that has none of the losses, one of them, or all; transducers,
trigger and certificates are those of a usual bench in every scene. Each loss of each draw is one verdict: right, wrong,
or "cannot tell". A scene's draw is right where every verdict is, wrong where one is, else it cannot tell.

    python benchmarks/scenes.py --draws 30 --workers 2 --write docs/scenes_figures.md
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from benches import bench_parser, outcomes, run_from_files, tell
from rigs.families import closed_volume, spill
from rigs.rig import simulate
from rigs.truth import NO_FRICTION, RIGID_DRIVELINE, RigTruth, change

FRICTION = ("bearing_mu", "bearing_mu_static", "pin_mu", "guide_mu", "seal_force", "drag_torque")
DAMPING = ("plunger_viscous", "shaft_viscous")
LOSSES = ("chamber", "friction", "damping", "driveline")
SCENES: dict[str, tuple[str, ...]] = {
    "none": (), "friction": ("friction",), "viscous": ("damping",), "compliance": ("driveline",),
    "chamber": ("chamber",), "all": LOSSES,
}  # fmt: skip
"""Scene -> losses that it has."""
RIGHT = {True: "needed", False: "not needed"}


def scene_of(name: str, draw: int) -> RigTruth:
    """Return a draw of a scene; every second pump ends its delivery by spill."""
    rng = np.random.default_rng([7000 + draw, list(SCENES).index(name)])
    truth = (spill if draw % 2 else closed_volume)(rng)
    present = SCENES[name]
    without = {f"friction__{key}": getattr(NO_FRICTION, key) for group, keys in
               (("friction", FRICTION), ("damping", DAMPING)) if group not in present for key in keys}  # fmt: skip
    truth = change(truth, name=f"{name}_{draw}", **without)
    if "driveline" not in present:
        truth = change(truth, driveline=RIGID_DRIVELINE)
    return truth if "chamber" in present else change(truth, pressure_sensor__at="chamber")


def verdicts_of(name: str, draw: int, cycles: int) -> Mapping[str, str]:
    """Return loss -> verdict of one draw, or the reason why there is none."""
    truth = scene_of(name, draw)
    rng = np.random.default_rng([8000 + draw])
    run = simulate(truth, float(rng.uniform(400.0, 1300.0)), float(rng.uniform(0.55, 0.95)), n_cycles=cycles,
                   seed=draw, step=1e-5)  # fmt: skip
    with tempfile.TemporaryDirectory() as temporary:
        refused, result = run_from_files(run, Path(temporary), ("hdf5", "single"), draw)
    return {"refused": refused} if refused else {loss: result["evidence"][loss]["verdict"] for loss in LOSSES}


def judged(name: str, verdicts: Mapping[str, str]) -> Counter[str]:
    """Return how many verdicts of a draw are right, wrong and open."""
    counted: Counter[str] = Counter()
    for loss in LOSSES:
        said = verdicts.get(loss, "refused")
        right = said == RIGHT[loss in SCENES[name]]
        counted["right" if right else "cannot tell" if said == "cannot tell" else "wrong"] += 1
    return counted


def table(drawn: list[tuple[str, Mapping[str, str]]]) -> str:
    """Return a line a scene."""
    lines = [
        "| scene | draws | right | cannot tell | wrong | verdicts right / cannot tell / wrong | wrong ones |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in [*dict.fromkeys(scene for scene, _ in drawn), ""]:
        group = [(scene, said) for scene, said in drawn if not name or scene == name]
        each = [judged(scene, said) for scene, said in group]
        wrong = sum(one["wrong"] > 0 for one in each)
        right = sum(one["right"] == len(LOSSES) for one in each)
        total = sum(each, Counter())
        errors = Counter(
            f"{loss} {said.get(loss, 'refused')}" for scene, said in group for loss in LOSSES
            if said.get(loss) not in (RIGHT[loss in SCENES[scene]], "cannot tell")
        )  # fmt: skip
        told = ", ".join(f"{count} x {what}" for what, count in errors.most_common()) or "-"
        lines.append(
            f"| {name or 'all scenes'} | {len(group)} | {right} | {len(group) - right - wrong} | {wrong} | "
            f"{total['right']} / {total['cannot tell']} / {total['wrong']} | {told} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the scenes and print, or write, the table."""
    parser = bench_parser(__doc__)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    arguments = parser.parse_args()
    draws = range(arguments.first, arguments.first + arguments.draws)
    jobs = [(name, draw, arguments.cycles) for name in arguments.scenes for draw in draws]
    drawn = []
    for (name, draw, _), said in outcomes(lambda job: verdicts_of(*job), jobs, arguments.workers):
        drawn.append((name, said))
        print(name, draw, dict(judged(name, said)), dict(said), flush=True)
    tell(table(drawn), arguments.write)


if __name__ == "__main__":
    main()
