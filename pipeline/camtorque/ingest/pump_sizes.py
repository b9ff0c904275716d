"""Sizes of one pump that are each within their band but cannot belong together: slips of unit, diameters for radii.

The limits come from 46 pumps of three makers, for which the ratios lie in ``seen``, and from sizes of built ones (fuel
pumps of cars to ships); what lies well outside is reported, what lies far outside is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camtorque.config import PumpData
from camtorque.config.tables import Problems
from camtorque.ingest.cam_table import outliers_text
from camtorque.records import CamTable, Finding
from camtorque.units import STEEL_DENSITY, short

SMOOTHED = 5.0
"""Slopes and bends of a lift table are taken over this many degrees, to suppress its noise."""

STEEL = 210.0e9
"""Young's modulus of steel [Pa]; cast iron and titanium have half of it, ceramics 1.5 and tungsten carbide 3 times."""


@dataclass(frozen=True)
class Ratio:
    """A ratio of sizes of one pump: what it is, its value, limits, the keys to look at."""

    what: str
    value: Callable[[PumpData, CamTable], float]
    seen: tuple[float, float]
    usual: tuple[float, float]
    possible: tuple[float, float]
    keys: str


def _steel(radius: float) -> float:
    return STEEL_DENSITY * radius**3


def _mean(*sizes: float) -> float:
    return float(math.prod(sizes)) ** (1.0 / len(sizes))


def _roller_disc(pump: PumpData) -> float:
    """Return the mass of a steel disc as large as the roller [kg]."""
    return STEEL_DENSITY * math.pi * pump.roller_radius**2 * pump.roller_width


def _pitch_curvature(pump: PumpData, table: CamTable) -> float:
    """Return roller radius times the largest curvature of its centre's path: at 1 the cam ends in a point."""
    step = np.radians(SMOOTHED)
    angle = np.arange(0.0, 2.0 * np.pi, step)
    before, lift, after = (table.at(angle + d) for d in (-step, 0.0, step))
    slope, bend = (after - before) / (2.0 * step), (after - 2.0 * lift + before) / step**2
    away, offset = slope - pump.follower_offset, pump.follower_offset
    centre = np.sqrt(max((pump.base_circle_radius + pump.roller_radius) ** 2 - offset**2, 0.0)) + lift
    curvature = (centre**2 + away * (slope + away) - centre * bend) / np.hypot(centre, away) ** 3
    return float(np.max(curvature)) * pump.roller_radius


PUMP_RATIOS: dict[str, Ratio] = {
    "lift": Ratio("largest lift over base circle radius", lambda p, t: float(np.max(t.lift)) / p.base_circle_radius,
                  (0.24, 0.54), (0.03, 1.0), (0.003, 1.6), "the unit of the lift table, base_circle_radius_m"),
    "plunger": Ratio("plunger diameter over base circle radius", lambda p, t: p.plunger_diameter / p.base_circle_radius,
                     (0.25, 0.68), (0.08, 1.6), (0.02, 3.0), "plunger_diameter_m, base_circle_radius_m"),
    "roller": Ratio("roller radius over base circle radius", lambda p, t: p.roller_radius / p.base_circle_radius,
                    (0.25, 0.59), (0.08, 1.6), (0.02, 4.0), "roller_radius_m, base_circle_radius_m"),
    "roller_width": Ratio("roller width over its radius", lambda p, t: p.roller_width / p.roller_radius,
                          (0.6, 1.5), (0.1, 6.0), (0.02, 20.0), "roller_width_m, roller_radius_m"),
    "size": Ratio("mean of largest lift and plunger diameter over base circle radius",
                  lambda p, t: _mean(float(np.ptp(t.lift)), p.plunger_diameter) / p.base_circle_radius,
                  (0.22, 0.54), (0.21, 0.85), (0.02, 3.0),
                  "base_circle_radius_m (is it the diameter?), the lift table, plunger_diameter_m (is it the radius?)"),
    "roller_size": Ratio("roller radius over the mean of largest lift, plunger diameter and 0.4 base circle radii",
                         lambda p, t: p.roller_radius / _mean(float(np.ptp(t.lift)), p.plunger_diameter,
                                                              0.4 * p.base_circle_radius),
                         (0.72, 1.7), (0.62, 1.8), (0.05, 10.0),
                         "roller_radius_m (is it the diameter?), base_circle_radius_m, the lift table"),
    "undercut": Ratio("roller radius times the curvature of its path about the cam, which no cam can drive above 1,",
                      _pitch_curvature, (0.28, 0.7), (0.0, 0.85), (-1.0, 1.05),
                      "roller_radius_m, base_circle_radius_m (too small), the lift table"),
    "offset": Ratio("follower offset over base circle and roller radius",
                    lambda p, t: abs(p.follower_offset) / (p.base_circle_radius + p.roller_radius),
                    (0.0, 0.12), (0.0, 0.5), (0.0, 0.95), "follower_offset_m"),
    "cam_inertia": Ratio("cam inertia over its mass times base circle radius squared",
                         lambda p, t: p.cam_inertia / (p.cam_mass * p.base_circle_radius**2),
                         (0.11, 1.03), (0.03, 5.0), (0.003, 50.0), "cam_inertia_kg_m2, cam_mass_kg"),
    "cam_mass": Ratio("cam mass over that of a steel cube of its radius",
                      lambda p, t: p.cam_mass / _steel(p.base_circle_radius),
                      (1.4, 246.0), (0.2, 400.0), (0.02, 2000.0), "cam_mass_kg, base_circle_radius_m"),
    "follower_mass": Ratio("follower mass over that of a steel cube of the cam's radius",
                           lambda p, t: p.follower_mass / _steel(p.base_circle_radius),
                           (0.42, 7.3), (0.06, 10.0), (0.005, 100.0), "follower_mass_kg, base_circle_radius_m"),
    "spring": Ratio("spring preload over the force it gains by the lift",
                    lambda p, t: p.spring_preload / (p.spring_stiffness * float(np.max(t.lift)))
                    if p.spring_stiffness and p.spring_preload else 1.0,
                    (0.22, 2.25), (0.1, 6.0), (0.003, 300.0), "spring_stiffness_N_per_m, spring_preload_N"),
    "roller_mass": Ratio("roller mass over follower mass", lambda p, t: (p.roller_mass or 0.0) / p.follower_mass,
                         (0.0, 0.5), (0.0, 0.9), (0.0, 1.0), "roller_mass_kg, follower_mass_kg"),
    "roller_disc": Ratio("roller mass over that of a steel disc of its size",
                         lambda p, t: p.roller_mass / _roller_disc(p) if p.roller_mass else 1.0,
                         (1.0, 1.0), (0.3, 1.6), (0.05, 8.0),
                         "roller_mass_kg, roller_radius_m (is it the diameter?), roller_width_m"),
    "follower_disc": Ratio("follower mass over that of a steel disc as large as its roller",
                           lambda p, t: p.follower_mass / _roller_disc(p), (1.4, 37.0), (1.0, 150.0), (0.2, 5000.0),
                           "follower_mass_kg, roller_radius_m (is it the diameter?), roller_width_m; a foot that "
                           "slides has roller_inertia_kg_m2 = 0"),
    "roller_gyration": Ratio("roller inertia over its mass times radius squared, 0.5 to 1 for a disc with a bore,",
                             lambda p, t: p.roller_inertia / (p.roller_mass * p.roller_radius**2)
                             if p.roller_inertia and p.roller_mass else 0.6,
                             (0.5, 0.7), (0.45, 1.0), (0.3, 1.3),
                             "roller_radius_m (is it the diameter?), roller_inertia_kg_m2, roller_mass_kg"),
    "roller_inertia": Ratio("roller inertia over that of a ring of the follower's mass",
                            lambda p, t: (p.roller_inertia or 0.0) / (p.follower_mass * p.roller_radius**2),
                            (0.0, 0.3), (0.0, 0.8), (0.0, 1.0), "roller_inertia_kg_m2, roller_radius_m"),
    "cam_modulus": Ratio("Young's modulus of the cam over that of steel", lambda p, t: p.youngs_modulus_cam / STEEL,
                         (1.0, 1.0), (0.28, 3.4), (0.0, math.inf), "youngs_modulus_cam_Pa"),
    "roller_modulus": Ratio("Young's modulus of the roller over that of steel",
                            lambda p, t: p.youngs_modulus_roller / STEEL,
                            (1.0, 1.0), (0.28, 3.4), (0.0, math.inf), "youngs_modulus_roller_Pa"),
    "moduli": Ratio("Young's modulus of the roller over that of the cam",
                    lambda p, t: p.youngs_modulus_roller / p.youngs_modulus_cam,
                    (1.0, 1.0), (0.25, 4.0), (0.0, math.inf), "youngs_modulus_roller_Pa, youngs_modulus_cam_Pa"),
}  # fmt: skip


OF_ROLLERS = frozenset({"roller", "roller_width", "roller_size", "follower_disc"})
"""Ratios that say nothing of a foot that slides (roller_inertia_kg_m2 = 0), whose radius is that of its crown."""
LARGE_ON_FEET = frozenset({"undercut"})
"""Ratios that come near what is possible with a flat foot, whose crown is nearly all of the curvature of its path."""


def check_pump(
    pump: PumpData, table: CamTable, rotation: int, path: Path, *, but: AbstractSet[str] = frozenset()
) -> list[Finding]:
    """Compare sizes of one pump with each other.

    Parameters
    ----------
    rotation : 1, or -1 where the cam runs backwards
    path : file that states the pump
    but : ratios that are left out

    Raises
    ------
    Refusals : sizes that no one pump has, all of them
    """
    problems, findings = Problems(), []
    left_out, (wrong, _) = but | (OF_ROLLERS if pump.roller_inertia == 0.0 else set()), outliers_text(table)
    # the cam sees the offset on its other side where it runs backwards
    pump = replace(pump, follower_offset=pump.follower_offset * rotation)
    for name, ratio in PUMP_RATIOS.items():
        if name in left_out:
            continue
        value = ratio.value(pump, table)
        low, high = ratio.possible if name in LARGE_ON_FEET and pump.roller_inertia == 0.0 else ratio.usual
        ask = f"{wrong}: measure them again" if wrong and "the lift table" in ratio.keys else f"check {ratio.keys}"
        text = f"{ratio.what} is {short(value)}, usual are {low:g} to {high:g}; {ask}"
        if not ratio.possible[0] <= value <= ratio.possible[1]:
            problems.texts.append(f"{path} [pump]: {text}")
        elif not low <= value <= high:
            findings.append(Finding("pump_unusual", "warning", text, f"{path.name} [pump]"))
    problems.raise_any(listed=False)
    return findings
