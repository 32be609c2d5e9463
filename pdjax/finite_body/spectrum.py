"""The body criterion: the spectrum of the exact Jacobian of a finite body with its surfaces, clamps and loads.

    H = V^{-½} A V^{-½} = S V^½ J V^{-½} Sᵀ,     H w = λ w,   v = V^{-½} w     (A, S: `pdjax.finite_body.scene`)

H is symmetric for a model with an energy and has J's eigenvalues on the free components. λ < 0 throughout: a
minimum of the potential energy; λ > 0: a perturbation along v grows at the rate √(λ/ρ).

Three ways, by size: all of `eigh`; shift and invert with sparse factors, whose inertia proves that no eigenvalue was
passed over; Lanczos on JVPs alone, which stores no matrix and proves nothing about the count.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array

from .._internal.checks import choice, in_double
from .._internal.public import public_function
from ..force.fields import point_field
from .factorisation import Factor, Singular, as_operator, count_positive, matrix, product, unknown_volumes
from .scene import Scene

DENSE = 1500  # unknowns up to which all eigenvalues cost less than two factorisations and their Lanczos runs (0.5 s)
SPARSE = 250_000  # unknowns up to which a factor is tried: 10⁵ in 2D take 4 GB
METHODS = ("auto", "dense", "sparse", "matrix_free")


class BodyStability(eqx.Module):
    """The answer of `body_stability`.

    eigenvalue: the largest of J on the free components [force/length^(dim+1)]; mode (points, dim), unit length;
    residual ‖J v − λ v‖ in the norm where H is symmetric; norm: ‖H‖; positive: how many exceed `tolerance`, None
    if not counted; eigenvalues: the ones computed, largest first.
    """

    eigenvalue: float
    positive: int | None
    mode: np.ndarray
    residual: float
    norm: float
    tolerance: float
    eigenvalues: np.ndarray
    method: str = eqx.field(static=True)
    factorisations: int = eqx.field(static=True)

    @property
    def verdict(self) -> str:
        """ "stable", "marginal" (zero within rounding) or "unstable"."""
        if self.eigenvalue > self.tolerance:
            return "unstable"
        return "stable" if self.eigenvalue < -self.tolerance else "marginal"

    @property
    def kind(self) -> str:
        """What an equilibrium is: "minimum", "degenerate" or "saddle" of the potential energy."""
        return {"stable": "minimum", "marginal": "degenerate", "unstable": "saddle"}[self.verdict]

    def __str__(self) -> str:
        count = "not counted" if self.positive is None else f"{self.positive} positive"
        return (
            f"body: {self.verdict}, largest eigenvalue {self.eigenvalue:.6e} (zero within {self.tolerance:.0e}),"
            f" {count}; residual {self.residual:.1e}, {self.method}"
        )


def closed_form(scene: Scene, instead: str) -> Array:
    """The scene's closed form; ValueError that says what to pass `instead` where it has none."""
    if scene.closed_form is None:
        raise ValueError(f"this scene has no closed form to stand for u: pass {instead}")
    return scene.closed_form


def _state(scene: Scene, u, factor) -> Array:
    if u is None:
        u = factor * np.asarray(closed_form(scene, "the displacement u (points, dim)"))
    return point_field(u, scene.families)


def _tolerance(norm: float, dtype: Any) -> float:
    """Eigenvalues nearer to zero are rounding: 64 eps ‖H‖ (measured noise of the zero modes of free bars: 2 to 9)."""
    return 64 * float(jnp.finfo(dtype).eps) * norm


def _norm(H: Any) -> float:
    """‖H‖ by a few Lanczos steps: a lower bound within a per cent."""
    import scipy.sparse.linalg as sla

    if H.shape[0] < 3:
        return float(np.linalg.norm(H @ np.eye(H.shape[0]), 2))
    return float(abs(sla.eigsh(H, k=1, which="LM", tol=1e-3, return_eigenvectors=False)[0]))


def _full(scene: Scene, w: np.ndarray, root: np.ndarray) -> np.ndarray:
    """w of H → the unit mode v on all points."""
    v = np.zeros(scene.prescribed.size)
    v[np.asarray(scene.unknowns)] = w / root
    v = v / np.linalg.norm(v)
    v = v * np.sign(v[np.argmax(np.abs(v))])
    return v.reshape(scene.prescribed.shape)


def need_energy(scene: Scene) -> None:
    """Refuse a scene whose model has no energy."""
    if not scene.model.hyperelastic:
        raise ValueError(f"{type(scene.model).__name__} has no energy: its Jacobian is not symmetric in any volumes")


def _scaled(A: sp.csc_array, root: np.ndarray) -> sp.csc_array:
    D = sp.diags_array(1 / root)
    return (D @ A @ D).tocsc()


def shifted(H: sp.csc_array, shift: float) -> sp.csc_array:
    """H − shift: with `shift` the tolerance, what counts as zero is not positive."""
    return (H - shift * sp.eye_array(H.shape[0], format="csc")).tocsc()


def nearest(H: Any, factor: Factor, shift: float, k: int, start: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The eigenpairs of H next to `shift`, by Lanczos on (H − shift)⁻¹: at most k, at least one.

    A solve is good to eps × condition, so Lanczos can't always bring k pairs to 1e-8 (the error of a value is its
    square): those that it did are taken, or else the one that inverse iteration finds.
    """
    import scipy.sparse.linalg as sla

    inverse = sla.LinearOperator(H.shape, matvec=factor.solve, dtype=float)
    try:
        return sla.eigsh(H, k=k, sigma=shift, OPinv=inverse, v0=start, tol=1e-8, maxiter=200)
    except sla.ArpackNoConvergence as failure:
        if len(failure.eigenvalues):
            return failure.eigenvalues, failure.eigenvectors
    w = np.ones(H.shape[0]) if start is None else start
    for _ in range(60):
        w = factor.solve(w)
        w = w / np.linalg.norm(w)
    return np.array([w @ (H @ w)]), w[:, None]


def _certified_top(H: sp.csc_array, count: int, tolerance: float) -> tuple:
    """The largest eigenvalues by shift and invert, and the number above tolerance, both proved by inertia."""
    import scipy.sparse.linalg as sla

    size, factors = H.shape[0], 0

    def near(shift: float, k: int) -> tuple[int, np.ndarray, np.ndarray]:
        nonlocal factors
        factor = Factor(shifted(H, shift))
        factors += 1
        values, vectors = nearest(H, factor, shift, k, np.ones(size) + start)
        order = np.argsort(values)[::-1]
        return factor.positive, values[order], vectors[:, order]

    start = 0.5 * np.random.default_rng(1).normal(size=size)
    positive, values, vectors = near(tolerance, count)
    if positive == 0:
        return values, vectors, 0, factors
    # unstable: Lanczos without a factor finds the top to a few digits, one factor just above it proves and sharpens
    rough = sla.eigsh(H, k=1, which="LA", tol=1e-4, v0=np.ones(size) + start, return_eigenvectors=False)[0]
    shift = max(rough, values[0]) + 1e-3 * max(rough, tolerance)
    for _ in range(6):
        above, values, vectors = near(shift, count)
        if above == 0:
            return values, vectors, positive, factors
        shift = values[0] + 2 * abs(values[0] - shift)
    raise Singular("the top of the spectrum was not bracketed in 6 shifts")


@public_function
@in_double
def body_spectrum(scene: Scene, u=None, count: int | None = None, factor: float = 1.0, method: str = "auto") -> tuple:
    """The largest eigenvalues of the reduced Jacobian, largest first, and their modes.

    Arguments: scene; u (points, dim) [length], by default the scene's closed form times `factor`; count how many (None:
        all, dense); factor the load factor; method "auto", "dense", "sparse" (shift and invert), "matrix_free".
    Returns: eigenvalues (count,) [force/length^(dim+1)], modes (count, points, dim) of unit length, and a dictionary
        of norm, positive (count above rounding, None if unknown), residuals, method, factorisations.
    Raises: ValueError for a model without an energy, or no u where the scene has no closed form.
    """
    choice("method", method, METHODS)
    need_energy(scene)
    u = _state(scene, u, factor)
    size = len(np.asarray(scene.unknowns))
    if size < 3:
        method = "dense"
    if method == "auto":
        fits = "sparse" if size <= SPARSE else "matrix_free"
        method = "dense" if size <= DENSE or count is None else fits
    root = np.sqrt(unknown_volumes(scene))
    positive: int | None = None
    factors = 0
    if method == "matrix_free":
        q, scene = np.asarray(u).reshape(-1)[np.asarray(scene.unknowns)], scene.prepared()
        H: Any = as_operator(lambda v: np.asarray(product(scene, q, factor, v / root)) / root, size)
        entries = H @ np.ones(size)
    else:
        H = _scaled(matrix(scene, u, factor), root)
        entries = H.data
    if not np.isfinite(entries).all():  # derivatives of forces that are not finite are not finite either
        raise ValueError("the forces at u are not finite: a bond collapsed to no length, or u holds NaN")
    if method == "dense":
        values, vectors = np.linalg.eigh(H.toarray())
        values, vectors = values[::-1], vectors[:, ::-1]
        norm = float(np.abs(values).max())
        tolerance = _tolerance(norm, u.dtype)
        positive = int((values > tolerance).sum())
        values, vectors = values[:count], vectors[:, :count]
    else:
        k = min(count or 1, size - 1)
        norm = _norm(H)
        tolerance = _tolerance(norm, u.dtype)
        if method == "sparse":
            values, vectors, positive, factors = _certified_top(H, k, tolerance)
        else:
            import scipy.sparse.linalg as sla

            values, vectors = sla.eigsh(H, k=k, which="LA", tol=1e-11, ncv=min(size, max(40, 3 * k)), maxiter=2000)
            values, vectors = values[::-1], vectors[:, ::-1]
    residuals = np.array([np.linalg.norm(H @ w - x * w) for x, w in zip(values, vectors.T, strict=True)])
    modes = np.array([_full(scene, w, root) for w in vectors.T])
    about = {
        "norm": norm,
        "tolerance": tolerance,
        "positive": positive,
        "residuals": residuals,
        "method": method,
        "factorisations": factors,
    }
    return values, modes, about


@public_function
@in_double
def body_stability(scene: Scene, u=None, factor: float = 1.0, method: str = "auto") -> BodyStability:
    """Is a finite body stable at a displacement: the largest eigenvalue of its Jacobian, its mode, and the count.

    Arguments: as `body_spectrum`. Returns: `BodyStability`, with eigenpair residual below 1e-10 of the norm.
    Raises: ValueError as `body_spectrum`.
    """
    values, modes, about = body_spectrum(scene, u, 6 if len(np.asarray(scene.unknowns)) > 7 else 1, factor, method)
    return BodyStability(
        float(values[0]),
        about["positive"],
        modes[0],
        float(about["residuals"][0]),
        about["norm"],
        about["tolerance"],
        values,
        about["method"],
        about["factorisations"],
    )


@public_function
@in_double
def body_inertia(scene: Scene, u=None, factor: float = 1.0) -> int:
    """How many eigenvalues of the reduced Jacobian exceed rounding, from one sparse factor.

    Arguments, errors: as `body_stability`.
    """
    need_energy(scene)
    u = _state(scene, u, factor)
    H = _scaled(matrix(scene, u, factor), np.sqrt(unknown_volumes(scene)))
    return count_positive(shifted(H, _tolerance(_norm(H), u.dtype)))
