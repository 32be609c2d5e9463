"""Text and CSV files, one line a point: the meshes of Peridigm and PeriLab, and tables with named columns.

Peridigm reads lines "x y z block volume" without names. PeriLab and most other programs name the columns in a first
line, such as "header: x y block_id volume" or "x,y,volume,temperature". A comment line above the numbers may name them
too: "# x y volume". Columns of other names are fields.

References
----------
Public files and scripts of the repositories peridigm/peridigm (examples/wave_in_bar) and PeriHub/PeriLab.jl.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..contents import Contents, States
from .columns import BLOCK, COORDINATES, VOLUME, body_of, plain
from .table import Place, delimiter_of, header_line, is_number, line_of, read_table, words

UNNAMED = {
    2: ["x", "volume"],
    3: ["x", "y", "volume"],
    4: ["x", "y", "z", "volume"],
    5: ["x", "y", "z", "block", "volume"],
}
NEEDED = {name for known in (*COORDINATES.values(), VOLUME, BLOCK) for name in known}  # columns that must be numbers
ADVICE = 'name the columns in a first line, such as "# x y z volume"'


def states(path: Path) -> States:
    """The single state of a text file."""
    return States((), lambda _: _contents(path))


def _names(line: str) -> list[str]:
    text = line.strip().lstrip("#%").strip()
    return words(text[7:] if text.lower().startswith("header:") else text)


def _head(path: Path) -> tuple[Place, list[str], list[str] | None]:
    """Where the numbers start, the cells of their first line, and the names of the columns if there are any."""
    named, comments = None, []
    with open(path, "rb") as stream:
        number = 0
        while True:
            number, offset = number + 1, stream.tell()
            line = header_line(stream, path, number)
            if not line:
                raise ValueError(f"{path} holds no numbers; expected a line of numbers for every point")
            text = line.strip()
            if not text:
                continue
            if text.startswith("#"):
                comments.append(_names(text))
                continue
            delimiter = delimiter_of(text)
            cells = [cell.strip() for cell in text.partition("#")[0].strip().split(delimiter)]
            if named is not None or any(is_number(cell) for cell in cells):
                break
            named = _names(text)
    place = Place(path, offset, number, None, delimiter)
    if named is not None and len(named) != len(cells):
        raise ValueError(
            f"{path}, line {number}: expected {len(named)} numbers ({', '.join(named):.200}); got {len(cells)} columns;"
            " every column needs a name"
        )
    x, others = COORDINATES["x"], (*COORDINATES["y"], *VOLUME)
    for names in reversed(comments if named is None else []):
        lower = [plain(name) for name in names]
        if len(names) == len(cells) and any(n in x for n in lower) and any(n in others for n in lower):
            return place, cells, names
    return place, cells, named


def _unnamed(place: Place, count: int) -> list[str]:
    """The meaning of columns without names, by their number. Raises ValueError if there is none."""
    if count not in UNNAMED:
        raise ValueError(
            f"{place.path}, line {place.line}: expected 2 columns (x volume), 3 (x y volume), 4 (x y z volume) or 5"
            f" (x y z block volume) where the columns have no names; got {count}; {ADVICE}"
        )
    return UNNAMED[count]


def _contents(path: Path) -> Contents:
    place, cells, named = _head(path)
    names, notes = _unnamed(place, len(cells)) if named is None else named, []
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{path} has two columns named {twice}; rename one of them")
    kept = list(range(len(names)))
    if named is None:
        instead = " If the last one is z, name the columns and pass volume=." if len(names) == 3 else ""
        notes.append(f"The columns have no names and are taken as {', '.join(names)}.{instead}")
    else:  # words, such as the name of a material
        kept = [k for k, cell in enumerate(cells) if is_number(cell) or plain(names[k]) in NEEDED]
        if len(kept) < len(names):
            left = ", ".join(names[k] for k in range(len(names)) if k not in kept)
            notes.append(f"Columns that hold words are left out: {left}.")
    if not kept:
        raise ValueError(f"{path}, line {place.line}: expected numbers; got {' '.join(cells)!r:.60}")
    values = read_table(place, names, kept)
    if named is None and len(names) == 4 and (values[:, 2] == np.round(values[:, 2])).all():
        raise ValueError(
            f"{path} has four columns without names, which may be x y block volume or x y z volume; {ADVICE}"
        )

    def where(row: int) -> str:
        return f"line {line_of(place, row)}"

    try:
        body = body_of({names[k]: column for k, column in zip(kept, values.T, strict=True)}, where, tuple(notes))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if named is None and len(names) < 5:
        return replace(body, uncertain=f"its last column has no name and may be a coordinate or a volume; {ADVICE}")
    return body
