"""Results that are computed once for an object, such as the families of a body, and kept as long as the object exists.

A check of shape tensors or the reference sums of a force depend on the model and the families, not on the displacement.
`remember` computes such a result once for each pair of a model and families. The results of an object are found by its
`id`. A weak reference confirms at each look-up that the `id` still belongs to this object, and the results are deleted
together with the object. An object has at most `MOST` results. A module changed by `eqx.tree_at` is a new object, which
starts with none.
"""

import hashlib
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar

import jax
import numpy as np

MOST = 32  # results of one object; the least recently used one is deleted first
LARGEST = 2**30  # bytes of all arrays in the results of one object; a single larger result is kept alone
SMALL = 64  # arrays of up to this many numbers are compared by value, larger ones by identity

Result = TypeVar("Result")

_MEMORIES: dict[int, tuple[weakref.ref, OrderedDict]] = {}


class _Same:
    """An immutable array as a key, equal only to itself. The key keeps the array alive."""

    def __init__(self, array: jax.Array):
        self.array = array

    def __hash__(self) -> int:
        return id(self.array)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.array is other.array


def _memory(owner: object) -> OrderedDict:
    number = id(owner)
    known = _MEMORIES.get(number)
    if known is not None and known[0]() is owner:
        return known[1]
    made: OrderedDict = OrderedDict()

    def forget(reference: weakref.ref) -> None:
        if _MEMORIES and number in _MEMORIES and _MEMORIES[number][0] is reference:
            del _MEMORIES[number]

    _MEMORIES[number] = (weakref.ref(owner, forget), made)
    return made


def _bytes(memory: OrderedDict) -> int:
    arrays = {id(x): x.nbytes for x in jax.tree.leaves(list(memory.values())) if isinstance(x, jax.Array | np.ndarray)}
    return sum(arrays.values())


def remember(owner: object, key: Hashable, make: Callable[[], Result]) -> Result:
    """`make()`, computed once for each owner (an equinox module) and key, also while another function is traced."""
    memory = _memory(owner)
    if key in memory:
        memory.move_to_end(key)
        return memory[key]
    with jax.core.eval_context():  # `ensure_compile_time_eval` would split the programs of `make`
        value = make()
    memory[key] = value
    while len(memory) > MOST or (len(memory) > 1 and _bytes(memory) > LARGEST):
        memory.popitem(last=False)
    return value


def value_key(tree: object) -> Hashable | None:
    """A key that is equal for trees of the same structure and values. It is None if a value is traced.

    Small arrays and NumPy arrays are compared by value. Large JAX arrays are immutable and compared by identity.
    """
    leaves, structure = jax.tree.flatten(tree)
    parts: list[Hashable] = [structure]
    for leaf in leaves:
        if isinstance(leaf, jax.core.Tracer):
            return None
        if isinstance(leaf, jax.Array) and leaf.size > SMALL:
            parts.append(_Same(leaf))
        elif isinstance(leaf, jax.Array | np.ndarray | np.generic):
            array = np.asarray(leaf)
            parts.append((array.shape, array.dtype.str, hashlib.sha1(array.tobytes()).digest()))
        else:
            parts.append((type(leaf), leaf))
    return tuple(parts)
