"""Pages from the templates beside, with their figures: one self-contained file each, every text escaped.

No script but the page's own runs.
"""

from __future__ import annotations

import base64
import hashlib
import importlib.util
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import resvg_py
from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup

from camtorque.fit.evidence import LARGE
from camtorque.jsonable import clean
from camtorque.process.second_process import in_two
from camtorque.report.answer import answer, cards, work_text
from camtorque.report.chart import NARROW, Chart, Curves, Rows, Span, tone_css
from camtorque.report.charts_svg import curves_svg, rows_svg
from camtorque.report.numbers import FILTERS
from camtorque.report.payload import chart_data
from camtorque.report.texts import (
    METRIC_NAMES,
    alignment_text,
    budget_rows,
    by_size,
    gap_rows,
    inside_text,
    loss_rows,
    pair_rows,
    parameter_groups,
)
from camtorque.report.verdict import verdict
from camtorque.version import __version__

VERSIONS_OF = ("numpy", "scipy", "h5py", "lmfit", "numba", "pandas")
HERE = Path(__file__).parent
SCRIPTS = ("vendor/uPlot.iife.min.js", "live.js")
EXPLORER = "explore.js"
ZOOM_HINT = (
    "Drag across a curve to zoom (on a touch screen with two fingers), double-click or double-tap for the whole "
    "revolution, click a name to switch it off."
)
STAND_IN = "strokes"
"""Section whose curves are seen by zooming where the script runs."""
STYLES = ("vendor/uPlot.min.css", "page.css")


SECTIONS: dict[str, str] = {
    "torque": "Curves",
    "causes": "What closes the gap",
    "evidence": "Which losses",
    "structures": "",
    "parameters": "Parameters",
    "uncertainty": "How sure",
    "inside": "Inside the pump",
    "alignment": "Alignment and cycles",
    "findings": "Findings",
    "next": "Next measurement",
    "provenance": "Provenance",
}
"""Sections of report.html in their order: name of the file in `sections` and of the anchor -> what the list at the top
of the page calls it, "" for a part of the section before it."""
LEFT_OUT_EMPTY = ("evidence",)
"""Sections that are left out where the part of result.json of their name is empty."""


@dataclass(frozen=True)
class Drawing:
    """One figure of a page: the chart and its SVG, with the words around it.

    ``wide``: over the whole width; ``png``: an image file is written beside the SVG; ``narrow``: the same in drawings
    that a phone can show, None where the script or ``svg`` itself does.
    """

    name: str
    title: str
    caption: str
    section: str
    wide: bool
    png: bool
    chart: Chart
    svg: Markup
    narrow: Markup | None = None

    @property
    def live(self) -> bool:
        """True where the script draws curves in its place."""
        return isinstance(self.chart, Curves) and self.chart.live

    @property
    def stand_in(self) -> bool:
        """True for curves shown only where no script runs and one cannot zoom."""
        return self.section == STAND_IN


@cache
def versions() -> str:
    """Return the versions of what computes."""
    return ", ".join([f"Python {platform.python_version()}", *(f"{name} {version(name)}" for name in VERSIONS_OF)])


@cache
def _text(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"


def policy(css: str, scripts: Sequence[str]) -> str:
    """Return the content security policy: nothing is loaded; only this style sheet and these scripts are used."""
    allowed = " ".join(map(_hash, scripts)) or "'none'"
    return (
        f"default-src 'none'; script-src {allowed}; style-src {_hash(css)}; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )


class TemplateCache(FileSystemBytecodeCache):
    """A cache that can only help: what cannot be read is compiled, what cannot be written is not kept.

    Compiling a page anew takes 0.09 s.
    """

    def load_bytecode(self, bucket: Bucket) -> None:
        """Fill in the template as it was compiled before, if its source is the same."""
        try:
            super().load_bytecode(bucket)
        except Exception:  # a damaged pickle raises anything
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep a template that was compiled."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


def template_cache(folder: Path) -> TemplateCache | None:
    """Return the cache beside the templates of a folder, None where Python does not keep compiled modules there."""
    place = folder / "__pycache__"
    if sys.dont_write_bytecode or not os.access(place, os.W_OK):
        return None
    made_by = f"{sys.implementation.cache_tag}-jinja2-{version('jinja2')}-camtorque-{__version__}"
    return TemplateCache(str(place), f"%s.{made_by}.cache")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("camtorque", "report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        finalize=lambda value: clean(value) if type(value) is str else value, bytecode_cache=template_cache(HERE),
    )  # fmt: skip
    environment.filters.update(FILTERS)
    return environment


def render(
    template: str, drawings: Sequence[Drawing] = (), phases: tuple[Span, ...] = (), explorer: str = "", **values: Any
) -> str:
    """Return one page; what a template names and is not given is an error. ``explorer``: data of trends and maps."""
    charts = {item.name: item.chart for item in drawings if isinstance(item.chart, Curves) and item.chart.live}
    css = tone_css() + "".join(map(_text, STYLES))
    names = (*(SCRIPTS if charts or explorer else ()), *((EXPLORER,) if explorer else ()))
    scripts = [_text(name) for name in names]
    return _environment().get_template(template).render(
        css=Markup(css), versions=versions(), scripts=[Markup(text) for text in scripts], policy=policy(css, scripts),
        drawings=drawings, data=chart_data(charts, phases) if scripts else "", explorer=explorer, zoom_hint=ZOOM_HINT,
        **values,
    )  # fmt: skip


def run_page(
    doc: Mapping[str, Any], drawings: Sequence[Drawing], config_text: str, phases: tuple[Span, ...], correlation: Any
) -> str:
    """Return report.html of a run; ``correlation``: names of the fitted parameters and (k, k) matrix."""
    alignment = doc["alignment"]
    budget = budget_rows(alignment["angle_error_budget_deg"], alignment["angle_error_budget_after_fit_deg"])
    large, small = by_size(budget)
    return render(
        "run.html", drawings, phases, title=f"{doc['recording']['name']}: measured against model", doc=doc,
        verdict=verdict(doc), answer=answer(doc), cards=cards(doc),
        losses=loss_rows(doc), work=work_text(doc), gaps=gap_rows(doc), groups=parameter_groups(doc),
        pairs=pair_rows(*correlation), inside=inside_text(doc), alignment=alignment_text(doc),
        config_text=config_text, metric_names=METRIC_NAMES,
        sections={name: link for name, link in SECTIONS.items() if name not in LEFT_OUT_EMPTY or doc[name]},
        budget=budget, large_errors=large, small_errors=small, beyond_doubt=LARGE,
    )  # fmt: skip


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
