"""Small bodies for the tests, and one compiled function that evaluates all results of a body.

In each dimension the lattice and the cloud have the same number of points and of neighbour slots, so that a model is
compiled once for both. Volumes differ from point to point, the influence function is not constant, and most points are
near a surface.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd

SHAPES = {1: (7,), 2: (5, 3), 3: (3, 2, 2)}
HORIZONS = {1: 2.3, 2: 2.3, 3: 2.05}
BODIES = [(dim, kind) for dim in SHAPES for kind in ("lattice", "cloud")]


def gaussian(r, horizon):
    """`pdjax.gaussian_influence` of width ½ in NumPy, for the reference."""
    return np.exp(-((2 * r / horizon) ** 2))


def random(*key):
    """A random generator for these integers, so that each test has its own numbers."""
    return np.random.default_rng([7, *key])


@functools.cache
def points(dim, kind):
    """The lattice or the jittered cloud of a dimension, with unequal volumes."""
    rng = random(dim)
    positions = pd.lattice(SHAPES[dim]).positions
    volumes = rng.uniform(0.8, 1.2, len(positions))
    return pd.cloud(positions + (0.15 if kind == "cloud" else 0) * rng.uniform(-1, 1, positions.shape), volumes)


def padded(fams, width):
    """The same families with more slots. A new slot holds the point itself, a non-zero ξ and the weight 0."""
    more = ((0, 0), (0, width - fams.xi.shape[1]))
    own = np.arange(len(fams), dtype=np.int32)[:, None]
    slots = np.arange(width, dtype=np.int32)[None, :]
    empty = slots >= fams.xi.shape[1]
    return eqx.tree_at(
        lambda f: (f.neighbours, f.reverse, f.xi, f.influence, f.weight),
        fams,
        (
            jnp.where(empty, own, jnp.pad(fams.neighbours, more)),
            jnp.where(empty, slots, jnp.pad(fams.reverse, more)),
            jnp.pad(fams.xi, (*more, (0, 0)), constant_values=0.7),
            jnp.pad(fams.influence, more, constant_values=1.0),
            jnp.pad(fams.weight, more),
        ),
    )


@functools.cache
def families(dim, kind):
    """Families of a body, padded so that each has one slot for every other point."""
    found = pd.families(points(dim, kind), HORIZONS[dim], pd.gaussian_influence)
    return padded(found, len(points(dim, kind)) - 1)


def deformation(dim, *key, size=0.1):
    """A random F near the identity, det F > 0."""
    return np.eye(dim) + size * random(dim, *key).uniform(-1, 1, (dim, dim))


def rotation(dim, *key):
    """A random proper rotation."""
    Q, R = np.linalg.qr(random(dim, *key).normal(size=(dim, dim)))
    Q = Q * np.sign(np.diag(R))
    Q[:, 0] *= np.linalg.det(Q)
    return Q


def displacement(dim, kind, *key, size=0.1):
    """A large affine displacement plus noise, so that all points differ."""
    X = points(dim, kind).positions
    return X @ (deformation(dim, *key, size=size) - np.eye(dim)).T + 0.3 * size * random(*key, 1).normal(size=X.shape)


def worst(a, b=0.0):
    """max |a − b|. It is NaN if any entry is NaN."""
    a, b = np.asarray(a), np.asarray(b)
    assert a.shape == b.shape or b.ndim == 0, f"{a.shape} is not {b.shape}"
    return np.max(np.abs(a - b))


class Response(NamedTuple):
    """Results of a body at one displacement."""

    force: jax.Array
    energy: jax.Array | None  # None if the model has no energy
    gradient: jax.Array | None  # ∂Π/∂u
    jacobian: jax.Array  # dense
    strain: jax.Array
    stress: jax.Array


@jax.jit
def respond(model, fams, u):
    """All results of a body in one program, which is compiled once for each kind of model and shape."""
    energy = gradient = None
    if model.hyperelastic:
        energy, gradient = jax.value_and_grad(lambda v: pd.strain_energy(model, fams, v))(u)
    return Response(
        pd.force_density(model, fams, u),
        energy,
        gradient,
        pd.jacobian(model, fams, u, "dense"),
        pd.strain(model, fams, u),
        pd.stress(model, fams, u),
    )


@jax.jit
def homogeneous(model, fam, F):
    """W(F) and ∂W/∂F of a lattice family by autodiff (None if the model has no energy), P, ∂P/∂F and T."""

    def stress(F):
        P = pd.piola_stress(model, fam, F)
        return P, P

    energy = slope = None
    if model.hyperelastic:
        energy, slope = jax.value_and_grad(lambda F: model.energy(fam.bonds(F)))(F)
    moduli, P = jax.jacfwd(stress, has_aux=True)(F)
    return energy, slope, P, moduli, pd.force_state(model, fam, F)
