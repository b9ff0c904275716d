"""The oldest versions that pyproject.toml allows, as requirements; and whether two results say the same.

python .ci/oldest.py pins                        print numpy==1.26.* and so on
python .ci/oldest.py same A/result.json B/result.json
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path

LARGEST_SHARE = 0.5
"""Largest difference of a value as a share of its standard uncertainty."""
LARGEST_RMS = 2.0e-3
"""Largest difference of a residual [N m]."""


def pins(project: Path) -> list[str]:
    """Return every dependency, those of tables included, at the oldest minor version that is declared."""
    content = tomllib.loads(project.read_text(encoding="utf-8"))["project"]
    declared = [*content["dependencies"], *content["optional-dependencies"]["tables"]]
    found = [re.fullmatch(r"([\w-]+)>=([\d.]+)", item) for item in declared]
    assert all(found), declared
    return [f"{item[1]}=={'.'.join(item[2].split('.')[:2])}.*" for item in found if item is not None]


def differences(first: dict, second: dict) -> list[str]:
    """Return what two results of one recording say differently."""
    told = []
    if first["effects"] != second["effects"]:
        told.append(f"effects: {first['effects']} and {second['effects']}")
    for name, one in first["parameters"].items():
        other = second["parameters"][name]
        if abs(one["value"] - other["value"]) > LARGEST_SHARE * (one["stderr"] or abs(one["value"])):
            told.append(f"{name}: {one['value']} and {other['value']}, uncertain by {one['stderr']}")
    for name, one in first["metrics"].items():
        if abs(one["rms_nm"] - second["metrics"][name]["rms_nm"]) > LARGEST_RMS:
            told.append(f"{name}: {one['rms_nm']} and {second['metrics'][name]['rms_nm']} N m")
    return told


if __name__ == "__main__":
    if sys.argv[1] == "pins":
        print("\n".join(pins(Path("pyproject.toml"))))
    else:
        found = differences(*(json.loads(Path(path).read_text(encoding="utf-8")) for path in sys.argv[2:4]))
        print("\n".join(found) or "the same numbers")
        sys.exit(bool(found))
