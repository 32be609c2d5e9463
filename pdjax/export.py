"""A motion for other programs: VTK files that ParaView opens as one time series.

Each save becomes a `.vtu` of its own (a vertex for every point, with displacement, velocity and what else is asked),
whole or not there; `NAME.vtu.series` lists them with their times. Written by meshio, an optional extra:
`pip install meshio`.
"""

import json
import os
from pathlib import Path

import numpy as np

from ._checks import moved_whole, writable, written_whole
from .dynamics.history import History
from .problem import Scene


def write_vtk(scene: Scene, history: History, path: str | os.PathLike, fields: dict | None = None) -> Path:
    """Write the fields of a history for ParaView.

    Arguments: scene the motion's; history with its fields kept; path NAME of the series, without ending; fields: name →
        (saves, points, …) more arrays on the points, e.g. a stress. Vectors are padded to three components.
    Returns: the path of NAME.vtu.series: open that. Files are named NAME-0000.vtu and so on.
    Raises: ImportError without meshio; ValueError for a history without fields, or fields of another shape.
    """
    try:
        import meshio
    except ImportError as error:
        raise ImportError("writing VTK needs meshio: pip install meshio") from error
    saves, points = len(history.times), len(scene.body)
    if len(history.u) != saves:
        raise ValueError("this history kept no fields but the last: run it with fields=True")
    columns = {"displacement": history.u, "velocity": history.v, **({} if fields is None else fields)}
    columns = {name: np.asarray(values) for name, values in columns.items()}
    for name, values in columns.items():
        if values.shape[:2] != (saves, points):
            raise ValueError(
                f"field {name} must have shape (saves, points, …) = ({saves}, {points}, …); got {values.shape}"
            )
    path = Path(path)
    series = writable(path.with_name(path.name + ".vtu.series"))
    cells = [("vertex", np.arange(points)[:, None])]
    where = _three(scene.body.positions)
    entries = []
    for save in range(saves):
        file = path.with_name(f"{path.name}-{save:04d}.vtu")
        data = {name: _three(values[save]) for name, values in columns.items()}
        part = file.with_name(file.name + ".part.vtu")
        with moved_whole(file, part):
            meshio.write(part, meshio.Mesh(where, cells, point_data=data))
        entries.append({"name": file.name, "time": float(history.times[save])})
    with written_whole(series) as stream:
        stream.write(json.dumps({"file-series-version": "1.0", "files": entries}, indent=1).encode())
    return series


def _three(values: np.ndarray) -> np.ndarray:
    """Vectors of fewer than three components padded to three, for VTK knows no others; tensors as rows."""
    if values.ndim == 2 and values.shape[1] < 3:
        return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
    return values.reshape(len(values), -1) if values.ndim > 2 else values
