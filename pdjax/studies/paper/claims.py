"""Every statement of the paper that is tested, one line each, in CLAIMS. Each claim reads the numbers of its sheet.

A claim with a question is a step of the derivation that looked like a slip, or a conclusion that was open. The test
named in the claim checks the answer against something independent of this table. The functions (numbers → ours,
verdict) of the sheets state the results.
"""

from . import a_cr, cuboid, dispersion, family, m_cr, maps, singular_bar, step_bar
from ._common import Claim

_TESTS = ("studies/test_closed_forms", "studies/test_claims", "infinite_lattice/test_dispersion")
_FORMS, _CLAIMS, _WAVES = (f"tests/{name}.py::test_" for name in _TESTS)
_LOADS = "pdjax critical --dim {} --N 3 --m {} --criterion diagonal symbol"


# One claim is one line, so that the table can be read across.
# ruff: noqa: E501
# fmt: off
CLAIMS = (
    # one family in a uniform deformation
    Claim("equilibrium", "inside a body every uniform deformation is an equilibrium", "sec. 3.1", "net force 0", "family", family.equilibrium, test="tests/force/test_force.py::test_a_homogeneous_periodic_body_is_in_equilibrium_and_moves_freely"),
    Claim("static", "summand of the static equation for one bond", "sec. 3.1, static equation", "T − T", "family", family.static, question="Does the bracket of the static equation equal 2T?", test=_FORMS + "static_equation_sign"),
    Claim("entry", "∂f(X)/∂x(X + η) in any uniform state, three terms", "sec. 3.2", "printed formula", "family", family.entry, test=_CLAIMS + "general_closed_form_of_the_jacobian_equals_autodiff"),
    Claim("centre", "moving a point does not change the strain at this point", "Remark 1", "∂Ē/∂x = 0", "family", family.centre),
    Claim("strain", "Ē recovers the local strain exactly under uniform deformation", "sec. 2, nonlocal strain", "exact", "family", family.strain, question="For which m and F is the nonlocal strain the local one?", test=_FORMS + "nonlocal_strain_is_exact_only_for_order_one_and_similarities"),
    Claim("silling", "Silling's model is stable under homogeneous deformation", "sec. 3.3", "stable for any deformation", "family", family.silling_stable, "pdjax atlas --dim 2 --models Silling", test=_CLAIMS + "sillings_model_is_marginal_not_stable"),
    # the continuum's diagonal
    Claim("m_cr", "order at which Γ changes sign, in 1D and 2D", "Proposition 1", "½, 0", "m-cr", m_cr.m_cr_plane, test=_FORMS + "gamma_is_the_average_over_directions"),
    Claim("m_cr_3d", "order at which Γ changes sign, in 3D", "Proposition 1", "0", "m-cr", m_cr.m_cr_space, question="Is the average of ξ_k²/|ξ|² in 3D right, and where does Γ(m) vanish?", test=_FORMS + "gamma_is_the_average_over_directions"),
    Claim("dTdY", "dT·dY of a moved centre, 3D, m = 0.8, a = 10 %, λ = μ = 1", "sec. 6.1, dT·dY", "printed formula: −0.4506", "m-cr", m_cr.moved_centre_sign, question="Are the sign and the indices of dT·dY of the moved centre right?", test=_FORMS + "material_test_of_the_moved_centre"),
    # critical loads
    Claim("a_cr_1d", "a_cr of the diagonal, 1D, m = 1, N = 1 and 3", "Remark 4", "−0.184, −0.074", "a-cr", a_cr.quoted_1d, _LOADS.format(1, 1), test=_FORMS + "critical_loads_1d"),
    Claim("nonlocality", "larger N is unfavourable to stability", "Remark 4", "−0.184 at N = 1, −0.074 at N = 3", "a-cr", a_cr.nonlocality, "pdjax critical --dim 1 --N 1 --m 1 --criterion diagonal symbol", question="In 1D, does a larger N make the full Jacobian less stable?", test=_CLAIMS + "in_1d_discretisation_stabilises_the_diagonal_but_not_the_symbol"),
    Claim("volume", "2D weighted volume over the volume of a point, N = 3", "sec. 4.2, 2D Jacobian", "πN = 9.42", "a-cr", a_cr.volume, question="Does the 2D weighted volume grow with N or with N²?", test=_FORMS + "diagonal_2d_corrected_is_exact"),
    Claim("sums", "2D sum of 1/p² over a family, N = 3", "sec. 4.2, lattice sums", "printed formula: 8 + 2π ln N = 14.90", "a-cr", a_cr.sums, question="Does four times the sum over a quadrant count the points on the axes once?", test=_FORMS + "lattice_sums_2d"),
    Claim("law", "I : dS/dE : I of the law S = κE, over κ", "sec. 4.2, 2D law", "4", "a-cr", a_cr.law, question="Is ∂S/∂E = κδδ the tangent of S = κE?", test=_CLAIMS + "critical_loads_of_the_exact_diagonals_in_1d_and_2d"),
    Claim("which_law", "law with S = κE under hydrostatic load that the paper uses", "sec. 4.2, 2D law", "not said", "a-cr", a_cr.which_law, test=_CLAIMS + "critical_loads_of_the_exact_diagonals_in_1d_and_2d"),
    Claim("factor", "q of the 2D criterion 1 + q[1 − (1 + a)^(−2m)], N = 3", "appendix C", "2πN = 18.85", "a-cr", a_cr.factor, question="Is the step from 1/(2m) to 1/m correct?", test=_FORMS + "printed_2d_diagonal_differs_by_a_factor_from_the_general_formula"),
    Claim("a_cr_2d", "a_cr in 2D, m = 1, N = 3, follows from the criterion", "Remark 5", "−0.037", "a-cr", a_cr.quoted_2d, _LOADS.format(2, 1), question="Does the quoted 2D critical load follow from the printed criterion?", test=_FORMS + "chain_2d"),
    Claim("inequality", "2D criterion at rest, a = 0", "before Fig. 3", "violated", "a-cr", a_cr.inequality, question="Which is the direction of the 2D inequality?", test=_FORMS + "criteria_2d_inequality_and_hencky_branch"),
    Claim("hencky", "a_cr of the 2D criterion at m = 0, N = 3", "before Fig. 3", "printed formula: −0.0517", "a-cr", a_cr.hencky, question="Is the 2D criterion at m = 0 the limit of the other branch?", test=_FORMS + "criteria_2d_inequality_and_hencky_branch"),
    Claim("dimension", "unstable regions grow with the dimension, 1D to 3D, m = 1, N = 3", "Remark 5", "2D half of 1D, 3D less", "a-cr", a_cr.dimension),
    # the maps
    Claim("map_1d", "1D map, N = 3: the printed diagonal", "Fig. 2", "printed formula", "maps-1d", maps.map_1d, "pdjax map --dim 1", test=_FORMS + "diagonal_1d_is_exact"),
    Claim("map_2d", "2D map, N = 3: the printed criterion, with its inequality reversed", "Fig. 3", "printed formula", "maps-2d", maps.map_2d, test=_FORMS + "diagonal_2d_corrected_is_exact"),
    Claim("sides_1d", "1D: compression is unstable for m > ½, tension for m < ½", "sec. 4.1", "beyond a critical load", "maps-1d", maps.sides_1d, "pdjax map --dim 1"),
    Claim("slightest", "continuum, m ≠ m_cr: the slightest load of one sign is unstable", "Remark 3", "a_cr = 0", "maps-1d", maps.slightest, "pdjax critical --dim 1 --m 0 1"),
    Claim("discretisation", "discretisation enhances stability, m = 1", "Remark 6", "true of every model", "maps-2d", maps.discretisation, "pdjax critical --dim 2 --N 2 --m 1 --criterion diagonal symbol", question="Does discretisation make the full Jacobian more stable?", test=_CLAIMS + "every_order_is_unstable_at_once_on_some_side"),
    Claim("log", "m = 0 may be stable under any hydrostatic load", "Remark 7", "in 2D and 3D", "maps-2d", maps.logarithmic, _LOADS.format(2, 0), question="Is the logarithmic model stable under hydrostatic load, in 2D and 3D, on each side?", test=_CLAIMS + "the_logarithmic_model_is_unstable_under_hydrostatic_load"),
    Claim("source", "the classical model is unstable too, at far larger loads", "sec. 6.3", "milder", "maps-2d", maps.source, "pdjax critical --m 1 -1 --criterion local symbol"),
    Claim("stabilise", "no known stabilisation removes the instability", "sec. 6.2", "none", "maps-2d", maps.stabilised, 'pdjax atlas --dim 2 --models "Seth–Hill 1" "Seth–Hill 1 + penalty"', test="tests/infinite_lattice/test_atlas.py::test_zero_energy_controls_move_the_critical_load_of_seth_hill_to_that_of_the_law"),
    Claim("switch", "choosing m by the sign of the load is not practical", "sec. 6.2", "doubted", "maps-2d", maps.switch, "pdjax critical --path uniaxial-stress --m -1 0 1"),
    # bars
    Claim("bar_tension", "singular bar, σ/E₀ = 10⁻³, m = 1: the solution is right and stable", "sec. 5.1", "as the local solution", "singular-bar", singular_bar.bar_tension),
    Claim("bar_form", "singular bar: the printed closed form is the local solution at σ/E₀ = 10⁻³", "sec. 5.1", "small strain", "singular-bar", singular_bar.bar_form, test="tests/scenes/test_scenes.py::test_local_solution_of_the_singular_bar_by_scipy"),
    Claim("bar_compression", "singular bar, σ/E₀ = −10⁻⁵, m = 1: the solution has unstable modes", "sec. 5.1", "unstable", "singular-bar", singular_bar.bar_compression),
    Claim("bar_points", "singular bar: number of points at which the solution is unstable", "sec. 5.1", "not in the text", "singular-bar", singular_bar.bar_points),
    Claim("bar_silling", "singular bar: Silling's model is unstable too, in tension and compression", "sec. 5.1", "unstable", "singular-bar", singular_bar.bar_silling),
    Claim("step_tension", "step-size bar: +100 % in one step is solved", "sec. 5.2", "correct", "step-bar", step_bar.step_tension, test=_CLAIMS + "the_compressed_step_size_bar_is_at_a_saddle"),
    Claim("step_size", "step-size bar: −0.1 % in one step fails because the step is too large", "sec. 5.2", "step size", "step-bar", step_bar.step_size, question="Is the step too large, or is the Jacobian of the clamped bar indefinite? What does Newton find?", test=_CLAIMS + "the_compressed_step_size_bar_is_at_a_saddle"),
    Claim("step_region", "step-size bar: it is stable down to a_cr", "sec. 5.2", "−7.4 %", "step-bar", step_bar.step_region, question="How does the critical strain of the clamped bar fall with its number of points?", test="tests/finite_body/test_spectrum.py::test_odd_horizons_lose_stability_as_the_inverse_square_of_length"),
    # the cuboid
    Claim("cuboid", "cuboid, m = 0: unstable under small tension and compression", "sec. 5.3", "unstable", "cuboid", cuboid.cuboid),
    Claim("cuboid_step", "cuboid: a smaller time step changes nothing", "sec. 5.3", "no effect", "cuboid", cuboid.cuboid_step),
    Claim("cuboid_fields", "cuboid in compression: u_x is smooth, u_y and u_z are not", "Fig. 6", "smooth, not, not", "cuboid", cuboid.cuboid_fields),
    Claim("cuboid_when", "cuboid: strain at which it becomes unstable", "Fig. 6", "not in the text", "cuboid", cuboid.cuboid_when),
    # waves
    Claim("waves_small", "for tiny u₀ all orders have the same dispersion curve", "sec. 5.4", "the same", "dispersion", dispersion.waves_small, question="Does the dispersion relation for u₀ → 0 agree with the symbol?", test=_WAVES + "the_papers_dispersion_tends_to_the_symbol"),
    Claim("waves_zeros", "the frequency of every order has periodic zeros, also for large u₀", "Fig. 7b", "periodic zero frequencies", "dispersion", dispersion.waves_zeros),
    Claim("waves_edge", "zero frequencies indicate instability", "Fig. 7", "for all models", "dispersion", dispersion.waves_edge, test=_WAVES + "a_zero_energy_mode_stands_still"),
    Claim("waves_large", "for large u₀ (0.1 h) ω read at X = 0, t = 0 is the frequency of a wave", "sec. 5.4", "\"dependent on X, t, and u₀\"", "dispersion", dispersion.waves_large, question="Is the complex plane wave of large u₀ a motion?", test=_WAVES + "the_papers_complex_wave_is_no_motion"),
)
# fmt: on

__all__ = ["CLAIMS"]
