"""The atlas of models as one picture: a row for each model, a column for each dimension, path and side."""

import itertools

import matplotlib
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ..infinite_lattice.atlas import LAW, SIDES, Atlas

_SHORT = {"hydrostatic": "hydro-\nstatic", "uniaxial-strain": "uniaxial\nstrain", "uniaxial-stress": "uniaxial\nstress"}
_ARROW = {"compression": "−", "tension": "+"}
_PLAIN = {"at once": "#B2182B", "never": "#F7F7F7", "marginal": "#D9D9D9", "none": "#FFFFFF"}


def _columns(atlas: Atlas, N: float) -> list[tuple[int, str, str]]:
    """(dim, path, side) of every column."""
    dims = sorted({r["dim"] for r in atlas.records if r["N"] == N})
    out = []
    for dim in dims:
        paths = next((list(r["critical"]) for r in atlas.records if r["dim"] == dim and "critical" in r), [])
        out += [(dim, path, side) for path in paths for side in SIDES]
    return out


def _cell(record: dict | None, path: str, side: str) -> tuple[float | None, str, str]:
    """(critical strain that sets the colour, or None; name of a plain colour; text) of one cell."""
    if record is None or "critical" not in record or path not in record["critical"]:
        return None, "none", "–"
    value, before = record["critical"][path][side]
    value = float(value)
    free = before == "marginal"
    if value == 0:
        return None, "at once", "0"
    if np.isinf(value):
        return None, "marginal" if free else "never", "○" if free else "∞"
    return abs(value), "", f"{100 * abs(value):.3g}" + (" ○" if free else "")


def model_atlas(data: Atlas, N: float = 3.0) -> Figure:
    """Draw the critical strains of every model of an atlas, for one horizon.

    Parameters
    ----------
    data : Atlas
        Result of `pd.model_atlas`, or `pd.Atlas.load(path)`.
    N : float
        Horizon over spacing [-].

    Returns
    -------
    Figure
        A table of critical strains [%]. 0 means unstable at once, ∞ not unstable between −90 % and +100 %, – not
        defined. A ring marks states that are marginal at smaller loads, because the model has zero-energy waves.

    Raises
    ------
    ValueError
        If the atlas holds nothing for this N.

    Examples
    --------
    >>> critical = {"hydrostatic": {"compression": (-0.074, "stable"), "tension": (np.inf, "stable")}}
    >>> atlas = pd.Atlas([{"model": "my model", "dim": 1, "N": 3.0, "critical": critical}])
    >>> [text.get_text() for text in pd.figures.model_atlas(atlas).axes[0].texts][:2]
    ['7.4', '∞']
    """
    columns = _columns(data, N)
    names = list(dict.fromkeys(r["model"] for r in data.records if r["N"] == N))
    if not columns:
        raise ValueError(f"the atlas holds nothing for N = {N:g}; it has N = {sorted({r['N'] for r in data.records})}")
    gap = np.cumsum([0.0] + [0.35 if a[0] != b[0] else 0.0 for a, b in itertools.pairwise(columns)])
    x = np.arange(len(columns)) + gap
    colour, norm = matplotlib.colormaps["cividis"], LogNorm(0.003, 1.0)
    figure = Figure(figsize=(2.6 + 0.52 * (x[-1] + 1), 1.7 + 0.27 * len(names)), layout="constrained")
    axes = figure.subplots()
    for row, name in enumerate(names):
        for place, (dim, path, side) in zip(x, columns, strict=True):
            size, plain, text = _cell(data.find(name, dim, N), path, side)
            face = _PLAIN[plain] if size is None else colour(norm(size))
            dark = (size is None and plain != "at once") or (size is not None and norm(size) > 0.6)
            axes.add_patch(matplotlib.patches.Rectangle((place - 0.5, row - 0.5), 1, 1, fc=face, ec="white", lw=1))
            axes.text(place, row, text, ha="center", va="center", fontsize=7, color="black" if dark else "white")
    axes.set_xlim(-0.6, x[-1] + 0.6)
    axes.set_ylim(len(names) - 0.4, -0.6)
    shown = ["the law itself" if name == LAW else name for name in names]
    axes.set_yticks(range(len(names)), shown, fontsize=8)
    axes.set_xticks(x, [_ARROW[side] for _, _, side in columns], fontsize=10)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for i, (dim, path, side) in enumerate(columns):
        if side == SIDES[0]:
            label = _SHORT.get(path, path.replace("-", "\n"))
            axes.text(x[i] + 0.5, -1.15, f"{dim}D\n{label}", ha="center", va="bottom", fontsize=7.5)
    axes.set_xlabel(
        f"N = {N:g}: critical strain [%] by the symbol, compression − and tension +\n"
        "0: unstable at once   ∞: not within −90, +100 %   –: not defined\n"
        "○: marginal at smaller loads (zero-energy waves)",
        fontsize=8,
    )
    return figure
