"""The parameters of a design or an inverse problem: a tree of numbers and arrays, its flat array, and its names."""

from typing import Any

import jax
import numpy as np

from .._internal.checks import finite, is_concrete

PathEntry = Any


class Parameters:
    """A tree of real numbers and arrays that can be written as one flat array and back.

    Attributes
    ----------
    flat : array, shape (parameters,)
        All values of the tree given first.
    names : list of str
        A name for each of them, such as `lam` or `modulus[3]`.
    """

    def __init__(self, start: Any):
        self.form: Any
        paths, self.form = jax.tree_util.tree_flatten_with_path(start)
        if not paths:
            raise ValueError("start must hold at least one number; got an empty tree")
        self.shapes, values, self.names = [], [], []
        for path, leaf in paths:
            name = _name(path)
            if not is_concrete(leaf):
                raise ValueError(
                    "start must be known numbers; the search runs on the host, not inside jit, vmap or grad"
                )
            array = finite(f"start {name}".strip(), leaf)
            self.shapes.append(array.shape)
            values.append(array.reshape(-1))
            inner = [",".join(map(str, k)) for k in np.ndindex(array.shape)]
            self.names += [f"{name or 'parameter'}[{k}]" if array.ndim else name or "parameter" for k in inner]
        self.flat = np.concatenate(values)

    def tree(self, flat: Any) -> Any:
        """The tree of flat values, which may be traced."""
        leaves, first = [], 0
        for shape in self.shapes:
            size = int(np.prod(shape))
            part = flat[first : first + size]
            concrete = is_concrete(part)
            leaves.append(jax.device_put(np.array(part, float).reshape(shape)) if concrete else part.reshape(shape))
            first += size
        return jax.tree.unflatten(self.form, leaves)

    def scales(self) -> np.ndarray:
        """Typical sizes of the flat parameters, > 0, see `pdjax.optimise.identify`."""
        sizes, first = [], 0
        for shape in self.shapes:
            part = np.abs(self.flat[first : first + int(np.prod(shape))])
            sizes.append(np.maximum(part, np.sqrt(np.mean(part**2))) if part.size else part)
            first += part.size
        size = np.concatenate(sizes)
        return np.where(size > 0, size, size.max() or 1.0)

    def flat_of(self, name: str, tree: Any, nothing: float) -> np.ndarray:
        """A tree like the parameters, one number for all of them, or None (`nothing` everywhere), as a flat array."""
        if tree is None or (_is_number(tree) and np.ndim(tree) == 0):
            return np.full(self.flat.size, nothing if tree is None else float(tree))
        leaves, form = jax.tree.flatten(tree, is_leaf=lambda x: x is None)
        if form != self.form:
            raise ValueError(f"{name} must be one number or a tree like start, {self.form}; got {form}")
        try:
            parts = [
                np.broadcast_to(np.asarray(nothing if leaf is None else leaf, float), shape).reshape(-1)
                for leaf, shape in zip(leaves, self.shapes, strict=True)
            ]
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} must have entries that fit those of start: {error}") from None
        return np.concatenate(parts)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.generic | np.ndarray | jax.Array)


def _name(path: tuple[PathEntry, ...]) -> str:
    """A path in a tree as words: `law.lam` for dictionaries and attributes, `layers[2]` for lists."""
    name = ""
    for entry in path:
        key = getattr(entry, "key", getattr(entry, "name", None))
        if isinstance(key, str):
            name += f".{key}" if name else key
        else:
            name += f"[{getattr(entry, 'idx', key)}]"
    return name
