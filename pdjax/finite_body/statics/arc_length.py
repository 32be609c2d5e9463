"""Equilibrium paths through limit points: pseudo-arc-length continuation in (q, λ).

    r(q, λ) = 0,     θ² t_q·(q − q₀) + t_λ (λ − λ₀) = Δs

One factor of A serves both right-hand sides of the bordered system, A a = −r and A b = −∂r/∂λ; the tangent keeps its
direction by its product with the last one, so a limit point (dλ/ds changes sign) is passed like any other. θ scales
displacements to the size they have under the first linear step. The same factor's inertia counts the positive
eigenvalues: where the count changes at a smooth λ(s) a branch crosses. Source: Keller 1977.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..._internal.checks import in_double
from ..._internal.public import public_function
from ..factorisation import Factor, Singular, load_rate, matrix, relative, residual_and_scale
from ..scene import Scene, frozen
from ..spectrum import need_energy
from .result import CONVERGED, OUT_OF_STEPS, REASONS, SINGULAR, STEP_TOO_SMALL

NEWTON = 12
EASY = 4


class EquilibriumPath(eqx.Module):
    """load_factors (states,), u (states, points, dim) [length], positive (states,): eigenvalues of J above zero at
    each state (−1: not counted); reason: why it stopped."""

    load_factors: Float[np.ndarray, " states"]
    u: Float[np.ndarray, "states points dim"]
    positive: np.ndarray
    reason: str = eqx.field(static=True)

    @property
    def limit_points(self) -> np.ndarray:
        """Numbers of the states at which the load factor turns."""
        rise = np.sign(np.diff(self.load_factors))
        return np.flatnonzero(rise[1:] * rise[:-1] < 0) + 1


@public_function
@in_double
def equilibrium_path(
    scene: Scene,
    states: int = 50,
    arc: float = 0.05,
    largest_arc: float = 0.2,
    stop_at: float = 1.0,
    tolerance: float = 1e-10,
) -> EquilibriumPath:
    """Follow the equilibrium from rest (u = 0, λ = 0) through limit points.

    Arguments: states: how many to find at most; arc: first step, in units where the linear response to the full load is
        1 long; largest_arc; stop_at: |λ| at which to end (np.inf: never); tolerance of the relative residual.
    Returns: `EquilibriumPath`. Raises: ValueError for steps that are not positive or a model without an energy.
    """
    if not (0 < arc <= largest_arc and states >= 1):
        raise ValueError(f"need 0 < arc <= largest_arc and states >= 1; got {arc}, {largest_arc}, {states}")
    need_energy(scene)
    scene = frozen(scene)
    q = np.zeros(scene.unknowns.shape[0], scene.prescribed.dtype)
    factor = 0.0

    def tangent(q, factor):
        lu = Factor(matrix(scene, scene.displacement(q, factor), factor))
        return lu, -lu.solve(np.asarray(load_rate(scene, q, factor)))

    out_factor, out_u, out_positive = [0.0], [np.asarray(scene.displacement(q, 0.0))], []
    try:
        lu, rate = tangent(q, factor)
        out_positive.append(lu.positive)
    except Singular:
        return EquilibriumPath(np.zeros(1), np.array(out_u), np.array([-1]), f"{REASONS[SINGULAR]} at rest")
    theta2 = 1.0 / max(float(rate @ rate), np.finfo(float).tiny)
    last_q, last_factor = rate, 1.0
    reason = REASONS[OUT_OF_STEPS]
    while len(out_factor) < states + 1:
        size = np.sqrt(theta2 * rate @ rate + 1.0)
        sign = np.sign(theta2 * rate @ last_q + last_factor) or 1.0
        t_q, t_factor = sign * rate / size, sign / size
        found = _correct(scene, q, factor, t_q, t_factor, arc, theta2, tolerance)
        if found is None:
            arc /= 2
            if arc < 1e-6 * largest_arc:
                reason = f"{REASONS[STEP_TOO_SMALL]} (arc {arc:.1e})"
                break
            continue
        q, factor, iterations = found
        last_q, last_factor = t_q, t_factor
        try:
            lu, rate = tangent(q, factor)
            count = lu.positive
        except Singular:
            count = -1
        out_factor.append(factor)
        out_u.append(np.asarray(scene.displacement(q, factor)))
        out_positive.append(count)
        if iterations <= EASY:
            arc = min(1.5 * arc, largest_arc)
        if abs(factor) >= stop_at:
            reason = REASONS[CONVERGED]
            break
    return EquilibriumPath(np.array(out_factor), np.array(out_u), np.array(out_positive), reason)


def _correct(scene, q0, factor0, t_q, t_factor, arc, theta2, tolerance):
    """Bordered Newton from the tangent predictor → (q, λ, iterations), or None."""
    q, factor = (q0 + arc * t_q).astype(q0.dtype), factor0 + arc * t_factor
    for iteration in range(NEWTON):
        r, scale = map(np.asarray, residual_and_scale(scene, q, factor))
        gap = theta2 * t_q @ (q - q0) + t_factor * (factor - factor0) - arc
        with np.errstate(all="ignore"):  # a residual that is not finite ends the correction
            size = float(relative(np.linalg.norm(r), scale))
        if not np.isfinite(size):
            return None
        if size <= tolerance and abs(gap) <= 1e-8 * arc:
            return q, factor, iteration
        try:
            lu = Factor(matrix(scene, scene.displacement(q, factor), factor))
        except Singular:
            return None
        a, b = -lu.solve(r), -lu.solve(np.asarray(load_rate(scene, q, factor)))
        bottom = theta2 * t_q @ b + t_factor
        if bottom == 0:
            return None
        change = (-gap - theta2 * t_q @ a) / bottom
        q, factor = (q + a + change * b).astype(q.dtype), factor + change
    return None
