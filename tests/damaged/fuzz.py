"""A fuzz target per format: the corpus' clean log of that format is the seed, mutated bytes are what a stranger sends.

Whatever comes, a reader gives channels or refuses in one line. ``python tests/damaged/fuzz.py tdms 600`` fuzzes one
format for ten minutes and keeps what broke it; the suite runs a short stretch of each.
"""

from __future__ import annotations

import sys
import time
import traceback
import warnings
from pathlib import Path

import numpy as np

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from camtorque.config import ChannelSpec
from camtorque.ingest.formats import FORMATS, content_format, first_bytes
from camtorque.records import Refusal
from damaged.logs import GROUPS, NAMES, SUFFIXES, WRITERS, clean_log

NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**63 - 1, 2**63, 2**64 - 1)
"""Counts, lengths and links that break arithmetic."""
LINES = (b"\n", b",,,,", b"\x00", b"1e999", b"-", b'"', b";", b"nan", b"\xff\xfe", b"9" * 400)
HEAD = 4096
"""Most of a format's structure lies in its first bytes."""


def seed(name: str, folder: Path) -> bytes:
    """Return the clean log of a format, short."""
    file = folder / f"seed.{SUFFIXES[name]}"
    WRITERS[name](file, clean_log(rate=2000.0, revolutions=12.0))
    return file.read_bytes()


def mutate(data: bytes, random: np.random.Generator) -> bytes:
    """Return the data with one to four faults: flips, cuts, extreme numbers, moved, doubled and lost blocks."""
    out = bytearray(data)
    for _ in range(int(random.integers(1, 5))):
        size = len(out)
        if size < 16:
            break
        at = int(random.integers(0, min(size, HEAD) if random.random() < 0.6 else size))
        kind = int(random.integers(0, 7))
        length = int(random.integers(1, 64))
        if kind == 0:
            out[at] ^= 1 << int(random.integers(0, 8))
        elif kind == 1:
            del out[at + 16 :]
        elif kind == 2:
            width = int(random.choice([1, 2, 4, 8]))
            number = NUMBERS[int(random.integers(0, len(NUMBERS)))] & (256**width - 1)
            out[at : at + width] = number.to_bytes(width, "little")
        elif kind == 3:
            del out[at : at + length]
        elif kind == 4:
            out[at:at] = out[at : at + length]
        elif kind == 5:
            other = int(random.integers(0, size))
            out[at : at + length] = out[other : other + length]
        else:
            out[at:at] = LINES[int(random.integers(0, len(LINES)))]
    return bytes(out)


def read_all(name: str, file: Path) -> str:
    """Read a file as a recording does and as `new` does; return "read" or "refused"."""
    try:
        if content_format(first_bytes(file)) not in (name, ""):
            return "refused"
        group = GROUPS[name]
        specs = tuple(
            ChannelSpec(quantity, file, group.format(quantity=quantity), channel, "V", "L", 2000.0, "")
            for quantity, channel in NAMES.items()
        )
        for raw in FORMATS[name].read(file, specs, "").channels:
            raw.source.read(0, min(raw.source.n_samples, 100_000))
        FORMATS[name].channels(file)
    except Refusal as refusal:
        if "\n" in str(refusal):
            raise AssertionError(f"a refusal of two lines: {refusal}") from refusal
        return "refused"
    return "read"


def fuzz(name: str, folder: Path, count: int = sys.maxsize, seconds: float = float("inf"), first: int = 0) -> list[str]:
    """Return what was neither read nor refused; each case is kept in ``folder`` with its number in the name."""
    clean, broken = seed(name, folder), []
    end = time.monotonic() + seconds
    for number in range(first, first + count):
        if time.monotonic() > end:
            break
        file = folder / f"case_{number}.{SUFFIXES[name]}"
        file.write_bytes(mutate(clean, np.random.default_rng(number)))
        started = time.monotonic()
        try:
            read_all(name, file)
        except BaseException as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            broken.append(f"{file}: {type(error).__name__}: {error} at {last.filename}:{last.lineno}")
            continue
        if time.monotonic() - started > 20.0:
            broken.append(f"{file}: {time.monotonic() - started:.0f} s")
            continue
        file.unlink()
    return broken


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    target = Path("fuzz") / sys.argv[1]
    target.mkdir(parents=True, exist_ok=True)
    print(*fuzz(sys.argv[1], target, seconds=float(sys.argv[2])), sep="\n")
