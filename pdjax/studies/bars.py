"""Static bars next to their known solutions, for the command line, the notebooks and the figures of the paper."""

import numpy as np


def singular_curves(scene, stress: float, alpha: float = 10.0) -> dict[str, np.ndarray]:
    """The two closed forms of the singular bar: name → u (points,)."""
    import pdjax as pd

    x = scene.body.positions[:, 0]
    printed = pd.closed_forms.singular_bar_displacement(x, 1.0, stress, alpha)
    return {
        "nonlinear local solution": np.asarray(scene.closed_form)[:, 0],
        "printed, small strain": np.asarray(printed),
    }


def bar_case(scene, result, what: str, value: float, curves: dict[str, np.ndarray]):
    """One solved bar: the column that `pd.figures.bars` draws, and a dictionary of the results."""
    import pdjax as pd

    x, u, known = scene.body.positions[:, 0], np.asarray(result.u)[:, 0], np.asarray(scene.closed_form)[:, 0]
    own = result.stability
    row = {
        "load": value,
        "converged": result.converged,
        "reason": result.reason,
        "iterations": int(result.iterations),
        "residual": result.residual,
        "kind": result.kind,
        "eigenvalue": None if own is None else own.eigenvalue,
        "positive": None if own is None else own.positive,
        "turned": int(result.turned),
        "distance": float(np.linalg.norm(u - known) / np.linalg.norm(known)),
    }
    short = result.kind if result.converged else "not converged"
    mode = None if own is None else np.asarray(own.mode)[:, 0]
    verdict = "" if own is None else f"λ = {own.eigenvalue:+.3g}, {own.positive} positive".replace("-", "−")
    case = pd.figures.BarCase(f"{what}: {short}", x, u, curves or {"homogeneous": known}, value, value, mode, verdict)
    return case, row
