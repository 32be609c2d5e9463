"""Computations on many devices: batches of states, and bodies cut into slabs, over a `jax.sharding.Mesh`.

**Batches.** The states of a batch are independent, so every device computes an equal share of them (`sharded_vmap`, and
maps by `stability_map(..., mesh=mesh)`).

**Slabs.** A full lattice of n planes along its first axis is cut into D slabs of P = n / D planes. Device s holds the
planes s P … (s + 1) P − 1 of all fields. A bond reaches R = ⌊N⌋ planes. The force on a point depends on points up to
`rings` bonds away: 1 for springs, and 2 where the state A of a neighbour is a sum over the neighbour's family. Hence

    f_p = f(u_q : |q − p| ≤ H),    H = rings · R

and each slab needs only one exchange of H planes, its halo, with each neighbouring slab:

    ũ_s = [ last H planes of u_{s−1} | u_s | first H planes of u_{s+1} ],    f_s = planes H … H + P − 1 of f(ũ_s)

`jax.lax.ppermute` under `jax.shard_map` carries out the exchange. The slab with its halo is a small lattice body, which
the backend "slices" evaluates. A mask marks the planes beyond the ends of the body as empty, so one program serves the
first, the middle and the last slab. A periodic first axis joins the last slab to the first. Both neighbours compute the
planes of a halo, so the work grows by the factor 1 + 2 H / P. Each slab computes the reference sums of its own points
once, and exchanges them in the same way.

    mesh = jax.sharding.Mesh(jax.devices(), ("slabs",))
    families = pd.families(pd.lattice((64, 32, 32), 1.0), 3.015, arrays=False)
    f = pd.slab_force(model, families, mesh)

    @jax.jit
    def verlet(u, v, dt, steps=100):                       # all fields stay on their devices
        def step(state, _):
            u, v, a = state
            v = v + dt / 2 * a
            u = u + dt * v
            a = f(u) / density
            return (u, v + dt / 2 * a, a), None
        return jax.lax.scan(step, (u, v, f(u) / density), length=steps)[0]

    K = lambda u, v: -jax.jvp(f, (u,), (v,))[1]            # K v without storing the stiffness matrix
    step, _ = jax.scipy.sparse.linalg.cg(lambda v: K(u, v), f(u) + b)

**Several processes**, each with its own devices, run the same script. Before it makes any array or model, the script
starts with

    jax.config.update("jax_cpu_collectives_implementation", "gloo")      # for CPUs only
    jax.distributed.initialize("host0:1234", num_processes=2, process_id=rank)
    mesh = jax.sharding.Mesh(jax.devices(), ("slabs",))                  # of all processes
    u = jax.device_put(u, jax.sharding.NamedSharding(mesh, jax.P("slabs")))

and continues as above. `jax.experimental.multihost_utils.process_allgather(f(u), tiled=True)` gives the whole result to
every process.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, PyTree

from ..._internal.checks import as_real, is_concrete, require
from ..._internal.public import public_function
from ...geometry.bonds import Families
from ...models.base import AbstractModel
from ...models.pointwise import split_model
from ..fields import check_model
from .streaming import reference_sums, streamed_force
from .traversal import LatticeTraversal


def device_mesh(mesh: Mesh) -> tuple[Mesh, str, int]:
    """The mesh with automatic axes, the name of its first axis, and the number of devices along it.

    The axes of `jax.make_mesh` are explicit, and then every derivative outside of `jax.jit` needs the mesh as a
    context. Automatic axes do not.
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
    """Make `jax.vmap(function)` with its batch divided over the devices of a mesh.

    The states of the batch are independent, so the devices do not communicate until the results are collected.

    Parameters
    ----------
    function : callable
        Function of one state. Its arguments and its result are arrays or trees of arrays.
    mesh : jax.sharding.Mesh
        Devices. The batch is divided over the first axis of the mesh.

    Returns
    -------
    callable
        Function of batches (states, ...), for any number of states ≥ 1. The last state is repeated until all devices
        have equal shares, and the copies are dropped. Every device gets the whole result (states, ...).

    Raises
    ------
    ValueError
        If `mesh` is not a mesh with an axis. The returned function raises it if the batches have different lengths or
        are empty.

    Examples
    --------
    >>> mesh = jax.sharding.Mesh(jax.devices(), ("batch",))
    >>> squares = pd.sharded_vmap(lambda x: x**2, mesh)(np.arange(5.0))
    >>> np.asarray(squares).tolist()
    [0.0, 1.0, 4.0, 9.0, 16.0]
    """
    mesh, name, devices = device_mesh(mesh)
    cut, whole = (NamedSharding(mesh, PartitionSpec(*axes)) for axes in ((name,), ()))

    constrain = jax.lax.with_sharding_constraint  # `jax.device_put` moves nothing inside a traced function

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
    """The traversal over a slab with its halo: a full lattice of `cells` that is not periodic along its first axis."""
    grid = families.grid
    assert grid is not None
    grid = replace(grid, cells=cells, periodic=(False, *grid.periodic[1:]), kinds=None)
    points = int(np.prod(cells))
    volumes = jnp.full(points, float(families.spacing or 1.0) ** families.dim, families.dtype)
    nothing = (None,) * 5
    count = jnp.zeros(points, jnp.int32)
    return LatticeTraversal.of(Families(*nothing, volumes, count, families.horizon, families.spacing, cells, grid))


class SlabForce(eqx.Module):
    """Force density of a lattice body that is cut into slabs over the devices of a mesh.

    `slab_force` makes it. It is a function of the displacement that also works under `jax.jit`, `jax.grad`, `jax.jvp`
    and `jax.lax.scan`.

    Attributes
    ----------
    varying : tree of arrays
        Constants of the model that vary from point to point, slab by slab, each with its halo.
    shared : AbstractModel
        The model with all other constants.
    reference : array, shape (entries, flat), or None
        Sums over the reference configuration, slab by slab. None before they are computed.
    traversal : LatticeTraversal
        Traversal over one slab with its halo.
    horizon : array, shape ()
        Horizon δ [length].
    mesh : jax.sharding.Mesh
        The devices.
    planes : int
        Number of planes of a slab.
    halo : int
        Number of planes H that a slab exchanges with each neighbour.
    wraps : bool
        True if the body is periodic along its first axis.

    Examples
    --------
    >>> mesh = jax.sharding.Mesh(jax.devices()[:1], ("slabs",))
    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1, arrays=False)
    >>> f = pd.slab_force(pd.BondBased(1.0), families, mesh)
    >>> f.devices, f.planes, f.halo
    (1, 5, 2)
    """

    varying: PyTree
    shared: AbstractModel
    reference: Float[Array, "entries flat"] | None
    traversal: LatticeTraversal
    horizon: Float[Array, ""]
    mesh: Mesh = eqx.field(static=True)
    planes: int = eqx.field(static=True)
    halo: int = eqx.field(static=True)
    wraps: bool = eqx.field(static=True)

    # Two operators are equal only if they are the same object, as `jax.jit(operator)` needs it.
    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    @property
    def name(self) -> str:
        """Name of the mesh axis over which the body is cut."""
        return self.mesh.axis_names[0]

    @property
    def devices(self) -> int:
        """Number of devices, which is also the number of slabs."""
        return self.mesh.shape[self.name]

    @property
    def sharding(self) -> NamedSharding:
        """The sharding of fields over the points (points, ...) on the devices."""
        return NamedSharding(self.mesh, PartitionSpec(self.name))

    def __call__(self, u) -> Float[Array, "points dim"]:
        """Compute the force density of the displacement u.

        Parameters
        ----------
        u : array, shape (points, dim)
            Displacements [length]. An array that does not have the sharding `sharding` is moved to it.

        Returns
        -------
        array, shape (points, dim)
            f [force/length^dim], with the sharding `sharding`.

        Raises
        ------
        ValueError
            If u has a wrong shape or is not finite.
        """
        u = as_real(u)
        wanted = (self.devices * self.planes * int(np.prod(self.traversal.cells[1:])), self.traversal.xi.shape[1])
        if u.shape != wanted:
            raise ValueError(f"u must have shape (points, dim) = {wanted}; got {u.shape}")
        u = jax.device_put(u, self.sharding)
        if is_concrete(u):
            require(u, jnp.isfinite(u).all(), "u must be finite; it has NaN or infinite entries")
        return _force(self, u)

    # The methods below run on one device, under shard_map.

    def with_halo(self, x: Array) -> Array:
        """A field (points of the slab, …) with its halo of H planes on both sides.

        Beyond the ends of the body the halo repeats the values of the outermost plane.
        """
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
        """A field (points of the slab with its halo, …) without its halo."""
        plane = x.shape[0] // (self.planes + 2 * self.halo)
        return x[self.halo * plane : (self.halo + self.planes) * plane]

    def masked(self) -> LatticeTraversal:
        """The traversal of this device's slab, with empty cells beyond the ends of the body."""
        if self.wraps:
            return self.traversal
        plane = jnp.arange(-self.halo, self.planes + self.halo) + jax.lax.axis_index(self.name) * self.planes
        inside = (plane >= 0) & (plane < self.devices * self.planes)
        inside = jnp.repeat(inside.astype(self.traversal.filled.dtype), int(np.prod(self.traversal.cells[1:])))
        return eqx.tree_at(lambda w: w.filled, self.traversal, self.traversal.embed(inside[:, None])[0])


def _on_slabs(function: Callable, operator: SlabForce, data: tuple, specs: tuple, out_specs: PyTree) -> PyTree:
    """function(operator, *data) on every device.

    `specs` are the partition specs of the data. The states and constants of the points in the operator are divided over
    the slabs. Every device has a copy of everything else in the operator.
    """
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
def _prepared(operator: SlabForce, varying: PyTree) -> SlabForce:
    """The operator with everything that does not depend on u: constants with their halos, and reference sums."""

    def one(o: SlabForce, varying: PyTree) -> tuple[PyTree, Array]:
        varying, traversal = jax.tree.map(o.with_halo, varying), o.masked()
        sums = reference_sums((varying, o.shared), traversal, traversal.xi.shape[1], o.horizon)
        if not sums.shape[0]:
            return varying, sums
        # The sums are correct inside the slab, where all neighbours are present. The halo gets those of its owners.
        right = traversal.embed(o.with_halo(o.inner(traversal.collect(sums))))
        return varying, jnp.where(traversal.filled > 0, right, sums)

    own = operator.sharding.spec
    made = _on_slabs(one, operator, (varying,), (own,), (own, PartitionSpec(None, *own)))
    return eqx.tree_at(lambda o: (o.varying, o.reference), operator, made, is_leaf=lambda x: x is None)


def _refuse(model: AbstractModel, families: Families) -> None:
    if not model.by_moments:
        raise ValueError(
            f"slab_force needs a model made of sums over single bonds (`moments`); {type(model).__name__} has none."
            " Evaluate it on one device with pd.force_operator"
        )
    if families.grid is None or families.grid.sites is not None:
        what = "families of a cloud or with bond weights" if families.grid is None else "a masked lattice"
        raise ValueError(
            f"slab_force needs a full lattice (pd.lattice without a mask); got {what}. Evaluate it on one device with"
            " pd.force_operator"
        )


def _slab_planes(planes: int, halo: int, devices: int) -> int:
    """Number of planes of one slab. Raises ValueError if the devices cannot divide the body."""
    able = [d for d in range(1, planes + 1) if planes % d == 0 and planes // d >= halo]
    would = f"numbers of devices that work: {', '.join(map(str, able)) or 'none (on one device use pd.force_operator)'}"
    if planes % devices:
        raise ValueError(
            f"the first axis of the body has {planes} planes, which {devices} devices cannot share equally; {would}"
        )
    if planes // devices < halo:
        raise ValueError(
            f"slabs of {planes // devices} planes ({planes} over {devices} devices) are thinner than the {halo} planes"
            f" that neighbouring slabs exchange (rings of the model × reach of the horizon); {would}"
        )
    return planes // devices


@public_function
def slab_force(model: AbstractModel, families: Families, mesh: Mesh) -> SlabForce:
    """Prepare the force density of a lattice body that is cut into slabs over the devices of a mesh.

    f_s = inner planes of f([H planes of u_{s−1} | u_s | H planes of u_{s+1}]),    H = rings · ⌊N⌋

    The body is cut along its first axis. Device s computes slab s, and neighbouring slabs exchange H planes of u.

    Parameters
    ----------
    model : AbstractModel
        A model made of moments, such as `SethHill`, `Correspondence`, `BondBased` or `LPS`.
    families : Families
        Families of a full `lattice`; those made with `arrays=False` suffice. The first axis should be the longest.
    mesh : jax.sharding.Mesh
        Devices. The first axis of the mesh counts.

    Returns
    -------
    SlabForce
        Function of u (points, dim) [length] that gives f (points, dim) [force/length^dim], equal to `force_density` to
        rounding. It works under `jax.jit`, `jax.grad`, `jax.jvp` and `jax.lax.scan`. Its attribute `sharding` is the
        sharding of its fields.

    Raises
    ------
    ValueError
        If the model has no moments, the body is not a full lattice, the number of devices does not divide the number of
        planes, or the slabs are thinner than H planes. The last two messages list the numbers of devices that work.

    Notes
    -----
    The module `pdjax.force.backends.slabs` shows dynamics, statics and several processes with slabs.

    Examples
    --------
    >>> mesh = jax.sharding.Mesh(jax.devices()[:1], ("slabs",))
    >>> families, model = pd.families(pd.lattice((5, 4)), horizon=2.1), pd.BondBased(1.0)
    >>> u = 0.01 * np.arange(40.0).reshape(20, 2)
    >>> f = pd.slab_force(model, families, mesh)
    >>> bool(np.allclose(f(u), pd.force_density(model, families, u)))
    True
    """
    check_model(model, families, Families)
    _refuse(model, families)
    mesh, _, devices = device_mesh(mesh)
    grid = families.grid
    assert grid is not None  # `_refuse` has required it
    reach = int(np.abs(np.array(grid.offsets).reshape(-1, families.dim))[:, 0].max(initial=0))
    halo = model.rings * max(reach, 1)
    planes = _slab_planes(grid.cells[0], halo, devices)
    traversal = _slab(families, (planes + 2 * halo, *grid.cells[1:]))
    varying, shared = split_model(model, len(families))
    bare = SlabForce(None, shared, None, traversal, families.horizon, mesh, planes, halo, grid.periodic[0])
    return _prepared(bare, jax.device_put(varying, bare.sharding))
