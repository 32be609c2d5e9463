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
from matplotlib.ticker import NullFormatter

import pdjax as pd
from pdjax.bench.harness import timed, write
from pdjax.figures import COLOURS, LABELS
from pdjax.infinite_lattice import brillouin as zone
from pdjax.infinite_lattice import criteria

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)


def draw(numbers: dict) -> Figure:
    """Draw the share of wrong verdicts over time, two marks for each criterion."""
    figure = Figure(figsize=(8.4, 4.6), layout="constrained")
    axes = figure.subplots()
    for name, row in numbers["criteria"].items():
        x, missed, alarms = (row[k] for k in ("microseconds per state", "missed instabilities", "false alarms"))
        axes.plot([x], [100 * missed], "o", color=COLOURS[name])
        axes.plot([x], [100 * alarms], "x", color=COLOURS[name])
        place, side = {"diagonal": ((-2, -12), "center"), "symbol": ((-6, 5), "right")}.get(name, ((6, 5), "left"))
        label = LABELS.get(name, name).split(", a")[0]  # the equation of the continuum's criterion is too long here
        at = (x, 100 * max(missed, alarms))
        axes.annotate(label, at, textcoords="offset points", fontsize=8, xytext=place, ha=side)
    axes.plot([], [], "o", color="#888888", label="missed instabilities")
    axes.plot([], [], "x", color="#888888", label="false alarms")
    axes.set_xscale("log")
    axes.set_xlim(15, 1500)
    ticks = (20, 50, 100, 200, 500, 1000)
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time for one state (m, a)  [µs]")
    axes.set_ylabel("share of the map with a wrong verdict  [%]")
    axes.set_title("Criteria compared with the symbol: 2D, N = 3, hydrostatic load", fontsize=10)
    axes.legend(frameon=False, fontsize=8, loc="upper left")
    return figure


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
    numbers = {"states": len(m), "criteria": rows}
    write("criteria", numbers, draw(numbers))


if __name__ == "__main__":
    main()
