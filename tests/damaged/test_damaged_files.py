"""The damaged files itself, small: its judge, and a few mutations of each kind of file."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import damaged_files as campaign
from damaged_files import Reading


def test_the_judge():
    clean = Reading("read", frozenset({("known", "", "")}))
    assert campaign.judge(clean, Reading("hang")) == "hang"
    assert campaign.judge(clean, Reading("refused")) == "flagged"
    assert campaign.judge(clean, Reading("read", frozenset({("new", "", "")}), change=1.0)) == "flagged"
    assert campaign.judge(clean, Reading("read", clean.codes)) == "harmless"
    assert campaign.judge(clean, Reading("read", clean.codes, change=1e-5)) == "small"
    assert campaign.judge(clean, Reading("read", clean.codes, change=0.1)) == "silent"


def test_change_is_relative_to_the_range_of_the_channel():
    head, values = np.array([0.0, 1.0, 1.0, 1.0]), np.array([0.0, 4.0, 2.0])
    assert campaign.change_of((head, values), (head, np.array([0.0, 4.0, 3.0]))) == 0.25
    assert campaign.change_of((head, values), (head + 1.0, values)) == np.inf
    assert campaign.change_of((head, values), (head, values[:2])) == np.inf


@pytest.mark.parametrize(
    "name", ["TDMS", "MF4 deflate", "HDF5 fletcher32 + gzip", "MAT v5 compressed", "NumPy archive", "catman"]
)
def test_declared_lengths_catch_every_cut_and_checksums_every_flip(name: str, tmp_path: Path):
    counts, _ = campaign.run_target(name, 6, 7, tmp_path)
    assert counts["truncation"]["flagged"] == 6
    if name not in ("TDMS", "catman"):
        assert counts["flip"]["silent"] + counts["flip"]["small"] == 0
    both = counts["truncation"] + counts["flip"]
    assert both["crash"] + both["hang"] + both["foreign"] == 0
