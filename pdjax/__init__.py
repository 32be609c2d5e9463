"""pdjax: a stability laboratory and differentiable engine for peridynamics, in JAX.

Write a material model once, for one family of bonds; get its forces, its exact Jacobian, its spectrum, its
critical loads and their gradients; and the equilibria and motions of whole bodies with their spectra.
The library follows the dtype of its inputs and never touches `jax.config`, unless you call `use_compilation_cache`:
for signs of eigenvalues, enable float64 first, `jax.config.update("jax_enable_x64", True)`. One flag of XLA it sets,
and says why (`pdjax._xla`): import it before the first computation.
`pdjax.figures` and `pdjax.export` load matplotlib and meshio when they are first used, not before.
"""

import importlib as _importlib

from . import _xla as _xla
from . import closed_forms, observers, scenes
from .atlas import Atlas, model_atlas, zero_energy_waves
from .bench.advice import advise
from .cells import CellStability, cell_families, cell_stability, cell_symbol, relaxed
from .compilation_cache import use_compilation_cache
from .conditions import body_force, homogeneous_traction, prescribe, total_force
from .criteria import CRITERIA, Stability, stability
from .criteria.body import BodyStability, body_inertia, body_spectrum, body_stability
from .criteria.body_critical import BodyCritical, body_critical_load
from .criteria.critical import critical_load, load_slope, stable_orders
from .cuts import Plane, Polygon, Segment, cut
from .devices import SlabForce, sharded_vmap, slab_force
from .dynamics import (
    Energies,
    Failure,
    History,
    Hold,
    Motion,
    Ramp,
    Rate,
    SmoothRamp,
    amplitude,
    critical_time_step,
    diffrax_start,
    diffrax_terms,
    measured_rate,
    motion,
    simulate,
    simulate_diffrax,
    symplectic_terms,
    verlet_rate,
)
from .evaluate import ForceOperator, force_density, force_operator
from .family_search import families
from .force import force_state, piola_stress, strain, strain_energy, stress
from .influence import (
    constant_influence,
    cubic_spline_influence,
    gaussian_influence,
    inverse_distance_influence,
    linear_influence,
    parabolic_influence,
    partial_volume_influence,
)
from .kinematics import bond_average_strain, local_strain, log_stretch, shape_tensor_K, shape_tensor_L
from .lattice_states import center_block, p_wave_modulus, symbol
from .laws import EnergyLaw, Law, LinearElastic, NeoHookean
from .maps import StabilityMap, stability_map
from .models import (
    CATALOGUE,
    LPS,
    AbstractModel,
    BondAssociated,
    BondAssociatedForce,
    BondBased,
    BondLevel,
    BondLevelAverage,
    Correspondence,
    LittlewoodControl,
    PointStateModel,
    ReproducingKernel,
    SethHill,
    SillingControl,
    SubHorizon,
    TupekRadovitzky,
    TwoStageModel,
    WanControl,
    graded,
    linearised,
    plane_bulk_modulus,
)
from .neighbourhoods import NeighbourReport, neighbour_report
from .neighbours import Bonds, Families, Family, lattice_family
from .paths import PATHS, hydrostatic, simple_shear, uniaxial_strain, uniaxial_stress
from .point_fields import cauchy_stress, dilatation, energy_density, von_mises, weighted_volume
from .points import Points, bar, cloud, cuboid, lattice, plate
from .problem import Scene, scene
from .statics import Equilibrium, EquilibriumPath, equilibrium_path, solve
from .tangent import jacobian, jvp
from .waves import Dispersion, classical_frequency, dispersion


def __getattr__(name: str):
    if name in ("figures", "export"):
        return _importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module 'pdjax' has no attribute {name!r}")


__all__ = [
    "CATALOGUE",
    "CRITERIA",
    "LPS",
    "PATHS",
    "AbstractModel",
    "Atlas",
    "BodyCritical",
    "BodyStability",
    "BondAssociated",
    "BondAssociatedForce",
    "BondBased",
    "BondLevel",
    "BondLevelAverage",
    "Bonds",
    "CellStability",
    "Correspondence",
    "Dispersion",
    "Energies",
    "EnergyLaw",
    "Equilibrium",
    "EquilibriumPath",
    "Failure",
    "Families",
    "Family",
    "ForceOperator",
    "History",
    "Hold",
    "Law",
    "LinearElastic",
    "LittlewoodControl",
    "Motion",
    "NeighbourReport",
    "NeoHookean",
    "Plane",
    "PointStateModel",
    "Points",
    "Polygon",
    "Ramp",
    "Rate",
    "ReproducingKernel",
    "Scene",
    "Segment",
    "SethHill",
    "SillingControl",
    "SlabForce",
    "SmoothRamp",
    "Stability",
    "StabilityMap",
    "SubHorizon",
    "TupekRadovitzky",
    "TwoStageModel",
    "WanControl",
    "advise",
    "amplitude",
    "bar",
    "body_critical_load",
    "body_force",
    "body_inertia",
    "body_spectrum",
    "body_stability",
    "bond_average_strain",
    "cauchy_stress",
    "cell_families",
    "cell_stability",
    "cell_symbol",
    "center_block",
    "classical_frequency",
    "closed_forms",
    "cloud",
    "constant_influence",
    "critical_load",
    "critical_time_step",
    "cubic_spline_influence",
    "cuboid",
    "cut",
    "diffrax_start",
    "diffrax_terms",
    "dilatation",
    "dispersion",
    "energy_density",
    "equilibrium_path",
    "export",
    "families",
    "figures",
    "force_density",
    "force_operator",
    "force_state",
    "gaussian_influence",
    "graded",
    "homogeneous_traction",
    "hydrostatic",
    "inverse_distance_influence",
    "jacobian",
    "jvp",
    "lattice",
    "lattice_family",
    "linear_influence",
    "linearised",
    "load_slope",
    "local_strain",
    "log_stretch",
    "measured_rate",
    "model_atlas",
    "motion",
    "neighbour_report",
    "observers",
    "p_wave_modulus",
    "parabolic_influence",
    "partial_volume_influence",
    "piola_stress",
    "plane_bulk_modulus",
    "plate",
    "prescribe",
    "relaxed",
    "scene",
    "scenes",
    "shape_tensor_K",
    "shape_tensor_L",
    "sharded_vmap",
    "simple_shear",
    "simulate",
    "simulate_diffrax",
    "slab_force",
    "solve",
    "stability",
    "stability_map",
    "stable_orders",
    "strain",
    "strain_energy",
    "stress",
    "symbol",
    "symplectic_terms",
    "total_force",
    "uniaxial_strain",
    "uniaxial_stress",
    "use_compilation_cache",
    "verlet_rate",
    "von_mises",
    "weighted_volume",
    "zero_energy_waves",
]
