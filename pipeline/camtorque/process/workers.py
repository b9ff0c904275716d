"""Processes of this machine: one pool per worker, so that a worker that dies takes its own recording alone with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import TypeVar

from camtorque.process.stopping import end_workers

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Lost:
    """In place of a result: two workers died on this item, one after the other."""


def on_processes(call: Callable[[T], R], items: Iterable[T], workers: int) -> Iterator[tuple[T, R | Lost]]:
    """Yield each item with its result as it is done by a function of a module, in fresh processes.

    An item whose worker dies is tried once more; then `Lost` is its result. Whatever ends the loop ends the workers.
    """
    # the process that clears away semaphores would warn on standard error when workers were killed
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker")
    waiting = iter(items)
    running: dict[Future[R], tuple[ProcessPoolExecutor, T, bool]] = {}

    def start(pool: ProcessPoolExecutor, item: T, again: bool = False) -> None:
        running[pool.submit(call, item)] = pool, item, again

    def start_next(pool: ProcessPoolExecutor) -> None:
        for item in waiting:
            start(pool, item)
            return
        pool.shutdown(wait=False)

    try:
        for item in waiting:
            start(_pool(), item)
            if len(running) == workers:
                break
        while running:
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                pool, item, again = running.pop(future)
                died = isinstance(future.exception(), BrokenProcessPool)
                if died and not again:
                    start(_pool(), item, again=True)
                    continue
                start_next(_pool() if died else pool)
                yield item, Lost() if died else future.result()
    except BaseException:
        end_workers()
        raise


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _start_worker)


def _start_worker() -> None:
    """Leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
