"""A stability laboratory and differentiable engine for peridynamics, in JAX.

Write a material model once, for one family of bonds. pdjax gives its forces, its exact Jacobian, its spectrum and its
critical loads, the equilibria and motions of whole bodies, and the derivatives of all of them.

    pdjax.geometry           points of a body, families of bonds, influence functions, cuts
        lattice, bar, plate, cuboid, cloud, lattice_family, families, neighbour_report, cut
    pdjax.models             material models, material laws, strains and shape tensors
        SethHill, Correspondence, BondBased, LPS, BondLevel, ReproducingKernel, BondAssociated, SillingControl
        LinearElastic, NeoHookean, EnergyLaw, graded, linearised, CATALOGUE
    pdjax.force              forces, energies, strains and stresses of a body or of one family
        force_density, force_operator, force_state, strain_energy, strain, stress, cauchy_stress, von_mises
        surface_correction
    pdjax.tangent            the exact Jacobian of the forces of a body: jacobian, jvp
    pdjax.infinite_lattice   stability and waves of an infinite lattice, from one family
        stability, certify, certify_path, critical_load, stability_map, model_atlas, symbol, center_block, dispersion
        cell_stability, hydrostatic, uniaxial_strain, uniaxial_stress, simple_shear
    pdjax.finite_body        supports and loads, stability, statics, dynamics and fracture of a body
        prescribe, body_force, total_force, scene, solve, use_direct_solver, equilibrium_path, body_stability
        body_spectrum, body_critical_load, motion, simulate, observers, CriticalStretch, solve_breaking, crack_path
    pdjax.scenes             problems that are ready to solve, some with a closed form
    pdjax.optimise           design by gradient, and parameters from measured data
        worst_margin, load_cases, dispersion_error, lattice_time_step, design, pareto_front
        identify, tikhonov, total_variation
    pdjax.trust              whether a state can be trusted: audit, audit_states, trust_observer, crack_or_instability
    pdjax.figures            matplotlib figures of results
    pdjax.files              points and fields from files and to files: read_points, PointData, write_points, export
    pdjax.studies            the paper of Behzadinasab & Foster: figures, claims, formulas: pdjax.closed_forms
    pdjax.bench              measurements of speed, and advice on methods: pdjax.advise

The indented names belong to pdjax itself, such as `pdjax.stability`. `help(pdjax.stability)` explains it.

The dtype of the results follows the inputs. The signs of eigenvalues decide verdicts, so enable float64 first:
`jax.config.update("jax_enable_x64", True)`. pdjax changes no setting of JAX unless `use_compilation_cache` is called.
With jaxlib 0.10, pdjax sets one flag of XLA (see `pdjax._internal.xla`): import pdjax before the first computation.
"""

import importlib as _importlib

from . import scenes as scenes
from ._internal import moved as _moved
from ._internal import version as _version
from ._internal import xla as _xla
from ._internal.compilation_cache import use_compilation_cache as use_compilation_cache
from .bench.advice import advise as advise
from .files.point_data import PointData as PointData
from .files.read import read_points as read_points
from .files.write import write_points as write_points
from .finite_body import observers as observers
from .finite_body.conditions import (
    body_force as body_force,
)
from .finite_body.conditions import (
    homogeneous_traction as homogeneous_traction,
)
from .finite_body.conditions import (
    prescribe as prescribe,
)
from .finite_body.conditions import (
    total_force as total_force,
)
from .finite_body.crack_path import Branching as Branching
from .finite_body.crack_path import CrackPath as CrackPath
from .finite_body.crack_path import crack_angle as crack_angle
from .finite_body.crack_path import crack_area as crack_area
from .finite_body.crack_path import crack_branching as crack_branching
from .finite_body.crack_path import crack_path as crack_path
from .finite_body.crack_path import crack_speed as crack_speed
from .finite_body.critical_load import BodyCritical as BodyCritical
from .finite_body.critical_load import body_critical_load as body_critical_load
from .finite_body.damage import BreakingRule as BreakingRule
from .finite_body.damage import CriticalBondEnergy as CriticalBondEnergy
from .finite_body.damage import CriticalStretch as CriticalStretch
from .finite_body.damage import released_energy as released_energy
from .finite_body.direct_solver import use_direct_solver as use_direct_solver
from .finite_body.dynamics import (
    Energies as Energies,
)
from .finite_body.dynamics import (
    Failure as Failure,
)
from .finite_body.dynamics import (
    History as History,
)
from .finite_body.dynamics import (
    Hold as Hold,
)
from .finite_body.dynamics import (
    Motion as Motion,
)
from .finite_body.dynamics import (
    Ramp as Ramp,
)
from .finite_body.dynamics import (
    Rate as Rate,
)
from .finite_body.dynamics import (
    SmoothRamp as SmoothRamp,
)
from .finite_body.dynamics import (
    amplitude as amplitude,
)
from .finite_body.dynamics import (
    critical_time_step as critical_time_step,
)
from .finite_body.dynamics import (
    diffrax_start as diffrax_start,
)
from .finite_body.dynamics import (
    diffrax_terms as diffrax_terms,
)
from .finite_body.dynamics import (
    measured_rate as measured_rate,
)
from .finite_body.dynamics import (
    motion as motion,
)
from .finite_body.dynamics import (
    simulate as simulate,
)
from .finite_body.dynamics import (
    simulate_diffrax as simulate_diffrax,
)
from .finite_body.dynamics import (
    symplectic_terms as symplectic_terms,
)
from .finite_body.dynamics import (
    verlet_rate as verlet_rate,
)
from .finite_body.scene import Scene as Scene
from .finite_body.scene import scene as scene
from .finite_body.spectrum import (
    BodyStability as BodyStability,
)
from .finite_body.spectrum import (
    body_inertia as body_inertia,
)
from .finite_body.spectrum import (
    body_spectrum as body_spectrum,
)
from .finite_body.spectrum import (
    body_stability as body_stability,
)
from .finite_body.statics import (
    BreakingEnergies as BreakingEnergies,
)
from .finite_body.statics import (
    BreakingPath as BreakingPath,
)
from .finite_body.statics import (
    Equilibrium as Equilibrium,
)
from .finite_body.statics import (
    EquilibriumPath as EquilibriumPath,
)
from .finite_body.statics import (
    equilibrium_path as equilibrium_path,
)
from .finite_body.statics import (
    solve as solve,
)
from .finite_body.statics import (
    solve_breaking as solve_breaking,
)
from .force.backends.slabs import SlabForce as SlabForce
from .force.backends.slabs import sharded_vmap as sharded_vmap
from .force.backends.slabs import slab_force as slab_force
from .force.fields import (
    force_state as force_state,
)
from .force.fields import (
    piola_stress as piola_stress,
)
from .force.fields import (
    strain as strain,
)
from .force.fields import (
    strain_energy as strain_energy,
)
from .force.fields import (
    stress as stress,
)
from .force.operator import (
    ForceOperator as ForceOperator,
)
from .force.operator import (
    force_density as force_density,
)
from .force.operator import (
    force_operator as force_operator,
)
from .force.point_fields import (
    cauchy_stress as cauchy_stress,
)
from .force.point_fields import (
    dilatation as dilatation,
)
from .force.point_fields import (
    energy_density as energy_density,
)
from .force.point_fields import (
    von_mises as von_mises,
)
from .force.point_fields import (
    weighted_volume as weighted_volume,
)
from .force.surface_correction import surface_correction as surface_correction
from .geometry.bonds import (
    Bonds as Bonds,
)
from .geometry.bonds import (
    Families as Families,
)
from .geometry.bonds import (
    LatticeFamily as LatticeFamily,
)
from .geometry.bonds import (
    lattice_family as lattice_family,
)
from .geometry.cuts import Plane as Plane
from .geometry.cuts import Polygon as Polygon
from .geometry.cuts import Segment as Segment
from .geometry.cuts import cut as cut
from .geometry.influence import (
    constant_influence as constant_influence,
)
from .geometry.influence import (
    cubic_spline_influence as cubic_spline_influence,
)
from .geometry.influence import (
    gaussian_influence as gaussian_influence,
)
from .geometry.influence import (
    inverse_distance_influence as inverse_distance_influence,
)
from .geometry.influence import (
    linear_influence as linear_influence,
)
from .geometry.influence import (
    parabolic_influence as parabolic_influence,
)
from .geometry.influence import (
    partial_volume_influence as partial_volume_influence,
)
from .geometry.influence import (
    signed_influence as signed_influence,
)
from .geometry.neighbour_search import families as families
from .geometry.points import (
    Points as Points,
)
from .geometry.points import (
    bar as bar,
)
from .geometry.points import (
    cloud as cloud,
)
from .geometry.points import (
    cuboid as cuboid,
)
from .geometry.points import (
    lattice as lattice,
)
from .geometry.points import (
    plate as plate,
)
from .geometry.report import NeighbourReport as NeighbourReport
from .geometry.report import neighbour_report as neighbour_report
from .geometry.shells import interpolated_influence as interpolated_influence
from .geometry.shells import shells as shells
from .infinite_lattice.atlas import Atlas as Atlas
from .infinite_lattice.atlas import model_atlas as model_atlas
from .infinite_lattice.atlas import zero_energy_waves as zero_energy_waves
from .infinite_lattice.cells import (
    CellStability as CellStability,
)
from .infinite_lattice.cells import (
    cell_families as cell_families,
)
from .infinite_lattice.cells import (
    cell_stability as cell_stability,
)
from .infinite_lattice.cells import (
    cell_symbol as cell_symbol,
)
from .infinite_lattice.cells import (
    relaxed as relaxed,
)
from .infinite_lattice.certificate.certificate import Certificate as Certificate
from .infinite_lattice.criteria import CRITERIA as CRITERIA
from .infinite_lattice.criteria import Stability as Stability
from .infinite_lattice.criteria import stability as stability
from .infinite_lattice.criteria.certified import certify as certify
from .infinite_lattice.criteria.certified_critical import CriticalCertificate as CriticalCertificate
from .infinite_lattice.criteria.certified_critical import certify_critical_load as certify_critical_load
from .infinite_lattice.criteria.certified_path import PathCertificate as PathCertificate
from .infinite_lattice.criteria.certified_path import certify_path as certify_path
from .infinite_lattice.criteria.critical_load import (
    critical_load as critical_load,
)
from .infinite_lattice.criteria.critical_load import (
    load_slope as load_slope,
)
from .infinite_lattice.criteria.critical_load import (
    stable_orders as stable_orders,
)
from .infinite_lattice.dispersion import (
    Dispersion as Dispersion,
)
from .infinite_lattice.dispersion import (
    classical_frequency as classical_frequency,
)
from .infinite_lattice.dispersion import (
    dispersion as dispersion,
)
from .infinite_lattice.lattice_states import (
    center_block as center_block,
)
from .infinite_lattice.lattice_states import (
    p_wave_modulus as p_wave_modulus,
)
from .infinite_lattice.lattice_states import (
    symbol as symbol,
)
from .infinite_lattice.maps import StabilityMap as StabilityMap
from .infinite_lattice.maps import stability_map as stability_map
from .infinite_lattice.paths import (
    PATHS as PATHS,
)
from .infinite_lattice.paths import (
    hydrostatic as hydrostatic,
)
from .infinite_lattice.paths import (
    simple_shear as simple_shear,
)
from .infinite_lattice.paths import (
    uniaxial_strain as uniaxial_strain,
)
from .infinite_lattice.paths import (
    uniaxial_stress as uniaxial_stress,
)
from .infinite_lattice.time_step import lattice_time_step as lattice_time_step
from .models import (
    CATALOGUE as CATALOGUE,
)
from .models import (
    LPS as LPS,
)
from .models import (
    AbstractModel as AbstractModel,
)
from .models import (
    BondAssociated as BondAssociated,
)
from .models import (
    BondAssociatedForce as BondAssociatedForce,
)
from .models import (
    BondBased as BondBased,
)
from .models import (
    BondLevel as BondLevel,
)
from .models import (
    BondLevelAverage as BondLevelAverage,
)
from .models import (
    Correspondence as Correspondence,
)
from .models import (
    LittlewoodControl as LittlewoodControl,
)
from .models import (
    PointStateModel as PointStateModel,
)
from .models import (
    ReproducingKernel as ReproducingKernel,
)
from .models import (
    SethHill as SethHill,
)
from .models import (
    ShellControl as ShellControl,
)
from .models import (
    SillingControl as SillingControl,
)
from .models import (
    SubHorizon as SubHorizon,
)
from .models import (
    TupekRadovitzky as TupekRadovitzky,
)
from .models import (
    TwoStageModel as TwoStageModel,
)
from .models import (
    WanControl as WanControl,
)
from .models import (
    graded as graded,
)
from .models import (
    linearised as linearised,
)
from .models import (
    plane_bulk_modulus as plane_bulk_modulus,
)
from .models.kinematics import (
    bond_average_strain as bond_average_strain,
)
from .models.kinematics import (
    local_strain as local_strain,
)
from .models.kinematics import (
    log_stretch as log_stretch,
)
from .models.kinematics import (
    shape_tensor_K as shape_tensor_K,
)
from .models.kinematics import (
    shape_tensor_L as shape_tensor_L,
)
from .models.laws import EnergyLaw as EnergyLaw
from .models.laws import Law as Law
from .models.laws import LinearElastic as LinearElastic
from .models.laws import NeoHookean as NeoHookean
from .optimise.design_search import Design as Design
from .optimise.design_search import design as design
from .optimise.identified import Identified as Identified
from .optimise.identify import identify as identify
from .optimise.least_penalty import least_penalty as least_penalty
from .optimise.load_cases import LoadCases as LoadCases
from .optimise.load_cases import load_cases as load_cases
from .optimise.margins import worst_margin as worst_margin
from .optimise.pareto import ParetoFront as ParetoFront
from .optimise.pareto import pareto_front as pareto_front
from .optimise.regularisation import tikhonov as tikhonov
from .optimise.regularisation import total_variation as total_variation
from .optimise.wave_speeds import dispersion_error as dispersion_error
from .optimise.wave_speeds import moduli_error as moduli_error
from .studies import closed_forms as closed_forms
from .tangent.jacobian import jacobian as jacobian
from .tangent.jacobian import jvp as jvp
from .trust.audit import audit as audit
from .trust.crack_or_instability import crack_or_instability as crack_or_instability
from .trust.fracture_verdict import Burst as Burst
from .trust.fracture_verdict import FractureVerdict as FractureVerdict
from .trust.observer import TrustObserver as TrustObserver
from .trust.observer import trust_observer as trust_observer
from .trust.series import AuditSeries as AuditSeries
from .trust.series import audit_states as audit_states
from .trust.verdict import Audit as Audit
from .trust.verdict import Finding as Finding

__version__ = _version.VERSION
Family = LatticeFamily

_xla.set_flag()
_moved.install()


def __getattr__(name: str):
    if name == "figures":  # it loads matplotlib
        return _importlib.import_module(".figures", __name__)
    if name == "export":  # few sessions write files
        return _importlib.import_module(".files.vtk", __name__)
    raise AttributeError(f"module 'pdjax' has no attribute {name!r}{_moved.hint(name)}")
