"""`certify`: the margin of a homogeneous state, enclosed with a proof."""

import numpy as np

from ..._internal.checks import Numbers, deformation_gradient, is_concrete
from ..._internal.public import public_function
from ...force.fields import check_model
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..brillouin import Zone
from ..certificate.certificate import Certificate, certificate_of
from ..certificate.enclosed import FLOOR, Enclosed, enclose, quotients
from ..lattice_states import States, checked_states, has_series
from .on_host import at_waves, outcomes, searched
from .outcome import Outcome
from .waves import Found
from .zones import family_zone

BOXES = 1_000_000
_MANY = 256  # states whose proofs run together
NOT_TRACED = "a proof needs known numbers; call it outside jit, grad and vmap"


def check_budget(tol: float, boxes: int = 1, seconds: float | None = None) -> None:
    """Raise ValueError for a tolerance or a budget that is not positive."""
    if not (np.ndim(tol) == 0 and np.isfinite(tol) and tol > 0):
        raise ValueError(
            "tol must be one number > 0, the width of the enclosure relative to the margin; got"
            f" {tol!r}. Take 1e-2, or 1 to prove the sign alone"
        )
    if not (isinstance(boxes, int | np.integer) and boxes > 0):
        raise ValueError(f"boxes must be an integer > 0, the largest number of boxes; got {boxes!r}")
    if seconds is not None and not seconds > 0:
        raise ValueError(f"seconds must be > 0, the time after which the proof ends; got {seconds!r}")


def check_criterion(criterion: str) -> None:
    """Raise ValueError for a criterion whose margin cannot be proved."""
    if criterion != "symbol":
        raise ValueError(f'certify is for the criterion "symbol", which searches waves; got criterion {criterion!r}')


def certifiable_states(model: AbstractModel, family: LatticeFamily, F: Numbers) -> States:
    """Linearise up to STATES states, or raise ValueError if no proof is possible for the model."""
    check_model(model, family, LatticeFamily)
    if not is_concrete(model, family, F):
        raise ValueError(NOT_TRACED)
    if not has_series(model):
        raise ValueError(
            f"{type(model).__name__} needs the states of both ends of a bond, and its states are not even (ξ → −ξ), so"
            " one family does not give its symbol and no proof is available; use pdjax.cell_stability"
        )
    states = checked_states(model, family, np.asarray(F))
    twist = np.abs(states.blocks - states.blocks.transpose(0, 1, 3, 2)).max(initial=0)
    if model.hyperelastic and twist > 1e-9 * np.abs(states.blocks).max(initial=0):  # rounding: 1e-15 measured
        raise ValueError(
            f"{type(model).__name__} declares an energy, but its symbol is not symmetric. If the bond force is not the"
            " derivative of an energy, declare hyperelastic = False in the class"
        )
    if not np.isfinite(states.scaled).all():
        raise ValueError(
            f"the symbol of {type(model).__name__} has coefficients that are not finite at this F, so nothing can be"
            " proved; check the constants of the model and whether its energy is defined at this deformation"
        )
    return states


def enclosed_states(
    states: States,
    found: Found,
    tol: float,
    boxes: int,
    seconds: float = np.inf,
    show: bool = False,
    keep: bool = False,
) -> Enclosed:
    """Enclose the margins of states from the waves that the search has found."""
    x, is_long, mode = (np.asarray(part) for part in (found.x, found.is_long, found.mode))
    return enclose(states.scaled, states.offsets, x, is_long, mode, tol, boxes, seconds, show, keep)


def proved_signs(blocks: np.ndarray, offsets: np.ndarray, at: tuple, tol: float, boxes: int) -> tuple:
    """What is proved about the signs of the margins of many states, and the margins themselves.

    Parameters
    ----------
    blocks : array, shape (states, offsets, dim, dim)
        Cosine series in units of M/h².
    offsets : array, shape (offsets, dim)
        Their offsets.
    at : tuple
        `Outcome.at` of the criterion "symbol" at these states.
    tol : float
        A state counts as proved stable if its margin is at most (1 − tol) of the one found; 1 asks for the sign alone.
    boxes : int
        Largest number of boxes for each state.

    Returns
    -------
    proof : array, shape (states,)
        −1 is proved stable, 1 is proved unstable, and 0 is open.
    margin : array, shape (states,)
        The margins. One that the search has missed is replaced by that of the wave that the proof has found.
    """
    waves = [np.asarray(part) for part in at[:3]]
    margin, rounding = quotients(blocks, offsets, *waves)
    proof = np.where(margin > rounding, 1, 0).astype(np.int8)
    negative = np.flatnonzero(margin < -FLOOR)  # Zero-energy waves cannot be proved stable.
    for start in range(0, len(negative), _MANY):
        some = negative[start : start + _MANY]
        x, is_long, mode = (part[some] for part in waves)
        made = enclose(blocks[some], offsets, x, is_long, mode, tol, boxes)
        proof[some] = np.where(made.upper < 0, -1, np.where(made.lower > 0, 1, 0))
        margin[some] = np.where(made.missed, made.lower, margin[some])
    return proof, margin


def certified_outcome(
    model: AbstractModel, family: LatticeFamily, F: np.ndarray, zone: Zone, tol: float
) -> tuple[Outcome, Certificate]:
    """The criterion "symbol" at one state F (dim, dim), at the worst wave that search and proof have found."""
    states = certifiable_states(model, family, F[None])
    found = searched(states, model, family, zone)
    made = enclosed_states(states, found, tol, BOXES)
    certificate = certificate_of(made, states, tol, model.hyperelastic)
    if not model.hyperelastic:
        return outcomes("symbol", model, family, F[None], zone), certificate
    found = found._replace(x=made.x, is_long=made.is_long, mode=made.mode)
    if made.missed[0]:
        found = found._replace(fast_x=made.x, fast_mode=made.mode)
    return at_waves(found, states, family), certificate


@public_function
def certify(
    model: AbstractModel,
    family: LatticeFamily,
    F,
    tol: float = 1e-2,
    boxes: int = BOXES,
    seconds: float | None = None,
    regions: bool = False,
    show_progress: bool = False,
) -> Certificate:
    """Enclose the margin of a homogeneous state with a proof: no wave of the whole Brillouin zone has been missed.

    lower ≤ sup over k of λ_max(Ĵ(k)) / (M κ²) ≤ upper,    upper − lower ≤ max(tol |margin|, 1e-9)

    `stability` finds the worst wave by a search, which can miss a narrow maximum. This function divides the zone into
    boxes and bounds the largest eigenvalue on every box, long waves included (branch and bound).

    Parameters
    ----------
    model : AbstractModel
        The material model. Its constants must be known single numbers.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim)
        Deformation gradient [-] of the homogeneous state, det F > 0.
    tol : float, optional
        Width of the enclosure relative to the margin [-]. A tolerance of 1 proves the sign of the margin alone.
    boxes : int, optional
        Largest number of boxes. A proof in 2D takes 30 to 5000, in 3D 30 to 10⁵.
    seconds : float, optional
        Time [s] after which the proof ends with the bounds reached so far.
    regions : bool, optional
        Whether to keep the corners of the boxes, for a picture.
    show_progress : bool, optional
        Whether to print the share of the zone that is done.

    Returns
    -------
    Certificate
        The bounds `lower` and `upper`, the `verdict` in words, whether the tolerance was reached (`proved`), the number
        of `boxes`, and the wave of the lower bound.

    Raises
    ------
    ValueError
        If `tol`, `boxes` or `seconds` is not positive, if a value is traced by JAX, if the coefficients of the symbol
        are not finite, or for what `stability` refuses.

    Notes
    -----
    The statement is proved in real arithmetic for the float64 coefficients B_o/M of the symbol

        Ĵ(k) = −Σ_o B_o 4 sin²(h k·o/2).

    The coefficients come from automatic differentiation in float64 and have its rounding errors, about 1e-15 of the
    largest one. All rounding of the proof itself is bounded and added. The statement is about the given F, not about a
    load path (see `certify_path`).

    A zero-energy wave has the margin 0, which cannot be proved to be negative. The verdict is then "marginal within
    tol". For a model without an energy, Ĵ is not symmetric. A bound of its symmetric part excludes divergence, a
    positive real eigenvalue, but not flutter. The verdict is then "no divergence" or "undecided".

    References
    ----------
    Born & Huang 1954 (the symbol); Neumaier 1990 (enclosures by Taylor forms). The bounds, and those of long
    waves, are derived in `pdjax.infinite_lattice.certificate`: see its modules `polynomials` and `enclosure`.

    Examples
    --------
    >>> family = pd.lattice_family(2, 2)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> proof = pd.certify(model, family, 1.02 * np.eye(2))
    >>> proof.verdict, proof.proved
    ('stable', True)
    >>> margin = float(pd.stability(model, family, 1.02 * np.eye(2)).margin)
    >>> bool(proof.lower <= margin <= proof.upper)
    True
    """
    check_budget(tol, boxes, seconds)
    F = deformation_gradient(F, family.dim)
    states = certifiable_states(model, family, F[None])
    found = searched(states, model, family, family_zone(family, "inversion", None))
    made = enclosed_states(states, found, tol, boxes, np.inf if seconds is None else seconds, show_progress, regions)
    return certificate_of(made, states, float(tol), model.hyperelastic)
