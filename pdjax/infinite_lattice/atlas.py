"""The atlas: every model of the table, on every lattice, along every load path, by the symbol.

For a model on a family: the waves that cost nothing at rest, the error of ω at kh = 1 along an axis beside the
classical law, the time of a force evaluation for a bond, and for each path and side

    a_cr     the edge of the unstable set: 0 unstable at once, inf not within the limit
    before   "stable" or "marginal": what the loads are that come before it

The margins of a batch of states serve all paths: loads are sampled in batches until one is unstable, then the bracket
is split three times into 16 and closed by the secant: a_cr to 1e-5 of the range at worst; `pdjax.critical_load` gives
all digits. An edge below 1e-4 counts as 0: so near to rest the worst wave sits on a ridge that a search can miss. The
row "law" is the classical law itself (criterion "local"): what a model that adds no instability of its own has.
"""

import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path as FilePath

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._internal.checks import choice, computed_in_double, sign_of, writable, written_whole
from .._internal.progress import progress
from .._internal.public import public_function
from ..force.operator import force_operator
from ..geometry import neighbour_search
from ..geometry.bonds import LatticeFamily, lattice_family
from ..geometry.points import lattice
from ..models.base import AbstractModel
from ..models.catalogue import CATALOGUE, model_name
from ..models.correspondence import Correspondence
from ..models.laws import LinearElastic, law_label
from .brillouin import brillouin_zone, largest_eigenvalue, nudge
from .climb import climb
from .cosine_series import Series, entries, forms, on_grid, packed, reached
from .criteria import check_at_rest, family_zone, margin_tolerance
from .criteria.critical_load import critical_load, deformations
from .criteria.on_host import outcomes
from .lattice_states import checked_states, rings, symbol
from .paths import PATHS

LAW = "law"
BATCH, AT_ONCE = 16, 1e-4
LIMITS = {"compression": 0.9, "tension": 1.0}
SIDES = tuple(LIMITS)
GRID = {1: 8, 2: 6, 3: 4}  # intervals of the zone for each spacing of the horizon; the climb from it does the rest
SAME = 0.02  # [π/h]
COST_POINTS = {1: (4096,), 2: (48, 48), 3: (14, 14, 14)}


@dataclass
class Atlas:
    """One record for each (model, dim, N): `zero` (waves, dim) [π/h], `zero_count`, `dispersion` ω/ω_classical − 1
    longitudinal and transverse, `cost` [s/bond], `critical` {path: {side: (a_cr, before)}}, or `refused`, why not."""

    records: list[dict] = field(default_factory=list)
    settings: dict = field(default_factory=dict)

    def save(self, path: str | os.PathLike) -> FilePath:
        """Write a JSON file, all of it or nothing."""
        with written_whole(path) as stream:
            text = json.dumps({"settings": self.settings, "records": self.records}, ensure_ascii=False, indent=1)
            stream.write(text.encode())
        return FilePath(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> "Atlas":
        """Read what `save` wrote."""
        try:
            read = json.loads(FilePath(path).read_text())
            return cls(read["records"], read["settings"])
        except (json.JSONDecodeError, KeyError, UnicodeDecodeError) as error:
            raise ValueError(f"{path} is not an atlas of pdjax, or is damaged: {error}") from None

    def find(self, model: str, dim: int, N: float) -> dict | None:
        """The record of one model on one family."""
        return next((r for r in self.records if (r["model"], r["dim"], r["N"]) == (model, dim, float(N))), None)


def critical(
    model: AbstractModel, family: LatticeFamily, path, side: str, criterion: str = "symbol"
) -> tuple[float, str]:
    """(a_cr, what the states before it are) along one path and side: `critical_load` on the atlas's grid."""
    limit = LIMITS[side]
    law_family = path is not PATHS["uniaxial-stress"] or criterion != "local"
    own = model if law_family else Correspondence(model.law)  # type: ignore[attr-defined]
    intervals = GRID[family.dim] * int(family.reach)
    edge = float(critical_load(own, family, path, criterion, side, limit, intervals))
    if abs(edge) <= AT_ONCE:
        return 0.0, "unstable at once"
    sizes = min(abs(edge), limit) * np.arange(1, BATCH) / BATCH
    F = computed_in_double(deformations, path, sign_of(side) * sizes, own, family)
    out = outcomes(criterion, own, family, F, family_zone(family, "inversion", intervals))
    margin, tolerance = out.margin, margin_tolerance(family.xi.dtype, out.scale)
    there = np.isfinite(margin)  # where there is no such state, there is no verdict
    return edge, "marginal" if there.any() and (np.abs(margin) <= tolerance)[there].all() else "stable"


@partial(jax.jit, static_argnums=(1, 2, 3, 4, 5))
def _zero_search(blocks: Array, dim: int, bonds: int, rings: int, intervals: int, symmetry: str):
    """(wave vectors [1/spacing], quotients) of one cosine series: the best grid points and where they climb to."""
    offsets, zone = reached(dim, bonds, rings), brillouin_zone(dim, intervals, symmetry)
    grid = jnp.asarray(zone.grid, blocks.dtype)
    values = on_grid(blocks, offsets, list(zone.axes)).reshape(blocks.shape[1], -1)[:, zone.places]
    screen = largest_eigenvalue(entries(values, dim)) / jnp.sum(4 * jnp.sin(grid / 2) ** 2, axis=1)
    count = min(len(zone.grid), 64)
    chosen = jnp.argsort(-screen)[:count]
    starts = grid[chosen][None]
    sums, wave = Series.of(blocks[None], offsets), np.zeros(count, bool)
    begin = starts + 0.3 * jnp.asarray(nudge(dim, zone.step), blocks.dtype)
    vectors = jnp.linalg.eigh(forms(sums, begin, wave, wave).A)[1][..., -1]
    climbed, _, quotients = climb(lambda x: forms(sums, x, wave, wave), begin, vectors, zone.step)
    return jnp.concatenate([starts, climbed], axis=1)[0], jnp.concatenate([screen[chosen], quotients[0]])


@public_function
def zero_energy_waves(model: AbstractModel, family: LatticeFamily) -> np.ndarray:
    """Wave vectors (waves, dim) [π/h] at which the resting lattice resists nothing, one of each set that its symmetry
    makes the same: as far as a search from 64 starts finds them."""
    symmetry = "cubic" if family.cubic and model.isotropic else "inversion"
    states = checked_states(model, family, np.eye(family.dim)[None])
    settings = family.dim, len(family.influence), rings(model), GRID[family.dim] * family.reach, symmetry
    points, values = computed_in_double(_zero_search, packed(states.scaled[0]), *settings)
    tolerance = 100 * float(margin_tolerance(points.dtype))
    found = points[np.abs(values) <= tolerance] / np.pi
    found = found - 2 * np.round(found / 2)
    found = found[np.linalg.norm(found, axis=1) > 0.05]  # k → 0 is no mode
    if symmetry == "cubic":
        folded = -np.sort(-np.abs(found), axis=1)
    else:  # a wave and its mirror image are one
        sign = np.sign(found[np.arange(len(found)), np.argmax(np.abs(found) > 1e-6, axis=1)])
        folded = found * sign[:, None]
    corner = np.abs(folded - np.round(folded)).max(axis=1, initial=0.0) < SAME
    folded = np.round(np.where(corner[:, None], np.round(folded), folded), 3)
    waves: list[np.ndarray] = []
    for wave in np.unique(folded, axis=0):  # λ is flat by a zero: what is near is the same one
        if all(np.abs(wave - other).max() > SAME for other in waves):
            waves.append(wave)
    return np.array(waves).reshape(-1, family.dim)


def dispersion_error(model: AbstractModel, family: LatticeFamily, law: LinearElastic) -> list[float]:
    """ω/ω_classical − 1 at rest, kh = 1 along an axis: longitudinal, and transverse if dim > 1."""
    k = np.eye(family.dim)[0] / float(family.spacing)
    values = -np.diag(np.asarray(symbol(model, family, np.eye(family.dim), k))) * float(family.spacing) ** 2
    classical = [float(law.lam + 2 * law.mu), float(law.mu)][: min(family.dim, 2)]
    return [float(np.sqrt(max(v, 0.0) / c) - 1) for v, c in zip(values, classical, strict=False)]


def cost_per_bond(model: AbstractModel, dim: int, N: float, repeats: int = 5) -> float:
    """Median time of a force evaluation over its bonds [s], on a small periodic lattice, compiled before."""
    families = neighbour_search.families(lattice(COST_POINTS[dim], periodic=True), N)
    u = jnp.asarray(1e-3 * np.random.default_rng(0).normal(size=(len(families), dim)))
    force = force_operator(model, families)
    force(u).block_until_ready()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        force(u).block_until_ready()
        times.append(time.perf_counter() - start)
    return float(np.median(times)) / float(families.count.sum())


def _record(name: str, dim: int, N: float, law: LinearElastic, paths: Sequence[str], cost: bool) -> dict:
    family = lattice_family(dim, N)
    record: dict = {"model": name, "dim": dim, "N": float(N)}
    criterion = "local" if name == LAW else "symbol"
    try:
        model = Correspondence(law) if name == LAW else CATALOGUE[name](law, family)
        check_at_rest(model, family)
    except ValueError as error:
        return record | {"refused": str(error)}
    record["critical"] = {
        path: {side: list(critical(model, family, PATHS[path], side, criterion)) for side in SIDES} for path in paths
    }
    if name == LAW:
        return record
    waves = zero_energy_waves(model, family)
    record |= {
        "zero": waves[:12].tolist(),
        "zero_count": len(waves),
        "dispersion": dispersion_error(model, family, law),
    }
    return record | ({"cost": cost_per_bond(model, dim, N)} if cost else {})


@public_function
def model_atlas(
    models: Sequence[str] | None = None,
    dims: Sequence[int] = (1, 2),
    N: Sequence[float] = (3,),
    law: LinearElastic | None = None,
    paths: Sequence[str] = tuple(PATHS),
    cost: bool = True,
    save: str | os.PathLike | None = None,
    show_progress: bool = True,
) -> Atlas:
    """Survey models on infinite lattices (see the module).

    Arguments: models: names from `CATALOGUE`, all by default (and the law itself); dims; N horizons over spacing; law
        linear (default λ = μ = 1); paths: names from `PATHS` (1D has but one); save: a JSON file kept up to date, and
        gone on with if it is there and of the same settings.
    Raises: ValueError for an unknown name, a file of other settings; OSError where it can't be written.
    """
    names = list(CATALOGUE) if models is None else [model_name(name) for name in models]
    for name in paths:
        choice("path", name, list(PATHS))
    law = LinearElastic(lam=1.0, mu=1.0) if law is None else law  # type: ignore
    result = Atlas(settings={"law": law_label(law), "paths": list(paths)})
    if save is not None and writable(save).exists() and FilePath(save).stat().st_size:
        result = Atlas.load(save)
        if result.settings != {"law": law_label(law), "paths": list(paths)}:
            raise ValueError(f"{save} holds an atlas of other settings, {result.settings}; name another file")
    jobs = [(name, dim, n) for dim in dims for n in N for name in [LAW, *names]]
    for name, dim, n in progress(jobs, len(jobs), "atlas", show_progress):
        if result.find(name, dim, n) is None:
            mine = ["hydrostatic"] if dim == 1 else list(paths)
            result.records.append(_record(name, dim, n, law, mine, cost))
            if save is not None:
                result.save(save)
    return result
