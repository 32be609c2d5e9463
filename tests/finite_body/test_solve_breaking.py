"""Quasi-static breaking: energies, order of breaks, loose pieces, endings, checkpoints, programs, wrong input."""

import jax
import numpy as np
import pytest

import pdjax as pd
from pdjax.finite_body.statics.breaking_rounds import most_overloaded
from pdjax.finite_body.statics.load_paths import load_paths

SIDE = 12
BODY = pd.lattice((SIDE, SIDE))
X = BODY.positions
FAMILIES = pd.families(BODY, 2.1)
NOTCHED = pd.cut(FAMILIES, pd.Segment((0.0, 6.0), (5.0, 6.0)))
LOW, HIGH = X[:, 1] < 2, X[:, 1] > 10
MODELS = {"bond-based": pd.BondBased(1.0), "LPS": pd.LPS(1.0, 0.6)}
ACROSS = (X[:, 1:] - 6) * (X[np.asarray(FAMILIES.neighbours), 1] - 6) < 0  # bonds that cross the plane of the notch
QUIET = {"show_progress": False}


def interface(stretch):
    """A critical stretch for the bonds that cross the plane of the notch. All others never break."""
    return pd.CriticalStretch(stretch, no_fail=~ACROSS)


STRETCH = interface(0.03)


def pulled(model, families=NOTCHED, by=0.3):
    """The notched plate, whose upper layer is displaced and whose lower layer is held."""
    return pd.scene(BODY, families, model, pd.prescribe(LOW, 0.0), pd.prescribe(HIGH, [0.0, by]))


@pytest.fixture(scope="module", params=list(MODELS))
def paths(request):
    """The notched plate, and its paths of 10, 20 and 40 load steps."""
    scene = pulled(MODELS[request.param])
    return scene, [pd.solve_breaking(scene, STRETCH, load_steps=n, **QUIET) for n in (10, 20, 40)]


def test_the_crack_severs_the_body(paths):
    _, found = paths
    for path in found:
        assert path.ending.name == "SEVERED" and "at load factor 0." in path.reason
        assert path.energies.strain[-1] < 1e-12 * path.energies.strain.max()  # measured 4e-17
        assert np.abs(path.reactions[-1]).max() < 1e-8 * np.abs(path.reactions).max()  # measured 7e-11
        lost = (path.damage() > 0).reshape(SIDE, SIDE)
        assert lost[6:, 4:8].all() and not lost[:, :4].any() and not lost[:, 8:].any()


def test_the_energy_budget_closes_with_the_load_step(paths):
    _, found = paths
    errors = [float(np.abs(path.energies.error).max()) for path in found]
    # Measured: bond-based 3e-5, 8e-6, 2e-6; LPS 2e-5, 6e-6, 2e-6 (trapezoidal rule on a nonlinear load curve).
    assert errors[0] < 1e-4 and errors[1] < errors[0] / 3 and errors[2] < errors[1] / 3
    for path in found:
        assert (np.diff(path.energies.released) >= 0).all() and path.energies.released[-1] > 0
        assert (np.diff(path.energies.dissipated) >= -1e-14).all() and path.energies.dissipated[-1] > 0


def test_states_are_equilibria_of_the_bonds_that_are_left(paths):
    """The force density and the strain energy of the families with broken bonds, by the functions of their own."""
    scene, found = paths
    path = found[1]
    last = np.flatnonzero(path.settled & (path.broken_at[..., None] <= path.load_factors).any((0, 1)))[0].item()
    broken = path.broken_at <= path.load_factors[last]
    families = scene.families.with_broken(broken)
    f = np.asarray(pd.force_density(scene.model, families, path.u[last]))
    assert np.abs(f[scene.free]).max() < 1e-9 * np.abs(f).max()  # measured 1e-12
    held = ~scene.free
    assert np.abs(path.reactions[last] + np.where(held, f, 0)).max() < 1e-13 * np.abs(f).max()  # volumes are 1
    energy = float(pd.strain_energy(scene.model, families, path.u[last]))
    assert path.energies.strain[last] == pytest.approx(energy, rel=1e-13)
    assert not STRETCH.broken(scene.model, families, path.u[last]).any()
    assert path.damage(last).max() > 0 == path.damage(last - 1).max()


def test_the_solution_is_that_of_solve():
    scene = pulled(MODELS["LPS"])
    path = pd.solve_breaking(scene, STRETCH, load_steps=[0.3, 0.45], **QUIET)
    alone = pd.solve(pulled(MODELS["LPS"], by=0.3 * 0.45), stability=False, **QUIET)
    assert path.ending.name == "FINISHED" and path.broken_bonds == 0
    assert np.abs(path.u[-1] - alone.u).max() < 1e-9 * np.abs(alone.u).max()  # measured 1e-13


def test_both_ends_of_a_bond_break_together(paths):
    scene, found = paths
    for path in found:
        back = np.asarray(scene.families.neighbours), np.asarray(scene.families.reverse)
        true = np.asarray(scene.families.is_bond)
        assert np.array_equal(path.broken_at[true], path.broken_at[back][true])
        assert np.array_equal(path.alive, (np.asarray(scene.families.weight) > 0) & np.isinf(path.broken_at))
        assert np.array_equal(np.asarray(path.families.weight) > 0, path.alive)


def test_springs_in_series_break_at_their_stretch_and_release_their_energy():
    """Two springs of length and volume 1: each has the energy ½ s² and breaks at s = 0.05, at half the load."""
    body = pd.bar(3, 3.0)
    scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), pd.prescribe([0, 2], [[0.0], [0.2]]))
    path = pd.solve_breaking(scene, pd.CriticalStretch(0.05 * (1 - 1e-9)), load_steps=4, bonds_per_step=1, **QUIET)
    assert path.load_factors.tolist() == [0, 0.25, 0.5, 0.5] and path.settled.tolist() == [True, True, False, True]
    assert path.energies.released[-1] == pytest.approx(0.5 * 0.05**2, rel=1e-12)
    assert path.energies.dissipated[-1] == pytest.approx(0.5 * 0.05**2, rel=1e-12)  # the other spring relaxes
    assert path.energies.supports[-1] == pytest.approx(0.05**2, rel=1e-12)
    assert path.reactions[2, :, 0] == pytest.approx([-0.05, 0, 0.05], rel=1e-12)
    both = pd.solve_breaking(scene, pd.CriticalStretch(0.05 * (1 - 1e-9)), load_steps=4, **QUIET)
    assert both.energies.released[-1] == pytest.approx(0.05**2, rel=1e-12)
    assert abs(both.energies.dissipated[-1]) < 1e-15 and both.separated.tolist() == [False, True, False]


def test_the_most_overloaded_bonds_break_first():
    model, families = MODELS["LPS"], NOTCHED
    u = 0.05 * X * [0, 1] + 1e-3 * np.random.default_rng(0).normal(size=X.shape)
    hit = np.asarray(STRETCH.broken(model, families, u))
    overload = np.asarray(STRETCH.overload(model, families, families.bonds(u)))
    dying = most_overloaded(hit, overload, families, 5)
    assert hit.sum() > 30 and dying.sum() == 10
    assert overload[dying].min() >= overload[hit & ~dying].max()
    families.with_broken(dying)  # raises if the two ends of a bond disagree
    assert np.array_equal(most_overloaded(hit, None, families, 5), hit)


@pytest.mark.parametrize(
    "criterion", [pd.CriticalStretch(0.03), pd.CriticalBondEnergy(2e-4)], ids=["stretch", "energy"]
)
def test_overload_is_above_one_where_a_bond_exceeds_the_criterion(criterion):
    u = 0.05 * X * [0, 1]
    for model in MODELS.values():
        bonds = FAMILIES.bonds(u)
        exceeded = np.asarray(criterion.exceeded(model, FAMILIES, bonds))[np.asarray(FAMILIES.is_bond)]
        longer = (np.asarray(bonds.eta) * np.asarray(bonds.xi)).sum(-1)[np.asarray(FAMILIES.is_bond)] > 0
        overload = np.asarray(criterion.overload(model, FAMILIES, bonds))[np.asarray(FAMILIES.is_bond)]
        assert np.array_equal(exceeded, (overload > 1) & longer) and exceeded.any() and not exceeded.all()


def test_one_bond_at_a_time_ends_the_same_way(paths):
    """All bonds across the plane break either way. The first load factor is the same, and less is released at once."""
    scene, found = paths
    one = pd.solve_breaking(scene, STRETCH, load_steps=10, bonds_per_step=1, **QUIET)
    assert one.ending.name == "SEVERED" and one.broken_bonds == found[0].broken_bonds
    assert one.broken_at.min() == found[0].broken_at.min()
    assert float(np.abs(one.energies.error).max()) < 1e-4  # measured 5e-5, 3e-5


@pytest.mark.parametrize("name", list(MODELS))
def test_a_piece_that_breaks_off_stays_finite(name):
    """All bonds of a ring of weak points break: 32 points without bonds, and a piece of 4 points that nothing holds."""
    middle = np.abs(X - 6).max(axis=1)
    weak = np.where((middle > 1) & (middle < 3), 0.005, 1.0)
    rim = np.any((X < 2) | (X > 10), axis=1)
    scene = pd.scene(BODY, FAMILIES, MODELS[name], pd.prescribe(rim, 0.01 * (X[rim] - 6)))
    path = pd.solve_breaking(scene, pd.CriticalStretch(weak), load_steps=5, **QUIET)
    assert path.ending.name == "FINISHED" and np.isfinite(path.u).all()
    assert np.array_equal(path.separated, middle < 3)
    assert (path.damage()[(middle > 1) & (middle < 3)] == 1).all()
    energy = np.asarray(scene.model.energy and pd.energy_density(scene.model, path.families, path.u[-1]))
    assert np.abs(energy[middle < 3]).max() < 1e-12 * energy.max()  # the pieces have relaxed; measured 2e-20
    assert np.abs(path.u[:, middle < 3]).max() < 0.05  # they stay where they were
    assert float(np.abs(path.energies.error).max()) < 1e-4  # measured 2e-6


def test_a_force_that_the_body_cannot_carry_is_an_ending():
    model = MODELS["LPS"]
    held = pd.prescribe(LOW, 0.0), pd.prescribe(HIGH, 0.0, components=0)
    scene = pd.scene(BODY, NOTCHED, model, *held, pd.body_force(HIGH, [0.0, 0.05]))
    path = pd.solve_breaking(scene, STRETCH, load_steps=20, **QUIET)
    assert path.ending.name == "LOAD_LOST" and "72 points" in path.reason
    assert 0 < path.load_factors[-1] < 1 and not path.settled[-1]
    with pytest.raises(RuntimeError, match="a loaded piece broke off"):
        pd.solve_breaking(scene, STRETCH, load_steps=20, throw=True, **QUIET)


def test_a_first_load_step_that_severs_the_body_is_too_large():
    path = pd.solve_breaking(pulled(MODELS["LPS"]), STRETCH, load_steps=1, **QUIET)
    onset = float(path.detail.partition("near load factor ")[2].partition(":")[0])
    fine = pd.solve_breaking(pulled(MODELS["LPS"]), STRETCH, load_steps=np.linspace(0.9, 1.1, 21) * onset, **QUIET)
    assert "This is the first load step" in path.reason
    assert abs(float(fine.broken_at.min()) - onset) < 0.02 * onset  # measured 0.01: a step is 0.01


def test_a_resumed_path_is_the_same_bit_for_bit(tmp_path):
    scene, file = pulled(MODELS["LPS"]), tmp_path / "path.npz"
    settings = {"bonds_per_step": 4, **QUIET}
    criterion = interface(0.045)
    whole = pd.solve_breaking(scene, criterion, load_steps=10, **settings)
    part = pd.solve_breaking(scene, criterion, load_steps=np.arange(1, 10) / 10, checkpoint=file, **settings)
    again = pd.solve_breaking(scene, criterion, load_steps=10, checkpoint=file, resume=True, **settings)
    assert 0 < part.broken_bonds < whole.broken_bonds
    for name in ("load_factors", "settled", "u", "reactions", "alive", "broken_at"):
        assert np.array_equal(getattr(whole, name), getattr(again, name)), name
    assert all(np.array_equal(a, b) for a, b in zip(whole.energies, again.energies, strict=True))
    other = {"checkpoint": file, "resume": True, **settings}
    for changed in (
        lambda: pd.solve_breaking(scene, STRETCH, load_steps=10, **other),
        lambda: pd.solve_breaking(pulled(MODELS["bond-based"]), criterion, load_steps=10, **other),
        lambda: pd.solve_breaking(scene, criterion, load_steps=10, **(other | {"bonds_per_step": 5})),
        lambda: pd.solve_breaking(scene, criterion, load_steps=7, **other),
    ):
        with pytest.raises(ValueError, match="belongs to another run: its scene, model, criterion"):
            changed()
    with pytest.raises(FileNotFoundError, match="no checkpoint"):
        pd.solve_breaking(scene, criterion, checkpoint=tmp_path / "none.npz", resume=True, **QUIET)


def test_breaking_compiles_a_few_programs_once():
    """A break compiles nothing. A further run with other constants, cracks and loads compiles nothing either."""
    seen = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, seconds, **_: seen.append(name) if name.endswith("backend_compile_duration") else None
    )
    body = pd.lattice((11, 12))  # a shape of its own, so that no other test has compiled its programs
    y = body.positions[:, 1]
    families = pd.families(body, 2.1)

    def run(bulk, stretch, x):
        notched = pd.cut(families, pd.Segment((0.0, 6.0), (x, 6.0)))
        held = pd.prescribe(y < 2, 0.0), pd.prescribe(y > 10, [0.0, 0.3])
        scene = pd.scene(body, notched, pd.LPS(bulk, 0.6), *held)
        return pd.solve_breaking(scene, pd.CriticalStretch(stretch), load_steps=10, **QUIET)

    first = run(1.0, 0.03, 5.0)
    assert first.broken_bonds > 10 and len(seen) <= 6, seen  # measured 6
    seen.clear()
    assert run(1.2, 0.025, 4.0).broken_bonds > 10
    assert seen == []


@pytest.mark.parametrize("model", [pd.Correspondence, lambda law: pd.SethHill(1.0, law)], ids=["Silling", "Seth-Hill"])
def test_correspondence_models_break_without_nan(model):
    """Points whose bonds no longer determine their deformation lose them all."""
    scene = pulled(model(pd.LinearElastic(1.0, 1.0)))
    path = pd.solve_breaking(scene, pd.CriticalStretch(0.04, no_fail=LOW | HIGH), load_steps=10, **QUIET)
    assert path.broken_bonds > 20 and np.isfinite(path.u).all() and np.isfinite(np.array(path.energies)).all()
    assert float(np.abs(path.energies.error).max()) < 1e-3  # measured 2e-4, 2e-4
    pd.force_density(scene.model, path.families, path.u[-1])  # raises for a singular shape tensor


def test_load_paths_of_a_cut_body():
    whole = load_paths(pulled(MODELS["LPS"], FAMILIES), 0 * X)
    assert not whole.severed and whole.lost is None and not whole.separated.any()
    parts = load_paths(pulled(MODELS["LPS"], pd.cut(FAMILIES, pd.Plane((0.0, 6.0), (0.0, 1.0)))), 0 * X)
    assert parts.severed and parts.lost is None and not parts.separated.any()


def test_what_is_wrong_is_refused():
    scene = pulled(MODELS["LPS"])
    cases = {
        "breaking must be": (scene, 0.01, {}),
        "load_steps must be load factors > 0 that increase": (scene, STRETCH, {"load_steps": [0.5, 0.4]}),
        "load_steps must be a whole number": (scene, STRETCH, {"load_steps": 0}),
        "bonds_per_step must be a whole number >= 1; got 0": (scene, STRETCH, {"bonds_per_step": 0}),
        "tolerance must lie between 0 and 1": (scene, STRETCH, {"tolerance": 0.0}),
        "resume needs checkpoint": (scene, STRETCH, {"resume": True}),
        "leave out the smoothing": (scene, pd.CriticalStretch(0.03, smoothing=0.001), {}),
        "nothing strains this body": (pulled(MODELS["LPS"], by=0.0), STRETCH, {}),
        "one entry for each of the 144 points": (scene, pd.CriticalStretch(0.03, no_fail=np.zeros(3, bool)), {}),
        "scene must be": (BODY, STRETCH, {}),
    }
    for message, (where, criterion, more) in cases.items():
        with pytest.raises(ValueError, match=message):
            pd.solve_breaking(where, criterion, **more, **QUIET)
    law = pd.LinearElastic(1.0, 1.0)
    with pytest.raises(ValueError, match="CriticalBondEnergy cannot serve ReproducingKernel"):
        pd.solve_breaking(pulled(pd.ReproducingKernel(law)), pd.CriticalBondEnergy(1.0), **QUIET)
    with pytest.raises(ValueError, match="has no energy"):
        pd.solve_breaking(pulled(pd.Correspondence(law, pd.LittlewoodControl(1.0))), STRETCH, **QUIET)
    severed = pulled(MODELS["LPS"], pd.cut(FAMILIES, pd.Plane((0.0, 6.0), (0.0, 1.0))))
    with pytest.raises(ValueError, match="check that a cut does not sever the body"):
        pd.solve_breaking(severed, STRETCH, **QUIET)


def test_a_checkpoint_that_exists_is_kept(tmp_path):
    body = pd.bar(3, 3.0)
    bar = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), pd.prescribe([0, 2], [[0.0], [0.2]]))
    file, criterion = tmp_path / "path.npz", pd.CriticalStretch(0.5)
    pd.solve_breaking(bar, criterion, load_steps=3, checkpoint=file, show_progress=False)
    before = file.read_bytes()
    with pytest.warns(UserWarning, match=r"is kept as .*path\.npz\.old; to continue from it, pass resume=True"):
        pd.solve_breaking(bar, criterion, load_steps=2, checkpoint=file, show_progress=False)
    assert (tmp_path / "path.npz.old").read_bytes() == before
