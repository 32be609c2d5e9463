"""Lists of files of one body at several times: NAME.pvd of ParaView and NAME.vtu.series.

NAME.pvd is XML with an entry <DataSet timestep="0.5" part="0" file="NAME-0001.vtu"/> for every file. NAME.vtu.series is
JSON with {"name": "NAME-0001.vtu", "time": 0.5} for every file. The files are VTU or legacy VTK. Only files in the
folder of the list, or below it, are opened: a list from elsewhere must not choose what is read. A time that has
several parts is refused.

Sources: ParaView, "ParaView Data (PVD) File Format" and "File series", https://www.paraview.org/Wiki/ParaView/Data_formats
"""

import json
import math
from collections import Counter
from pathlib import Path, PurePosixPath, PureWindowsPath

from . import legacy_vtk, vtu
from .contents import Contents, States
from .meshes import fault, readable
from .xml import parsed

READERS = {".vtu": vtu, ".vtk": legacy_vtk}


def states(path: Path) -> States:
    """The states that a list of files names. Each is loaded when it is asked for."""
    if path.suffix.lower() == ".pvd":
        with readable(path, "list of files of ParaView (PVD)"):
            entries = _pvd(path)
    elif path.suffix.lower() == ".series":
        with readable(path, "list of files (.vtu.series, JSON)"):
            entries = _series(path)
    else:
        raise fault(path, "files of parallel runs are not read. Open it in ParaView and save the data as one VTU file")
    if not entries:
        raise fault(path, "a list must name at least one file; it names none")
    for time, _ in entries:
        if not math.isfinite(time):
            raise fault(path, f"times must be finite numbers; got {time}")
    files = [_inside(path, name) for _, name in entries]

    def at(state: int) -> Contents:
        if not files[state].is_file():
            raise FileNotFoundError(
                f"{path.name} names {files[state].name}, and there is no such file in {path.parent}"
            )
        return READERS[files[state].suffix.lower()].states(files[state]).at(0)

    return States(tuple(time for time, _ in entries), at)


def _pvd(path: Path) -> list[tuple[float, str]]:
    """Times and names of the files in a PVD list."""
    root = parsed(path, path.read_bytes())
    collection = root.find("Collection")
    if root.get("type") != "Collection" or collection is None:
        raise fault(path, f"a PVD file must hold a Collection; got type {root.get('type')!r}")
    entries = [(float(e.get("timestep") or k), e.get("file") or "") for k, e in enumerate(collection.iter("DataSet"))]
    time, count = Counter(time for time, _ in entries).most_common(1)[0] if entries else (0.0, 0)
    if count > 1:
        raise fault(path, f"every time must have one file; t = {time} has {count} parts. Merge the parts into one file")
    return entries


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
    if absolute or ".." in parts or not name or "\0" in name:
        raise fault(path, f"a list may only name files in its own folder; got {name!r}. Move the files and write names")
    file = path.parent / name
    if not file.resolve().is_relative_to(path.parent.resolve()):
        raise fault(path, f"a list may only name files in its own folder; {name!r} is a link that leads out of it")
    if file.suffix.lower() not in READERS:
        raise fault(path, f"the files of a list must be VTU or legacy VTK files; got {name!r}")
    return file
