"""How a chart becomes a drawing of a page, an SVG or a PNG file."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import resvg_py
from markupsafe import Markup

from camtorque.process.second_process import in_two
from camtorque.report.chart import NARROW, Chart, Rows
from camtorque.report.charts_svg import curves_svg, rows_svg
from camtorque.report.page import Drawing

if TYPE_CHECKING:  # the fit is not needed to draw
    from camtorque.report.bundle import RunResult

PNG_WIDTH = 1440


@dataclass(frozen=True)
class FigureSpec:
    """One figure of a run.

    Attributes
    ----------
    title, caption : what it is, what to look at
    draw : what it shows, None where the run has nothing to show
    section : of the page
    wide : over the whole width
    png : True where an image file is written beside the SVG
    """

    title: str
    caption: str
    draw: Callable[[RunResult], Chart | None]
    section: str
    wide: bool = False
    png: bool = False


def png_of(svg: str) -> bytes:
    """Return a drawing as a PNG image on white, with the font of matplotlib: the same on every machine."""
    return bytes(
        resvg_py.svg_to_bytes(
            svg_string=svg, width=PNG_WIDTH, background="#ffffff", skip_system_fonts=True, font_files=[str(_font())],
            sans_serif_family="DejaVu Sans",
        )
    )  # fmt: skip


def _font() -> Path:
    """Return the font file of matplotlib, without importing it."""
    found = importlib.util.find_spec("matplotlib")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"


def drawing_of(
    name: str, chart: Chart, title: str, caption: str = "", section: str = "curves", wide: bool = True
) -> Drawing:
    """Return a chart as a figure of a page, see `FigureSpec`; where no script redraws it, as wide as a phone too."""
    label = f"{title}. {caption}" if caption else title
    narrow = list[str]()
    if isinstance(chart, Rows):  # its panels below each other
        svg = rows_svg(chart, label)
        narrow = [rows_svg(Rows(chart.labels, (panel,), NARROW), label) for panel in chart.panels]
    else:
        svg = curves_svg(chart, label)
        if not chart.live and chart.width > NARROW:
            narrow = [curves_svg(replace(chart, width=NARROW), label)]
    return Drawing(name, title, caption, section, wide, chart, Markup(svg), Markup("".join(narrow)) or None)


def write_figures(drawings: list[Drawing], folder: Path, wants_png: Callable[[str], bool]) -> None:
    """Write every figure as SVG, some as PNG too; without figures there is no folder."""
    for item in drawings:
        folder.mkdir(exist_ok=True)
        (folder / f"{item.name}.svg").write_text(item.svg, encoding="utf-8")
    chosen = [item for item in drawings if wants_png(item.name)]
    for item, image in zip(chosen, in_two(png_of, [str(item.svg) for item in chosen]), strict=True):
        (folder / f"{item.name}.png").write_bytes(image)
