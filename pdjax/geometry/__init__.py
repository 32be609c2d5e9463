"""The geometry of a body on the host: points, families of bonds, influence functions, cuts and reports.

The modules, in the order in which to read them:

    points              the points of a body: lattice, bar, plate, cuboid, cloud
    influence           influence functions ω(|ξ|, δ)
    bonds               bonds and families: Bonds, LatticeFamily, Families
    neighbour_search    families: all bonds of a body within the horizon
    ties                bonds as long as the horizon, whose family must not depend on rounding
    stencils            arrays of a lattice without neighbour lists
    cuts                cracks: surfaces that cut bonds
    report              a report on the families of a body
"""
