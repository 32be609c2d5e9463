"""The backend "compiled": loops over the bonds as machine code, which LLVM makes from the formulas of a model.

It needs the package llvmlite (`pip install "pdjax[compiled]"`), a CPU and float64. It serves models made of moments on
bodies that are not traced. A model is written once, in JAX. Its functions of one bond are traced to scalar programs,
and each scalar becomes a vector that holds one number of several points. There is no code of its own for any model.

The modules, in the order in which to read them:

    pairs         what a pair of points contributes to the sums of both, and the derivatives of that
    model_pairs   the pair programs of a model, and its forces by two sums over pairs
    pair_sum      a sum over all pairs as a JAX primitive, with derivatives of every order
    layouts       how the points and bonds of a body lie in memory
    kernels       the loops over bonds, made for a pair program
    loops         loads, stores and loops of LLVM functions
    emit          programs of scalars as vector instructions
    handler       the function that XLA calls, and how its threads share the work
    machine       machine code of this processor

This file holds the backend itself. It imports the others only when they are used, because they need llvmlite.
"""

import functools
import importlib.util
import sys
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...._internal.checks import is_concrete
from ...._internal.memory import remember
from ...._internal.xla import ONCE, compiled_with
from ....geometry.bonds import Families
from ....models.base import AbstractModel, PointStateModel
from ..backend import Backend, lattice_refusal
from ..point_states import kept_reference

INSTALL = 'it needs the package llvmlite; install it with: pip install "pdjax[compiled]"'


class Compiled(Backend):
    """The layout of a body, together with the sums over its reference configuration."""

    quick: ClassVar[bool] = True  # little is left for XLA to compile

    layout: Any  # a `compiled.layouts.Layout`, whose module needs llvmlite
    reference: list[Array]  # rows (flat,)
    horizon: Array

    def _pairs(self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None) -> Any:
        from .model_pairs import ModelPairs

        gradient = None if F is None else F - jnp.eye(u.shape[1], dtype=u.dtype)
        return ModelPairs(model, len(u), self.layout, self.horizon, gradient)

    def energy(
        self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None
    ) -> Float[Array, " points"] | None:
        """W of every point, if it is a function of the sums over the family; see `Backend.energy`."""
        return self._pairs(model, u, F).energies(self.reference, u)

    def force(self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None) -> Float[Array, "points dim"]:
        """f of every point; see `Backend.force`."""
        return self._pairs(model, u, F).force(self.reference, u)


@functools.cache
def unavailable() -> str | None:
    """Why this machine cannot use the backend, or None if it can."""
    if importlib.util.find_spec("llvmlite") is None:
        return INSTALL
    from .handler import functions

    if sys.platform == "win32" or "XLA_FFI_ThreadPool_Schedule" not in functions()[0]:
        return "this operating system or version of jaxlib has no interface for compiled loops"
    return None


def states_of_lattice(
    model: PointStateModel, dim: int, sums: tuple[Array, Array], horizon: Array
) -> list[Array] | None:
    """The point states of a lattice of one material from both sums (entries, points), or None if XLA must make them."""
    points = sums[0].shape[1]
    if unavailable() or jax.default_backend() != "cpu" or sums[1].dtype != np.float64 or not len(sums[0]):
        return None
    from .emit import NotVectorised
    from .layouts import Blank
    from .machine import target
    from .model_pairs import ModelPairs

    if points < target()[1]:
        return None
    try:
        pairs = ModelPairs(model, -1, Blank.of(dim, points, True), horizon, None)
        return pairs.states(*(list(x) for x in sums))[2]
    except NotVectorised:
        return None


def refusal(model: AbstractModel, families: Families) -> str | None:
    """Why this backend cannot evaluate this model and body, or None if it can."""
    why = unavailable()
    if why:
        return why
    if jax.default_backend() != "cpu":
        return f"it computes on CPUs, and JAX computes on {jax.default_backend()!r} here"
    if not model.by_moments:
        return f"{type(model).__name__} has no point state made of sums over single bonds"
    if not is_concrete(families):
        return "the families are traced"
    if families.dtype != np.float64:
        return f"it computes in float64, and the families are in {families.dtype}"
    if families.intact is not None:
        return "some of its bonds are broken"
    if families.xi is None and lattice_refusal(model, families):
        return "the families were made with arrays=False"
    return _unserved(model, families)


def _unserved(model: AbstractModel, families: Families) -> str | None:
    """Why the formulas of a model cannot be translated, or None if they can. Their values do not matter."""
    from .emit import NotVectorised
    from .layouts import Blank
    from .model_pairs import ModelPairs

    leaves = jax.tree.leaves(eqx.filter(model, eqx.is_array))
    kinds = [x.dtype for x in leaves if not jnp.issubdtype(x.dtype, jnp.floating)]
    if kinds:
        return f"{type(model).__name__} has constants of the type {kinds[0]}, and it computes with real numbers only"
    why: list[str | None] = []

    def trace(model: AbstractModel) -> None:
        layout = Blank.of(families.dim, 1, lattice_refusal(model, families) is None)
        horizon = jnp.ones((1,) * families.horizon.ndim, families.dtype)
        why.append(ModelPairs(model, len(families), layout, horizon, None).unserved())

    try:
        eqx.filter_eval_shape(trace, model)
    except NotVectorised as error:
        why.append(str(error))
    return why[0] and f"{type(model).__name__} uses {why[0]}, which has no vector instruction"


def _reference(model: AbstractModel, layout: Any, horizon: Array, points: int) -> list[Array]:
    from .model_pairs import ModelPairs

    return ModelPairs(model, points, layout, horizon, None).reference()


_reference_of_traced, _reference_of_known = eqx.filter_jit(_reference), compiled_with(ONCE)(_reference)


def prepare(model: AbstractModel, families: Families) -> Backend:
    """The backend for these families."""
    from .layouts import CloudBonds, LatticePairs

    kind = CloudBonds if lattice_refusal(model, families) else LatticePairs
    layout = remember(families, ("layout", kind.kind), lambda: kind.of(families))
    with jax.ensure_compile_time_eval():  # the reference sums are kept, so they must not depend on a user's trace
        horizon = jnp.asarray(families.horizon)
        horizon = layout.embed(horizon[:, None])[0] if horizon.ndim else horizon
    assert isinstance(model, PointStateModel)
    points = len(families)
    reference = kept_reference(
        model,
        families,
        kind.kind,
        # A known order of a strain makes the program shorter, although the reference sums do not depend on it.
        lambda known: _reference_of_known(known.specialised(), layout, horizon, points),
        lambda traced: _reference_of_traced(traced, layout, horizon, points),
    )
    return Compiled(layout, reference, horizon)
