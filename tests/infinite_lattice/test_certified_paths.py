"""Stability proved along load paths: the sums that carry the proof, against dense scans, critical loads and maps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd
from pdjax.infinite_lattice.certificate.load_forms import load_form
from pdjax.infinite_lattice.lattice_states import linearised

LAW = pd.LinearElastic(1.0, 1.0)
SETH_HILL = pd.SethHill(1.0, LAW)
CONTROLLED = pd.SethHill(1.0, LAW, pd.SillingControl(0.065))
MODELS = table.MODELS | {
    "seth_hill m=0, control": pd.SethHill(0.0, LAW, pd.SillingControl(0.3)),
    "seth_hill m=1/2, control": pd.SethHill(0.5, LAW, pd.WanControl()),
    "seth_hill m=2, control": pd.SethHill(2.0, LAW, pd.SillingControl(0.5)),
}


def forms(dims=(1, 2)):
    """(name, dim, path) of every model that has a form along a path."""
    pairs = [(n, d, p) for n, m in MODELS.items() for d in dims if d in m.dims for p in pd.PATHS]
    return [c for c in pairs if load_form(MODELS[c[0]], pd.PATHS[c[2]]) and not (c[1] == 1 and c[2] == "simple-shear")]


@pytest.mark.parametrize(("name", "dim", "path"), forms())
def test_symbol_is_the_declared_sum_of_functions_of_the_load_and_lies_in_the_hull(name, dim, path):
    model, family = MODELS[name], pd.lattice_family(dim, 2, influence=pd.linear_influence)
    form = load_form(model, pd.PATHS[path])
    loads = np.array([-0.3, -0.1, 0.05, 0.2, 0.4])
    F = np.stack([np.asarray(pd.PATHS[path](jnp.asarray(a), model, family)) for a in loads])
    series = linearised(model, family, F).blocks * np.array([form.scale(a) for a in loads])[:, None, None, None]
    flat, basis = series.reshape(len(loads), -1), np.stack([form.basis(a) for a in loads])
    fitted = basis @ np.linalg.lstsq(basis, flat, rcond=None)[0]
    assert np.abs(fitted - flat).max() < 1e-14 * np.abs(flat).max()  # measured 1e-15
    # The curve b(a) is a convex combination of the first end and the vertices.
    low, high = -0.2, 0.3
    vertices = np.concatenate([form.basis(low)[None], form.vertices(low, high)])
    for a in np.linspace(low, high, 7):
        weights = np.linalg.lstsq(vertices.T, form.basis(a), rcond=None)[0]
        assert np.abs(weights @ vertices - form.basis(a)).max() < 1e-13
        assert weights.min() > -1e-12


def test_every_kind_of_form_is_tested():
    terms = {(len(load_form(MODELS[n], pd.PATHS[p]).basis(0.1)), p) for n, _, p in forms()}
    assert {(2, "hydrostatic"), (3, "hydrostatic"), (3, "uniaxial-strain"), (3, "simple-shear")} <= terms


@pytest.mark.parametrize("path", ["hydrostatic", "uniaxial-strain", "uniaxial-stress"])
def test_stability_is_proved_up_to_the_critical_load_and_not_beyond_it(path):
    family = pd.lattice_family(2, 2)
    critical = float(pd.critical_load(CONTROLLED, family, path))
    proof = pd.certify_path(CONTROLLED, family, 0.99 * critical, path)
    assert proof.verdict == "stable" and proof.continuous == (path != "uniaxial-stress")
    beyond = pd.certify_path(CONTROLLED, family, 1.3 * critical, path)
    assert beyond.verdict == "unstable"
    assert abs(beyond.stable_to) < abs(critical) < abs(beyond.unstable_at)
    if proof.continuous:
        loads = np.linspace(0, proof.load, 12)[1:]
        margins = [float(pd.stability(CONTROLLED, family, pd.PATHS[path](a, CONTROLLED, family)).margin) for a in loads]
        assert max(margins) < 0


def test_a_path_that_is_marginal_says_so_and_spends_no_boxes():
    proof = pd.certify_path(pd.Correspondence(LAW), pd.lattice_family(2, 2), 0.1)
    assert proof.verdict == "marginal" and proof.stable_to == 0 and proof.boxes == 0
    assert "zero-energy wave" in str(proof)


def test_a_side_that_fails_at_once_is_proved_unstable():
    found = pd.certify_critical_load(SETH_HILL, pd.lattice_family(2, 2))
    assert found.load == 0 and found.proved and found.verdict == "proved unstable at once"


@pytest.mark.parametrize("model", [CONTROLLED, pd.BondBased(1.0)])
def test_both_sides_of_a_critical_load_are_proved(model):
    found = pd.certify_critical_load(model, pd.lattice_family(2, 2))
    assert found.proved and found.below.continuous
    assert "every load before it" in found.verdict and found.beyond.lower > 0
    never = pd.certify_critical_load(model, pd.lattice_family(2, 2), side="positive")
    assert np.isinf(never.load) == (never.beyond is None) and never.proved


def test_a_wrong_critical_load_is_noticed(monkeypatch):
    monkeypatch.setattr(
        "pdjax.infinite_lattice.criteria.certified_critical.critical_load", lambda *a, **k: jnp.asarray(-0.2)
    )
    found = pd.certify_critical_load(CONTROLLED, pd.lattice_family(2, 2))
    assert not found.proved and "the critical load is wrong" in found.verdict


def test_a_map_proves_every_sign_but_those_of_marginal_states(tmp_path):
    arguments = dict(N=2, dim=2, law=LAW, show_progress=False)
    grid = pd.stability_map([0.0, 0.5, 1.0], [-0.1, -0.05, 0.0, 0.05, 0.1], certify=1.0, **arguments)
    plain = pd.stability_map([0.0, 0.5, 1.0], [-0.1, -0.05, 0.0, 0.05, 0.1], **arguments)
    assert plain.proof is None and np.allclose(plain.margin, grid.margin, atol=1e-14)
    assert (np.array(["stable", "marginal", "unstable"])[grid.proof + 1] == grid.verdict).all()
    again = pd.StabilityMap.load(grid.save(tmp_path / "map.npz"))
    assert (again.proof == grid.proof).all()
    assert "proved" in pd.figures.stability_map(grid).axes[-1].get_title()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f: pd.certify_path(SETH_HILL, f, 0.0), "load must be finite and not 0"),
        (lambda f: pd.certify_path(SETH_HILL, f, np.nan), "load must be finite and not 0"),
        (lambda f: pd.certify_path(SETH_HILL, f, -1.5), "must be > -1"),
        (lambda f: pd.certify_path(pd.Correspondence(LAW, pd.LittlewoodControl(1.0)), f, 0.1), "no energy"),
        (lambda f: jax.jit(lambda m: pd.certify_path(pd.SethHill(m, LAW), f, 0.1).stable_to)(1.0), "known numbers"),
        (lambda f: pd.stability_map([1.0], [0.1], 2, 1, LAW, criterion="block", certify=1.0), "symbol"),
        (lambda f: pd.stability_map([1.0], [0.1], 2, 1, LAW, certify=0.0), "tol must be"),
    ],
)
def test_what_cannot_be_proved_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call(pd.lattice_family(1, 2))


def worst_margin_up_to(model, family, path, load, count=60):
    """The largest margin of the search at loads between 0 and the given one."""
    loads = load * np.geomspace(1e-3, 1, count)
    return max(float(pd.stability(model, family, pd.PATHS[path](jnp.asarray(a), model, family)).margin) for a in loads)


class Soft(pd.LinearElastic):
    """A law of a user with a dip in its energy."""

    def energy(self, E):
        return super().energy(E) + 0.003 * jnp.exp(-(((E[0, 0] + E[1, 1] + 0.2) / 0.02) ** 2))


FALSE_CLAIMS = {  # States of a referee, who got false proofs from an earlier version.
    "rest is unstable by negative strengths": (
        pd.SethHill(1.0, LAW, pd.ShellControl(pd.shells(2, 2), [-0.02] * 3)),
        "hydrostatic",
        0.5,
    ),
    "rest is unstable by a negative modulus": (
        pd.Correspondence(pd.LinearElastic(3.0, -0.2), pd.SillingControl(1.0)),
        "hydrostatic",
        0.8,
    ),
    "powers of very different size": (pd.SethHill(10.0, LAW, pd.SillingControl(0.02)), "hydrostatic", -0.9),
    "negative powers": (pd.SethHill(-5.0, LAW, pd.SillingControl(0.02)), "hydrostatic", 100.0),
    "dependent powers": (pd.SethHill(1 + 2.2e-16, LAW, pd.SillingControl(0.065)), "hydrostatic", -0.3),
    "a user's law": (pd.SethHill(1.0, Soft(1.0, 1.0), pd.SillingControl(0.5)), "hydrostatic", -0.25),
}


@pytest.mark.parametrize("case", FALSE_CLAIMS)
def test_no_load_up_to_the_proved_one_is_unstable(case):
    model, path, load = FALSE_CLAIMS[case]
    family = pd.lattice_family(2, 2)
    proof = pd.certify_path(model, family, load, path)
    assert proof.verdict != "stable"
    assert proof.stable_to == 0 or worst_margin_up_to(model, family, path, proof.stable_to) < 0


def test_a_path_that_has_no_state_but_rest_is_undecided():
    def nowhere(a, model, family):
        return jnp.eye(family.dim) * jnp.where(a == 0, 1.0, jnp.nan)

    proof = pd.certify_path(SETH_HILL, pd.lattice_family(1, 2), 0.1, nowhere)
    assert proof.verdict == "undecided" and proof.stable_to == 0


def test_powers_that_overflow_are_refused():
    with pytest.raises(ValueError, match="overflow"):
        pd.certify_path(pd.SethHill(60.0, LAW, pd.SillingControl(0.02)), pd.lattice_family(2, 2), -0.999)
