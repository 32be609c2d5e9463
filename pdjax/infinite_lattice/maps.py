"""Stability maps: the margin over a grid of orders m (or another model parameter), loads a and horizon ratios N.

The grid is evaluated in chunks of pairs (m, a), so that memory grows with the result only. A compiled program evaluates
one chunk for the main criterion, and for every further criterion whose zero line is drawn in the figure (`lines`). The
host loops over the chunks. A run that is stopped keeps the chunks that it has saved.
"""

import inspect
import json
import os
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import NamedTuple

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
from .criteria import CRITERIA, Outcome, evaluate, family_zone, margin_tolerance, verdicts
from .criteria.certified import check_budget, check_criterion, proved_signs
from .criteria.critical_load import deformations
from .criteria.on_host import FROM_STATES, MANY, from_states
from .lattice_states import States, check_modulus, has_series, modulus_of, offsets_of, resting_modulus
from .paths import Path, check_stretch, hydrostatic, is_stretch, named_path, path_symmetry

_SAVE_EVERY = 30.0  # seconds between partial saves
_CHUNK_BYTES = 2**23  # size of the screened symbols of one chunk, so that they fit in the caches
_ARRAYS = ("m", "a", "N", "margin", "eigenvalue", "tolerance", "line_m", "line_a")
_LINE_POINTS = 64
PROOF_BOXES = 20_000  # largest number of boxes of the proof of one state


@dataclass(frozen=True)
class StabilityMap:
    """Margins over orders m and loads a, the result of `stability_map`.

    The arrays of the grid have the shape (orders, loads), or (horizons, orders, loads) if `N` was a sequence.

    Attributes
    ----------
    m : array, shape (orders,)
        Orders m [-], or values of the parameter of `model`.
    a : array, shape (loads,)
        Loads a along the path [-].
    N : array, shape (horizons,)
        Horizon over spacing [-].
    margin : array
        Margin of every state [-], as in `stability`: positive is unstable, NaN is undefined.
    eigenvalue : array
        Eigenvalue of every state, as in `stability`.
    tolerance : array
        Margins between −tolerance and tolerance are zero to rounding.
    line_m, line_a : array
        Orders and loads of `lines`: those of `m` and `a`, thinned to at most 64 along each axis.
    lines : dict of str to array
        Margins of the further criteria on the grid of `line_m` and `line_a`.
    settings : dict
        The settings from which the map can be computed again.
    proof : array or None
        What is proved about every state, if a proof was asked for: −1 is stable, 1 is unstable, 0 is open.
    verdict : array of str
        The margins in words.

    Examples
    --------
    >>> law = pd.LinearElastic(1.0, 1.0)
    >>> grid = pd.stability_map([0.0, 1.0], [-0.02, 0.02], N=2, dim=1, law=law, show_progress=False)
    >>> grid.margin.shape, grid.verdict[1].tolist()
    ((2, 2), ['unstable', 'stable'])
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
    proof: np.ndarray | None = None

    @property
    def verdict(self) -> np.ndarray:
        """ "stable", "marginal" or "unstable" at every point of the grid, "undefined" if the margin is NaN."""
        return verdicts(self.margin, self.tolerance)

    def save(self, path: str | os.PathLike) -> FilePath:
        """Write the map to an .npz file.

        An interrupted write leaves no partial file.

        Parameters
        ----------
        path : str or path
            File to write.

        Returns
        -------
        pathlib.Path
            The path of the file.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        arrays = {f"line_{name}": values for name, values in self.lines.items()}
        if self.proof is not None:
            arrays["proof"] = self.proof
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
        """Read a map that `save` wrote.

        Parameters
        ----------
        path : str or path
            File to read.

        Returns
        -------
        StabilityMap
            The map with all its arrays and settings.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        ValueError
            If the file is damaged or is not a stability map.

        Examples
        --------
        >>> import tempfile
        >>> law = pd.LinearElastic(1.0, 1.0)
        >>> grid = pd.stability_map([0.0, 1.0], [-0.02, 0.02], N=2, dim=1, law=law, show_progress=False)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = pd.StabilityMap.load(grid.save(f"{folder}/map.npz"))
        >>> bool((again.margin == grid.margin).all())
        True
        """
        path = FilePath(path)
        if not path.exists():
            raise FileNotFoundError(f"no map at {path}")
        try:
            with np.load(path, allow_pickle=False) as file:
                lines = {
                    name[5:]: file[name] for name in file.files if name.startswith("line_") and name not in _ARRAYS
                }
                settings = json.loads(str(file["settings"]))
                proof = file["proof"] if "proof" in file.files else None
                return cls(**{name: file[name] for name in _ARRAYS}, lines=lines, settings=settings, proof=proof)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, EOFError) as error:
            raise ValueError(f"{path} is not a map that StabilityMap.save wrote, or is damaged: {error}") from None


def _check_proof(certify: float, criterion: str, model: AbstractModel, mesh: Mesh | None) -> None:
    """Raise ValueError if the signs of a map cannot be proved."""
    check_budget(certify)
    check_criterion(criterion)
    if not (model.hyperelastic and has_series(model)):
        raise ValueError(f"{type(model).__name__} has no energy or no symbol of one family, so no sign can be proved")
    if mesh is not None:
        raise ValueError("certify runs on one host; leave out mesh")


def _free_memory() -> float:
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return np.inf


class _SethHillOf(eqx.Module):
    """The function m → SethHill(m, law). The constants of the law are traced."""

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
_FEW = _LINE_POINTS**2  # Up to this number of states, compiling takes longer than running.


@eqx.filter_jit
def _linearised_chunk(m, a, at_rest, family, make, path: Path):
    """The cosine series of every pair (m, a), or of the undeformed state of every m if `at_rest` is True."""

    def one(m, a):
        model = make(m)
        F = jnp.where(at_rest, jnp.eye(family.dim, dtype=m.dtype), path(a, model, family))
        return series(homogeneous_tangent(model, family, F), family.dim, len(family.influence))

    return jax.vmap(one)(m, a)


def _from_series(model: AbstractModel, names: tuple[str, ...], mesh: Mesh | None) -> tuple[str, ...]:
    """The criteria that can be evaluated from the linearised states alone."""
    if mesh is not None or not has_series(model):
        return ()
    return tuple(n for n in names if n in FROM_STATES and (n != "symbol" or model.hyperelastic))


def _evaluated(job: "_Job", make: Callable, path: Path, mesh: Mesh | None) -> list[tuple]:
    """(margin, eigenvalue, tolerance) of the criteria of a job.

    Where the linearised states are enough, the search is a program that all models share. The other criteria, and all
    criteria on several devices, are evaluated in one program of the model.
    """
    family, zone, model = job.family, job.zone, make(job.m[0])
    found: dict[str, tuple] = {}
    able = _from_series(model, job.names, mesh)
    if able:
        blocks = computed_in_double(_linearised_chunk, job.m, job.a, np.asarray(False), family, make, path)
        states = States(blocks, offsets_of(model, family), job.modulus, float(family.spacing))
        out = {name: from_states(name, model, family, states, zone) for name in able}
        found = {
            n: (o.margin, o.eigenvalue, margin_tolerance(job.m.dtype, o.scale)) for n, o in out.items() if o is not None
        }
        main = out.get("symbol")
        if job.certify is not None and main is not None:
            found["symbol"] = _with_proof(job, job.certify, states, main, found["symbol"])
    rest = tuple(n for n in job.names if n not in found)
    if rest:
        chunk = _few_states if job.out.shape[-1] <= _FEW else _many_states
        traced = chunk(job.m, job.a, family, make, path, rest, zone.intervals, zone.symmetry, mesh)
        found |= dict(zip(rest, traced, strict=True))
    return [found[name] for name in job.names]


def _with_proof(job: "_Job", certify: float, states: States, out: Outcome, numbers: tuple) -> tuple:
    """(margin, eigenvalue, tolerance, proof) of a chunk. Only its last state may be repeated."""
    count = len(np.unique(job.where))
    at = tuple(np.asarray(part)[:count] for part in out.at)
    proof, margin = proved_signs(states.scaled[:count], states.offsets, at, certify, PROOF_BOXES)
    rest = (0, len(job.where) - count)
    _, eigenvalue, tolerance = numbers
    return np.pad(margin, rest, "edge"), eigenvalue, tolerance, np.pad(proof, rest, "edge")


def _check_loads(a: np.ndarray, model: AbstractModel, family, path: Path) -> None:
    """Raise ValueError for loads with a stretch 1 + a ≤ 0, or with det F ≤ 0 on a path of the user."""
    if is_stretch(path):
        check_stretch(a)
    det = np.linalg.det(computed_in_double(deformations, path, np.asarray(a, float), model, family))
    if (det <= 0).any():
        i = int(np.argmax(det <= 0))
        raise ValueError(f"a must keep det F > 0 along the path; a[{i}] = {a[i]:g} gives det F = {det[i]:g}")


def _check_memory(shape: tuple[int, ...], criteria: int) -> None:
    """Raise ValueError for a map whose results would fill more than half of the free memory."""
    need, free = 8.0 * np.prod(shape, dtype=float) * (2 + criteria) * 2, _free_memory()
    if need > 0.5 * free:
        raise ValueError(
            f"a map of {shape} states needs {need / 2**30:.1f} GiB, but only {free / 2**30:.1f} GiB are free; take"
            " fewer values of m, a or N, or fewer lines"
        )


def _moduli(make: Callable, orders: np.ndarray, family: LatticeFamily, path: Path, size: int) -> np.ndarray:
    """The checked P-wave modulus of every order, computed by the program that linearises the chunks."""
    orders = orders[:1] if isinstance(make, _SethHillOf) else orders  # The modulus at rest does not depend on m.
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
        raise ValueError(f"model must be a function m -> pdjax model; it returned {type(first).__name__}")
    return first


def _axis(name: str, values) -> np.ndarray:
    """One axis of the map as a checked array."""
    axis = finite(name, values)
    if axis.ndim != 1 or axis.size == 0:
        raise ValueError(f"{name} must be a one-dimensional array with at least one entry; got {axis.shape}")
    return axis


def _parameter(make: Callable) -> str:
    """The name of the parameter of a function of one parameter."""
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
    path: Path | str = hydrostatic,
    criterion: str = "symbol",
    lines: Sequence[str] = (),
    influence: Callable | str = constant_influence,
    resolution: int | None = None,
    save: str | os.PathLike | None = None,
    show_progress: bool = True,
    mesh: Mesh | None = None,
    certify: float | None = None,
) -> StabilityMap:
    """Compute stability margins over orders m and loads a, on infinite lattices.

    The model is a Seth–Hill model of order m, or any model that depends on one parameter.

    Parameters
    ----------
    m : array, shape (orders,)
        Orders m of the Seth–Hill model [-], or values of the parameter of `model`.
    a : array, shape (loads,)
        Loads a along the path [-].
    N : float or sequence of float, optional
        Horizon over spacing [-]. Several values give the results a leading axis.
    dim : int, optional
        Dimension of the lattice: 1, 2 or 3.
    law : Law, optional
        Law of the Seth–Hill model. Give either `law` or `model`.
    model : callable, optional
        Function m → model, where m stands for any one parameter (a strength, a modulus, an order).
    path : callable or str, optional
        Load path: a function (a, model, family) → F, such as `hydrostatic`, or a name in `PATHS`.
    criterion : str, optional
        Criterion of the map, see `stability`.
    lines : sequence of str, optional
        Further criteria, evaluated on the same grid thinned to at most 64 points along each axis. The figure draws
        their zero lines.
    influence : callable or str, optional
        Influence function ω(|ξ|, δ), or its name.
    resolution : int, optional
        Grid intervals of the Brillouin zone, see `stability`.
    save : str or path, optional
        File (.npz) for the result. A long run updates it while it computes. States that it has not reached are NaN.
    show_progress : bool, optional
        Whether to print the progress.
    mesh : jax.sharding.Mesh, optional
        Devices: every chunk of states is divided between the devices of the first axis.
    certify : float, optional
        Prove the sign of the margin of every state, for the criterion "symbol" (see `certify`). A state counts as
        proved stable if its margin is proved to be at most (1 − certify) times the one found. 1 asks for the sign alone
        and takes the least time. A proof ends after 20 000 boxes.

    Returns
    -------
    StabilityMap
        Margins, eigenvalues and verdicts, shape (orders, loads), with a leading axis if `N` is a sequence.

    Raises
    ------
    ValueError
        If both or none of `law` and `model` are given, if `m` or `a` is empty or not finite, if det F ≤ 0 at a load, if
        a family is too small for the model, or if the map does not fit in memory. Also if a proof is asked for another
        criterion than "symbol", of a model without an energy, or on several devices.
    OSError
        If the file `save` cannot be written. This is checked before the computation.

    Examples
    --------
    In 1D with N = 2, m = 0 is stable in compression only and m = 1 in tension only.

    >>> law = pd.LinearElastic(1.0, 1.0)
    >>> grid = pd.stability_map([0.0, 1.0], [-0.02, 0.02], N=2, dim=1, law=law, show_progress=False)
    >>> grid.verdict.tolist()
    [['stable', 'unstable'], ['unstable', 'stable']]
    """
    if law is not None and model is None:
        make: Callable = _SethHillOf(law)
    elif law is None and model is not None:
        make = model
    else:
        raise ValueError(
            "a law is needed, such as pd.LinearElastic(lam=1.0, mu=1.0), or a model, which is a function m -> pdjax"
            " model, but not both"
        )
    path = named_path(path)
    orders, loads = _axis("m", m), _axis("a", a)
    horizons = np.atleast_1d(finite("N", N))
    names = tuple(choice("criterion", c, list(CRITERIA)) for c in (criterion, *lines))
    shape = (len(horizons), len(orders), len(loads))
    _check_memory(shape, len(names))
    devices = 1 if mesh is None else device_mesh(mesh)[2]
    target = None if save is None else writable(save)

    families = [lattice_family(dim, float(n), influence=influence) for n in horizons]
    first = _first_model(make, orders)
    if certify is not None:
        _check_proof(certify, criterion, first, mesh)
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
    results = np.full((3 if certify is None else 4, *shape), np.nan)
    extra = np.full((len(lines), len(horizons), len(thin_m), len(thin_a)), np.nan)

    def result() -> StabilityMap:
        margin, eigenvalue, tolerance, *proof = results if np.ndim(N) else results[:, 0]
        rest = dict(zip(names[1:], extra if np.ndim(N) else extra[:, 0], strict=True))
        proved = np.nan_to_num(proof[0]).astype(np.int8) if proof else None
        arrays = orders, loads, horizons, margin, eigenvalue, tolerance, thin_m, thin_a
        return StabilityMap(*arrays, rest, settings, proved)

    jobs = []
    for n, (family, zone) in enumerate(zip(families, zones, strict=True)):
        size = _chunk_size(zone, devices, len(orders) * len(loads))
        moduli = np.broadcast_to(_moduli(make, orders, family, path, size), orders.shape)
        _check_loads(loads, first, family, path)
        main = results[:, n].reshape(len(results), 1, -1)
        jobs += _jobs(family, zone, names[:1], orders, moduli, loads, size, main, certify)
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
    """One chunk of the grid of one family: pairs (m, a), and the arrays and indices at which the results are stored."""

    family: LatticeFamily
    zone: Zone
    names: tuple[str, ...]
    m: np.ndarray
    modulus: np.ndarray
    a: np.ndarray
    where: np.ndarray
    out: np.ndarray
    certify: float | None = None


def _chunk_size(zone: Zone, devices: int, states: int) -> int:
    """The number of states of a chunk: a multiple of the number of states that are searched together."""
    dim = zone.grid.shape[1]
    size = int(np.clip(_CHUNK_BYTES // (8 * len(zone.grid) * dim * (dim + 4)), 16, 4096))
    return min(max(size // MANY[dim] * MANY[dim], min(size, MANY[dim])) * devices, states)


def _jobs(
    family, zone: Zone, names: tuple[str, ...], orders, moduli, loads, size: int, out: np.ndarray, certify=None
) -> list:
    """The chunks of the grid of one family, all of equal size."""
    m, a = (x.reshape(-1).astype(family.xi.dtype) for x in np.meshgrid(orders, loads, indexing="ij"))
    jobs = []
    for start in range(0, len(m), size):
        index = np.minimum(np.arange(start, start + size), len(m) - 1)  # The last chunk repeats its last state.
        jobs.append(_Job(family, zone, names, m[index], moduli[index // len(loads)], a[index], index, out, certify))
    return jobs


def _do(job: _Job, make: Callable, path: Path, mesh: Mesh | None) -> None:
    """Evaluate one chunk and store its results."""
    for c, kinds in enumerate(_evaluated(job, make, path, mesh)):
        for kind in range(len(job.out)):
            job.out[kind, c, job.where] = np.asarray(kinds[kind])
