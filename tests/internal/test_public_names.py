"""The public names of earlier versions: all of them still work."""

import numpy as np
import pytest

import pdjax as pd

NAMES = """
CATALOGUE CRITERIA LPS PATHS AbstractModel Atlas BodyCritical BodyStability BondAssociated BondAssociatedForce
BondBased BondLevel BondLevelAverage Bonds CellStability Correspondence Dispersion Energies EnergyLaw Equilibrium
EquilibriumPath Failure Families LatticeFamily ForceOperator History Hold Law LinearElastic LittlewoodControl Motion
NeighbourReport NeoHookean Plane PointData PointStateModel Points Polygon Ramp Rate ReproducingKernel Scene Segment
SethHill SillingControl SlabForce SmoothRamp Stability StabilityMap SubHorizon TupekRadovitzky TwoStageModel WanControl
advise amplitude bar body_critical_load body_force body_inertia body_spectrum body_stability bond_average_strain
cauchy_stress cell_families cell_stability cell_symbol center_block classical_frequency closed_forms cloud
constant_influence critical_load critical_time_step cubic_spline_influence cuboid cut diffrax_start diffrax_terms
dilatation dispersion energy_density equilibrium_path export families figures force_density force_operator force_state
gaussian_influence graded homogeneous_traction hydrostatic inverse_distance_influence jacobian jvp lattice
lattice_family linear_influence linearised load_slope local_strain log_stretch measured_rate model_atlas motion
neighbour_report observers p_wave_modulus parabolic_influence partial_volume_influence piola_stress plane_bulk_modulus
plate prescribe read_points relaxed scene scenes shape_tensor_K shape_tensor_L sharded_vmap simple_shear simulate
simulate_diffrax slab_force solve stability stability_map stable_orders strain strain_energy stress symbol
symplectic_terms total_force uniaxial_strain uniaxial_stress use_compilation_cache use_direct_solver verlet_rate
von_mises weighted_volume write_points zero_energy_waves
""".split()


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_is_there(name):
    assert getattr(pd, name) is not None


def test_earlier_names_of_arguments_are_accepted():
    law = pd.LinearElastic(1.0, 1.0)
    model, family = pd.SethHill(1.0, law), pd.lattice_family(2, 2)
    assert pd.Family is pd.LatticeFamily
    old = pd.stability(model, fam=family, F=np.eye(2))
    assert old.verdict == pd.stability(model, family=family, F=np.eye(2)).verdict
    families = pd.families(pd.lattice((5, 4)), 2.1)
    u = np.zeros((20, 2))
    assert np.array_equal(pd.force_density(model, fams=families, u=u), pd.force_density(model, families=families, u=u))
    with pytest.raises(TypeError, match="fam"):
        pd.stability(model, fam=family, family=family, F=np.eye(2))


def test_version_is_that_of_the_distribution():
    from importlib.metadata import version

    assert pd.__version__ == version("pdjax")


def test_help_fits_a_screen():
    """`help(pdjax)` shows the rooms by topic, not the documentation of every name."""
    import pydoc

    text = pydoc.render_doc(pd, renderer=pydoc.plaintext)
    assert len(text.splitlines()) < 80
    assert "stability" in text and "solve" in text
