"""No verdict depends on units, in float32 and float64: lengths, moduli and densities are scaled by powers of ten."""

import jax
import numpy as np
import pytest

import pdjax as pd

UNITS = [(1e-9, 1e11, 8e3), (1e3, 1e9, 1e-3)]  # units of length, pressure and density


@pytest.fixture(params=[32, 64])
def precision(request):
    with jax.enable_x64(request.param == 64):
        yield request.param


def lattice_models(P, fam):
    law = pd.LinearElastic(P, 0.8 * P)
    yield from (pd.SethHill(1.0, law), pd.Correspondence(law))
    if fam.dim > 1:
        yield pd.LPS(P, 0.8 * P)


@pytest.mark.parametrize("dim, N", [(1, 3), (2, 2), (3, 1.5)])
def test_verdict_margin_and_load_of_a_lattice_do_not_depend_on_units(precision, dim, N):
    def found(h, P):
        fam, F = pd.lattice_family(dim, N, spacing=h), 0.97 * np.eye(dim)
        rows = []
        for model in lattice_models(P, fam):
            states = [pd.stability(model, fam, F, criterion) for criterion in ("symbol", "diagonal")]
            load = pd.critical_load(model, fam, pd.hydrostatic)
            rows.append([s.verdict for s in states] + [float(s.margin) for s in states] + [float(load)])
        return rows

    expected = found(1.0, 1.0)
    assert expected[0][0] == "unstable" and expected[1][0] == "marginal"
    for h, P, _ in UNITS:
        for row, right in zip(found(h, P), expected, strict=True):
            assert row[:2] == right[:2]
            margins = np.abs(np.array(row[2:4]) - right[2:4])
            assert margins.max() < (1e-14 if precision == 64 else 1e-6)  # 3e-17, 8e-8
            if np.isfinite(right[4]):
                assert abs(row[4] - right[4]) < 1e-6  # 2e-7 where the margin leaves 0, 3e-14 where it was negative
            else:
                assert row[4] == right[4]


@pytest.mark.parametrize("h, P", [(1e-6, 1e11), (1e3, 1e9)])
def test_verdicts_of_a_map_do_not_depend_on_units(precision, h, P):
    def verdict(P):
        law = pd.LinearElastic(P, 0.8 * P)
        return pd.stability_map([0.0, 1.0], [-0.05, 0.05], law=law, lines=("diagonal",), show_progress=False).verdict

    assert np.array_equal(verdict(P), verdict(1.0))


@pytest.mark.parametrize("dim", [3])
def test_equilibrium_spectrum_and_time_step_of_a_body_do_not_depend_on_units(precision, dim):
    shape = {2: (8, 4), 3: (6, 3, 3)}[dim]

    def found(h, P, density):
        body = pd.lattice(shape, h)
        x, law = body.positions[:, 0] / h, pd.LinearElastic(P, 0.8 * P)
        held = pd.prescribe(x < 1, 0.0), pd.prescribe(x > shape[0] - 1, [0.02 * h] + [0.0] * (dim - 1))
        out = []
        for model in (pd.Correspondence(law, pd.SillingControl(0.5)),):
            scene = pd.scene(body, pd.families(body, 2 * h), model, *held)
            newton = pd.solve(scene)
            relaxed = pd.solve(scene, "relaxation", stability=False)
            assert newton.converged and relaxed.converged and newton.kind == "minimum"
            step = pd.critical_time_step(pd.motion(scene, density)) * np.sqrt(P / density) / h
            lowest = float(newton.stability.eigenvalue) * h**2 / P
            out.append([*np.ravel(newton.u) / h, *np.ravel(relaxed.u) / h, step, lowest])
        return np.array(out)

    expected = found(1.0, 1.0, 1.0)
    for units in UNITS:
        error = np.abs(found(*units) - expected) / np.maximum(1, np.abs(expected))
        assert error.max() < (1e-8 if precision == 64 else 3e-6)  # 2e-11 (relaxation stops at 1e-10), 3e-7


def test_forces_beyond_float32_raise_with_advice():
    with jax.enable_x64(False):
        h, law = 1e-7, pd.LinearElastic(1e11, 1e11)
        fams = pd.families(pd.lattice((4, 4, 4), h), 2 * h)
        u = 1e-2 * h * np.random.default_rng(0).normal(size=(64, 3))
        with pytest.raises(ValueError, match="lengths are near 1, or float64"):
            pd.force_density(pd.Correspondence(law), fams, u)


@pytest.mark.parametrize("P", [1e-6, 1e3, 1e11])
def test_the_lateral_stretch_of_uniaxial_stress_does_not_depend_on_units(precision, P):
    family = pd.lattice_family(2, 2)

    def stretch(P):
        law = pd.LinearElastic(1.494 * P, P)
        return np.asarray(pd.uniaxial_stress(0.03, pd.SethHill(1.0, law), family))[1, 1]

    assert abs(stretch(P) - stretch(1.0)) < (1e-14 if precision == 64 else 1e-6)  # 3e-16, 1e-7
