"""The sparse direct solvers: PARDISO equals SuperLU, and who asks for a solver that is not installed is told."""

import importlib.util

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp
from bodies import random, worst

import pdjax as pd
from pdjax.finite_body import direct_solver
from pdjax.finite_body.factorisation import Factor, Singular
from pdjax.scenes import step_size_bar

HERE = importlib.util.find_spec("pypardiso") is not None
installed = pytest.mark.skipif(not HERE, reason="pypardiso is not installed")


@pytest.fixture(params=["superlu", pytest.param("pardiso", marks=installed)])
def solver(request):
    before = pd.use_direct_solver(request.param)
    yield request.param
    pd.use_direct_solver(before)


def matrices():
    """A definite, an indefinite and an unsymmetric sparse matrix of 40 unknowns."""
    rng = random(3)
    A = sp.random_array((40, 40), density=0.1, rng=rng, format="csc").tocsc()
    weights = sp.diags_array(rng.uniform(3, 5, 40))
    return {
        "definite": (-(A + A.T) - 2 * weights, True),
        "indefinite": (A + A.T + sp.diags_array(rng.choice([-4.0, 4.0], 40)), True),
        "unsymmetric": (A + weights, False),
    }


@pytest.mark.parametrize("kind", ["definite", "indefinite", "unsymmetric"])
def test_solutions_equal_those_of_dense_matrices(solver, kind):
    """One and several right-hand sides, with A and with its transpose."""
    A, symmetric = matrices()[kind]
    factor = direct_solver.factorised(A.tocsc(), symmetric)
    assert type(factor).__name__ == {"superlu": "Factor", "pardiso": "PardisoFactor"}[solver]
    for b in (random(1).normal(size=40), random(2).normal(size=(40, 3))):
        for transposed in (False, True):
            dense = A.toarray().T if transposed else A.toarray()
            assert worst(factor.solve(b, transposed), np.linalg.solve(dense, b)) < 1e-12  # measured 4e-15


def test_a_singular_matrix_is_refused(solver):
    A = sp.csc_array(np.array([[1.0, 1.0], [1.0, 1.0]]))
    with pytest.raises(Singular):
        direct_solver.factorised(A)


def test_equilibria_and_their_derivatives_do_not_depend_on_the_solver(solver):
    """A saddle, whose Jacobian is indefinite, and the derivative of a solution."""
    scene = step_size_bar(100, 3, -1e-3)
    found = pd.solve(scene, predictor="tangent")
    assert found.kind == "saddle" and found.stability.positive == 3
    assert worst(found.u, scene.closed_form) / worst(scene.closed_form) < 1e-12  # measured 3e-14

    model = pd.graded(pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0)), np.where(np.arange(31) < 13, 1.0, 0.5))

    def inside(strain):
        return pd.solve(step_size_bar(31, 2, strain, 4, model), tolerance=1e-12, stability=False).u[17, 0]

    slope, h = float(jax.grad(inside)(jnp.asarray(0.08))), 1e-5
    assert abs((inside(0.08 + h) - inside(0.08 - h)) / (2 * h) / slope - 1) < 1e-6  # measured 2e-11


def test_the_choice_is_returned_and_restored():
    before = pd.use_direct_solver("superlu")
    assert before == "auto" and pd.use_direct_solver(before) == "superlu"
    with pytest.raises(ValueError, match="name must be one of auto, superlu, pardiso; got 'mumps'"):
        pd.use_direct_solver("mumps")


def test_who_asks_for_pardiso_without_it_is_told_how_to_install_it(monkeypatch):
    def missing():
        raise ImportError("No module named 'pypardiso'")

    monkeypatch.setattr(direct_solver, "_pypardiso", missing)
    with pytest.raises(ImportError, match=r'needs the package pypardiso.*pip install "pdjax\[pardiso\]"'):
        pd.use_direct_solver("pardiso")
    monkeypatch.setattr(direct_solver, "MANY", 0)
    monkeypatch.setattr(direct_solver, "find_spec", lambda name: "found")
    assert isinstance(direct_solver.factorised(matrices()["definite"][0].tocsc()), Factor)  # "auto" does without


@installed
def test_large_matrices_go_to_pardiso_of_themselves(monkeypatch):
    A = matrices()["definite"][0].tocsc()
    assert isinstance(direct_solver.factorised(A), Factor)
    monkeypatch.setattr(direct_solver, "MANY", A.nnz)
    assert isinstance(direct_solver.factorised(A), direct_solver.PardisoFactor)
