"""The paper's dispersion relation of the bar, at an amplitude that is small and at one that is not: is it a motion's?

u = u₀ exp i(kX − ωt) in the equation of motion, ω read at X = t = 0, real part drawn. For small u₀ it is the symbol's
frequency, whatever the order. A frequency of a motion depends neither on the place X nor on the sign of u₀, which is
the same real wave half a wavelength on.
"""

import jax
import numpy as np

import pdjax as pd
from pdjax.bench.harness import write

jax.config.update("jax_enable_x64", True)
N, ORDERS, SMALL, LARGE = 3, (-1.0, 0.0, 0.5, 1.0, 2.0), 1e-6, 0.1
K = np.append(np.linspace(0.01, np.pi, 200), np.linspace(np.pi, 2 * np.pi, 200)[1:])
READ = 2 * np.pi * 4 / 40  # the wave at which ω is read at two places and for both signs


def printed(k, u0: float, m: float, X: float = 0.0) -> np.ndarray:
    """ω as printed, complex, in units of c/h."""
    return np.sqrt(np.asarray(pd.closed_forms.dispersion_1d(k, u0, m, N, X=X)) + 0j)


def main() -> None:
    family = pd.lattice_family(dim=1, N=N)
    exact = pd.dispersion(pd.SethHill(1.0, pd.LinearElastic(lam=1.0, mu=0.0)), family, np.eye(1), K)
    symbol, still = np.asarray(exact.frequency[:, 0]), np.asarray(exact.zero_energy[:, 0])
    line = pd.figures.Branch("classical", K / np.pi, K, ":")
    small, large = (
        [line, *(pd.figures.Branch(f"m = {m:g}", K / np.pi, printed(K, u0, m).real) for m in ORDERS)]
        for u0 in (SMALL, LARGE)
    )
    gap = max(float(np.abs(branch.omega - symbol).max()) for branch in small[1:])
    small.append(pd.figures.Branch("symbol", K / np.pi, symbol, "--", still))
    panels = {
        f"u₀ = {SMALL:g} h: all orders lie on the symbol (to {gap:.0e})": small,
        f"u₀ = {LARGE:g} h: the orders part": large,
    }
    cases = {"X = 0": (LARGE, 0.0), "X = 0, the sign of u0 changed": (-LARGE, 0.0), "X = 2 h": (LARGE, 2.0)}
    reads = {name: complex(printed(READ, u0, 1.0, X)) for name, (u0, X) in cases.items()}
    at_edge = {f"{m:g}": abs(complex(printed(np.pi, LARGE, m))) for m in ORDERS}
    write(
        "paper_dispersion",
        {
            "N": N,
            "small u0, largest distance of any order from the symbol": gap,
            "zeros of the symbol, k h / pi": (K[still] / np.pi).tolist(),
            f"|omega| h/c at k = pi/h, u0 = {LARGE:g} h, over the order": at_edge,
            f"omega h/c at k h = 0.2 pi, u0 = {LARGE:g} h, m = 1 (real, imaginary)": {
                name: [value.real, value.imag] for name, value in reads.items()
            },
        },
        pd.figures.dispersion_curves(panels, f"The paper's dispersion relation, 1D, N = {N}", highest=0.7),
    )


if __name__ == "__main__":
    main()
