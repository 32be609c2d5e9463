"""Proofs about margins: beside the search and periodic bodies, over the default map, for designs, and their cost.

    python benchmarks/proofs.py                 all parts; kept parts are not computed again (hours, most of them in 3D)
    python benchmarks/proofs.py --part random   one part: random, bodies, map, cost, designs
    python benchmarks/proofs.py --seconds 600   every part ends after this time, and the next run continues it

`pd.certify` encloses the margin of a homogeneous state, and `pd.stability` searches the Brillouin zone for it.

**random**: 10 000 random states. The models are of every kind in `pd.CATALOGUE`, with random constants, laws and
influence functions, and F is random near I. The margin of the search, and the quotients of random waves, must not
exceed the proved upper bound. A state at which they do is kept as a contradiction. A state at which the proof finds a
larger margin than the search is kept as missed. A group of states shares one model and one family. Group g has the seed
g, and `group(g)` makes it again.

**bodies**: the dense Jacobian J of periodic bodies under F. Every wave of the body is a wave of the zone. The largest
generalised eigenvalue of J v = μ M L v, with L = −Δ on the lattice, must therefore not exceed the upper bound. It does
not use the symbol.

**map**: the sign of the margin at all 40 000 states of the default map of `pdjax map`.

**cost**: boxes and seconds of a proof against the tolerance, the dimension, N and the model.

**designs**: the designs kept by `designed_stabilisers.py` at ±5 % on all load paths, and at every load between.
"""

import argparse
import json
import time
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from matplotlib.figure import Figure
from stabiliser_fronts import SPACES, all_paths

import pdjax as pd
from pdjax.bench.harness import results, write
from pdjax.figures import SERIES
from pdjax.force.fields import check_model
from pdjax.geometry.bonds import LatticeFamily
from pdjax.geometry.influence import INFLUENCES
from pdjax.infinite_lattice.bloch import homogeneous_tangent
from pdjax.infinite_lattice.brillouin import brillouin_zone, default_intervals
from pdjax.infinite_lattice.certificate.enclosed import enclose, quotients
from pdjax.infinite_lattice.cosine_series import series
from pdjax.infinite_lattice.criteria.certified import certifiable_states, enclosed_states
from pdjax.infinite_lattice.criteria.on_host import at_waves, searched
from pdjax.infinite_lattice.lattice_states import States, has_series, offsets_of, resting_modulus

jax.config.update("jax_enable_x64", True)
NAME = "proofs"


class Block(NamedTuple):
    """Groups of states: dimension, horizons over spacing, groups, states of a group, and the boxes for each state."""

    dim: int
    horizons: tuple[int, ...]
    groups: int
    states: int
    boxes: int


BLOCKS = (
    Block(1, (1, 2, 3, 4), 485, 10, 20_000),
    Block(2, (1, 2, 3, 4), 485, 10, 200_000),
    Block(3, (2,), 27, 10, 200_000),
    Block(3, (3,), 6, 5, 200_000),
)
FIRST = [sum(block.groups for block in BLOCKS[:i]) for i in range(len(BLOCKS))]  # number of the first group of a block
ROUNDING = 1e-12  # by which a computed margin may exceed a proved bound
WAVES = 400  # random waves at which the quotient of every random state is computed
ANY_LAW = ("Silling", "bond-level", "bond-associated", "sub-horizon", "reproducing")  # kinds that take a law in F
LAW = pd.LinearElastic(1.0, 1.0)
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
MODELS = {
    "Seth–Hill 1": lambda: pd.SethHill(1.0, LAW),
    "Seth–Hill 0, g = ½": lambda: pd.SethHill(0.0, LAW, pd.SillingControl(0.5)),
    "LPS": lambda: pd.LPS(5 / 3, 1.0),
    "Silling, g = 0.02": lambda: pd.Correspondence(LAW, pd.SillingControl(0.02)),
}


class Clock:
    """A budget of seconds."""

    def __init__(self, seconds: float):
        self.end = time.perf_counter() + seconds

    def late(self) -> bool:
        """Whether the budget has ended."""
        return time.perf_counter() > self.end


# ---------------------------------------------------------------- random states


@lru_cache(maxsize=64)
def family_of(dim: int, N: int, influence: str) -> LatticeFamily:
    """One family, which keeps what has been prepared for it."""
    return pd.lattice_family(dim, N, influence=influence)


@lru_cache(maxsize=512)
def influences_of(dim: int, N: int, kind: str) -> tuple[str, ...]:
    """The influence functions for which a model of the catalogue exists and has a series."""
    found = []
    for name in INFLUENCES:
        try:
            family = family_of(dim, N, name)
            model = pd.CATALOGUE[kind](LAW, family)
            check_model(model, family, LatticeFamily)
        except ValueError:
            continue
        if has_series(model):
            found.append(name)
    return tuple(found)


@lru_cache(maxsize=4)
def kinds(block: Block) -> tuple[tuple[int, str, str], ...]:
    """All (N, kind, law) of a block that can be proved."""
    found = []
    for N in block.horizons:
        for kind in pd.CATALOGUE:
            if influences_of(block.dim, N, kind):
                found.append((N, kind, "LinearElastic"))
                if kind.startswith(ANY_LAW):
                    found.append((N, kind, "NeoHookean"))
    return tuple(found)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A random number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def group(g: int):
    """The states of a group: a description, model, family, F (states, dim, dim), and the boxes for each state."""
    i = max(i for i, first in enumerate(FIRST) if g >= first)
    block, place, rng = BLOCKS[i], g - FIRST[i], np.random.default_rng(g)
    dim, several = block.dim, kinds(block)
    # In 3D, steps of 7 spread the few groups over all kinds. The second term makes all of them different.
    N, kind, law = several[(place * 7 + place // 5) % len(several)] if dim == 3 else several[place % len(several)]
    names = influences_of(dim, N, kind)
    influence = names[rng.integers(len(names))]
    family = family_of(dim, N, influence)
    modulus = log_uniform(rng, 1e-3, 1e11)
    constants = {"lam": rng.uniform(-0.5, 4.0) * modulus, "mu": modulus}
    model = pd.CATALOGUE[kind](getattr(pd, law)(**constants), family)
    if rng.uniform() < 0.75:  # Otherwise the catalogue's own constants.
        if getattr(model, "m", None) is not None:
            constants["m"] = rng.uniform(-2.0, 2.0)
            model = replace(model, m=constants["m"])
        if "penalty" in kind:
            constants["g"] = log_uniform(rng, 1e-3, 1.0)
            model = replace(model, control=pd.SillingControl(constants["g"]))
        if "hourglass" in kind:
            constants["C"] = log_uniform(rng, 1e-3, 0.3)
            model = replace(model, control=pd.LittlewoodControl(constants["C"]))
    H = rng.normal(size=(block.states, dim, dim))
    size = np.array([log_uniform(rng, 1e-4, 0.3) for _ in range(block.states)])
    F = np.eye(dim) + H * (size / np.linalg.norm(H, 2, axis=(1, 2)))[:, None, None]  # det F > 0, for |H|₂ < 1
    about = {"g": g, "dim": dim, "N": N, "kind": kind, "law": law, "influence": influence, "constants": constants}
    return about, model, family, F, block.boxes


def largest_sampled(states: States, g: int) -> np.ndarray:
    """The largest real part of an eigenvalue of Ĵ/(M κ²) at random waves, for every state."""
    dim, rng = states.offsets.shape[1], np.random.default_rng([g, 1])
    x = rng.uniform(-np.pi, np.pi, (WAVES, dim)) * rng.uniform(0, 1, (WAVES, 1)) ** (1 / 2)
    symbols = -np.einsum("ko,soij->skij", 4 * np.sin(x @ states.offsets.T / 2) ** 2, states.scaled)
    top = np.linalg.eigvals(symbols).real.max(axis=2)
    return (top / (4 * np.sin(x / 2) ** 2).sum(axis=1)).max(axis=1)


def prove_group(g: int) -> tuple[dict, list[dict]]:
    """The row of a group, and the states that the search has missed or at which it contradicts the proof."""
    about, model, family, F, boxes = group(g)
    begin = time.perf_counter()
    states = certifiable_states(model, family, F)
    linearised = time.perf_counter()
    found = searched(states, model, family, brillouin_zone(family.dim, default_intervals(family.reach)))
    margin = np.asarray(at_waves(found, states, family).margin)
    middle = time.perf_counter()
    made = enclosed_states(states, found, 1e-2, boxes)
    end = time.perf_counter()
    sampled = largest_sampled(states, g)
    above = (margin > made.upper + ROUNDING) | (sampled > made.upper + ROUNDING)
    wrong = above | (~made.missed & (margin < made.lower - ROUNDING)) | (made.lower > made.upper)
    row = {
        **{k: v for k, v in about.items() if k != "constants"},
        "energy": bool(model.hyperelastic),
        "proved": int(made.proved.sum()),
        "sign": int(((made.upper < 0) | (made.lower > 0)).sum()),
        "marginal": int((np.maximum(-made.lower, made.upper) <= 2e-9).sum()),
        "missed": int(made.missed.sum()),
        "contradictions": int(wrong.sum()),
        "open": np.flatnonzero(~made.proved).tolist(),
        "boxes": " ".join(map(str, made.boxes)),
        "seconds": {"linearise": linearised - begin, "search": middle - linearised, "prove": end - middle},
    }
    cases = [
        {
            **about,
            "state": int(i),
            "F": F[i].tolist(),
            "contradiction": bool(wrong[i]),
            "margin of the search": float(margin[i]),
            "sampled": float(sampled[i]),
            "lower": float(made.lower[i]),
            "upper": float(made.upper[i]),
            "wave of the search": np.asarray(found.x)[i].tolist(),
            "wave of the proof": made.x[i].tolist(),
        }
        for i in np.flatnonzero(wrong | made.missed)
    ]
    return row, cases


def random(kept: dict, save, clock: Clock) -> None:
    """All groups. Those of all blocks are mixed, so that a part of the run has states of each."""
    table = kept.setdefault("random", {"rows": [], "cases": []})
    done = {row["g"] for row in table["rows"]}
    groups = [
        ((place + 0.5) / block.groups, first + place)
        for block, first in zip(BLOCKS, FIRST, strict=True)
        for place in range(block.groups)
    ]
    saved = time.perf_counter()
    for _, g in sorted(groups):
        if g in done:
            continue
        if clock.late():
            break
        row, cases = prove_group(g)
        table["rows"].append(row)
        table["cases"] += cases
        print({k: v for k, v in row.items() if k != "boxes"}, *cases, sep="\n", flush=True)
        if time.perf_counter() - saved > 20:
            kept["random"]["summary"] = summary_of(table["rows"])
            save()
            saved = time.perf_counter()
    kept["random"]["summary"] = summary_of(table["rows"])
    save()


def summary_of(rows: list[dict]) -> dict:
    """Counts, boxes and seconds of the random states by dimension and N of 3D."""
    out = {}
    for name, choose in {
        "1D": lambda r: r["dim"] == 1,
        "2D": lambda r: r["dim"] == 2,
        "3D, N = 2": lambda r: (r["dim"], r["N"]) == (3, 2),
        "3D, N = 3": lambda r: (r["dim"], r["N"]) == (3, 3),
    }.items():
        mine = [r for r in rows if choose(r)]
        if not mine:
            continue
        boxes = np.concatenate([np.array(r["boxes"].split(), int) for r in mine])
        count = len(boxes)
        out[name] = {
            "states": count,
            "models": len(mine),
            "states of models without an energy": sum(len(r["boxes"].split()) for r in mine if not r["energy"]),
            "proved": sum(r["proved"] for r in mine),
            "not proved within the budget": count - sum(r["proved"] for r in mine),
            "sign proved": sum(r["sign"] for r in mine),
            "marginal": sum(r["marginal"] for r in mine),
            "missed by the search": sum(r["missed"] for r in mine),
            "contradictions": sum(r["contradictions"] for r in mine),
            "boxes, median": float(np.median(boxes)),
            "boxes, 90 %": float(np.quantile(boxes, 0.9)),
            "boxes, largest": int(boxes.max()),
            "seconds": {k: sum(r["seconds"][k] for r in mine) for k in ("linearise", "search", "prove")},
            "seconds of a proof": sum(r["seconds"]["prove"] for r in mine) / count,
            "seconds of a proof, median": float(
                np.median([r["seconds"]["prove"] / len(r["boxes"].split()) for r in mine])
            ),
        }
    return out


# ---------------------------------------------------------------- periodic bodies


def bodies(kept: dict, save, clock: Clock) -> None:
    """The dense Jacobians of periodic bodies beside the bounds of their states."""
    rows = kept.setdefault("bodies", [])
    shapes = {1: ((12,), 3), 2: ((8, 7), 2), 3: ((6, 6, 6), 2)}
    for dim, (shape, N) in shapes.items():
        for name, make in {
            **MODELS,
            "Silling": lambda: pd.Correspondence(LAW),
            "Seth–Hill −1": lambda: pd.SethHill(-1.0, LAW),
        }.items():
            if dim == 1 and name == "LPS":  # has no 1D form
                continue
            for j, size in enumerate((0.02, 0.1)):
                if clock.late():
                    return
                if any((r["dim"], r["model"], r["size"]) == (dim, name, size) for r in rows):
                    continue
                model, rng = make(), np.random.default_rng([dim, j])
                F = np.eye(dim) + size * rng.uniform(-1, 1, (dim, dim))
                proof = pd.certify(model, pd.lattice_family(dim, N), F, 1e-2, 200_000)
                body = pd.lattice(shape, periodic=True)
                families = pd.families(body, N)
                J = np.asarray(pd.jacobian(model, families, np.zeros((len(body), dim)), form="dense", F=F))
                J = (J + J.T) / 2
                M = float(pd.p_wave_modulus(model, pd.lattice_family(dim, N)))
                margin, positive, largest = of_body(J, shape, M)
                row = {
                    "dim": dim,
                    "model": name,
                    "size": size,
                    "shape": shape,
                    "F": F.tolist(),
                    "body": {"margin": margin, "positive eigenvalues": positive, "largest eigenvalue": largest},
                    "lower": proof.lower,
                    "upper": proof.upper,
                    "verdict": proof.verdict,
                    "contradiction": bool(
                        margin > proof.upper + ROUNDING or (proof.verdict == "stable" and positive > 0)
                    ),
                }
                rows.append(row)
                print(row, flush=True)
                save()


def of_body(J: np.ndarray, shape: tuple[int, ...], M: float) -> tuple[float, int, float]:
    """The largest μ of J v = μ M L v, the number of positive eigenvalues of J/M, and the largest one.

    The translations, for which both sides are zero, are left out.
    """
    dim, laplacian = len(shape), 0.0
    for axis, n in enumerate(shape):
        one = 2 * np.eye(n) - np.roll(np.eye(n), 1, axis=0) - np.roll(np.eye(n), -1, axis=0)
        factors = [one if i == axis else np.eye(k) for i, k in enumerate(shape)]
        whole = factors[0]
        for factor in factors[1:]:
            whole = np.kron(whole, factor)
        laplacian = laplacian + whole
    L = np.kron(laplacian, np.eye(dim))
    basis = scipy.linalg.null_space(np.kron(np.ones((1, int(np.prod(shape)))), np.eye(dim)))
    own, free = basis.T @ (J / M) @ basis, basis.T @ L @ basis
    values = np.linalg.eigvalsh(own)
    margin = scipy.linalg.eigh(own, free, eigvals_only=True)[-1]
    return float(margin), int((values > 1e-10 * np.abs(values).max()).sum()), float(values[-1])


# ---------------------------------------------------------------- the default map


def default_map(kept: dict, save, clock: Clock, points: int = 200, batch: int = 400) -> None:
    """The sign of the margin at all states of the default map: s stable, u unstable, o open."""
    if "map" in kept:
        return
    family = pd.lattice_family(2, 3)
    zone = brillouin_zone(2, default_intervals(family.reach), "cubic")
    loads = np.linspace(-0.3, 0.3, points)
    m, a = (x.ravel() for x in np.meshgrid(np.linspace(-2, 2, points), loads, indexing="ij"))
    some = pd.SethHill(1.0, LAW)
    offsets, M = offsets_of(some, family), resting_modulus(some, family)

    @jax.jit
    @jax.vmap
    def linearise(m, a):
        F = (1 + a) * jnp.eye(2)
        return series(homogeneous_tangent(pd.SethHill(m, LAW), family, F), 2, len(family.influence))

    spent = {"linearise": 0.0, "search": 0.0, "prove": 0.0, "prove the rest": 0.0}
    lower, upper = np.empty(len(m)), np.full(len(m), np.inf)
    boxes, missed = np.zeros(len(m), int), np.zeros(len(m), bool)
    waves = []

    def prove_some(index: np.ndarray, states: States, waves: tuple, most: int) -> None:
        """Prove the signs of states that the search has not shown to be unstable."""
        made = enclose(states.scaled, states.offsets, *waves, tol=1.0, boxes=most)
        lower[index], upper[index] = made.lower, made.upper
        missed[index] |= made.missed
        boxes[index] += made.boxes

    linearise(m[:batch], a[:batch])  # compiles
    searched(States(np.asarray(linearise(m[:batch], a[:batch])), offsets, M, 1.0), some, family, zone)
    for start in range(0, len(m), batch):
        index = np.arange(start, min(start + batch, len(m)))
        t0 = time.perf_counter()
        states = States(np.asarray(linearise(m[index], a[index])), offsets, M, 1.0)
        t1 = time.perf_counter()
        found = searched(states, some, family, zone)
        wave = tuple(np.asarray(part) for part in (found.x, found.is_long, found.mode))
        t2 = time.perf_counter()
        value, rounding = quotients(states.scaled, offsets, *wave)
        lower[index] = value - rounding
        rest = lower[index] <= 0
        if rest.any():
            part = states._replace(blocks=states.blocks[rest])
            prove_some(index[rest], part, tuple(x[rest] for x in wave), 2_000)
        t3 = time.perf_counter()
        for name, seconds in zip(spent, (t1 - t0, t2 - t1, t3 - t2), strict=False):
            spent[name] += seconds
        waves.append(wave)
        print(start, spent, flush=True)
    easy = int(((lower > 0) | (upper < 0)).sum())
    wave = tuple(np.concatenate(part) for part in zip(*waves, strict=True))
    begin = time.perf_counter()
    for i in np.flatnonzero((lower <= 0) & (upper >= 0)):
        states = States(np.asarray(linearise(m[i : i + 1], a[i : i + 1])), offsets, M, 1.0)
        prove_some(np.array([i]), states, tuple(x[i : i + 1] for x in wave), 200_000)
        if time.perf_counter() - begin > 120:  # Marginal states would use their whole budget.
            break
    spent["prove the rest"] = time.perf_counter() - begin
    signs = np.where(lower > 0, "u", np.where(upper < 0, "s", "o"))
    left = np.flatnonzero(signs == "o")
    kept["map"] = {
        "states": len(m),
        "stable": int((signs == "s").sum()),
        "unstable": int((signs == "u").sum()),
        "open": int((signs == "o").sum()),
        "proved with up to 2 000 boxes": easy,
        "missed by the search": int(missed.sum()),
        "boxes of a proof, median and largest": [float(np.median(boxes[boxes > 0])), int(boxes.max())],
        "smallest |margin| proved stable": float(-lower[signs == "s"].max()),
        "smallest |margin| proved unstable": float(lower[signs == "u"].min()),
        "seconds": spent,
        "open states": [
            {"m": float(m[i]), "a": float(a[i]), "lower": float(lower[i]), "upper": float(upper[i])} for i in left[:400]
        ],
        "signs": ["".join(row) for row in signs.reshape(points, points)],
    }
    save()


# ---------------------------------------------------------------- cost


def deformations(dim: int) -> dict[str, np.ndarray]:
    """A cubic state, and a state whose only symmetry is −I."""
    general = np.eye(3) + np.array([[0.02, 0.013, 0.004], [-0.008, -0.011, 0.017], [0.006, -0.005, 0.009]])
    return {"1.02 I": 1.02 * np.eye(dim)} | ({"general": general[:dim, :dim]} if dim > 1 else {})


def cost(kept: dict, save, clock: Clock, longest: float = 60.0) -> None:
    """Boxes and seconds of every tolerance. A state ends at the first tolerance that takes longer than `longest`."""
    rows = kept.setdefault("cost", [])
    for dim, horizons in ((1, (2, 3, 4)), (2, (2, 3, 4)), (3, (2, 3))):
        for N in horizons:
            family = pd.lattice_family(dim, N)
            zone = brillouin_zone(dim, default_intervals(family.reach))
            for name, make in MODELS.items():
                for shape, F in deformations(dim).items():
                    if dim == 1 and name == "LPS":
                        continue
                    model, found = make(), None
                    for tol in TOLERANCES:
                        key = {"dim": dim, "N": N, "model": name, "F": shape, "tol": tol}
                        known = next((r for r in rows if key.items() <= r.items()), None)
                        if known is not None and known["proved"]:
                            continue
                        if known is not None:
                            break
                        if clock.late():
                            return
                        if found is None:
                            states = certifiable_states(model, family, F[None])
                            found = searched(states, model, family, zone)
                        begin = time.perf_counter()
                        made = enclosed_states(states, found, tol, 10_000_000, longest)
                        rows.append(
                            key
                            | {
                                "boxes": int(made.boxes[0]),
                                "seconds": time.perf_counter() - begin,
                                "proved": bool(made.proved[0]),
                                "missed": bool(made.missed[0]),
                                "lower": float(made.lower[0]),
                                "upper": float(made.upper[0]),
                            }
                        )
                        print(rows[-1], flush=True)
                        kept["a digit costs"] = digits(rows)
                        save()
                        if not made.proved[0]:
                            break


def digits(rows: list[dict]) -> dict:
    """The factor in boxes from one tolerance to the next, by dimension: geometric mean, smallest and largest."""
    out = {}
    for dim in (1, 2, 3):
        factors = []
        for r in rows:
            same = ("dim", "N", "model", "F")
            after = [
                s
                for s in rows
                if all(s[k] == r[k] for k in same) and s["proved"] and np.isclose(s["tol"], r["tol"] / 10)
            ]
            if r["dim"] == dim and r["proved"] and after:
                factors.append(after[0]["boxes"] / r["boxes"])
        if factors:
            mean = float(np.exp(np.mean(np.log(factors))))
            out[f"{dim}D"] = {"mean": mean, "smallest": min(factors), "largest": max(factors), "pairs": len(factors)}
    return out


# ---------------------------------------------------------------- designs


def designs(kept: dict, save, clock: Clock) -> None:
    """Every kept design at ±5 % on all load paths, and along the paths."""
    fronts = json.loads((results() / "designed_stabilisers.json").read_text())["fronts"]
    rows = kept.setdefault("designs", [])
    for name, designed in fronts.items():
        space = SPACES[name]
        for design in designed:
            row = next((r for r in rows if (r["design"], r["limit"]) == (name, design["limit"])), None)
            if row is None:
                row = {"design": name, "limit": design["limit"], "margin of the search": design["margin"]}
                rows.append(row | {"states": [], "paths": []})
                row = rows[-1]
            model, family = space({k: jnp.asarray(v) for k, v in design["parameters"].items()})
            jobs = [(path, a) for path in all_paths(space.dim) for a in (-0.05, 0.05)]
            for path, a in jobs[len(row["states"]) :]:
                if clock.late():
                    return
                F = np.asarray(pd.PATHS[path](a, model, family))
                begin = time.perf_counter()
                proof = pd.certify(model, family, F, 1e-2, 300_000)
                row["states"].append(
                    {
                        "path": path,
                        "a": a,
                        "verdict": proof.verdict,
                        "lower": proof.lower,
                        "upper": proof.upper,
                        "proved": proof.proved,
                        "missed": proof.missed,
                        "boxes": proof.boxes,
                        "seconds": time.perf_counter() - begin,
                    }
                )
                print(name, design["limit"], row["states"][-1], flush=True)
                save()
            row["proved margin"] = max(s["upper"] for s in row["states"])
            for path, a in jobs[len(row["paths"]) :]:
                if clock.late():
                    return
                begin = time.perf_counter()
                along = pd.certify_path(model, family, a, path, 300_000)
                row["paths"].append(
                    {
                        "path": path,
                        "a": a,
                        "verdict": along.verdict,
                        "stable to": along.stable_to,
                        "every load": along.continuous,
                        "unstable at": along.unstable_at,
                        "boxes": along.boxes,
                        "seconds": time.perf_counter() - begin,
                    }
                )
                print(name, design["limit"], row["paths"][-1], flush=True)
                save()
            row["stable at ±5 %"] = all(s["verdict"] == "stable" for s in row["states"])
            row["stable along all paths"] = all(p["verdict"] == "stable" for p in row["paths"])
            row["paths with every load"] = sorted({p["path"] for p in row["paths"] if p["every load"]})
            save()


# ---------------------------------------------------------------- picture


def draw(kept: dict) -> Figure:
    """Boxes of the random states, boxes against the tolerance, and the proved signs of the default map."""
    figure = Figure(figsize=(13, 4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    rows = kept.get("random", {}).get("rows", [])
    for i, (dim, N) in enumerate(((1, None), (2, None), (3, 2), (3, 3))):
        mine = [r for r in rows if r["dim"] == dim and N in (None, r["N"])]
        if mine:
            boxes = np.sort(np.concatenate([np.array(r["boxes"].split(), int) for r in mine]))
            label = f"{dim}D" + ("" if N is None else f", N = {N}") + f", {len(boxes)} states"
            left.plot(boxes, (np.arange(len(boxes)) + 1) / len(boxes), color=SERIES[i], label=label)
    if rows:
        left.set_xscale("log")
    left.set(xlabel="boxes of a proof, tol = 1e-2", ylabel="share of the random states [-]")
    left.legend(frameon=False, fontsize=7, loc="lower right")
    widest = {1: 3, 2: 3, 3: 2}
    for i, name in enumerate(MODELS):
        for dim, style in ((1, ":"), (2, "-"), (3, "--")):
            mine = [
                r
                for r in kept.get("cost", [])
                if (r["model"], r["dim"], r["N"]) == (name, dim, widest[dim]) and r["F"] == "1.02 I" and r["proved"]
            ]
            if not mine:
                continue
            middle.plot(
                [r["tol"] for r in mine],
                [r["boxes"] for r in mine],
                "o" + style,
                color=SERIES[i],
                ms=3,
                label=name if dim == 2 else None,
            )
    if kept.get("cost"):
        middle.set(xscale="log", yscale="log", ylim=(1, None))
    middle.set(xlabel="tol [-]", ylabel="boxes of a proof")
    middle.set_title("F = 1.02 I; dotted 1D, N = 3; full 2D, N = 3; dashed 3D, N = 2", fontsize=9)
    middle.invert_xaxis()
    middle.legend(frameon=False, fontsize=8, loc="lower center", ncols=2)
    if "map" in kept:
        signs = np.array([["sou".index(c) for c in row] for row in kept["map"]["signs"]])
        for i, (name, color) in enumerate((("stable", SERIES[0]), ("open", "black"), ("unstable", SERIES[1]))):
            shade = np.where(signs == i, 1.0, np.nan)
            right.contourf(
                np.linspace(-30, 30, signs.shape[1]),
                np.linspace(-2, 2, signs.shape[0]),
                np.nan_to_num(shade),
                levels=[0.5, 1.5],
                colors=[color],
                alpha=0.6,
            )
            right.plot([], [], "s", color=color, alpha=0.6, label=name)
        right.legend(fontsize=8, loc="upper right")
    right.set(xlabel="hydrostatic strain a [%]", ylabel="order m [-]", title="Seth–Hill, 2D, N = 3: proved signs")
    return figure


PARTS = {"random": random, "bodies": bodies, "map": default_map, "cost": cost, "designs": designs}


def main() -> None:
    """Compute the parts that are asked for and keep them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--part", choices=PARTS, nargs="*", default=list(PARTS))
    parser.add_argument("--seconds", type=float, default=np.inf, help="time after which every part ends")
    arguments = parser.parse_args()
    path = results() / f"{NAME}.json"
    kept = json.loads(path.read_text()) if path.exists() else {}

    def save() -> None:
        path.write_text(json.dumps(kept, indent=1) + "\n")

    for part in arguments.part:
        PARTS[part](kept, save, Clock(arguments.seconds))
    kept.pop("machine", None)
    write(NAME, kept, draw(kept))


if __name__ == "__main__":
    main()
