"""`certify_critical_load`: the critical load of a path with a proof on both of its sides."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._internal.public import public_function
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..certificate.certificate import Certificate
from ..paths import Path, hydrostatic, named_path
from .certified import BOXES, certify
from .certified_path import PathCertificate, certify_path
from .critical_load import LIMITS, SMALLEST, critical_load, sign_of

NEAR = 1e-3


class CriticalCertificate(eqx.Module):
    """A critical load and what is proved about it, the result of `certify_critical_load`.

    Attributes
    ----------
    load : float
        The critical load a_cr [-] of `critical_load`: 0 if the side is unstable at once, infinite if it does not fail.
    below : PathCertificate or None
        Proof of stability from 0 to (1 − 1e-3) a_cr, or to the limit if a_cr is infinite. None if a_cr is 0.
    beyond : Certificate or None
        Proof of instability at (1 + 1e-3) a_cr, or at the smallest sampled load if a_cr is 0. None if it is infinite.
    proved : bool
        Whether all of these proofs have succeeded.
    verdict : str
        What is proved, in words.

    Examples
    --------
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0), pd.SillingControl(0.065))
    >>> print(pd.certify_critical_load(model, pd.lattice_family(2, 2)))
    a = -0.04769: proved stable at every load before it, proved unstable just beyond it
    """

    load: float
    below: PathCertificate | None
    beyond: Certificate | None

    @property
    def proved(self) -> bool:
        """Whether all of these proofs have succeeded."""
        stable = self.below is None or self.below.verdict == "stable"
        return stable and (self.beyond is None or self.beyond.verdict == "unstable")

    @property
    def verdict(self) -> str:
        """What is proved, in words."""
        parts = []
        if self.below is not None:
            where = "every load" if self.below.continuous else f"{len(self.below.loads)} samples"
            upto = "up to the limit" if self.beyond is None else "before it"
            if self.below.verdict == "stable":
                parts.append(f"proved stable at {where} {upto}")
            elif self.below.verdict == "unstable":
                parts.append(f"unstable already at {self.below.unstable_at:.4g}: the critical load is wrong")
            elif self.below.verdict == "marginal":
                parts.append(f"marginal at {self.below.marginal_at:.4g}, so that stability cannot be proved")
            else:
                parts.append(f"proved stable only up to {self.below.stable_to:.4g}")
        if self.beyond is not None:
            at = "at once" if self.below is None else "just beyond it"
            parts.append(f"{'' if self.beyond.verdict == 'unstable' else 'not '}proved unstable {at}")
        return ", ".join(parts)

    def __str__(self) -> str:
        return f"a = {self.load:.4g}: {self.verdict}"

    __repr__ = __str__


@public_function
def certify_critical_load(
    model: AbstractModel,
    family: LatticeFamily,
    path: Path | str = hydrostatic,
    side: str = "negative",
    limit: float | None = None,
    boxes: int = BOXES,
) -> CriticalCertificate:
    """Find the critical load of a path, and prove stability before it and instability beyond it.

    `critical_load` samples the path and can miss a narrow range of unstable loads. `certify_path` then proves stability
    from 0 to (1 − 1e-3) a_cr, for many models at every load, and `certify` proves instability at (1 + 1e-3) a_cr.

    Parameters
    ----------
    model : AbstractModel
        The material model. It must have an energy, and its constants must be known single numbers.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    path : callable or str, optional
        Load path: a function (a, model, family) → F with F = I at a = 0, such as `hydrostatic`, or a name in `PATHS`.
    side : str, optional
        Sign of the loads: "negative" or "compression", "positive" or "tension".
    limit : float, optional
        Largest |a| of the search [-], see `critical_load`.
    boxes : int, optional
        Largest number of boxes of the Brillouin zone for each load.

    Returns
    -------
    CriticalCertificate
        The critical load, and the proofs on both of its sides.

    Raises
    ------
    ValueError
        For what `critical_load` and `certify_path` refuse.

    Examples
    --------
    In compression the Seth–Hill model of order 1 is unstable at any load, which is proved at the smallest sample.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> found = pd.certify_critical_load(model, pd.lattice_family(2, 2))
    >>> found.load, found.proved, found.verdict
    (0.0, True, 'proved unstable at once')
    """
    path, sign = named_path(path), sign_of(side)
    load = float(critical_load(model, family, path, side=side, limit=limit))
    end = sign * (LIMITS[sign] if limit is None else limit) if np.isinf(load) else load * (1 - NEAR)
    below = None if load == 0 else certify_path(model, family, end, path, boxes)
    beyond = None
    if np.isfinite(load):
        further = load * (1 + NEAR) if load else 2 * sign * SMALLEST
        # The sign alone is asked for; a lower bound needs no boxes.
        beyond = certify(model, family, path(jnp.asarray(further), model, family), tol=1.0, boxes=1)
    return CriticalCertificate(load, below, beyond)
