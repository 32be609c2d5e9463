"""The models in plain NumPy, from their equations: energies of families and bonds, forces of models without energy.

No line is shared with the package. |Y|² is Σ Y² without modulus or conjugate, so that every function is analytic. A
derivative is the imaginary part of the result of a step of 1e-30 i. A body is evaluated by a loop over its points. For
a model that uses the states of both ends of a bond it is a double loop.
"""

import itertools
from typing import NamedTuple

import numpy as np
import reference as ref

LAM, MU = 1.3, 0.7  # those of table.LINEAR and table.NEO_HOOKEAN
MICROMODULUS = {1: 2.0, 2: 12 / np.pi, 3: 18 / np.pi}  # c δ^(d+1)/k


class Family(NamedTuple):
    """Neighbours, ξ, Y, influence times weight, volumes of the neighbours, horizon. The property w is ω V."""

    near: np.ndarray
    xi: np.ndarray
    Y: np.ndarray
    omega: np.ndarray
    V: np.ndarray
    horizon: float

    @property
    def w(self):
        return self.omega * self.V

    @property
    def dim(self):
        return self.xi.shape[1]


def families(positions, volumes, horizon, u, omega=None, weight=None):
    """The family of every point. `weight` (points, points) holds the weight of the bond from i to j."""
    found = []
    for i, near in enumerate(ref.families(positions, horizon)):
        xi = positions[near] - positions[i]
        influence = np.ones(len(near)) if omega is None else omega(np.sqrt(np.sum(xi**2, axis=1)), horizon)
        influence = influence if weight is None else influence * weight[i, near]
        found.append(Family(near, xi, xi + (u[near] - u[i]), influence, volumes[near], horizon))
    return found


def length(x):
    return np.sqrt(np.sum(x**2, axis=-1))


# ---------------------------------------------------------------- laws: ψ(F) and P(F)


def green(F):
    return (F.T @ F - np.eye(len(F))) / 2


def linear(E):
    return LAM / 2 * np.trace(E) ** 2 + MU * np.sum(E * E)


def svk(F):
    return linear(green(F))


def neo_hookean(F):
    J = np.linalg.det(F)
    return MU / 2 * (np.trace(F.T @ F) - len(F) - 2 * np.log(J)) + LAM / 2 * np.log(J) ** 2


def svk_stress(F):
    E = green(F)
    return F @ (LAM * np.trace(E) * np.eye(len(F)) + 2 * MU * E)


def neo_hookean_stress(F):
    inverse = np.linalg.inv(F)
    return MU * (F - inverse.T) + LAM * np.log(np.linalg.det(F)) * inverse.T


# ---------------------------------------------------------------- kinematics


def shape(f, w=None):
    return np.einsum("b,bi,bj->ij", f.w if w is None else w, f.xi, f.xi)


def gradient(f, w=None):
    """F̄ = (Σ w Y⊗ξ) K⁻¹."""
    w = f.w if w is None else w
    return np.einsum("b,bi,bj->ij", w, f.Y, f.xi) @ np.linalg.inv(shape(f, w))


def deviation(f):
    """z = Y − F̄ξ."""
    return f.Y - f.xi @ gradient(f).T


def micromodulus(dim, horizon):
    return MICROMODULUS[dim] * (LAM + 2 * MU / dim) / horizon ** (dim + 1)


# ---------------------------------------------------------------- energies of one family


def bond_based(f, c, m=0.5):
    s = length(f.Y) / length(f.xi)
    return np.sum(f.w * c * ((s ** (2 * m) - 1) / (2 * m)) ** 2 * length(f.xi)) / 4


def lps(f, bulk, shear):
    d, r = f.dim, length(f.xi)
    e, m = length(f.Y) - r, np.sum(f.w * r**2)
    theta = d * np.sum(f.w * r * e) / m
    return bulk * theta**2 / 2 + d * (d + 2) * shear / m / 2 * np.sum(f.w * (e - theta * r / d) ** 2)


def silling(f, g):
    """½ g (c/δ) Σ w |z|²."""
    return g * micromodulus(f.dim, f.horizon) / f.horizon / 2 * np.sum(f.w[:, None] * deviation(f) ** 2)


def shells(f, q, strengths):
    """½ (c/δ) Σ w g(q) |z|², with g linear between its values."""
    g = np.interp(length(f.xi) / f.horizon, q, strengths)
    return micromodulus(f.dim, f.horizon) / f.horizon / 2 * np.sum((f.w * g)[:, None] * deviation(f) ** 2)


def wan(f):
    """½ Σ w z·(λ tr(K⁻¹) I + 2μ K⁻¹) z."""
    inverse, z = np.linalg.inv(shape(f)), deviation(f)
    C = LAM * np.trace(inverse) * np.eye(f.dim) + 2 * MU * inverse
    return np.sum(f.w * np.sum(z * (z @ C), axis=1)) / 2


def tupek_radovitzky(f, m):
    """Σ w e n⊗n = ω₀ (tr(Ē) I + 2 Ē)/(d(d + 2))."""
    d, n = f.dim, f.xi / length(f.xi)[:, None]
    e = np.expm1(2 * m * np.log(length(f.Y) / length(f.xi))) / (2 * m)
    moment = np.einsum("b,bi,bj->ij", f.w * e, n, n) * d * (d + 2) / np.sum(f.w)
    return linear((moment - np.trace(moment) / (d + 2) * np.eye(d)) / 2)


def mended(F, xi, Y):
    return F + np.outer(Y - F @ xi, xi) / np.dot(xi, xi)


def bond_level(f, law):
    F = gradient(f)
    return sum(w * law(mended(F, xi, Y)) for w, xi, Y in zip(f.w, f.xi, f.Y, strict=True)) / np.sum(f.w)


def sub_horizon(f, law):
    """Sectors by the signs of ξ. A bond on a border is shared, and sectors that do not span space are left out."""
    parts, energies = [], []
    for signs in itertools.product((1, -1), repeat=f.dim):
        share = np.ones(len(f.xi))
        for axis, sign in enumerate(signs):
            x = sign * f.xi[:, axis] / length(f.xi)
            share *= np.where(np.abs(x) < 1e-9, 0.5, np.where(x > 0, 1.0, 0.0))
        w = share * f.w
        roots = np.linalg.eigvalsh(shape(f, w))
        if np.prod(roots) > 1e-2 * np.mean(roots) ** f.dim:
            parts.append(np.sum(w))
            energies.append(law(gradient(f, w)))
    return np.dot(parts, energies) / np.sum(parts)


def members(f, r):
    """(b, k): whether bond k belongs to the sub-family of bond b."""
    return length(f.xi[:, None, :] - f.xi[None, :, :]) <= r * f.horizon * (1 + 1e-9)


def bond_associated(f, law, r):
    each = [law(gradient(f, np.where(inside, f.w, 0.0))) for inside in members(f, r)]
    share = [np.sum(f.V[inside]) for inside in members(f, r)]
    return np.dot(share, each) / np.sum(share)


# ---------------------------------------------------------------- energies of bonds that use the states of both ends


def reproducing_kernel_gradient(f, order):
    """F̄ = I + Σ η⊗Φ, Φ = (w/δ) Q_∇ᵀ M⁻¹ Q, written monomial by monomial."""
    rows = []
    for x in f.xi / f.horizon:
        quadratic = [x[i] * x[j] for i in range(f.dim) for j in range(i + 1)]
        rows.append(list(x) + (quadratic if order == 2 else []))
    Q = np.array(rows)
    weights = (np.linalg.inv((Q * f.w[:, None]).T @ Q) @ (Q * f.w[:, None]).T)[: f.dim] / f.horizon
    return np.eye(f.dim) + (weights @ (f.Y - f.xi)).T


def two_sided(found, volumes, law, gradient_of=gradient):
    """Π = Σ_i V_i (1/ω₀ᵢ) Σ_j w_ij ψ(½(F̄_i + F̄_j) mended on ij)."""
    F, total = [gradient_of(f) for f in found], 0.0
    for i, f in enumerate(found):
        for slot, j in enumerate(f.near):
            bond = law(mended((F[i] + F[j]) / 2, f.xi[slot], f.Y[slot]))
            total = total + volumes[i] * f.w[slot] / np.sum(f.w) * bond
    return total


# ---------------------------------------------------------------- forces of models without an energy


def littlewood(f, C, stress):
    """T of the correspondence model plus the hourglass force C c (z·Y) Y/(|ξ||Y|²)."""
    Z = stress(gradient(f)) @ np.linalg.inv(shape(f))
    along = np.sum(deviation(f) * f.Y, axis=1) / length(f.xi) / np.sum(f.Y**2, axis=1)
    return f.omega[:, None] * (f.xi @ Z.T) + C * micromodulus(f.dim, f.horizon) * along[:, None] * f.Y


def bond_associated_force(f, stress, r):
    """T_b = ω_b (V_h/V_H) P_b K_b⁻¹ ξ_b."""
    T = []
    for inside, omega, xi in zip(members(f, r), f.omega, f.xi, strict=True):
        w = np.where(inside, f.w, 0.0)
        part = np.sum(f.V[inside]) / np.sum(f.V)
        T.append(omega * part * stress(gradient(f, w)) @ np.linalg.inv(shape(f, w)) @ xi)
    return np.array(T)


def force_of_states(found, states):
    """f_i = Σ_j (T_ij − T_ji) V_j."""
    force = np.zeros((len(found), found[0].dim), dtype=np.result_type(*states))
    for i, f in enumerate(found):
        for slot, j in enumerate(f.near):
            back = list(found[j].near).index(i)
            force[i] += (states[i][slot] - states[j][back]) * f.V[slot]
    return force


# ---------------------------------------------------------------- the models of the table


def _quartic(E):
    return linear(E) + 2.0 * np.sum(E * E) ** 2


def _seth_hill(m, energy=linear):
    return lambda f: energy(ref.seth_hill_strain(f.xi, f.Y, f.w, m))


FAMILY_ENERGIES = {
    "seth_hill m=1": _seth_hill(1.0),
    "seth_hill m=0": _seth_hill(0.0),
    "seth_hill m=-0.7": _seth_hill(-0.7),
    "seth_hill user law": _seth_hill(0.4, _quartic),
    "correspondence svk": lambda f: svk(gradient(f)),
    "correspondence neo-hookean": lambda f: neo_hookean(gradient(f)),
    "seth_hill m=1, energy only": _seth_hill(1.0),
    "bond_based": lambda f: bond_based(f, 20.0),
    "bond_based m=-0.3": lambda f: bond_based(f, 20.0, -0.3),
    "lps": lambda f: lps(f, 1.5, 0.7),
    "silling control": lambda f: svk(gradient(f)) + silling(f, 0.5),
    "wan control": lambda f: _seth_hill(0.4)(f) + wan(f),
    "shell control": lambda f: _seth_hill(0.4)(f) + shells(f, [0.3, 0.7, 1.0], [0.9, -0.2, 0.4]),
    "tupek_radovitzky": lambda f: tupek_radovitzky(f, 0.4),
    "bond_level": lambda f: bond_level(f, neo_hookean),
    "sub_horizon": lambda f: sub_horizon(f, svk),
    "bond_associated": lambda f: bond_associated(f, neo_hookean, 0.8),
}
BODY_ENERGIES = {
    "bond_level average": lambda found, V: two_sided(found, V, svk),
    "reproducing_kernel 1": lambda found, V: two_sided(found, V, svk, lambda f: reproducing_kernel_gradient(f, 1)),
    "reproducing_kernel 2": lambda found, V: two_sided(
        found, V, neo_hookean, lambda f: reproducing_kernel_gradient(f, 2)
    ),
}
STATES = {
    "littlewood control": lambda f: littlewood(f, 0.3, neo_hookean_stress),
    "bond_associated force": lambda f: bond_associated_force(f, svk_stress, 1.0),
}
WITH_ENERGY = (*FAMILY_ENERGIES, *BODY_ENERGIES)


def body_energy(name, positions, volumes, horizon, u, omega=None, weight=None):
    """Π of a model of the table, from its energy."""
    found = families(positions, volumes, horizon, u, omega, weight)
    if name in BODY_ENERGIES:
        return BODY_ENERGIES[name](found, volumes)
    return sum(V * FAMILY_ENERGIES[name](f) for V, f in zip(volumes, found, strict=True))


def body_force(name, positions, volumes, horizon, u, omega=None, weight=None):
    """f of a model of the table, from its force states or from the slope of its energy by complex steps."""
    if name in STATES:
        found = families(positions, volumes, horizon, u, omega, weight)
        return force_of_states(found, [STATES[name](f) for f in found])

    def energy(v):
        return body_energy(name, positions, volumes, horizon, v, omega, weight)

    return -ref.complex_step_jacobian(energy, u).reshape(u.shape) / volumes[:, None]
