"""Errors of the operating system in words; standard streams that can always be written."""

from __future__ import annotations

import errno
import gc
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

ADVICE = {
    errno.ENOSPC: "free some space and run again",
    errno.EDQUOT: "free some of your quota and run again",
    errno.EFBIG: "raise the limit of the file size and run again",
    errno.EROFS: "choose a place that can be written",
    errno.EACCES: "check its permissions or choose another place",
    errno.EPERM: "check its permissions or choose another place",
    errno.ELOOP: "its links run in a circle; choose another place",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ENOTDIR: "one of its parents is a file; choose another place",
    errno.EMFILE: "raise the limit of open files (ulimit -n) and run again",
    errno.ENOMEM: "use a machine with more memory, or fewer workers",
}
"""What to do about an error of the system."""
OTHERWISE = "check the path and its permissions"


def described(error: Exception) -> tuple[str, str]:
    """Return the text of an error and what to do about it.

    HDF5 names the reason in its text alone, so the text is searched for the system's words.
    """
    text = " ".join(str(error).split())
    code = getattr(error, "errno", None)
    if code not in ADVICE:
        code = next((known for known in ADVICE if os.strerror(known) in text), None)
    if code is not None:
        place = getattr(error, "filename", None)
        return os.strerror(code) if place is None else f"{os.strerror(code)}: {place}", ADVICE[code]
    if isinstance(error, MemoryError):
        return f"not enough memory {text}".strip(), ADVICE[errno.ENOMEM]
    if isinstance(error, OSError):
        return text, OTHERWISE
    return f"unexpected {type(error).__name__}: {text}", "run again with --debug and report it"


def usable_streams() -> None:
    """Make closed standard streams go nowhere, and let a narrow encoding escape what it lacks.

    A closed one would lend its number to the next file that is opened, and messages would end up in it. In the locale C
    the bytes of names of files come out as they went in, and all else as UTF-8.
    """
    plain = sys.getfilesystemencoding() == "ascii" and "PYTHONIOENCODING" not in os.environ
    how = {"encoding": "utf-8", "errors": "surrogateescape"} if plain else {"errors": "backslashreplace"}
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - lives as long as the process
        with suppress(AttributeError):  # a stream of a notebook or a test
            getattr(sys, name).reconfigure(**how)


def silence_output() -> None:
    """Send the rest of the standard output nowhere: its reader has gone, and the interpreter would complain at exit."""
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def no_tracebacks() -> Iterator[None]:
    """Keep objects that fail while they are taken apart from printing a traceback.

    After a failed write every open object of HDF5 does so, beside the one line that tells of it.
    """

    def nothing(*_: Any) -> None:
        return

    hooks = sys.excepthook, sys.unraisablehook
    sys.excepthook, sys.unraisablehook = nothing, nothing
    try:
        yield
    finally:
        sys.excepthook, sys.unraisablehook = hooks


def forget(error: BaseException | None) -> None:
    """Let go of what the frames of an error and of its causes hold, while nothing is printed about it."""
    while error is not None:
        traceback.clear_frames(error.__traceback__)
        error = error.__cause__ or error.__context__
    gc.collect()
