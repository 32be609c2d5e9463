"""`identify`: parameters of a model from measured data, by nonlinear least squares with exact Jacobians.

    minimise over θ     ½ Σ ((y(θ) − d)/σ)² + ½ ‖ρ(θ)‖²        within bounds

θ are the parameters, y the predictions, d the data, σ their noise and ρ the residuals of the regularisation. The method
is the trust-region reflective Gauss–Newton method of `scipy.optimize.least_squares`. The Jacobian of y comes from
`pdjax.optimise.predictions`, the search is in `pdjax.optimise.least_squares`.

The search works with the parameters divided by their scales: |start|, but at least the root mean square of start over
the array of the parameter. Where that is 0, the scale is the largest |start| of all parameters, or 1. A trial point
without a prediction counts as infinitely bad, and the step becomes a quarter as long. Along directions that change no
residual at the start, the parameters keep their start.

Sources: Branch, Coleman & Li 1999 (the method); Tarantola 2005 (least squares, covariance).
"""

import inspect
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._internal.checks import choice
from .._internal.public import public_function
from ..finite_body.dynamics.system import Motion
from ..finite_body.scene import Scene
from .identified import Identified, IdentifyEnding, Solves, uncertainty
from .least_squares import Search, minimise
from .measured import Measured
from .parameters import Parameters
from .predict_motions import Dynamics
from .predict_statics import Statics
from .predictions import Function, LeftDomain

DERIVATIVES = ("auto", "tangent", "adjoint")
# Time of a reverse run over that of a tangent run: 0.98 and 0.52 of a forward run of 2000 points, for 16 of each.
REVERSE = 2


def _problem(scene_of, parameters: Parameters, measure, run: dict) -> Any:
    """The kind of problem that scene_of makes at the start."""
    first = scene_of(parameters.tree(parameters.flat))
    if isinstance(first, Motion):
        return Dynamics(scene_of, parameters, first, measure, **run)
    given = [name for name, value in run.items() if value is not None]
    if given:
        raise ValueError(f"{', '.join(given)} must be given for motions only; scene_of returns {type(first).__name__}")
    if isinstance(first, Scene):
        return Statics(scene_of, parameters, first, measure)
    if measure is not None:
        raise ValueError(
            "measure must be given for a scene or a motion only. scene_of returns the predictions themselves, as"
            f" {type(first).__name__}"
        )
    return Function(scene_of, parameters)


def _takes_one(function: Callable) -> bool:
    """Whether a function can be called with one argument."""
    try:
        inspect.signature(function).bind(None)
    except TypeError:
        return False
    except ValueError:  # it has no signature that Python knows
        pass
    return True


def _bounds(parameters: Parameters, bounds, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    try:
        lower, upper = (None, None) if bounds is None else bounds
    except (TypeError, ValueError):
        raise ValueError(f"bounds must be a pair (lower, upper); got {bounds!r:.80}") from None
    low = parameters.flat_of("the lower bounds", lower, -np.inf)
    high = parameters.flat_of("the upper bounds", upper, np.inf)
    wrong = np.flatnonzero(~((low < high) & (low <= parameters.flat) & (parameters.flat <= high)))
    if wrong.size:
        k = wrong[0]
        raise ValueError(
            f"start must lie within bounds, and lower below upper; {parameters.names[k]} starts at"
            f" {parameters.flat[k]:g} with bounds {low[k]:g} and {high[k]:g}"
        )
    return low / scale, high / scale


@public_function
def identify(
    scene_of: object,
    start: object,
    observed: object,
    *,
    noise: object = None,
    where: object = None,
    measure: Callable | None = None,
    bounds: object = None,
    regularisation: object = None,
    duration: float | None = None,
    dt: float | None = None,
    save_every: int | None = None,
    derivative: str = "auto",
    tolerance: float = 1e-10,
    max_solves: int = 100,
    show_progress: bool = True,
    throw: bool = False,
) -> Identified:
    """Identify parameters from measured data by nonlinear least squares.

    minimise ½ Σ ((y(θ) − d)/σ)² + ½ ‖ρ(θ)‖², with the predictions y, the data d, their noise σ and a regularisation ρ

    Parameters
    ----------
    scene_of : function
        Parameters → `Scene` (statics), `Motion` (dynamics), or the predicted data themselves (an array or a tree of
        arrays). It must use jax.numpy for what depends on the parameters. Make the families outside of it if they do
        not depend on the parameters.
    start : tree of floats and arrays
        Parameters at which the search starts.
    observed : array or tree of arrays
        The data d: without `measure` the displacements [length], shape (points, dim), of the equilibrium, or those of
        all saves of the run, shape (saves, points, dim).
    noise : float, array or tree, optional
        Standard deviation σ of the noise, in the unit of the data. Default: unknown. The residuals are then divided by
        the root mean square of the data, and the covariance takes σ from the residuals.
    where : bool array or tree, optional
        True where a value was measured: a mask of the data or, for displacements, of the points. Default: everywhere.
    measure : function, optional
        (scene, u) → predicted data for statics, (motion, history) → predicted data for dynamics, as an array or a
        tree of arrays. It uses jax.numpy. Default: the displacements.
    bounds : pair (lower, upper), optional
        Bounds of the parameters: each a number, a tree like `start`, or None.
    regularisation : function or sequence of functions, optional
        Parameters → residuals ρ [-], such as `tikhonov` or `total_variation`.
    duration, dt, save_every : optional
        For motions: as in `simulate`. `dt` must be given, because the saves must keep their times.
    derivative : str, optional
        "tangent" (one linearised solve for each parameter), "adjoint" (one for each datum), or "auto", the cheaper.
    tolerance : float, optional
        Relative change [-] of the cost or of the parameters at which the search ends. Default 1e-10.
    max_solves : int, optional
        Largest number of forward solves. Default 100.
    show_progress : bool, optional
        Show the iterations and the cost on a terminal.
    throw : bool, optional
        Raise RuntimeError if the search does not converge.

    Returns
    -------
    Identified
        The parameters with their covariance, what the data do not determine, and how the search ended.

    Raises
    ------
    ValueError
        If an argument is wrong, if data are NaN or have another shape than the predictions, if there is no prediction
        at the start, or if the predictions depend on no parameter.
    RuntimeError
        If `throw` is True and the search did not converge.

    Notes
    -----
    The covariance is linearised, and it assumes that the model is right. A regularisation counts as prior knowledge. It
    adds a bias that the covariance does not contain. Displacements under prescribed displacements determine moduli only
    up to a common factor. Measure a force too. The search ends at once at a start where all derivatives vanish.

    References
    ----------
    Branch, Coleman & Li 1999; Tarantola 2005

    Examples
    --------
    The stiffness of a spring of length 1 from its extension of 0.2 under a force of 1:

    >>> pair = pd.bar(2, 2.0)
    >>> families, ends = pd.families(pair, 1.0), (pd.prescribe(0), pd.total_force([1], [1.0]))
    >>> spring = lambda p: pd.scene(pair, families, pd.BondBased(p["c"]), *ends)
    >>> found = pd.identify(spring, {"c": 1.0}, [[0.0], [0.2]], noise=0.01)
    >>> round(float(found.parameters["c"]), 6), found.identifiable
    (5.0, True)

    The same stiffness from the force of 1 on an end, where the ends of two such springs are held. `measure` returns the
    force, because the displacements under prescribed displacements do not depend on the stiffness.

    >>> row = pd.bar(3, 3.0)
    >>> families, ends = pd.families(row, 1.0), pd.prescribe([0, 2], [[0.0], [0.4]])
    >>> springs = lambda p: pd.scene(row, families, pd.BondBased(p["c"]), ends)
    >>> force = lambda scene, u: -scene.unbalanced(u)[2]
    >>> found = pd.identify(springs, {"c": 1.0}, [1.0], noise=0.01, measure=force)
    >>> round(float(found.parameters["c"]), 6), found.identifiable
    (5.0, True)
    """
    if jnp.result_type(float) != np.float64:
        raise ValueError(
            "identify needs float64, because it differentiates solutions; before anything else call"
            ' jax.config.update("jax_enable_x64", True)'
        )
    if not (callable(scene_of) and _takes_one(scene_of)):
        raise ValueError(
            "scene_of must be a function of one argument, the parameters, which returns a scene, a motion or data; got"
            f" {scene_of!r:.80}"
        )
    choice("derivative", derivative, DERIVATIVES)
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance must lie between 0 and 1; got {tolerance}")
    if not (float(max_solves).is_integer() and max_solves >= 1):
        raise ValueError(f"max_solves must be a whole number >= 1; got {max_solves!r}")
    parameters = Parameters(start)
    scale = parameters.scales()
    low, high = _bounds(parameters, bounds, scale)
    problem = _problem(scene_of, parameters, measure, {"duration": duration, "dt": dt, "save_every": save_every})
    try:
        predicted = problem.predict(parameters.flat)
    except LeftDomain as error:
        raise ValueError(f"start must be parameters with a prediction: {error}. Start at other parameters") from None
    measured = Measured(observed, predicted, problem.what, where, noise)
    if not np.isfinite(measured.first).all():
        raise ValueError(
            "start must be parameters with a finite prediction; the prediction there is not finite. For a motion take a"
            " smaller dt, otherwise other parameters"
        )
    parts = regularisation if isinstance(regularisation, list | tuple) else (regularisation,)
    parts = tuple(part for part in parts if part is not None)
    if not all(map(callable, parts)):
        raise ValueError(f"regularisation must be functions of the parameters; got {regularisation!r:.80}")
    reverse = 1 if isinstance(problem, Statics) else REVERSE
    adjoint = derivative == "adjoint" or (derivative == "auto" and reverse * measured.index.size < scale.size)
    search = Search(problem, measured, parameters, scale, parts, adjoint, show_progress)
    code = minimise(search, parameters.flat / scale, (low, high), tolerance, int(max_solves))
    result = _result(search, code)
    if throw and not result.converged:
        raise RuntimeError(f"identify did not converge: {result}")
    return result


def _result(search: Search, code: IdentifyEnding) -> Identified:
    assert search.best is not None
    _, flat, data, J, R = search.best
    names, measured, parameters = tuple(search.parameters.names), search.measured, search.parameters
    found = uncertainty(J, R, data, measured.known, names)
    covariance = found.covariance * np.outer(search.scale, search.scale)
    linearised = search.jacobians * (measured.index.size if search.adjoint else flat.size)
    solves = Solves(
        search.forward,
        0 if search.adjoint else linearised,
        linearised if search.adjoint else 0,
        search.jacobians * flat.size,
    )
    return Identified(
        parameters.tree(flat),
        covariance,
        parameters.tree(np.sqrt(np.diag(covariance))),
        measured.residual(data),
        float(np.sqrt(np.mean(data**2))),
        np.array(search.history),
        solves,
        found.identifiable,
        found.singular_values,
        found.direction,
        names,
        found.words,
        int(code),
        search.failures,
        search.failure if search.failures else None,
        flat,
    )
