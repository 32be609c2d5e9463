"""Lists of VTK files: NAME.pvd of ParaView and NAME.vtu.series for several times, NAME.pvtu for the parts of one time.

NAME.pvd is XML with an entry <DataSet timestep="0.5" part="0" file="NAME-0001.vtu"/> for every file. NAME.vtu.series is
JSON with {"name": "NAME-0001.vtu", "time": 0.5} for every file. NAME.pvtu is XML with an entry <Piece Source="…"/> for
every process of a parallel run. The files are VTU, legacy VTK or, in the other lists, PVTU.

Files of one time are its parts, and are joined. Cells that a process only copies from another (vtkGhostType) are left
out. Only files in the folder of the list, or below it, are opened: a list from elsewhere must not choose what is read.

Sources: ParaView, "ParaView Data (PVD) File Format" and "File series", https://www.paraview.org/Wiki/ParaView/Data_formats;
VTK, "VTK XML Formats", https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

import json
import math
from pathlib import Path, PurePosixPath, PureWindowsPath

from ..contents import Contents, States
from ..faults import fault, readable
from . import legacy_vtk, vtu
from .meshes import Mesh, contents
from .xml import parsed

SUFFIXES = (".vtu", ".vtk", ".pvtu")
LONGEST = 2**24  # bytes of a list, enough for 200 000 files


def states(path: Path) -> States:
    """The states that a list of files names. Each is loaded when it is asked for."""
    if path.stat().st_size > LONGEST:
        raise fault(path, f"a list of files must have at most {LONGEST} bytes; got {path.stat().st_size}")
    if path.suffix.lower() == ".pvtu":
        return States((), lambda state: _joined(path, [path]))
    with readable(path, "list of files (PVD or .vtu.series)"):
        entries = _pvd(path) if path.suffix.lower() == ".pvd" else _series(path)
    if not entries:
        raise fault(path, "a list must name at least one file; it names none")
    parts: dict[float, list[Path]] = {}
    for time, name in entries:
        if not math.isfinite(time):
            raise fault(path, f"times must be finite numbers; got {time}")
        parts.setdefault(time, []).append(_inside(path, name))
    files = list(parts.values())
    return States(tuple(parts), lambda state: _joined(path, files[state]))


def _joined(path: Path, files: list[Path]) -> Contents:
    """The contents of the files of one time, which the list `path` names."""
    if len(files) == 1 and files[0].suffix.lower() == ".vtk":
        return legacy_vtk.states(_present(path, files[0])).at(0)
    meshes: list[Mesh] = []
    if len(set(files)) < len(files):
        raise fault(path, f"the {len(files)} parts of one time must be different files; got {len(set(files))} files")
    for file in files:
        pieces = _pieces(_present(path, file)) if file.suffix.lower() == ".pvtu" else [file]
        for piece in pieces:
            if piece.suffix.lower() != ".vtu":
                raise fault(path, f"the parts of one time must be VTU files; got {piece.name}")
            meshes.append(vtu.mesh_of(_present(path, piece)))
    with readable(path, "list of VTU files"):
        return contents(vtu.joined(meshes), path if len(meshes) > 1 else files[0])


def _present(path: Path, file: Path) -> Path:
    """The file, if it is there and no link leads out of the folder of the list."""
    if not file.is_file():
        raise FileNotFoundError(f"{path.name} names {file.name}, and there is no such file in {file.parent}")
    if not file.resolve().is_relative_to(path.parent.resolve()):
        raise fault(path, f"a list may only name files in its own folder; {file.name} is a link that leads out of it")
    return file


def _pieces(path: Path) -> list[Path]:
    """The VTU files of a PVTU file."""
    with readable(path, "parallel file of VTK (PVTU)"):
        grid = parsed(path, path.read_bytes()).find("PUnstructuredGrid")
        names = [] if grid is None else [piece.get("Source") or "" for piece in grid.findall("Piece")]
    if not names:
        raise fault(path, "a PVTU file must hold a PUnstructuredGrid with pieces; it holds none")
    return [_inside(path, name) for name in names]


def _pvd(path: Path) -> list[tuple[float, str]]:
    """Times and names of the files in a PVD list."""
    root = parsed(path, path.read_bytes())
    collection = root.find("Collection")
    if root.get("type") != "Collection" or collection is None:
        raise fault(path, f"a PVD file must hold a Collection; got type {root.get('type')!r}")
    return [(float(e.get("timestep") or k), e.get("file") or "") for k, e in enumerate(collection.iter("DataSet"))]


def _series(path: Path) -> list[tuple[float, str]]:
    """Times and names of the files in a JSON list."""
    listed = json.loads(path.read_bytes())
    files = listed.get("files") if isinstance(listed, dict) else None
    if not isinstance(files, list) or not all(isinstance(f, dict) and isinstance(f.get("name"), str) for f in files):
        raise fault(path, 'the JSON must hold {"files": [{"name": file, "time": number}, …]}; it does not')
    return [(float(f.get("time", k)), f["name"]) for k, f in enumerate(files)]


def _inside(path: Path, name: str) -> Path:
    """The file of that name in the folder of the list. Raises ValueError if it would lie elsewhere."""
    parts = [*PurePosixPath(name).parts, *PureWindowsPath(name).parts]
    absolute = PurePosixPath(name).is_absolute() or PureWindowsPath(name).drive or PureWindowsPath(name).root
    if absolute or ".." in parts or not name or not name.isprintable():
        raise fault(path, f"a list may only name files in its own folder; got {name!r}. Move the files and write names")
    file = path.parent / name
    if file.suffix.lower() not in SUFFIXES:
        raise fault(path, f"the files of a list must be VTU, PVTU or legacy VTK files; got {name!r}")
    return file
