"""Data files and dumps of LAMMPS. The samples have the form that LAMMPS of July 2025 writes."""

import numpy as np
import pytest

import pdjax as pd

DATA = """\
LAMMPS data file via write_data, version 22 Jul 2025, timestep = 0, units = si

4 atoms
2 atom types

-0.0020004 0.0020004 xlo xhi
-1.0000000000000001e-07 0.0010001 ylo yhi
-0.0020004 0.0020004 zlo zhi

Masses

1 1
2 1

Atoms # peri

4 1 1.25e-10 2200 0 0 -0.002 0 0 0
2 1 1.25e-10 2200 0 0.0005 -0.002 0 0 0
3 2 1.25e-10 2200 0.0005 0 -0.002 0 0 0
1 1 1.25e-10 2200 0.0005 0.0005 -0.002 0 0 0

Velocities

1 0.1 0 0
2 0.2 0 0
3 0.3 0 0
4 0.4 0 0
"""
FRAME = """\
ITEM: UNITS
si
ITEM: TIME
{time}
ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
3
ITEM: BOX BOUNDS {box}
0.0 4.0
0.0 4.0
0.0 1.0
ITEM: ATOMS id type {names}
{rows}
"""


def data_file(folder, text=DATA, name="a.data", **arguments):
    (folder / name).write_text(text)
    return pd.read_points(folder / name, **arguments)


def frame(step, rows, names="x y z vx vy vz fx fy fz c_vol", box="pp pp ss", timed=True):
    text = FRAME.format(time=0.5 * step, step=step, box=box, names=names, rows="\n".join(rows))
    return text if timed else text[text.index("ITEM: TIMESTEP") :]


FIRST = ["2 1 1.5 0.5 0.5 2 0 0 0 2 0 1", "3 2 2.5 1.0 0.5 3 0 0 0 3 0 1", "1 1 0.5 0.5 0.5 1 0 0 0 1 0 1"]
LATER = ["1 1 3.75 0.5 0.5 1 0 0 0 1 0 1", "3 2 2.75 1.0 0.5 3 0 0 0 3 0 1", "2 1 1.5 0.75 0.5 2 0 0 0 2 0 1"]


def test_a_data_file_of_style_peri_keeps_its_order(tmp_path):
    body, data = data_file(tmp_path)
    assert body.dim == 2 and (body.volumes == 1.25e-10).all() and body.positions[1].tolist() == [0.0, 0.0005]
    assert data.fields["id"].tolist() == [4, 2, 3, 1] and (data.fields["density"] == 2200).all()
    assert data.vector("velocity", 2)[:, 0].tolist() == [0.4, 0.2, 0.3, 0.1]
    assert data.sets["type 1"].tolist() == [True, True, False, True] and data.sets["type 2"].sum() == 1
    assert data.notes[0].startswith("z is the same")
    assert 'volume="lattice" makes it a lattice' in data.notes[1]
    lattice, _ = data_file(tmp_path, volume="lattice")
    assert lattice.shape == (2, 2) and lattice.spacing == 0.0005


def test_a_data_file_without_volumes_needs_them(tmp_path):
    text = DATA.replace("# peri", "# atomic").replace(" 1.25e-10 2200", "")
    with pytest.raises(ValueError, match="has no volumes; pass volume="):
        data_file(tmp_path, text)
    assert data_file(tmp_path, text, volume="lattice", dim=2)[0].uniform
    bare = text.replace("Atoms # atomic", "Atoms").replace(" 0 0 0\n", "\n")
    _, data = data_file(tmp_path, bare, volume=1e-10)
    assert data.notes[0] == "The section Atoms has no style and is taken as style atomic: id type x y z."


def test_image_flags_move_positions_out_of_the_box(tmp_path):
    text = DATA.replace("0 0 -0.002 0 0 0", "0 0 -0.002 1 0 0")
    body, data = data_file(tmp_path, text, dim=2)
    assert body.positions[0].tolist() == pytest.approx([0.0040008, 0.0], abs=1e-15)  # measured 0
    assert data.notes[0].startswith("Positions are moved out of the periodic box")


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("4 atoms", "1000000000000 atoms", "announces 1000000000000 lines of 10 numbers, but has only"),
        ("4 atoms", "5 atoms", "line 22: expected 10 numbers .*; got 1 columns: 'Velocities'"),
        ("4 atoms", "four atoms", 'expected a line "N atoms"'),
        ("Atoms # peri", "Atom # peri", "and a section Atoms; got the sections Masses, Atom, Velocities"),
        ("# peri", "# ellipsoid", "the atom style must be one of peri, atomic, .*; got 'ellipsoid'"),
        ("3 2 1.25e-10", "3 2 0", "line 19: expected a volume that is finite and > 0; got 0.0"),
        ("3 2 1.25e-10", "3 2 steel", "line 19: expected 10 numbers .*; got 'steel' for volume"),
        ("3 2 1.25e-10 2200 0.0005", "3 2 1.25e-10 2200 nan", "line 19: expected finite coordinates"),
        ("2 1 1.25e-10 2200 0 0.0005", "2 1 1.25e-10 2200 0 0", "line 17 and line 18 have the same position"),
        ("3 2 1.25e-10", "4 2 1.25e-10", "ids of the section Atoms must be whole numbers that differ"),
        ("3 0.3", "5 0.3", "Velocities has other ids than the section Atoms"),
    ],
)
def test_a_bad_data_file_is_refused(tmp_path, old, new, words):
    assert DATA.count(old) == 1 or old == "# peri"
    with pytest.raises(ValueError, match=words):
        data_file(tmp_path, DATA.replace(old, new))


def test_a_truncated_data_file_is_refused(tmp_path):
    for cut in range(0, len(DATA), 37):
        with pytest.raises(ValueError):
            data_file(tmp_path, DATA[: cut or 1])


@pytest.mark.parametrize("timed", [True, False])
def test_a_dump_has_sorted_points_displacements_and_named_vectors(tmp_path, timed):
    text = frame(0, FIRST, timed=timed) + frame(10, LATER, timed=timed)
    body, data = data_file(tmp_path, text, "a.dump")
    assert body.positions.tolist() == [[0.5, 0.5], [1.5, 0.5], [2.5, 1.0]] and (body.volumes == 1).all()
    assert data.times == ((0.0, 5.0) if timed else (0.0, 10.0)) and data.step == 1 and data.time == data.times[1]
    moved = [[-0.75, 0, 0], [0, 0.25, 0], [0.25, 0, 0]]  # the first point crosses the periodic box
    assert data.fields["displacement"].tolist() == moved
    assert data.fields["velocity"][:, 0].tolist() == [1, 2, 3] and data.fields["force"][:, 1].tolist() == [1, 2, 3]
    assert data.fields["id"].tolist() == [1, 2, 3] and data.sets["type 2"].tolist() == [False, False, True]
    assert any("less than half of its length" in note for note in data.notes)
    assert any("reference positions are those of the first" in note for note in data.notes)
    assert [s.step for s in data.states()] == [0, 1]
    assert not next(data.states()).fields["displacement"].any()
    assert pd.read_points(tmp_path / "a.dump", step=0)[1].step == 0
    with pytest.raises(ValueError, match=r"step must be from -2 to 1; a.dump has 2 states, at the times 0, "):
        pd.read_points(tmp_path / "a.dump", step=2)


KINDS = {  # columns, boundaries, and the rows of three points, of which the first moves
    "xu": ("xu yu zu vol", "pp pp pp", ["1 1 {0} 0.5 0.5 1", "2 1 1 1 0.5 1", "3 1 2 0 0.5 1"]),
    "images": (
        "x y z ix iy iz vol",
        "pp pp pp",
        ["1 1 {1} 0.5 0.5 {2} 0 0 1", "2 1 1 1 .5 0 0 0 1", "3 1 2 0 .5 0 0 0 1"],
    ),
    "scaled": (
        "xs ys zs ix iy iz vol",
        "pp pp pp",
        ["1 1 {3} .125 .5 {2} 0 0 1", "2 1 .25 .25 .5 0 0 0 1", "3 1 .5 0 .5 0 0 0 1"],
    ),
    "scaled and unwrapped": (
        "xsu ysu zsu vol",
        "pp pp pp",
        ["1 1 {4} .125 .5 1", "2 1 .25 .25 .5 1", "3 1 .5 0 .5 1"],
    ),
    "open": ("x y z vol", "ss ss ss", ["1 1 {0} 0.5 0.5 1", "2 1 1 1 0.5 1", "3 1 2 0 0.5 1"]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_coordinates_of_every_kind_give_the_displacement(tmp_path, kind):
    names, box, rows = KINDS[kind]
    text = ""
    for step, x in ((0, 0.5), (1, 7.0)):  # more than half of the box of length 4
        numbers = (x, x % 4.0, int(x // 4.0), (x % 4.0) / 4.0, x / 4.0)
        text += frame(step, [row.format(*numbers) for row in rows], names, box)
    body, data = data_file(tmp_path, text, "a.lammpstrj")
    assert body.positions.tolist() == [[0.5, 0.5], [1, 1], [2, 0]]
    assert data.fields["displacement"].tolist() == [[6.5, 0, 0], [0, 0, 0], [0, 0, 0]]
    assert data.fields.keys() == {"id", "displacement"}


def test_displacements_in_a_tilted_box_are_the_shortest(tmp_path):
    def tilted(step, rows):
        text = frame(step, rows, "x y z vol", "xy xz yz pp pp pp")
        return text.replace("0.0 4.0\n0.0 4.0\n0.0 1.0", "0.0 5.0 1.0\n0.0 4.0 0.0\n0.0 1.0 0.0")

    rows = ["1 1 0.5 0.25 0.5 1", "2 1 1 1 0.5 1", "3 1 2 3 0.5 1"]
    later = ["1 1 1.5 4.0 0.5 1", "2 1 1 1 0.5 1", "3 1 2 3 0.5 1"]  # by the second edge (1, 4, 0) and (0, -0.25, 0)
    _, data = data_file(tmp_path, tilted(0, rows) + tilted(1, later), "a.dump")
    assert np.abs(data.fields["displacement"] - [[0, -0.25, 0], [0, 0, 0], [0, 0, 0]]).max() < 1e-15  # measured 0


def test_element_names_and_missing_ids_are_told(tmp_path):
    text = frame(0, ["Fe 1 0.5 0.5 1", "Fe 1 1.5 0.7 1", "C 2 0.9 2.5 1"], "x y vol").replace("id type", "element type")
    body, data = data_file(tmp_path, text, "a.dump")
    assert body.dim == 2 and data.notes[0] == "Columns that hold words are left out: element."
    assert any("There is no column id" in note for note in data.notes)


def test_an_incomplete_last_frame_is_an_error_and_earlier_frames_are_read(tmp_path):
    whole = frame(0, FIRST) + frame(10, LATER)
    tail = whole[: whole.rindex("2 1 1.5")]
    for text in (tail, tail[:-20], whole[: whole.rindex("ITEM: ATOMS")], whole[: whole.rindex("ITEM: BOX") + 30]):
        with pytest.raises(ValueError, match=r"frame 1"):
            data_file(tmp_path, text, "a.dump")
        body, data = pd.read_points(tmp_path / "a.dump", step=0)
        assert len(body) == 3 and len(data.times) == 2
    with pytest.raises(ValueError, match=r"incomplete.*earlier frames can be read with step= up to 0"):
        data_file(tmp_path, tail, "a.dump")


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("ATOMS\n3", "ATOMS\n1000000000000", "frame 0 .*announces 1000000000000 lines of 12 numbers"),
        ("ATOMS\n3", "ATOMS\n-3", "frame 0: expected a number > 0"),
        ("3 2 2.5", "3 2 abc", "frame 0 .*line 15: expected 12 numbers .*; got 'abc' for x"),
        ("3 2 2.5", "3 2 nan", "frame 0, line 15: expected finite coordinates"),
        ("3 2 2.5 1.0 0.5 3 0 0 0 3 0 1", "3 2 2.5 1.0 0.5 3 0 0 0 3 0 0", "frame 0, line 15: expected a volume"),
        ("3 2 2.5", "2 2 2.5", "the ids must be whole numbers that differ"),
        ("x y z", "a b c", "expected columns x y z"),
        ("id type x y z", "id type x y x", "names of the columns must differ"),
        ("0.0 1.0", "0.0", 'below "ITEM: BOX BOUNDS"'),
        ("ITEM: TIMESTEP", "ITEM: STEP", "is no text dump of LAMMPS"),
        ("ITEM: ATOMS", "ATOMS", 'frame 0: expected a line "ITEM: ATOMS"'),
    ],
)
def test_a_bad_dump_is_refused(tmp_path, old, new, words):
    text = frame(0, FIRST)
    assert text.count(old) == 1
    with pytest.raises(ValueError, match=words):
        data_file(tmp_path, text.replace(old, new), "a.dump")


def test_other_atoms_in_a_later_frame_are_refused(tmp_path):
    text = frame(0, FIRST) + frame(10, [row.replace("3 2", "7 2") for row in LATER])
    with pytest.raises(ValueError, match="expected the same atoms in all frames"):
        data_file(tmp_path, text, "a.dump")


def test_a_later_state_that_is_not_finite_is_read(tmp_path):
    text = frame(0, FIRST) + frame(10, [row.replace("3.75", "nan") for row in LATER])
    _, data = data_file(tmp_path, text, "a.dump")
    assert np.isnan(data.fields["displacement"][0, 0])
