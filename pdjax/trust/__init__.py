"""Whether a computed state of a body can be trusted: the audit.

The modules, in the order in which to read them:

    point_measures   zero-energy measures of every point, from its family alone
    own_lattice      the margin of the infinite lattice at every point's own stretch
    checks           what makes a state doubtful or untrusted
    verdict          the result of an audit
    auditor          what all audits of a body share, and how one comes to its verdict
    given_forces     forces of another code beside those of the model
    audit            the public function audit
    series           audits of the states of a run
    observer         the audit as an observer of simulate
    bursts           bonds that break together, in space and in time
    surroundings     the material around the first bonds of a burst, before it
    fracture_verdict the result of crack_or_instability
    crack_or_instability  whether a crack grew, or the model was unstable before
"""
