"""Studies: the paper of Behzadinasab & Foster (closed forms, figures and claims), and running cracks.

The modules, in the order in which to read them:

    closed_forms    the formulas of the paper, as printed and corrected; pdjax.closed_forms is this module
    bars            the curves of the static bars, for the command line and the paper
    running_cracks  runs of the scenes of dynamic fracture, and what they show beside wave theory and papers
    paper           the figures and claims of the paper, tested with the exact Jacobian
"""
