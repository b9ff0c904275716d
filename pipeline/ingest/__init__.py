"""Files -> Recording: one reader per format, sensors and certificates, the cam table, the check of a recording."""

from pipeline.ingest.readers import READERS
from pipeline.ingest.recording import read_recording

__all__ = ["READERS", "read_recording"]
