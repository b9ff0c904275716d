"""MATLAB files: v5 to v7.2 with scipy, v7.3 (which is HDF5) with h5py. What a channel is: `variables`."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, whosmat

from camtorque.config import ChannelSpec
from camtorque.ingest import hdf5
from camtorque.ingest.formats import first_bytes, is_hdf5
from camtorque.ingest.header import is_time_name, timed_by_name
from camtorque.ingest.raw import FileChannel, RawFile, checked_size, refusing
from camtorque.ingest.variables import is_rate_name, listed, read_variables
from camtorque.records import Refusal

HEAD = 128
COMPRESSED, MATRIX = 15, 14
OBJECT = "opaque"
"""Class of an object; its name stands where only MATLAB finds it."""


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read variables of a MATLAB file."""
    if is_hdf5(first_bytes(path)):
        return hdf5.read(path, specs, hint)
    check_mat(path)
    named = {spec.group or spec.channel for spec in specs}
    named |= {spec.group or spec.time_channel for spec in specs if spec.time_channel}
    wanted = {re.split(r"[.(]", name)[0] for name in named}  # rec.Torque and rec(2) lie in the variable rec
    names = _variable_names(path, wanted)
    beside = {name for name in names if is_time_name(name) or is_rate_name(name) or timed_by_name(name) in wanted}
    with refusing(path, "MATLAB v5"):
        variables = loadmat(str(path), variable_names=sorted(wanted | beside))
    return read_variables(path, "MATLAB v5", variables, names, specs)


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the variables, and the fields of structs, that hold one number per sample."""
    if is_hdf5(first_bytes(path)):
        return hdf5.channels(path)
    check_mat(path)
    names = _variable_names(path, set())
    with refusing(path, "MATLAB v5"):
        variables = loadmat(str(path), variable_names=list(names))
    found = listed(variables)
    if not found:
        _variable_names(path, {""})
        raise Refusal(f"{path}: holds no variable of one number per sample; {_kinds(variables)}")
    return found


def _kinds(variables: Mapping[str, Any]) -> str:
    """Say what the variables are and how to store them."""
    own = {name: value for name, value in variables.items() if not name.startswith("__")}
    shown = ", ".join(f"{name} {np.asarray(value).shape}" for name, value in list(own.items())[:5]) or "it is empty"
    return f"{shown}; store each channel as a variable or as a column of one, such as torque = Data(:,2)"


def check_mat(path: Path) -> None:
    """Follow the elements of a v5 file to its end; unpack the compressed ones for their checksum."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(HEAD)
        mark = head[126:128]
        if len(head) < HEAD or mark not in (b"IM", b"MI"):
            raise Refusal(f"{path}: the first {HEAD} bytes are not a MATLAB v5 header; save the file again")
        order = "<" if mark == b"IM" else ">"
        position = HEAD
        while position < size:
            file.seek(position)
            tag = file.read(8)
            kind, length = struct.unpack(order + "II", tag) if len(tag) == 8 else (0, 0)
            if kind not in (COMPRESSED, MATRIX) or position + 8 + length > size:
                raise Refusal(
                    f"{path}: the variable at byte {position} is no whole MATLAB element, the file has {size} bytes: "
                    "it is cut or damaged; save it again"
                )
            if kind == COMPRESSED:
                checked_size(file, length, f"{path}: compressed variable at byte {position}")
            position += 8 + length


def _variable_names(path: Path, wanted: set[str]) -> tuple[str, ...]:
    """Return the names of the variables that hold arrays.

    Raises
    ------
    Refusal : a wanted one is not among them, and an object is in the file
    """
    with refusing(path, "MATLAB v5"):
        found = whosmat(str(path))
    names = tuple(name for name, _, kind in found if kind != OBJECT)
    if len(names) < len(found) and not wanted <= set(names):
        raise Refusal(f"{path}: {hdf5.MATLAB_OBJECT.format('a variable')}")
    return names
