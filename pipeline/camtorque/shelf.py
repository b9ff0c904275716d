"""Arrays that are read again and again but are too many to be held: few stay in memory, more go to a nameless file."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Callable
from functools import partial
from threading import Lock
from typing import IO

import numpy as np

from camtorque.records import Array

HELD = 1 << 25
"""Bytes of a shelf that stay in memory."""


class Shelf:
    """Room for arrays; where the disk gives none they stay in memory. Several threads may use it."""

    def __init__(self, held: int = HELD) -> None:
        self._left, self._end, self._lock = held, 0, Lock()
        self._file: IO[bytes] | None = None

    def put(self, array: Array) -> Callable[[], Array]:
        """Take an array and return what gives it back; the caller keeps no other hold on it."""
        with self._lock:
            if array.nbytes > self._left and hasattr(os, "pread"):
                try:
                    return partial(self._read, self._written(array), array.shape)
                except OSError:
                    pass
            self._left -= array.nbytes
        return lambda: array

    def _written(self, array: Array) -> int:
        """Write an array to the end of the file and return its place."""
        if self._file is None:
            self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 (closed with the shelf)
            weakref.finalize(self, self._file.close)
        place, data = self._end, array.tobytes()
        if os.pwrite(self._file.fileno(), data, place) < len(data):
            raise OSError("no room is left")
        self._end += len(data)
        return place

    def _read(self, place: int, shape: tuple[int, ...]) -> Array:
        assert self._file is not None
        data = os.pread(self._file.fileno(), 8 * int(np.prod(shape)), place)
        return np.frombuffer(data).reshape(shape)
