"""Tests of stability maps against single states, of their chunks and files, and of errors before the computation."""

import numpy as np
import pytest

import pdjax as pd
from pdjax.infinite_lattice import maps

M, A = np.array([-0.9, 0.1, 1.4]), np.array([-0.05, 0.0, 0.02, 0.08])


@pytest.fixture(scope="module")
def grid(law):
    return pd.stability_map(M, A, law=law, lines=("diagonal",), show_progress=False)


def test_margins_are_those_of_single_states(grid, law):
    fam = pd.lattice_family(2, 3)
    for i, m in enumerate(M):
        for j, a in enumerate(A):
            model, F = pd.SethHill(m, law), (1 + a) * np.eye(2)
            alone = pd.stability(model, fam, F)
            # Measured: 2e-17 on margins up to 3e-2. Batched and single searches end at the same wave.
            assert grid.margin[i, j] == pytest.approx(float(alone.margin), abs=1e-14)
            assert grid.eigenvalue[i, j] == pytest.approx(float(alone.eigenvalue), abs=1e-12)
            assert grid.verdict[i, j] == alone.verdict
            cheap = pd.stability(model, fam, F, criterion="diagonal")
            assert grid.lines["diagonal"][i, j] == pytest.approx(float(cheap.margin), abs=1e-14)


def test_chunks_and_horizons_change_nothing(grid, law, monkeypatch):
    monkeypatch.setattr(maps, "_CHUNK_BYTES", 1)  # The smallest chunk has 16 states, the map 12.
    both = pd.stability_map(M, A, N=(2, 3), law=law, lines=("diagonal",), show_progress=False)
    assert both.margin.shape == (2, 3, 4)
    np.testing.assert_array_equal(both.margin[1], grid.margin)
    np.testing.assert_array_equal(both.lines["diagonal"][1], grid.lines["diagonal"])
    assert both.settings["N"] == [2.0, 3.0] and both.settings["resolution"] == [16, 24]
    assert (both.verdict[0] != "undefined").all()


def test_lines_are_thinned_with_both_ends(law):
    m, a = np.linspace(-1, 1, 150), np.array([-0.01, 0.01])
    thin = pd.stability_map(m, a, law=law, criterion="diagonal", lines=("continuum",), show_progress=False)
    assert len(thin.line_m) == 64 and thin.line_m[0] == m[0] and thin.line_m[-1] == m[-1]
    # The continuum margin has the sign of −aΓ(m), and Γ is proportional to m in 2D.
    np.testing.assert_array_equal(np.sign(thin.lines["continuum"][:, 0]), np.sign(thin.line_m))


def test_save_and_load_keep_everything(grid, tmp_path):
    again = pd.StabilityMap.load(grid.save(tmp_path / "map.npz"))
    assert again.settings == grid.settings
    for name in maps._ARRAYS:
        np.testing.assert_array_equal(getattr(again, name), getattr(grid, name))
    np.testing.assert_array_equal(again.lines["diagonal"], grid.lines["diagonal"])
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]


def test_a_stopped_run_leaves_a_valid_partial_file(law, tmp_path, monkeypatch):
    """A run with save= that stops after its first chunk leaves a file in which the other states are undefined."""
    evaluated, calls = maps._evaluated, []

    def stop_at_the_second(*arguments):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return evaluated(*arguments)

    monkeypatch.setattr(maps, "_evaluated", stop_at_the_second)
    monkeypatch.setattr(maps, "_CHUNK_BYTES", 1)
    monkeypatch.setattr(maps, "_SAVE_EVERY", 0.0)
    target = tmp_path / "part.npz"
    with pytest.raises(KeyboardInterrupt):
        pd.stability_map(np.linspace(-1, 1, 8), A, law=law, criterion="diagonal", save=target, show_progress=False)
    verdict = pd.StabilityMap.load(target).verdict
    assert (verdict[:4] != "undefined").all() and (verdict[4:] == "undefined").all()


def test_states_that_do_not_exist_are_undefined(law):
    """A path that has no state at a load gives a NaN margin there."""
    found = pd.stability_map(
        np.array([1.0]), np.array([-0.8, 0.01]), law=law, path=no_state, criterion="block", show_progress=False
    )
    assert found.verdict.tolist() == [["undefined", "stable"]]


def no_state(a, model, fam):
    """A path that has no state in compression."""
    import jax.numpy as jnp

    return jnp.where(a > 0, 1 + a, jnp.nan) * jnp.eye(2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"m": [np.nan]}, "m must be finite"),
        ({"a": []}, "a must be a one-dimensional array with at least one entry"),
        ({"a": [-1.0, 0.1]}, "a must be > -1"),
        ({"N": 0.9}, "N .* must be finite and >= 1"),
        ({"N": 1}, "invertible shape tensor"),
        ({"dim": 4}, "dim must be 1, 2 or 3"),
        ({"criterion": "trace"}, "criterion must be one of"),
        ({"lines": ("trace",)}, "criterion must be one of"),
        ({"law": None}, "a law is needed"),
        ({"resolution": 1}, "resolution must be an integer >= 2"),
    ],
)
def test_bad_input_names_the_argument(change, words, law):
    arguments = {"m": M, "a": A, "law": law, **change}
    with pytest.raises(ValueError, match=words):
        pd.stability_map(**arguments)


def test_maps_too_large_or_unwritable_are_refused_before_the_computation(law, monkeypatch, tmp_path):
    monkeypatch.setattr(maps, "_chunk", lambda *_: pytest.fail("computed before checking"))
    with pytest.raises(OSError, match="does not exist"):
        pd.stability_map(M, A, law=law, save=tmp_path / "nowhere" / "map.npz")
    with pytest.raises(OSError, match="is a directory"):
        pd.stability_map(M, A, law=law, save=tmp_path)
    monkeypatch.setattr(maps, "_free_memory", lambda: 100.0)
    with pytest.raises(ValueError, match="GiB are free"):
        pd.stability_map(M, A, law=law)


@pytest.mark.parametrize("content", [b"", b"text", b"\x89PNG\r\n\x1a\n" + b"0" * 99, b"PK\x03\x04" + b"0" * 30])
def test_files_that_are_no_map_are_refused_without_unpickling(tmp_path, content):
    file = tmp_path / "map.npz"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=r"is not a map that StabilityMap\.save wrote"):
        pd.StabilityMap.load(file)
    np.savez(file, m=np.zeros(2))
    with pytest.raises(ValueError, match="is not a map"):
        pd.StabilityMap.load(file)
    with pytest.raises(FileNotFoundError, match="no map at"):
        pd.StabilityMap.load(tmp_path / "none.npz")


@pytest.mark.parametrize("m, a", [([1.0], [-0.1, 0.0, 0.1]), ([0.0, 1.0], [-0.1]), ([1.0], [-0.1])])
def test_a_map_of_one_row_is_drawn_as_lines(law, m, a):
    grid = pd.stability_map(m, a, law=law, lines=("diagonal",), show_progress=False)
    axes = pd.figures.stability_map(grid).axes[0]
    drawn = [line for line in axes.lines if line.get_label() and not line.get_label().startswith("_")]
    assert len(drawn) == 2 and np.array_equal(drawn[0].get_ydata(), grid.margin.reshape(-1))
