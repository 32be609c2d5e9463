"""The largest time step that explicit integration bears: Δt_cr = 2/ω_max.

ω_max² is the largest |eigenvalue| of (ρV)^{-½} A (ρV)^{-½} on the free components, by a few Lanczos steps on JVPs: no
matrix is stored. Lanczos comes from below, so Δt_cr comes from above, within ACCURACY/2 of itself.
"""

import numpy as np

from ..._internal.checks import in_double, is_concrete
from ..._internal.public import public_function
from ...force.fields import point_field
from ..factorisation import as_operator, product
from ..scene import frozen
from .system import Motion

ACCURACY = 1e-3  # of ω_max²
SAFETY = 0.8  # of the critical step at the start, where none is given: bodies stiffen as they deform


@public_function
@in_double
def critical_time_step(motion: Motion, u=None, t=0.0) -> float:
    """Δt_cr = 2/ω_max [time] of velocity Verlet and central differences, linearised at u.

    Arguments: u (points, dim) [length], the start by default; t [time] the moment whose load factor counts. inf where
    nothing resists.
    Raises: ValueError under jit or vmap (it runs on the host), or where the forces at u are not finite.
    """
    if not isinstance(motion, Motion):
        raise ValueError(
            f"motion must be a Motion (pdjax.motion(scene, density) or a moving scene); got {type(motion).__name__}"
        )
    motion = frozen(motion)
    scene, density = motion.scene, motion.density
    if not is_concrete(motion, u):
        raise ValueError("the critical time step is found on the host: under jit or vmap give dt yourself")
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
            raise ValueError("the forces at u are not finite: no time step can follow them")
        if not moved.any():
            return float("inf")
        import scipy.sparse.linalg as sla

        find = sla.eigsh if scene.model.hyperelastic else sla.eigs
        try:
            largest = float(abs(find(H, k=1, which="LM", tol=ACCURACY, v0=start, return_eigenvectors=False)[0]))
        except sla.ArpackError as error:
            raise ValueError(f"the largest eigenvalue at u was not found: {error}") from error
    return float("inf") if largest == 0 else 2 / largest**0.5
