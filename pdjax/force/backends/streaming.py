# mypy: disable-error-code="arg-type, union-attr"
"""The formulas of streaming: forces and reference sums, computed slot by slot. The backend class is in `streamed`.

The functions of this module keep nothing between calls. They apply to models made of moments. Memory is a few numbers
for each point and never grows with points × bonds. There are two passes over the bonds b of every point i, each with a
neighbour j:

    first pass    A_i = state(Σ_b moments(bond b))
    second pass   f_i = Σ_b V_j [t(A_i, A_j, bond) − t(A_j, A_i, −bond)]

The second pass simplifies to f_i = Σ_b V_j t(A_i + A_j, bond) if the model promises `additive` (`models.base`) and
every bond has the same weight seen from both ends. `reference_sums` computes once what depends on the reference
configuration alone.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from ...geometry.bonds import EACH_BOND, Bonds
from ...models.base import AbstractModel, PointStateModel
from ...models.pointwise import regular, split_model
from .components import by_components, entries, one_entry, trees
from .point_states import Varying, bonds_of_rest, sizes_of_moments, states, with_rest
from .traversal import LatticeTraversal, Slot, SlotTraversal, Traversal


def _opened(traversal: Traversal, x: Array) -> list[Array]:
    """(components, flat) → opened rows. They are separated before the loop: inside it, every step would copy a row."""
    return [traversal.open(x[k]) for k in range(x.shape[0])]


def _bond(
    traversal: Traversal,
    u: list[Array],
    here: list[Array],
    gradient: Array | None,
    slot: Slot,
    volumes: Array,
    horizon: Array,
):
    """The bonds of one slot, by components."""
    dim = len(u)
    xi, eta = np.empty(dim, dtype=object), np.empty(dim, dtype=object)
    for k in range(dim):
        xi[k] = slot.xi[k]
    far = traversal.far(volumes, slot)
    # In an empty cell u is 0, so a bond to it may have length 0, and its force 0 · ∞ would be NaN.
    real = None if traversal.filled is None else (far > 0) & (traversal.filled > 0)
    for k in range(dim):
        eta[k] = traversal.far(u[k], slot) - here[k]
        if real is not None:
            eta[k] = jnp.where(real, eta[k], 0.0)
        if gradient is not None:
            eta[k] = eta[k] + sum(gradient[k, l] * xi[l] for l in range(dim))
    return Bonds(xi, eta, one_entry(slot.omega), one_entry(far), one_entry(horizon))


def _over_slots(traversal: Traversal, body: Callable, start: list[Array], pairs: float) -> list[Array]:
    """Sum body(slot), a list of (flat,) arrays, over all slots.

    If `pairs` is ±1, the contribution of a bond to its far end is `pairs` times that to its near end, so one slot of
    every opposite two is enough. If `pairs` is 0, all slots are evaluated.
    """

    @partial(jax.checkpoint, prevent_cse=False)
    def add(total, numbers):
        for number in numbers:
            slot = traversal.slot(number)
            share = body(slot)
            total = [a + b for a, b in zip(total, share, strict=True)]
            if pairs:
                total = [a + pairs * traversal.returned(b, slot) for a, b in zip(total, share, strict=True)]
        return total

    numbers = traversal.numbers(bool(pairs))
    left = [n for n in numbers[-1] if n >= 0]
    whole = numbers[:-1] if len(left) < numbers.shape[1] else numbers
    total, _ = jax.lax.scan(lambda total, step: (add(total, list(step)), None), start, jnp.asarray(whole))
    return add(total, left) if len(whole) < len(numbers) else total


def _in_pairs(traversal: Traversal, varying: Varying) -> bool:
    """Whether the contributions of a bond to its two ends differ at most in sign: a lattice of one material."""
    model = varying.single()
    return (
        model.even and model.additive and not model.degree and isinstance(traversal, LatticeTraversal) and not varying
    )


def _sum_moments(varying: Varying, traversal: Traversal, which: int, u: Array, gradient, horizon) -> Array:
    """The reference moments (`which` = 0) or the deformed moments (1), summed over every family: (entries, flat)."""
    dim, dtype = u.shape[0], u.dtype
    _, shapes = sizes_of_moments(varying.single(), which, dim, dtype)
    count = sum(int(np.prod(s)) for s in shapes)
    opened, volumes = _opened(traversal, u), traversal.open(traversal.volumes)
    pairs = 1.0 if _in_pairs(traversal, varying) else 0.0

    def moments(leaves, bond):
        return varying.model(leaves).moments(bond)[which]

    here = [traversal.here(x) for x in opened]
    own = varying.components()

    def body(slot):
        bond = _bond(traversal, opened, here, gradient, slot, volumes, horizon)
        if pairs:  # an empty cell must contribute nothing to its neighbours
            bond = bond._replace(volume=one_entry(bond.volume[()] * traversal.filled))
        return entries(
            by_components(moments, dtype, traversal.one, traversal.dear(*bond.eta, bond.volume[()]))(own, bond)
        )

    flat = traversal.volumes.shape[0]
    total = _over_slots(traversal, body, [jnp.zeros(flat, dtype)] * count, pairs) if count else []
    return jnp.stack(total) if count else jnp.zeros((0, flat), dtype)


def reference_sums(
    split: tuple[PyTree, AbstractModel], traversal: Traversal, dim: int, horizon: Array
) -> Float[Array, "entries flat"]:
    """The reference moments summed over every family.

    Empty cells get the sums of a full family, and points without bonds get those of the bonds at rest that
    `models.pointwise` defines. No model then divides by 0 or inverts a singular tensor.

    `split` is the result of `split_model`: (leaves of the model that vary from point to point, the rest).
    """
    dtype = traversal.volumes.dtype
    u = jnp.zeros((dim, traversal.volumes.shape[0]), dtype)
    varying = Varying(split, traversal)
    sums = _sum_moments(varying, traversal, 0, u, None, horizon)
    if traversal.filled is None:
        return with_rest(varying.single(), sums, jnp.all(sums == 0, axis=0), bonds_of_rest(dim, horizon, dtype))
    return with_rest(varying.single(), sums, traversal.filled <= 0, traversal.full_family(horizon))


def sums_of_families(model: PointStateModel, bonds: Bonds) -> Float[Array, "entries few"]:
    """`reference_sums` of few families (few, bonds), whose points have the constants of `model`.

    Families without bonds get those of the bonds at rest that `models.pointwise` defines.
    """
    varying, shared = split_model(model, len(bonds.xi))

    def one(mine, bonds):
        return jax.vmap(lambda bond: eqx.combine(mine, shared).moments(bond)[0], (EACH_BOND,))(bonds)

    sums = jax.vmap(one)(varying, regular(bonds)[0])
    rows = [jnp.sum(x, axis=1).reshape(len(bonds.xi), -1) for x in jax.tree.leaves(sums)]
    return jnp.concatenate(rows, axis=1).T


def _pull_of_both(
    force: Callable,
    own: list,
    traversal: Traversal,
    states: tuple,
    here: list[Array],
    slot: Slot,
    bond: Bonds,
    read: list,
) -> tuple[Any, Any]:
    """The weight and the force of the bonds of one slot, where a bond has the force of the sum of both states.

    `states` are the structure, the shapes and the rows of the states, and `here` their rows at the points. `read` lists
    the parts of `bond` that are expensive to read again.
    """
    structure, shapes, rows = states
    summed = [a + traversal.far(x, slot) for a, x in zip(here, rows, strict=True)]
    both = trees(structure, shapes, summed)
    dear = traversal.dear(*read, *summed)
    total = by_components(force, traversal.volumes.dtype, traversal.one, dear)(own, both, both, bond)
    if isinstance(traversal, SlotTraversal) and traversal.share is not None:
        # The ends of a broken bond may meet. It has no direction then, and its force 0 · ∞ would be NaN.
        total = [jnp.where(slot.omega == 0, 0.0, x) for x in total]
    return bond.volume[()] * (1.0 if shapes else 2.0), total


def streamed_force(
    split: tuple[PyTree, AbstractModel],
    traversal: Traversal,
    reference: Array,
    u: Float[Array, "points dim"],
    gradient: Array | None,
    horizon: Array,
) -> Float[Array, "points dim"]:
    """f of every point, in two passes over the bonds.

    `split` is the result of `split_model`. `gradient` is F − I of a mean deformation, or None.
    """
    dim, dtype = u.shape[1], traversal.volumes.dtype
    varying = Varying(split, traversal)
    model = varying.single()
    U = traversal.embed(u.astype(dtype))
    deformed = _sum_moments(varying, traversal, 1, U, gradient, horizon)
    mine = varying.components()
    structure, shapes, rows = states(model, varying.model, mine, dim, dtype, (reference, deformed), horizon)
    a = _opened(traversal, traversal.renew(jnp.stack(rows))) if rows else []
    opened, volumes = _opened(traversal, U), traversal.open(traversal.volumes)
    constants = [_opened(traversal, x) for x in varying.rows]
    pairs = -1.0 if _in_pairs(traversal, varying) else 0.0
    alike = model.additive and traversal.back is None and not varying
    u_here, a_here = ([traversal.here(x) for x in rows] for rows in (opened, a))
    here = trees(structure, shapes, a_here)

    def force(leaves, here, there, bond):
        return varying.model(leaves).bond_force(here, there, bond)

    def body(slot):
        bond = _bond(traversal, opened, u_here, gradient, slot, volumes, horizon)
        if alike:
            of = structure, shapes, a
            weight, total = _pull_of_both(force, mine, traversal, of, a_here, slot, bond, list(bond.eta))
            if pairs:
                weight = weight * traversal.filled
            return [weight * x for x in total]
        there = trees(structure, shapes, [traversal.far(x, slot) for x in a])
        yours = [
            trees(None, [s], [traversal.far(x, slot) for x in rows])
            for rows, s in zip(constants, varying.shapes, strict=True)
        ]
        omega = slot.omega if slot.back is None else slot.back
        theirs = bond.horizon if horizon.ndim == 0 else one_entry(traversal.far(horizon, slot))
        reverse = Bonds(-bond.xi, -bond.eta, one_entry(omega), one_entry(traversal.volumes), theirs)
        out = by_components(force, dtype)(mine, here, there, bond)
        back = by_components(force, dtype)(yours, there, here, reverse)
        return [bond.volume[()] * (a - b) for a, b in zip(out, back, strict=True)]

    zeros = [jnp.zeros_like(traversal.volumes)] * dim
    return traversal.collect(jnp.stack(_over_slots(traversal, body, zeros, pairs)))


def breaks_in_the_loop(model: AbstractModel, split: tuple[PyTree, AbstractModel], traversal: Traversal) -> bool:
    """Whether `streamed_break` serves a model: its bond force is that of the sum of both states."""
    symmetric = isinstance(traversal, SlotTraversal) and traversal.back is None
    return model.additive and symmetric and not jax.tree.leaves(split[0])


def streamed_break(
    split: tuple[PyTree, AbstractModel],
    traversal: SlotTraversal,
    reference: Array,
    u: Float[Array, "points dim"],
    horizon: Array,
    alive: Bool[Array, "points bonds"],
    limit: Float[Array, "..."],
) -> tuple[Float[Array, "points dim"], Bool[Array, "points bonds"]]:
    """f of the bonds that are alive, and which of them have a stretch above `limit`, from one gathering of every bond.

    `limit` is one critical stretch s₀, or one for each bond (points, bonds). |ξ + η| > (1 + s₀)|ξ| is the same as
    (2ξ + η)·η > s₀(2 + s₀)|ξ|², which has no root and no cancellation.
    """
    dim, dtype = u.shape[1], traversal.volumes.dtype
    varying = Varying(split, traversal)
    model, live = varying.single(), alive.T
    traversal = eqx.tree_at(lambda t: t.share, traversal, live, is_leaf=lambda x: x is None)
    U = traversal.embed(u.astype(dtype))
    deformed = _sum_moments(varying, traversal, 1, U, None, horizon)
    structure, shapes, rows = states(model, varying.model, [], dim, dtype, (reference, deformed), horizon)
    a = _opened(traversal, jnp.stack(rows)) if rows else []
    opened, volumes = _opened(traversal, U), traversal.open(traversal.volumes)
    limits = limit.T if limit.ndim else jnp.broadcast_to(limit, (live.shape[0],))

    def force(leaves, here, there, bond):
        return varying.model(leaves).bond_force(here, there, bond)

    @partial(jax.checkpoint, prevent_cse=False)
    def one(total, numbers):
        number, left, most = numbers
        slot = traversal.slot(number)
        bond = _bond(traversal, opened, opened, None, slot, volumes, horizon)
        # Divided by 1, η is stored (see `components`). XLA would gather it twice, for the force and for the stretch.
        for k in range(dim):
            bond.eta[k] = bond.eta[k] / traversal.one
        weight, t = _pull_of_both(force, [], traversal, (structure, shapes, a), a, slot, bond, [])
        grown = sum((2 * a + b) * b for a, b in zip(bond.xi, bond.eta, strict=True))
        square = sum(a * a for a in bond.xi)
        return [a + weight * x for a, x in zip(total, t, strict=True)], left & (grown > most * (2 + most) * square)

    start = [jnp.zeros_like(traversal.volumes)] * dim
    total, hit = jax.lax.scan(one, start, (jnp.arange(live.shape[0]), live, limits))
    return traversal.collect(jnp.stack(total)), hit.T
