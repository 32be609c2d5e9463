"""One family in a uniform deformation: the schematic of the paper on a lattice, and one row of the Jacobian.

    J⟨η⟩ = ∂f(X)/∂x(X + η),   non-zero within two horizons;   the test of the paper is its diagonal at η = 0

The numbers compare the general formula of J⟨η⟩ with reverse-mode differentiation of the force on one point. They also
show: whether uniform states are equilibria; what the static equation sums; how moving the centre changes its strain;
where the nonlocal strain equals the local one; Silling's model by its diagonal block and by its symbol.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

import pdjax as pd

from ...figures import COLOURS, SERIES
from .. import closed_forms as cf
from ._common import Found, close, judge, linear, of_order, signed, sizes

N, M = 3, 0.7
STATE = np.array([[0.93, 0.06], [-0.04, 1.05]])
LAW = linear(1.0, 1.0)


def rows(F=STATE, m=M) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """η (points, 2) [h]; J⟨η⟩ (points, 2, 2) by autodiff of the force on one point of a lattice, and by the formula."""
    side = 4 * N + 1
    body = pd.lattice((side, side), periodic=True)
    families, centre = pd.families(body, float(N)), len(body) // 2
    eta, model, family = body.positions - body.positions[centre], of_order(m, LAW), pd.lattice_family(2, N)

    def force(u):
        return pd.force_density(model, families, u, F)[centre]

    exact = jnp.moveaxis(jax.jit(jax.jacrev(force))(jnp.zeros_like(eta)), 1, 0)

    @jax.jit
    def formula(eta):
        strain = model.strain(family.bonds(F))
        stress, tangent = jax.grad(LAW.energy)(strain), jax.hessian(LAW.energy)(strain)
        one = jnp.ones(len(family.xi))
        return jax.vmap(lambda e: cf.jacobian_entry(e, family.xi, one, 1.0, F, m, stress, tangent))(eta)

    return eta, np.asarray(exact), np.asarray(formula(eta))


def strain_gaps() -> dict[str, float]:
    """Largest component of Ē_m − E_m, 2D, N = 3: for λQ, for stretches of 1 % and 10 %, and for a shear."""
    family = pd.lattice_family(2, N)
    one, turn = np.ones(len(family.xi)), np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    states = (1.2 * turn, np.diag([1.01, 1.0]), np.diag([1.1, 1.0]), np.array([[1.0, 0.1], [0.0, 1.0]]))
    defect = jax.jit(lambda F, m: abs(cf.strain_defect(F, m, family.xi, one)).max())
    gap = {m: [float(defect(F, m)) for F in states] for m in (-1.0, 0.0, 0.5, 1.0, 2.0)}
    others = [g for m, g in gap.items() if m != 1]
    return {
        "m = 1, any state": max(gap[1.0]),
        "any m, similarities": max(g[0] for g in gap.values()),
        "m = 0, 10 % stretch": gap[0.0][2],
        "largest ratio of 10 % to 1 % stretch": max(g[2] / g[1] for g in others),
        "smallest ratio of 10 % to 1 % stretch": min(g[2] / g[1] for g in others),
    }


def uniform_state() -> dict[str, float]:
    """Net force of a uniform state, summand of the static equation, and ∂Ē/∂x of a moved centre."""
    family, model = pd.lattice_family(2, N), of_order(M, LAW)
    T = np.asarray(eqx.filter_jit(pd.force_state)(model, family, STATE))
    there = np.roll(T, len(T) // 2, axis=0)  # T⟨−ξ⟩(X + ξ), as bond b + bonds/2 is opposite to bond b
    at = family.bonds(jnp.asarray(STATE))
    move = jnp.zeros_like(at.eta).at[:, 0].set(-1.0)
    change = jax.jvp(lambda eta: model.strain(at._replace(eta=eta)), (at.eta,), (move,))[1]
    return {
        "net force": float(abs((T - there).sum(axis=0)).max() / abs(T).sum()),
        "bracket, exact": float(abs(T - there).max()),
        "bracket, printed": float(abs(np.asarray(cf.static_integrand(T, T, "printed"))).max()),
        "bracket, corrected": float(abs(np.asarray(cf.static_integrand(T, T))).max()),
        "strain of a moved centre": float(abs(change).max()),
    }


def silling() -> dict:
    """Silling's model at ±5 %: largest eigenvalue of the diagonal block and of the symbol at the zone's corner."""
    family, model, corner = pd.lattice_family(2, N), pd.Correspondence(LAW), np.pi * np.ones(2)
    found = {}
    for a in (-0.05, 0.05):
        F = (1 + a) * np.eye(2)
        block = np.linalg.eigvalsh(np.asarray(pd.center_block(model, family, F)))
        wave = np.linalg.eigvalsh(np.asarray(pd.symbol(model, family, F, corner)))
        found[f"{a:+g}"] = {
            "block": float(block[-1]),
            "at the corner": float(abs(wave).max()),
            "verdict": pd.stability(model, family, F).verdict,
        }
    return found


def make(quick: bool) -> tuple[dict, Figure]:
    """The sheet `family`."""
    eta, exact, formula = rows()
    size = np.linalg.norm(exact, 2, axis=(1, 2))
    reached = size > 1e-12 * size.max()
    numbers = {
        "entries of a row": int(reached.sum()),
        "formula from autodiff": float(abs(exact - formula).max() / abs(exact).max()),
        "strain": strain_gaps(),
        "uniform": uniform_state(),
        "Silling": silling(),
    }
    return numbers, draw(eta[reached], size[reached], numbers, quick)


def draw(eta: np.ndarray, size: np.ndarray, numbers: dict, quick: bool) -> Figure:
    """Draw the family on its lattice (left) and the size of each entry of the point's row of the Jacobian (right)."""
    figure = Figure(figsize=(10.2, 4.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    side = np.arange(-2 * N - 1, 2 * N + 2)
    grid = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    inside = (np.linalg.norm(grid, axis=1) <= N * (1 + 1e-9)) & np.any(grid != 0, axis=1)
    left.scatter(*grid[~inside].T, s=9, color="#BBBBBB")
    left.scatter(*grid[inside].T, s=14, color=SERIES[0], label="family of X")
    left.plot(0, 0, "o", color=COLOURS["diagonal"], markersize=7, label="X")
    left.annotate("", (-2, 2), (0, 0), arrowprops={"arrowstyle": "->", "color": SERIES[0], "lw": 1.6})
    left.text(-1.5, 0.45, "ξ", color=SERIES[0], fontsize=12)
    left.text(-4.6, 2.35, "X + ξ", color=SERIES[0], fontsize=9)
    left.add_patch(Circle((0, 0), N, fill=False, color=SERIES[0], lw=1.2))
    left.text(N * 0.72, N * 0.78, "horizon δ", color=SERIES[0], fontsize=9)
    left.set_title(f"the schematic of the paper on a lattice: {inside.sum()} bonds, N = {N}", fontsize=10)
    left.legend(fontsize=8, frameon=True, loc="lower right")
    marks = right.scatter(
        *eta.T, s=46, c=size / size.max(), cmap="cividis_r", norm=LogNorm(1e-3, 1), edgecolor="#555555", linewidth=0.3
    )
    right.plot(0, 0, "o", mfc="none", mec=COLOURS["diagonal"], mew=2, markersize=12, label="diagonal block")
    for radius in (N, 2 * N):
        right.add_patch(Circle((0, 0), radius, fill=False, color="#888888", lw=0.9, ls="--"))
    right.set_title(f"row of the Jacobian: {numbers['entries of a row']} entries, within two horizons", fontsize=10)
    right.legend(fontsize=8, loc="lower right")
    figure.colorbar(marks, ax=right, label="‖J⟨η⟩‖ / ‖J⟨0⟩‖  [–]", shrink=0.85)
    for on, name in ((left, "ξ"), (right, "η")):
        on.set_xlabel(f"{name}₁ / h  [–]")
        on.set_ylabel(f"{name}₂ / h  [–]")
        on.set_xlim(-7.6, 7.6)
        on.set_ylim(-7.6, 7.6)
        on.set_aspect("equal")
    figure.suptitle(
        f"One family, and the points on which the force of X depends: 2D, m = {M:g}{sizes(quick)}", fontsize=11
    )
    return figure


# --- what the numbers say of the claims


def equilibrium(n: dict) -> Found:
    """Section 3.1."""
    size = n["uniform"]["net force"]
    return f"the net force is {size:.0e} of the sum of the bond forces", judge(size < 1e-14)


def static(n: dict) -> Found:
    """The static equation of a uniform deformation (section 3.1)."""
    u = n["uniform"]
    exact = u["bracket, exact"]
    ours = f"T + T, with components up to {exact:.4f}; the printed ones are {u['bracket, printed']:.4f}; both sum to 0"
    return ours, judge(close(u["bracket, printed"], exact), close(u["bracket, corrected"], exact))


def entry(n: dict) -> Found:
    """The general entry of the Jacobian (section 3.2)."""
    gap = n["formula from autodiff"]
    return f"agrees with autodiff to {gap:.0e} in all {n['entries of a row']} entries of a row", judge(gap < 1e-12)


def centre(n: dict) -> Found:
    """Remark 1."""
    size = n["uniform"]["strain of a moved centre"]
    return f"∂Ē/∂x = {size:.0e}", judge(size < 1e-14)


def strain(n: dict) -> Found:
    """The sentence after the strains."""
    s = n["strain"]
    exact = max(s["m = 1, any state"], s["any m, similarities"])
    ratios = s["smallest ratio of 10 % to 1 % stretch"], s["largest ratio of 10 % to 1 % stretch"]
    second = 50 < ratios[0] and ratios[1] < 200
    off = s["m = 0, 10 % stretch"]
    ours = (
        f"exact ({exact:.0e}) for m = 1 and for F = λQ; otherwise to first order: {off:.1e} off at m = 0, 10 % stretch"
    )
    return ours, judge(max(exact, off) < 1e-14, exact < 1e-14 and second)


def silling_stable(n: dict) -> Found:
    """Section 3.3."""
    states = n["Silling"].values()
    block, free = max(s["block"] for s in states), max(s["at the corner"] for s in states)
    words = {s["verdict"] for s in states}
    ours = (
        f"its diagonal block is negative (at most {signed(block, 3)}), but the full Jacobian is {' or '.join(words)}:"
        f" some waves have zero energy (eigenvalue {free:.0e})"
    )
    return ours, judge(words == {"stable"}, block < 0 and words == {"marginal"} and free < 1e-14)
