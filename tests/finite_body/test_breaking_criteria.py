"""Breaking criteria agree with loops over pairs, both ends of a bond agree, and intact reference sums stay exact."""

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd
from pdjax.finite_body.damage import BREAKING, Criterion
from pdjax.finite_body.damage.critical_bond_energy import bond_energies
from pdjax.trust.point_measures import point_measures

CLOUD = bodies.points(2, "cloud")
X = np.asarray(CLOUD.positions)
FAMS = pd.families(CLOUD, 2.3, bodies.gaussian)
U = 0.1 * bodies.random(5, 2).normal(size=X.shape)
SPRINGS, LPS, SILLING = table.MODELS["bond_based"], table.MODELS["lps"], table.MODELS["correspondence svk"]


def pairs(fams, broken):
    """The pairs (i, j) of the slots that are marked."""
    i, slot = np.nonzero(np.asarray(broken))
    return set(zip(i.tolist(), np.asarray(fams.neighbours)[i, slot].tolist(), strict=True))


def stretched(limit, u=U):
    """The pairs whose stretch exceeds limit(i, j), by a loop."""
    found = set()
    for i, row in enumerate(np.asarray(FAMS.neighbours)):
        for j in row[: int(FAMS.count[i])].tolist():
            long = np.linalg.norm(X[j] + u[j] - X[i] - u[i]) / np.linalg.norm(X[j] - X[i]) - 1
            if long > limit(i, j):
                found.add((i, j))
    return found


@pytest.mark.parametrize("slots", [0, 3])
def test_stretched_bonds_break_at_both_ends_and_padding_and_compression_never_do(slots):
    fams = bodies.padded(FAMS, FAMS.xi.shape[1] + slots)
    broken = pd.CriticalStretch(0.05).broken(SPRINGS, fams, U)
    expected = stretched(lambda i, j: 0.05)
    assert 5 < len(expected) < 50 and pairs(fams, broken) == expected
    assert not np.asarray(broken)[~np.asarray(fams.is_bond)].any()
    assert not np.asarray(pd.CriticalStretch(1e-12).broken(SPRINGS, fams, -0.2 * X)).any()


def test_a_bond_has_the_smaller_critical_stretch_of_its_ends():
    limit = bodies.random(6).uniform(0.01, 0.2, len(X))
    broken = pd.CriticalStretch(limit).broken(SPRINGS, FAMS, U)
    assert pairs(FAMS, broken) == stretched(lambda i, j: min(limit[i], limit[j]))


@pytest.mark.parametrize(
    "criterion", [pd.CriticalStretch(0.05), pd.CriticalBondEnergy(0.01)], ids=lambda c: type(c).__name__
)
def test_broken_bonds_and_no_fail_zones_never_break(criterion):
    first = criterion.broken(LPS, FAMS, U)
    assert first.any()
    assert not criterion.broken(LPS, FAMS.with_broken(first), U)[np.asarray(first)].any()
    zone = np.arange(len(X)) < 5
    spared = eqx.tree_at(lambda c: c.no_fail, criterion, jnp.asarray(zone), is_leaf=lambda x: x is None)
    outside = ~(zone[:, None] | zone[np.asarray(FAMS.neighbours)])
    assert np.array_equal(spared.broken(LPS, FAMS, U), np.asarray(first) & outside)


@pytest.mark.parametrize(
    "criterion",
    [
        pd.CriticalStretch(0.03),
        pd.CriticalBondEnergy(3e-4),
        pd.BreakingRule(lambda bond, here, there: bond.eta[0] * bond.xi[0] > 0.04 + here[1, 1], states="strain"),
    ],
    ids=lambda c: type(c).__name__,
)
def test_a_scan_over_changing_weights_equals_the_loop(criterion):
    loads = [0.3, 0.6, 0.9]

    def after(fams, load):
        return fams.with_broken(criterion.broken(LPS, fams, load * U))

    fams, counts = FAMS, []
    for load in loads:
        fams = after(fams, load)
        counts.append(int((fams.weight == 0).sum()))

    @jax.jit
    def run(weight):
        def step(weight, load):
            now = eqx.tree_at(
                lambda f: (f.weight, f.intact, f.grid), FAMS, (weight, FAMS.weight, None), is_leaf=lambda x: x is None
            )
            weight = after(now, load).weight
            return weight, jnp.sum(weight == 0)

        return jax.lax.scan(step, weight, jnp.asarray(loads))

    weight, scanned = run(FAMS.weight)
    assert np.array_equal(weight, fams.weight) and scanned.tolist() == counts
    assert counts[0] < counts[1] < counts[2]


def work_on_bonds(model, fams, u):
    """∫ (T_ij − T_ji)·dη along u from 0 to `u` in proportion, by Gauss–Legendre quadrature of forces by autodiff."""
    back = fams.neighbours, fams.reverse
    at, weight = np.polynomial.legendre.leggauss(8)
    total = 0.0
    for x, w in zip((1 + at) / 2, weight / 2, strict=True):
        bonds = fams.bonds(x * u)
        T = jax.vmap(jax.grad(lambda eta, b: model.energy(b._replace(eta=eta))))(bonds.eta, bonds)
        T = T / bonds.volume[..., None]
        total = total + w * jnp.sum((T - T[back]) * fams.bonds(u).eta, axis=-1)
    return np.asarray(total)


def rotated(u):
    """The displacement of the deformed body after a rotation by 70°."""
    c, s = np.cos(1.2), np.sin(1.2)
    return (X + u) @ np.array([[c, s], [-s, c]]) - X


@pytest.mark.parametrize("name", ["bond_based", "lps", "correspondence svk", "seth_hill m=0", "silling control"])
def test_bond_energy_is_the_work_of_proportional_loading_and_ignores_rotations(name):
    model, bond = table.MODELS[name], np.asarray(FAMS.is_bond)
    u = 1e-6 * np.stack([np.sin(X[:, 0]) + X[:, 1], X[:, 0] * X[:, 1]], axis=1)
    if name not in ("bond_based", "lps"):  # the work of Foster et al. on a single bond depends on rotations here
        u = 1e-6 * X @ np.array([[2.0, 0.7], [0.7, -0.5]])
    energy = np.asarray(bond_energies(model, FAMS, FAMS.bonds(u)))[bond]
    expected = work_on_bonds(model, FAMS, u)[bond]
    # The strain is 2e-6, and the formula is exact to first order. Measured 1.2e-6
    assert np.abs(energy - expected).max() < 5e-6 * np.abs(expected).max()
    turned = np.asarray(bond_energies(model, FAMS, FAMS.bonds(rotated(1e4 * u))))[bond]
    plain = np.asarray(bond_energies(model, FAMS, FAMS.bonds(1e4 * u)))[bond]
    assert np.abs(turned - plain).max() < 1e-12 * np.abs(plain).max()  # measured 7e-14


@pytest.mark.parametrize("name", ["bond_based", "lps"])
def test_bond_energy_is_exact_under_large_similarities(name):
    model, bond, u = table.MODELS[name], np.asarray(FAMS.is_bond), 0.3 * X
    energy, expected = bond_energies(model, FAMS, FAMS.bonds(u)), work_on_bonds(model, FAMS, u)
    assert np.allclose(np.asarray(energy)[bond], expected[bond], rtol=1e-13, atol=0)  # measured 1.3e-15


def test_bonds_in_compression_have_an_energy_and_do_not_break():
    u = -0.1 * X
    assert np.asarray(bond_energies(LPS, FAMS, FAMS.bonds(u)))[np.asarray(FAMS.is_bond)].min() > 0
    assert not pd.CriticalBondEnergy(1e-12).broken(LPS, FAMS, u).any()
    assert pd.CriticalBondEnergy(1e-12).broken(LPS, FAMS, -u).sum() == FAMS.is_bond.sum()


def test_a_rule_gets_the_bond_and_the_states_of_both_ends():
    def by_stretch(bond, here, there):
        return jnp.linalg.norm(bond.xi + bond.eta) > 1.05 * jnp.linalg.norm(bond.xi)

    expected = pd.CriticalStretch(0.05).broken(SPRINGS, FAMS, U)
    assert np.array_equal(pd.BreakingRule(by_stretch).broken(SPRINGS, FAMS, U), expected)
    graded = pd.graded(SILLING, np.linspace(1, 2, len(X)))
    stress = np.asarray(pd.stress(graded, FAMS, U))[:, 0, 0]
    rule = pd.BreakingRule(lambda bond, here, there: here[0, 0] > there[0, 0] + 0.1, states="stress")
    there = stress[np.asarray(FAMS.neighbours)]
    one_end = (stress[:, None] > there + 0.1) | (there > stress[:, None] + 0.1)
    assert np.array_equal(rule.broken(graded, FAMS, U), one_end & np.asarray(FAMS.is_bond))
    own = pd.BreakingRule(
        lambda b, here, there: here["p"] > there["p"] + 0.1, lambda m, bonds: {"p": m.stress(bonds)[0, 0]}
    )
    assert np.array_equal(own.broken(graded, FAMS, U), rule.broken(graded, FAMS, U))


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: pd.CriticalStretch(-0.1), "stretch must be finite and > 0"),
        (lambda: pd.CriticalStretch(float("nan")), "stretch must be finite and > 0"),
        (lambda: pd.CriticalStretch(float("inf")), "stretch must be finite and > 0"),
        (lambda: pd.CriticalBondEnergy(0.0), "energy must be finite and > 0"),
        (lambda: pd.CriticalBondEnergy(np.ones(3)), "energy of CriticalBondEnergy must be one number"),
        (lambda: pd.CriticalStretch(0.1, no_fail=[1, 2]), "no_fail must be a mask of bool"),
        (lambda: pd.CriticalStretch(np.ones(3)).broken(LPS, FAMS, U), "one for each of the 15 points"),
        (lambda: pd.CriticalStretch(0.1, no_fail=np.ones(3, bool)).broken(LPS, FAMS, U), "each of the 15 points"),
        (
            lambda: pd.CriticalBondEnergy(1.0).broken(table.MODELS["reproducing_kernel 1"], FAMS, U),
            "cannot serve ReproducingKernel.*serves BondBased, LPS, Correspondence",
        ),
        (lambda: pd.BreakingRule(3.0), "function must be a function"),
        (lambda: pd.BreakingRule(max, states="energy"), "states must be"),
        (lambda: pd.BreakingRule(lambda b, h, t: b.eta).broken(LPS, FAMS, U), "must return one bool"),
        (lambda: pd.CriticalStretch(0.1).broken(LPS, FAMS, U * np.nan), "u must be finite"),
        (lambda: FAMS.with_broken(np.zeros((2, 2), bool)), "broken must have shape"),
        (lambda: FAMS.with_broken(np.eye(15, FAMS.xi.shape[1], dtype=bool)), "broken at one end only"),
    ],
)
def test_bad_input_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_every_criterion_of_the_table_is_one():
    assert all(issubclass(kind, Criterion) for kind in BREAKING.values())


BROKEN = np.asarray(pd.CriticalStretch(0.05).broken(SPRINGS, FAMS, U))
AFTER = FAMS.with_broken(BROKEN)


@pytest.mark.parametrize("name", ["bond_based", "lps", "correspondence svk"])
def test_forces_after_a_break_are_the_gradient_of_the_energy(name):
    model = table.MODELS[name]
    assert BROKEN.any()
    f = np.asarray(pd.force_density(model, AFTER, U))
    slope = jax.grad(lambda u: pd.strain_energy(model, AFTER, u))(jnp.asarray(U))
    expected = -np.asarray(slope) / np.asarray(FAMS.volumes)[:, None]
    scale = np.abs(expected).max()
    assert np.abs(f - expected).max() < 1e-14 * scale  # measured 3e-16
    assert np.abs(np.asarray(FAMS.volumes) @ f).max() < 1e-14 * scale  # measured 3e-16
    step, v = 1e-6, bodies.random(8).normal(size=U.shape)
    ahead, behind = (pd.force_density(model, AFTER, U + s * step * v) for s in (1, -1))
    J = np.asarray(pd.jacobian(model, AFTER, U, form="dense")).reshape(U.size, U.size)
    Jv = J @ v.reshape(-1)
    sparse = pd.jacobian(model, AFTER, U, form="sparse")
    assert np.abs(sparse - J).max() < 1e-14 * np.abs(J).max()  # measured 3e-16
    assert (
        np.abs(Jv.reshape(U.shape) - (ahead - behind) / (2 * step)).max() < 1e-9 * np.abs(Jv).max()
    )  # measured 1.8e-11


def test_a_damaged_lps_is_an_lps_of_the_remaining_family_with_other_moduli():
    r = np.asarray(pd.weighted_volume(AFTER) / pd.weighted_volume(FAMS))
    assert 0 < r.min() < r.max() < 1
    k = r**2 * LPS.bulk + r * (1 - r) * 2 * LPS.shear  # (d + 2)/d = 2
    other, rest = pd.LPS(k, r * LPS.shear), FAMS.with_weight(np.where(BROKEN, 0.0, 1.0))
    for of in (pd.force_density, pd.energy_density):
        found, expected = np.asarray(of(LPS, AFTER, U)), np.asarray(of(other, rest, U))
        assert np.abs(found - expected).max() < 1e-14 * np.abs(expected).max()  # measured 1.2e-16
        assert np.abs(found - np.asarray(of(LPS, rest, U))).max() > 0.1 * np.abs(expected).max()


def test_backends_keep_the_reference_sums_of_the_intact_family():
    from pdjax.force.backends.padded import Whole
    from pdjax.force.backends.streamed import prepare_streamed
    from pdjax.force.backends.traversal import SlotTraversal

    for model in (SPRINGS, LPS, SILLING):
        whole = Whole(AFTER).force(model, jnp.asarray(U), None)
        streamed = prepare_streamed(model, AFTER, SlotTraversal).force(model, jnp.asarray(U), None)
        assert np.abs(streamed - whole).max() < 1e-14 * np.abs(whole).max()  # measured 2.6e-16


def test_dilatation_after_a_break_is_that_of_lps():
    u, all_but = 0.01 * X, 1 - BROKEN.sum(axis=1) / np.asarray(FAMS.count)
    theta = np.asarray(pd.dilatation(AFTER, u))
    r = np.asarray(pd.weighted_volume(AFTER) / pd.weighted_volume(FAMS))
    assert np.allclose(theta, 0.02 * r, rtol=1e-12) and (all_but < 1).any()


def test_a_break_releases_energy_in_an_affine_state_and_a_cut_of_lps_does_not():
    u = 0.01 * X
    before = float(pd.strain_energy(LPS, FAMS, u))
    released = float(pd.released_energy(LPS, FAMS, u, BROKEN))
    assert 0.3 * before < released < 0.5 * before  # measured 0.378
    assert np.isclose(released, before - float(pd.strain_energy(LPS, AFTER, u)), rtol=1e-12)
    removed = FAMS.with_weight(np.where(BROKEN, 0.0, 1.0))
    assert abs(before - float(pd.strain_energy(LPS, removed, u))) < 1e-14 * before  # measured 0
    assert abs(float(pd.released_energy(SILLING, FAMS, u, BROKEN))) < 1e-14 * before  # measured 7e-17


def test_an_audit_of_a_damaged_body_has_the_energy_of_intact_reference_sums():
    u = 0.01 * X  # an affine state, where P + W(U) is W
    found = point_measures(LPS, AFTER, u, None, 1.0, 1.0).energy
    assert np.allclose(found, pd.energy_density(LPS, AFTER, u), rtol=1e-12, atol=0)


def test_breaking_twice_equals_breaking_once():
    more = pd.CriticalStretch(0.02).broken(SPRINGS, AFTER, U)
    twice, once = AFTER.with_broken(more), FAMS.with_broken(BROKEN | np.asarray(more))
    assert np.array_equal(twice.weight, once.weight) and np.array_equal(twice.intact, FAMS.weight)
    halves = [float(pd.released_energy(LPS, *case)) for case in ((FAMS, U, BROKEN), (AFTER, U, more))]
    assert np.isclose(sum(halves), float(pd.released_energy(LPS, FAMS, U, BROKEN | np.asarray(more))), rtol=1e-12)


@pytest.mark.parametrize("name", ["bond_based", "lps", "correspondence svk"])
def test_a_point_that_has_lost_all_bonds_has_no_force_and_finite_derivatives(name):
    model, lonely = table.MODELS[name], np.arange(len(X)) == 7
    off = np.asarray(FAMS.is_bond) & (lonely[:, None] | lonely[np.asarray(FAMS.neighbours)])
    fams = FAMS.with_broken(off)
    assert not np.asarray(pd.force_density(model, fams, U))[7].any()
    assert np.isfinite(jax.grad(lambda u: pd.strain_energy(model, fams, u))(jnp.asarray(U))).all()
    assert not pd.CriticalBondEnergy(1e-9).broken(model, fams, U)[7].any()


def test_a_model_without_an_energy_releases_none():
    with pytest.raises(ValueError, match="needs a model with an energy"):
        pd.released_energy(table.MODELS["littlewood control"], FAMS, U, BROKEN)


def test_released_energy_has_gradients():
    slope = jax.grad(lambda u: pd.released_energy(LPS, FAMS, u, BROKEN))(jnp.asarray(U))
    v, step = bodies.random(9).normal(size=U.shape), 1e-6
    ahead, behind = (float(pd.released_energy(LPS, FAMS, U + s * step * v, BROKEN)) for s in (1, -1))
    assert np.isclose(np.sum(slope * v), (ahead - behind) / (2 * step), rtol=1e-7)


@pytest.mark.parametrize("criterion", [pd.CriticalStretch, pd.CriticalBondEnergy])
def test_bonds_of_a_no_fail_mask_do_not_break(criterion):
    """A mask of bonds, given at one end only, protects both ends. A mask of points protects all bonds of the points."""
    body = pd.lattice((6, 5))
    families, u = pd.families(body, 2.1), 0.1 * body.positions
    whole = np.asarray(criterion(1e-6).broken(pd.BondBased(1.0), families, u))
    here = np.zeros(whole.shape, bool)
    here[7, 3] = True
    there = int(families.neighbours[7, 3]), int(families.reverse[7, 3])
    left = np.asarray(criterion(1e-6, no_fail=here).broken(pd.BondBased(1.0), families, u))
    assert whole.all(where=np.asarray(families.is_bond)) and not left[7, 3] and not left[there]
    assert left.sum() == whole.sum() - 2
    points = np.arange(30) == 7
    zone = points[:, None] | points[np.asarray(families.neighbours)]
    both = [np.asarray(criterion(1e-6, no_fail=m).broken(pd.BondBased(1.0), families, u)) for m in (points, zone)]
    assert np.array_equal(*both) and np.array_equal(both[0], whole & ~zone)
    with pytest.raises(ValueError, match=r"shape \(30,\), or one for each bond, shape \(30, 12\); got shape \(30, 3\)"):
        criterion(1e-6, no_fail=np.zeros((30, 3), bool)).broken(pd.BondBased(1.0), families, u)


def test_mistakes_of_newcomers_are_named():
    families, model = pd.families(pd.lattice((5, 4)), 2.1), pd.LPS(1.0, 0.6)
    u = np.zeros((20, 2))
    with pytest.raises(ValueError, match=r"smoothing must be at most 0\.2 of the critical stretch.*Take a tenth"):
        pd.CriticalStretch(0.01, smoothing=0.005)
    with pytest.raises(ValueError, match=r"BreakingRule failed: .*states= is given"):
        pd.BreakingRule(lambda bond, here, there: jnp.trace(here) > 0).broken(model, families, u)
    with pytest.raises(ValueError, match="BreakingRule failed"):
        pd.BreakingRule(lambda bond: True).broken(model, families, u)
    safe = np.arange(20) < 3
    family = pd.lattice_family(2, 2.1)
    whole = pd.CriticalStretch.from_fracture_energy(1e-4, model, family, smoothing=1e-4, no_fail=safe)
    plain = pd.CriticalStretch.from_fracture_energy(1e-4, model, family)
    assert float(whole.stretch) == float(plain.stretch) and whole.smooth and np.array_equal(whole.no_fail, safe)
    assert repr(pd.CriticalStretch(0.01)) == "CriticalStretch(stretch=0.01)"
