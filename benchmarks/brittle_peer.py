"""The same brittle run by LAMMPS (peri/pmb) and by pdjax: broken bonds and displacements step by step, and the time.

A block of 12 × 7 × 6 points is pulled apart along x by its initial velocity. Both codes take the same steps of velocity
Verlet and break bonds at the stretch s₀ after the force of a step (LAMMPS: s₀₀, α = 0). Compared after every step are
the damage of all points, which LAMMPS computes from the number of bonds, and the displacements. The run ends before
fragments touch: from step 140 on the short-range contact of LAMMPS acts, which pdjax does not have.
"""

import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.finite_body.dynamics.verlet import before_start, march

sys.path.insert(0, str(Path(__file__).parent))
from peers import lammps_peri

jax.config.update("jax_enable_x64", True)
SHAPE, SPACING, HORIZON, C, STRETCH, STEPS = (12, 7, 6), 0.5, 1.507, 1.3, 0.02, 130
RATE = 0.02  # strain rate of the initial velocity


def velocities(X):
    """Initial velocities (points, 3): a uniform stretching along x, with a jump in the middle."""
    middle = X[:, 0] - X[:, 0].mean()
    v = np.zeros_like(X)
    v[:, 0] = RATE * middle + 0.02 * np.sign(middle)
    return v


def by_lammps(dt, start):
    """Positions and damage of every step (steps, points, …), in pdjax's order of points, and the seconds."""
    kept = lammps_peri.SETUP
    lammps_peri.SETUP = kept.replace("1e30 0.0", f"{STRETCH!r} 0.0")
    try:
        peri = lammps_peri.Peri(SHAPE, SPACING, HORIZON, "pmb", (C,))
    finally:
        lammps_peri.SETUP = kept
    peri._array("s0")[:] = STRETCH
    peri.engine.command(f"timestep {dt!r}")
    peri.engine.command("compute broken all damage/atom")
    peri._array("v")[:] = start[peri.order]
    peri.engine.command("run 0 post no")
    u, damage = [], []
    began = time.perf_counter()
    for _ in range(STEPS):
        peri.engine.command("run 1 pre no post no")
        now = np.empty_like(peri.X)
        now[peri.order] = peri._array("x") - peri.X
        u.append(now)
        found = np.empty(len(peri.X))
        found[peri.order] = peri.engine.numpy.extract_compute("broken", 1, 1)
        damage.append(found)
    seconds = time.perf_counter() - began
    peri.close()
    return np.array(u), np.array(damage), seconds


def by_pdjax(dt, start):
    """The same from pdjax."""
    body = pd.lattice(SHAPE, SPACING)
    families = pd.families(body, HORIZON, pd.partial_volume_influence("constant", SPACING))
    motion = pd.motion(pd.scene(body, families, pd.BondBased(C), moving=True), velocity=start)
    bonds = jnp.sum(families.is_bond, axis=1)
    watch = {"damage": lambda scene, now: 1 - jnp.sum(now.alive, axis=1) / bonds}
    settings = {"dt": dt, "save_every": 1, "observers": watch, "show_progress": False}
    pd.simulate(motion, 2 * dt, breaking=pd.CriticalStretch(STRETCH), **settings)
    began = time.perf_counter()
    history = pd.simulate(motion, STEPS * dt, breaking=pd.CriticalStretch(STRETCH), **settings)
    seconds = time.perf_counter() - began
    return np.asarray(history.u)[1:], np.asarray(history.observed["damage"])[1:], seconds, history, families


def step_ratio(model, side=320, steps=5, rounds=12):
    """Seconds of a step in which bonds can break, or do break, over those of a step with fixed weights.

    The body is a plate of side² points on padded arrays, with a notch that opens. The three runs alternate.
    """
    body = pd.lattice((side, side))
    X, middle = body.positions, side / 2
    families = pd.cut(pd.families(body, 3.015), pd.Segment((0.0, middle), (middle, middle)))
    start, velocity = (np.stack([0 * X[:, 0], rate * (X[:, 1] - middle)], axis=1) for rate in (3e-3, 1e-4))
    motion = pd.motion(pd.scene(body, families, model, moving=True), start=start, velocity=velocity)
    dt = np.asarray(0.4 * pd.critical_time_step(motion))
    go_on = eqx.filter_jit(march)
    runs = {}
    for name, criterion in {"fixed": None, "can": pd.CriticalStretch(1.0), "do": pd.CriticalStretch(0.01)}.items():
        ready = eqx.tree_at(lambda m: m.breaking, motion, criterion, is_leaf=lambda x: x is None).prepared()
        runs[name] = [ready, go_on(ready, before_start(ready), dt, np.int32(2)), []]
    for _ in range(rounds):
        for run in runs.values():
            began = time.perf_counter()
            run[1] = jax.block_until_ready(go_on(run[0], run[1], dt, np.int32(steps)))
            run[2].append((time.perf_counter() - began) / steps)
    seconds = {name: float(np.median(run[2])) for name, run in runs.items()}
    at = np.asarray(runs["do"][1].bonds.at)
    return {
        "points": side**2,
        "seconds of a step with fixed weights": seconds["fixed"],
        "ratio, bonds can break": seconds["can"] / seconds["fixed"],
        "ratio, bonds break": seconds["do"] / seconds["fixed"],
        "broken bonds": int((at >= 0).sum() // 2),
        "steps with a break": len(np.unique(at[at >= 0])),
        "steps": rounds * steps + 1,
    }


def main():
    law = pd.LinearElastic(1.0, 1.0)
    models = {
        "bond-based": pd.BondBased(1.0),
        "LPS": pd.LPS(1.0, 0.6),
        "Silling with a control": pd.Correspondence(law, pd.SillingControl(0.2)),
    }
    ratios = {name: step_ratio(model) for name, model in models.items()}
    X = pd.lattice(SHAPE, SPACING).positions
    start, dt = velocities(X), 0.05
    u, damage, seconds, history, families = by_pdjax(dt, start)
    theirs, hit, peer_seconds = by_lammps(dt, start)
    size = np.abs(theirs).max()
    apart = np.abs(u - theirs).max(axis=(1, 2)) / size
    # pdjax breaks a bond at the start of the next step, LAMMPS at the end of this one.
    off = np.abs(damage[1:] - hit[:-1]).max(axis=1)
    wrong = np.flatnonzero(off > 1e-12)
    write(
        "brittle_peer",
        {
            "points": len(X),
            "steps": STEPS,
            "broken bonds": int(((np.asarray(families.weight) > 0) & ~np.asarray(history.alive)).sum() // 2),
            "largest damage": float(damage.max()),
            "damage equal up to step": int(wrong[0]) if len(wrong) else STEPS - 1,
            "largest difference of displacements over the largest": float(apart.max()),
            "the same up to the first difference of damage": float(
                apart[: wrong[0]].max() if len(wrong) else apart.max()
            ),
            "energy error": float(np.abs(history.energies.error).max()),
            "seconds of pdjax with a save every step": seconds,
            "seconds of LAMMPS with a read every step": peer_seconds,
            "a step with breaking bonds over one with fixed weights": ratios,
        },
    )


if __name__ == "__main__":
    main()
