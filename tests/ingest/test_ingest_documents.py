"""docs/recording_toml.md shows the tables of camtorque/config/schemas.py word for word; run this file to write them."""

import re
import tomllib
from pathlib import Path

import camtorque
from camtorque.config.keys import KEY_UNITS, Key, TableSchema
from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.config.schemas import CERTIFICATE_COLUMNS, PUMP_FILE_TABLES, RECORDING_TABLES, SHEET
from camtorque.fit.planning import TOOTH
from camtorque.ingest.formats import FORMATS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "recording_toml.md"
FORMATS_PAGE, PACKAGE = PAGE.with_name("formats.md"), Path(camtorque.__file__).parent
BEGIN, END = "from camtorque/config/schemas.py -->\n", "<!-- end -->"
HEAD = ["| table | key | meaning | allowed | |", "|---|---|---|---|---|"]


def markdown_rows(schema: TableSchema) -> list[str]:
    """Return the rows of a table: table, key, meaning, allowed, default."""
    rows = []
    for number, key in enumerate(schema.keys):
        if key.choices:
            allowed = ", ".join(f"`{word}`" for word in key.choices)
        elif key.band is not None:
            allowed = f"{key.band} ({key.band.reason})"
        else:
            allowed = {"flag": "`true`, `false`", "date": "2025-01-31"}.get(key.kind, "text")
        needed = "**required**" if key.required else f"*{default_of(key)}*" + (", own" if key.own else "")
        needed += "" if key.used else ", not used"
        table = f"`{schema.header}`" if number == 0 and schema.header else ""
        rows.append(f"| {table} | `{key.name}` | {key.meaning} | {allowed} | {needed} |")
    return rows


def default_of(key: Key) -> str:
    if key.default is None or key.default in ("", ()):
        return "optional"
    for word, value in key.choices.items():
        if value == key.default:
            return f"optional, `{word}`"
    factor, offset = KEY_UNITS.get(key.unit, (1.0, 0.0))
    if isinstance(key.default, bool):
        return f"optional, `{str(key.default).lower()}`"
    if isinstance(key.default, (int, float)):
        return f"optional, {(key.default - offset) / factor:g}"
    return f"optional, {key.default}"


def tables() -> str:
    lines = [*HEAD]
    for schema in RECORDING_TABLES.values():
        lines += markdown_rows(schema)
    lines += ["", "A sensor sheet is a file with one table:", "", *HEAD, *markdown_rows(SHEET)]
    lines += ["", "Its certificate is a table of points:", "", "| column | meaning |", "|---|---|"]
    lines += [f"| `{name}` | {meaning} |" for name, meaning in CERTIFICATE_COLUMNS.items()]
    lines += ["", "What a channel may measure (`quantity`):", "", "| quantity | unit | meaning |", "|---|---|---|"]
    lines += [f"| `{name}` | {item.dimension} | {item.meaning} |" for name, item in CHANNEL_QUANTITIES.items()]
    return "\n".join(lines) + "\n"


def page_with(text: str) -> str:
    page = PAGE.read_text(encoding="utf-8")
    head, rest = page.split(BEGIN, 1)
    return head + BEGIN + text + END + rest.split(END, 1)[1]


def test_the_page_shows_the_tables_that_the_product_reads():
    assert page_with(tables()) == PAGE.read_text(encoding="utf-8"), f"run python {Path(__file__).name}"


def test_every_number_has_a_band_with_a_reason_and_its_default_lies_inside():
    schemas: list[TableSchema] = [*RECORDING_TABLES.values(), *PUMP_FILE_TABLES.values(), SHEET]
    for schema in schemas:
        for key in schema.keys:
            assert key.meaning, key.name
            if key.band is not None:
                assert key.band.low < key.band.high
                assert key.band.reason, key.name


def rows_of(heading: str) -> list[list[str]]:
    """Return the rows of the table below a heading of formats.md."""
    part = FORMATS_PAGE.read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line[:1] == "|"][2:]


def test_the_page_of_formats_lists_every_reader_and_the_extra_it_needs():
    listed = {row[0]: row[1] for row in rows_of("Logs")}
    assert set(listed) == {form.shown for form in FORMATS.values()}
    for form in FORMATS.values():
        reader = (PACKAGE / "ingest" / f"{form.module}.py").read_text(encoding="utf-8")
        assert ("extra `tables`" in listed[form.shown]) == ("require((" in reader)


def test_the_page_of_formats_lists_every_source_of_the_angle_with_keys_that_exist():
    rows = rows_of("Where the cam angle comes from")
    named = " ".join(row[1] for row in rows)
    assert all(f"`{quantity}`" in named for quantity, item in CHANNEL_QUANTITIES.items() if item.is_pulse)
    assert "`angle`" in named
    keys = {re.match(r"\w+", word)[0] for row in rows for word in re.findall(r"`([^`]+)`", row[2]) if word[0].isalpha()}
    assert keys - {"index"} <= set(RECORDING_TABLES["trigger"].names)


def test_the_second_tooth_of_the_page_is_the_one_that_reports_ask_for():
    (block,) = re.findall("## A second tooth.*?```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    trigger = tomllib.loads(block)["trigger"]
    assert set(trigger) <= set(RECORDING_TABLES["trigger"].names)
    assert f"(pulses_per_rev = {trigger['pulses_per_rev']}, missing_teeth = {trigger['missing_teeth']})" in TOOTH


if __name__ == "__main__":
    PAGE.write_text(page_with(tables()), encoding="utf-8")
