"""What has been checked or prepared for a families object, remembered as long as that object lives.

A check of shape tensors or the reference sums of a force depend on the model and the families, not on the displacement.
`remember` computes such a thing once for each pair. The memory belongs to the object itself: it is found through a weak
reference that is compared with the object at every look, it holds at most `MOST` entries, and it goes with the object.
A module changed by `eqx.tree_at` is another object and starts with no memory.
"""

import hashlib
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

import jax
import numpy as np

MOST = 32  # entries an object keeps; the one that was not used for longest goes first
LARGEST = 2**30  # bytes of all arrays that an object's entries hold; a larger single entry stays alone
SMALL = 64  # numbers in an array up to which its values are compared, not its identity

_MEMORIES: dict[int, tuple[weakref.ref, OrderedDict]] = {}


class _Same:
    """An immutable array as a key: equal to itself alone, and alive as long as the key."""

    def __init__(self, array: jax.Array):
        self.array = array

    def __hash__(self) -> int:
        return id(self.array)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.array is other.array


def _memory(owner: Any) -> OrderedDict:
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


def remember(owner: Any, key: Hashable, make: Callable[[], Any]) -> Any:
    """`make()`, computed once for this owner (an equinox module) and key, even while something else is traced."""
    memory = _memory(owner)
    if key in memory:
        memory.move_to_end(key)
        return memory[key]
    with jax.core.eval_context():  # `ensure_compile_time_eval` would take the programs of `make` apart
        value = make()
    memory[key] = value
    while len(memory) > MOST or (len(memory) > 1 and _bytes(memory) > LARGEST):
        memory.popitem(last=False)
    return value


def value_key(tree: Any) -> Hashable | None:
    """A key that is equal for trees of the same structure and values; None if a value is traced.

    Small arrays and NumPy arrays are compared by value, large JAX arrays, which can't change, by identity.
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
