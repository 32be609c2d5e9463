"""Critical load of a finite body: the load factor λ at which the largest eigenvalue of its Jacobian crosses zero.

The displacement follows a given path u(λ). A(λ) is the reduced Jacobian along it, A'(λ) = dA/dλ, and the critical load
factor is the smallest λ with a mode v that satisfies

    A(λ) v = 0

The search has three steps:

1. The linearised problem at rest, −A(0) v = λ A'(0) v, gives a first λ (Lanczos with one matrix factorisation of A(0)).
2. Newton's method on the eigenvalue x nearest to zero improves it: λ ← λ − x / (vᵀ A'(λ) v) with A(λ) v = x v. Each
   step computes x and v by inverse iteration with one matrix factorisation.
3. Two more matrix factorisations at λ (1 ∓ 1e-6) prove the crossing. Their inertia shows that A has no positive
   eigenvalue just below λ and at least one just above.

Where A has more than one positive eigenvalue, Newton's method would follow a later crossing. The search then halves
the interval between the largest λ known to be stable and the smallest known to be unstable. A' is not stored as a
matrix: its products with vectors are JVPs of JVPs. Six matrix factorisations are enough if the path is a homogeneous
deformation.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array

from .._internal.checks import Numbers, in_double
from .._internal.public import public_function
from .._internal.shown import told
from .factorisation import Factor, Singular, as_operator, count_positive, matrix, product_rate, unknown_volumes
from .inertia import shifted
from .scene import Scene, frozen
from .spectrum import (
    closed_form,
    eigenpairs,
    full_displacement,
    nearest,
    need_energy,
    norm_of,
    scaled_matrix,
    zero_tolerance,
)

if TYPE_CHECKING:
    import scipy.sparse.linalg

PROOF = 1e-6  # relative distance from λ of the two matrix factorisations that prove the crossing
MOST = 60  # matrix factorisations after which the search stops


class BodyCritical(eqx.Module):
    """Result of `body_critical_load`: the critical load factor, its mode and whether it is proved.

    Attributes
    ----------
    factor : float
        Critical load factor λ [-]. 0 if the body is unstable at rest, inf if it is stable up to the limit.
    mode : array, shape (points, dim), or None
        The critical mode, of unit length. None if no crossing was found.
    positive : tuple of (float, int)
        Load factor and number of positive eigenvalues at every matrix factorisation.
    proved : bool
        True if the body is stable just below `factor` and unstable just above it, or stable at the limit for
        `factor` = inf. If False, `factor` is the middle of the interval that is left after 60 matrix factorisations.

    Examples
    --------
    >>> found = pd.body_critical_load(pd.scenes.step_size_bar(20, N=3, strain=-0.1))
    >>> round(found.factor, 6), found.proved, found.mode.shape
    (0.05272, True, (20, 1))
    """

    factor: float
    mode: np.ndarray | None
    positive: tuple[tuple[float, int], ...] = eqx.field(static=True)
    proved: bool = eqx.field(static=True)

    @property
    def factorisations(self) -> int:
        """Number of sparse matrix factorisations."""
        return len(self.positive)

    def __repr__(self) -> str:
        return told(self)

    def __str__(self) -> str:
        proof = "proved by inertia" if self.proved else "not proved"
        return f"critical load factor {self.factor:.9g}, {proof}, {self.factorisations} factorisations"


def _near_zero(A: sp.csc_array, factor: Factor, start: np.ndarray | None) -> tuple[float, np.ndarray]:
    """The eigenpair of A nearest to zero."""
    values, vectors = nearest(A, factor.solve, 0.0, 1, start)
    return float(values[0]), vectors[:, 0]


@eqx.filter_jit
def _rate(path: Callable[[Array], Array], factor) -> tuple[Array, Array]:
    """u and du/dλ of a path at a load factor."""
    return jax.jvp(path, (factor,), (jnp.ones_like(factor),))


class _Loading:
    """H along a path of displacements, with a record of its numbers of positive eigenvalues."""

    def __init__(self, scene: Scene, along: Callable[[float], tuple[Numbers, Numbers]]):
        self.scene, self.along, self.root = scene, along, np.sqrt(unknown_volumes(scene))
        self.seen: list[tuple[float, int]] = []
        self.shift = 0.0

    def state(self, factor: float) -> tuple[sp.csc_array, "scipy.sparse.linalg.LinearOperator"]:
        """H at a load factor and the product v ↦ H'v. H is shifted by the tolerance of the first load factor."""
        scene, root = self.scene, self.root
        u, du = self.along(factor)
        H = scaled_matrix(matrix(scene, u, factor), root)
        if self.shift == 0.0:
            self.shift = zero_tolerance(norm_of(H), u.dtype)
        rate = as_operator(lambda v: np.asarray(product_rate(scene, u, factor, du, v / root)) / root, H.shape[0])
        return shifted(H, self.shift), rate

    def factorised(self, H: sp.csc_array) -> Factor:
        """A matrix factorisation of H."""
        try:
            return Factor(H)
        except Singular:  # The shift hit an eigenvalue or a pivot vanished; a further small shift avoids both.
            return Factor(shifted(H, 2 * self.shift))

    def unstable_at(self, factor: float) -> bool:
        """Whether H has positive eigenvalues at a load factor; their number is recorded."""
        self.seen.append((float(factor), count_positive(self.state(factor)[0])))
        return self.seen[-1][1] > 0

    def answer(self, factor: float, w: np.ndarray | None, proved: bool) -> BodyCritical:
        """The result, with the record of all matrix factorisations."""
        mode = None if w is None else full_displacement(self.scene, w, self.root)
        return BodyCritical(float(factor), mode, tuple(self.seen), proved)


@public_function
@in_double
def body_critical_load(
    scene: Scene,
    path: Callable[[Array], Array] | None = None,
    limit: float = 1.0,
) -> BodyCritical:
    """Find the first load factor in (0, limit] at which a body becomes unstable.

    Parameters
    ----------
    scene : Scene
        The boundary value problem.
    path : callable, optional
        JAX function from the load factor λ [-] to the displacements, shape (points, dim) [length]. It must start at
        rest. The default is λ times the closed form of the scene; for homogeneous states that is the equilibrium path.
    limit : float, optional
        Largest load factor of the search [-].

    Returns
    -------
    BodyCritical
        The critical load factor, its mode and whether it is proved.

    Raises
    ------
    ValueError
        If the model has no energy, both a path and a closed form are missing, or the limit is not positive.

    Notes
    -----
    The search tests single load factors. It misses an instability that appears and disappears between two of them.

    Examples
    --------
    A clamped bar of 20 points and horizon 3 spacings becomes unstable at 0.5 % compression:

    >>> found = pd.body_critical_load(pd.scenes.step_size_bar(20, N=3, strain=-0.1))
    >>> round(-0.1 * found.factor, 5)
    -0.00527
    """
    need_energy(scene)
    scene = frozen(scene)
    if path is None:
        form = np.asarray(closed_form(scene, "a path, load factor -> u (points, dim)"))
    if not limit > 0:
        raise ValueError(f"limit must be > 0; got {limit}")

    def along(factor: float) -> tuple[Numbers, Numbers]:
        if path is None:
            return (factor * form).astype(form.dtype), form
        return _rate(path, np.asarray(factor, jnp.result_type(float)))

    loading = _Loading(scene, along)
    H, rate = loading.state(0.0)
    lu = loading.factorised(H)
    loading.seen.append((0.0, lu.positive))
    if loading.seen[0][1] > 0:
        return loading.answer(0.0, _near_zero(H, lu, None)[1], True)
    strength, vector = _strongest(rate, H, lu)
    del lu, H  # A matrix factorisation takes most of the memory, so only one is kept at a time.
    first = min(1 / strength[0], limit) if strength[0] > 0 else limit
    return _search(loading, first, vector[:, 0], limit)


def _strongest(
    rate: "scipy.sparse.linalg.LinearOperator", H: sp.csc_array, lu: Factor
) -> tuple[np.ndarray, np.ndarray]:
    """The largest λ of Ḣ v = −λ H v, and its v, of a stable H: 1/λ is the first estimate of the critical factor."""
    import scipy.sparse.linalg as sla

    inverse = sla.LinearOperator(H.shape, matvec=lambda v: -lu.solve(v), dtype=float)
    values, vectors = eigenpairs(rate, 1, M=-H, Minv=inverse, which="LA", tol=1e-6)
    return values[-1:], vectors[:, -1:]


def _search(loading: _Loading, factor: float, w: np.ndarray, limit: float) -> BodyCritical:
    """Steps 2 and 3 of the module docstring: from a first load factor and mode to the proved crossing."""
    stable, unstable = 0.0, np.inf
    while len(loading.seen) < MOST:
        if stable >= limit:
            return loading.answer(np.inf, None, True)
        H, rate = loading.state(factor)
        lu = loading.factorised(H)
        value, w = _near_zero(H, lu, w)
        count = lu.positive if lu.cheap else int(value > 0)  # large: counted in the proof only
        del lu
        loading.seen.append((float(factor), count))
        slope = float(w @ (rate @ w)) / float(w @ w)
        new = factor - value / slope if slope != 0 else limit
        if abs(new - factor) <= 0.1 * PROOF * abs(new):
            if loading.unstable_at(new * (1 - PROOF)):
                unstable = min(unstable, new * (1 - PROOF))
            elif loading.unstable_at(new * (1 + PROOF)):
                return loading.answer(new, w, True)
            else:
                stable = max(stable, new * (1 + PROOF))
            new = np.nan  # This is not the first crossing, so the search goes on between the bounds.
        elif count == 0:
            stable = max(stable, factor)
            if slope <= 0 or new > limit:
                if factor >= limit:
                    return loading.answer(np.inf, None, True)
                new = limit
        else:
            unstable = min(unstable, factor)
            if count > 1 or value < 0:
                new = np.nan  # The eigenvalue nearest to zero is not the one that crossed first.
        if not stable < new < unstable:
            new = 0.5 * (stable + unstable) if np.isfinite(unstable) else limit
        factor = new
    return loading.answer(0.5 * (stable + min(unstable, limit)), w, False)
