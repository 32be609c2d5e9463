"""The checks that `test_slabs.py` runs in separate processes, because the number of devices is fixed when JAX starts.

`python on_devices.py` uses the devices that XLA_FLAGS simulates on the host, and prints its results as JSON.
`python on_devices.py RANK PORT` is one of two processes with one device each, and prints its results as JSON too.
"""

import json
import re
import sys

import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd
from pdjax.force.fields import whole_force

COLLECTIVES = ("collective-permute", "all-gather", "all-reduce", "all-to-all")


def law():
    """The law, made in a function because it holds arrays, and `jax.distributed.initialize` must come before these."""
    return pd.LinearElastic(1.3, 0.9)


def relative(a, b):
    a, b = np.asarray(a), np.asarray(b)
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def plate(periodic=False, planes=16):
    body = pd.lattice((planes, 5), 0.5, periodic=periodic)
    fams = pd.families(body, 1.01, pd.gaussian_influence)
    u = 0.02 * np.random.default_rng(1).normal(size=body.positions.shape)
    return body, fams, u


def general(model, fams, u):
    """The forces of the general path: all bonds at once, on one device."""
    return whole_force(model, fams, fams.bonds(jnp.asarray(u)))


def collectives(function, *arguments):
    text = jax.jit(function).lower(*arguments).compile().as_text()
    return {name: len(re.findall(name + r"(?:-start)?\(", text)) for name in COLLECTIVES}


def forces(mesh):
    """The error of the slabs against the general path, for every kind of body and model."""
    order = np.repeat(np.linspace(-1, 1, 16), 5)  # it varies from plane to plane
    cases = {
        "periodic": (pd.BondBased(1.0), (True, False)),
        "graded": (pd.graded(pd.SethHill(order, law()), 2 + order), False),
    }
    out = {}
    for name, (model, periodic) in cases.items():
        _, fams, u = plate(periodic)
        out[name] = relative(pd.slab_force(model, fams, mesh)(u), general(model, fams, u))
    body = pd.lattice((12, 3, 4), 0.5)
    lean, fams = (pd.families(body, 0.75, arrays=arrays) for arrays in (False, True))
    u = 0.02 * np.random.default_rng(2).normal(size=body.positions.shape)
    model = pd.LPS(1.3, 0.9)
    explicit = jax.make_mesh((2, 2), ("slabs", "rest"))
    out["3D, two axes of the mesh"] = relative(pd.slab_force(model, lean, explicit)(u), general(model, fams, u))
    return out


def derivatives(f, fams, u):
    """The error of gradients with respect to u and a constant of the law, against the general path."""

    def on_slabs(u, mu):
        moved = pd.slab_force(pd.Correspondence(pd.LinearElastic(1.3, mu)), fams, f.mesh)
        return jnp.sum(moved(u) ** 2)

    def on_one(u, mu):
        return jnp.sum(general(pd.Correspondence(pd.LinearElastic(1.3, mu)), fams, u) ** 2)

    found, expected = (jax.grad(g, (0, 1))(jnp.asarray(u), 0.9) for g in (on_slabs, on_one))
    return max(relative(a, b) for a, b in zip(found, expected, strict=True))


def dynamics(f, model, fams, u):
    """50 steps of velocity Verlet with slabs: the error against the general path, and whether u stays sharded."""

    def verlet(force, u, dt=0.05, steps=50):
        def step(state, _):
            u, v, a = state
            u = u + dt * v + dt**2 / 2 * a
            after = force(u)
            return (u, v + dt / 2 * (a + after), after), None

        return jax.lax.scan(step, (u, jnp.zeros_like(u), force(u)), length=steps)[0]

    found = jax.jit(lambda u: verlet(f, u))(jax.device_put(u, f.sharding))[0]
    expected = jax.jit(lambda u: verlet(lambda x: general(model, fams, x), u))(jnp.asarray(u))[0]
    return relative(found, expected), found.sharding.is_equivalent_to(f.sharding, 2)


def statics(f, model, fams, body):
    """Newton steps with conjugate gradients for a plate that is held at its left and pulled at its right.

    Returns the residual of the general path relative to the load, and the largest displacement.
    """
    X = body.positions
    free = jax.device_put((X[:, :1] > 0.9) * np.ones(2), f.sharding)
    load = jax.device_put((X[:, :1] > 7.1) * np.array([0.02, 0.01]), f.sharding)

    @jax.jit
    def newton(u):
        def stiffness(v):
            return -free * jax.jvp(f, (u,), (free * v,))[1] + (1 - free) * v

        return u + jax.scipy.sparse.linalg.cg(stiffness, free * (f(u) + load), tol=1e-10, maxiter=400)[0]

    u = jnp.zeros_like(load)
    for _ in range(6):
        u = newton(u)
    at_rest = np.asarray(free) * np.asarray(general(model, fams, np.asarray(u)) + np.asarray(load))
    return float(np.abs(at_rest).max() / np.abs(np.asarray(load)).max()), float(np.abs(np.asarray(u)).max())


def sweeps(mesh):
    grid = dict(m=np.linspace(-2, 2, 5), a=np.linspace(-0.3, 0.3, 3), N=2, law=law(), criterion="block")
    one, many = (pd.stability_map(**grid, show_progress=False, mesh=m) for m in (None, mesh))
    eigenvalues = pd.sharded_vmap(lambda x: jnp.linalg.eigvalsh(x + x.T), mesh)
    batch = jnp.asarray(np.random.default_rng(3).normal(size=(7, 3, 3)))  # 7 states on 4 devices: 2 each
    shares = re.findall(r"f64\[(\d),3,3\][^=]*custom-call", eigenvalues.lower(batch).compile().as_text())
    return {
        "map": relative(many.margin, one.margin),
        "eigenvalues": relative(eigenvalues(batch), np.linalg.eigvalsh(np.asarray(batch + batch.mT))),
        "shares": sorted({int(x) for x in shares}),
    }


def refusals(mesh):
    """The messages of all errors."""
    lattice = pd.lattice((12, 4))
    fams = {
        "not equal": pd.families(pd.lattice((18, 4)), 2.0),
        "thin": pd.families(lattice, 2.0),
        "nobody": pd.families(pd.lattice((7, 4)), 2.0),
        "mask": pd.families(pd.lattice((12, 4), mask=np.arange(48).reshape(12, 4) != 17), 2.0),
        "cloud": pd.families(pd.cloud(lattice.positions, 1.0), 2.0),
        "no moments": pd.families(lattice, 2.0),
        "no mesh": pd.families(lattice, 2.0),
        "shape": pd.families(pd.lattice((16, 4)), 2.0),
        "nan": pd.families(pd.lattice((16, 4)), 2.0),
    }
    out = {}
    for name, families in fams.items():
        model = pd.BondLevelAverage(law()) if name == "no moments" else pd.Correspondence(law())
        u = np.full((64, 3 if name == "shape" else 2), np.nan)
        try:
            pd.slab_force(model, families, "cpu" if name == "no mesh" else mesh)(u)
        except ValueError as error:
            out[name] = str(error)
    try:
        pd.sharded_vmap(jnp.add, mesh)(np.zeros(3), np.zeros(2))
    except ValueError as error:
        out["lengths"] = str(error)
    return out


def one_process():
    mesh = jax.sharding.Mesh(jax.devices(), ("slabs",))
    model = pd.Correspondence(law())
    body, fams, u = plate()
    f = pd.slab_force(model, fams, mesh)
    drift, stays = dynamics(f, model, fams, u)
    residual, moved = statics(f, model, fams, body)
    return {
        "devices": len(jax.devices()),
        "forces": {"plate": relative(f(u), general(model, fams, u)), **forces(mesh)},
        "collectives": collectives(lambda u: f(u), jax.device_put(u, f.sharding)),
        "gradient": derivatives(f, fams, u),
        "verlet": drift,
        "verlet stays sharded": stays,
        "residual": residual,
        "moved": moved,
        "sweeps": sweeps(mesh),
        "refusals": refusals(mesh),
    }


def one_of_two(rank, port):
    from jax.experimental.multihost_utils import process_allgather

    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    jax.distributed.initialize(f"localhost:{port}", num_processes=2, process_id=rank)
    mesh = jax.sharding.Mesh(jax.devices(), ("slabs",))
    model = pd.Correspondence(law())
    _, fams, u = plate()
    f = pd.slab_force(model, fams, mesh)
    u_slabs = jax.device_put(u, f.sharding)
    found = process_allgather(f(u_slabs), tiled=True)
    doubled = pd.sharded_vmap(lambda x: 2 * x, mesh)(np.arange(3.0))
    return {
        "devices": len(jax.devices()),
        "own points": u_slabs.addressable_shards[0].data.shape[0],
        "force": relative(found, general(model, fams, u)),
        "doubled": np.asarray(doubled).tolist(),
    }


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    print(json.dumps(one_of_two(*map(int, sys.argv[1:])) if len(sys.argv) > 1 else one_process()))
