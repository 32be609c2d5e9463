"""Fields of a file as vectors of the body, and what PointData prints."""

import numpy as np
import pytest

import pdjax as pd


@pytest.fixture
def data(tmp_path):
    text = "x,y,z,volume,u_x,u_y,u_z,Disp_X,Disp_Y,heat,w_x,w_y,w_z\n"
    rows = [f"{k},{k * k},3,1,{k},{2 * k},0,{3 * k},{4 * k},{5 * k},1,2,3" for k in range(4)]
    (tmp_path / "a.csv").write_text(text + "\n".join(rows))
    return pd.read_points(tmp_path / "a.csv")[1]


def test_a_vector_has_the_dimension_of_the_body(data):
    k = np.arange(4.0)
    assert np.array_equal(data.vector("u", 2), np.stack([k, 2 * k], axis=1))
    assert data.vector("u", 3).shape == (4, 3)
    assert np.array_equal(data.vector("disp", 2), np.stack([3 * k, 4 * k], axis=1))
    assert np.array_equal(data.vector("heat", 1), 5 * k[:, None])


@pytest.mark.parametrize(
    "name, dim, words",
    [
        ("velocity", 2, "a.csv has no field 'velocity'; its fields are: Disp, heat, u, w"),
        ("w", 2, "field w has 3 components and the body is 2D; expected zeros in the other components; got up to 3"),
        ("heat", 2, r"field heat must have 2 components .*; got shape \(4, 1\)"),
        ("disp", 3, "field Disp must have 3 components"),
    ],
)
def test_a_field_that_is_no_such_vector_is_refused(data, name, dim, words):
    with pytest.raises(ValueError, match=words):
        data.vector(name, dim)


def test_a_body_in_another_plane_takes_the_components_of_its_plane(tmp_path):
    (tmp_path / "a.txt").write_text("# x y z volume u_x u_y u_z\n2 0 0 1 0 3 4\n2 1 0 1 0 5 6\n2 0 1 1 0 7 8\n")
    body, data = pd.read_points(tmp_path / "a.txt")
    assert body.dim == 2 and body.positions[1].tolist() == [1, 0]
    assert data.vector("u", 2).tolist() == [[3, 4], [5, 6], [7, 8]]


def test_a_file_with_one_state_yields_it_once(data):
    assert list(data.states()) == [data]
    assert data.at(0).fields.keys() == data.fields.keys()
    with pytest.raises(ValueError, match=r"step must be from -1 to 0; a.csv has 1 states"):
        data.at(1)


def test_the_print_names_fields_sets_and_notes(data):
    said = repr(data).splitlines()
    assert said[0] == "PointData of a.csv" and said[1] == "  fields: u (3,), Disp (2,), heat, w (3,)"
    assert said[2] == "  sets: none" and said[3].startswith("  z is the same for all points")
