"""Measured data of an inverse problem: their values, their noise, and which of them were measured.

Data are one array or a tree of arrays, such as a pair (displacements, reaction force). The weighted residual of a
datum is (y − d)/σ with the prediction y, the measured value d and the standard deviation σ of its noise. Without a
known noise, σ is the root mean square of the measured values of the same array, so that the residuals have no unit.
"""

from typing import Any

import jax
import numpy as np

from .._internal.checks import native


class Measured:
    """The measured data of an inverse problem.

    Attributes
    ----------
    index : int array, shape (data,)
        Numbers of the measured entries in the flat prediction.
    values, sigma : array, shape (data,)
        Measured values, and the standard deviation that divides their residuals.
    first : array, shape (data,)
        Weighted residuals of the prediction given first.
    known : bool
        Whether `sigma` is the noise, not a scale.
    """

    def __init__(self, observed: Any, predicted: Any, what: str, where: Any, noise: Any):
        self.form: Any
        leaves, self.form = jax.tree.flatten(predicted)
        single = jax.tree_util.treedef_is_leaf(self.form)
        given = [observed] if single else self._like(observed, "observed")
        masks = [where] if single else self._like(where, "where", each=True)
        noises = [noise] if single else self._like(noise, "noise", each=True)
        self.shapes = [np.shape(leaf) for leaf in leaves]
        self.known = noise is not None
        index, values, sigma, first = [], [], [], 0
        for k, shape in enumerate(self.shapes):
            name = "" if single else f" (part {k + 1} of {len(leaves)})"
            data, mask = _data(given[k], shape, name, what), _mask(masks[k], shape, name)
            found = data[mask]
            if np.isnan(found).any() or not np.isfinite(found).all():
                bad = np.argwhere(mask & ~np.isfinite(data))
                raise ValueError(
                    f"observed{name} must be finite where it is measured; {len(bad)} of {found.size} data are not,"
                    f" the first at {tuple(int(i) for i in bad[0])}. Leave missing data out with"
                    " where=np.isfinite(observed)"
                )
            index.append(first + np.flatnonzero(mask))
            values.append(found)
            sigma.append(_sigma(noises[k], shape, mask, found, name))
            first += mask.size
        self.total = first
        self.index, self.values, self.sigma = map(np.concatenate, (index, values, sigma))
        self.first = self.weighted(predicted)
        if not self.index.size:
            raise ValueError("where selects no datum; it must be True for at least one entry of observed")

    def _like(self, tree: Any, name: str, each: bool = False) -> list[Any]:
        """The leaves of a tree like the prediction. `each`: one value for all leaves is accepted too."""
        if each and (tree is None or isinstance(tree, bool | int | float)):
            return [tree] * self.form.num_leaves
        try:
            return self.form.flatten_up_to(tree)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{name} must be a tree like the predicted data, {self.form}: {error}") from None

    def weighted(self, predicted: Any) -> np.ndarray:
        """The weighted residuals (y − d)/σ of the measured data."""
        leaves = jax.tree.leaves(jax.device_get(predicted))
        if [np.shape(leaf) for leaf in leaves] != self.shapes:
            raise ValueError(
                f"the predictions must keep their shapes {self.shapes}; they changed to {[np.shape(x) for x in leaves]}"
            )
        flat = np.concatenate([np.asarray(leaf, float).reshape(-1) for leaf in leaves])
        return (flat[self.index] - self.values) / self.sigma

    def residual(self, weighted: np.ndarray) -> Any:
        """y − d as a tree like the data, NaN where nothing was measured."""
        flat = np.full(self.total, np.nan)
        flat[self.index] = weighted * self.sigma
        ends = np.cumsum([int(np.prod(shape)) for shape in self.shapes])[:-1]
        parts = [part.reshape(shape) for part, shape in zip(np.split(flat, ends), self.shapes, strict=True)]
        return jax.tree.unflatten(self.form, parts)


def _data(given: Any, shape: tuple[int, ...], name: str, what: str) -> np.ndarray:
    data = native(f"observed{name}", given).astype(float)
    if data.shape != shape:
        raise ValueError(
            f"observed{name} must have the shape of the prediction, {shape}: {what}. Its shape is {data.shape}. If"
            " something else was measured, give measure, the function that turns the solution into the measured array"
        )
    return data


def _mask(given: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    """`where` as a mask of all entries.

    An array of one axis is a mask of points, which holds for all of their components. An array of several axes is read
    as a mask of entries first, and as a mask of points if it does not fit.
    """
    if given is None:
        return np.ones(shape, bool)
    mask = np.asarray(given)
    if mask.dtype != bool:
        raise ValueError(f"where{name} must be an array of True and False; got an array of {mask.dtype}")
    readings = (mask, mask[..., None]) if mask.ndim > 1 else (mask[..., None], mask)
    for reading in readings:
        try:
            return np.broadcast_to(reading, shape)
        except ValueError:
            continue
    raise ValueError(
        f"where{name} must have the shape {shape} of observed, or that of its points; got shape {mask.shape}"
    )


def _sigma(noise: Any, shape: tuple[int, ...], mask: np.ndarray, found: np.ndarray, name: str) -> np.ndarray:
    if noise is None:
        size = float(np.sqrt(np.mean(found**2))) if found.size else 1.0
        return np.full(found.shape, size if size > 0 else 1.0)
    sigma = native(f"noise{name}", noise).astype(float)
    try:
        sigma = np.broadcast_to(sigma, shape)[mask]
    except ValueError:
        raise ValueError(
            f"noise{name} must be one standard deviation, or an array of the shape {shape}; got {sigma.shape}"
        ) from None
    if not (np.isfinite(sigma) & (sigma > 0)).all():
        raise ValueError(f"noise{name} must be a finite standard deviation > 0; got {sigma.min()} to {sigma.max()}")
    return sigma
