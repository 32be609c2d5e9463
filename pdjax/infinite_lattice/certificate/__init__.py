"""Proofs about the margin of a homogeneous state over the whole Brillouin zone.

The modules, in the order in which to read them:

    chambers      the lattice symmetries of a state, and the part of the zone that has to be examined
    enclosure     upper bounds of the symbol on boxes of the zone
    proof         branch and bound over the zone
    enclosed      lower and upper bounds of the margins of several states
    certificate   the result of `certify`, in words
"""
