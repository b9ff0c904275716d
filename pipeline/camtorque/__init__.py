"""camtorque: from rig recordings to a measured-vs-model torque report."""

from pathlib import Path

from camtorque.caches import find_caches

__version__ = "0.1.0"

# before numba is imported: it looks for the folder of its cache once
find_caches(Path(__file__).parent)
