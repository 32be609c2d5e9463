"""The largest stable time step of explicit integration: Δt_cr = 2/ω_max.

ω_max² is the largest |eigenvalue| of (ρV)^{-½} A (ρV)^{-½}, where A is the Jacobian of the forces on the free
components. A few Lanczos steps find it from Jacobian–vector products, so no matrix is stored. Lanczos approaches
ω_max² from below, so the computed Δt_cr is too large, by a relative error of at most ACCURACY/2.
"""

import numpy as np

from ..._internal.checks import in_double, is_concrete
from ..._internal.public import public_function
from ...force.fields import point_field
from ..factorisation import as_operator, product
from ..scene import frozen
from .system import Motion

ACCURACY = 1e-3  # relative, of ω_max²
SAFETY = 0.8  # default dt over the critical step at the start: a body may become stiffer as it deforms
# The same for a run with breaking bonds. Bonds are looked at once a step and break late. At the tip of a fast crack
# they release 1.58, 1.36, 1.18 and 1.09 times the fracture energy with 0.8, 0.4, 0.2 and 0.1 of the critical step
# (measured, `pdjax.studies.running_cracks`).
SAFETY_BREAKING = 0.2


@public_function
@in_double
def critical_time_step(motion: Motion, u=None, t=0.0) -> float:
    """Compute the critical time step of velocity Verlet.

    Δt_cr = 2/ω_max, with ω_max the largest frequency of the motion linearised at u

    Parameters
    ----------
    motion : Motion
        The motion, from `motion` or from `pdjax.scenes`.
    u : array, shape (points, dim), optional
        Displacements [length] at which the motion is linearised. Default: the initial displacements.
    t : float, optional
        Time [time] that determines the load factor λ(t). Default 0.

    Returns
    -------
    float
        The critical time step [time], inf for a body without stiffness.

    Raises
    ------
    ValueError
        If it is called under jit or vmap, because it runs on the host, or if the forces at u are not finite.

    Notes
    -----
    Central differences have the same critical time step. The relative error is at most 0.0005, from above.

    Examples
    --------
    A chain of springs of stiffness 1 between neighbours of mass 1 has ω_max = 2:

    >>> motion = pd.scenes.wave(8, N=1, model=pd.BondBased(1.0))
    >>> round(pd.critical_time_step(motion), 6)
    1.0
    """
    if not isinstance(motion, Motion):
        raise ValueError(
            f"motion must be a Motion (pdjax.motion(scene, density) or a moving scene); got {type(motion).__name__}"
        )
    motion = frozen(motion)
    scene, density = motion.scene, motion.density
    if not is_concrete(motion, u):
        raise ValueError(
            "critical_time_step runs on the host and cannot be traced; under jit or vmap, compute it beforehand or give"
            " dt yourself"
        )
    u = motion.start if u is None else point_field(u, scene.families)
    factor = motion.factor(t)[0]
    keep = np.asarray(scene.unknowns)
    mass = np.asarray(density) * np.asarray(scene.families.volumes)
    root = np.sqrt(np.broadcast_to(mass[:, None], u.shape).reshape(-1)[keep])
    q = np.asarray(u).reshape(-1)[keep]
    scene = scene.prepared()
    H = as_operator(lambda v: np.asarray(product(scene, q, factor, v / root)) / root, len(keep))
    if len(keep) < 3:
        largest = float(np.abs(np.linalg.eigvals(H @ np.eye(len(keep)))).max())
    else:
        start = np.random.default_rng(0).normal(size=len(keep))
        moved = H @ start
        if not np.isfinite(moved).all():
            raise ValueError(
                "the forces at u are not finite, so there is no critical time step; look in u for bonds of zero length"
            )
        if not moved.any():
            return float("inf")
        import scipy.sparse.linalg as sla

        find = sla.eigsh if scene.model.hyperelastic else sla.eigs
        try:
            largest = float(abs(find(H, k=1, which="LM", tol=ACCURACY, v0=start, return_eigenvectors=False)[0]))
        except sla.ArpackError as error:
            raise ValueError(f"the largest eigenvalue at u was not found: {error}") from error
    return float("inf") if largest == 0 else 2 / largest**0.5
