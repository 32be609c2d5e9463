"""An order m that changes with the sign of the load: does it help? Hydrostatic, uniaxial and shear, both sides.

The paper doubts that an m chosen by the sign of the load is a cure. Under a homogeneous load the model is the one of
the order chosen, so the orders that are not unstable at once on each side of each path (`pdjax.stable_orders`) say all:
a switch by the sign of tr E helps where compression and tension each have such orders, and cannot where a side has
none. (Under simple shear the first order in the load vanishes and decides nothing: NaN; the critical loads do.) The
price is a jump of the energy at tr E = 0, where the sign changes while the shear does not: Ψ(E_m) differs between
orders.
"""

import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd
from pdjax.bench.harness import write

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)


def energy(m: float, family, F) -> float:
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
    for shear in (0.01, 0.02, 0.04):  # a state of shear with tr E₀ = 0, where the switch would happen
        F = jnp.asarray(np.diag(np.exp([shear, -shear])))
        jumps.append({"shear": shear, "relative jump": energy(-1.0, family, F) / energy(1.0, family, F) - 1})
    write("order_switch", {"stable orders": rows, "critical loads (2D, N = 3)": loads, "energy jump": jumps})


if __name__ == "__main__":
    main()
