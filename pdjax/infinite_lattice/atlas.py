"""The atlas: a survey of all material models of the catalogue, on infinite lattices, along all load paths.

For each model on a family the atlas records the zero-energy waves of the lattice at rest, the error of the angular
frequency ω at kh = 1 along an axis relative to the classical law (wave number k, spacing h), the time of a force
evaluation per bond, and for each path and side

    a_cr     the critical load by the criterion "symbol": 0 if the lattice is unstable at once, infinite if no load up
             to the limit is unstable
    before   verdict of the loads between 0 and a_cr: "stable" or "marginal", or "unstable at once"

`pdjax.critical_load` finds a_cr. In 2D and 3D the grid of the Brillouin zone (`GRID`) is coarser than the default.
A critical load below 1e-4 counts as 0, because so close to rest the largest eigenvalue lies on a ridge that the search
can miss. The model "law" is the classical law itself (criterion "local"). It shows the critical loads of a model that
adds no instability to those of the law.
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
from .bloch import laplacian
from .brillouin import brillouin_zone, largest_eigenvalue, nudge
from .climb import climb
from .cosine_series import Series, entries, forms, on_grid, packed, reached
from .criteria import check_at_rest, family_zone, margin_tolerance
from .criteria.critical_load import LIMITS, critical_load, deformations
from .criteria.on_host import outcomes
from .lattice_states import checked_states, rings, symbol
from .paths import PATHS

LAW = "law"
BATCH, AT_ONCE = 16, 1e-4
SIDES = ("compression", "tension")
GRID = {1: 8, 2: 6, 3: 4}  # grid intervals of the zone for each spacing in the horizon; the search climbs from there
SAME = 0.02  # [π/h]; zeros that are closer are one zero
COST_POINTS = {1: (4096,), 2: (48, 48), 3: (14, 14, 14)}


@dataclass
class Atlas:
    """Survey of material models on infinite lattices, from `model_atlas`.

    Attributes
    ----------
    records : list of dict
        One record for each model, dimension and N (horizon divided by spacing), with the keys

        - "model", "dim", "N": name in `CATALOGUE` or "law", dimension, horizon divided by spacing,
        - "critical": {path: {side: [a_cr, before]}} with the critical load a_cr [-] and the verdict of the loads before
          it, "stable", "marginal" or "unstable at once", for the sides "compression" and "tension",
        - "zero": wave vectors [π/spacing] of the zero-energy waves at rest, the first 12, "zero_count": their number,
        - "dispersion": ω/ω_classical − 1 [-] at kh = 1 along an axis, longitudinal and (not in 1D) transverse,
        - "cost": time of a force evaluation per bond [s], if it was measured,
        - "refused": the reason, if the model is not defined on this family. The other keys from "critical" on are then
          absent.

        The record of "law", the classical law, has only the key "critical" in addition to the first three.
    settings : dict
        Text of the law ("law") and names of the load paths ("paths").

    Examples
    --------
    The classical law P = M s (s² − 1)/2 in 1D loses its stiffness at the stretch s = 3^(−½), a = −0.4226. The
    correspondence model ("Silling") has zero-energy waves, so its states before this load are marginal.

    >>> atlas = pd.model_atlas(["Silling"], dims=(1,), N=(2,), cost=False, show_progress=False)
    >>> [record["model"] for record in atlas.records]
    ['law', 'Silling']
    >>> a_cr, before = atlas.find("Silling", 1, 2)["critical"]["hydrostatic"]["compression"]
    >>> round(a_cr, 4), before
    (-0.4226, 'marginal')
    """

    records: list[dict] = field(default_factory=list)
    settings: dict = field(default_factory=dict)

    def save(self, path: str | os.PathLike) -> FilePath:
        """Write the atlas to a JSON file. A write that fails leaves an earlier file unchanged.

        Parameters
        ----------
        path : str or path
            Name of the file.

        Returns
        -------
        path
            The file written.

        Raises
        ------
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pd.Atlas(settings={"paths": ["hydrostatic"]}).save(folder + "/atlas.json")
        ...     pd.Atlas.load(path).settings
        {'paths': ['hydrostatic']}
        """
        with written_whole(path) as stream:
            text = json.dumps({"settings": self.settings, "records": self.records}, ensure_ascii=False, indent=1)
            stream.write(text.encode())
        return FilePath(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> "Atlas":
        """Read an atlas from a JSON file that `save` has written.

        Parameters
        ----------
        path : str or path
            Name of the file.

        Returns
        -------
        Atlas
            The atlas.

        Raises
        ------
        ValueError
            If the file does not hold an atlas, or is damaged.
        OSError
            If the file cannot be read.
        """
        try:
            read = json.loads(FilePath(path).read_text())
            return cls(read["records"], read["settings"])
        except (json.JSONDecodeError, KeyError, UnicodeDecodeError) as error:
            raise ValueError(f"{path} is not an atlas of pdjax, or it is damaged: {error}") from None

    def find(self, model: str, dim: int, N: float) -> dict | None:
        """Find the record of one model on one family.

        Parameters
        ----------
        model : str
            Name of the model in `CATALOGUE`, or "law".
        dim : int
            Dimension.
        N : float
            Horizon divided by spacing [-].

        Returns
        -------
        dict or None
            The record, see `Atlas`. It is None if the atlas has no such record.

        Examples
        --------
        >>> pd.Atlas([{"model": "LPS", "dim": 2, "N": 3.0, "zero_count": 0}]).find("LPS", 2, 3)["zero_count"]
        0
        """
        return next((r for r in self.records if (r["model"], r["dim"], r["N"]) == (model, dim, float(N))), None)


def critical(
    model: AbstractModel, family: LatticeFamily, path, side: str, criterion: str = "symbol"
) -> tuple[float, str]:
    """(a_cr, verdict of the states before it) along one path and side: `critical_load` on the grid of the atlas."""
    sign = sign_of(side)
    intervals = GRID[family.dim] * int(family.reach)
    edge = float(critical_load(model, family, path, criterion, side, resolution=intervals))
    if abs(edge) <= AT_ONCE:
        return 0.0, "unstable at once"
    sizes = min(abs(edge), LIMITS[sign]) * np.arange(1, BATCH) / BATCH
    F = computed_in_double(deformations, path, sign * sizes, model, family)
    out = outcomes(criterion, model, family, F, family_zone(family, "inversion", intervals))
    margin, tolerance = out.margin, margin_tolerance(family.xi.dtype, out.scale)
    there = np.isfinite(margin)  # a load without a state has no verdict
    return edge, "marginal" if there.any() and (np.abs(margin) <= tolerance)[there].all() else "stable"


@partial(jax.jit, static_argnums=(1, 2, 3, 4, 5))
def _zero_search(blocks: Array, dim: int, bonds: int, rings: int, intervals: int, symmetry: str):
    """(wave vectors [1/spacing], quotients λ/κ²) of one series: best grid points, then the maxima found from them."""
    offsets, zone = reached(dim, bonds, rings), brillouin_zone(dim, intervals, symmetry)
    grid = jnp.asarray(zone.grid, blocks.dtype)
    values = on_grid(blocks, offsets, list(zone.axes)).reshape(blocks.shape[1], -1)[:, zone.places]
    screen = largest_eigenvalue(entries(values, dim)) / laplacian(grid)
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
    """Find the wave vectors at which the infinite lattice at rest has zero stiffness.

    λ_max(k)/κ² = 0 to rounding, with the largest eigenvalue λ_max of the symbol and κ² = Σ_i (2 sin(k_i h/2)/h)²

    Parameters
    ----------
    model : AbstractModel
        The material model.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.

    Returns
    -------
    array, shape (waves, dim)
        Wave vectors [π/spacing], rounded to 3 digits, one of each set of wave vectors that are equal by symmetry of the
        lattice. The array is empty if no such wave is found.

    Raises
    ------
    ValueError
        If the model is not defined on this family.

    Notes
    -----
    The search starts from the 64 best points of a grid of the Brillouin zone. It can miss waves if there are more.
    The limit k → 0 is not a zero-energy wave and is left out.

    Examples
    --------
    The correspondence model in 1D with N = 2 has the zeros of Σ ξ sin kξ = sin k + 2 sin 2k (spacing 1). They are
    k = arccos(−1/4) = 0.58 π and k = π.

    >>> pd.zero_energy_waves(pd.Correspondence(pd.LinearElastic(1.0, 1.0)), pd.lattice_family(1, 2)).tolist()
    [[0.58], [1.0]]
    """
    symmetry = "cubic" if family.cubic and model.isotropic else "inversion"
    states = checked_states(model, family, np.eye(family.dim)[None])
    settings = family.dim, len(family.influence), rings(model), GRID[family.dim] * family.reach, symmetry
    points, values = computed_in_double(_zero_search, packed(states.scaled[0]), *settings)
    tolerance = 100 * float(margin_tolerance(points.dtype))
    found = points[np.abs(values) <= tolerance] / np.pi
    found = found - 2 * np.round(found / 2)
    found = found[np.linalg.norm(found, axis=1) > 0.05]  # the limit k → 0 is no zero-energy wave
    if symmetry == "cubic":
        folded = -np.sort(-np.abs(found), axis=1)
    else:  # k and −k are the same wave
        sign = np.sign(found[np.arange(len(found)), np.argmax(np.abs(found) > 1e-6, axis=1)])
        folded = found * sign[:, None]
    corner = np.abs(folded - np.round(folded)).max(axis=1, initial=0.0) < SAME
    folded = np.round(np.where(corner[:, None], np.round(folded), folded), 3)
    waves: list[np.ndarray] = []
    for wave in np.unique(folded, axis=0):  # λ is flat near a zero, so one zero is found at slightly different k
        if all(np.abs(wave - other).max() > SAME for other in waves):
            waves.append(wave)
    return np.array(waves).reshape(-1, family.dim)


def dispersion_error(model: AbstractModel, family: LatticeFamily, law: LinearElastic) -> list[float]:
    """ω/ω_classical − 1 at rest for kh = 1 along an axis: longitudinal, and transverse if dim > 1."""
    k = np.eye(family.dim)[0] / float(family.spacing)
    values = -np.diag(np.asarray(symbol(model, family, np.eye(family.dim), k))) * float(family.spacing) ** 2
    classical = [float(law.lam + 2 * law.mu), float(law.mu)][: min(family.dim, 2)]
    return [float(np.sqrt(max(v, 0.0) / c) - 1) for v, c in zip(values, classical, strict=False)]


def cost_per_bond(model: AbstractModel, dim: int, N: float, repeats: int = 5) -> float:
    """Median time of a force evaluation per bond [s] on a small periodic lattice, without the compilation."""
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


def _record(name: str, dim: int, N: float, law: LinearElastic, paths: Sequence[str]) -> dict:
    """The record of one model without its cost."""
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
    return record | {
        "zero": waves[:12].tolist(),
        "zero_count": len(waves),
        "dispersion": dispersion_error(model, family, law),
    }


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
    """Survey material models on infinite lattices: critical loads, zero-energy waves, dispersion and cost.

    Parameters
    ----------
    models : sequence of str, optional
        Names of models in `CATALOGUE`. The default is all of them. The classical law is always added as "law".
    dims : sequence of int, optional
        Dimensions of the lattices.
    N : sequence of float, optional
        Horizons divided by the spacing [-].
    law : LinearElastic, optional
        The law of all models. The default has λ = μ = 1.
    paths : sequence of str, optional
        Names of load paths in `PATHS`. In 1D only "hydrostatic" is used.
    cost : bool, optional
        Measure the time of a force evaluation.
    save : str or path, optional
        A JSON file that is written after every record. If the file exists and has the same law and paths, its records
        are kept. Only missing records are computed, and missing costs are measured if `cost` is True.
    show_progress : bool, optional
        Show the progress on the terminal.

    Returns
    -------
    Atlas
        One record for each model, dimension and N, see `Atlas`.

    Raises
    ------
    ValueError
        If the name of a model or of a path is unknown, or if the file `save` holds an atlas of another law or of other
        paths.
    OSError
        If the file `save` cannot be written.

    Notes
    -----
    Critical loads are searched up to a = −0.9 in compression and a = 1 in tension. A critical load below 1e-4 counts as
    0, "unstable at once". In 2D and 3D the grid of the Brillouin zone is coarser than the default of `critical_load`.

    Examples
    --------
    "Silling" is the correspondence model without a control. In 1D with N = 2 it has two zero-energy waves.

    >>> atlas = pd.model_atlas(["Silling"], dims=(1,), N=(2,), cost=False, show_progress=False)
    >>> atlas.find("Silling", 1, 2)["zero"]
    [[0.58], [1.0]]
    """
    names = list(CATALOGUE) if models is None else [model_name(name) for name in models]
    for name in paths:
        choice("path", name, list(PATHS))
    law = LinearElastic(lam=1.0, mu=1.0) if law is None else law  # type: ignore[call-arg, arg-type]
    result = Atlas(settings={"law": law_label(law), "paths": list(paths)})
    if save is not None and writable(save).exists() and FilePath(save).stat().st_size:
        result = Atlas.load(save)
        if result.settings != {"law": law_label(law), "paths": list(paths)}:
            raise ValueError(f"{save} holds an atlas of other settings, {result.settings}. Name another file")
    jobs = [(name, dim, n) for dim in dims for n in N for name in [LAW, *names]]
    for name, dim, n in progress(jobs, len(jobs), "atlas", show_progress):
        record = result.find(name, dim, n)
        if missing := record is None:
            record = _record(name, dim, n, law, ["hydrostatic"] if dim == 1 else list(paths))
            result.records.append(record)
        if measured := cost and name != LAW and not {"cost", "refused"} & record.keys():
            record["cost"] = cost_per_bond(CATALOGUE[name](law, lattice_family(dim, n)), dim, n)
        if save is not None and (missing or measured):
            result.save(save)
    return result
