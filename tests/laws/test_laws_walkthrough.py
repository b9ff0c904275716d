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
EDITS = {
    "laws/damping.py": [
        (
            "ROWS = (\n",
            'ROWS = (\n    display("shaft_churning", "c_h", "N m s^2", 1.0, (0.0, 0.0, 0.01, 1e-5), (0.0, 1e-4),\n'
            '            "churning of the oil bath", "grows with the square of speed", "shared", True),\n',
        )
    ],
    "laws/torque.py": [
        ('"packing_force", "packing_friction",\n', '"packing_force", "packing_friction", "shaft_churning",\n'),
        ("f_pack, s_pack = coefficients", "f_pack, s_pack, c_churn = coefficients"),
        ("columns = np.empty((n, 9))", "columns = np.empty((n, 10))"),
        ("        columns[i, 3] = w\n", "        columns[i, 3] = w\n        columns[i, 9] = w * w\n"),
        (") / guide + c_shaft\n", ") / guide + c_shaft + 2.0 * c_churn * w\n"),
    ],
    "fit/evidence.py": [
        ('("shaft_viscous", "plunger_viscous")', '("shaft_viscous", "plunger_viscous", "shaft_churning")')
    ],
}
"""File -> what is replaced by what, as the page says."""
USE = """
import numpy as np
from camtorque.fit.evidence import LOSSES
from camtorque.laws import LAW_OF, ROWS
from camtorque.laws.causes import CAUSES, LOSS_GROUPS
from camtorque.laws.chain import COLUMN_NAMES, evaluate
from camtorque.laws.torque import LINEAR_NAMES, cam_torque
from laws_cases import chain_input, start_values

name = "shaft_churning"
assert LAW_OF[name] == "damping" and ROWS[name].is_linear
assert LINEAR_NAMES[-1] == name and COLUMN_NAMES[-2:] == (name, "torque_zero")
assert name in CAUSES and name in LOSS_GROUPS["damping"] and name in LOSSES["damping"]
data = chain_input(uses_chamber=False)
output = evaluate(data, start_values())
column = output.linear[:, COLUMN_NAMES.index(name)]
assert abs(column.mean() / data.speed**2 - 1.0) < 0.02

lift, one = data.law.derivatives(data.theta, 3), np.ones(data.theta.size)
c = np.zeros(len(LINEAR_NAMES))
c[-1] = 3e-4
def torque(rate):
    whole, columns, by, *_ = cam_torque(data.pump_numbers, 0.0, lift, rate * one, 0.0 * one, data.line_pressure, c)
    return whole + columns @ c, by[1]
slope = (torque(60.01)[0] - torque(59.99)[0]) / 0.02
assert np.max(np.abs(slope - torque(60.0)[1])) < 1e-6
"""


def test_a_friction_law_is_added_as_the_page_says(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "camtorque", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "laws_cases.py").write_text(changed_cases(), encoding="utf-8")
    for name, edits in EDITS.items():
        path = tmp_path / "camtorque" / name
        text = path.read_text(encoding="utf-8")
        for old, new in edits:
            assert text.count(old) == 1, f"{name}: {old!r}"
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]


def changed_cases():
    """Return the cases of these tests with a value for the new column."""
    text = (Path(__file__).parent / "laws_cases.py").read_text(encoding="utf-8")
    assert text.count("12.0, 0.01, 0.3]") == 1
    return text.replace("12.0, 0.01, 0.3]", "12.0, 0.01, 1e-4, 0.3]")


def test_the_page_names_every_file_that_it_takes():
    text = (ROOT / "docs" / "adding_a_law.md").read_text(encoding="utf-8")
    for name in EDITS:
        assert f"`{name}`" in text
