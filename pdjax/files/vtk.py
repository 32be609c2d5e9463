"""VTK files of bodies and results, for ParaView and other programs.

Every point of the body is a vertex. A single state becomes one file, NAME.vtu. A motion or an equilibrium path becomes
one file a state, and NAME.vtu.series lists these files. An interrupted run leaves no incomplete file. Vectors are
padded to three components and tensors to nine (row by row), because VTK has no smaller ones. The optional package
meshio writes the files: `pip install meshio`.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._internal.checks import moved_whole, on_host, writable, written_whole
from .._internal.public import public_function
from ..finite_body.dynamics.history import History
from ..finite_body.scene import Scene
from ..finite_body.statics.arc_length import EquilibriumPath
from ..finite_body.statics.result import Equilibrium
from ..geometry.bonds import Families
from ..geometry.points import Points

Body = Scene | Points | Families
Result = History | Equilibrium | EquilibriumPath


class _States(NamedTuple):
    """Fields by name, (states, points, …), and the time of every state.

    If `times` is None there is a single state, and the fields have the shape (points, …).
    """

    fields: dict[str, np.ndarray]
    times: np.ndarray | None


def _positions(body: Body) -> np.ndarray:
    if isinstance(body, Families):
        if body.positions is None:
            raise ValueError("these families hold no positions of the points: pass the points or the scene instead")
        return np.asarray(body.positions, float)
    return body.positions if isinstance(body, Points) else body.body.positions


def _own_fields(body: Body) -> dict[str, np.ndarray]:
    """Fields that are the same in every state: volumes, and for a scene its supports and loads."""
    if isinstance(body, Points):
        return {"volume": body.volumes}
    families = body.families if isinstance(body, Scene) else body
    fields = {"volume": np.asarray(families.volumes), "neighbours": np.asarray(families.count)}
    if isinstance(body, Scene):
        held = ~body.free
        fields |= {"held": held.astype(np.uint8), "prescribed": on_host(body.prescribed), "load": on_host(body.load)}
    return fields


def _states(result: object) -> _States:
    if result is None:
        return _States({}, None)
    if isinstance(result, Equilibrium):
        return _States({"displacement": np.asarray(result.u)}, None)
    if isinstance(result, EquilibriumPath):
        count = len(result.load_factors)
        return _States({"displacement": np.asarray(result.u)}, np.arange(count, dtype=float))
    if isinstance(result, History):
        if len(result.u) != len(result.times):
            raise ValueError("this history kept no fields except the last: run simulate with fields=True")
        return _States(
            {"displacement": np.asarray(result.u), "velocity": np.asarray(result.v)}, np.asarray(result.times)
        )
    raise ValueError(
        "result must be a result of pdjax.simulate, solve or equilibrium_path, or None; got"
        f" {type(result).__name__}: pass other arrays as fields={{name: array}}"
    )


@public_function
def write_vtk(
    body: Body,
    result: Result | str | os.PathLike | None = None,
    path: str | os.PathLike | None = None,
    fields: dict | None = None,
) -> Path:
    """Write a body, its result and more fields to VTK files for ParaView.

    Parameters
    ----------
    body : Scene, Points or Families
        The body. Its volumes, numbers of neighbours, supports and loads are written as fields, where it has them.
    result : History, Equilibrium or EquilibriumPath, optional
        A result of `simulate`, `solve` or `equilibrium_path` for this body.
    path : str or path
        File name NAME without extension.
    fields : dict, optional
        More arrays by name, for example a stress. Each has the shape (points, …), or (states, points, …) for a
        history or an equilibrium path.

    Returns
    -------
    pathlib.Path
        The file to open: NAME.vtu, or NAME.vtu.series for a history or an equilibrium path.

    Raises
    ------
    ImportError
        If meshio is not installed.
    ValueError
        If a field has another shape, the history holds no fields, or `body` or `result` has another type.
    OSError
        If the files cannot be written.

    Notes
    -----
    The files of a series are NAME-0000.vtu, NAME-0001.vtu, and so on. The time of a state of an equilibrium path is the
    number of the state. If there is no result, the second argument may be the path.

    Examples
    --------
    >>> import tempfile
    >>> body = pd.lattice((5, 4))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pd.export.write_vtk(body, path=f"{folder}/plate", fields={"height": body.positions[:, 1]}).name
    'plate.vtu'
    """
    try:
        import meshio
    except ImportError as error:
        raise ImportError("writing VTK needs meshio: pip install meshio") from error
    if isinstance(result, str | os.PathLike) and path is None:
        result, path = None, result
    if not isinstance(body, Body):
        raise ValueError(f"body must be a Scene, Points or Families; got {type(body).__name__}")
    if path is None:
        raise ValueError('path must name the files, without extension; got none: write_vtk(scene, result, "plate")')
    states, own = _states(result), _own_fields(body)
    where = _positions(body)
    series = states.times is not None
    shape = (len(states.times), len(where)) if states.times is not None else (len(where),)
    columns = states.fields | {name: np.asarray(values) for name, values in ({} if fields is None else fields).items()}
    for name, values in columns.items():
        if values.shape[: len(shape)] != shape:
            axes = "states, points" if series else "points"
            raise ValueError(f"field {name} must have shape ({axes}, …) = {(*shape, '…')}; got {values.shape}")
    path = Path(path)
    path = path.with_name(path.name.removesuffix(".series").removesuffix(".vtu"))
    cells, positions = [("vertex", np.arange(len(where))[:, None])], _three(where)

    def write(file: Path, now: dict[str, np.ndarray]) -> None:
        data = {name: _three(values) for name, values in (own | now).items()}
        part = file.with_name(file.name + ".part.vtu")
        with moved_whole(file, part):
            meshio.write(part, meshio.Mesh(positions, cells, point_data=data))

    if states.times is None:
        file = writable(path.with_name(path.name + ".vtu"))
        write(file, columns)
        return file
    listing, entries = writable(path.with_name(path.name + ".vtu.series")), []
    for state, time in enumerate(states.times):
        file = path.with_name(f"{path.name}-{state:04d}.vtu")
        write(file, {name: values[state] for name, values in columns.items()})
        entries.append({"name": file.name, "time": float(time)})
    with written_whole(listing) as stream:
        stream.write(json.dumps({"file-series-version": "1.0", "files": entries}, indent=1).encode())
    return listing


def _three(values: np.ndarray) -> np.ndarray:
    """Vectors padded to three components, tensors padded to 3 × 3 and flattened row by row; scalars unchanged."""
    values = values.astype(np.uint8) if values.dtype == bool else values
    lacking = [(0, 0)] + [(0, 3 - n) if n < 3 else (0, 0) for n in values.shape[1:]]
    if values.ndim in (2, 3) and all(n <= 3 for n in values.shape[1:]):
        values = np.pad(values, lacking)
    return values.reshape(len(values), -1) if values.ndim > 2 else values
