"""docs/recording_toml.md shows the tables of camtorque/schemas.py, word for word; run this file to write them."""

from pathlib import Path

from camtorque.quantities import CHANNEL_QUANTITIES
from camtorque.schemas import CERTIFICATE_COLUMNS, PUMP_FILE_TABLES, RECORDING_TABLES, SHEET
from camtorque.toml_schema import TableSchema, markdown_rows

PAGE = Path(__file__).resolve().parents[2] / "docs" / "recording_toml.md"
BEGIN, END = "from camtorque/schemas.py -->\n", "<!-- end -->"
HEAD = ["| table | key | meaning | allowed | |", "|---|---|---|---|---|"]


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


if __name__ == "__main__":
    PAGE.write_text(page_with(tables()), encoding="utf-8")
