"""Every model of the catalogue on the singular bar (at rest, 1D) and on the cuboid (tension and compression, 3D).

Bar: the error is ‖u − u_local‖/‖u_local‖. The alternation is ‖¼ δ²(u − u_local)‖/‖u_local‖, where δ² is the second
difference; for a pure zigzag it equals the relative amplitude. The bond-based models have no material law. In 1D they
have the strain energy density ψ(F) = ½ E e_m(F)², and u_local is the local solution for this energy. A model
without an energy has no minimum. It is called "growing" if the largest Re √λ of its Jacobian is positive, else
"steady".

Cuboid: as in `cuboid.py`, a model fails where the alternation between neighbours exceeds ONSET h, or where the run ends
early. Each cuboid runs twice: from rest, and from random displacements of size SEED h. The second run also perturbs
the models that reproduce affine deformations exactly.

Results that are already in the result file are kept and not computed again. `--quick` runs a small trial, which is
stored under another name.
"""

import argparse
import json
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import machine, results, write
from pdjax.figures import SERIES
from pdjax.finite_body.factorisation import matrix
from pdjax.infinite_lattice.criteria.flutter import growth_square
from pdjax.models.catalogue import CATALOGUE
from pdjax.models.kinematics import seth_hill
from pdjax.scenes.alternation import roughness
from pdjax.studies.paper.cuboid import ONSET

jax.config.update("jax_enable_x64", True)
STRESS = 1e-5  # over E₀
RATE, STRAIN, SEED = 0.005, 0.1, 1e-3
GROWS = 1e-10  # a γ² above this fraction of ‖J‖ is more than rounding
FULL = {"bar points": [100, 200, 50], "bar N": 3, "cuboid shape": [20, 5, 5], "cuboid N": 2, "models": list(CATALOGUE)}
QUICK = {
    "bar points": [30],
    "bar N": 3,
    "cuboid shape": [10, 3, 3],
    "cuboid N": 2,
    "models": ["bond-based", "LPS", "Silling + hourglass", "Seth–Hill 0"],
}
SIDES = {"tension": 1, "compression": -1}
TINT = {"tension": SERIES[2], "compression": SERIES[0]}
MARK = {"minimum": "o", "degenerate": "D", "saddle": "X", "steady": "s", "growing": "P"}


class Springs(pd.BondBased):
    """Bond-based model in 1D, with the strain energy density that it has in a homogeneous deformation."""

    modulus: float = 1.0

    def local_energy(self, F):
        return 0.5 * self.modulus * seth_hill(jnp.log(F[0, 0]), 0.5 if self.m is None else self.m) ** 2


def growth(scene, u) -> tuple[float, int]:
    """The largest growth rate [√(E₀/ρ)/L] of small motions about u, and the number of modes that grow."""
    J = matrix(scene, u, 1.0).toarray() / scene.body.volumes[0]
    size = np.linalg.norm(J, 2)
    squares = np.asarray(growth_square(jnp.linalg.eigvals(J), size))
    return float(max(squares.max(), 0) ** 0.5), int((squares > GROWS * size).sum())


def bar(name: str, n: int, N: int) -> dict:
    """Error, alternation and stability of one model on the singular bar of n points, for both signs of the load."""
    model = CATALOGUE[name](pd.LinearElastic(1.0, 0.0), pd.lattice_family(1, N, 1 / n))
    if isinstance(model, pd.BondBased):
        model = Springs(model.c, model.m)
    out = {}
    for side, sign in SIDES.items():
        scene = pd.scenes.singular_bar(n, N, sign * STRESS, model=model)
        found = pd.solve(scene, stability=False)
        known = np.asarray(scene.closed_form)
        off = np.asarray(found.u) - known
        rate, growing = growth(scene, found.u)
        row = {
            "error": float(np.linalg.norm(off) / np.linalg.norm(known)),
            "alternation": float(np.linalg.norm(np.diff(off, 2, axis=0)) / 4 / np.linalg.norm(known)),
            "converged": found.converged,
            "iterations": int(found.iterations),
            "growth rate": rate,
            "growing": growing,
        }
        if model.hyperelastic:
            own = pd.body_stability(scene, found.u)
            row |= {"kind": own.kind, "positive": own.positive}
        else:
            row |= {"kind": "growing" if growing else "steady", "positive": None}
        out[side] = row
    return out


def drive(motion, steps: int, shape) -> dict:
    """One run of the cuboid: the strain at which it fails (None if it does not), and measures of the run."""
    h = motion.scene.body.spacing
    cut = {"force": pd.observers.section_force(motion.scene.body, 0.5 * h * shape[0])}
    dt = motion.duration / steps
    history = pd.simulate(motion, dt=dt, save_every=steps // 100, observers=cut, show_progress=False)
    strain = STRAIN * np.minimum(history.times / motion.duration, 1)
    worst = np.max([roughness(history.u, shape, k) for k in range(3)], axis=0) / h
    over = np.flatnonzero(~(worst <= ONSET))
    fails = float(strain[over[0]]) if len(over) else None if history.finished else float(strain[-1])
    force = history.observed["force"][:, 0] / (shape[1] * shape[2] * h**2)
    early = strain <= 0.02
    return {
        "fails at": fails,
        "finished": history.finished,
        "reason": history.reason,
        "alternation at the end": float(worst[-1]),
        "stiffness": float(np.abs(force[early] @ strain[early] / (strain[early] @ strain[early]))),
    }


def cuboid(name: str, shape, N: int) -> dict:
    """Failure strains of one model on the cuboid, from rest and from a random start, and its Young's moduli."""
    model = CATALOGUE[name](pd.LinearElastic(1.0, 1.0), pd.lattice_family(3, N, 1 / shape[-1]))
    family = pd.lattice_family(3, N, 1 / shape[-1])
    out, small = {}, 1e-5
    inside = pd.piola_stress(model, family, pd.uniaxial_stress(small, model, family))[0, 0] / small
    out["Young's modulus inside a lattice"] = float(inside)
    for side, sign in SIDES.items():
        motion = pd.scenes.cuboid(shape, N, sign * STRAIN, RATE, model)
        steps = 100 * int(np.ceil(motion.duration / (80 * pd.critical_time_step(motion))))
        noise = SEED * motion.scene.body.spacing * np.random.default_rng(0).normal(size=motion.start.shape)
        shaken = eqx.tree_at(lambda m: m.start, motion, jnp.where(motion.free, noise, motion.start))
        if sign > 0 and not model.hyperelastic:
            # Sideways translation and rotation about x are free, so that rounding alone gives a rate of about 1e-3.
            out["growth rate at rest"] = growth(motion.scene, motion.start)[0]
        out[side] = {"steps": steps, **drive(motion, steps, shape), "seeded": drive(shaken, steps, shape)}
    out["Young's modulus of the body"] = (out["tension"]["stiffness"] + out["compression"]["stiffness"]) / 2
    return out


def draw(numbers: dict) -> Figure:
    figure = Figure(figsize=(11.5, 7.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3, sharey=True, width_ratios=(1, 1, 1.25))
    names, seen = numbers["settings"]["models"], set()
    n, end = str(numbers["settings"]["bar points"][0]), 100 * STRAIN
    for y, name in enumerate(names):
        rest, moving = numbers["bar"].get(name, {}).get(n, {}), numbers["cuboid"].get(name, {})
        for side, sign in SIDES.items():
            if row := rest.get(side):
                seen.add(row["kind"])
                how = {"color": TINT[side], "markersize": 6, "markeredgecolor": "white", "markeredgewidth": 0.5}
                left.plot(row["error"], y - 0.17 * sign, MARK[row["kind"]], **how)
                middle.plot(row["alternation"], y - 0.17 * sign, MARK[row["kind"]], **how)
            if row := moving.get(side):
                whole = row["fails at"] is None
                length = sign * (end if whole else 100 * row["fails at"])
                right.barh(y, length, 0.62, color=TINT[side], alpha=0.35 if whole else 0.9)
                again = row["seeded"]["fails at"]
                edge = sign * (end if again is None else 100 * again)
                right.plot(edge, y, ">" if sign > 0 else "<", color="black", markersize=4, fillstyle="full")
        for on, said in ((left, rest), (right, moving)):
            if "left out" in said:
                on.text(
                    0.5, y, said["left out"], fontsize=7, ha="center", va="center", transform=on.get_yaxis_transform()
                )
    left.set_yticks(range(len(names)), names, fontsize=8.5)
    left.set_ylim(len(names) - 0.4, -0.6)
    left.set_xlim(left=0)
    left.set_xlabel("bar: error of u, relative  [–]")
    middle.set_xscale("log")
    middle.set_xlabel("bar: alternation of u, relative  [–]")
    right.set_xlim(-1.12 * end, 1.12 * end)
    right.axvline(0, color="black", linewidth=0.8)
    right.set_xlabel("cuboid: end strain reached without failure  [%]")
    for on in (left, middle, right):
        on.grid(axis="both", color="#dddddd", linewidth=0.5)
        on.set_axisbelow(True)
    for side in SIDES:
        left.plot([], [], "o", color=TINT[side], label=side)
        right.barh(0, 0, color=TINT[side], alpha=0.9, label=f"fails in {side}")
        right.barh(0, 0, color=TINT[side], alpha=0.35, label=f"no failure in {side}")
    words = {"steady": "model without energy: no growing mode", "growing": "model without energy: a growing mode"}
    for kind in (k for k in MARK if k in seen):
        left.plot([], [], MARK[kind], color="#777777", label=words.get(kind, kind))
    right.plot([], [], "k>", markersize=4, label="same, from random displacements of h/1000")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=3, frameon=False, fontsize=8)
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=2, frameon=False, fontsize=8)
    where = numbers["settings"]
    shape = " × ".join(map(str, where["cuboid shape"]))
    figure.suptitle(
        f"Singular bar: n = {n}, N = {where['bar N']}, α = 10, σ/E₀ = ±10⁻⁵.   "
        f"Cuboid: {shape}, N = {where['cuboid N']}, λ = μ = ρ = 1, strain rate {RATE:g}",
        fontsize=10.5,
    )
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="run four models on small bodies, under another name")
    quick = parser.parse_args().quick
    settings, out = (QUICK, "models_on_scenes-quick") if quick else (FULL, "models_on_scenes")
    file = results() / f"{out}.json"
    numbers = {"settings": settings, "bar": {}, "cuboid": {}}
    if file.exists() and (kept := json.loads(file.read_text()))["settings"] == settings:
        numbers = {key: kept[key] for key in numbers}
    shape, N = tuple(settings["cuboid shape"]), settings["cuboid N"]
    tasks = [("cuboid", 3, None), *(("bar", 1, n) for n in settings["bar points"])]
    for scene, dim, n in [tasks[1], tasks[0], *tasks[2:]]:
        for name in settings["models"]:
            rows, key = (numbers[scene], name) if n is None else (numbers[scene].setdefault(name, {}), str(n))
            if key in rows:
                continue
            start = time.perf_counter()
            law = pd.LinearElastic(1.0, 1.0)
            if dim not in CATALOGUE[name](law, pd.lattice_family(3, 1)).dims:
                rows[key] = {"left out": f"not defined in {dim}D"}
                continue
            rows[key] = cuboid(name, shape, N) if n is None else bar(name, n, settings["bar N"])
            rows[key]["seconds, compilation included"] = round(time.perf_counter() - start, 1)
            file.write_text(json.dumps({"machine": machine(), **numbers}, indent=1) + "\n")
            print(scene, n or "", name, json.dumps(rows[key]), flush=True)
    write(out, numbers, draw(numbers))


if __name__ == "__main__":
    main()
