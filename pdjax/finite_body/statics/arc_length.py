"""Equilibrium paths through limit points: pseudo-arc-length continuation in (q, λ).

    r(q, λ) = 0,     θ² t_q·(q − q₀) + t_λ (λ − λ₀) = Δs

q are the free components of the displacement, λ is the load factor and r the residual. (q₀, λ₀) is the last state of
the path, (t_q, t_λ) the unit tangent there, Δs the step along the path, and s the arc length. θ scales the
displacements: the linear response to the full load has the length 1.

Newton's method solves both equations together. One matrix factorisation of A = ∂r/∂q solves for both right-hand sides
of the bordered system, A a = −r and A b = −∂r/∂λ. A new tangent points to the same side as the last one (their product
is positive), so the path passes a limit point, where dλ/ds changes sign, like any other state.

The inertia of the same matrix factorisation counts the positive eigenvalues of A. If that number changes where λ(s)
has no limit point, another branch of equilibria crosses the path. Source: Keller 1977.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..._internal.checks import in_double
from ..._internal.public import public_function
from ..factorisation import Factor, Singular, load_rate, matrix, relative, residual_and_scale
from ..scene import Scene, frozen
from ..spectrum import need_energy
from .result import SolveEnding

NEWTON = 12  # most Newton iterations of a step
EASY = 4  # iterations up to which the next step may be longer


class EquilibriumPath(eqx.Module):
    """Result of `equilibrium_path`: the states of the path, starting at rest.

    Attributes
    ----------
    load_factors : array, shape (states,)
        Load factor λ [-] of every state.
    u : array, shape (states, points, dim)
        Displacements [length] of every state.
    positive : int array, shape (states,)
        Number of positive eigenvalues of the reduced Jacobian at every state; −1 where it was not counted.
    reason : str
        Why the path ended.

    Examples
    --------
    Two points joined by one bond of the Hencky model. The load factor is 2 log(1 + e)/(1 + e) at the strain e, so its
    maximum is 2/exp(1) = 0.7358:

    >>> body = pd.bar(2, 2.0)
    >>> families, model = pd.families(body, 1.0), pd.SethHill(0.0, pd.LinearElastic(1.0, 0.0))
    >>> pair = pd.scene(body, families, model, pd.prescribe(0), pd.total_force([1], [1.0]))
    >>> path = pd.equilibrium_path(pair, states=25)
    >>> round(float(path.load_factors[path.limit_points[0]]), 4)
    0.7358
    """

    load_factors: Float[np.ndarray, " states"]
    u: Float[np.ndarray, "states points dim"]
    positive: np.ndarray
    reason: str = eqx.field(static=True)

    @property
    def limit_points(self) -> np.ndarray:
        """Indices of the states at which the load factor has a local maximum or minimum."""
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
    """Follow the equilibrium of a scene from rest (u = 0, λ = 0) through limit points.

    Parameters
    ----------
    scene : Scene
        The boundary value problem.
    states : int, optional
        Largest number of states after the state at rest.
    arc : float, optional
        First step along the path [-]. The linear response to the full load has the length 1.
    largest_arc : float, optional
        Largest step along the path [-].
    stop_at : float, optional
        The path ends where |λ| reaches this value [-]; `np.inf` for no such end.
    tolerance : float, optional
        Largest relative residual of a state [-].

    Returns
    -------
    EquilibriumPath
        Load factors, displacements, numbers of positive eigenvalues, and why the path ended.

    Raises
    ------
    ValueError
        If a step or the number of states is not positive, or the model has no energy.

    References
    ----------
    Keller 1977

    Examples
    --------
    Two points joined by one bond of the Hencky model become unstable at the limit point:

    >>> body = pd.bar(2, 2.0)
    >>> families, model = pd.families(body, 1.0), pd.SethHill(0.0, pd.LinearElastic(1.0, 0.0))
    >>> pair = pd.scene(body, families, model, pd.prescribe(0), pd.total_force([1], [1.0]))
    >>> path = pd.equilibrium_path(pair, states=25)
    >>> path.limit_points, path.positive[[19, 21]]
    (array([20]), array([0, 1]))
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
        return EquilibriumPath(np.zeros(1), np.array(out_u), np.array([-1]), f"{SolveEnding.SINGULAR.reason} at rest")
    theta2 = 1.0 / max(float(rate @ rate), np.finfo(float).tiny)
    last_q, last_factor = rate, 1.0
    reason = f"all {states} states were computed before the load factor reached {stop_at:g}"
    while len(out_factor) < states + 1:
        size = np.sqrt(theta2 * rate @ rate + 1.0)
        sign = np.sign(theta2 * rate @ last_q + last_factor) or 1.0
        t_q, t_factor = sign * rate / size, sign / size
        found = _correct(scene, q, factor, t_q, t_factor, arc, theta2, tolerance)
        if found is None:
            arc /= 2
            if arc < 1e-6 * largest_arc:
                reason = f"{SolveEnding.STEP_TOO_SMALL.reason} (arc {arc:.1e})"
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
            reason = SolveEnding.CONVERGED.reason
            break
    return EquilibriumPath(np.array(out_factor), np.array(out_u), np.array(out_positive), reason)


def _correct(scene, q0, factor0, t_q, t_factor, arc, theta2, tolerance):
    """Newton's method on the bordered system, from the tangent predictor: (q, λ, iterations), or None if it fails."""
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
