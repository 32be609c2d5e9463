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
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike

from ..._internal.checks import finite, in_double, is_concrete, on_device, writable
from ..._internal.progress import progress
from ..._internal.public import public_function
from ...force.fields import energies
from ...geometry.bonds import Families
from ..damage.criteria import Criterion, exceeding
from ..damage.fragments import without_fragments
from ..damage.released import released_energy
from ..dynamics import checkpoint as checkpoints
from ..dynamics.breaking import check_breaking
from ..factorisation import Singular, load_rate, residual_and_scale
from ..scene import Scene
from ..spectrum import need_energy
from .breaking_path import BreakingEnding, BreakingEnergies, BreakingPath
from .load_paths import load_paths
from .newton import newton
from .recycled import Recycled
from .result import SolveEnding, torn

DIFFERS = (
    "its scene, model, criterion, bonds_per_step, tolerance or the load factors that it has passed differ from those of"
    " this run, or another version of JAX wrote it"
)
HALVINGS = 30  # bisections for the load factor of the first break


class State(NamedTuple):
    """One equilibrium of the path, as `BreakingPath` holds it for all states."""

    factor: float
    settled: bool
    u: np.ndarray
    force: np.ndarray  # V (f + λ b), minus the reaction on held components
    energies: tuple[float, ...]  # those of BreakingEnergies


class Progress(NamedTuple):
    """What a checkpoint needs beside the states: the load steps done, the unknowns, bonds and sums of energies."""

    done: int
    q: np.ndarray
    alive: np.ndarray
    broken_at: np.ndarray
    released: float
    dissipated: float
    largest: float


@eqx.filter_jit
def _looked(scene: Scene, criterion: Criterion, u: Array, factor: Array) -> tuple[Array, Array | None, Array, Array]:
    """At an equilibrium: the bonds that exceed the criterion, by how much, the strain energy, and V (f + λ b)."""
    bonds = scene.families.bonds(u)
    hit = exceeding(criterion, scene.model, scene.families, u, None)
    strain = jnp.dot(scene.families.volumes, energies(scene.model, scene.families, bonds))
    return hit, criterion.overload(scene.model, scene.families, bonds), strain, scene.unbalanced(u, factor)


_fewer = eqx.filter_jit(without_fragments)


def _number(value: float, like: Array) -> Array:
    """The value as an array, so that another value compiles nothing."""
    return on_device(np.asarray(value, like.dtype))


def most_overloaded(
    hit: Bool[np.ndarray, "points bonds"],
    overload: Float[np.ndarray, "points bonds"] | None,
    families: Families,
    most: int | None,
) -> Bool[np.ndarray, "points bonds"]:
    """At most `most` of the bonds that were hit, those of the largest overload, each at both of its ends."""
    if most is None or overload is None:
        return hit
    i, slot = np.nonzero(hit)
    there = np.asarray(families.neighbours)[i, slot], np.asarray(families.reverse)[i, slot]
    size = hit.shape[1]
    once = i * size + slot < there[0] * size + there[1]
    worst = np.maximum(overload[i, slot], overload[there])[once]
    chosen = np.flatnonzero(once)[np.argsort(-worst, kind="stable")[:most]]
    dying = np.zeros_like(hit)
    dying[i[chosen], slot[chosen]] = True
    dying[there[0][chosen], there[1][chosen]] = True
    return dying


class _Body:
    """The body during the run: its families, its equilibrium, its energies, and the states so far."""

    def __init__(self, scene: Scene, criterion: Criterion, most: int | None, tolerance: float, iterations: int):
        self.intact, self.criterion, self.most = scene, criterion, most
        self.tolerance, self.iterations, self.solver = tolerance, iterations, Recycled()
        self.alive = np.asarray(scene.families.weight) > 0
        self.broken_at = np.full(self.alive.shape, np.inf)
        self.q = np.zeros(len(scene.unknowns), scene.prescribed.dtype)
        self.factor, self.released, self.dissipated = 0.0, 0.0, 0.0
        self.largest = 0.0  # largest scale of the forces so far, see `residual_and_scale`
        self.states: list[State] = []
        self.code, self.detail = BreakingEnding.FINISHED, ""
        self.held = ~scene.free
        self.load = np.asarray(scene.families.volumes)[:, None] * np.asarray(scene.load)
        self.with_bonds()
        self.look()
        self.record(True)

    def with_bonds(self) -> None:
        """Give the scene the bonds that are alive."""
        families = self.intact.families.with_broken(~self.alive)
        self.scene = eqx.tree_at(lambda s: s.families, self.intact, families)

    def look(self) -> None:
        """Evaluate criterion, energy and forces at the present state."""
        u = self.scene.displacement(self.q, self.factor)
        hit, overload, strain, force = _looked(self.scene, self.criterion, u, _number(self.factor, u))
        self.u, self.hit, self.force, self.strain = np.asarray(u), np.asarray(hit), np.asarray(force), float(strain)
        self.overload = None if overload is None else np.asarray(overload)

    def record(self, settled: bool) -> None:
        """Add the present equilibrium to the states."""
        supports = loads = 0.0
        if self.states:
            last = self.states[-1]
            moved = self.u - last.u
            supports = last.energies[3] - 0.5 * float(np.sum((self.force + last.force) * moved * self.held))
            loads = last.energies[4] + 0.5 * (self.factor + last.factor) * float(np.sum(self.load * moved))
        parts = (self.strain, self.released, self.dissipated, supports, loads)
        self.states.append(State(self.factor, settled, self.u, self.force, parts))

    def equilibrium(self, q: np.ndarray, factor: float) -> bool:
        """Solve at this load factor from q, with a fresh factorisation if the recycled one fails."""
        for _ in range(2):
            found, code, _ = newton(
                self.scene, q, factor, self.tolerance, self.iterations, self.solver, least_scale=self.largest
            )
            if code == SolveEnding.CONVERGED:
                break
            self.solver.forget()
        if code == SolveEnding.CONVERGED and bool(torn(self.scene.families, self.scene.displacement(found, factor))):
            code = SolveEnding.TORN
        if code != SolveEnding.CONVERGED:
            self.code = BreakingEnding.NO_EQUILIBRIUM
            self.detail = f"at load factor {factor:.6g}, {SolveEnding.of(int(code)).reason}"
            return False
        self.q, self.factor = found, factor
        self.look()
        self.largest = max(self.largest, float(residual_and_scale(self.scene, found, factor)[1]))
        return True

    def predicted(self, factor: float) -> np.ndarray:
        """The unknowns at which Newton's method starts at a larger load factor."""
        if self.factor > 0:
            return (self.q * (factor / self.factor)).astype(self.q.dtype)
        try:
            b = factor * np.asarray(load_rate(self.scene, self.q, 0.0))
            return (self.q - self.solver(self.scene, self.q, 0.0)(b)).astype(self.q.dtype)
        except Singular:
            return self.q

    def rupture(self) -> bool:
        """Break the bonds that exceed the criterion, and find the next equilibrium. False if the run ends."""
        dying = most_overloaded(self.hit, self.overload, self.scene.families, self.most)
        alive = self.alive & ~dying
        if self.scene.model.has_shape_tensor:
            both = on_device((self.alive, alive))
            alive = np.asarray(_fewer(self.scene.model, self.intact.families, *both))
        gone = self.alive & ~alive
        released = float(released_energy(self.scene.model, self.scene.families, self.u, gone))
        before, u = self.strain - released, self.u
        self.released += released
        self.alive, self.broken_at = alive, np.where(gone, self.factor, self.broken_at)
        self.with_bonds()
        left = load_paths(self.scene, u)
        if left.lost is not None:
            self.code = BreakingEnding.LOAD_LOST
            self.detail = (
                f"{len(left.lost)} points, the first is point {left.lost[0]}, at load factor {self.factor:.6g}"
            )
            return False
        if not self.equilibrium(self.q, self.factor):
            return False
        self.dissipated += before - self.strain + self.factor * float(np.sum(self.load * (self.u - u)))
        if left.severed:
            self.code = BreakingEnding.SEVERED
            self.detail = f"at load factor {self.factor:.6g}"
            self.record(True)
        return not left.severed

    def step(self, factor: float) -> bool:
        """One load step. False if the run ends."""
        self.solver.forget()  # A resumed run has no earlier factorisation, and must compute the same numbers.
        if not self.equilibrium(self.predicted(factor), factor):
            return False
        breaks = bool(self.hit.any())
        self.record(not breaks)
        if not breaks:
            return True
        while self.hit.any():
            if not self.rupture():
                return False
        self.record(True)
        return True

    def first_break(self) -> float:
        """The load factor of the first break, if the displacement grows in proportion to the load."""
        first = next(state for state in self.states if state.factor > 0)
        whole = self.intact.families.with_broken(np.zeros_like(self.alive))
        scene = eqx.tree_at(lambda s: s.families, self.intact, whole)
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            u = on_device(middle * first.u)
            hit = _looked(scene, self.criterion, u, _number(first.factor, u))[0]
            low, high = (low, middle) if np.asarray(hit).any() else (middle, high)
        return high * first.factor

    def progress(self, done: int) -> Progress:
        """What a checkpoint needs after `done` load steps."""
        return Progress(done, self.q, self.alive, self.broken_at, self.released, self.dissipated, self.largest)

    def resume(self, saved: Progress, states: list[State]) -> None:
        """Continue from a checkpoint."""
        _, self.q, self.alive, self.broken_at = (np.asarray(x) for x in saved[:4])
        self.released, self.dissipated, self.largest = (float(x) for x in saved[4:])
        self.states = [
            State(float(s.factor), bool(s.settled), s.u, s.force, tuple(map(float, s.energies))) for s in states
        ]
        self.factor = self.states[-1].factor
        self.with_bonds()
        self.look()

    def path(self) -> BreakingPath:
        """The result."""
        parts = np.array([state.energies for state in self.states]).T
        force = np.array([state.force for state in self.states])
        return BreakingPath(
            np.array([state.factor for state in self.states]),
            np.array([state.settled for state in self.states]),
            np.array([state.u for state in self.states]),
            np.where(self.held, -force, 0.0),
            BreakingEnergies(*parts),
            self.alive,
            self.broken_at,
            load_paths(self.scene, self.u).separated,
            self.intact.families,
            int(self.code),
            self.detail,
            self.solver.factorisations,
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
        File that is written after each load step, from which a run can continue.
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
    body = _Body(scene, breaking, bonds_per_step, tolerance, max_iterations)
    name, done = "", 0
    if checkpoint is not None:
        path = Path(checkpoint)
        if not resume:
            writable(path)
        u = on_device(body.u)
        program = _looked.lower(body.scene, breaking, u, _number(0.0, u)).as_text()  # type: ignore[attr-defined]
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
            f" that start below it, such as load_steps=np.linspace({0.9 * first:.3g}, {factors[-1]:.3g}, 50)"
        )
    found = body.path()
    if throw and found.code in (BreakingEnding.LOAD_LOST, BreakingEnding.NO_EQUILIBRIUM):
        raise RuntimeError(f"no equilibrium of the {scene.name}: {found}")
    return found
