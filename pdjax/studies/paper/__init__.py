"""The figures and claims of the paper, tested with the exact Jacobian.

A "sheet" makes one figure of the paper and the numbers behind it; there is one file for each. `FIGURES` lists the
sheets. A "claim" is one statement of the paper. `CLAIMS` lists them; their verdicts follow from the numbers of the
sheets. `results` stores the numbers, the claims and the tables. `pdjax paper` runs all of it.

    claims          the statements of the paper that are tested
    family          Fig. 1
    m_cr, a_cr      the critical order and the critical loads
    maps            Figs. 2 and 3
    singular_bar    Fig. 4
    step_bar        Fig. 5
    cuboid          Fig. 6
    dispersion      Fig. 7
    making          the sheets made one after the other or in processes
    results         the files of the results

Source: M. Behzadinasab and J. T. Foster, On the stability of the generalized, finite deformation
correspondence model of peridynamics, Int. J. Solids Struct. 182–183 (2020) 64–76.
"""

from . import a_cr, cuboid, dispersion, family, m_cr, maps, singular_bar, step_bar
from ._common import VERDICTS, Claim, Sheet
from .claims import CLAIMS
from .results import markdown, read, verdicts, write

FIGURES = {
    "family": Sheet("Fig. 1, a family, and its row of the Jacobian", family.make),
    "m-cr": Sheet("Proposition 1, the order m_cr, compared with autodiff", m_cr.make),
    "a-cr": Sheet("critical loads, quoted and printed, compared with the exact diagonal and the symbol", a_cr.make),
    "maps-1d": Sheet("Fig. 2, stability map in 1D, compared with the symbol", maps.make_1d),
    "maps-2d": Sheet("Fig. 3, stability map in 2D, compared with the symbol", maps.make_2d),
    "singular-bar": Sheet(
        "Fig. 4, singular bar (four panels), also with Silling's model: minimum or saddle", singular_bar.make
    ),
    "step-bar": Sheet(
        "Fig. 5, ends displaced in one step (three panels), and the critical strain of the bar", step_bar.make
    ),
    "cuboid": Sheet(
        "Fig. 6, cuboid in tension and compression (five panels), and the prediction of the symbol", cuboid.make
    ),
    "dispersion": Sheet(
        "Fig. 7, dispersion curves (two panels), and whether the large wave is a motion", dispersion.make
    ),
}

__all__ = ["CLAIMS", "FIGURES", "VERDICTS", "Claim", "Sheet", "markdown", "read", "verdicts", "write"]
