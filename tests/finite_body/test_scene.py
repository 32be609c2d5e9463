"""Scenes: supports and loads, the reduced system, and errors that name what is wrong with a problem."""

import functools

import bodies
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from table import KINDS, LINEAR, MODELS

import pdjax as pd
from pdjax.finite_body import factorisation as reduced

SVK = pd.SethHill(1.0, LINEAR)
HENCKY = pd.SethHill(0.0, LINEAR)
BAR = pd.bar(11, 11.0)
NEAR = pd.families(BAR, 2.0)
PLATE = pd.lattice((5, 3))
AROUND = pd.families(PLATE, 2.0)


@functools.cache
def cloud(name):
    """A cloud of 15 points with unequal volumes. Four points are held, one of them only in y; some are loaded."""
    rng = bodies.random(40)
    return pd.scene(
        bodies.points(2, "cloud"),
        bodies.families(2, "cloud"),
        MODELS[name],
        pd.prescribe([0, 1, 5], 0.05 * rng.normal(size=(3, 2))),
        pd.prescribe([9], 0.03, components=1),
        pd.body_force([2, 3, 11], 0.1 * rng.normal(size=(3, 2))),
        pd.total_force([12, 14], [0.2, -0.1]),
    )


@functools.cache
def box():
    """A periodic box under a mean deformation; one point is held and two are pulled apart."""
    body = pd.lattice((6, 7), 0.5, periodic=True)
    b = np.array([[0.3, -0.2], [-0.3, 0.2]])
    mean = bodies.deformation(2, 41)
    return pd.scene(
        body, pd.families(body, 1.0), SVK, pd.prescribe(0, [0.02, 0.01]), pd.body_force([9, 22], b), mean=mean
    )


def selection(scene):
    """The selection matrix S of `cloud`, written by hand: a row of the identity for each free component."""
    held = np.zeros((15, 2), dtype=bool)
    held[[0, 1, 5]] = True
    held[9, 1] = True
    return np.eye(30)[~held.reshape(-1)]


# ---------------------------------------------------------------- elimination


def test_displacement_takes_free_and_held_components_from_their_places():
    """u = λ û + Sᵀ q holds for every component."""
    scene, rng = cloud("seth_hill m=1"), bodies.random(40)
    q = bodies.random(42).normal(size=23)
    held = 0.05 * rng.normal(size=(3, 2))
    u = np.asarray(scene.displacement(jnp.asarray(q), 0.4))
    assert worst(u[[0, 1, 5]], 0.4 * held) == 0 and u[9, 1] == 0.4 * 0.03
    assert worst(u.reshape(-1), selection(scene).T @ q + 0.4 * np.asarray(scene.prescribed).reshape(-1)) == 0
    assert np.array_equal(scene.free.reshape(-1), selection(scene).sum(axis=0) > 0)
    assert np.array_equal(scene.unknowns, np.argmax(selection(scene), axis=1))


def test_loads_add_up_and_the_total_is_the_force_given():
    """Σ V b is the sum of the forces. A total force gives the same b to all of its points."""
    scene, rng = cloud("seth_hill m=1"), bodies.random(40)
    rng.normal(size=(3, 2))
    b, V = 0.1 * rng.normal(size=(3, 2)), bodies.points(2, "cloud").volumes
    load = np.asarray(scene.load)
    assert worst(load[[2, 3, 11]], b) == 0
    assert worst(load[12], load[14]) == 0 and V[12] != V[14]
    assert worst(V @ load - V[[2, 3, 11]] @ b, np.array([0.2, -0.1])) < 1e-15  # measured 4e-17
    both = pd.scene(
        BAR, NEAR, SVK, pd.prescribe(0), pd.body_force([4, 5], [[1.0], [2.0]]), pd.total_force([5, 6], [3.0])
    )
    assert worst(both.load[3:8, 0], np.array([0, 1, 3.5, 1.5, 0])) == 0


def test_a_mask_selects_the_points_that_are_true():
    by_mask = pd.scene(BAR, NEAR, SVK, pd.prescribe(BAR.positions[:, 0] < 2, 0.5))
    assert np.array_equal(np.flatnonzero(~by_mask.free[:, 0]), [0, 1])
    assert worst(by_mask.prescribed[:3, 0], np.array([0.5, 0.5, 0])) == 0


def test_mean_deformation_grows_with_the_load_factor():
    scene = box()
    F = bodies.deformation(2, 41)
    assert worst(scene.mean_deformation(0.0), np.eye(2)) == 0
    assert worst(scene.mean_deformation(1.0), F) < 1e-15  # measured 0
    assert worst(scene.mean_deformation(0.3), 0.7 * np.eye(2) + 0.3 * F) < 1e-14  # measured 1e-16


# ---------------------------------------------------------------- the reduced system


@pytest.mark.parametrize("name", KINDS)
def test_reduced_matrix_equals_that_of_the_dense_jacobian(name):
    """A = S V J Sᵀ. A is symmetric for a model with an energy, and A v by JVP is the same product."""
    scene, u = cloud(name), jnp.asarray(bodies.displacement(2, "cloud", 43))
    J = np.asarray(bodies.respond(MODELS[name], bodies.families(2, "cloud"), u).jacobian)
    S, V = selection(scene), np.diag(np.repeat(bodies.points(2, "cloud").volumes, 2))
    exact = S @ V @ J @ S.T
    size = np.abs(exact).max()
    A = reduced.matrix(scene, u).toarray()
    assert worst(A, exact) / size < 3e-13  # measured 5e-14 (sub-horizon, whose sectors barely span), else 1e-15
    if MODELS[name].hyperelastic:
        assert worst(exact, exact.T) / size < 1e-14  # measured 1e-15 (sub-horizon), else 4e-16
        assert worst(A, A.T) == 0
    q = u.reshape(-1)[scene.unknowns]
    v = bodies.random(44).normal(size=len(q))
    at_rest = np.asarray(scene.displacement(q, 0.6))
    J = np.asarray(bodies.respond(MODELS[name], bodies.families(2, "cloud"), jnp.asarray(at_rest)).jacobian)
    by_jvp = reduced.product(scene, q, 0.6, jnp.asarray(v))
    assert worst(by_jvp, S @ V @ J @ S.T @ v) / size < 1e-13  # measured 7e-15


@pytest.mark.parametrize("make", [lambda: cloud("seth_hill m=0"), lambda: cloud("correspondence svk"), box])
def test_load_rates_of_residual_and_matrix_equal_central_differences(make):
    """∂r/∂λ and dA/dλ along a path on which the held points, the loads and the mean deformation change."""
    scene, h = make(), 1e-5
    rng = bodies.random(45)
    q = jnp.asarray(0.02 * rng.normal(size=len(scene.unknowns)))
    up, down = (reduced.residual_of(scene, q, 0.7 + s) for s in (h, -h))
    rate = reduced.load_rate(scene, q, jnp.asarray(0.7))
    assert worst(rate, (up - down) / (2 * h)) / worst(rate) < 1e-8  # measured 2e-11
    v = jnp.asarray(rng.normal(size=len(q)))
    dq = jnp.asarray(0.3 * rng.normal(size=len(q)))

    def along(s):
        return scene.displacement(q + s * dq, 0.7 + s)

    up, down = (reduced.matrix(scene, along(s), 0.7 + s) @ np.asarray(v) for s in (h, -h))
    rate = reduced.product_rate(scene, along(0.0), jnp.asarray(0.7), scene.displacement(dq, 1.0), v)
    assert worst(rate, (up - down) / (2 * h)) / worst(rate) < 1e-8  # measured 5e-10


def test_unbalanced_forces_of_all_points_sum_to_the_applied_ones():
    """Σ V f = 0 for any displacement, so only the applied load remains in the sum over all points."""
    scene = cloud("seth_hill m=0")
    forces = scene.unbalanced(jnp.asarray(bodies.displacement(2, "cloud", 46)), 0.8)
    applied = 0.8 * bodies.points(2, "cloud").volumes @ np.asarray(scene.load)
    assert worst(np.asarray(forces).sum(axis=0), applied) < 1e-13  # measured 2e-16


def test_matrix_factorisation_counts_and_solves_as_dense_algebra_does():
    """At an indefinite state the pivots have the signs of the eigenvalues, and the solution equals NumPy's."""
    scene = cloud("seth_hill m=1")
    u = jnp.asarray(-0.4 * bodies.points(2, "cloud").positions)
    A = reduced.matrix(scene, u)
    values, b = np.linalg.eigvalsh(A.toarray()), bodies.random(47).normal(size=23)
    factor = reduced.Factor(A)
    assert 0 < (values > 0).sum() < 23
    assert factor.positive == (values > 0).sum()
    x = np.linalg.solve(A.toarray(), b)
    assert worst(factor.solve(b), x) / worst(x) < 1e-12  # measured 3e-14
    general = reduced.Factor(A, symmetric=False)
    assert worst(general.solve(b, transposed=True), x) / worst(x) < 1e-12  # measured 2e-14
    with pytest.raises(reduced.Singular):
        _ = general.positive


# ---------------------------------------------------------------- tractions


@pytest.mark.parametrize("m, N", [(1.0, 3), (0.0, 2)])
def test_exact_traction_of_a_bar_sums_to_its_stress(m, N):
    """Σ V b = P N over a layer of 2N points, with P from the law. A layer of N points does not balance the stress."""
    e, h = -0.2, 0.25
    P = (1 + e) * (e + e * e / 2) * 2.7 if m == 1 else np.log1p(e) / (1 + e) * 2.7  # E = λ + 2μ in 1D
    body = pd.bar(17, 17 * h)
    fams, model = pd.families(body, N * h), pd.SethHill(m, LINEAR)
    F = [[1 + e]]
    ends = [
        pd.homogeneous_traction(np.arange(17 - 2 * N, 17), F),
        pd.homogeneous_traction(np.arange(2 * N), F),
    ]
    for traction, side in zip(ends, (1, -1), strict=True):
        scene = pd.scene(body, fams, model, pd.prescribe(8), traction)
        assert worst(h * np.asarray(scene.load).sum(), side * P) < 3e-14  # measured 1e-15
    both = pd.scene(body, fams, model, pd.prescribe(8), *ends)
    u = jnp.asarray(e * (body.positions - body.positions[8]))
    assert worst(both.unbalanced(u)) < 1e-14  # measured 6e-16
    thin = pd.scene(body, fams, model, pd.prescribe(8), pd.homogeneous_traction(np.arange(17 - N, 17), F), ends[1])
    assert worst(thin.unbalanced(u)) > 1e-3 * abs(P)


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "correspondence neo-hookean"])
def test_exact_traction_of_a_face_sums_to_p_n_a(name):
    """Σ V b = P N A for a strip that is periodic along its face, with P from a lattice family."""
    h, N = 0.5, 2
    body = pd.lattice((10, 7), h, periodic=(False, True))
    F = jnp.array([[1.15, 0.0], [-0.2, 1.0]])  # u does not change along the face, so it is periodic
    layer = body.positions[:, 0] > (10 - 2 * N) * h
    traction = pd.homogeneous_traction(layer, F)
    scene = pd.scene(body, pd.families(body, N * h), MODELS[name], pd.prescribe(body.positions[:, 0] < 1), traction)
    P = pd.piola_stress(MODELS[name], pd.lattice_family(2, N, h), F)
    assert worst(h**2 * np.asarray(scene.load).sum(axis=0), np.asarray(P)[:, 0] * 7 * h) < 1e-13  # measured 3e-16


def test_traction_uses_the_stress_of_the_model_that_is_given():
    """A model with twice the modulus gives twice the load."""
    one, two = (
        pd.scene(BAR, NEAR, SVK, pd.prescribe(0), pd.homogeneous_traction(np.arange(7, 11), [[1.1]], model)).load
        for model in (None, pd.SethHill(1.0, pd.LinearElastic(2.6, 1.4)))
    )
    assert worst(np.asarray(one)) > 0.01
    assert worst(two, 2 * np.asarray(one)) < 1e-15  # measured 0


# ---------------------------------------------------------------- refusals

APART = pd.cloud(np.array([[0.0], [1.0], [2.0], [7.0], [8.0], [9.0]]), 1.0)
CHAIN = pd.lattice((11,), periodic=True)
ROUND = pd.families(CHAIN, 2.0)
HELD = pd.prescribe(0)


@pytest.mark.parametrize(
    "call, named",
    [
        (lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe(np.arange(11))), "over-constrained"),
        (lambda: pd.scene(BAR, NEAR, SVK), "under-constrained: nothing holds its translation along x"),
        (lambda: pd.scene(PLATE, AROUND, SVK), "translation along x, translation along y, rotation in the plane xy"),
        (
            lambda: pd.scene(PLATE, AROUND, SVK, pd.prescribe(4)),
            r"nothing holds its rotation in the plane xy \(1 rigid",
        ),
        (lambda: pd.scene(PLATE, AROUND, SVK, pd.prescribe(np.arange(15), 0.0, 0)), "translation along y"),
        (lambda: pd.scene(APART, pd.families(APART, 1.0), SVK, HELD), r"piece 2 of 2 \(it contains point 3\).*along x"),
        (lambda: pd.scene(CHAIN, ROUND, SVK, pd.body_force([3], 0.1)), "nothing holds its translation along x"),
        (lambda: pd.scene(CHAIN, ROUND, SVK, mean=[[1.1]]), "nothing holds its translation along x"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.body_force([0, 3], 0.1)), "component 0 of point 0 is prescribed"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.total_force([3, 0], [0.1])), "load on a held component"),
        (
            lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe([0, 4], 0.1), pd.prescribe([4], 0.2)),
            "contradictory prescriptions: component 0 of point 4 is held at 0.1 and at 0.2",
        ),
        (lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe([0, 11])), "Prescribed names point 11.*points 0 to 10"),
        (lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe([-1])), "Prescribed names point -1"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.body_force([12], 0.1)), "BodyForce names point 12"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.total_force([12], [0.1])), "TotalForce names point 12"),
        (
            lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.homogeneous_traction([12], [[1.1]])),
            "HomogeneousTraction names point 12",
        ),
        (lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe(0, np.nan)), "u of prescribe must be finite"),
        (lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe(0, np.inf)), "u of prescribe must be finite"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.body_force([3], np.nan)), "a load must be finite"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.total_force([3], [np.inf])), "a load must be finite"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.homogeneous_traction([9, 10], [[np.nan]])), "F must be finite"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.homogeneous_traction([9, 10], [[-0.1]])), "det F > 0"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.homogeneous_traction([9, 10], np.eye(2))), r"\(1, 1\)"),
        (
            lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe([0, 1], [[0.1], [0.2], [0.3]])),
            r"u of prescribe must broadcast to \(points named, components\) = \(2, 1\); got \(3, 1\)",
        ),
        (lambda: pd.scene(PLATE, AROUND, SVK, pd.prescribe([0, 1], [0.1, 0.2, 0.3])), "u of prescribe must broadcast"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.body_force([3, 4], [[0.1]] * 3)), "b of body_force must broadcast"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, pd.total_force([3], [0.1, 0.2])), "force of total_force must"),
        (lambda: pd.scene(BAR, NEAR, SVK, pd.prescribe(0, 0.1, 1)), "components must lie in 0 to 0"),
        (lambda: pd.scene(PLATE, AROUND, SVK, pd.prescribe(0, 0.1, (0, 2))), "components must lie in 0 to 1"),
        (lambda: pd.scene(PLATE, AROUND, SVK, pd.prescribe(0, 0.1, -1)), "components must lie in 0 to 1"),
        (lambda: pd.scene(BAR, pd.families(pd.bar(7), 0.3), SVK, HELD), "families must be families of this body of 11"),
        (lambda: pd.scene(BAR, pd.families(pd.lattice((11, 2)), 1.5), SVK, HELD), "families must be families"),
        (lambda: pd.scene(pd.lattice((11, 1)), NEAR, SVK, HELD), "families must be families of this body"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, mean=[[1.1]]), "mean deformation is for periodic bodies"),
        (lambda: pd.scene(CHAIN, ROUND, SVK, HELD, mean=[[-1.1]]), "F must be finite with det F > 0"),
        (lambda: pd.scene(BAR, NEAR, SVK, HELD, closed_form=np.zeros(11)), r"closed_form must have shape.*\(11, 1\)"),
        (lambda: pd.scene(PLATE, pd.families(PLATE, 1.0), SVK, pd.prescribe([0, 1])), "shape tensor"),
        (lambda: pd.prescribe([]), "points must be a mask or a list of point numbers, not empty"),
        (lambda: pd.prescribe(np.zeros(11, bool)), "not empty"),
        (lambda: pd.prescribe([0.5]), "points must be a mask or a list of point numbers"),
        (lambda: pd.prescribe([3, 4, 3]), "points must not name a point twice"),
        (lambda: pd.prescribe(0, 0.0, (0, 0)), "components must be different numbers"),
        (lambda: pd.prescribe(0, 0.0, ()), "components must be different numbers"),
        (lambda: pd.scenes.step_size_bar(30, strain=-1.0), "strain must be finite and > -1"),
        (lambda: pd.scenes.step_size_bar(30, strain=-1.5), "strain must be finite and > -1"),
        (lambda: pd.scenes.step_size_bar(30, strain=np.nan), "strain must be finite"),
        (lambda: pd.scenes.step_size_bar(12), "n must be a whole number >= 13; got 12"),
        (lambda: pd.scenes.step_size_bar(30, clamp=15), "n must be a whole number >= 31"),
        (lambda: pd.scenes.step_size_bar(30, clamp=0), "clamp must be a whole number >= 1"),
        (lambda: pd.scenes.step_size_bar(30, N=0.5), "N = horizon / spacing must be finite and >= 1"),
        (lambda: pd.scenes.singular_bar(30, alpha=-0.1), "alpha must be >= 0"),
        (lambda: pd.scenes.singular_bar(31), "n must be even"),
        (lambda: pd.scenes.singular_bar(12), "n must be a whole number >= 14"),
        (lambda: pd.scenes.singular_bar(30, stress=-0.3), "stress -0.3 has no local equilibrium.*limit point"),
        (lambda: pd.scenes.singular_bar(30, traction="uniform"), "traction must be 'exact' or 'even'"),
        (lambda: pd.scenes.clamped_plate((9, 8), 2, np.eye(2), SVK), "every side must have more than 8 cells"),
        (lambda: pd.scenes.clamped_plate((9, 10), 2, -np.eye(2)[::-1] * -1, SVK), "det F > 0"),
        (lambda: pd.scenes.manufactured_plate(8, 2), "n must be a whole number >= 9"),
    ],
)
def test_bad_problems_are_refused_by_name(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_two_points_hold_a_plate_unless_their_components_miss_the_rotation():
    """Three held components can stop three rigid motions, but a wrong choice of three leaves the rotation free."""
    good = [pd.prescribe(4), pd.prescribe([5], 0.0, 0)]  # points 4 and 5 differ in y, so x stops the rotation
    assert len(pd.scene(PLATE, AROUND, SVK, *good).unknowns) == 27
    with pytest.raises(ValueError, match=r"rotation in the plane xy \(1 rigid"):
        pd.scene(PLATE, AROUND, SVK, good[0], pd.prescribe([5], 0.0, 1))


def test_the_rotation_about_a_corner_is_named():
    """A corner is held in both components, so only the rotation about it is free."""
    with pytest.raises(ValueError, match="rotation in the plane xy"):
        pd.scene(PLATE, AROUND, SVK, pd.prescribe(0), pd.prescribe([2], 0.0, 1))


def test_the_same_prescription_twice_is_no_contradiction():
    corner = [pd.prescribe([0, 1, 2], [[0.1, 0.0]]), pd.prescribe([0, 3, 6], [[0.1, 0.0]])]
    scene = pd.scene(PLATE, AROUND, SVK, *corner)
    assert (~scene.free).sum() == 10
    split = pd.scene(PLATE, AROUND, SVK, pd.prescribe([0, 1], 0.1, 0), pd.prescribe([0, 1], 0.2, 1))
    assert worst(split.prescribed[:2], np.array([[0.1, 0.2]] * 2)) == 0


def test_a_scene_with_every_piece_held_or_one_point_of_a_periodic_body_held_is_accepted():
    two = pd.scene(APART, pd.families(APART, 1.0), SVK, pd.prescribe([0, 4]))
    assert len(two.unknowns) == 4
    ring = pd.scene(CHAIN, ROUND, SVK, pd.prescribe([2]), pd.body_force([3], 0.1), mean=[[1.1]])
    assert len(ring.unknowns) == 10


def test_a_load_that_is_zero_where_held_is_accepted():
    """A load is refused only for held components in which it is not zero."""
    roller = pd.scene(PLATE, AROUND, SVK, pd.prescribe(0), pd.prescribe(2, 0.0, 0), pd.body_force([2], [0.0, 0.5]))
    assert worst(roller.load[2], np.array([0.0, 0.5])) == 0
    with pytest.raises(ValueError, match="component 0 of point 2 is prescribed and loaded"):
        pd.scene(PLATE, AROUND, SVK, pd.prescribe(0), pd.prescribe(2, 0.0, 0), pd.body_force([2], [0.5, 0.5]))


def test_a_mask_of_another_body_is_refused():
    """A mask must be as long as the body, because a shorter one would select the wrong points."""
    body = pd.bar(12, 12.0)
    fams, model = pd.families(body, 3.0), pd.SethHill(1.0, pd.LinearElastic(lam=1.0, mu=0.0))
    short, ends = np.arange(10) > 6, np.isin(np.arange(12), (0, 11))
    with pytest.raises(ValueError, match="Prescribed has a mask of 10 points; the body has 12"):
        pd.scene(body, fams, model, pd.prescribe(short, 0.0))
    with pytest.raises(ValueError, match="BodyForce has a mask of 10 points; the body has 12"):
        pd.scene(body, fams, model, pd.prescribe(ends, 0.0), pd.body_force(short, 0.1))
    still = pd.motion(pd.scene(body, fams, model, pd.prescribe(ends, 0.0)))
    with pytest.raises(ValueError, match="an observer has a mask of 10 points; the body has 12"):
        pd.simulate(still, 1.0, dt=0.1, observers={"probe": pd.observers.probe(short)}, show_progress=False)


MOVES = pd.lattice((4, 4))


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_a_free_piece_far_from_the_origin_has_all_its_motions_named(shift):
    other = MOVES.positions + np.array([50.0 + shift, 30.0])
    body = pd.cloud(np.concatenate([MOVES.positions, other]), 1.0)
    fams = pd.families(body, 2.0)
    held = pd.prescribe(np.arange(4), 0.0)
    with pytest.raises(
        ValueError, match=r"piece 2 of 2.*translation along x, translation along y, rotation in the plane xy \(3"
    ):
        pd.scene(body, fams, pd.LPS(1.0, 1.0), held)
    with pytest.raises(ValueError, match="moving=True if it is to move in time"):
        pd.scene(body, fams, pd.LPS(1.0, 1.0), held)


@pytest.mark.parametrize(
    "conditions, words",
    [
        (lambda held: [[held]], "given one by one"),
        (lambda held: ["held"], "conditions must come from"),
        (lambda held: [None], "conditions must come from"),
        (lambda held: [held, pd.total_force([15], 0.01)], r"must be a vector \(2,\)"),
        (lambda held: [held, pd.body_force([15], 0.01)], r"must be a vector \(2,\)"),
    ],
)
def test_arguments_that_are_no_conditions_are_refused(conditions, words):
    held = pd.prescribe([0, 1], 0.0)
    with pytest.raises(ValueError, match=words):
        pd.scene(MOVES, pd.families(MOVES, 2.0), pd.LPS(1.0, 1.0), *conditions(held))
