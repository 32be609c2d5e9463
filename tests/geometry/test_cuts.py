"""Cut bonds agree with independent geometry at planes, segments and polygons, and invalid surfaces are refused."""

import numpy as np
import pytest

import pdjax as pd

PLATE = pd.lattice((8, 6))  # points at ½, 1½, …
FAMS = pd.families(PLATE, 2.3)


def broken(fams, cut):
    """The pairs (i, j) whose bond was cut."""
    i, slot = np.nonzero(np.asarray(fams.weight) > np.asarray(cut.weight))
    return set(zip(i.tolist(), np.asarray(fams.neighbours)[i, slot].tolist(), strict=True))


def crossing(body, fams, p, q):
    """The pairs whose bond crosses the segment from p to q, found from the orientations of triangles."""

    def side(a, b, c):
        return np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    X, found = body.positions, set()
    for i, row in enumerate(np.asarray(fams.neighbours)):
        for j in row[: int(fams.count[i])].tolist():
            if side(p, q, X[i]) != side(p, q, X[j]) and side(X[i], X[j], p) != side(X[i], X[j], q):
                found.add((i, j))
    return found


@pytest.mark.parametrize(
    "p, q", [((-1, 3), (4.1, 3)), ((2.1, -1), (2.1, 9)), ((1.2, 1.3), (5.3, 4.65)), ((3, 3), (3.1, 3))]
)
def test_a_segment_cuts_the_bonds_that_cross_it(p, q):
    p, q = np.asarray(p, float), np.asarray(q, float)
    cut = pd.cut(FAMS, pd.Segment(p, q))
    expected = crossing(PLATE, FAMS, p, q)
    assert broken(FAMS, cut) == expected and expected
    assert {(j, i) for i, j in expected} == expected  # in the families of both ends


def test_a_plane_separates_a_body_into_two_parts():
    X = PLATE.positions
    cut = pd.cut(FAMS, pd.Plane((3.37, 0.0), (1.0, 0.4)))
    side = (X - [3.37, 0.0]) @ [1.0, 0.4] > 0
    assert broken(FAMS, cut) == {
        (i, j)
        for i, row in enumerate(np.asarray(FAMS.neighbours))
        for j in row[: int(FAMS.count[i])].tolist()
        if side[i] != side[j]
    }


def test_a_polygon_cuts_the_same_bonds_as_its_two_triangles():
    body = pd.lattice((5, 5, 5))
    fams = pd.families(body, 1.8)
    a, b, c, d = (1.1, 0.9, 2.0), (4.2, 1.2, 2.0), (3.9, 4.1, 2.0), (0.8, 3.7, 2.0)
    whole = broken(fams, pd.cut(fams, pd.Polygon([a, b, c, d])))
    assert whole == broken(fams, pd.cut(fams, pd.Polygon([a, b, c]))) | broken(
        fams, pd.cut(fams, pd.Polygon([a, c, d]))
    )
    assert 0 < len(whole) < len(broken(fams, pd.cut(fams, pd.Plane((0, 0, 2.0), (0, 0, 1)))))


def test_a_plane_does_not_cut_bonds_across_a_periodic_face():
    body = pd.lattice((8,), periodic=True)
    fams = pd.families(body, 1.0)
    assert broken(fams, pd.cut(fams, pd.Plane((4.0,), (1.0,)))) == {(3, 4), (4, 3)}


def test_cuts_accumulate_and_padding_keeps_zero_weight():
    first = pd.cut(FAMS, pd.Segment((-1, 3), (4.1, 3)))
    both = pd.cut(first, pd.Segment((4.1, 3), (9, 3)))
    assert broken(FAMS, both) == broken(FAMS, pd.cut(FAMS, pd.Plane((0, 3), (0, 1))))
    assert not np.asarray(both.weight)[~np.asarray(FAMS.is_bond)].any()


@pytest.mark.parametrize(
    "surface, words",
    [
        (pd.Segment((0, 2.5), (8, 2.5)), "passes through 8 points, the first is point 2"),
        (pd.Segment((20, 3), (30, 3)), "no bond crosses"),
        (pd.Segment((1, 1), (1, 1)), "no extent"),
        (pd.Plane((1.0, 1.0), (0.0, 0.0)), "no extent or no direction"),
        (pd.Plane((1.0, 1.0, 0), (0.0, 0.0, 1.0)), "dim 2"),
        (pd.Polygon([(0, 0, 0), (1, 0, 0), (0, 1, 0)]), "Polygon cuts bodies of dim"),
        (pd.Segment((0, np.nan), (1, 1)), "must be finite"),
        ([(0, 0), (1, 1)], "Plane or Segment or Polygon"),
    ],
)
def test_an_invalid_surface_raises_value_error(surface, words):
    with pytest.raises(ValueError, match=words):
        pd.cut(FAMS, surface)


def test_a_polygon_must_be_flat_and_convex():
    fams = pd.families(pd.lattice((3, 3, 3)), 1.0)
    for bent in ([(0, 0, 1), (3, 0, 1), (3, 3, 1.5), (0, 3, 1)], [(0, 0, 1), (3, 0, 1), (1, 1, 1), (0, 3, 1)]):
        with pytest.raises(ValueError, match="flat and convex"):
            pd.cut(fams, pd.Polygon(bent))


@pytest.mark.parametrize("n", [30, 70, 150])
def test_bonds_through_the_end_of_a_notch_are_cut_on_both_sides(n):
    """Mirrored bonds pass exactly through an end on a multiple of the spacing. Rounding must not tell them apart."""
    h = 0.1 / n
    body = pd.lattice((n, 20), h)
    families = pd.families(body, 3.015 * h)
    cracked = pd.cut(families, pd.Segment((0.0, 10 * h), (0.05, 10 * h)))
    gone = (np.asarray(cracked.weight) < np.asarray(families.weight)).sum(axis=1).reshape(n, 20)
    assert np.array_equal(gone, gone[:, ::-1]) and gone.any()
    # A bond (2, 2) from a point one spacing before and below the end touches it. Cut bonds reach that far.
    longer = pd.cut(families, pd.Segment((0.0, 10 * h), (0.05 + 1e-3 * h, 10 * h)))
    assert np.array_equal(cracked.weight, longer.weight)
