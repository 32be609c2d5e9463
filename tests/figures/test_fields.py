"""Pictures of bodies: what is drawn, in which colours and units, and the errors for arrays of a wrong shape."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.quiver import Quiver
from mpl_toolkits.mplot3d.art3d import Line3DCollection

import pdjax as pd
from pdjax.figures import fields


@pytest.fixture(scope="module")
def plate():
    return pd.lattice((5, 4), spacing=0.5)


def tiles(figure) -> PolyCollection:
    (found,) = (c for c in figure.axes[0].collections if isinstance(c, PolyCollection))
    return found


def corners(figure) -> np.ndarray:
    """Corners (points, 4, 2) of the cells."""
    return np.array([path.vertices[:4] for path in tiles(figure).get_paths()])


def legend(figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


# --- field


def test_every_point_is_one_cell_with_its_value(plate):
    values = np.arange(20.0)
    figure = pd.figures.field(plate, values, title="numbers", label="number  [–]")
    assert np.array_equal(tiles(figure).get_array(), values)
    assert np.allclose(corners(figure).mean(axis=1), plate.positions)
    assert np.allclose(np.ptp(corners(figure), axis=1), 0.5)  # the side of a cell
    axes, bar = figure.axes
    assert axes.get_title() == "numbers" and bar.get_ylabel() == "number  [–]"
    assert axes.get_aspect() == 1.0 and axes.get_xlabel() == "x  [length]" and axes.get_ylabel() == "y  [length]"
    assert not figure.legends


def test_a_long_body_has_its_colour_bar_below():
    figure = pd.figures.field(pd.lattice((20, 3)), np.arange(60.0), label="number  [–]")
    assert figure.axes[1].get_xlabel() == "number  [–]"


@pytest.mark.parametrize(
    ("values", "limits", "colours"),
    [
        ([-1.0, 3.0], (-3.0, 3.0), "RdBu_r"),
        ([1.0, 3.0], (1.0, 3.0), "cividis"),
        ([-3.0, -1.0], (-3.0, -1.0), "cividis"),
        ([-1e-13, 3.0], (-1e-13, 3.0), "cividis"),  # the negative value is rounding
        ([2.0, 2.0 + 1e-13], (1.9, 2.1), "cividis"),  # a uniform field does not show its rounding
        ([0.0, 0.0], (-1.0, 1.0), "cividis"),
        ([np.nan, 2.0], (1.9, 2.1), "cividis"),
        ([np.nan, np.nan], (0.0, 1.0), "cividis"),
    ],
)
def test_signed_values_have_diverging_colours_about_zero_and_others_sequential_ones(plate, values, limits, colours):
    drawn = tiles(pd.figures.field(plate, np.resize(values, 20)))
    assert np.allclose(drawn.get_clim(), limits, atol=1e-12) and drawn.get_cmap().name == colours


def test_points_without_a_finite_value_are_grey(plate):
    values = np.arange(20.0)
    values[[3, 7]] = np.nan, np.inf
    figure = pd.figures.field(plate, values)
    drawn = tiles(figure)
    assert np.flatnonzero(drawn.get_array().mask).tolist() == [3, 7] and drawn.get_clim() == (0.0, 19.0)
    assert tuple(drawn.get_cmap().get_bad()) == to_rgba(fields.GREY)
    assert legend(figure) == ["no value"]


def test_vectors_are_drawn_by_magnitude_or_component_and_tensors_by_component(plate):
    u, stress = np.stack([3 * np.ones(20), -4 * np.ones(20)], 1), np.arange(80.0).reshape(20, 2, 2)
    for values, component, shown, label in (
        (u, None, 5 * np.ones(20), "u  [mm], magnitude"),
        (u, 1, u[:, 1], "u  [mm], component y"),
        (stress, (0, 1), stress[:, 0, 1], "u  [mm], component xy"),
    ):
        figure = pd.figures.field(plate, values, label="u  [mm]", component=component)
        assert np.allclose(tiles(figure).get_array(), shown) and figure.axes[1].get_ylabel() == label


def test_deformed_cells_follow_a_homogeneous_deformation(plate):
    G = np.array([[0.1, 0.2], [0.0, -0.1]])
    figure = pd.figures.field(plate, np.ones(20), plate.positions @ G.T)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 4
    wanted = (plate.positions[:, None] + square) @ (np.eye(2) + G).T
    assert np.abs(corners(figure) - wanted).max() < 1e-14  # measured 4e-16


def test_cells_at_a_crack_keep_their_length(plate):
    u = np.where(plate.positions[:, :1] > 1.2, [[2.0, 0.0]], 0.0)
    figure = pd.figures.field(plate, np.ones(20), u)
    assert np.allclose(np.ptp(corners(figure), axis=1), 0.5)


def test_points_of_a_cloud_are_discs_of_their_area():
    body = pd.cloud([[0.0, 0.0], [3.0, 0.0]], volumes=[1.0, 4.0])
    paths = tiles(pd.figures.field(body, np.ones(2))).get_paths()
    radii = [np.linalg.norm(p.vertices - x, axis=1).max() for p, x in zip(paths, body.positions, strict=True)]
    assert np.allclose(radii, np.array([1.0, 2.0]) / np.sqrt(np.pi))


def test_one_layer_of_a_3d_body_is_drawn():
    body = pd.lattice((4, 3, 6), spacing=0.5)
    X = body.positions
    for cut, layer, across, title in (
        (None, X[:, 2] == 1.25, (0, 1), "layer z = 1.25"),  # the middle, 1.5, lies between two layers
        ((0, 1.9), X[:, 0] == 1.75, (1, 2), "layer x = 1.75"),
        ((1, 0.75), X[:, 1] == 0.75, (0, 2), "layer y = 0.75"),
    ):
        figure = pd.figures.field(body, X[:, 0], cut=cut, title="block")
        assert np.allclose(corners(figure).mean(axis=1), X[layer][:, across])
        assert np.array_equal(tiles(figure).get_array(), X[layer, 0])
        axes = figure.axes[0]
        assert axes.get_title() == f"block\n{title}"
        assert [axes.get_xlabel()[0], axes.get_ylabel()[0]] == ["xyz"[k] for k in across]


def test_the_layer_of_a_3d_body_moves_with_its_points():
    body = pd.lattice((4, 3, 3))
    figure = pd.figures.field(body, np.ones(36), 0.1 * body.positions)
    assert np.allclose(corners(figure).mean(axis=1), 1.1 * body.positions[body.positions[:, 2] == 1.5][:, :2])


def test_a_bar_is_a_curve_over_its_positions():
    body = pd.cloud([[0.9], [0.1], [0.5]], volumes=0.3)
    figure = pd.figures.field(body, [[3.0], [1.0], [np.nan]], [[0.1], [0.0], [0.0]], label="u  [mm]", component=0)
    (axes,) = figure.axes
    curve, missing = axes.lines
    assert curve.get_xdata().tolist() == [0.1, 0.5, 1.0] and curve.get_ydata()[[0, 2]].tolist() == [1.0, 3.0]
    assert missing.get_xdata().tolist() == [0.5] and missing.get_color() == fields.GREY
    assert axes.get_ylabel() == "u  [mm]" and axes.get_xlabel() == "deformed position x  [length]"
    assert legend(figure) == ["no value"]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda body: pd.figures.field(body, np.ones(3)), r"values must have shape \(20,\), \(20, 2\) or .*got \(3,\)"),
        (lambda body: pd.figures.field(body, np.ones(20) * 1j), "values must be real numbers"),
        (lambda body: pd.figures.field(body.positions, np.ones(20)), "points must be Points"),
        (lambda body: pd.figures.field(body, np.ones(20), np.ones(20)), r"u must have shape .*got \(20,\)"),
        (lambda body: pd.figures.field(body, np.ones(20), np.full((20, 2), np.nan)), "u must be finite"),
        (lambda body: pd.figures.field(body, np.ones(20), component=0), "leave component out"),
        (lambda body: pd.figures.field(body, np.ones((20, 2)), component=2), "component must be a number 0 to 1"),
        (lambda body: pd.figures.field(body, np.ones((20, 2, 2))), "component must be a pair of numbers 0 to 1"),
        (lambda body: pd.figures.field(body, np.ones((20, 2, 2)), component=1), "component must be a pair"),
        (lambda body: pd.figures.field(body, np.ones(20), cut=(0, 1.0)), "this body is 2D: leave cut out"),
        (lambda _: pd.figures.field(pd.lattice((2, 2, 2)), np.ones(8), cut=1.0), r"cut must be \(axis, coordinate\)"),
        (lambda _: pd.figures.field(pd.lattice((2, 2, 2)), np.ones(8), cut=(3, 1.0)), "axis 0, 1 or 2"),
        (lambda _: pd.figures.field(pd.lattice((2, 2, 2)), np.ones(8), cut=(0, 5.0)), "reaches from 0 to 2 along x"),
        (lambda body: pd.figures.scene(body), "scene must be Scene"),
    ],
)
def test_wrong_arguments_are_value_errors_that_say_what_is_expected(plate, call, words):
    with pytest.raises(ValueError, match=words):
        call(plate)


# --- scene


@pytest.fixture(scope="module")
def model(law):
    return pd.SethHill(1.0, law)


def test_supports_and_loads_of_a_plate_are_named_and_drawn(plate, model):
    x, y = plate.positions.T
    pulled = (x > 2) & (y > 0.5)
    scene = pd.scene(
        plate,
        pd.families(plate, 1.05),
        model,
        pd.prescribe(x < 0.5, 0.0, components=0),
        pd.prescribe(y < 0.5, 0.25, components=1),
        pd.body_force(pulled, [2.0, 0.0]),
        name="plate in tension",
    )
    figure = pd.figures.scene(scene)
    axes = figure.axes[0]
    assert axes.get_title() == "plate in tension" and axes.get_aspect() == 1.0
    assert legend(figure) == [
        "20 points",
        "u_x held",
        "u_y held",
        "u_x, u_y held",
        "prescribed displacement, largest 0.25 [length]",
        "body force, largest 2 [force/length²]",
    ]
    assert [len(line.get_xdata()) for line in axes.lines] == [20, 3, 4, 1]
    moved, loaded = (c for c in axes.collections if isinstance(c, Quiver))
    assert len(moved.U) == 5 and np.allclose(moved.U, 0) and np.allclose(moved.V, 0.9 * 0.5)  # 0.9 of a cell
    assert np.allclose(loaded.XY, plate.positions[pulled]) and np.allclose(loaded.V, 0)


def test_arrows_are_thinned_out_where_they_are_dense(model):
    body = pd.lattice((64, 32))
    X = body.positions
    families = pd.families(body, 2.1)
    scene = pd.scene(body, families, model, pd.prescribe(X[:, 0] < 2, 0.0), pd.body_force(X[:, 0] > 2, [1.0, 0.0]))
    (arrows,) = (c for c in pd.figures.scene(scene, "dense").axes[0].collections if isinstance(c, Quiver))
    assert len(arrows.U) == 16 * 8 and np.allclose(arrows.U, 0.9 * 4)  # one for 4 × 4 points
    assert np.diff(np.unique(arrows.XY[:, 0])).min() >= 3  # the last row holds two points only


def test_a_bar_shows_its_supports_and_loads():
    figure = pd.figures.scene(pd.scenes.singular_bar(40))
    assert legend(figure)[:2] == ["40 points", "u held"]
    assert "[force/length]" in legend(figure)[3]
    assert not len(figure.axes[0].get_yticks())


def test_a_3d_scene_is_drawn_in_perspective(model):
    body = pd.lattice((4, 3, 3))
    x = body.positions[:, 0]
    scene = pd.scene(body, pd.families(body, 1.8), model, pd.prescribe(x < 1, 0.0), pd.prescribe(x > 3, 0.1, 2))
    figure = pd.figures.scene(scene, "block")
    (axes,) = figure.axes
    assert axes.name == "3d" and axes.get_title() == "block" and axes.get_zlabel() == "z  [length]"
    assert legend(figure)[1:] == ["u_z held", "u_x, u_y, u_z held", "prescribed displacement, largest 0.1 [length]"]
    assert sum(isinstance(c, Line3DCollection) for c in axes.collections) == 1


def test_a_periodic_scene_names_its_period_and_mean_deformation(model):
    body = pd.lattice((6, 5), periodic=True)
    F = np.array([[1.0, 0.0], [0.0, 0.99]])
    scene = pd.scene(body, pd.families(body, 2.0), model, pd.prescribe([0], 0.0), mean=F, name="cell")
    assert pd.figures.scene(scene).axes[0].get_title() == (
        "cell\nperiodic along x, y; mean deformation [[1, 0], [0, 0.99]]"
    )
