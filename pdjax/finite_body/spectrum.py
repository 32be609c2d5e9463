"""Stability of a finite body: the spectrum of its exact Jacobian, with its surfaces, supports and loads.

    H = V^{-½} A V^{-½} = S V^½ J V^{-½} Sᵀ,     H w = λ w,   v = V^{-½} w     (A, S: pdjax.finite_body.scene)

J is the Jacobian of the force density, V the volumes of the points and A the reduced Jacobian. In this module λ is an
eigenvalue, not the load factor. H is symmetric for a model with an energy. Its eigenvalues are those of J on the free
components. If every λ is negative, the state is a minimum of the potential energy. If a λ is positive, a
perturbation along its mode v grows at the rate √(λ/ρ), where ρ is the mass density.

Three methods compute the largest eigenvalues. The size of the body decides which one is used by default:

- dense: `numpy.linalg.eigh` computes all eigenvalues.
- sparse: Lanczos iteration in shift-and-invert mode with sparse matrix factorisations. Their inertia (the number of
  positive eigenvalues) shows that no eigenvalue was missed.
- matrix_free: Lanczos iteration with Jacobian-vector products. It stores no matrix and does not count eigenvalues.

For the first two methods `pdjax.finite_body.inertia` proves the number of positive eigenvalues, where rounding permits.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.typing import DTypeLike
from jaxtyping import Array

from .._internal.checks import choice, in_double
from .._internal.public import public_function
from .._internal.shown import told
from ..force.fields import point_field
from .factorisation import Factor, Singular, as_operator, count_positive, matrix, product, unknown_volumes
from .inertia import Inertia, prove, shifted
from .scene import Scene

if TYPE_CHECKING:
    import scipy.sparse.linalg

DENSE = 1500  # unknowns up to which all eigenvalues take less time than two sparse factorisations and Lanczos (0.5 s)
SPARSE = 250_000  # unknowns up to which sparse factorisations are used: 10⁵ unknowns in 2D take 4 GB
METHODS = ("auto", "dense", "sparse", "matrix_free")


class BodyStability(eqx.Module):
    """Result of `body_stability`: the largest eigenvalue of the Jacobian of a body, its mode and the verdict.

    Attributes
    ----------
    eigenvalue : float
        Largest eigenvalue of J on the free components [force/length^(dim+1)].
    positive : int or None
        Number of eigenvalues above `tolerance`. None if they were not counted (method "matrix_free").
    mode : array, shape (points, dim)
        Mode of the largest eigenvalue, of unit length; 0 on held components.
    residual : float
        ‖H w − λ w‖ of the largest eigenvalue [force/length^(dim+1)].
    norm : float
        ‖H‖, the largest absolute eigenvalue [force/length^(dim+1)].
    tolerance : float
        Eigenvalues between −tolerance and tolerance count as zero [force/length^(dim+1)].
    eigenvalues : array, shape (count,)
        The computed eigenvalues, largest first [force/length^(dim+1)].
    method : str
        The method that was used: "dense", "sparse" or "matrix_free".
    factorisations : int
        Number of sparse matrix factorisations.
    proved : bool
        True if it is proved that H has exactly `positive` eigenvalues above `tolerance` and that all others are below
        −`tolerance`. The proof covers all rounding errors of the count. It does not cover those of the entries of H,
        the float64 matrix that was computed. It fails if an eigenvalue is zero to rounding, as for rigid modes.
    backward_error : float
        Bound of the backward error of the count, relative to `norm` [-]. The pivots that were counted are those of a
        shifted H with an error of at most this size in the 2-norm. It is inf if no bound is known.
    reason : str
        Why the count is not proved; empty if it is.

    Examples
    --------
    >>> result = pd.body_stability(pd.scenes.step_size_bar(20, N=3, strain=-0.1))
    >>> result.verdict, result.kind, result.positive, result.proved
    ('unstable', 'saddle', 5, True)
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
    proved: bool = eqx.field(static=True)
    backward_error: float
    reason: str = eqx.field(static=True)

    @property
    def verdict(self) -> str:
        """Verdict "stable", "marginal" or "unstable". It is marginal if the largest eigenvalue is zero to rounding."""
        if self.eigenvalue > self.tolerance:
            return "unstable"
        return "stable" if self.eigenvalue < -self.tolerance else "marginal"

    @property
    def kind(self) -> str:
        """Kind of stationary point of the potential energy: "minimum", "degenerate" or "saddle".

        It says what an equilibrium is, and has no meaning at other states.
        """
        return {"stable": "minimum", "marginal": "degenerate", "unstable": "saddle"}[self.verdict]

    def __repr__(self) -> str:
        return told(self)

    def __str__(self) -> str:
        count = "not counted"
        if self.positive is not None:
            count = f"{self.positive} positive, " + ("count proved" if self.proved else f"not proved: {self.reason}")
        return (
            f"body: {self.verdict}, largest eigenvalue {self.eigenvalue:.6e} (zero within {self.tolerance:.0e}),"
            f" {count}; residual {self.residual:.1e}, {self.method}"
        )


def closed_form(scene: Scene, instead: str) -> Array:
    """The closed form of the scene. Without one, raises ValueError that says what to pass `instead`."""
    if scene.closed_form is None:
        raise ValueError(f"this scene has no closed form to use as the displacement: pass {instead}")
    return scene.closed_form


def _state(scene: Scene, u, factor) -> Array:
    if u is None:
        u = factor * np.asarray(closed_form(scene, "the displacement u (points, dim)"))
    return point_field(u, scene.families)


def zero_tolerance(norm: float, dtype: DTypeLike) -> float:
    """64 eps ‖H‖. Smaller eigenvalues count as zero.

    The zero modes of free bars have eigenvalues of 2 to 9 eps ‖H‖ (measured).
    """
    return 64 * float(jnp.finfo(dtype).eps) * norm


def too_small(size: int, k: int = 1) -> bool:
    """Whether a matrix of `size` unknowns is too small for Lanczos iteration to `k` eigenpairs.

    ARPACK needs more unknowns than eigenvalues.
    """
    return size <= max(k, 2)


def eigenpairs(
    H: "sp.csc_array | scipy.sparse.linalg.LinearOperator", k: int, M: sp.csc_array | None = None, **options: object
) -> tuple[np.ndarray, np.ndarray]:
    """`k` eigenvalues and eigenvectors of H v = λ M v. If H is too small for ARPACK, all of them, smallest first.

    H and M are symmetric matrices or operators, M is positive definite and the identity by default. `options` are those
    of `scipy.sparse.linalg.eigsh`. They say which eigenpairs are wanted.
    """
    size = H.shape[0]
    if too_small(size, k):
        import scipy.linalg

        I = np.eye(size)
        return scipy.linalg.eigh(H @ I, None if M is None else M @ I)
    import scipy.sparse.linalg as sla

    return sla.eigsh(H, k=k, M=M, **options)


def norm_of(H: "sp.csc_array | scipy.sparse.linalg.LinearOperator") -> float:
    """‖H‖ from a few Lanczos steps: a lower bound, less than one per cent too small."""
    return float(np.abs(eigenpairs(H, 1, which="LM", tol=1e-3)[0]).max())


def full_displacement(scene: Scene, w: np.ndarray, root: np.ndarray) -> np.ndarray:
    """The mode v on all points, of unit length, from the eigenvector w of H."""
    v = np.zeros(scene.prescribed.size)
    v[np.asarray(scene.unknowns)] = w / root
    v = v / np.linalg.norm(v)
    v = v * np.sign(v[np.argmax(np.abs(v))])
    return v.reshape(scene.prescribed.shape)


def need_energy(scene: Scene) -> None:
    """Raise ValueError for a scene whose model has no energy."""
    if not scene.model.hyperelastic:
        raise ValueError(
            f"{type(scene.model).__name__} has no energy, so its Jacobian is not symmetric; eigenvalues of bodies are"
            " computed for symmetric Jacobians only: choose a model with an energy (hyperelastic = True)"
        )


def scaled_matrix(A: sp.csc_array, root: np.ndarray) -> sp.csc_array:
    """H = V^{-½} A V^{-½} from the reduced Jacobian A and `root`, the square roots of the volumes of its unknowns."""
    A, scale = A.tocoo(), 1 / root
    # The product of the two factors comes first, so that H is symmetric to the last bit if A is.
    return sp.coo_array((A.data * (scale[A.row] * scale[A.col]), (A.row, A.col)), A.shape).tocsc()


def nearest(
    H: sp.csc_array, solve: Callable[[np.ndarray], np.ndarray], shift: float, k: int, start: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """The eigenpairs of H nearest to `shift`, by Lanczos iteration on (H − shift)⁻¹: at most k, at least one.

    A solve has the relative error eps × condition number. Lanczos therefore cannot always bring k eigenvectors to
    1e-8 (the error of an eigenvalue is the square of that). Then the function returns the pairs that did converge. If
    none did, it returns one pair from inverse iteration.
    """
    import scipy.sparse.linalg as sla

    inverse = sla.LinearOperator(H.shape, matvec=solve, dtype=float)
    try:
        values, vectors = eigenpairs(H, k, sigma=shift, OPinv=inverse, v0=start, tol=1e-8, maxiter=200)
        order = np.argsort(np.abs(values - shift))[:k]
        return values[order], vectors[:, order]
    except sla.ArpackNoConvergence as failure:
        if len(failure.eigenvalues):
            return failure.eigenvalues, failure.eigenvectors
    w = np.ones(H.shape[0]) if start is None else start
    for _ in range(60):
        w = solve(w)
        w = w / np.linalg.norm(w)
    return np.array([w @ (H @ w)]), w[:, None]


def _certified_top(H: sp.csc_array, count: int, tolerance: float, norm: float) -> tuple:
    """The largest eigenvalues by shift and invert, the number above the tolerance, its proof, the factorisations."""
    size = H.shape[0]
    start = 0.5 * np.random.default_rng(1).normal(size=size)
    proof, factor = prove(H, norm, tolerance)
    positive, factors = proof.positive, proof.factorisations

    def near(factor: Factor, shift: float) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = nearest(H, factor.solve, shift, count, np.ones(size) + start)
        order = np.argsort(values)[::-1]
        return values[order], vectors[:, order]

    if factor is not None:  # No eigenvalue lies above −shift, so the nearest ones are the largest.
        return *near(factor, -proof.shift), 0, proof, factors
    least = 0.0
    if not proof.proved:
        factor = Factor(shifted(H, tolerance))
        values, vectors = near(factor, tolerance)
        positive, factors = factor.positive, factors + 1
        del factor
        if positive == 0:
            return values, vectors, 0, proof, factors
        least = values[0]
    # The state is unstable. Lanczos without a matrix factorisation gives the largest eigenvalue to a few digits. One
    # factorisation just above it makes it exact and shows that no eigenvalue lies higher.
    rough = eigenpairs(H, 1, which="LA", tol=1e-4, v0=np.ones(size) + start)[0][-1]
    shift = max(rough, least) + 1e-3 * max(rough, tolerance)
    for _ in range(6):
        factor = Factor(shifted(H, shift))
        values, vectors = near(factor, shift)
        factors += 1
        if factor.positive == 0:
            return values, vectors, positive, proof, factors
        del factor
        shift = values[0] + 2 * abs(values[0] - shift)
    raise Singular("6 shifts did not find a bound above the largest eigenvalue")


@public_function
@in_double
def body_spectrum(scene: Scene, u=None, count: int | None = None, factor: float = 1.0, method: str = "auto") -> tuple:
    """Compute the largest eigenvalues of the Jacobian of a body on its free components, and their modes.

    Parameters
    ----------
    scene : Scene
        The boundary value problem.
    u : array, shape (points, dim), optional
        Displacements [length]. The default is the closed form of the scene times `factor`.
    count : int, optional
        Number of eigenvalues. The default, None, gives all of them by the dense method.
    factor : float, optional
        Load factor λ [-]. It scales the loads and the mean deformation.
    method : str, optional
        "dense" (all eigenvalues), "sparse" (shift and invert with sparse matrix factorisations), "matrix_free"
        (Jacobian-vector products) or "auto" (chosen by the number of unknowns).

    Returns
    -------
    values : array, shape (count,)
        Eigenvalues, largest first [force/length^(dim+1)].
    modes : array, shape (count, points, dim)
        Their modes, each of unit length.
    about : dict
        `norm` ‖H‖; `tolerance`, below which an eigenvalue counts as zero; `positive`, the number of eigenvalues above
        the tolerance, None if not counted; `residuals` ‖H w − λ w‖; `method`; `factorisations`, their number;
        `proved`, `backward_error` and `reason`, the proof of `positive` (see `BodyStability`).

    Raises
    ------
    ValueError
        If the model has no energy, the forces at u are not finite, or both u and a closed form are missing.

    Examples
    --------
    >>> bar = pd.scenes.step_size_bar(20, N=3, strain=-0.1)
    >>> values, modes, about = pd.body_spectrum(bar, count=3)
    >>> values.round(2), modes.shape, about["positive"]
    (array([52.45, 45.51, 39.51]), (3, 20, 1), 5)
    """
    choice("method", method, METHODS)
    if count is not None and not (isinstance(count, int | np.integer) and count >= 1):
        raise ValueError(f"count must be a whole number >= 1, or None for all eigenvalues; got {count!r}")
    need_energy(scene)
    u = _state(scene, u, factor)
    size = len(np.asarray(scene.unknowns))
    if too_small(size):
        method = "dense"
    if method == "auto":
        fits = "sparse" if size <= SPARSE else "matrix_free"
        method = "dense" if size <= DENSE or count is None else fits
    root = np.sqrt(unknown_volumes(scene))
    positive: int | None = None
    factors = 0
    proof = Inertia(None, False, np.inf, "the matrix-free method does not count eigenvalues", 0.0, 0)
    if method == "matrix_free":
        q, scene = np.asarray(u).reshape(-1)[np.asarray(scene.unknowns)], scene.prepared()
        H = as_operator(lambda v: np.asarray(product(scene, q, factor, v / root)) / root, size)
        entries = H @ np.ones(size)
    else:
        H = scaled_matrix(matrix(scene, u, factor), root)
        entries = H.data
    if not np.isfinite(entries).all():  # where a force is not finite, its derivatives are not finite either
        raise ValueError("the forces at u are not finite: a bond has length zero, or u contains NaN")
    if method == "dense":
        values, vectors = np.linalg.eigh(H.toarray())
        values, vectors = values[::-1], vectors[:, ::-1]
        norm = float(np.abs(values).max())
        tolerance = zero_tolerance(norm, u.dtype)
        proof = prove(H, norm, tolerance)[0]
        positive, factors = proof.positive if proof.proved else int((values > tolerance).sum()), proof.factorisations
        values, vectors = values[:count], vectors[:, :count]
    else:
        k = min(count or 1, size - 1)
        norm = norm_of(H)
        tolerance = zero_tolerance(norm, u.dtype)
        if method == "sparse":
            values, vectors, positive, proof, factors = _certified_top(H, k, tolerance, norm)
        else:
            values, vectors = eigenpairs(H, k, which="LA", tol=1e-11, ncv=min(size, max(40, 3 * k)), maxiter=2000)
            values, vectors = values[::-1], vectors[:, ::-1]
    residuals = np.array([np.linalg.norm(H @ w - x * w) for x, w in zip(values, vectors.T, strict=True)])
    modes = np.array([full_displacement(scene, w, root) for w in vectors.T])
    about = {
        "norm": norm,
        "tolerance": tolerance,
        "positive": positive,
        "residuals": residuals,
        "method": method,
        "factorisations": factors,
        "proved": proof.proved,
        "backward_error": proof.error / norm if norm > 0 else np.inf,
        "reason": proof.reason,
    }
    return values, modes, about


@public_function
@in_double
def body_stability(scene: Scene, u=None, factor: float = 1.0, method: str = "auto") -> BodyStability:
    """Decide whether a finite body is stable at a displacement, from the largest eigenvalue of its Jacobian.

    Parameters
    ----------
    scene : Scene
        The boundary value problem.
    u : array, shape (points, dim), optional
        Displacements [length]. The default is the closed form of the scene times `factor`.
    factor : float, optional
        Load factor λ [-]. It scales the loads and the mean deformation.
    method : str, optional
        "auto", "dense", "sparse" or "matrix_free", see `body_spectrum`.

    Returns
    -------
    BodyStability
        Verdict, largest eigenvalue, mode, and number of positive eigenvalues with its proof. The residual of the
        eigenpair is below 1e-10 of ‖H‖.

    Raises
    ------
    ValueError
        As `body_spectrum`.

    Examples
    --------
    A clamped bar of 20 points and horizon 3 spacings, at 10 % and at 0.5 % compression:

    >>> bar = pd.scenes.step_size_bar(20, N=3, strain=-0.1)
    >>> pd.body_stability(bar).verdict, pd.body_stability(bar, factor=0.05).verdict
    ('unstable', 'stable')

    A damaged body is judged with the families of the bonds that remain. A crack through a third of a clamped plate
    makes its softest mode softer:

    >>> body, held = pd.lattice((6, 6)), pd.prescribe(np.arange(12), 0.0)
    >>> families = pd.families(body, horizon=2.1)
    >>> cut = pd.cut(families, pd.Segment((3.0, 0.0), (3.0, 2.0)))
    >>> cracked = families.with_broken(np.asarray(cut.weight) < np.asarray(families.weight))
    >>> plates = (pd.scene(body, f, pd.LPS(1.5, 0.7), held) for f in (families, cracked))
    >>> before, after = (pd.body_stability(plate, np.zeros((36, 2))) for plate in plates)
    >>> after.verdict, round(after.eigenvalue / before.eigenvalue, 2)
    ('stable', 0.44)
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
        about["proved"],
        about["backward_error"],
        about["reason"],
    )


@public_function
@in_double
def body_inertia(scene: Scene, u=None, factor: float = 1.0) -> int:
    """Count the positive eigenvalues of the Jacobian of a body, from one sparse matrix factorisation.

    Parameters
    ----------
    scene : Scene
        The boundary value problem.
    u : array, shape (points, dim), optional
        Displacements [length]. The default is the closed form of the scene times `factor`.
    factor : float, optional
        Load factor λ [-]. It scales the loads and the mean deformation.

    Returns
    -------
    int
        Number of eigenvalues on the free components that exceed the rounding error.

    Raises
    ------
    ValueError
        As `body_spectrum`.

    Examples
    --------
    >>> bar = pd.scenes.step_size_bar(20, N=3, strain=-0.1)
    >>> pd.body_inertia(bar), pd.body_inertia(bar, factor=0.05)
    (5, 0)
    """
    need_energy(scene)
    u = _state(scene, u, factor)
    H = scaled_matrix(matrix(scene, u, factor), np.sqrt(unknown_volumes(scene)))
    return count_positive(shifted(H, zero_tolerance(norm_of(H), u.dtype)))
