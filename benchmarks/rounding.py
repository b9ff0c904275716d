"""What rounding alone decides: every recording fitted again with all samples larger by parts in 10^12.

    python benchmarks/rounding.py RECORDING... [--draws 4] [--workers 2] [--write FILE]

Another machine, or another version of a library, changes as much. Where a fit then ends in another minimum, its trigger
angle moves: by how many of its standard uncertainties, and whether the page warns of it, is what the table says.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from benches import plain_parser, tell
from camtorque.align import AlignOptions, align
from camtorque.fit.result import fitted_torque
from camtorque.fit.single import fit_prepared, prepare
from camtorque.ingest import read_recording
from camtorque.rehearsal import rigid_torque

PART = 1.0e-12
APART = 0.5
"""Standard uncertainties of the trigger angle between draws from which a recording gets a line of its own."""
TRIGGER = "trigger_offset"


@dataclass(frozen=True)
class Draw:
    """One fit: chi-square, the trigger angle with its standard uncertainty [deg], codes of its findings."""

    chi_square: float
    angle: float
    std: float
    codes: tuple[str, ...]


def drawn(folder: Path, draw: int) -> Draw:
    """Return the fit of a recording whose samples are larger by so many parts."""
    recording = read_recording(folder)
    cycles = align(recording, AlignOptions())
    assert cycles.torque is not None
    torque, pressure = ((1.0 + PART * draw) * values for values in (cycles.torque, cycles.pressure))
    cycles = replace(cycles, torque=torque, pressure=pressure)
    rigid = rigid_torque(recording, cycles)
    prepared = prepare(recording, cycles, rigid)
    fitted = fitted_torque(fit_prepared(prepared), recording, cycles, rigid, prepared.means)
    trigger = next(item for item in fitted.parameters if item.name == TRIGGER)
    codes = tuple(finding.code for finding in fitted.findings)
    return Draw(prepared.candidates[0].value, trigger.value, trigger.stderr, codes)


def apart(draws: Sequence[Draw]) -> float:
    """Return how far the trigger angles of draws lie apart, in their mean standard uncertainty."""
    return float(np.ptp([draw.angle for draw in draws]) / np.mean([draw.std for draw in draws]))


def table(found: dict[str, list[Draw]]) -> str:
    """Return the table of what moves."""
    moving = {name: draws for name, draws in found.items() if apart(draws) > APART}
    spread = [apart(draws) for draws in found.values()]
    rows = [
        f"{len(found)} recordings, {len(next(iter(found.values())))} draws each: the trigger angle moves by "
        f"{np.median(spread):.2f} standard uncertainties in the median, {np.percentile(spread, 90):.2f} in nine of ten",
        "",
        f"| recording that moves by more than {APART:g} | chi-square | trigger, deg | its standard uncertainty, deg "
        "| draws whose page warns (`not_converged`) |",
        "|---|---|---|---|---|",
    ]
    for name, draws in moving.items():
        chi, angles = ([f"{getattr(draw, key):.4g}" for draw in draws] for key in ("chi_square", "angle"))
        warned = sum("not_converged" in draw.codes for draw in draws)
        std = np.mean([draw.std for draw in draws])
        rows.append(f"| {name} | {', '.join(chi)} | {', '.join(angles)} | {std:.2f} | {warned} of {len(draws)} |")
    return "\n".join(rows) + "\n"


def main() -> None:
    """Fit the recordings and print, or write, the table."""
    parser = plain_parser(__doc__)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    jobs = [(folder, draw) for folder in arguments.recordings for draw in range(arguments.draws)]
    found: dict[str, list[Draw]] = {}
    with ProcessPoolExecutor(arguments.workers) as pool:
        for (folder, _), draw in zip(jobs, pool.map(drawn, *zip(*jobs, strict=True)), strict=True):
            found.setdefault(folder.name, []).append(draw)
            print(folder.name, draw, flush=True)
    tell(table(found), arguments.write)


if __name__ == "__main__":
    main()
