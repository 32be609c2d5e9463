"""A double cantilever: two arms that are pulled apart, and a crack between them that grows in a stable way.

Each arm has the height H and the length a of the crack. P is the force on an arm, and Δ the distance by which the
loaded ends have moved apart. With E' the modulus in the plane, beams clamped at a distance χH behind the tip give

    G = 12 P² (a + χH)²/(E'H³),    Δ = 8 P (a + χH)³/(E'H³)

χ = 0 is plain beam theory: it lacks shear, and the bending of the strip before the crack. χ = 0.673 is the value of the
plane theory of elasticity for long arms (Fichter 1983); beams on an elastic foundation give 0.64 (Kanninen 1973). While
the crack grows, G = G_c. Then Δ alone gives the length of the arms and the force, which falls as 1/√Δ:

    A = √(G_c E'H³/12),    a + χH = √(Δ E'H³/(8A)),    P = A/(a + χH)

The pre-crack is made of broken bonds, as in `pdjax.scenes.cracked_plate`. A crack between two arms may leave its plane
and break an arm, and here it does: without further measures it turns by 90° at once. Specimens have side grooves
against it. Here only the bonds that cross the plane may break: `arms` marks all others, as `no_fail` of a criterion.
"""

from typing import NamedTuple

import numpy as np

from ..finite_body import conditions
from ..finite_body.scene import Scene, scene
from ..geometry.cuts import Plane, Segment, crossed
from ..geometry.neighbour_search import families
from ..geometry.points import lattice
from ..models.base import AbstractModel
from .bodies import checked_count, checked_ratio
from .cracked_plate import checked_energy, unit_plate

ROOT = 0.673  # χ


class DoubleCantilever(NamedTuple):
    """What beam theory says of a double cantilever.

    Attributes
    ----------
    height, crack : float
        Height H of an arm and length a of the pre-crack [length], from the line of the load.
    opening : float
        Distance Δ [length] by which the loaded ends have moved apart at load factor 1.
    modulus, fracture_energy : float
        E' [pressure] and G_c [energy/area].
    upper : array of bool, shape (points,)
        The loaded points of the upper arm. The sum of their reactions along y is P.
    arms : array of bool, shape (points, bonds)
        Bonds that do not cross the plane of the crack, as `no_fail` of a breaking criterion.

    Examples
    --------
    The force at the first growth is that of the pre-crack, and falls as the crack grows:

    >>> _, expected = pd.scenes.double_cantilever(8)
    >>> onset = expected.opening_at_onset()
    >>> force = expected.force(np.array([onset, 4 * onset]))
    >>> round(float(force[0] / force[1]), 6)
    2.0
    """

    height: float
    crack: float
    opening: float
    modulus: float
    fracture_energy: float
    upper: np.ndarray
    arms: np.ndarray

    @property
    def _moment(self) -> float:
        """A = P (a + χH) of a growing crack."""
        return float(np.sqrt(self.fracture_energy * self.modulus * self.height**3 / 12))

    def opening_at_onset(self, root: float = ROOT) -> float:
        """The opening Δ at which the pre-crack begins to grow.

        Parameters
        ----------
        root : float, optional
            χ [-]. Default 0.673; 0 is plain beam theory.

        Returns
        -------
        float
            Δ [length].

        Examples
        --------
        >>> _, expected = pd.scenes.double_cantilever(8)
        >>> round(expected.opening_at_onset() / expected.opening, 3)
        0.25
        """
        return 8 * self._moment * (self.crack + root * self.height) ** 2 / (self.modulus * self.height**3)

    def force(self, opening, root: float = ROOT):
        """The force P on an arm at an opening Δ: of the pre-crack before it grows, of the growing crack after.

        Parameters
        ----------
        opening : float or array
            Δ [length].
        root : float, optional
            χ [-]. Default 0.673; 0 is plain beam theory.

        Returns
        -------
        float or array
            P [force per thickness].

        Examples
        --------
        >>> _, expected = pd.scenes.double_cantilever(8)
        >>> float(expected.force(0.0))
        0.0
        """
        stiffness, least = self.modulus * self.height**3, self.crack + root * self.height
        arm = np.maximum(np.sqrt(np.asarray(opening) * stiffness / (8 * self._moment)), least)
        return np.asarray(opening) * stiffness / (8 * arm**3)


def double_cantilever(
    n: int = 12,
    N: float = 3,
    crack: float = 4.0,
    length: float = 10.0,
    fracture_energy: float = 1e-6,
    model: AbstractModel | None = None,
) -> tuple[Scene, DoubleCantilever]:
    """Make a double cantilever whose arms of height 1 are pulled apart at their ends.

    The upper and lower ends of the arms are displaced by ±Δ/2 along y. At load factor 1 the opening Δ is four times
    that at which beam theory expects the crack to grow.

    Parameters
    ----------
    n : int, optional
        Number of points across an arm, at least N + 2. Default 12.
    N : float, optional
        Horizon over spacing [-]. Default 3.
    crack : float, optional
        Length a of the pre-crack from the line of the load [length], at least 2. Its tip lies midway between two
        points. Default 4.
    length : float, optional
        Length of the strip [length], at least crack + 3. Default 10.
    fracture_energy : float, optional
        Fracture energy G_c > 0 [energy/area]. Default 1e-6.
    model : AbstractModel, optional
        The material model, with Young's modulus 1 in plane stress. Default: `LPS` with Poisson's ratio ⅓.

    Returns
    -------
    Scene
        The problem, for `solve_breaking`. Its families hold the crack as broken bonds.
    DoubleCantilever
        The force and the opening of beam theory, and the masks of the loaded points and of the bonds in the arms.

    Raises
    ------
    ValueError
        If an argument is out of range.

    References
    ----------
    Fichter 1983; Kanninen 1973.

    Examples
    --------
    >>> scene, expected = pd.scenes.double_cantilever(6, crack=2, length=5)
    >>> family = pd.lattice_family(dim=2, N=3, spacing=1 / 6)
    >>> stretch = pd.CriticalStretch.from_fracture_energy(1e-6, scene.model, family).stretch
    >>> criterion = pd.CriticalStretch(stretch, no_fail=expected.arms)
    >>> path = pd.solve_breaking(scene, criterion, load_steps=np.linspace(0.1, 0.5, 9), show_progress=False)
    >>> path.ending.name, path.broken_bonds > 0
    ('FINISHED', True)
    """
    N = checked_ratio(N)
    n, G, h = checked_count("n", n, round(N) + 2), checked_energy(fracture_energy), 1.0 / n
    if not (crack >= 2 and length >= crack + 3):
        raise ValueError(f"need crack >= 2 and length >= crack + 3, in heights of an arm; got {crack} and {length}")
    cells = round(length * n), 2 * n
    body = lattice(cells, h)
    X = body.positions
    tip = (round(crack * n) + 1) * h  # the load acts on the first column of points, at x = h/2
    own = families(body, N * h)
    arms = ~crossed(own, Plane((0.0, 1.0), (0.0, 1.0)))
    own = own.with_broken(crossed(own, Segment((-h, 1.0), (tip, 1.0))))
    end = X[:, 0] < h
    upper, lower = end & (X[:, 1] > 1), end & (X[:, 1] < 1)
    expected = DoubleCantilever(1.0, tip - h / 2, 0.0, 1.0, G, upper, arms)
    opening = 4 * expected.opening_at_onset()
    far = np.ravel_multi_index((cells[0] - 1, n - 1), cells), np.ravel_multi_index((cells[0] - 1, n), cells)
    fixed = scene(
        body,
        own,
        unit_plate() if model is None else model,
        conditions.prescribe(upper, opening / 2, components=1),
        conditions.prescribe(lower, -opening / 2, components=1),
        conditions.prescribe(list(far), 0.0),
        name="double cantilever",
    )
    return fixed, expected._replace(opening=opening)
