"""NumPy archives (.npz) of a body: an array `positions`, perhaps `volumes`, and arrays with one row for each point.

An archive is a zip file whose members are arrays, each with a header that announces its shape. Sizes are checked from
the directory of the zip file and from these headers before any array is loaded. Arrays of Python objects are not
loaded, since loading them would run code.

References
----------
NumPy Enhancement Proposal 1, a simple file format for NumPy arrays. PKWARE, .ZIP file format specification.
"""

import math
import os
import zipfile
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..contents import Contents, States

POSITIONS = ("positions", "points", "coordinates")
VOLUMES = ("volumes", "volume")
DEFLATED = 1032  # a deflated stream cannot hold more than 1032 bytes in one


class Announced(NamedTuple):
    """What the header of an array announces."""

    shape: tuple[int, ...]
    dtype: np.dtype


def states(path: Path) -> States:
    """The single state of an archive."""
    return States((), lambda _: _contents(path))


def _contents(path: Path) -> Contents:
    try:
        with zipfile.ZipFile(path) as archive:
            return _body(path, archive)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"{path} is damaged or no .npz archive of NumPy: {error}") from None


def _announced(path: Path, archive: zipfile.ZipFile) -> dict[str, Announced]:
    """The shape and dtype of every array, after a check of the announced sizes."""
    length, out = os.path.getsize(path), {}
    members = archive.infolist()
    stored = sum(member.compress_size for member in members)
    if stored > length:
        raise ValueError(f"{path} announces {stored} bytes of arrays, but the file has only {length}; it is damaged")
    for member in members:
        if not member.filename.endswith(".npy"):
            continue
        if member.file_size > DEFLATED * max(member.compress_size, 1):
            raise ValueError(
                f"{path}: {member.filename} announces {member.file_size} bytes in {member.compress_size} compressed"
                " ones, which is impossible; the file is damaged"
            )
        with archive.open(member) as stream:
            version = np.lib.format.read_magic(stream)
            read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(
                version
            )
            if read is None:
                continue  # version 3 is for names of fields that are not Latin-1; positions have no fields
            shape, _, dtype = read(stream)
        size = math.prod(shape) * dtype.itemsize
        if not dtype.hasobject and size > member.file_size:
            raise ValueError(
                f"{path}: {member.filename} announces an array of shape {shape}, {size} bytes, but holds only"
                f" {member.file_size}; the file is incomplete or damaged"
            )
        out[member.filename.removesuffix(".npy")] = Announced(shape, dtype)
    return out


def _body(path: Path, archive: zipfile.ZipFile) -> Contents:
    announced = _announced(path, archive)
    listed = ", ".join(sorted(announced)) or "none"
    key = next((name for name in POSITIONS if name in announced), None)
    if key is None:
        raise ValueError(
            f"{path} holds no array named positions; got the arrays {listed}; it is no body that pdjax.write_points"
            " wrote; save one with numpy.savez(path, positions=…, volumes=…)"
        )
    shape = announced[key].shape
    if len(shape) not in (1, 2) or shape[1:] not in ((), (1,), (2,), (3,)) or announced[key].dtype.kind not in "fiu":
        raise ValueError(f"{path}: {key} must be numbers of shape (points, 1 to 3); got {announced[key]}")
    volume = next((name for name in VOLUMES if name in announced), None)
    fields, sets, left = {}, {}, []
    for name, (form, dtype) in announced.items():
        if name in (key, volume):
            continue
        if form[:1] != shape[:1] or dtype.kind not in "fiubc":
            left.append(name)
        elif dtype.kind == "b" and len(form) == 1:
            sets[name] = _array(path, archive, name)
        else:
            fields[name] = _array(path, archive, name)
    notes = (f"Left out: {', '.join(left)}; these are no numbers for each of the {shape[0]} points.",) if left else ()
    positions = np.asarray(_array(path, archive, key))
    volumes = None
    if volume is not None:
        if announced[volume].dtype.kind not in "fiu" or announced[volume].shape not in ((), shape[:1]):
            raise ValueError(f"{path}: {volume} must be one number a point, {shape[:1]}; got {announced[volume]}")
        volumes = np.broadcast_to(_array(path, archive, volume), shape[:1])
    return Contents(positions.reshape(len(positions), -1), volumes, fields, sets, notes=notes)


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> np.ndarray:
    with archive.open(name + ".npy") as stream:
        try:
            return np.lib.format.read_array(stream, allow_pickle=False)
        except ValueError as error:
            raise ValueError(f"{path}: the array {name} is damaged: {error}") from None
