"""Text and CSV files: formats, names of columns, dimensions, volumes, and errors that name the line."""

import numpy as np
import pytest

import pdjax as pd

PERIDIGM = """\
# x y z block_id volume
0.5 0.5 0.0 1 1.0
0.5 1.5 0.0 1 1.0

1.5 0.5 0.0 2 1.0  # a comment
1.5 1.5 0.0 2 1.0
"""
SQUARE = [[0.5, 0.5], [0.5, 1.5], [1.5, 0.5], [1.5, 1.5]]


def read(folder, text, name="points.txt", **arguments):
    file = folder / name
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return pd.read_points(file, **arguments)


def test_a_mesh_of_peridigm_becomes_a_lattice_with_blocks(tmp_path):
    body, data = read(tmp_path, PERIDIGM)
    assert body.uniform and body.shape == (2, 2) and body.positions.tolist() == SQUARE
    assert data.sets["block 1"].tolist() == [True, True, False, False] and data.sets["block 2"].sum() == 2
    assert not data.fields and data.times == () and data.time is None and data.step == 0
    assert data.notes[0] == "z is the same for all points and left out: the body is 2D."
    assert data.notes[1] == "The points are a uniform lattice of 2 × 2 cells with spacing 1."
    assert data.source.name == "points.txt" and "block 1 (2 points)" in repr(data)


@pytest.mark.parametrize(
    "head",
    [
        "header: x y z block_id volume",
        "#header: x y z block_id volume",
        "X Y Z Block Volume",
        "x, y, z, block, volume",
        '"x [mm]", "y [mm]", "z [mm]", "block", "volume (mm^3)"',
        "# written by a program\n# x;y;z;block;volume\n# 4 points",
        "# L\xe4nge in mm\nx y z block vol",
        "\ufeffx y z block volume",
    ],
)
def test_a_first_line_names_the_columns(tmp_path, head):
    numbers = PERIDIGM.split("\n", 1)[1]
    body, data = read(tmp_path, f"{head}\n{numbers}")
    assert body.positions.tolist() == SQUARE and list(data.sets) == ["block 1", "block 2"]


@pytest.mark.parametrize(
    "mark, name", [(",", "a.csv"), (", ", "a.csv"), (";", "a.CSV"), ("\t", "a.dat"), (" ", "a.txt")]
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_separators_and_line_ends(tmp_path, mark, name, end):
    rows = [["x", "y", "volume", "heat"], ["0.1", "0.2", "1e-3", "7"], ["0.4", "-0.2", "2e-3", "8"]]
    body, data = read(tmp_path, end.join(mark.join(row) for row in rows), name)
    assert body.positions.tolist() == [[0.1, 0.2], [0.4, -0.2]] and body.volumes.tolist() == [1e-3, 2e-3]
    assert data.fields["heat"].tolist() == [7.0, 8.0]


@pytest.mark.parametrize(
    "line, dim", [("{0} 2.0", 1), ("{0} {1} 2.0", 2), ("{0} {1} 0.{0} 2.0", 3), ("{0} {1} 0.{0} 3 2.0", 3)]
)
def test_columns_without_names_are_told_by_their_number(tmp_path, line, dim):
    text = "\n".join(line.format(k, k * k) for k in range(1, 6))
    body, data = read(tmp_path, text)
    assert body.dim == dim and (body.volumes == 2.0).all() and len(body) == 5
    assert data.notes[0].startswith("The columns have no names and are taken as x, ")


def test_components_become_vectors_and_tensors_and_words_are_left_out(tmp_path):
    names = "x,y,volume,u_x,u_y,fx,fy,s_1,s_2,s_3,s_4,F_11,F_12,F_21,F_22,material,Points_id,index"
    rows = ["0,0,1,1,2,3,4,5,6,7,8,9,10,11,12,steel,1,1", "1,2,1,1,2,3,4,5,6,7,8,9,10,11,12,steel,2,2"]
    _, data = read(tmp_path, "\n".join([names, *rows]), "a.csv")
    shapes = {name: values.shape[1:] for name, values in data.fields.items()}
    assert shapes == {"u": (2,), "f": (2,), "s": (4,), "F": (2, 2), "Points_id": (), "index": ()}
    assert data.fields["F"][0].tolist() == [[9, 10], [11, 12]]
    assert "Columns that hold words are left out: material." in data.notes


def test_exported_tables_of_paraview_are_read(tmp_path):
    text = '"u:0","u:1","u:2","volume","Points:0","Points:1","Points:2"\n1,2,0,0.5,0,0,0\n3,4,0,0.5,1,0.7,0\n'
    body, data = read(tmp_path, text, "a.csv")
    assert body.positions.tolist() == [[0, 0], [1, 0.7]] and data.vector("U", 2).tolist() == [[1, 2], [3, 4]]


def test_dim_keeps_a_constant_coordinate_or_refuses(tmp_path):
    assert read(tmp_path, PERIDIGM, dim=3)[0].dim == 3
    with pytest.raises(ValueError, match=r"dim must be at least 2 .* vary: x by 1, y by 1; got 1"):
        read(tmp_path, PERIDIGM, dim=1)
    with pytest.raises(ValueError, match="dim must be from 1 to 3"):
        read(tmp_path, PERIDIGM, dim=4)
    line = "\n".join(f"0.7 {k} 0.0 1 1.0" for k in range(4))
    body, data = read(tmp_path, line)
    assert body.dim == 1 and "x and z are the same for all points" in data.notes[1]
    assert read(tmp_path, line, dim=2)[0].dim == 2


def test_volumes_from_the_file_a_number_an_array_voronoi_cells_or_a_lattice(tmp_path):
    text = "# x y heat\n0.5 0.5 1\n0.5 1.5 2\n1.5 0.5 3\n1.5 1.5 4\n"
    with pytest.raises(ValueError, match=r"has no volumes; pass volume= a number or an array, .*voronoi.*lattice"):
        read(tmp_path, text)
    assert read(tmp_path, text, volume=1.0)[0].uniform
    cloud, data = read(tmp_path, text, volume=[1.0, 2.0, 1.0, 1.0])
    assert not cloud.uniform and cloud.spacing is None and cloud.volumes[1] == 2.0
    assert "so the body is a cloud" in data.notes[-1]
    assert read(tmp_path, text, volume="lattice")[0].uniform
    assert read(tmp_path, text, volume="lattice", spacing=1.0)[0].uniform
    cells, _ = read(tmp_path, text, volume="voronoi", outline=[[0, 0], [2, 0], [2, 3], [0, 3]])
    assert cells.volumes.tolist() == pytest.approx([1.0, 2.0, 1.0, 2.0], rel=1e-14)  # measured: 0
    for arguments, words in [
        ({"volume": "voronoi"}, "cells of the outer points have no end"),
        ({"volume": "lattice", "spacing": 0.7}, 'volume="lattice" needs a uniform lattice, but'),
        ({"volume": 1.0, "spacing": 0.7}, "spacing= is for a uniform lattice, but"),
        ({"volume": "box"}, "volume must be one of voronoi, lattice"),
        ({"volume": [1.0, 2.0]}, "volume must be one number or 4 of them"),
        ({"volume": -1.0}, "volume must be > 0"),
        ({"volume": np.nan}, "volume must be finite"),
        ({"volume": 1.0, "outline": [[0, 0], [2, 0], [2, 3]]}, "outline is for Voronoi cells"),
        ({"volume": 1.0, "step": 1}, "step must be from -1 to 0"),
    ]:
        with pytest.raises(ValueError, match=words):
            read(tmp_path, text, **arguments)


def test_columns_without_names_and_volumes_as_an_argument_are_refused(tmp_path):
    with pytest.raises(
        ValueError, match="its last column has no name and may be a coordinate or a volume; name the col"
    ):
        read(tmp_path, "0 0 1\n1 0 2\n0 1 3\n", volume=1.0)
    body, data = read(tmp_path, PERIDIGM.split("\n", 1)[1], volume=2.0)
    assert (body.volumes == 2.0).all() and "The volumes of the file are not used." in data.notes


def test_rounded_digits_give_the_exact_lattice_in_the_order_of_the_file(tmp_path):
    body = pd.lattice((6, 5), 1 / 3)
    order = np.random.default_rng(0).permutation(30)
    lines = [f"{x:.6g} {y:.6g} {1 / 9:.6g} {k}" for k, (x, y) in zip(order, body.positions[order], strict=True)]
    made, data = read(tmp_path, "# x y volume number\n" + "\n".join(lines))
    assert made.uniform and np.array_equal(made.sites, order) and np.array_equal(data.fields["number"], order)
    assert np.abs(made.positions - body.positions[order]).max() < 1e-5  # measured: 4e-6, from six digits
    assert "Their positions are those of the exact lattice" in data.notes[-1]


BAD = {
    "columns": ("# x y volume\n0 0 1\n1 0 1\n2 0\n", r"line 4: expected 3 numbers \(x, y, volume\); got 2 columns"),
    "word": ("# x y volume\n0 0 1\n\n1 zero 1\n", "line 4: expected 3 numbers .*; got 'zero' for y"),
    "decimal comma": ("x;y;volume\n0,5;0,5;1\n", "line 2: .*got '0,5' for x"),
    "zero volume": ("# x y volume\n0 0 1\n1 0 0\n", "line 3: expected a volume that is finite and > 0; got 0.0"),
    "negative volume": ("0 0 1\n\n1 0 -1\n", r"line 3: expected a volume .*; got -1.0 .*taken as x, y, volume"),
    "NaN volume": ("# x y volume\n0 0 nan\n", "line 2: expected a volume that is finite and > 0; got nan"),
    "NaN": ("# x y volume\n0 0 1\nnan 0 1\n", r"line 3: expected finite coordinates below 1e\+100; got \[nan, 0.0\]"),
    "overflow": (
        "# x y volume\n0 0 1\n1e999 0 1\n",
        r"line 3: expected finite coordinates below 1e\+100; got \[inf, 0.0\]",
    ),
    "twice": ("# x y volume\n0 1 1\n1 0 1\n\n0 1 1\n", "line 2 and line 5 have the same position"),
    "no x": ("# y volume heat\nlength volume\n1 2\n", "expected columns named x, y and z, x and y, or x; got length"),
    "z without y": ("x z volume\n1 2 3\n", "expected columns named x"),
    "two names": ("x y y volume\n1 2 3 4\n", "has two columns named y"),
    "few names": ("x y\n1 2 3\n", "line 2: expected 2 numbers .*; got 3 columns; every column needs a name"),
    "one column": ("1\n2\n", "expected 2 columns .*; got 1; name the columns in a first line"),
    "six columns": ("1 2 3 4 5 6\n", "got 6; name the columns in a first line"),
    "four whole columns": ("1 2 3 1.5\n2 2 3 1.5\n", "may be x y block volume or x y z volume; name the columns"),
    "part of a block": (
        "# x y block volume\n0 0 1 1\n1 1 1.5 1\n",
        "line 3: expected a whole number in the column block",
    ),
    "half a set": ("# x y set:a volume\n0 0 1 1\n1 1 2 1\n", "line 3: expected 0 or 1 in the column set:a"),
    "names only": ("x y volume\n", "holds no numbers"),
    "comments only": ("# x y volume\n", "holds no numbers"),
    "empty": ("", "the file is empty"),
    "UTF-16": ("x y volume\n0 0 1\n".encode("utf-16"), "is text in UTF-16; expected UTF-8"),
    "binary": (bytes(range(256)) * 10, "zero byte"),
    "noise": (bytes(range(1, 256)) * 10, "expected"),
    "long line": (b"x" * 100_000, "line 1: expected a line of text; got one of more than 65536 bytes"),
    "zero in the table": (b"0 0 1\n1 0 1\n\0\0\0\0", "line 3: expected 3 numbers"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_is_refused_with_the_line(tmp_path, kind):
    text, words = BAD[kind]
    with pytest.raises(ValueError, match=words) as caught:
        read(tmp_path, text)
    assert "points.txt" in str(caught.value)


def test_what_is_no_file_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        pd.read_points(tmp_path / "nothing.txt")
    with pytest.raises(IsADirectoryError, match="it is a directory; name a file in it"):
        pd.read_points(tmp_path)
    (tmp_path / "a.xyz").write_text("1 2 3")
    with pytest.raises(ValueError, match=r"expected one of \.csv, .*\.npz, .*\.txt.*; got '\.xyz'"):
        pd.read_points(tmp_path / "a.xyz")
    with pytest.raises(OSError, match="it is no regular file"):
        pd.read_points("/dev/zero")


def test_a_file_without_permission_is_refused(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text(PERIDIGM)
    file.chmod(0)
    try:
        file.read_bytes()
    except PermissionError:
        with pytest.raises(PermissionError, match=r"cannot read .*a.txt: Permission denied"):
            pd.read_points(file)
    else:
        pytest.skip("this user may read every file")


def test_many_blocks_are_a_field(tmp_path):
    text = "# x block volume\n" + "\n".join(f"{k} {k} 1" for k in range(300))
    _, data = read(tmp_path, text)
    assert not data.sets and len(data.fields["block"]) == 300 and "more than 256 different numbers" in data.notes[0]
