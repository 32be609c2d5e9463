"""Models made from E and ν have these constants on a fine family; constants out of range raise ValueError."""

import numpy as np
import pytest

import pdjax as pd


def recovered(model, N):
    """ℂ₁₁₁₁, ℂ₁₁₂₂ and ℂ₁₂₁₂ of a 2D lattice family at rest, by central differences over two affine maps."""
    fam, h = pd.lattice_family(2, N), 1e-6
    columns = []
    for G in (np.array([[1.0, 0], [0, 0]]), np.array([[0, 0.5], [0.5, 0]])):
        P = [np.asarray(pd.piola_stress(model, fam, np.eye(2) + s * h * G)) for s in (1, -1)]
        columns.append((P[0] - P[1]) / (2 * h))
    return columns[0][0, 0], columns[0][1, 1], columns[1][0, 1]


def test_plane_stress_and_plane_strain_of_lps():
    """For E = 2, ν = 0.3 the stiffness is E/(1 − ν²) or E(1 − ν)/((1 + ν)(1 − 2ν)), up to the lattice's anisotropy."""
    E, nu = 2.0, 0.3
    for plane, stiff in (("stress", E / (1 - nu**2)), ("strain", E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)))):
        found, cross, shear = recovered(pd.LPS.from_young(E, nu, 2, plane), 6)
        assert found == pytest.approx(stiff, rel=0.02)  # 1.2e-2
        # The lattice makes one shear modulus stiffer (3 %) and the other softer. Their mean is exact for every family.
        assert ((found - cross) / 2 + shear) / 2 == pytest.approx(E / (2 * (1 + nu)), rel=1e-8)  # 1e-10
        k = pd.plane_bulk_modulus(E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu)), plane)
        assert (found + cross) / 2 == pytest.approx(float(k), rel=1e-8)  # exact for every family


def test_bond_based_from_young_has_the_closed_form_micromodulus():
    for plane, nu in (("strain", 0.25), ("stress", 1 / 3)):
        model = pd.BondBased.from_young(2.0, nu, 1.0, 2, plane)
        exact = {"strain": 48 * 2 / (5 * np.pi), "stress": 9 * 2 / np.pi}[plane]
        assert float(model.c) == pytest.approx(exact, rel=1e-12)
    assert float(pd.BondBased.from_young(2.0, 0.25, 1.0).c) == pytest.approx(12 * 2 / np.pi, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: pd.BondBased.from_young(1.0, 0.3, 1.0), "Poisson's ratio 0.25"),
        (lambda: pd.BondBased.from_young(1.0, 0.25, 1.0, 2, "stress"), "Poisson's ratio 0.3333"),
        (lambda: pd.BondBased.from_young(1.0, 0.25, 1.0, 2), "needs dim 3"),
        (lambda: pd.LPS.from_young(1.0, 0.5), "between -1 and 1/2"),
        (lambda: pd.LPS.from_young(-1.0, 0.2), "young must be finite and > 0"),
        (lambda: pd.LPS.from_young(1.0, 0.2, 3, "strain"), "needs dim 3"),
    ],
)
def test_constants_out_of_range_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
