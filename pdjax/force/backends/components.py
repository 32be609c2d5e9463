"""A function of small arrays, evaluated for many points at once as plain arithmetic on long arrays.

A model is written for one bond, in vectors and small matrices. `jax.vmap` of it gives arrays whose last axis has length
3, and small batched matrix products. XLA needs 10 to 60 ns a bond for these on a CPU.

This module traces the function once for one point and then carries out each operation on *components*. The components
of an array of shape (3, 3) are a NumPy object array of nine entries. Each entry is a JAX array over the points, or a
number that all points share. Elementwise operations then run over contiguous memory, and XLA can fuse them. Products
with the zeros and ones of constant tensors are dropped.

Operations that only move entries are replayed on an array of indices. Every other operation is evaluated by stacking
its operands, `jax.vmap`, and splitting the result again. The result is therefore correct for every function, and fast
for the arithmetic of which models consist.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jax.tree_util import PyTreeDef
from jax.typing import DTypeLike
from jaxtyping import PyTree

Components = np.ndarray  # its entries are JAX arrays over the points, 0-d JAX arrays, or NumPy scalars
Entry = jax.Array | np.ndarray | np.generic | float

_MOVES = {"broadcast_in_dim", "reshape", "slice", "squeeze", "transpose", "rev", "copy", "expand_dims"}
_MOVES_MANY = {"concatenate", "split", "pad", "stack"}
_PRICES = {
    "exp": 8,
    "log": 16,
    "log1p": 20,
    "expm1": 16,
    "pow": 30,
    "div": 5,
    "sqrt": 5,
    "sin": 20,
    "cos": 20,
    "tanh": 10,
}
DEAR = 25.0  # the cost, in operations, from which an entry counts as expensive: about 3 ns a point
_ELEMENTWISE = set(
    "abs acos asin atan atan2 cbrt ceil cos cosh erf exp exp2 expm1 floor log log1p max min neg not pow rem round rsqrt"
    " sign sin sinh sqrt square tan tanh integer_pow convert_element_type is_finite eq ne lt le gt ge and or xor"
    " div sub mul add add_any select_n clamp stop_gradient".split()
)
_REDUCTIONS: dict[str, Any] = {
    "reduce_sum": None,
    "reduce_prod": None,
    "reduce_max": jnp.maximum,
    "reduce_min": jnp.minimum,
    "reduce_and": jnp.logical_and,
    "reduce_or": jnp.logical_or,
}
_ON_HOST: dict[str, Callable] = {
    "add": np.add,
    "add_any": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "abs": np.abs,
    "max": np.maximum,
    "min": np.minimum,
    "sqrt": np.sqrt,
    "square": np.square,
    "integer_pow": lambda x, *, y: x**y,
    "eq": np.equal,
    "ne": np.not_equal,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "and": np.bitwise_and,
    "or": np.bitwise_or,
    "not": np.invert,
    "select_n": lambda which, *cases: cases[int(which)],
    "convert_element_type": lambda x, *, new_dtype, **_: np.asarray(x).astype(new_dtype),
    "stop_gradient": lambda x: x,
}
_TOLD = {"integer_pow", "convert_element_type"}
_INLINED = {"jit", "pjit", "closed_call", "core_call", "custom_lin"}


def split(x: jax.Array | np.ndarray, batched: bool = True) -> Components:
    """(…, points) → components (…) over the points. If not batched, (…) → numbers that all points share."""
    shape = x.shape[:-1] if batched else np.shape(x)
    out = np.empty(shape, dtype=object)
    known = not batched and not isinstance(x, jax.core.Tracer) and not isinstance(x, jax.Array)
    for at in np.ndindex(*shape):
        out[at] = np.asarray(x)[at] if known else x[at] if shape else x
    return out


def join(x: Components, points: int) -> jax.Array:
    """Components (…) → (…, points)."""
    rows = [jnp.broadcast_to(entry, (points,)) for entry in x.reshape(-1)]
    return jnp.stack(rows).reshape((*x.shape, points)) if x.ndim else rows[0]


def _known(entry: Entry) -> bool:
    return isinstance(entry, np.generic | bool | int | float)


def _is(entry: Entry, value: float) -> bool:
    return bool(_known(entry) and entry == value)


def _simplified(name: str, a: Entry, b: Entry) -> Entry | None:
    """The result of an operation if a constant 0 or 1 makes it equal to one operand, else None."""
    if name == "mul":
        if _is(a, 0) or _is(b, 1):
            return a
        if _is(b, 0) or _is(a, 1):
            return b
    elif name in ("add", "add_any"):
        if _is(a, 0):
            return b
        if _is(b, 0):
            return a
    elif (name == "sub" and _is(b, 0)) or (name == "div" and (_is(a, 0) or _is(b, 1))):
        return a
    return None


def _bind(primitive: core.Primitive, params: dict, entries: list) -> Entry:
    """One elementwise primitive on entries. Constants are computed on the host, everything else over the points."""
    if all(_known(e) for e in entries):
        if primitive.name in _ON_HOST and (primitive.name != "div" or np.asarray(entries[0]).dtype.kind in "fc"):
            with np.errstate(all="ignore"):
                told = params if primitive.name in _TOLD else {}  # other params only repeat the dtypes
                return np.asarray(_ON_HOST[primitive.name](*map(np.asarray, entries), **told))[()]
        with jax.ensure_compile_time_eval():  # this compiles a program, but it is rarely needed
            return np.asarray(primitive.bind(*map(jnp.asarray, entries), **params))[()]
    entries = [jnp.asarray(e) for e in entries]
    shape = jnp.broadcast_shapes(*(e.shape for e in entries))
    return primitive.bind(*(jnp.broadcast_to(e, shape) for e in entries), **params)


def _elementwise(eqn: Any, operands: list[Components], costs: "_Costs") -> Components:
    name, shape = eqn.primitive.name, eqn.outvars[0].aval.shape
    out = np.empty(shape, dtype=object)
    operands = [np.broadcast_to(x, shape) for x in operands]  # a primitive may stretch axes of length 1
    for at in np.ndindex(*shape):
        entries = [x[at] for x in operands]
        done = _simplified(name, *entries) if len(entries) == 2 else None
        if done is None:
            done = _bind(eqn.primitive, eqn.params, entries)
            costs.note(done, entries, _PRICES.get(name, 1))
        out[at] = done
    return out


def _indices(shape: tuple[int, ...], start: int = 0) -> np.ndarray:
    return np.arange(start, start + int(np.prod(shape)), dtype=np.int32).reshape(shape)


def _padded(x: np.ndarray, value: np.ndarray, padding_config: tuple) -> np.ndarray:
    """`jax.lax.pad`: add (before, behind, between) entries of `value` along every axis. Negative numbers cut off."""
    for axis, (before, behind, between) in enumerate(padding_config):
        count = x.shape[axis]
        shape = list(x.shape)
        first, length = max(before, 0), count + max(count - 1, 0) * between
        shape[axis] = first + length + max(behind, 0)
        out = np.full(shape, value)
        at: list[slice] = [slice(None)] * x.ndim
        at[axis] = slice(first, first + length, between + 1)
        out[tuple(at)] = x
        at[axis] = slice(max(-before, 0), shape[axis] - max(-behind, 0))
        x = out[tuple(at)]
    return x


def _spread(x: np.ndarray, shape: Sequence, broadcast_dimensions: Sequence) -> np.ndarray:
    """`jax.lax.broadcast_in_dim`."""
    axes = [x.shape[broadcast_dimensions.index(k)] if k in broadcast_dimensions else 1 for k in range(len(shape))]
    return np.broadcast_to(x.reshape(axes), shape)


_MOVED_ON_HOST: dict[str, Callable] = {
    "broadcast_in_dim": lambda x, shape, broadcast_dimensions, **_: _spread(x, shape, broadcast_dimensions),
    "reshape": lambda x, new_sizes, **_: x.reshape(new_sizes),
    "slice": lambda x, start_indices, limit_indices, strides: x[
        tuple(map(slice, start_indices, limit_indices, strides or [1] * x.ndim))
    ],
    "squeeze": lambda x, dimensions: np.squeeze(x, tuple(dimensions)),
    "transpose": lambda x, permutation: x.transpose(permutation),
    "rev": lambda x, dimensions: np.flip(x, tuple(dimensions)),
    "copy": lambda x: x,
    "concatenate": lambda *xs, dimension: np.concatenate(xs, dimension),
    "stack": lambda *xs, axis: np.stack(xs, axis),
    "split": lambda x, sizes, axis: np.split(x, np.cumsum(sizes)[:-1], axis),
    "pad": _padded,
}


def _moved(eqn: core.JaxprEqn, operands: list[Components]) -> list[Components]:
    """An operation that only moves entries, replayed on an array of their indices."""
    flat = np.concatenate([x.reshape(-1) for x in operands])
    starts = np.cumsum([0, *(x.size for x in operands[:-1])])
    numbers = [_indices(x.shape, int(s)) for x, s in zip(operands, starts, strict=True)]
    if eqn.primitive.name in _MOVED_ON_HOST:
        out = _MOVED_ON_HOST[eqn.primitive.name](*numbers, **eqn.params)
    else:
        with jax.ensure_compile_time_eval():  # this compiles a program, but it is rarely needed
            out = eqn.primitive.bind(*map(jnp.asarray, numbers), **eqn.params)
    results = out if eqn.primitive.multiple_results else [out]
    return [flat[np.asarray(r).reshape(-1)].reshape(r.shape) for r in results]


def _sum_of_products(rows: list[tuple], dtype: DTypeLike, costs: "_Costs") -> Entry:
    """The sum of products of entries in the given order, without the operations that a 0 or 1 makes unnecessary."""
    total: Entry = np.zeros((), dtype)[()]
    for factors in rows:
        term = factors[0]
        for factor in factors[1:]:
            done = _simplified("mul", term, factor)
            product = term * factor if done is None else done
            if done is None:
                costs.note(product, [term, factor], 1)
            term = product
        done = _simplified("add", total, term)
        after = total + term if done is None else done
        if done is None:
            costs.note(after, [total, term], 1)
        total = after
    return total


def _dot(a: Components, b: Components, dimension_numbers: tuple, dtype: DTypeLike, costs: "_Costs") -> Components:
    (ca, cb), (ba, bb) = dimension_numbers
    fa = [i for i in range(a.ndim) if i not in (*ca, *ba)]
    fb = [i for i in range(b.ndim) if i not in (*cb, *bb)]
    a, b = a.transpose((*ba, *fa, *ca)), b.transpose((*bb, *fb, *cb))
    batch, rows, columns = (
        a.shape[: len(ba)],
        a.shape[len(ba) : len(ba) + len(fa)],
        b.shape[len(bb) : len(bb) + len(fb)],
    )
    a = a.reshape(int(np.prod(batch)), int(np.prod(rows)), -1)
    b = b.reshape(int(np.prod(batch)), int(np.prod(columns)), -1)
    out = np.empty((len(a), a.shape[1], b.shape[1]), dtype=object)
    for g, i, j in itertools.product(*map(range, out.shape)):
        out[g, i, j] = _sum_of_products(list(zip(a[g, i], b[g, j], strict=True)), dtype, costs)
    return out.reshape((*batch, *rows, *columns))


def _reduced(eqn: Any, x: Components, costs: "_Costs") -> Components:
    axes = eqn.params["axes"]
    kept = [i for i in range(x.ndim) if i not in axes]
    rows = x.transpose((*kept, *axes)).reshape((*(x.shape[i] for i in kept), -1))
    out = np.empty(rows.shape[:-1], dtype=object)
    name, dtype = eqn.primitive.name, eqn.outvars[0].aval.dtype
    for at in np.ndindex(*out.shape):
        if name == "reduce_sum":
            out[at] = _sum_of_products([(e,) for e in rows[at]], dtype, costs)
        elif name == "reduce_prod":
            out[at] = _sum_of_products([tuple(rows[at])], dtype, costs)
        else:
            out[at] = functools.reduce(_REDUCTIONS[name], rows[at])
    return out


def _batched(eqn: Any, operands: list[Components]) -> list[Components]:
    """Any other operation: stack the components, batch the operation by `jax.vmap`, and split its result."""
    given = {v: x for v, x in zip(eqn.invars, operands, strict=True) if not isinstance(v, core.Literal)}
    lengths = [np.shape(e) for x in given.values() for e in x.reshape(-1) if np.ndim(e)]
    points = max((n[0] for n in lengths), default=None)

    def alone(*values: jax.Array) -> list:
        known = dict(zip(given, values, strict=True))
        read = [v.val if isinstance(v, core.Literal) else known[v] for v in eqn.invars]
        bound = eqn.primitive.get_bind_params(eqn.params)  # versions of JAX before 0.10 return a pair
        functions, settings = bound if isinstance(bound, tuple) else ((), bound)
        result = eqn.primitive.bind(*functions, *read, **settings)
        return result if eqn.primitive.multiple_results else [result]

    if points is None:  # all operands are shared by the points
        shared = [
            jnp.stack(list(x.reshape(-1))).reshape(x.shape) if x.ndim else jnp.asarray(x[()]) for x in given.values()
        ]
        return [split(y, False) for y in alone(*(x.astype(v.aval.dtype) for v, x in zip(given, shared, strict=True)))]
    arrays = [join(x, points).astype(v.aval.dtype) for v, x in given.items()]
    return [split(y) for y in jax.vmap(alone, -1, -1)(*arrays)]


def _fans(jaxpr: Any) -> dict:
    """How often later operations read an entry of each variable.

    An operation that only moves entries does not count as a reader. Its own readers count instead.
    """
    fans = {v: 0.0 for v in jaxpr.invars}
    for v in jaxpr.outvars:
        if not isinstance(v, core.Literal):
            fans[v] = fans.get(v, 0.0) + 1
    for eqn in reversed(jaxpr.eqns):
        if not eqn.outvars:  # it prints, for example
            continue
        name, out = eqn.primitive.name, eqn.outvars[0]
        moves = name in _MOVES or name in _MOVES_MANY
        for v in eqn.invars:
            if isinstance(v, core.Literal):
                continue
            spread = max(1.0, out.aval.size / max(1, v.aval.size)) if moves or name in _ELEMENTWISE else 1.0
            if name == "dot_general":
                spread = max(1.0, out.aval.size / max(1, v.aval.size))
            fans[v] = fans.get(v, 0.0) + spread * (fans.get(out, 0.0) if moves else 1.0)
    return fans


class _Costs:
    """The cost of computing each entry again, in operations, and the trick that makes XLA store expensive entries.

    On a CPU, XLA computes an intermediate again in every kernel that reads it, unless its last operation is one that
    XLA considers expensive, such as a division. An entry that is expensive and read more than once is therefore divided
    by `one`, an input whose value is 1.
    """

    def __init__(self, one: jax.Array | None, inputs: dict[int, float]):
        self.one, self.of = one, inputs

    def note(self, entry: Entry, operands: list, own: float) -> None:
        self.of[id(entry)] = own + sum(self.of.get(id(x), 0.0) for x in operands)

    def kept(self, x: Components, fan: float) -> Components:
        if self.one is None or fan < 2:
            return x
        out = np.empty(x.shape, dtype=object)
        for at in np.ndindex(*x.shape):
            entry = x[at]
            if np.ndim(entry) and self.of.get(id(entry), 0.0) >= DEAR:
                entry = entry / self.one
                self.of[id(entry)] = 1.0
            out[at] = entry
        return out


def _step(eqn: Any, operands: list[Components], costs: _Costs) -> list[Components]:
    name = eqn.primitive.name
    if name in _ELEMENTWISE:
        return [_elementwise(eqn, operands, costs)]
    if name in _MOVES or name in _MOVES_MANY:
        return _moved(eqn, operands)
    if name in _REDUCTIONS:
        return [_reduced(eqn, operands[0], costs)]
    if name == "dot_general":
        a, b = operands
        return [_dot(a, b, eqn.params["dimension_numbers"], eqn.outvars[0].aval.dtype, costs)]
    if name in _INLINED and "jaxpr" in eqn.params:
        inner = eqn.params["jaxpr"]
        return _run(inner.jaxpr, inner.consts, operands, costs)
    if name == "iota":
        shape, dtype = eqn.outvars[0].aval.shape, eqn.outvars[0].aval.dtype
        return [split(_spread(np.arange(shape[axis := eqn.params["dimension"]], dtype=dtype), shape, (axis,)), False)]
    out = _batched(eqn, operands)
    for entry in (e for x in out for e in x.reshape(-1)):
        costs.note(entry, [e for x in operands for e in x.reshape(-1)], 2 * DEAR)
    return out


def _run(jaxpr: core.Jaxpr, consts: list, operands: list[Components], costs: _Costs) -> list[Components]:
    known = dict(zip(jaxpr.constvars, (split(c, False) for c in consts), strict=True))
    fans = _fans(jaxpr)
    known.update((v, costs.kept(x, fans[v])) for v, x in zip(jaxpr.invars, operands, strict=True))

    def read(v):
        return split(np.asarray(v.val), False) if isinstance(v, core.Literal) else known[v]

    for eqn in jaxpr.eqns:
        out = _step(eqn, [read(v) for v in eqn.invars], costs)
        known.update((v, costs.kept(x, fans.get(v, 0.0))) for v, x in zip(eqn.outvars, out, strict=True))
    return [read(v) for v in jaxpr.outvars]


def by_components(
    function: Callable, dtype: DTypeLike, one: jax.Array | None = None, dear: list | None = None
) -> Callable:
    """Turn a function of trees of small arrays into the same function of trees of `Components`.

    All floating-point numbers have the dtype `dtype`. `one` is an input of value 1, which `_Costs` uses to make XLA
    store expensive intermediates. `dear` lists entries among the arguments that are expensive to read.
    """

    def run(*trees):
        leaves, structure = jax.tree.flatten(trees)
        shapes = [jax.ShapeDtypeStruct(x.shape, dtype) for x in leaves]
        made, out = jax.make_jaxpr(lambda *xs: function(*jax.tree.unflatten(structure, xs)), return_shape=True)(*shapes)
        costs = _Costs(one, {id(x): DEAR for x in dear or ()})
        return jax.tree.unflatten(jax.tree.structure(out), _run(made.jaxpr, made.consts, leaves, costs))

    return run


def one_entry(x: object) -> Components:
    """Components of shape () that hold this entry."""
    out = np.empty((), dtype=object)
    out[()] = x
    return out


def entries(tree: PyTree) -> list:
    """All entries of a tree of components."""
    return [e for x in jax.tree.leaves(tree) for e in x.reshape(-1)]


def trees(structure: PyTreeDef | None, shapes: list[tuple[int, ...]], rows: Sequence | jax.Array) -> PyTree:
    """A tree of components of these shapes from a list of entries, or one leaf if there is no structure."""
    leaves, at = [], 0
    for shape in shapes:
        size = int(np.prod(shape))
        leaf = np.empty(size, dtype=object)
        for k in range(size):
            leaf[k] = rows[at + k]
        leaves.append(leaf.reshape(shape))
        at += size
    return jax.tree.unflatten(structure, leaves) if structure is not None else leaves[0]
