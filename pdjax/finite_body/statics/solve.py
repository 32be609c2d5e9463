"""`solve`: the equilibrium of a scene by one of the static methods, with load stepping, derivatives and stability.

Load stepping raises the load factor λ from 0 to 1. A step that fails is undone and halved. After a step that takes few
iterations the next step is longer. If the step becomes smaller than the smallest allowed, `solve` stops and returns the
last equilibrium.

The tangent predictor moves the whole body before each step by the solution of A δq = −(r + ∂r/∂λ δλ). Here r is the
residual, A = ∂r/∂q and δλ the load step. Without the predictor a prescribed displacement moves only the held boundary
layer, and the bonds between that layer and the unmoved body take the whole step.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._internal.checks import choice, in_double, inside_jit, is_concrete, namespace, on_device
from ..._internal.progress import Residuals
from ..._internal.public import public_function
from ..factorisation import Singular, load_rate, residual_and_scale, residual_of
from ..scene import Scene, frozen
from ..spectrum import body_stability
from .implicit import attach, leaves_sum, without_derivative
from .newton import Krylov, LinearSolver, direct, newton
from .relaxation import CHUNK, relaxation
from .result import Equilibrium, SolveEnding, torn, turned_bonds
from .trust_region import trust_region

SOLVERS = ("newton", "newton_krylov", "trust_region", "relaxation")
ITERATIONS = {"newton": 50, "newton_krylov": 50, "trust_region": 200, "relaxation": 200_000}
EASY = 6  # iterations up to which the next load step may grow


def _attempt(
    scene: Scene,
    method: str,
    linear: LinearSolver,
    q: np.ndarray,
    factor: float,
    tolerance: float,
    most: int,
    shown: bool,
):
    if method == "trust_region":
        # Both numbers become arrays, so that new values do not recompile the solver.
        target, left = (np.asarray(x, q.dtype) for x in (factor, tolerance))
        q, code, history = map(np.asarray, trust_region(scene, q, target, left, most))
        return q, int(code), list(history[np.isfinite(history)])
    seen = Residuals(factor, shown)
    try:
        if method == "relaxation":
            return relaxation(scene, q, factor, tolerance, most, seen)
        return newton(scene, q, factor, tolerance, most, linear, seen)
    finally:
        seen.end()


def _predict(scene: Scene, linear: LinearSolver, q: np.ndarray, factor: float, step: float) -> np.ndarray:
    """One linear step of the whole body with the load; q itself if A is singular."""
    try:
        r, _ = residual_and_scale(scene, q, factor)
        b = np.asarray(r) + step * np.asarray(load_rate(scene, q, factor))
        return (q - linear(scene, q, factor, 0.0)(b)).astype(q.dtype) if np.any(b) else q
    except Singular:
        return q


def _climb(scene: Scene, method, q: np.ndarray, step, smallest_step, predictor, tolerance, most, shown) -> tuple:
    """Load stepping from q at load factor 0.

    Returns (q, factor, code, history, iterations, the load step that failed or None).
    """
    factor, history, iterations = 0.0, [], 0
    linear: LinearSolver = Krylov() if method == "newton_krylov" else direct
    while True:
        size = min(step, 1.0 - factor)
        target = 1.0 if size == 1.0 - factor else factor + size
        trial = _predict(scene, linear, q, factor, size) if predictor == "tangent" else q
        new, code, residuals = _attempt(scene, method, linear, trial, target, tolerance, most, shown)
        if code == SolveEnding.CONVERGED and bool(torn(scene.families, scene.displacement(new, target))):
            code = SolveEnding.TORN
        history += residuals
        iterations += (len(residuals) - 1) * (CHUNK if method == "relaxation" else 1)
        if code == SolveEnding.CONVERGED:
            q, factor = new, target
            if factor >= 1.0:
                return q, factor, code, history, iterations, None
            if len(residuals) - 1 <= EASY:
                step = min(2 * step, 1.0)
        elif size / 2 < smallest_step:
            failed = f"from load factor {factor:.6g} to {target:.6g}"
            if factor == 0.0 and size == 1.0:
                q, factor = new, 1.0  # The only step, to the full load, failed: return the state it reached.
            elif code not in (SolveEnding.SINGULAR, SolveEnding.NOT_FINITE, SolveEnding.TORN):
                code = SolveEnding.STEP_TOO_SMALL
            return q, factor, code, history, iterations, failed
        else:
            step = size / 2


def _sound(scene: Scene, q: np.ndarray, factor: float) -> bool:
    """Whether the forces are finite on every point, held points included.

    The scale of the residual contains all of these forces, and its program is already compiled.
    """
    return bool(np.isfinite(np.asarray(residual_and_scale(scene, q, factor)[1])))


def _check(scene, method, tolerance, step, smallest_step, predictor) -> None:
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene (pdjax.scene or pdjax.scenes); got {type(scene).__name__}")
    choice("method", method, SOLVERS)
    choice("predictor", predictor, ("tangent", "none"))
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance must lie between 0 and 1; got {tolerance}")
    if not (0 < smallest_step <= step <= 1):
        raise ValueError(f"need 0 < smallest_step <= step <= 1; got step {step}, smallest_step {smallest_step}")


@public_function
@in_double
def solve(
    scene: Scene,
    method: str = "newton",
    *,
    start=None,
    step: float = 1.0,
    smallest_step: float = 1e-3,
    predictor: str = "none",
    tolerance: float | None = None,
    max_iterations: int | None = None,
    stability: bool = True,
    show_progress: bool = True,
    throw: bool = False,
) -> Equilibrium:
    """Solve a scene for its equilibrium at the full load.

    Parameters
    ----------
    scene : Scene
        The boundary value problem.
    method : str, optional
        "newton" (exact sparse Jacobian and line search), "newton_krylov" (Newton's method with products A v instead of
        a matrix, preconditioned on a lattice), "trust_region" (dogleg of optimistix with a dense Jacobian; runs under
        jit and vmap) or "relaxation" (adaptive dynamic relaxation).
    start : array, shape (points, dim), optional
        Displacements [length] at which the iteration starts; only free components are used. The default is zero.
    step : float, optional
        First load step [-]; 1 applies the full load at once.
    smallest_step : float, optional
        Smallest load step [-]; a step that fails is halved until it would become smaller.
    predictor : str, optional
        "none" (the free points start each load step from the last state, as in the paper's experiment) or "tangent".
    tolerance : float, optional
        Largest relative residual [-]. The default is 1e-10, in float32 1e-5.
    max_iterations : int, optional
        Largest number of iterations of a load step. The default depends on the method.
    stability : bool, optional
        Compute the largest eigenvalue of the Jacobian at the end.
    show_progress : bool, optional
        Show the load factor and the residual on a terminal.
    throw : bool, optional
        Raise RuntimeError if the solver does not converge.

    Returns
    -------
    Equilibrium
        The displacement, why the solver stopped, and the stability. JAX differentiates `u` exactly (first and second
        derivatives, forward and reverse) with respect to every array of the scene. These derivatives are NaN if the
        solver did not converge.

    Raises
    ------
    ValueError
        If an argument is wrong, or a method other than "trust_region" is traced by jit or vmap.
    RuntimeError
        If `throw` is True and the solver did not converge; the message gives the reason.

    Notes
    -----
    For bodies in 3D of more than some thousand unknowns use "newton_krylov" with `stability=False`: the derivatives and
    the stability factorise the Jacobian. `use_direct_solver` chooses the solver for the factorisations.

    Examples
    --------
    >>> body = pd.lattice((5, 4))
    >>> families, model = pd.families(body, horizon=2.1), pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> left = body.positions[:, 0] < 1
    >>> plate = pd.scene(body, families, model, pd.prescribe(left), pd.body_force(~left, [0.01, 0.0]))
    >>> found = pd.solve(plate)
    >>> found.kind, round(float(found.u[-1, 0]), 4)
    ('minimum', 0.0279)
    """
    if tolerance is None and isinstance(scene, Scene):
        tolerance = 1e-10 if scene.prescribed.dtype == jnp.float64 else 1e-5  # rounding: up to 1e-11, 1e-7
    _check(scene, method, tolerance, step, smallest_step, predictor)
    most = ITERATIONS[method] if max_iterations is None else max_iterations
    dtype = scene.prescribed.dtype
    if start is None:
        q = np.zeros(scene.unknowns.shape[0], dtype)
    else:
        xp = namespace(start, scene.unknowns)
        q = xp.asarray(start, dtype).reshape(-1)[xp.asarray(scene.unknowns)]
    quiet = frozen(scene)
    if inside_jit() or not is_concrete(quiet, q):
        if method != "trust_region":
            raise ValueError(f"method {method!r} runs on the host; under jit or vmap use method='trust_region'")
        return _traced(scene, quiet, q, tolerance, most)
    q, factor, code, history, iterations, failed = _climb(
        quiet, method, q, step, smallest_step, predictor, tolerance, most, show_progress
    )
    u = at = quiet.displacement(q, factor)
    if not is_concrete(scene):  # `quiet` is concrete, so the scene is traced for a derivative
        u = _differentiable(
            scene,
            attach(scene, q, factor) if code == SolveEnding.CONVERGED else q,
            factor,
            code != SolveEnding.CONVERGED,
        )
    look = stability and scene.model.hyperelastic and _sound(quiet, q, factor)
    result = Equilibrium(
        u,
        on_device(np.asarray(factor, dtype)),
        np.asarray(history),
        iterations,
        code,
        int(turned_bonds(quiet.families, at)),
        body_stability(quiet, at, factor) if look else None,
        failed,
        method,
    )
    if throw and not result.converged:
        raise RuntimeError(f"no equilibrium of the {scene.name}: {result}")
    return result


@eqx.filter_jit
def _place(scene: Scene, q: Array | np.ndarray, factor, bad) -> Array:
    return without_derivative(scene.displacement(q, factor), leaves_sum(scene), bad)


def _differentiable(scene: Scene, q, factor: float, bad: bool) -> Array:
    """u of a scene that is traced for a derivative; the derivative is NaN if `bad`."""
    return _place(scene, q, np.asarray(factor, q.dtype), np.asarray(bad))


def _traced(scene: Scene, quiet: Scene, start: Array | np.ndarray, tolerance, most: int) -> Equilibrium:
    """One load step to the full load, wholly in JAX. Its derivative comes from a dense implicit solve."""
    found, code, history = trust_region(quiet, start, 1.0, tolerance, most)
    q = jax.lax.stop_gradient(found)
    # Two Newton steps at the root leave its value unchanged and make derivatives up to the second exact.
    for _ in range(2):
        A = jax.jacfwd(lambda p: residual_of(scene, p, 1.0))(q)
        r = residual_of(scene, q, 1.0)
        q = q - jnp.linalg.solve(A, r - jax.lax.stop_gradient(r))
    u = scene.displacement(q, 1.0)
    code = jnp.where((code == SolveEnding.CONVERGED) & torn(quiet.families, u), int(SolveEnding.TORN), code)
    u = without_derivative(u, leaves_sum(scene), code != SolveEnding.CONVERGED)
    used = jnp.sum(jnp.isfinite(history)) - 1
    turned = turned_bonds(quiet.families, u)
    return Equilibrium(u, jnp.ones((), q.dtype), history, used, code, turned, None, None, "trust_region")
