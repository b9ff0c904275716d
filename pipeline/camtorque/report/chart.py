"""What a figure shows, whatever draws it: curves, named rows, the phases of a revolution, colours by what they mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.records import Array, ReadOnly, ResidualBump
from camtorque.units import DEGREE, TURN

CAM_ANGLE = "cam angle [deg]"
"""Name of the axis of most drawings."""
WIDE, HALF, NARROW = 960.0, 640.0, 420.0
"""Widths of drawings in pixels: over the whole page, over half of it, on a phone."""


@dataclass(frozen=True)
class Line(ReadOnly):
    """One curve; NaN is a gap.

    values : (n,) in the unit of the panel; tone : key of `TONES`; points : markers in place of a line;
    error : (n,) half height of error bars
    """

    label: str
    values: Array
    tone: str
    width: float = 1.5
    dash: str = ""
    points: bool = False
    error: Array | None = None


@dataclass(frozen=True)
class Band(ReadOnly):
    """The area between two curves, each (n,)."""

    label: str
    low: Array
    high: Array
    tone: str = "band"


@dataclass(frozen=True)
class Panel:
    """Curves over one ordinate.

    ordinate : name and unit; height : of the axes [px]; zero : a line at zero; limits : of the ordinate, None for
    those of what is shown; keys : False for no legend: one curve that the title names, or too many to list
    """

    ordinate: str
    lines: tuple[Line, ...]
    bands: tuple[Band, ...] = ()
    height: float = 220.0
    zero: bool = True
    limits: tuple[float, float] | None = None
    keys: bool = True


@dataclass(frozen=True)
class Span:
    """A named range of the abscissa; ``loud`` for one that asks for attention."""

    low: float
    high: float
    label: str
    loud: bool = False


@dataclass(frozen=True)
class Curves(ReadOnly):
    """Panels above each other over one abscissa.

    Attributes
    ----------
    x : (n,) abscissa in border units, increasing
    abscissa : its name and unit
    full_turn : True for cam angle over one revolution
    x_range : what is shown, None for all
    spans : stretches named above the first panel and shaded in all
    live : False for a drawing that the script leaves alone (shown in print and on pages without a script)
    links : page that each curve of a panel opens; empty for none
    """

    x: Array
    abscissa: str
    panels: tuple[Panel, ...]
    full_turn: bool = True
    x_range: tuple[float, float] | None = None
    spans: tuple[Span, ...] = ()
    width: float = WIDE
    live: bool = True
    links: tuple[str, ...] = ()


@dataclass(frozen=True)
class Marks:
    """One value per row.

    kind : ``bar``, ``point`` or ``stack`` (bars behind each other); tones : one for all or one per row;
    low, high : (n_rows,) ends of an interval, or None
    """

    label: str
    values: tuple[float, ...]
    tones: tuple[str, ...]
    kind: str = "bar"
    low: tuple[float, ...] | None = None
    high: tuple[float, ...] | None = None


@dataclass(frozen=True)
class RowPanel:
    """Marks over one abscissa.

    log : logarithmic abscissa; shaded : a stretch behind all rows;
    notes : text beside each row's mark
    """

    abscissa: str
    marks: tuple[Marks, ...]
    log: bool = False
    shaded: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Rows:
    """Named rows with one or more panels beside each other."""

    labels: tuple[str, ...]
    panels: tuple[RowPanel, ...]
    width: float = HALF


Chart = Curves | Rows


RAMP = tuple(f"r{k}" for k in range(8))
CYCLE = tuple(f"c{k}" for k in range(10))
DASHES = ("", "6 3", "2 3", "8 3 2 3")
TONES: dict[str, tuple[str, str]] = {
    "measured": ("#1b1b1b", "#f1f3f5"), "fitted": ("#0072b2", "#4db2ec"), "over": ("#4db2ec", "#1f8fd0"),
    "rigid": ("#d55e00", "#f28b3c"), "residual": ("#7a4fa3", "#b794dd"), "band": ("#c3c9cf", "#59616b"),
    "chamber": ("#9cc9e6", "#2c5a78"), "ink": ("#1d2329", "#e8ebee"), "muted": ("#5b6470", "#a5adb7"),
    "axis": ("#8a929b", "#7b848e"), "grid": ("#e6e8eb", "#32383f"), "soft": ("#f1f4f6", "#22272d"),
    "warn": ("#b35900", "#f0a65a"), "warnsoft": ("#fdeedd", "#46331c"), "bad": ("#b3261e", "#ff8a80"),
    "good": ("#1a7f4b", "#5fc08c"), "r0": ("#440154", "#8b5fbf"), "r1": ("#46327e", "#7b7fd6"),
    "r2": ("#365c8d", "#5f9fd8"), "r3": ("#277f8e", "#4bb5c4"), "r4": ("#1fa187", "#42c9a5"),
    "r5": ("#4ac16d", "#7dd87f"), "r6": ("#9bb61f", "#c3df4e"), "r7": ("#c9a400", "#fde725"),
    "c0": ("#0072b2", "#4db2ec"), "c1": ("#d55e00", "#f28b3c"), "c2": ("#009e73", "#3cc79d"),
    "c3": ("#b35f95", "#e09cc6"), "c4": ("#56b4e9", "#8fd0f5"), "c5": ("#c98a00", "#f0bf4d"),
    "c6": ("#7a4fa3", "#b794dd"), "c7": ("#5f6b6d", "#a9b5b7"), "c8": ("#8c6d31", "#cfac6a"),
    "c9": ("#b04a5a", "#e68a98"),
}  # fmt: skip
"""Name -> colour on white, colour on black; those of curves after Okabe and Ito (2008) and steps of like lightness."""


def light(tone: str) -> str:
    """Return the colour on white."""
    return TONES[tone][0]


def stroke(tone: str) -> str:
    """Return the attributes of a line: the colour on white, and the class by which a dark page changes it."""
    return f'class="s-{tone}" stroke="{light(tone)}"'


def fill(tone: str) -> str:
    """Return the attributes of a filled shape, as `stroke`."""
    return f'class="f-{tone}" fill="{light(tone)}"'


def tone_css() -> str:
    """Return the style sheet of all tones: variables, dark values, and the classes of drawings."""
    names = [":root{" + "".join(f"--{name}:{pair[0]};" for name, pair in TONES.items()) + "}"]
    dark = "".join(f"--{name}:{pair[1]};" for name, pair in TONES.items())
    names.append("@media screen and (prefers-color-scheme:dark){:root{" + dark + "}}")
    names += [f".s-{name}{{stroke:var(--{name})}}.f-{name}{{fill:var(--{name})}}" for name in TONES]
    return "".join(names)


ENDS = 2.0e-3
"""Share of the lift within which it counts as base circle, or as top."""
SHORTEST_DEG = 3.0
"""A shorter top is a point between the strokes."""
LEAST_LOBE = 0.3
"""Share of the largest lift from which a rise off the base circle is a lobe."""


def phases(theta: Array, lift: Array) -> tuple[Span, ...]:
    """Return the phases of all lobes over one revolution in degrees, in the order of the angle.

    Parameters
    ----------
    theta : (n,) cam angle [rad]; lift : (n,) [m]
    """
    lobes = sorted(_lobes(theta / DEGREE, (lift - np.min(lift)) / np.ptp(lift)))
    marks = []
    for (start, reach, leave, end), after in zip(lobes, (*lobes[1:], tuple(x + 360.0 for x in lobes[0])), strict=True):
        marks += [("forward stroke", start, reach), ("top", reach, leave), ("return stroke", leave, end),
                  ("base circle", end, after[0])]  # fmt: skip
    return tuple(
        sorted(
            (span for name, low, high in marks if high > low for span in _within_turn(name, low, high)),
            key=lambda span: span.low,
        )
    )


def _lobes(angle: Array, share: Array) -> list[tuple[float, ...]]:
    """Return where each lobe starts, reaches and leaves its top, and ends [deg]; ``share`` of the lift, (n,)."""
    found, left, step = [], share.copy(), 360.0 / share.size
    while np.max(left) > LEAST_LOBE:
        top = int(np.argmax(left))
        after = np.roll(share, -top)
        before = after[::-1]
        leave, reach = (_first(side, (1.0 - ENDS) * share[top]) for side in (after, before))
        down, start = (_first(side, ENDS) for side in (after, before))
        left[np.arange(top - start, top + down) % share.size] = 0.0
        if (leave + reach) * step < SHORTEST_DEG:
            leave = reach = 0
        found.append(tuple(float(angle[top] + place * step) for place in (-start, -reach, leave, down)))
    return found


def strokes(theta: Array, lift: Array) -> tuple[Span, ...]:
    """Return the phases that are strokes."""
    return tuple(span for span in phases(theta, lift) if "stroke" in span.label)


def _first(share: Array, limit: float) -> int:
    """Return the first place below a limit."""
    return int(np.argmax(share < limit)) if np.any(share < limit) else share.size


def _within_turn(name: str, low: float, high: float) -> list[Span]:
    """Return a span, cut in two where it passes the end of the revolution."""
    turn = 360.0 * np.floor(low / 360.0)
    low, high = low - turn, high - turn
    if high <= 360.0:
        return [Span(low, high, name)]
    return [Span(low, 360.0, name), Span(0.0, high - 360.0, name)]


def bump_spans(bumps: tuple[ResidualBump, ...]) -> tuple[Span, ...]:
    """Return where the residual stands out, as loud spans in degrees."""
    return tuple(
        Span(part.low, part.high, f"bump {k}", loud=True)
        for k, bump in enumerate(bumps, 1)
        for part in _within_turn("", bump.start / DEGREE, (bump.stop + TURN * (bump.stop < bump.start)) / DEGREE)
    )
