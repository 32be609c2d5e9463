"""Many devices: batches of states, and bodies cut in slabs, over a `jax.sharding.Mesh`.

**Batches.** States do not know of each other: every device takes an equal share (`sharded_vmap`, and the maps by
`stability_map(..., mesh=mesh)`).

**Slabs.** A full lattice of n planes along its first axis is cut into D slabs of P = n / D planes; device s holds
planes s P … (s + 1) P − 1 of everything that the points carry. A bond reaches R = ⌊N⌋ planes and the force on a point
`rings` bonds far (1: springs; 2: the state A of a neighbour is a sum over the neighbour's own family), so

    f_p = f(u_q : |q − p| ≤ H),    H = rings · R

and one exchange of H planes with each neighbour is all there is to tell:

    ũ_s = [ last H planes of u_{s−1} | u_s | first H planes of u_{s+1} ],    f_s = planes H … H + P − 1 of f(ũ_s)

by `jax.lax.ppermute` under `jax.shard_map`. The slab with its halo is a small lattice body, evaluated by slices
(`pdjax.force.backends`), with a mask of what is filled: planes beyond the ends of the body are not, so one program serves the
first, the middle and the last slab. A periodic first axis joins the last slab to the first. Planes of the halo are
computed on both sides: the work grows by 1 + 2 H / P. What the family sums of the reference configuration are is known
once, by the slab that owns the point, and exchanged in the same way.

    mesh = jax.sharding.Mesh(jax.devices(), ("slabs",))
    families = pd.families(pd.lattice((64, 32, 32), 1.0), 3.015, arrays=False)
    f = pd.slab_force(model, families, mesh)

    @jax.jit
    def verlet(u, v, dt, steps=100):                       # everything stays where it is
        def step(state, _):
            u, v, a = state
            v = v + dt / 2 * a
            u = u + dt * v
            a = f(u) / density
            return (u, v + dt / 2 * a, a), None
        return jax.lax.scan(step, (u, v, f(u) / density), length=steps)[0]

    K = lambda u, v: -jax.jvp(f, (u,), (v,))[1]            # a stiffness that is never stored
    step, _ = jax.scipy.sparse.linalg.cg(lambda v: K(u, v), f(u) + b)

**Several processes**, each with devices of its own, run the same script, which starts with (before any array or model)

    jax.config.update("jax_cpu_collectives_implementation", "gloo")      # for CPUs only
    jax.distributed.initialize("host0:1234", num_processes=2, process_id=rank)
    mesh = jax.sharding.Mesh(jax.devices(), ("slabs",))                  # of all processes
    u = jax.device_put(u, jax.sharding.NamedSharding(mesh, jax.P("slabs")))

and go on as above; `jax.experimental.multihost_utils.process_allgather(f(u), tiled=True)` brings a result to all.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float

from ..._internal.checks import as_real, is_concrete, require
from ..._internal.public import public_function
from ...geometry.bonds import Families
from ...models.base import AbstractModel
from ...models.pointwise import split_model
from ..fields import check_model
from .streaming import reference_sums, streamed_force
from .traversal import LatticeTraversal


def device_mesh(mesh: Mesh) -> tuple[Mesh, str, int]:
    """The mesh, its first axis' name and how many devices lie along it.

    Axes are made automatic: those of `jax.make_mesh` are explicit, and every derivative outside of `jit` would then
    need the mesh as a context.
    """
    if not isinstance(mesh, Mesh) or not mesh.axis_names:
        raise ValueError(
            "mesh must be a jax.sharding.Mesh with an axis, such as Mesh(jax.devices(), ('slabs',));"
            f" got {type(mesh).__name__}"
        )
    name = mesh.axis_names[0]
    return Mesh(mesh.devices, mesh.axis_names), name, mesh.shape[name]


@public_function
def sharded_vmap(function: Callable, mesh: Mesh) -> Callable:
    """`jax.vmap(function)` whose batch is cut over the first axis of a mesh; no device hears of another's states.

    Arguments: function (one state: arrays or trees of them) → a tree of arrays.
    Returns: a function of batches (states, …), any number of states (the last is repeated to fill the devices, and
        dropped); its results (states, …) are whole on every device.
    Raises: ValueError for what is no mesh, or batches of different lengths.
    Example: `pd.sharded_vmap(lambda m: pd.critical_load(pd.SethHill(m, law), family), mesh)(orders)`.
    """
    mesh, name, devices = device_mesh(mesh)
    cut, whole = (NamedSharding(mesh, PartitionSpec(*axes)) for axes in ((name,), ()))

    constrain = jax.lax.with_sharding_constraint  # in a traced function `jax.device_put` moves nothing

    @jax.jit
    def mapped(*batches):
        lengths = {jnp.shape(x)[:1] for x in jax.tree.leaves(batches)}
        if len(lengths) != 1 or () in lengths or (0,) in lengths:
            raise ValueError(f"all batches must have one length >= 1; got {sorted(lengths)}")
        (count,) = lengths.pop()
        index = np.minimum(np.arange(-(-count // devices) * devices), count - 1)
        full = jax.tree.map(lambda x: constrain(jnp.asarray(x)[index], cut), batches)
        return jax.tree.map(lambda x: constrain(x, whole)[:count], jax.vmap(function)(*full))

    return mapped


def _slab(families: Families, cells: tuple[int, ...]) -> LatticeTraversal:
    """The traversal over a slab with its halo: a lattice of `cells`, all filled, not periodic along the first axis."""
    grid: Any = families.grid
    grid = replace(grid, cells=cells, periodic=(False, *grid.periodic[1:]), kinds=None)
    points = int(np.prod(cells))
    volumes = jnp.full(points, float(families.spacing or 1.0) ** families.dim, families.dtype)
    nothing = (None,) * 5
    count = jnp.zeros(points, jnp.int32)
    return LatticeTraversal.of(Families(*nothing, volumes, count, families.horizon, families.spacing, cells, grid))


class SlabForce(eqx.Module):
    """f(u) of a lattice body in slabs over a mesh; made by `slab_force`."""

    varying: Any  # constants of the model that vary from point to point, slab by slab with their halos
    shared: AbstractModel
    reference: Float[Array, "entries flat"] | None  # slab after slab; None: not known yet
    traversal: LatticeTraversal  # of one slab with its halo
    horizon: Float[Array, ""]
    mesh: Mesh = eqx.field(static=True)
    planes: int = eqx.field(static=True)  # of a slab
    halo: int = eqx.field(static=True)  # planes on either side
    wraps: bool = eqx.field(static=True)

    def __hash__(self) -> int:  # equal to itself alone, so that `jax.jit(operator)` works
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    @property
    def name(self) -> str:
        """Of the mesh's axis."""
        return self.mesh.axis_names[0]

    @property
    def devices(self) -> int:
        return self.mesh.shape[self.name]

    @property
    def sharding(self) -> NamedSharding:
        """How fields over the points (points, …) lie over the devices."""
        return NamedSharding(self.mesh, PartitionSpec(self.name))

    def __call__(self, u) -> Float[Array, "points dim"]:
        """f (points, dim) [force/length^dim] of u (points, dim) [length], sharded as `sharding` says, or not.

        Raises: ValueError for a wrong shape or NaN.
        """
        u = as_real(u)
        wanted = (self.devices * self.planes * int(np.prod(self.traversal.cells[1:])), self.traversal.xi.shape[1])
        if u.shape != wanted:
            raise ValueError(f"u must have shape (points, dim) = {wanted}; got {u.shape}")
        u = jax.device_put(u, self.sharding)
        if is_concrete(u):
            require(u, jnp.isfinite(u).all(), "u must be finite; it has NaN or infinite entries")
        return _force(self, u)

    # What follows runs on one device, under shard_map.

    def with_halo(self, x: Array) -> Array:
        """(points of the slab, …) → the same with H planes more on either side; edge values beyond the body's ends."""
        name, devices = self.name, self.devices
        own = x.reshape(self.planes, -1, *x.shape[1:])
        here, h = jax.lax.axis_index(name), self.halo
        up = [(s, (s + 1) % devices) for s in range(devices if self.wraps else devices - 1)]
        left = jax.lax.ppermute(own[-h:], name, up)
        right = jax.lax.ppermute(own[:h], name, [(b, a) for a, b in up])
        if not self.wraps:
            left = jnp.where(here == 0, own[:1], left)
            right = jnp.where(here == devices - 1, own[-1:], right)
        return jnp.concatenate([left, own, right]).reshape(-1, *x.shape[1:])

    def inner(self, x: Array) -> Array:
        """(points of the slab with its halo, …) → (points of the slab, …)."""
        plane = x.shape[0] // (self.planes + 2 * self.halo)
        return x[self.halo * plane : (self.halo + self.planes) * plane]

    def masked(self) -> LatticeTraversal:
        """The traversal of this device's slab: not filled beyond the ends of the body."""
        if self.wraps:
            return self.traversal
        plane = jnp.arange(-self.halo, self.planes + self.halo) + jax.lax.axis_index(self.name) * self.planes
        inside = (plane >= 0) & (plane < self.devices * self.planes)
        inside = jnp.repeat(inside.astype(self.traversal.filled.dtype), int(np.prod(self.traversal.cells[1:])))
        return eqx.tree_at(lambda w: w.filled, self.traversal, self.traversal.embed(inside[:, None])[0])


def _on_slabs(function: Callable, operator: SlabForce, data: tuple, specs: tuple, out_specs: Any) -> Any:
    """function(operator, *data) on every device: `specs` say how data lie; of the operator, states and constants of
    the points lie slab after slab and everything else is everywhere."""
    arrays, rest = eqx.partition(operator, eqx.is_array)
    own = PartitionSpec(operator.name)
    along = jax.tree.map(lambda _: PartitionSpec(), arrays)
    reference = None if arrays.reference is None else PartitionSpec(None, *own)
    lie = (jax.tree.map(lambda _: own, arrays.varying), reference)
    along = eqx.tree_at(lambda o: (o.varying, o.reference), along, lie, is_leaf=lambda x: x is None)

    def run(arrays, *data):
        return function(eqx.combine(arrays, rest), *data)

    each = jax.shard_map(run, mesh=operator.mesh, in_specs=(along, *specs), out_specs=out_specs, check_vma=False)
    return each(arrays, *data)


@eqx.filter_jit
def _force(operator: SlabForce, u: Array) -> Float[Array, "points dim"]:
    def one(o: SlabForce, u: Array) -> Array:
        assert o.reference is not None
        f = streamed_force((o.varying, o.shared), o.masked(), o.reference, o.with_halo(u), None, o.horizon)
        return o.inner(f)

    return _on_slabs(one, operator, (u,), (operator.sharding.spec,), operator.sharding.spec)


@eqx.filter_jit
def _prepared(operator: SlabForce, varying: Any) -> SlabForce:
    """The operator with what does not depend on u: constants with their halos, sums of the reference configuration."""

    def one(o: SlabForce, varying: Any) -> tuple[Any, Array]:
        varying, traversal = jax.tree.map(o.with_halo, varying), o.masked()
        sums = reference_sums((varying, o.shared), traversal, traversal.xi.shape[1], o.horizon)
        if not sums.shape[0]:
            return varying, sums
        # right inside the slab, where all neighbours are seen; the halo hears it from those who own it
        right = traversal.embed(o.with_halo(o.inner(traversal.collect(sums))))
        return varying, jnp.where(traversal.filled > 0, right, sums)

    own = operator.sharding.spec
    made = _on_slabs(one, operator, (varying,), (own,), (own, PartitionSpec(None, *own)))
    return eqx.tree_at(lambda o: (o.varying, o.reference), operator, made, is_leaf=lambda x: x is None)


def _refuse(model: AbstractModel, families: Families) -> None:
    if not model.by_moments:
        raise ValueError(
            f"slabs need a model made of sums over single bonds (`moments`); {type(model).__name__} is none:"
            " evaluate it on one device, by pd.force_operator"
        )
    if families.grid is None or families.grid.sites is not None:
        what = "families of a cloud or with weights of their own" if families.grid is None else "a masked lattice"
        raise ValueError(f"slabs are cut from a full lattice (pd.lattice without a mask); got {what}")


def _slab_planes(planes: int, halo: int, devices: int) -> int:
    """Planes of one slab; refuses a mesh that can't cut the body."""
    able = [d for d in range(1, planes + 1) if planes % d == 0 and planes // d >= halo]
    would = f"numbers of devices that would do: {', '.join(map(str, able)) or 'none (one device: pd.force_operator)'}"
    if planes % devices:
        raise ValueError(
            f"the first axis of the body has {planes} planes, which {devices} devices can't share equally; {would}"
        )
    if planes // devices < halo:
        raise ValueError(
            f"slabs of {planes // devices} planes ({planes} over {devices} devices) are thinner than the {halo} planes"
            f" that their neighbours must hear of (rings of the model × reach of the horizon); {would}"
        )
    return planes // devices


@public_function
def slab_force(model: AbstractModel, families: Families, mesh: Mesh) -> SlabForce:
    """The force density of a lattice body cut in slabs along its first axis, over the first axis of a mesh.

    f_s = inner planes of f([H planes of u_{s−1} | u_s | H planes of u_{s+1}]),  H = rings · ⌊N⌋  (see the module).

    Arguments: model made of moments; families of a full `pd.lattice` (arrays=False is enough), its first axis the longest.
    Returns: `SlabForce`: a function of u (points, dim) [length] → f (points, dim) [force/length^dim], equal to
        `force_density` to rounding, under jit, grad, jvp, scan; `.sharding` says how its fields lie on the devices.
    Raises: ValueError for a model without moments, a body that is not a full lattice, a mesh that does not divide the
        first axis (with the numbers of devices that would) or makes slabs thinner than the halo.
    """
    check_model(model, families, Families)
    _refuse(model, families)
    mesh, _, devices = device_mesh(mesh)
    grid: Any = families.grid
    reach = int(np.abs(np.array(grid.offsets).reshape(-1, families.dim))[:, 0].max(initial=0))
    halo = model.rings * max(reach, 1)
    planes = _slab_planes(grid.cells[0], halo, devices)
    traversal = _slab(families, (planes + 2 * halo, *grid.cells[1:]))
    varying, shared = split_model(model, len(families))
    bare = SlabForce(None, shared, None, traversal, families.horizon, mesh, planes, halo, grid.periodic[0])
    return _prepared(bare, jax.device_put(varying, bare.sharding))
