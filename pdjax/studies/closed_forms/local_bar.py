"""The bar of the classical (local) theory: uniform stress, whatever the law and its profile.

    P(1 + e) = σ / c(x),   P = ∂ψ/∂F,   u(x) = ∫₀ˣ e dx,      c = E/E₀ the modulus' profile

The branch is the one that leaves rest: it ends where P has an extremum (St. Venant–Kirchhoff in compression: e =
1/√3 − 1, P = −0.192 E₀; Hencky in tension: 1 + e = e, P = E₀/e), and beyond it there is no solution: NaN.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ...models.base import AbstractModel


def uniaxial_piola(model: AbstractModel, e) -> Float[Array, ""]:
    """P(1 + e) of a 1D model's classical law [pressure]."""
    return jax.grad(lambda F: model.local_energy(F.reshape(1, 1)))(jnp.asarray(1.0 + e))


def _branch_end(model: AbstractModel, side) -> Float[Array, ""]:
    """The strain at which P first turns on one side of rest (or the end of the range searched, −0.99 or 100)."""
    low, high = -np.geomspace(1e-4, 0.99, 600), np.geomspace(1e-4, 100.0, 600)
    e = jnp.where(side < 0, low, high)
    turned = jax.vmap(jax.grad(lambda x: uniaxial_piola(model, x)))(e) <= 0
    i = jnp.argmax(turned)
    slope = jax.grad(lambda x: uniaxial_piola(model, x))

    def halve(_, bracket):
        rising, falling = bracket
        middle = (rising + falling) / 2
        up = slope(middle) > 0
        return jnp.where(up, middle, rising), jnp.where(up, falling, middle)

    rising, _ = jax.lax.fori_loop(0, 50, halve, (jnp.where(i > 0, e[i - 1], 0.0), e[i]))
    return jnp.where(turned.any(), rising, e[-1])


@eqx.filter_jit
def local_strain_of_stress(model: AbstractModel, stress) -> Float[Array, "..."]:
    """e with P(1 + e) = stress, in 1D, on the branch from rest; NaN where there is none.

    Arguments: model with a classical law, scalar constants; stress (...) [pressure].
    Returns: (...) [-], with exact first derivatives in stress and model.
    """
    stress = jnp.asarray(stress, dtype=float)
    quiet: Any = jax.lax.stop_gradient(model)
    low, high = _branch_end(quiet, -1.0), _branch_end(quiet, 1.0)

    def one(target):
        frozen = jax.lax.stop_gradient(target)
        end = jnp.where(frozen < 0, low, high)
        most = uniaxial_piola(quiet, end)
        reachable = jnp.abs(frozen) < jnp.abs(most)
        aim = jnp.where(reachable & (frozen != 0), frozen, 0.5 * most)
        found: optx.Solution = optx.root_find(
            lambda t, _: uniaxial_piola(quiet, t * end) - aim,
            optx.Bisection(rtol=1e-12, atol=1e-13),  # type: ignore[call-arg]
            jnp.asarray(0.5, dtype=target.dtype),
            options={"lower": 0.0, "upper": 1.0},
            max_steps=80,
            throw=False,
        )
        e = jnp.where(reachable & (frozen != 0), found.value * end, 0.0)
        for _ in range(3):  # Newton from the root: polished to rounding, and the implicit function theorem
            slope = jax.grad(lambda x: uniaxial_piola(quiet, x))(jax.lax.stop_gradient(e))
            e = e - (uniaxial_piola(model, e) - target) / slope
        return jnp.where(reachable, e, jnp.nan)

    return jax.vmap(one)(stress.reshape(-1)).reshape(stress.shape)


@eqx.filter_jit
def singular_bar_local(model: AbstractModel, x, length, stress, alpha=10.0) -> tuple[Array, Array]:
    """Nonlinear local solution of the singular bar: displacement [length] and strain [-] at x.

    Arguments: model of modulus E₀ in 1D; x (points,) [length] from the fixed end, increasing; stress σ [pressure].
    Returns: (points,) each. Strain is NaN where no local solution exists; the displacement then takes the strain at the
        end of its branch there, over a region next to L/2 of width below (5σ/0.19E₀)² L.
    Source: the profile of Breitenfeld et al. 2014 as in section 5.1; the nonlinear solution is ours.
    """
    x = jnp.asarray(x, dtype=float)
    square = jnp.maximum(x / length - 0.5, 0.0)  # t²
    beyond = square > 0
    softness = 1 + alpha / (2 * jnp.sqrt(jnp.where(beyond, square, 1.0)))
    end = _branch_end(jax.lax.stop_gradient(model), stress)

    # ∫ e dx = ∫ 2 t e dt panel by panel, from point to point; the first one from 0 in y, t = t₁ y³, for e grows there
    t = jnp.sqrt(square)
    before = jnp.concatenate([jnp.zeros(1), t[:-1]])
    first = beyond & (before == 0)
    inner, share = np.polynomial.legendre.leggauss(12)
    left, width = jnp.where(first | ~beyond, 1.0, before), jnp.where(first | ~beyond, 0.0, t - before)
    panels = left[:, None] + width[:, None] * (inner + 1) / 2
    outer, weight = np.polynomial.legendre.leggauss(128)
    y = (outer + 1) / 2
    start = jnp.max(jnp.where(first, t, 0.0))
    opening = jnp.where(start > 0, start, 1.0) * y**3
    places = jnp.concatenate([panels.reshape(-1), opening])
    soft = jnp.concatenate([1 + alpha / (2 * places), jnp.where(beyond, softness, 1.0), jnp.ones(1)])
    found = local_strain_of_stress(model, stress * soft)
    e = jnp.where(jnp.isnan(found[: len(places)]), end, found[: len(places)])  # none there: the end of the branch
    panel = (share / 2 * 2 * panels * e[: panels.size].reshape(panels.shape)).sum(axis=1) * width
    first_panel = jnp.sum(weight / 2 * 6 * y**2 * opening * e[panels.size :]) * start
    grown = jnp.cumsum(jnp.where(first, first_panel, panel)) * length
    return found[-1] * jnp.minimum(x, length / 2) + jnp.where(beyond, grown, 0.0), found[len(places) : -1]
