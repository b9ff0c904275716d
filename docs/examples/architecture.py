"""Draw the picture of docs/architecture.md: rooms in order, what each hands on, who imports whom.

python docs/examples/architecture.py
"""

from __future__ import annotations

import ast
from html import escape
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "pipeline" / "camtorque"
ROOMS = {
    "signal": ("raw samples", "edges, damage"),
    "ingest": ("files to SI", "Recording"),
    "align": ("to cam angle", "CamCycles"),
    "mechanism": ("rigid DeNOC", "RigidTorque"),
    "laws": ("what is missing", "chain of links"),
    "fit": ("values, evidence", "FittedTorque"),
    "report": ("pages, files", "report.html"),
    "design": ("a better cam", "front, lift table"),
}
"""Room -> what it does, what it hands on. Left of them: records, units, config, process; below: flows, then faces."""
FLOWS = {
    "run": "one recording", "campaign": "many recordings", "compare": "before and after",
    "finished_fit": "values of a fit", "predict_from": "runs not made", "design_from": "cam under fitted loads",
    "plan": "what to record next", "studies": "speed, stability",
}  # fmt: skip
FACES = {
    "api": "import camtorque", "watch": "during a test", "export": "tables", "commands": "camtorque COMMAND",
    "cli": "prints",
}  # fmt: skip
WIDTH, HEIGHT, GAP, TOP = 118, 54, 22, 74
INK, SOFT, LINE, ACCENT = "#1d2329", "#eef2f5", "#8a929b", "#0072b2"


def used_rooms() -> dict[str, set[str]]:
    """Return for each room those whose modules it imports."""
    found: dict[str, set[str]] = {room: set() for room in ROOMS}
    for room in ROOMS:
        for path in (PACKAGE / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("camtorque."):
                    found[room].add(node.module.split(".")[1])
    return {room: others & set(ROOMS) - {room} for room, others in found.items()}


def text(x: float, y: float, words: str, style: str = 'font-size="11"') -> str:
    """Return a text about its middle."""
    return f'<text x="{x}" y="{y}" text-anchor="middle" {style}>{escape(words)}</text>'


def box(x: float, y: float, width: float, head: str, words: str, colour: str = LINE) -> str:
    """Return a box with a head and a line of text."""
    middle = x + 0.5 * width
    shape = f'<rect x="{x}" y="{y}" width="{width}" height="{HEIGHT}" rx="6" fill="{SOFT}" stroke="{colour}"/>'
    return shape + text(middle, y + 23, head, 'font-weight="600"') + text(middle, y + 41, words)


def arrow(x1: float, y1: float, x2: float, y2: float) -> str:
    """Return a straight arrow."""
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{INK}" marker-end="url(#tip)"/>'


def arches(places: dict[str, int]) -> list[str]:
    """Return a dashed line for each import beyond the neighbour, which has its arrow."""
    names, parts = list(ROOMS), []
    for room, others in used_rooms().items():
        for other in sorted(others):
            far = names.index(room) - names.index(other)
            if far > 1:
                start, end, lift = places[other] + WIDTH / 2, places[room] + WIDTH / 2, TOP + 44 - 9 * far
                path = f"M{start} {TOP + 40}C{start} {lift} {end} {lift} {end} {TOP + 38}"
                parts.append(f'<path d="{path}" fill="none" stroke="{LINE}" stroke-dasharray="3 3"/>')
    return parts


def drawing() -> str:
    """Return the SVG."""
    places = {room: 20 + number * (WIDTH + GAP) for number, room in enumerate(ROOMS)}
    total = places["design"] + WIDTH + 20
    left = "records, units, config, process, limits"
    parts = [box(20, 10, total - 40, left, "frozen records, one statement a fact")]
    for room, (does, hands) in ROOMS.items():
        parts.append(box(places[room], TOP + 40, WIDTH, room, does, ACCENT))
        parts.append(text(places[room] + WIDTH / 2, TOP + 112, hands))
    for one, other in pairwise(ROOMS):
        parts.append(arrow(places[one] + WIDTH, TOP + 67, places[other] - 2, TOP + 67))
    parts += arches(places)
    for group, y, above in ((FLOWS, TOP + 140, 22), (FACES, TOP + 226, 32)):
        wide = (total - 40 - (len(group) - 1) * GAP) / len(group)
        parts += [box(20 + k * (wide + GAP), y, wide, *item) for k, item in enumerate(group.items())]
        parts.append(arrow(total / 2, y - above, total / 2, y - 2))
    tip = '<marker id="tip" markerWidth="8" markerHeight="8" refX="7" refY="4" orient="auto"><path d="M0 0L8 4L0 8z"/>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total} {TOP + 294}" font-family="sans-serif" '
        f'font-size="13" fill="{INK}" role="img" aria-label="Rooms of the package, what each hands on, and the faces">'
        f'<defs>{tip}</marker></defs><rect width="100%" height="100%" fill="#fff"/>{"".join(parts)}</svg>\n'
    )


if __name__ == "__main__":
    target = ROOT / "docs" / "architecture.svg"
    target.write_text(drawing(), encoding="utf-8")
    print(target.relative_to(ROOT))
