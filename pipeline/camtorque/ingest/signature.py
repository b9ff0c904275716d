"""What a file really is, from its first bytes."""

from __future__ import annotations

from pathlib import Path

from camtorque.records import Refusal

NAMES = {
    "csv": "CSV or ASCII text",
    "tdms": "TDMS",
    "mf4": "MDF 4",
    "mdf3": "MDF 2 or 3",
    "hdf5": "HDF5",
    "mat": "MATLAB",
    "catman": "catman binary",
}
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
HDF5_PLACES = (0, 512, 1024, 2048)


def content_format(path: Path) -> str:
    """Return the format that the first bytes show: a key of `NAMES`, "text" or "unknown"."""
    with path.open("rb") as file:
        head = file.read(4096)
    if head.startswith((b"TDSm", b"TDSh")):
        return "tdms"
    if head.startswith((b"MDF     ", b"UnFinMF ")):
        return "mf4" if head[8:9] >= b"4" else "mdf3"
    if head.startswith(b"MATLAB"):
        return "mat"
    if _holds_hdf5_magic(head):
        return "hdf5"
    if len(head) > 10 and 5009 <= int.from_bytes(head[:2], "little") <= 5020 and b"\x00" in head:
        return "catman"
    return "text" if b"\x00" not in head else "unknown"


def check_content(path: Path, declared: str) -> None:
    """Refuse a missing or empty file, and one whose content is of another format than declared."""
    if not path.is_file():
        raise Refusal(f"{path}: no such file; recording.toml names it as a log (paths are relative to recording.toml)")
    if path.stat().st_size == 0:
        raise Refusal(f"{path}: the file is empty (0 bytes); copy it from the logger again")
    found = content_format(path)
    agrees = found == declared or (declared == "csv" and found in ("text", "unknown"))
    if agrees or (declared == "mat" and found == "hdf5"):
        return
    said = NAMES.get(found, "text" if found == "text" else "of no known kind or damaged at its very beginning")
    raise Refusal(
        f"{path}: file_format says {NAMES[declared]}, but the content is {said}; correct file_format or the file"
    )


def is_hdf5(path: Path) -> bool:
    """Tell whether a file is HDF5, maybe behind a user block (as MAT v7.3 is)."""
    with path.open("rb") as file:
        return _holds_hdf5_magic(file.read(4096))


def _holds_hdf5_magic(head: bytes) -> bool:
    return any(head[place:].startswith(HDF5_MAGIC) for place in HDF5_PLACES)
