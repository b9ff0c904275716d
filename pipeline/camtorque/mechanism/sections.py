"""Lift laws put together from the sections that cam designers use, with a check of continuity.

A section knows its lift over its own angle, starting from 0; the law is their sum around one revolution, stored as
polynomials of degree 9 on pieces of at most 2.5 degrees (Chebyshev interpolation, exact for the polynomial sections and
below 1e-14 of the lift for the others). Formulas: Norton, Cam Design and Manufacturing Handbook, 2nd ed. 2009, Chapters
2-3; tangent cam: Rothbart, Cams, 1956.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial, chebyshev
from scipy.interpolate import PPoly

from camtorque.mechanism.cam import CamLaw
from camtorque.records import Array, Refusal
from camtorque.units import DEGREE, TURN

PIECE = np.deg2rad(2.5)
ORDER = 9
CLOSES = 1.0e-6 * DEGREE
"""By how much the angles of sections may miss a revolution: the last digit that the refusal of a gap states."""
BELOW = 1.0e-9
"""Rounding of lifts that add up to 0 [m]."""
UNIT_TOLERANCE = 1.0e-9
"""A jump of lift or velocity beyond this share of the lift (per radian) is a mistake of the drawing, not rounding."""


@dataclass(frozen=True)
class Section:
    """One section: its name, its angle [rad] and its lift over local angle, 0 at the start [m]."""

    name: str
    angle: float
    lift: Callable[[Array], Array]

    def __post_init__(self) -> None:
        if not self.angle > 0.0:
            raise Refusal(f"cam section {self.name}: angle is {self.angle} rad, expected more than 0; leave it out")


def _modified_sine(x: Array) -> Array:
    scale = 1.0 / (4.0 + np.pi)
    ends = scale * (np.pi * x - 0.25 * np.sin(4.0 * np.pi * x)) + np.where(x > 0.5, 4.0 * scale, 0.0)
    middle = scale * (2.0 + np.pi * x - 2.25 * np.sin(4.0 * np.pi * x / 3.0 + np.pi / 3.0))
    return np.where(np.abs(x - 0.5) > 0.375, ends, middle)


FLANKS: dict[str, Callable[[Array], Array]] = {
    "simple_harmonic": lambda x: 0.5 * (1.0 - np.cos(np.pi * x)),
    "cycloidal": lambda x: x - np.sin(TURN * x) / TURN,
    "modified_sine": _modified_sine,
    "polynomial_345": lambda x: x**3 * (10.0 + x * (-15.0 + 6.0 * x)),
    "polynomial_4567": lambda x: x**4 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x))),
}
"""Flanks from rest to rest: unit rise over unit angle."""


def dwell(angle: float) -> Section:
    """Return a section at constant lift."""
    return Section("dwell", angle, np.zeros_like)


def flank(kind: str, angle: float, rise: float) -> Section:
    """Return a flank of `FLANKS` from rest to rest; a negative rise is a return.

    Raises
    ------
    Refusal : unknown kind
    """
    if kind not in FLANKS:
        raise Refusal(f"cam section: kind {kind!r} is unknown, expected one of {', '.join(FLANKS)}")
    unit = FLANKS[kind]
    return Section(kind, angle, lambda local: rise * unit(local / angle))


def unit_flank(kind: str) -> PPoly:
    """Return a flank of `FLANKS` of unit rise over unit angle as a piecewise polynomial of degree 9."""
    widths, coefficients = _pieces(flank(kind, 1.0, 1.0), 0.0)
    return PPoly(coefficients, np.append(0.0, np.cumsum(widths)))


def tangent_sections(
    base_circle_radius: float, roller_radius: float, lift: float, nose_radius: float
) -> tuple[Section, ...]:
    """Return the lobe of a tangent cam for an on-axis roller: straight flank, round nose, straight flank.

    The flank touches base and nose circle; with c = r_b + r_r the roller on it lifts by c (1/cos theta - 1). Its
    acceleration jumps where flank meets base circle and nose, as that of every tangent cam does.

    Raises
    ------
    Refusal : the nose circle does not fit between base circle and lift
    """
    centre = base_circle_radius + lift - nose_radius
    if not 0.0 < base_circle_radius - nose_radius < centre:
        raise Refusal(
            f"tangent cam: nose radius {nose_radius} m does not fit a base radius {base_circle_radius} m and lift "
            f"{lift} m; expected smaller than the base radius"
        )
    distance, path = base_circle_radius + roller_radius, nose_radius + roller_radius
    nose_angle = float(np.arccos((base_circle_radius - nose_radius) / centre))
    flank_angle = float(np.arctan(centre * np.sin(nose_angle) / distance))
    half = nose_angle - flank_angle

    def straight(angle: Array) -> Array:
        return distance * (1.0 / np.cos(angle) - 1.0)

    def nose(angle: Array) -> Array:
        return centre * np.cos(angle) + np.sqrt(path**2 - (centre * np.sin(angle)) ** 2) - distance

    return (
        Section("tangent", flank_angle, straight),
        Section("nose", 2.0 * half, lambda local: nose(local - half) - nose(np.array(-half))),
        Section("tangent", flank_angle, lambda local: straight(flank_angle - local) - straight(np.array(flank_angle))),
    )


def _power_matrices() -> tuple[Array, Array, Array]:
    """Return Chebyshev nodes on [0, 1], and the matrices from values to series and on to powers, highest first."""
    nodes = chebyshev.chebpts1(ORDER + 1)
    to_series = np.asarray(np.linalg.inv(chebyshev.chebvander(nodes, ORDER)), dtype=np.float64)
    powers = [Chebyshev.basis(k, domain=[0.0, 1.0]).convert(kind=Polynomial).coef for k in range(ORDER + 1)]
    to_powers = np.array([np.pad(power, (0, ORDER + 1 - power.size)) for power in powers]).T
    return 0.5 * (nodes + 1.0), to_series, to_powers[::-1]


NODES, TO_SERIES, TO_POWERS = _power_matrices()


def _pieces(section: Section, start_lift: float) -> tuple[Array, Array]:
    """Return piece widths (m,) and coefficients (ORDER + 1, m) of a section."""
    # a multiple of 8 pieces puts the joints of the modified sine on piece ends
    count = 8 * max(1, int(np.ceil(section.angle / PIECE / 8.0)))
    width = section.angle / count
    values = section.lift(width * (np.arange(count) + NODES[:, None]))
    # in two steps: the series falls off fast, and its cut tail is what the powers would blow up
    series = TO_SERIES @ values
    series[np.abs(series) < 1e-15 * np.max(np.abs(values), initial=1e-300)] = 0.0
    coefficients = (TO_POWERS @ series) / width ** np.arange(ORDER, -1, -1)[:, None]
    coefficients[-1] += start_lift
    return np.full(count, width), coefficients


def section_law(sections: Sequence[Section], start: float = 0.0) -> CamLaw:
    """Return the lift law of sections around one revolution, from the base circle at ``start`` [rad].

    Raises
    ------
    Refusal : the angles do not make one revolution, the lift goes below 0 or does not come back to it, or lift or
        velocity jumps
    """
    total = sum(section.angle for section in sections)
    if abs(total - TURN) > CLOSES:
        raise Refusal(
            f"cam sections: their angles add up to {np.rad2deg(total):.6f} deg, expected 360; adjust the last dwell"
        )
    lift, widths, blocks = 0.0, [], []
    for section in sections:
        width, block = _pieces(section, lift)
        widths.append(width)
        blocks.append(block)
        lift += float(section.lift(np.array(section.angle)))
        if lift < -BELOW:
            end = np.rad2deg(start + float(np.sum(np.concatenate(widths))))
            raise Refusal(
                f"cam sections: the lift goes down to {1e3 * lift:.4g} mm at {end:.3f} deg, expected 0 mm or more: "
                "sections begin on the base circle; begin with the rise, and turn it by start_deg"
            )
    knots = start + np.append(0.0, np.cumsum(np.concatenate(widths)))
    knots[-1] = start + TURN
    return _checked(CamLaw(knots, np.concatenate(blocks, axis=1)))


def _checked(law: CamLaw) -> CamLaw:
    """Return the law, or refuse it where lift or velocity jumps."""
    jumps = law.continuity_at_knots()
    for derivative, name in ((0, "lift"), (1, "velocity")):
        worst = int(np.argmax(jumps[derivative]))
        if jumps[derivative, worst] > UNIT_TOLERANCE * law.lift:
            where = np.rad2deg(law.knots[worst + 1])
            raise Refusal(
                f"cam sections: {name} jumps by {jumps[derivative, worst]:.3g} at {where:.3f} deg, expected none; "
                "make the neighbouring sections meet"
            )
    return law
