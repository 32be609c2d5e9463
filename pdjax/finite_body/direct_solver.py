"""The choice of the sparse direct solver for A x = b: SuperLU (SciPy), or PARDISO where pypardiso is installed.

SuperLU orders the unknowns by minimum degree, keeps both triangles of a symmetric matrix, and uses one core. PARDISO
(Intel MKL) orders them by nested dissection, keeps one triangle, and uses all cores. Measured on two cores, float64,
time of the factorisation with SuperLU and with PARDISO:

    LPS plate 160 × 80, N = 3        24 880 unknowns    7.5 s    2.8 s    half of the entries in the factors
    LPS block 17 × 16 × 16, N = 2    11 008 unknowns    9.1 s    2.2 s    a third of the entries
    springs, 21 × 20 × 20, N = 2     22 000 unknowns     39 s    1.0 s    a quarter of the entries

It serves `solve`, its derivatives, `solve_breaking` and `identify`. Proofs of stability keep SuperLU, because their
bound of the rounding errors needs the entries of the factors.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._internal.checks import choice
from .._internal.public import public_function
from .factorisation import Factor, Singular, checked_backward_error

SOLVERS = ("auto", "superlu", "pardiso")
MANY = 500_000  # entries of A from which PARDISO is faster; a plate of 6000 unknowns with 10⁶ takes as long with both
INSTALL = 'pip install "pdjax[pardiso]"'

_chosen = "auto"


@public_function
def use_direct_solver(name: str = "auto") -> str:
    """Choose the sparse direct solver of `solve`, its derivatives, `solve_breaking` and `identify`.

    Parameters
    ----------
    name : {"auto", "superlu", "pardiso"}, optional
        "superlu" is that of SciPy. "pardiso" is that of Intel MKL, from the package pypardiso. "auto", the setting at
        import, takes PARDISO for matrices of at least 500 000 entries if pypardiso is installed, else SuperLU.

    Returns
    -------
    str
        The name that was chosen before, to restore it later.

    Raises
    ------
    ValueError
        If the name is none of these.
    ImportError
        If "pardiso" is asked for and cannot be loaded. The message says how to install it.

    Notes
    -----
    The setting holds for the whole process. Both solvers give the same solution to rounding. Where PARDISO had to
    change a pivot that is nearly zero, the matrix goes to SuperLU.

    Examples
    --------
    >>> before = pd.use_direct_solver("superlu")
    >>> pd.use_direct_solver(before)
    'superlu'
    """
    global _chosen
    choice("name", name, SOLVERS)
    if name == "pardiso":
        try:
            _pypardiso().PyPardisoSolver()
        except ImportError as error:
            why = f"the direct solver 'pardiso' needs the package pypardiso, which cannot be loaded ({error})"
            raise ImportError(f"{why}: {INSTALL}") from error
    before, _chosen = _chosen, name
    return before


def _pypardiso() -> Any:
    import pypardiso

    return pypardiso


class PardisoFactor:
    """The matrix factorisation of a sparse A by PARDISO, with the interface of `Factor` for solutions."""

    def __init__(self, A: sp.csc_array, symmetric: bool = True):
        self.matrix, self.symmetric = A, symmetric
        # Row by row; of a symmetric matrix the upper triangle.
        self._stored = sp.csr_matrix(sp.triu(A, format="csr") if symmetric else A.tocsr())
        self._stored.sort_indices()
        self._solver = _pypardiso().PyPardisoSolver(mtype=-2 if symmetric else 11)
        try:
            self._solver.factorize(self._stored)
        except (RuntimeError, ValueError, _pypardiso().PyPardisoError) as error:
            raise Singular(str(error)) from error
        if self._solver.get_iparm(14) > 0:
            raise Singular(f"PARDISO changed {self._solver.get_iparm(14)} pivots that are nearly zero")
        self.backward = checked_backward_error(A, self._apply)

    def _apply(self, b: np.ndarray, transposed: bool = False) -> np.ndarray:
        # The transpose of a matrix by rows is the same arrays by columns, by which the wrapper knows it.
        return self._solver.solve(self._stored.T if transposed and not self.symmetric else self._stored, b)

    def solve(self, b: np.ndarray, transposed: bool = False) -> np.ndarray:
        """A⁻¹ b with one step of iterative refinement."""
        b = np.asarray(b, float)
        A = self.matrix.T if transposed and not self.symmetric else self.matrix
        x = self._apply(b, transposed)
        return x + self._apply(b - A @ x, transposed)

    def __del__(self) -> None:
        if hasattr(self, "_solver"):
            self._solver.free_memory(everything=True)  # memory of MKL, which Python does not know


def factorised(A: sp.csc_array, symmetric: bool = True) -> Factor | PardisoFactor:
    """The factorisation of A for solutions A⁻¹ b, by the solver that `use_direct_solver` chose."""
    if _chosen == "pardiso" or (_chosen == "auto" and A.nnz >= MANY and find_spec("pypardiso") is not None):
        try:
            return PardisoFactor(A, symmetric)
        except Singular:
            pass
        except ImportError:  # installed without MKL; who asks for it by name is told
            if _chosen == "pardiso":
                raise
    return Factor(A, symmetric)
