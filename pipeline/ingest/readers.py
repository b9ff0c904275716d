"""One line per format. `pipeline.config_toml.FORMAT_ALIASES` maps the bench's words to these names."""

from __future__ import annotations

from pipeline.ingest.catman import read_catman
from pipeline.ingest.csv_log import read_csv
from pipeline.ingest.hdf5 import read_hdf5
from pipeline.ingest.mat import read_mat
from pipeline.ingest.mf4 import read_mf4
from pipeline.ingest.raw import Reader
from pipeline.ingest.tdms import read_tdms

READERS: dict[str, Reader] = {
    "csv": read_csv,
    "tdms": read_tdms,
    "mf4": read_mf4,
    "hdf5": read_hdf5,
    "mat": read_mat,
    "catman": read_catman,
}
"""Name of a format -> its reader."""
