"""One line per format. `camtorque.config_toml.FORMAT_ALIASES` maps the bench's words to these names."""

from __future__ import annotations

from camtorque.ingest.catman import read_catman
from camtorque.ingest.csv_log import read_csv
from camtorque.ingest.hdf5 import read_hdf5
from camtorque.ingest.mat import read_mat
from camtorque.ingest.mf4 import read_mf4
from camtorque.ingest.raw import Reader
from camtorque.ingest.tdms import read_tdms

READERS: dict[str, Reader] = {
    "csv": read_csv,
    "tdms": read_tdms,
    "mf4": read_mf4,
    "hdf5": read_hdf5,
    "mat": read_mat,
    "catman": read_catman,
}
"""Name of a format -> its reader."""
