"""Points, fields and sets from files: `read_points`. `READERS` lists the formats; a new one is one module and one line.

A file is untrusted. Readers run no code from it: no pickles, no XML entities. They check announced sizes against the
length of the file before they allocate memory.
"""

import contextlib
import importlib
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from .._internal.checks import native
from .._internal.public import public_function
from ..geometry.points import Points
from .bodies import body_from
from .contents import Contents, States
from .point_data import PointData, state_number

# Module of `pdjax.files.formats` that reads each suffix.
READERS = {
    ".txt": "text",
    ".csv": "text",
    ".dat": "text",
    ".npz": "arrays",
    ".data": "lammps_data",
    ".lmp": "lammps_data",
    ".dump": "lammps_dump",
    ".lammpstrj": "lammps_dump",
    ".vtu": "vtu",
    ".vtk": "legacy_vtk",
    ".msh": "gmsh",
    ".inp": "abaqus",
    ".exo": "exodus",
    ".e": "exodus",
    ".ex2": "exodus",
    ".pvd": "series",
    ".series": "series",
    ".pvtu": "series",
}


def reader(path: Path) -> ModuleType:
    """The module that reads files of this suffix. Raises ValueError that lists the suffixes if there is none."""
    name = READERS.get(path.suffix.lower())
    if name is None:
        known = ", ".join(sorted(READERS))
        raise ValueError(f"{path.name} has a suffix that no reader knows; expected one of {known}; got {path.suffix!r}")
    return importlib.import_module(f".formats.{name}", __package__)


def opened(path: Path) -> States:
    """The states of a file, by the reader of its suffix."""
    return reader(path).states(path)


def readable(path: str | os.PathLike) -> Path:
    """`path`, if it is a file that can be opened and is not empty. Otherwise OSError or ValueError is raised."""
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"cannot read {path}: it is a directory; name a file in it")
    if not path.exists():
        raise FileNotFoundError(f"cannot read {path}: there is no such file")
    if not path.is_file():
        raise OSError(f"cannot read {path}: it is no regular file")
    try:
        with open(path, "rb"):
            pass
    except OSError as error:
        raise PermissionError(f"cannot read {path}: {error.strerror or error}") from error
    if path.stat().st_size == 0:
        raise ValueError(f"cannot read {path}: the file is empty")
    return path


@contextlib.contextmanager
def _damaged(path: Path) -> Iterator[None]:
    """Raise ValueError for errors of decoding, such as KeyError, that a damaged file causes in a library."""
    try:
        yield
    except (ValueError, OSError, ImportError):
        raise
    except Exception as error:
        raise ValueError(f"{path} is damaged or of another format: {type(error).__name__}: {error}") from error


def _loaded(path: Path, states: States, step: int) -> Contents:
    """One state of a file with fields and sets of the right length, in the byte order of the machine."""
    with _damaged(path):
        contents = states.at(step)
    points = len(contents.positions)
    fields = {name: native(f"field {name}", values) for name, values in contents.fields.items()}
    for kind, arrays in (("field", fields), ("set", contents.sets)):
        for name, values in arrays.items():
            if len(values) != points:
                raise ValueError(
                    f"{path}: {kind} {name} must have one row for each of the {points} points; got {len(values)} rows"
                )
    return replace(contents, fields=fields)


@public_function
def read_points(
    path: str | os.PathLike,
    *,
    volume=None,
    outline=None,
    spacing: float | None = None,
    dim: int | None = None,
    step: int = -1,
) -> tuple[Points, PointData]:
    """Read a body, and the fields and sets of its points, from a file.

    Parameters
    ----------
    path : str or path
        The file. Its suffix tells the format: text and CSV (.txt, .csv, .dat), NumPy archives (.npz), LAMMPS data files
        (.data, .lmp) and text dumps (.dump, .lammpstrj), and meshes and results (.vtu, .vtk, .msh, .inp, .exo, .e,
        .ex2, .pvd, .pvtu, .series).
    volume : float, array of shape (points,), "voronoi" or "lattice", optional
        Volumes [length^dim]. By default they come from the file. "voronoi" takes the Voronoi cells of the points within
        `outline`. "lattice" takes spacing^dim, if the points are those of a uniform lattice.
    outline : array, optional
        Outline of the body [length] for Voronoi cells: the two ends in 1D, the vertices of a polygon in order in 2D,
        the vertices of a convex hull in 3D; shape (2,) or (vertices, dim).
    spacing : float, optional
        Spacing [length] of the lattice, by default found from the positions.
    dim : int, optional
        Dimension of the body, by default that of the cells of a mesh. In other files a coordinate that is the same for
        all points is left out.
    step : int, optional
        State to read from a file with several, from 0. The default, −1, is the last one.

    Returns
    -------
    points : Points
        The reference positions and the volumes, in the order of the file.
    data : PointData
        Fields and sets of the points, times of the states, and notes on what was assumed.

    Raises
    ------
    OSError
        If there is no such file or it can't be opened.
    ValueError
        If the suffix is unknown, the file is damaged, a number is not finite, points coincide, a volume is not positive
        or missing, or an argument does not fit the file.
    ImportError
        If the format needs a package that is not installed.

    Notes
    -----
    If the points are those of a uniform lattice, up to the rounding of their digits, and all volumes are spacing^dim,
    then the body is a lattice, for which forces are fastest. `data.notes` says so.

    Text: a line for each point, with the columns x volume, x y volume, x y z volume, or x y z block volume. Other
    columns need names, in a first line such as "# x y z volume temperature". Columns ux, uy, uz or u_x, u_y, u_z
    become the vector field u. The modules of `pdjax.files.formats` describe the formats.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "bar.txt"
    ...     _ = file.write_text("# x volume heat\\n0.5 1.0 20.0\\n1.5 1.0 21.0\\n2.5 1.0 19.0\\n")
    ...     body, data = pd.read_points(file)
    >>> body
    Points(3 points, 1D, spacing 1)
    >>> data
    PointData of bar.txt
      fields: heat
      sets: none
      The points are a uniform lattice of 3 cells with spacing 1.
    """
    file = readable(path)
    with _damaged(file):
        states = opened(file)
    step = state_number(file, states.times, step)
    contents = _loaded(file, states, step)
    points, axes, notes = body_from(file, contents, volume, outline, spacing, contents.dim if dim is None else dim)

    def load(number: int) -> Contents:
        other = _loaded(file, states, number)
        if len(other.positions) != len(points):
            raise ValueError(
                f"{file}: state {number} has {len(other.positions)} points, but state {step} has {len(points)}; read"
                " them one by one with step="
            )
        return other

    time = states.times[step] if states.times else None
    return points, PointData(contents.fields, contents.sets, time, states.times, step, notes, file, axes, load)
