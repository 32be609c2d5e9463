"""Text dumps of LAMMPS (dump custom): frames of a run, each with a table of named columns.

A frame is "ITEM: TIMESTEP", the number of atoms, the bounds of the box, and the table. Only the places of the frames
are found at first; a frame is read when it is asked for.

The reference positions are those of the first frame. Every state has a field "displacement" from them. Points are
sorted by id, since the order of atoms changes from frame to frame. Coordinates may be x, y, z, unwrapped (xu), scaled
by the box (xs) or both (xsu). Where a box is periodic and there are neither unwrapped coordinates nor image flags (ix),
displacements are taken as less than half of the box. The columns fx, fy, fz are the field "force" and vx, vy, vz are
"velocity"; a column volume, vol, c_vol or v_vol holds the volumes.

If the last frame of an interrupted run is incomplete, reading this frame raises an error, and the others can be read.

References
----------
LAMMPS documentation, command dump.
"""

import mmap
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..contents import Contents, States
from .columns import ID, MOST_BLOCKS, VOLUME, are_whole, combined, parts, plain
from .table import Place, header_line, is_number, line_of, read_table

START = b"ITEM: TIMESTEP"
COORDINATES = (("xu", "yu", "zu"), ("xsu", "ysu", "zsu"), ("x", "y", "z"), ("xs", "ys", "zs"))  # best first
IMAGES = ("ix", "iy", "iz")
RENAMED = {"v": "velocity", "f": "force"}


class Frame(NamedTuple):
    """One frame as it is read: ids in ascending order or None, and the other arrays in that order.

    positions (points, dim) are unwrapped if `unwrapped`. edges (dim, dim): those of the box, as rows. periodic: axes.
    """

    ids: np.ndarray | None
    positions: np.ndarray
    unwrapped: bool
    edges: np.ndarray
    periodic: np.ndarray
    columns: dict[str, np.ndarray]
    where: Callable[[int], str]
    notes: tuple[str, ...]


def states(path: Path) -> States:
    """The frames of a dump as states, with the reference positions of the first one."""
    offsets, times, are_steps = _index(path)
    first: list[Frame] = []

    def at(number: int) -> Contents:
        frame = _frame(path, offsets, number)
        if not first:
            first.append((_frame(path, offsets, 0) if number else frame)._replace(columns={}))
        return _state(path, number, first[0], frame, times, are_steps)

    return States(tuple(times), at)


def _index(path: Path) -> tuple[list[int], list[float], bool]:
    """The offsets of the frames, their times, and whether these are numbers of steps."""
    offsets: list[int] = []
    times: list[float] = []
    steps: list[float] = []
    with open(path, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at = data.find(START)
        while at >= 0:
            if at > 0 and data[at - 1] != ord("\n"):  # not at the start of a line
                at = data.find(START, at + len(START))
                continue
            following = data[at : at + 100].split(b"\n", 2)[1:2]
            steps.append(_number(following[0]) if following else np.nan)
            said = re.search(rb"ITEM: TIME\s*\n\s*(\S+)\s*\n$", data[max(0, at - 100) : at])
            times.append(_number(said[1]) if said else np.nan)
            offsets.append(at)
            at = data.find(START, at + len(START))
    if not offsets:
        raise ValueError(
            f'{path} is no text dump of LAMMPS: expected a line "ITEM: TIMESTEP"; binary dumps are not read'
        )
    are_steps = bool(np.isnan(times).any())
    return offsets, steps if are_steps else times, are_steps


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        return np.nan


def _head(path: Path, offsets: list[int], number: int) -> tuple[Place, list[str], list[str], list[list[float]]]:
    """Where the table of a frame starts, the names of its columns, the words on the box, and its bounds."""
    items: dict[str, list[str]] = {}
    named = f"{path}, frame {number}"
    with open(path, "rb") as stream:
        stream.seek(offsets[number])
        line, key = 0, ""
        while True:
            line += 1
            text = header_line(stream, path, line + 1).strip()
            if text.startswith("ITEM: ATOMS"):
                break
            if not text or line > 100:
                raise ValueError(f'{named}: expected a line "ITEM: ATOMS"; the frame is incomplete or damaged')
            if text.startswith("ITEM:"):
                key = text[5:].strip()
                items[key] = []
            else:
                items[key].append(text)
        offset = stream.tell()
    atoms = items.get("NUMBER OF ATOMS", [""])[0:1]
    if not atoms or not re.fullmatch(r"\d{1,18}", atoms[0]) or int(atoms[0]) == 0:
        raise ValueError(f'{named}: expected a number > 0 below "ITEM: NUMBER OF ATOMS"; got {"".join(atoms)!r:.40}')
    box = next((key for key in items if key.startswith("BOX BOUNDS")), None)
    bounds = [[float(w) for w in row.split() if is_number(w)] for row in items[box]] if box else []
    if box is None or len(bounds) != 3 or len({len(row) for row in bounds}) > 1 or len(bounds[0]) not in (2, 3):
        raise ValueError(
            f'{named}: expected three lines of 2 or 3 numbers below "ITEM: BOX BOUNDS"; general boxes are not read'
        )
    return Place(path, offset, line + 1, int(atoms[0])), text[11:].split(), box[10:].split(), bounds


def _frame(path: Path, offsets: list[int], number: int) -> Frame:
    place, names, box, bounds = _head(path, offsets, number)
    named = f"{path}, frame {number} of {len(offsets)}"
    if len(set(names)) < len(names):
        raise ValueError(f"{named}: the names of the columns must differ; got {' '.join(names):.100}")
    with open(path, "rb") as stream:
        stream.seek(place.offset)
        cells = stream.readline(100_000).decode("latin-1").split()
    kept = [k for k in range(len(names)) if k >= len(cells) or is_number(cells[k])]
    left = [name for k, name in enumerate(names) if k not in kept]
    notes = [f"Columns that hold words are left out: {', '.join(left)}."] if left else []
    try:
        table = read_table(place, names, kept)
    except ValueError:
        earlier = f"; earlier frames can be read with step= up to {number - 1}" if number else ""
        try:
            read_table(place._replace(line=place.line + _lines_before(path, offsets[number])), names, kept)
        except ValueError as error:
            raise ValueError(f"{named} is incomplete or damaged: {error}{earlier}") from None
        raise
    columns = {names[k]: column for k, column in zip(kept, table.T, strict=True)}
    order, ids = np.arange(len(table)), None
    key = next((name for name in columns if plain(name) in ID), None)
    if key is not None:
        ids = columns.pop(key)
        order = np.argsort(ids, kind="stable")
        if not are_whole(ids) or (np.diff(ids[order]) == 0).any():
            raise ValueError(f"{named}: the ids must be whole numbers that differ")
        ids = ids[order].astype(np.int64)
    columns = {name: values[order] for name, values in columns.items()}
    edges, corner, periodic = _box(box, bounds)
    group = next((group for group in COORDINATES if group[0] in columns), None)
    if group is None:
        raise ValueError(
            f"{named}: expected columns x y z, xu yu zu, xs ys zs or xsu ysu zsu; got {' '.join(names):.100}"
        )
    have = [name for name in group if name in columns]
    dim = len(have)
    positions = np.stack([columns[name] for name in have], axis=1)
    edges, corner, periodic = edges[:dim, :dim], corner[:dim], periodic[:dim]
    if "s" in group[0]:
        positions = corner + positions @ edges
    unwrapped = "u" in group[0]
    if not unwrapped and all(name in columns for name in IMAGES[:dim]):
        positions = positions + np.stack([columns[name] for name in IMAGES[:dim]], axis=1) @ edges
        unwrapped = True
    for name in {*IMAGES, *(name for group in COORDINATES for name in group)}:
        columns.pop(name, None)

    def where(row: int) -> str:
        return f"frame {number}, line {line_of(place, int(order[row])) + _lines_before(path, offsets[number])}"

    return Frame(ids, positions, unwrapped, edges, periodic, columns, where, tuple(notes))


def _lines_before(path: Path, offset: int) -> int:
    """The number of lines before a byte of a file."""
    count = 0
    with open(path, "rb") as stream:
        while offset > 0 and (block := stream.read(min(offset, 2**20))):
            count, offset = count + block.count(b"\n"), offset - len(block)
    return count


def _box(words: list[str], bounds: list[list[float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The edges of the box as rows, its corner, and which axes are periodic."""
    low, high = np.array([row[0] for row in bounds]), np.array([row[1] for row in bounds])
    xy, xz, yz = [row[2] for row in bounds] if len(bounds[0]) == 3 else (0.0, 0.0, 0.0)
    low = low - [min(0, xy, xz, xy + xz), min(0, yz), 0]  # the bounds of a tilted box enclose it
    high = high - [max(0, xy, xz, xy + xz), max(0, yz), 0]
    lx, ly, lz = high - low
    periodic = [word == "pp" for word in words if re.fullmatch(r"[pfsm]{2}", word)]
    periodic = periodic if len(periodic) == 3 else [False] * 3
    return np.array([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]]), low, np.array(periodic)


def _moves(first: Frame, frame: Frame) -> np.ndarray:
    """Displacements (points, dim) of a frame from the first, the shortest ones in a periodic box."""
    move = frame.positions - first.positions
    if frame.periodic.any() and not (frame.unwrapped and first.unwrapped) and np.linalg.det(frame.edges):
        turns = np.linalg.solve(frame.edges.T, move.T).T
        move -= np.where(frame.periodic, np.round(turns), 0.0) @ frame.edges
    return move


def _state(path: Path, number: int, first: Frame, frame: Frame, times: list[float], are_steps: bool) -> Contents:
    """The contents of a frame, with displacements from the first one."""
    same = len(first.positions) == len(frame.positions) and first.positions.shape == frame.positions.shape
    if not same or not np.array_equal(
        np.zeros(0) if first.ids is None else first.ids, np.zeros(0) if frame.ids is None else frame.ids
    ):
        raise ValueError(
            f"{path}: frame {number} has {len(frame.positions)} atoms and frame 0 has {len(first.positions)}, or they"
            " have other ids or coordinates; expected the same atoms in all frames; dump all atoms of the body"
        )
    notes = list(frame.notes)
    if len(times) > 1 or are_steps:
        kind = "numbers of steps" if are_steps else "times of the run"
        notes.append(
            f"The states have {kind} as times. The reference positions are those of the first, at {times[0]:g}."
        )
    if first.ids is None:
        notes.append("There is no column id, so the order of the points is taken as the same in all frames.")
    bad = np.flatnonzero(~np.isfinite(first.positions).all(axis=1))
    if bad.size:
        raise ValueError(
            f"{path}, {first.where(int(bad[0]))}: expected finite coordinates; got {first.positions[bad[0]].tolist()}"
        )
    with np.errstate(invalid="ignore", over="ignore"):  # a run that failed leaves numbers that are not finite
        move = _moves(first, frame)
    if frame.periodic.any() and not (frame.unwrapped and first.unwrapped):
        notes.append("Displacements across the periodic box are taken as less than half of its length.")
    columns = dict(frame.columns)
    sets: dict[str, np.ndarray] = {}
    if "type" in columns and are_whole(columns["type"]) and len(np.unique(columns["type"])) <= MOST_BLOCKS:
        sets = parts("type", columns.pop("type"))
    volume = next((name for name in columns if plain(name) in VOLUME), None)
    volumes = None if volume is None else columns.pop(volume)
    joined = combined(columns)
    fields = {RENAMED.get(name, name) if x.ndim > 1 else name: x for name, x in joined.items()}
    if frame.ids is not None:
        fields["id"] = frame.ids
    fields["displacement"] = move
    return Contents(first.positions, volumes, fields, sets, frame.where, tuple(notes))
