"""Laws: stress against closed forms, small-strain moduli, user's laws, constants and wrong use."""

import bodies
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from hypothesis import given
from hypothesis import strategies as st
from table import LINEAR, MODELS, quartic

import pdjax as pd
from pdjax.models.laws import law_stress

LAM, MU, B = 1.3, 0.7, 2.0
TENSORS = st.integers(0, 2**32 - 1)


def linear(E):
    """S = λ tr(E) I + 2μE."""
    return LAM * np.trace(E) * np.eye(len(E)) + 2 * MU * E


def neo_hookean(F):
    """P = μ(F − F⁻ᵀ) + λ log J F⁻ᵀ."""
    inverse = np.linalg.inv(F).T
    return MU * (F - inverse) + LAM * np.log(np.linalg.det(F)) * inverse


def quartic_stress(E):
    """S = λ tr(E) I + 2μE + 4b (E:E) E."""
    return linear(E) + 4 * B * np.sum(E * E) * E


# law, closed form of its stress
LAWS = {
    "linear elastic": (LINEAR, linear),
    "neo-hookean": (pd.NeoHookean(LAM, MU), neo_hookean),
    "user, in E": (pd.EnergyLaw(quartic, "E", {"lam": LAM, "mu": MU, "b": B}), quartic_stress),
    "user, in F": (
        pd.EnergyLaw(lambda F, c: pd.NeoHookean(c[0], c[1]).energy(F), "F", (jnp.asarray(LAM), jnp.asarray(MU))),
        neo_hookean,
    ),
}
stress = jax.jit(law_stress)


def tensor(law, dim, seed):
    """A random strain, or a random deformation gradient."""
    change = bodies.deformation(dim, seed, size=0.3) - np.eye(dim)
    return (change + change.T) / 2 if law.takes == "E" else np.eye(dim) + change


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("dim", [1, 2, 3])
@given(seed=TENSORS)
def test_stress_is_the_closed_form(name, dim, seed):
    law, closed = LAWS[name]
    A = tensor(law, dim, seed)
    assert worst(stress(law, A), closed(A)) < 1e-13  # 9e-16


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_at_rest_energy_and_stress_vanish_and_moduli_are_lam_and_mu(name, dim):
    """∂²ψ applied to any G is λ tr(G) I + 2μ sym G; in 1D the modulus is λ + 2μ."""
    law, _ = LAWS[name]
    rest = jnp.zeros((dim, dim)) if law.takes == "E" else jnp.eye(dim)
    assert float(law.energy(rest)) == 0 and worst(stress(law, rest)) == 0
    G = bodies.random(dim).normal(size=(dim, dim))
    slope = jax.jvp(lambda A: law_stress(law, A), (rest,), (jnp.asarray(G),))[1]
    assert worst(slope, linear((G + G.T) / 2)) < 1e-14  # 4e-16
    if dim == 1:
        assert worst(slope / G, LAM + 2 * MU) < 1e-14  # 4e-16


@pytest.mark.parametrize("size, tolerance", [(1e-2, 1e-10), (1e-4, 1e-6), (1e-6, 1e-2)])
def test_neo_hookean_energy_at_tiny_strain(size, tolerance):
    """ψ(1 + ε) equals its series. A law in F gets 1 + ε, so the relative error of its energy is about eps/ε²."""
    F = jnp.diag(jnp.array([1.0 + size, 1.0]))
    log_J = np.log1p(size)
    excess = size**2 + 2 * sum((-size) ** n / n for n in range(2, 12))  # (1 + ε)² − 1 − 2 log(1 + ε)
    exact = LAM / 2 * log_J**2 + MU / 2 * excess
    assert worst(LAWS["neo-hookean"][0].energy(F) / exact, 1.0) < tolerance  # 2e-10


@pytest.mark.parametrize("name", LAWS)
def test_constants_are_traced_and_differentiable(name):
    """The laws are linear in their constants, so the stress is the sum of constants times derivatives."""
    law, _ = LAWS[name]
    A = tensor(law, 2, 5)
    slopes = jax.tree.leaves(jax.jacfwd(lambda law: law_stress(law, jnp.asarray(A)))(law))
    constants = jax.tree.leaves(law)
    total = sum(np.asarray(slope) * constant for slope, constant in zip(slopes, constants, strict=True))
    assert len(constants) in (2, 3) and all(worst(slope) > 1e-3 for slope in slopes)
    assert worst(total, stress(law, A)) < 1e-14  # 6e-17


def test_new_constants_compile_nothing():
    compiled = jax.jit(lambda law, E: law_stress(law, E))  # a new function has an empty cache
    for lam, mu in ((1.0, 2.0), (0.3, 0.1), (-0.2, 5.0)):
        S = compiled(pd.LinearElastic(lam, mu), jnp.eye(2))
        assert worst(S, (2 * lam + 2 * mu) * np.eye(2)) < 1e-14  # 0
    assert compiled._cache_size() == 1


@pytest.mark.parametrize("law", [pd.LinearElastic(1, 2), pd.NeoHookean(1, 2)])
def test_constants_given_as_integers_are_real_numbers(law):
    """Otherwise each kind of number would compile again, and no derivative in a constant would exist."""
    assert jnp.issubdtype(law.lam.dtype, jnp.floating) and jnp.issubdtype(law.mu.dtype, jnp.floating)


def test_an_order_given_as_an_integer_is_a_real_number():
    assert jnp.issubdtype(pd.SethHill(1, LINEAR).m.dtype, jnp.floating)


def test_constants_of_a_users_law_are_arrays():
    """Python numbers are static under `eqx.filter_jit`, so each new value would compile again."""
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(MODELS["seth_hill user law"].law))


@pytest.mark.parametrize(
    "call, named",
    [
        (lambda: pd.SethHill(1.0, pd.NeoHookean(LAM, MU)), "SethHill needs a law in a strain.*NeoHookean"),
        (lambda: pd.SethHill(1.0, LAWS["user, in F"][0]), "SethHill needs a law in a strain"),
        (lambda: pd.EnergyLaw(quartic, "S"), "takes must be one of E, F; got 'S'"),
    ],
)
def test_wrong_use_names_the_argument(call, named):
    with pytest.raises(ValueError, match=named):
        call()


@pytest.mark.parametrize("nu", [-0.4, 0.0, 0.3, 0.45])
def test_from_young_and_from_bulk_agree_and_plane_stress_is_that_of_hookes_law(nu):
    """In plane stress σ = E/(1 − ν²) [(1 − ν) ε + ν tr(ε) I], which is the 3D solid with σ₃₃ = 0."""
    E = 2.0
    K, G = E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))
    for one, other in (
        (pd.LinearElastic.from_young(E, nu), pd.LinearElastic.from_bulk(K, G)),
        (pd.LinearElastic.from_young(E, nu, plane="stress"), pd.LinearElastic.from_bulk(K, G, "stress")),
        (pd.NeoHookean.from_young(E, nu, "stress"), pd.NeoHookean.from_bulk(K, G, plane="stress")),
    ):
        assert np.allclose([one.lam, one.mu], [other.lam, other.mu], rtol=1e-14)
    strain = np.array([[0.3, 0.1], [0.1, -0.2]])
    stress = np.asarray(law_stress(pd.LinearElastic.from_young(E, nu, "stress"), jnp.asarray(strain)))
    direct = E / (1 - nu**2) * ((1 - nu) * strain + nu * np.trace(strain) * np.eye(2))
    assert np.abs(stress - direct).max() < 1e-15 * E / (1 - nu**2) * 4  # 2e-16
    whole = np.zeros((3, 3))
    whole[:2, :2] = strain
    compliance = [(s - nu * (np.trace(stress) - s)) / E for s in np.diag(stress)]  # the 3D solid with σ₃₃ = 0
    assert np.allclose(compliance, np.diag(strain), atol=1e-15)


def test_neo_hookean_plane_stress_minimises_the_energy_of_the_solid():
    from scipy.optimize import brentq

    flat, solid = pd.NeoHookean.from_young(2.0, 0.3, "stress"), pd.NeoHookean.from_young(2.0, 0.3)
    draw = np.random.default_rng(0)
    for size in (0.05, 0.3, 0.7):
        F = np.eye(2) + size * draw.uniform(-1, 1, (2, 2))

        def in_space(f, F=F):
            return jnp.zeros((3, 3)).at[:2, :2].set(F).at[2, 2].set(f)

        P33 = lambda f: float(jax.grad(solid.energy)(in_space(f))[2, 2])  # noqa: E731
        f = brentq(P33, 0.05, 20, xtol=1e-14)
        assert abs(float(flat.energy(jnp.asarray(F))) - float(solid.energy(in_space(f)))) < 1e-13
        P = jax.grad(solid.energy)(in_space(f))[:2, :2]
        assert np.abs(jax.grad(flat.energy)(jnp.asarray(F)) - P).max() < 1e-12  # 2e-14
        h = 1e-5 * draw.normal(size=(2, 2))
        slope = (jax.grad(flat.energy)(F + h) - jax.grad(flat.energy)(F - h)) / 2
        exact = jnp.einsum("ijkl,kl->ij", jax.hessian(flat.energy)(jnp.asarray(F)), h)
        assert np.abs(slope - exact).max() < 1e-8 * np.abs(h).max()  # 1e-9
    model, F = pd.Correspondence(flat), np.eye(2)
    fams = pd.families(pd.lattice((40, 40)), 3.0)  # enough bonds for the streaming backend
    u = 1e-2 * draw.normal(size=(1600, 2))
    both = [pd.force_density(model, fams, u, way=way) for way in ("families", "slices")]
    assert np.abs(both[0] - both[1]).max() < 1e-13  # 3e-15
    with pytest.raises(ValueError, match="bodies of dim 2"):
        pd.force_state(model, pd.lattice_family(3, 1.8), np.eye(3))


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: pd.LinearElastic.from_young(-1.0, 0.3), "E must be finite and > 0"),
        (lambda: pd.LinearElastic.from_young(1.0, 0.5), "nu must lie between"),
        (lambda: pd.NeoHookean.from_bulk(1.0, -1.0), "G must be"),
        (lambda: pd.LinearElastic.from_young(1.0, 0.3, plane="strein"), "plane must be one of strain, stress"),
        (lambda: pd.NeoHookean(1.0, 1.0, "flat"), "plane must be one of"),
    ],
)
def test_invalid_constants_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
