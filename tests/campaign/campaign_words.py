"""What the word of a stand-in recording makes its worker do; light to import, for every worker is a fresh process."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def act(word: str, place: Path) -> None:
    """Do what the word of a recording says."""
    verb, _, value = word.partition(" ")
    if verb == "sleep":
        time.sleep(float(value))
    elif verb == "refuse":
        from camtorque.records import Refusal

        raise Refusal(f"no {value}")
    elif verb == "fail":
        raise ValueError(value)
    elif verb == "unreadable":
        raise OSError(5, "Input/output error", "log.csv")
    elif verb == "die" or (verb == "once" and not place.exists()):
        place.touch()
        os.kill(os.getpid(), signal.SIGKILL)


def sleepy(word: str) -> str:
    """Do what a word says, then hand it back; its second line is where it leaves a mark."""
    first, _, place = word.partition("\n")
    act(first, Path(place))
    return first
