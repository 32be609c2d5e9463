"""The Jacobian of a body by five methods: error against wall time.

    central difference   (f(u + h e) − f(u − h e))/2h, column by column, h from 1e-1 to 1e-8 spacings
    complex step         Im f(u + i h e)/h, h = 1e-30, without cancellation
    dense jacfwd         forward differentiation of every column
    coloured JVP         forward differentiation of groups of columns that share no row
    structured           pdjax.jacobian, from the two functions that define the model

The model is Silling's with λ = μ = 1 (St. Venant–Kirchhoff). Its force is a polynomial of degree 3 in u. The five-point
difference with a step of a quarter spacing therefore has no truncation error. It is the reference: exact to rounding,
and independent of every method.

The complex step needs a force that accepts complex numbers. It uses the same model with its stress written out,
P = F (λ tr(E) I + 2 μ E). It does not apply to models whose stress comes from `jax.grad`, which are all models with a
law, because `jax.grad` refuses complex numbers. It does not apply to norms and absolute values of bonds either, because
they are not complex-differentiable.
"""

from collections.abc import Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ..force.fields import whole_force
from ..force.operator import force_density
from ..geometry import neighbour_search
from ..geometry.points import lattice
from ..models import Correspondence
from ..models.kinematics import gradient_of_moments, solve_positive
from ..models.laws import LinearElastic
from ..tangent.coloring import coloured_jacobian
from ..tangent.jacobian import jacobian
from .chart import error_against_time
from .harness import Case, Task, hosted, kernel

STEPS = tuple(10.0**-k for k in range(1, 9))  # [spacing]
BATCH = 16  # columns at once


class WrittenOut(Correspondence):
    """Silling's model of a linear law with its stress in closed form, a polynomial that accepts complex numbers."""

    law: LinearElastic

    def law_state(self, sums):
        H = gradient_of_moments(sums.reference, sums.deformed)
        E = (H + H.T + H.T @ H) / 2
        S = self.law.lam * jnp.trace(E) * jnp.eye(H.shape[0]) + 2 * self.law.mu * E
        P = (jnp.eye(H.shape[0]) + H) @ S
        return solve_positive(sums.reference, P.T).T


def columns(one, size: int):
    """Compute the matrix whose column i is one(e_i), BATCH columns at a time."""
    return jax.lax.map(lambda i: one(jnp.zeros(size).at[i].set(1.0)), jnp.arange(size), batch_size=BATCH).T


def central(force, u, h):
    """Compute all columns by central differences."""
    shape = u.shape
    return columns(
        lambda e: ((force(u + h * e.reshape(shape)) - force(u - h * e.reshape(shape))) / (2 * h)).ravel(), u.size
    )


def five_point(force, u, h=0.25):
    """Compute all columns by five-point differences, which are exact for polynomials of degree 4."""
    return (4 * central(force, u, h) - central(force, u, 2 * h)) / 3


def complex_step(force, u, h=1e-30):
    """Compute all columns as Im f(u + i h e)/h."""
    return columns(lambda e: (force(u + 1j * h * e.reshape(u.shape)).imag / h).ravel(), u.size)


def plan(quick: bool) -> Iterator[Task]:
    """Plan every method on a plate and on a block."""
    law = LinearElastic(lam=1.0, mu=1.0)  # type: ignore[call-arg, arg-type]
    model, polynomial = Correspondence(law), WrittenOut(law)
    for shape, horizon in (((10, 9), 2.01), ((4, 4, 3), 2.01)) if quick else (((24, 23), 3.015), ((9, 8, 7), 2.01)):
        yield from _body(model, polynomial, shape, horizon, STEPS[::3] if quick else STEPS)


def _body(model, polynomial, shape: tuple[int, ...], horizon: float, steps) -> Iterator[Task]:
    """Plan every method on one lattice, displaced at random by at most 2 % of the spacing."""
    families = neighbour_search.families(lattice(shape), horizon)
    u = jnp.asarray(0.02 * np.random.default_rng(7).uniform(-1, 1, (len(families), families.dim)))
    body = {"body": " × ".join(map(str, shape)), "horizon": horizon, "unknowns": u.size}
    known: list[np.ndarray] = []

    def force(w):
        return force_density(model, families, w)

    def error(J) -> float:
        if not known:
            known.append(np.asarray(jax.jit(lambda u: five_point(force, u))(u)))
        J = np.asarray(J) if hasattr(J, "devices") else J.toarray()
        return float(np.abs(J - known[0]).max() / np.abs(known[0]).max())

    def differences(h):
        J, row = kernel(lambda u, h: central(force, u, h), u, jnp.asarray(h), repeats=3)
        return row | {"error": error(J)}

    def imaginary():
        written = lambda w: whole_force(polynomial, families, families.bonds(w))  # noqa: E731
        J, row = kernel(lambda u: complex_step(written, u), u, repeats=3)
        return row | {"error": error(J)}

    def dense():
        J, row = kernel(lambda u: jax.jacfwd(force)(u).reshape(u.size, u.size), u, repeats=3)
        return row | {"error": error(J)}

    def sparse(make):
        J, row = hosted(lambda: make(model, families, u))
        return row | {"error": error(J), "nonzeros": int(J.nnz)}

    for h in steps:
        yield Task("central difference", {**body, "step": h}, partial(differences, h))
    yield Task("complex step", body, imaginary)
    yield Task("dense jacfwd", body, dense)
    yield Task("coloured JVP", body, partial(sparse, coloured_jacobian))
    yield Task("structured", body, partial(sparse, jacobian))


def draw(rows: list[dict]):
    """Draw a panel for each body. The numbers are steps in spacings."""
    return error_against_time(
        rows,
        "Jacobian of a body",
        "largest error over largest entry  [–]",
        note=lambda row: f"{row['step']:.0e}" if "step" in row else "",
        panel=lambda row: f"{row['body']} points, horizon {row['horizon']:g} spacings",
    )


CASE = Case("Jacobians: central differences, complex step, jacfwd, coloured JVP, structured", plan, draw)
