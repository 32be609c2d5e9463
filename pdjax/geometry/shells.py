"""Influence functions by shells: one weight for every distance that occurs in a lattice.

The bonds of a lattice family have few different lengths. All bonds of one length form a shell. `shells` lists the
lengths, and `interpolated_influence` takes one weight for each. Between the given lengths ω is linear, so that the same
influence function serves a cloud of points too. The weights may be traced: they are the parameters of a design.

Wrap the function with `signed_influence` if weights may be negative.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from .._internal.checks import as_real, is_concrete, namespace, on_host
from .._internal.public import public_function
from .bonds import cells_within
from .influence import Lengths


@public_function
def shells(dim: int, N: float) -> np.ndarray:
    """List the lengths of the bonds of a lattice family.

    Parameters
    ----------
    dim : int
        Number of space dimensions: 1, 2 or 3.
    N : float
        Horizon over spacing [-], at least 1.

    Returns
    -------
    array, shape (shells,)
        Different lengths over the horizon, q = r/δ [-], from the shortest to the longest.

    Raises
    ------
    ValueError
        If `dim` is not 1, 2 or 3, or N < 1.

    Examples
    --------
    >>> (pd.shells(2, 2) * 2).round(3).tolist()
    [1.0, 1.414, 2.0]
    """
    if dim not in (1, 2, 3):
        raise ValueError(f"dim must be 1, 2 or 3; got {dim!r}")
    if not (np.isfinite(N) and N >= 1):
        raise ValueError(f"N must be finite and >= 1; got {N}")
    return np.sqrt(np.unique((cells_within(dim, N) ** 2).sum(axis=1))) / N


def piecewise_linear(x, nodes: np.ndarray, values):
    """The function of x that is linear between its values at the nodes, and constant outside.

    It is a sum of ramps without branches. Its derivatives in the values flow, and every backend can evaluate it.
    """
    xp = namespace(x, values)
    total = values[0] + 0 * x
    for i in range(len(nodes) - 1):
        ramp = xp.clip((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0, 1)
        total = total + (values[i + 1] - values[i]) * ramp
    return total


@public_function
def interpolated_influence(q, weights) -> Callable:
    """Influence function that is linear between given values.

    ω(r, δ) = the linear interpolation of the weights at q = r/δ, constant outside the given range

    Parameters
    ----------
    q : array, shape (values,)
        Lengths over the horizon [-], increasing, > 0. Their values must be known. `shells` gives those of a lattice.
    weights : array, shape (values,)
        ω [-] at these lengths. They may be traced and differentiated.

    Returns
    -------
    callable
        (r, δ) → ω [-]. Pass it to `lattice_family` or `families` as `influence`.

    Raises
    ------
    ValueError
        If q is not increasing and > 0, or the shapes differ.

    Examples
    --------
    >>> influence = pd.interpolated_influence(pd.shells(1, 2), [1.0, 0.25])
    >>> pd.lattice_family(1, 2, influence=influence).influence.tolist()
    [1.0, 0.25, 1.0, 0.25]
    """
    q = np.atleast_1d(np.asarray(q, float))
    weights = as_real(jnp.stack(weights) if isinstance(weights, list | tuple) and not is_concrete(weights) else weights)
    if q.ndim != 1 or not (np.isfinite(q).all() and (q > 0).all() and (np.diff(q) > 0).all()):
        raise ValueError(f"q must be increasing, finite and > 0; got {q}")
    if weights.shape != q.shape:
        raise ValueError(f"weights must have the shape of q, {q.shape}; got {weights.shape}")

    def interpolated(r: Lengths, horizon) -> Lengths:
        if isinstance(r, np.ndarray) and is_concrete(horizon, weights):
            r, delta, values = on_host((r, horizon, weights))
            return piecewise_linear(r / delta, q, values)
        return piecewise_linear(r / horizon, q, weights)

    return interpolated
