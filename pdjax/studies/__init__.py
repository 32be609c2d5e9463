"""Studies of the paper of Behzadinasab & Foster: closed forms, figures and claims.

The modules, in the order in which to read them:

    closed_forms    the formulas of the paper, as printed and corrected; pdjax.closed_forms is this module
    bars            the curves of the static bars, for the command line and the paper
    paper           the figures and claims of the paper, tested with the exact Jacobian
"""
