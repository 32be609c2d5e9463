"""Closed-form results of Behzadinasab & Foster, as printed and, where an error is proved, corrected.

Some formulas of the paper contain an error (a "slip"). `SLIPS` lists these slips, S1 to S15. A function with an
argument `form` gives both versions: `form="printed"` is the formula of the paper, `form="corrected"` is the exact one.
"Derived here" and "ours" mark a formula that the paper does not contain.

    continuum        Γ(m), m_cr, the diagonal of the Jacobian and dT·dY as h → 0 at fixed horizon
    one_dimension    the discrete 1D diagonal, criterion and critical load; the plane wave; the singular and clamped bar
    local_bar        the nonlinear local solution of a bar under uniform stress, for any law (derived here)
    two_dimensions   the discrete 2D chain: lattice sums, diagonal, criteria, critical loads, slip by slip
    homogeneous      the Jacobian entry, force state and strain of any homogeneous deformation, exactly
    silling          the Jacobian entry of the original correspondence model
    lattice          the exact hydrostatic diagonal in 1D to 3D, and the symbol at the half-reciprocal points (ours)

Source: M. Behzadinasab and J. T. Foster, On the stability of the generalized, finite deformation
correspondence model of peridynamics.
"""

from ._common import SLIPS, lattice_bonds
from .continuum import continuum_diagonal, gamma, m_cr, material_test, radial_factor
from .homogeneous import (
    gradient_defect,
    jacobian_entry,
    jacobian_terms,
    local_strain,
    nonlocal_strain,
    static_integrand,
    strain_defect,
    uniform_force_state,
)
from .lattice import (
    half_reciprocal_points,
    half_reciprocal_symbol,
    hydrostatic_thresholds,
    lattice_critical_load,
    lattice_diagonal,
    odd_bond_sums,
)
from .local_bar import local_strain_of_stress, singular_bar_local
from .one_dimension import (
    bracket_1d,
    clamped_bar_critical_strain,
    critical_load_1d,
    diagonal_1d,
    dispersion_1d,
    dispersion_continuum_1d,
    dispersion_limit_1d,
    singular_bar_displacement,
    singular_bar_strain,
)
from .silling import silling_diagonal_3d, silling_entry
from .two_dimensions import (
    LatticeSums,
    Step,
    bracket_2d,
    chain_2d,
    critical_load_2d,
    diagonal_2d,
    index_tensor_2d,
    inverse_shape_tensor,
    jacobian_2d_hydrostatic,
    jacobian_2d_uniform,
    lattice_sums_2d,
    satisfies_criterion_2d,
)

__all__ = [
    "SLIPS",
    "LatticeSums",
    "Step",
    "bracket_1d",
    "bracket_2d",
    "chain_2d",
    "clamped_bar_critical_strain",
    "continuum_diagonal",
    "critical_load_1d",
    "critical_load_2d",
    "diagonal_1d",
    "diagonal_2d",
    "dispersion_1d",
    "dispersion_continuum_1d",
    "dispersion_limit_1d",
    "gamma",
    "gradient_defect",
    "half_reciprocal_points",
    "half_reciprocal_symbol",
    "hydrostatic_thresholds",
    "index_tensor_2d",
    "inverse_shape_tensor",
    "jacobian_2d_hydrostatic",
    "jacobian_2d_uniform",
    "jacobian_entry",
    "jacobian_terms",
    "lattice_bonds",
    "lattice_critical_load",
    "lattice_diagonal",
    "lattice_sums_2d",
    "local_strain",
    "local_strain_of_stress",
    "m_cr",
    "material_test",
    "nonlocal_strain",
    "odd_bond_sums",
    "radial_factor",
    "satisfies_criterion_2d",
    "silling_diagonal_3d",
    "silling_entry",
    "singular_bar_displacement",
    "singular_bar_local",
    "singular_bar_strain",
    "static_integrand",
    "strain_defect",
    "uniform_force_state",
]
