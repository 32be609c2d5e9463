"""Surface corrections are symmetric, 1 in the interior, and reduce the errors of bond-based and LPS bodies."""

import jax
import numpy as np
import pytest
from table import MODELS

import pdjax as pd

BOND = pd.BondBased(1.0)
SHAPES = {1: (17,), 2: (24, 21), 3: (9, 8, 7)}


def lps(nu, dim):
    return pd.LPS.from_young(1.0, nu, dim, plane="stress" if dim == 2 else None)


def model_of(name, dim):
    return BOND if name == "bond-based" else lps(0.3, dim)


def body_of(kind, dim):
    body = pd.lattice(SHAPES[dim])
    if kind == "lattice":
        return body
    shift = np.random.default_rng(dim).uniform(-0.2, 0.2, body.positions.shape)
    return pd.cloud(body.positions + shift, np.random.default_rng(0).uniform(0.8, 1.2, len(body)))


def deviations(model, families, full, dim):
    """Relative deviations (points, dim) of the energies under small extensions along the axes from a full family."""
    found = []
    for k in range(dim):
        F = np.eye(dim)
        F[k, k] += 1e-6
        W0 = float(model.energy(full.bonds(F)))
        found.append(np.asarray(pd.energy_density(model, families, np.zeros((len(families), dim)), F)) / W0 - 1)
    return np.stack(found, axis=1)


CASES = [
    (name, method, kind, dim)
    for name in ("bond-based", "lps")
    for method in ("energy", "volume")
    for kind in ("lattice", "cloud")
    for dim in (1, 2, 3)
    if (name, dim) != ("lps", 1)
]


@pytest.mark.parametrize(("name", "method", "kind", "dim"), CASES)
def test_weights_of_both_directions_of_a_bond_are_equal(name, method, kind, dim):
    families = pd.families(body_of(kind, dim), 2.3)
    beta = np.asarray(pd.surface_correction(model_of(name, dim), families, method))
    assert np.isfinite(beta).all() and (beta > 0).all()
    bond = np.asarray(families.is_bond)
    assert np.array_equal(beta[np.asarray(families.neighbours), np.asarray(families.reverse)][bond], beta[bond])
    assert (beta[~bond] == 1).all()


@pytest.mark.parametrize("influence", ["constant", "gaussian", "partial volume"])
@pytest.mark.parametrize("name", ["bond-based", "lps"])
def test_bonds_far_from_the_surface_keep_the_weight_one(name, influence):
    """Each pass carries the correction one horizon further."""
    families = pd.families(pd.lattice((24, 21)), 2.0, influence)
    X = np.asarray(families.positions)
    depth = np.minimum(X, [24, 21] - X).min(axis=1)
    bond = np.asarray(families.is_bond)
    for method, passes in (("energy", 1), ("energy", 3), ("volume", 1)):
        beta = np.asarray(pd.surface_correction(model_of(name, 2), families, method, passes))
        deep = bond & (depth > 2.0 * (passes + 1))[:, None]
        assert deep.any() and np.abs(beta[deep] - 1).max() < 1e-14  # measured 7e-16
        assert np.abs(beta[bond] - 1).max() > 0.1  # measured 0.25 at least


@pytest.mark.parametrize("name", ["bond-based", "lps"])
def test_a_periodic_body_needs_no_correction(name):
    families = pd.families(pd.lattice((8, 9), periodic=True), 2.3)
    for method in ("energy", "volume"):
        beta = np.asarray(pd.surface_correction(model_of(name, 2), families, method))
        assert np.abs(beta - 1).max() < 1e-14  # measured 4e-16


def test_a_cloud_is_compared_with_a_ball():
    """The weights inside a regular cloud are near 1, but not 1."""
    X = pd.lattice((9, 9, 9)).positions
    families = pd.families(pd.cloud(X, 1.0, period=[9.0, 9.0, 9.0]), 3.015)
    found = {
        (name, method): float(np.asarray(pd.surface_correction(model_of(name, 3), families, method, 1)).mean())
        for name, method in (("bond-based", "volume"), ("bond-based", "energy"), ("lps", "energy"))
    }
    # The ball without its centre has the volume 113.8, and 122 points are in it.
    assert found["bond-based", "volume"] == pytest.approx(113.8 / 122, abs=3e-4)  # measured 2e-5
    # Along the axes this lattice is too stiff for a bond and too soft for LPS.
    assert found["bond-based", "energy"] == pytest.approx(0.964, abs=5e-4)  # measured 6e-5, its fourth digit
    assert found["lps", "energy"] == pytest.approx(1.067, abs=5e-4)  # measured 2e-4, its fourth digit


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_many_passes_make_the_extension_energies_of_a_bond_based_body_exact(dim):
    """At every point, corners included, and along every axis."""
    families, full = pd.families(pd.lattice(SHAPES[dim]), 2.0), pd.lattice_family(dim, 2.0)
    before = np.abs(deviations(BOND, families, full, dim)).max()
    corrected = families.with_weight(pd.surface_correction(BOND, families, passes=200))
    assert before > 0.3  # measured 0.5 at least
    assert np.abs(deviations(BOND, corrected, full, dim)).max() < 2e-6  # measured 1e-7 in 3D, 5e-13 at least


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", ["bond-based", "lps"])
def test_three_passes_halve_the_errors_of_the_extension_energies(name, dim):
    model, full = model_of(name, dim), pd.lattice_family(dim, 3.015)
    families = pd.families(pd.lattice(SHAPES[dim]), 3.015)
    corrected = families.with_weight(pd.surface_correction(model, families))
    before, after = (np.abs(deviations(model, f, full, dim)) for f in (families, corrected))
    assert after.max() < 0.5 * before.max()  # measured 0.45 at most
    assert np.sqrt((after**2).mean()) < 0.5 * np.sqrt((before**2).mean())  # measured 0.41 at most


@pytest.mark.parametrize("nu", [0.0, 0.25, 0.4])
def test_the_volume_method_makes_the_energies_of_lps_worse_at_the_side_of_a_plate(nu):
    """The largest energy error along the side, under extension along the side."""
    model, full = lps(nu, 2), pd.lattice_family(2, 3.015)
    families = pd.families(pd.lattice(SHAPES[2]), 3.015)
    side = np.asarray(families.positions)[:, 0] == 12.5
    errors = {
        method: np.abs(deviations(model, fams, full, 2))[side, 0].max()
        for method, fams in {
            "none": families,
            "volume": families.with_weight(pd.surface_correction(model, families, "volume")),
            "energy": families.with_weight(pd.surface_correction(model, families, "energy")),
        }.items()
    }
    assert errors["energy"] < 0.3 * errors["none"]  # measured 0.25 at most
    assert errors["volume"] > 1.2 * errors["none"]  # measured 1.39 at least


@pytest.mark.parametrize("name", ["bond-based", "lps"])
@pytest.mark.parametrize("method", ["energy", "volume"])
def test_rigid_motions_cause_no_force_and_momentum_is_conserved(name, method):
    model, families = model_of(name, 2), pd.families(body_of("cloud", 2), 2.3)
    corrected = families.with_weight(pd.surface_correction(model, families, method))
    X, angle = np.asarray(families.positions), 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert np.abs(pd.force_density(model, corrected, X @ turn.T - X + [0.3, -0.2])).max() < 1e-12  # measured 3e-14
    u = 0.05 * np.random.default_rng(3).normal(size=X.shape)
    f, V = np.asarray(pd.force_density(model, corrected, u)), np.asarray(families.volumes)[:, None]
    assert np.abs((V * f).sum(axis=0)).max() < 3e-16 * np.abs(V * f).sum()  # measured 9e-18
    x, Vf = X + u, V * f
    moment = (x[:, 0] * Vf[:, 1] - x[:, 1] * Vf[:, 0]).sum()
    assert abs(moment) < 3e-16 * np.abs(Vf).sum() * np.abs(x).max()  # measured 5e-18
    slope = jax.grad(lambda u: pd.strain_energy(model, corrected, u))(u)
    assert np.abs(np.asarray(slope) / V + f).max() < 2e-14 * np.abs(f).max()  # measured 6e-16


def test_a_missing_neighbour_counts_whether_it_is_cut_or_absent():
    """A cut along a line of a plate gives the same weights as two separate plates."""
    whole, half = pd.families(pd.lattice((12, 7)), 2.0), pd.families(pd.lattice((6, 7)), 2.0)
    cut = pd.cut(whole, pd.Plane((6.0, 0.0), (1.0, 0.0)))
    beta = np.asarray(pd.surface_correction(BOND, cut)) * np.asarray(cut.weight)
    alone = np.asarray(pd.surface_correction(BOND, half)) * np.asarray(half.weight)
    assert np.allclose(beta[:42].sum(axis=1), alone.sum(axis=1), rtol=1e-14, atol=0)  # measured 0


def test_a_point_without_bonds_gets_finite_weights():
    families = pd.families(pd.lattice((5, 5)), 1.5)
    weight = np.asarray(families.weight).copy()
    weight[12] = 0.0
    weight[np.asarray(families.neighbours)[12], np.asarray(families.reverse)[12]] = 0.0
    for model, method in ((BOND, "energy"), (BOND, "volume"), (lps(0.3, 2), "energy")):
        assert np.isfinite(pd.surface_correction(model, families.with_weight(weight), method)).all()


def test_a_plate_of_one_layer_in_3d_is_corrected_in_its_plane():
    families = pd.families(pd.lattice((12, 11, 1)), 2.0)
    beta = np.asarray(pd.surface_correction(BOND, families))
    assert np.isfinite(beta).all() and (beta > 0).all()


def test_constants_of_each_point_have_weights_of_their_own():
    families = pd.families(pd.lattice((12, 11)), 2.0)
    same = pd.LPS(np.full(132, 1.5), np.full(132, 0.7))
    found, expected = (pd.surface_correction(model, families) for model in (same, pd.LPS(1.5, 0.7)))
    assert np.allclose(found, expected, rtol=1e-14, atol=0)  # measured 0
    graded = pd.BondBased(np.linspace(1.0, 2.0, 132))
    assert np.array_equal(pd.surface_correction(graded, families), pd.surface_correction(BOND, families))


@pytest.mark.parametrize("name", [n for n in MODELS if n not in ("bond_based", "bond_based m=-0.3", "lps")])
def test_other_models_are_refused_with_the_reason(name):
    families = pd.families(pd.lattice((8, 7)), 3.0)
    with pytest.raises(ValueError, match=r"for BondBased and LPS; \w+ (needs none|has none)"):
        pd.surface_correction(MODELS[name], families)


@pytest.mark.parametrize(
    ("more", "words"),
    [({"method": "force"}, "method must be one of"), ({"passes": 0}, "passes must be")],
)
def test_wrong_arguments_are_refused(more, words):
    with pytest.raises(ValueError, match=words):
        pd.surface_correction(BOND, pd.families(pd.lattice((5, 4)), 2.0), **more)


def test_families_without_arrays_and_traced_constants_are_refused():
    body = pd.lattice((5, 4))
    with pytest.raises(ValueError, match="arrays=False"):
        pd.surface_correction(BOND, pd.families(body, 2.0, arrays=False))
    with pytest.raises(ValueError, match="outside jit and grad"):
        jax.jit(lambda c: pd.surface_correction(pd.BondBased(c), pd.families(body, 2.0)))(1.0)
