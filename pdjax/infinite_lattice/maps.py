"""Sweeps of stability over (m, a, N): the margin of every state of a grid, in chunks of bounded memory.

One compiled kernel evaluates a chunk of (m, a) pairs for the main criterion and for every criterion whose line is
drawn; the host traversals over the chunks, so memory grows with the answer, and stops leave what is done.
"""

import inspect
import json
import os
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Float

from .._internal.checks import as_real, choice, computed_in_double, finite, writable, written_whole
from .._internal.progress import progress
from .._internal.public import public_function
from .._internal.xla import ONCE, QUICK, compiled_with
from ..force.backends.slabs import device_mesh, sharded_vmap
from ..force.fields import check_model
from ..geometry.bonds import LatticeFamily, lattice_family
from ..geometry.influence import constant_influence
from ..models.base import AbstractModel
from ..models.laws import Law, law_label
from ..models.seth_hill import SethHill
from .bloch import homogeneous_tangent
from .brillouin import Zone, brillouin_zone
from .cosine_series import series
from .criteria import CRITERIA, evaluate, family_zone, margin_tolerance, verdicts
from .criteria.critical_load import deformations
from .criteria.on_host import FROM_STATES, MANY, from_states
from .lattice_states import States, check_modulus, has_series, modulus_of, offsets_of, resting_modulus
from .paths import Path, check_stretch, hydrostatic, path_symmetry

_SAVE_EVERY = 30.0  # seconds between partial saves
_CHUNK_BYTES = 2**23  # of screened symbols at once: what the caches hold
_ARRAYS = ("m", "a", "N", "margin", "eigenvalue", "tolerance", "line_m", "line_a")
_LINE_POINTS = 64


@dataclass(frozen=True)
class StabilityMap:
    """Margins over orders m and loads a (and horizons N, if several were asked for).

    m (orders,), a (loads,) [-]; margin, eigenvalue, tolerance (orders, loads), or (horizons, orders, loads);
    lines: the margins of other criteria over line_m and line_a, the same grid thinned to at most 64 along an axis,
    plenty for a contour; settings: everything needed to compute it again.
    """

    m: np.ndarray
    a: np.ndarray
    N: np.ndarray
    margin: Float[np.ndarray, "*grid"]
    eigenvalue: Float[np.ndarray, "*grid"]
    tolerance: Float[np.ndarray, "*grid"]
    line_m: np.ndarray
    line_a: np.ndarray
    lines: dict[str, np.ndarray] = field(default_factory=dict)
    settings: dict = field(default_factory=dict)

    @property
    def verdict(self) -> np.ndarray:
        """ "stable", "marginal", "unstable", or "undefined" (no such state) at every point of the grid."""
        return verdicts(self.margin, self.tolerance)

    def save(self, path: str | os.PathLike) -> FilePath:
        """Write everything to an .npz, all of it or nothing; returns the path."""
        arrays = {f"line_{name}": values for name, values in self.lines.items()}
        with written_whole(path) as stream:
            np.savez_compressed(
                stream,
                **{name: getattr(self, name) for name in _ARRAYS},
                settings=json.dumps(self.settings),
                **arrays,  # type: ignore[arg-type]
            )
        return FilePath(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> "StabilityMap":
        """Read what `save` wrote.  Raises: FileNotFoundError; ValueError for any other file."""
        path = FilePath(path)
        if not path.exists():
            raise FileNotFoundError(f"no map at {path}")
        try:
            with np.load(path, allow_pickle=False) as file:
                lines = {
                    name[5:]: file[name] for name in file.files if name.startswith("line_") and name not in _ARRAYS
                }
                settings = json.loads(str(file["settings"]))
                return cls(**{name: file[name] for name in _ARRAYS}, lines=lines, settings=settings)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, EOFError) as error:
            raise ValueError(f"{path} is not a map that StabilityMap.save wrote, or is damaged: {error}") from None


def _free_memory() -> float:
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return np.inf


class _SethHillOf(eqx.Module):
    """m → SethHill(m, law), the law's constants traced."""

    law: Law

    def __call__(self, m) -> SethHill:
        return SethHill(m, self.law)


def _chunk(m, a, family, make, path: Path, names: tuple[str, ...], intervals: int, symmetry: str, mesh: Mesh | None):
    """(margin, eigenvalue, tolerance) of every named criterion, for pairs (m, a)."""
    zone = brillouin_zone(family.dim, intervals, symmetry)

    def one(m, a):
        model = make(m)
        F = path(a, model, family)
        outs = [evaluate(name, model, family, F, zone, fastest=True) for name in names]
        return [(o.margin, o.eigenvalue, jnp.asarray(margin_tolerance(m.dtype, o.scale), m.dtype)) for o in outs]

    return (jax.vmap(one) if mesh is None else sharded_vmap(one, mesh))(m, a)


_few_states, _many_states = (compiled_with(options)(_chunk) for options in (ONCE, QUICK))
_FEW = _LINE_POINTS**2  # up to which compiling takes longer than running


@eqx.filter_jit
def _linearised_chunk(m, a, at_rest, family, make, path: Path):
    """The cosine series of every pair (m, a), or of the resting state of every m."""

    def one(m, a):
        model = make(m)
        F = jnp.where(at_rest, jnp.eye(family.dim, dtype=m.dtype), path(a, model, family))
        return series(homogeneous_tangent(model, family, F), family.dim, len(family.influence))

    return jax.vmap(one)(m, a)


def _from_series(model: AbstractModel, names: tuple[str, ...], mesh: Mesh | None) -> tuple[str, ...]:
    """The criteria that the linearised states are enough for."""
    if mesh is not None or not has_series(model):
        return ()
    return tuple(n for n in names if n in FROM_STATES and (n != "symbol" or model.hyperelastic))


def _evaluated(job: "_Job", make: Callable, path: Path, mesh: Mesh | None) -> list[tuple]:
    """(margin, eigenvalue, tolerance) of the job's criteria: from the linearised states where that is enough, so that
    the search is the program that all models share; the rest, and all on many devices, in one program."""
    family, zone, model = job.family, job.zone, make(job.m[0])
    found: dict[str, Any] = {}
    able = _from_series(model, job.names, mesh)
    if able:
        blocks = computed_in_double(_linearised_chunk, job.m, job.a, np.asarray(False), family, make, path)
        states = States(blocks, offsets_of(model, family), job.modulus, float(family.spacing))
        found = {name: from_states(name, model, family, states, zone) for name in able}
        found = {n: (o.margin, o.eigenvalue, margin_tolerance(job.m.dtype, o.scale)) for n, o in found.items()}
    rest = tuple(n for n in job.names if n not in found)
    if rest:
        chunk = _few_states if job.out.shape[-1] <= _FEW else _many_states
        traced = chunk(job.m, job.a, family, make, path, rest, zone.intervals, zone.symmetry, mesh)
        found |= dict(zip(rest, traced, strict=True))
    return [found[name] for name in job.names]


def _check_loads(a: np.ndarray, model: AbstractModel, family, path: Path) -> None:
    """Refuse loads whose deformation is not one: a stretch 1 + a ≤ 0, or det F ≤ 0 on a user's path."""
    if getattr(path, "stretch", False):
        check_stretch(a)
    det = np.linalg.det(computed_in_double(deformations, path, np.asarray(a, float), model, family))
    if (det <= 0).any():
        i = int(np.argmax(det <= 0))
        raise ValueError(f"a must keep det F > 0 along the path; a[{i}] = {a[i]:g} gives det F = {det[i]:g}")


def _check_memory(shape: tuple[int, ...], criteria: int) -> None:
    """Refuse a map whose results would fill more than half of the free memory."""
    need, free = 8.0 * np.prod(shape, dtype=float) * (2 + criteria) * 2, _free_memory()
    if need > 0.5 * free:
        raise ValueError(
            f"a map of {shape} states needs {need / 2**30:.1f} GiB and {free / 2**30:.1f} GiB are free; take fewer"
            " m, a or N, or fewer lines"
        )


def _moduli(make: Callable, orders: np.ndarray, family: LatticeFamily, path: Path, size: int) -> np.ndarray:
    """The checked P-wave modulus of every order, by the program that linearises the chunks."""
    orders = orders[:1] if isinstance(make, _SethHillOf) else orders  # at rest its order changes nothing
    models = [make(as_real(m)) for m in orders]
    for model in models:
        check_model(model, family, LatticeFamily)
    if not has_series(models[0]):
        return np.array([resting_modulus(model, family) for model in models])
    offsets, values = offsets_of(models[0], family), np.empty(len(orders))
    for start in range(0, len(orders), size):
        index = np.minimum(np.arange(start, start + size), len(orders) - 1)
        m = orders[index].astype(family.xi.dtype)
        blocks = computed_in_double(_linearised_chunk, m, np.zeros_like(m), np.asarray(True), family, make, path)
        values[index] = modulus_of(blocks, offsets, float(family.spacing))
    for model, value in zip(models, values, strict=True):
        check_modulus(model, value)
    return values


def _first_model(make: Callable, orders: np.ndarray) -> AbstractModel:
    first = make(as_real(orders[0]))
    if not isinstance(first, AbstractModel):
        raise ValueError(f"model must be a function m -> pdjax model; it gave {type(first).__name__}")
    return first


def _axis(name: str, values) -> np.ndarray:
    """One axis of the map, checked."""
    axis = finite(name, values)
    if axis.ndim != 1 or axis.size == 0:
        raise ValueError(f"{name} must be a one-dimensional array with at least one entry; got {axis.shape}")
    return axis


def _parameter(make: Callable) -> str:
    """What a function of one parameter calls it."""
    try:
        return next(iter(inspect.signature(make).parameters))
    except (TypeError, ValueError, StopIteration):
        return "parameter"


def _thin(x: np.ndarray) -> np.ndarray:
    return np.linspace(0, len(x) - 1, min(len(x), _LINE_POINTS)).round().astype(int)


@public_function
def stability_map(
    m,
    a,
    N: float | Sequence[float] = 3,
    dim: int = 2,
    law: Law | None = None,
    model: Callable | None = None,
    path: Path = hydrostatic,
    criterion: str = "symbol",
    lines: Sequence[str] = (),
    influence: Callable | str = constant_influence,
    resolution: int | None = None,
    save: str | os.PathLike | None = None,
    show_progress: bool = True,
    mesh: Mesh | None = None,
) -> StabilityMap:
    """Margins over orders m and loads a along a path, on infinite lattices: of the Seth–Hill model, or of any model.

    Arguments: m (orders,), a (loads,) [-]; N horizon(s) over spacing [-]; law in E of the Seth–Hill model, or `model`,
        a function m → model of one parameter, called m whatever it is (strength, modulus, order); `lines`: further
        criteria to evaluate on the same grid, thinned to 64 along an axis; resolution as in `stability`; save: an .npz
        path, checked before and kept up to date during a long run (states not reached yet are NaN, "undefined");
        mesh: a `jax.sharding.Mesh`, to share every chunk of states between the devices of its first axis.
    Returns: `StabilityMap`: .margin and .eigenvalue (orders, loads), with a leading axis if N is a sequence.
    Raises: ValueError for NaN, empty m or a, det F ≤ 0, a singular family, a map too large for memory;
        OSError for a path that can't be written.
    """
    if (law is None) == (model is None):
        raise ValueError(
            "a law is needed, such as pd.LinearElastic(lam=1.0, mu=1.0), or a model, a function of m; not both"
        )
    make: Callable = _SethHillOf(law) if model is None else model  # type: ignore[arg-type]
    orders, loads = _axis("m", m), _axis("a", a)
    horizons = np.atleast_1d(finite("N", N))
    names = tuple(choice("criterion", c, list(CRITERIA)) for c in (criterion, *lines))
    shape = (len(horizons), len(orders), len(loads))
    _check_memory(shape, len(names))
    devices = 1 if mesh is None else device_mesh(mesh)[2]
    target = None if save is None else writable(save)

    families = [lattice_family(dim, float(n), influence=influence) for n in horizons]
    first = _first_model(make, orders)
    zones = [family_zone(family, path_symmetry(path, family, first.isotropic), resolution) for family in families]
    settings = {
        "dim": dim,
        "N": horizons.tolist(),
        "model": "SethHill by order" if model is None else type(first).__name__,
        "parameter": "m" if model is None else _parameter(model),
        "law": law_label(law) if law is not None else type(first).__name__,
        "path": getattr(path, "__name__", repr(path)),
        "criterion": criterion,
        "influence": getattr(influence, "__name__", repr(influence)),
        "resolution": [zone.intervals for zone in zones],
        "dtype": str(families[0].xi.dtype),
    }
    thin_m, thin_a = orders[_thin(orders)], loads[_thin(loads)]
    results = np.full((3, *shape), np.nan)
    extra = np.full((len(lines), len(horizons), len(thin_m), len(thin_a)), np.nan)

    def result() -> StabilityMap:
        margin, eigenvalue, tolerance = results if np.ndim(N) else results[:, 0]
        rest = dict(zip(names[1:], extra if np.ndim(N) else extra[:, 0], strict=True))
        return StabilityMap(orders, loads, horizons, margin, eigenvalue, tolerance, thin_m, thin_a, rest, settings)

    jobs = []
    for n, (family, zone) in enumerate(zip(families, zones, strict=True)):
        size = _chunk_size(zone, devices, len(orders) * len(loads))
        moduli = np.broadcast_to(_moduli(make, orders, family, path, size), orders.shape)
        _check_loads(loads, first, family, path)
        jobs += _jobs(family, zone, names[:1], orders, moduli, loads, size, results[:, n].reshape(3, 1, -1))
        if lines:
            thin = np.broadcast_to(moduli, orders.shape)[_thin(orders)]
            into = extra[:, n].reshape(1, len(lines), -1)
            jobs += _jobs(family, zone, names[1:], thin_m, thin, thin_a, min(size, into.shape[2]), into)
    saved = time.monotonic()
    for job in progress(jobs, len(jobs), f"{criterion} map", show_progress):
        _do(job, make, path, mesh)
        if target is not None and time.monotonic() - saved > _SAVE_EVERY:
            result().save(target)
            saved = time.monotonic()
    final = result()
    if target is not None:
        final.save(target)
    return final


class _Job(NamedTuple):
    """One chunk of the grid of one family: pairs (m, a), and where the results go."""

    family: LatticeFamily
    zone: Zone
    names: tuple[str, ...]
    m: np.ndarray
    modulus: np.ndarray
    a: np.ndarray
    where: np.ndarray
    out: np.ndarray


def _chunk_size(zone: Zone, devices: int, states: int) -> int:
    """States in a chunk: whole groups of states that climb together."""
    dim = zone.grid.shape[1]
    size = int(np.clip(_CHUNK_BYTES // (8 * len(zone.grid) * dim * (dim + 4)), 16, 4096))
    return min(max(size // MANY[dim] * MANY[dim], min(size, MANY[dim])) * devices, states)


def _jobs(family, zone: Zone, names: tuple[str, ...], orders, moduli, loads, size: int, out: np.ndarray) -> list:
    """The grid of one family in chunks of equal size."""
    m, a = (x.reshape(-1).astype(family.xi.dtype) for x in np.meshgrid(orders, loads, indexing="ij"))
    jobs = []
    for start in range(0, len(m), size):
        index = np.minimum(np.arange(start, start + size), len(m) - 1)  # the last chunk repeats its last state
        jobs.append(_Job(family, zone, names, m[index], moduli[index // len(loads)], a[index], index, out))
    return jobs


def _do(job: _Job, make: Callable, path: Path, mesh: Mesh | None) -> None:
    """Evaluate one chunk and put its results where they go."""
    for c, kinds in enumerate(_evaluated(job, make, path, mesh)):
        for kind in range(len(job.out)):
            job.out[kind, c, job.where] = np.asarray(kinds[kind])
