"""What the alignment makes of the corpus: cycles lost and why, findings, or the refusal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from camtorque.align import align
from camtorque.ingest import read_recording
from camtorque.records import Refusal
from damaged.build import BUILDERS
from damaged.cases import VERDICTS


@dataclass(frozen=True)
class Aligned:
    """``lost``: complete cycles left out, by reason; ``found``: complete cycles where not 21."""

    lost: dict[str, int] = field(default_factory=dict)
    findings: frozenset[str] = frozenset()
    found: int = 21
    refused: str = ""


def used(*findings: str, found: int = 21, **lost: int) -> Aligned:
    return Aligned(lost, frozenset(findings), found)


SOUND = used()
HOLE = used("trigger_drop_out", drop_out=1)
PAUSE = used(clock_jump=2)

ALIGNED: dict[str, Aligned] = {
    "cut_half_csv": used(found=10),
    "cut_half_lvm": used(found=10),
    "companion_cut_csv": used(found=14),
    "unclosed_tdms": used(found=20),
    "three_cycles_only": used(found=3),
    "flipped_csv_digit": used(outlier=1),
    "flipped_csv_separator": HOLE,
    "flipped_csv_row_end": HOLE,
    "letters_in_csv": HOLE,
    "nan_run_csv": used(drop_out=1),
    "nan_run_hdf5": used(drop_out=1),
    "row_missing_csv": PAUSE,
    "gap_csv": PAUSE,
    "gap_mf4": PAUSE,
    "time_runs_back_csv": PAUSE,
    "clock_jump_mat": used("clock_jump", clock_jump=2),
    "clock_jump_catman": used("clock_jump", clock_jump=2),
    "clipped_pressure": Aligned(refused="most fail 'pressure_clipped'"),
    "clipped_torque": Aligned(refused="most fail 'torque_clipped'"),
    "constant_pressure": Aligned(refused="the pressure does not follow the cam"),
    "constant_trigger": Aligned(refused="found 0 trigger pulses"),
    "swapped_channels": Aligned(refused="torque and pressure are swapped"),
    "speed_ramp": Aligned(refused="most fail 'start_stop'"),
    "start_stop": used(found=22, start_stop=2),
    "inverted_torque": used("torque_inverted"),
    "trigger_dies": used("trigger_silent", found=10),
    "trigger_wakes_late": used("trigger_silent", found=10),
    "trigger_missed": used("trigger_missed"),
    "trigger_doubled": used("trigger_doubled"),
    "trigger_bounced": used("trigger_bounced"),
    # The corpus' misfire is a channel that stands still for a revolution, which reaches into two cycles.
    "misfire": used(drop_out=2),
    "two_loggers": used("clock_lag_ambiguous"),
    "two_loggers_one_trigger": used("clock_from_physics", "clock_lag_ambiguous"),
    "spike_tdms": used(outlier=1),
    "out_of_range_tdms": used(pressure_clipped=1),
}
"""Cases whose cycles are not all used, or with a finding of the alignment; the others are `SOUND`."""


def test_the_table_names_cases_of_the_corpus() -> None:
    assert set(ALIGNED) <= {name for name, verdict in VERDICTS.items() if not verdict.refused}


@pytest.mark.parametrize("name", sorted(name for name in BUILDERS if not VERDICTS[name].refused))
def test_alignment_of(name: str, corpus: Callable[[str], Path]) -> None:
    expected = ALIGNED.get(name, SOUND)
    recording = read_recording(corpus(name))
    if expected.refused:
        with pytest.raises(Refusal, match=expected.refused) as caught:
            align(recording)
        assert "\n" not in str(caught.value)
        return
    cycles = align(recording)
    lost = {row.reason: row.cycles for row in cycles.cut_flow if row.cycles and row.reason != "incomplete"}
    assert lost == expected.lost
    assert cycles.cycles_found == expected.found
    # the note that every recording with one pulse per revolution carries
    assert {finding.code for finding in cycles.findings} - {"ripple_unseen"} == expected.findings
    if VERDICTS[name].lost is not None:
        assert sum(lost.values()) == VERDICTS[name].lost
