"""Newton–Krylov with the preconditioner of lattices: the solutions of the direct solver, in few products."""

import equinox as eqx
import numpy as np
import pytest
from bodies import random, worst

import pdjax as pd
from pdjax.finite_body.factorisation import matrix, product, residual
from pdjax.finite_body.statics import lattice_response as preconditioner
from pdjax.finite_body.statics.newton import Krylov
from pdjax.scenes import step_size_bar

LAW = pd.LinearElastic(1.0, 0.8)


class NoEnergy(pd.LPS):
    """A model with an energy that declares that it has none, so that GMRES solves its equations."""

    hyperelastic = False


def pulled(shape, N, model, **options):
    """A lattice that is held at one end and pulled along x at the other, where its sides may slide."""
    body = pd.lattice(shape, **options)
    x, layer = body.positions[:, 0], int(N) - 0.5
    left, right = x < x.min() + layer, x > x.max() - layer
    return pd.scene(
        body, pd.families(body, 1.005 * N), model, pd.prescribe(left), pd.prescribe(right, 0.02, components=0)
    )


def with_hole():
    mask = np.ones((15, 8), dtype=bool)
    mask[6:9, 3:5] = False
    return pulled((15, 8), 2, pd.LPS(1.0, 1.0), mask=mask)


def a_cloud():
    body = pd.lattice((12, 6))
    moved = body.positions + 0.1 * random(1).uniform(-1, 1, body.positions.shape)
    cloud = pd.cloud(moved, 1.0)
    left, right = moved[:, 0] < 2, moved[:, 0] > 10
    return pd.scene(
        cloud, pd.families(cloud, 2.3), pd.LPS(1.0, 1.0), pd.prescribe(left), pd.prescribe(right, 0.02, components=0)
    )


def a_stretched_ring():
    body = pd.lattice((14, 9), periodic=True)
    c = 1 + 0.3 * np.sin(2 * np.pi * body.positions[:, 0] / 14)
    model = pd.graded(pd.BondBased(1.0), c)
    return pd.scene(body, pd.families(body, 2.1), model, pd.prescribe(0), mean=[[1.02, 0.0], [0.01, 1.0]])


SCENES = {
    "bar": lambda: pulled((60,), 3, pd.SethHill(0.0, LAW)),
    "plate": lambda: pulled((16, 7), 2, pd.SethHill(1.0, LAW)),
    "block": lambda: pulled((8, 5, 4), 2, pd.LPS(1.0, 1.0)),
    "controlled block": lambda: pulled((8, 5, 4), 1.5, pd.Correspondence(LAW, pd.WanControl())),
    "plate with a hole": with_hole,
    "cloud": a_cloud,
    "periodic, graded, mean deformation": a_stretched_ring,
    "unsymmetric": lambda: pulled((16, 7), 2, NoEnergy(1.0, 1.0)),
}


@pytest.mark.parametrize("name", SCENES)
def test_newton_krylov_equals_the_direct_solver(name):
    """Bodies with free and held components, lattices and others, symmetric and unsymmetric systems."""
    scene = SCENES[name]()
    direct, krylov = (pd.solve(scene, method, stability=False) for method in ("newton", "newton_krylov"))
    assert direct.converged and krylov.converged and krylov.iterations <= direct.iterations + 1
    assert worst(krylov.u, direct.u) / worst(direct.u) < 1e-8  # measured 2e-10 (periodic), 2e-11 (others)


def test_newton_krylov_finds_a_saddle():
    """At −0.1 % the smooth state of this bar has 3 unstable modes, so A is indefinite; MINRES needs only M > 0."""
    found = pd.solve(step_size_bar(100, 3, -1e-3), "newton_krylov", predictor="tangent")
    assert found.converged and found.kind == "saddle" and found.stability.positive == 3
    form = step_size_bar(100, 3, -1e-3).closed_form
    assert worst(found.u, form) / worst(form) < 1e-9  # measured 8e-11


def products(scene, preconditioned=True) -> int:
    """Products A v until the residual of one linear system has fallen to 1e-5."""
    q, linear = np.zeros(len(scene.unknowns)), Krylov()
    if not preconditioned:
        linear._nearly.append(None)
    linear(scene, q, 1.0)(np.asarray(residual(scene, q, 1.0)))
    return linear.products


def test_the_number_of_products_grows_slowly_with_the_body():
    """Without the preconditioner it doubles with the length of a plate, as the square root of the condition number."""
    model = pd.LPS(1.0, 1.0)
    plates = [pulled((n, n // 2), 2, model) for n in (16, 32, 64)]
    few, many = [products(p) for p in plates], [products(p, False) for p in plates]
    assert many[2] > 1.6 * many[1] > 2.5 * many[0]  # measured 33, 63, 126
    assert few[2] < 1.4 * few[0] and few[2] < many[2] / 3  # measured 30, 30, 35
    bars = [pulled((n,), 3, pd.BondBased(1.0)) for n in (100, 800)]
    assert max(map(products, bars)) <= 12  # measured 9, 9; 410 without it for the longer one


def dense(scene):
    """(A, M⁻¹) of a small scene."""
    q, size = np.zeros(len(scene.unknowns)), len(scene.unknowns)
    M = preconditioner.lattice_response(scene, lambda v: product(scene, q, 1.0, v))
    return matrix(scene, scene.displacement(q, 1.0)).toarray(), np.stack([M(e) for e in np.eye(size)], axis=1)


@pytest.mark.parametrize(
    "model", [pd.LPS(1.0, 1.0), pd.Correspondence(LAW), pd.SethHill(0.0, LAW)], ids=["LPS", "Silling", "Seth–Hill"]
)
def test_the_preconditioner_is_symmetric_and_positive_definite(model):
    """Also where the lattice has zero-energy modes, and where the body is thinner than the reach of its forces."""
    _, inverse = dense(pulled((9, 4), 2, model))
    assert worst(inverse, inverse.T) / worst(inverse) < 1e-13  # measured 2e-16
    values = np.linalg.eigvalsh(inverse)
    assert values.min() > 1e-3 * values.max()  # measured 3e-2 and more


def test_the_preconditioner_is_the_inverse_for_a_homogeneous_periodic_body():
    """One point is held, so A M⁻¹ differs from −1 by the constraint alone: a matrix of rank 2 · dim at most."""
    body = pd.lattice((9, 7), periodic=True)
    scene = pd.scene(body, pd.families(body, 2.1), pd.LPS(1.0, 1.0), pd.prescribe(0))
    A, inverse = dense(scene)
    size = np.linalg.svd(A @ inverse + np.eye(len(A)), compute_uv=False)
    assert (size > 1e-10).sum() <= 4 and size[4] < 1e-12  # measured 2e-15


def test_clouds_and_scenes_without_a_free_point_have_no_preconditioner():
    assert preconditioner.lattice_response(a_cloud(), lambda v: v) is None
    body = pd.lattice((6, 4))
    sliding = pd.scene(
        body,
        pd.families(body, 1.5),
        pd.LPS(1.0, 1.0),
        pd.prescribe(np.arange(24), 0.0, components=1),
        pd.prescribe([0], 0.0, components=0),
    )
    assert preconditioner.lattice_response(sliding, lambda v: v) is None
    loaded = eqx.tree_at(lambda s: s.load, sliding, np.tile([1e-3, 0.0], (24, 1)) * (np.arange(24) > 0)[:, None])
    assert pd.solve(loaded, "newton_krylov", stability=False).converged
