"""How a chart becomes a drawing of a page, an SVG or a PNG file."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import resvg_py
from markupsafe import Markup

from camtorque.process.second_process import in_two
from camtorque.report.chart import NARROW, Chart, Rows
from camtorque.report.charts_svg import curves_svg, rows_svg
from camtorque.report.page import Drawing

PNG_WIDTH = 1440


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
    name: str, chart: Chart, title: str, caption: str = "", section: str = "curves", wide: bool = True, png: bool = True
) -> Drawing:
    """Return a chart as a figure of a page, see `Drawing`; where no script redraws it, as wide as a phone too."""
    label = f"{title}. {caption}" if caption else title
    narrow = list[str]()
    if isinstance(chart, Rows):  # its panels below each other
        svg = rows_svg(chart, label)
        narrow = [rows_svg(Rows(chart.labels, (panel,), NARROW), label) for panel in chart.panels]
    else:
        svg = curves_svg(chart, label)
        if not chart.live and chart.width > NARROW:
            narrow = [curves_svg(replace(chart, width=NARROW), label)]
    return Drawing(name, title, caption, section, wide, png, chart, Markup(svg), Markup("".join(narrow)) or None)


def write_figures(drawings: list[Drawing], folder: Path) -> None:
    """Write every figure as SVG, some as PNG too; without figures there is no folder."""
    for item in drawings:
        folder.mkdir(exist_ok=True)
        (folder / f"{item.name}.svg").write_text(item.svg, encoding="utf-8")
    chosen = [item for item in drawings if item.png]
    for item, image in zip(chosen, in_two(png_of, [str(item.svg) for item in chosen]), strict=True):
        (folder / f"{item.name}.png").write_bytes(image)
