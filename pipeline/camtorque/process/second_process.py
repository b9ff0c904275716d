"""A second process for half of the work, where a fit follows many starts that know nothing of one another.

It is a fork, which begins with everything that was loaded and compiled; work and results go through pipes. What comes
out is the same number for number with it, without it, or where it dies.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, BinaryIO, NoReturn, TypeVar

from camtorque.process.stopping import SIGNALS, before_leaving
from camtorque.process.threads import processors

T = TypeVar("T")
R = TypeVar("R")
TICKET, NO_MORE = 2, b"\xff\xff"
"""Bytes of a place among the items, and what stands for the end: one for each process."""
PROTOCOL = 5
"""Of pickle: it keeps arrays read-only, which compiled functions tell apart."""

KILL_WITH_PARENT = 1
"""Request to `prctl` of Linux."""


@dataclass
class Second:
    """The second process of this one: 0 before it is needed, -1 where there is none any more.

    jobs, results : pipes to it and from it
    tickets : both ends of a pipe with the places of items that nobody has begun, from which both processes draw
    """

    number: int = 0
    jobs: BinaryIO | None = None
    results: BinaryIO | None = None
    tickets: tuple[int, int] = (-1, -1)

    def begin(self) -> None:
        """Fork."""
        to_child, jobs = os.pipe()
        results, to_parent = os.pipe()
        self.tickets = os.pipe()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of other threads: none of them holds a lock
                self.number = os.fork()
        except OSError:  # no room for one more process
            self.number = -1
        if self.number == 0:
            os.close(jobs)
            os.close(results)
            os.close(self.tickets[1])
            _work(to_child, to_parent, self.tickets[0])
        os.close(to_child)
        os.close(to_parent)
        self.jobs, self.results = open(jobs, "wb"), open(results, "rb")  # noqa: SIM115 - closed by `end`

    def send(self, job: tuple[Callable[[T], R], Sequence[T]], begun: int) -> None:
        """Have a function called with the items whose places the second process draws, from the first not begun."""
        data = pickle.dumps(job, PROTOCOL)
        places = b"".join(place.to_bytes(TICKET, "little") for place in range(begun, len(job[1])))
        os.write(self.tickets[1], places + 2 * NO_MORE)
        try:
            if self.jobs:
                self.jobs.write(data)
                self.jobs.flush()
        except OSError:
            self.end()

    def received(self) -> dict[int, Any]:
        """Wait for the results by place, none where the second process is no more."""
        try:
            return dict(pickle.load(self.results)) if self.results else {}
        except (EOFError, OSError, pickle.UnpicklingError):
            self.end()
            return {}

    def kill(self) -> None:
        """End the process at once."""
        if self.number > 0:
            with suppress(ProcessLookupError):
                os.kill(self.number, signal.SIGKILL)

    def end(self) -> None:
        """Leave nothing of it behind."""
        self.kill()
        if self.number > 0:
            os.waitpid(self.number, 0)
        for pipe in (self.jobs, self.results):
            if pipe:
                with suppress(OSError):
                    pipe.close()
        for end in self.tickets:
            with suppress(OSError):
                os.close(end)
        self.number, self.jobs, self.results, self.tickets = -1, None, None, (-1, -1)


_SECOND: ContextVar[Second | None] = ContextVar("the second process of this one", default=None)


@contextmanager
def second_process(wanted: bool = True) -> Iterator[None]:
    """Let `in_two` use a second process inside the block, where the system is made for it and has a core for it.

    It is for commands and workers, which own their process: a fork beside the threads of other code is not safe.
    """
    on_main = threading.current_thread() is threading.main_thread()
    possible = sys.platform == "linux" and on_main and processors() > 1
    second = Second() if wanted and possible else None
    token = _SECOND.set(second)
    try:
        if second is None:
            yield
            return
        with before_leaving(second.kill):
            yield
    finally:
        _SECOND.reset(token)
        if second:
            second.end()


def in_two(function: Callable[[T], R], items: Sequence[T], at_once: bool = False) -> list[R]:
    """Return the results of a function in the order of the items, some of them from a second process.

    Each process begins the next item as soon as it has done one: some take ten times as long as others. Outside of
    `second_process`, and inside the function itself, one process does them in turn. The function is one of a module, or
    a `functools.partial` of one; the first item goes before the others, to compile and load for both processes, unless
    all begin ``at_once``.
    """
    second = _SECOND.get()
    if second is None or len(items) < 2 or second.number < 0:
        return [function(item) for item in items]
    token = _SECOND.set(None)
    try:
        done: dict[int, R] = {}
        if second.number == 0:
            if not at_once:
                done[0] = function(items[0])  # what is compiled or loaded at the first call is then there in both
            second.begin()
        if second.number > 0:
            second.send((function, items), len(done))
        if second.number > 0:
            done |= {place: function(items[place]) for place in _drawn(second.tickets[0])}
            done |= second.received()
        return [done[place] if place in done else function(item) for place, item in enumerate(items)]
    except BaseException:
        second.end()  # it may be at work on what nobody asks for any more
        raise
    finally:
        _SECOND.reset(token)


def _drawn(tickets: int) -> Iterator[int]:
    """Yield places of items that nobody has begun, until there are no more."""
    while (ticket := os.read(tickets, TICKET)) not in (NO_MORE, b""):
        yield int.from_bytes(ticket, "little")


def _work(jobs: int, results: int, tickets: int) -> NoReturn:
    """Run the jobs that come in until the pipe closes, then exit silently."""
    try:
        ctypes.CDLL(None).prctl(KILL_WITH_PARENT, signal.SIGKILL)
        signal.set_wakeup_fd(-1)
        for number in SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        _SECOND.set(None)
        with open(jobs, "rb") as source, open(results, "wb") as target:
            while True:
                function, items = pickle.load(source)
                target.write(pickle.dumps({place: function(items[place]) for place in _drawn(tickets)}, PROTOCOL))
                target.flush()
    finally:
        os._exit(0)
