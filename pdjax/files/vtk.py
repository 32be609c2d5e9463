"""VTK files of bodies and results, for ParaView and other programs.

Every point of the body is a vertex. A single state becomes one file, NAME.vtu. A motion or an equilibrium path becomes
one file a state, and a list of these files: NAME.vtu.series, or NAME.pvd if the path ends so. Vectors are padded to
three components and tensors to nine (row by row), because VTK has no smaller ones. VTK has no sets, so a set NAME is a
field "set:NAME" of zeros and ones. `read_points` reads all of this again, with the same bits.

An interrupted run leaves no incomplete file, and no list: the list is written last.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from .._internal.checks import finite, native, on_host, writable, written_whole
from .._internal.public import public_function
from ..finite_body.dynamics.history import History
from ..finite_body.scene import Scene
from ..finite_body.statics.arc_length import EquilibriumPath
from ..finite_body.statics.result import Equilibrium
from ..geometry.bonds import Families
from ..geometry.points import Points
from .formats.meshes import SET
from .formats.vtu_write import write as write_vtu

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
    sets: dict | None = None,
    times=None,
) -> Path:
    """Write a body, its result, more fields and sets to VTK files for ParaView and other programs.

    Parameters
    ----------
    body : Scene, Points or Families
        The body. Its volumes, numbers of neighbours, supports and loads are written as fields, where it has them.
    result : History, Equilibrium or EquilibriumPath, optional
        A result of `simulate`, `solve` or `equilibrium_path` for this body.
    path : str or path
        File name NAME without extension, or NAME.pvd.
    fields : dict, optional
        More arrays by name, for example a stress. Each has the shape (points, …), or (states, points, …) for a
        history or an equilibrium path.
    sets : dict, optional
        Masks by name: arrays of bool of shape (points,). The set NAME is written as the field "set:NAME".
    times : array, shape (states,), optional
        Times of several states without a result. Every array of `fields` then has the shape (states, points, …).

    Returns
    -------
    pathlib.Path
        The file to open: NAME.vtu, or NAME.vtu.series for a history or an equilibrium path. If the path ends in .pvd
        it is always NAME.pvd.

    Raises
    ------
    ValueError
        If a field has another shape or does not hold real numbers, the history holds no fields, or `body` or `result`
        has another type.
    OSError
        If the files cannot be written.

    Notes
    -----
    The files of a list are NAME-0000.vtu, NAME-0001.vtu, and so on. The time of a state of an equilibrium path is the
    number of the state. If there is no result, the second argument may be the path.

    ParaView opens both kinds of lists. NAME.vtu.series needs ParaView 5.5 or later; older versions and many other
    programs know NAME.pvd.

    Examples
    --------
    >>> import tempfile
    >>> body = pd.lattice((5, 4))
    >>> x, y = body.positions.T
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pd.export.write_vtk(body, path=f"{folder}/plate", fields={"height": y}, sets={"left": x < 1}).name
    'plate.vtu'
    """
    if isinstance(result, str | os.PathLike) and path is None:
        result, path = None, result
    if not isinstance(body, Body):
        raise ValueError(f"body must be a Scene, Points or Families; got {type(body).__name__}")
    if path is None:
        raise ValueError('path must name the files, without extension; got none: write_vtk(scene, result, "plate")')
    states, where = _states(result), _positions(body)
    if times is not None:
        if result is not None:
            raise ValueError(f"times is for fields without a result; this {type(result).__name__} has its own times")
        states = _States({}, finite("times", times).reshape(-1))
    own = {name: _real(name, values) for name, values in _own_fields(body).items()} | _masks(sets, len(where))
    series = states.times is not None
    shape = (len(states.times), len(where)) if states.times is not None else (len(where),)
    columns = {name: _real(name, values) for name, values in (states.fields | (fields or {})).items()}
    for name, values in columns.items():
        if values.shape[: len(shape)] != shape or 0 in values.shape:
            axes = "states, points" if series else "points"
            raise ValueError(f"field {name} must have shape ({axes}, …) = {(*shape, '…')}; got {values.shape}")
    path = Path(path)
    listing = path.suffix == ".pvd"
    path = path.with_name(path.name.removesuffix(".pvd").removesuffix(".series").removesuffix(".vtu"))

    def write(file: Path, now: dict[str, np.ndarray]) -> None:
        with written_whole(file) as stream:
            write_vtu(stream, _three(where), {name: _three(values) for name, values in (own | now).items()})

    if states.times is None and not listing:
        file = writable(path.with_name(path.name + ".vtu"))
        write(file, columns)
        return file
    times = [0.0] if states.times is None else [float(time) for time in states.times]
    listed = writable(path.with_name(path.name + (".pvd" if listing else ".vtu.series")))
    listed.unlink(missing_ok=True)  # an earlier list would mix the states of two runs, if this one is interrupted
    names = [f"{path.name}-{state:04d}.vtu" for state in range(len(times))]
    for state, name in enumerate(names):
        now = {name: values[state] if series else values for name, values in columns.items()}
        write(path.with_name(name), now)
    with written_whole(listed) as stream:
        stream.write((_pvd if listing else _series)(names, times).encode())
    return listed


def _series(names: list[str], times: list[float]) -> str:
    """The list of files that ParaView knows as NAME.vtu.series."""
    entries = [{"name": name, "time": time} for name, time in zip(names, times, strict=True)]
    return json.dumps({"file-series-version": "1.0", "files": entries}, indent=1)


def _pvd(names: list[str], times: list[float]) -> str:
    """The list of files that ParaView and others know as NAME.pvd."""
    entries = (
        f'<DataSet timestep="{time!r}" group="" part="0" file={quoteattr(name)}/>\n'
        for name, time in zip(names, times, strict=True)
    )
    start = '<?xml version="1.0" encoding="UTF-8"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n'
    return start + "".join(entries) + "</Collection>\n</VTKFile>\n"


def _real(name: object, values: object) -> np.ndarray:
    """A field as an array of a type that VTK has. Booleans become 0 and 1, half precision becomes single."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise ValueError(f"names of fields must be printable words; got {name!r}")
    array = native(f"field {name}", values)
    if array.dtype.kind == "c":
        raise ValueError(f"field {name} must hold real numbers; got {array.dtype}. Write .real and .imag as two fields")
    if array.dtype == bool:
        return array.astype(np.uint8)
    if array.dtype.kind not in "iu" and array.dtype not in (np.float32, np.float64):
        return array.astype(np.float32 if array.dtype.itemsize < 4 else np.float64)
    return array


def _masks(sets: dict | None, points: int) -> dict[str, np.ndarray]:
    """Sets as fields of zeros and ones."""
    masks = {}
    for name, mask in (sets or {}).items():
        array = np.asarray(mask)
        if array.dtype != bool or array.shape != (points,):
            raise ValueError(f"set {name} must be a mask, bool of shape ({points},); got {array.dtype} {array.shape}")
        masks[SET + name] = _real(f"{SET}{name}", array)
    return masks


def _three(values: np.ndarray) -> np.ndarray:
    """Vectors padded to three components, tensors padded to 3 × 3 and flattened row by row; scalars unchanged."""
    lacking = [(0, 0)] + [(0, 3 - n) if n < 3 else (0, 0) for n in values.shape[1:]]
    if values.ndim in (2, 3) and all(n <= 3 for n in values.shape[1:]):
        values = np.pad(values, lacking)
    return values.reshape(len(values), -1) if values.ndim > 2 else values
