"""What a fit says about the lift table it was given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from camtorque.fit.result import table_findings
from camtorque.records import CamTable
from rig_bridge import cam_table
from rigs.rig import simulate
from rigs.truth import RigTruth


def table(noise: float) -> CamTable:
    return cam_table(simulate(RigTruth(), speed_rpm=1200, n_cycles=4, seed=0, step=2e-5), noise=noise)


def test_clean_table_is_not_mentioned():
    assert table_findings(table(0.0)) == ()


def test_scatter_beyond_rounding_is_told():
    (finding,) = table_findings(table(1.0e-6))
    assert finding.code == "lift_scatter"
    assert "smoothed by its scatter" in finding.text


def test_point_that_sticks_out_is_a_warning_with_its_angle():
    clean = table(0.0)
    lift = clean.lift.copy()
    lift[40] += 50e-6
    (finding,) = [f for f in table_findings(replace(clean, lift=lift)) if f.code == "lift_outlier"]
    assert finding.severity == "warning"
    assert finding.where == f"{np.rad2deg(clean.theta[40]):.1f} deg"
