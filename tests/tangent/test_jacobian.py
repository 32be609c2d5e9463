"""The dense, sparse and JVP forms of the Jacobian agree with each other, with complex steps and central differences.

Other tests check its pattern, the tangent of one family, the centre block and the symbol.
"""

from typing import ClassVar

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from bodies import worst
from table import KINDS, MODELS

import pdjax as pd
from pdjax.tangent.linearise import family_tangent

LAM, MU = 1.3, 0.7


class Averaged(pd.PointStateModel):
    """A model that divides each bond force equally, t = ½ (t(A_i, ξ) − t(A_j, −ξ)). Its f is that of the base model."""

    base: pd.PointStateModel
    needs_other_end: ClassVar[bool] = True

    def energy(self, bonds):
        return self.base.energy(bonds)

    def shape_tensor(self, bonds):
        return self.base.shape_tensor(bonds)

    def point_state(self, bonds):
        return self.base.point_state(bonds)

    def bond_force(self, here, there, bond):
        back = bond._replace(xi=-bond.xi, eta=-bond.eta)
        return (self.base.bond_force(here, there, bond) - self.base.bond_force(there, here, back)) / 2


class Product(pd.PointStateModel):
    """A model without energy or symmetry of the ends, t = ω (1 + θ_i)(1 + 2 θ_j² + φ_j) Y. Its state is a tree."""

    hyperelastic: ClassVar[bool] = False
    needs_other_end: ClassVar[bool] = True

    def point_state(self, bonds):
        w = bonds.omega * bonds.volume
        growth = jnp.sum(bonds.xi * bonds.eta, axis=1)
        return {"theta": jnp.sum(w * growth) / jnp.sum(w), "phi": jnp.sum(w * growth**2)}

    def bond_force(self, here, there, bond):
        return bond.omega * (1 + here["theta"]) * (1 + 2 * there["theta"] ** 2 + there["phi"]) * (bond.xi + bond.eta)


BOTH_ENDS = {"averaged": Averaged(MODELS["seth_hill m=-0.7"]), "product": Product()}
ALL = {**KINDS, **BOTH_ENDS}


# ---------------------------------------------------------------- values


def peer(name, dim, kind):
    """The force as a NumPy function of u, for the Seth–Hill and correspondence models of the table with linear laws."""
    body = bodies.points(dim, kind)
    args = (body.positions, body.volumes, bodies.HORIZONS[dim])
    if name == "correspondence svk":
        return lambda u: ref.correspondence_force(*args, u, LAM, MU, bodies.gaussian)
    return lambda u: ref.seth_hill_force(*args, u, float(MODELS[name].m), LAM, MU, bodies.gaussian)


PEERS = ["seth_hill m=1", "seth_hill m=0", "seth_hill m=-0.7", "correspondence svk"]


@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("dim, kind", bodies.BODIES)
def test_dense_jacobian_is_the_complex_step_of_the_reference(name, dim, kind):
    u = bodies.displacement(dim, kind, 1)
    exact = ref.complex_step_jacobian(peer(name, dim, kind), u)
    J = bodies.respond(MODELS[name], bodies.families(dim, kind), u).jacobian
    assert worst(J / np.max(exact), exact / np.max(exact)) < 1e-12  # 2e-14


SPARSE = [(name, 2, "cloud") for name in ALL] + [
    ("correspondence neo-hookean", 1, "lattice"),
    ("seth_hill m=1", 3, "cloud"),
]


@pytest.mark.parametrize("name, dim, kind", SPARSE)
def test_sparse_and_dense_agree(name, dim, kind):
    """The two directions of a bond have different weights, and one bond is broken in one direction only."""
    fams, u = bodies.families(dim, kind), bodies.displacement(dim, kind, 2)
    weight = bodies.random(dim).uniform(0.2, 1.0, fams.weight.shape)
    weight[1, 0] = 0.0
    fams = fams.with_weight(jnp.asarray(weight))
    dense = bodies.respond(ALL[name], fams, u).jacobian
    sparse = pd.jacobian(ALL[name], fams, u)
    assert sparse.has_sorted_indices and sparse.shape == dense.shape
    assert worst(sparse.toarray() / np.max(dense), dense / np.max(dense)) < 1e-13  # 1e-14


def test_jacobian_of_a_body_with_varying_constants_is_exact_and_symmetric():
    """The far end of a bond pulls with its own constants. V J is symmetric."""
    lam = bodies.random(5).uniform(0.5, 2.0, 15)
    model, fams = pd.SethHill(1.0, pd.LinearElastic(lam, MU)), bodies.families(2, "cloud")
    u = bodies.displacement(2, "cloud", 5)
    sparse = pd.jacobian(model, fams, u).toarray()
    assert worst(sparse, bodies.respond(model, fams, u).jacobian) < 1e-13  # 1e-14
    weighed = np.repeat(np.asarray(fams.volumes), 2)[:, None] * sparse
    assert worst(weighed, weighed.T) < 1e-13  # 7e-15


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "correspondence neo-hookean"])
def test_central_differences_converge_to_the_jacobian_as_the_square_of_the_step(name):
    fams, u = bodies.families(2, "cloud"), bodies.displacement(2, "cloud", 6)
    J = bodies.respond(MODELS[name], fams, u).jacobian

    def force(v):
        return bodies.respond(MODELS[name], fams, v).force

    errors = [worst(ref.central_difference_jacobian(force, u, step), J) for step in (1e-2, 1e-3, 1e-4, 1e-6)]
    orders = np.log10(np.array(errors[:2]) / errors[1:3])
    assert worst(orders, 2.0) < 0.1  # 3e-4
    assert errors[3] < 1e-8  # rounding divided by the step; measured 4e-10


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "correspondence neo-hookean", "averaged"])
def test_jvp_is_the_product_with_the_jacobian(name):
    fams, u = bodies.families(2, "cloud"), jnp.asarray(bodies.displacement(2, "cloud", 7))
    v, F = jnp.asarray(bodies.random(7).normal(size=u.shape)), jnp.asarray(bodies.deformation(2, 7))
    along = eqx.filter_jit(pd.jvp)(ALL[name], fams, u, v, F)
    product = (pd.jacobian(ALL[name], fams, u, F=F) @ np.asarray(v).reshape(-1)).reshape(v.shape)
    assert worst(along, product) < 1e-12  # 8e-15


def test_a_force_divided_between_both_ends_has_the_same_jacobian_and_symbol():
    """The model reads the state of the far end. With ω_ij = ω_ji this must not change J or the symbol."""
    shared, base = BOTH_ENDS["averaged"], MODELS["seth_hill m=-0.7"]
    fams, u = bodies.families(2, "cloud"), bodies.displacement(2, "cloud", 8)
    exact = ref.complex_step_jacobian(peer("seth_hill m=-0.7", 2, "cloud"), u)
    assert worst(pd.jacobian(shared, fams, u).toarray(), exact) < 1e-12  # 4e-14
    F, k = jnp.asarray(bodies.deformation(2, 8)), jnp.asarray(bodies.random(8).uniform(-3, 3, (5, 2)))
    fam, symbol = pd.lattice_family(2, 2, 0.5), eqx.filter_jit(pd.symbol)
    assert worst(symbol(shared, fam, F, k), symbol(base, fam, F, k)) < 1e-12  # 0


# ---------------------------------------------------------------- pattern


BY_RINGS = ["seth_hill m=1", "correspondence svk", "seth_hill m=1, energy only", *BOTH_ENDS, "bond_based"]
BY_RINGS += ["bond_level", "bond_level average", "bond_associated force"]


@pytest.mark.parametrize("name", BY_RINGS)
def test_the_pattern_is_as_many_rings_of_neighbours_as_promised(name):
    """Stored blocks lie within the rings, and for a generic state every block there is nonzero.

    A spring depends on its two ends: one ring. Other bonds depend on the states of both ends, because the force on a
    point includes the reverse bonds: two rings, whether or not the model needs the state of the far end. Only states
    made from states reach a third ring. In bond-associated models the family of a bond is smaller than that of the
    point, so some blocks are missing.
    """
    rng, rings = bodies.random(9), ALL[name].rings
    X = pd.lattice((5, 3) if rings < 3 else (9, 2)).positions
    body = pd.cloud(X + 0.05 * rng.uniform(-1, 1, X.shape), rng.uniform(0.8, 1.2, len(X)))
    fams, u = bodies.padded(pd.families(body, 1.6, pd.gaussian_influence), 14), 0.05 * rng.normal(size=X.shape)
    near = np.eye(len(X), dtype=bool)
    for i, neighbours in enumerate(ref.families(body.positions, 1.6)):
        near[i, neighbours] = True
    reach = np.linalg.matrix_power(near.astype(int), rings) > 0
    assert 0.3 < reach.mean() < 0.8 and rings == {"bond_based": 1, "bond_level average": 3}.get(name, rings)
    J = pd.jacobian(ALL[name], fams, u)
    stored = np.zeros_like(reach)
    rows, columns = J.nonzero()
    stored[rows // 2, columns // 2] = True
    if "associated" in name:
        assert not (stored & ~reach).any() and stored.sum() > 0.5 * reach.sum()
        return
    assert np.array_equal(stored, reach)
    blocks = np.abs(J.toarray()).reshape(len(X), 2, len(X), 2).min(axis=(1, 3))
    assert blocks[reach].min() > 1e-7  # 1e-5


# ---------------------------------------------------------------- the block of one point, and the symbol

block = eqx.filter_jit(lambda model, fam, F, k: (pd.center_block(model, fam, F), pd.symbol(model, fam, F, k)))


def zone_grid(dim, n):
    """A grid of n wave vectors along each axis of the zone. Its mean is exact for sums of fewer than n harmonics."""
    axes = np.meshgrid(*[2 * np.pi * np.arange(n) / n] * dim, indexing="ij")
    return np.stack([axis.reshape(-1) for axis in axes], axis=1)


@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("dim, N", [(1, 3), (2, 1.5), (3, 1.5)])
def test_centre_block_is_that_of_a_patch_and_the_mean_of_the_symbol(name, dim, N):
    """The patch is the NumPy reference: the complex step of the force at its centre."""
    F, reach = bodies.deformation(dim, 10, size=0.2), int(N)

    def force_of_u(X, u):
        args = (X, np.ones(len(X)), N, u)
        if name == "correspondence svk":
            return ref.correspondence_force(*args, LAM, MU, rows=[0])
        return ref.seth_hill_force(*args, float(MODELS[name].m), LAM, MU, rows=[0])

    eta, blocks = ref.patch_row(dim, N, force_of_u, F)
    assert not eta[0].any()
    D, J = block(MODELS[name], pd.lattice_family(dim, N), jnp.asarray(F), zone_grid(dim, 4 * reach + 1))
    assert worst(D, blocks[0]) < 1e-12  # 2e-15
    assert worst(D, np.mean(J, axis=0)) < 1e-12  # 2e-16


FAMILIES = ["seth_hill m=-0.7", "bond_based", "littlewood control", "bond_level", "reproducing_kernel 2", "averaged"]
FAMILIES += ["sub_horizon", "bond_associated", "bond_associated force"]


@pytest.mark.parametrize("name", FAMILIES)
def test_the_tangent_of_one_family_is_the_derivative_of_its_force_state(name):
    """C = ∂T/∂η. C_bc = C_cbᵀ if the model has an energy, and sums of C give the centre block."""
    model, fam, F = ALL[name], pd.lattice_family(2, 1.5, 0.5, pd.gaussian_influence), bodies.deformation(2, 12)
    bonds = fam.bonds(jnp.asarray(F))
    if isinstance(model, pd.TwoStageModel):
        with pytest.raises(ValueError, match="neighbours' families too"):
            family_tangent(model, bonds)
        return
    C, slope, D = tangents(model, fam, jnp.asarray(F))
    if model.hyperelastic:
        assert worst(C, np.transpose(C, (2, 3, 0, 1))) < 1e-12  # 1e-15
    if not model.needs_other_end:
        assert worst(C, slope) < 1e-12  # 7e-15
        own, moved = np.einsum("bicj->ij", C), np.einsum("bibj->ij", C)
        assert worst(D, -0.25 * (own + moved)) < 1e-12  # 7e-15


@eqx.filter_jit
def tangents(model, fam, F):
    """C by the package, C by jacfwd of the force state, and the centre block."""
    bonds = fam.bonds(F)
    slope = jax.jacfwd(lambda eta: model.force_state(bonds._replace(eta=eta)))(bonds.eta)
    return family_tangent(model, bonds), slope, pd.center_block(model, fam, F)


@pytest.mark.parametrize("name", ALL)
def test_a_periodic_body_has_the_symbol_and_the_centre_block(name):
    """The diagonal block of J of a periodic lattice is the centre block, and J times a plane wave is the symbol."""
    body = pd.lattice((5, 7), 0.5, periodic=True)
    F = jnp.asarray(bodies.deformation(2, 11, size=0.2))
    J = pd.jacobian(ALL[name], pd.families(body, 0.75, pd.gaussian_influence), np.zeros((35, 2)), F=F)
    numbers = bodies.random(11).integers(-3, 4, (25, 2))
    k = 2 * np.pi * numbers / (0.5 * np.array([5, 7]))
    D, symbol = block(ALL[name], pd.lattice_family(2, 1.5, 0.5, pd.gaussian_influence), F, k)
    for wave, exact in zip(k, np.asarray(symbol), strict=True):
        phase = np.exp(1j * body.positions @ wave)[:, None, None]
        assert worst(J @ (phase * np.eye(2)).reshape(-1, 2), (phase * exact).reshape(-1, 2)) < 1e-11  # 2e-14
    assert worst(J.toarray()[:2, :2], D) < 1e-11  # 7e-15
