"""Stabilisers with the smallest error of wave speeds, and what they do on states and bodies they were not designed for.

`designed_stabilisers.py` runs both parts and keeps their numbers.

**fronts**: the smallest error of all phase speeds at kh = 1 that a stabiliser can have whose margin over ±5 % on all
load paths is at most the given one (`pd.design`, ε-constraints). Silling's correspondence model and the Seth–Hill model
with a free order m have the published penalty, a control by shells (`pd.ShellControl`), the same with an influence
function by shells, and the same with an influence function that may be negative.

**transfer**: the designs of margin −0.02 at other strains, and on bodies. In 2D they are judged on jittered cells and a
clamped plate. In 3D a short cuboid is pulled and pushed to ±5 % in time; an instability amplifies an alternation of
neighbouring points that is there at the start. In 1D the singular bar carries the loads of the paper.
"""

import dataclasses
import time

import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd
from pdjax.scenes.alternation import roughness

jax.config.update("jax_enable_x64", True)  # before the spaces below make arrays
LAW = pd.LinearElastic(1.0, 1.0)
LATTICES = {1: 3, 2: 3, 3: 2}  # N by dimension
MARGINS = (-0.02, -0.15)
CUBOID = (12, 4, 4)  # points; the ends take 4 layers each
RATE = 0.005  # strain rate of the cuboid [1/time], for a side and a density of 1
SEED = 1e-4  # size of the random displacements at the start, over the spacing
STRESSES = {"tension": 1e-3, "compression": -1e-5}  # σ/E₀ of the singular bar


def all_paths(dim: int) -> list[str]:
    """Names of the load paths of a dimension."""
    return [name for name in pd.PATHS if dim > 1 or name in ("hydrostatic",)]


def measures(model, family, cases) -> dict:
    """Margin over the load cases, errors of wave speeds at kh = 1, and the critical time step (h = ρ = 1)."""
    return {
        "margin": float(pd.worst_margin(model, family, cases)),
        "phase error": float(pd.dispersion_error(model, family)),
        "shear error": float(pd.dispersion_error(model, family, branches=(0,))),
        "group error": float(pd.dispersion_error(model, family, speed="group")),
        "time step": float(pd.lattice_time_step(model, family)),
    }


class Space:
    """A family of stabilised models: parameters → (model, lattice family), with a start and bounds."""

    def __init__(self, dim: int, seth_hill: bool, weights: str | None, shells: bool = True):
        self.dim, self.N, self.weights, self.shells, self.seth_hill = dim, LATTICES[dim], weights, shells, seth_hill
        self.q = pd.shells(dim, self.N)
        count = len(self.q)
        self.fixed = pd.lattice_family(dim, self.N)
        self.start = {"g": jnp.full(count, 0.3) if shells else jnp.array(0.3)}
        self.lower, self.upper = {"g": -4.0 if shells else 0.0}, {"g": 4.0}
        if seth_hill:
            self.start["m"], self.lower["m"], self.upper["m"] = jnp.array(0.5), -2.0, 3.0
        if weights:
            self.start["w"] = jnp.linspace(0.9, 0.4, count - 1)
            self.lower["w"], self.upper["w"] = -1.0 if weights == "signed" else 0.0, 2.0

    def model(self, p):
        """The stabilised model."""
        control = pd.ShellControl(self.q, p["g"]) if self.shells else pd.SillingControl(p["g"])
        return pd.SethHill(p["m"], LAW, control) if self.seth_hill else pd.Correspondence(LAW, control)

    def influence(self, p):
        """The influence function. The weight of the first shell is 1, because a factor does not change the model."""
        w = pd.interpolated_influence(self.q, jnp.concatenate([jnp.ones(1), p["w"]]))
        return pd.signed_influence(w) if self.weights == "signed" else w

    def __call__(self, p):
        """(model, family)."""
        family = pd.lattice_family(self.dim, self.N, influence=self.influence(p)) if self.weights else self.fixed
        return self.model(p), family


SPACES = {
    "Silling, penalty g": Space(2, False, None, False),
    "Silling, by shells": Space(2, False, None),
    "Silling, by shells, ω ≥ 0": Space(2, False, "positive"),
    "Silling, by shells, signed ω": Space(2, False, "signed"),
    "Seth–Hill m, penalty g": Space(2, True, None, False),
    "Seth–Hill m, by shells": Space(2, True, None),
    "Seth–Hill m, by shells, signed ω": Space(2, True, "signed"),
    "3D Silling, penalty g": Space(3, False, None, False),
    "3D Silling, by shells": Space(3, False, None),
    "3D Silling, by shells, signed ω": Space(3, False, "signed"),
    "1D Seth–Hill m, by shells": Space(1, True, None),
}


def designed(space: Space, limit: float, start, steps: int, sharp: float = 300.0) -> pd.Design:
    """The smallest phase error whose margin is at most `limit`."""
    cases = pd.load_cases(all_paths(space.dim), [-0.05, 0.05])
    return pd.design(
        space,
        start,
        lambda model, family: pd.dispersion_error(model, family, sharpness=sharp),
        {"margin": lambda model, family: pd.worst_margin(model, family, cases, sharpness=sharp) - limit},
        bounds=(
            {k: jnp.broadcast_to(space.lower[k], jnp.shape(v)) for k, v in start.items()},
            {k: jnp.broadcast_to(space.upper[k], jnp.shape(v)) for k, v in start.items()},
        ),
        steps=steps,
    )


def fronts(kept: dict, save, steps: int = 60) -> None:
    """Designs of every space for every margin, each from its neighbour."""
    table = kept.setdefault("fronts", {})
    for name, space in SPACES.items():
        rows = table.setdefault(name, [])
        start = {k: jnp.asarray(v) for k, v in rows[-1]["parameters"].items()} if rows else space.start
        cases = pd.load_cases(all_paths(space.dim), [-0.05, 0.05])
        for limit in (x for x in MARGINS if x not in [r["limit"] for r in rows]):
            begin = time.perf_counter()
            found = designed(space, limit, start, steps)
            start = {k: np.clip(v, space.lower[k], space.upper[k]) for k, v in found.parameters.items()}
            rows.append(
                {
                    "limit": limit,
                    "feasible": found.feasible,
                    "judged": {k: float(np.max(v)) for k, v in found.judged.items()},
                    "reason": found.reason,
                    "evaluations": found.evaluations,
                    "seconds": time.perf_counter() - begin,
                    "parameters": {k: np.asarray(v).tolist() for k, v in found.parameters.items()},
                }
                | measures(found.model, found.family, cases)
            )
            print(name, {k: v for k, v in rows[-1].items() if k != "parameters"}, flush=True)
            save()


def on_plate(model, space: Space, influence) -> dict:
    """Jittered cells of 16 points, and a plate with free edges between two clamps."""
    rng, out = np.random.default_rng(7), {}
    M = float(pd.p_wave_modulus(model, pd.lattice_family(2, space.N, influence=influence)))
    for jitter in (0.1, 0.2):
        unstable = 0
        for _ in range(5):
            cell = pd.lattice((4, 4)).positions + jitter * rng.uniform(-1, 1, (16, 2))
            body = pd.cloud(cell, np.ones(16), period=(4.0, 4.0))
            families = pd.cell_families(body, space.N * (1 + 1e-9), influence=influence)
            for F in (0.95 * np.eye(2), 1.05 * np.eye(2)):
                u = pd.relaxed(model, families, F)
                state = pd.cell_stability(model, families, body.period, F, M, u, 4)
                unstable += state.verdict == "unstable"
        out[f"unstable of 10 states of 5 cells, jitter {jitter:g}"] = unstable
    body = pd.lattice((14, 10))
    for side, a in (("compression", -0.05), ("tension", 0.05)):
        ends = (body.positions[:, 0] < 3) | (body.positions[:, 0] > 10)
        pull = np.zeros((len(body), 2))
        pull[:, 0] = a * body.positions[:, 0]
        plate = pd.scene(body, pd.families(body, space.N, influence=influence), model, pd.prescribe(ends, pull[ends]))
        found = pd.solve(plate, step=0.25, show_progress=False)
        state = found.stability
        out[f"plate with free edges, {side}"] = {
            "converged": bool(found.converged),
            "kind": found.kind,
            "positive": None if state is None else int(np.sum(np.asarray(state.eigenvalues) > 0)),
        }
    return out


def on_cuboid(model, space: Space, influence) -> dict:
    """A short cuboid pulled and pushed to ±5 % at a constant rate, from a state in which its neighbours alternate."""
    out = {}
    for side, strain in (("compression", -0.05), ("tension", 0.05)):
        motion = pd.scenes.cuboid(CUBOID, space.N, strain, RATE, model)
        body = motion.scene.body
        # The scene has no argument for the influence function. The initial velocities do not depend on it.
        families = pd.families(body, space.N * body.spacing, influence=influence)
        start = SEED * body.spacing * np.random.default_rng(3).uniform(-1, 1, body.positions.shape)
        x = body.positions[:, 0] / body.spacing
        start[(x < 4) | (x > CUBOID[0] - 4)] = 0  # the ends, 2N layers
        motion = dataclasses.replace(
            motion, scene=dataclasses.replace(motion.scene, families=families), start=jnp.asarray(start)
        )
        steps = int(np.ceil(motion.duration / (0.8 * pd.critical_time_step(motion)) / 25)) * 25
        run = pd.simulate(motion, dt=motion.duration / steps, save_every=steps // 25, show_progress=False)
        rough = np.max([roughness(np.asarray(run.u), CUBOID, k) for k in range(3)], axis=0)
        out[f"cuboid, {side}"] = {
            "finished": bool(run.finished),
            "steps": int(run.steps),
            "largest alternation over that at the start": float(np.max(rough) / rough[0]),
            "alternation at the end over that at the start": float(rough[-1] / rough[0]),
            "energy error": float(np.abs(run.energies.error).max()),
        }
    return out


def on_bar(model, space: Space, influence) -> dict:
    """The singular bar of 50 and 200 points. Errors are relative, from the nonlinear local solution."""
    out = {}
    modulus = float(pd.p_wave_modulus(model, space.fixed))
    for side, stress in STRESSES.items():
        for n in (50, 200):
            bar = pd.scenes.singular_bar(n, space.N, stress * modulus, model=model)
            found = pd.solve(bar, show_progress=False)
            state, exact = found.stability, np.asarray(bar.closed_form)
            out[f"singular bar of {n} points, {side}"] = {
                "converged": bool(found.converged),
                "kind": found.kind,
                "positive": None if state is None else int(np.sum(np.asarray(state.eigenvalues) > 0)),
                "error": float(np.linalg.norm(np.asarray(found.u) - exact) / np.linalg.norm(exact)),
            }
    return out


BODIES = {1: on_bar, 2: on_plate, 3: on_cuboid}


def transfer(kept: dict, save) -> None:
    """The designs of margin −0.02 on what they have not seen, beside the models without a control."""
    table = {}
    plain = {
        "1D Seth–Hill m = 1, no control": (Space(1, True, None), pd.SethHill(1.0, LAW)),
        "3D Seth–Hill m = 0, no control": (Space(3, True, None), pd.SethHill(0.0, LAW)),
        "3D Silling, no control": (Space(3, False, None), pd.Correspondence(LAW)),
    }
    jobs = {name: (space, model, space.fixed, "constant") for name, (space, model) in plain.items()}
    for name, rows in kept["fronts"].items():
        space = SPACES[name]
        row = next((r for r in rows if r["limit"] == -0.02), None)
        if row is not None:
            p = {k: jnp.asarray(v) for k, v in row["parameters"].items()}
            jobs[name] = (space, *space(p), space.influence(p) if space.weights else "constant")
    for name, (space, model, family, influence) in jobs.items():
        begin, out = time.perf_counter(), {}
        for a in (0.01, 0.1):
            cases = pd.load_cases(all_paths(space.dim), [-a, a])
            out[f"margin at ±{100 * a:g} %"] = float(pd.worst_margin(model, family, cases))
        table[name] = out | BODIES[space.dim](model, space, influence)
        table[name]["seconds"] = time.perf_counter() - begin
        kept["transfer"] = table
        save()
        print(name, table[name], flush=True)
