"""The formats of logs: one line each, one file each. What a file is, its first bytes tell; a suffix tells nothing.

The modules are loaded when a file of their format is read, so a format costs nothing where it is not used.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from camtorque.config import ChannelSpec
from camtorque.config.absent import no_file, what_is_beside
from camtorque.ingest.csv_layout import HEAD_BYTES, wide_codec
from camtorque.ingest.raw import FileChannel, RawFile
from camtorque.records import Refusal
from camtorque.units import did_you_mean

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
HDF5_PLACES = (0, 512, 1024, 2048)
ZIP_MAGIC = b"PK\x03\x04"
WORKBOOK_PARTS = (b"[Content_Types].xml", b"_rels/", b"docProps/", b"customXml/", b"xl/")
"""What a workbook's archive begins with, whichever program wrote it."""


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes
    ----------
    shown : its name for people
    aliases : other words of the bench for it
    module : below `camtorque.ingest`; it has ``read(path, specs, hint)`` -> `RawFile` and
        ``channels(path)`` -> what the file holds
    begins : tells it by the first bytes of a file
    """

    shown: str
    aliases: tuple[str, ...]
    module: str
    begins: Callable[[bytes], bool]

    def read(self, path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
        """Read channels of a file."""
        return importlib.import_module(f"camtorque.ingest.{self.module}").read(path, specs, hint)

    def channels(self, path: Path) -> tuple[FileChannel, ...]:
        """List the channels of a file."""
        return importlib.import_module(f"camtorque.ingest.{self.module}").channels(path)


def is_hdf5(head: bytes) -> bool:
    """Tell HDF5, maybe behind a user block (as MAT v7.3 is)."""
    return any(head[place:].startswith(HDF5_MAGIC) for place in HDF5_PLACES)


def _first_member(head: bytes) -> bytes:
    """Return the name of the first file of a zip archive, empty for other files."""
    length = int.from_bytes(head[26:28], "little")
    return head[30 : 30 + length] if head.startswith(ZIP_MAGIC) else b""


def _is_workbook(member: bytes) -> bool:
    """Tell a workbook by the first file of its archive; one whose very name is cut off may be one, too."""
    return not member or member.startswith(WORKBOOK_PARTS)


FORMATS: dict[str, Format] = {
    "tdms": Format("TDMS", (), "tdms", lambda head: head.startswith((b"TDSm", b"TDSh"))),
    "mf4": Format("MDF 4", ("mdf4", "mdf"), "mf4",
                  lambda head: head.startswith((b"MDF     ", b"UnFinMF ")) and head[8:9] >= b"4"),
    "mat": Format("MATLAB", (), "mat", lambda head: head.startswith(b"MATLAB")),
    "hdf5": Format("HDF5", ("h5",), "hdf5", is_hdf5),
    "numpy": Format("NumPy", ("npz", "npy"), "numpy_file",
                    lambda head: head.startswith(b"\x93NUMPY") or _first_member(head).endswith(b".npy")),
    "catman": Format("catman binary", (), "catman", lambda head: len(head) > 10 and b"\x00" in head and
                     5009 <= int.from_bytes(head[:2], "little") <= 5020),
    "xlsx": Format("Excel workbook", ("excel",), "xlsx",
                   lambda head: head.startswith(ZIP_MAGIC) and _is_workbook(_first_member(head))),
    "parquet": Format("Parquet or Feather", ("feather", "arrow"), "parquet",
                      lambda head: head.startswith((b"PAR1", b"ARROW1"))),
    "lvm": Format("LabVIEW measurement", (), "lvm", lambda head: head.startswith(b"LabVIEW Measurement")),
    "csv": Format("CSV or ASCII text", ("ascii", "txt"), "csv_log",
                  lambda head: b"\x00" not in head or bool(wide_codec(head))),
}  # fmt: skip
"""Name of a format -> how it is recognised and what reads it; the first that fits a file's beginning is its format."""
LINE_BY_LINE = ("csv", "lvm")
"""Of these, the texts: what stands in one up to its last whole line can be read while it is being written."""

UNREADABLE = {
    "MDF 2 or 3": lambda head: head.startswith((b"MDF     ", b"UnFinMF ")) and head[8:9] < b"4",
    "Excel 97 (.xls)": lambda head: head.startswith(b"\xd0\xcf\x11\xe0"),
    "imc FAMOS": lambda head: head.startswith(b"|CF,"),
    "WAV": lambda head: head.startswith(b"RIFF") and head[8:12] == b"WAVE",
    "gzip": lambda head: head.startswith(b"\x1f\x8b"),
    "a zip archive": lambda head: head.startswith(ZIP_MAGIC) and not content_format(head),
}
"""Formats that are known, not read."""
PACKED = ("gzip", "a zip archive")
"""Of these, what only has to be unpacked."""
LOCK_FILE = "~$"
POINTERS = (b"version https://git-lfs", b"/annex/objects/")
"""How what stands in the place of a large file begins, in a copy of a repository without its large files."""
ALIASES = {word: name for name, form in FORMATS.items() for word in (name, *form.aliases)}


def declared_format(word: str, where: str) -> str:
    """Return the name of a format as the bench writes it; "" stays "".

    Raises
    ------
    Refusal : the word names no format
    """
    word = word.strip()
    if word and word.lower() not in ALIASES:
        hint = did_you_mean(word, tuple(ALIASES))
        raise Refusal(f"{where} file_format: found {word!r}, expected one of {', '.join(ALIASES)}{hint}")
    return ALIASES.get(word.lower(), "")


def content_format(head: bytes) -> str:
    """Return the format that the first bytes show, "" for none."""
    return next((name for name, form in FORMATS.items() if form.begins(head)), "")


def file_format(path: Path, declared: str, used: Collection[Path] = ()) -> str:
    """Return the format of a log; of ``used`` files none is meant by the name of one that is missing.

    Raises
    ------
    Refusal : a missing or empty file, content of no known format, or of another one than declared
    """
    head = first_bytes(path, used)
    found = content_format(head)
    other = next((name for name, begins in UNREADABLE.items() if begins(head)), "")
    if found and declared in ("", found):
        return found
    # damage at the very beginning of a text makes it look like nothing: its reader says more
    if (declared, found or other) in (("csv", ""), ("mat", "hdf5")):
        return declared
    said = FORMATS[found].shown if found else other or "of no known kind or damaged at its very beginning"
    if declared:
        raise Refusal(
            f"{path}: file_format says {FORMATS[declared].shown}, but the content is {said}; correct file_format or "
            "the file"
        )
    shown = ", ".join(form.shown for form in FORMATS.values())
    ask = "unpack it" if other in PACKED else "export the log as one of them"
    raise Refusal(f"{path}: the content is {said}; expected one of {shown}: {ask}")


def first_bytes(path: Path, used: Collection[Path] = ()) -> bytes:
    """Return the first bytes of a log, which has to be there and hold something; ``used`` as for `file_format`."""
    if path.name.startswith(LOCK_FILE):
        raise Refusal(f"{path}: found what Excel keeps beside an open workbook, expected the log; name {path.name[2:]}")
    try:
        if not path.is_file():
            raise Refusal(
                f"{path}: {no_file(path)}, expected a log; recording.toml names logs relative to its own folder"
                f"{what_is_beside(path, used=used)}"
            )
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except (OSError, ValueError) as error:
        raise Refusal(f"{str(path)[:200]}: cannot be read ({getattr(error, 'strerror', error)})") from error
    if not head:
        raise Refusal(f"{path}: the file is empty (0 bytes); copy it from the logger again")
    if head.startswith(POINTERS):
        raise Refusal(
            f"{path}: found a pointer of Git, expected the log that it stands for; get it by `git lfs pull` or "
            "`git annex get`"
        )
    return head
