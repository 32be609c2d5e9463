"""pdjax compared with its alternatives: hand-written Numba kernels, LAMMPS, and finite differences in NumPy and SciPy.

The program first checks that all codes agree, then times them. It calls them in turns within one run (A B C A B C …),
so that other load on the machine affects all alike. A time is the median over the turns, with the fastest beside it.
The body is a cube of 32³ points (--quick: 12³). The horizon is 3.015 spacings, and also 6 for Silling's correspondence
model. All computations use float64. A peer that is not installed is named and left out.

* force: seconds of one evaluation f(u), from an array (points, 3) to an array (points, 3), and time per bond. On the
  lattice pdjax uses its fastest backend. The same points as a cloud are to be compared with Numba's neighbour lists.
  The backends of plain XLA, which serve where llvmlite is not installed, stand beside. Every model is measured in
  three processes, and the median process counts.
* scaling: time per point of a force at 32³ and at 100³ points. derivatives: JVP and VJP over the force.
* Hessian of LPS: `pd.jacobian`, LAMMPS's dynamical_matrix, and central differences of the Numba kernel.
* spectrum of a held body: `pd.body_spectrum`, and ARPACK on differences of the Numba kernel.
* stability map: `pd.stability_map`, and NumPy with a Jacobian by differences on the same waves.
"""

import importlib
import json
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import timed, write
from pdjax.figures import SERIES
from pdjax.infinite_lattice import brillouin as zone

jax.config.update("jax_enable_x64", True)
QUICK = "--quick" in sys.argv[1:]
LAM, MU, BULK, SHEAR, C = 1.0, 0.8, 1.3, 0.7, 1.3
LAW = pd.LinearElastic(LAM, MU)
LABELS = {  # code: (its name in the figure, colour)
    "pdjax": ("pdjax, lattice", "#000000"),
    "pdjax, cloud": ("pdjax, cloud", "#d62728"),
    "pdjax, XLA": ("pdjax without llvmlite, lattice", "#888888"),
    "pdjax, XLA, cloud": ("pdjax without llvmlite, cloud", "#bbbbbb"),
    "Numba, lattice": ("Numba, lattice", SERIES[0]),
    "Numba, list": ("Numba, neighbour lists", SERIES[1]),
    "LAMMPS": ("LAMMPS", SERIES[2]),
}
MODELS = {
    "PMB": (pd.BondBased(C), "PMB", (C,), ("pmb", (C,), pd.constant_influence)),
    "LPS": (pd.LPS(BULK, SHEAR), "LPS", (BULK, SHEAR), ("lps", (BULK, SHEAR), pd.inverse_distance_influence)),
    "Silling": (pd.Correspondence(LAW), "Silling", (LAM, MU), None),
    "Seth–Hill, m = 1": (pd.SethHill(1.0, LAW), "SethHill", (1.0, LAM, MU), None),
    "Seth–Hill, m = −½": (pd.SethHill(-0.5, LAW), "SethHill", (-0.5, LAM, MU), None),
    "Seth–Hill, m = 0.7": (pd.SethHill(0.7, LAW), "SethHill", (0.7, LAM, MU), None),
}


def ours(model, families, way="auto"):
    """Compiled force f(u) of pdjax, for every comparison."""
    operator = pd.force_operator(model, families, way)
    return lambda u: np.asarray(operator(jnp.asarray(u)))


def peer(name: str):
    """Import a module of benchmarks/peers; if its dependencies are missing, print a message and return None."""
    try:
        module = importlib.import_module(f"peers.{name}")
        if name == "lammps_peri":
            module.library()
    except (ImportError, OSError) as error:
        print(f"left out: {name} ({error}); install it with pip install -e '.[peers]'")
        return None
    return module


PEERS = {name: peer(name) for name in ("lattice_forces", "list_forces", "grid", "lammps_peri", "by_differences")}


def contenders(name: str, body: pd.Points, horizon: float) -> dict:
    """Map name → f(u) of pdjax and of every peer that has the model, except LAMMPS."""
    model, kind, constants, _ = MODELS[name]
    families = pd.families(body, horizon)
    cloud = pd.families(pd.cloud(body.positions, body.volumes), horizon)
    made = {
        "pdjax": ours(model, families),
        "pdjax, cloud, 2": ours(model, cloud),
        "pdjax, XLA, 2": ours(model, families, "slices"),
        "pdjax, XLA, cloud, 2": ours(model, cloud, "families"),
    }
    if PEERS["lattice_forces"]:
        grid = PEERS["grid"].Grid(body.shape, body.spacing, horizon, border=kind == "Silling")
        cloud = PEERS["list_forces"].Cloud(body.positions, body.volumes, horizon)
        for threads in (1, 2):
            made[f"Numba, lattice, {threads}"] = getattr(PEERS["lattice_forces"], kind)(grid, *constants, threads)
            made[f"Numba, list, {threads}"] = getattr(PEERS["list_forces"], kind)(cloud, *constants, threads)
    return made


def in_turns(work: dict, turns: int) -> dict:
    """Median and fastest seconds of each call in `work`; every turn calls each of them once."""
    spent: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(turns):
        for name, call in work.items():
            time.sleep(0.01)  # lets the threads of the previous call stop spinning
            start = time.perf_counter()
            call()
            spent[name].append(time.perf_counter() - start)
    return {name: {"median": float(np.median(s)), "fastest": min(s)} for name, s in spent.items()}


def forces(name: str, side: int, horizon: float, turns: int) -> dict:
    """Differences from pdjax, seconds and ratios of speed for one model."""
    body = pd.lattice((side,) * 3)
    u = 1e-3 * np.random.default_rng(0).normal(size=(side**3, 3))
    made = contenders(name, body, horizon)
    true = made["pdjax"](u)
    off = {key: float(np.abs(f(u) - true).max() / np.abs(true).max()) for key, f in made.items() if key != "pdjax"}
    work = {key: lambda f=f: f(u) for key, f in made.items()}
    style = MODELS[name][3]
    engine = None
    if style and PEERS["lammps_peri"]:
        kind, constants, influence = style
        engine = PEERS["lammps_peri"].Peri(body.shape, body.spacing, horizon, kind, constants)
        part = pd.partial_volume_influence(influence, body.spacing)
        theirs = ours(MODELS[name][0], pd.families(body, horizon, part))(u)
        off["LAMMPS, 1"] = float(np.abs(engine(u) - theirs).max() / np.abs(theirs).max())
        work["LAMMPS, 1"] = lambda: engine.steps(1)
    seconds = in_turns(work, turns)
    if engine:
        engine.close()
    bonds = _bonds(side, horizon)
    return {
        "points": side**3,
        "horizon / spacing": horizon,
        "bonds": bonds,
        "largest relative difference from pdjax": off,
        "seconds": seconds,
        "nanoseconds per bond": {key: 1e9 * s["median"] / bonds for key, s in seconds.items()},
        "speed of pdjax over it": {key: s["median"] / seconds["pdjax"]["median"] for key, s in seconds.items()},
        "speed of pdjax, cloud, over it": {
            key: s["median"] / seconds["pdjax, cloud, 2"]["median"] for key, s in seconds.items() if "list" in key
        },
    }


def _bonds(side: int, horizon: float) -> int:
    """Number of directed bonds of a cube."""
    cells = np.abs(np.round(np.asarray(pd.lattice_family(3, horizon).xi)).astype(int))
    return int(np.prod(np.maximum(side - cells, 0), axis=1).sum())


def hessians(side: int) -> dict:
    """Jacobian of LPS at rest, with LAMMPS's partial volumes: errors by difference step, and seconds."""
    body, horizon = pd.lattice((side, side - 1, side - 2)), 3.015
    model, _, _, (kind, constants, influence) = MODELS["LPS"]
    part = pd.partial_volume_influence(influence, body.spacing)
    families, rest = pd.families(body, horizon, part), np.zeros((len(body), 3))
    exact = pd.jacobian(model, families, rest)
    scale = np.abs(exact.data).max()
    rows = {"pdjax, sparse": {"seconds": timed(lambda: pd.jacobian(model, families, rest), repeats=3)}}
    dense = exact.toarray()
    if PEERS["lammps_peri"]:
        engine = PEERS["lammps_peri"].Peri(body.shape, body.spacing, horizon, kind, constants)
        for step in (1e-3, 1e-4, 1e-5, 1e-6):
            error = float(np.abs(engine.hessian(step) + dense).max() / scale)
            rows[f"LAMMPS dynamical_matrix, step {step:g}"] = {"error": error}
        rows["LAMMPS dynamical_matrix, step 1e-05"]["seconds"] = timed(lambda: engine.hessian(1e-5), repeats=1)
        engine.close()
    if PEERS["list_forces"]:
        cloud = PEERS["list_forces"].Cloud(body.positions, body.volumes, horizon, part)
        force = PEERS["list_forces"].LPS(cloud, *constants)
        for step in (1e-3, 1e-4, 1e-5, 1e-6):
            error = float(np.abs(PEERS["by_differences"].jacobian(force, rest, step) - dense).max() / scale)
            rows[f"Numba by differences, step {step:g}"] = {"error": error}
        work = timed(lambda: PEERS["by_differences"].jacobian(force, rest, 1e-5), repeats=1)
        rows["Numba by differences, step 1e-05"]["seconds"] = work
    return {"points": len(body), "nonzeros": int(exact.nnz), "rows": rows}


def spectra(side: int, count: int = 4) -> dict:
    """The largest eigenvalues of a cube held at one face (Seth–Hill, m = 1, stretched by 1 %)."""
    body, horizon = pd.lattice((side,) * 3), 2.0
    X = body.positions
    held = np.flatnonzero(X[:, 0] < 1)
    model, families = MODELS["Seth–Hill, m = 1"][0], pd.families(body, horizon)
    scene = pd.scene(body, families, model, pd.prescribe(held, 0.0))
    u = np.stack([0.01 * (X[:, 0] - 0.5), 0 * X[:, 1], 0 * X[:, 2]], axis=1)
    values, _, about = pd.body_spectrum(scene, u, count)
    answer = {
        "unknowns": len(scene.unknowns),
        "eigenvalues": [float(x) for x in values],
        "norm": about["norm"],
        "seconds": {"pdjax": timed(lambda: pd.body_spectrum(scene, u, count)[0], repeats=3)},
    }
    if not PEERS["list_forces"]:
        return answer
    force = PEERS["list_forces"].SethHill(PEERS["list_forces"].Cloud(X, body.volumes, horizon), 1.0, LAM, MU)
    free = np.setdiff1d(np.arange(len(X)), held)

    def reduced(v):
        whole = u.copy()
        whole[free] = v
        return force(whole)[free]

    for step in (1e-3, 1e-5, 1e-7):
        start = time.perf_counter()
        theirs, calls = PEERS["by_differences"].largest_eigenvalues(reduced, u[free], step, count)
        answer["seconds"][f"ARPACK, step {step:g}"] = time.perf_counter() - start
        answer[f"ARPACK, step {step:g}: error over the norm, forces"] = [
            float(np.abs(theirs - values).max() / about["norm"]),
            calls,
        ]
    return answer


def maps(orders: int, loads: int, intervals: int = 24) -> dict:
    """A stability map in 2D, N = 3: verdicts and seconds of pdjax and of NumPy with finite differences."""
    m, a = np.linspace(-2, 2, orders), np.linspace(-0.3, 0.3, loads)
    kept = {"N": 3, "dim": 2, "law": pd.LinearElastic(1.0, 1.0), "resolution": intervals, "show_progress": False}
    ours = timed(lambda: pd.stability_map(m, a, **kept).margin, repeats=3)
    grid = pd.stability_map(m, a, **kept)
    family = pd.lattice_family(2, 3)
    lattice = PEERS["by_differences"].SethHillLattice(family.xi, np.ones(len(family.xi)), 1.0, 1.0)
    waves = np.asarray(zone.brillouin_zone(2, intervals, "cubic").grid)
    start = time.perf_counter()
    theirs = np.array([[lattice.largest(x, (1 + y) * np.eye(2), waves) for y in a] for x in m])
    spent = time.perf_counter() - start
    # The map keeps the eigenvalue of the wave with the largest margin. A margin is divided by κ², so that in a stable
    # state this need not be the largest eigenvalue.
    kept_values = np.asarray(grid.eigenvalue)
    same, positive = (theirs > 1e-7) == (kept_values > 1e-7), theirs > 1e-7
    off = np.abs(theirs - kept_values)[positive] / theirs[positive]
    return {
        "states": orders * loads,
        "waves": len(waves),
        "seconds": {"pdjax": ours, "NumPy by differences": spent},
        "factor, after compilation": spent / ours["median"],
        "factor, cold": spent / ours["first"],
        "share of equal verdicts": float(same.mean()),
        "largest relative difference of positive eigenvalues (pdjax refines between the waves)": float(off.max()),
    }


def draw(numbers: dict) -> Figure:
    """Draw nanoseconds per bond by model. Filled marks: one thread; open marks: two threads."""
    rows = numbers["forces"]
    figure = Figure(figsize=(8.6, 4.4), layout="constrained")
    axes = figure.subplots()
    handles = {}
    for place, row in enumerate(rows.values()):
        for key, value in row["nanoseconds per bond"].items():
            kind, _, threads = key.rpartition(", ") if key != "pdjax" else ("pdjax", "", "2")
            name, colour = LABELS[kind]
            label = f"{name}, {threads} thread{'s' * (threads != '1')}"
            shape = "D" if kind.startswith("pdjax") else "o"
            how = {"color": colour, "markerfacecolor": colour if threads == "1" else "white", "markersize": 8}
            handles[label] = axes.plot([value], [-place], shape, label=label, **how)[0]
    axes.set_xscale("log")
    axes.set_yticks(-np.arange(len(rows)), [name.replace("PMB", "bond-based") for name in rows])
    axes.grid(axis="x", which="both", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("time of one force evaluation per bond  [ns]")
    axes.legend(handles=handles.values(), frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    points = next(iter(rows.values()))["points"]
    axes.set_title(f"Forces of a cube of {round(points ** (1 / 3))}³ points, float64, two cores", fontsize=10)
    return figure


def prepared(model, side: int, derivatives: bool) -> dict:
    """Calls of a prepared force of a cube under the user's own jit, and of its JVP and VJP."""
    operator = pd.force_operator(model, pd.families(pd.lattice((side,) * 3), 3.015, arrays=False))
    u, v = (jnp.asarray(1e-3 * np.random.default_rng(k).normal(size=(side**3, 3))) for k in (0, 1))
    programs = {"force": (jax.jit(operator), (u,))}
    if derivatives:
        programs["jvp"] = jax.jit(lambda u, v: jax.jvp(operator, (u,), (v,))), (u, v)
        programs["vjp"] = jax.jit(lambda u, v: jax.vjp(operator, u)[1](v)[0]), (u, v)
    return {key: lambda f=f, x=x: jax.block_until_ready(f(*x)) for key, (f, x) in programs.items()}


def scaling(few: int, many: int) -> dict:
    """Nanoseconds per point of one prepared force at two sizes, and JVP and VJP over the force at the first."""
    rows: dict = {}
    for name, (model, *_) in MODELS.items():
        small, large = prepared(model, few, True), prepared(model, many, False)
        for call in (*small.values(), *large.values()):
            call()
        spent = {key: times["median"] for key, times in in_turns(small, 9).items()}
        per = 1e9 * spent["force"] / few**3, 1e9 * in_turns(large, 5)["force"]["median"] / many**3
        rows[name] = {
            f"nanoseconds per point, {few}³": per[0],
            f"nanoseconds per point, {many}³": per[1],
            "a point of the large body over one of the small": per[1] / per[0],
            **{f"{key} over force": spent[key] / spent["force"] for key in ("jvp", "vjp")},
        }
    return rows


def in_processes(name: str, side: int, horizon: float, turns: int, count: int) -> dict:
    """`forces` in several processes: the numbers of the process with the median time of pdjax over the best peer."""
    rows = []
    for _ in range(count):
        call = [sys.executable, __file__, "--force", name, str(side), str(horizon), str(turns)]
        rows.append(
            json.loads(subprocess.run(call, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
        )

    def ratio(row: dict) -> float:
        return row["speed of pdjax over it"].get("Numba, lattice, 2", 1.0)

    rows.sort(key=ratio)
    kept = rows[len(rows) // 2]
    return {**kept, "speed over Numba in every process": [ratio(row) for row in rows]}


def main() -> None:
    if "--force" in sys.argv:
        name, side, horizon, turns = sys.argv[-4:]
        print(json.dumps(forces(name, int(side), float(horizon), int(turns))))
        return
    side, turns, count = (12, 5, 1) if QUICK else (32, 15, 3)
    rows = {f"{name}, N = 3": in_processes(name, side, 3.015, turns, count) for name in MODELS}
    rows["Silling, N = 6"] = in_processes("Silling", side, 6.0, turns if QUICK else 5, count)
    numbers = {"forces": rows, "scaling and derivatives": scaling(*((12, 20) if QUICK else (32, 100)))}
    numbers |= {"Hessian of LPS": hessians(6 if QUICK else 9), "spectrum": spectra(6 if QUICK else 9)}
    numbers["stability map"] = maps(5, 6) if QUICK else maps(13, 14)
    write("peers-quick" if QUICK else "peers", numbers, draw(numbers))


if __name__ == "__main__":
    main()
