"""The rounds of `solve_breaking`: solve for an equilibrium, find the bonds that exceed the criterion, break them.

`BreakingBody` holds the body during a run: the bonds that are left, the present equilibrium, the energies and all
states so far. Its method `step` is one load step. `breaking` drives it, and `breaking_path` holds the result.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._internal.checks import on_device
from ...force.fields import energies
from ...geometry.bonds import Families
from ..damage.criteria import Criterion, exceeding
from ..damage.fragments import without_fragments
from ..damage.released import released_energy
from ..factorisation import Singular, load_rate, residual_and_scale
from ..scene import Scene
from .breaking_path import BreakingEnding, BreakingEnergies, BreakingPath
from .load_paths import load_paths
from .newton import newton
from .recycled import Recycled
from .result import SolveEnding, torn

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
def looked(scene: Scene, criterion: Criterion, u: Array, factor: Array) -> tuple[Array, Array | None, Array, Array]:
    """At an equilibrium: the bonds that exceed the criterion, by how much, the strain energy, and V (f + λ b)."""
    bonds = scene.families.bonds(u)
    hit = exceeding(criterion, scene.model, scene.families, u, None)
    strain = jnp.dot(scene.families.volumes, energies(scene.model, scene.families, bonds))
    return hit, criterion.overload(scene.model, scene.families, bonds), strain, scene.unbalanced(u, factor)


_fewer = eqx.filter_jit(without_fragments)


def number(value: float, like: Array) -> Array:
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


class BreakingBody:
    """The body during the run: its families, its equilibrium, its energies, and the states so far."""

    def __init__(self, scene: Scene, criterion: Criterion, most: int | None, tolerance: float, iterations: int):
        self.intact, self.criterion, self.most = scene, criterion, most
        self.tolerance, self.iterations, self.solver = tolerance, iterations, Recycled()
        self.alive = np.asarray(scene.families.acting)
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
        hit, overload, strain, force = looked(self.scene, self.criterion, u, number(self.factor, u))
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
            if self.load.any():
                self.detail += (
                    ". The body may be unable to carry this load; prescribe displacements instead of forces to follow"
                    " a crack that grows in a stable way"
                )
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
            hit = looked(scene, self.criterion, u, number(first.factor, u))[0]
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
