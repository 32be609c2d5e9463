"""`certify_path`: stability proved along a load path, at samples or at every load.

For the models and paths of `pdjax.infinite_lattice.certificate.load_forms` a proof at a few vertices covers all loads
of an interval. An interval whose vertices are not all proved is halved. For any other model or path the loads are
sampled.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np

from ..._internal.checks import computed_in_double, frozen, is_concrete
from ..._internal.public import public_function
from ...force.fields import check_model
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..certificate.enclosed import quotients
from ..certificate.load_forms import LoadForm, load_form, rest_is_minimum
from ..certificate.proof import prove
from ..cosine_series import packed
from ..lattice_states import STATES, offsets_of
from ..paths import Path, check_stretch, hydrostatic, is_stretch, named_path, path_symmetry
from .certified import BOXES, NOT_TRACED, certifiable_states, check_budget
from .critical_load import SMALLEST, deformations
from .waves import search_few
from .zones import family_zone

SAMPLES = 64
_INTERPOLATION = 1e-14  # Relative error of a series at a node and of a sum of nodes; measured 1e-15.
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
    marginal_at : float or None
        A load [-] at which a zero-energy wave was found, whose margin is zero and cannot be proved negative.
    ends_at : float or None
        The first sample [-] at which the path has no state, as if a lateral stretch has no solution, if there is one.
    loads : array, shape (loads,)
        The samples, or the ends of the intervals [-].
    boxes : int
        Number of boxes of the Brillouin zone that were bounded.
    verdict : str
        What is proved, in words: "stable", "unstable", "marginal" (a zero-energy wave) or "undecided".

    Examples
    --------
    >>> model, family = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), pd.lattice_family(1, 2)
    >>> print(pd.certify_path(model, family, 0.5))
    stable at every load from 0 (excluded) to 0.5, proved with 8 boxes
    """

    stable_to: float
    load: float
    continuous: bool
    loads: np.ndarray
    boxes: int
    unstable_at: float | None = None
    marginal_at: float | None = None
    ends_at: float | None = None

    @property
    def verdict(self) -> str:
        """What is proved, in words."""
        end = self.load if self.ends_at is None else self.loads[-1] if len(self.loads) else np.nan
        if self.stable_to == end:
            return "stable"
        if self.unstable_at is not None:
            return "unstable"
        return "undecided" if self.marginal_at is None else "marginal"

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
        elif self.verdict == "stable" and self.ends_at is not None:
            said += f"; the path has no state at {self.ends_at:g}"
        elif self.marginal_at is not None:
            said += f"; marginal at {self.marginal_at:g}, where a zero-energy wave cannot be proved stable"
        elif self.verdict == "undecided":
            said += f"; undecided from there to {self.load:g}: allow more boxes"
        return said

    __repr__ = __str__


class _Prover:
    """Proofs that cosine series have no positive eigenvalue, for the states of one model along one path."""

    def __init__(self, model: AbstractModel, family: LatticeFamily, path: Path, boxes: int):
        self.model, self.family, self.path, self.boxes, self.used = model, family, path, boxes, 0
        self.offsets = offsets_of(model, family)
        self.zone = family_zone(family, path_symmetry(path, family, model.isotropic), None)

    def deformed(self, loads: np.ndarray) -> np.ndarray:
        """The deformation gradients (loads, dim, dim). They are NaN where the path has no state.

        They are computed for STATES loads at once, by the program that `critical_load` uses.
        """
        found = []
        for start in range(0, len(loads), STATES):
            part = loads[start : start + STATES]
            padded = np.concatenate([part, np.full(STATES - len(part), part[-1])])
            F = computed_in_double(deformations, self.path, padded, self.model, self.family)
            found.append(F[: len(part)])
        return np.concatenate(found)

    def blocks(self, F: np.ndarray) -> np.ndarray:
        """The cosine series (states, offsets, dim, dim) of up to STATES states F, in units of M/h²."""
        return certifiable_states(self.model, self.family, F).scaled

    def judged(self, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether the search finds a positive quotient, and whether it finds one that is zero to rounding."""
        found = search_few(packed(blocks), self.offsets, self.zone)
        x, is_long, mode = (np.asarray(part) for part in (found.x, found.is_long, found.mode))
        value, rounding = quotients(blocks, self.offsets, x, is_long, mode)
        return value > rounding, abs(value) <= rounding

    def stable(self, blocks: np.ndarray, error: np.ndarray | float = 0.0) -> np.ndarray:
        """Whether the proof succeeds for each series, whose blocks are known to `error` (series, offsets)."""
        found = prove(blocks, self.offsets, np.zeros(len(blocks)), self.boxes, error=error)
        self.used += int(found.boxes.sum())
        return found.done


class Found(NamedTuple):
    """The fields of a `PathCertificate` of the same names."""

    stable_to: float
    loads: np.ndarray
    unstable_at: float | None = None
    marginal_at: float | None = None
    ends_at: float | None = None


def _sampled(prover: _Prover, load: float) -> Found:
    """Prove the samples one after another, until one of them is not proved."""
    near = np.geomspace(SMALLEST, 0.02, SAMPLES // 4)
    sizes = np.concatenate([near[near < abs(load) / 2], np.linspace(0, abs(load), SAMPLES + 1)[1:]])
    loads = np.sign(load) * np.unique(sizes)
    F = prover.deformed(loads)
    exists = np.isfinite(F).all(axis=(1, 2))
    ends_at = None
    if not exists.all():
        first = int(np.argmin(exists))
        ends_at, loads = float(loads[first]), loads[:first]
    for start in range(0, len(loads), STATES):
        part = loads[start : start + STATES]
        blocks = prover.blocks(F[start : start + len(part)])
        unstable, marginal = prover.judged(blocks)
        first = int(np.argmax(unstable | marginal)) if (unstable | marginal).any() else len(part)
        done = prover.stable(blocks[:first]) if first else np.zeros(0, bool)
        proved = int(np.argmin(done)) if not done.all() else first
        if proved < len(part):
            last = float(loads[start + proved - 1]) if start + proved else 0.0
            at = float(part[first]) if first < len(part) else None
            known = {"unstable_at" if at is not None and unstable[first] else "marginal_at": at}
            return Found(last, loads[: start + first + 1], **known)
    return Found(float(loads[-1]) if len(loads) else 0.0, loads, ends_at=ends_at)


def _weights(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The weights w with w @ known = values. The columns are scaled, and the residual is removed twice."""
    size = np.abs(known).max(axis=0)
    inverse = np.linalg.inv(known / size) / size[:, None]
    weights = values @ inverse
    for _ in range(2):
        weights = weights + (values - weights @ known) @ inverse
    return weights


def _continuous(prover: _Prover, load: float, form: LoadForm) -> Found:
    """Prove intervals of loads one after another. An interval that is not proved is halved."""
    nodes = np.linspace(0, load, len(form.basis(load)))
    known, scale = np.stack([form.basis(a) for a in nodes]), np.array([form.scale(a) for a in nodes])
    if not (np.isfinite(known).all() and np.isfinite(scale).all()):
        raise ValueError(f"powers of the stretch overflow at the load {load:g}; take a smaller load")
    series = prover.blocks(prover.deformed(nodes)) * scale[:, None, None, None]
    sizes = np.linalg.norm(series, axis=(2, 3))
    if not (rest_is_minimum(prover.model, prover.family) or prover.stable(series[:1]).all()):
        unstable, marginal = prover.judged(series[:1])
        return Found(0.0, np.zeros(1), 0.0 if unstable[0] else None, 0.0 if marginal[0] else None)
    ends, low, high, smallest = [0.0], 0.0, load, abs(load) / 2**HALVINGS
    unstable_at: float | None = None
    marginal_at: float | None = None
    while low != load:
        weights = _weights(form.vertices(low, high), known)
        vertices, error = np.tensordot(weights, series, axes=1), _INTERPOLATION * np.abs(weights) @ sizes
        unstable, marginal = prover.judged(vertices)
        if unstable[-1]:
            unstable_at = high
        elif marginal[-1] and marginal_at is None:
            marginal_at = high
        elif not (unstable | marginal).any() and prover.stable(vertices, error).all():
            ends.append(high)
            further = min(load, 2 * high - low, key=abs)
            low, high = high, further if unstable_at is None else (high + unstable_at) / 2
            continue
        high = (low + high) / 2
        if abs(high - low) < smallest:
            break
    return Found(low, np.array(ends), unstable_at, marginal_at)


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
        If `load` is 0, not finite or a stretch 1 + load ≤ 0, if the model has no energy, if a value is traced, or for
        what `certify` refuses.

    Notes
    -----
    The proof covers every load for these models with a linear law: on the hydrostatic path Seth–Hill, bond-based and
    linear peridynamic solids; on the paths `hydrostatic`, `uniaxial_strain` and `simple_shear` Seth–Hill with m = 1,
    correspondence, bond-level, sub-horizon, bond-associated and reproducing-kernel models. Their symbol is a sum of two
    or three known functions of the load. It lies in the convex hull of a few vertices, and the largest eigenvalue is
    convex (see `pdjax.infinite_lattice.certificate.load_forms`). For all other models and paths samples are proved: 64
    in equal steps, and up to 16 near rest.

    At rest no eigenvalue is positive, because the energy has a minimum there if no weight, modulus or strength of a
    control is negative. This is used, not proved. If one of them is negative, rest is proved like any other state. The
    statement is for the model in real arithmetic, up to a relative error of 1e-14 of the series that are linearised.

    Examples
    --------
    With a control of this strength the model of order 1 is stable at every strain between 0 and −4 %.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0), pd.SillingControl(0.065))
    >>> proof = pd.certify_path(model, pd.lattice_family(2, 2), -0.04)
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
    if is_stretch(path):
        check_stretch(load)
    if not model.hyperelastic:
        raise ValueError(
            f"{type(model).__name__} has no energy here, so its stability cannot be proved; pdjax.certify bounds the"
            " symmetric part of its symbol"
        )
    prover, form = _Prover(model, family, path, boxes), load_form(model, path)
    search: Callable = _sampled if form is None else lambda prover, load: _continuous(prover, load, form)
    found = search(prover, load)
    return PathCertificate(load=load, continuous=form is not None, boxes=prover.used, **found._asdict())
