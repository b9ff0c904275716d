"""Arrays that may not fit into memory: stacks of aligned cycles (n_cycles, n_theta), and shelves of any arrays.

What is too large lies in a nameless file; what was read of a stack is given back to the system after each piece.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import weakref
from collections.abc import Callable, Iterator
from functools import partial
from threading import Lock
from typing import IO

import numpy as np
from numpy.typing import NDArray

Stack = NDArray[np.float64]

PIECE_VALUES = 1 << 17
"""Values worked on at a time: they stay in the processor's cache."""
GIVEN_BACK = 1 << 25
"""Bytes that are read of a stack on disk before its pages are given back."""
LARGEST_IN_MEMORY = 1 << 27
"""Bytes of one channel's stack above which it is kept on disk, where the system can promise the room."""


def empty_stack(n_cycles: int, n_theta: int) -> Stack:
    """Return room for aligned cycles: in memory, or in a nameless file where they are many."""
    size = 8 * n_cycles * n_theta
    if size > LARGEST_IN_MEMORY and hasattr(os, "posix_fallocate"):
        try:
            with tempfile.TemporaryFile() as file:
                # a full disk is noticed now; later it would kill the process
                os.posix_fallocate(file.fileno(), 0, size)
                return np.memmap(file, dtype=np.float64, mode="r+", shape=(n_cycles, n_theta))
        except OSError:
            pass
    return np.empty((n_cycles, n_theta))


def give_back(stack: Stack) -> None:
    """Have the system drop from memory what it holds of a stack on disk; nothing is lost."""
    owner: object = stack
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        owner.madvise(mmap.MADV_DONTNEED)


def pieces(stack: Stack) -> Iterator[slice]:
    """Yield slices of cycles that fit into the processor's cache; see `give_back`."""
    n_cycles, width = stack.shape
    step, held = max(1, PIECE_VALUES // max(width, 1)), 0
    for first in range(0, n_cycles, step):
        yield slice(first, min(first + step, n_cycles))
        held += 8 * step * width
        if held > GIVEN_BACK:
            give_back(stack)
            held = 0
    give_back(stack)


def mean_of(stack: Stack, chosen: NDArray[np.bool_] | None = None) -> Stack:
    """Return the mean over all cycles, or over the chosen ones (n_theta,)."""
    weights = np.ones(stack.shape[0]) if chosen is None else chosen.astype(np.float64)
    total = np.zeros(stack.shape[1])
    for piece in pieces(stack):
        total += weights[piece] @ stack[piece]
    return np.asarray(total / np.sum(weights))


def products_of(stack: Stack, weights: Stack) -> Stack:
    """Return the sum of each cycle's values times weights (n_theta,), (n_cycles,)."""
    return np.concatenate([stack[piece] @ weights for piece in pieces(stack)])


def std_of(stack: Stack, mean: Stack, ddof: int = 0) -> Stack:
    """Return the standard deviation over all cycles about their mean (n_theta,)."""
    total = np.zeros(stack.shape[1])
    for piece in pieces(stack):
        deviation = stack[piece] - mean
        total += np.einsum("ij,ij->j", deviation, deviation)
    return np.asarray(np.sqrt(total / (stack.shape[0] - ddof)))


def distance_of(stack: Stack, centre: Stack, stride: int = 1) -> Stack:
    """Return the rms distance of each cycle from a cycle, which holds every ``stride``-th point (n_cycles,)."""
    total = np.empty(stack.shape[0])
    for piece in pieces(stack):
        deviation = stack[piece, ::stride] - centre
        total[piece] = np.einsum("ij,ij->i", deviation, deviation)
    return np.asarray(np.sqrt(total / centre.size))


HELD = 1 << 25
"""Bytes of a shelf that stay in memory."""


class Shelf:
    """Room for arrays; where the disk gives none they stay in memory. Several threads may use it."""

    def __init__(self, held: int = HELD) -> None:
        self._left, self._end, self._lock = held, 0, Lock()
        self._file: IO[bytes] | None = None

    def put(self, array: Stack) -> Callable[[], Stack]:
        """Take an array and return what gives it back; the caller keeps no other hold on it."""
        with self._lock:
            if array.nbytes > self._left and hasattr(os, "pread"):
                try:
                    return partial(self._read, self._written(array), array.shape)
                except OSError:
                    pass
            self._left -= array.nbytes
        return lambda: array

    def _written(self, array: Stack) -> int:
        """Write an array to the end of the file and return its place."""
        if self._file is None:
            self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 (closed with the shelf)
            weakref.finalize(self, self._file.close)
        place, data = self._end, array.tobytes()
        if os.pwrite(self._file.fileno(), data, place) < len(data):
            raise OSError("no room is left")
        self._end += len(data)
        return place

    def _read(self, place: int, shape: tuple[int, ...]) -> Stack:
        assert self._file is not None
        data = os.pread(self._file.fileno(), 8 * int(np.prod(shape)), place)
        return np.frombuffer(data).reshape(shape)
