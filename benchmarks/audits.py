"""Audits of states whose answer is known: results of LAMMPS, the paper's cuboid, and a file of a million points.

    lammps   LAMMPS deforms a block with peri/lps and peri/pmb, smoothly and with a checkerboard, and dumps it. The
             audit reads the dump. Its forces must be those of LAMMPS, and only the checkerboard may be found.
    cuboid   The paper's cuboid (m = 0) at +5 % and −5 %, saved by simulate. The audit names the strain from which the
             run cannot be trusted. Beside it: the strain at which the force curve shows it, and Wan's control.
    large    A file of 10⁶ points is written, read, searched and audited. Time and memory of every stage.

`python benchmarks/audits.py --part lammps` runs one part and keeps the results of the others.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.scenes.alternation import roughness

jax.config.update("jax_enable_x64", True)
RESULTS = Path(__file__).parent / "results" / "audits.json"
LAW = pd.LinearElastic(1.0, 1.0)
BULK, SHEAR, C = 1.3, 0.7, 1.3
SHAPE, SPACING, HORIZON = (10, 6, 7), 0.5, 1.507  # three spacings and a little, so that no bond ties


def checkerboard(shape):
    return (-1.0) ** np.indices(shape).sum(axis=0).reshape(-1)


def dumped(style, constants, states, file):
    """Let LAMMPS compute the forces of every displacement (points, 3) and write a dump with one frame for each."""
    from peers.lammps_peri import Peri

    peri = Peri(SHAPE, SPACING, HORIZON, style, constants)
    columns = "id type x y z c_volume fx fy fz"
    peri.engine.command("compute volume all property/atom vfrac")
    peri.engine.command(f"dump frames all custom 1 {file} {columns}")
    peri.engine.command("dump_modify frames format float %.17g first no")
    for u in states:
        peri.place(u)
        peri.engine.command("run 1 pre yes post no")
    peri.close()


def lammps():
    """Dumps of both styles, and the audits of their frames."""
    body = pd.lattice(SHAPE, SPACING)
    X = body.positions
    smooth = X * np.array([0.01, -0.003, -0.003]) + 1e-3 * np.sin(X[:, [1, 2, 0]])
    noise = 0.002 * checkerboard(SHAPE)[:, None] * np.array([1.0, 0.5, -0.7]) * SPACING
    states = [np.zeros_like(X), smooth, smooth + noise]  # LAMMPS writes the first state twice
    rows = []
    for style, constants, model, influence in (
        ("pmb", (C,), pd.BondBased(C), "constant"),
        ("lps", (BULK, SHEAR), pd.LPS(BULK, SHEAR), "inverse distance"),
    ):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{style}.dump"
            dumped(style, constants, states, file)
            points, data = pd.read_points(file, step=0)
            families = pd.families(points, HORIZON, pd.partial_volume_influence(influence, SPACING))
            for state in data.states():
                u = state.vector("displacement", 3)
                found = pd.audit(model, families, u, given_density=state.vector("force", 3))
                row = {
                    "style": f"peri/{style}",
                    "frame": state.step,
                    "largest displacement": float(np.abs(u).max()),
                    "force error": found.force_error,
                    "verdict": found.verdict,
                    "findings": [f.check for f in found.findings],
                    "largest zero-energy share": float(found.zero_energy.max()),
                    "positive": found.positive,
                }
                print(row, flush=True)
                rows.append(row)
    return {"rows": rows, "points": len(body), "horizon / spacing": HORIZON / SPACING}


def cuboid(shape=(28, 7, 7), N=3):
    """The strain from which the audit does not trust the run, and that from which the force shows it."""
    rows = []
    for sign in (1.0, -1.0):
        force, strain = {}, {}
        for name, model in (("m = 0", pd.SethHill(0.0, LAW)), ("m = 0 + Wan", pd.SethHill(0.0, LAW, pd.WanControl()))):
            motion = pd.scenes.cuboid(shape, N, 0.05 * sign, 0.005, model)
            body = motion.scene.body
            watch = {"force": pd.observers.section_force(body, 0.5 * body.spacing * shape[0])}
            history = pd.simulate(motion, observers=watch, show_progress=False)
            run = pd.audit_states(model, motion.scene.families, history, held=~motion.scene.free, show_progress=False)
            force[name] = history.observed["force"][:, 0]
            strain[name] = 0.05 * sign * np.minimum(history.times / motion.duration, 1)
            rough = np.max([roughness(np.asarray(history.u), shape, k) / body.spacing for k in range(3)], axis=0)
            column = run.checks.index("zero-energy mode")

            def first(scores, limit, at=strain[name]):
                over = np.flatnonzero(scores >= limit)
                return float(at[over[0]]) if len(over) else None

            row = {
                "side": "tension" if sign > 0 else "compression",
                "model": name,
                "verdict": run.verdict,
                "untrusted from": None if run.first is None else float(strain[name][run.first]),
                "by": None if run.first is None else run.checks[int(np.argmax(run.scores[run.first]))],
                "alternation then": None if run.first is None else float(rough[run.first]),
                "zero-energy doubtful from": first(run.scores[:, column], 1),
                "zero-energy untrusted from": first(run.scores[:, column], 2),
                "worst place": None if run.first_audit is None else run.last_audit.places[0].position.tolist(),
            }
            if name != "m = 0":
                order = np.argsort(strain["m = 0"])
                of_first = np.interp(strain[name], strain["m = 0"][order], force["m = 0"][order])
                gap = np.abs(of_first - force[name]) / np.abs(force[name]).max()
                row["forces differ by 1 % from"] = first(gap, 0.01)
                row["forces differ by 0.1 % from"] = first(gap, 0.001)
            print(row, flush=True)
            rows.append(row)
    return {"shape": shape, "N": N, "rows": rows}


def large(side=1000):
    """Write, read, search and audit a plate of side² points."""
    stages = {}

    def stage(name, work):
        start = time.perf_counter()
        out = work()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        stages[name] = {"seconds": time.perf_counter() - start, "peak GiB so far": peak}
        print(name, stages[name], flush=True)
        return out

    shape = (side, side)
    lattice = pd.lattice(shape)
    X = lattice.positions
    bump = np.exp(-((X - 0.3 * side) ** 2).sum(axis=1) / (0.02 * side) ** 2)
    u = X * np.array([0.01, -0.003]) + 0.01 * (checkerboard(shape) * bump)[:, None] * np.array([1.0, 0.5])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plate.csv"
        stage("write", lambda: pd.write_points(file, lattice, fields={"u": u}))
        points, data = stage("read", lambda: pd.read_points(file))
        families = stage("search", lambda: pd.families(points, 3.0))
        model = pd.BondLevel(LAW)
        state = stage("audit", lambda: pd.audit(model, families, data.vector("u", 2)))
        stage("write the fields", lambda: pd.export.write_vtk(points, path=f"{folder}/out", fields=state.fields))
    print(state)
    total = sum(x["seconds"] for x in stages.values())
    verdict = {"verdict": state.verdict, "worst place": state.places[0].position.tolist()}
    return {"points": side**2, "stages": stages, "total seconds": total, **verdict}


PARTS = {"lammps": lammps, "cuboid": cuboid, "large": large}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=list(PARTS), help="run one part (default: all)")
    part = parser.parse_args().part
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    kept.pop("machine", None)
    sys.path.insert(0, str(Path(__file__).parent))
    for name in PARTS if part is None else [part]:
        kept[name] = PARTS[name]()
        write("audits", kept)


if __name__ == "__main__":
    main()
