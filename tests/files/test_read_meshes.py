"""Meshes become points: volumes, centroids, fields and sets of every format, against independent numbers."""

import importlib.util
import itertools
import sys
import tracemalloc

import jax
import meshio
import numpy as np
import pytest
from mesh_samples import FOLDER, OF_MESHES, SAMPLES, box_mesh, exodus, plate_mesh, spheres

import pdjax as pd
from pdjax.files.formats.cells import measured
from pdjax.files.read import opened

NETCDF = pytest.mark.skipif(importlib.util.find_spec("netCDF4") is None, reason="needs netCDF4")
GMSH = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="needs gmsh")
BODIES = {"triangles": (2.0, [1, 0.5, 0]), "quadrilaterals": (2.0, [1, 0.5, 0])}
BODIES |= {"tetrahedra": (3.0, [1, 0.5, 0.75]), "hexahedra": (3.0, [1, 0.5, 0.75])}


def brute_force_set(path):
    """Cells with an edge (2D) or a face (3D) at x = 0, by meshio's reader and a loop over the nodes."""
    mesh = meshio.gmsh.read(path)
    dim = 3 if any(block.dim == 3 for block in mesh.cells) else 2
    at_left = np.abs(mesh.points[:, 0]) < 1e-12
    cells = [(block, k) for block in mesh.cells if block.dim == dim for k in range(len(block.data))]
    inside = [sum(at_left[block.data[k]]) >= (4 if "hexa" in block.type else dim) for block, k in cells]
    centroids = np.array(
        [mesh.points[block.data[k]][: 3 if "triangle" in block.type else None].mean(0) for block, k in cells]
    )
    return np.unique(centroids[inside], axis=0)  # meshio gives a cell twice if version 2 lists it in two groups


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.msh")))
def test_meshes_of_gmsh_have_the_volume_the_centroid_and_the_sets_of_the_body(name):
    contents = opened(FOLDER / name).at(0)
    volume, centroid = BODIES[name.split("_")[0]]
    assert contents.volumes.sum() == pytest.approx(volume, rel=1e-14)  # measured 4.4e-16
    assert contents.volumes @ contents.positions / volume == pytest.approx(np.array(centroid), abs=1e-14)  # 4e-16
    body = "plate" if volume == 2 else "solid"
    assert contents.sets[body].all()
    at_left = contents.positions[contents.sets["left"]]
    # These bodies have cells of parallel sides at x = 0, where the mean of the nodes is near the centroid.
    wanted = brute_force_set(FOLDER / name)
    assert len(at_left) == len(wanted)
    distances = np.linalg.norm(at_left[:, None] - wanted, axis=2).min(axis=1)
    assert distances.max() < (0.04 if "quadrilaterals" in name else 5e-15)  # 0.021 for distorted quadrilaterals, 3e-16
    if volume == 2:
        assert (contents.sets["plate"] == contents.sets["all of it"]).all() and contents.sets["right"].any()
    else:
        assert 0 < contents.sets["corner"].sum() < 10 and contents.sets["curve 3"].any()


def test_the_four_kinds_of_gmsh_files_hold_the_same_cells():
    for kind in BODIES:
        bodies = [opened(path).at(0) for path in sorted(FOLDER.glob(f"{kind}_[24]*"))]
        assert len(bodies) == 2
        sorts = [np.lexsort(np.round(body.positions.T, 9)) for body in bodies]
        first, second = (body.positions[order] for body, order in zip(bodies, sorts, strict=True))
        assert np.abs(first - second).max() < 1e-14  # measured 4e-16


def test_cells_of_second_order_are_read_by_their_corners():
    first = opened(FOLDER / "triangles_41_binary.msh").at(0)
    second = opened(FOLDER / "triangles_of_second_order_41_text.msh").at(0)
    assert np.abs(first.positions - second.positions).max() < 5e-15  # measured 2e-16
    assert np.abs(first.volumes / second.volumes - 1).max() < 1e-14  # measured 8e-16
    assert any("triangle6" in note for note in second.notes)


def trilinear(corners, signs, xi):
    return ((1 + signs * xi).prod(axis=1) / 2.0 ** signs.shape[1]) @ corners


@pytest.mark.parametrize("shape, dim", [("quadrilateral", 2), ("hexahedron", 3)])
def test_distorted_cells_have_the_volume_and_the_centroid_of_a_fine_quadrature(shape, dim):
    signs = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]], float)[:, :dim]
    signs = signs if dim == 2 else np.vstack([signs, signs * [1, 1, -1]])
    rng = np.random.default_rng(3)
    corners = np.zeros((5, len(signs), 3))
    corners[..., :dim] = signs + rng.uniform(-0.3, 0.3, (5, len(signs), dim))
    points, weights = np.polynomial.legendre.leggauss(6)
    found, gradient = measured(shape, corners), jax.jit(jax.jacfwd(trilinear, argnums=2))
    for cell, volume, share in zip(corners, found.volumes, found.weights, strict=True):
        total, moment = 0.0, np.zeros(dim)
        for which in itertools.product(range(6), repeat=dim):
            xi = points[list(which)]
            weight = weights[list(which)].prod() * np.linalg.det(gradient(cell[:, :dim], signs, xi))
            total, moment = total + weight, moment + weight * trilinear(cell[:, :dim], signs, xi)
        assert volume == pytest.approx(total, rel=3e-14)  # measured 1e-15
        assert share @ cell[:, :dim] == pytest.approx(moment / total, abs=5e-15)  # measured 2e-16


def test_areas_do_not_depend_on_the_plane_and_match_the_shoelace_formula():
    outlines = np.array(
        [[[0, 0, 0], [2, 0, 0], [2.5, 1, 0], [0, 1.5, 0]], [[0, 0, 0], [2, 0, 0], [0.5, 0.5, 0], [0, 2, 0]]]
    )
    x, y = outlines[..., 0], outlines[..., 1]
    area = np.abs((x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1)) / 2
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    for corners in (outlines, outlines @ turn.T + 7):
        assert np.abs(measured("quadrilateral", corners).volumes) == pytest.approx(area, rel=3e-14)  # measured 1e-15
        assert np.abs(measured("triangle", corners[:, :3]).volumes) == pytest.approx(
            np.abs(measured("triangle", outlines[:, :3]).volumes), rel=3e-14
        )  # measured 1e-15


def check_plate(contents, dim=3):
    """The plate of `plate_mesh`: two squares and two triangles."""
    third = 1 / 3
    centroids = np.array([[0.5, 0.5], [1.5, 0.5], [3 - third, third], [2 + third, 1 - third]])
    assert contents.positions.shape == (4, dim)
    assert np.abs(contents.positions[:, :2] - centroids).max() < 5e-15  # measured 4e-16
    assert np.abs(contents.volumes - [1, 1, 0.5, 0.5]).max() < 1e-15  # measured 0
    return centroids


@pytest.mark.parametrize("name", ["text.vtu", "plain.vtu", "lzma.vtu", "binary.vtk", "text.vtk", "text42.vtk"])
def test_vtk_files_of_meshio_hold_centroids_interpolated_fields_and_sets(name, tmp_path):
    contents = opened(SAMPLES[name](tmp_path)).at(0)
    x = check_plate(contents)
    assert np.abs(contents.fields["heat"] - (1 + 2 * x[:, 0])).max() < 1e-14  # measured 9e-16
    assert np.abs(contents.fields["shift"][:, :2] - x * [1, 2]).max() < 1e-14  # measured 4e-16
    assert contents.fields["strength"].tolist() == [1, 2, 3, 4]
    assert contents.sets["low"].tolist() == [True, True, True, False]  # the last has a single node at y = 0


def test_a_field_that_is_linear_in_the_position_keeps_its_values_in_distorted_cells(tmp_path):
    meshio.vtu.write(tmp_path / "box.vtu", box_mesh())
    contents = opened(tmp_path / "box.vtu").at(0)
    wanted = contents.positions @ [1.0, 2.0, 3.0]
    assert contents.fields["heat"] == pytest.approx(wanted, abs=2e-14)  # measured 1e-15
    assert len(contents.volumes) == 3 and contents.volumes[2] == pytest.approx(1 / 6, rel=1e-14)  # measured 0


def written(tmp_path, points, cells, **data):
    meshio.vtu.write(tmp_path / "x.vtu", meshio.Mesh(np.array(points, float), cells, **data))
    return tmp_path / "x.vtu"


def test_cells_of_other_types_are_refused_with_their_numbers(tmp_path):
    points = np.random.default_rng(0).random((6, 3))
    path = written(tmp_path, points, [("wedge", [[0, 1, 2, 3, 4, 5]]), ("pyramid", [[0, 1, 2, 3, 4]] * 2)])
    with pytest.raises(ValueError, match=r"x\.vtu: cells must be .*; got 2 pyramid, 1 wedge\. Divide"):
        opened(path).at(0)


def test_degenerate_cells_are_refused_and_inverted_cells_are_noted(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0]]
    with pytest.raises(ValueError, match=r"cell 1, a triangle with nodes \[0, 1, 4\] .* has 0. 1 cells are such"):
        opened(written(tmp_path, points, [("triangle", [[0, 1, 2], [0, 1, 4]])])).at(0)
    contents = opened(written(tmp_path, points, [("tetra", [[0, 2, 1, 3], [0, 1, 2, 3]])])).at(0)
    assert contents.volumes == pytest.approx(1 / 6, rel=1e-14)  # measured 0
    assert contents.notes[-1].startswith("1 of 2 cells are inverted")
    flat = opened(written(tmp_path, points, [("triangle", [[0, 2, 1], [1, 4, 2]])])).at(0)
    assert (flat.volumes == 0.5).all() and "clockwise" in flat.notes[-1]
    warped = opened(written(tmp_path, points, [("quad", [[0, 1, 3, 2]])])).at(0)
    assert "not plane" in warped.notes[-1]


def test_lines_are_a_body_of_dimension_one(tmp_path):
    contents = opened(written(tmp_path, [[0, 0, 0], [1, 0, 0], [3, 0, 0]], [("line", [[0, 1], [1, 2]])])).at(0)
    assert contents.positions[:, 0].tolist() == [0.5, 2.0] and contents.volumes.tolist() == [1.0, 2.0]


def test_contents_tell_the_dimension_of_the_cells(tmp_path):
    for kind, (_, centroid) in BODIES.items():
        for path in FOLDER.glob(f"{kind}_[24]*"):
            assert opened(path).at(0).dim == (3 if centroid[2] else 2)
    assert opened(SAMPLES["points.vtu"](tmp_path)).at(0).dim is None
    box = box_mesh()  # one layer of hexahedra is 3D, also where all centroids have the same z
    layer = meshio.Mesh(box.points * [1, 1, 1], box.cells[:1])
    layer.points[7] = [1, 0, 1]
    meshio.vtu.write(tmp_path / "layer.vtu", layer)
    contents = opened(tmp_path / "layer.vtu").at(0)
    assert contents.dim == 3 and np.ptp(contents.positions[:, 2]) == 0
    body, _ = pd.read_points(tmp_path / "layer.vtu")
    assert body.dim == 3 and body.volumes.tolist() == [1, 1]
    tilted = plate_mesh()
    tilted.points = tilted.points @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    meshio.vtu.write(tmp_path / "tilted.vtu", tilted)
    with pytest.raises(ValueError, match="dim must be at least 3"):  # areas are no volumes of a body in 3D
        pd.read_points(tmp_path / "tilted.vtu")


def test_a_file_without_cells_or_with_vertices_is_a_cloud(tmp_path):
    points, size = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], {"Volume": np.array([1.0, 2.0, 3.0])}
    order = [("vertex", [[2], [0], [1]])]
    data = {"cell_data": {"c": [np.array([2.0, 0.0, 1.0])]}, "point_data": size}
    for cells, more in (([], {"point_data": size}), (order, data), ([("vertex", [[1]])], {"point_data": size})):
        contents = opened(written(tmp_path, points, cells, **more)).at(0)
        assert contents.volumes.tolist() == ([2.0] if len(contents.positions) == 1 else [1.0, 2.0, 3.0])
        assert "Volume" not in contents.fields
    contents = opened(written(tmp_path, points, order, **data)).at(0)
    assert contents.fields["c"].tolist() == [0.0, 1.0, 2.0]


def test_mixed_cells_keep_the_order_of_the_file(tmp_path):
    points = [[x, y, 0] for x in range(6) for y in (0, 1)]
    cells = [("quad", [[0, 2, 3, 1]]), ("triangle", [[2, 4, 5]]), ("quad", [[6, 8, 9, 7]]), ("triangle", [[8, 10, 11]])]
    contents = opened(written(tmp_path, points, cells, cell_data={"k": [np.array([k]) for k in range(4)]})).at(0)
    assert contents.fields["k"].tolist() == [0, 1, 2, 3] and (np.diff(contents.positions[:, 0]) > 0).all()
    assert contents.where(2) == "cell 2"


def test_views_of_gmsh_are_fields_at_several_times(tmp_path):
    mesh = plate_mesh()
    del mesh.point_data["set:low"]
    path = tmp_path / "x.msh"
    meshio.gmsh.write(path, mesh, fmt_version="2.2", binary=True)
    contents = opened(path).at(0)
    x = check_plate(contents)
    assert np.abs(contents.fields["heat"] - (1 + 2 * x[:, 0])).max() < 1e-14  # measured 9e-16
    assert contents.fields["strength"].tolist() == [1, 2, 3, 4] and contents.fields["shift"].shape == (4, 3)
    mesh.point_data, mesh.cell_data = {}, {}  # with NumPy 2, meshio writes "np.float64(1.0)" into views of text files
    meshio.gmsh.write(path, mesh, fmt_version="2.2", binary=False)
    text = path.read_text()
    view = (
        '$NodeData\n1\n"speed"\n1\n{t}\n3\n0\n1\n8\n' + "".join(f"{k} {{t}}\n" for k in range(1, 9)) + "$EndNodeData\n"
    )
    path.write_text(text + view.format(t=0.5) + view.format(t=1.5))
    states = opened(path)
    assert states.times == (0.5, 1.5)
    for step, speed in enumerate((0.5, 1.5)):
        assert np.abs(states.at(step).fields["speed"] - speed).max() < 1e-15  # measured 0


def test_gmsh_files_name_elements_by_their_tags_and_refuse_unknown_nodes(tmp_path):
    text = (FOLDER / "triangles_22_text.msh").read_text()
    assert "cell " in opened(FOLDER / "triangles_22_text.msh").at(0).where(0)
    path = tmp_path / "x.msh"
    for old, new, words in (
        ("2.2 0 8", "3.0 0 8", "must have version 2.2 or 4.1; got 3.0"),
        ("$EndElements", "", r"section \$Elements must end with"),
        ("\n1 0 0 0\n", "\n1001 0 0 0\n", "node 1 is used, but the file does not define it"),
        ("\n1 0 0 0\n", "\n2 0 0 0\n", "node 2 is defined twice"),
        ("$Nodes\n", "$Nodes\n9", "numbers are announced"),
    ):
        assert old in text
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(ValueError, match=words):
            opened(path).at(0)


def test_abaqus_files_of_gmsh_and_of_abaqus_hold_the_sets(tmp_path):
    contents = opened(FOLDER / "quadrilaterals.inp").at(0)
    assert contents.volumes.sum() == pytest.approx(2, rel=1e-14) and contents.sets["Surface1"].all()
    other = opened(FOLDER / "quadrilaterals_41_text.msh").at(0)
    apart = np.sort(contents.positions, axis=0) - np.sort(other.positions, axis=0)
    assert np.abs(apart).max() < 2e-13  # measured 1e-14, from the digits of the text; the sum above: 0
    assert contents.sets["left"].sum() == other.sets["left"].sum() == 2
    contents = opened(FOLDER / "assembly.inp").at(0)
    assert contents.positions.tolist() == [[0.5, 0.5], [1.5, 0.5]] and contents.volumes.tolist() == [1.0, 1.0]
    assert {name: mask.tolist() for name, mask in contents.sets.items()} == {
        "Set-1": [True, True],
        "Left": [True, False],
        "Second": [False, True],
    }


@pytest.mark.parametrize(
    "line, words",
    [
        ("*INCLUDE, INPUT=/etc/passwd", r"line \d+: \*INCLUDE is not read"),
        ("*Element, type=SPRINGA\n9, 1, 2", "must be of a continuum, shell or truss type; got SPRINGA"),
        ("*Element, type=CPS4\n9, 1, 2", "must have a number and 4 nodes each; got 3 numbers"),
        ("*Element, type=CPS4\n9, 1, 2, 3, 77", "node 77 is used, but the file does not define it"),
        ("*Element, type=CPS4\n1, 1, 2, 5, 4", "element 1 is defined twice"),
        ("*Elset, elset=A\nB", "a set must name earlier sets or numbers; got 'B'"),
        ("*Instance, name=I2\n1., 0., 0.", "must not be moved"),
    ],
)
def test_wrong_abaqus_files_are_refused_with_the_line(tmp_path, line, words):
    path = tmp_path / "x.inp"
    path.write_text((FOLDER / "assembly.inp").read_text() + line + "\n")
    with pytest.raises(ValueError, match=words):
        opened(path).at(0)


def test_sets_of_sets_take_no_more_memory_than_their_masks(tmp_path):
    lines = ["*Elset, elset=S0", "1, 2"]
    for k in range(60):  # written out, the last set would have 2^61 entries
        lines += [f"*Elset, elset=S{k + 1}", f"S{k}, S{k}"]
    path = tmp_path / "x.inp"
    path.write_text((FOLDER / "assembly.inp").read_text() + "\n".join(lines))
    assert opened(path).at(0).sets["S60"].all()


def test_exodus_files_hold_blocks_sets_and_all_time_steps(tmp_path):
    states = opened(exodus(tmp_path / "plate.exo"))
    assert states.times == (0.0, 0.5, 1.0)
    for step in range(3):
        contents = states.at(step)
        x = check_plate(contents, dim=2)
        assert np.abs(contents.fields["DISPL"] - 0.1 * step * x[:, :1] * [1, 2]).max() < 3e-15  # measured 2e-16
    assert contents.fields["damage"][:2].tolist() == [0.3, 0.4] and np.isnan(contents.fields["damage"][2:]).all()
    assert {name: np.flatnonzero(mask).tolist() for name, mask in contents.sets.items()} == {
        "steel": [0, 1],
        "block 20": [2, 3],
        "side set 7": [2],
        "left": [0],
    }
    assert any("block 2" in note for note in contents.notes)


def test_exodus_files_of_spheres_are_points_with_their_volumes(tmp_path):
    points = opened(spheres(tmp_path / "spheres.exo")).at(0)
    assert points.volumes.tolist() == [1.0, 2.0, 3.0] and points.positions[:, 0].tolist() == [0.0, 1.0, 2.0]


def test_without_netcdf4_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "netCDF4", None)
    (tmp_path / "x.exo").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(ImportError, match=r'x\.exo is in HDF5, which needs netCDF4: pip install "pdjax\[meshes\]"'):
        opened(tmp_path / "x.exo")


@NETCDF
def test_exodus_files_in_hdf5_are_read(tmp_path):
    mesh = box_mesh()
    mesh.cells = mesh.cells[:1]
    mesh.points, mesh.point_data = mesh.points[:12], {"heat": mesh.point_data["heat"][:12]}
    meshio.exodus.write(tmp_path / "box.e", mesh)
    contents = opened(tmp_path / "box.e").at(0)
    assert contents.fields["heat"] == pytest.approx(contents.positions @ [1.0, 2.0, 3.0], abs=1e-14)


@pytest.mark.parametrize("head", ["<!DOCTYPE x [<!ENTITY a 'b'>]>", "<!doctype x>"])
def test_xml_with_a_document_type_is_refused(tmp_path, head):
    path = SAMPLES["points.vtu"](tmp_path)
    start, _, rest = path.read_text().partition("\n")
    path.write_text(start + "\n" + head + rest)
    with pytest.raises(ValueError, match=r"points\.vtu: .* no document type and no entities"):
        opened(path).at(0)
    path.write_bytes((start + head + rest).encode("utf-16"))
    with pytest.raises(ValueError, match="must be UTF-8"):
        opened(path).at(0)


def test_many_arrays_that_refer_to_the_same_data_are_refused(tmp_path):
    path = written(tmp_path, np.zeros((10**5, 3)), [])
    body = path.read_text()
    array = body[body.index("<DataArray") : body.index("</DataArray>") + 12]  # 2.4 MB of zeros in 3 kB
    path.write_text(body.replace("</Piece>", "<PointData>" + array * 2 + "</PointData></Piece>"))
    assert len(opened(path).at(0).positions) == 10**5
    data = array.split(">")[1].split("<")[0].strip()
    again = '<DataArray type="Float64" Name="a" NumberOfComponents="3" format="appended" offset="0"/>'
    tail = f'</UnstructuredGrid><AppendedData encoding="base64">_{data}</AppendedData>'
    body = body.replace("</Piece>", "<PointData>" + again * 300 + "</PointData></Piece>")
    path.write_text(body.replace("</UnstructuredGrid>", tail))
    with pytest.raises(ValueError, match=r"x\.vtu: all arrays together announce more than 1100 times"):
        opened(path).at(0)


HUGE = [
    ("triangles_22_text.msh", b"$Nodes\n", b"$Nodes\n999999999"),
    ("triangles_41_binary.msh", b"$Nodes\n", b"$Nodes\n" + b"\xff\xff\xff\xff\xff\xff\xff\x7f"),
    ("points.vtu", b'NumberOfPoints="7"', b'NumberOfPoints="99999999999"'),
    ("text.vtu", b'NumberOfCells="', b'NumberOfCells="9999999999'),
    ("binary.vtk", b"POINTS ", b"POINTS 99999999999"),
    ("text42.vtk", b"CELLS ", b"CELLS 99999999999"),
]


@pytest.mark.parametrize("name, old, new", HUGE, ids=[name for name, _, _ in HUGE])
def test_announced_sizes_that_the_file_cannot_hold_take_no_memory(name, old, new, tmp_path):
    path = SAMPLES[name](tmp_path)
    body = path.read_bytes()
    assert old in body
    path.write_bytes(body.replace(old, new, 1))
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=name):
            opened(path).at(0)
        assert tracemalloc.get_traced_memory()[1] < 3e6  # bytes; measured at most 4e5
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", sorted(SAMPLES))
def test_files_that_are_cut_off_or_changed_raise_value_errors_that_name_them(name, tmp_path):
    path = SAMPLES[name](tmp_path)
    body, rng = path.read_bytes(), np.random.default_rng(1)
    refused = 0
    for cut in np.linspace(0, len(body) - 1, 15).astype(int).tolist():
        changed = bytearray(body)
        changed[cut] ^= 1 << int(rng.integers(8))
        for damaged in (body[:cut], bytes(changed)):
            path.write_bytes(damaged)
            try:
                opened(path).at(0)
            except (ValueError, OSError) as error:
                refused += 1
                assert (
                    isinstance(error, OSError)
                    or path.name in str(error)
                    or "points-0000" in str(error)
                    or "step" in str(error)
                )
    assert refused > 5  # measured: 11 of 30 at least


@GMSH
def test_a_plate_with_a_hole_made_by_gmsh_has_its_area(tmp_path):
    import gmsh

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        shape = gmsh.model.occ
        plate = shape.cut([(2, shape.addRectangle(0, 0, 0, 1, 1))], [(2, shape.addDisk(0.5, 0.5, 0, 0.1, 0.1))])[0]
        shape.synchronize()
        gmsh.model.addPhysicalGroup(2, [plate[0][1]], name="plate")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.03)
        gmsh.model.mesh.generate(2)
        for version, binary in itertools.product((2.2, 4.1), (0, 1)):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(tmp_path / "x.msh"))
            nodes = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
            edges = np.isclose(np.hypot(*(nodes[:, :2] - 0.5).T), 0.1).sum()  # the hole is a regular polygon
            area = 1 - edges / 2 * 0.01 * np.sin(2 * np.pi / edges)
            assert opened(tmp_path / "x.msh").at(0).volumes.sum() == pytest.approx(area, rel=1e-14)  # 1e-16
    finally:
        gmsh.finalize()


def test_samples_are_small_and_hold_bodies():
    for path in OF_MESHES:
        assert path.stat().st_size < 20_000 and (opened(path).at(0).volumes > 0).all()
