"""Public functions × transformations: jit = eager, jvp = central difference, vjp = its transpose, vmap = loop.

Each row is a function of one tree of arrays that holds all inputs: the constants of the model, the bonds, volumes,
influence and weights of the families, F, u and k. All real numbers of the tree are perturbed at once, in a random
direction.
"""

import functools
from functools import partial

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from table import LINEAR, MODELS, EnergyOnly

import pdjax as pd
from pdjax.models.laws import law_stress

SETH_HILL, NEO_HOOKEAN = MODELS["seth_hill m=-0.7"], MODELS["correspondence neo-hookean"]
BODY, FAM = bodies.families(2, "cloud"), pd.lattice_family(2, 2, 0.5, pd.gaussian_influence)
U, V = bodies.displacement(2, "cloud", 1), bodies.random(1).normal(size=(15, 2))
F, K = bodies.deformation(2, 1, size=0.2), bodies.random(1).uniform(-3, 3, (5, 2))


def lattice(x):
    spacing, width = x
    return pd.lattice_family(2, 2, spacing, partial(pd.gaussian_influence, width=width))


def body(width):
    return pd.families(bodies.points(2, "cloud"), 2.3, partial(pd.gaussian_influence, width=width))


def both(*functions):
    """Several functions of the same tree as one function, so that they are compiled together."""
    return lambda x: tuple(function(*x) for function in functions)


# function of one tree, that tree
TABLE = {
    "force_density": (lambda x: pd.force_density(*x), (SETH_HILL, BODY, U, F)),
    "force_density, energy only": (lambda x: pd.force_density(*x), (EnergyOnly(NEO_HOOKEAN), BODY, U)),
    "strain_energy, strain, stress": (both(pd.strain_energy, pd.strain, pd.stress), (NEO_HOOKEAN, BODY, U)),
    "jvp": (lambda x: pd.jvp(*x), (NEO_HOOKEAN, BODY, U, V)),
    "jacobian, dense": (lambda x: pd.jacobian(*x, form="dense"), (NEO_HOOKEAN, BODY, U)),
    "force_state, piola_stress": (both(pd.force_state, pd.piola_stress), (SETH_HILL, FAM, F)),
    "center_block, p_wave_modulus": (
        lambda x: (pd.center_block(*x), pd.p_wave_modulus(*x[:2])),
        (NEO_HOOKEAN, FAM, F),
    ),
    "symbol": (lambda x: pd.symbol(*x), (NEO_HOOKEAN, FAM, F, K)),
    "uniaxial_stress": (lambda x: pd.uniaxial_stress(*x), (np.asarray(0.1), NEO_HOOKEAN, FAM)),
    "law_stress": (lambda x: law_stress(*x), (NEO_HOOKEAN.law, F)),
    "lattice_family": (lattice, (np.asarray(0.5), np.asarray(0.6))),
    "families": (body, np.asarray(0.6)),
}


def real_part(name, dtype=np.float64):
    """(f as a function of the list of the real arrays of a tree, this list as NumPy arrays of a dtype)."""
    function, tree = TABLE[name]
    real, rest = eqx.partition(tree, lambda leaf: np.asarray(leaf).dtype.kind == "f")
    leaves, shape = jax.tree.flatten(real)

    def of(leaves):
        out = function(eqx.combine(jax.tree.unflatten(shape, leaves), rest))
        return [leaf for leaf in jax.tree.leaves(out) if leaf.dtype.kind == "f"]

    return of, [np.asarray(leaf, dtype=dtype) for leaf in leaves]


def moved(leaves, direction, step):
    return [leaf + step * move for leaf, move in zip(leaves, direction, strict=True)]


def gap(a, b):
    """The largest difference of two lists of arrays, each divided by the largest entry of the second array."""
    scales = [np.max(np.abs(leaf)) or 1.0 for leaf in b]
    return max(worst(x / scale, y / scale) for x, y, scale in zip(a, b, scales, strict=True))


def dot(a, b):
    return sum(np.sum(np.asarray(x) * np.asarray(y)) for x, y in zip(a, b, strict=True))


@functools.cache
def transformed(name):
    """The real arrays of f, a direction, a cotangent, and one compiled function that returns f, its JVP and its VJP."""
    function, at = real_part(name)
    rng = bodies.random(2)
    direction = [rng.normal(size=leaf.shape) * np.max(np.abs(leaf)) for leaf in at]
    cotangent = [rng.normal(size=leaf.shape) for leaf in jax.eval_shape(function, at)]

    @jax.jit
    def everything(leaves):
        value, along = jax.jvp(function, (leaves,), (direction,))
        return value, along, jax.vjp(function, leaves)[1]([jnp.asarray(c) for c in cotangent])[0]

    return at, direction, cotangent, everything


@pytest.mark.parametrize("name", TABLE)
def test_jit_jvp_vjp_and_vmap_of_a_public_function_agree(name):
    function, _ = real_part(name)
    at, direction, cotangent, everything = transformed(name)
    value, along, pulled = everything(at)
    assert all(np.isfinite(leaf).all() for leaf in (*value, *along, *pulled))

    eager = function([jnp.asarray(leaf) for leaf in at])
    assert gap(value, eager) < 1e-12  # jit = eager; 5e-16

    step = 1e-6  # jvp = central difference
    up, down = (everything(moved(at, direction, h))[0] for h in (step, -step))
    assert max(worst(leaf) for leaf in along) > 1e-3
    assert gap([(a - b) / (2 * step) for a, b in zip(up, down, strict=True)], along) < 1e-6  # 1e-9

    forward, backward = dot(cotangent, along), dot(pulled, direction)  # vjp = transpose of jvp
    assert worst(backward / forward, 1.0) < 1e-11  # 7e-15

    batch = [moved(at, direction, h) for h in (0.0, 0.01, -0.02)]  # vmap = loop
    stacked = jax.jit(jax.vmap(function))([np.stack(leaves) for leaves in zip(*batch, strict=True)])
    for n, leaves in enumerate(batch):
        assert gap([leaf[n] for leaf in stacked], everything(leaves)[0]) < 1e-12  # 2e-16
    assert everything._cache_size() == 1  # new values do not compile anything


BOTH_MODES = ("force_density", "law_stress", "symbol")


@pytest.mark.parametrize("name, x64", [(n, False) for n in TABLE] + [(n, True) for n in BOTH_MODES])
def test_float32_inputs_give_float32_answers(name, x64):
    """The answers agree with double precision to 1e-5. The dtype of the inputs decides in both modes of JAX."""
    at, _, _, everything = transformed(name)
    exact = [np.asarray(leaf) for leaf in everything(at)[0]]
    with jax.enable_x64(x64):
        function, at = real_part(name, np.float32)
        found = jax.jit(function)(at)
        assert all(leaf.dtype == jnp.float32 for leaf in found)
        found = [np.asarray(leaf, dtype=float) for leaf in found]
    assert gap(found, exact) < 1e-5  # 1e-6


def compiled(call):
    """The number of programs that XLA compiles during a call."""
    events = []

    def listen(event, duration, **_):
        events.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        call()
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)
    return sum("backend_compile" in event for event in events)


EAGER = [name for name in TABLE if name not in ("uniaxial_stress", "law_stress", "lattice_family", "families")]


@pytest.mark.parametrize("name", EAGER)
def test_eager_calls_compile_nothing_for_new_values(name):
    function, at = real_part(name)
    old, new = ([jnp.asarray(factor * leaf) for leaf in at] for factor in (1.0, 1.001))
    function(old)
    assert compiled(lambda: function(new)) == 0


def test_models_of_one_class_share_a_compile():
    """m and the constants of the law are traced, also if they are given as NumPy numbers."""
    force = jax.jit(lambda model: pd.force_state(model, FAM, jnp.asarray(F)))
    for m, lam in ((1.0, 1.3), (0.0, -0.2), (np.float64(0.7), 2.0)):
        force(pd.SethHill(m, pd.LinearElastic(lam, 0.7)))
    assert force._cache_size() <= 2  # NumPy numbers are not weakly typed: one more program


@jax.jit
def jet(m):
    """f, ∂f/∂m, ∂²f/∂m²."""

    def force(m):
        return pd.force_density(pd.SethHill(m, LINEAR), BODY, U)

    def slope(m):
        return jax.jvp(force, (m,), (1.0,))[1]

    return force(m), *jax.jvp(slope, (m,), (1.0,))


@pytest.mark.parametrize("m", [0.0, 1e-9, -0.7, 1.0])
def test_force_is_smooth_in_the_order(m):
    """The derivatives in m equal central differences, also at m = 0, where a measure of two branches gives 0 or NaN."""
    step, (_, slope, second) = 1e-4, jet(m)
    up, down = jet(m + step), jet(m - step)
    assert worst((up[0] - down[0]) / (2 * step), slope) < 1e-7  # 2e-10
    assert worst((up[1] - down[1]) / (2 * step), second) < 1e-7  # 7e-11
    assert worst(second) > 1e-4
