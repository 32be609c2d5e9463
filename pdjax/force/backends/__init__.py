"""Backends of the force density: padded families, slices of a lattice, convolutions, compiled loops.

All backends compute the same forces to rounding. The modules, in the order in which to read them:

    backend       the interface of a backend: refusal, prepare and Backend.force
    padded        the backend "families": padded neighbour arrays, for every model and every cloud of points
    slices        the backend "slices": on a lattice the neighbours at one offset are one slice of an array
    fft           the backend "fft": on a lattice the sums over bonds are convolutions
    compiled      the backend "compiled": loops over the bonds that LLVM compiles, for lattices and clouds on CPUs
    streamed      the class Streamed, which padded and slices share: it prepares a body and keeps what is reused
    streaming     the formulas of Streamed: forces and reference sums, one slot of bonds after the other
    traversal     the order in which streaming visits the bonds of a body
    point_states  constants that vary, sums of the reference configuration and point states of a whole body
    components    functions of small arrays, evaluated as arithmetic on long arrays
    slabs         a lattice body cut into slabs, one for each device
"""
