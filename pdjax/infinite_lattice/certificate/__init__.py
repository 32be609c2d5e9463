"""Proofs about the margin of a homogeneous state over the whole Brillouin zone.

The modules, in the order in which to read them:

    chambers      the lattice symmetries of a state, and the part of the zone that has to be examined
    boxes         boxes of the zone, and cones of long waves
    polynomials   upper bounds of matrix polynomials on boxes
    enclosure     the symbol on boxes and cones: a polynomial, and bounds of what it leaves out
    proof         branch and bound over the zone
    enclosed      lower and upper bounds of the margins of several states
    certificate   the result of `certify`, in words
"""
