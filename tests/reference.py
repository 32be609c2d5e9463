"""An independent reference in plain NumPy: brute-force families, forces, energies, Jacobians, symbols.

It shares no code with the package and follows the definitions line by line, so that agreement is significant. Every
force accepts complex displacements: √(Σ Y²) has no modulus or conjugate and is therefore analytic. A derivative is the
imaginary part of the result of a step of 1e-30 i, exact to rounding.

    Seth-Hill       T = ω (n·(L⁻¹:S)·n) s^{2m} Y/|Y|²,  S = λ tr(Ē) I + 2μĒ,
                    Ē = L⁻¹ : Σ w ((s^{2m} − 1)/2m) n⊗n
    correspondence  T = ω F̄ S K⁻¹ ξ,  S as above of Ē = (F̄ᵀF̄ − I)/2,  F̄ = (Σ w Y⊗ξ) K⁻¹
    f_i = Σ_j (T_ij − T_ji) V_j,   w = ωV,  L = Σ w n⊗n⊗n⊗n,  K = Σ w ξ⊗ξ,  Y = ξ + u_j − u_i,  s = |Y|/|ξ|

`omega` is a NumPy callable (r, horizon) → influence. If it is None, the influence is 1. `rows` are the points whose
force is computed, all points if it is None. Only these points and their neighbours need a full family.
"""

import functools

import numpy as np


@functools.lru_cache(maxsize=32)
def _families(raw, shape, horizon):
    points = np.frombuffer(raw).reshape(shape)
    found = []
    for i in range(shape[0]):
        distance = np.sqrt(np.sum((points - points[i]) ** 2, axis=1))
        near = distance <= horizon * (1 + 1e-9)
        near[i] = False
        found.append(np.flatnonzero(near))
    return found


def families(positions, horizon):
    """For each point the indices of the others within the horizon, by brute force. Ties are included."""
    positions = np.ascontiguousarray(positions, dtype=float)
    return _families(positions.tobytes(), positions.shape, float(horizon))


def lattice_ball(dim, radius):
    """Integer points with |p| ≤ radius, the centre first: positions (n, dim)."""
    axis = np.arange(-int(radius), int(radius) + 1)
    grid = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim).astype(float)
    size = np.sqrt(np.sum(grid**2, axis=1))
    keep = size <= radius * (1 + 1e-9)
    return grid[keep][np.argsort(size[keep], kind="stable")]


def _family(i, positions, volumes, horizon, u, omega):
    """Neighbours, bonds ξ, deformed bonds Y, influence ω, weights ωV of point i."""
    near = families(positions, horizon)[i]
    xi = positions[near] - positions[i]
    r = np.sqrt(np.sum(xi**2, axis=1))
    influence = np.ones(len(near)) if omega is None else omega(r, horizon)
    return near, xi, xi + (u[near] - u[i]), influence, influence * volumes[near]


def _seth_hill_measure(s, m):
    return np.log(s) if m == 0 else np.expm1(2 * m * np.log(s)) / (2 * m)


def _dual(xi, w):
    """L⁻¹ : n⊗n for every bond. L is a d²×d² matrix, inverted on the symmetric tensors it acts on."""
    xi, w = np.ascontiguousarray(xi, dtype=float), np.ascontiguousarray(w, dtype=float)
    return _dual_of(xi.tobytes(), w.tobytes(), xi.shape)


@functools.lru_cache(maxsize=1024)  # a Jacobian needs the same reference state many times
def _dual_of(raw_xi, raw_w, shape):
    xi, w, dim = np.frombuffer(raw_xi).reshape(shape), np.frombuffer(raw_w), shape[1]
    n = xi / np.sqrt(np.sum(xi**2, axis=1))[:, None]
    dyads = np.einsum("bi,bj->bij", n, n).reshape(len(n), dim * dim)
    L = (dyads * w[:, None]).T @ dyads
    if np.linalg.matrix_rank(L, tol=1e-9 * np.trace(L)) < dim * (dim + 1) // 2:
        raise ValueError(f"{len(n)} bonds do not span the shape tensor L")
    return (dyads @ np.linalg.pinv(L, rcond=1e-11)).reshape(len(n), dim, dim)


def _law(E, lam, mu):
    return lam * np.trace(E) * np.eye(len(E)) + 2 * mu * E


def seth_hill_strain(xi, Y, w, m):
    """Ē_m of one family: L⁻¹ : Σ w ((s^{2m} − 1)/2m) n⊗n."""
    s = np.sqrt(np.sum(Y**2, axis=1)) / np.sqrt(np.sum(xi**2, axis=1))
    return np.einsum("b,b,bij->ij", w, _seth_hill_measure(s, m), _dual(xi, w))


def seth_hill_states(positions, volumes, horizon, u, m, lam, mu, omega=None, points=None):
    """{i: (neighbours, T (bonds, dim))} for the given points (all if None)."""
    states = {}
    for i in range(len(positions)) if points is None else points:
        near, xi, Y, influence, w = _family(i, positions, volumes, horizon, u, omega)
        S = _law(seth_hill_strain(xi, Y, w, m), lam, mu)
        Y2 = np.sum(Y**2, axis=1)
        s2m = np.exp(m * np.log(Y2 / np.sum(xi**2, axis=1)))
        pull = influence * np.einsum("bij,ij->b", _dual(xi, w), S) * s2m / Y2
        states[i] = (near, pull[:, None] * Y)
    return states


def _gradient(xi, Y, w):
    K = np.einsum("b,bi,bj->ij", w, xi, xi)
    return np.einsum("b,bi,bj->ij", w, Y, xi) @ np.linalg.inv(K), K


def correspondence_states(positions, volumes, horizon, u, lam, mu, omega=None, points=None):
    """{i: (neighbours, T (bonds, dim))} of the original correspondence model, St. Venant–Kirchhoff law."""
    states = {}
    for i in range(len(positions)) if points is None else points:
        near, xi, Y, influence, w = _family(i, positions, volumes, horizon, u, omega)
        F, K = _gradient(xi, Y, w)
        P = F @ _law((F.T @ F - np.eye(len(F))) / 2, lam, mu)
        states[i] = (near, influence[:, None] * (xi @ np.linalg.inv(K).T @ P.T))
    return states


def _force(state_of, positions, volumes, horizon, u, rows):
    """f_i = Σ_j (T_ij − T_ji) V_j of the points `rows`, from their states and those of their neighbours."""
    rows = list(range(len(positions)) if rows is None else rows)
    near = families(positions, horizon)
    states = state_of(sorted(set(rows).union(*(near[i].tolist() for i in rows))))
    force = np.zeros((len(rows), positions.shape[1]), dtype=np.asarray(u).dtype)
    for row, i in enumerate(rows):
        for slot, j in enumerate(near[i]):
            back = int(np.flatnonzero(states[j][0] == i)[0])
            force[row] += (states[i][1][slot] - states[j][1][back]) * volumes[j]
    return force


def seth_hill_force(positions, volumes, horizon, u, m, lam, mu, omega=None, rows=None):
    """Force density (n, dim), or (rows, dim), of the generalised finite-deformation model."""

    def state_of(points):
        return seth_hill_states(positions, volumes, horizon, u, m, lam, mu, omega, points)

    return _force(state_of, positions, volumes, horizon, u, rows)


def correspondence_force(positions, volumes, horizon, u, lam, mu, omega=None, rows=None):
    """Force density (n, dim), or (rows, dim), of the original correspondence model."""

    def state_of(points):
        return correspondence_states(positions, volumes, horizon, u, lam, mu, omega, points)

    return _force(state_of, positions, volumes, horizon, u, rows)


def seth_hill_energy(positions, volumes, horizon, u, m, lam, mu, omega=None):
    """Π = Σ_i V_i [½λ (tr Ē_i)² + μ Ē_i:Ē_i]."""
    total = 0.0
    for i in range(len(positions)):
        _, xi, Y, _, w = _family(i, positions, volumes, horizon, u, omega)
        E = seth_hill_strain(xi, Y, w, m)
        total = total + volumes[i] * (lam * np.trace(E) ** 2 / 2 + mu * np.sum(E**2))
    return total


def correspondence_energy(positions, volumes, horizon, u, lam, mu, omega=None):
    """Π = Σ_i V_i [½λ (tr E_i)² + μ E_i:E_i], E = (F̄ᵀF̄ − I)/2."""
    total = 0.0
    for i in range(len(positions)):
        _, xi, Y, _, w = _family(i, positions, volumes, horizon, u, omega)
        F = _gradient(xi, Y, w)[0]
        E = (F.T @ F - np.eye(len(F))) / 2
        total = total + volumes[i] * (lam * np.trace(E) ** 2 / 2 + mu * np.sum(E**2))
    return total


def complex_step_jacobian(force, u):
    """∂force/∂u, (force size, u size), by one imaginary step for each column, exact to rounding."""
    u = np.asarray(u, dtype=float)
    columns = []
    for index in np.ndindex(*u.shape):
        moved = u.astype(complex)
        moved[index] += 1e-30j
        columns.append(np.imag(force(moved)).reshape(-1) / 1e-30)
    return np.stack(columns, axis=1)


def central_difference_jacobian(force, u, step):
    """∂force/∂u, (force size, u size), by central differences of the given step."""
    u = np.asarray(u, dtype=float)
    columns = []
    for index in np.ndindex(*u.shape):
        up, down = u.copy(), u.copy()
        up[index] += step
        down[index] -= step
        columns.append((np.asarray(force(up)) - np.asarray(force(down))).reshape(-1) / (2 * step))
    return np.stack(columns, axis=1)


def patch_row(dim, N, force_of_u, F):
    """(η (n, dim), J⟨η⟩ = ∂f(X)/∂x(X + η) (n, dim, dim)) at the centre of a patch of unit spacing.

    `force_of_u(positions, u)` returns the force densities, first that of the centre, which is the first position.
    """
    positions = lattice_ball(dim, 2 * N)
    u = positions @ (np.asarray(F, dtype=float) - np.eye(dim)).T

    def centre(moved):
        return np.asarray(force_of_u(positions, moved))[0]

    rows = complex_step_jacobian(centre, u)
    return positions, rows.reshape(dim, len(positions), dim).transpose(1, 0, 2)


def symbol_of_row(row, k):
    """Ĵ(k) = Σ_η J⟨η⟩ e^{ik·η}, from the η and J⟨η⟩ of `patch_row`."""
    eta, blocks = row
    return np.einsum("n,nkl->kl", np.exp(1j * eta @ np.asarray(k, dtype=float)), blocks)


def patch_symbol(dim, N, force_of_u, F, k):
    """Ĵ(k), (dim, dim) complex, of the infinite lattice of unit spacing, by the direct sum over a patch."""
    return symbol_of_row(patch_row(dim, N, force_of_u, F), k)
