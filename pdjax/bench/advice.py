"""`advise`: which setting to take, from what was measured and not from what is believed.

The rows are those of `pdjax bench`. For one scene they all have the same kind of error, said in the table below, and
the answer is the row of least wall time among those whose error meets the tolerance.
"""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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
    """What `advise` found: the method, its settings (N, n, steps, …, dtype), its measured error and seconds.

    evidence: every row measured on that scene, the fastest first; machine: what they were measured on; scene: its name.
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
            f"  measured: error {self.error:.2e} in {self.seconds:.2e} s, compilation apart, on {self.machine['cpu']}",
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


def scene_name(scene: Any) -> str:
    """The name under which a scene was measured; ValueError listing those that were."""
    given = scene.scene if isinstance(scene, Motion) else scene
    name = given.name.replace(" ", "-") if isinstance(given, Scene) else given
    if name not in SCENES:
        known = "\n".join(f"  {k}: {v}" for k, v in SCENES.items())
        raise ValueError(f"no measurements of a scene {name!r}; there are\n{known}")
    return name


def _rows(name: str, folder: Path) -> tuple[list[dict], dict]:
    """Every row of the scene that has an error, the fastest first, and the machine."""
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
    """One row for every setting: the worst error and the mean seconds over the loads that a scene was measured at;
    what was not measured at each of them is left out, for it may be right by luck."""
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

    Only the name of a Scene or Motion is used. Its model, load, number of points and horizon are not. The advice is for
    the scene as it was measured (m = 1 and σ/E₀ = 1e-3; 60 points, u₀ = 2 %), and holds for yours as far as it is
    similar.

    Parameters
    ----------
    scene : str, Scene or Motion
        "singular-bar", "wave", "critical-load" or "map", or a result of `pdjax.scenes.singular_bar` or `wave`.
    tol : float
        Largest error [-], of the kind that was measured on that scene.
    data : path, optional
        Folder that `pdjax bench --out` has written on your machine. The default are the rows that come with pdjax.
        Another machine measured them, so their order is more reliable than their seconds.

    Returns
    -------
    Advice
        The method, its settings, error and seconds, and in `evidence` all measured rows, the fastest first.

    Raises
    ------
    ValueError
        If the scene was not measured, or if no row meets the tolerance; the message names the best row.

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
