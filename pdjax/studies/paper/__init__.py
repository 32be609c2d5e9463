"""The paper, figure by figure and claim by claim: its result, and what the exact Jacobian says of it.

`FIGURES` is the list of sheets, one file each; `CLAIMS` the table of what was tried, whose verdicts follow from the
numbers of the sheets; `results` keeps and writes them. `pdjax paper` does it all.

Source: M. Behzadinasab and J. T. Foster, On the stability of the generalized, finite deformation
correspondence model of peridynamics, Int. J. Solids Struct. 182–183 (2020) 64–76.
"""

from . import a_cr, cuboid, dispersion, family, m_cr, maps, singular_bar, step_bar
from ._common import VERDICTS, Claim, Sheet
from .claims import CLAIMS
from .results import markdown, read, verdicts, write

FIGURES = {
    "family": Sheet("Fig. 1, a family; and the row of the Jacobian it makes", family.make),
    "m-cr": Sheet("Proposition 1, the order m_cr; by autodiff", m_cr.make),
    "a-cr": Sheet("critical loads quoted and printed; exact diagonal and symbol", a_cr.make),
    "maps-1d": Sheet("Fig. 2, stability map in 1D; by the symbol", maps.make_1d),
    "maps-2d": Sheet("Fig. 3, stability map in 2D; by the symbol", maps.make_2d),
    "singular-bar": Sheet(
        "Fig. 4, singular bar, four panels, and Silling's model; minimum or saddle", singular_bar.make
    ),
    "step-bar": Sheet("Fig. 5, ends displaced at once, three panels; the bar's own critical strain", step_bar.make),
    "cuboid": Sheet("Fig. 6, cuboid pulled and pushed, five panels; the symbol's prediction", cuboid.make),
    "dispersion": Sheet("Fig. 7, dispersion curves, two panels; whether the large wave is a motion", dispersion.make),
}

__all__ = ["CLAIMS", "FIGURES", "VERDICTS", "Claim", "Sheet", "markdown", "read", "verdicts", "write"]
