"""Tests of load paths: F(a), their symmetry, and uniaxial stress with its derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from table import MODELS

import pdjax as pd
from pdjax.infinite_lattice.paths import path_symmetry

LAM, MU = 1.3, 0.7
FAM = pd.lattice_family(2, 2, 0.5)
MODEL = MODELS["seth_hill m=1"]


@pytest.mark.parametrize("name", pd.PATHS)
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_every_path_starts_at_rest(name, dim):
    if (name, dim) == ("simple-shear", 1):
        pytest.skip("simple shear refuses 1D, see test_simple_shear_needs_two_dimensions")
    fam = pd.lattice_family(dim, 1.5)
    assert worst(eqx.filter_jit(pd.PATHS[name])(0.0, MODEL, fam), np.eye(dim)) < 1e-15  # 0


@pytest.mark.parametrize(
    "name, dim, exact",
    [
        ("hydrostatic", 1, [[1.2]]),
        ("hydrostatic", 3, np.diag([1.2, 1.2, 1.2])),
        ("uniaxial-strain", 2, np.diag([1.2, 1.0])),
        ("uniaxial-strain", 3, np.diag([1.2, 1.0, 1.0])),
        ("uniaxial-stress", 1, [[1.2]]),
        ("simple-shear", 2, [[1.0, 0.2], [0.0, 1.0]]),
        ("simple-shear", 3, [[1.0, 0.2, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ],
)
def test_known_deformations(name, dim, exact):
    F = pd.PATHS[name](0.2, MODEL, pd.lattice_family(dim, 1.5))
    assert worst(F, np.array(exact)) < 1e-15  # 0


def test_symmetry_of_a_path_needs_a_cubic_family_and_an_isotropic_model():
    kept = {name: path_symmetry(path, FAM, True) for name, path in pd.PATHS.items()}
    assert kept == {
        "hydrostatic": "cubic",
        "uniaxial-strain": "tetragonal",
        "uniaxial-stress": "tetragonal",
        "simple-shear": "inversion",
    }
    assert path_symmetry(lambda a, model, fam: jnp.eye(2), FAM, True) == "inversion"
    assert path_symmetry(pd.hydrostatic, FAM.with_weight(jnp.full(12, 0.5)), True) == "inversion"
    assert path_symmetry(pd.hydrostatic, FAM, False) == "inversion"


# ---------------------------------------------------------------- uniaxial stress


@jax.jit
def pulled(a, model, fam):
    """F and P of uniaxial stress, and ∂F/∂(a, constants)."""
    F = pd.uniaxial_stress(a, model, fam)
    return F, pd.piola_stress(model, fam, F), *jax.jacfwd(pd.uniaxial_stress, (0, 1))(a, model, fam)


PULLED = ["seth_hill m=1", "seth_hill m=-0.7", "correspondence neo-hookean"]


@pytest.mark.parametrize("name", PULLED)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("a", [-0.1, 1e-9, 0.15])
def test_lateral_stress_vanishes(name, dim, a):
    """At a tiny load the lateral strain is −ν a with ν = λ/(λ(d − 1) + 2μ)."""
    F, P, slope, _ = pulled(a, MODELS[name], pd.lattice_family(dim, 1.5, 0.5))
    assert float(F[0, 0]) == 1 + a and worst(F, np.diag(np.diag(F))) == 0
    assert worst(np.asarray(P)[1:, 1:]) < 1e-14  # 8e-16
    assert a * float(P[0, 0]) > 0
    if dim == 3:
        assert worst(F[1, 1], F[2, 2]) == 0
    if abs(a) < 1e-6:
        nu = LAM / (LAM * (dim - 1) + 2 * MU)
        assert worst(slope[1, 1], -nu) < 1e-7  # 1e-9
        assert worst((F[1, 1] - 1) / a, -nu) < 1e-6  # 4e-8


def test_lateral_stretch_of_st_venant_kirchhoff_in_closed_form():
    """For m = 1, E₂₂ = −ν E₁₁ exactly, so that b² = 1 − ν (a² + 2a)."""
    nu = LAM / (LAM + 2 * MU)
    for a in (-0.3, 0.1, 0.4):
        exact = np.sqrt(1 - nu * (a**2 + 2 * a))
        assert worst(pulled(a, MODEL, FAM)[0][1, 1], exact) < 1e-14  # 0


@pytest.mark.parametrize("name", PULLED)
def test_derivatives_in_the_load_and_the_constants(name):
    """They follow from the implicit function theorem and agree with central differences. m is one of the constants."""
    a, step, model = 0.15, 1e-5, MODELS[name]
    _, _, in_a, in_model = pulled(a, model, FAM)
    assert worst(in_a, (pulled(a + step, model, FAM)[0] - pulled(a - step, model, FAM)[0]) / (2 * step)) < 1e-8  # 5e-11
    leaves, tree = jax.tree.flatten(model)
    programs = pulled._cache_size()
    slopes = jax.tree.leaves(in_model)
    assert len(slopes) == len(leaves) >= 2
    for n, slope in enumerate(slopes):
        up, down = (
            pulled(a, jax.tree.unflatten(tree, [leaf + h * (i == n) for i, leaf in enumerate(leaves)]), FAM)[0]
            for h in (step, -step)
        )
        assert worst(slope, (up - down) / (2 * step)) < 1e-8  # 1e-11
        assert worst(slope) > 1e-4
    assert pulled._cache_size() == programs  # A new load or constant compiles nothing.


def test_uniaxial_stress_without_a_state_is_nan():
    """For a St. Venant–Kirchhoff law with large λ and a = 3, b² would be negative."""
    F = pd.uniaxial_stress(3.0, pd.SethHill(1.0, pd.LinearElastic(10.0, 0.5)), FAM)
    assert np.isnan(F[1, 1])


def test_simple_shear_needs_two_dimensions():
    with pytest.raises(ValueError, match="simple_shear needs dim 2 or 3; this family has dim 1"):
        pd.simple_shear(0.1, MODEL, pd.lattice_family(1, 2))


def test_uniaxial_stress_has_second_and_third_derivatives():
    """For a St. Venant–Kirchhoff law b = √(1 − ν(a² + 2a)), b″ = −(ν + b′²)/b and b‴ = −3 b′ b″/b."""
    a, nu = 0.15, LAM / (LAM + 2 * MU)
    b = np.sqrt(1 - nu * (a**2 + 2 * a))
    first = -nu * (1 + a) / b
    exact = -(nu + first**2) / b
    second = jax.grad(jax.grad(lambda a: pd.uniaxial_stress(a, MODEL, FAM)[1, 1]))
    assert worst(jax.jit(second)(a), exact) < 1e-12  # 8e-16
    assert worst(jax.jit(jax.grad(second))(a), -3 * first * exact / b) < 1e-11


@pytest.mark.parametrize("path", [pd.hydrostatic, pd.uniaxial_strain, pd.uniaxial_stress])
def test_a_negative_stretch_is_refused_by_the_path(path):
    with pytest.raises(ValueError, match=r"a must be > -1.*got a = -1\.5"):
        path(-1.5, MODEL, FAM)
    with pytest.raises(ValueError, match="a must be > -1"):
        pd.stability_map([1.0], [-1.5, 0.0], law=pd.LinearElastic(1.0, 1.0), path=path, show_progress=False)
    assert pd.simple_shear(-1.5, MODEL, FAM)[0, 1] == -1.5


def test_a_path_can_be_named():
    family, model = pd.lattice_family(2, 2), pd.SethHill(0.0, pd.LinearElastic(1.0, 1.0))
    by_name, by_function = (pd.critical_load(model, family, path) for path in ("uniaxial-strain", pd.uniaxial_strain))
    assert float(by_name) == float(by_function)
    law = pd.LinearElastic(1.0, 1.0)
    grid = pd.stability_map([0.0], [0.02], N=2, dim=2, law=law, path="uniaxial-strain", show_progress=False)
    assert grid.margin.shape == (1, 1) and grid.settings["path"] == "uniaxial_strain"
    with pytest.raises(ValueError, match="path must be one of hydrostatic"):
        pd.stability_map([0.0], [0.02], N=2, dim=2, law=law, path="pull")
    with pytest.raises(ValueError, match="path must be a function"):
        pd.stability_map([0.0], [0.02], N=2, dim=2, law=law, path=3)
