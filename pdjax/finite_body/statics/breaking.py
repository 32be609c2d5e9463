"""`solve_breaking`: equilibria of a body whose bonds break while its load grows slowly.

The load factor λ rises in load steps. In each step the following is repeated until no bond breaks any more:

    1. solve for the equilibrium of the bonds that are left,
    2. find the bonds that exceed the breaking criterion there,
    3. break them, or the most overloaded of them, at both of their ends.

The load stays constant between the rounds of one load step. A crack that grows in an unstable way therefore runs on
within one load step until it stops, or until nothing is left to carry the load.

**Equilibrium.** Newton's method of `solve`, with the linear solver of `pdjax.finite_body.statics.recycled`. Each load
step starts from the last equilibrium, scaled in proportion to the load: this is the exact start for a linear body. The
residual is relative to the largest forces of the path so far, because a body that has broken carries almost none.

**Compiled programs.** Families with broken bonds have arrays of the same shapes as those of the intact body, so no
break compiles a program. Sparsity: the matrix of a round has the pattern of the bonds that are left.

**Models.** BondBased and LPS keep their reference sums. A correspondence model takes them over the bonds that are left,
and a point whose bonds no longer determine its deformation loses them all (`pdjax.finite_body.damage.fragments`).
"""

import os

import equinox as eqx
import numpy as np
from numpy.typing import ArrayLike

from ..._internal.checks import finite, in_double, is_concrete, on_device
from ..._internal.progress import progress
from ..._internal.public import public_function
from ..damage.criteria import Criterion
from ..dynamics import checkpoint as checkpoints
from ..dynamics.breaking import check_breaking
from ..scene import Scene
from ..spectrum import need_energy
from .breaking_path import BreakingEnding, BreakingPath
from .breaking_rounds import BreakingBody, looked, number
from .load_paths import load_paths

DIFFERS = (
    "its scene, model, criterion, bonds_per_step, tolerance or the load factors that it has passed differ from those of"
    " this run, or another version of JAX wrote it"
)


def _factors(load_steps: ArrayLike) -> np.ndarray:
    """The load factors of the load steps."""
    if np.ndim(load_steps) == 0:
        if isinstance(load_steps, bool) or not float(load_steps).is_integer() or load_steps < 1:  # type: ignore
            raise ValueError(f"load_steps must be a whole number >= 1, or the load factors; got {load_steps!r}")
        return np.arange(1, int(load_steps) + 1) / int(load_steps)  # type: ignore[arg-type]
    factors = finite("load_steps", load_steps)
    if factors.ndim != 1 or not len(factors) or not (np.diff(factors, prepend=0.0) > 0).all():
        raise ValueError(
            f"load_steps must be load factors > 0 that increase, shape (steps,); got shape {factors.shape}:"
            f" {np.array2string(factors, threshold=6)}"
        )
    return factors


def _check(scene, breaking, bonds_per_step, tolerance, max_iterations, checkpoint, resume) -> None:
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene (pdjax.scene or pdjax.scenes); got {type(scene).__name__}")
    check_breaking(breaking, scene)
    need_energy(scene)
    if breaking.smooth:
        raise ValueError("solve_breaking breaks bonds at once; leave out the smoothing of the criterion")
    if not is_concrete(scene, breaking):
        raise ValueError("solve_breaking runs on the host; call it outside of jit, vmap and grad")
    for name, value in {"bonds_per_step": bonds_per_step, "max_iterations": max_iterations}.items():
        whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not (value is None and name == "bonds_per_step") and not (whole and value >= 1):
            raise ValueError(f"{name} must be a whole number >= 1; got {value!r}")
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance must lie between 0 and 1; got {tolerance}")
    if resume and checkpoint is None:
        raise ValueError("resume needs checkpoint, the file from which the run continues")
    left = load_paths(scene, np.zeros(scene.prescribed.shape))
    if left.lost is not None:
        raise ValueError(
            f"nothing holds a loaded piece of {len(left.lost)} points, the first is point {left.lost[0]}; prescribe"
            " displacements that hold it"
        )
    if left.severed:
        raise ValueError(
            "nothing strains this body: no body force acts, and every piece is held or moved as a rigid body, so no"
            " bond can break; prescribe other displacements or add a load, and check that a cut does not sever the body"
        )


@public_function
@in_double
def solve_breaking(
    scene: Scene,
    breaking: Criterion,
    *,
    load_steps: ArrayLike = 20,
    bonds_per_step: int | None = None,
    tolerance: float = 1e-10,
    max_iterations: int = 50,
    checkpoint: str | os.PathLike | None = None,
    resume: bool = False,
    show_progress: bool = True,
    throw: bool = False,
) -> BreakingPath:
    """Follow the equilibrium of a body whose bonds break while its load grows slowly.

    Parameters
    ----------
    scene : Scene
        The boundary value problem, at load factor 1. Prescribed displacements and body forces grow in proportion to the
        load factor. A cracked body has cut or broken bonds in its families.
    breaking : Criterion
        The breaking criterion.
    load_steps : int or array, shape (steps,), optional
        Number of equal load steps up to load factor 1, or the increasing load factors [-] themselves. Default 20.
    bonds_per_step : int, optional
        Most bonds that break before the next equilibrium is computed, the most overloaded first. With a small number
        the crack feels every break, and the run takes longer. Default: all bonds that exceed the criterion. A criterion
        without a measure of overload, `BreakingRule`, always breaks all of them.
    tolerance : float, optional
        Largest relative residual [-] of an equilibrium. Default 1e-10.
    max_iterations : int, optional
        Largest number of Newton iterations of an equilibrium. Default 50.
    checkpoint : path, optional
        File that is written after each load step, from which a run can continue. An existing file is kept as FILE.old.
    resume : bool, optional
        Continue from `checkpoint`, bit for bit. The load factors may be other ones beyond those that it has passed.
    show_progress : bool, optional
        Show the number of load steps on a terminal.
    throw : bool, optional
        Raise RuntimeError if a loaded piece breaks off or no equilibrium is found.

    Returns
    -------
    BreakingPath
        The equilibria, the bonds that broke, the energies, and how the path ended. A severed body, or a load that the
        body cannot carry, is an ending of the path.

    Raises
    ------
    ValueError
        If an argument is wrong, the criterion cannot serve the model, the model has no energy, nothing strains the
        body, or another run wrote the checkpoint.
    FileNotFoundError
        If `resume` and there is no checkpoint.
    RuntimeError
        If `throw` is True and a loaded piece broke off or no equilibrium was found.

    Notes
    -----
    A path of stable equilibria under slow loading depends on the load steps only through their size: a bond breaks at
    the first load factor at which it exceeds the criterion. Under a given force a body has no equilibrium beyond its
    largest load. Prescribe displacements to follow a crack that grows in a stable way.

    The path follows equilibria, stable or not. `body_stability` examines one of them.

    A body counts as severed when no chain of bonds joins parts that the supports move apart. The last bonds of a
    section may form hinges, which carry almost no load until they are pulled straight. Such a body is not severed yet.

    On a coarse lattice a crack is trapped between the points: it grows at a larger load than the fracture energy of the
    criterion demands. In a double cantilever the excess falls with N = δ/h (`benchmarks/fracture_statics.py`).

    References
    ----------
    Ni, Zaccariotto, Zhu & Galvanetto 2019 (static solution of crack propagation in peridynamics)

    Examples
    --------
    A plate with an edge crack is pulled apart. Its first bonds break in the step to the load factor 0.8:

    >>> body = pd.lattice((12, 12))
    >>> families = pd.cut(pd.families(body, horizon=2.1), pd.Segment((0.0, 6.0), (5.0, 6.0)))
    >>> low, high = body.positions[:, 1] < 2, body.positions[:, 1] > 10
    >>> pulled = pd.prescribe(low, 0.0), pd.prescribe(high, [0.0, 0.3])
    >>> plate = pd.scene(body, families, pd.LPS(1.0, 0.6), *pulled)
    >>> path = pd.solve_breaking(plate, pd.CriticalStretch(0.04, no_fail=low | high), load_steps=10)
    >>> path.ending.name, path.broken_bonds, float(path.broken_at.min())
    ('FINISHED', 40, 0.8)
    """
    _check(scene, breaking, bonds_per_step, tolerance, max_iterations, checkpoint, resume)
    factors = _factors(load_steps)
    body = BreakingBody(scene, breaking, bonds_per_step, tolerance, max_iterations)
    name, done = "", 0
    if checkpoint is not None:
        path = checkpoints.fresh(checkpoint, resume)
        u = on_device(body.u)
        program = looked.lower(body.scene, breaking, u, number(0.0, u)).as_text()  # type: ignore[attr-defined]
        settings = (bonds_per_step or 0, tolerance, max_iterations)
        name = checkpoints.fingerprint(program, eqx.filter((scene, breaking), eqx.is_array), settings)
        if resume:
            saved, states = checkpoints.load(path, name, body.progress(0), body.states[0], DIFFERS)
            done = int(saved.done)
            past = np.array([float(s.factor) for s in states])
            if not np.array_equal(np.unique(past)[1:], factors[:done]):
                raise ValueError(f"checkpoint {path} belongs to another run: {DIFFERS}")
            body.resume(saved, states)
    for k in progress(range(done, len(factors)), len(factors) - done, "load steps", show_progress):
        if not body.step(float(factors[k])):
            break
        if checkpoint is not None:
            checkpoints.save(checkpoint, name, body.progress(k + 1), body.states)
    if body.code != BreakingEnding.FINISHED and len(np.unique([s.factor for s in body.states])) == 2:
        first = body.first_break()
        body.detail += (
            f". This is the first load step, and the first bond breaks near load factor {first:.4g}: take load factors"
            f" that start below it, such as load_steps=np.linspace({0.9 * first:.3g}, {2 * first:.3g}, 50)"
        )
    found = body.path()
    if throw and found.code in (BreakingEnding.LOAD_LOST, BreakingEnding.NO_EQUILIBRIUM):
        raise RuntimeError(f"no equilibrium of the {scene.name}: {found}")
    return found
