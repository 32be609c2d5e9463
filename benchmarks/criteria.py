"""Cost and errors of each stability criterion, compared with the symbol over the default map.

The states (m, a) are those of the default map: 2D, N = 3, hydrostatic load. A missed instability is a state that is
unstable by the symbol and stable by the criterion. A false alarm is the reverse. A criterion that is necessary for
stability can miss instabilities but never raises a false alarm. The material test is sufficient for stability, so it
can raise false alarms but never misses an instability.
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import timed, write
from pdjax.figures import COLOURS
from pdjax.infinite_lattice import brillouin as zone
from pdjax.infinite_lattice import criteria

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)


def main() -> None:
    family = pd.lattice_family(2, 3)
    z = zone.brillouin_zone(2, 24, "cubic")
    m, a = (x.reshape(-1) for x in jnp.meshgrid(jnp.linspace(-2, 2, 32), jnp.linspace(-0.3, 0.3, 32)))

    def margin(name):
        return jax.jit(
            jax.vmap(lambda m, a: criteria.evaluate(name, pd.SethHill(m, LAW), family, (1 + a) * jnp.eye(2), z).margin)
        )

    unstable = np.asarray(margin("symbol")(m, a)) > 1e-12
    rows = {}
    for name in criteria.CRITERIA:
        kernel = margin(name)
        spent = timed(lambda k=kernel: k(m, a), repeats=3)
        says = np.asarray(kernel(m, a)) > 1e-12
        rows[name] = {
            "microseconds per state": 1e6 * spent["median"] / len(m),
            "seconds to compile": spent["first"] - spent["median"],
            "missed instabilities": float(np.mean(unstable & ~says)),
            "false alarms": float(np.mean(~unstable & says)),
        }
    figure = Figure(figsize=(6.6, 4.2), layout="constrained")
    axes = figure.subplots()
    for name, row in rows.items():
        x, missed, alarms = (row[k] for k in ("microseconds per state", "missed instabilities", "false alarms"))
        axes.plot([x], [100 * missed], "o", color=COLOURS[name])
        axes.plot([x], [100 * alarms], "x", color=COLOURS[name])
        axes.annotate(name, (x, 100 * max(missed, alarms)), textcoords="offset points", xytext=(5, 5), fontsize=8)
    axes.plot([], [], "o", color="#888888", label="missed instabilities")
    axes.plot([], [], "x", color="#888888", label="false alarms")
    axes.set_xscale("log")
    axes.set_xlabel("time for one state (m, a)  [µs]")
    axes.set_ylabel("share of the map judged wrongly  [%]")
    axes.set_title("Criteria against the exact symbol, 2D, N = 3, hydrostatic", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    write("criteria", {"states": len(m), "criteria": rows}, figure)


if __name__ == "__main__":
    main()
