"""pdjax: a stability laboratory and differentiable engine for peridynamics, in JAX.

Write a material model once, for one family of bonds; get its forces, its exact Jacobian, its spectrum, its
critical loads and their gradients; and the equilibria and motions of whole bodies with their spectra.
The library follows the dtype of its inputs and never touches `jax.config`, unless you call `use_compilation_cache`:
for signs of eigenvalues, enable float64 first, `jax.config.update("jax_enable_x64", True)`. One flag of XLA it sets,
and says why (`pdjax._internal.xla`): import it before the first computation.
`pdjax.figures` and `pdjax.export` load matplotlib and meshio when they are first used, not before.
"""

import importlib as _importlib

from . import scenes
from ._internal import xla as _xla
from ._internal.compilation_cache import use_compilation_cache
from .bench.advice import advise
from .finite_body import observers
from .finite_body.conditions import body_force, homogeneous_traction, prescribe, total_force
from .finite_body.critical_load import BodyCritical, body_critical_load
from .finite_body.dynamics import (
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
from .finite_body.scene import Scene, scene
from .finite_body.spectrum import BodyStability, body_inertia, body_spectrum, body_stability
from .finite_body.statics import Equilibrium, EquilibriumPath, equilibrium_path, solve
from .force.backends.slabs import SlabForce, sharded_vmap, slab_force
from .force.fields import force_state, piola_stress, strain, strain_energy, stress
from .force.operator import ForceOperator, force_density, force_operator
from .force.point_fields import cauchy_stress, dilatation, energy_density, von_mises, weighted_volume
from .geometry.bonds import Bonds, Families, Family, lattice_family
from .geometry.cuts import Plane, Polygon, Segment, cut
from .geometry.influence import (
    constant_influence,
    cubic_spline_influence,
    gaussian_influence,
    inverse_distance_influence,
    linear_influence,
    parabolic_influence,
    partial_volume_influence,
)
from .geometry.neighbour_search import families
from .geometry.points import Points, bar, cloud, cuboid, lattice, plate
from .geometry.report import NeighbourReport, neighbour_report
from .infinite_lattice.atlas import Atlas, model_atlas, zero_energy_waves
from .infinite_lattice.cells import CellStability, cell_families, cell_stability, cell_symbol, relaxed
from .infinite_lattice.criteria import CRITERIA, Stability, stability
from .infinite_lattice.criteria.critical_load import critical_load, load_slope, stable_orders
from .infinite_lattice.dispersion import Dispersion, classical_frequency, dispersion
from .infinite_lattice.lattice_states import center_block, p_wave_modulus, symbol
from .infinite_lattice.maps import StabilityMap, stability_map
from .infinite_lattice.paths import PATHS, hydrostatic, simple_shear, uniaxial_strain, uniaxial_stress
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
from .models.kinematics import bond_average_strain, local_strain, log_stretch, shape_tensor_K, shape_tensor_L
from .models.laws import EnergyLaw, Law, LinearElastic, NeoHookean
from .studies import closed_forms
from .tangent.jacobian import jacobian, jvp


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
