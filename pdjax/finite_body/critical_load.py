"""Critical load of a body: where the largest eigenvalue of its Jacobian crosses zero along a path of displacements.

    A(λ) v = 0.     First the linearised problem at rest, −A(0) v = λ A'(0) v (Lanczos with one factor of A(0)); then
    Newton on the eigenvalue that vanishes, λ ← λ − x / (vᵀ A'(λ) v), x v = A(λ) v by inverse iteration with one
    factor each; at last two factors at λ (1 ∓ 1e-6), whose inertia proves the crossing.

Where an iterate is unstable by more than one eigenvalue the bracket of counts is halved instead: Newton there would
follow a later crossing. A'(λ) is never formed: its products are JVPs of JVPs. Six factors suffice where the path is a
homogeneous deformation.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._internal.checks import in_double
from .._internal.public import public_function
from .factorisation import Factor, Singular, as_operator, count_positive, matrix, product_rate, unknown_volumes
from .scene import Scene, frozen
from .spectrum import _full, _norm, _scaled, _tolerance, closed_form, nearest, need_energy, shifted

PROOF = 1e-6  # relative distance of the two proving factors
MOST = 60


class BodyCritical(eqx.Module):
    """The answer of `body_critical_load`.

    factor: the load factor λ at the crossing (0: unstable at rest; inf: not up to the limit); mode (points, dim), unit;
    positive: (factor, eigenvalues above zero) at every factorisation; proved: stable just below, unstable just above
    (for inf: stable at the limit). Not proved: the middle of the bracket that 60 factors left.
    """

    factor: float
    mode: np.ndarray | None
    positive: tuple[tuple[float, int], ...] = eqx.field(static=True)
    proved: bool = eqx.field(static=True)

    @property
    def factorisations(self) -> int:
        """How many sparse factors were made."""
        return len(self.positive)

    def __str__(self) -> str:
        proof = "proved by inertia" if self.proved else "not proved"
        return f"critical load factor {self.factor:.9g}, {proof}, {self.factorisations} factorisations"


def _near_zero(A: Any, factor: Factor, start: np.ndarray | None) -> tuple[float, np.ndarray]:
    """The eigenpair of A nearest zero."""
    values, vectors = nearest(A, factor, 0.0, 1, start)
    return float(values[0]), vectors[:, 0]


@eqx.filter_jit
def _rate(path: Callable[[Any], Any], factor) -> tuple[Array, Array]:
    """u and du/dλ of a path at a load factor."""
    return jax.jvp(path, (factor,), (jnp.ones_like(factor),))


class _Walk:
    """H along a path of displacements, and the counts of its eigenvalues above zero met on the way."""

    def __init__(self, scene: Scene, along: Callable[[float], tuple[Any, Any]]):
        self.scene, self.along, self.root = scene, along, np.sqrt(unknown_volumes(scene))
        self.seen: list[tuple[float, int]] = []
        self.shift = 0.0

    def state(self, factor: float) -> tuple[Any, Any]:
        """H at a load factor, shifted by the rounding at the first one asked for, and v ↦ H'v."""
        scene, root = self.scene, self.root
        u, du = self.along(factor)
        H = _scaled(matrix(scene, u, factor), root)
        if self.shift == 0.0:
            self.shift = _tolerance(_norm(H), u.dtype)
        rate = as_operator(lambda v: np.asarray(product_rate(scene, u, factor, du, v / root)) / root, H.shape[0])
        return shifted(H, self.shift), rate

    def factorised(self, H: Any) -> Factor:
        """A factor of H."""
        try:
            return Factor(H)
        except Singular:  # it sits on an eigenvalue, or a pivot vanished: two roundings further it does not
            return Factor(shifted(H, 2 * self.shift))

    def unstable_at(self, factor: float) -> bool:
        """Whether H has positive eigenvalues there, by their count."""
        self.seen.append((float(factor), count_positive(self.state(factor)[0])))
        return self.seen[-1][1] > 0

    def answer(self, factor: float, w: np.ndarray | None, proved: bool) -> BodyCritical:
        """The critical load with all that was seen."""
        mode = None if w is None else _full(self.scene, w, self.root)
        return BodyCritical(float(factor), mode, tuple(self.seen), proved)


@public_function
@in_double
def body_critical_load(
    scene: Scene,
    path: Callable[[Any], Any] | None = None,
    limit: float = 1.0,
) -> BodyCritical:
    """The first load factor in (0, limit] at which the body becomes unstable.

    Arguments: path λ → u (points, dim) [length], a JAX function, starting at rest; by default λ times the scene's
        closed form, which for homogeneous states is the equilibrium path; limit.
    Instability that comes and goes between two factors is not seen.
    Returns: `BodyCritical`. Raises: ValueError without a path or closed form, or for a model without an energy.
    """
    need_energy(scene)
    scene = frozen(scene)
    if path is None:
        form = np.asarray(closed_form(scene, "a path, load factor -> u (points, dim)"))
    if not limit > 0:
        raise ValueError(f"limit must be > 0; got {limit}")

    def along(factor: float) -> tuple[Any, Any]:
        if path is None:
            return (factor * form).astype(form.dtype), form
        return _rate(path, np.asarray(factor, jnp.result_type(float)))

    traversal = _Walk(scene, along)
    H, rate = traversal.state(0.0)
    lu = traversal.factorised(H)
    traversal.seen.append((0.0, lu.positive))
    if traversal.seen[0][1] > 0:
        return traversal.answer(0.0, _near_zero(H, lu, None)[1], True)
    import scipy.sparse.linalg as sla

    inverse = sla.LinearOperator(H.shape, matvec=lambda v: -lu.solve(v), dtype=float)
    strength, vector = sla.eigsh(rate, k=1, M=-H, Minv=inverse, which="LA", tol=1e-6)
    del lu, inverse, H  # one factor at a time: it is most of the memory
    first = min(1 / strength[0], limit) if strength[0] > 0 else limit
    return _search(traversal, first, vector[:, 0], limit)


def _search(traversal: _Walk, factor: float, w: np.ndarray, limit: float) -> BodyCritical:
    """From a guess of the load factor and of the mode to the proved crossing: the module's head."""
    stable, unstable = 0.0, np.inf
    while len(traversal.seen) < MOST:
        if stable >= limit:
            return traversal.answer(np.inf, None, True)
        H, rate = traversal.state(factor)
        lu = traversal.factorised(H)
        value, w = _near_zero(H, lu, w)
        count = lu.positive if lu.cheap else int(value > 0)  # where counting is dear the proof comes at the end
        del lu
        traversal.seen.append((float(factor), count))
        slope = float(w @ (rate @ w)) / float(w @ w)
        new = factor - value / slope if slope != 0 else limit
        if abs(new - factor) <= 0.1 * PROOF * abs(new):
            if traversal.unstable_at(new * (1 - PROOF)):
                unstable = min(unstable, new * (1 - PROOF))
            elif traversal.unstable_at(new * (1 + PROOF)):
                return traversal.answer(new, w, True)
            else:
                stable = max(stable, new * (1 + PROOF))
            new = np.nan  # an eigenvalue crosses here, but not the first: go on between the bounds
        elif count == 0:
            stable = max(stable, factor)
            if slope <= 0 or new > limit:
                if factor >= limit:
                    return traversal.answer(np.inf, None, True)
                new = limit
        else:
            unstable = min(unstable, factor)
            if count > 1 or value < 0:
                new = np.nan  # the eigenvalue next to zero is not the one that crossed first
        if not stable < new < unstable:
            new = 0.5 * (stable + unstable) if np.isfinite(unstable) else limit
        factor = new
    return traversal.answer(0.5 * (stable + min(unstable, limit)), w, False)
