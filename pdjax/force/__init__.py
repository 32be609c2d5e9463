"""Forces, energies, strains and stresses of bodies and of single families, and the backends of the forces.

The modules, in the order in which to read them:

    operator         force_density and force_operator, which choose a backend
    fields           forces, energies, strains and stresses by the general path, which every model has
    point_fields     dilatation, energy density, Cauchy stress and von Mises stress of every point
    shape_tensors    the check that the shape tensors of all families can be inverted
    backends         the fast ways to evaluate the force density of a body
"""
