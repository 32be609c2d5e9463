"""Bodies and results for other programs: VTK files that ParaView opens.

Every point is a vertex. One state is one file, NAME.vtu. A motion and a path of equilibria are one file for each state,
whole or not there, and NAME.vtu.series lists them. Vectors get three components and tensors nine (row by row), for VTK
knows no others. Written by meshio, an optional extra: `pip install meshio`.
"""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

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
    """Fields name → (states, points, …), and the time of every state; None: one state, its fields without that axis."""

    fields: dict[str, np.ndarray]
    times: np.ndarray | None


def _positions(body: Body) -> np.ndarray:
    if isinstance(body, Families):
        if body.positions is None:
            raise ValueError("these families know no positions; give the points or the scene instead")
        return np.asarray(body.positions, float)
    return body.positions if isinstance(body, Points) else body.body.positions


def _own_fields(body: Body) -> dict[str, np.ndarray]:
    """What a body, families or a scene has at its points: the same in every state."""
    if isinstance(body, Points):
        return {"volume": body.volumes}
    families = body.families if isinstance(body, Scene) else body
    fields = {"volume": np.asarray(families.volumes), "neighbours": np.asarray(families.count)}
    if isinstance(body, Scene):
        held = ~body.free
        fields |= {"held": held.astype(np.uint8), "prescribed": on_host(body.prescribed), "load": on_host(body.load)}
    return fields


def _states(result: Any) -> _States:
    if result is None:
        return _States({}, None)
    if isinstance(result, Equilibrium):
        return _States({"displacement": np.asarray(result.u)}, None)
    if isinstance(result, EquilibriumPath):
        count = len(result.load_factors)
        return _States({"displacement": np.asarray(result.u)}, np.arange(count, dtype=float))
    if isinstance(result, History):
        if len(result.u) != len(result.times):
            raise ValueError("this history kept no fields but the last: run it with fields=True")
        return _States(
            {"displacement": np.asarray(result.u), "velocity": np.asarray(result.v)}, np.asarray(result.times)
        )
    raise ValueError(
        "result must be what pdjax.simulate, solve or equilibrium_path returned, or None for fields of your own; got"
        f" {type(result).__name__}"
    )


@public_function
def write_vtk(
    body: Body,
    result: Result | str | os.PathLike | None = None,
    path: str | os.PathLike | None = None,
    fields: dict | None = None,
) -> Path:
    """Write a body and what was found of it for ParaView.

    Arguments: body a scene, points, or families: their volumes, counts of neighbours, supports and loads are written
        too; result a `History`, `Equilibrium` or `EquilibriumPath` of it, or None; path NAME, without ending; fields:
        name → more arrays on the points, (points, …), for a history or path (states, points, …), e.g. a stress.
    Returns: the path of NAME.vtu, for a history or path of NAME.vtu.series: open that. Its files are named
        NAME-0000.vtu and so on; a path's "time" is the number of its state.
    Raises: ImportError without meshio; ValueError for fields of another shape, a history without fields, a result
        that is none; OSError where nothing can be written.
    Example: `write_vtk(scene, pd.solve(scene), "plate", {"stress": stress})`; `write_vtk(points, path="cloud")`.
    """
    try:
        import meshio
    except ImportError as error:
        raise ImportError("writing VTK needs meshio: pip install meshio") from error
    if isinstance(result, str | os.PathLike) and path is None:
        result, path = None, result
    if not isinstance(body, Body):
        raise ValueError(f"body must be a scene, points or families; got {type(body).__name__}")
    if path is None:
        raise ValueError('path must name the files, without ending: write_vtk(scene, result, "plate")')
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
    """Vectors padded to three components, tensors to 3 × 3 and written row by row; scalars as they are."""
    values = values.astype(np.uint8) if values.dtype == bool else values
    lacking = [(0, 0)] + [(0, 3 - n) if n < 3 else (0, 0) for n in values.shape[1:]]
    if values.ndim in (2, 3) and all(n <= 3 for n in values.shape[1:]):
        values = np.pad(values, lacking)
    return values.reshape(len(values), -1) if values.ndim > 2 else values
