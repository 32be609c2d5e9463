"""NumPy archives, files that write_points writes, and archives that announce more than they hold."""

import struct
import warnings
import zipfile

import numpy as np
import pytest

import pdjax as pd

BODY = pd.lattice((5, 3), 0.1)
RNG = np.random.default_rng(0)
FIELDS = {"u": RNG.normal(size=(15, 2)), "F": RNG.normal(size=(15, 2, 2)), "heat": RNG.normal(size=15)}
SETS = {"left end": BODY.positions[:, 0] < 0.1, "block 1": BODY.positions[:, 1] > 0.1}


@pytest.mark.parametrize("suffix", [".txt", ".dat", ".csv", ".npz"])
@pytest.mark.parametrize("kind", ["lattice", "cloud", "bar", "moved"])
def test_what_is_written_is_read_again_to_the_last_digit(tmp_path, kind, suffix):
    cloud = pd.cloud(RNG.normal(size=(15, 3)), RNG.random(15) + 0.1)
    moved = pd.cloud(BODY.positions[::-1] - 1.0, BODY.volumes)
    body = {"lattice": BODY, "cloud": cloud, "bar": pd.bar(15, 2.0), "moved": moved}[kind]
    fields = {"u": RNG.normal(size=(15, body.dim)), "n": np.arange(15)} | {k: FIELDS[k] for k in ("F", "heat")}
    file = pd.write_points(tmp_path / f"body{suffix}", body, fields, SETS)
    assert [f.name for f in tmp_path.iterdir()] == [file.name]
    again, data = pd.read_points(file)
    assert np.array_equal(again.positions, body.positions) and np.array_equal(again.volumes, body.volumes)
    assert again.uniform == (kind != "cloud") and again.shape == body.shape
    assert data.fields.keys() == fields.keys() and data.sets.keys() == SETS.keys()
    for name in fields:
        assert np.array_equal(data.fields[name], fields[name])
    for name in SETS:
        assert np.array_equal(data.sets[name], SETS[name])


def test_archives_of_numpy_with_other_names_and_dtypes_are_read(tmp_path):
    file = tmp_path / "a.npz"
    x = np.asfortranarray(RNG.random((6, 2))).astype(">f4")
    np.savez(file, points=x, volume=np.float32(0.5), spins=np.ones((6, 2), complex), title="words", table=np.ones(7))
    body, data = pd.read_points(file)
    assert np.array_equal(body.positions, x) and (body.volumes == 0.5).all()
    assert data.fields["spins"].dtype == complex
    assert data.notes == ("Left out: title, table; these are no numbers for each of the 6 points.",)
    np.savez(file, positions=np.arange(5.0), volumes=np.ones(5))
    assert pd.read_points(file)[0].shape == (5,)
    np.savez_compressed(file, positions=x)
    with pytest.raises(ValueError, match="has no volumes"):
        pd.read_points(file)


def test_archives_of_something_else_are_refused(tmp_path):
    law = pd.LinearElastic(1.0, 1.0)
    grid = pd.stability_map([0.0, 1.0], [-0.02, 0.02], N=2, dim=1, law=law, show_progress=False)
    with pytest.raises(ValueError, match=r"holds no array named positions; got the arrays .*margin.*write_points"):
        pd.read_points(grid.save(tmp_path / "map.npz"))
    file = tmp_path / "a.npz"
    np.savez(file, positions=np.ones((4, 5)), volumes=np.ones(4))
    with pytest.raises(ValueError, match="positions must be numbers of shape"):
        pd.read_points(file)
    np.savez(file, positions=np.ones((4, 2)), volumes=np.ones(3))
    with pytest.raises(ValueError, match="volumes must be one number a point"):
        pd.read_points(file)
    file.write_bytes(b"PK no archive")
    with pytest.raises(ValueError, match=r"is damaged or no \.npz archive"):
        pd.read_points(file)


class Evil:
    def __reduce__(self):
        return (exec, ("raise SystemExit('code of the file was run')",))


@pytest.mark.parametrize("name", ["positions", "field"])
def test_no_code_of_an_archive_is_run(tmp_path, name):
    file = tmp_path / "a.npz"
    arrays = {"positions": np.arange(3.0), "volumes": np.ones(3)}
    np.savez(file, **(arrays | {name: np.array([Evil(), 1, 2], dtype=object)}), allow_pickle=True)
    if name == "positions":
        with pytest.raises(ValueError, match="positions must be numbers"):
            pd.read_points(file)
    else:
        assert "field" not in pd.read_points(file)[1].fields


def header(shape, dtype="<f8"):
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def test_huge_announced_shapes_are_refused_before_memory_is_taken(tmp_path):
    file = tmp_path / "a.npz"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("positions.npy", header((10**12, 2)) + bytes(64))
        archive.writestr("volumes.npy", header((10**12,)) + bytes(64))
    with pytest.raises(ValueError, match="announces an array of shape"):
        pd.read_points(file)


def test_a_bomb_of_zeros_is_refused(tmp_path):
    file = tmp_path / "a.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("positions.npy", header((4,)) + np.arange(4.0).tobytes())
        archive.writestr("volumes.npy", header((4,)) + np.ones(4).tobytes())
        archive.writestr("zeros.npy", header((2_000_000,)) + bytes(16_000_000))  # 16 kB in the file
    body, data = pd.read_points(file)  # the array is not loaded, since it is no field of 4 points
    assert len(body) == 4 and "zeros" not in data.fields
    raw = bytearray(file.read_bytes())
    at = raw.rfind(b"PK\x01\x02")
    raw[at + 24 : at + 28] = struct.pack("<I", 2**32 - 2)  # the announced size of the last array
    file.write_bytes(raw)
    with pytest.raises(ValueError, match="announces 4294967294 bytes"):
        pd.read_points(file)


@pytest.mark.parametrize("cut", [10, 100, 300, 400])
def test_truncated_archives_are_refused(tmp_path, cut):
    file = pd.write_points(tmp_path / "a.npz", BODY)
    file.write_bytes(file.read_bytes()[:cut])
    with pytest.raises(ValueError, match="damaged"):
        pd.read_points(file)


def test_a_flipped_bit_in_the_data_is_noticed(tmp_path):
    file = pd.write_points(tmp_path / "a.npz", pd.cloud(RNG.random((500, 2)), 1.0))
    raw = bytearray(file.read_bytes())
    raw[2000] ^= 8
    file.write_bytes(raw)
    with pytest.raises(ValueError, match="is damaged"):
        pd.read_points(file)


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".txt"])
@pytest.mark.parametrize(
    "fields, sets, words",
    [
        ({"u": np.zeros((14, 2))}, {}, r"field u must have shape \(15, …\)"),
        ({"u": "words"}, {}, "field u must be an array of numbers"),
        ({}, {"left": np.zeros(15)}, r"set left must be bool of shape \(15,\); got float64"),
        ({}, {"left": np.zeros(14, bool)}, r"set left must be bool of shape \(15,\)"),
        ({" ": np.zeros(15)}, {}, "names of fields and sets must be printable text"),
    ],
    ids=range(5),
)
def test_wrong_fields_are_not_written(tmp_path, suffix, fields, sets, words):
    with pytest.raises(ValueError, match=words):
        pd.write_points(tmp_path / f"a{suffix}", BODY, fields, sets)
    assert not list(tmp_path.iterdir())


def test_wrong_files_are_not_written(tmp_path):
    with pytest.raises(ValueError, match=r"path must end in \.txt, \.dat, \.csv or \.npz; got a\.vtk"):
        pd.write_points(tmp_path / "a.vtk", BODY)
    with pytest.raises(ValueError, match="points must not be periodic"):
        pd.write_points(tmp_path / "a.csv", pd.lattice((5, 3), periodic=True))
    with pytest.raises(ValueError, match="got volume twice"):
        pd.write_points(tmp_path / "a.csv", BODY, {"volume": np.ones(15)})
    with pytest.raises(ValueError, match="got positions twice"):
        pd.write_points(tmp_path / "a.npz", BODY, {"positions": np.ones(15)})
    with pytest.raises(ValueError, match="must be real"):
        pd.write_points(tmp_path / "a.csv", BODY, {"a": np.ones(15, complex)})
    with pytest.raises(ValueError, match="a scalar, a vector or a tensor"):
        pd.write_points(tmp_path / "a.csv", BODY, {"a": np.ones((15, 2, 2, 2))})
    with pytest.raises(FileNotFoundError, match="does not exist"):
        pd.write_points(tmp_path / "nowhere" / "a.csv", BODY)
    with pytest.raises(IsADirectoryError):
        (tmp_path / "b.csv").mkdir()
        pd.write_points(tmp_path / "b.csv", BODY)
    assert [f.name for f in tmp_path.iterdir()] == ["b.csv"]


def test_an_interrupted_write_leaves_the_earlier_file(tmp_path, monkeypatch):
    file = pd.write_points(tmp_path / "a.csv", BODY)
    before = file.read_bytes()
    monkeypatch.setattr("pdjax.files.write._write_table", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        pd.write_points(file, pd.lattice((2, 2)))
    assert file.read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_reading_warns_of_nothing(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for suffix in (".csv", ".npz", ".txt"):
            pd.read_points(pd.write_points(tmp_path / f"a{suffix}", BODY, FIELDS, SETS))
