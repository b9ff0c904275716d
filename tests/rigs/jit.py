"""`compiled`: the one decorator of the compiled functions. They release the GIL, so threads run rigs side by side.

Numba keeps compiled functions on disk but looks only at the file of each function, not at what it calls. So the
cache is emptied here whenever any of the compiled sources has changed. Sums keep their order (no fast math): else a
rig differs in its last digits by what was compiled before it, and what a search finds on it may.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from numba import njit

HERE = Path(__file__).parent
SOURCES = ("constants.py", "hydraulics.py", "jit.py", "laws.py", "loop.py", "mechanics.py")


def _drop_stale_cache() -> None:
    digest = hashlib.sha256(b"".join((HERE / name).read_bytes() for name in SOURCES)).hexdigest()
    stamp = HERE / "__pycache__" / "sources.sha256"
    if stamp.exists() and stamp.read_text() == digest:
        return
    stamp.parent.mkdir(exist_ok=True)
    for name in SOURCES:
        for index in stamp.parent.glob(f"{Path(name).stem}.*.nbi"):
            index.unlink(missing_ok=True)
    stamp.write_text(digest)


_drop_stale_cache()
compiled = njit(cache=True, nogil=True, error_model="numpy")
