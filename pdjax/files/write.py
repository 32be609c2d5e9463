"""Points, fields and sets to files that `read_points` reads again: `write_points`.

Numbers are written with the fewest digits that give the same double again. Components of a vector u become the columns
u_x, u_y, u_z, or u_1, u_2, … if there are more than three; those of a tensor F become F_11, F_12, … A set becomes a
column "set:NAME" of zeros and ones in text, and an array of bool in an archive.
"""

import os
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .._internal.checks import native, writable, written_whole
from .._internal.public import public_function
from ..geometry.points import Points, check_body

ROWS = 20_000  # lines that are formatted at once
DELIMITERS = {".csv": ",", ".txt": " ", ".dat": " "}


@public_function
def write_points(path: str | os.PathLike, points: Points, fields: dict | None = None, sets: dict | None = None) -> Path:
    """Write a body, and fields and sets of its points, to a text, CSV or .npz file.

    Parameters
    ----------
    path : str or path
        The file. Its suffix tells the format: .txt or .dat (white space), .csv (commas) or .npz.
    points : Points
        The body, without periodic axes.
    fields : dict of str to array, shape (points, …), optional
        Numbers by name. Text files hold scalars, vectors and square tensors.
    sets : dict of str to array of bool, shape (points,), optional
        Masks by name.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ValueError
        If the suffix is unknown, an array has the wrong shape or type, a name cannot be a column, or the body is
        periodic.
    OSError
        If the file cannot be written. An earlier file is then unchanged.

    Examples
    --------
    >>> import tempfile
    >>> body = pd.lattice((3, 2), spacing=0.5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pd.write_points(f"{folder}/plate.csv", body, sets={"left": body.positions[:, 0] < 0.5})
    ...     file.read_text().split()[:3]
    ['x,y,volume,set:left', '0.25,0.25,0.25,1', '0.25,0.75,0.25,1']
    """
    check_body("points", points)
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (*DELIMITERS, ".npz"):
        raise ValueError(f"path must end in .txt, .dat, .csv or .npz; got {path.name}")
    if points.period is not None:
        raise ValueError(
            "points must not be periodic, because these files hold no period; write"
            " pdjax.cloud(points.positions, points.volumes) and give the period again after reading"
        )
    count = len(points)
    numbers = {name: native(f"field {name}", x) for name, x in (fields or {}).items()}
    masks = {name: native(f"set {name}", x) for name, x in (sets or {}).items()}
    for name, x in numbers.items():
        if x.shape[:1] != (count,):
            raise ValueError(f"field {name} must have shape ({count}, …), one row for each point; got {x.shape}")
    for name, x in masks.items():
        if x.shape != (count,) or x.dtype != bool:
            raise ValueError(f"set {name} must be bool of shape ({count},); got {x.dtype} of shape {x.shape}")
    writable(path)
    if suffix == ".npz":
        _write_archive(path, points, numbers, masks)
        return path
    columns = {f"{'xyz'[k]}": x for k, x in enumerate(points.positions.T)} | {"volume": points.volumes}
    for name, x in numbers.items():
        for key, column in _components(name, x).items():
            _add(columns, key, column)
    for name, mask in masks.items():
        _add(columns, f"set:{name}", mask.astype(np.int8))
    with written_whole(path) as stream:
        _write_table(stream, columns, DELIMITERS[suffix])
    return path


def _add(columns: dict[str, np.ndarray], name: str, values: np.ndarray) -> None:
    if name.lower() in {key.lower() for key in columns}:
        raise ValueError(
            f"names of fields and sets must differ from each other and from x, y, z, volume; got {name} twice"
        )
    if not name.isprintable() or '"' in name or "#" in name or not name.strip():
        raise ValueError(f'names of fields and sets must be printable text without " or #; got {name!r}')
    columns[name] = values


def _components(name: str, x: np.ndarray) -> dict[str, np.ndarray]:
    """The columns of a field by name."""
    if x.dtype.kind == "c":
        raise ValueError(f"field {name} must be real in a text file; got {x.dtype}; write its real and imaginary parts")
    x = x.astype(np.int8) if x.dtype == bool else x
    if x.ndim == 1:
        return {name: x}
    if x.ndim == 2:
        ends = "xyz" if x.shape[1] <= 3 else [str(k + 1) for k in range(x.shape[1])]
        return {f"{name}_{end}": column for end, column in zip(ends, x.T, strict=False)}
    if x.ndim == 3 and x.shape[1] <= 9 and x.shape[2] <= 9:
        return {f"{name}_{i + 1}{j + 1}": x[:, i, j] for i in range(x.shape[1]) for j in range(x.shape[2])}
    raise ValueError(
        f"field {name} must hold a scalar, a vector or a tensor for each point of a text file; got shape {x.shape};"
        " write an .npz file"
    )


def _write_archive(path: Path, points: Points, fields: dict[str, np.ndarray], sets: dict[str, np.ndarray]) -> None:
    own = {"positions": points.positions, "volumes": points.volumes}
    names = [*own, *fields, *sets]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(
            f"fields and sets must have names that differ, other than positions and volumes; got {twice} twice"
        )
    for name in names:
        if not name.isprintable() or not name.strip() or "/" in name or "\\" in name:
            raise ValueError(f"names of fields and sets must be printable text without slashes; got {name!r}")
    with written_whole(path) as stream:
        import zipfile

        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, allowZip64=True) as archive:
            for name, values in (own | fields | sets).items():
                with archive.open(name + ".npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.ascontiguousarray(values), allow_pickle=False)


def _write_table(stream: BinaryIO, columns: dict[str, np.ndarray], delimiter: str) -> None:
    quoted = [f'"{name}"' if any(c in name for c in " ,;\t") else name for name in columns]
    stream.write((("# " if delimiter == " " else "") + delimiter.join(quoted) + "\n").encode())
    values = list(columns.values())
    for start in range(0, len(values[0]), ROWS):
        rows = zip(*(map(repr, x[start : start + ROWS].tolist()) for x in values), strict=True)
        stream.write(("\n".join(map(delimiter.join, rows)) + "\n").encode())
