"""One line per format, its module loaded when a recording needs it: pandas alone takes longer than reading a log.

`camtorque.config_toml.FORMAT_ALIASES` maps the bench's words to these names.
"""

from __future__ import annotations

from importlib import import_module

from camtorque.ingest.raw import Reader

READERS: dict[str, str] = {
    "csv": "camtorque.ingest.csv_log:read_csv",
    "tdms": "camtorque.ingest.tdms:read_tdms",
    "mf4": "camtorque.ingest.mf4:read_mf4",
    "hdf5": "camtorque.ingest.hdf5:read_hdf5",
    "mat": "camtorque.ingest.mat:read_mat",
    "catman": "camtorque.ingest.catman:read_catman",
}
"""Name of a format -> module and function of its reader."""


def reader_of(file_format: str) -> Reader:
    """Return the reader of a format."""
    module, function = READERS[file_format].split(":")
    return getattr(import_module(module), function)
