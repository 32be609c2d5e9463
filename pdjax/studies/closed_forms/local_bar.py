"""A bar of the classical (local) theory under uniform stress, for any law and any profile of the modulus.

    P(1 + e) = σ / c(x),   P = ∂ψ/∂F,   u(x) = ∫₀ˣ e dx,      c = E/E₀ the profile of the modulus

The solution is the branch that starts at the undeformed state. This branch ends where P has an extremum. For the St.
Venant–Kirchhoff law in compression that is e = 1/√3 − 1, P = −0.192 E₀. For the Hencky law in tension it is 1 + e = e
(Euler's number), P = E₀/e. Beyond the end there is no solution, and the result is NaN.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..._internal.implicit_step import implicit_root
from ...models.base import AbstractModel


def uniaxial_piola(model: AbstractModel, e) -> Float[Array, ""]:
    """P(1 + e) of the classical law of a 1D model [pressure]."""
    return jax.grad(lambda F: model.local_energy(F.reshape(1, 1)))(jnp.asarray(1.0 + e))


def _branch_end(model: AbstractModel, side) -> Float[Array, ""]:
    """The strain at which dP/de first vanishes on one side of rest; if none, the end of the range, −0.99 or 100."""
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
    """Compute the strain e of a 1D classical law under a given stress: P(1 + e) = stress.

    Parameters
    ----------
    model : AbstractModel
        A model with a classical law and scalar constants.
    stress : array, shape (...)
        First Piola–Kirchhoff stress [pressure].

    Returns
    -------
    array, shape (...)
        e [-] on the branch that starts at rest; NaN where that branch does not reach the stress. The first derivatives
        with respect to the stress and the model are exact.

    Examples
    --------
    St. Venant–Kirchhoff with E₀ = 1: P = (1 + e)(e + e²/2), which is 0.1155 at e = 0.1.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
    >>> round(float(pd.closed_forms.local_strain_of_stress(model, 0.1155)), 6)
    0.1
    """
    stress = jnp.asarray(stress, dtype=float)
    quiet = jax.lax.stop_gradient(model)
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
        # A stress out of reach gets the root 0 of the stress 0: its own steps diverge, and 0 · ∞ would enter gradients.
        within = jnp.where(reachable, target, 0.0)
        e = implicit_root(lambda x: uniaxial_piola(model, x) - within, e, order=3)  # The steps also improve its value.
        return jnp.where(reachable, e, jnp.nan)

    return jax.vmap(one)(stress.reshape(-1)).reshape(stress.shape)


@eqx.filter_jit
def singular_bar_local(model: AbstractModel, x, length, stress, alpha=10.0) -> tuple[Array, Array]:
    """Compute the nonlinear local solution of the singular bar: displacement and strain at x.

    P(1 + e) = σ E₀/E(x),   E₀/E(x) = 1 + α/(2√(x/L − ½)) beyond L/2, 1 before,   u(x) = ∫₀ˣ e dx

    Parameters
    ----------
    model : AbstractModel
        A 1D model of modulus E₀ with a classical law.
    x : array, shape (points,)
        Positions from the fixed end [length], increasing.
    length : float
        L [length].
    stress : float
        σ [pressure].
    alpha : float
        α of the profile of the modulus [-].

    Returns
    -------
    u : array, shape (points,)
        Displacement [length].
    e : array, shape (points,)
        Strain [-], NaN where no local solution exists.

    Notes
    -----
    Where no local solution exists, the displacement uses the strain at the end of the branch. This region
    lies next to L/2 and is narrower than (5σ/0.19E₀)² L.

    References
    ----------
    The profile of Breitenfeld et al. 2014, as in section 5.1 of Behzadinasab & Foster. The nonlinear solution is
    derived here.

    Examples
    --------
    Before L/2 the strain is uniform, here 0.1 (see `local_strain_of_stress`), and u = 0.1 x.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
    >>> u, e = pd.closed_forms.singular_bar_local(model, np.array([0.25]), 1.0, 0.1155)
    >>> round(float(u[0]), 6)
    0.025
    """
    x = jnp.asarray(x, dtype=float)
    square = jnp.maximum(x / length - 0.5, 0.0)  # t²
    beyond = square > 0
    softness = 1 + alpha / (2 * jnp.sqrt(jnp.where(beyond, square, 1.0)))
    end = _branch_end(jax.lax.stop_gradient(model), stress)

    # ∫ e dx = ∫ 2 t e dt, one panel between two points. The first panel starts at t = 0, where e grows fast;
    # there the variable of the quadrature is y with t = t₁ y³.
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
    # Where no solution exists, the displacement uses the strain at the end of the branch.
    e = jnp.where(jnp.isnan(found[: len(places)]), end, found[: len(places)])
    panel = (share / 2 * 2 * panels * e[: panels.size].reshape(panels.shape)).sum(axis=1) * width
    first_panel = jnp.sum(weight / 2 * 6 * y**2 * opening * e[panels.size :]) * start
    grown = jnp.cumsum(jnp.where(first, first_panel, panel)) * length
    return found[-1] * jnp.minimum(x, length / 2) + jnp.where(beyond, grown, 0.0), found[len(places) : -1]
