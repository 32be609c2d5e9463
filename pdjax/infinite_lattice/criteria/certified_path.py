"""`certify_path`: stability proved along a load path, at samples or at every load.

For the models and paths of `pdjax.infinite_lattice.certificate.load_forms` a proof at a few vertices covers all loads
of an interval. An interval whose vertices are not all proved is halved. For any other model or path the loads are
sampled.
"""

from collections.abc import Callable

import equinox as eqx
import numpy as np

from ..._internal.checks import computed_in_double, frozen, is_concrete
from ..._internal.public import public_function
from ...force.fields import check_model
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..certificate.enclosed import quotients
from ..certificate.load_forms import LoadForm, load_form
from ..certificate.proof import prove
from ..cosine_series import packed
from ..lattice_states import STATES, offsets_of
from ..paths import Path, hydrostatic, named_path, path_symmetry
from . import family_zone
from .certified import BOXES, NOT_TRACED, certifiable_states, check_budget
from .critical_load import SMALLEST, deformations
from .waves import search_few

SAMPLES = 64
HALVINGS = 10  # The smallest interval is the load divided by 2^HALVINGS.


class PathCertificate(eqx.Module):
    """What is proved about the loads of a path between 0 and a given load, the result of `certify_path`.

    Attributes
    ----------
    stable_to : float
        The largest load [-] up to which stability is proved: at every load from 0 if `continuous` is True, and
        otherwise at every sample. It is 0 if nothing is proved.
    load : float
        The load [-] that was asked for.
    continuous : bool
        Whether the proof covers every load, or the samples only.
    unstable_at : float or None
        A load [-] at which a wave was found that proves instability, if there is one.
    loads : array, shape (loads,)
        The samples, or the ends of the intervals [-].
    boxes : int
        Number of boxes of the Brillouin zone that were bounded.
    verdict : str
        What is proved, in words: "stable", "unstable" or "undecided".

    Examples
    --------
    >>> model, family = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), pd.lattice_family(1, 2)
    >>> print(pd.certify_path(model, family, 0.5))
    stable at every load from 0 (excluded) to 0.5, proved with 9 boxes
    """

    stable_to: float
    load: float
    continuous: bool
    unstable_at: float | None
    loads: np.ndarray
    boxes: int

    @property
    def verdict(self) -> str:
        """What is proved, in words."""
        if self.stable_to == self.load:
            return "stable"
        return "undecided" if self.unstable_at is None else "unstable"

    def __str__(self) -> str:
        proof = f"proved with {self.boxes} boxes"
        if self.continuous:
            said = f"stable at every load from 0 (excluded) to {self.stable_to:g}, {proof}"
        else:
            count = int((np.abs(self.loads) <= abs(self.stable_to)).sum())
            said = f"stable at {count} samples up to {self.stable_to:g}, {proof}; between the samples nothing is proved"
        if self.stable_to == 0:
            said = f"stability is not proved at any load, {self.boxes} boxes"
        if self.unstable_at is not None:
            said += f"; unstable at {self.unstable_at:g}"
        elif self.stable_to != self.load:
            said += f"; undecided from there to {self.load:g}: allow more boxes"
        return said

    __repr__ = __str__


class _Prover:
    """Proofs that cosine series have no positive eigenvalue, for the states of one model along one path."""

    def __init__(self, model: AbstractModel, family: LatticeFamily, path: Path, boxes: int):
        self.model, self.family, self.path, self.boxes, self.used = model, family, path, boxes, 0
        self.offsets = offsets_of(model, family)
        self.zone = family_zone(family, path_symmetry(path, family, model.isotropic), None)

    def blocks(self, loads: np.ndarray) -> np.ndarray:
        """The cosine series (loads, offsets, dim, dim) at up to STATES loads, in units of M/h²."""
        F = computed_in_double(deformations, self.path, loads, self.model, self.family)
        return certifiable_states(self.model, self.family, F).scaled

    def unstable(self, blocks: np.ndarray) -> np.ndarray:
        """Whether the search finds a wave whose quotient is positive beyond rounding, for each series."""
        found = search_few(packed(blocks), self.offsets, self.zone)
        x, is_long, mode = (np.asarray(part) for part in (found.x, found.is_long, found.mode))
        value, rounding = quotients(blocks, self.offsets, x, is_long, mode)
        return value > rounding

    def stable(self, blocks: np.ndarray) -> np.ndarray:
        """Whether the proof succeeds for each series."""
        found = prove(blocks, self.offsets, np.zeros(len(blocks)), self.boxes)
        self.used += int(found.boxes.sum())
        return found.done


def _sampled(prover: _Prover, load: float) -> tuple[float, float | None, np.ndarray]:
    """The last proved sample, the first sample known to be unstable, and all samples up to there."""
    near = np.geomspace(SMALLEST, 0.02, SAMPLES // 4)
    sizes = np.concatenate([near[near < abs(load) / 2], np.linspace(0, abs(load), SAMPLES + 1)[1:]])
    loads = np.sign(load) * np.unique(sizes)
    for start in range(0, len(loads), STATES):
        part = loads[start : start + STATES]
        blocks = prover.blocks(part)
        unstable = prover.unstable(blocks)
        first = int(np.argmax(unstable)) if unstable.any() else len(part)
        done = prover.stable(blocks[:first]) if first else np.zeros(0, bool)
        proved = int(np.argmin(done)) if not done.all() else first
        if proved < len(part):
            last = loads[start + proved - 1] if start + proved else 0.0
            return float(last), float(part[first]) if first < len(part) else None, loads[: start + first + 1]
    return load, None, loads


def _continuous(prover: _Prover, load: float, form: LoadForm) -> tuple[float, float | None, np.ndarray]:
    """The last load up to which all loads are proved, a load known to be unstable, and the ends of intervals."""
    nodes = np.linspace(0, load, len(form.basis(load)))
    series = prover.blocks(nodes) * np.array([form.scale(a) for a in nodes])[:, None, None, None]
    weights = np.linalg.inv(np.stack([form.basis(a) for a in nodes]))  # interpolation within the nodes
    ends, low, high, smallest, unstable = [0.0], 0.0, load, abs(load) / 2**HALVINGS, None
    while low != load:
        vertices = np.einsum("vk,kn,noij->voij", form.vertices(low, high), weights, series, optimize=True)
        if prover.unstable(vertices[-1:])[0]:
            unstable = high
        elif prover.stable(vertices).all():
            ends.append(high)
            low, high = high, min(load, 2 * high - low, key=abs) if unstable is None else (high + unstable) / 2
            continue
        high = (low + high) / 2
        if abs(high - low) < smallest:
            break
    return low, unstable, np.array(ends)


@public_function
def certify_path(
    model: AbstractModel, family: LatticeFamily, load: float, path: Path | str = hydrostatic, boxes: int = BOXES
) -> PathCertificate:
    """Prove that the infinite lattice is stable along a load path, from 0 to a given load.

    Parameters
    ----------
    model : AbstractModel
        The material model. It must have an energy, and its constants must be known single numbers.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    load : float
        The end of the path [-], with its sign: negative is compression on most paths.
    path : callable or str, optional
        Load path: a function (a, model, family) → F with F = I at a = 0, such as `hydrostatic`, or a name in `PATHS`.
    boxes : int, optional
        Largest number of boxes of the Brillouin zone for each load.

    Returns
    -------
    PathCertificate
        The load up to which stability is proved, and whether every load is covered or samples only.

    Raises
    ------
    ValueError
        If `load` is 0 or not finite, if the model has no energy, if a value is traced, or for what `certify` refuses.

    Notes
    -----
    The proof covers every load for these models with a linear law: on the hydrostatic path Seth–Hill, bond-based and
    linear peridynamic solids; on the paths `hydrostatic`, `uniaxial_strain` and `simple_shear` Seth–Hill with m = 1,
    correspondence, bond-level, sub-horizon, bond-associated and reproducing-kernel models. Their symbol is a sum of two
    or three known functions of the load. It lies in the convex hull of a few vertices, and the largest eigenvalue is
    convex (see `pdjax.infinite_lattice.certificate.load_forms`). For all other models and paths 64 samples are proved.

    At rest no eigenvalue is positive, because the energy of a stable law has a minimum there. This is used, not proved.

    Examples
    --------
    With a control of this strength the model of order 1 is stable at every strain between 0 and −5 %, and not beyond.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0), pd.SillingControl(0.065))
    >>> proof = pd.certify_path(model, pd.lattice_family(2, 2), -0.05)
    >>> proof.verdict, proof.continuous
    ('stable', True)
    >>> pd.certify_path(model, pd.lattice_family(2, 2), -0.08).verdict
    'unstable'
    """
    check_budget(1.0, boxes)
    path = named_path(path)
    check_model(model, family, LatticeFamily)
    model, family, path = frozen((model, family, path))
    if not is_concrete(model, family, path, load):
        raise ValueError(NOT_TRACED)
    load = float(load)
    if not (np.isfinite(load) and load != 0):
        raise ValueError(f"load must be finite and not 0, the end of the path; got {load:g}")
    if not model.hyperelastic:
        raise ValueError(
            f"{type(model).__name__} has no energy here, so its stability cannot be proved; pdjax.certify bounds the"
            " symmetric part of its symbol"
        )
    prover, form = _Prover(model, family, path, boxes), load_form(model, path)
    search: Callable = _sampled if form is None else lambda prover, load: _continuous(prover, load, form)
    stable_to, unstable_at, loads = search(prover, load)
    return PathCertificate(stable_to, load, form is not None, unstable_at, loads, prover.used)
