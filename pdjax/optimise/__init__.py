"""Design by gradient and inverse problems: derivatives of stability, statics and dynamics put to use.

This room stands above the infinite lattice, the finite body and the scenes. In the order in which to read them:

    load_cases              the deformations that a design has to survive
    margins                 the worst margin over load cases, and its smooth bound
    wave_speeds             errors of phase and group speeds, and of moduli
    least_penalty           the least strength of a zero-energy control, by Newton's method
    problem                 objective and constraints as functions of one scaled vector
    augmented_lagrangian    the search with constraints, on optax
    design_search           `design`
    pareto                  `pareto_front`
    parameters, measured    parameters and data of an inverse problem as flat arrays
    predictions             predicted data and their Jacobians, with predict_statics and predict_motions
    regularisation          Tikhonov and total variation
    least_squares           the search, on SciPy
    identified, identify    the result of an inverse problem, and `identify`
"""
