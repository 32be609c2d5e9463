"""Finite bodies: conditions, scenes, spectra, critical loads, statics, dynamics, damage and observers.

The modules, in the order in which to read them:

    conditions       supports and loads: prescribed displacements, body forces, total forces, tractions
    scene            Scene: a body, its model and its conditions as one boundary value problem
    statics          equilibria of a scene, and equilibrium paths
    spectrum         eigenvalues and modes of a body, and the verdict on its stability
    critical_load    the first load at which a body becomes unstable
    dynamics         motions of a body, time steps, growth rates
    damage           bonds that break: criteria, fracture energy, released energy
    observers        time series recorded during a motion: probes, reactions, section forces, damage, crack tips
    crack_path       the path, area, speed, angle and branches of a crack
    inertia          a proof of the number of positive eigenvalues of a matrix
    direct_solver    the choice of the sparse direct solver: SuperLU or PARDISO
    factorisation    the reduced system of a scene, its sparse factors, the count of its positive eigenvalues
"""
