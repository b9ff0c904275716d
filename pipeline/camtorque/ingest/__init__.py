"""Files -> Recording: one reader per format, sensors and certificates, the cam table, the check of a recording."""

from camtorque.ingest.check import RecordingSummary, summarise
from camtorque.ingest.formats import FORMATS
from camtorque.ingest.recording import read_recording
