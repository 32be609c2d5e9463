"""`pair_sum`, a JAX primitive: the sums of a pair program over all bonds of every point.

It has forward and reverse derivatives of every order, because the derivative of a sum over pairs is again a sum over
pairs (`pairs`), and batches one element after the other.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float

from .kernels import KERNELS
from .machine import register
from .pairs import PairProgram, tangent, transposed

primitive = core.Primitive("pair_sum")
primitive.multiple_results = True


def pair_sum(
    program: PairProgram, kind: str, geometry: Sequence, rows: list[Array], numbers: list[Array]
) -> list[Float[Array, " flat"]]:
    """Σ over the bonds of every point of what the program gives, one row for each sum.

    `kind` names the loop (`kernels.KERNELS`), and `geometry` are its arrays. `rows` (flat,) hold the numbers of the
    points, and `numbers` the vectors of shared numbers.
    """
    return primitive.bind(*rows, *numbers, *geometry, program=program, kind=kind)


def _split(program: PairProgram, operands: tuple) -> tuple[list, list, list]:
    """Operands as rows, vectors of shared numbers, and geometry."""
    a, b = program.rows, program.rows + len(program.numbers)
    return list(operands[:a]), list(operands[a:b]), list(operands[b:])


@primitive.def_abstract_eval
def _shapes(*operands, program, kind):
    rows, numbers, _ = _split(program, operands)
    other = [x.dtype for x in (*rows, *numbers) if x.dtype != np.float64]
    if other:  # the loops would write beyond the arrays
        raise ValueError(
            f"way='compiled' computes in float64 only; got {other[0]}. The operator was prepared in float64: call it"
            " with jax_enable_x64 switched on, or prepare it where it is called"
        )
    return [operands[0]] * program.outs if program.rows else []


@primitive.def_impl
def _evaluate(*operands, program, kind):
    with jax.disable_jit(False):  # the sum exists in compiled form only
        return jax.jit(functools.partial(primitive.bind, program=program, kind=kind))(*operands)


def _derivative(operands: tuple, changes: tuple, *, program: PairProgram, kind: str) -> tuple[list, list]:
    rows, numbers, geometry = _split(program, operands)
    d_rows, d_numbers, d_geometry = _split(program, changes)
    if any(type(x) is not ad.Zero for x in d_geometry):
        raise NotImplementedError(
            "way='compiled' has no derivatives in the geometry of a body (positions, volumes, weights). Differentiate"
            " in u, F or the model alone, or prepare the operator with way='slices' or way='families'"
        )
    out = pair_sum(program, kind, geometry, rows, numbers)
    some = tuple(k for k, x in enumerate(d_rows) if type(x) is not ad.Zero)
    few = tuple(k for k, x in enumerate(d_numbers) if type(x) is not ad.Zero)
    along = pair_sum(
        tangent(program, some, few),
        kind,
        geometry,
        [*rows, *(d_rows[k] for k in some)],
        [*numbers, *(d_numbers[k] for k in few)],
    )
    return out, along


def _transpose(weights: list, *operands: Any, program: PairProgram, kind: str) -> list:
    rows, numbers, geometry = _split(program, operands)
    some = tuple(k for k, x in enumerate(rows) if ad.is_undefined_primal(x))
    few = tuple(k for k, x in enumerate(numbers) if ad.is_undefined_primal(x))
    weights = [ad.instantiate_zeros(w) for w in weights]
    found = pair_sum(
        transposed(program, some, few),
        kind,
        geometry,
        [*(x for k, x in enumerate(rows) if k not in some), *weights],
        [x for k, x in enumerate(numbers) if k not in few],
    )
    answer: list = [None] * len(operands)
    for k, x in zip(some, found[: len(some)], strict=True):
        answer[k] = x
    at = len(some)
    for k in few:
        length = program.numbers[k]
        answer[program.rows + k] = jnp.stack([jnp.sum(x) for x in found[at : at + length]])
        at += length
    return answer


def _batch(operands: tuple, axes: tuple, *, program: PairProgram, kind: str) -> tuple[list, list]:
    moved = [jnp.moveaxis(x, a, 0) for x, a in zip(operands, axes, strict=True) if a is not None]

    def one(few):
        left = iter(few)
        whole = [x if a is None else next(left) for x, a in zip(operands, axes, strict=True)]
        return primitive.bind(*whole, program=program, kind=kind)

    out = jax.lax.map(one, moved)
    return out, [0] * len(out)


@functools.cache
def _target(program: PairProgram, kind: str) -> str:
    return register(KERNELS[kind](program))


def _lower(ctx: Any, *operands: Any, program: PairProgram, kind: str) -> Any:
    return jax.ffi.ffi_lowering(_target(program, kind))(ctx, *operands)


ad.primitive_jvps[primitive] = _derivative
ad.primitive_transposes[primitive] = _transpose
batching.primitive_batchers[primitive] = _batch
mlir.register_lowering(primitive, _lower, platform="cpu")
