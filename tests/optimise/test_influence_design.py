"""Tests of benchmarks/influence_design.py: the theorem of chains, its counterpart in the plane, and micromoduli.

Each statement is checked with formulas that are written here once more, or by the symbol of pdjax.
"""

import importlib.util
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
LAW = pd.LinearElastic(1.0, 1.0)


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("influence_design", BENCHMARKS / "influence_design.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def kept():
    return json.loads((BENCHMARKS / "results" / "influence_design.json").read_text(encoding="utf-8"))


def chain(weights):
    N = len(weights)
    influence = pd.interpolated_influence(np.arange(1, N + 1) / N, np.asarray(weights))
    return pd.lattice_family(1, N, influence=pd.signed_influence(influence))


def weights_of(seed, N):
    rng = np.random.default_rng(seed)
    w = rng.uniform(-1, 1, N)
    return w * np.sign(w.sum()) if abs(w.sum()) > 0.1 else w + 1.0


@pytest.mark.parametrize("m", [1.0, 0.25, -1.0])
@pytest.mark.parametrize("N", [1, 4])
def test_symbol_of_a_chain_is_the_stress_term_and_the_squared_slope(m, N):
    w, s = weights_of(N, N), 0.93
    model, k, j = pd.SethHill(m, LAW), np.linspace(0.2, np.pi, 7), np.arange(1, N + 1)
    G, slope = (np.array([f(j * x) for x in k]) for f in (lambda x: 1 - np.cos(x), np.sin))
    G, slope = G @ (w / j**2) / (2 * w.sum()), slope @ (w / j) / (2 * w.sum())
    stress = 3 * (s ** (2 * m) - 1) / (2 * m)
    wanted = -4 * ((2 * m - 1) * s ** (2 * m - 2) * stress * G + 3 * s ** (4 * m - 2) * slope**2)
    found = np.asarray(pd.symbol(model, chain(w), np.array([[s]]), k[:, None]))[:, 0, 0]
    assert np.abs(found - wanted).max() < 1e-13 * np.abs(wanted).max()  # measured 1e-15


@pytest.mark.parametrize("N", [1, 2, 3, 4, 5, 6])
def test_no_signed_weights_make_a_chain_stable_on_the_side_of_its_order(N, study):
    """m = 1 fails in compression and m = 0 in tension, at least as badly as the theorem says."""
    for seed in range(2):
        w = weights_of(10 * N + seed, N)
        for m, a in ((1.0, -0.001), (1.0, -0.2), (0.0, 0.05)):
            margin = float(pd.worst_margin(pd.SethHill(m, LAW), chain(w), np.array([[[1 + a]]])))
            assert margin >= study.least_margin(w, m, a) - 1e-12 > 0


@pytest.mark.parametrize("N", [1, 3, 6])
def test_spread_of_gamma_is_at_least_one_over_n_squared(N, study):
    """Bernstein's inequality. The outer shell alone attains the bound."""
    k = np.linspace(0, np.pi, 3001)
    for seed in range(5):
        assert np.ptp(study.chain_gamma(weights_of(seed, N), k)[0]) >= 1 / N**2
    outer = study.chain_gamma(np.eye(N)[-1], k)[0]
    assert abs(np.ptp(outer) * N**2 - 1) < 1e-5  # measured 7e-7, from the grid of k


@pytest.mark.parametrize(("dim", "N"), [(2, 2), (3, 2)])
def test_half_reciprocal_waves_fail_on_one_side(dim, N, study):
    """There the symbol is −2 d p G I, so that compression and tension need opposite signs of G."""
    w = np.array([-0.4, 0.3, 0.9, 0.7][: len(pd.shells(dim, N))])
    family, model = study.shell_family(dim, N, w), pd.SethHill(1.0, LAW)
    k = np.stack(np.meshgrid(*[(0, np.pi)] * dim, indexing="ij"), -1).reshape(-1, dim)[1:]
    xi, omega = np.asarray(family.xi), np.asarray(family.influence)
    G = (1 - np.cos(k @ xi.T)) @ (omega / (xi**2).sum(1)) / omega.sum()
    worst = []
    for a in (-0.05, 0.05):
        p = (dim + 2) * ((1 + a) ** 2 - 1) / 2
        J = np.asarray(pd.symbol(model, family, (1 + a) * np.eye(dim), k))
        wanted = -2 * dim * p * G[:, None, None] * np.eye(dim)
        assert np.abs(J - wanted).max() < 1e-13  # measured 1e-15
        worst.append(float(pd.worst_margin(model, family, pd.load_cases("hydrostatic", [a]))))
    assert max(worst) > 0


def test_square_lattice_with_two_spacings_fails_in_compression_if_its_shape_tensor_is_definite():
    """Weights with G ≤ 0 at all half-reciprocal points leave a growing shear wave along the diagonal."""
    rng = np.random.default_rng(3)
    for _ in range(4):
        x, y = np.sort(rng.uniform(0.05, 0.95, 2))[::-1]  # −w₁/w₃ ≥ w₂/w₃
        w = np.array([-x, y, 1.0])
        influence = pd.signed_influence(pd.interpolated_influence(pd.shells(2, 2), w))
        family, model = pd.lattice_family(2, 2, influence=influence), pd.SethHill(1.0, LAW)
        F, shear = 0.99 * np.eye(2), np.array([1.0, -1.0]) / np.sqrt(2)
        half = np.asarray(pd.symbol(model, family, F, np.pi * np.array([[1.0, 0.0], [1.0, 1.0]])))
        assert np.linalg.eigvalsh(half).max() <= 1e-15
        wave = np.arccos(x) * np.ones((1, 2))
        assert shear @ np.asarray(pd.symbol(model, family, F, wave))[0] @ shear > 0


def test_weights_with_an_indefinite_shape_tensor_are_stable_in_compression_and_refused(study, kept):
    """The formula of this benchmark agrees with the tangent of pdjax, whose public functions refuse the family."""
    row = kept["margins"]["2D, N = 2"]["indefinite L, compression"]
    w = np.array(row["weights"])
    lattice = study.Lattice(2, 2, 40)
    found = lattice.margins(w, [-0.05, 0.05])
    assert found[0] < 0 < found[1] and lattice.definite(w) < 0
    assert abs(found[0] - study._unchecked_margin(w, lattice, 2, -0.05)) < 1e-12  # measured 1e-16
    with pytest.raises(ValueError, match="shape tensor"):
        pd.worst_margin(pd.SethHill(1.0, LAW), study.shell_family(2, 2, w), np.array([0.95 * np.eye(2)]))


def test_formula_of_the_plane_gives_the_margins_of_pdjax(study):
    for dim, w in ((2, [1.0, 0.6, 0.4]), (3, [1.0, 0.5, 0.3, 0.5])):
        lattice = study.Lattice(dim, 2, 16)
        found = float(pd.worst_margin(pd.SethHill(1.0, LAW), study.shell_family(dim, 2, w), 0.95 * np.eye(dim)))
        assert -1e-12 < found - lattice.margins(np.array(w), [-0.05])[0] < 2e-3  # measured 1e-3


@pytest.mark.parametrize("dim", [1, 2])
def test_springs_have_the_symbol_and_the_modulus_of_the_bond_based_model(dim, study):
    springs = study.Springs(dim, 3, 2.0, 6)
    a = springs.coordinates()[0]
    model, family = springs.build(jnp.asarray(a))
    J = -np.asarray(pd.symbol(model, family, np.eye(dim), springs.k)) / (springs.k**2).sum(1)[:, None, None]
    assert np.abs(J - springs.tables(springs.k) @ a).max() < 1e-13  # measured 1e-15
    assert abs(float(pd.p_wave_modulus(model, family)) - (1.0 if dim == 1 else 3.0)) < 1e-12


def test_published_chains_have_their_known_moduli_and_orders(study):
    """The cut Fourier series has the modulus 2 or 0. The central difference of order 2N has the error k^{2N}."""
    for N in (2, 3, 4):
        j = np.arange(1, N + 1)
        assert abs(study.published(N)["Fourier, cut off"] @ j**2 - 2 * (N % 2)) < 1e-12
        a = study.central_difference(N)
        error = [2 * (1 - np.cos(k * j)) @ a / k**2 - 1 for k in (0.2, 0.1)]
        assert abs(np.log2(error[0] / error[1]) - 2 * N) < 0.02 * N  # measured up to 0.004 N


@pytest.mark.parametrize(("N", "kh"), [(2, 1.0), (3, 3.0), (5, 2.0)])
def test_error_of_the_linear_program_alternates(N, kh, study):
    """Chebyshev's certificate: N − 1 free springs are optimal if the extreme errors alternate in sign N times."""
    a = study.linear_program(study.Springs(1, N, kh, 200))
    k = np.linspace(1e-3, kh, 4000)
    e = np.sqrt(2 * (1 - np.cos(np.outer(k, np.arange(1, N + 1)))) @ a) / k - 1
    inner = np.flatnonzero(np.diff(e[:-1]) * np.diff(e[1:]) < 0) + 1
    peaks = e[np.append(inner, len(k) - 1)]
    peaks = peaks[np.abs(peaks) > 0.5 * np.abs(e).max()]
    assert len(peaks) >= N and (np.sign(peaks[1:]) == -np.sign(peaks[:-1])).all()
    assert np.ptp(np.abs(peaks)) < 2e-3 * np.abs(e).max()  # measured 3e-4, from the grid of the program


def test_design_by_gradient_reaches_the_linear_program(study):
    springs = study.Springs(1, 2, 2.0, 12)
    a, _ = study.designed(springs, 60)
    best = np.abs(springs.errors(study.linear_program(springs))).max()
    assert 1 - 1e-6 < np.abs(springs.errors(a)).max() / best < 1.002


def test_kept_micromoduli_have_the_errors_margins_and_order_that_the_file_says(study, kept):
    for row in kept["micromoduli"]["rows"]:
        if row["dim"] == 1 and row["N"] > 1:
            k = row["kh"] * np.arange(1, 501) / 500
            j = np.arange(1, row["N"] + 1)
            for name in {"best", "designed"} & set(row):
                e = np.sqrt(2 * (1 - np.cos(np.outer(k, j))) @ np.array(row[name]["springs"])) / k - 1
                assert np.abs(e).max() < row[name]["error"] * 1.001 and row[name]["margin"] < -0.1
            if "designed" not in row:
                continue
            assert row["best"]["error"] < 1.005 * row["designed"]["error"]  # both have 40 samples of k
            assert row["designed"]["error"] < 1.005 * row["best"]["error"]
            assert row["designed"]["error"] < 0.5 * row["central difference"]["error"]
