"""Defects that a review of the numerics found in the models. Each test is a case that was once wrong."""

import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd

LAW = pd.LinearElastic(1.0, 1.0)


def test_every_row_of_a_map_is_checked_at_rest():
    """A row with λ + 2μ < 0 was once called stable, because the margin and its unit change sign together."""
    with pytest.raises(ValueError, match="positive P-wave modulus"):
        pd.stability_map(
            [1.0, -3.0],
            [0.01],
            dim=1,
            model=lambda lam: pd.BondLevel(pd.LinearElastic(lam, 1.0)),
            criterion="diagonal",
            show_progress=False,
        )


def test_shared_constants_of_a_cell_are_not_taken_for_points():
    """A law has two constants and the cell has one point. Real and imaginary part once took one constant each."""
    law = pd.EnergyLaw(lambda E, c: 0.5 * jnp.sum(c) * jnp.trace(E) ** 2, "E", jnp.asarray([1.0, 5.0]))
    one = pd.cell_families(pd.lattice((1,), periodic=True), 1.0)
    k = np.array([[0.4 * np.pi]])
    found = np.asarray(pd.cell_symbol(pd.Correspondence(law), one, np.eye(1), k))[0, 0, 0].real
    assert found == pytest.approx(-6 * np.sin(0.4 * np.pi) ** 2, rel=1e-12)  # F̄ of two bonds: central differences


def test_the_fastest_mode_without_energy_is_reported():
    """A model that is unstable for long waves once reported 0. It reports the largest γ² of the zone and its wave."""
    model, fam, F = pd.BondAssociatedForce(LAW, 0.75), pd.lattice_family(2, 2), 0.7 * jnp.eye(2)
    found = pd.stability(model, fam, F, resolution=12)
    assert found.verdict == "unstable" and float(found.eigenvalue) > 0.5  # 0.81
    values = np.linalg.eigvals(np.asarray(pd.symbol(model, fam, F, np.asarray(found.wave_vector))))
    assert np.max(np.sqrt(values.astype(complex)).real ** 2) == pytest.approx(float(found.eigenvalue), rel=1e-9)


def test_cell_stability_names_a_wrong_argument():
    cell = pd.cell_families(pd.lattice((2,), periodic=True), 1.0)
    model = pd.BondLevel(LAW)
    for arguments, words in (
        ({"modulus": -3.0}, "modulus must be finite and > 0"),
        ({"intervals": 0}, "intervals must be"),
        ({"period": (2.0, 2.0)}, "period must hold 1"),
    ):
        with pytest.raises(ValueError, match=words):
            pd.cell_stability(model, cell, **({"period": (2.0,), "F": np.eye(1), "modulus": 3.0} | arguments))
    assert pd.cell_stability(model, cell, (2.0,), np.eye(1), 3.0).verdict == "stable"


def test_zero_energy_waves_of_a_lattice_without_cubic_symmetry_have_zero_energy():
    """Waves with energy were once reported, because the zone was reduced as if x and y were equivalent."""
    fam = pd.lattice_family(2, 2)
    half = fam.xi.shape[0] // 2
    weight = np.where(np.abs(np.asarray(fam.xi[:half, 0])) > 0.5, 1.0, 0.4)
    fam = fam.with_weight(jnp.asarray(np.concatenate([weight, weight])))
    model = pd.Correspondence(LAW)
    waves = pd.zero_energy_waves(model, fam)
    assert len(waves)
    values = np.linalg.eigvalsh(np.asarray(pd.symbol(model, fam, np.eye(2), np.pi * waves)))[:, -1]
    assert np.abs(values).max() < 1e-4, values  # waves are rounded to 3 digits


def test_a_constant_of_a_lattice_family_is_one_number():
    """Two numbers in 2D were once broadcast over the components, and the model was called stable."""
    for model in (pd.BondBased([1.0, 2.0]), pd.LPS([1.0, 2.0], 1.0), pd.graded(pd.BondBased(1.0), [1.0, 2.0])):
        with pytest.raises(ValueError, match="must be one number on a lattice family"):
            pd.stability(model, pd.lattice_family(2, 2), np.eye(2))


def test_the_reach_of_sub_families_may_vary_from_point_to_point():
    fams = pd.families(pd.lattice((5,)), 2.0)
    model = pd.BondAssociated(LAW, jnp.asarray([1.0, 0.9, 1.0, 0.9, 1.0]))
    assert np.isfinite(np.asarray(pd.force_density(model, fams, np.zeros((5, 1))))).all()


def test_states_of_both_ends_must_be_even_for_the_fast_symbol():
    class Odd(pd.BondLevelAverage):
        even = False

    with pytest.raises(ValueError, match="cell_symbol"):
        pd.symbol(Odd(LAW), pd.lattice_family(1, 2), np.eye(1), np.array([1.0]))


def test_a_graded_control_does_not_pass_the_continuum_criterion():
    model = pd.graded(pd.Correspondence(LAW, pd.SillingControl()), 1.0)
    with pytest.raises(ValueError, match="continuum"):
        pd.stability(model, pd.lattice_family(1, 2), np.eye(1), "continuum")
