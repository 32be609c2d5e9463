"""Tests of `model_atlas` against `critical_load` and closed forms, of its file, and of maps of any model."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.cli import main
from pdjax.infinite_lattice.atlas import dispersion_error

LAW = pd.LinearElastic(1.0, 1.0)
SOME = ["bond-based", "Silling", "Seth–Hill 1", "Seth–Hill 1 + penalty", "LPS"]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("atlas") / "small.json"
    return pd.model_atlas(SOME, dims=(1,), N=(3,), save=path, show_progress=False), path


def test_critical_strains_are_those_of_critical_load(small):
    """They also equal closed forms: in 1D a St. Venant–Kirchhoff law loses its stiffness at the stretch s with
    3 s² = 1, and springs whose force is proportional to s − 1 never lose it."""
    found, _ = small
    fam = pd.lattice_family(1, 3)
    for name in SOME[:-1]:
        for side, word in (("compression", "negative"), ("tension", "positive")):
            value, before = found.find(name, 1, 3)["critical"]["hydrostatic"][side]
            exact = float(pd.critical_load(pd.CATALOGUE[name](LAW, fam), fam, side=word))
            assert value == pytest.approx(exact, abs=2e-5), (name, side)  # 1e-5 if marginal, else 1e-10
            assert before == {"Silling": "marginal"}.get(name, "unstable at once" if exact == 0 else "stable")
    value, _ = found.find("law", 1, 3)["critical"]["hydrostatic"]["compression"]
    assert value == pytest.approx(3**-0.5 - 1, abs=1e-8)  # 3e-11
    value, _ = found.find("Seth–Hill 1 + penalty", 1, 3)["critical"]["hydrostatic"]["compression"]
    assert value == pytest.approx(3**-0.5 - 1, abs=1e-8)  # 4e-11
    assert np.isinf(found.find("bond-based", 1, 3)["critical"]["hydrostatic"]["compression"][0])


def test_a_model_undefined_in_a_dimension_is_recorded_with_the_reason(small):
    assert "dimension 2 or 3" in small[0].find("LPS", 1, 3)["refused"]


def test_zero_energy_waves_of_silling_are_those_that_the_gradient_does_not_see():
    """In 1D these are the zeros of Σ ξ sin kξ. The test finds them by the sign changes of this sum."""
    k = np.linspace(1e-3, np.pi, 200_001)
    seen = sum(n * np.sin(k * n) for n in (1, 2, 3))
    exact = k[:-1][np.sign(seen[:-1]) != np.sign(seen[1:])] / np.pi
    waves = pd.zero_energy_waves(pd.Correspondence(LAW), pd.lattice_family(1, 3))
    np.testing.assert_allclose(waves[:, 0], [*exact[exact < 0.99], 1.0], atol=1e-3)
    assert len(pd.zero_energy_waves(pd.BondLevel(LAW), pd.lattice_family(1, 3))) == 0


def test_dispersion_error_of_silling_in_closed_form():
    n = np.arange(1, 4)
    exact = np.sum(n * np.sin(n)) / np.sum(n**2) - 1
    found = dispersion_error(pd.Correspondence(LAW), pd.lattice_family(1, 3, 0.2), LAW)
    assert found == [pytest.approx(exact, abs=1e-12)]  # 2e-16


def test_a_second_run_reads_the_saved_file_and_computes_nothing(small, monkeypatch):
    found, path = small
    monkeypatch.setattr("pdjax.infinite_lattice.atlas._record", lambda *_: pytest.fail("computed again"))
    again = pd.model_atlas(SOME, dims=(1,), N=(3,), save=path, show_progress=False)
    assert again.records == found.records == pd.Atlas.load(path).records


def test_a_second_run_measures_the_costs_that_the_saved_records_lack(tmp_path, monkeypatch):
    path = tmp_path / "atlas.json"
    settings = {"models": ["Silling", "LPS"], "dims": (1,), "N": (2,), "save": path, "show_progress": False}
    first = pd.model_atlas(**settings, cost=False)
    assert not any("cost" in record for record in first.records)
    monkeypatch.setattr("pdjax.infinite_lattice.atlas._record", lambda *_: pytest.fail("computed again"))
    again = pd.model_atlas(**settings, cost=True)
    assert again.find("Silling", 1, 2)["cost"] > 0
    without = [{key: value for key, value in record.items() if key != "cost"} for record in again.records]
    assert without == first.records
    assert not any("cost" in again.find(name, 1, 2) for name in ("law", "LPS"))  # LPS is not defined in 1D.
    assert pd.Atlas.load(path).records == again.records


def test_bad_input(small, tmp_path):
    _, path = small
    with pytest.raises(ValueError, match="model must be one of\n  'bond-based'"):
        pd.model_atlas(["unheard of"])
    with pytest.raises(ValueError, match="path must be one of hydrostatic"):
        pd.model_atlas(["Silling"], paths=["sideways"])
    with pytest.raises(ValueError, match="other settings"):
        pd.model_atlas(SOME, dims=(1,), law=pd.LinearElastic(2.0, 1.0), save=path)
    (tmp_path / "x.json").write_text("{")
    with pytest.raises(ValueError, match="not an atlas"):
        pd.Atlas.load(tmp_path / "x.json")
    with pytest.raises(ValueError, match="nothing for N = 7"):
        pd.figures.model_atlas(small[0], 7.0)


def test_command_line(tmp_path, capsys):
    out = tmp_path / "a"
    assert main(["atlas", "--dim", "1", "--N", "2", "--models", "Silling", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "1D, N = 2" in said and "-42.26" in said
    assert (tmp_path / "a.png").stat().st_size > 10_000
    assert len(json.loads((tmp_path / "a.json").read_text())["records"]) == 2
    assert main(["atlas", "--models", "none such", "--out", str(out)]) == 2


def test_zero_energy_controls_move_the_critical_load_of_seth_hill_to_that_of_the_law():
    """Without a control, m = 1 is unstable in compression at any load. With any of the three controls it becomes
    unstable at the critical load of the classical law."""
    fam = pd.lattice_family(2, 3)
    own = float(pd.critical_load(pd.Correspondence(LAW), fam, criterion="local"))
    assert own == pytest.approx(-0.1835034, abs=1e-7)
    for control in (pd.SillingControl(0.5), pd.WanControl(), pd.LittlewoodControl(0.3)):
        assert float(pd.critical_load(pd.SethHill(1.0, LAW, control), fam)) == pytest.approx(own, abs=1e-4), control


def test_a_map_of_any_model_of_one_parameter():
    """A map over the strength of a control and the load has the margins of single states."""
    strengths, loads = np.array([0.0, 0.1]), np.array([-0.02, 0.01])
    grid = pd.stability_map(
        strengths, loads, dim=1, model=lambda g: pd.SethHill(1.0, LAW, pd.SillingControl(g)), show_progress=False
    )
    fam = pd.lattice_family(1, 3)
    for i, g in enumerate(strengths):
        for j, a in enumerate(loads):
            alone = pd.stability(pd.SethHill(1.0, LAW, pd.SillingControl(g)), fam, (1 + a) * jnp.eye(1))
            assert grid.margin[i, j] == pytest.approx(float(alone.margin), abs=1e-14)
    assert grid.verdict.tolist() == [["unstable", "stable"], ["stable", "stable"]]
    with pytest.raises(ValueError, match="not both"):
        pd.stability_map(strengths, loads, law=LAW, model=lambda g: pd.SethHill(g, LAW))
    with pytest.raises(ValueError, match="function m -> pdjax model"):
        pd.stability_map(strengths, loads, model=lambda g: g)
