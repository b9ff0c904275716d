"""What a figure shows, independent of how it is drawn: SVG for print, interactive curves for the screen."""

from __future__ import annotations

from dataclasses import dataclass

from camtorque.records import Array, ReadOnly

CAM_ANGLE = "cam angle [deg]"
"""Name of the axis of most drawings."""
WIDE, HALF, NARROW = 960.0, 640.0, 420.0
"""Widths of drawings in pixels: over the whole page, over half of it, on a phone."""


@dataclass(frozen=True)
class Line(ReadOnly):
    """One curve; NaN is a gap.

    values : (n,) in the unit of the panel; tone : key of `tones.TONES`; points : markers in place of a line;
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
