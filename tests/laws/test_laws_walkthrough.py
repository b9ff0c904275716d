"""docs/adding_a_law.md done to a copy of the package: a friction law is added, and every registry knows it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import camtorque

PACKAGE = Path(camtorque.__file__).parent
ROOT = Path(__file__).resolve().parents[2]
LAW = '''"""Churning of the oil bath: torque with the square of speed, and with the lift that dips into it."""

from __future__ import annotations

from camtorque.compiled import njit

from camtorque.laws.rows import Law, on_shaft, parameter

ROWS = (
    parameter("shaft_churning", "c_h", "N m s^2", 1.0, (0.0, 0.0, 0.01, 1e-5), (0.0, 1e-4),
            "churning of the oil bath", "grows with the square of speed"),
)  # fmt: skip


@njit
def columns(at):
    """Return the column of c_h w^2 (1 + y)."""
    dip = 1.0 + at.lift
    return (on_shaft(at.rate * at.rate * dip, at.rate * at.rate * at.slope, 2.0 * at.rate * dip),)


LAW = Law(ROWS, columns, loss="churning")
'''
"""The one file, `laws/churning.py`, as the page shows it."""
EDITS = [
    ("    chamber,\n    damping,", "    chamber,\n    churning,\n    damping,"),
    ('    "bridge": bridge.LAW,\n', '    "bridge": bridge.LAW,\n    "churning": churning.LAW,\n'),
]
"""The line of `laws/__init__.py`, and its import."""
USE = """
import numpy as np
from camtorque.fit.evidence import LOSSES
from camtorque.fit.verdicts import BALANCE_LOSSES as DIFFERENCES
from camtorque.laws import LAW_OF, LINEAR_NAMES, ROWS
from camtorque.laws.causes import CAUSES, LOSS_GROUPS
from camtorque.laws.chain import COLUMN_NAMES, evaluate
from camtorque.laws.torque import cam_torque
from laws_cases import chain_input, start_values

name = "shaft_churning"
assert LAW_OF[name] == "churning"
assert LINEAR_NAMES[-1] == name and COLUMN_NAMES[-4:-2] == (name, "torque_zero")
assert name in CAUSES and LOSS_GROUPS["churning"] == LOSSES["churning"] == DIFFERENCES["churning"] == (name,)
data = chain_input(uses_chamber=False)
output = evaluate(data, start_values())
column = output.linear[:, COLUMN_NAMES.index(name)]
assert abs(column.mean() / data.speed**2 - 1.0) < 0.02

law, one = data.law, np.ones(data.theta.size)
c = np.zeros(len(LINEAR_NAMES))
c[-1] = 3e-4
def torque(rate, shift):
    theta = data.theta + shift
    lift, rates = law.derivatives(theta, 3), (rate * one, 0.0 * one)
    whole, columns, by, *_ = cam_torque(data.constants, 0.0, theta, lift, *rates, data.line_pressure, c, True)
    return whole + columns @ c, by
for row, (rate, shift) in enumerate([(0.0, 1e-5), (0.01, 0.0)]):
    slope = (torque(60.0 + rate, shift)[0] - torque(60.0 - rate, -shift)[0]) / (2.0 * (rate + shift))
    assert np.max(np.abs(slope - torque(60.0, 0.0)[1][0, row])) < 1e-4, row
"""


def test_a_friction_law_is_added_as_the_page_says(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "camtorque", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "laws_cases.py").write_text(changed_cases(), encoding="utf-8")
    (tmp_path / "camtorque" / "laws" / "churning.py").write_text(LAW, encoding="utf-8")
    path = tmp_path / "camtorque" / "laws" / "__init__.py"
    text = path.read_text(encoding="utf-8")
    for old, new in EDITS:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["NUMBA_OPT"] = "0"  # it runs once: what matters is that it compiles, and what comes out
    done = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]


def changed_cases():
    """Return the cases of these tests with a value for the new column."""
    text = (Path(__file__).parent / "laws_cases.py").read_text(encoding="utf-8")
    assert text.count("-0.07, 0.3, ") == 1
    return text.replace("-0.07, 0.3, ", "-0.07, 1e-4, 0.3, ")


def test_the_page_shows_this_law():
    text = (ROOT / "docs" / "adding_a_law.md").read_text(encoding="utf-8")
    assert LAW in text
    assert "`laws/churning.py`" in text
    assert '"churning": churning.LAW,' in text
