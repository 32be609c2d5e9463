"""The exact tangent: ∂f/∂u of a body, and the linearised force state of one family.

The modules, in the order in which to read them:

    jacobian     jvp and jacobian, the exact Jacobian of a body
    linearise    the tangent ∂T/∂η of one family, by automatic differentiation
    assembly     the sparse Jacobian, assembled from the linearised families
    coloring     the sparse Jacobian by coloured directional derivatives, as a check
"""
