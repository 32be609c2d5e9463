"""A linear solver that uses one matrix factorisation for many Jacobians that differ little: A x = b.

Between two rounds of breaking bonds the reduced Jacobian A changes in a few rows only. Let P be the factorised Jacobian
of an earlier state. The conjugate gradient method (SciPy) with the preconditioner P then needs few products A v, about
one for each bond that has broken since. A fresh factorisation is made only if CG does not converge in MOST iterations,
for example because too many bonds have broken, or because A is indefinite. For an LPS plate of 10⁴ points (N = 3) a
factorisation with the assembly of A takes as long as about 25 iterations of CG.

**Loose points.** A point without bonds, a piece that nothing holds, or a point that hangs on one bond has motions
without stiffness, and A is singular. The factorised matrix is therefore A − ε a I, with a the largest diagonal entry.
The residual has no part along a motion that no force resists, so such a motion keeps its present value. All other
unknowns are solved as if ε were 0, because Newton's method evaluates the residual without ε.
"""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from ..direct_solver import PardisoFactor, factorised
from ..factorisation import Factor, as_operator, matrix, product
from ..scene import Scene

MOST = 40  # iterations of CG before a fresh factorisation
LINEAR_TOLERANCE = 1e-6  # inexact Newton: an iteration can still reduce the residual by a factor of 10⁶
# ε: the softest bending mode of a slender body of 100 points has 1e-8 of the largest stiffness.
SHIFT = 1e-11


class Recycled:
    """b ↦ A⁻¹ b with the factorisation of an earlier A, for a scene whose model has an energy."""

    def __init__(self) -> None:
        self._factor: Factor | PardisoFactor | None = None
        self.factorisations = 0

    def forget(self) -> None:
        """Factorise afresh at the next call."""
        self._factor = None

    def _fresh(self, scene: Scene, q: np.ndarray, factor: float) -> Factor | PardisoFactor:
        A = matrix(scene, scene.displacement(q, factor), factor)
        size = float(np.abs(A.diagonal()).max())
        self._factor = factorised((A - SHIFT * size * sp.eye_array(A.shape[0], format="csc")).tocsc())
        self.factorisations += 1
        return self._factor

    def __call__(
        self, scene: Scene, q: np.ndarray, factor: float, enough: float = 0.0
    ) -> Callable[[np.ndarray], np.ndarray]:
        """The solver for A at q. `newton` takes it as its argument `solver`."""
        if self._factor is None:
            return self._fresh(scene, q, factor).solve
        import scipy.sparse.linalg as sla

        earlier = self._factor
        stiffness = as_operator(lambda v: -np.asarray(product(scene, q, factor, v)), q.shape[0])
        nearly = sla.LinearOperator(stiffness.shape, matvec=lambda v: -earlier.solve(v), dtype=float)

        def solve(b: np.ndarray) -> np.ndarray:
            x, failed = sla.cg(stiffness, -b, rtol=LINEAR_TOLERANCE, atol=0.0, maxiter=MOST, M=nearly)
            return self._fresh(scene, q, factor).solve(b) if failed or not np.isfinite(x).all() else x

        return solve
