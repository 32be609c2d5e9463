"""Does an order m that changes with the sign of the load stabilise the Seth–Hill model?

The paper doubts it. The program tests hydrostatic, uniaxial and shear paths with both signs of the load. Under a
homogeneous load the switched model is the model of the chosen order. It is therefore enough to know the orders that do
not become unstable at the smallest load, for each path and sign (`pdjax.stable_orders`). A switch by the sign of tr E
helps where both compression and tension have such orders. It cannot help where one sign has none. Under simple shear
the first-order term in the load vanishes, so `stable_orders` returns NaN; the critical loads decide instead.

The disadvantage of the switch is a jump of the energy at tr E = 0. There the sign changes while the shear strain does
not vanish, and the energy Ψ(E_m) differs between the orders.
"""

import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd
from pdjax.bench.harness import write

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)


def energy(m: float, family, F) -> float:
    """Energy density of the model of order m at F."""
    return float(pd.SethHill(m, LAW).energy(family.bonds(F)))


def main() -> None:
    rows = []
    for dim in (2, 3):
        family = pd.lattice_family(dim, 3)
        for name, path in pd.PATHS.items():
            for side in ("negative", "positive"):
                low, high = pd.stable_orders(family, LAW, path, side)
                rows.append({"dim": dim, "path": name, "side": side, "orders": [low, high]})
    family = pd.lattice_family(2, 3)
    loads = [
        {
            "m": m,
            "path": name,
            "side": side,
            "a_cr": float(pd.critical_load(pd.SethHill(m, LAW), family, path, side=side)),
        }
        for m in (-1.0, -0.75, 0.5, 1.0)
        for name, path in pd.PATHS.items()
        for side in ("negative", "positive")
    ]
    jumps = []
    for shear in (0.01, 0.02, 0.04):  # pure shear with tr E₀ = 0 (E₀: logarithmic strain), where the order switches
        F = jnp.asarray(np.diag(np.exp([shear, -shear])))
        jumps.append({"shear": shear, "relative jump": energy(-1.0, family, F) / energy(1.0, family, F) - 1})
    write("order_switch", {"stable orders": rows, "critical loads (2D, N = 3)": loads, "energy jump": jumps})


if __name__ == "__main__":
    main()
