"""Ctrl-C and termination: what is unfinished is removed, workers are ended, the process leaves within two seconds.

Python runs its signal handlers between two of its own instructions, so a long call of compiled code would hold them
back. A thread therefore hears of the signal too and ends the process itself when the main thread is not done in time.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
GRACE = 0.7
"""Seconds that the main thread has to end in good order."""

_last_steps: list[Callable[[], None]] = []
_heard: list[int] = []
"""Signals that came since the last `stoppable` began."""


class Stopped(KeyboardInterrupt):
    """The user or the system ended the process; ``status`` is what it leaves with."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.status = 128 + number


@contextmanager
def before_leaving(step: Callable[[], None]) -> Iterator[None]:
    """Have a step taken when the process is stopped inside the block and cannot end in good order."""
    _last_steps.append(step)
    try:
        yield
    finally:
        _last_steps.remove(step)


def end_workers() -> None:
    """Kill the worker processes that this process started; their locks are free afterwards."""
    workers = sys.modules.get("multiprocessing")  # nobody loaded it: there are none
    children = [] if workers is None else workers.active_children()
    for child in children:
        child.kill()
    for child in children:
        child.join(0.5)


def interruption_behind(error: BaseException, handled: BaseException | None) -> KeyboardInterrupt | None:
    """Return the interruption of which compiled code made another error, None where there was none.

    What the caller was handling before stands behind every error, too.
    """
    seen: BaseException | None = error
    while seen is not None and seen is not handled:
        if isinstance(seen, KeyboardInterrupt):
            return seen
        seen = seen.__cause__ or seen.__context__
    return None


@contextmanager
def stoppable() -> Iterator[None]:
    """Turn the first signal into `Stopped`, and leave in any case soon after it; only in the main thread.

    Once a signal came the process ends within `GRACE`, even where threads of a library would keep it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    _heard.clear()
    earlier = {number: signal.signal(number, _raise_once) for number in SIGNALS}
    earlier_writer = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), daemon=True, name="stop watch").start()
    try:
        yield
    except Exception as error:
        if was_stopped():  # compiled code makes another error of the one that is raised inside it
            raise Stopped(_heard[0]) from error
        raise
    finally:
        signal.set_wakeup_fd(earlier_writer)
        for number, former in earlier.items():
            signal.signal(number, former)
        os.close(writer)


def was_stopped() -> bool:
    """Tell whether a signal came: any error after it may be its consequence."""
    return bool(_heard)


def _raise_once(number: int, frame: Any) -> None:
    """Raise at the first signal; a second one must not interrupt the tidying up."""
    _heard.append(number)
    if len(_heard) == 1:
        raise Stopped(number)


def _watch(reader: int) -> None:
    """Wait for a signal, then give the main thread its time and leave."""
    while data := os.read(reader, 1):
        if data[0] in SIGNALS:
            time.sleep(GRACE)
            for step in [end_workers, *reversed(_last_steps)]:
                step()
            os._exit(128 + data[0])
    os.close(reader)
