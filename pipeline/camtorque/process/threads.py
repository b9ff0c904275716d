"""Threads: one for the linear algebra, whose matrices are small; several for recordings of a joint fit side by side."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from camtorque.process.stopping import interruption_behind

P = ParamSpec("P")
T = TypeVar("T")
R = TypeVar("R")


def processors() -> int:
    """Return how many processors this process may use; a batch system or a container may keep some from it."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function with the numerical libraries on one thread while it runs, in a script as in the command.

    Whatever compiled code makes of Ctrl-C, it leaves the function as KeyboardInterrupt.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        handled = sys.exception()
        try:
            with threadpool_limits(1):
                return function(*args, **kwargs)
        except Exception as error:
            stop = interruption_behind(error, handled)
            if stop is None:
                raise
            raise stop from None

    return limited


class Each(Protocol):
    """Calls a function with each item and returns the results in the order of the items."""

    def __call__(self, function: Callable[[T], R], items: Iterable[T], /) -> list[R]:
        """Return the results."""
        ...


def in_turn(function: Callable[[T], R], items: Iterable[T], /) -> list[R]:
    """Call one after the other."""
    return [function(item) for item in items]


@contextmanager
def side_by_side(threads: int) -> Iterator[Each]:
    """Give a way to call in several threads: compiled code and linear algebra run at the same time.

    A function that is called so must not be given the same way to call: its threads might wait for each other.
    """
    if threads < 2:
        yield in_turn
        return
    pool = ThreadPoolExecutor(threads)
    try:
        yield lambda function, items: list(pool.map(function, items))
    finally:
        pool.shutdown(cancel_futures=True)
