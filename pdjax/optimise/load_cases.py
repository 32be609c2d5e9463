"""Load cases: the homogeneous deformations that a design has to survive.

A load case is a deformation gradient F. `LoadCases` makes all F of some load paths at some loads, for any model and
family. A path may depend on the model: under uniaxial stress the lateral stretch does. The deformations are therefore
made anew for every model that a design tries, and their derivatives flow.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import deformation_gradient, is_concrete, on_device
from .._internal.public import public_function
from .._internal.shown import shown
from ..geometry.bonds import LatticeFamily
from ..infinite_lattice.criteria import kept_symmetry
from ..infinite_lattice.criteria.critical_load import deformations
from ..infinite_lattice.paths import Path, check_stretch, is_stretch, named_path, path_symmetry
from ..models.base import AbstractModel


class LoadCases(eqx.Module):
    """Loads along several load paths, from `load_cases`.

    Call it with a model and a family: it returns the deformation gradients.

    Parameters
    ----------
    paths : tuple of callables
        Load paths (a, model, family) → F.
    loads : array, shape (loads,)
        Loads a [-], applied along every path.

    Examples
    --------
    >>> cases = pd.load_cases(["hydrostatic", "simple-shear"], [-0.05, 0.05])
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> cases(model, pd.lattice_family(2, 2)).shape
    (4, 2, 2)
    """

    paths: tuple[Path, ...] = eqx.field(static=True)
    loads: np.ndarray = eqx.field(converter=np.asarray)

    def __repr__(self) -> str:
        return shown(self)

    def __call__(self, model: AbstractModel, family: LatticeFamily) -> Float[Array, "cases dim dim"]:
        """The deformation gradients F [-] of all cases, one path after another."""
        loads = on_device(self.loads.astype(family.xi.dtype))
        return jnp.concatenate([deformations(path, loads, model, family) for path in self.paths])


@public_function
def load_cases(paths: Sequence[Path | str] | Path | str, loads) -> LoadCases:
    """Collect the load cases of some load paths at some loads, for `worst_margin`.

    Parameters
    ----------
    paths : callable or str, or a sequence of these
        Load paths (a, model, family) → F such as `hydrostatic`, or their names in `PATHS`.
    loads : array, shape (loads,)
        Loads a [-], applied along every path. Negative loads compress.

    Returns
    -------
    LoadCases
        A function (model, family) → deformation gradients, shape (paths · loads, dim, dim).

    Raises
    ------
    ValueError
        If there is no path or no load, if a load is not finite, or is not greater than −1 on a path that stretches by
        1 + a, or if a name is unknown.

    Examples
    --------
    >>> pd.load_cases("hydrostatic", [-0.05, 0.05])
    LoadCases(paths=(hydrostatic,), loads=array(2,))
    """
    if not is_concrete(loads):
        raise ValueError("loads of load_cases must be known numbers; to differentiate in loads, pass an array of F")
    several = [paths] if isinstance(paths, str) or callable(paths) else list(paths)
    loads = np.atleast_1d(np.asarray(loads, float))
    if not several or not loads.size:
        raise ValueError(f"load_cases needs at least one path and one load; got {len(several)} and {loads.size}")
    if loads.ndim != 1 or not np.isfinite(loads).all():
        raise ValueError(f"loads must be finite numbers, shape (loads,); got {loads}")
    chosen = tuple(named_path(path) for path in several)
    for path in chosen:
        if is_stretch(path):
            check_stretch(loads)
    return LoadCases(chosen, loads)


def checked_cases(loads: Any, model: AbstractModel, family: LatticeFamily) -> tuple[Any, list[str]]:
    """The deformation gradients (cases, dim, dim), and the symmetry of the lattice that each of them leaves.

    An array is checked where its values are known. Its symmetry is read from them, unless derivatives flow through it:
    a derivative can break the symmetry that a value has.
    """
    if isinstance(loads, LoadCases):
        kept = [path_symmetry(path, family, model.isotropic) for path in loads.paths]
        # A path may give NaN where no state exists. The margin of that case is then NaN.
        return loads(model, family), [symmetry for symmetry in kept for _ in loads.loads]
    if isinstance(loads, str) or callable(loads):
        raise ValueError(f"loads must be deformation gradients or be made by pdjax.load_cases; got {loads!r}")
    dim = family.dim
    F = loads if not is_concrete(loads) else np.asarray(loads, family.xi.dtype)
    F = F[None] if F.ndim == 2 else F
    if F.ndim != 3 or F.shape[1:] != (dim, dim) or not len(F):
        raise ValueError(f"loads must have shape (cases, {dim}, {dim}), or be made by pdjax.load_cases; got {F.shape}")
    if not is_concrete(F):
        return F, ["inversion"] * len(F)
    for each in F:
        deformation_gradient(each, dim)
    return on_device(F), [kept_symmetry(each, family, model.isotropic) for each in F]


def groups(symmetries: list[str]) -> list[tuple[str, np.ndarray]]:
    """The cases of every symmetry: (symmetry, indices of its cases)."""
    return [(one, np.flatnonzero([s == one for s in symmetries])) for one in dict.fromkeys(symmetries)]
