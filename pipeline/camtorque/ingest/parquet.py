"""Parquet and Feather (Arrow) with pyarrow, an optional extra: columns by name, units from the field's metadata."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.arrow_size import refuse_feather_bomb
from camtorque.ingest.cells import LEVELS
from camtorque.ingest.columns import columns_of, raw_file, time_columns_of
from camtorque.ingest.csv_layout import CsvLayout
from camtorque.ingest.header import name_and_unit
from camtorque.ingest.listing import listed
from camtorque.ingest.parquet_size import refuse_lying_pages
from camtorque.ingest.raw import ArraySource, FileChannel, RawFile, optional_library, refusing
from camtorque.ingest.zlib_check import refuse_bomb
from camtorque.records import Refusal, SampleSource

UNIT_KEYS = (b"unit", b"units")
TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read columns of a Parquet or Feather file."""
    layout = _layout(path)
    _refuse_no_numbers(path, layout, specs)
    wanted = columns_of(path, layout, specs)
    times = {column for column in time_columns_of(path, layout, specs) if column is not None}
    return raw_file(path, layout, _sources(path, layout, sorted({*wanted, *times})), specs)


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the columns of numbers and levels."""
    layout = _layout(path)
    return listed(path, layout, _sources(path, layout, [n for n, name in enumerate(layout.names) if name]))


def _library(path: Path) -> Any:
    return optional_library(path, "Parquet or Feather", "pyarrow", "feather", "parquet")


def _is_parquet(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == b"PAR1"


def _layout(path: Path) -> CsvLayout:
    library = _library(path)
    with refusing(path, "Parquet or Feather"):
        if _is_parquet(path):
            with library.parquet.ParquetFile(path) as file:
                schema, rows = file.schema_arrow, file.metadata.num_rows
                metadata = file.metadata
            refuse_bomb(8 * rows * max(len(schema), 1), path.stat().st_size, f"{path}: {rows} rows")
            refuse_lying_pages(path, metadata)
        else:
            schema = _feather_schema(path, library)
            refuse_feather_bomb(path, library)
    with refusing(path, "Parquet or Feather"):
        levels = _levels(path, library, schema)
    names, units, first = [], [], []
    for item in schema:
        kinds = library.types
        number = kinds.is_floating(item.type) or kinds.is_integer(item.type) or kinds.is_boolean(item.type)
        stamp, span = library.types.is_timestamp(item.type), library.types.is_duration(item.type)
        name, unit = name_and_unit(item.name)
        stated = next((item.metadata[key].decode() for key in UNIT_KEYS if key in (item.metadata or {})), unit)
        names.append(name if number or stamp or span or item.name in levels else "")
        units.append("s" if span else "" if stamp else stated)
        first.append("2000-01-01T00:00:00" if stamp else "0")
    return CsvLayout("", "", ".", 0, 0, tuple(names), tuple(units), tuple(first), None)


def _is_text(kinds: Any, found: Any) -> bool:
    held = found.value_type if kinds.is_dictionary(found) else found
    return bool(kinds.is_string(held) or kinds.is_large_string(held))


def _levels(path: Path, library: Any, schema: Any) -> set[str]:
    """Return the columns of texts, pandas' categories among them, whose first one is a word for a level."""
    texts = [item.name for item in schema if _is_text(library.types, item.type) and schema.names.count(item.name) == 1]
    if not texts:
        return set()
    if _is_parquet(path):
        with library.parquet.ParquetFile(path) as file:
            rows = list(islice(file.iter_batches(1, columns=texts), 1))
    else:
        with library.memory_map(str(path)) as memory:
            file = library.ipc.open_file(memory)
            rows = [file.get_batch(0)] if file.num_record_batches else []
    return {name for row in rows if row.num_rows for name in texts if _level(row.column(name)[0].as_py()) is not None}


def _level(word: str | None) -> float | None:
    return None if word is None else LEVELS.get(word.strip().lower())


def _refuse_no_numbers(path: Path, layout: CsvLayout, specs: tuple[ChannelSpec, ...]) -> None:
    """Refuse a channel whose column is there and holds texts, or what else is no number."""
    absent = {spec.channel for spec in specs} - set(layout.names)
    library = _library(path)
    for item, name in zip(_schema(path, library) if absent else (), layout.names, strict=False):
        if item.name in absent and not name:
            raise Refusal(
                f"{path}: column {item.name!r} holds {item.type}, expected numbers or a level in the first row "
                f"({', '.join(LEVELS)}): convert them, in pandas by df[{item.name!r}].astype(float) or, if they are "
                f"other words, df[{item.name!r}].astype(str).map({{'open': 1.0, 'shut': 0.0}})"
            )


def _schema(path: Path, library: Any) -> Any:
    with refusing(path, "Parquet or Feather"):
        return library.parquet.read_schema(path) if _is_parquet(path) else _feather_schema(path, library)


def _sources(path: Path, layout: CsvLayout, wanted: list[int]) -> dict[int, SampleSource]:
    library = _library(path)
    with refusing(path, "Parquet or Feather"):
        if _is_parquet(path):
            names = library.parquet.read_schema(path).names
            chosen = [names[number] for number in wanted]
            table = library.parquet.read_table(path, columns=chosen, page_checksum_verification=True,
                                               read_dictionary=chosen)  # fmt: skip
        else:
            names = _feather_schema(path, library).names
            table = library.feather.read_table(path, columns=[names[number] for number in wanted])
        arrays = {number: _numbers(library, table.column(place)) for place, number in enumerate(wanted)}
    return {number: ArraySource(values) for number, values in arrays.items()}


def _feather_schema(path: Path, library: Any) -> Any:
    with library.memory_map(str(path)) as memory:
        return library.ipc.open_file(memory).schema


def _numbers(library: Any, column: Any) -> np.ndarray:
    """Return a column as numbers: a date as seconds since 1970, a duration in seconds, no value or level as nan."""
    if _is_text(library.types, column.type):
        words = column.dictionary_encode().combine_chunks()
        levels = np.array([*map(_level, words.dictionary.to_pylist()), None], dtype=np.float64)
        return levels[words.indices.cast(library.int64()).fill_null(-1).to_numpy()]
    if library.types.is_timestamp(column.type) or library.types.is_duration(column.type):
        factor = TICKS[column.type.unit]
        return column.cast(library.int64()).to_numpy().astype(np.float64) * factor
    return column.to_numpy().astype(np.float64)
