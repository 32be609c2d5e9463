"""Stability of an infinite uniform lattice under a homogeneous deformation x = F X.

All points of such a lattice are equivalent, so that one family of bonds is enough. The modules, in the order in which
to read them:

    bloch             the symbol Ĵ(k): the exact Jacobian of the lattice on one plane wave of wave vector k
    lattice_states    linearised states, and the functions symbol, center_block and p_wave_modulus
    criteria          the stability criteria, stability and critical_load
    paths             load paths: a deformation gradient F for each load a
    brillouin         the grid of wave vectors that covers the Brillouin zone
    cosine_series     the symbol written as a sum of cosines, which is the form that the search uses
    climb             Newton's method, which refines the best wave vectors of the grid
    maps              stability margins over many models and loads
    dispersion        frequencies of plane waves
    cells             periodic lattices whose cell holds several points
    atlas             a survey of many models
"""
