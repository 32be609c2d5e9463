"""Public functions accept arrays of other libraries, and name an argument of the wrong kind in their errors."""

import inspect
import warnings

import numpy as np
import pytest

import pdjax as pd

LAW = pd.LinearElastic(1.0, 1.0)
MODEL, FAM = pd.SethHill(1.0, LAW), pd.lattice_family(2, 2)
BODY = pd.lattice((5, 4))
FAMS, X = pd.families(BODY, 2.0), BODY.positions
U = 1e-3 * np.random.default_rng(0).normal(size=(20, 2))
SCENE = pd.scene(BODY, FAMS, MODEL, pd.prescribe(X[:, 0] < 1, 0.0), pd.prescribe(X[:, 0] > 4, [0.01, 0.0]))
MOTION = pd.motion(SCENE, 1.0)


def read_only(x):
    x = np.array(x)
    x.setflags(write=False)
    return x


FOREIGN = {
    "big-endian": lambda x: np.asarray(x).astype(np.asarray(x).dtype.newbyteorder(">")),
    "Fortran": np.asfortranarray,
    "read-only": read_only,
    "list": lambda x: np.asarray(x).tolist(),
    "strided": lambda x: np.repeat(np.asarray(x), 2, axis=0)[::2],
    "unmasked": lambda x: np.ma.MaskedArray(x),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_arrays_of_other_libraries_are_accepted(kind):
    """The readers of meshio return big-endian arrays. Other libraries return lists, masked or read-only arrays."""
    as_given = FOREIGN[kind]
    cloud = pd.cloud(as_given(X), as_given(BODY.volumes))
    assert np.array_equal(cloud.positions, X)
    fams = pd.families(cloud, 2.0)
    f = pd.force_density(MODEL, fams, U)
    assert np.array_equal(pd.force_density(MODEL, fams, as_given(U)), f)
    graded = pd.graded(MODEL, as_given(np.linspace(1, 2, 20)))
    assert np.array_equal(
        pd.force_density(graded, fams, as_given(U)), pd.force_density(pd.graded(MODEL, np.linspace(1, 2, 20)), fams, U)
    )
    held = pd.prescribe(as_given(np.arange(4)), as_given(np.zeros((4, 2))))
    pull = pd.body_force(as_given(np.arange(16, 20)), as_given(np.full((4, 2), 1e-3)))
    scene = pd.scene(cloud, fams, MODEL, held, pull)
    assert pd.solve(scene, start=as_given(np.zeros((20, 2)))).converged
    assert pd.stability(MODEL, FAM, as_given(0.99 * np.eye(2))).verdict == "unstable"
    assert np.asarray(pd.symbol(MODEL, FAM, np.eye(2), as_given(np.ones((3, 2))))).shape == (3, 2, 2)
    assert np.array_equal(fams.with_weight(as_given(np.full(fams.weight.shape, 0.5))).weight, 0.5 * fams.weight)


def test_pandas_columns_and_integer_volumes_are_accepted():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"x": X[:, 0], "y": X[:, 1], "V": 1})
    cloud = pd.cloud(frame[["x", "y"]], frame["V"])
    assert np.array_equal(cloud.positions, X) and cloud.volumes.dtype == float


def test_integer_arrays_are_converted_to_floats():
    assert pd.cloud([[0, 0], [1, 0]], 1).positions.dtype == float
    assert not np.asarray(pd.force_density(MODEL, FAMS, np.zeros((20, 2), int))).any()


@pytest.mark.parametrize(
    "call",
    [
        lambda x: pd.cloud(x, 1.0),
        lambda x: pd.force_density(MODEL, FAMS, x),
        lambda x: pd.scene(BODY, FAMS, MODEL, pd.prescribe(np.arange(20), x)),
    ],
)
def test_masked_entries_raise_value_error(call):
    with pytest.raises(ValueError, match="1 masked entries"):
        call(np.ma.MaskedArray(U, mask=np.arange(40).reshape(20, 2) == 7))


OBJECTS = {
    "law": LAW,
    "model": MODEL,
    "family": FAM,
    "body": BODY,
    "families": FAMS,
    "scene": SCENE,
    "motion": MOTION,
    "condition": pd.prescribe([0], 0.0),
    "nothing": None,
    "text": "text",
    "function": pd.hydrostatic,
}
GOOD = {
    "model": MODEL,
    "family": FAM,
    "families": FAMS,
    "body": BODY,
    "points": BODY,
    "scene": SCENE,
    "motion": MOTION,
    "F": np.eye(2),
    "u": np.zeros((20, 2)),
    "v": np.zeros((20, 2)),
    "k": np.ones((3, 2)),
    "horizon": 2.0,
    "path": pd.hydrostatic,
    "surface": pd.Plane((2.2, 0.0), (1.0, 0.0)),
    "stress": np.zeros((20, 2, 2)),
    "dim": 2,
    "N": 2.0,
}
LONG = {
    "model_atlas",
    "advise",
    "use_compilation_cache",
    "stability_map",
    "stable_orders",
    "critical_load",
    "load_slope",
}  # left out, because a call takes long or writes files


def functions():
    return [n for n in dir(pd) if n[0] != "_" and inspect.isfunction(getattr(pd, n)) and n not in LONG]


@pytest.mark.parametrize("name", functions())
def test_every_function_names_an_argument_of_the_wrong_kind(name):
    """Each required argument is replaced by every other object: the call succeeds or raises a ValueError of pdjax."""
    function = getattr(pd, name)
    needed = [p for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    needed = [p for p in needed if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for place, replaced in enumerate(needed):
            for kind, value in OBJECTS.items():
                arguments = [value if i == place else GOOD.get(p.name, 1.0) for i, p in enumerate(needed)]
                try:
                    function(*arguments)
                except (ValueError, OSError) as error:
                    assert len(str(error)) > 20, (replaced.name, kind, error)
                except Exception as error:  # arguments that do not fit each other: a note states their shapes
                    assert getattr(error, "__notes__", None), (name, replaced.name, kind, repr(error))


def test_an_unknown_argument_name_raises_pythons_type_error():
    with pytest.raises(TypeError, match="unexpected keyword argument 'methode'"):
        pd.solve(SCENE, methode="newton")
