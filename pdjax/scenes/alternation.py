"""A measure of the alternation between neighbouring points, which is the sign of a zero-energy mode in a result."""

import numpy as np


def roughness(u: np.ndarray, shape: tuple[int, ...], axis: int) -> np.ndarray:
    """How much one component of u alternates between neighbours, at every save (saves,) [length].

    It is the root mean square of ¼ of the second differences along an axis, and the largest of these over the axes. For
    a smooth field it is of the order of h² u''/4.
    """
    field = u[..., axis].reshape(len(u), *shape)
    sizes = [np.diff(field, 2, axis=k + 1) / 4 for k in range(len(shape)) if shape[k] > 2]
    return np.max([np.sqrt(np.mean(d**2, axis=tuple(range(1, d.ndim)))) for d in sizes], axis=0)
