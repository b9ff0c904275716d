"""The verdict on each case of the damaged corpus.

``refused`` is a pattern of the one line; otherwise ``findings`` are the codes that ingest and its check have to give,
and no other (but those of the shared sheets). What the alignment makes of it stands in `ALIGNED`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from damaged.logs import SUFFIXES


@dataclass(frozen=True)
class Verdict:
    refused: str = ""
    findings: frozenset[str] = frozenset()


def refused(pattern: str) -> Verdict:
    return Verdict(refused=pattern)


def used(*findings: str) -> Verdict:
    return Verdict(findings=frozenset(findings))


OF_THE_SHEETS = frozenset({"lift_negative", "delay_tolerance_assumed", "certificate_age_unknown"})
"""Findings about the sheets in ``calibration/``, the same for every case."""

HEADER_CUTS = {
    "csv": "holds a header but no row of numbers",
    "tdms": "ends inside the description of segment 1",
    "mf4": "are not an MDF 4 identification",
    "hdf5": "cannot be read as HDF5",
    "mat": "are not a MATLAB v5 header",
    "numpy": "file_format says NumPy, but the content is Excel workbook",
    "catman": "cannot be read as catman",
    "xlsx": "cannot be read as Excel workbook",
    "parquet": "cannot be read as Parquet",
    "lvm": "holds 0 segments of data",
}

VERDICTS: dict[str, Verdict] = {
    **{f"clean_{name}": used() for name in SUFFIXES},
    **{f"empty_{name}": refused(r"the file is empty \(0 bytes\)") for name in SUFFIXES},
    **{f"cut_in_header_{name}": refused(pattern) for name, pattern in HEADER_CUTS.items()},
    "cut_half_csv": used("csv_cut_row"),
    "cut_half_tdms": refused("'Prox_Trigger' in group 'Grp_trigger' holds no samples; the file is cut: copy it"),
    "cut_half_mf4": refused("it is cut or damaged"),
    "cut_half_hdf5": refused("truncated file"),
    "cut_half_mat": refused("no whole MATLAB element"),
    "cut_half_numpy": refused("cannot be read as NumPy"),
    "cut_last_byte_numpy": refused("cannot be read as NumPy"),
    "flipped_numpy_deflate": refused("cannot be read as NumPy"),
    "cut_half_catman": refused("of 22000 samples ends at byte"),
    "cut_last_byte_csv": used("csv_cut_row"),
    "cut_last_byte_tdms": used("file_truncated", "samples_missing"),
    "cut_last_byte_mf4": refused("it is cut"),
    "cut_last_byte_hdf5": refused("truncated file"),
    "cut_last_byte_mat": refused("no whole MATLAB element"),
    "cut_last_byte_catman": refused("it is cut"),
    "header_only_csv": refused("holds a header but no row of numbers"),
    "cut_half_uncompressed_mf4": refused("it is cut or damaged"),
    "cut_half_contiguous_hdf5": refused("truncated file"),
    "cut_half_uncompressed_mat": refused("no whole MATLAB element"),
    "cut_mat73": refused("truncated file"),
    "clean_mat73": used(),
    "clean_mat_struct": used(),
    "flipped_hdf5_checksum": refused("samples 0 to 22000: cannot be read as HDF5"),
    "flipped_mf4_deflate": refused("fails its checksum"),
    "flipped_mat_deflate": refused("fails its checksum"),
    "flipped_tdms_lead_in": refused("file_format says TDMS, but the content is"),
    "flipped_csv_digit": used("isolated_samples", "out_of_range"),
    "flipped_csv_separator": used("csv_rows_damaged", "time_stamp_damaged", "samples_not_numbers"),
    "flipped_csv_row_end": used("csv_rows_damaged", "time_stamp_damaged", "samples_not_numbers"),
    "letters_in_csv": used("csv_rows_damaged", "time_stamp_damaged", "samples_not_numbers"),
    "row_missing_csv": used("time_gap"),
    "companion_cut_csv": used("log_ends_early", "starts_together"),
    "unfinished_mf4": refused("never finished it"),
    "unclosed_tdms": used("file_truncated", "samples_missing", "log_ends_early"),
    "wrong_content": refused("file_format says HDF5, but the content is TDMS"),
    "missing_log": refused("no such file, expected a log; recording.toml names logs"),
    **{
        f"dialect_{name}": used()
        for name in (
            "semicolon",
            "tab_bom",
            "brackets",
            "milliseconds",
            "iso_stamps",
            "no_time",
            "crlf",
            "blanks",
            "bars",
            "latin1",
            "day_first",
            "utf16",
            "utf16_plain",
        )
    },
    "dialect_surplus": used("csv_header_longer"),
    "cut_half_xlsx": refused("cannot be read as Excel workbook"),
    "cut_half_parquet": refused("cannot be read as Parquet"),
    "cut_half_lvm": used("csv_cut_row", "samples_missing"),
    "cut_last_byte_xlsx": refused("cannot be read as Excel workbook"),
    "cut_last_byte_parquet": refused("cannot be read as Parquet"),
    "cut_last_byte_lvm": used("csv_no_line_end", "samples_missing"),
    "flipped_xlsx": refused("cannot be read as Excel workbook"),
    "flipped_parquet": refused("cannot be read as Parquet"),
    "segments_lvm": refused("holds 2 segments of data, expected one"),
    "dialect_hint_wrong": used("csv_dialect_differs"),
    "unit_in_file_differs": refused("the file's unit is 'mV', recording.toml says 'V'"),
    "unit_unknown": refused("unknown unit 'Vlt', did you mean 'V'"),
    "unit_of_other_kind": refused("unit 'mm' is a length, expected a torque unit or voltage unit"),
    "channel_unknown": refused("no data set 'Main/Torqe', did you mean 'Main/Torque'"),
    "group_unknown": refused("no group 'Torque', did you mean 'Grp_torque'"),
    "key_missing": refused("nominal_speed_rpm: this key is missing"),
    "key_unknown": used("unknown_key"),
    "key_misspelt": used("unknown_key"),
    "value_impossible": refused("plunger_diameter_m: found -0.008, expected a number from 0.001 to 0.1 m"),
    "rate_contradicts": refused("says 10000 Hz, recording.toml says 20000 Hz; correct the one that is wrong"),
    "rate_off_a_little": used("rate_differs"),
    "nan_run_csv": used("samples_not_numbers"),
    "nan_run_hdf5": used("samples_not_numbers"),
    "gap_csv": used("time_gap"),
    "gap_mf4": used("time_gap"),
    "clock_jump_mat": used("time_gap"),
    "clock_jump_catman": used("time_gap"),
    "time_runs_back_csv": used("time_not_monotonic"),
    "time_not_uniform_csv": refused("the samples are not equidistant"),
    "clipped_pressure": used("pressure_clipped"),
    "clipped_torque": used("torque_clipped"),
    "constant_pressure": used("channel_constant"),
    "constant_trigger": used("channel_constant"),
    "swapped_channels": used("channels_swapped", "torque_beyond_pressure"),
    "inverted_torque": used(),
    "trigger_dies": used(),
    "trigger_wakes_late": used(),
    "trigger_missed": used("pulses_irregular"),
    "trigger_doubled": used("pulses_irregular"),
    "trigger_bounced": used("isolated_samples"),
    "misfire": used(),
    "speed_ramp": used(),
    "start_stop": used(),
    "three_cycles_only": used(),
    "two_loggers": used(),
    "two_loggers_one_trigger": used(),
    "spike_tdms": used("isolated_samples"),
    "out_of_range_tdms": used("out_of_range"),
}
"""Name of a case -> what the product says about it."""


@dataclass(frozen=True)
class Aligned:
    """``lost``: complete cycles left out, by reason; ``found``: complete cycles where not 21."""

    lost: dict[str, int] = field(default_factory=dict)
    findings: frozenset[str] = frozenset()
    found: int = 21
    refused: str = ""


def aligned(*findings: str, found: int = 21, **lost: int) -> Aligned:
    return Aligned(lost, frozenset(findings), found)


SOUND = aligned()
HOLE = aligned("trigger_drop_out", drop_out=1)
PAUSE = aligned(clock_jump=2)

ALIGNED: dict[str, Aligned] = {
    "cut_half_csv": aligned(found=10),
    "cut_half_lvm": aligned(found=10),
    "companion_cut_csv": aligned(found=14),
    "unclosed_tdms": aligned(found=20),
    "three_cycles_only": aligned(found=3),
    "flipped_csv_digit": aligned(outlier=1),
    "flipped_csv_separator": HOLE,
    "flipped_csv_row_end": HOLE,
    "letters_in_csv": HOLE,
    "nan_run_csv": aligned(drop_out=1),
    "nan_run_hdf5": aligned(drop_out=1),
    "row_missing_csv": PAUSE,
    "gap_csv": PAUSE,
    "gap_mf4": PAUSE,
    "time_runs_back_csv": PAUSE,
    "clock_jump_mat": aligned("clock_jump", clock_jump=2),
    "clock_jump_catman": aligned("clock_jump", clock_jump=2),
    "clipped_pressure": Aligned(refused=r"most fail 'pressure_clipped' \(\d+: .*\); put that right at the rig"),
    "clipped_torque": Aligned(refused="most fail 'torque_clipped'"),
    "constant_pressure": Aligned(refused="the pressure does not follow the cam"),
    "constant_trigger": Aligned(refused="found 0 trigger pulses"),
    "swapped_channels": Aligned(refused="torque and pressure are swapped"),
    "speed_ramp": Aligned(refused="most fail 'start_stop'"),
    "start_stop": aligned(found=22, start_stop=2),
    "inverted_torque": aligned("torque_inverted"),
    "trigger_dies": aligned("trigger_silent", found=10),
    "trigger_wakes_late": aligned("trigger_silent", found=10),
    "trigger_missed": aligned("trigger_missed"),
    "trigger_doubled": aligned("trigger_doubled"),
    "trigger_bounced": aligned("trigger_bounced"),
    # The corpus' misfire is a channel that stands still for a revolution, which reaches into two cycles.
    "misfire": aligned(drop_out=2),
    "two_loggers": aligned("clock_lag_ambiguous"),
    "two_loggers_one_trigger": aligned("clock_from_physics", "clock_lag_ambiguous"),
    "spike_tdms": aligned(outlier=1),
    "out_of_range_tdms": aligned(pressure_clipped=1),
}
"""Cases whose cycles are not all used, or with a finding of the alignment; the others are `SOUND`."""
