"""A user's own breaking criterion: a function of one bond and of the states of its two ends."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from ...geometry.bonds import EACH_BOND, Bonds, Families
from ...models.base import AbstractModel
from ...models.pointwise import each_point, none_if_empty, regular, split_model
from .criteria import Criterion

METHODS = ("strain", "stress")


class BreakingRule(Criterion):
    """Breaking criterion of your own: `function(bond, here, there)` says whether one bond breaks.

    A bond breaks if the function is true for one of its two ends.

    Parameters
    ----------
    function : callable
        Function of one bond, with .xi (dim,), .eta (dim,), .omega, .volume, .horizon, and of the states of its two
        ends. It returns one bool, computed with jax.numpy.
    states : "strain" or "stress" or callable, optional
        State of a point that the function gets as `here` and `there`: the model's strain (dim, dim) [-], its stress
        (dim, dim) [pressure], or the result of your function (model, bonds of the family) → array or tree of arrays.
        Default: both are None.
    no_fail : array of bool, shape (points,) or (points, bonds), optional
        Points whose bonds never break, or bonds that never break.

    Raises
    ------
    ValueError
        If `function` cannot be called or `states` is another word. `broken` raises it if the function does not return
        one bool.

    Examples
    --------
    The strain of a plate grows along x. A bond breaks where the mean of the strains of its ends has a trace above 6 %:

    >>> def opens(bond, here, there):
    ...     return jnp.trace(here + there) / 2 > 0.06
    >>> body = pd.lattice((5, 4))
    >>> families, model = pd.families(body, horizon=2.1), pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> u = 0.01 * body.positions**2 * [1, 0]
    >>> broken = pd.BreakingRule(opens, states="strain").broken(model, families, u)
    >>> int(broken.sum()) // 2, int(families.is_bond.sum()) // 2
    (24, 77)
    """

    function: Any  # (bond, here, there) → bool
    states: Any = None

    def __check_init__(self):
        if not callable(self.function):
            raise ValueError(f"function must be a function (bond, here, there) → bool; got {self.function!r}")
        if not (self.states is None or callable(self.states) or self.states in METHODS):
            raise ValueError(
                f"states must be 'strain', 'stress', a function (model, bonds) → state, or None; got {self.states!r}"
            )

    def _states(self, model: AbstractModel, bonds: Bonds) -> PyTree:
        if self.states is None:
            return None
        if isinstance(self.states, str):
            return each_point(self.states, model, bonds)
        full, empty = regular(bonds)
        varying, shared = split_model(model, bonds.xi.shape[0])
        of = self.states
        return none_if_empty(jax.vmap(lambda mine, b: of(eqx.combine(mine, shared), b))(varying, full), empty)

    def exceeded(self, model: AbstractModel, families: Families, bonds: Bonds) -> Bool[Array, "points bonds"]:
        here = self._states(model, bonds)
        there = jax.tree.map(lambda x: x[families.neighbours], here)

        def one(bond: Bonds, here: PyTree, there: PyTree) -> Array:
            try:
                value = jnp.asarray(self.function(bond, here, there))
            except Exception as error:
                raise ValueError(
                    f"the function (bond, here, there) of BreakingRule failed: {type(error).__name__}: {error}. It must"
                    " use jax.numpy and no Python `if` on values; here and there are None unless states= is given"
                ) from error
            if value.shape != () or value.dtype != bool:
                raise ValueError(
                    f"the function of BreakingRule must return one bool for one bond; got shape {value.shape} of"
                    f" {value.dtype}"
                )
            return value

        return jax.vmap(jax.vmap(one, (EACH_BOND, None, 0)))(bonds, here, there)
