"""The symbol of a homogeneous state as a cosine series.

The search of the Brillouin zone (`pdjax.infinite_lattice.brillouin`) uses this series and nothing else of the model. On
a lattice of spacing h, with integer offsets o and x = h k,

    Ĵ(x) = −Σ_o B_o c_o(x),    c_o = 4 sin²(o·x/2),    o over one half of the offsets that the forces reach.

B_o is the block of the Jacobian that couples two points at the offset o. It has this meaning for every model. A tangent
(`pdjax.infinite_lattice.bloch`) holds products of two factors. The following identities turn them into single terms:

    s_a s_b = (c_{a+b} − c_{a−b})/4,    c_a c_b = 2 c_a + 2 c_b − c_{a+b} − c_{a−b},    s = sin o·x.

The tangent of a model of two stages holds products of three factors. A discrete Fourier transform of its symbol, on a
grid fine enough for the highest harmonic, gives its blocks exactly to rounding.

`forms` sums Ĵ and its derivatives in x over the same blocks. As x → 0 along N, Ĵ/|x|² tends to the series with
c = (N·o)².
"""

from collections.abc import Callable
from functools import lru_cache, singledispatch
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import Numbers, namespace
from ..geometry.bonds import cells_within
from .bloch import DenseTangent, Phases, StateTangent, Tangent, TwoStageTangent, laplacian, squared_chord


class Fold(NamedTuple):
    """The offset to which every product over a half family contributes.

    `offsets` (offsets, dim) holds one half of the offsets. `own`, `plus` and `minus` hold the index in it of every
    bond, of every sum a + b and of every difference a − b. The index len(offsets) stands for the zero offset, which is
    dropped. `order` sorts the three together by index, and `first` is the position at which each index begins.
    """

    offsets: np.ndarray
    own: np.ndarray
    plus: np.ndarray
    minus: np.ndarray
    order: np.ndarray
    first: np.ndarray


@lru_cache(maxsize=32)
def half_offsets(dim: int, bonds: int) -> np.ndarray:
    """The integer offsets (bonds/2, dim) of the first half of a lattice family, found from its number of bonds."""
    reach = 1
    while len(cells_within(dim, reach)) < bonds:
        reach += 1
    cells = cells_within(dim, reach)
    squares = np.sort((cells**2).sum(axis=1))
    cells = cells[(cells**2).sum(axis=1) <= squares[bonds - 1]]
    first = cells[len(cells) // 2 :]
    return first[np.lexsort((*first.T[::-1], (first**2).sum(axis=1)))]


def _canonical(offsets: np.ndarray) -> np.ndarray:
    """Replace o by −o where the first non-zero component of o is negative."""
    first = offsets[np.arange(len(offsets)), np.argmax(offsets != 0, axis=1)]
    return offsets * np.where(first < 0, -1, 1)[:, None]


@lru_cache(maxsize=32)
def fold(dim: int, bonds: int) -> Fold:
    """The `Fold` of a lattice family of `bonds` bonds, whose products reach two rings of neighbours."""
    half = half_offsets(dim, bonds)
    pairs = [half, *((half[:, None] + s * half[None]).reshape(-1, dim) for s in (1, -1))]
    everything = _canonical(np.concatenate(pairs))
    unique, where = np.unique(everything, axis=0, return_inverse=True)
    zero = int(np.flatnonzero((unique == 0).all(axis=1))[0])
    place = np.where(where == zero, len(unique) - 1, where - (where > zero)).astype(np.int32).reshape(-1)
    own, plus, minus = np.split(place, [len(half), len(half) + len(half) ** 2])
    order = np.argsort(place, kind="stable")
    return Fold(
        np.delete(unique, zero, axis=0), own, plus, minus, order, np.searchsorted(place[order], np.arange(len(unique)))
    )


def reached(dim: int, bonds: int, rings: int) -> np.ndarray:
    """One half of the offsets (offsets, dim) of the blocks of a series, for two or three rings of neighbours."""
    return fold(dim, bonds).offsets if rings <= 2 else _box(dim, 3 * int(np.abs(half_offsets(dim, bonds)).max()))


@lru_cache(maxsize=8)
def _box(dim: int, reach: int) -> np.ndarray:
    """Half of all offsets with components up to `reach`."""
    steps = np.arange(-reach, reach + 1)
    every = np.stack([x.reshape(-1) for x in np.meshgrid(*[steps] * dim, indexing="ij")], axis=1)
    return every[len(every) // 2 + 1 :]


@singledispatch
def series(tangent: Tangent, dim: int, bonds: int) -> Float[Numbers, "offsets dim dim"]:
    """The blocks B_o [force/length^(dim+1)] of one state of a lattice family of `bonds` bonds.

    Each kind of tangent registers its own function.
    """
    raise NotImplementedError(f"no cosine series of a {type(tangent).__name__}")


@series.register(DenseTangent)
def _of_all_bonds(tangent: DenseTangent, dim: int, bonds: int) -> Float[Numbers, "offsets dim dim"]:
    even, odd = (x.transpose(0, 2, 1, 3) / 4 for x in (tangent.even, tangent.odd))
    return _sums(2 * (even.sum(axis=0) + even.sum(axis=1)), odd - even, -odd - even)


@series.register(StateTangent)
def _of_states(tangent: StateTangent, dim: int, bonds: int) -> Float[Numbers, "offsets dim dim"]:
    """In NumPy if the tangent is concrete."""
    plus = namespace(tangent).tensordot(tangent.g, tangent.r, axes=(2, 1)).transpose(0, 2, 1, 3) / 4
    return _sums(tangent.b, plus, -plus)


def _sums(own: Numbers, plus: Numbers, minus: Numbers) -> Numbers:
    """Sum the terms of every offset: those of single bonds `own` (half, dim, dim), and those of the sums `plus` and
    differences `minus` of two bonds (half, half, dim, dim)."""
    xp, (half, dim, _) = namespace(own), own.shape
    f = fold(dim, 2 * half)
    terms = xp.concatenate([own, plus.reshape(-1, dim, dim), minus.reshape(-1, dim, dim)])
    if xp is np:
        return np.add.reduceat(terms[f.order], f.first)[:-1]
    place = np.concatenate([f.own, f.plus, f.minus])
    return jnp.zeros((len(f.first), dim, dim), terms.dtype).at[place].add(terms)[:-1]


@series.register(TwoStageTangent)
def _by_transform(tangent: TwoStageTangent, dim: int, bonds: int) -> Float[Array, "offsets dim dim"]:
    half = half_offsets(dim, bonds)
    reach = 3 * int(np.abs(half).max())
    size = 2 * reach + 1
    waves = np.stack([x.reshape(-1) for x in np.meshgrid(*[np.arange(size)] * dim, indexing="ij")], axis=1)
    angle = jnp.asarray(2 * np.pi / size * ((waves @ half.T) % size), tangent.b.dtype)
    c = squared_chord(angle)
    values = tangent(Phases(c, jnp.sin(angle), -c / 2, c[:, 0]))
    blocks = jnp.fft.ifftn(values.reshape(*[size] * dim, dim, dim), axes=tuple(range(dim))).real
    return blocks[tuple((_box(dim, reach) % size).astype(np.int32).T)]


class Forms(NamedTuple):
    """A symmetric matrix function A(x) and a scale κ²(x), each with its first and second derivatives in x."""

    A: Float[Numbers, "*lanes dim dim"]
    A1: Float[Numbers, "*lanes dim dim dim"]
    A2: Float[Numbers, "*lanes dim dim dim dim"]
    scale: Float[Numbers, "*lanes"]
    scale1: Float[Numbers, "*lanes dim"]
    scale2: Float[Numbers, "*lanes dim dim"]


@lru_cache(maxsize=4)
def upper(dim: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """The indices of the upper triangle, and the position (dim, dim) of every matrix entry in it."""
    rows, columns = (x.astype(np.int32) for x in np.triu_indices(dim))  # jax 0.10 fails on int64 in float32 runs.
    place = np.zeros((dim, dim), dtype=np.int32)
    place[rows, columns] = place[columns, rows] = np.arange(len(rows))
    return (rows, columns), place


def packed(blocks: Numbers) -> Numbers:
    """The upper triangle (*states, offsets, p) of the symmetric part of every block (*states, offsets, dim, dim)."""
    (rows, columns), _ = upper(blocks.shape[-1])
    return (blocks[..., rows, columns] + blocks[..., columns, rows]) / 2


def entries(values: Float[Numbers, "p *waves"], dim: int) -> list[list[Numbers]]:
    """The entries of packed matrices as a nested list of arrays."""
    _, place = upper(dim)
    return [[values[place[i, j]] for j in range(dim)] for i in range(dim)]


class Series(NamedTuple):
    """The terms that `forms` sums for many states at once: upper triangles of B, o B and o o B, and the offsets."""

    zeroth: Float[Numbers, "states offsets p"]
    first: Float[Numbers, "states offsets dim_p"]
    second: Float[Numbers, "states offsets p_p"]
    offsets: np.ndarray

    @staticmethod
    def of(blocks: Numbers, offsets: np.ndarray) -> "Series":
        (rows, columns), _ = upper(offsets.shape[1])
        o = offsets.astype(blocks.dtype)
        oo = o[:, rows] * o[:, columns]
        shape = (*blocks.shape[:2], -1)
        first = (o[None, :, :, None] * blocks[:, :, None, :]).reshape(shape)
        return Series(blocks, first, (oo[None, :, :, None] * blocks[:, :, None, :]).reshape(shape), o)


def forms(s: Series, x: Numbers, long: np.ndarray, bare: np.ndarray) -> Forms:
    """A = Ĵ (symmetric part) and κ² = Σ 4 sin²(x_i/2) with derivatives, at x (states, lanes, dim) [1/spacing].

    A lane is one start of the search. Lanes marked in `long` (lanes,) use the limit x → 0 along x, with κ² = |x|².
    Lanes marked in `bare` (lanes,) use κ² = 1.
    """
    xp, dim = namespace(s, x), x.shape[-1]
    angle = x @ s.offsets.T
    far = long[:, None]
    c = squared_chord(angle, far)
    c1 = xp.where(far, 2 * angle, 2 * xp.sin(angle))
    c2 = xp.where(far, 2.0, 2 - c)
    _, place = upper(dim)
    A = -(c @ s.zeroth)[..., place]
    A1 = -(c1 @ s.first).reshape(*x.shape[:-1], dim, -1)[..., place]
    A2 = -(c2 @ s.second).reshape(*x.shape[:-1], len(s.zeroth[0, 0]), -1)[..., place, :][..., place]
    return Forms(A, A1, A2, *_laplacian(x, far, bare[:, None]))


def _laplacian(x: Numbers, far: np.ndarray, bare: np.ndarray) -> tuple[Numbers, Numbers, Numbers]:
    xp = namespace(x)
    eye = xp.eye(x.shape[-1], dtype=x.dtype)
    slope = xp.where(far, 2 * x, 2 * xp.sin(x))
    curvature = xp.where(far, 2.0, 2 * xp.cos(x))
    value = xp.where(bare[:, 0], 1.0, laplacian(x, far))
    return value, xp.where(bare, 0.0, slope), xp.where(bare, 0.0, curvature)[..., None] * eye


def on_grid(
    blocks: Float[Numbers, "offsets p"], offsets: np.ndarray, axes: list[np.ndarray]
) -> Float[Numbers, "p *grid"]:
    """Ĵ (entries of `blocks`) on the grid of wave vectors with the components `axes` [1/spacing].

    The sum over offsets is a product with one matrix for each axis, so that its cost does not grow as grid × offsets.
    """
    xp, real = namespace(blocks), blocks.dtype
    reach, dim = int(np.abs(offsets).max()), offsets.shape[1]
    size = 2 * reach + 1
    place = np.full(size**dim, len(offsets) + 1, np.int32)  # Index of a block of zeros.
    place[size**dim // 2] = len(offsets)
    for sign in (1, -1):
        place[np.ravel_multi_index((sign * offsets + reach).T, [size] * dim)] = np.arange(len(offsets))
    padded = xp.concatenate([blocks, -2 * blocks.sum(axis=0)[None], xp.zeros((1, blocks.shape[1]), real)])
    box = padded[place].T.reshape(-1, *[size] * dim)
    steps = np.arange(-reach, reach + 1)
    waves = [np.outer(steps, axis) for axis in axes]
    tables = [(np.cos(x).astype(real), np.sin(x).astype(real)) for x in waves]
    cos, sin = tables[-1]
    even, odd = box @ cos, box @ sin  # The transform is even − i odd.
    if dim == 1:
        return even
    for cos, sin in tables[-2:0:-1]:
        even, odd = cos.T @ even - sin.T @ odd, sin.T @ even + cos.T @ odd
    cos, sin = tables[0]
    flat = (len(box), size, -1)
    return (cos.T @ even.reshape(flat) - sin.T @ odd.reshape(flat)).reshape(len(box), -1, *even.shape[2:])


def works(blocks: np.ndarray, offsets: np.ndarray, x: Numbers, is_long: Numbers, v: Numbers) -> tuple:
    """(vᵀ Ĵ v, κ²) of every state at its wave x [1/spacing], in the units of the concrete blocks.

    Where `is_long` is True, both are those of the limit k → 0 along x.
    """
    c = squared_chord(x @ offsets.T, is_long[:, None])
    return -np.einsum("so,si,soij,sj->s", c, v, blocks, v), laplacian(x, is_long[:, None])


def symbols(blocks: np.ndarray, offsets: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Ĵ (..., dim, dim) of concrete blocks at x = h k (..., dim), computed in NumPy."""
    return _summed(lambda part: -squared_chord(part @ offsets.T), blocks, x)


def symbol_slopes(blocks: np.ndarray, offsets: np.ndarray, x: np.ndarray) -> np.ndarray:
    """∂Ĵ/∂x (..., dim, dim, dim of x) of concrete blocks at x = h k (..., dim), computed in NumPy."""
    outer = blocks[..., None] * offsets[:, None, None, :]
    return _summed(lambda part: -2 * np.sin(part @ offsets.T), outer, x)


def _summed(factor: Callable, terms: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Σ_o factor_o(x) terms_o, computed for a few thousand waves at once."""
    dim = x.shape[-1]
    parts = np.array_split(x.reshape(-1, dim), max(1, x.size // (dim * 4096)))
    values = [np.tensordot(factor(part), terms, axes=(-1, 0)) for part in parts]
    return np.concatenate(values).reshape(*x.shape[:-1], *terms.shape[1:])
