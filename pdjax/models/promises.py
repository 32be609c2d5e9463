"""A check of the promises of a user's model on one random bond.

The force backends rely on the promises `additive`, `even` and `degree`: they halve a sum over bonds, or compute it by
FFT. A promise that does not hold would give a wrong force without any error. The models of the package are not checked
here, because the tests check their promises.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .._internal.checks import is_concrete
from ..geometry.bonds import Bonds
from .base import AbstractModel, PointStateModel, Sums

_MEANING = {
    "additive": "a bond's force is linear in the point state and t(A, −ξ, −η) = −t(A, ξ, η)",
    "even": "what a bond adds to the sums does not change if (ξ, η) becomes (−ξ, −η)",
    "degree": "the moments are polynomials of this degree in η, the bond force one of degree 1, both proportional to ω",
}
_KNOWN: set[tuple] = set()  # keys of the models that have passed the check


def _own(model: eqx.Module) -> bool:
    """True if the package defines the class of the model and of each of its parts."""
    parts = jax.tree.leaves(model, is_leaf=lambda x: x is not model and isinstance(x, eqx.Module))
    mine = type(model).__module__.startswith("pdjax.")
    return mine and all(_own(part) for part in parts if isinstance(part, eqx.Module))


def _off(found: PyTree, expected: PyTree) -> Array:
    """Largest difference of two trees, divided by their largest entry."""
    a, b = (jnp.concatenate([jnp.zeros(1), *(jnp.ravel(x) for x in jax.tree.leaves(t))]) for t in (found, expected))
    return jnp.max(jnp.abs(a - b)) / jnp.maximum(jnp.maximum(jnp.max(jnp.abs(a)), jnp.max(jnp.abs(b))), 1e-30)


@eqx.filter_jit
def _deviations(model: PointStateModel, dim: int) -> dict[str, Array]:
    """Relative deviation from each promise that the model makes, on one random bond."""
    draw = iter(np.random.default_rng(1).normal(size=64))
    xi, eta = (scale * jnp.asarray([next(draw) for _ in range(dim)]) for scale in (1.0, 0.05))
    one = jnp.ones(())
    bond = Bonds(xi, eta, one, one, jnp.asarray(3.0))
    mirrored, heavier = bond._replace(xi=-xi, eta=-eta), bond._replace(omega=2 * one)
    summed = model.moments(bond)
    shapes = jax.eval_shape(lambda s: model.state(Sums(s[0], s[1], bond.horizon, dim)), summed)
    states = [jax.tree.map(lambda x, k=k: jnp.sin(k + jnp.arange(x.size, dtype=x.dtype)).reshape(x.shape), shapes)
              for k in (1.0, 2.0)]  # fmt: skip

    def t(state, bond):
        return model.bond_force(state, state, bond)

    def flat(function, degree):
        """Relative finite difference of order degree + 1 along η. It is zero for a polynomial of this degree."""
        points = [function(bond._replace(eta=k * eta)) for k in range(degree + 2)]
        signs = [(-1) ** k * math.comb(degree + 1, k) for k in range(degree + 2)]
        total = jax.tree.map(lambda *x: sum(s * y for s, y in zip(signs, x, strict=True)), *points)
        return _off(jax.tree.map(jnp.add, total, points[-1]), points[-1])

    out = {}
    a, b = states
    if model.additive:
        both = jax.tree.map(jnp.add, a, b)
        linear = _off(t(both, bond), t(a, bond) + t(b, bond)) if jax.tree.leaves(a) else jnp.zeros(())
        out["additive"] = jnp.maximum(linear, _off(t(a, mirrored), -t(a, bond)))
    if model.additive and model.even:
        out["even"] = _off(model.moments(mirrored), summed)
    if model.additive and model.degree:
        doubled = jax.tree.map(lambda x: 2 * x, (summed, t(a, bond)))
        parts = [
            flat(lambda x: model.moments(x)[1], model.degree),
            flat(lambda x: t(a, x), 1),
            _off((model.moments(heavier), t(a, heavier)), doubled),
        ]
        out["degree"] = jnp.max(jnp.stack(parts))
    return out


def check_promises(model: AbstractModel, dim: int) -> None:
    """Raise ValueError if a user's model breaks a promise that the force backends rely on.

    The message names the promise, its meaning, and what to declare instead. A model with traced values is not checked.
    """
    if not isinstance(model, PointStateModel) or not is_concrete(model) or _own(model):
        return
    leaves, structure = jax.tree.flatten(model)
    key = (structure, dim, tuple(np.asarray(x).tobytes() for x in leaves))
    if key in _KNOWN:
        return
    with jax.core.eval_context():  # the values are concrete, also while another function is traced
        for promise, off in _deviations(model, dim).items():
            if float(off) > 1e-3 * float(jnp.finfo(jnp.result_type(float)).eps) ** 0.25:
                instead = 0 if promise == "degree" else False
                name = type(model).__name__
                raise ValueError(
                    f"{name} declares {promise} = {getattr(model, promise)}, which means: {_MEANING[promise]}. On a"
                    f" random bond the relative deviation from this is {float(off):.1g}. Declare {promise} = {instead},"
                    " or correct the methods of the model"
                )
    _KNOWN.add(key)
