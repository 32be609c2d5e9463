"""Data files of LAMMPS: the points of a run before it starts, for atom style peri and others.

The first line is a title. A header announces the number of atoms and the box, then sections follow. A line of the
section Atoms of style peri is "id type volume density x y z", perhaps with three image flags, which count how many
times the point has crossed the box. The style stands behind the name of the section: "Atoms # peri". Without it, 5
columns are style atomic and 7 are style peri. Other styles have no volumes. Points keep the order of the file;
velocities are matched by id.

References
----------
LAMMPS documentation, commands read_data and atom_style. M. L. Parks et al., Implementing peridynamics within a
molecular dynamics code, Computer Physics Communications 179 (2008) 777-783.
"""

import re
from pathlib import Path

import numpy as np

from ..contents import Contents, States
from .columns import MOST_BLOCKS, are_whole, parts
from .table import Place, header_line, line_of, read_table

STYLES = {
    "peri": "id type volume density x y z",
    "atomic": "id type x y z",
    "charge": "id type charge x y z",
    "sphere": "id type diameter density x y z",
    "bond": "id molecule type x y z",
    "angle": "id molecule type x y z",
    "molecular": "id molecule type x y z",
    "full": "id molecule type charge x y z",
}
UNNAMED = {5: "atomic", 8: "atomic", 7: "peri", 10: "peri"}  # by the number of columns
IMAGES = ["ix", "iy", "iz"]


def states(path: Path) -> States:
    """The single state of a data file."""
    return States((), lambda _: _contents(path))


def _sections(path: Path) -> tuple[list[str], dict[str, tuple[str, int, int]]]:
    """The lines of the header, and for every section its comment, the offset and the number of its first line."""
    header: list[str] = []
    sections: dict[str, tuple[str, int, int]] = {}
    with open(path, "rb") as stream:
        header_line(stream, path, 1)
        number, offset = 1, stream.tell()
        for raw in stream:
            number, offset = number + 1, offset + len(raw)
            if not sections and len(header) > 1000:
                raise ValueError(f"{path} has no section Atoms in its first {number} lines; it is no LAMMPS data file")
            if raw[:1].isalpha() and re.match(rb"[A-Z][A-Za-z ]*(#.*)?$", raw.strip()):
                name, _, comment = raw.decode("latin-1").partition("#")
                sections[name.strip()] = (comment.strip(), offset, number + 1)
            elif not sections and raw.strip():
                header.append(raw[:1000].decode("latin-1").partition("#")[0].strip())
    return header, sections


def _contents(path: Path) -> Contents:
    header, sections = _sections(path)
    atoms = [int(found[1]) for line in header if (found := re.match(r"(\d{1,18})\s+atoms$", line))]
    if not atoms or "Atoms" not in sections:
        raise ValueError(
            f'{path} is no LAMMPS data file: expected a line "N atoms" and a section Atoms; got the sections'
            f" {', '.join(sections) or 'none':.100}"
        )
    count, (style, offset, line) = atoms[0], sections["Atoms"]
    notes: list[str] = []
    first = _first_cells(path, offset)
    if not style:
        style = UNNAMED.get(len(first), "")
        if not style:
            raise ValueError(
                f"{path}, line {line}: expected 5 columns (style atomic) or 7 (style peri), or the style behind the"
                f' name of the section, such as "Atoms # peri"; got {len(first)} columns'
            )
        notes.append(f"The section Atoms has no style and is taken as style {style}: {STYLES[style]}.")
    if style not in STYLES:
        raise ValueError(f"{path}: the atom style must be one of {', '.join(STYLES)}; got {style!r:.40}")
    names = STYLES[style].split()
    images = len(first) == len(names) + 3
    place = Place(path, offset, line, count)
    table = read_table(place, names + IMAGES if images else names)
    columns = dict(zip(names + IMAGES if images else names, table.T, strict=True))

    def where(row: int) -> str:
        return f"line {line_of(place, row)}"

    positions = np.stack([columns.pop(x) for x in "xyz"], axis=1)
    if images:
        turns = np.stack([columns.pop(x) for x in IMAGES], axis=1)
        if turns.any():
            with np.errstate(invalid="ignore", over="ignore"):  # positions that are not finite are refused later
                positions = positions + turns @ _box(path, header)
            notes.append("Positions are moved out of the periodic box by their image flags.")
    ids = columns.pop("id")
    if not are_whole(ids) or len(np.unique(ids)) < len(ids):
        raise ValueError(f"{path}: the ids of the section Atoms must be whole numbers that differ")
    sets: dict[str, np.ndarray] = {}
    if are_whole(columns["type"]) and len(np.unique(columns["type"])) <= MOST_BLOCKS:
        sets = parts("type", columns.pop("type"))
    volumes = columns.pop("volume", None)
    fields = columns | {"id": ids.astype(np.int64)}
    if "Velocities" in sections:
        fields["velocity"] = _velocities(path, sections["Velocities"], ids)
    return Contents(positions, volumes, fields, sets, where, tuple(notes))


def _first_cells(path: Path, offset: int) -> list[str]:
    """The cells of the first line of a section."""
    with open(path, "rb") as stream:
        stream.seek(offset)
        for raw in stream:
            if cells := raw[:10_000].decode("latin-1").partition("#")[0].split():
                return cells
    raise ValueError(f"{path} ends after the line Atoms; expected a line for every atom; the file is incomplete")


def _box(path: Path, header: list[str]) -> np.ndarray:
    """The edges of the box as rows."""
    found: dict[str, list[float]] = {}
    for line in header:
        cells = line.split()
        key = " ".join(cell for cell in cells if re.match(r"[a-z]", cell))
        try:
            found[key] = [float(cell) for cell in cells if not re.match(r"[a-z]", cell)]
        except ValueError:
            continue
    lengths = [found.get(key, []) for key in ("xlo xhi", "ylo yhi", "zlo zhi")]
    tilt = found.get("xy xz yz", [0.0, 0.0, 0.0])
    if any(len(x) != 2 for x in lengths) or len(tilt) != 3:
        raise ValueError(f"{path} has image flags but no box: expected lines such as '0 1 xlo xhi' in its header")
    lx, ly, lz = (high - low for low, high in lengths)
    return np.array([[lx, 0, 0], [tilt[0], ly, 0], [tilt[1], tilt[2], lz]])


def _velocities(path: Path, section: tuple[str, int, int], ids: np.ndarray) -> np.ndarray:
    """Velocities (points, 3) in the order of the ids."""
    _, offset, line = section
    table = read_table(Place(path, offset, line, len(ids)), ["id", "vx", "vy", "vz"])
    there, here = np.argsort(table[:, 0], kind="stable"), np.argsort(ids, kind="stable")
    if not np.array_equal(table[there, 0], ids[here]):
        raise ValueError(f"{path}: the section Velocities has other ids than the section Atoms; they must be the same")
    out = np.empty((len(ids), 3))
    out[here] = table[there, 1:]
    return out
