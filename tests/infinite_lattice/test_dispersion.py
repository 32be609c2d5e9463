"""Tests of the dispersion relation, and of waves and unstable lattices in time against the symbol."""

import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst

import pdjax as pd

BAR = pd.LinearElastic(lam=1.0, mu=0.0)
LAW = pd.LinearElastic(lam=1.0, mu=1.0)

# --- waves --------------------------------------------------------------------------------------------------------

WAVES = [
    (60, 2 * np.pi * 7 / 60, 1, pd.SethHill(0.3, BAR)),
    ((10, 8), (2 * np.pi * 3 / 10, 2 * np.pi * 2 / 8), 2, pd.SethHill(1.0, LAW)),
    pytest.param((9, 8), (2 * np.pi * 2 / 9, 2 * np.pi / 8), 2, pd.Correspondence(LAW), marks=pytest.mark.long),
]


@pytest.mark.parametrize(("n", "k", "dim", "model"), WAVES)
def test_frequency_of_a_small_wave_is_the_symbols(n, k, dim, model):
    motion = pd.scenes.wave(n, 3, k, 1e-6, model, dim)
    J = pd.symbol(model, pd.lattice_family(dim, 3), np.eye(dim), np.atleast_1d(k))
    omega = float(jnp.sqrt(-jnp.linalg.eigvalsh(J)[0]))
    dt = 0.004 / omega
    every = round(2 * np.pi / 8 / 0.004)
    history = pd.simulate(motion, 2 * np.pi / omega, dt=dt, save_every=every, fields=True, show_progress=False)
    found = pd.measured_rate(history.times, pd.amplitude(history.u, motion.start))
    assert found.growth == 0
    assert abs(found.frequency / omega - 1) < 7e-7  # Verlet's own (ω dt)²/24 = 6.7e-7
    own = pd.verlet_rate(pd.Rate(0.0, omega), history.dt)
    assert abs(found.frequency / own.frequency - 1) < 1e-10  # measured 3e-14 to 2e-12


def test_a_travelling_wave_keeps_its_shape():
    k = 2 * np.pi * 3 / 40
    motion = pd.scenes.wave(40, 3, k, 1e-7, pd.SethHill(1.0, BAR), travelling=True, periods=1.0)
    history = pd.simulate(motion, dt=0.01, save_every=1, show_progress=False)
    omega = float(pd.dispersion(motion.scene.model, pd.lattice_family(1, 3), np.eye(1), [k]).frequency[0, 0])
    x = motion.scene.body.positions - motion.scene.body.positions[0]
    t = history.times[300]
    assert (
        worst(history.u[300], 1e-7 * np.cos(k * x - omega * t)) < 1e-5 * 1e-7
    )  # measured 2e-13; the other direction would give 2e-7


@pytest.mark.parametrize(
    ("n", "dim", "k", "model"),
    [
        (16, 1, np.pi, pd.SethHill(1.0, BAR)),
        (16, 1, np.pi, pd.Correspondence(BAR)),
        (8, 2, (np.pi, np.pi), pd.SethHill(0.0, LAW)),
        (8, 2, (np.pi, 0.0), pd.Correspondence(LAW)),
    ],
)
def test_a_zero_energy_mode_stands_still(n, dim, k, model):
    """It has no energy and no force to first order, so that a standing wave keeps its initial displacement."""
    motion = pd.scenes.wave(n, 3, k, 1e-8, model, dim, branch=0)
    assert bool(pd.dispersion(model, pd.lattice_family(dim, 3), np.eye(dim), np.atleast_1d(k)[None]).zero_energy[0, 0])
    history = pd.simulate(motion, 50.0, dt=0.2, show_progress=False)
    assert history.finished
    assert worst(history.u - motion.start) < 1e-4 * 1e-8  # measured below 2e-5 (second order in u0) and 0
    ordinary = pd.scenes.wave(n, 3, None, 1e-8, model, dim)
    assert worst(pd.simulate(ordinary, 50.0, dt=0.2, show_progress=False).u - ordinary.start) > 1e-8


# --- unstable lattices --------------------------------------------------------------------------------------------

GROWING = [
    (1, 24, 1.0, -0.01),
    (1, 24, 0.0, 0.01),
    (2, 12, 1.0, -0.01),
    (2, 12, 0.0, -0.01),
    pytest.param(2, 12, 0.0, 0.01, marks=pytest.mark.long),
    pytest.param(3, 8, 1.0, -0.01, marks=pytest.mark.long),
    (3, 8, 0.0, -0.01),
]
QUIET = [
    (1, 24, 1.0, 0.01),
    (1, 24, 0.0, -0.01),
    (2, 12, 1.0, 0.01),
    pytest.param(3, 8, 1.0, 0.01, marks=pytest.mark.long),
    (3, 8, 0.0, 0.01),
]


def perturbed(dim, n, m, a):
    """A periodic lattice under F = (1 + a) I with noise of 1e-12, the dispersion of its plane waves, and F."""
    model = pd.SethHill(m, BAR if dim == 1 else LAW)
    F = (1 + a) * np.eye(dim)
    noise = 1e-12 * np.random.default_rng(dim).normal(size=(n**dim, dim))
    body = pd.lattice((n,) * dim, 1.0, periodic=True)
    fixed = pd.scene(body, pd.families(body, 3.0), model, mean=F, moving=True)
    axes = np.meshgrid(*[2 * np.pi * np.arange(n) / n] * dim, indexing="ij")
    waves = np.stack(axes, -1).reshape(-1, dim)
    return pd.motion(fixed, start=noise), pd.dispersion(model, pd.lattice_family(dim, 3), F, waves), F


@pytest.mark.parametrize(("dim", "n", "m", "a"), GROWING)
def test_an_unstable_lattice_grows_at_the_rate_of_the_symbol(dim, n, m, a):
    motion, waves, F = perturbed(dim, n, m, a)
    top = int(jnp.argmax(waves.growth[:, 0]))
    rate = float(waves.growth[top, 0])
    verdict = pd.stability(motion.scene.model, pd.lattice_family(dim, 3), F)
    assert verdict.verdict == "unstable"
    assert rate <= float(verdict.eigenvalue) ** 0.5 * (1 + 1e-12)
    assert rate > 0.995 * float(verdict.eigenvalue) ** 0.5  # The worst wave of the box grows at most 0.17 % slower.
    x = motion.scene.body.positions
    mode = np.cos((x - x[0]) @ np.asarray(waves.k[top]))[:, None] * np.asarray(waves.mode[top, :, 0])
    dt = 0.4 * pd.critical_time_step(motion)
    grown = 14.0 / rate  # e¹⁴ = 1.2e6
    history = pd.simulate(motion, grown, dt=dt, save_every=4, show_progress=False)
    late = history.times > 4.0 / rate
    found = pd.measured_rate(history.times[late], pd.amplitude(history.u, mode)[late])
    own = pd.verlet_rate(pd.Rate(rate, 0.0), history.dt)
    assert abs(found.growth / rate - 1) < 1e-2  # measured 7e-4 to 2.5e-3
    assert abs(found.growth / own.growth - 1) < 1e-7  # measured 1e-11 to 5e-9
    assert worst(history.u[-1]) > 1e-8


@pytest.mark.parametrize(("dim", "n", "m", "a"), QUIET)
def test_a_stable_lattice_does_not_grow(dim, n, m, a):
    motion, _, F = perturbed(dim, n, m, a)
    assert pd.stability(motion.scene.model, pd.lattice_family(dim, 3), F).verdict == "stable"
    dt = 0.4 * pd.critical_time_step(motion)
    history = pd.simulate(motion, 120.0, dt=dt, save_every=4, show_progress=False)
    drift = history.u - history.u.mean(axis=1, keepdims=True)
    assert worst(drift) < 10 * worst(motion.start)  # measured at most 2


# --- dispersion ---------------------------------------------------------------------------------------------------

STATES = [
    (1, pd.SethHill(0.4, BAR), np.array([[1.05]])),
    (2, pd.SethHill(0.4, LAW), np.array([[1.1, 0.03], [0.0, 1.02]])),
    (3, pd.Correspondence(LAW), np.diag([1.1, 1.0, 0.95])),
]


@pytest.mark.parametrize(("dim", "model", "F"), STATES)
def test_dispersion_is_the_symbols_spectrum(dim, model, F):
    fam = pd.lattice_family(dim, 2, spacing=0.5)
    k = np.random.default_rng(dim).uniform(-3, 3, (7, dim))
    found = pd.dispersion(model, fam, F, k, density=2.0)
    J = np.asarray(pd.symbol(model, fam, F, k))
    values = np.linalg.eigvalsh(J)[:, ::-1]
    assert worst(found.eigenvalue, values) < 1e-13 * np.abs(values).max()
    assert worst(found.frequency**2 - found.growth**2, -values / 2) < 1e-12
    assert worst(np.minimum(found.frequency, found.growth)) == 0
    left = np.einsum("wij,wjb->wib", J, found.mode)
    assert worst(left, found.mode * found.eigenvalue[:, None, :]) < 1e-12 * np.abs(values).max()
    e = 1e-5
    for axis in range(dim):
        step = e * np.eye(dim)[axis]
        ahead, behind = (pd.dispersion(model, fam, F, k + s, density=2.0).frequency for s in (step, -step))
        moving = np.asarray(found.frequency) > 1e-3
        wanted = (ahead - behind) / (2 * e)
        assert moving.any()
        assert (
            worst(np.asarray(found.group_velocity[..., axis])[moving], np.asarray(wanted)[moving]) < 1e-8
        )  # measured 5e-11


@pytest.mark.parametrize(("dim", "model", "F"), STATES)
def test_long_waves_run_on_the_classical_line(dim, model, F):
    """As k → 0 every correspondence model at rest has the wave speeds of the law, and so has a deformed model that is
    exact for affine maps."""
    fam = pd.lattice_family(dim, 2)
    direction = np.arange(1.0, dim + 1)[None]
    at = np.eye(dim) if isinstance(model, pd.SethHill) else F
    slow, fast = (pd.dispersion(model, fam, at, e * direction).frequency for e in (1e-2, 1e-3))
    line = pd.classical_frequency(model, at, direction)
    errors = worst(slow / 1e-2, line), worst(fast / 1e-3, line)
    assert errors[1] < 1e-4 and errors[0] / errors[1] == pytest.approx(100, rel=0.02)  # dispersion is of order k²


def test_zero_energy_waves_are_marked():
    fam = pd.lattice_family(2, 3)
    k = np.array([[0.0, 0.0], [np.pi, 0.0], [np.pi, np.pi], [1.0, 0.3], [2 * np.pi, 0.0]])
    found = pd.dispersion(pd.Correspondence(LAW), fam, np.eye(2), k)
    assert found.zero_energy.tolist() == [[False] * 2, [True] * 2, [True] * 2, [False] * 2, [False] * 2]
    assert np.isnan(found.group_velocity[1]).all() and np.isfinite(found.group_velocity[3]).all()
    strained = pd.dispersion(pd.SethHill(1.0, LAW), fam, 0.99 * np.eye(2), k[1:2])
    assert not strained.zero_energy.any() and (strained.growth > 0).all()


def test_group_velocity_is_the_speed_of_a_wave_packet():
    """On a long bar the centre of the energy of a packet moves at ∂ω/∂k, here a quarter below the classical speed."""
    n, k = 240, 2 * np.pi * 18 / 240
    model = pd.SethHill(1.0, BAR)
    fam = pd.lattice_family(1, 3)
    x = np.arange(n) - 80.0
    wave = pd.scenes.wave(n, 3, k, 1.0, model)
    envelope = 1e-7 * np.exp(-((x / 25) ** 2))[:, None]
    omega = float(pd.dispersion(model, fam, np.eye(1), [k]).frequency[0, 0])
    velocity = omega * envelope * np.sin(k * x)[:, None]
    packet = pd.motion(wave.scene, start=envelope * np.cos(k * x)[:, None], velocity=velocity)
    history = pd.simulate(packet, 60.0, dt=0.1, save_every=100, show_progress=False)
    density = np.asarray(history.v[..., 0]) ** 2
    centre = density @ np.arange(n) / density.sum(axis=1)
    speed = np.polyfit(history.times, centre, 1)[0]
    wanted = float(pd.dispersion(model, fam, np.eye(1), [k]).group_velocity[0, 0, 0])
    assert abs(wanted) < 0.9
    assert speed == pytest.approx(wanted, rel=0.03)  # measured 1.8 %, because the packet has a range of k


# --- the paper's relation (S10) -----------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [-1.0, 0.0, 1.0, 2.0])
def test_the_papers_dispersion_tends_to_the_symbol(m):
    k = np.linspace(0.1, 3.0, 9)
    exact = pd.dispersion(pd.SethHill(m, BAR), pd.lattice_family(1, 3), np.eye(1), k).frequency[:, 0]
    errors = [
        worst(np.asarray(pd.closed_forms.dispersion_1d(k, u0, m, 3)), np.asarray(exact) ** 2) for u0 in (1e-5, 1e-6)
    ]
    assert errors[0] < 1e-3 and errors[0] / errors[1] == pytest.approx(10, rel=0.01)  # first order in u0


@pytest.mark.parametrize("m", [0.0, 1.0])
def test_the_papers_complex_wave_is_no_motion(m):
    """At finite u0 its ω² depends on the position, and changes to its conjugate with the sign of u0. The frequency of a
    wave cannot do that."""
    k, u0 = 1.0, 0.1
    here, there = (complex(pd.closed_forms.dispersion_1d(k, u0, m, 3, X=X)) for X in (0.0, 1.0))
    assert abs(here - there) > 0.05 * abs(here)
    flipped = complex(pd.closed_forms.dispersion_1d(k, -u0, m, 3))
    assert flipped == pytest.approx(here.conjugate(), rel=1e-12) and abs(here.imag) > 0.01 * abs(here)
    shifted = complex(pd.closed_forms.dispersion_1d(k, u0, m, 3, X=np.pi / k))
    assert shifted == pytest.approx(flipped, rel=1e-12)  # −u0 shifts the wave by half a length.


def test_a_real_waves_frequency_moves_with_the_square_of_u0():
    """The frequency shift of a standing wave of the nonlinear bar is even in u0. The relation of the paper shifts at
    first order."""
    k = 2 * np.pi * 4 / 40
    shifts = []
    for u0 in (0.05, 0.1):
        motion = pd.scenes.wave(40, 3, k, u0, pd.SethHill(1.0, BAR))
        omega = float(pd.dispersion(motion.scene.model, pd.lattice_family(1, 3), np.eye(1), [k]).frequency[0, 0])
        dt = 0.002 * 2 * np.pi / omega
        history = pd.simulate(motion, 1.2 * 2 * np.pi / omega, dt=dt, save_every=1, show_progress=False)
        a = np.asarray(pd.amplitude(history.v, motion.start))
        turn = np.flatnonzero((a[1:-1] < 0) & (a[2:] >= 0))[0] + 1  # v crosses zero upwards after half a period.
        half = history.times[turn] + dt * a[turn] / (a[turn] - a[turn + 1])
        shifts.append(np.pi / half / omega - 1)
    assert np.abs(shifts[1]) > 1e-4
    assert shifts[1] / shifts[0] == pytest.approx(4, rel=0.15)  # measured
