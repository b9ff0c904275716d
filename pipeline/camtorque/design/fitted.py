"""What a fit knows of the pump to be improved: friction coefficients, chamber pressure under a load."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from camtorque.config.pump import PressureCurve, PumpConfig
from camtorque.mechanism.cam import CamLaw
from camtorque.records import Array, ReadOnly, Refusal
from camtorque.results import read_result

FACTORS = {"-": 1.0, "um": 1.0e-6, "µm": 1.0e-6, "mm": 1.0e-3, "m": 1.0}
FRICTION_NAMES = ("guide_friction", "bearing_arm", "pin_arm")
"""Parameters of a fit that make the friction of a pump file."""


@dataclass(frozen=True)
class FittedStroke(ReadOnly):
    """The fitted chamber under the load of a recording.

    Attributes
    ----------
    recording : its name
    pressure : on the plunger over the angle of the fitted cam
    delivering : share of the plunger's flow that leaves for the line, at the angles of ``pressure``; empty where no
        chamber was fitted, which alone would tell it
    """

    recording: str
    pressure: PressureCurve
    delivering: Array


@dataclass(frozen=True)
class FittedPump:
    """A pump as a fit knows it.

    Attributes
    ----------
    path : of the fit, for messages
    pump_id : of its recordings
    friction : guide coefficient, bearing and pin arm [-, m, m]
    law : lift of the cam that it was fitted with
    recordings : names of what was fitted
    stroke : recording ("" for the one nearest in speed), speed [rad/s] -> what the fitted chamber does there
    """

    path: Path
    pump_id: str
    friction: tuple[float, float, float]
    law: CamLaw
    recordings: tuple[str, ...]
    stroke: Callable[[str, float], FittedStroke]


def fitted_friction(path: Path, config: PumpConfig) -> tuple[float, float, float]:
    """Return guide coefficient, bearing and pin arm [-, m, m] of a fit of the same pump.

    Raises
    ------
    Refusal : not the result of a run, of another pump, or a pump file without an id to compare
    """
    document = read_result(path)
    same_pump(path, config, str(document["recording"].get("pump", "")))
    rows = [document["parameters"].get(name, {"value": 0.0, "unit": "-"}) for name in FRICTION_NAMES]
    guide, bearing, pin = (float(row["value"]) * FACTORS[row["unit"]] for row in rows)
    return guide, bearing, pin


def same_pump(path: Path, config: PumpConfig, there: str) -> None:
    """Refuse a fit of another pump, or a pump file without an id to compare."""
    here = str(tomllib.loads(config.text).get("pump", {}).get("id", ""))
    if not here or here != there:
        raise Refusal(
            f"{path}: is a fit of the pump {there!r}, expected that of {config.path}, whose id is {here!r}; name the "
            "fit of this pump, or give it the same id where it is the same"
        )
