"""The friction of a pump as a fit found it: result.json of a run -> coefficients for the design."""

from __future__ import annotations

import tomllib
from pathlib import Path

from camtorque.config_pump import PumpConfig
from camtorque.records import Refusal
from camtorque.results import read_result

FACTORS = {"-": 1.0, "um": 1.0e-6, "µm": 1.0e-6, "mm": 1.0e-3, "m": 1.0}
NAMES = ("guide_friction", "bearing_arm", "pin_arm")


def fitted_friction(path: Path, config: PumpConfig) -> tuple[float, float, float]:
    """Return guide coefficient, bearing and pin arm [-, m, m] of a fit of the same pump.

    Raises
    ------
    Refusal : not the result of a run, of another pump, or a pump file without an id to compare
    """
    document = read_result(path)
    here = str(tomllib.loads(config.text).get("pump", {}).get("id", ""))
    there = str(document["recording"].get("pump", ""))
    if not here or here != there:
        raise Refusal(
            f"{path}: is a fit of the pump {there!r}, expected that of {config.path}, whose id is {here!r}; name the "
            "fit of this pump, or give it the same id where it is the same"
        )
    rows = [document["parameters"].get(name, {"value": 0.0, "unit": "-"}) for name in NAMES]
    guide, bearing, pin = (float(row["value"]) * FACTORS[row["unit"]] for row in rows)
    return guide, bearing, pin
