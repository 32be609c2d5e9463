"""`advise`: the fastest method and setting that meet a tolerance, from measurements.

The rows come from `pdjax bench`. All rows of one scene have the same kind of error, which the table `SCENES` describes.
The advice is the row with the least wall time among those whose error meets the tolerance.
"""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path

from .._internal.public import public_function
from ..finite_body.dynamics.system import Motion
from ..finite_body.scene import Scene

MEASURED = Path(__file__).parent / "measured"
SCENES = {
    "singular-bar": "singular bar in tension: relative root mean square error of u from the local solution",
    "wave": "travelling wave on a periodic bar: largest relative error of u and v after four periods",
    "critical-load": "critical load of the infinite lattice in uniaxial strain: relative error of a_cr, the worst load",
    "map": "map of stability over (m, a): largest error of the margin, itself a share of the elastic modulus",
}


@dataclass(frozen=True)
class Advice:
    """The answer of `advise`: a method with its settings, its measured error and time.

    Attributes
    ----------
    method : str
        Name of the method, for example "newton" or "Tsit5 (5)".
    settings : dict
        Settings of the method: N, n, steps, intervals, ..., and dtype.
    error : float
        Measured error [-], of the kind that belongs to the scene.
    seconds : float
        Measured wall time [s] without compilation.
    scene : str
        Name of the scene.
    tol : float
        Tolerance [-] that was asked for.
    evidence : tuple of dict
        All measured settings of the scene that have an error, the fastest first. For a scene with several loads, each
        row has the largest error and the mean time over the loads.
    machine : dict
        Processor, device and versions of the measurements.

    Examples
    --------
    >>> advice = pd.advise("critical-load", 1e-3)
    >>> advice.error <= 1e-3, len(advice.evidence)
    (True, 17)
    """

    method: str
    settings: dict
    error: float
    seconds: float
    scene: str
    tol: float
    evidence: tuple[dict, ...] = field(repr=False)
    machine: dict = field(repr=False)

    def __repr__(self) -> str:
        lines = [
            f"{self.scene}, error ≤ {self.tol:g}: {_described(self.method, self.settings)}",
            f"  measured: error {self.error:.2e} in {self.seconds:.2e} s without compilation, on {self.machine['cpu']}",
        ]
        best: dict[str, dict] = {}
        for row in self.evidence:
            if row["error"] <= self.tol and row["method"] != self.method:
                best.setdefault(row["method"], row)
        lines += [f"  instead, {r['seconds'] / self.seconds:.3g} × the time: {_said(r)}" for r in best.values()]
        return "\n".join(lines)


def _settings(row: dict) -> dict:
    return {k: v for k, v in row["settings"].items() if k != "scene"} | {"dtype": row["dtype"]}


def _described(method: str, settings: dict) -> str:
    return ", ".join([method, *(f"{k} = {v}" for k, v in settings.items())])


def _said(row: dict) -> str:
    return f"{_described(row['method'], _settings(row))}, error {row['error']:.2e}"


def scene_name(scene: Motion | Scene | str) -> str:
    """Return the name under which a scene was measured. Raise ValueError with the measured names if it was not."""
    given = scene.scene if isinstance(scene, Motion) else scene
    name = given.name.replace(" ", "-") if isinstance(given, Scene) else given
    if name not in SCENES:
        known = "\n".join(f"  {k}: {v}" for k, v in SCENES.items())
        raise ValueError(f"no measurements of a scene {name!r}; there are\n{known}")
    return name


def _rows(name: str, folder: Path) -> tuple[list[dict], dict]:
    """Return every row of the scene that has an error, the fastest first, and the machine."""
    rows: list[dict] = []
    machines: list[dict] = []
    for file in sorted(folder.glob("*.json")):
        record = json.loads(file.read_text())
        mine = [row for row in record["rows"] if row["settings"].get("scene") == name and row["error"] is not None]
        rows += [{**row, "case": file.stem} for row in mine]
        if mine and record["machine"] not in machines:
            machines.append(record["machine"])
    if not rows:
        raise ValueError(f"{folder} holds no rows of {name}: measure them with pdjax bench --out {folder}")
    if len(machines) > 1:
        raise ValueError(
            f"{folder} holds rows of {name} from {len(machines)} machines, whose times can't be compared:"
            f" {', '.join(str(m.get('cpu')) for m in machines)}; give a folder of one machine"
        )
    return sorted(_worst(rows), key=lambda row: row["seconds"]), machines[0]


def _worst(rows: list[dict]) -> list[dict]:
    """Return one row for every setting: its largest error and its mean seconds over the loads of the scene.

    A setting that was not measured at every load is left out, because it may be accurate at one load by chance.
    """
    loads = {row["settings"].get("load") for row in rows}
    groups: dict[str, list[dict]] = {}
    for row in rows:
        rest = {k: v for k, v in row["settings"].items() if k != "load"}
        groups.setdefault(json.dumps([row["method"], rest, row["dtype"]]), []).append({**row, "settings": rest})
    return [
        {**group[0], "error": max(r["error"] for r in group), "seconds": sum(r["seconds"] for r in group) / len(group)}
        for group in groups.values()
        if len(group) == len(loads)
    ]


@public_function
def advise(scene: Scene | Motion | str, tol: float, data: str | os.PathLike | None = None) -> Advice:
    """Find the fastest measured setting of a scene whose error meets a tolerance.

    `advise` uses only the name of a Scene or Motion. It ignores the model, the load, the number of points and the
    horizon. The advice is for the scene as it was measured: the singular bar with m = 1 and σ/E₀ = 1e-3, the wave on
    60 points with u₀ = 2 % of a spacing. It applies to your scene only as far as the two are similar.

    Parameters
    ----------
    scene : str, Scene or Motion
        "singular-bar", "wave", "critical-load" or "map", or a result of `pdjax.scenes.singular_bar` or `wave`.
    tol : float
        Largest acceptable error [-], of the kind that was measured on that scene.
    data : path, optional
        Folder that `pdjax bench --out` has written on your machine. By default `advise` reads the rows that come with
        pdjax. Another machine measured those, so their order is more reliable than their times.

    Returns
    -------
    Advice
        The method, its settings, its error and its time. `evidence` holds all measured rows, the fastest first.

    Raises
    ------
    ValueError
        If the scene was not measured, if tol is not a finite number > 0, if `data` holds no rows of the scene or rows
        of several machines, or if no row meets the tolerance. In the last case the message names the best row.

    Examples
    --------
    >>> advice = pd.advise("wave", tol=1e-2)
    >>> advice.error <= 1e-2
    True
    """
    name = scene_name(scene)
    if not (isinstance(tol, int | float) and 0 < tol < float("inf")):
        raise ValueError(f"tol must be a finite number > 0; got {tol!r}")
    rows, machine = _rows(name, MEASURED if data is None else Path(data))
    good = [row for row in rows if row["error"] <= tol]
    if not good:
        best = min(rows, key=lambda row: row["error"])
        raise ValueError(
            f"no measured setting of {name} has an error of {tol:g} or less ({SCENES[name]}); the best of {len(rows)}"
            f" is {_said(best)} in {best['seconds']:.2e} s"
        )
    row = good[0]
    return Advice(row["method"], _settings(row), row["error"], row["seconds"], name, tol, tuple(rows), machine)
