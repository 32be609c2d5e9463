"""How strongly neighbouring points alternate: the sign of a zero-energy mode in a result."""

import numpy as np


def roughness(u: np.ndarray, shape: tuple[int, ...], axis: int) -> np.ndarray:
    """How much a component alternates between neighbours (saves,) [length]: ¼ second differences, root mean square.

    The largest over the three directions; a smooth field's is of the order of h² u''/4.
    """
    field = u[..., axis].reshape(len(u), *shape)
    sizes = [np.diff(field, 2, axis=k + 1) / 4 for k in range(len(shape)) if shape[k] > 2]
    return np.max([np.sqrt(np.mean(d**2, axis=tuple(range(1, d.ndim)))) for d in sizes], axis=0)
