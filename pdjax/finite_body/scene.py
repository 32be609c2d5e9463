"""The boundary value problem of a finite body, and the checks that it is well posed.

A scene combines a body, its families, a material model, supports and loads. The unknowns q are the free components
of the displacement u. The held components are eliminated. Let S be the matrix that selects the free components (one
row of the identity for each of them). Then the residual r, the displacement and the reduced Jacobian A are

    r(q) = S V (f(u) + λ b),   u = λ û + Sᵀ q,      A = ∂r/∂q = S V J Sᵀ

f is the net internal force density, J = ∂f/∂u its Jacobian, V the diagonal matrix of the volumes of the points, b the
body force density and û the prescribed displacement. λ is the load factor. The prescribed displacements û, the body
forces b and the mean deformation of a periodic body grow in proportion to it.

Π is the potential energy. For a model with an energy, V J is the exact Hessian of −Π, so A is symmetric. At a minimum
of Π, A is negative definite.

A rigid motion that no support prevents makes A singular. `scene` looks for such motions in every connected piece of
the body, that is, in every set of points that no bond joins to the other points. The error message names them.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._internal.checks import Numbers, Tree, as_array, deformation_gradient, is_concrete, namespace, on_device, on_host
from .._internal.public import public_function
from ..force.fields import check_model
from ..force.operator import ForceOperator, force_density, force_operator
from ..geometry.bonds import Families
from ..geometry.points import Points, check_body
from ..models.base import AbstractModel
from .conditions import Condition, HomogeneousTraction, Prescribed, TotalForce, check_points
from .rigid_motions import free_pieces


class Scene(eqx.Module):
    """The boundary value problem of a finite body.

    `scene` and the functions of `pdjax.scenes` return one.

    Attributes
    ----------
    body : Points
        The points of the body.
    families : Families
        Families of the body.
    model : AbstractModel
        The material model.
    unknowns : int array, shape (unknowns,)
        Indices of the free components in the flattened displacement of shape (points·dim,).
    prescribed : array, shape (points, dim)
        Prescribed displacements [length] at load factor 1; 0 where a component is free.
    load : array, shape (points, dim)
        Body force density [force/length^dim] at load factor 1.
    mean : array, shape (dim, dim), or None
        Mean deformation gradient [-] of a periodic body at load factor 1.
    closed_form : array, shape (points, dim), or None
        The known displacement [length] at load factor 1.
    name : str
        Name of the scene in messages and figures.
    operator : ForceOperator or None
        The prepared force, see `prepared`.

    Examples
    --------
    >>> body = pd.bar(2, 2.0)
    >>> families, model = pd.families(body, 1.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
    >>> pair = pd.scene(body, families, model, pd.prescribe(0), pd.total_force([1], [0.1]))
    >>> pair.free.ravel()
    array([False,  True])
    """

    body: Points
    families: Families
    model: AbstractModel
    unknowns: Int[np.ndarray | Array, " unknowns"]
    prescribed: Float[Array, "points dim"]
    load: Float[Array, "points dim"]
    mean: Float[Array, "dim dim"] | None
    closed_form: Float[Array, "points dim"] | None
    name: str = eqx.field(static=True, default="scene")
    operator: ForceOperator | None = None

    @property
    def free(self) -> Bool[np.ndarray, "points dim"]:
        """True where a component of the displacement is unknown; bool array of shape (points, dim)."""
        flags = np.zeros(self.prescribed.size, dtype=bool)
        flags[np.asarray(self.unknowns)] = True
        return flags.reshape(self.prescribed.shape)

    def displacement(self, q: Float[Array | np.ndarray, " unknowns"], factor=1.0) -> Float[Array, "points dim"]:
        """Assemble the displacement u = λ û + Sᵀ q of all points.

        Parameters
        ----------
        q : array, shape (unknowns,)
            Free components of the displacement [length].
        factor : float, optional
            Load factor λ [-].

        Returns
        -------
        array, shape (points, dim)
            Displacements [length].

        Examples
        --------
        >>> body = pd.bar(2, 2.0)
        >>> families, model = pd.families(body, 1.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
        >>> held = pd.scene(body, families, model, pd.prescribe(0, 0.4))
        >>> np.asarray(held.displacement(np.array([3.0]), factor=0.5)).ravel()
        array([0.2, 3. ])
        """
        shape, dtype = self.prescribed.shape, self.prescribed.dtype
        if is_concrete(self.prescribed, self.unknowns, q, factor):
            u = np.asarray(factor, dtype) * np.asarray(self.prescribed)
            u.reshape(-1)[np.asarray(self.unknowns)] = np.asarray(q)
            return jax.device_put(u)
        flat = (jnp.asarray(factor, dtype) * self.prescribed).reshape(-1)
        return flat.at[self.unknowns].set(q).reshape(shape)

    def mean_deformation(self, factor=1.0):
        """Mean deformation gradient I + λ (F − I) of a periodic body at a load factor.

        Parameters
        ----------
        factor : float, optional
            Load factor λ [-].

        Returns
        -------
        array, shape (dim, dim), or None
            Mean deformation gradient [-]. None if the scene prescribes no mean deformation.

        Examples
        --------
        >>> ring = pd.lattice((11,), periodic=True)
        >>> families, model = pd.families(ring, 2.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
        >>> stretched = pd.scene(ring, families, model, pd.prescribe(0), mean=[[1.2]])
        >>> round(float(stretched.mean_deformation(0.5)[0, 0]), 3)
        1.1
        """
        if self.mean is None:
            return None
        xp = namespace(self.mean, factor)
        mean, factor = on_host((self.mean, factor)) if xp is np else (self.mean, factor)
        eye = xp.eye(mean.shape[0], dtype=mean.dtype)
        return on_device(eye + factor * (mean - eye))

    def prepared(self, way: str = "auto") -> "Scene":
        """Copy the scene with a prepared force operator, for loops of many force evaluations.

        The operator holds every part of the force that does not depend on the displacement.

        Parameters
        ----------
        way : str, optional
            Backend of the force, see `force_operator`.

        Returns
        -------
        Scene
            The same scene with its field `operator` set.

        Examples
        --------
        >>> body = pd.bar(2, 2.0)
        >>> families, model = pd.families(body, 1.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
        >>> pair = pd.scene(body, families, model, pd.prescribe(0))
        >>> pair.operator is None, pair.prepared().operator is None
        (True, False)
        """
        operator = force_operator(self.model, self.families, way, mean=self.mean is not None)
        return eqx.tree_at(lambda s: s.operator, self, operator, is_leaf=lambda x: x is None)

    def unbalanced(self, u: Float[Numbers, "points dim"], factor=1.0) -> Float[Array, "points dim"]:
        """Unbalanced force V (f + λ b) on every point.

        On a free component it is zero in equilibrium. On a held component it is minus the reaction of the support.

        Parameters
        ----------
        u : array, shape (points, dim)
            Displacements [length].
        factor : float, optional
            Load factor λ [-].

        Returns
        -------
        array, shape (points, dim)
            Force [force].

        Examples
        --------
        >>> body = pd.bar(2, 2.0)
        >>> families, model = pd.families(body, 1.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
        >>> pair = pd.scene(body, families, model, pd.prescribe(0), pd.total_force([1], [0.1]))
        >>> np.asarray(pair.unbalanced(np.zeros((2, 1)))).ravel()
        array([0. , 0.1])
        """
        F = self.mean_deformation(factor)
        f = force_density(self.model, self.families, u, F) if self.operator is None else self.operator(u, F)
        return self.families.volumes[:, None] * (f + factor * self.load)


def _spread(value: Numbers, shape: tuple[int, int], name: str) -> Numbers:
    """Broadcast `value` to every named point and component; the result is a NumPy array if `value` is concrete."""
    try:
        return namespace(value).broadcast_to(value, shape)
    except ValueError:
        raise ValueError(f"{name} must broadcast to (points named, components) = {shape}; got {value.shape}") from None


def _check_points(condition: Condition, points: int) -> np.ndarray:
    return check_points(type(condition).__name__, condition.points, condition.mask, points)


def _put(array: Numbers, index: tuple[np.ndarray, ...], new: Numbers, add: bool = False) -> Numbers:
    """The array with `new` set at the index or added to it; concrete arrays are changed in place."""
    if namespace(array, new) is np:
        array[index] = new + array[index] if add else new
        return array
    array = jnp.asarray(array)
    return array.at[index].add(new) if add else array.at[index].set(new)


def _prescribe(conditions: Sequence[Condition], shape: tuple[int, int], eps: float) -> tuple[np.ndarray, Numbers]:
    """Which components are held, (points, dim), and their values.

    Raises ValueError if two prescriptions of one component differ by more than eps, relative to the larger value.
    """
    held = np.zeros(shape, dtype=bool)
    value: Numbers = np.zeros(shape, jnp.result_type(float))
    for condition in conditions:
        if not isinstance(condition, Prescribed):
            continue
        p = _check_points(condition, shape[0])
        c = np.arange(shape[1]) if condition.components is None else np.asarray(condition.components)
        if c.min() < 0 or c.max() >= shape[1]:
            raise ValueError(f"components must lie in 0 to {shape[1] - 1} for this body; got {condition.components}")
        new = _spread(condition.u, (len(p), len(c)), "u of prescribe")
        if is_concrete(new) and not np.isfinite(np.asarray(new)).all():
            raise ValueError("u of prescribe must be finite; it holds NaN or infinity")
        again = held[np.ix_(p, c)]
        if again.any() and is_concrete(new, value):
            old = np.asarray(value)[np.ix_(p, c)]
            scale = max(float(np.abs(old).max()), float(np.abs(new).max()))
            clash = again & (np.abs(old - np.asarray(new)) > eps * scale)
            if clash.any():
                i, k = np.argwhere(clash)[0]
                raise ValueError(
                    f"contradictory prescriptions: component {c[k]} of point {p[i]} is held at {old[i, k]:g} and at"
                    f" {float(new[i, k]):g} ({int(clash.sum())} such components)"
                )
        held[np.ix_(p, c)] = True
        value = _put(value, np.ix_(p, c), new)
    return held, value


def _load(conditions: Sequence[Condition], body: Points, families: Families, model, held: np.ndarray) -> Numbers:
    load: Numbers = np.zeros(held.shape, jnp.result_type(float))
    for condition in conditions:
        if isinstance(condition, Prescribed):
            continue
        p = _check_points(condition, len(body))
        shape = (len(p), body.dim)
        if isinstance(condition, HomogeneousTraction):
            F = deformation_gradient(condition.F, body.dim)
            pulled = model if condition.model is None else condition.model
            force = on_host(force_density(pulled, families, on_device(np.zeros(held.shape)), F))
            b = namespace(force).where(held[p], 0.0, -force[p])
        elif isinstance(condition, TotalForce):
            force = on_host(condition.force)
            if np.shape(force) not in ((body.dim,), () if body.dim == 1 else (body.dim,)):
                raise ValueError(
                    f"force of total_force must be a vector ({body.dim},), one component for each direction; got shape"
                    f" {np.shape(force)}"
                )
            b = _spread(force / float(body.volumes[p].sum()), shape, "force of total_force")
        else:
            if body.dim > 1 and np.ndim(condition.b) == 0:
                raise ValueError(f"b of body_force must be a vector ({body.dim},) or one for each point; got a number")
            b = _spread(condition.b, shape, "b of body_force")
        value = b if is_concrete(b) else jax.lax.stop_gradient(b)
        clash = held[p] & ((np.asarray(value) != 0) if is_concrete(value) else False)
        if clash.any():
            i, k = np.argwhere(clash)[0]
            raise ValueError(
                f"a load on a held component does nothing: component {k} of point {p[i]} is prescribed and loaded"
                f" ({int(clash.sum())} such components); remove one of the two"
            )
        if is_concrete(b) and not np.isfinite(np.asarray(b)).all():
            raise ValueError("a load must be finite; it holds NaN or infinity")
        load = _put(load, (p,), b, add=True)
    return load


def _check_held(body: Points, families: Families, held: np.ndarray) -> None:
    """Raise ValueError that names the rigid motions of each connected piece that no support prevents.

    Families that are traced by a JAX transformation are not checked, since their values are unknown.
    """
    if not is_concrete(families):
        return
    for piece in free_pieces(body.positions, families, held, body.period is not None):
        where = (
            "the body" if piece.of == 1 else f"piece {piece.number} of {piece.of} (it contains point {piece.points[0]})"
        )
        raise ValueError(
            f"{where} is under-constrained: nothing holds its {', '.join(piece.names)}"
            f" ({len(piece.motions)} rigid motions free); prescribe displacements that stop them, or make the scene"
            " with moving=True if it is to move in time"
        )


def _checked_conditions(conditions: Sequence[object]) -> list[Condition]:
    """The conditions, or ValueError for an argument that is not a condition."""
    checked = []
    for condition in conditions:
        if isinstance(condition, list | tuple) and not isinstance(condition, Condition):
            raise ValueError(
                "conditions must be given one by one, as in scene(body, families, model, held, pulled); got a"
                f" {type(condition).__name__}: unpack it with a star, *conditions"
            )
        if not isinstance(condition, Condition):
            raise ValueError(f"conditions must come from prescribe, body_force, total_force …; got {condition!r:.80}")
        checked.append(condition)
    return checked


@public_function
def scene(
    body: Points,
    families: Families,
    model: AbstractModel,
    *conditions: object,
    mean=None,
    closed_form=None,
    moving: bool = False,
    name: str = "scene",
) -> Scene:
    """Make the boundary value problem of a body from its model, supports and loads.

    Parameters
    ----------
    body : Points
        The points of the body.
    families : Families
        Families of this body, from `families`.
    model : AbstractModel
        The material model.
    *conditions : Prescribed, BodyForce, TotalForce or HomogeneousTraction
        Supports and loads at load factor 1, from `prescribe`, `body_force`, `total_force`, `homogeneous_traction`.
    mean : array, shape (dim, dim), optional
        Mean deformation gradient [-] of a periodic body at load factor 1.
    closed_form : array, shape (points, dim), optional
        A displacement [length] that is known to solve the problem, or that the solution is compared with.
    moving : bool, optional
        True for dynamics: then the supports need not prevent rigid motions.
    name : str, optional
        Name of the scene in messages and figures.

    Returns
    -------
    Scene
        The boundary value problem. Pass it to `solve`, `equilibrium_path`, `body_stability` or `motion`.

    Raises
    ------
    ValueError
        If the families belong to another body, two prescriptions contradict each other, a load acts on a held
        component, every component is held, or the supports leave a rigid motion of a connected piece free. The
        message names the points or the motions.

    Examples
    --------
    >>> body = pd.lattice((5, 4))
    >>> families, model = pd.families(body, horizon=2.1), pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> left = body.positions[:, 0] < 1
    >>> plate = pd.scene(body, families, model, pd.prescribe(left), pd.body_force(~left, [0.01, 0.0]))
    >>> plate.unknowns.size  # 20 points with two components each, 4 points held
    32
    """
    check_body("body", body)
    check_model(model, families, Families)  # raises for families that the model cannot use
    checked = _checked_conditions(conditions)
    if len(families) != len(body) or families.dim != body.dim:
        raise ValueError(
            f"families must be families of this body of {len(body)} points in {body.dim}D; got those of"
            f" {len(families)} points in {families.dim}D: make them with pdjax.families(body, horizon)"
        )
    if mean is not None and body.period is None:
        raise ValueError(
            "mean deformation is for periodic bodies only; this body is not periodic: prescribe displacements instead"
        )
    shape = (len(body), body.dim)
    held, value = _prescribe(checked, shape, 16 * float(jnp.finfo(families.dtype).eps))
    if held.all():
        raise ValueError("the body is over-constrained: every displacement is prescribed and nothing is left to solve")
    if not moving:
        _check_held(body, families, held)
    load = _load(checked, body, families, model, held)
    real = families.dtype
    if closed_form is not None:
        closed_form = as_array(closed_form, real)
        if closed_form.shape != shape:
            raise ValueError(f"closed_form must have shape (points, dim) = {shape}; got {closed_form.shape}")
    if mean is not None:
        mean = as_array(deformation_gradient(mean, body.dim), real)
    return Scene(
        body,
        families,
        model,
        np.flatnonzero(~held.reshape(-1)).astype(np.int32),
        on_device(value.astype(real)),
        on_device(load.astype(real)),
        mean,
        closed_form,
        name,
    )


def frozen(scene: Tree) -> Tree:
    """The scene as a constant, through which no derivative flows.

    A concrete scene is returned unchanged, so that the cached data of its families stay in use.
    """
    if is_concrete(scene):
        return scene
    arrays = jax.lax.stop_gradient(eqx.filter(scene, eqx.is_array))
    return eqx.combine(arrays, eqx.filter(scene, eqx.is_array, inverse=True))
